//! Recordings that wait for a name: how they came, and what a person says about one.

use serde::Deserialize;
use utoipa::ToSchema;

use super::named;
use super::text::{Invalid, Key};
use crate::ids::WaitingRecordingId;

named! {
    /// How a recording without a name came.
    RecordingSource: "source" {
        /// From the watched folder of the server.
        Inbox = "inbox",
        /// From the agent of a box.
        Agent = "agent",
        /// From a member of staff, or a program of one.
        Upload = "upload",
    }
}

/// Most recordings that one request assigns.
pub const MAX_ASSIGNED: usize = 200;

/// What a person says about a recording that waits for a name.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordingAssignment {
    /// The recording.
    pub id: WaitingRecordingId,
    /// Whose it is, by id or code.
    #[schema(value_type = String)]
    pub trainee: Key,
    /// The task, by id or code; default: the one that it came with.
    #[serde(default)]
    #[schema(value_type = Option<String>)]
    pub task: Option<Key>,
    /// The box, by id or code; default: the one that it came with.
    #[serde(default, rename = "box")]
    #[schema(value_type = Option<String>)]
    pub in_box: Option<Key>,
    /// When it was recorded, RFC 3339; default: the time that it came with, else when it arrived.
    #[serde(default)]
    pub recorded_at: Option<String>,
    /// True if the caller saw the attempt.
    #[serde(default)]
    pub supervised: bool,
}

/// Recordings to assign, each on its own: a problem with one does not keep the others.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordingAssignments {
    /// 1 to 200 recordings.
    pub items: Vec<RecordingAssignment>,
}

impl RecordingAssignments {
    /// Checks the number of recordings.
    ///
    /// # Errors
    /// There are none, or too many.
    pub fn check(&self) -> Result<(), Invalid> {
        match self.items.len() {
            1..=MAX_ASSIGNED => Ok(()),
            count => Err(Invalid::new("items", format!("has {count} recordings; expected 1 to {MAX_ASSIGNED}"))),
        }
    }
}
