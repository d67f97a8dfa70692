//! Cutting a recording with two attempts into two sessions.

use serde::Deserialize;
use utoipa::ToSchema;

use super::text::{Invalid, Remark};

/// Latest accepted second: no recording is longer than a day.
const MAX_TIME_S: f64 = 86_400.0;

/// Where a recording is cut.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewSessionCut {
    /// The second of the recording: the first session ends there, and the second one begins.
    pub at_s: f64,
    /// The reason, for later readers: 1 to 2000 characters.
    #[schema(value_type = String)]
    pub why: Remark,
}

impl NewSessionCut {
    /// Checks the second.
    ///
    /// # Errors
    /// It lies outside any recording.
    pub fn check(&self) -> Result<(), Invalid> {
        match self.at_s > 0.0 && self.at_s < MAX_TIME_S {
            true => Ok(()),
            false => Err(Invalid::new("at_s", format!("is {}; expected a second of the recording", self.at_s))),
        }
    }
}
