//! Paged lists. A cursor is the sort key of the last item, so rows added or removed between two requests neither repeat
//! nor hide another row.

use std::fmt;

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;

/// The place in a list where a page ended. As text it has a check sum of the list's name and the place, so that a
/// damaged cursor and one of another list are recognised and not taken for another place. Its characters need no
/// encoding in an address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cursor {
    list: String,
    key: String,
}

/// Text that is no cursor of the list, or a damaged one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("is not a cursor of this list, or is damaged: use `next` of the previous page, or no cursor for the first one")]
pub struct NotACursor;

impl Cursor {
    /// Reads the text of a cursor of the list with this name.
    pub fn parse(text: &str, list: &str) -> Result<Self, NotACursor> {
        let bytes = URL_SAFE_NO_PAD.decode(text).map_err(|_| NotACursor)?;
        let (stated, key) = bytes.split_first_chunk::<4>().ok_or(NotACursor)?;
        if check_sum(list, key) != *stated {
            return Err(NotACursor);
        }
        String::from_utf8(key.to_vec()).map(|key| Self { list: list.to_owned(), key }).map_err(|_| NotACursor)
    }
}

fn check_sum(list: &str, key: &[u8]) -> [u8; 4] {
    crc32fast::hash(&[list.as_bytes(), &[0], key].concat()).to_be_bytes()
}

impl fmt::Display for Cursor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let key = self.key.as_bytes();
        f.write_str(&URL_SAFE_NO_PAD.encode([check_sum(&self.list, key).as_slice(), key].concat()))
    }
}

/// Which part of a list to return.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageRequest {
    /// Name of the list, for the text of the next page's cursor; empty if the cursor is not sent.
    list: String,
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
        Self { list: String::new(), limit: limit.clamp(1, Self::MAX_LIMIT), after }
    }

    /// The same page of a list with this name, for a client that gets the next page's cursor.
    pub fn of_list(self, list: String) -> Self {
        Self { list, ..self }
    }

    /// Number of rows to query: one more than the page holds, to know whether there is a next page.
    pub(super) fn row_limit(&self) -> i64 {
        i64::from(self.limit) + 1
    }

    /// The sort key after which the page begins, to bind in the query.
    pub(super) fn after(&self) -> Option<&str> {
        self.after.as_ref().map(|cursor| cursor.key.as_str())
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
        let next = rows.last().filter(|_| more).map(|last| Cursor { list: request.list.clone(), key: sort_key(last) });
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
    fn a_cursor_survives_its_text_and_a_damaged_or_foreign_one_is_refused() {
        for list in ["people", "cohort-members/0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44"] {
            for key in ["", "peg", "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44", "1.2.3.x", "Grundkurs für Anfänger"] {
                let cursor = Cursor { list: list.to_owned(), key: key.to_owned() };
                let text = cursor.to_string();
                assert_eq!(Cursor::parse(&text, list), Ok(cursor), "{text}");
                let of_another = "cohort-members/0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a45";
                for other in ["tasks", "peoplf", "peopl", "people-of-a-group", "cohort-members", of_another, ""] {
                    assert_eq!(Cursor::parse(&text, other), Err(NotACursor), "{text} as one of `{other}`");
                }
                for at in 0..text.len() {
                    let other = if text.as_bytes()[at] == b'A' { "B" } else { "A" };
                    let changed = [&text[..at], other, &text[at + 1..]].concat();
                    assert_eq!(Cursor::parse(&changed, list), Err(NotACursor), "{changed}");
                    assert_eq!(Cursor::parse(&text[..at], list), Err(NotACursor), "{}", &text[..at]);
                }
            }
        }
        for text in ["peg", "17", "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44", "%", "🪡"] {
            assert_eq!(Cursor::parse(text, "people"), Err(NotACursor), "{text}");
        }
    }
}
