//! Frames of a recording as they are decoded: part of the work of [`super::probe`] and [`super::track`].

use std::fs::File;
use std::io;
use std::ops::Range;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::limits::{is_plausible_number, is_small_jpeg, set_once, set_size};
use super::{ChildEvent, Reporter, StopReason, WorkRecord};
use crate::analysis::protocol::SeenRow;
use crate::analysis::scene::collect_scene;
use crate::media::{MediaLimits, RecordingInfo, WholeRecording};
use crate::vision::tracker::{SceneSamples, TrackerSettings};

/// Frames per record: few enough to show progress, many enough to cost little.
const FRAMES_PER_RECORD: usize = 32;

/// Packets between two signs of life while the scene is collected: most packets are only read.
const PACKETS_PER_ALIVE: u64 = 256;

/// A record about a recording.
#[derive(Debug, Serialize, Deserialize)]
pub enum RecordingRecord {
    /// What the container announces.
    Announced {
        /// Width as displayed, pixels.
        width: u32,
        /// Height as displayed, pixels.
        height: u32,
        /// Frames to expect, if known; for progress only.
        frames_expected: Option<u64>,
    },
    /// Decoded frames, in order.
    Frames {
        /// Their times, s.
        times_s: Vec<f64>,
        /// What the tracker saw in them; a row per frame and tool.
        seen: Vec<SeenRow>,
    },
    /// All frames were decoded.
    End {
        /// The number of frames that the file states, if it does.
        frames_stated: Option<u64>,
        /// Time on the file's own clock at which time 0 lies, s.
        starts_at_s: f64,
    },
    /// What the tracker saw at a second look; a row per frame and tool, in order.
    SeenAgain(Vec<SeenRow>),
    /// Per tool: is the path that of the second look?
    SecondLook(Vec<bool>),
    /// A small JPEG of one frame; empty if none could be encoded.
    Preview(Vec<u8>),
}

/// What is kept of these records.
#[derive(Debug, Default)]
pub struct RecordingOutput {
    /// Width and height as displayed, pixels.
    pub size: Option<(u32, u32)>,
    /// Number of frames that the container announces; for progress only.
    pub frames_expected: Option<u64>,
    /// Number of frames that the file should give, if it states it.
    pub frames_stated: Option<u64>,
    /// Time on the file's own clock at which time 0 lies, s.
    pub starts_at_s: Option<f64>,
    /// Presentation time of every decoded frame, s.
    pub times_s: Vec<f64>,
    /// What the tracker saw, a row per frame and tool.
    pub seen: Vec<SeenRow>,
    /// What it saw at a second look, until it is known which tools' paths are those of the second look.
    pub seen_again: Vec<SeenRow>,
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
            RecordingRecord::End { frames_stated, starts_at_s } => self.accept_end(frames_stated, starts_at_s)?,
            RecordingRecord::SeenAgain(seen) => self.accept_seen_again(seen, tools)?,
            RecordingRecord::SecondLook(taken) => self.take_second_look(&taken, tools)?,
            RecordingRecord::Preview(jpeg) if jpeg.is_empty() => {}
            RecordingRecord::Preview(jpeg) if is_small_jpeg(&jpeg) => set_once(&mut self.preview, jpeg, "preview")?,
            RecordingRecord::Preview(_) => return Err("a preview that is not a small JPEG".into()),
        }
        Ok(ChildEvent::Nothing)
    }

    fn accept_end(&mut self, frames_stated: Option<u64>, starts_at_s: f64) -> Result<(), String> {
        if !(is_plausible_number(starts_at_s) && starts_at_s >= 0.0) {
            return Err(format!("a recording that starts at {starts_at_s} s"));
        }
        self.frames_stated = frames_stated;
        set_once(&mut self.starts_at_s, starts_at_s, "end of the recording")
    }

    fn accept_frames(
        &mut self,
        times_s: Vec<f64>,
        seen: Vec<SeenRow>,
        tools: usize,
        limits: MediaLimits,
    ) -> Result<ChildEvent, String> {
        let before = self.times_s.len() as u64;
        if !self.seen_again.is_empty() {
            return Err("new frames after a second look".into());
        }
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
        check_rows(&seen, before..after, tools)?;
        self.seen.extend(seen);
        Ok(ChildEvent::progress(after, self.frames_expected))
    }

    fn accept_seen_again(&mut self, seen: Vec<SeenRow>, tools: usize) -> Result<(), String> {
        let first = self.seen_again.last().map_or(0, |row| row.frame + 1);
        check_rows(&seen, first..self.times_s.len() as u64, tools)?;
        self.seen_again.extend(seen);
        Ok(())
    }

    fn take_second_look(&mut self, taken: &[bool], tools: usize) -> Result<(), String> {
        if taken.len() != tools {
            return Err("a second look at other tools".into());
        }
        let is_taken = |row: &SeenRow| taken[row.tool as usize];
        self.seen.retain(|row| !is_taken(row));
        self.seen.extend(std::mem::take(&mut self.seen_again).into_iter().filter(is_taken));
        self.seen.sort_by_key(place);
        Ok(())
    }
}

fn place(row: &SeenRow) -> (u64, u32) {
    (row.frame, row.tool)
}

/// Checks that rows are of these frames, in order, and hold possible numbers.
fn check_rows(seen: &[SeenRow], frames: Range<u64>, tools: usize) -> Result<(), String> {
    let known = |row: &SeenRow| frames.contains(&row.frame) && (row.tool as usize) < tools;
    let possible = |row: &SeenRow| known(row) && row.numbers().all(|x| is_plausible_number(x.into()));
    let is_valid = seen.iter().all(possible) && seen.is_sorted_by(|a, b| place(a) < place(b));
    if is_valid { Ok(()) } else { Err("an invalid row of observations".into()) }
}

/// Collects frames that show the box, with signs of life: see [`collect_scene`].
pub(super) fn scene_of(
    file: Arc<File>,
    settings: &TrackerSettings,
    limits: MediaLimits,
    reporter: &mut Reporter,
) -> Result<SceneSamples, StopReason> {
    let (mut packets, mut sent) = (0_u64, Ok(()));
    let scene = collect_scene(settings, file, limits, || {
        packets += 1;
        if sent.is_ok() && packets.is_multiple_of(PACKETS_PER_ALIVE) {
            sent = reporter.alive(packets, None);
        }
    });
    sent?;
    Ok(scene?)
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

    fn flush(&mut self, reporter: &mut Reporter) -> io::Result<()> {
        let (times_s, seen) = (std::mem::take(&mut self.times_s), std::mem::take(&mut self.seen));
        if times_s.is_empty() {
            return Ok(());
        }
        reporter.record((self.wrap)(RecordingRecord::Frames { times_s, seen }))
    }

    /// Sends the frames that are left, and what is then known of the file.
    pub(super) fn end(&mut self, whole: WholeRecording, reporter: &mut Reporter) -> io::Result<()> {
        self.flush(reporter)?;
        let WholeRecording { frames_stated, starts_at_s } = whole;
        reporter.record((self.wrap)(RecordingRecord::End { frames_stated, starts_at_s }))
    }

    /// Adds what a second look saw of a frame.
    pub(super) fn frame_again(
        &mut self,
        seen: impl Iterator<Item = SeenRow>,
        reporter: &mut Reporter,
    ) -> io::Result<()> {
        self.seen.extend(seen);
        if self.seen.len() < FRAMES_PER_RECORD { Ok(()) } else { self.flush_again(reporter) }
    }

    /// Ends a second look.
    pub(super) fn end_second_look(&mut self, taken: Vec<bool>, reporter: &mut Reporter) -> io::Result<()> {
        self.flush_again(reporter)?;
        reporter.record((self.wrap)(RecordingRecord::SecondLook(taken)))
    }

    fn flush_again(&mut self, reporter: &mut Reporter) -> io::Result<()> {
        reporter.record((self.wrap)(RecordingRecord::SeenAgain(std::mem::take(&mut self.seen))))
    }

    /// Sends the preview.
    pub(super) fn preview(&self, jpeg: Vec<u8>, reporter: &mut Reporter) -> io::Result<()> {
        reporter.record((self.wrap)(RecordingRecord::Preview(jpeg)))
    }
}
