//! The rows of a table that need not be in memory: they are read one by one, and as often as a format needs them.

use std::io;

use crate::vision::trajectory::Sample;

/// Maximum number of rows that [`hold_if_few`] keeps in memory; they take 1.6 MiB. The overview of a session with two
/// tools has 8,000.
pub const MAX_HELD_ROWS: usize = 8_192;

/// Rows in order of frame and tool, which can be read several times.
pub trait RowSource: Send {
    /// Names of the tools; [`Sample::tool`] is an index into this list.
    fn tools(&self) -> &[String];

    /// The next row; `None` after the last one.
    ///
    /// # Errors
    /// The rows cannot be read.
    fn next_row(&mut self) -> io::Result<Option<Sample>>;

    /// Continues with the first row.
    fn rewind(&mut self);
}

/// Any source of rows.
pub type BoxedRows = Box<dyn RowSource>;

/// Rows in memory.
#[derive(Debug)]
pub struct HeldRows {
    tools: Vec<String>,
    rows: Vec<Sample>,
    next: usize,
}

impl HeldRows {
    /// These rows of these tools.
    pub fn new(tools: Vec<String>, rows: Vec<Sample>) -> Self {
        Self { tools, rows, next: 0 }
    }
}

impl RowSource for HeldRows {
    fn tools(&self) -> &[String] {
        &self.tools
    }

    fn next_row(&mut self) -> io::Result<Option<Sample>> {
        let row = self.rows.get(self.next).copied();
        self.next += usize::from(row.is_some());
        Ok(row)
    }

    fn rewind(&mut self) {
        self.next = 0;
    }
}

/// Keeps the rows in memory if they are few, for a format that reads them once for each column.
///
/// # Errors
/// The rows cannot be read.
pub fn hold_if_few(mut source: BoxedRows) -> io::Result<BoxedRows> {
    let mut rows = Vec::new();
    source.rewind();
    while let Some(row) = source.next_row()? {
        if rows.len() == MAX_HELD_ROWS {
            source.rewind();
            return Ok(source);
        }
        rows.push(row);
    }
    Ok(Box::new(HeldRows::new(source.tools().to_vec(), rows)))
}
