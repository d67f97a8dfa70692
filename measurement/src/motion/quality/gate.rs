//! The quality gate: compares every figure with its limits. The worst result is the session's verdict.

use super::limits::QualityLimits;
use super::{BoxAnswer, Figures, JumpRows, LostStretch, PathJump, QualityCause, ToolFigures};
use crate::vision::segmentation::palette::Margin;
use crate::vision::tracker::TrocarEvidence;

/// A change of brightness, as a share, that may be why tools were lost: colours are known down to 0.6 times their light.
const MIN_BLINDING_CHANGE: f64 = 0.4;

/// The quality verdict on a session: whether its measurements can be trusted.
#[derive(Clone, Debug, PartialEq)]
pub enum QualityVerdict {
    /// They can be trusted.
    Valid,
    /// They can be trusted if the reader knows these concerns.
    UsableWithCare(Vec<Concern>),
    /// They cannot be trusted, and features are withheld. What may explain the other concerns comes first, then the
    /// refusing ones.
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
    pub cause: QualityCause,
    /// The tool concerned; `None` for the session as a whole.
    pub tool: Option<String>,
    /// True if the tool was followed by its bare shaft.
    pub is_bare: bool,
    /// The marked colour label concerned, if the cause is about a colour.
    pub label: Option<String>,
    /// The longest stretch that the cause is about, if it is about lost tracking.
    pub longest: Option<LostStretch>,
    /// The rows that the cause is about, if it is about a jump of the path.
    pub rows: Option<JumpRows>,
    /// When the cause occurred, s, if it is about a moment.
    pub at_s: Option<f64>,
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
        let longest = self.longest.map(|longest| longest.to_string()).unwrap_or_default();
        let rows = self.rows.map(|rows| rows.to_string()).unwrap_or_default();
        let at = self.at_s.map(|at_s| format!("; at {at_s:.0} s")).unwrap_or_default();
        prefix + &self.cause.finding(self.figure, self.limit) + &nearest + &longest + &rows + &at
    }

    /// What to do about it.
    pub fn advice(&self) -> &'static str {
        self.cause.advice(self.is_bare)
    }
}

impl QualityVerdict {
    /// Stable name for files, API and pages.
    pub fn name(&self) -> &'static str {
        match self {
            QualityVerdict::Valid => "valid",
            QualityVerdict::UsableWithCare(_) => "usable_with_care",
            QualityVerdict::Refused(_) => "refused",
        }
    }

    /// The verdict in words.
    pub fn title(&self) -> &'static str {
        match self {
            QualityVerdict::Valid => "valid",
            QualityVerdict::UsableWithCare(_) => "usable with care",
            QualityVerdict::Refused(_) => "refused",
        }
    }

    /// True if the session's features are withheld.
    pub fn is_refused(&self) -> bool {
        matches!(self, QualityVerdict::Refused(_))
    }

    /// The concerns: what may explain the others first, then the worst.
    pub fn concerns(&self) -> &[Concern] {
        match self {
            QualityVerdict::Valid => &[],
            QualityVerdict::UsableWithCare(concerns) | QualityVerdict::Refused(concerns) => concerns,
        }
    }
}

/// Compares every figure with its limits. An unknown figure breaks none.
pub fn judge(figures: &Figures) -> QualityVerdict {
    let of_tools = figures.tools.iter().flat_map(|tool| QualityCause::ALL.map(|cause| (cause, Some(tool))));
    let of_session = QualityCause::ALL.map(|cause| (cause, None));
    let concern = |(cause, tool): (QualityCause, Option<&ToolFigures>)| {
        let figure = tool.map_or_else(|| session_figure(figures, cause), |tool| tool_figure(tool, cause))?;
        if cause == QualityCause::PortMoved && is_box_open(figures) {
            return None;
        }
        let refuse = cause.limits().refuse.filter(|_| !is_only_care(tool, cause));
        let (severity, limit) = QualityLimits { refuse, ..cause.limits() }.breach(figure)?;
        let label = tool.and_then(|tool| colour_margin(tool, cause)).map(|margin| margin.nearest.clone());
        let longest = tool.filter(|_| cause == QualityCause::Lost).and_then(|tool| tool.longest_lost);
        let rows = tool.and_then(|tool| path_jump(tool, cause)).map(|jump| jump.rows);
        let at_s = moment_s(figures, cause);
        let is_bare = tool.is_some_and(|tool| tool.is_bare);
        let tool = tool.map(|tool| tool.tool.clone());
        Some(Concern { cause, tool, is_bare, label, longest, rows, at_s, figure, limit, severity })
    };
    let mut concerns: Vec<Concern> = of_session.into_iter().chain(of_tools).filter_map(concern).collect();
    let worst = concerns.iter().map(|concern| concern.severity).max();
    let rank = |concern: &Concern| if explains_others(concern) { worst } else { Some(concern.severity) };
    concerns.sort_by_key(|concern| (std::cmp::Reverse(rank(concern)), concern.cause));
    match worst {
        None => QualityVerdict::Valid,
        Some(Severity::Care) => QualityVerdict::UsableWithCare(concerns),
        Some(Severity::Refuse) => QualityVerdict::Refused(concerns),
    }
}

/// Does the cause never refuse this tool's session? A tool that shows its trocar is no other object of the tape's colour;
/// one that may have a trocar is not known to have none.
fn is_only_care(tool: Option<&ToolFigures>, cause: QualityCause) -> bool {
    let trocar = tool.and_then(|tool| tool.trocar);
    match cause {
        QualityCause::ColourBackground => trocar == Some(TrocarEvidence::Shown),
        QualityCause::NoTrocar => trocar == Some(TrocarEvidence::Possible),
        _ => false,
    }
}

fn session_figure(figures: &Figures, cause: QualityCause) -> Option<f64> {
    let session = &figures.session;
    match cause {
        QualityCause::NothingSeen => Some(session.observed as f64),
        QualityCause::Calibration => session.calibration_rms_px,
        QualityCause::CutFile => session.cut_share,
        QualityCause::Interlaced => session.interlaced_share,
        QualityCause::FrameRate => session.frame_rate_hz,
        QualityCause::DroppedFrames => session.dropped_share,
        QualityCause::Break => session.longest_interval_s,
        QualityCause::BeginsInMotion => session.first_speed_mm_s,
        QualityCause::EndsInMotion => session.last_speed_mm_s,
        QualityCause::Exposure => session.exposure_drift,
        QualityCause::WhiteBalance => session.white_drift_codes,
        QualityCause::CameraMovedDuring => session.moved_during.map(|moved| moved.mm),
        // Tape is found without pictures of the box, and displaced trocars say more.
        QualityCause::ViewShifted => session
            .box_match
            .filter(|_| session.camera_shift.is_none() && figures.tools.iter().any(|tool| tool.is_bare))
            .and_then(|of| of.view_shift()),
        // In doubt whether it is this box, nothing is said of its camera.
        QualityCause::CameraMoved => session.camera_shift.filter(|_| !is_box_open(figures)).map(|shift| shift.mm),
        QualityCause::OtherBox => (session.box_match?.answer == Some(BoxAnswer::OtherBox)).then_some(0.0),
        QualityCause::BoxSurroundings => session.box_match?.doubtful_correlation(),
        QualityCause::BoxTrocars => session.box_match?.doubtful_displacement_mm(),
        _ => None,
    }
}

/// Does the concern explain why tools were lost: did the camera move, or the light go off?
fn explains_others(concern: &Concern) -> bool {
    match concern.cause {
        QualityCause::CameraMovedDuring | QualityCause::ViewShifted => true,
        QualityCause::Exposure => concern.figure >= MIN_BLINDING_CHANGE,
        _ => false,
    }
}

/// When it happened, s, if the cause is about a moment.
fn moment_s(figures: &Figures, cause: QualityCause) -> Option<f64> {
    match cause {
        QualityCause::CameraMovedDuring => figures.session.moved_during.map(|moved| moved.at_s),
        QualityCause::Exposure => figures.session.light_step_s,
        _ => None,
    }
}

/// Does a person still have to say whether the recording shows this box?
fn is_box_open(figures: &Figures) -> bool {
    figures.session.box_match.is_some_and(|of| of.is_open())
}

/// A tool that was never in the picture has only that cause.
fn tool_figure(tool: &ToolFigures, cause: QualityCause) -> Option<f64> {
    if tool.never_in_picture {
        return (cause == QualityCause::NeverInPicture).then_some(0.0);
    }
    match cause {
        QualityCause::ColourBackground | QualityCause::ColourPair => {
            colour_margin(tool, cause).map(|margin| margin.margin_steps)
        }
        QualityCause::Coverage => tool.coverage,
        QualityCause::LeftView => tool.left_view_share,
        QualityCause::Lost => tool.lost_share,
        QualityCause::NoTrocar => tool.moved_without_trocar_mm,
        QualityCause::BareTool => tool.error_bar.filter(|_| tool.is_bare).map(|bar| bar.median_mm),
        QualityCause::BandTooLong => tool.size_mismatch.map(|mismatch| mismatch.sigmas()),
        QualityCause::BandTooShort => tool.size_mismatch.map(|mismatch| -mismatch.sigmas()),
        QualityCause::Predicted => tool.predicted_share,
        QualityCause::LongGap => tool.longest_gap_s,
        QualityCause::Rejected => tool.rejected_share,
        QualityCause::BorderResidual => tool.border_residual_px,
        QualityCause::Jump | QualityCause::Spike => path_jump(tool, cause).map(|jump| jump.figure),
        QualityCause::NoiseFloor => tool.noise_floor.map(|noise| noise.smoothed_mm_s),
        QualityCause::ErrorBar => tool.error_bar.map(|bar| bar.median_mm),
        QualityCause::PortMoved => tool.has_port_moved.then_some(tool.port_shift?.mm),
        _ => None,
    }
}

/// The jump that the cause is about; `None` for causes that are not about a jump.
fn path_jump(tool: &ToolFigures, cause: QualityCause) -> Option<PathJump> {
    match cause {
        QualityCause::Jump => tool.fastest_step,
        QualityCause::Spike => tool.sharpest_turn,
        _ => None,
    }
}

/// The colour margin that the cause is about; `None` for causes that are not about colour.
fn colour_margin(tool: &ToolFigures, cause: QualityCause) -> Option<&Margin> {
    match cause {
        QualityCause::ColourBackground => tool.colour.from_background.as_ref(),
        QualityCause::ColourPair => tool.colour.from_tools.as_ref(),
        _ => None,
    }
}
