//! What people open of the recordings of others, for the log that the trainee reads.

use super::named;

named! {
    /// A part of a session that a person opened.
    AccessedPart: "accessed part" {
        /// The recording: video, pictures, the live view.
        Video = "video",
        /// The path of the tools, and what the tracker saw.
        Path = "path",
        /// The result: features, report, evidence.
        Result = "result",
        /// Ratings and comments.
        Remarks = "remarks",
        /// A copy of all data of the trainee.
        Export = "export",
    }
}

impl AccessedPart {
    /// The number of the part in the sum that is stored.
    pub fn bit(self) -> i64 {
        match self {
            Self::Video => 1,
            Self::Path => 2,
            Self::Result => 4,
            Self::Remarks => 8,
            Self::Export => 16,
        }
    }

    /// The parts in a stored sum.
    pub fn in_sum(sum: i64) -> Vec<Self> {
        Self::ALL.iter().copied().filter(|part| sum & part.bit() != 0).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sum_gives_its_parts_back() {
        assert_eq!(AccessedPart::in_sum(0), []);
        assert_eq!(AccessedPart::in_sum(9), [AccessedPart::Video, AccessedPart::Remarks]);
        assert_eq!(AccessedPart::in_sum(31), AccessedPart::ALL);
    }
}
