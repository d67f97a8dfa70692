//! Frames of a recording as they are decoded: part of the work of [`super::probe`] and [`super::track`].

use std::io;

use serde::{Deserialize, Serialize};

use super::limits::{is_plausible_number, is_small_jpeg, set_once, set_size};
use super::{ChildEvent, Reporter, WorkRecord};
use crate::analysis::protocol::SeenRow;
use crate::media::{MediaLimits, RecordingInfo};

/// Frames per record: few enough to show progress, many enough to cost little.
const FRAMES_PER_RECORD: usize = 32;

/// A record about a recording.
#[derive(Debug, Serialize, Deserialize)]
pub enum RecordingRecord {
    /// What the container announces.
    Announced {
        /// Width as displayed, pixels.
        width: u32,
        /// Height as displayed, pixels.
        height: u32,
        /// Frames to expect, if known.
        frames_expected: Option<u64>,
    },
    /// Decoded frames, in order.
    Frames {
        /// Their times, s.
        times_s: Vec<f64>,
        /// What the tracker saw in them; a row per frame and tool.
        seen: Vec<SeenRow>,
    },
    /// A small JPEG of one frame; empty if none could be encoded.
    Preview(Vec<u8>),
}

/// What is kept of these records.
#[derive(Debug, Default)]
pub struct RecordingOutput {
    /// Width and height as displayed, pixels.
    pub size: Option<(u32, u32)>,
    /// Number of frames that the container announces, if it does.
    pub frames_expected: Option<u64>,
    /// Presentation time of every decoded frame, s.
    pub times_s: Vec<f64>,
    /// What the tracker saw, a row per frame and tool.
    pub seen: Vec<SeenRow>,
    /// The preview, a small JPEG.
    pub preview: Option<Vec<u8>>,
}

impl RecordingOutput {
    /// Keeps a record about a recording with this many tools.
    pub(super) fn accept(
        &mut self,
        record: RecordingRecord,
        tools: usize,
        limits: MediaLimits,
    ) -> Result<ChildEvent, String> {
        match record {
            RecordingRecord::Announced { width, height, frames_expected } => {
                self.frames_expected = frames_expected.filter(|&n| n > 0);
                set_size(&mut self.size, (width, height), limits)?;
            }
            RecordingRecord::Frames { times_s, seen } => return self.accept_frames(times_s, seen, tools, limits),
            RecordingRecord::Preview(jpeg) if jpeg.is_empty() => {}
            RecordingRecord::Preview(jpeg) if is_small_jpeg(&jpeg) => set_once(&mut self.preview, jpeg, "preview")?,
            RecordingRecord::Preview(_) => return Err("a preview that is not a small JPEG".into()),
        }
        Ok(ChildEvent::Nothing)
    }

    fn accept_frames(
        &mut self,
        times_s: Vec<f64>,
        seen: Vec<SeenRow>,
        tools: usize,
        limits: MediaLimits,
    ) -> Result<ChildEvent, String> {
        let before = self.times_s.len() as u64;
        self.times_s.reserve(times_s.len());
        for time_s in times_s {
            let last = self.times_s.last().copied().unwrap_or(-f64::MIN_POSITIVE);
            if !(time_s > last && time_s <= limits.duration_s) {
                return Err(format!("a frame at {time_s} s after one at {last} s"));
            }
            self.times_s.push(time_s);
        }
        let after = self.times_s.len() as u64;
        if after > limits.frames {
            return Err(format!("{after} frames"));
        }
        let place = |row: &SeenRow| (row.frame, row.tool);
        let known = |row: &SeenRow| (before..after).contains(&row.frame) && (row.tool as usize) < tools;
        if !seen.iter().all(|row| known(row) && row.numbers().all(|x| is_plausible_number(x.into())))
            || !seen.is_sorted_by(|a, b| place(a) < place(b))
        {
            return Err("an invalid row of observations".into());
        }
        self.seen.extend(seen);
        Ok(ChildEvent::progress(after, self.frames_expected))
    }
}

/// Collects frames into fewer, larger records.
pub(super) struct FrameReporter {
    times_s: Vec<f64>,
    seen: Vec<SeenRow>,
    wrap: fn(RecordingRecord) -> WorkRecord,
}

impl FrameReporter {
    /// Announces a recording. `wrap` makes its records those of the work.
    pub(super) fn start(
        info: RecordingInfo,
        wrap: fn(RecordingRecord) -> WorkRecord,
        reporter: &mut Reporter,
    ) -> io::Result<Self> {
        let RecordingInfo { width, height, frames_expected, .. } = info;
        reporter.record(wrap(RecordingRecord::Announced { width, height, frames_expected }))?;
        Ok(Self { times_s: Vec::new(), seen: Vec::new(), wrap })
    }

    pub(super) fn frame(
        &mut self,
        time_s: f64,
        seen: impl Iterator<Item = SeenRow>,
        reporter: &mut Reporter,
    ) -> io::Result<()> {
        self.times_s.push(time_s);
        self.seen.extend(seen);
        if self.times_s.len() < FRAMES_PER_RECORD { Ok(()) } else { self.flush(reporter) }
    }

    /// Sends the frames that are left.
    pub(super) fn flush(&mut self, reporter: &mut Reporter) -> io::Result<()> {
        let (times_s, seen) = (std::mem::take(&mut self.times_s), std::mem::take(&mut self.seen));
        if times_s.is_empty() {
            return Ok(());
        }
        reporter.record((self.wrap)(RecordingRecord::Frames { times_s, seen }))
    }

    /// Sends the preview.
    pub(super) fn preview(&self, jpeg: Vec<u8>, reporter: &mut Reporter) -> io::Result<()> {
        reporter.record((self.wrap)(RecordingRecord::Preview(jpeg)))
    }
}
