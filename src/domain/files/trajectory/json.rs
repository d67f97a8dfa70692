//! Trajectory → JSON columns, which pages plot: `{"tools":[…],"columns":{"frame":[…],…,"state":[…]}}`, where the column
//! `tool` holds indices into `tools` and an absent number is `null`. A thinned table also has `after_gap` for each row
//! and `thinned`: whether any rows were removed.
//!
//! The rows are read once for each column, so that a table of any length is written in the memory of one piece.

use std::io;

use super::columns::{TableCell, cell};
use super::rows::{BoxedRows, hold_if_few};
use super::thin::{ThinnedRows, Thinning};
use super::{COLUMNS, PIECE_BYTES};

/// Pieces of the JSON text.
pub struct JsonPieces {
    rows: BoxedRows,
    /// If the rows are thinned: the rows that remain.
    thinning: Option<Thinning>,
    next: JsonPart,
}

/// The part of the text that comes next.
enum JsonPart {
    Tools,
    Column(usize),
    Cell { column: usize, is_first: bool },
    End,
    Nothing,
}

impl JsonPieces {
    /// The text of these rows.
    ///
    /// # Errors
    /// The rows cannot be read.
    pub fn new(rows: BoxedRows) -> io::Result<Self> {
        Ok(Self { rows: hold_if_few(rows)?, thinning: None, next: JsonPart::Tools })
    }

    /// The text of the rows that a thinning leaves.
    ///
    /// # Errors
    /// The rows cannot be read.
    pub fn thinned(rows: BoxedRows, thinning: Thinning) -> io::Result<Self> {
        let rows = hold_if_few(Box::new(ThinnedRows::new(rows, thinning.clone())))?;
        Ok(Self { rows, thinning: Some(thinning), next: JsonPart::Tools })
    }

    fn write_part(&mut self, piece: &mut Vec<u8>) -> io::Result<()> {
        self.next = match self.next {
            JsonPart::Tools => {
                piece.extend(b"{\"tools\":");
                serde_json::to_writer(&mut *piece, self.rows.tools())?;
                piece.extend(b",\"columns\":{");
                JsonPart::Column(0)
            }
            JsonPart::Column(column) => {
                let comma = if column == 0 { "" } else { "," };
                piece.extend(format!("{comma}\"{}\":[", COLUMNS[column]).bytes());
                self.rows.rewind();
                JsonPart::Cell { column, is_first: true }
            }
            JsonPart::Cell { column, is_first } => match self.rows.next_row()? {
                Some(row) => {
                    piece.extend((!is_first).then_some(b','));
                    match cell(&row, column) {
                        TableCell::Frame(frame) => serde_json::to_writer(piece, &frame)?,
                        TableCell::Tool(tool) => serde_json::to_writer(piece, &tool)?,
                        TableCell::State(state) => serde_json::to_writer(piece, state)?,
                        TableCell::Number(number) => serde_json::to_writer(piece, &number)?, // not finite: null
                    }
                    JsonPart::Cell { column, is_first: false }
                }
                None => {
                    piece.push(b']');
                    if column + 1 < COLUMNS.len() { JsonPart::Column(column + 1) } else { JsonPart::End }
                }
            },
            JsonPart::End => {
                piece.push(b'}');
                if let Some(thinning) = &self.thinning {
                    piece.extend(b",\"after_gap\":");
                    serde_json::to_writer(&mut *piece, &thinning.after_gap().collect::<Vec<_>>())?;
                    piece.extend(format!(",\"thinned\":{}", thinning.is_thinned()).bytes());
                }
                piece.push(b'}');
                JsonPart::Nothing
            }
            JsonPart::Nothing => JsonPart::Nothing,
        };
        Ok(())
    }
}

impl Iterator for JsonPieces {
    type Item = io::Result<Vec<u8>>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut piece = Vec::with_capacity(PIECE_BYTES);
        while piece.len() < PIECE_BYTES && !matches!(self.next, JsonPart::Nothing) {
            if let Err(error) = self.write_part(&mut piece) {
                self.next = JsonPart::Nothing;
                return Some(Err(error));
            }
        }
        (!piece.is_empty()).then_some(Ok(piece))
    }
}
