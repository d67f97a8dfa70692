//! Validates a child's output record by record: the file that the child decoded may have taken over its decoder.
//!
//! A record is accepted if an honest child could have sent it at this point. Sizes, order, indices and numbers are
//! checked here, so accepted records can be stored and shown.

mod pictures;
mod problem_texts;
mod self_test_reports;
mod tape_advice;

use super::marked::colours_of;
use super::protocol::{
    self, BoardShape, CalibrationShape, ChildReply, ChildWork, FollowReply, FollowedFrame, FollowedTool, KindShape,
    PaletteShape, PathRow, PlacementShape, QualityShape, RunningRow, SeenRow,
};
use crate::domain::feed::{MAX_FRAMES, MAX_PAYLOAD};
use crate::domain::palette::{FrameMask, PaletteAdvice, PaletteReport};
use crate::domain::photo_check::PhotoCheck;
use crate::domain::problem::Problem;
use crate::domain::self_test::SelfTestReport;
use crate::media::{CapturedFrame, MediaLimits, SourceInfo};
use crate::motion::features::running::LIVE_FEATURES;
use crate::vision::reason::MissReason;

/// Largest preview, bytes.
const MAX_PREVIEW_BYTES: usize = 1 << 20;

/// Largest magnitude of a number in a row: 10 km in mm, and far outside any frame in pixels.
const MAX_MAGNITUDE: f64 = 1e7;

/// Most samples in a palette.
const MAX_SAMPLES: usize = 1_000_000;

/// Most frames in one reply about a feed: those that a decoder held back, or that were rehearsed.
const MAX_FRAMES_PER_REPLY: u64 = 64;

/// Longest texts of a problem, characters: slug, title, detail.
const MAX_TEXT_CHARS: [usize; 3] = [64, 200, 4000];

/// The validated output of a child.
#[derive(Debug, Default)]
pub struct ChildOutput {
    /// Set once the child is confined; true if Landlock is enforced.
    pub landlock: Option<bool>,
    /// Width and height as displayed, pixels.
    pub size: Option<(u32, u32)>,
    /// Number of frames that the container announces, if it does.
    pub frames_expected: Option<u64>,
    /// Presentation time of every decoded frame, s.
    pub times_s: Vec<f64>,
    /// What the tracker saw, a row per frame and tool.
    pub seen: Vec<SeenRow>,
    /// Unfiltered path.
    pub raw: Vec<PathRow>,
    /// Causal path.
    pub filtered: Vec<PathRow>,
    /// Smoothed path.
    pub smoothed: Vec<PathRow>,
    /// The tracker's summary.
    pub quality: Option<QualityShape>,
    /// The preview, a small JPEG.
    pub preview: Option<Vec<u8>>,
    /// The colour samples.
    pub palette: Option<PaletteShape>,
    /// The report on the colours.
    pub palette_report: Option<PaletteReport>,
    /// Which tapes suit a box.
    pub palette_advice: Option<PaletteAdvice>,
    /// For each picture, the pixels classified as tape.
    pub masks: Vec<FrameMask>,
    /// How a photo of a board can be used.
    pub photo_check: Option<PhotoCheck>,
    /// A calibration.
    pub calibration: Option<CalibrationShape>,
    /// The report of a self-test.
    pub self_test: Option<SelfTestReport>,
    /// Frames in an assembled recording, and frames left out of it.
    pub assembled: Option<[u64; 2]>,
    /// Why the work cannot be done.
    pub(super) problem: Option<Problem>,
    /// The child reported that it was done.
    pub(super) done: bool,
}

/// Checks a child's replies as they arrive and collects their content.
pub(super) struct OutputValidator {
    work: WorkKind,
    tools: usize,
    /// Board and tool names of a self-test.
    self_tested: Option<(BoardShape, Vec<String>)>,
    /// The board to find in a photo.
    searched_board: Option<BoardShape>,
    /// The frames of the pictures to mask, and the number of colours.
    masked: (Vec<u64>, usize),
    limits: MediaLimits,
    output: ChildOutput,
    /// Number and time of the last live frame that was tracked.
    last_live_frame: Option<(u64, f64)>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum WorkKind {
    Probe,
    Track,
    Palette,
    Advise,
    Mask,
    Check,
    Calibrate,
    SelfTest,
    Assemble,
    Follow,
    Demux,
}

/// What a reply means for the caller at once.
#[derive(Debug)]
pub enum ChildEvent {
    /// Nothing: the content is stored, or the reply is only a sign of life.
    Nothing,
    /// Progress of the child, 0..1.
    Progress(f64),
    /// The result of one record of a feed.
    Followed(FollowReply),
    /// What a pushed stream contains.
    Stream(SourceInfo),
    /// The next coded frame of a pushed stream.
    Coded(CapturedFrame),
}

impl OutputValidator {
    /// A validator for the replies that this work may give.
    pub(super) fn new(work: &ChildWork, limits: MediaLimits) -> Self {
        let self_tested = match work {
            ChildWork::SelfTest(test) => {
                Some((test.board, test.track.tools.iter().map(|tool| tool.name.clone()).collect()))
            }
            _ => None,
        };
        let searched_board = if let ChildWork::Check(board) = work { Some(*board) } else { None };
        let masked = match work {
            ChildWork::Mask(of) => (of.frames.clone().unwrap_or_default(), colours_of(&of.tools).len()),
            _ => (Vec::new(), 0),
        };
        let (work, tools) = match work {
            ChildWork::Probe => (WorkKind::Probe, 0),
            ChildWork::Track(track) => (WorkKind::Track, track.tools.len()),
            ChildWork::Palette(_) => (WorkKind::Palette, 0),
            ChildWork::Advise => (WorkKind::Advise, 0),
            ChildWork::Mask(_) => (WorkKind::Mask, 0),
            ChildWork::Check(_) => (WorkKind::Check, 0),
            ChildWork::Calibrate(_) => (WorkKind::Calibrate, 0),
            ChildWork::SelfTest(_) => (WorkKind::SelfTest, 0),
            ChildWork::Assemble(_) => (WorkKind::Assemble, 0),
            ChildWork::Demux => (WorkKind::Demux, 0),
            ChildWork::Follow(follow) => (WorkKind::Follow, follow.track.tools.len()),
        };
        Self {
            work,
            tools,
            self_tested,
            searched_board,
            masked,
            limits,
            output: ChildOutput::default(),
            last_live_frame: None,
        }
    }

    /// Validates one record; an error ends the child.
    pub(super) fn validate(&mut self, record: &[u8]) -> Result<ChildEvent, String> {
        let answer = protocol::decode(record).map_err(|e| format!("an unreadable record: {e}"))?;
        if self.output.done || self.output.problem.is_some() {
            return Err("a record after the last one".into());
        }
        if self.output.landlock.is_none() && !matches!(answer, ChildReply::Confined { .. }) {
            return Err("a reply before confinement".into());
        }
        self.accept_reply(answer)
    }

    /// The output after the last record.
    pub(super) fn into_output(self) -> ChildOutput {
        self.output
    }

    fn accept_reply(&mut self, answer: ChildReply) -> Result<ChildEvent, String> {
        match answer {
            ChildReply::Confined { landlock } => set_once(&mut self.output.landlock, landlock, "confinement")?,
            ChildReply::Recording { width, height, frames_expected } => {
                self.recording(width, height, frames_expected)?
            }
            ChildReply::Frames { times_s, seen } => return self.frames(times_s, seen),
            ChildReply::Followed(followed) => return self.followed(followed),
            ChildReply::Alive { done, of } => return Ok(progress_event(done, of)),
            ChildReply::Path { kind, rows } => self.path(kind, rows)?,
            ChildReply::Quality(quality) => self.quality(quality)?,
            ChildReply::Preview(jpeg) => self.preview(jpeg)?,
            ChildReply::Palette(palette) => self.palette(palette)?,
            ChildReply::PaletteReport(report) => self.palette_report(report)?,
            ChildReply::PaletteAdvice(advice) => self.palette_advice(advice)?,
            ChildReply::Mask(mask) => self.mask(mask)?,
            ChildReply::PhotoCheck(check) => self.photo_check(check)?,
            ChildReply::Calibration(calibration) => {
                self.require_work(&[WorkKind::Calibrate])?;
                set_once(&mut self.output.calibration, calibration, "calibration")?;
            }
            ChildReply::SelfTest(report) => self.self_test(*report)?,
            ChildReply::Assembled { frames, left_out } => {
                self.require_work(&[WorkKind::Assemble])?;
                if frames == 0 || frames.max(left_out) > MAX_FRAMES {
                    return Err("an assembled recording with an impossible number of frames".into());
                }
                set_once(&mut self.output.assembled, [frames, left_out], "recording")?;
            }
            ChildReply::Stream(info) => return self.stream(info),
            ChildReply::Coded(frame) => return self.coded(frame),
            ChildReply::Problem(problem) => self.output.problem = Some(problem_texts::presentable(problem)?),
            ChildReply::Done => self.output.done = true,
        }
        Ok(ChildEvent::Nothing)
    }

    fn require_work(&self, kinds: &[WorkKind]) -> Result<(), String> {
        if kinds.contains(&self.work) { Ok(()) } else { Err("a reply that does not belong to this work".into()) }
    }

    fn recording(&mut self, width: u32, height: u32, frames_expected: Option<u64>) -> Result<(), String> {
        let longest = self.limits.width.max(self.limits.height);
        if !(1..=longest).contains(&width) || !(1..=longest).contains(&height) {
            return Err(format!("a picture of {width}×{height} pixels"));
        }
        self.output.frames_expected = frames_expected.filter(|&n| n > 0);
        set_once(&mut self.output.size, (width, height), "recording")
    }

    fn frames(&mut self, times_s: Vec<f64>, seen: Vec<SeenRow>) -> Result<ChildEvent, String> {
        self.require_work(&[WorkKind::Probe, WorkKind::Track])?;
        let before = self.output.times_s.len() as u64;
        self.output.times_s.reserve(times_s.len());
        for time_s in times_s {
            let last = self.output.times_s.last().copied().unwrap_or(-f64::MIN_POSITIVE);
            if !(time_s > last && time_s <= self.limits.duration_s) {
                return Err(format!("a frame at {time_s} s after one at {last} s"));
            }
            self.output.times_s.push(time_s);
        }
        let after = self.output.times_s.len() as u64;
        if after > self.limits.frames {
            return Err(format!("{after} frames"));
        }
        let place = |row: &SeenRow| (row.frame, row.tool);
        let known = |row: &SeenRow| (before..after).contains(&row.frame) && (row.tool as usize) < self.tools;
        if !seen.iter().all(|row| known(row) && row.numbers().all(|x| is_plausible_number(x.into())))
            || !seen.is_sorted_by(|a, b| place(a) < place(b))
        {
            return Err("an invalid row of observations".into());
        }
        self.output.seen.extend(seen);
        Ok(progress_event(after, self.output.frames_expected))
    }

    fn followed(&mut self, followed: FollowReply) -> Result<ChildEvent, String> {
        self.require_work(&[WorkKind::Follow])?;
        for frame in &followed.frames {
            let is_later =
                self.last_live_frame.is_none_or(|(number, time_s)| frame.frame != number && frame.time_s > time_s);
            let in_time = (0.0..=self.limits.duration_s).contains(&frame.time_s);
            let are_tools = frame.tools.len() == self.tools
                && frame.tools.iter().enumerate().all(|(index, tool)| belongs_to_frame(tool, frame, index as u32));
            if !(is_later && in_time && are_tools && frame.frame < MAX_FRAMES) {
                return Err("an invalid frame of a feed".into());
            }
            self.last_live_frame = Some((frame.frame, frame.time_s));
        }
        let is_running = |row: &RunningRow| {
            (row.tool as usize) < self.tools
                && (row.feature as usize) < LIVE_FEATURES.len()
                && row.value.is_none_or(is_plausible_number)
        };
        let is_picture = |jpeg: &[u8]| jpeg.len() <= MAX_PREVIEW_BYTES && jpeg.starts_with(&[0xff, 0xd8]);
        let consistent = followed.frames.len() as u64 <= MAX_FRAMES_PER_REPLY
            && followed.running.iter().flatten().count() <= self.tools * LIVE_FEATURES.len()
            && followed.running.iter().flatten().all(is_running)
            && followed.light.iter().flatten().all(|&x| is_plausible_number(x))
            && followed.placement.iter().flat_map(PlacementShape::numbers).all(is_plausible_number)
            && followed.placement.iter().all(|placement| placement.ports.len() == self.tools)
            && followed.picture.as_ref().is_none_or(|(_, jpeg)| is_picture(jpeg));
        if consistent { Ok(ChildEvent::Followed(followed)) } else { Err("an invalid reply about a feed".into()) }
    }

    fn stream(&mut self, info: SourceInfo) -> Result<ChildEvent, String> {
        self.require_work(&[WorkKind::Demux])?;
        self.recording(info.size.0, info.size.1, None)?;
        match info.coded_from.as_ref().is_none_or(|codec| codec.len() <= MAX_TEXT_CHARS[0] && codec.is_ascii()) {
            true => Ok(ChildEvent::Stream(info)),
            false => Err("a codec without a name".into()),
        }
    }

    fn coded(&mut self, frame: CapturedFrame) -> Result<ChildEvent, String> {
        self.require_work(&[WorkKind::Demux])?;
        match self.output.size.is_some() && frame.bytes.len() <= MAX_PAYLOAD && frame.due_s.is_finite() {
            true => Ok(ChildEvent::Coded(frame)),
            false => Err("an invalid frame of a stream".into()),
        }
    }

    fn path(&mut self, kind: KindShape, rows: Vec<PathRow>) -> Result<(), String> {
        self.require_work(&[WorkKind::Track])?;
        let path = match kind {
            KindShape::Raw => &mut self.output.raw,
            KindShape::Filtered => &mut self.output.filtered,
            KindShape::Smoothed => &mut self.output.smoothed,
        };
        let times_s = &self.output.times_s;
        let place = |row: &PathRow| (row.frame, row.tool);
        for row in rows {
            let on_its_frame = times_s.get(row.frame as usize).is_some_and(|&t| t == row.time_s);
            let in_order = path.last().is_none_or(|last| place(last) < place(&row));
            if !(on_its_frame && in_order && (row.tool as usize) < self.tools && row.numbers().all(is_plausible_number))
            {
                return Err("an invalid row of a path".into());
            }
            path.push(row);
        }
        Ok(())
    }

    fn quality(&mut self, quality: QualityShape) -> Result<(), String> {
        self.require_work(&[WorkKind::Track])?;
        let frames = self.output.times_s.len() as u64;
        let consistent = quality.frames == frames
            && quality.frames_interlaced <= frames
            && quality.tools.len() == self.tools
            && quality.tools.iter().all(|tool| {
                tool.observed_predicted_missing.iter().all(|&n| n <= frames)
                    && tool.reasons.is_sorted_by(|a, b| MissReason::from(a.0) < MissReason::from(b.0))
                    && tool.reasons.iter().all(|&(_, n)| n <= frames)
                    && [tool.border_residual_px, tool.passing_depth_mm].into_iter().flatten().all(is_plausible_number)
                    && tool.effective_diameter.is_none_or(|(numbers, _)| numbers.into_iter().all(is_plausible_number))
                    && tool.gaps.iter().all(|gap| gap.0 <= gap.1 && gap.1 < frames)
                    && tool.gaps.is_sorted_by(|a, b| a.1 < b.0)
                    && tool.colour.iter().flatten().all(|margin| {
                        margin.margin_spread_steps.iter().all(|&x| is_plausible_number(x))
                            && margin.nearest.chars().count() <= MAX_TEXT_CHARS[0]
                    })
                    && tool.fulcrum.is_none_or(|fulcrum| fulcrum.numbers().all(is_plausible_number))
            })
            && quality.light.len() as u64 <= frames
            && quality.light.iter().flatten().all(|&x| is_plausible_number(x));
        if !consistent {
            return Err("a summary that contradicts its frames".into());
        }
        set_once(&mut self.output.quality, quality, "summary")
    }

    fn preview(&mut self, jpeg: Vec<u8>) -> Result<(), String> {
        self.require_work(&[WorkKind::Probe, WorkKind::Track])?;
        if jpeg.is_empty() {
            return Ok(());
        }
        if jpeg.len() > MAX_PREVIEW_BYTES || !jpeg.starts_with(&[0xff, 0xd8]) {
            return Err("a preview that is not a small JPEG".into());
        }
        set_once(&mut self.output.preview, jpeg, "preview")
    }

    fn palette(&mut self, palette: PaletteShape) -> Result<(), String> {
        self.require_work(&[WorkKind::Palette])?;
        let named = palette.labels.iter().all(|l| l.chars().count() <= MAX_TEXT_CHARS[0]);
        if !named || palette.samples.len() > MAX_SAMPLES || palette.colour_samples().is_none() {
            return Err("invalid colour samples".into());
        }
        set_once(&mut self.output.palette, palette, "palette")
    }

    fn self_test(&mut self, report: SelfTestReport) -> Result<(), String> {
        self.require_work(&[WorkKind::SelfTest])?;
        let Some((board, tools)) = &self.self_tested else {
            return Err("a reply that does not belong to this work".into());
        };
        if !self_test_reports::is_possible(&report, *board, tools) {
            return Err("an invalid self-test".into());
        }
        set_once(&mut self.output.self_test, report, "self-test")
    }

    fn mask(&mut self, mask: FrameMask) -> Result<(), String> {
        self.require_work(&[WorkKind::Mask])?;
        let (frames, colours) = &self.masked;
        let next = frames.get(self.output.masks.len()).ok_or("a mask without a picture")?;
        if !pictures::is_possible_mask(&mask, *next, *colours, self.limits) {
            return Err("an invalid mask".into());
        }
        self.output.masks.push(mask);
        Ok(())
    }

    fn photo_check(&mut self, check: PhotoCheck) -> Result<(), String> {
        self.require_work(&[WorkKind::Check])?;
        let Some(board) = self.searched_board else { return Err("a reply that does not belong to this work".into()) };
        if !pictures::is_possible_check(&check, board, self.limits) {
            return Err("an invalid check of a photo".into());
        }
        set_once(&mut self.output.photo_check, check, "photo")
    }

    fn palette_report(&mut self, report: PaletteReport) -> Result<(), String> {
        self.require_work(&[WorkKind::Palette, WorkKind::Mask])?;
        if !report.numbers().all(is_plausible_number)
            || report.texts().any(|text| text.chars().count() > MAX_TEXT_CHARS[2])
        {
            return Err("an invalid report on colours".into());
        }
        set_once(&mut self.output.palette_report, report, "report on colours")
    }

    fn palette_advice(&mut self, advice: PaletteAdvice) -> Result<(), String> {
        self.require_work(&[WorkKind::Advise])?;
        if !tape_advice::is_possible(&advice) {
            return Err("invalid advice on tapes".into());
        }
        set_once(&mut self.output.palette_advice, advice, "advice on tapes")
    }
}

/// True if the tool's rows belong to this frame.
fn belongs_to_frame(tool: &FollowedTool, frame: &FollowedFrame, index: u32) -> bool {
    let FollowedTool { seen, path, .. } = tool;
    (seen.frame, seen.tool) == (frame.frame, index)
        && seen.numbers().all(|x| is_plausible_number(x.into()))
        && path.is_none_or(|row| {
            (row.frame, row.tool, row.time_s) == (frame.frame, index, frame.time_s)
                && row.numbers().all(is_plausible_number)
        })
}

fn set_once<T>(slot: &mut Option<T>, value: T, what: &str) -> Result<(), String> {
    match slot.replace(value) {
        None => Ok(()),
        Some(_) => Err(format!("a second {what}")),
    }
}

fn is_plausible_number(x: f64) -> bool {
    x.is_finite() && x.abs() <= MAX_MAGNITUDE
}

fn progress_event(done: u64, of: Option<u64>) -> ChildEvent {
    let share = of.filter(|&of| of > 0).map(|of| (done as f64 / of as f64).min(1.0));
    share.map_or(ChildEvent::Nothing, ChildEvent::Progress)
}

#[cfg(test)]
mod tests;
