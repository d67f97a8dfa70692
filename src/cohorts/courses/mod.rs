//! Progress in a course: compares each step of the plan with the trainees' sessions, judged as in [`super::progress`].
//! Nothing is stored: each request computes it anew, so erased sessions and people are in no answer.
//!
//! A standard counts as passed even if it was passed before the course began. Practice counts only from the course's
//! first day: a step that asks for sessions asks for sessions during the course.

use serde::Serialize;
use utoipa::ToSchema;

use super::answer::{ProgressAnswer as Judged, RuleStanding, RuleState, StandingName};
use super::progress::{FeatureSelection, ProgressSelection, judge_sessions};
use super::versions::TaskStandards;
use super::{Cohorts, CohortsError};
use crate::domain::named;
use crate::domain::scope::Scope;
use crate::domain::session::SessionStatus;
use crate::domain::text::Key;
use crate::ids::{CourseId, GroupId, SessionId, TaskId, TraineeId};
use crate::store::{
    CourseRecord, CourseStep, GroupCoursePlan, GroupRecord, Practice, PracticeSession, StandardRecord, StoreError,
    TraineeCourse, TraineeRecord, TraineeTask,
};
use crate::time::{Day, to_rfc3339};

/// Limit of rows in a table, so that it stays readable.
const MAX_ROWS: usize = 500;

/// Progress of a group in its course.
#[derive(Debug)]
pub struct GroupCourse {
    /// The group.
    pub group: GroupRecord,
    /// The course that it follows.
    pub course: CourseRecord,
    /// The course's first day.
    pub begins: Day,
    /// Trainees of the group, by name; at most 500.
    pub trainees: Vec<TraineeRecord>,
    /// One row per trainee.
    pub rows: Vec<CourseRow>,
    /// True if the group has more trainees than rows.
    pub more: bool,
}

/// Progress of a trainee in one of their courses.
#[derive(Debug)]
pub struct OwnCourse {
    /// The enrolment: the group that the trainee follows the course with.
    pub of: TraineeCourse,
    /// The course.
    pub course: CourseRecord,
    /// The trainee's progress.
    pub row: CourseRow,
}

/// One trainee's progress in the steps of a course.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct CourseRow {
    /// The trainee.
    pub trainee: TraineeId,
    /// Number, from 1, of the first step that is not passed; `null` if all are passed.
    pub next: Option<usize>,
    /// The steps in the plan's order.
    pub steps: Vec<StepProgress>,
}

/// Progress in a step.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct StepProgress {
    /// Its state.
    pub state: StepState,
    /// Number of sessions so far. For a step that asks for sessions: those since the course began; otherwise all of the
    /// task.
    pub sessions: usize,
    /// How many more sessions or, for a standard, passes under its rule are needed. `null` if none are missing, or if
    /// the number is unknown.
    pub missing: Option<usize>,
    /// The session that passed it; `null` until then.
    pub passed: Option<StepPassed>,
    /// State of the standard's pass rule; `null` without a rule, and for a step that asks for sessions.
    pub rule: Option<RuleState>,
    /// Standing on the standard's charts; `null` for a step that asks for sessions.
    pub standing: Option<StandingName>,
    /// True if it was due before today and is not passed.
    pub overdue: bool,
}

/// When a step was passed.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct StepPassed {
    /// The session that passed it.
    pub session: SessionId,
    /// When that session was recorded.
    #[schema(format = "date-time")]
    pub at: String,
}

named! {
    /// State of a step of a course.
    StepState: "state" {
        /// The step is passed.
        Passed = "passed",
        /// The trainee has sessions, but the step is not passed yet, or no longer after a relapse.
        InWork = "in_work",
        /// The trainee has no session yet.
        NotBegun = "not_begun",
    }
}

/// The steps of a course, its first day, and the time of the request.
#[derive(Clone, Debug)]
struct CourseContext {
    steps: Vec<CourseStep>,
    begins: Day,
    now_ms: i64,
}

impl Cohorts {
    /// Progress of a group in its course.
    pub async fn group_course(&self, scope: &Scope, group: GroupId) -> Result<GroupCourse, CohortsError> {
        let group = self.store.groups().get(scope, group).await?;
        let Some(GroupCoursePlan { course, begins, .. }) = group.follows.clone() else {
            return Err(StoreError::NotFound { what: "course" }.into());
        };
        let course = self.store.courses().get(scope, course).await?;
        let mut trainees = self.store.trainees().of_group(scope, group.id, MAX_ROWS as u32 + 1).await?;
        let more = trainees.len() > MAX_ROWS;
        trainees.truncate(MAX_ROWS);
        let rows = self.course_rows(scope, &course, begins, &trainees).await?;
        Ok(GroupCourse { group, course, begins, trainees, rows, more })
    }

    /// Progress of a trainee in all their courses, the latest first.
    pub async fn own_courses(&self, scope: &Scope, trainee: &Key) -> Result<Vec<OwnCourse>, CohortsError> {
        let trainee = [self.store.trainees().get(scope, trainee).await?];
        let enrolled = self.store.courses().of_trainee(scope, trainee[0].id).await?;
        let ids: Vec<CourseId> = enrolled.iter().map(|of| of.course_id).collect();
        let plans = self.store.courses().of(scope, &ids).await?;
        let mut courses = Vec::with_capacity(enrolled.len());
        for of in enrolled {
            let Some(course) = plans.iter().find(|plan| plan.id == of.course_id).cloned() else { continue };
            let rows = self.course_rows(scope, &course, of.begins, &trainee).await?;
            courses.extend(rows.into_iter().map(|row| OwnCourse { of: of.clone(), course: course.clone(), row }));
        }
        Ok(courses)
    }

    /// The rows of these trainees. It works task by task, so that only one task's sessions of a large group are in
    /// memory.
    async fn course_rows(
        &self,
        scope: &Scope,
        course: &CourseRecord,
        begins: Day,
        trainees: &[TraineeRecord],
    ) -> Result<Vec<CourseRow>, CohortsError> {
        let asking = CourseContext { steps: course.steps.clone(), begins, now_ms: self.clock.now_ms() };
        let mut tasks: Vec<TaskId> = course.steps.iter().map(|step| step.task_id).collect();
        tasks.sort();
        tasks.dedup();
        let standards = self.store.standards().of_tasks(scope, &tasks).await?;
        let mut columns: Vec<Vec<StepProgress>> = vec![Vec::new(); course.steps.len()];
        for task in tasks {
            let versions = standards.iter().filter(|standard| standard.task_id == task).cloned().collect();
            for (at, column) in self.step_columns(scope, &asking, task, versions, trainees).await? {
                columns[at] = column;
            }
        }
        let mut columns: Vec<_> = columns.into_iter().map(Vec::into_iter).collect();
        let row = |trainee: &TraineeRecord| {
            CourseRow::of(trainee.id, columns.iter_mut().filter_map(Iterator::next).collect())
        };
        Ok(trainees.iter().map(row).collect())
    }

    /// Progress in the steps of one task: for each step its index in the plan, and one entry per trainee.
    async fn step_columns(
        &self,
        scope: &Scope,
        asking: &CourseContext,
        task: TaskId,
        versions: Vec<StandardRecord>,
        trainees: &[TraineeRecord],
    ) -> Result<Vec<(usize, Vec<StepProgress>)>, CohortsError> {
        let is_judged = asking.steps.iter().any(|step| step.task_id == task && step.sessions.is_none());
        let (known, now_ms) = (self.cache.clone(), asking.now_ms);
        let versions = if is_judged { versions } else { Vec::new() };
        let standards = self.calculate(move || TaskStandards::of(versions, &known, now_ms)).await?;
        let features = match standards.current() {
            Some(_) => FeatureSelection::of(&ProgressSelection::default(), &standards)?.features(),
            None => Vec::new(),
        };
        let pairs: Vec<TraineeTask> = trainees.iter().map(|of| TraineeTask { trainee: of.id, task }).collect();
        let of_each = self.practices(scope, &pairs, &features).await?;
        let (asking, trainees) = (asking.clone(), trainees.to_vec());
        let calculation = move || {
            let nothing = Practice { earlier: 0, sessions: Vec::new() };
            let of =
                |trainee: &TraineeRecord| of_each.get(&TraineeTask { trainee: trainee.id, task }).unwrap_or(&nothing);
            let judge = |trainee: &TraineeRecord| asking.judge(of(trainee), &standards, trainee);
            let judged: Vec<_> = trainees.iter().map(judge).collect();
            let steps = asking.steps.iter().enumerate().filter(|(_, step)| step.task_id == task);
            let column = |(at, step)| {
                let rows = trainees
                    .iter()
                    .zip(&judged)
                    .map(|(trainee, judged)| asking.step_progress(step, of(trainee), judged));
                (at, rows.collect())
            };
            steps.map(column).collect()
        };
        self.calculate(calculation).await
    }
}

impl CourseRow {
    fn of(trainee: TraineeId, steps: Vec<StepProgress>) -> Self {
        let next = steps.iter().position(|step| step.state != StepState::Passed).map(|at| at + 1);
        Self { trainee, next, steps }
    }
}

impl CourseContext {
    fn judge(&self, practice: &Practice, standards: &TaskStandards, trainee: &TraineeRecord) -> Judged {
        judge_sessions(practice, standards, trainee.handedness, self.now_ms).1
    }

    /// A trainee's progress in a step, from their sessions and the judgement on them.
    fn step_progress(&self, step: &CourseStep, practice: &Practice, judged: &Judged) -> StepProgress {
        let progress = match step.sessions {
            Some(of) => self.progress_by_sessions(of as usize, practice),
            None => progress_by_standard(practice, judged),
        };
        let is_late = step.due(self.begins).is_some_and(|due| due < Day::of(self.now_ms));
        StepProgress { overdue: is_late && progress.passed.is_none(), ..progress }
    }

    /// Progress in a step that asks for sessions. All sessions count as practice, with any result, except sessions that
    /// are still arriving and sessions that are set aside.
    fn progress_by_sessions(&self, asked: usize, practice: &Practice) -> StepProgress {
        let since_ms = self.begins.start_ms();
        let counts = |session: &&PracticeSession| {
            !session.is_uncounted && session.status != SessionStatus::Receiving && session.recorded_at_ms >= since_ms
        };
        let counted: Vec<&PracticeSession> = practice.sessions.iter().filter(counts).collect();
        let last = asked.checked_sub(1).and_then(|last| counted.get(last));
        let passed = last.map(|session| StepPassed { session: session.id, at: to_rfc3339(session.recorded_at_ms) });
        let missing = asked.checked_sub(counted.len()).filter(|missing| *missing > 0);
        StepProgress { missing, ..StepProgress::of(counted.len(), passed) }
    }
}

fn progress_by_standard(practice: &Practice, judged: &Judged) -> StepProgress {
    let practised = practice.sessions.iter().filter(|session| !session.is_uncounted).count();
    let passed = judged.passed.as_ref().and_then(|passed| {
        let session = judged.sessions.iter().find(|step| step.number == passed.session)?;
        Some(StepPassed { session: session.id, at: session.recorded_at.clone() })
    });
    let missing = judged.rule.as_ref().filter(|_| passed.is_none()).and_then(missing_passes);
    StepProgress {
        missing,
        rule: judged.rule.clone(),
        standing: judged.charts.as_ref().map(|charts| charts.standing),
        ..StepProgress::of(practice.earlier + practised, passed)
    }
}

/// The number of passes that an open rule still needs, if all further sessions are passes.
fn missing_passes(RuleState { rule, state, have_in_a_row, have_more, .. }: &RuleState) -> Option<usize> {
    let missing = (rule.in_a_row + rule.then_more).checked_sub((*have_in_a_row)? + (*have_more)?);
    missing.filter(|_| *state == RuleStanding::Open)
}

impl StepProgress {
    fn of(sessions: usize, passed: Option<StepPassed>) -> Self {
        let state = match (&passed, sessions) {
            (Some(_), _) => StepState::Passed,
            (None, 0) => StepState::NotBegun,
            (None, _) => StepState::InWork,
        };
        Self { state, sessions, missing: None, passed, rule: None, standing: None, overdue: false }
    }
}

#[cfg(test)]
mod tests;
