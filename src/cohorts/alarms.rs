//! Trainees who need attention according to the standards: relapses, and refreshers that are due.
//!
//! Judging all recent trainees takes about a second at a centre of ten thousand sessions, and every open overview page
//! asks again after each finished session. So the alarms are cached for a minute per caller, and only one computation
//! runs at a time. Names are read anew for each answer, through the scope: trainees who were erased or are no longer in
//! the caller's scope are left out.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use serde::Serialize;
use tokio::sync::Mutex;
use utoipa::ToSchema;

use super::answer::{EventName, RefresherState, SessionStep};
use super::progress::{FeatureSelection, ProgressSelection, judge_sessions};
use super::{Cohorts, CohortsError};
use crate::domain::named as names;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::ids::{SessionId, TaskId, TraineeId};
use crate::store::{StoreError, TraineeTask};

/// Limit of judged sessions; the trainees who trained most recently come first.
const MAX_SESSIONS: usize = 30_000;
/// Trainees without a session in this time are not judged: a month after the last refresher.
const LOOKBACK_MS: i64 = 150 * 86_400_000;
/// Lifetime of cached alarms.
const CACHE_MS: i64 = 60_000;

/// Trainees in the caller's scope who need attention according to the standards.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub struct Alarms {
    /// Relapses and refreshers that are due, the latest first.
    pub items: Vec<Alarm>,
    /// True if there are more trainees than were checked.
    pub more: bool,
}

/// One trainee who needs attention at one task.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Alarm {
    /// Reason of the alarm.
    pub kind: AlarmKind,
    /// Id of the trainee.
    pub trainee: TraineeId,
    /// Name of the trainee.
    pub trainee_name: String,
    /// Id of the task.
    pub task: TaskId,
    /// Name of the task.
    pub task_name: String,
    /// The session that caused the relapse; `null` for a refresher.
    pub session: Option<SessionId>,
    /// Start of the alarm: when the session was recorded, or when the refresher was due.
    #[schema(format = "date-time")]
    pub since: String,
}

names! {
    /// Why a trainee needs attention.
    AlarmKind: "kind" {
        /// The chart shows that the trainee has lost proficiency.
        Relapsed = "relapsed",
        /// A refresher is due.
        Due = "due",
    }
}

/// Cached alarms by the caller's role and subject.
pub(super) type AlarmCache = Arc<Mutex<HashMap<(Role, Option<String>), Arc<CachedAlarms>>>>;

/// Alarms without names.
#[derive(Debug)]
pub(super) struct CachedAlarms {
    at_ms: i64,
    alarms: Vec<UnnamedAlarm>,
    more: bool,
}

#[derive(Debug)]
struct UnnamedAlarm {
    kind: AlarmKind,
    of: TraineeTask,
    session: Option<SessionId>,
    since: String,
}

impl Cohorts {
    /// Relapses and due refreshers of the trainees in this scope.
    pub async fn alarms(&self, scope: &Scope) -> Result<Alarms, CohortsError> {
        let found = self.cached_alarms(scope).await?;
        let mut trainees: Vec<TraineeId> = found.alarms.iter().map(|raised| raised.of.trainee).collect();
        trainees.sort();
        trainees.dedup();
        let seen = self.store.trainees().named(scope, &trainees).await?;
        let names: HashMap<TraineeId, String> =
            seen.into_iter().map(|trainee| (trainee.id, trainee.name.to_string())).collect();
        let ids: BTreeSet<TaskId> = found.alarms.iter().map(|raised| raised.of.task).collect();
        let mut tasks: HashMap<TaskId, String> = HashMap::with_capacity(ids.len());
        for id in ids {
            match self.store.tasks().get(scope, &Key::from(&id)).await {
                Ok(task) => drop(tasks.insert(id, task.name.to_string())),
                Err(StoreError::NotFound { .. }) => {} // deleted meanwhile
                Err(error) => return Err(error.into()),
            }
        }
        let mut items = Vec::with_capacity(found.alarms.len());
        for UnnamedAlarm { kind, of, session, since } in &found.alarms {
            let (Some(trainee), Some(task)) = (names.get(&of.trainee), tasks.get(&of.task)) else { continue };
            items.push(Alarm {
                kind: *kind,
                trainee: of.trainee,
                trainee_name: trainee.clone(),
                task: of.task,
                task_name: task.clone(),
                session: *session,
                since: since.clone(),
            });
        }
        Ok(Alarms { items, more: found.more })
    }

    async fn cached_alarms(&self, scope: &Scope) -> Result<Arc<CachedAlarms>, CohortsError> {
        let mut known = self.alarms.lock().await;
        let now_ms = self.clock.now_ms();
        known.retain(|_, found| (0..CACHE_MS).contains(&(now_ms - found.at_ms)));
        let key = (scope.role(), scope.subject());
        if let Some(found) = known.get(&key) {
            return Ok(found.clone());
        }
        let found = Arc::new(self.find_alarms(scope, now_ms).await?);
        known.insert(key, found.clone());
        Ok(found)
    }

    async fn find_alarms(&self, scope: &Scope, now_ms: i64) -> Result<CachedAlarms, CohortsError> {
        let since = now_ms.saturating_sub(LOOKBACK_MS);
        let trained = self.store.sessions().trainee_tasks(scope, since, MAX_SESSIONS as u32 + 1).await?;
        let mut sessions = 0;
        let within = |(_, of): &&(TraineeTask, usize)| {
            sessions += *of;
            sessions <= MAX_SESSIONS
        };
        let pairs: Vec<TraineeTask> = trained.iter().take_while(within).map(|(pair, _)| *pair).collect();
        let mut tasks: Vec<TaskId> = pairs.iter().map(|pair| pair.task).collect();
        tasks.sort();
        tasks.dedup();
        let mut alarms = Vec::new();
        for task in tasks {
            let of: Vec<TraineeTask> = pairs.iter().copied().filter(|pair| pair.task == task).collect();
            alarms.extend(self.alarms_of_task(scope, task, of, now_ms).await?);
        }
        alarms.sort_by(|one, other| other.since.cmp(&one.since));
        Ok(CachedAlarms { at_ms: now_ms, alarms, more: pairs.len() < trained.len() })
    }

    async fn alarms_of_task(
        &self,
        scope: &Scope,
        task: TaskId,
        pairs: Vec<TraineeTask>,
        now_ms: i64,
    ) -> Result<Vec<UnnamedAlarm>, CohortsError> {
        let (standards, _) = self.task_standards(scope, task).await?;
        if standards.current().is_none() {
            return Ok(Vec::new());
        }
        let shown = FeatureSelection::of(&ProgressSelection::default(), &standards)?;
        let of_each = self.practices(scope, &pairs, &shown.features()).await?;
        let ids: Vec<TraineeId> = pairs.iter().map(|pair| pair.trainee).collect();
        let trainees = self.store.trainees().named(scope, &ids).await?;
        let calculation = move || {
            let mut alarms = Vec::new();
            for trainee in &trainees {
                let of = TraineeTask { trainee: trainee.id, task };
                let Some(practice) = of_each.get(&of) else { continue };
                let (_, course) = judge_sessions(practice, &standards, trainee.handedness, now_ms);
                let last = course.charts.as_ref().and_then(|charts| charts.events.last());
                let relapse = last.filter(|event| event.event == EventName::Relapsed);
                let at = relapse.and_then(|event| course.sessions.iter().find(|step| step.number == event.session));
                alarms.extend(at.map(|SessionStep { id, recorded_at, .. }| UnnamedAlarm {
                    kind: AlarmKind::Relapsed,
                    of,
                    session: Some(*id),
                    since: recorded_at.clone(),
                }));
                let due = course.reminders.iter().rev().find(|reminder| reminder.state == RefresherState::Due);
                alarms.extend(due.map(|reminder| UnnamedAlarm {
                    kind: AlarmKind::Due,
                    of,
                    session: None,
                    since: reminder.due_at.clone(),
                }));
            }
            alarms
        };
        self.calculate(calculation).await
    }
}
