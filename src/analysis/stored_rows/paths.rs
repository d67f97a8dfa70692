//! Rows of a blob of [`SessionPaths`](crate::analysis::paths::SessionPaths).

use std::fs::File;
use std::io;
use std::sync::Arc;

use serde::de::DeserializeOwned;

use super::ROWS_PER_BLOCK;
use super::window::{WINDOW_BYTES, WindowReader};
use crate::analysis::paths::{
    MAGIC, MAGIC_WITH_SIGMAS, MAGIC_WITHOUT_SIZES, MAGIC_WITHOUT_TRACKING, MAGIC_WITHOUT_VIEW, PathsError,
    SampleWithSigmas,
};
use crate::vision::trajectory::{PathKind, Sample};

/// Longest encoded row, length of a list or number, bytes; a row has at most 173.
const MAX_ITEM_BYTES: usize = 256;

/// Bytes of a frame's time.
const TIME_BYTES: u64 = 8;

/// Where the parts of a blob of paths begin.
#[derive(Debug)]
pub(super) struct PathIndex {
    tools: Vec<String>,
    has_sigmas: bool,
    /// Number of frames, and place of the first frame's time.
    frames: u64,
    times_at: u64,
    /// Raw, filtered and smoothed.
    paths: [PathSection; 3],
}

/// The rows of one path.
#[derive(Debug, Default)]
struct PathSection {
    rows: u64,
    blocks: Vec<RowBlock>,
}

/// Place and frame of a row, once every [`ROWS_PER_BLOCK`].
#[derive(Debug)]
struct RowBlock {
    at: u64,
    first_frame: u64,
}

impl PathIndex {
    /// Reads all rows once.
    pub(super) fn build(file: Arc<File>) -> Result<Self, PathsError> {
        let mut reader = WindowReader::new(file);
        let magic = reader.peek(MAGIC.len())?.get(..MAGIC.len()).ok_or(PathsError::NotPaths)?.to_vec();
        let is = |known: [u8; 8]| magic == known;
        let formats = [MAGIC, MAGIC_WITHOUT_VIEW, MAGIC_WITHOUT_SIZES, MAGIC_WITH_SIGMAS, MAGIC_WITHOUT_TRACKING];
        if !formats.into_iter().any(is) {
            return Err(PathsError::NotPaths);
        }
        let has_sigmas = is(MAGIC_WITH_SIGMAS) || is(MAGIC_WITHOUT_TRACKING);
        reader.skip(MAGIC.len());
        let count: u64 = decode(&mut reader, MAX_ITEM_BYTES)?;
        let tools = (0..count).map(|_| decode(&mut reader, WINDOW_BYTES)).collect::<Result<Vec<String>, _>>()?;
        let frames: u64 = decode(&mut reader, MAX_ITEM_BYTES)?;
        let times_at = reader.position();
        reader.seek(times_at.saturating_add(frames.saturating_mul(TIME_BYTES)));
        let mut paths: [PathSection; 3] = Default::default();
        for path in &mut paths {
            *path = PathSection::read(&mut reader, has_sigmas)?;
        }
        Ok(Self { tools, has_sigmas, frames, times_at, paths })
    }
}

impl PathSection {
    fn read(reader: &mut WindowReader, has_sigmas: bool) -> Result<Self, PathsError> {
        let mut section = Self { rows: decode(reader, MAX_ITEM_BYTES)?, blocks: Vec::new() };
        let mut before = None;
        for number in 0..section.rows {
            let at = reader.position();
            let row = decode_row(reader, has_sigmas)?;
            let place = Some((row.frame, row.tool));
            if place <= before {
                return Err(PathsError::OutOfOrder);
            }
            before = place;
            if number % ROWS_PER_BLOCK == 0 {
                section.blocks.push(RowBlock { at, first_frame: row.frame });
            }
        }
        Ok(section)
    }
}

fn decode_row(reader: &mut WindowReader, has_sigmas: bool) -> Result<Sample, PathsError> {
    if has_sigmas {
        decode::<SampleWithSigmas>(reader, MAX_ITEM_BYTES).map(Sample::from)
    } else {
        decode(reader, MAX_ITEM_BYTES)
    }
}

/// Decodes a value of at most `max_bytes`.
fn decode<T: DeserializeOwned>(reader: &mut WindowReader, max_bytes: usize) -> Result<T, PathsError> {
    let window = reader.peek(max_bytes)?;
    let before = window.len();
    let (value, rest) = postcard::take_from_bytes(window).map_err(PathsError::Damaged)?;
    let bytes = before - rest.len();
    reader.skip(bytes);
    Ok(value)
}

/// A blob of paths that is read by rows.
#[derive(Clone, Debug)]
pub struct StoredPaths {
    file: Arc<File>,
    index: Arc<PathIndex>,
}

impl StoredPaths {
    pub(super) fn new(file: Arc<File>, index: Arc<PathIndex>) -> Self {
        Self { file, index }
    }

    /// Names of the tools; rows refer to them by index.
    pub fn tools(&self) -> &[String] {
        &self.index.tools
    }

    /// The rows of a path from this frame on, in order of frame and tool.
    pub fn rows(&self, kind: PathKind, from_frame: u64) -> StoredPathRows {
        let section = match kind {
            PathKind::Raw => 0,
            PathKind::Filtered => 1,
            PathKind::Smoothed => 2,
        };
        let reader = WindowReader::new(self.file.clone());
        let mut rows = StoredPathRows { index: self.index.clone(), section, from_frame, reader, left: 0 };
        rows.rewind();
        rows
    }

    /// The times of the frames.
    pub fn frame_times(&self) -> StoredFrameTimes {
        StoredFrameTimes { index: self.index.clone(), reader: WindowReader::new(self.file.clone()) }
    }
}

/// Rows of one path.
#[derive(Debug)]
pub struct StoredPathRows {
    index: Arc<PathIndex>,
    section: usize,
    from_frame: u64,
    reader: WindowReader,
    /// Rows from the reader's position to the path's end.
    left: u64,
}

impl StoredPathRows {
    /// Continues with the first row.
    pub fn rewind(&mut self) {
        let section = &self.index.paths[self.section];
        // The rows of a frame may begin in the block before the first one that begins with the frame.
        let block = section.blocks.partition_point(|block| block.first_frame < self.from_frame).saturating_sub(1);
        self.left = section.rows.saturating_sub(block as u64 * ROWS_PER_BLOCK);
        if let Some(block) = section.blocks.get(block) {
            self.reader.seek(block.at);
        }
    }

    /// The next row; `None` after the last one.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn next_row(&mut self) -> io::Result<Option<Sample>> {
        while self.left > 0 {
            self.left -= 1;
            let row = decode_row(&mut self.reader, self.index.has_sigmas)
                .map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))?;
            if row.frame >= self.from_frame {
                return Ok(Some(row));
            }
        }
        Ok(None)
    }
}

/// Presentation times of a recording's frames.
#[derive(Debug)]
pub struct StoredFrameTimes {
    index: Arc<PathIndex>,
    reader: WindowReader,
}

impl StoredFrameTimes {
    /// Time of a frame, s; `None` if it is unknown. Times of frames in order are read fastest.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn at(&mut self, frame: u64) -> io::Result<Option<f64>> {
        if frame >= self.index.frames {
            return Ok(None);
        }
        self.reader.seek(self.index.times_at + frame * TIME_BYTES);
        let time_s = self.reader.peek(TIME_BYTES as usize)?.first_chunk().copied();
        let time_s = time_s.ok_or(io::ErrorKind::UnexpectedEof)?;
        Ok(Some(f64::from_le_bytes(time_s)))
    }
}
