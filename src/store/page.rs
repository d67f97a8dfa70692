//! Paged lists. A cursor is the sort key of the last item, so rows added or removed between two requests neither repeat
//! nor hide another row.

use std::fmt;
use std::str::FromStr;

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;

/// The place in a list where a page ended. As text it has a check sum, so that a damaged cursor is recognised and not
/// taken for another place; its characters need no encoding in an address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cursor(String);

/// Text that is no cursor, or a damaged one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "is not a cursor of this service, or is damaged: use `next` of the previous page, or no cursor for the first one"
)]
pub struct NotACursor;

impl fmt::Display for Cursor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let check_sum = crc32fast::hash(self.0.as_bytes()).to_be_bytes();
        f.write_str(&URL_SAFE_NO_PAD.encode([check_sum.as_slice(), self.0.as_bytes()].concat()))
    }
}

impl FromStr for Cursor {
    type Err = NotACursor;

    fn from_str(text: &str) -> Result<Self, NotACursor> {
        let bytes = URL_SAFE_NO_PAD.decode(text).map_err(|_| NotACursor)?;
        let (check_sum, key) = bytes.split_first_chunk::<4>().ok_or(NotACursor)?;
        if crc32fast::hash(key) != u32::from_be_bytes(*check_sum) {
            return Err(NotACursor);
        }
        String::from_utf8(key.to_vec()).map(Self).map_err(|_| NotACursor)
    }
}

/// Which part of a list to return.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageRequest {
    /// Maximum number of items, 1 to [`PageRequest::MAX_LIMIT`].
    limit: u32,
    /// Cursor of the previous page; `None` for the first page.
    after: Option<Cursor>,
}

impl PageRequest {
    /// Maximum number of items on one page.
    pub const MAX_LIMIT: u32 = 200;

    /// The page of `limit` items after this cursor; `limit` is clamped to the allowed range.
    pub fn new(limit: u32, after: Option<Cursor>) -> Self {
        Self { limit: limit.clamp(1, Self::MAX_LIMIT), after }
    }

    /// Number of rows to query: one more than the page holds, to know whether there is a next page.
    pub(super) fn row_limit(&self) -> i64 {
        i64::from(self.limit) + 1
    }

    /// The sort key after which the page begins, to bind in the query.
    pub(super) fn after(&self) -> Option<&str> {
        self.after.as_ref().map(|cursor| cursor.0.as_str())
    }
}

impl Default for PageRequest {
    fn default() -> Self {
        Self::new(50, None)
    }
}

/// One page of a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Page<T> {
    /// The items.
    pub items: Vec<T>,
    /// Cursor of the next page; `None` if this is the last.
    pub next: Option<Cursor>,
}

impl<T> Page<T> {
    /// Makes a page of the queried rows and removes the extra one; `sort_key` returns an item's sort key.
    pub(super) fn from_rows(mut rows: Vec<T>, request: &PageRequest, sort_key: impl Fn(&T) -> String) -> Self {
        let more = rows.len() as i64 == request.row_limit();
        rows.truncate(request.limit as usize);
        let next = rows.last().filter(|_| more).map(sort_key).map(Cursor);
        Self { items: rows, next }
    }

    /// Converts the items of the page.
    pub fn map<U>(self, f: impl FnMut(T) -> U) -> Page<U> {
        Page { items: self.items.into_iter().map(f).collect(), next: self.next }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_survives_its_text_and_a_damaged_one_is_refused() {
        for key in ["", "peg", "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44", "1.2.3.x", "Grundkurs für Anfänger"] {
            let cursor = Cursor(key.to_owned());
            let text = cursor.to_string();
            assert_eq!(text.parse::<Cursor>(), Ok(cursor), "{text}");
            for at in 0..text.len() {
                let other = if text.as_bytes()[at] == b'A' { "B" } else { "A" };
                let changed = [&text[..at], other, &text[at + 1..]].concat();
                assert_eq!(changed.parse::<Cursor>(), Err(NotACursor), "{changed}");
                assert_eq!(text[..at].parse::<Cursor>(), Err(NotACursor), "{}", &text[..at]);
            }
        }
        for text in ["peg", "17", "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44", "%", "🪡"] {
            assert_eq!(text.parse::<Cursor>(), Err(NotACursor), "{text}");
        }
    }
}
