//! Trainees.

use serde::{Deserialize, Serialize};

use super::named;
use super::text::{Code, Name};
use crate::ids::GroupId;

named! {
    /// A trainee's declared level of experience.
    Level: "level" {
        /// First steps.
        Novice = "novice",
        /// Some operations.
        Intermediate = "intermediate",
        /// Operates regularly.
        Expert = "expert",
    }
}

named! {
    /// The hand that a trainee prefers.
    Handedness: "handedness" {
        /// Left.
        Left = "left",
        /// Right.
        Right = "right",
        /// Either.
        Both = "both",
    }
}

/// A trainee to be registered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewTrainee {
    /// The trainee's name.
    pub name: Name,
    /// Short unique name; derived from `name` if absent.
    pub code: Option<Code>,
    /// Experience.
    pub level: Option<Level>,
    /// Preferred hand.
    pub handedness: Option<Handedness>,
    /// The group to join. An instructor with only one group may leave it out.
    pub group: Option<GroupId>,
}

/// Changes to a trainee; absent fields stay as they are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TraineeChange {
    /// New name.
    pub name: Option<Name>,
    /// New code.
    pub code: Option<Code>,
    /// New level.
    pub level: Option<Level>,
    /// New preferred hand.
    pub handedness: Option<Handedness>,
}
