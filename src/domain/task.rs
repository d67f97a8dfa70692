//! An exercise that trainees do in a box.

use serde::{Deserialize, Serialize};

use super::text::{Code, Name, Paragraphs};

/// A task to be registered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewTask {
    /// What people call it.
    pub name: Name,
    /// Its short unique name; made from `name` if absent.
    pub code: Option<Code>,
    /// What to do.
    pub description: Option<Paragraphs>,
}

/// Changes to a task; what is absent stays.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TaskChange {
    /// New name.
    pub name: Option<Name>,
    /// New code.
    pub code: Option<Code>,
    /// New description.
    pub description: Option<Paragraphs>,
}
