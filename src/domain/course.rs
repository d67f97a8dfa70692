//! Course plans: an ordered list of tasks, each with a condition for being done and a due date.
//!
//! A step is done when the task's standard is passed or, if the step requires a number of sessions, when that many were
//! recorded. A trainee's progress is computed from their sessions at each request (`cohorts`); no progress is stored.

use serde::Deserialize;

use super::text::{Invalid, Key, Name};
use crate::ids::GroupId;
use crate::time::Day;

/// Maximum number of steps of a plan: a longer table is unreadable.
pub const MAX_STEPS: usize = 40;
/// Latest due day of a step, days after the beginning: ten years.
pub const MAX_DAYS: u32 = 3650;
/// Maximum number of sessions that a step may require.
pub const MAX_SESSIONS: u32 = 200;

/// A course plan to be created, or the new content of an existing one.
#[derive(Clone, Debug, PartialEq, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewCourse {
    /// Name for people.
    pub name: Name,
    /// Its steps in their order, 1 to 40.
    pub steps: Vec<NewStep>,
    /// The groups whose instructors may change the plan. Absent in a new plan: all groups of the instructor who makes
    /// it; for an administrator none, so that only administrators may change it. Absent in a changed plan: as before.
    pub groups: Option<Vec<GroupId>>,
}

/// A step of a course plan.
#[derive(Clone, Debug, PartialEq, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewStep {
    /// The task, by id or code.
    pub task: Key,
    /// Due date, days after the course's beginning, 0 to 3650; 0: the first day; absent: no due date.
    pub within_days: Option<u32>,
    /// Required number of sessions during the course, 1 to 200; absent: the task's standard must be passed.
    pub sessions: Option<u32>,
}

impl NewCourse {
    /// Returns the plan if its numbers are within their limits.
    pub fn checked(self) -> Result<Self, Invalid> {
        if !(1..=MAX_STEPS).contains(&self.steps.len()) {
            return Err(Invalid::new("steps", format!("are {}; expected 1 to {MAX_STEPS}", self.steps.len())));
        }
        for (number, step) in (1..).zip(&self.steps) {
            if let Some(days) = step.within_days.filter(|days| *days > MAX_DAYS) {
                let why = format!("is {days} in step {number}; expected 0 to {MAX_DAYS} days");
                return Err(Invalid::new("within_days", why));
            }
            if let Some(sessions) = step.sessions.filter(|of| !(1..=MAX_SESSIONS).contains(of)) {
                return Err(Invalid::new(
                    "sessions",
                    format!("is {sessions} in step {number}; expected 1 to {MAX_SESSIONS}, or none for the standard"),
                ));
            }
        }
        Ok(self)
    }
}

/// The first day of a course, if it lies within ten years ([`MAX_DAYS`]) before or after `today`: another one is
/// mistyped.
pub fn checked_first_day(begins: Day, today: Day) -> Result<Day, Invalid> {
    if begins <= today.plus_days(MAX_DAYS) && today <= begins.plus_days(MAX_DAYS) {
        return Ok(begins);
    }
    Err(Invalid::new("begins", format!("is {begins}; expected a day within ten years of today, such as {today}")))
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
        assert!(checked(vec![json!({"task": "pegs"}); MAX_STEPS].into()).is_ok());
        for (steps, what) in [
            (json!([]), "steps"),
            (vec![json!({"task": "pegs"}); MAX_STEPS + 1].into(), "steps"),
            (json!([{"task": "pegs", "within_days": 3651}]), "within_days"),
            (json!([{"task": "pegs"}, {"task": "pegs", "sessions": 0}]), "sessions"),
            (json!([{"task": "pegs", "sessions": 201}]), "sessions"),
        ] {
            assert_eq!(checked(steps.clone()).unwrap_err().what, what, "{steps}");
        }
    }

    #[test]
    fn a_course_begins_within_ten_years_of_today() {
        let day = |text: &str| text.parse::<Day>().unwrap();
        let today = day("2026-11-21");
        for begins in ["2026-11-21", "2016-11-24", "2036-11-18"] {
            assert_eq!(checked_first_day(day(begins), today), Ok(day(begins)));
        }
        for begins in ["9999-12-31", "0001-01-01", "2016-11-22", "2036-11-20"] {
            let refused = checked_first_day(day(begins), today).unwrap_err();
            assert!(refused.what == "begins" && refused.why.contains("such as 2026-11-21"), "{refused}");
        }
    }
}
