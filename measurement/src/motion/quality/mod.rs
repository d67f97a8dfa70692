//! Judges whether a session's measurements can be trusted: figures that describe how it was seen, and a gate that
//! returns *valid*, *usable with care* or *refused*, with reasons.
//!
//! **In:** [`QualityInput`]: the paths and what is known of their origin. Unknown figures are not judged, so that the
//! path of any other tracker can be judged too. **Out:** [`Figures`], with units, and the [`QualityVerdict`] on them.
//! **Method:** counts and percentiles, except for the noise floor ([`noise_floor`]). All limits and their grounds are
//! in [`limits`]. A wrong number that looks right is worse than none: the features of a refused session are withheld
//! ([`crate::motion::assessment::Assessment::withheld`]).
//!
//! | file | what |
//! |---|---|
//! | [`noise_floor`] | speed at which a resting tool would appear to move |
//! | [`tool`] | how one tool was seen |
//! | [`jumps`] | rows that no hand can have moved a tool to |
//! | [`ports`] | whether camera or trocars have moved since earlier sessions |
//! | [`moved_during`] | whether the camera moved during the recording |
//! | [`running`] | the same figures of a tool while the recording arrives |
//! | [`mod@box_match`] | whether the recording shows the box that it is filed under |
//! | [`session`] | the recording itself: frame times, light, beginning and end |
//! | [`cause`] | what can be wrong: a closed set, each with a sentence and advice |
//! | [`limits`] | the limit of each figure, and its ground |
//! | [`gate`] | the verdict |

pub mod box_match;
pub mod cause;
pub mod gate;
pub mod jumps;
pub mod limits;
pub mod moved_during;
pub mod noise_floor;
pub mod ports;
pub mod running;
pub mod session;
pub mod tool;

pub use box_match::{BoxAnswer, BoxEvidence, BoxFinding, BoxMatch};
pub use cause::QualityCause;
pub use gate::{Concern, QualityVerdict, Severity, judge};
pub use jumps::{JumpRows, PathJump};
pub use moved_during::{MovedDuring, MovementWatch};
pub use noise_floor::{NoiseFloor, NoiseFloorBasis};
pub use ports::{Displacement, PortAgreement, PortPlacement, Ports};
pub use session::SessionFigures;
pub use tool::{LostStretch, ToolFigures};

use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::tracker::{MotionSettings, Quality, Tracking};
use crate::vision::trajectory::{PathSource, SampleState, Trajectory};

/// Everything that is known of a session when it is judged.
#[derive(Clone, Copy, Debug)]
pub struct QualityInput<'a> {
    /// The path that is scored.
    pub smoothed: &'a Trajectory,
    /// The causal path, and each frame's own measurement.
    pub others: Option<&'a dyn PathSource>,
    /// The tracker's quality record.
    pub tracker: Option<&'a Quality>,
    /// The filter's motion model.
    pub motion: MotionSettings,
    /// RMS reprojection error of the camera's calibration, pixels.
    pub calibration_rms_px: Option<f64>,
    /// Number of frames that the file states and players show, if it states one.
    pub frames_expected: Option<u64>,
    /// Number of frames that were recorded interlaced.
    pub frames_interlaced: Option<u64>,
    /// Positions of the trocars in earlier sessions of the box with this calibration.
    pub ports: Option<&'a Ports>,
    /// What is known of the box besides its trocars; `None` for a recording that belongs to no box.
    pub of_box: Option<BoxEvidence>,
}

impl<'a> QualityInput<'a> {
    /// For a recording that was tracked here, with its smoothed path.
    pub fn of_tracking(tracking: &'a Tracking, smoothed: &'a Trajectory, motion: MotionSettings) -> Self {
        Self {
            smoothed,
            others: Some(tracking),
            tracker: Some(&tracking.quality),
            motion,
            calibration_rms_px: None,
            frames_expected: None,
            frames_interlaced: None,
            ports: None,
            of_box: None,
        }
    }

    /// For a path without any other record.
    pub fn of_path(path: &'a Trajectory) -> Self {
        Self {
            smoothed: path,
            others: None,
            tracker: None,
            motion: MotionSettings::default(),
            calibration_rms_px: None,
            frames_expected: None,
            frames_interlaced: None,
            ports: None,
            of_box: None,
        }
    }
}

/// The figures that describe how a session was seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Figures {
    /// The recording itself.
    pub session: SessionFigures,
    /// One entry per tool, in the trajectory's order.
    pub tools: Vec<ToolFigures>,
}

/// Computes every figure that the input supports.
pub fn measure(evidence: &QualityInput<'_>) -> Figures {
    let measured_range = MeasuredRange::of(evidence.smoothed);
    let placement = placement(evidence).unwrap_or_default();
    let tool = |index| tool::measure(evidence, index, measured_range, &placement);
    Figures {
        session: session::measure(evidence, &placement, box_match(evidence)),
        tools: (0..evidence.smoothed.tools.len()).map(tool).collect(),
    }
}

fn placement(evidence: &QualityInput<'_>) -> Option<PortPlacement> {
    Some(evidence.ports?.compare(&fulcrums(evidence)?))
}

fn box_match(evidence: &QualityInput<'_>) -> Option<BoxMatch> {
    let agreement = || Some(evidence.ports?.agreement(&fulcrums(evidence)?));
    Some(BoxMatch::of(evidence.of_box?, agreement().unwrap_or_default()))
}

/// The trocar of each tool, where it is known.
fn fulcrums(evidence: &QualityInput<'_>) -> Option<Vec<Option<Fulcrum>>> {
    Some(evidence.tracker?.tools.iter().map(|tool| tool.fulcrum).collect())
}

/// The frames between the first and the last one with a measurement of any tool: the session without its lead-in and
/// end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MeasuredRange {
    first: u64,
    last: u64,
    first_s: f64,
    last_s: f64,
}

impl MeasuredRange {
    fn of(path: &Trajectory) -> Option<Self> {
        let mut seen = path.samples.iter().filter(|sample| sample.state == SampleState::Observed);
        let first = seen.next()?;
        let last = seen.next_back().unwrap_or(first);
        Some(Self { first: first.frame, last: last.frame, first_s: first.time_s, last_s: last.time_s })
    }

    fn frames(self) -> u64 {
        self.last - self.first + 1
    }
}

#[cfg(test)]
mod tests;
