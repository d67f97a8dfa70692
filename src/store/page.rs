//! Paged lists. A cursor is the sort key of the last item, so rows added or removed between two requests neither repeat
//! nor hide another row.

/// Which part of a list to return.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageRequest {
    /// Maximum number of items, 1 to [`PageRequest::MAX_LIMIT`].
    limit: u32,
    /// Cursor of the previous page; `None` for the first page.
    after: Option<String>,
}

impl PageRequest {
    /// Maximum number of items on one page.
    pub const MAX_LIMIT: u32 = 200;

    /// The page of `limit` items after this cursor; `limit` is clamped to the allowed range.
    pub fn new(limit: u32, after: Option<String>) -> Self {
        Self { limit: limit.clamp(1, Self::MAX_LIMIT), after }
    }

    /// Number of rows to query: one more than the page holds, to know whether there is a next page.
    pub(super) fn row_limit(&self) -> i64 {
        i64::from(self.limit) + 1
    }

    /// The cursor, to bind in the query.
    pub(super) fn after(&self) -> Option<&str> {
        self.after.as_deref()
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
    pub next: Option<String>,
}

impl<T> Page<T> {
    /// Makes a page of the queried rows and removes the extra one; `cursor` returns an item's sort key.
    pub(super) fn from_rows(mut rows: Vec<T>, request: &PageRequest, cursor: impl Fn(&T) -> String) -> Self {
        let more = rows.len() as i64 == request.row_limit();
        rows.truncate(request.limit as usize);
        let next = rows.last().filter(|_| more).map(cursor);
        Self { items: rows, next }
    }

    /// Converts the items of the page.
    pub fn map<U>(self, f: impl FnMut(T) -> U) -> Page<U> {
        Page { items: self.items.into_iter().map(f).collect(), next: self.next }
    }
}
