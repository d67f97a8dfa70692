//! A group's table at one task. Sessions are judged as in [`super::progress`]; learning curves and ranks are only
//! computed there.

use std::collections::{BTreeSet, HashMap};

use serde::Serialize;
use utoipa::ToSchema;

use super::answer::{RuleState, SeriesPoint, StandingName};
use super::progress::{FeatureSelection, MAX_SESSIONS, ProgressSelection, judge_sessions};
use super::series::{NumberedSession, points};
use super::versions::TaskStandards;
use super::{Cohorts, CohortsError, unknown_field};
use crate::domain::feature::FeatureKey;
use crate::domain::scope::Scope;
use crate::domain::standard::Target;
use crate::domain::text::Invalid;
use crate::ids::{GroupId, SessionId, TraineeId};
use crate::motion::features::Feature;
use crate::store::{GroupRecord, Practice, StandardRecord, TaskRecord, TraineeRecord, TraineeTask};

/// Limit of rows in a table, so that it stays readable.
const MAX_ROWS: usize = 500;

/// Limit of points in a sparkline: the last sessions.
const MAX_SPARKLINE_POINTS: usize = 30;

/// A group's table with the objects that it refers to.
#[derive(Debug)]
pub struct GroupTableAnswer {
    /// The group.
    pub group: GroupRecord,
    /// The task.
    pub task: TaskRecord,
    /// The task's standard.
    pub standard: Option<StandardRecord>,
    /// The feature and its rows.
    pub table: GroupTable,
    /// The trainees of the rows, by name.
    pub trainees: Vec<TraineeRecord>,
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
    pub points: Vec<SeriesPoint>,
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
    pub async fn group_table(
        &self,
        scope: &Scope,
        group: GroupId,
        asked: ProgressSelection,
    ) -> Result<GroupTableAnswer, CohortsError> {
        let group = self.store.groups().get(scope, group).await?;
        let Some(task) = &asked.task else {
            return Err(Invalid::new("task", "is missing: name one").into());
        };
        let task = self.store.tasks().get(scope, task).await.map_err(unknown_field("task"))?;
        let (standards, standard) = self.task_standards(scope, task.id).await?;
        let mut trainees = self.store.trainees().of_group(scope, group.id, MAX_ROWS as u32 + 1).await?;
        let more = trainees.len() > MAX_ROWS;
        trainees.truncate(MAX_ROWS);
        let pairs: Vec<TraineeTask> = trainees.iter().map(|of| TraineeTask { trainee: of.id, task: task.id }).collect();
        let shown = FeatureSelection::of(&asked, &standards)?;
        let of_each = self.practices(scope, &pairs, &shown.features()).await?;
        let now_ms = self.clock.now_ms();
        let (at, trained) = (task.id, trainees.clone());
        let calculation = move || {
            let keys = shown.keys(of_each.values());
            let of = keys.first().cloned().unwrap_or_else(|| shown.default_key());
            let sessions = of_each.values().flat_map(|practice| &practice.sessions);
            let measured = sessions.flat_map(|session| &session.measured).map(|measured| &measured.of);
            let alike = measured.filter(|key| key.feature == of.feature && key.space == of.space);
            let tools: BTreeSet<&String> = alike.filter_map(|key| key.tool.as_ref()).collect();
            let tools = tools.into_iter().cloned().collect();
            let nothing = Practice { earlier: 0, sessions: Vec::new() };
            let rows = trained.iter().map(|trainee| {
                let practice = of_each.get(&TraineeTask { trainee: trainee.id, task: at }).unwrap_or(&nothing);
                table_row(trainee, &of, practice, &standards, now_ms)
            });
            let rows = rows.collect();
            let target = standards.current().and_then(|version| version.definition.target(&of)).cloned();
            GroupTable {
                title: of.feature.title,
                unit: of.feature.unit,
                better: of.feature.direction.name(),
                of,
                target,
                tools,
                rows,
                more,
            }
        };
        let table = self.calculate(calculation).await?;
        Ok(GroupTableAnswer { group, task, standard, table, trainees })
    }

    pub(super) async fn practices(
        &self,
        scope: &Scope,
        of: &[TraineeTask],
        features: &[&'static Feature],
    ) -> Result<HashMap<TraineeTask, Practice>, CohortsError> {
        Ok(self.store.sessions().practice_of_many(scope, of, features, MAX_SESSIONS).await?)
    }
}

fn table_row(
    trainee: &TraineeRecord,
    of: &FeatureKey,
    practice: &Practice,
    standards: &TaskStandards,
    now_ms: i64,
) -> GroupTableRow {
    let (sessions, course) = judge_sessions(practice, standards, trainee.handedness, now_ms);
    let counted: Vec<NumberedSession<'_>> = sessions.into_iter().filter(|session| session.counts).collect();
    let mut points = points(of, &counted, standards);
    points.retain(|point| point.value.is_some());
    points.drain(..points.len().saturating_sub(MAX_SPARKLINE_POINTS));
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
