//! Moving a session to the right trainee, task or box.

use serde::Deserialize;
use utoipa::ToSchema;

use super::named;
use super::text::{Invalid, Key, Remark};

named! {
    /// What a move changes.
    MovedPart: "part" {
        /// The trainee.
        Trainee = "trainee",
        /// The task.
        Task = "task",
        /// The box.
        Box = "box",
    }
}

/// Where a session is to be moved. Absent: it stays as it is.
#[derive(Clone, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewSessionMove {
    /// The right trainee, by id or code.
    #[serde(default)]
    #[schema(value_type = Option<String>)]
    pub trainee: Option<Key>,
    /// The right task, by id or code.
    #[serde(default)]
    #[schema(value_type = Option<String>)]
    pub task: Option<Key>,
    /// The right box, by id or code.
    #[serde(default, rename = "box")]
    #[schema(value_type = Option<String>)]
    pub in_box: Option<Key>,
    /// The reason, for later readers: 1 to 2000 characters.
    #[schema(value_type = String)]
    pub why: Remark,
}

impl NewSessionMove {
    /// Checks that the request names something.
    ///
    /// # Errors
    /// It names neither a trainee nor a task nor a box.
    pub fn check(&self) -> Result<(), Invalid> {
        match self.trainee.is_none() && self.task.is_none() && self.in_box.is_none() {
            true => Err(Invalid::new("trainee", "is missing: name the right trainee, `task` or `box`")),
            false => Ok(()),
        }
    }
}
