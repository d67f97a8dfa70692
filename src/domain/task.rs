//! An exercise that trainees do in a box.

use serde::{Deserialize, Serialize};

use super::text::{Code, Name, Paragraphs};
use crate::ids::GroupId;

/// A task to be registered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewTask {
    /// Name for people.
    pub name: Name,
    /// Short unique name; derived from `name` if absent.
    pub code: Option<Code>,
    /// Instructions for trainees.
    pub description: Option<Paragraphs>,
    /// The groups whose instructors may change it. Absent: all groups of the instructor who registers it; for an
    /// administrator none, so that only administrators may change it.
    pub groups: Option<Vec<GroupId>>,
}

/// Changes to a task; absent fields stay as they are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TaskChange {
    /// New name.
    pub name: Option<Name>,
    /// New code.
    pub code: Option<Code>,
    /// New description.
    pub description: Option<Paragraphs>,
    /// The groups whose instructors may change it. An instructor names own groups, at least one; other groups stay.
    pub groups: Option<Vec<GroupId>>,
}
