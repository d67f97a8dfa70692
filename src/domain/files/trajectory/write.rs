//! Trajectory → CSV.

use std::io::{self, Write};

use csv::Terminator;

use super::columns::{TableCell, cell};
use super::rows::BoxedRows;
use super::{COLUMNS, ROWS_PER_PIECE};
use crate::vision::trajectory::{Sample, Trajectory};

/// Writes the header and one line per sample, in the trajectory's order, ended by `\n`.
///
/// Fails where `out` fails, and with `InvalidData` on a sample that no reader could use: a number that is not finite,
/// or a tool without a name in the trajectory.
pub fn write_csv(trajectory: &Trajectory, out: impl Write) -> io::Result<()> {
    let mut table = table_writer(out);
    table.write_record(COLUMNS).map_err(into_io)?;
    trajectory.samples.iter().try_for_each(|sample| write_row(&mut table, &trajectory.tools, sample))?;
    table.flush()
}

/// Pieces of the same text; the rows are read once.
pub struct CsvPieces {
    rows: BoxedRows,
    has_header: bool,
    has_ended: bool,
}

impl CsvPieces {
    /// The text of these rows.
    pub fn new(mut rows: BoxedRows) -> Self {
        rows.rewind();
        Self { rows, has_header: false, has_ended: false }
    }

    fn write_piece(&mut self) -> io::Result<Vec<u8>> {
        let mut table = table_writer(Vec::new());
        if !self.has_header {
            table.write_record(COLUMNS).map_err(into_io)?;
            self.has_header = true;
        }
        for _ in 0..ROWS_PER_PIECE {
            match self.rows.next_row()? {
                Some(row) => write_row(&mut table, self.rows.tools(), &row)?,
                None => {
                    self.has_ended = true;
                    break;
                }
            }
        }
        table.into_inner().map_err(csv::IntoInnerError::into_error)
    }
}

impl Iterator for CsvPieces {
    type Item = io::Result<Vec<u8>>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.has_ended {
            return None;
        }
        let piece = self.write_piece();
        self.has_ended |= piece.is_err();
        Some(piece)
    }
}

fn table_writer<W: Write>(out: W) -> csv::Writer<W> {
    csv::WriterBuilder::new().terminator(Terminator::Any(b'\n')).from_writer(out)
}

fn write_row(table: &mut csv::Writer<impl Write>, tools: &[String], row: &Sample) -> io::Result<()> {
    for (column, name) in COLUMNS.iter().enumerate() {
        let written = match cell(row, column) {
            TableCell::Frame(frame) => table.write_field(frame.to_string()),
            TableCell::Tool(tool) => table.write_field(tools.get(tool).ok_or_else(|| unusable_value(row, name))?),
            TableCell::State(state) => table.write_field(state),
            TableCell::Number(None) => table.write_field(""),
            TableCell::Number(Some(value)) if value.is_finite() => table.write_field(value.to_string()),
            TableCell::Number(Some(_)) => return Err(unusable_value(row, name)),
        };
        written.map_err(into_io)?;
    }
    table.write_record(None::<&[u8]>).map_err(into_io)
}

fn unusable_value(sample: &Sample, column: &str) -> io::Error {
    let what = format!("frame {}, tool {}: `{column}` is not a usable value", sample.frame, sample.tool);
    io::Error::new(io::ErrorKind::InvalidData, what)
}

/// The stream's own error with its kind, if the CSV error has one.
fn into_io(error: csv::Error) -> io::Error {
    match error.into_kind() {
        csv::ErrorKind::Io(error) => error,
        other => io::Error::other(format!("{other:?}")),
    }
}
