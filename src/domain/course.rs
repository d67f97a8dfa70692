//! What a course asks for: tasks in an order, each with what counts as done and by when.
//!
//! A step is done when the task's standard is passed, or, where it asks for sessions, when so many were recorded. How far somebody has
//! come is worked out from their sessions each time it is asked (`cohorts`): nobody's state is kept.

use serde::Deserialize;

use super::text::{Invalid, Key, Name};

/// Most steps of a plan: more of them are no table that somebody reads.
pub const MOST_STEPS: usize = 40;
/// Latest day that a step may be due on, days after the beginning: ten years.
pub const MOST_DAYS: u32 = 3650;
/// Most sessions that a step may ask for.
pub const MOST_SESSIONS: u32 = 200;

/// A course plan to be made, or what an existing one becomes.
#[derive(Clone, Debug, PartialEq, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewCourse {
    /// What people call it.
    pub name: Name,
    /// Its steps in their order, 1 to 40.
    pub steps: Vec<NewStep>,
}

/// A step of it.
#[derive(Clone, Debug, PartialEq, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewStep {
    /// What to train, by id or code.
    pub task: Key,
    /// Due so many days after the course's beginning, 0 to 3650; 0: on its first day; absent: at any time.
    pub within_days: Option<u32>,
    /// So many sessions of the course are asked for, 1 to 200; absent: that the task's standard is passed.
    pub sessions: Option<u32>,
}

impl NewCourse {
    /// The same, if its figures are within their limits.
    pub fn checked(self) -> Result<Self, Invalid> {
        if !(1..=MOST_STEPS).contains(&self.steps.len()) {
            return Err(Invalid::new("steps", format!("are {}; expected 1 to {MOST_STEPS}", self.steps.len())));
        }
        for (number, step) in (1..).zip(&self.steps) {
            if let Some(days) = step.within_days.filter(|days| *days > MOST_DAYS) {
                let why = format!("has {days} in step {number}; expected 0 to {MOST_DAYS} days");
                return Err(Invalid::new("within_days", why));
            }
            if let Some(sessions) = step.sessions.filter(|of| !(1..=MOST_SESSIONS).contains(of)) {
                return Err(Invalid::new(
                    "sessions",
                    format!(
                        "has {sessions} in step {number}; expected 1 to {MOST_SESSIONS}, or nothing for the standard"
                    ),
                ));
            }
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn checked(steps: Value) -> Result<NewCourse, Invalid> {
        serde_json::from_value::<NewCourse>(json!({"name": "Basics", "steps": steps})).unwrap().checked()
    }

    #[test]
    fn a_plan_has_steps_within_their_limits() {
        assert!(checked(json!([{"task": "pegs"}])).is_ok());
        assert!(checked(json!([{"task": "pegs", "within_days": 0, "sessions": 200}])).is_ok());
        assert!(checked(vec![json!({"task": "pegs"}); MOST_STEPS].into()).is_ok());
        for (steps, what) in [
            (json!([]), "steps"),
            (vec![json!({"task": "pegs"}); MOST_STEPS + 1].into(), "steps"),
            (json!([{"task": "pegs", "within_days": 3651}]), "within_days"),
            (json!([{"task": "pegs"}, {"task": "pegs", "sessions": 0}]), "sessions"),
            (json!([{"task": "pegs", "sessions": 201}]), "sessions"),
        ] {
            assert_eq!(checked(steps.clone()).unwrap_err().what, what, "{steps}");
        }
    }
}
