//! Wire and stored form of path rows and of what the tracker saw.

use nalgebra::{Point2, Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::vision::reason::MissReason;
use crate::vision::tracker::ToolReport;
use crate::vision::trajectory::{Sample, SampleState};

/// Wire form of [`Sample`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathRow {
    /// Decoded frames before this one.
    pub frame: u64,
    /// Presentation time, s.
    pub time_s: f64,
    /// Index of the tool.
    pub tool: u32,
    /// Tip, mm.
    pub tip_mm: [f64; 3],
    /// Velocity, mm/s.
    pub velocity_mm_s: Option<[f64; 3]>,
    /// Unit vector towards the tip.
    pub axis: Option<[f64; 3]>,
    /// Tip, pixels.
    pub tip_px: Option<[f64; 2]>,
    /// Standard deviation across the line of sight, mm.
    pub sigma_xy_mm: Option<f64>,
    /// Standard deviation of depth, mm.
    pub sigma_z_mm: Option<f64>,
    /// Measured (true) or bridged (false).
    pub observed: bool,
}

impl PathRow {
    /// Every number of the row.
    pub fn numbers(&self) -> impl Iterator<Item = f64> + use<> {
        let optional = [self.velocity_mm_s, self.axis].into_iter().flatten().flatten();
        let sigma = [self.sigma_xy_mm, self.sigma_z_mm].into_iter().flatten();
        let px = self.tip_px.into_iter().flatten();
        self.tip_mm.into_iter().chain([self.time_s]).chain(optional).chain(px).chain(sigma)
    }
}

impl From<&Sample> for PathRow {
    fn from(s: &Sample) -> Self {
        Self {
            frame: s.frame,
            time_s: s.time_s,
            tool: s.tool as u32,
            tip_mm: s.tip_mm.into(),
            velocity_mm_s: s.velocity_mm_s.map(Into::into),
            axis: s.axis.map(Into::into),
            tip_px: s.tip_px.map(Into::into),
            sigma_xy_mm: s.sigma_xy_mm,
            sigma_z_mm: s.sigma_z_mm,
            observed: s.state == SampleState::Observed,
        }
    }
}

impl From<PathRow> for Sample {
    fn from(row: PathRow) -> Self {
        Self {
            frame: row.frame,
            time_s: row.time_s,
            tool: row.tool as usize,
            tip_mm: Point3::from(row.tip_mm),
            velocity_mm_s: row.velocity_mm_s.map(Vector3::from),
            axis: row.axis.map(Vector3::from),
            tip_px: row.tip_px.map(Point2::from),
            sigma_xy_mm: row.sigma_xy_mm,
            sigma_z_mm: row.sigma_z_mm,
            state: if row.observed { SampleState::Observed } else { SampleState::Predicted },
        }
    }
}

/// What the tracker saw of one tool on one frame. Pixels are `f32`: in column 4096 the rounding is 1/2000 pixel, which
/// is fine enough to draw.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeenRow {
    /// Decoded frames before this one.
    pub frame: u64,
    /// Index of the tool.
    pub tool: u32,
    /// Why there is no measurement.
    pub reason: Option<ReasonShape>,
    /// Both borders of the band, each `u1 v1 u2 v2`.
    pub borders_px: Option<[[f32; 4]; 2]>,
    /// Tip, pixels.
    pub tip_px: Option<[f32; 2]>,
}

impl SeenRow {
    /// The row of one tool's report.
    pub fn new(frame: u64, report: &ToolReport) -> Self {
        let observed = report.outcome.as_ref().ok();
        let tip = observed.map(|o| o.tip_px.0).or_else(|| report.filtered.and_then(|s| s.tip_px));
        let border = |[a, b]: [crate::vision::space::Pixel; 2]| [a.u(), a.v(), b.u(), b.v()].map(|x| x as f32);
        Self {
            frame,
            tool: report.tool as u32,
            reason: report.outcome.as_ref().err().map(|&reason| reason.into()),
            borders_px: report.borders_px.map(|borders| borders.map(border)),
            tip_px: tip.map(|p| [p.x as f32, p.y as f32]),
        }
    }

    /// Every number of the row.
    pub fn numbers(&self) -> impl Iterator<Item = f32> + use<> {
        self.borders_px.into_iter().flatten().flatten().chain(self.tip_px.into_iter().flatten())
    }
}

macro_rules! reason_shape {
    ($($reason:ident),* $(,)?) => {
        /// [`MissReason`] on the wire.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
        pub enum ReasonShape {
            $(#[doc = concat!("[`MissReason::", stringify!($reason), "`]")] $reason,)*
        }

        impl ReasonShape {
            /// All of them.
            pub const ALL: &[ReasonShape] = &[$(ReasonShape::$reason),*];
        }

        impl From<MissReason> for ReasonShape {
            fn from(reason: MissReason) -> Self {
                match reason { $(MissReason::$reason => Self::$reason,)* }
            }
        }

        impl From<ReasonShape> for MissReason {
            fn from(shape: ReasonShape) -> Self {
                match shape { $(ReasonShape::$reason => Self::$reason,)* }
            }
        }
    };
}

// Stored by position: append only. `ImpossiblePose` stays readable for results of earlier versions.
reason_shape!(
    NoMarkerColour,
    TooSmall,
    WrongShape,
    BordersNotFound,
    ImpossiblePose,
    TipHidden,
    OutOfBounds,
    GateRejected,
    EitherTool,
    OutsideLensModel,
    LengthUnknown,
    PoorFit,
    NotTape,
    WrongWayRound,
    OffFulcrum,
    OtherToolsBand,
    Misread,
);
