//! Tracks one recording: every frame passes the [`Tracker`], then the paths are smoothed. Decoding runs ahead on a
//! second thread; everything else stays on this one.

use std::fs::File;
use std::io::Seek;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::limits::{MAX_TEXT_CHARS, accept_surroundings, is_plausible_number, is_plausible_row, set_once};
use super::preview::Preview;
use super::recording::{FrameReporter, RecordingOutput, RecordingRecord, scene_of};
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord, explain};
use crate::analysis::clock::{ClockError, open_with_clock};
use crate::analysis::empty_box::read_empty_box;
use crate::analysis::protocol::{QualitySummary, SeenRow};
use crate::domain::clock::{ClockBasis, RecordingClock, TimeCorrection};
use crate::heap;
use crate::media::{MediaError, MediaLimits, Picture, ReadAhead, VideoFile};
use crate::vision::frame::Frame;
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::surroundings::{Surroundings, SurroundingsSampler, ViewShift};
use crate::vision::tracker::{
    FirstLook, LightSample, MAX_WARM_UP_FRAMES, Quality, SecondLook, ToolQuality, ToolSpec, Tracker, TrackerSettings,
    Tracking,
};
use crate::vision::trajectory::{PathKind, Sample};

/// Rows of a path per record.
const ROWS_PER_RECORD: usize = 1024;

/// What to track a recording with.
#[derive(Debug, Serialize, Deserialize)]
pub struct TrackWork {
    /// Camera, tools and colours.
    pub tracker: TrackerSettings,
    /// The correction of its times, if a person made one.
    pub time: Option<TimeCorrection>,
}

/// A record about a tracked recording.
#[derive(Debug, Serialize, Deserialize)]
pub enum TrackRecord {
    /// How the times were computed.
    Clock(RecordingClock),
    /// Size, frames and preview.
    Recording(RecordingRecord),
    /// Part of a path, in order.
    Path {
        /// Which path.
        kind: PathKind,
        /// Its rows.
        rows: Vec<Sample>,
    },
    /// The tracker's summary.
    Quality(QualitySummary),
    /// What stands still in the recording.
    Surroundings(Surroundings),
}

/// What is kept of a tracked recording.
#[derive(Debug, Default)]
pub struct TrackOutput {
    /// How the times were computed.
    pub clock: Option<RecordingClock>,
    /// Size, frames and preview.
    pub recording: RecordingOutput,
    /// Unfiltered path.
    pub raw: Vec<Sample>,
    /// Causal path.
    pub filtered: Vec<Sample>,
    /// Smoothed path.
    pub smoothed: Vec<Sample>,
    /// The tracker's summary.
    pub quality: Option<QualitySummary>,
    /// What stands still in the recording.
    pub surroundings: Option<Surroundings>,
}

impl ChildTask for TrackWork {
    type Record = TrackRecord;
    type Output = TrackOutput;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let limits = inputs.limits;
        let (file, empty_box) = inputs.first_and_second()?;
        let file = Arc::new(file);
        let mut scene = scene_of(file.clone(), &self.tracker, limits, reporter)?;
        let (video, clock) = open_with_clock(file.clone(), self.time, limits)?;
        reporter.record(WorkRecord::Track(TrackRecord::Clock(clock)))?;
        let info = video.info();
        let wrap = |record| WorkRecord::Track(TrackRecord::Recording(record));
        let mut frames = FrameReporter::start(info, wrap, reporter)?;
        let mut pictures = ReadAhead::new(video)?;
        let first: Vec<Frame<'_>> = pictures.first_pictures(MAX_WARM_UP_FRAMES)?.iter().map(Picture::frame).collect();
        let encoding = first.first().ok_or(MediaError::NoFrames)?.encoding;
        let is_bare = self.tracker.tools.iter().all(ToolSpec::is_bare);
        let tracker = Tracker::new(self.tracker, info.width, info.height, encoding);
        let mut tracker = tracker.map_err(|problem| problem.of_shown(info.shown_size))?;
        // Read before the first frame is tracked: a picture that cannot be used is refused at once.
        let size = [info.width, info.height].map(|size| size as usize);
        if let Some(file) = empty_box {
            scene.set_empty(&read_empty_box(file, size, limits)?.frame(), encoding);
        }
        tracker.learn_scene(&scene);
        drop(scene);
        tracker.warm_up(&first);
        let mut preview = Preview::new(info.frames_expected);
        let (mut frames_interlaced, mut surroundings) = (0, SurroundingsSampler::default());
        while let Some(seen) = pictures.next_picture()? {
            let frame = seen.frame();
            frames_interlaced += u64::from(seen.is_interlaced());
            preview.consider(&frame);
            surroundings.sample_frame(&frame);
            let report = tracker.observe(&frame);
            let rows = report.tools.iter().map(|tool| SeenRow::new(frame.index, tool));
            frames.frame(frame.time_s, rows, reporter)?;
        }
        frames.end(pictures.whole(), reporter)?;
        drop(pictures);
        if let Some(picture) = surroundings.surroundings() {
            reporter.record(WorkRecord::Track(TrackRecord::Surroundings(picture)))?;
        }
        let tracking = match tracker.finish_first_look() {
            FirstLook::Enough(tracking) => tracking,
            FirstLook::LookAgain(second) => {
                let video = reopen(file, self.time, limits)?;
                look_again(*second, video, &mut frames, reporter)?
            }
        };
        heap::release_free_memory(); // the paths need the memory now
        if was_never_seen(&tracking.quality) {
            return Err(StopReason::Impossible(explain::never_seen(&tracking.quality, is_bare)));
        }
        send_results(&tracking, frames_interlaced, reporter)?;
        Ok(frames.preview(preview.into_jpeg(), reporter)?)
    }

    fn accept(&self, record: TrackRecord, output: &mut TrackOutput, limits: MediaLimits) -> Result<ChildEvent, String> {
        let tools = self.tracker.tools.len();
        match record {
            TrackRecord::Clock(clock) => output.accept_clock(clock, self.time)?,
            TrackRecord::Recording(record) => return output.recording.accept(record, tools, limits),
            TrackRecord::Path { kind, rows } => output.accept_path(kind, rows, tools)?,
            TrackRecord::Quality(quality) => output.accept_quality(quality, tools)?,
            TrackRecord::Surroundings(picture) => accept_surroundings(&mut output.surroundings, picture)?,
        }
        Ok(ChildEvent::Nothing)
    }
}

fn reopen(file: Arc<File>, time: Option<TimeCorrection>, limits: MediaLimits) -> Result<VideoFile, StopReason> {
    (&*file).rewind().map_err(ClockError::Rewind)?;
    Ok(open_with_clock(file, time, limits)?.0)
}

/// Tracks the recording once more, with what the first look has taught.
fn look_again(
    mut second: SecondLook,
    video: VideoFile,
    frames: &mut FrameReporter,
    reporter: &mut Reporter,
) -> Result<Tracking, StopReason> {
    let mut pictures = ReadAhead::new(video)?;
    while let Some(seen) = pictures.next_picture()? {
        let frame = seen.frame();
        let report = second.observe(&frame);
        frames.frame_again(report.tools.iter().map(|tool| SeenRow::new(frame.index, tool)), reporter)?;
    }
    let (tracking, taken) = second.finish();
    frames.end_second_look(taken, reporter)?;
    Ok(tracking)
}

fn send_results(tracking: &Tracking, frames_interlaced: u64, reporter: &mut Reporter) -> Result<(), StopReason> {
    for kind in [PathKind::Raw, PathKind::Filtered, PathKind::Smoothed] {
        for rows in tracking.trajectory(kind).samples.chunks(ROWS_PER_RECORD) {
            reporter.record(WorkRecord::Track(TrackRecord::Path { kind, rows: rows.to_vec() }))?;
        }
    }
    let summary = QualitySummary::new(&tracking.quality, frames_interlaced);
    Ok(reporter.record(WorkRecord::Track(TrackRecord::Quality(summary)))?)
}

fn was_never_seen(quality: &Quality) -> bool {
    quality.tools.iter().all(|tool| tool.observed == 0)
}

impl TrackOutput {
    fn accept_clock(&mut self, clock: RecordingClock, asked: Option<TimeCorrection>) -> Result<(), String> {
        let is_asked = match clock.basis {
            ClockBasis::Stamps | ClockBasis::CaptureRate => asked.is_none(),
            basis => asked.is_some_and(|asked| asked.basis() == basis),
        };
        if is_asked && clock.is_possible() {
            return set_once(&mut self.clock, clock, "clock");
        }
        Err("an impossible clock".into())
    }

    fn accept_path(&mut self, kind: PathKind, rows: Vec<Sample>, tools: usize) -> Result<(), String> {
        let path = match kind {
            PathKind::Raw => &mut self.raw,
            PathKind::Filtered => &mut self.filtered,
            PathKind::Smoothed => &mut self.smoothed,
        };
        let times_s = &self.recording.times_s;
        let place = |row: &Sample| (row.frame, row.tool);
        for row in rows {
            let on_its_frame = times_s.get(row.frame as usize).is_some_and(|&t| t == row.time_s);
            let in_order = path.last().is_none_or(|last| place(last) < place(&row));
            if !(on_its_frame && in_order && row.tool < tools && is_plausible_row(&row)) {
                return Err("an invalid row of a path".into());
            }
            path.push(row);
        }
        Ok(())
    }

    fn accept_quality(&mut self, quality: QualitySummary, tools: usize) -> Result<(), String> {
        let frames = self.recording.times_s.len() as u64;
        let consistent = quality.frames == frames
            && quality.frames_interlaced <= frames
            && quality.tools.len() == tools
            && quality.tools.iter().all(|tool| is_possible_quality(tool, frames))
            && quality.light.len() as u64 <= frames
            && quality.light.iter().all(is_plausible_light)
            && quality.view_shifts.len() as u64 <= frames
            && quality.view_shifts.iter().all(is_plausible_shift);
        if !consistent {
            return Err("a summary that contradicts its frames".into());
        }
        set_once(&mut self.quality, quality, "summary")
    }
}

/// True if a recording with this many frames can have this summary of a tool.
fn is_possible_quality(tool: &ToolQuality, frames: u64) -> bool {
    let ToolQuality { border_residual_px, transient_depth_sigma_mm, effective_diameter, gaps, colour, .. } = tool;
    let mismatch = tool.size_mismatch.iter().flat_map(|of| [of.px, of.sigma_px]);
    let diameter = effective_diameter.iter().flat_map(|of| [of.mm, of.sigma_mm]);
    let margins = || [&colour.from_tools, &colour.from_background].into_iter().flatten();
    let steps = margins().flat_map(|margin| [margin.margin_steps, margin.spread_steps]);
    let fulcrum = tool.fulcrum.iter().flat_map(Fulcrum::numbers);
    let lengths = [*border_residual_px, *transient_depth_sigma_mm].into_iter().flatten();
    [tool.observed, tool.predicted, tool.missing].iter().chain(tool.reasons.values()).all(|n| *n <= frames)
        && tool.size_mismatch.is_none_or(|of| of.sigma_px > 0.0)
        && lengths.chain(diameter).chain(mismatch).chain(steps).chain(fulcrum).all(is_plausible_number)
        && gaps.iter().all(|gap| gap.first <= gap.last && gap.last < frames)
        && gaps.is_sorted_by(|a, b| a.last < b.first)
        && margins().all(|margin| margin.nearest.chars().count() <= MAX_TEXT_CHARS[0])
}

pub(super) fn is_plausible_light(light: &LightSample) -> bool {
    let LightSample { time_s, luma_ratio, chroma_shift: [blue, red] } = *light;
    [time_s, luma_ratio, blue, red].into_iter().all(is_plausible_number)
}

fn is_plausible_shift(shift: &ViewShift) -> bool {
    [shift.time_s].into_iter().chain(shift.parts).all(is_plausible_number)
}

#[cfg(test)]
pub(in crate::analysis) mod tests;
