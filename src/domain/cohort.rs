//! Members of a reference group: a list of people, or all people who match a description.

use serde::Deserialize;

use super::text::{Code, Invalid, Name};
use super::trainee::{Handedness, Level};
use crate::ids::{GroupId, TraineeId};

/// A cohort to be created, or the new content of an existing one.
#[derive(Clone, Debug, PartialEq, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewCohort {
    /// Name for people.
    pub name: Name,
    /// Short unique name; derived from `name` if absent.
    pub code: Option<Code>,
    /// Only people of this level.
    pub level: Option<Level>,
    /// Only people who prefer this hand.
    pub handedness: Option<Handedness>,
    /// Only people of this training group.
    pub group: Option<GroupId>,
    /// A list of exactly these people, instead of a description.
    pub members: Option<Vec<TraineeId>>,
}

impl NewCohort {
    /// Returns the cohort if it has either a list without repeats or a description, not both.
    pub fn checked(self) -> Result<Self, Invalid> {
        let Some(members) = &self.members else { return Ok(self) };
        if self.level.is_some() || self.handedness.is_some() || self.group.is_some() {
            return Err(Invalid::new(
                "members",
                "cannot be combined with level, handedness or group; give a list or a description",
            ));
        }
        if members.is_empty() {
            return Err(Invalid::new("members", "is empty; name the people, or describe them by level or group"));
        }
        let mut sorted = members.clone();
        sorted.sort();
        match sorted.windows(2).find(|pair| pair[0] == pair[1]) {
            Some(pair) => Err(Invalid::new("members", format!("names {} twice; each counts once", pair[0]))),
            None => Ok(self),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cohort_is_a_list_without_repeats_or_a_description() {
        let of = |json: serde_json::Value| serde_json::from_value::<NewCohort>(json).unwrap().checked().map(drop);
        let id = TraineeId::at(1).to_string();
        assert!(of(serde_json::json!({ "name": "Experts", "level": "expert" })).is_ok());
        assert!(of(serde_json::json!({ "name": "Everybody" })).is_ok());
        assert!(of(serde_json::json!({ "name": "These", "members": [id] })).is_ok());
        for (body, why) in [
            (serde_json::json!({ "name": "x", "members": [] }), "is empty"),
            (serde_json::json!({ "name": "x", "members": [id, id] }), "twice"),
            (serde_json::json!({ "name": "x", "members": [id], "level": "expert" }), "combined"),
        ] {
            assert!(of(body.clone()).unwrap_err().to_string().contains(why), "{body}");
        }
    }
}
