//! Position of each tool at each frame: the product of the tracker and the input of the features.

use nalgebra::{Point2, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::covariance::PositionCovariance;

/// The kind of estimate in a trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum PathKind {
    /// Each frame's own measurement, unfiltered.
    Raw,
    /// Kalman filter, forwards in time, over poses steadied with the fulcrum and shared errors of the whole recording.
    /// A live feed lacks that knowledge and is slightly noisier.
    Filtered,
    /// Rauch–Tung–Striebel smoother over the whole recording: the default for scores.
    Smoothed,
}

/// Was the tool measured on this frame? Results store it by position in this list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum SampleState {
    /// Bridged by the motion model over a short gap.
    Predicted,
    /// Measured on this frame.
    Observed,
}

/// One tool at one frame. Results store its fields in this order.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Decoded frames before this one.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// Index into [`Trajectory::tools`].
    pub tool: usize,
    /// Tip in the camera frame, mm.
    pub tip_mm: Point3<f64>,
    /// Velocity of the tip, mm/s; `None` where the method gives none (raw).
    pub velocity_mm_s: Option<Vector3<f64>>,
    /// Unit vector along the tube from the hand to the tip.
    pub axis: Option<Vector3<f64>>,
    /// Tip in the recorded frame, pixels.
    pub tip_px: Option<Point2<f64>>,
    /// Covariance of the tip's error; `None` if the error is unknown.
    pub covariance_mm2: Option<PositionCovariance>,
    /// Measured or bridged.
    pub state: SampleState,
}

impl Sample {
    /// True if it was measured, false if it was bridged.
    pub fn is_observed(&self) -> bool {
        self.state == SampleState::Observed
    }

    /// Standard deviation across the line of sight (RMS of x and y), mm.
    pub fn sigma_xy_mm(&self) -> Option<f64> {
        self.covariance_mm2.map(|of| of.sigma_xy_mm())
    }

    /// Standard deviation of depth, mm.
    pub fn sigma_z_mm(&self) -> Option<f64> {
        self.covariance_mm2.map(|of| of.sigma_z_mm())
    }

    /// Every number but the frame and the tool; of the covariance, the two standard deviations, which limit it.
    pub fn numbers(&self) -> impl Iterator<Item = f64> + use<> {
        let vectors = [self.velocity_mm_s, self.axis].into_iter().flatten().flat_map(<[f64; 3]>::from);
        let pixels = self.tip_px.into_iter().flat_map(<[f64; 2]>::from);
        let sigmas = [self.sigma_xy_mm(), self.sigma_z_mm()].into_iter().flatten();
        <[f64; 3]>::from(self.tip_mm).into_iter().chain([self.time_s]).chain(vectors).chain(pixels).chain(sigmas)
    }
}

/// The path of every tool of a session, ordered by frame, then tool. A frame without a sample of a tool means that the
/// tool was not tracked there.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// Names of the tools; [`Sample::tool`] is an index into this list.
    pub tools: Vec<String>,
    /// The samples.
    pub samples: Vec<Sample>,
    /// Presentation time of every decoded frame, s; empty if unknown (when read from a file of samples).
    pub frame_times_s: Vec<f64>,
    /// Where an edit by a person says that the path continues as another tool's.
    pub cuts: Vec<Cut>,
}

/// Separates two samples under one name that belong to different tools. Nothing may be interpolated across it: no tool
/// moved from one sample to the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Index into [`Trajectory::tools`].
    pub tool: usize,
    /// Time of the first sample after the cut, s.
    pub time_s: f64,
}

impl Trajectory {
    /// The samples of one tool, in time order.
    pub fn of_tool(&self, tool: usize) -> impl Iterator<Item = &Sample> {
        self.samples.iter().filter(move |s| s.tool == tool)
    }

    /// Times of one tool's cuts, s.
    pub fn cuts_of(&self, tool: usize) -> Vec<f64> {
        self.cuts.iter().filter(|cut| cut.tool == tool).map(|cut| cut.time_s).collect()
    }
}

/// Is there a cut after the first of two times and not after the second, s?
pub fn has_cut_between(cuts_s: &[f64], [before_s, time_s]: [f64; 2]) -> bool {
    cuts_s.iter().any(|cut_s| before_s < *cut_s && *cut_s <= time_s)
}

/// Source of one tool's path at a time, for users that need only one in memory: an hour of samples takes 17 MiB.
pub trait PathSource: std::fmt::Debug {
    /// One path of one tool, in time order.
    fn path(&self, kind: PathKind, tool: usize) -> Vec<Sample>;
}
