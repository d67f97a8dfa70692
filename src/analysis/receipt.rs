//! Validates a child's output record by record: the file that the child decoded may have taken over its decoder.
//!
//! A record is accepted if an honest child could have sent it at this point. Sizes, order, indices and numbers are
//! checked here, so accepted records can be stored and shown.

mod advices;
mod glances;
mod problems;
mod self_tests;

use super::marked::colours_of;
use super::protocol::{
    self, Answer, BoardShape, CalibrationShape, Followed, FollowedFrame, FollowedTool, KindShape, PaletteShape,
    PathRow, PlacementShape, QualityShape, RunningRow, SeenRow, Work,
};
use crate::domain::feed::{MOST_FRAMES, MOST_PAYLOAD};
use crate::domain::palette::{FrameMask, PaletteAdvice, PaletteReport};
use crate::domain::photo_check::PhotoCheck;
use crate::domain::problem::Problem;
use crate::domain::self_test::SelfTestReport;
use crate::media::{CapturedFrame, Limits, SourceInfo};
use crate::pipeline::features::running::LIVE;

/// Largest preview, bytes.
const PREVIEW_BYTES: usize = 1 << 20;

/// Largest magnitude of a number in a row: 10 km in mm, and far outside any frame in pixels.
const MAGNITUDE: f64 = 1e7;

/// Most samples in a palette.
const SAMPLES: usize = 1_000_000;

/// Most frames in one reply about a feed: those that a decoder held back, or that were rehearsed.
const MOST_AT_A_TIME: u64 = 64;

/// Longest texts of a problem, characters: slug, title, detail.
const TEXTS: [usize; 3] = [64, 200, 4000];

/// The validated output of a child.
#[derive(Debug, Default)]
pub struct Heard {
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
pub(super) struct Receipt {
    work: Kind,
    tools: usize,
    /// Board and tool names of a self-test.
    tested: Option<(BoardShape, Vec<String>)>,
    /// The board to find in a photo.
    sought: Option<BoardShape>,
    /// The frames of the pictures to mask, and the number of colours.
    masked: (Vec<u64>, usize),
    limits: Limits,
    heard: Heard,
    /// Number and time of the last live frame that was tracked.
    followed: Option<(u64, f64)>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
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
pub enum News {
    /// Nothing: the content is stored, or the reply is only a sign of life.
    Nothing,
    /// Progress of the child, 0..1.
    Progress(f64),
    /// The result of one record of a feed.
    Followed(Followed),
    /// What a pushed stream contains.
    Stream(SourceInfo),
    /// The next coded frame of a pushed stream.
    Coded(CapturedFrame),
}

impl Receipt {
    /// A validator for the replies that this work may give.
    pub(super) fn new(work: &Work, limits: Limits) -> Self {
        let tested = match work {
            Work::SelfTest(test) => Some((test.board, test.track.tools.iter().map(|tool| tool.name.clone()).collect())),
            _ => None,
        };
        let sought = if let Work::Check(board) = work { Some(*board) } else { None };
        let masked = match work {
            Work::Mask(of) => (of.frames.clone().unwrap_or_default(), colours_of(&of.tools).len()),
            _ => (Vec::new(), 0),
        };
        let (work, tools) = match work {
            Work::Probe => (Kind::Probe, 0),
            Work::Track(track) => (Kind::Track, track.tools.len()),
            Work::Palette(_) => (Kind::Palette, 0),
            Work::Advise => (Kind::Advise, 0),
            Work::Mask(_) => (Kind::Mask, 0),
            Work::Check(_) => (Kind::Check, 0),
            Work::Calibrate(_) => (Kind::Calibrate, 0),
            Work::SelfTest(_) => (Kind::SelfTest, 0),
            Work::Assemble(_) => (Kind::Assemble, 0),
            Work::Demux => (Kind::Demux, 0),
            Work::Follow(follow) => (Kind::Follow, follow.track.tools.len()),
        };
        Self { work, tools, tested, sought, masked, limits, heard: Heard::default(), followed: None }
    }

    /// Validates one record; an error ends the child.
    pub(super) fn take(&mut self, record: &[u8]) -> Result<News, String> {
        let answer = protocol::decode(record).map_err(|e| format!("an unreadable record: {e}"))?;
        if self.heard.done || self.heard.problem.is_some() {
            return Err("a record after the last one".into());
        }
        if self.heard.landlock.is_none() && !matches!(answer, Answer::Confined { .. }) {
            return Err("a reply before confinement".into());
        }
        self.accept(answer)
    }

    /// The output after the last record.
    pub(super) fn into_heard(self) -> Heard {
        self.heard
    }

    fn accept(&mut self, answer: Answer) -> Result<News, String> {
        match answer {
            Answer::Confined { landlock } => once(&mut self.heard.landlock, landlock, "confinement")?,
            Answer::Recording { width, height, frames_expected } => self.recording(width, height, frames_expected)?,
            Answer::Frames { times_s, seen } => return self.frames(times_s, seen),
            Answer::Followed(followed) => return self.followed(followed),
            Answer::Alive { done, of } => return Ok(share(done, of)),
            Answer::Path { kind, rows } => self.path(kind, rows)?,
            Answer::Quality(quality) => self.quality(quality)?,
            Answer::Preview(jpeg) => self.preview(jpeg)?,
            Answer::Palette(palette) => self.palette(palette)?,
            Answer::PaletteReport(report) => self.palette_report(report)?,
            Answer::PaletteAdvice(advice) => self.palette_advice(advice)?,
            Answer::Mask(mask) => self.mask(mask)?,
            Answer::PhotoCheck(check) => self.photo_check(check)?,
            Answer::Calibration(calibration) => {
                self.only(&[Kind::Calibrate])?;
                once(&mut self.heard.calibration, calibration, "calibration")?;
            }
            Answer::SelfTest(report) => self.self_test(*report)?,
            Answer::Assembled { frames, left_out } => {
                self.only(&[Kind::Assemble])?;
                if frames == 0 || frames.max(left_out) > MOST_FRAMES {
                    return Err("an assembled recording with an impossible number of frames".into());
                }
                once(&mut self.heard.assembled, [frames, left_out], "recording")?;
            }
            Answer::Stream(info) => return self.stream(info),
            Answer::Coded(frame) => return self.coded(frame),
            Answer::Problem(problem) => self.heard.problem = Some(problems::presentable(problem)?),
            Answer::Done => self.heard.done = true,
        }
        Ok(News::Nothing)
    }

    fn only(&self, kinds: &[Kind]) -> Result<(), String> {
        if kinds.contains(&self.work) { Ok(()) } else { Err("a reply that does not belong to this work".into()) }
    }

    fn recording(&mut self, width: u32, height: u32, frames_expected: Option<u64>) -> Result<(), String> {
        let longest = self.limits.width.max(self.limits.height);
        if !(1..=longest).contains(&width) || !(1..=longest).contains(&height) {
            return Err(format!("a picture of {width}×{height} pixels"));
        }
        self.heard.frames_expected = frames_expected.filter(|&n| n > 0);
        once(&mut self.heard.size, (width, height), "recording")
    }

    fn frames(&mut self, times_s: Vec<f64>, seen: Vec<SeenRow>) -> Result<News, String> {
        self.only(&[Kind::Probe, Kind::Track])?;
        let before = self.heard.times_s.len() as u64;
        self.heard.times_s.reserve(times_s.len());
        for time_s in times_s {
            let last = self.heard.times_s.last().copied().unwrap_or(-f64::MIN_POSITIVE);
            if !(time_s > last && time_s <= self.limits.duration_s) {
                return Err(format!("a frame at {time_s} s after one at {last} s"));
            }
            self.heard.times_s.push(time_s);
        }
        let after = self.heard.times_s.len() as u64;
        if after > self.limits.frames {
            return Err(format!("{after} frames"));
        }
        let place = |row: &SeenRow| (row.frame, row.tool);
        let known = |row: &SeenRow| (before..after).contains(&row.frame) && (row.tool as usize) < self.tools;
        if !seen.iter().all(|row| known(row) && row.numbers().all(|x| sensible(x.into())))
            || !seen.is_sorted_by(|a, b| place(a) < place(b))
        {
            return Err("an invalid row of observations".into());
        }
        self.heard.seen.extend(seen);
        Ok(share(after, self.heard.frames_expected))
    }

    fn followed(&mut self, followed: Followed) -> Result<News, String> {
        self.only(&[Kind::Follow])?;
        for frame in &followed.frames {
            let is_later = self.followed.is_none_or(|(number, time_s)| frame.frame != number && frame.time_s > time_s);
            let in_time = (0.0..=self.limits.duration_s).contains(&frame.time_s);
            let are_tools = frame.tools.len() == self.tools
                && frame.tools.iter().enumerate().all(|(index, tool)| is_of(tool, frame, index as u32));
            if !(is_later && in_time && are_tools && frame.frame < MOST_FRAMES) {
                return Err("an invalid frame of a feed".into());
            }
            self.followed = Some((frame.frame, frame.time_s));
        }
        let is_running = |row: &RunningRow| {
            (row.tool as usize) < self.tools && (row.feature as usize) < LIVE.len() && row.value.is_none_or(sensible)
        };
        let is_picture = |jpeg: &[u8]| jpeg.len() <= PREVIEW_BYTES && jpeg.starts_with(&[0xff, 0xd8]);
        let consistent = followed.frames.len() as u64 <= MOST_AT_A_TIME
            && followed.running.iter().flatten().count() <= self.tools * LIVE.len()
            && followed.running.iter().flatten().all(is_running)
            && followed.light.iter().flatten().all(|&x| sensible(x))
            && followed.placement.iter().flat_map(PlacementShape::numbers).all(sensible)
            && followed.placement.iter().all(|placement| placement.ports.len() == self.tools)
            && followed.picture.as_ref().is_none_or(|(_, jpeg)| is_picture(jpeg));
        if consistent { Ok(News::Followed(followed)) } else { Err("an invalid reply about a feed".into()) }
    }

    fn stream(&mut self, info: SourceInfo) -> Result<News, String> {
        self.only(&[Kind::Demux])?;
        self.recording(info.size.0, info.size.1, None)?;
        match info.coded_from.as_ref().is_none_or(|codec| codec.len() <= TEXTS[0] && codec.is_ascii()) {
            true => Ok(News::Stream(info)),
            false => Err("a codec without a name".into()),
        }
    }

    fn coded(&mut self, frame: CapturedFrame) -> Result<News, String> {
        self.only(&[Kind::Demux])?;
        match self.heard.size.is_some() && frame.bytes.len() <= MOST_PAYLOAD && frame.due_s.is_finite() {
            true => Ok(News::Coded(frame)),
            false => Err("an invalid frame of a stream".into()),
        }
    }

    fn path(&mut self, kind: KindShape, rows: Vec<PathRow>) -> Result<(), String> {
        self.only(&[Kind::Track])?;
        let path = match kind {
            KindShape::Raw => &mut self.heard.raw,
            KindShape::Filtered => &mut self.heard.filtered,
            KindShape::Smoothed => &mut self.heard.smoothed,
        };
        let times_s = &self.heard.times_s;
        let place = |row: &PathRow| (row.frame, row.tool);
        for row in rows {
            let on_its_frame = times_s.get(row.frame as usize).is_some_and(|&t| t == row.time_s);
            let in_order = path.last().is_none_or(|last| place(last) < place(&row));
            if !(on_its_frame && in_order && (row.tool as usize) < self.tools && row.numbers().all(sensible)) {
                return Err("an invalid row of a path".into());
            }
            path.push(row);
        }
        Ok(())
    }

    fn quality(&mut self, quality: QualityShape) -> Result<(), String> {
        self.only(&[Kind::Track])?;
        let frames = self.heard.times_s.len() as u64;
        let consistent = quality.frames == frames
            && quality.frames_interlaced <= frames
            && quality.tools.len() == self.tools
            && quality.tools.iter().all(|tool| {
                tool.observed_predicted_missing.iter().all(|&n| n <= frames)
                    && tool.reasons.is_sorted_by(|a, b| a.0 < b.0)
                    && tool.reasons.iter().all(|&(_, n)| n <= frames)
                    && [tool.border_residual_px, tool.passing_depth_mm].into_iter().flatten().all(sensible)
                    && tool.effective_diameter.is_none_or(|(numbers, _)| numbers.into_iter().all(sensible))
                    && tool.gaps.iter().all(|gap| gap.0 <= gap.1 && gap.1 < frames)
                    && tool.gaps.is_sorted_by(|a, b| a.1 < b.0)
                    && tool.colour.iter().flatten().all(|margin| {
                        margin.margin_spread_steps.iter().all(|&x| sensible(x))
                            && margin.nearest.chars().count() <= TEXTS[0]
                    })
                    && tool.fulcrum.is_none_or(|fulcrum| fulcrum.numbers().all(sensible))
            })
            && quality.light.len() as u64 <= frames
            && quality.light.iter().flatten().all(|&x| sensible(x));
        if !consistent {
            return Err("a summary that contradicts its frames".into());
        }
        once(&mut self.heard.quality, quality, "summary")
    }

    fn preview(&mut self, jpeg: Vec<u8>) -> Result<(), String> {
        self.only(&[Kind::Probe, Kind::Track])?;
        if jpeg.is_empty() {
            return Ok(());
        }
        if jpeg.len() > PREVIEW_BYTES || !jpeg.starts_with(&[0xff, 0xd8]) {
            return Err("a preview that is not a small JPEG".into());
        }
        once(&mut self.heard.preview, jpeg, "preview")
    }

    fn palette(&mut self, palette: PaletteShape) -> Result<(), String> {
        self.only(&[Kind::Palette])?;
        let named = palette.labels.iter().all(|l| l.chars().count() <= TEXTS[0]);
        if !named || palette.samples.len() > SAMPLES || palette.colour_samples().is_none() {
            return Err("invalid colour samples".into());
        }
        once(&mut self.heard.palette, palette, "palette")
    }

    fn self_test(&mut self, report: SelfTestReport) -> Result<(), String> {
        self.only(&[Kind::SelfTest])?;
        let Some((board, tools)) = &self.tested else { return Err("a reply that does not belong to this work".into()) };
        if !self_tests::is_possible(&report, *board, tools) {
            return Err("an invalid self-test".into());
        }
        once(&mut self.heard.self_test, report, "self-test")
    }

    fn mask(&mut self, mask: FrameMask) -> Result<(), String> {
        self.only(&[Kind::Mask])?;
        let (frames, colours) = &self.masked;
        let next = frames.get(self.heard.masks.len()).ok_or("a mask without a picture")?;
        if !glances::is_possible_mask(&mask, *next, *colours, self.limits) {
            return Err("an invalid mask".into());
        }
        self.heard.masks.push(mask);
        Ok(())
    }

    fn photo_check(&mut self, check: PhotoCheck) -> Result<(), String> {
        self.only(&[Kind::Check])?;
        let Some(board) = self.sought else { return Err("a reply that does not belong to this work".into()) };
        if !glances::is_possible_check(&check, board, self.limits) {
            return Err("an invalid check of a photo".into());
        }
        once(&mut self.heard.photo_check, check, "photo")
    }

    fn palette_report(&mut self, report: PaletteReport) -> Result<(), String> {
        self.only(&[Kind::Palette, Kind::Mask])?;
        if !report.numbers().all(sensible) || report.texts().any(|text| text.chars().count() > TEXTS[2]) {
            return Err("an invalid report on colours".into());
        }
        once(&mut self.heard.palette_report, report, "report on colours")
    }

    fn palette_advice(&mut self, advice: PaletteAdvice) -> Result<(), String> {
        self.only(&[Kind::Advise])?;
        if !advices::is_possible(&advice) {
            return Err("invalid advice on tapes".into());
        }
        once(&mut self.heard.palette_advice, advice, "advice on tapes")
    }
}

/// True if the tool's rows belong to this frame.
fn is_of(tool: &FollowedTool, frame: &FollowedFrame, index: u32) -> bool {
    let FollowedTool { seen, path, .. } = tool;
    (seen.frame, seen.tool) == (frame.frame, index)
        && seen.numbers().all(|x| sensible(x.into()))
        && path.is_none_or(|row| {
            (row.frame, row.tool, row.time_s) == (frame.frame, index, frame.time_s) && row.numbers().all(sensible)
        })
}

fn once<T>(slot: &mut Option<T>, value: T, what: &str) -> Result<(), String> {
    match slot.replace(value) {
        None => Ok(()),
        Some(_) => Err(format!("a second {what}")),
    }
}

fn sensible(x: f64) -> bool {
    x.is_finite() && x.abs() <= MAGNITUDE
}

fn share(done: u64, of: Option<u64>) -> News {
    let share = of.filter(|&of| of > 0).map(|of| (done as f64 / of as f64).min(1.0));
    share.map_or(News::Nothing, News::Progress)
}

#[cfg(test)]
mod tests;
