//! Frames of a blob of [`Diagnostics`](crate::analysis::diagnostics::Diagnostics): a JSON text in columns. Only the
//! service writes these files, so no value has more than [`MAX_VALUE_BYTES`], and no blanks lie between values.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::sync::Arc;

use super::ROWS_PER_BLOCK;
use super::window::{WINDOW_BYTES, WindowReader};

/// Longest value of a column, bytes: four numbers of a border have at most 80.
const MAX_VALUE_BYTES: usize = 512;

/// Approximate size of a piece of an answer, bytes.
const PIECE_BYTES: usize = 64 * 1024;

/// Text between the file's head and its columns. It cannot be part of a tool's name, where quotes are escaped.
const COLUMNS_MARK: &[u8] = b"\"columns\":{";

/// The columns that select rows: the first two of each file.
const KEY_COLUMNS: [&[u8]; 2] = [b"frame", b"tool"];

/// Why diagnostics cannot be read by frames.
#[derive(Debug, thiserror::Error)]
pub enum DiagnosticsError {
    /// Another kind of file.
    #[error("not a file of diagnostics: {0} at byte {1}")]
    Damaged(&'static str, u64),
    /// The file cannot be read.
    #[error("a file of diagnostics cannot be read: {0}")]
    Unreadable(#[from] io::Error),
}

impl From<DiagnosticsError> for io::Error {
    fn from(error: DiagnosticsError) -> Self {
        match error {
            DiagnosticsError::Unreadable(error) => error,
            DiagnosticsError::Damaged(..) => io::Error::new(io::ErrorKind::InvalidData, error),
        }
    }
}

/// Where the columns of a file are.
#[derive(Debug)]
pub(super) struct DiagnosticsIndex {
    /// The text before the columns.
    head: Vec<u8>,
    columns: Vec<ColumnIndex>,
    rows: u64,
    /// Frame of the first row of each block.
    first_frames: Vec<u64>,
}

/// Name of a column and places of its values, once every [`ROWS_PER_BLOCK`].
#[derive(Debug)]
struct ColumnIndex {
    name: Vec<u8>,
    blocks: Vec<u64>,
}

/// What follows a value.
#[derive(Clone, Copy, PartialEq)]
enum Follower {
    Value,
    EndOfColumn,
}

impl DiagnosticsIndex {
    /// Reads the whole file once.
    pub(super) fn build(file: Arc<File>) -> Result<Self, DiagnosticsError> {
        let mut reader = WindowReader::new(file);
        let window = reader.peek(WINDOW_BYTES)?;
        let mark = window.windows(COLUMNS_MARK.len()).position(|bytes| bytes == COLUMNS_MARK);
        let mark = mark.ok_or(DiagnosticsError::Damaged("no columns", 0))?;
        let head = window[..mark + COLUMNS_MARK.len()].to_vec();
        reader.skip(head.len());
        let mut index = Self { head, columns: Vec::new(), rows: 0, first_frames: Vec::new() };
        loop {
            index.read_column(&mut reader)?;
            match reader.peek(1)?.first() {
                Some(b',') => reader.skip(1),
                Some(b'}') => break,
                _ => return Err(DiagnosticsError::Damaged("no end of the columns", reader.position())),
            }
        }
        let names = index.columns.iter().map(|column| column.name.as_slice());
        if names.take(KEY_COLUMNS.len()).eq(KEY_COLUMNS) {
            Ok(index)
        } else {
            Err(DiagnosticsError::Damaged("no column `frame` or `tool`", 0))
        }
    }

    /// Reads `"name":[value,…]`.
    fn read_column(&mut self, reader: &mut WindowReader) -> Result<(), DiagnosticsError> {
        let at = reader.position();
        let damaged = |what| DiagnosticsError::Damaged(what, at);
        let window = reader.peek(MAX_VALUE_BYTES)?;
        let end = window.windows(3).position(|bytes| bytes == b"\":[").ok_or_else(|| damaged("no column"))?;
        let name = window[..end].strip_prefix(b"\"").ok_or_else(|| damaged("no name of a column"))?.to_vec();
        reader.skip(end + 3);
        let is_frame = self.columns.is_empty();
        let (mut rows, mut blocks, mut frame_before) = (0, Vec::new(), 0);
        let mut has_more = reader.peek(1)?.first() != Some(&b']');
        if !has_more {
            reader.skip(1);
        }
        while has_more {
            let at = reader.position();
            let (value, follower) = next_value(reader)?;
            if is_frame {
                let frame = parse_number(value).ok_or(DiagnosticsError::Damaged("no frame", at))?;
                if frame < frame_before {
                    return Err(DiagnosticsError::Damaged("a frame out of order", at));
                }
                if rows % ROWS_PER_BLOCK == 0 {
                    self.first_frames.push(frame);
                }
                frame_before = frame;
            }
            if rows % ROWS_PER_BLOCK == 0 {
                blocks.push(at);
            }
            rows += 1;
            has_more = follower != Follower::EndOfColumn;
        }
        if !is_frame && rows != self.rows {
            return Err(damaged("a column of another length"));
        }
        self.rows = rows;
        self.columns.push(ColumnIndex { name, blocks });
        Ok(())
    }
}

/// Reads a value and the byte after it.
fn next_value(reader: &mut WindowReader) -> Result<(&[u8], Follower), DiagnosticsError> {
    let at = reader.position();
    let window = reader.peek(MAX_VALUE_BYTES)?;
    let (mut depth, mut is_text) = (0, false);
    let mut end = None;
    for (index, byte) in window.iter().enumerate().take(MAX_VALUE_BYTES) {
        match byte {
            b'"' => is_text = !is_text,
            _ if is_text => {}
            b'[' => depth += 1,
            b',' if depth == 0 => end = Some((index, Follower::Value)),
            b']' if depth == 0 => end = Some((index, Follower::EndOfColumn)),
            b']' => depth -= 1,
            _ => {}
        }
        if end.is_some() {
            break;
        }
    }
    let (end, follower) = end.ok_or(DiagnosticsError::Damaged("a value without an end", at))?;
    reader.skip(end + 1);
    Ok((reader.before(end + 1, end), follower))
}

fn parse_number(value: &[u8]) -> Option<u64> {
    std::str::from_utf8(value).ok()?.parse().ok()
}

/// A blob of diagnostics that is read by frames.
#[derive(Clone, Debug)]
pub struct StoredDiagnostics {
    file: Arc<File>,
    index: Arc<DiagnosticsIndex>,
}

/// The index under which a tool appears on a frame.
pub type NameAt = Box<dyn FnMut(u64, u32) -> io::Result<u32> + Send>;

impl StoredDiagnostics {
    pub(super) fn new(file: Arc<File>, index: Arc<DiagnosticsIndex>) -> Self {
        Self { file, index }
    }

    /// The document with these frames alone, in pieces. `name_at` renames the tools.
    pub fn select_frames(&self, frames: Range<u64>, name_at: NameAt) -> DiagnosticsPieces {
        let values = ColumnReader::new(self, 0, 0);
        let keys = [ColumnReader::new(self, 0, 0), ColumnReader::new(self, 1, 0)];
        DiagnosticsPieces {
            stored: self.clone(),
            frames,
            name_at,
            column: 0,
            is_first: true,
            has_head: false,
            keys,
            values,
        }
    }
}

/// Values of one column from a row on.
struct ColumnReader {
    reader: WindowReader,
    /// Rows before the position.
    row: u64,
    rows: u64,
}

impl ColumnReader {
    /// From the first row of this block on.
    fn new(stored: &StoredDiagnostics, column: usize, block: usize) -> Self {
        let mut reader = WindowReader::new(stored.file.clone());
        let index = &stored.index;
        let at = index.columns[column].blocks.get(block);
        reader.seek(at.copied().unwrap_or_default());
        let row = if at.is_some() { block as u64 * ROWS_PER_BLOCK } else { index.rows };
        Self { reader, row, rows: index.rows }
    }

    /// The next value; `None` after the last one.
    fn next(&mut self) -> io::Result<Option<&[u8]>> {
        if self.row >= self.rows {
            return Ok(None);
        }
        self.row += 1;
        Ok(Some(next_value(&mut self.reader)?.0))
    }

    fn next_number(&mut self) -> io::Result<Option<u64>> {
        let value = self.next()?;
        value.map(|value| parse_number(value).ok_or_else(|| io::ErrorKind::InvalidData.into())).transpose()
    }
}

/// Pieces of a document with some of the frames. Each column is read with frames and tools beside it, so that a document
/// of any length needs the memory of a few windows.
pub struct DiagnosticsPieces {
    stored: StoredDiagnostics,
    frames: Range<u64>,
    name_at: NameAt,
    /// The column that is being written.
    column: usize,
    /// Whether its next row is its first one.
    is_first: bool,
    has_head: bool,
    /// The frames and tools of the rows to come.
    keys: [ColumnReader; 2],
    /// The values of the rows to come.
    values: ColumnReader,
}

impl DiagnosticsPieces {
    fn write_piece(&mut self) -> io::Result<Vec<u8>> {
        let mut piece = Vec::with_capacity(PIECE_BYTES);
        if !self.has_head {
            piece.extend(&self.stored.index.head);
            self.begin_column(&mut piece);
            self.has_head = true;
        }
        while piece.len() < PIECE_BYTES && self.column < self.stored.index.columns.len() {
            if self.write_frame(&mut piece)? {
                continue;
            }
            piece.push(b']');
            self.column += 1;
            if self.column < self.stored.index.columns.len() {
                piece.push(b',');
                self.begin_column(&mut piece);
            } else {
                piece.extend(b"}}");
            }
        }
        Ok(piece)
    }

    /// Moves to the first of the frames in the next column.
    fn begin_column(&mut self, piece: &mut Vec<u8>) {
        let index = &self.stored.index;
        piece.push(b'"');
        piece.extend(&index.columns[self.column].name);
        piece.extend(b"\":[");
        // The rows of a frame may begin in the block before the first one that begins with the frame.
        let block = index.first_frames.partition_point(|frame| *frame < self.frames.start).saturating_sub(1);
        self.keys = [0, 1].map(|column| ColumnReader::new(&self.stored, column, block));
        self.values = ColumnReader::new(&self.stored, self.column, block);
        self.is_first = true;
    }

    /// Writes the column's values on the next frame, in order of the tools' names. False if there is no further frame.
    fn write_frame(&mut self, piece: &mut Vec<u8>) -> io::Result<bool> {
        let mut values: Vec<(u32, Vec<u8>)> = Vec::new();
        let mut of_frame = None;
        loop {
            let before = self.keys[0].reader.position();
            let Some(frame) = self.keys[0].next_number()? else { break };
            if of_frame.is_some_and(|of| of != frame) || frame >= self.frames.end {
                self.keys[0].reader.seek(before);
                self.keys[0].row -= 1;
                break;
            }
            let tool = self.keys[1].next_number()?.ok_or(io::ErrorKind::InvalidData)?;
            let value = self.values.next()?.ok_or(io::ErrorKind::InvalidData)?;
            if frame < self.frames.start {
                continue;
            }
            of_frame = Some(frame);
            let name = (self.name_at)(frame, tool as u32)?;
            let value = if self.column == 1 { name.to_string().into_bytes() } else { value.to_vec() };
            values.push((name, value));
        }
        values.sort_by_key(|(name, _)| *name);
        for (_, value) in &values {
            piece.extend((!std::mem::take(&mut self.is_first)).then_some(b','));
            piece.extend(value);
        }
        Ok(!values.is_empty())
    }
}

impl Iterator for DiagnosticsPieces {
    type Item = io::Result<Vec<u8>>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.column >= self.stored.index.columns.len() {
            return None;
        }
        let piece = self.write_piece();
        if piece.is_err() {
            self.column = self.stored.index.columns.len();
        }
        Some(piece)
    }
}
