//! Many trainees at once: a group's table at one task, and who needs somebody. The sessions are judged as one trainee's progress
//! judges them ([`super::progress`]); what takes a fit or a comparison is left to that.

use std::collections::HashMap;

use serde::Serialize;
use utoipa::ToSchema;

use super::answer::{EventName, Point, ReminderState, RuleState, StandingName, Step};
use super::progress::{Asked, MOST_SESSIONS, Shown, judged};
use super::series::{Numbered, points};
use super::{Cohorts, CohortsError, named};
use crate::domain::feature::FeatureKey;
use crate::domain::named as names;
use crate::domain::scope::Scope;
use crate::domain::standard::{Definition, Target};
use crate::domain::text::{Invalid, Key};
use crate::ids::{GroupId, SessionId, TaskId, TraineeId};
use crate::pipeline::features::find;
use crate::pipeline::score::lc_cusum::Monitor;
use crate::store::{Group, Practice, Standard, Task, Trained, Trainee};

/// Points of a sparkline: the last sessions, so many at most.
const SPARK: usize = 30;

/// What a group's table shows.
#[derive(Debug)]
pub struct TableFound {
    /// Of whom.
    pub group: Group,
    /// At which task.
    pub task: Task,
    /// What it asks for.
    pub standard: Option<Standard>,
    /// Which feature, and its rows.
    pub table: GroupTable,
    /// Who is in it, by name.
    pub trainees: Vec<Trainee>,
}

/// One feature over a group's trainees.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct GroupTable {
    /// Which feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// Its title for people.
    pub title: &'static str,
    /// Its unit; `1` for shares, counts and ratios.
    pub unit: &'static str,
    /// What is better: `lower`, `higher` or `neither`.
    pub better: &'static str,
    /// The limit that the standard sets it; `null` without one.
    pub target: Option<Target>,
    /// The tools that have this feature in any of the sessions; empty for one of the whole session.
    pub tools: Vec<String>,
    /// One row a trainee, by name.
    pub rows: Vec<GroupTableRow>,
}

/// One trainee's row.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct GroupTableRow {
    /// Who.
    pub trainee: TraineeId,
    /// How many sessions of the task they have.
    pub sessions: usize,
    /// When the last one was recorded; `null` without one.
    #[schema(format = "date-time")]
    pub last_at: Option<String>,
    /// Their last values that count, at most thirty, oldest first; the last of them is the newest.
    pub points: Vec<Point>,
    /// The session of the last of these points.
    pub newest: Option<SessionId>,
    /// How far they have come by the standard's pass rule; `null` without one.
    pub rule: Option<RuleState>,
    /// How they stand by the charts; `null` without a standard.
    pub standing: Option<StandingName>,
    /// Does the task count as learnt?
    pub passed: bool,
}

/// Who of those whom one sees needs somebody, as the standards tell it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub struct Alarms {
    /// Relapses and refreshers that are due, the latest first.
    pub items: Vec<Alarm>,
    /// Were there more trainees than are looked at?
    pub more: bool,
}

/// One of them.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Alarm {
    /// What.
    pub kind: AlarmKind,
    /// Who.
    pub trainee: TraineeId,
    /// What they are called.
    pub trainee_name: String,
    /// Of what.
    pub task: TaskId,
    /// What it is called.
    pub task_name: String,
    /// The session by which they relapsed; `null` for a refresher.
    pub session: Option<SessionId>,
    /// Since when: the session's day, or the day on which the refresher was due.
    #[schema(format = "date-time")]
    pub since: String,
}

names! {
    /// Why somebody needs somebody.
    AlarmKind: "kind" {
        /// The chart says that they do not keep what they had learnt.
        Relapsed = "relapsed",
        /// A refresher is due.
        Due = "due",
    }
}

/// Trainees and tasks that are looked at for alarms: those who trained last.
const MOST_LOOKED_AT: u32 = 300;
/// Who has not trained for so long is no news any more: a month beyond the last refresher.
const LOOKED_BACK_MS: i64 = 150 * 86_400_000;

impl Cohorts {
    /// How a group's trainees get on at a task, in one feature.
    pub async fn table(&self, scope: &Scope, group: GroupId, asked: Asked) -> Result<TableFound, CohortsError> {
        let group = self.store.groups().get(scope, group).await?;
        let Some(task) = &asked.task else {
            return Err(Invalid::new("task", "is missing: name one").into());
        };
        let task = self.store.tasks().get(scope, task).await.map_err(named("task"))?;
        let standard = self.store.standards().in_use(scope, task.id).await?;
        let trainees = self.store.trainees().of_group(scope, group.id).await?;
        let pairs: Vec<Trained> = trainees.iter().map(|of| Trained { trainee: of.id, task: task.id }).collect();
        let shown = Shown::of(&asked, standard.as_ref().map(|standard| &standard.definition))?;
        let of_each = self.practices(scope, &pairs, &shown.names()).await?;
        let definition = standard.as_ref().map(|standard| standard.definition.clone());
        let (known, now_ms) = (self.known.clone(), self.clock.now_ms());
        let (at, trained) = (task.id, trainees.clone());
        let calculation = move || {
            let keys = shown.keys(of_each.values());
            let of = keys.first().cloned().unwrap_or_else(|| shown.usual());
            let tools =
                keys.iter().filter(|key| key.feature == of.feature).filter_map(|key| key.tool.clone()).collect();
            let monitor = definition.as_ref().and_then(|definition| known.charts(definition.charts).ok());
            let standard = definition.as_ref().zip(monitor.as_deref());
            let nothing = Practice { earlier: 0, sessions: Vec::new() };
            let rows = trained.iter().map(|trainee| {
                let practice = of_each.get(&Trained { trainee: trainee.id, task: at }).unwrap_or(&nothing);
                row(trainee, &of, practice, standard, now_ms)
            });
            let rows = rows.collect();
            let target = definition.as_ref().and_then(|definition| definition.target(&of)).cloned();
            let feature = find(&of.feature);
            GroupTable {
                title: feature.map_or("", |feature| feature.title),
                unit: feature.map_or("", |feature| feature.unit),
                better: feature.map_or("neither", |feature| feature.direction.name()),
                of,
                target,
                tools,
                rows,
            }
        };
        let table = self.calculate(calculation).await?;
        Ok(TableFound { group, task, standard, table, trainees })
    }

    /// Relapses, and refreshers that are due.
    pub async fn alarms(&self, scope: &Scope) -> Result<Alarms, CohortsError> {
        let now_ms = self.clock.now_ms();
        let since = now_ms.saturating_sub(LOOKED_BACK_MS);
        let mut pairs = self.store.sessions().trained(scope, since, MOST_LOOKED_AT + 1).await?;
        let more = pairs.len() > MOST_LOOKED_AT as usize;
        pairs.truncate(MOST_LOOKED_AT as usize);
        let mut tasks: Vec<TaskId> = pairs.iter().map(|pair| pair.task).collect();
        tasks.sort();
        tasks.dedup();
        let mut items = Vec::new();
        for task in tasks {
            let of: Vec<Trained> = pairs.iter().copied().filter(|pair| pair.task == task).collect();
            items.extend(self.alarms_at(scope, task, &of, now_ms).await?);
        }
        items.sort_by(|one, other| other.since.cmp(&one.since));
        Ok(Alarms { items, more })
    }

    async fn alarms_at(
        &self,
        scope: &Scope,
        task: TaskId,
        of: &[Trained],
        now_ms: i64,
    ) -> Result<Vec<Alarm>, CohortsError> {
        let Some(standard) = self.store.standards().in_use(scope, task).await? else { return Ok(Vec::new()) };
        let task = self.store.tasks().get(scope, &Key::from(&task)).await?;
        let shown = Shown::of(&Asked::default(), Some(&standard.definition))?;
        let of_each = self.practices(scope, of, &shown.names()).await?;
        let ids: Vec<TraineeId> = of.iter().map(|pair| pair.trainee).collect();
        let trainees = self.store.trainees().named(scope, &ids).await?;
        let (known, definition) = (self.known.clone(), standard.definition);
        let calculation = move || {
            let Ok(monitor) = known.charts(definition.charts) else { return Vec::new() };
            let mut alarms = Vec::new();
            for trainee in &trainees {
                let Some(practice) = of_each.get(&Trained { trainee: trainee.id, task: task.id }) else { continue };
                let (_, course) = judged(practice, Some((&definition, &*monitor)), trainee.handedness, now_ms);
                let alarm = |kind, session, since: &str| Alarm {
                    kind,
                    trainee: trainee.id,
                    trainee_name: trainee.name.to_string(),
                    task: task.id,
                    task_name: task.name.to_string(),
                    session,
                    since: since.to_owned(),
                };
                let last = course.charts.as_ref().and_then(|charts| charts.events.last());
                let relapse = last.filter(|event| event.event == EventName::Relapsed);
                let at = relapse.and_then(|event| course.sessions.iter().find(|step| step.number == event.session));
                alarms
                    .extend(at.map(|Step { id, recorded_at, .. }| alarm(AlarmKind::Relapsed, Some(*id), recorded_at)));
                let due = course.reminders.iter().rev().find(|reminder| reminder.state == ReminderState::Due);
                alarms.extend(due.map(|reminder| alarm(AlarmKind::Due, None, &reminder.due_at)));
            }
            alarms
        };
        self.calculate(calculation).await
    }

    async fn practices(
        &self,
        scope: &Scope,
        of: &[Trained],
        names: &[String],
    ) -> Result<HashMap<Trained, Practice>, CohortsError> {
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        Ok(self.store.sessions().practice_of_many(scope, of, &names, MOST_SESSIONS).await?)
    }
}

fn row(
    trainee: &Trainee,
    of: &FeatureKey,
    practice: &Practice,
    standard: Option<(&Definition, &Monitor)>,
    now_ms: i64,
) -> GroupTableRow {
    let (sessions, course) = judged(practice, standard, trainee.handedness, now_ms);
    let counted: Vec<Numbered<'_>> = sessions.into_iter().filter(|session| session.counts).collect();
    let target = standard.and_then(|(definition, _)| definition.target(of));
    let mut points = points(of, &counted, target, trainee.handedness);
    points.retain(|point| point.value.is_some());
    points.drain(..points.len().saturating_sub(SPARK));
    let newest = points.last().and_then(|point| counted.iter().find(|session| session.number == point.session));
    GroupTableRow {
        trainee: trainee.id,
        sessions: course.earlier + course.sessions.len(),
        last_at: course.sessions.last().map(|step| step.recorded_at.clone()),
        newest: newest.map(|session| session.session.id),
        points,
        rule: course.rule,
        standing: course.charts.map(|charts| charts.standing),
        passed: course.passed.is_some(),
    }
}
