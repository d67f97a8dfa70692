//! Standards, cohorts and progress: turns what the store knows into places, judgements, curves and alarms of
//! [`crate::pipeline::score`].
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | who is asked what; the calculations' place beside the async threads |
//! | `people.rs` | a cohort's people, one value each, and who of them may be compared with whom |
//! | `propose.rs` | a standard's limits, made from people or chosen |
//! | `distribution.rs` | how a feature is spread over people, and whom a limit would be wrong about |
//! | `alarms.rs` | who needs somebody: relapses, refreshers that are due |
//! | `overview.rs` | a group's table |
//! | `courses.rs` | how far people have come in a course |
//! | `progress.rs` | a trainee's sessions of a task over time |
//! | `verdicts.rs` | what a standard makes of them: passes, rule, charts, reminders |
//! | `series.rs` | one feature of them: points, place, curve |
//! | `known.rs` | charts and curves that were computed lately |
//! | `raters.rs` | whether raters agree, and what their ratings go with |
//! | `skill.rs` | a task's model of skill: made, and asked of a session |
//! | `answer.rs` | what is answered, as it is told |
//!
//! What cannot be said is a reason ([`answer::Withheld`]), never a number. A person counts once. Nobody's own value leaves
//! this room but to who may see that person.

mod alarms;
pub mod answer;
mod courses;
mod distribution;
mod known;
mod overview;
mod people;
mod progress;
mod propose;
mod raters;
mod series;
mod skill;
mod verdicts;

use std::sync::Arc;

use tokio::sync::Semaphore;

use crate::domain::text::Invalid;
use crate::store::{Store, StoreError};
use crate::time::SharedClock;

use alarms::KnownAlarms;
pub use alarms::{Alarm, AlarmKind, Alarms};
pub use courses::{CourseRow, GroupCourse, OwnCourse, StepPassed, StepProgress, StepState};
pub use distribution::{AskedSpread, Distribution, Spread};
use known::Known;
pub use overview::{GroupTable, GroupTableRow, TableFound};
pub use progress::{Asked, Found};
pub use propose::{Proposal, Proposed};
pub use raters::{Agreement, CorrelationRow, Correlations};
pub use skill::NoSkillModel;

/// Calculations at the same time; further ones wait, so that what answers quickly goes on answering.
const CALCULATIONS: usize = 2;

/// Models of skill that are made at the same time: they take minutes, and leave the calculations their places.
const TRAININGS: usize = 1;

/// Why something was not calculated.
#[derive(Debug, thiserror::Error)]
pub enum CohortsError {
    /// A value of the request cannot be used.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// The request names something that is not there.
    #[error("`{field}` names no {what}")]
    Unknown {
        /// The request's field.
        field: &'static str,
        /// What it should name.
        what: &'static str,
    },
    /// A model of skill cannot be made of what is there.
    #[error("{}", .0.detail)]
    NoModel(NoSkillModel),
    /// Another model of skill is being made.
    #[error("another model of skill is being made")]
    Training,
    /// The store did not answer.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The service ends, or a calculation broke down.
    #[error("the calculation did not end")]
    Broken,
}

/// The room. Clones are the same room.
#[derive(Clone)]
pub struct Cohorts {
    store: Store,
    clock: SharedClock,
    known: Arc<Known>,
    alarms: KnownAlarms,
    places: Arc<Semaphore>,
    training: Arc<Semaphore>,
}

impl Cohorts {
    /// Asks this store, by this clock.
    pub fn new(store: Store, clock: SharedClock) -> Self {
        let places = |most| Arc::new(Semaphore::new(most));
        let (places, training) = (places(CALCULATIONS), places(TRAININGS));
        Self { store, clock, known: Arc::default(), alarms: Arc::default(), places, training }
    }

    /// Calculates beside the async threads.
    async fn calculate<T: Send + 'static>(&self, of: impl FnOnce() -> T + Send + 'static) -> Result<T, CohortsError> {
        let place = self.places.clone().acquire_owned().await.map_err(|_| CohortsError::Broken)?;
        let calculation = move || {
            let _place = place; // kept to the end, also where nobody waits for it any more
            of()
        };
        tokio::task::spawn_blocking(calculation).await.map_err(|_| CohortsError::Broken)
    }
}

impl From<NoSkillModel> for CohortsError {
    fn from(why: NoSkillModel) -> Self {
        CohortsError::NoModel(why)
    }
}

/// For what a request names: missing there is the request's mistake.
fn named(field: &'static str) -> impl FnOnce(StoreError) -> CohortsError {
    move |error| match error {
        StoreError::NotFound { what } => CohortsError::Unknown { field, what },
        other => other.into(),
    }
}

#[cfg(test)]
mod tests;
