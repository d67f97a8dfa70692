//! The quality gate: compares every figure with its limits. The worst result is the session's verdict.

use super::{Cause, Figures, ToolFigures};
use crate::pipeline::segmentation::palette::Margin;

/// The quality verdict on a session: whether its measurements can be trusted.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// They can be trusted.
    Valid,
    /// They can be trusted if the reader knows these concerns.
    UsableWithCare(Vec<Concern>),
    /// They cannot be trusted, and features are withheld. Refusing concerns come first.
    Refused(Vec<Concern>),
}

/// The effect of a concern on a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// The session is to be used with care.
    Care,
    /// The session is refused.
    Refuse,
}

impl Severity {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            Severity::Care => "care",
            Severity::Refuse => "refuse",
        }
    }
}

/// A figure beyond its limit.
#[derive(Clone, Debug, PartialEq)]
pub struct Concern {
    /// What is wrong.
    pub cause: Cause,
    /// The tool concerned; `None` for the session as a whole.
    pub tool: Option<String>,
    /// The marked colour label concerned, if the cause is about a colour.
    pub label: Option<String>,
    /// The figure, in the cause's unit.
    pub figure: f64,
    /// The limit that it broke.
    pub limit: f64,
    /// The effect on the session.
    pub severity: Severity,
}

impl Concern {
    /// What was found, in one sentence.
    pub fn finding(&self) -> String {
        let prefix = self.tool.as_ref().map(|tool| format!("{tool}: ")).unwrap_or_default();
        let nearest = self.label.as_ref().map(|label| format!(" (nearest: `{label}`)")).unwrap_or_default();
        prefix + &self.cause.finding(self.figure, self.limit) + &nearest
    }

    /// What to do about it.
    pub fn advice(&self) -> &'static str {
        self.cause.advice()
    }
}

impl Verdict {
    /// Stable name for files, API and pages.
    pub fn name(&self) -> &'static str {
        match self {
            Verdict::Valid => "valid",
            Verdict::UsableWithCare(_) => "usable_with_care",
            Verdict::Refused(_) => "refused",
        }
    }

    /// The verdict in words.
    pub fn title(&self) -> &'static str {
        match self {
            Verdict::Valid => "valid",
            Verdict::UsableWithCare(_) => "usable with care",
            Verdict::Refused(_) => "refused",
        }
    }

    /// True if the session's features are withheld.
    pub fn is_refused(&self) -> bool {
        matches!(self, Verdict::Refused(_))
    }

    /// The concerns, the worst first.
    pub fn concerns(&self) -> &[Concern] {
        match self {
            Verdict::Valid => &[],
            Verdict::UsableWithCare(concerns) | Verdict::Refused(concerns) => concerns,
        }
    }
}

/// Compares every figure with its limits. An unknown figure breaks none.
pub fn judge(figures: &Figures) -> Verdict {
    let of_tools = figures.tools.iter().flat_map(|tool| Cause::ALL.map(|cause| (cause, Some(tool))));
    let of_session = Cause::ALL.map(|cause| (cause, None));
    let concern = |(cause, tool): (Cause, Option<&ToolFigures>)| {
        let figure = tool.map_or_else(|| of_the_session(figures, cause), |tool| of_a_tool(tool, cause))?;
        let (severity, limit) = cause.limits().breach(figure)?;
        let label = tool.and_then(|tool| nearest(tool, cause)).map(|margin| margin.nearest.clone());
        Some(Concern { cause, tool: tool.map(|tool| tool.tool.clone()), label, figure, limit, severity })
    };
    let mut concerns: Vec<Concern> = of_session.into_iter().chain(of_tools).filter_map(concern).collect();
    concerns.sort_by_key(|concern| (std::cmp::Reverse(concern.severity), concern.cause));
    match concerns.first().map(|worst| worst.severity) {
        None => Verdict::Valid,
        Some(Severity::Care) => Verdict::UsableWithCare(concerns),
        Some(Severity::Refuse) => Verdict::Refused(concerns),
    }
}

fn of_the_session(figures: &Figures, cause: Cause) -> Option<f64> {
    let session = &figures.session;
    match cause {
        Cause::NothingSeen => Some(session.observed as f64),
        Cause::Calibration => session.calibration_rms_px,
        Cause::CutFile => session.cut_share,
        Cause::Interlaced => session.interlaced_share,
        Cause::FrameRate => session.frame_rate_hz,
        Cause::DroppedFrames => session.dropped_share,
        Cause::Break => session.longest_interval_s,
        Cause::BeginsInMotion => session.first_speed_mm_s,
        Cause::EndsInMotion => session.last_speed_mm_s,
        Cause::Exposure => session.exposure_drift,
        Cause::WhiteBalance => session.white_drift_codes,
        Cause::CameraMoved => session.camera_shift.map(|shift| shift.mm),
        _ => None,
    }
}

/// A tool that was never in the picture has only that cause.
fn of_a_tool(tool: &ToolFigures, cause: Cause) -> Option<f64> {
    if tool.never_in_picture {
        return (cause == Cause::NeverInPicture).then_some(0.0);
    }
    match cause {
        Cause::ColourBackground | Cause::ColourPair => nearest(tool, cause).map(|margin| margin.margin_steps),
        Cause::Coverage => tool.coverage,
        Cause::LeftView => tool.left_view_share,
        Cause::Lost => tool.lost_share,
        Cause::Predicted => tool.predicted_share,
        Cause::LongGap => tool.longest_gap_s,
        Cause::Rejected => tool.rejected_share,
        Cause::BorderResidual => tool.border_residual_px,
        Cause::NoiseFloor => tool.noise_floor.map(|noise| noise.smoothed_mm_s),
        Cause::ErrorBar => tool.error_bar.map(|bar| bar.median_mm),
        Cause::PortMoved => tool.has_port_moved.then_some(tool.port_shift?.mm),
        _ => None,
    }
}

/// The colour margin that the cause is about; `None` for causes that are not about colour.
fn nearest(tool: &ToolFigures, cause: Cause) -> Option<&Margin> {
    match cause {
        Cause::ColourBackground => tool.colour.from_background.as_ref(),
        Cause::ColourPair => tool.colour.from_tools.as_ref(),
        _ => None,
    }
}
