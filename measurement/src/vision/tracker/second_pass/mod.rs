//! Second pass over one tool's recording, after its last frame.
//!
//! [`super::pair_reassignment`] has assigned the records before. The errors that all poses share are estimated from
//! all poses together and corrected in each of them, from the first frame on. Then the filter runs again over the
//! corrected poses, and the smoother runs backwards over its result.

use std::ops::Range;

use super::blocks::Blocks;
use super::gaps::{self, FrameMargin};
use super::motion::{FrameInstant, StateUpdate, ToolMotion, TrackedRun};
use super::record::{FrameRecord, PlacedAxis};
use super::report::{DiameterBasis, EffectiveDiameter, ToolQuality};
use super::settings::{MotionSettings, ToolSpec};
use crate::vision::camera::Camera;
use crate::vision::edges::shaft::SeenShaft;
use crate::vision::filter::track::{Track, TrackSettings};
use crate::vision::pose::adjustment::{self, Adjustment};
use crate::vision::pose::axis_line::AxisLine;
use crate::vision::pose::fulcrum;
use crate::vision::pose::normal_equations::{shared_offsets_of_shaft_px, shared_offsets_px};
use crate::vision::pose::size_check;
use crate::vision::pose::{StoredPose, TubeEstimate};
use crate::vision::reason::MissReason;
use crate::vision::trajectory::PathKind;

/// Runs the second pass over one tool's records. A trocar is assumed only for a band with a shaft behind it.
pub fn run(
    (records, axes): (Blocks<FrameRecord>, Vec<PlacedAxis>),
    seen_shaft: &SeenShaft,
    spec: &ToolSpec,
    tool: usize,
    instants: &[FrameInstant],
    camera: &Camera,
    motion: &MotionSettings,
) -> (ToolMotion, ToolQuality) {
    let islands = isolated_runs(&records, instants, motion.max_prediction_s, spec);
    let good = sample_good_poses(&records);
    let adjustment = adjustment::estimate(&good).filter(|found| found.shows_side() || !seen_shaft.is_missing());
    let border_residual_px = rms(records.iter().filter_map(|r| r.pose.as_ref()).map(StoredPose::residual_px));
    let mut rework = SecondPass::new(tool, camera, motion);
    rework.motion.fulcrum = adjustment.as_ref().and_then(Adjustment::well_known_fulcrum);
    let mut axes = axes.into_iter().peekable();
    let mut reasons = Vec::with_capacity(instants.len());
    for (frame, (record, instant)) in records.into_iter().zip(instants).enumerate() {
        let is_isolated = islands.iter().any(|island| island.contains(&frame));
        let confirmed = match record.pose {
            None => Err(None),
            Some(_) if is_isolated => Err(Some(MissReason::Misread)),
            Some(_) => confirm(record.estimate(), adjustment.as_ref()).map_err(Some),
        };
        let rejected = confirmed.err().flatten();
        let axis = axes.next_if(|(place, _)| *place == frame).map(|(_, axis)| axis);
        reasons.push(rework.add_frame(*instant, confirmed.ok(), axis, record.reason.or(rejected)));
    }
    let (motion, quality) = rework.finish();
    let rim = FrameMargin::new(camera, spec.band_length_mm());
    let gaps = gaps::find_gaps(&motion.path(PathKind::Smoothed), instants, &reasons, &rim);
    let quality = ToolQuality {
        tool: spec.name.clone(),
        border_residual_px,
        transient_depth_sigma_mm: motion.transient_depth_sigma_mm(),
        effective_diameter: effective_diameter(&motion, adjustment.as_ref(), spec),
        gaps,
        fulcrum: motion.fulcrum,
        size_mismatch: size_check::mismatch(&good),
        ..quality
    };
    (motion, quality)
}

fn effective_diameter(
    motion: &ToolMotion,
    adjustment: Option<&Adjustment>,
    spec: &ToolSpec,
) -> Option<EffectiveDiameter> {
    let mm_per_px = motion.median_depth_mm()? / motion.camera.fx;
    let px_per_mm = 1.0 / mm_per_px;
    let usual_px = if spec.is_bare() {
        shared_offsets_of_shaft_px(0.5 * spec.diameter_mm * px_per_mm, px_per_mm, px_per_mm)[0]
    } else {
        shared_offsets_px(px_per_mm, px_per_mm)[0]
    };
    let meeting = adjustment.filter(|adjustment| !adjustment.is_wrong_way_round());
    let (px, sigma_px, basis) = match meeting {
        Some(_) if spec.is_bare() => (0.0, usual_px, DiameterBasis::BareShaft),
        None if spec.is_bare() => (0.0, usual_px, DiameterBasis::BareShaftWithoutTrocar),
        Some(adjustment) => {
            let (px, sigma_px) = adjustment.border_offset_px();
            let is_shown = adjustment.is_right_way_round();
            (px, sigma_px, if is_shown { DiameterBasis::Session } else { DiameterBasis::AssumedTrocar })
        }
        None => (0.0, usual_px, DiameterBasis::Usual),
    };
    let twice = 2.0 * mm_per_px;
    Some(EffectiveDiameter { mm: spec.diameter_mm + twice * px, sigma_mm: twice * sigma_px, basis })
}

/// The pose as the whole recording confirms it, or why it is rejected.
fn confirm(estimate: Option<TubeEstimate>, adjustment: Option<&Adjustment>) -> Result<TubeEstimate, MissReason> {
    let pose = estimate.ok_or(MissReason::Misread)?;
    match adjustment {
        Some(adjustment) if adjustment.is_wrong_way_round() => Err(MissReason::WrongWayRound),
        Some(adjustment) => steadied(&pose, adjustment),
        None => Ok(pose),
    }
}

/// The pose corrected with the session's fulcrum and offsets. It is rejected if its axis misses the fulcrum by too
/// much: its edges then belong to something else, and the corrected pose would look plausible but be millimetres off.
/// It is also rejected if the fulcrum lies ahead of it: it then has the tip where the hand is.
fn steadied(pose: &TubeEstimate, adjustment: &Adjustment) -> Result<TubeEstimate, MissReason> {
    const MAX_MISS_SQUARED: f64 = 30.0; // rejects 3 in 10 million good poses (two degrees of freedom)
    let passes = fulcrum::miss_squared(pose, &adjustment.fulcrum) < MAX_MISS_SQUARED;
    if !passes {
        return Err(MissReason::OffFulcrum);
    }
    if !adjustment.is_behind(&pose.tube) {
        return Err(MissReason::WrongWayRound);
    }
    adjustment::steady(pose, adjustment).ok_or(MissReason::Misread)
}

/// Good poses for the joint adjustment: at most `MAX_SAMPLED`, spread over the recording.
fn sample_good_poses(records: &Blocks<FrameRecord>) -> Vec<TubeEstimate> {
    const MAX_SAMPLED: usize = 256;
    let good = || records.iter().filter(|record| record.is_good);
    let every = good().count().div_ceil(MAX_SAMPLED).max(1);
    good().step_by(every).filter_map(FrameRecord::estimate).collect()
}

/// Isolated runs with fewer than `MIN_MEASURED` measured frames. A bridge to such a run could be wrong because nothing
/// confirms its measurements; without it there is only a gap. The only run of a band is kept, because its colour
/// confirms it; a bare shaft has no such mark.
fn isolated_runs(
    records: &Blocks<FrameRecord>,
    instants: &[FrameInstant],
    longest_gap_s: f64,
    spec: &ToolSpec,
) -> Vec<Range<usize>> {
    const MIN_MEASURED: usize = 4;
    let mut pieces: Vec<(Range<usize>, usize)> = Vec::new();
    for frame in (0..records.len()).filter(|frame| records[*frame].pose.is_some()) {
        match pieces.last_mut() {
            Some((piece, measured)) if instants[frame].1 - instants[piece.end - 1].1 <= longest_gap_s => {
                (piece.end, *measured) = (frame + 1, *measured + 1);
            }
            _ => pieces.push((frame..frame + 1, 1)),
        }
    }
    let is_confirmed = pieces.len() == 1 && !spec.is_bare();
    let is_small = |(_, measured): &(Range<usize>, usize)| !is_confirmed && *measured < MIN_MEASURED;
    pieces.into_iter().filter(is_small).map(|(piece, _)| piece).collect()
}

/// State of the second pass over one tool's recording.
struct SecondPass {
    settings: TrackSettings,
    track: Track,
    run: TrackedRun,
    motion: ToolMotion,
    quality: ToolQuality,
}

impl SecondPass {
    fn new(tool: usize, camera: &Camera, settings: &MotionSettings) -> Self {
        let longest_prediction_s = settings.max_prediction_s;
        Self {
            settings: TrackSettings { max_prediction_s: settings.max_bridge_s, ..settings.track_settings() },
            track: Track::default(),
            run: TrackedRun::default(),
            motion: ToolMotion {
                tool,
                runs: Vec::new(),
                camera: *camera,
                fulcrum: None,
                max_prediction_s: longest_prediction_s,
                max_hidden_s: settings.max_hidden_s,
            },
            quality: ToolQuality::default(),
        }
    }

    /// Adds one frame: its pose, or the axis of a tool whose tip is hidden, or the reason for having none. Returns why the
    /// frame was not measured or its pose was rejected.
    fn add_frame(
        &mut self,
        instant: FrameInstant,
        pose: Option<TubeEstimate>,
        axis: Option<AxisLine>,
        reason: Option<MissReason>,
    ) -> Option<MissReason> {
        let measured = pose.map(|p| (p.tube.tip, p.changing_tip_covariance()));
        let (advance, across) = match axis.filter(|_| pose.is_none()) {
            Some(line) => self.track.advance_along_axis(instant.1, &line, &self.settings),
            None => (self.track.advance(instant.1, measured, &self.settings), None),
        };
        let refused = reason.or(advance.refused);
        count(&mut self.quality, advance.observed, advance.state.is_some(), refused);
        if advance.discards_previous {
            let (all, seen) = self.start_run().frame_counts(); // discarded: subtract its frames from the counts
            self.quality.observed -= seen;
            self.quality.predicted -= all - seen;
            self.quality.missing += all;
        } else if advance.starts_track || advance.state.is_none() {
            let ended = self.start_run();
            self.motion.runs.extend(Some(ended).filter(|run| run.frame_counts().0 > 0));
        }
        if let Some(state) = advance.state {
            let update = match pose.as_ref().filter(|_| advance.observed) {
                Some(pose) => StateUpdate::Tip(pose),
                None => across.map_or(StateUpdate::None, StateUpdate::Axis),
            };
            self.run.add(&state, advance.noise_density, instant, update);
        }
        refused
    }

    /// Starts a new run and returns the previous one.
    fn start_run(&mut self) -> TrackedRun {
        std::mem::take(&mut self.run)
    }

    /// Finishes the recording. Bridged frames that are not in the smoothed path move from `predicted` to `missing`.
    fn finish(mut self) -> (ToolMotion, ToolQuality) {
        let last = self.start_run();
        self.motion.runs.push(last);
        let all: u64 = self.motion.runs.iter().map(|run| run.frame_counts().0).sum();
        let unsupported = all - self.motion.path(PathKind::Smoothed).len() as u64;
        self.quality.predicted -= unsupported;
        self.quality.missing += unsupported;
        (self.motion, self.quality)
    }
}

fn count(quality: &mut ToolQuality, observed: bool, tracked: bool, reason: Option<MissReason>) {
    match (observed, tracked) {
        (true, _) => quality.observed += 1,
        (false, true) => quality.predicted += 1,
        (false, false) => quality.missing += 1,
    }
    if let Some(reason) = reason {
        *quality.reasons.entry(reason).or_default() += 1;
    }
}

fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, squares) = values.fold((0u64, 0.0), |(n, s), v| (n + 1, s + v * v));
    (count > 0).then(|| (squares / count as f64).sqrt())
}

#[cfg(test)]
mod tests;
