//! Figures that describe how one tool was seen.

use std::collections::BTreeMap;
use std::fmt;

use nalgebra::Vector3;

use super::jumps::{JumpSearch, PathJump};
use super::noise_floor::{self, NoiseFloor};
use super::{Displacement, MeasuredRange, PortPlacement, QualityInput};
use crate::numbers::quantile::quantile;
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::pose::size_check::SizeMismatch;
use crate::vision::reason::MissReason;
use crate::vision::segmentation::palette::ColourSeparation;
use crate::vision::tracker::{Absence, EffectiveDiameter, ToolQuality, TrocarEvidence};
use crate::vision::trajectory::{Sample, SampleState, Trajectory};

/// How one tool was seen. Shares are 0 to 1; `None` if the input does not contain the figure.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolFigures {
    /// The tool's name.
    pub tool: String,
    /// Number of frames on which it was measured.
    pub observed: u64,
    /// Share of the session's frames on which it was measured, from the first to the last frame with any tool.
    pub coverage: Option<f64>,
    /// The same share between its own first and last frame.
    pub coverage_while_there: Option<f64>,
    /// The same share of all frames of the recording.
    pub coverage_of_recording: Option<f64>,
    /// Share of its positions that are bridged, not measured.
    pub predicted_share: Option<f64>,
    /// Share of the session's frames on which it was out of view.
    pub left_view_share: Option<f64>,
    /// Share of the frames of the whole recording on which it has no position, among those with it in view.
    pub lost_share: Option<f64>,
    /// Longest stretch of the recording without a position, with the tool in view.
    pub longest_lost: Option<LostStretch>,
    /// Frames of the session in gaps caused by the tracker, by their main reason.
    pub lost_frames: BTreeMap<MissReason, u64>,
    /// Longest stretch of the session without a measurement, s.
    pub longest_gap_s: Option<f64>,
    /// RMS distance of border points from the fitted outline, pixels.
    pub border_residual_px: Option<f64>,
    /// What its axes say of its trocar.
    pub trocar: Option<TrocarEvidence>,
    /// Distance of its positions from their mean across its mean axis, root mean square, mm, if its axes do not show its
    /// trocar.
    pub moved_without_trocar_mm: Option<f64>,
    /// The effective diameter of its tape.
    pub effective_diameter: Option<EffectiveDiameter>,
    /// True if it was followed by its bare shaft.
    pub is_bare: bool,
    /// Whether the picture contradicts its sizes.
    pub size_mismatch: Option<SizeMismatch>,
    /// Measurements that contradict the tool's motion, as a share of all measurements.
    pub rejected_share: Option<f64>,
    /// The fastest step from one row of its path to the next, m/s.
    pub fastest_step: Option<PathJump>,
    /// The sharpest turn of its path out to a few rows and back, m/s².
    pub sharpest_turn: Option<PathJump>,
    /// Speed at which it would appear to move at rest.
    pub noise_floor: Option<NoiseFloor>,
    /// The stated standard deviation of its measured positions. The name does not mean the error bars of features.
    pub error_bar: Option<PositionError>,
    /// Distance of its colour from the other marked colours.
    pub colour: ColourSeparation,
    /// Position of its trocar.
    pub fulcrum: Option<Fulcrum>,
    /// Distance of the trocar from the nearest trocar of earlier sessions.
    pub port_shift: Option<Displacement>,
    /// True if this trocar alone has moved.
    pub has_port_moved: bool,
    /// True if it was never measured and its colour was never in the picture.
    pub never_in_picture: bool,
}

/// A stretch of the recording during which a tool in view was not tracked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LostStretch {
    /// Time of its first frame, s.
    pub from_s: f64,
    /// Time of its last frame, s.
    pub to_s: f64,
    /// True if the recording ends with it.
    pub to_end: bool,
}

impl LostStretch {
    /// The longest of a tool's gaps that are no absence, within the frames of the path; `None` if their times are
    /// unknown. Gaps count the frames of the recording. An edit may have cut the first ones off.
    fn longest(tool: &ToolQuality, path: &Trajectory) -> Option<Self> {
        let (times_s, sample) = (&path.frame_times_s, path.samples.first()?);
        let first = sample.frame.checked_sub(times_s.partition_point(|time_s| *time_s < sample.time_s) as u64)?;
        let last = (first + times_s.len() as u64).checked_sub(1)?;
        let lost = tool.gaps.iter().filter(|gap| matches!(gap.absence, Absence::Lost(_)));
        let inside = lost.map(|gap| (gap.first.max(first), gap.last.min(last))).filter(|(from, to)| from <= to);
        let (from, to) = inside.max_by_key(|(from, to)| to - from)?;
        let time_s = |frame: u64| times_s.get((frame - first) as usize).copied();
        Some(Self { from_s: time_s(from)?, to_s: time_s(to)?, to_end: to == last })
    }
}

/// As an addition to the finding.
impl fmt::Display for LostStretch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { from_s, to_s, to_end } = self;
        write!(f, "; longest from {from_s:.1} s to ")?;
        if *to_end { f.write_str("the end of the recording") } else { write!(f, "{to_s:.1} s") }
    }
}

/// The stated standard deviation of measured positions in space, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionError {
    /// Half of the positions have a smaller one.
    pub median_mm: f64,
    /// 95 % of the positions have a smaller one.
    pub p95_mm: f64,
}

pub(super) fn measure(
    evidence: &QualityInput<'_>,
    index: usize,
    shown: Option<MeasuredRange>,
    placement: &PortPlacement,
) -> ToolFigures {
    let path: Vec<&Sample> = evidence.smoothed.of_tool(index).collect();
    let seen: Vec<&Sample> = path.iter().copied().filter(|s| s.state == SampleState::Observed).collect();
    let tracker = evidence.tracker.and_then(|quality| quality.tools.get(index));
    let observed = seen.len() as u64;
    let ends = seen.first().zip(seen.last());
    let recorded = evidence.tracker.map(|quality| quality.frames);
    let gaps = tracker.zip(shown).map(|(tool, shown)| ToolGaps::within(tool, shown));
    let jumps = JumpSearch::new(&path, evidence.smoothed.cuts_of(index));
    let of_session = |frames: u64| shown.and_then(|shown| share(frames, shown.frames()));
    let effective_diameter = tracker.and_then(|tool| tool.effective_diameter);
    ToolFigures {
        tool: evidence.smoothed.tools[index].clone(),
        observed,
        coverage: of_session(observed),
        coverage_while_there: ends.and_then(|(first, last)| share(observed, last.frame - first.frame + 1)),
        coverage_of_recording: recorded.and_then(|frames| share(observed, frames)),
        predicted_share: share(path.len() as u64 - observed, path.len() as u64),
        left_view_share: gaps.as_ref().and_then(|gaps| of_session(gaps.left_view)),
        lost_share: gaps
            .as_ref()
            .zip(recorded)
            .and_then(|(gaps, frames)| share(gaps.lost_anywhere, frames.saturating_sub(gaps.left_anywhere))),
        longest_lost: tracker.and_then(|tool| LostStretch::longest(tool, evidence.smoothed)),
        lost_frames: gaps.map(|gaps| gaps.lost).unwrap_or_default(),
        longest_gap_s: shown.map(|shown| longest_gap_s(&seen, shown)),
        border_residual_px: tracker.and_then(|tool| tool.border_residual_px),
        trocar: tracker.map(ToolQuality::trocar),
        moved_without_trocar_mm: tracker
            .filter(|tool| tool.trocar() != TrocarEvidence::Shown)
            .and_then(|_| spread_across_mm(&seen)),
        effective_diameter,
        is_bare: effective_diameter.is_some_and(|of| of.basis.is_of_bare_shaft()),
        size_mismatch: tracker.and_then(|tool| tool.size_mismatch),
        rejected_share: tracker.and_then(|tool| {
            let rejected = tool.reasons.get(&MissReason::GateRejected).copied().unwrap_or(0);
            share(rejected, rejected + observed)
        }),
        fastest_step: jumps.fastest_step(),
        sharpest_turn: jumps.sharpest_turn(),
        noise_floor: noise_floor::estimate(evidence, index),
        error_bar: error_bar(&seen),
        colour: tracker.map(|tool| tool.colour.clone()).unwrap_or_default(),
        fulcrum: tracker.and_then(|tool| tool.fulcrum),
        port_shift: placement.tools.get(index).copied().flatten(),
        has_port_moved: placement.port(index).is_some(),
        never_in_picture: observed == 0 && tracker.is_some_and(never_in_picture),
    }
}

/// Distance of the positions from their mean across their mean axis, root mean square, mm. A tool that moves along its
/// axis does not turn.
fn spread_across_mm(seen: &[&Sample]) -> Option<f64> {
    let count = seen.len() as f64;
    let mean = seen.iter().map(|sample| sample.tip_mm.coords).sum::<Vector3<f64>>() / count;
    let axes = seen.iter().filter_map(|sample| sample.axis).sum::<Vector3<f64>>();
    let along = axes.try_normalize(1e-9).unwrap_or_default(); // without axes, all motion counts
    let across = |moved: Vector3<f64>| moved - along * moved.dot(&along);
    let squares: f64 = seen.iter().map(|sample| across(sample.tip_mm.coords - mean).norm_squared()).sum();
    (!seen.is_empty()).then(|| (squares / count).sqrt())
}

fn share(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

fn never_in_picture(tool: &ToolQuality) -> bool {
    tool.gaps.iter().all(|gap| gap.absence == Absence::LeftView)
}

/// The gaps of a tool within the session by cause, in frames.
struct ToolGaps {
    left_view: u64,
    lost: BTreeMap<MissReason, u64>,
    /// The same in the whole recording.
    left_anywhere: u64,
    lost_anywhere: u64,
}

impl ToolGaps {
    fn within(tool: &ToolQuality, shown: MeasuredRange) -> Self {
        let mut gaps = Self { left_view: 0, lost: BTreeMap::new(), lost_anywhere: 0, left_anywhere: 0 };
        for gap in &tool.gaps {
            let of = if gap.absence == Absence::LeftView { &mut gaps.left_anywhere } else { &mut gaps.lost_anywhere };
            *of += gap.last + 1 - gap.first;
            let (first, last) = (gap.first.max(shown.first), gap.last.min(shown.last));
            let frames = (last + 1).saturating_sub(first);
            match gap.absence {
                _ if frames == 0 => {}
                Absence::LeftView => gaps.left_view += frames,
                Absence::Lost(reason) => *gaps.lost.entry(reason).or_default() += frames,
            }
        }
        gaps
    }
}

fn longest_gap_s(seen: &[&Sample], shown: MeasuredRange) -> f64 {
    let times = [shown.first_s].into_iter().chain(seen.iter().map(|s| s.time_s)).chain([shown.last_s]);
    let times: Vec<f64> = times.collect();
    times.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
}

fn error_bar(seen: &[&Sample]) -> Option<PositionError> {
    let sigma = |s: &&Sample| s.covariance_mm2.map(|stated| stated.matrix().trace().sqrt());
    let sigmas: Vec<f64> = seen.iter().filter_map(sigma).collect();
    Some(PositionError { median_mm: quantile(sigmas.clone(), 0.5)?, p95_mm: quantile(sigmas, 0.95)? })
}
