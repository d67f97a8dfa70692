//! A group's table at one task. Sessions are judged as in [`super::progress`]; learning curves and ranks are only
//! computed there.

use std::collections::{BTreeSet, HashMap};

use serde::Serialize;
use utoipa::ToSchema;

use super::answer::{Point, RuleState, StandingName};
use super::progress::{Asked, MOST_SESSIONS, Shown, judged};
use super::series::{Numbered, points};
use super::{Cohorts, CohortsError, named};
use crate::domain::feature::FeatureKey;
use crate::domain::scope::Scope;
use crate::domain::standard::{Definition, Target};
use crate::domain::text::Invalid;
use crate::ids::{GroupId, SessionId, TraineeId};
use crate::pipeline::features::find;
use crate::pipeline::score::lc_cusum::Monitor;
use crate::store::{Group, Practice, Standard, Task, Trained, Trainee};

/// Limit of rows in a table, so that it stays readable.
const MOST_ROWS: usize = 500;

/// Limit of points in a sparkline: the last sessions.
const SPARK: usize = 30;

/// A group's table with the objects that it refers to.
#[derive(Debug)]
pub struct TableFound {
    /// The group.
    pub group: Group,
    /// The task.
    pub task: Task,
    /// The task's standard.
    pub standard: Option<Standard>,
    /// The feature and its rows.
    pub table: GroupTable,
    /// The trainees of the rows, by name.
    pub trainees: Vec<Trainee>,
}

/// One feature over a group's trainees.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct GroupTable {
    /// The feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// Its title for people.
    pub title: &'static str,
    /// Its unit; `1` for shares, counts and ratios.
    pub unit: &'static str,
    /// What is better: `lower`, `higher` or `neither`.
    pub better: &'static str,
    /// The standard's limit for it; `null` without a limit.
    pub target: Option<Target>,
    /// The tools that have this feature in any of the sessions; empty for a feature of the whole session.
    pub tools: Vec<String>,
    /// One row per trainee, by name; at most 500.
    pub rows: Vec<GroupTableRow>,
    /// True if the group has more trainees than rows.
    pub more: bool,
}

/// One trainee's row.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct GroupTableRow {
    /// The trainee.
    pub trainee: TraineeId,
    /// Number of their sessions of the task.
    pub sessions: usize,
    /// When the last session was recorded; `null` without sessions.
    #[schema(format = "date-time")]
    pub last_at: Option<String>,
    /// Their last counted values, at most thirty, oldest first.
    pub points: Vec<Point>,
    /// The session of the last of these points.
    pub newest: Option<SessionId>,
    /// State of the standard's pass rule; `null` without a rule.
    pub rule: Option<RuleState>,
    /// Standing on the charts; `null` without a standard.
    pub standing: Option<StandingName>,
    /// True if the task is passed.
    pub passed: bool,
}

impl Cohorts {
    /// The table of a group's trainees at a task, for one feature.
    pub async fn table(&self, scope: &Scope, group: GroupId, asked: Asked) -> Result<TableFound, CohortsError> {
        let group = self.store.groups().get(scope, group).await?;
        let Some(task) = &asked.task else {
            return Err(Invalid::new("task", "is missing: name one").into());
        };
        let task = self.store.tasks().get(scope, task).await.map_err(named("task"))?;
        let standard = self.store.standards().in_use(scope, task.id).await?;
        let mut trainees = self.store.trainees().of_group(scope, group.id, MOST_ROWS as u32 + 1).await?;
        let more = trainees.len() > MOST_ROWS;
        trainees.truncate(MOST_ROWS);
        let pairs: Vec<Trained> = trainees.iter().map(|of| Trained { trainee: of.id, task: task.id }).collect();
        let shown = Shown::of(&asked, standard.as_ref().map(|standard| &standard.definition))?;
        let of_each = self.practices(scope, &pairs, &shown.names()).await?;
        let definition = standard.as_ref().map(|standard| standard.definition.clone().without_fingerprints());
        let (known, now_ms) = (self.known.clone(), self.clock.now_ms());
        let (at, trained) = (task.id, trainees.clone());
        let calculation = move || {
            let keys = shown.keys(of_each.values());
            let of = keys.first().cloned().unwrap_or_else(|| shown.usual());
            let sessions = of_each.values().flat_map(|practice| &practice.sessions);
            let measured = sessions.flat_map(|session| &session.measured).map(|measured| &measured.of);
            let alike = measured.filter(|key| key.feature == of.feature && key.space == of.space);
            let tools: BTreeSet<&String> = alike.filter_map(|key| key.tool.as_ref()).collect();
            let tools = tools.into_iter().cloned().collect();
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
                more,
            }
        };
        let table = self.calculate(calculation).await?;
        Ok(TableFound { group, task, standard, table, trainees })
    }

    pub(super) async fn practices(
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
