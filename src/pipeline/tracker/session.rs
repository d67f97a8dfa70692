//! The end of a recording: everything that was seen, looked at again with hindsight.
//!
//! What all poses share is worked out from them together and steadies each, also the first; the filter runs once more over the
//! steadied poses, and the smoother behind it.

use nalgebra::{Matrix3, Point2, Vector3};

use super::gaps::{self, Rim};
use super::report::ToolQuality;
use super::settings::MotionSettings;
use super::tool::{self, Record, ToolTracker};
use crate::pipeline::camera::Camera;
use crate::pipeline::filter::identity::{Thread, ThreadSettings};
use crate::pipeline::filter::kalman::State;
use crate::pipeline::filter::smoother::{Step, smooth};
use crate::pipeline::pose::adjustment::{self, Adjustment};
use crate::pipeline::pose::fulcrum::{self, Fulcrum};
use crate::pipeline::pose::{KeptPose, TubeEstimate};
use crate::pipeline::reason::Reason;
use crate::pipeline::space::CameraPoint;
use crate::pipeline::trajectory::{Sample, SampleState};

/// A frame's number and time.
pub type Instant = (u64, f64);

/// One tool's three paths and quality.
pub struct ToolPaths {
    pub raw: Vec<Sample>,
    pub filtered: Vec<Sample>,
    pub smoothed: Vec<Sample>,
    pub quality: ToolQuality,
}

/// Reworks one tool's records.
pub fn rework(
    tool: &ToolTracker,
    index: usize,
    instants: &[Instant],
    camera: &Camera,
    motion: &MotionSettings,
) -> ToolPaths {
    let hindsight = ThreadSettings { longest_prediction_s: motion.longest_bridge_s, ..motion.thread() };
    let good = thinned(&tool.records);
    let adjustment = adjustment::estimate(&good).filter(tool::is_known);
    let fulcrum = adjustment.as_ref().map(|a| a.fulcrum);
    let mut paths = ToolPaths {
        raw: Vec::new(),
        filtered: Vec::new(),
        smoothed: Vec::new(),
        quality: ToolQuality { tool: tool.spec.name.clone(), ..ToolQuality::default() },
    };
    let mut following = Thread::default();
    let mut run = Run { longest_prediction_s: motion.longest_prediction_s, ..Run::default() };
    let mut reasons = Vec::with_capacity(instants.len());
    for (record, instant) in tool.records.iter().zip(instants) {
        let pose = record.estimate().and_then(|e| match &adjustment {
            Some(adjustment) => steadied(&e, adjustment),
            None => Some(e),
        });
        let misread = (record.pose.is_some() && pose.is_none()).then_some(Reason::ImpossiblePose);
        let reason = record.reason.or(misread);
        let measured = pose.map(|p| (p.tube.tip, p.tip_covariance()));
        let advance = following.advance(instant.1, measured, &hindsight);
        reasons.push(reason.or(advance.refused));
        count(&mut paths.quality, advance.observed, advance.step.is_some(), reason.or(advance.refused));
        let believed = pose.filter(|_| advance.observed);
        if advance.disowns {
            run.drop_from(&mut paths);
        }
        if let Some(pose) = believed {
            paths.raw.push(raw_sample(&pose, index, *instant, camera));
        }
        if advance.begins || advance.step.is_none() {
            run.close(&mut paths, index, camera, fulcrum.as_ref());
        }
        if let Some(step) = advance.step {
            let in_sight = record.reason != Some(Reason::NoMarkerColour);
            run.add(step, *instant, believed, in_sight);
        }
    }
    run.close(&mut paths, index, camera, fulcrum.as_ref());
    paths.quality.border_residual_px =
        rms(tool.records.iter().filter_map(|r| r.pose.as_ref()).map(KeptPose::residual_px));
    paths.quality.gaps = gaps::find(&paths.smoothed, instants, &reasons, &Rim::new(camera, tool.spec.band_length_mm));
    paths
}

/// The pose as the whole session has it; `None` where its axis passes so far beside the fulcrum that its edges were taken for
/// others': steadied, it would look right, and lie millimetres off.
fn steadied(pose: &TubeEstimate, adjustment: &Adjustment) -> Option<TubeEstimate> {
    const MOST_SQUARED: f64 = 30.0; // passes all but 3 in 10 million good ones: two degrees of freedom
    let passes = fulcrum::miss_squared(pose, &adjustment.fulcrum) < MOST_SQUARED;
    if passes { adjustment::steady(pose, adjustment) } else { None }
}

/// Good poses enough to be adjusted together, spread over the recording.
fn thinned(records: &[Record]) -> Vec<TubeEstimate> {
    const ENOUGH: usize = 256;
    let good = || records.iter().filter(|record| record.is_good);
    let every = good().count().div_ceil(ENOUGH).max(1);
    good().step_by(every).filter_map(Record::estimate).collect()
}

/// An unbroken run of the filter.
#[derive(Default)]
struct Run {
    longest_prediction_s: f64,
    steps: Vec<Step>,
    instants: Vec<Instant>,
    poses: Vec<Option<PastPose>>,
    in_sight: Vec<bool>,
}

impl Run {
    fn add(&mut self, step: Step, instant: Instant, pose: Option<TubeEstimate>, in_sight: bool) {
        self.in_sight.push(in_sight);
        self.steps.push(step);
        self.instants.push(instant);
        self.poses.push(pose.as_ref().map(PastPose::from));
    }

    /// Forgets a run that was none.
    fn drop_from(&mut self, paths: &mut ToolPaths) {
        let first = self.instants.first().map_or(u64::MAX, |instant| instant.0);
        let (seen, all) = (self.poses.iter().flatten().count() as u64, self.poses.len() as u64);
        paths.quality.observed -= seen; // counted when they were added
        paths.quality.predicted -= all - seen;
        paths.quality.missing += all;
        paths.raw.retain(|sample| sample.frame < first);
        self.clear();
    }

    fn clear(&mut self) {
        *self = Self { longest_prediction_s: self.longest_prediction_s, ..Self::default() };
    }

    /// How many frames the smoothed path has: up to the last that saw the tool, and a short prediction beyond; but
    /// hindsight knows when the tool was gone, and ends with the last frame that showed anything of its colour.
    fn smoothed_frames(&self) -> usize {
        let after = |place: Option<usize>| place.map_or(0, |last| last + 1);
        let seen_s =
            self.poses.iter().rposition(Option::is_some).map_or(f64::NEG_INFINITY, |last| self.instants[last].1);
        let near = self.instants.iter().rposition(|instant| instant.1 - seen_s <= self.longest_prediction_s);
        after(near).min(after(self.in_sight.iter().rposition(|seen| *seen)))
    }

    /// Smooths the run and writes both paths. The filtered path is what was known at the time: it breaks off in a gap that
    /// only hindsight bridges.
    fn close(&mut self, paths: &mut ToolPaths, tool: usize, camera: &Camera, fulcrum: Option<&Fulcrum>) {
        let mut pose = self.poses.iter().flatten().next().copied();
        let smoothed_frames = self.smoothed_frames();
        let mut seen_s = f64::NEG_INFINITY;
        let steps = self.steps.iter().zip(smooth(&self.steps)).zip(self.instants.iter().zip(&self.poses));
        for (place, ((step, smoothed), (instant, seen))) in steps.enumerate() {
            pose = seen.or(pose);
            seen_s = if seen.is_some() { instant.1 } else { seen_s };
            let state = if seen.is_some() { SampleState::Observed } else { SampleState::Predicted };
            let sample = |s: &State| state_sample(s, pose.as_ref(), tool, *instant, state, camera, fulcrum);
            let (filtered, smoothed) = (sample(&step.updated), sample(&smoothed));
            if instant.1 - seen_s <= self.longest_prediction_s && is_supported(&filtered, camera) {
                paths.filtered.push(filtered);
            }
            if place < smoothed_frames && is_supported(&smoothed, camera) {
                paths.smoothed.push(smoothed);
            } else {
                paths.quality.predicted -= 1; // counted when it was added
                paths.quality.missing += 1;
            }
        }
        self.clear();
    }
}

/// A tip that was seen, or one that is predicted where it could have been: outside the picture nothing supports it.
fn is_supported(sample: &Sample, camera: &Camera) -> bool {
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let in_picture = |at: Point2<f64>| (0.0..width).contains(&at.x) && (0.0..height).contains(&at.y);
    sample.state == SampleState::Observed || sample.tip_px.is_some_and(in_picture)
}

/// What a filter's state needs of the pose that was measured last.
#[derive(Clone, Copy, Debug)]
pub struct PastPose {
    axis: Vector3<f64>,
    /// The lasting part of the tip's covariance, mm².
    lasting: Matrix3<f64>,
}

impl From<&TubeEstimate> for PastPose {
    fn from(pose: &TubeEstimate) -> Self {
        Self { axis: pose.tube.axis, lasting: pose.lasting_tip_covariance() }
    }
}

/// A sample of a filter's state. What lasts in the errors of poses like `pose`, the nearest one measured, the filter has
/// taken for noise and averaged away: it is added again (Schmidt's "considered" errors).
pub fn state_sample(
    state: &State,
    pose: Option<&PastPose>,
    tool: usize,
    instant: Instant,
    seen: SampleState,
    camera: &Camera,
    fulcrum: Option<&Fulcrum>,
) -> Sample {
    let tip = state.tip();
    let covariance = state.tip_covariance() + pose.map_or_else(Matrix3::zeros, |p| p.lasting);
    let by_fulcrum = fulcrum.and_then(|f| (tip - f.at).try_normalize(1e-9));
    Sample {
        frame: instant.0,
        time_s: instant.1,
        tool,
        tip_mm: tip,
        velocity_mm_s: Some(state.velocity()),
        axis: by_fulcrum.or(pose.map(|p| p.axis)),
        tip_px: camera.project(CameraPoint(tip)).map(|p| p.0),
        sigma_xy_mm: Some((0.5 * (covariance[(0, 0)] + covariance[(1, 1)])).sqrt()),
        sigma_z_mm: Some(covariance[(2, 2)].sqrt()),
        state: seen,
    }
}

fn raw_sample(pose: &TubeEstimate, tool: usize, instant: Instant, camera: &Camera) -> Sample {
    let covariance = pose.tip_covariance();
    Sample {
        frame: instant.0,
        time_s: instant.1,
        tool,
        tip_mm: pose.tube.tip,
        velocity_mm_s: None,
        axis: Some(pose.tube.axis),
        tip_px: camera.project(CameraPoint(pose.tube.tip)).map(|p| p.0),
        sigma_xy_mm: Some((0.5 * (covariance[(0, 0)] + covariance[(1, 1)])).sqrt()),
        sigma_z_mm: Some(covariance[(2, 2)].sqrt()),
        state: SampleState::Observed,
    }
}

fn count(quality: &mut ToolQuality, observed: bool, tracked: bool, reason: Option<Reason>) {
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
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::pipeline::camera::testing::STRAIGHT as CAMERA;
    use crate::pipeline::pose::evidence::Evidence;
    use crate::pipeline::tube::Tube;

    /// No multiple of it is a limit, where rounding would decide.
    const FRAME_S: f64 = 0.039;

    fn paths(seen: &[bool]) -> ToolPaths {
        paths_from(0.0, 0.0, seen)
    }

    /// A tool that moves to the right, mm and mm/s, seen on some frames only, but with its colour always in sight.
    fn paths_from(x_mm: f64, speed_mm_s: f64, seen: &[bool]) -> ToolPaths {
        let motion = MotionSettings::default();
        let hindsight = ThreadSettings { longest_prediction_s: motion.longest_bridge_s, ..motion.thread() };
        let covariance = nalgebra::Matrix5::identity() * 0.01;
        let mut thread = Thread::default();
        let mut run = Run { longest_prediction_s: motion.longest_prediction_s, ..Run::default() };
        let mut paths =
            ToolPaths { raw: Vec::new(), filtered: Vec::new(), smoothed: Vec::new(), quality: ToolQuality::default() };
        for (frame, seen) in seen.iter().enumerate() {
            let instant = (frame as u64, frame as f64 * FRAME_S);
            let tip = Point3::new(x_mm + speed_mm_s * instant.1, 0.0, 150.0);
            let tube = Tube { tip, axis: Vector3::z(), radius: 2.5 };
            let pose = TubeEstimate {
                tube,
                covariance,
                lasting: covariance,
                evidence: Evidence::of_covariance(&covariance),
                residual_px: 0.1,
                support: 50.0,
            };
            let advance = thread.advance(instant.1, seen.then(|| (tip, pose.tip_covariance())), &hindsight);
            count(&mut paths.quality, advance.observed, advance.step.is_some(), None);
            match advance.step {
                Some(step) if !advance.begins || frame == 0 => run.add(step, instant, seen.then_some(pose), true),
                step => {
                    run.close(&mut paths, 0, &CAMERA, None);
                    step.into_iter().for_each(|step| run.add(step, instant, seen.then_some(pose), true));
                }
            }
        }
        run.close(&mut paths, 0, &CAMERA, None);
        paths
    }

    fn frames(samples: &[Sample]) -> Vec<u64> {
        samples.iter().map(|sample| sample.frame).collect()
    }

    fn with_gap(length: usize, after: usize) -> Vec<bool> {
        [vec![true; 10], vec![false; length], vec![true; after]].concat()
    }

    #[test]
    fn hindsight_bridges_a_gap_that_the_filter_does_not_and_says_how_unsure_it_is() {
        let paths = paths(&with_gap(8, 10));
        assert_eq!(frames(&paths.smoothed), (0..28).collect::<Vec<_>>());
        assert_eq!(frames(&paths.filtered), (0..15).chain(18..28).collect::<Vec<_>>());
        let sigma = |frame: usize| paths.smoothed[frame].sigma_z_mm.unwrap();
        assert!(sigma(13) > 2.0 * sigma(5), "{} in the gap, {} before", sigma(13), sigma(5));
        assert_eq!((paths.quality.observed, paths.quality.predicted, paths.quality.missing), (20, 8, 0));
    }

    #[test]
    fn a_tool_that_does_not_come_back_is_predicted_for_a_short_time_only() {
        let paths = paths(&with_gap(30, 0));
        assert_eq!(frames(&paths.smoothed), (0..15).collect::<Vec<_>>());
        assert_eq!((paths.quality.observed, paths.quality.predicted, paths.quality.missing), (10, 5, 25));
    }

    #[test]
    fn a_tip_that_leaves_the_picture_is_not_predicted_beyond_its_rim() {
        let rim_mm = CAMERA.cx / CAMERA.fx * 150.0;
        let paths = paths_from(rim_mm - 41.0, 100.0, &with_gap(10, 0)); // 5.9 mm from the rim when seen last, 3.9 mm a frame
        assert_eq!(frames(&paths.smoothed), (0..11).collect::<Vec<_>>());
        assert_eq!(frames(&paths.filtered), (0..11).collect::<Vec<_>>());
        assert_eq!((paths.quality.observed, paths.quality.predicted, paths.quality.missing), (10, 1, 9));
    }

    #[test]
    fn a_long_gap_stays_one() {
        let paths = paths(&with_gap(30, 5));
        assert_eq!(frames(&paths.smoothed), (0..15).chain(40..45).collect::<Vec<_>>());
    }
}
