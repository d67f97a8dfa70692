//! Rows of a stored path with edits applied, read one by one.

use std::collections::VecDeque;
use std::io;
use std::ops::Range;

use super::{Swaps, WHOLE_RECORDING, is_within};
use crate::analysis::stored_rows::{StoredPathRows, StoredPaths};
use crate::domain::edit::{EditChange, kept_span};
use crate::domain::files::trajectory::RowSource;
use crate::vision::trajectory::{Cut, PathKind, Sample};

/// The rows that [`apply_edits`](super::apply_edits) leaves of a path, without the whole path in memory.
pub struct EditedRows {
    tools: Vec<String>,
    rows: StoredPathRows,
    /// The stretch that trims leave, s.
    span: [f64; 2],
    swaps: Swaps,
    frames: Range<u64>,
    /// The rows of a frame under their new names; empty without swaps.
    of_frame: VecDeque<Sample>,
    /// The first row of the frame after it, under its tracked name.
    ahead: Option<Sample>,
}

impl EditedRows {
    /// The rows of these frames, with these edits.
    pub fn new(stored: &StoredPaths, kind: PathKind, changes: &[EditChange], frames: Range<u64>) -> Self {
        Self {
            tools: stored.tools().to_vec(),
            rows: stored.rows(kind, frames.start),
            span: kept_span(changes).unwrap_or(WHOLE_RECORDING),
            swaps: Swaps::of(stored.tools(), changes),
            frames,
            of_frame: VecDeque::new(),
            ahead: None,
        }
    }

    /// Where swaps separate two of these rows. Reads all rows if there are swaps.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn cuts(&mut self) -> io::Result<Vec<Cut>> {
        if self.swaps.is_empty() {
            return Ok(Vec::new());
        }
        self.rewind();
        let (mut failure, swaps) = (None, self.swaps.clone());
        let tracked = std::iter::from_fn(|| {
            self.next_tracked().unwrap_or_else(|error| {
                failure = Some(error);
                None
            })
        });
        let cuts = swaps.cuts(tracked.map(|row| (row.tool as u32, row.time_s)));
        self.rewind();
        failure.map_or(Ok(cuts), Err)
    }

    /// The next row under its tracked name.
    fn next_tracked(&mut self) -> io::Result<Option<Sample>> {
        while let Some(row) = self.rows.next_row()? {
            if row.frame >= self.frames.end {
                break;
            }
            if is_within(row.time_s, self.span) {
                return Ok(Some(row));
            }
        }
        Ok(None)
    }

    /// Reads the rows of the next frame and brings them into the order of their new names.
    fn read_frame(&mut self) -> io::Result<()> {
        let first = match self.ahead.take() {
            Some(row) => row,
            None => match self.next_tracked()? {
                Some(row) => row,
                None => return Ok(()),
            },
        };
        self.of_frame.push_back(first);
        while let Some(row) = self.next_tracked()? {
            if row.frame != first.frame {
                self.ahead = Some(row);
                break;
            }
            self.of_frame.push_back(row);
        }
        for row in &mut self.of_frame {
            row.tool = self.swaps.name_at(row.tool as u32, row.time_s) as usize;
        }
        self.of_frame.make_contiguous().sort_by_key(|row| row.tool);
        Ok(())
    }
}

impl RowSource for EditedRows {
    fn tools(&self) -> &[String] {
        &self.tools
    }

    fn next_row(&mut self) -> io::Result<Option<Sample>> {
        if self.swaps.is_empty() {
            return self.next_tracked();
        }
        if self.of_frame.is_empty() {
            self.read_frame()?;
        }
        Ok(self.of_frame.pop_front())
    }

    fn rewind(&mut self) {
        self.rows.rewind();
        self.of_frame.clear();
        self.ahead = None;
    }
}
