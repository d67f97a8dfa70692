//! Reasons why a tool was not seen or its measurement was rejected: a closed set, so that pages can explain each one.

/// Why a tool has no observation on a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum MissReason {
    /// No region of the marker's colour.
    NoMarkerColour,
    /// Regions of the colour were found, but all are too small to measure.
    TooSmall,
    /// A region was found, but its shape is not a band.
    WrongShape,
    /// Too little of a border was visible to fit a line.
    BordersNotFound,
    /// The borders do not enclose a tube of the known diameter.
    ImpossiblePose,
    /// The band's distal end is outside the frame or hidden.
    TipHidden,
    /// The measured position lies outside the box.
    OutOfBounds,
    /// The measured position contradicts the tool's motion (Mahalanobis gate).
    GateRejected,
    /// A band was measured, but it could be either of two tools of one colour.
    EitherTool,
}

impl MissReason {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            MissReason::NoMarkerColour => "no_marker_colour",
            MissReason::TooSmall => "too_small",
            MissReason::WrongShape => "wrong_shape",
            MissReason::BordersNotFound => "borders_not_found",
            MissReason::ImpossiblePose => "impossible_pose",
            MissReason::TipHidden => "tip_hidden",
            MissReason::OutOfBounds => "out_of_bounds",
            MissReason::GateRejected => "gate_rejected",
            MissReason::EitherTool => "either_tool",
        }
    }
}
