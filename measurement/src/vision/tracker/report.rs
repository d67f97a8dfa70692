//! Results of a tracker: one report per frame while it runs, and the whole recording at its end.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::motion::ToolMotion;
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::pose::size_check::SizeMismatch;
use crate::vision::reason::MissReason;
use crate::vision::segmentation::palette::ColourSeparation;
use crate::vision::space::Pixel;
use crate::vision::surroundings::ViewShift;
use crate::vision::trajectory::{PathKind, PathSource, Sample, Trajectory};

/// One tool measured on one frame, before any filter over time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Tip in the camera frame, mm.
    pub tip_mm: Point3<f64>,
    /// Unit vector along the tube from the hand to the tip.
    pub axis: Vector3<f64>,
    /// Covariance of the tip, mm².
    pub covariance_mm2: Matrix3<f64>,
    /// Tip in the recorded frame, pixels.
    pub tip_px: Pixel,
    /// RMS distance of the border points from the fitted tube's outline, pixels.
    pub border_residual_px: f64,
}

/// Result of one frame for one tool.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolReport {
    /// Index into the settings' tools.
    pub tool: usize,
    /// The measurement, or why there is none.
    pub outcome: Result<Observation, MissReason>,
    /// The causal filter's estimate, where the tool is being tracked.
    pub filtered: Option<Sample>,
    /// Why the tool has no position, judged without later frames.
    pub absence: Option<Absence>,
    /// Both borders of the band, each from its distal to its proximal end, in the recorded frame.
    pub borders_px: Option<[[Pixel; 2]; 2]>,
    /// Where the midline meets the band's distal end: on the tube's surface, in the recorded frame.
    pub band_end_px: Option<Pixel>,
    /// True if all measurements of earlier frames were withdrawn: they were of something else, or lay the wrong way
    /// round.
    pub has_withdrawn: bool,
}

/// Result of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameReport {
    /// Decoded frames before this one.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// One report per tool, in the settings' order.
    pub tools: Vec<ToolReport>,
}

/// Why a tool has no position for a while. Results store it by position in this list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Absence {
    /// Its band was at the edge of the picture before or after, and was not in the picture in between.
    LeftView,
    /// It was lost inside the picture; the reason is the most frequent one of the gap.
    Lost(MissReason),
}

/// Consecutive frames without a position of a tool, neither measured nor bridged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gap {
    /// First frame without a position.
    pub first: u64,
    /// Last frame without one.
    pub last: u64,
    /// Why.
    pub absence: Absence,
}

/// The scene's light at one moment, relative to the first frame. Medians over the picture, so that moving tools do not
/// count.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightSample {
    /// Presentation time, s.
    pub time_s: f64,
    /// Gamma-coded luma divided by the first frame's.
    pub luma_ratio: f64,
    /// Blue and red differences minus the first frame's, as shares of the full code range.
    pub chroma_shift: [f64; 2],
}

/// Tracking quality of one tool over a recording. Results store its fields in this order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ToolQuality {
    /// The tool's name. Results store the names of all tools once, beside the paths.
    #[serde(skip)]
    pub tool: String,
    /// Frames on which it was measured.
    pub observed: u64,
    /// Frames bridged by prediction.
    pub predicted: u64,
    /// Frames without a position.
    pub missing: u64,
    /// How often each reason prevented a measurement or caused its rejection.
    pub reasons: BTreeMap<MissReason, u64>,
    /// RMS distance of border points from the fitted outline, pixels; `None` when never measured.
    pub border_residual_px: Option<f64>,
    /// Depth noise that can change from frame to frame: the median standard deviation of measured depth without its
    /// lasting part, mm; `None` when never measured.
    pub transient_depth_sigma_mm: Option<f64>,
    /// The apparent diameter of its tape; `None` when never measured.
    pub effective_diameter: Option<EffectiveDiameter>,
    /// Gaps in its path, in order.
    pub gaps: Vec<Gap>,
    /// How well its colour is separated from the other marked colours.
    pub colour: ColourSeparation,
    /// Where its tube passes through the box's wall; `None` if not known well.
    pub fulcrum: Option<Fulcrum>,
    /// Whether the picture contradicts its sizes; `None` if too few poses lean.
    pub size_mismatch: Option<SizeMismatch>,
}

impl ToolQuality {
    /// What its axes say of a trocar, even if its position is not known well.
    pub fn trocar(&self) -> TrocarEvidence {
        match self.effective_diameter.map(|diameter| diameter.basis) {
            Some(DiameterBasis::Session) => TrocarEvidence::Shown,
            Some(DiameterBasis::BareShaft) if self.fulcrum.is_some() => TrocarEvidence::Shown,
            Some(DiameterBasis::AssumedTrocar | DiameterBasis::BareShaft) => TrocarEvidence::Possible,
            Some(DiameterBasis::Usual | DiameterBasis::BareShaftWithoutTrocar) | None => TrocarEvidence::Missing,
        }
    }
}

/// What the axes of a tool's poses say of its trocar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrocarEvidence {
    /// They meet in no trocar behind the tips, or the poses are too few.
    Missing,
    /// They may meet in one behind the tips, but turn too little to exclude one ahead of them.
    Possible,
    /// They meet in one behind the tips.
    Shown,
}

/// Apparent diameter of a tape in a recording: its true diameter plus twice the outward shift of its borders by lens,
/// light and compression, at the median depth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EffectiveDiameter {
    /// Diameter, mm.
    pub mm: f64,
    /// Its standard deviation, mm.
    pub sigma_mm: f64,
    /// How it was determined.
    pub basis: DiameterBasis,
}

/// How an effective diameter was determined. Results store it by position in this list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DiameterBasis {
    /// The poses were too few or turned too little: the tube's true diameter, with the usual uncertainty of borders.
    Usual,
    /// From the session's poses together: they share a fulcrum and the band's length.
    Session,
    /// From the session's poses together, which turn too little to show their fulcrum: it is assumed at the usual
    /// distance.
    AssumedTrocar,
    /// Of a bare shaft, as entered: its polished limb mirrors what is beside it, which the poses do not show.
    BareShaft,
    /// The same, with poses that are too few, or whose axes meet in no trocar behind the tips.
    BareShaftWithoutTrocar,
}

impl DiameterBasis {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            DiameterBasis::Session => "session",
            DiameterBasis::Usual => "usual",
            DiameterBasis::AssumedTrocar => "assumed_trocar",
            DiameterBasis::BareShaft => "bare_shaft",
            DiameterBasis::BareShaftWithoutTrocar => "bare_shaft_without_trocar",
        }
    }

    /// True for a tool without tape.
    pub fn is_of_bare_shaft(self) -> bool {
        matches!(self, DiameterBasis::BareShaft | DiameterBasis::BareShaftWithoutTrocar)
    }
}

/// Tracking quality of a whole recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quality {
    /// Frames seen.
    pub frames: u64,
    /// One entry per tool.
    pub tools: Vec<ToolQuality>,
    /// The scene's light, about once a second; empty where the first frame is too dark to compare with.
    pub light: Vec<LightSample>,
    /// How the view is displaced, about once a second; empty where the picture does not show it, and for a live feed.
    pub view_shifts: Vec<ViewShift>,
}

/// A tracked recording. Its paths are computed on request: keeping all three would take three times the memory of the
/// data that they are computed from.
#[derive(Clone, Debug)]
pub struct Tracking {
    /// Tracking quality.
    pub quality: Quality,
    pub(super) motions: Vec<ToolMotion>,
    pub(super) frame_times_s: Vec<f64>,
}

impl Tracking {
    /// The path of every tool.
    pub fn trajectory(&self, kind: PathKind) -> Trajectory {
        let mut samples = Vec::with_capacity(self.motions.len() * self.frame_times_s.len());
        self.motions.iter().for_each(|motion| motion.append_path(&mut samples, kind));
        samples.sort_unstable_by_key(|s| (s.frame, s.tool));
        let tools = self.quality.tools.iter().map(|tool| tool.tool.clone()).collect();
        Trajectory { tools, samples, frame_times_s: self.frame_times_s.clone(), cuts: Vec::new() }
    }
}

impl PathSource for Tracking {
    fn path(&self, kind: PathKind, tool: usize) -> Vec<Sample> {
        self.motions.get(tool).map_or_else(Vec::new, |motion| motion.path(kind))
    }
}
