//! One tool's motion through a recording, as unbroken runs of the filter. Each path is computed from them on request.
//!
//! An hour of two tools' motion takes 33 MiB, as much as one path of samples.

use nalgebra::{Matrix3, Point2, Point3, Vector3};

use super::blocks::Blocks;
use crate::numbers::quantile::quantile;
use crate::vision::camera::Camera;
use crate::vision::covariance::PositionCovariance;
use crate::vision::filter::kalman::KalmanState;
use crate::vision::filter::smoother::{self, MeasuredPosition};
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::pose::{CHANGING_SHARE, TubeEstimate};
use crate::vision::space::CameraPoint;
use crate::vision::trajectory::{PathKind, Sample, SampleState};

/// A frame's index and time, s.
pub type FrameInstant = (u64, f64);

/// One tool's motion.
#[derive(Clone, Debug)]
pub struct ToolMotion {
    /// The tool's index.
    pub tool: usize,
    /// The unbroken runs of its filter, in time order.
    pub runs: Vec<TrackedRun>,
    /// The camera that saw it.
    pub camera: Camera,
    /// Where its tube passes through the box's wall, if known.
    pub fulcrum: Option<Fulcrum>,
    /// Longest gap that the filtered path bridges, s.
    pub max_prediction_s: f64,
    /// The same while the axis is measured, s.
    pub max_hidden_s: f64,
}

impl ToolMotion {
    /// Appends one of its paths, in time order.
    pub fn append_path(&self, path: &mut Vec<Sample>, kind: PathKind) {
        for run in &self.runs {
            match kind {
                PathKind::Raw => path.extend(self.raw(run)),
                PathKind::Filtered => path.extend(self.filtered(run)),
                PathKind::Smoothed => {
                    let before = path.len();
                    path.extend(self.smoothed_reversed(run));
                    path[before..].reverse();
                }
            }
        }
    }

    /// One of its paths, in time order.
    pub fn path(&self, kind: PathKind) -> Vec<Sample> {
        let mut path = Vec::with_capacity(self.runs.iter().map(|run| run.frames.len()).sum());
        self.append_path(&mut path, kind);
        path
    }

    /// The median standard deviation of the part of a measured depth's error that does not last, mm.
    pub fn transient_depth_sigma_mm(&self) -> Option<f64> {
        let measured = self.runs.iter().flat_map(|run| run.filter.measurements().zip(run.frames.iter()));
        let passing = measured.filter_map(|(position, frame)| {
            let (_, covariance) = position?;
            Some((covariance[(2, 2)] - CHANGING_SHARE * frame.pose()?.lasting.zz).max(0.0).sqrt())
        });
        quantile(passing.collect(), 0.5)
    }

    /// Median depth of the measured tips, mm.
    pub fn median_depth_mm(&self) -> Option<f64> {
        let all = self.runs.iter().flat_map(|run| run.filter.measurements().zip(run.frames.iter()));
        let measured = all.filter(|(_, frame)| frame.pose().is_some()).filter_map(|(position, _)| position);
        quantile(measured.map(|(tip, _)| tip.z).collect(), 0.5)
    }

    /// Each frame's own measurement.
    fn raw(&self, run: &TrackedRun) -> impl Iterator<Item = Sample> {
        let measured = run.filter.measurements().zip(run.frames.iter());
        measured.filter_map(|(position, frame)| Some(self.raw_sample(position?, frame.pose()?, frame.instant)))
    }

    /// The causal path. It ends within a gap that only the second pass bridges.
    fn filtered(&self, run: &TrackedRun) -> impl Iterator<Item = Sample> {
        let is_near = |place: usize| {
            let time_s = run.frames[place].instant.1;
            time_s - run.last_axis_s(place) <= self.max_prediction_s
                && time_s - run.last_measured(place).0 <= self.max_prediction_s.max(self.max_hidden_s)
        };
        let near = run.filter.filtered().enumerate().filter(move |(place, _)| is_near(*place));
        let sample = |(place, state)| self.sample(run, place, &state);
        near.map(sample).filter(|sample| is_supported(sample, &self.camera))
    }

    /// The smoothed path of a run, from the last frame to the first.
    fn smoothed_reversed(&self, run: &TrackedRun) -> impl Iterator<Item = Sample> {
        let length = run.smoothed_frames();
        let states = (0..run.frames.len()).rev().zip(run.filter.smoothed()).filter(move |(place, _)| *place < length);
        states.map(|(place, state)| self.sample(run, place, &state)).filter(|sample| is_supported(sample, &self.camera))
    }

    fn sample(&self, run: &TrackedRun, place: usize, state: &KalmanState) -> Sample {
        let frame = &run.frames[place];
        let seen = if frame.pose().is_some() { SampleState::Observed } else { SampleState::Predicted };
        let pose = run.last_measured(place).1;
        state_sample(state, pose, self.tool, frame.instant, seen, &self.camera, self.fulcrum.as_ref())
    }

    fn raw_sample(&self, (tip, covariance): MeasuredPosition, pose: &PastPose, instant: FrameInstant) -> Sample {
        let unchanging = pose.lasting.matrix() * (1.0 - CHANGING_SHARE);
        Sample {
            frame: instant.0,
            time_s: instant.1,
            tool: self.tool,
            tip_mm: tip,
            velocity_mm_s: None,
            axis: Some(pose.axis),
            tip_px: self.camera.project(CameraPoint(tip)).map(|p| p.0),
            covariance_mm2: Some(stated_covariance(&(covariance + unchanging), &self.camera, &tip)),
            state: SampleState::Observed,
        }
    }
}

/// An unbroken run of the filter.
#[derive(Clone, Debug, Default)]
pub struct TrackedRun {
    filter: smoother::FilterRun,
    frames: Blocks<RunFrame>,
}

#[derive(Clone, Debug)]
struct RunFrame {
    instant: FrameInstant,
    seen: Seen,
}

/// What was measured on a frame.
#[derive(Clone, Debug)]
enum Seen {
    Tip(PastPose),
    Axis,
    Nothing,
}

impl RunFrame {
    fn pose(&self) -> Option<&PastPose> {
        match &self.seen {
            Seen::Tip(pose) => Some(pose),
            Seen::Axis | Seen::Nothing => None,
        }
    }
}

/// What moved the filter's state on a frame.
pub enum StateUpdate<'a> {
    /// The measured pose.
    Tip(&'a TubeEstimate),
    /// The position that a measured axis gave: known across the axis only.
    Axis(MeasuredPosition),
    /// Nothing: the state is predicted.
    None,
}

impl TrackedRun {
    /// Adds the next frame: the filter's state, the acceleration density that it used since the previous frame,
    /// mm²/s³, and what the state was updated with.
    pub fn add(&mut self, state: &KalmanState, noise_density: f64, instant: FrameInstant, update: StateUpdate<'_>) {
        let (measured, seen) = match update {
            StateUpdate::Tip(pose) => {
                (Some((pose.tube.tip, pose.changing_tip_covariance())), Seen::Tip(PastPose::from(pose)))
            }
            StateUpdate::Axis(position) => (Some(position), Seen::Axis),
            StateUpdate::None => (None, Seen::Nothing),
        };
        self.filter.push(instant.1, state, noise_density, measured);
        self.frames.push(RunFrame { instant, seen });
    }

    /// Number of frames, and number of frames with a measurement.
    pub fn frame_counts(&self) -> (u64, u64) {
        (self.frames.len() as u64, self.frames.iter().filter(|frame| frame.pose().is_some()).count() as u64)
    }

    /// Time and pose of the last measurement up to and including a frame, s.
    fn last_measured(&self, place: usize) -> (f64, Option<&PastPose>) {
        let seen = (0..=place).rev().map(|place| &self.frames[place]).find(|frame| frame.pose().is_some());
        seen.map_or((f64::NEG_INFINITY, None), |frame| (frame.instant.1, frame.pose()))
    }

    /// When the axis was measured last up to and including a frame, with the tip or without it, s.
    fn last_axis_s(&self, place: usize) -> f64 {
        let mut before = (0..=place).rev().map(|place| &self.frames[place]);
        before.find(|frame| !matches!(frame.seen, Seen::Nothing)).map_or(f64::NEG_INFINITY, |frame| frame.instant.1)
    }

    /// Number of frames in the smoothed path: up to the last measured one. By then it is known that the tool did not
    /// return, and every later position would be a guess.
    fn smoothed_frames(&self) -> usize {
        (0..self.frames.len()).rev().find(|place| self.frames[*place].pose().is_some()).map_or(0, |last| last + 1)
    }
}

/// Was the tip measured, or predicted inside the picture? Outside the picture nothing supports a prediction.
fn is_supported(sample: &Sample, camera: &Camera) -> bool {
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let in_picture = |at: Point2<f64>| (0.0..width).contains(&at.x) && (0.0..height).contains(&at.y);
    sample.state == SampleState::Observed || sample.tip_px.is_some_and(in_picture)
}

/// Covariance of a tip by the error of the focal lengths, mm²: the same error in all positions of a session.
fn by_camera(camera: &Camera, tip: &Point3<f64>) -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, camera.depth_variance_mm2(tip.z)))
}

/// Least standard deviation that is stated in any direction, pixels. Across the tube, where a position is known best,
/// what shifts both borders alike (uneven light, the background, a second layer of tape) cannot be distinguished from
/// motion. On 105 tools of 71 ray-traced recordings the errors in this direction were 0.22 to 0.36 px (root mean square)
/// in each of nine groups, and hardly depended on what the adjustment stated: less than 0.3, 0.3 to 0.4, or 0.4 to
/// 0.5 px. Errors over 5 px were left out. All these recordings were looked at when the value was chosen.
const LEAST_SIGMA_PX: f64 = 0.3;

/// The covariance to state for a position, mm², from that of its pose: with the camera's part, and nowhere below
/// [`LEAST_SIGMA_PX`].
pub fn stated_covariance(of_pose: &Matrix3<f64>, camera: &Camera, tip: &Point3<f64>) -> PositionCovariance {
    let px_per_mm = 0.5 * (camera.fx + camera.fy) / tip.coords.norm();
    let least_mm2 = (LEAST_SIGMA_PX / px_per_mm).powi(2);
    let covariance = of_pose + by_camera(camera, tip);
    let mut axes = covariance.symmetric_eigen();
    if axes.eigenvalues.min() >= least_mm2 {
        return covariance.into(); // to the last digit
    }
    axes.eigenvalues.apply(|variance| *variance = variance.max(least_mm2));
    axes.recompose().into()
}

/// The part of the last measured pose that a sample of the filter's state needs.
#[derive(Clone, Copy, Debug)]
pub struct PastPose {
    axis: Vector3<f64>,
    /// The lasting part of the tip's covariance.
    lasting: PositionCovariance,
}

impl From<&TubeEstimate> for PastPose {
    fn from(pose: &TubeEstimate) -> Self {
        Self { axis: pose.tube.axis, lasting: pose.lasting_tip_covariance().into() }
    }
}

/// A sample of a filter's state. The filter averages a part of the lasting errors away, too. The whole lasting part is
/// added again, as estimated for `pose`, the nearest measured one (Schmidt's "considered" errors), and so is the
/// camera's part.
pub fn state_sample(
    state: &KalmanState,
    pose: Option<&PastPose>,
    tool: usize,
    instant: FrameInstant,
    seen: SampleState,
    camera: &Camera,
    fulcrum: Option<&Fulcrum>,
) -> Sample {
    let tip = state.tip();
    let lasting = pose.map_or_else(Matrix3::zeros, |p| p.lasting.matrix());
    let covariance = stated_covariance(&(state.tip_covariance() + lasting), camera, &tip);
    let by_fulcrum = fulcrum.and_then(|f| (tip - f.at).try_normalize(1e-9));
    Sample {
        frame: instant.0,
        time_s: instant.1,
        tool,
        tip_mm: tip,
        velocity_mm_s: Some(state.velocity()),
        axis: by_fulcrum.or(pose.map(|p| p.axis)),
        tip_px: camera.project(CameraPoint(tip)).map(|p| p.0),
        covariance_mm2: Some(covariance),
        state: seen,
    }
}
