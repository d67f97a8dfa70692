//! Standards, cohorts and progress: computes ranks, judgements, curves and alarms from stored sessions, with the
//! methods of [`crate::statistics`].
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | the service [`Cohorts`]; calculations on blocking threads |
//! | `people.rs` | a cohort's people with one value each, and which of them may be compared |
//! | `propose.rs` | the limits of a standard, computed from people or chosen |
//! | `effect.rs` | the trainees whose state a new version of a standard changes |
//! | `distribution.rs` | the distribution of a feature over people, and the effect of a limit |
//! | `alarms.rs` | trainees who need attention: relapses, due refreshers |
//! | `overview.rs` | the table of a group |
//! | `courses.rs` | progress in a course |
//! | `progress.rs` | a trainee's sessions of a task over time |
//! | `versions.rs` | the versions of a task's standard, and which of them judges which session |
//! | `verdicts.rs` | these sessions against a standard: passes, rule, charts, reminders |
//! | `series.rs` | one feature over these sessions: points, rank, curve |
//! | `cache.rs` | recently computed charts and curves |
//! | `raters.rs` | agreement of raters, and correlation of ratings with features |
//! | `error_scores.rs` | error scores of sessions, and agreement of raters on error items |
//! | `skill.rs` | a task's model of skill: training, and its verdict on a session |
//! | `answer.rs` | answers in the form of the REST interface |
//!
//! A value that cannot be given is replaced by a reason ([`answer::Withheld`]), never by a made-up number. A person
//! counts once. A person's own value is only given to callers who may see that person.

mod alarms;
pub mod answer;
mod cache;
mod courses;
mod distribution;
mod effect;
mod error_scores;
mod overview;
mod people;
mod progress;
mod propose;
mod raters;
mod series;
mod skill;
mod verdicts;
mod versions;

use std::sync::Arc;

use tokio::sync::Semaphore;

use crate::domain::text::Invalid;
use crate::store::{Store, StoreError};
use crate::time::SharedClock;

use alarms::AlarmCache;
pub use alarms::{Alarm, AlarmKind, Alarms};
use cache::ComputedCache;
pub use courses::{CourseRow, GroupCourse, OwnCourse, StepPassed, StepProgress, StepState};
pub use distribution::{Distribution, DistributionSelection, GroupSpread};
pub use effect::{StandardEffect, TaskState, TraineeEffect};
pub use error_scores::{ErrorAgreement, ErrorScoreAnswer, ItemAgreement};
pub use overview::{GroupTable, GroupTableAnswer, GroupTableRow};
pub use progress::{ProgressSelection, TraineeProgress};
pub use propose::{Proposal, ProposedTarget};
pub use raters::{Agreement, CorrelationRow, Correlations};
pub use skill::NoSkillModel;

/// Limit of concurrent calculations. Further ones wait, so that other requests keep getting fast answers.
const MAX_CALCULATIONS: usize = 2;

/// Limit of concurrent trainings of skill models. They take minutes, so they do not use the slots of calculations.
const MAX_TRAININGS: usize = 1;

/// Why a calculation failed.
#[derive(Debug, thiserror::Error)]
pub enum CohortsError {
    /// A value of the request cannot be used.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// A field of the request names something that does not exist.
    #[error("`{field}` names no {what}")]
    Unknown {
        /// Field of the request.
        field: &'static str,
        /// What the field should name.
        what: &'static str,
    },
    /// The data are not sufficient for a model of skill.
    #[error("{}", .0.detail)]
    NoModel(NoSkillModel),
    /// Another model of skill is being trained.
    #[error("another model of skill is being trained")]
    Training,
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The service is shutting down, or a calculation panicked.
    #[error("the calculation did not finish")]
    Interrupted,
}

/// The service for standards, cohorts and progress. Clones share their caches and limits.
#[derive(Clone)]
pub struct Cohorts {
    store: Store,
    clock: SharedClock,
    cache: Arc<ComputedCache>,
    alarms: AlarmCache,
    calculation_slots: Arc<Semaphore>,
    training_slots: Arc<Semaphore>,
}

impl Cohorts {
    /// A service on this store and clock.
    pub fn new(store: Store, clock: SharedClock) -> Self {
        let places = |count| Arc::new(Semaphore::new(count));
        let (calculation_slots, training_slots) = (places(MAX_CALCULATIONS), places(MAX_TRAININGS));
        Self { store, clock, cache: Arc::default(), alarms: Arc::default(), calculation_slots, training_slots }
    }

    /// Runs a calculation on a blocking thread, when a slot is free.
    async fn calculate<T: Send + 'static>(&self, of: impl FnOnce() -> T + Send + 'static) -> Result<T, CohortsError> {
        let place = self.calculation_slots.clone().acquire_owned().await.map_err(|_| CohortsError::Interrupted)?;
        let calculation = move || {
            let _place = place; // held until the calculation ends, even if the caller no longer waits
            of()
        };
        tokio::task::spawn_blocking(calculation).await.map_err(|_| CohortsError::Interrupted)
    }
}

impl From<NoSkillModel> for CohortsError {
    fn from(why: NoSkillModel) -> Self {
        CohortsError::NoModel(why)
    }
}

/// Maps "not found" to [`CohortsError::Unknown`]: the request named something that does not exist.
fn unknown_field(field: &'static str) -> impl FnOnce(StoreError) -> CohortsError {
    move |error| match error {
        StoreError::NotFound { what } => CohortsError::Unknown { field, what },
        other => other.into(),
    }
}

#[cfg(test)]
mod tests;
