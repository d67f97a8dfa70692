//! Reasons why a tool was not seen or its measurement was rejected: a closed set, so that pages can explain each one
//! (`session.reasons` in `static/texts/`).

use serde::{Deserialize, Serialize};

/// Why a tool has no observation on a frame, in the order of priority: of several reasons, the greatest is reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(into = "u8", try_from = "u8")]
pub enum MissReason {
    /// No region of the marker's colour.
    NoMarkerColour,
    /// Regions of the colour were found, but all are too small to measure.
    TooSmall,
    /// A region was found, but its shape is not a band.
    WrongShape,
    /// Too little of a border was visible to fit a line.
    BordersNotFound,
    /// A pose was rejected, for a cause that was not recorded: only in results of earlier versions. Now one of the
    /// reasons down to [`MissReason::Misread`].
    ImpossiblePose,
    /// The band lies where the lens model has no viewing direction, or its tip would.
    OutsideLensModel,
    /// The band's length is neither entered nor learned, and cannot be seen on this frame.
    LengthUnknown,
    /// No tube of the known diameter fits the edges well enough.
    PoorFit,
    /// A tube fits the edges, but the tape's colour is missing on it, or continues beyond its end.
    NotTape,
    /// The tool was tracked with tip and hand exchanged.
    WrongWayRound,
    /// The tube does not point at the tool's fulcrum.
    OffFulcrum,
    /// The only band in sight is already the other tool's.
    OtherToolsBand,
    /// The rest of the recording does not confirm the measurement.
    Misread,
    /// The band's distal end is outside the frame or hidden.
    TipHidden,
    /// The depth of the measured position is outside the limits `nearest_mm` and `farthest_mm`.
    OutOfBounds,
    /// The measured position contradicts the tool's motion (Mahalanobis gate).
    GateRejected,
    /// A band was measured, but it could be either of two tools of one colour.
    EitherTool,
}

impl MissReason {
    /// All reasons. Results store the position in this list: append only.
    pub const ALL: [MissReason; 17] = [
        MissReason::NoMarkerColour,
        MissReason::TooSmall,
        MissReason::WrongShape,
        MissReason::BordersNotFound,
        MissReason::ImpossiblePose,
        MissReason::TipHidden,
        MissReason::OutOfBounds,
        MissReason::GateRejected,
        MissReason::EitherTool,
        MissReason::OutsideLensModel,
        MissReason::LengthUnknown,
        MissReason::PoorFit,
        MissReason::NotTape,
        MissReason::WrongWayRound,
        MissReason::OffFulcrum,
        MissReason::OtherToolsBand,
        MissReason::Misread,
    ];

    /// The reason without its cause: [`MissReason::ImpossiblePose`] for each cause to reject a pose.
    pub fn general(self) -> Self {
        if (MissReason::ImpossiblePose..=MissReason::Misread).contains(&self) {
            MissReason::ImpossiblePose
        } else {
            self
        }
    }

    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            MissReason::NoMarkerColour => "no_marker_colour",
            MissReason::TooSmall => "too_small",
            MissReason::WrongShape => "wrong_shape",
            MissReason::BordersNotFound => "borders_not_found",
            MissReason::ImpossiblePose => "impossible_pose",
            MissReason::OutsideLensModel => "outside_lens_model",
            MissReason::LengthUnknown => "length_unknown",
            MissReason::PoorFit => "poor_fit",
            MissReason::NotTape => "not_tape",
            MissReason::WrongWayRound => "wrong_way_round",
            MissReason::OffFulcrum => "off_fulcrum",
            MissReason::OtherToolsBand => "other_tools_band",
            MissReason::Misread => "misread",
            MissReason::TipHidden => "tip_hidden",
            MissReason::OutOfBounds => "out_of_bounds",
            MissReason::GateRejected => "gate_rejected",
            MissReason::EitherTool => "either_tool",
        }
    }
}

impl From<MissReason> for u8 {
    fn from(reason: MissReason) -> u8 {
        MissReason::ALL.iter().take_while(|listed| **listed != reason).count() as u8
    }
}

/// No reason has this number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no reason has the number {0}")]
pub struct UnknownReason(u8);

impl TryFrom<u8> for MissReason {
    type Error = UnknownReason;

    fn try_from(number: u8) -> Result<Self, UnknownReason> {
        MissReason::ALL.get(usize::from(number)).copied().ok_or(UnknownReason(number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_is_listed_once_and_reads_back() {
        let mut stages: Vec<usize> = MissReason::ALL.iter().map(|reason| *reason as usize).collect();
        stages.sort_unstable();
        assert!(stages.into_iter().eq(0..=MissReason::EitherTool as usize));
        assert!(MissReason::ALL.iter().all(|reason| MissReason::try_from(u8::from(*reason)) == Ok(*reason)));
        assert!(MissReason::try_from(17).is_err() && MissReason::try_from(255).is_err());
    }
}
