//! How many frames a file should give, by what its container states.
//!
//! | container | statement |
//! |---|---|
//! | MP4, MOV | its tables list each frame; those that the edit list hides do not count; in a file of several parts, only parts that it holds |
//! | AVI | its index lists each frame; if the file is cut, the header's number |
//! | Matroska, WebM | none; if the file is shorter than its header states, the number that its duration would hold |
//! | MPEG-TS | none: a shorter file is a shorter stream |
//!
//! A duration alone states no number: a camera may leave frames out, and the sound may be longer than the picture.

use std::io::{Error, Read, Seek, SeekFrom};

use ffmpeg_next::format;

use super::presentation::{is_container, table_length};
use super::statements::stated_duration;

/// Maximum of elements that are read to find the end of a file: an AVI of 4 h has some 100.
const MAX_ELEMENTS: usize = 1_000;

/// What a container states about its frames, before they are read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum FrameStatement {
    /// A table has an entry for each frame.
    Table,
    /// The header's number.
    Number(u64),
    /// The file is cut, and its pictures and sound should end at this time, s.
    EndsAt(f64),
    /// Nothing.
    Nothing,
}

/// The frames that were read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FramesRead {
    /// Frames that are shown.
    pub(super) shown: u64,
    /// Frames before the presentation's start.
    pub(super) before_start: u64,
    /// Time at which the last of them is shown, s from the container's start.
    pub(super) last_s: f64,
    /// Time from the first to the last, s.
    pub(super) span_s: f64,
}

impl FrameStatement {
    /// The statement of an input that was just opened. `listed` is the number in its header, and `is_cut` says whether
    /// the file is shorter than its header states.
    pub(super) fn of(input: &format::context::Input, listed: Option<u64>, is_cut: bool) -> Self {
        let duration_s = stated_duration(input.duration());
        if is_container(input, "mov") {
            Self::Table
        } else if is_container(input, "avi") {
            if is_cut { listed.map_or(Self::Nothing, Self::Number) } else { Self::Table }
        } else if is_container(input, "matroska") && is_cut {
            duration_s.map_or(Self::Nothing, Self::EndsAt)
        } else {
            Self::Nothing
        }
    }

    /// The number of frames to be shown, once all were read from a stream.
    pub(super) fn frames(self, stream: &format::stream::Stream<'_>, read: FramesRead) -> Option<u64> {
        match self {
            Self::Table => table_length(stream).map(|length| length.saturating_sub(read.before_start)),
            Self::Number(number) => Some(number),
            Self::EndsAt(end_s) => Some(frames_until(end_s, read)),
            Self::Nothing => None,
        }
        .filter(|&frames| frames > 0)
    }
}

/// The number of frames if those after the last one followed at the same mean rate.
fn frames_until(end_s: f64, FramesRead { shown, last_s, span_s, .. }: FramesRead) -> u64 {
    let intervals = shown.saturating_sub(1) as f64;
    let interval_s = if intervals > 0.0 { span_s / intervals } else { 0.0 };
    let missing = if interval_s > 0.0 { ((end_s - last_s) / interval_s - 1.0).round().max(0.0) } else { 0.0 };
    shown.saturating_add(missing as u64)
}

/// True if the bytes end before the outermost element of a Matroska or AVI file does. Reads from the beginning, and goes
/// back to it.
pub(super) fn is_cut(bytes: &mut (impl Read + Seek)) -> Result<bool, Error> {
    let end = bytes.seek(SeekFrom::End(0))?;
    bytes.rewind()?;
    let stated = stated_end(bytes, end).unwrap_or(None); // what cannot be read states nothing
    bytes.rewind()?;
    Ok(stated.is_some_and(|stated| stated > end))
}

/// The place at which the outermost element ends; `None` if it is not stated.
fn stated_end(bytes: &mut (impl Read + Seek), end: u64) -> Result<Option<u64>, Error> {
    const EBML: [u8; 4] = [0x1a, 0x45, 0xdf, 0xa3];
    let mut kind = [0; 4];
    bytes.read_exact(&mut kind)?;
    bytes.rewind()?;
    match &kind {
        &EBML => segment_end(bytes),
        b"RIFF" => riff_end(bytes, end),
        _ => Ok(None),
    }
}

/// The end of the segment of a Matroska file (RFC 8794).
fn segment_end(bytes: &mut (impl Read + Seek)) -> Result<Option<u64>, Error> {
    const SEGMENT: u64 = 0x1853_8067;
    for _ in 0..MAX_ELEMENTS {
        let (id, _) = variable_number(bytes)?;
        let (size, mask) = variable_number(bytes)?;
        let size = size & mask;
        let end = (size != mask).then(|| bytes.stream_position().map(|at| at.saturating_add(size))).transpose()?;
        match end {
            Some(end) if id != SEGMENT => bytes.seek(SeekFrom::Start(end))?,
            end => return Ok(end),
        };
    }
    Ok(None)
}

/// A number with the marker of its length, and the mask of the bits after the marker.
fn variable_number(bytes: &mut impl Read) -> Result<(u64, u64), Error> {
    let mut first = [0];
    bytes.read_exact(&mut first)?;
    let more = first[0].leading_zeros() as usize;
    let mut all = [0; 8];
    all[0] = first[0];
    bytes.read_exact(all.get_mut(1..=more).ok_or(std::io::ErrorKind::InvalidData)?)?;
    let unused = 8 * (7 - more);
    Ok((u64::from_be_bytes(all) >> unused, (1 << (7 * (more + 1))) - 1))
}

/// The end of the last of the RIFF chunks that an AVI file consists of; a recorder that was killed leaves a size of 0.
fn riff_end(bytes: &mut (impl Read + Seek), end: u64) -> Result<Option<u64>, Error> {
    let mut at = 0;
    for _ in 0..MAX_ELEMENTS {
        let mut header = [0; 8];
        bytes.seek(SeekFrom::Start(at))?;
        if at >= end || bytes.read_exact(&mut header).is_err() || !header.starts_with(b"RIFF") {
            return Ok(None);
        }
        let [.., a, b, c, d] = header;
        let size = u64::from(u32::from_le_bytes([a, b, c, d]));
        if size == 0 {
            return Ok(None);
        }
        if at + 8 + size > end {
            return Ok(Some(at + 8 + size));
        }
        at += 8 + size + size % 2;
    }
    Ok(None)
}

#[cfg(test)]
mod tests;
