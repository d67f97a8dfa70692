//! Lists by the page. A cursor is the sort key of the last item, so that rows that come or go between two pages neither
//! repeat nor hide another.

/// Which part of a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageRequest {
    /// Most items, 1 to [`PageRequest::MOST`].
    limit: u32,
    /// Cursor of the page before; `None` for the first page.
    after: Option<String>,
}

impl PageRequest {
    /// Most items that one page may hold.
    pub const MOST: u32 = 200;

    /// The page after this cursor with so many items; a limit out of bounds becomes the nearest one inside.
    pub fn new(limit: u32, after: Option<String>) -> Self {
        Self { limit: limit.clamp(1, Self::MOST), after }
    }

    /// One row more than the page holds: it tells whether there is a next page.
    pub(super) fn rows(&self) -> i64 {
        i64::from(self.limit) + 1
    }

    /// The cursor to bind.
    pub(super) fn after(&self) -> Option<&str> {
        self.after.as_deref()
    }
}

impl Default for PageRequest {
    fn default() -> Self {
        Self::new(50, None)
    }
}

/// Part of a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Page<T> {
    /// The items.
    pub items: Vec<T>,
    /// Cursor of the next page; `None` if this is the last.
    pub next: Option<String>,
}

impl<T> Page<T> {
    /// Cuts the row too many off; `cursor` is an item's sort key.
    pub(super) fn cut(mut rows: Vec<T>, request: &PageRequest, cursor: impl Fn(&T) -> String) -> Self {
        let more = rows.len() as i64 == request.rows();
        rows.truncate(request.limit as usize);
        let next = rows.last().filter(|_| more).map(cursor);
        Self { items: rows, next }
    }

    /// The same page of something made from the items.
    pub fn map<U>(self, f: impl FnMut(T) -> U) -> Page<U> {
        Page { items: self.items.into_iter().map(f).collect(), next: self.next }
    }
}
