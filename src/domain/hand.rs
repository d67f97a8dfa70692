//! The hand that a limit is for, and the tools in a session's hands.
//!
//! A tool's name belongs to one box: on another box the same hand holds a tool of another name. Limits and comparisons
//! are therefore for a hand, and each session says which tool was in it.

use serde::Serialize;
use utoipa::ToSchema;

use super::named;
use super::trainee::Handedness;

named! {
    /// A hand of the trainee.
    Hand: "hand" {
        /// The left hand, as the camera shows it.
        Left = "left",
        /// The right hand, as the camera shows it.
        Right = "right",
        /// The hand that the trainee prefers.
        Dominant = "dominant",
        /// The other one.
        Other = "other",
    }
}

/// The tools in a session's hands, where they are known.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
pub struct ToolHands {
    /// Name of the tool in the left hand; `null` if unknown.
    pub left: Option<String>,
    /// Name of the tool in the right hand; `null` if unknown.
    pub right: Option<String>,
}

impl Hand {
    /// The hand as left or right, for a trainee who prefers this hand; `None` if that is unknown or both.
    pub fn side(self, preferred: Option<Handedness>) -> Option<Hand> {
        match (self, preferred) {
            (Hand::Left | Hand::Right, _) => Some(self),
            (Hand::Dominant, Some(Handedness::Left)) | (Hand::Other, Some(Handedness::Right)) => Some(Hand::Left),
            (Hand::Dominant, Some(Handedness::Right)) | (Hand::Other, Some(Handedness::Left)) => Some(Hand::Right),
            (Hand::Dominant | Hand::Other, Some(Handedness::Both) | None) => None,
        }
    }
}

impl ToolHands {
    /// The tool in a hand of a trainee who prefers this hand; `None` if that is unknown.
    pub fn tool(&self, hand: Hand, preferred: Option<Handedness>) -> Option<&str> {
        match hand.side(preferred)? {
            Hand::Left => self.left.as_deref(),
            _ => self.right.as_deref(),
        }
    }

    /// The side of a tool; `None` if that is unknown.
    pub fn side_of(&self, tool: &str) -> Option<Hand> {
        if self.left.as_deref() == Some(tool) {
            return Some(Hand::Left);
        }
        (self.right.as_deref() == Some(tool)).then_some(Hand::Right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dominant_hand_is_the_preferred_one_and_unknown_without_a_preference() {
        let hands = ToolHands { left: Some("orange".to_owned()), right: Some("cyan".to_owned()) };
        let (left, right) = (Some(Handedness::Left), Some(Handedness::Right));
        for (hand, preferred, tool) in [
            (Hand::Left, None, Some("orange")),
            (Hand::Right, left, Some("cyan")),
            (Hand::Dominant, left, Some("orange")),
            (Hand::Dominant, right, Some("cyan")),
            (Hand::Other, left, Some("cyan")),
            (Hand::Other, right, Some("orange")),
            (Hand::Dominant, Some(Handedness::Both), None),
            (Hand::Other, None, None),
        ] {
            assert_eq!(hands.tool(hand, preferred), tool, "{hand:?} {preferred:?}");
        }
        assert_eq!(ToolHands::default().tool(Hand::Left, right), None);
        assert_eq!(
            ["orange", "cyan", "red"].map(|tool| hands.side_of(tool)),
            [Some(Hand::Left), Some(Hand::Right), None]
        );
    }
}
