//! The effect of a new version of a standard, before it is set: the trainees in the caller's scope whose state at the
//! task would change.

use serde::Serialize;
use utoipa::ToSchema;

use super::answer::{ProgressAnswer, RuleState, StandingName};
use super::progress::{FeatureSelection, ProgressSelection, judge_sessions};
use super::versions::TaskStandards;
use super::{Cohorts, CohortsError};
use crate::domain::scope::Scope;
use crate::domain::standard::{StandardDefinition, StandardStart};
use crate::ids::{StandardId, TaskId, TraineeId};
use crate::store::{StandardRecord, TraineeTask};
use crate::time::to_rfc3339;

/// Limit of judged sessions; the trainees who trained most recently come first.
const MAX_SESSIONS: usize = 30_000;

/// The trainees whose state a new version would change.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct StandardEffect {
    /// It would judge the recordings that arrive from then on; `null`: all.
    #[schema(format = "date-time")]
    pub valid_from: Option<String>,
    /// The trainees whose state would change at once, by name.
    pub trainees: Vec<TraineeEffect>,
    /// Number of the other trainees of the task.
    pub unchanged: usize,
    /// True if there are more trainees than were compared.
    pub more: bool,
}

/// A trainee whose state at the task would change.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct TraineeEffect {
    /// Id of the trainee.
    pub trainee: TraineeId,
    /// Name of the trainee.
    pub name: String,
    /// The state under the present versions.
    pub before: TaskState,
    /// The state with the new version.
    pub after: TaskState,
    /// Number of past sessions that would be judged in another way.
    pub judged_anew: usize,
}

/// A trainee's state at a task.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct TaskState {
    /// The version under which the task is passed; `null` if it is not.
    pub passed: Option<i64>,
    /// State of the pass rule of the version in use; `null` without a rule.
    pub rule: Option<RuleState>,
    /// Standing on the charts of the version in use; `null` without a standard.
    pub standing: Option<StandingName>,
}

impl Cohorts {
    /// The trainees whose state a new version of a task's standard would change.
    pub async fn effect(
        &self,
        scope: &Scope,
        task: TaskId,
        definition: StandardDefinition,
        start: Option<StandardStart>,
    ) -> Result<StandardEffect, CohortsError> {
        let now_ms = self.clock.now_ms();
        let records = self.store.standards().of_tasks(scope, &[task]).await?;
        let valid_from_ms = StandardStart::or_usual(start, !records.is_empty()).valid_from_ms(now_ms);
        let is_in_use = |newest: &StandardRecord| newest.is_same(&definition, start, (now_ms, valid_from_ms));
        let with_new = match records.iter().max_by_key(|record| record.version) {
            Some(newest) if is_in_use(newest) => records.clone(),
            _ => with_version(&records, task, definition, (now_ms, valid_from_ms)),
        };
        let known = self.cache.clone();
        let both = move || [records, with_new].map(|versions| TaskStandards::of(versions, &known, now_ms));
        let [before, after] = self.calculate(both).await?;
        let trained = self.store.sessions().trainees_of_task(scope, task, MAX_SESSIONS as u32 + 1).await?;
        let mut sessions = 0;
        let within = trained.iter().take_while(|(_, of)| {
            sessions += *of;
            sessions <= MAX_SESSIONS
        });
        let ids: Vec<TraineeId> = within.map(|(trainee, _)| *trainee).collect();
        let features = FeatureSelection::of(&ProgressSelection::default(), &after)?.features();
        let pairs: Vec<TraineeTask> = ids.iter().map(|trainee| TraineeTask { trainee: *trainee, task }).collect();
        let of_each = self.practices(scope, &pairs, &features).await?;
        let trainees = self.store.trainees().named(scope, &ids).await?;
        let more = ids.len() < trained.len();
        let calculation = move || {
            let touched = trainees.iter().filter_map(|trainee| {
                let practice = of_each.get(&TraineeTask { trainee: trainee.id, task })?;
                let judged = |by: &TaskStandards| judge_sessions(practice, by, trainee.handedness, now_ms).1;
                TraineeEffect::of(trainee.id, trainee.name.to_string(), [judged(&before), judged(&after)])
            });
            let mut touched: Vec<TraineeEffect> = touched.collect();
            touched.sort_by(|one, other| one.name.cmp(&other.name));
            let valid_from = (valid_from_ms > 0).then(|| to_rfc3339(valid_from_ms));
            StandardEffect { valid_from, unchanged: trainees.len() - touched.len(), trainees: touched, more }
        };
        self.calculate(calculation).await
    }
}

/// These versions with one more, set and valid from these times.
fn with_version(
    records: &[StandardRecord],
    task_id: TaskId,
    definition: StandardDefinition,
    (created_at_ms, valid_from_ms): (i64, i64),
) -> Vec<StandardRecord> {
    let version = records.iter().map(|record| record.version).max().unwrap_or_default() + 1;
    let id = StandardId::at(created_at_ms);
    let new = StandardRecord { id, task_id, version, definition, who: None, created_at_ms, valid_from_ms };
    records.iter().cloned().chain([new]).collect()
}

impl TraineeEffect {
    /// The change of a trainee's progress; `None` if nothing changes.
    fn of(trainee: TraineeId, name: String, [before, after]: [ProgressAnswer; 2]) -> Option<Self> {
        let steps = before.sessions.iter().zip(&after.sessions);
        let judged_anew = steps.filter(|(one, other)| one.trial != other.trial).count();
        let [before, after] = [before, after].map(TaskState::of);
        (judged_anew > 0 || before != after).then_some(Self { trainee, name, before, after, judged_anew })
    }
}

impl TaskState {
    fn of(answer: ProgressAnswer) -> Self {
        Self {
            passed: answer.passed.map(|passed| passed.standard),
            rule: answer.rule,
            standing: answer.charts.map(|charts| charts.standing),
        }
    }
}
