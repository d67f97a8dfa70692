//! How far people have come in a course: each step of its plan held against their sessions, as progress judges them
//! ([`super::progress`]). Nothing of it is kept: it is worked out when it is asked, so an erased session or person is in no answer.
//!
//! What somebody can do counts whenever they learnt it: a standard that was passed before the course began is passed. Practice counts
//! from the course's first day on: a step that asks for sessions asks for sessions of this course.

use serde::Serialize;
use utoipa::ToSchema;

use super::answer::{Course as Judged, RuleStanding, RuleState, StandingName};
use super::progress::{Asked, Shown, judged};
use super::{Cohorts, CohortsError};
use crate::domain::named;
use crate::domain::scope::Scope;
use crate::domain::session::SessionStatus;
use crate::domain::standard::Definition;
use crate::domain::text::Key;
use crate::ids::{CourseId, GroupId, SessionId, TaskId, TraineeId};
use crate::pipeline::score::lc_cusum::Monitor;
use crate::store::{
    Course, CourseStep, Enrolled, Followed, Group, Practice, Practised, Standard, StoreError, Trained, Trainee,
};
use crate::time::{Day, to_rfc3339};

/// Rows of a table: more of them nobody reads.
const MOST_ROWS: usize = 500;

/// How a group has come through its course.
#[derive(Debug)]
pub struct GroupCourse {
    /// Which group.
    pub group: Group,
    /// What it follows.
    pub course: Course,
    /// The course's first day.
    pub begins: Day,
    /// Who is in it, by name; at most 500.
    pub trainees: Vec<Trainee>,
    /// One row for each of them.
    pub rows: Vec<CourseRow>,
    /// Are there more trainees in the group than rows?
    pub more: bool,
}

/// How a trainee has come through one of their courses.
#[derive(Debug)]
pub struct OwnCourse {
    /// By which group.
    pub of: Enrolled,
    /// What it asks for.
    pub course: Course,
    /// How far they are.
    pub row: CourseRow,
}

/// One trainee's way through the steps.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct CourseRow {
    /// Who.
    pub trainee: TraineeId,
    /// Number, from 1, of the first step that is not passed; `null`: all are.
    pub next: Option<usize>,
    /// How each step stands, in the plan's order.
    pub steps: Vec<StepProgress>,
}

/// How a step stands.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct StepProgress {
    /// How.
    pub state: StepState,
    /// Sessions so far: of a step that asks for sessions, those since the course began; otherwise all of the task.
    pub sessions: usize,
    /// How many more it takes: sessions, or of a standard passed ones by its rule. `null` where nothing is missing, and where the
    /// rule does not tell.
    pub missing: Option<usize>,
    /// By which session it was passed; `null` as long as it is not.
    pub passed: Option<StepPassed>,
    /// How far by the standard's pass rule; `null` without one, and where sessions are asked for.
    pub rule: Option<RuleState>,
    /// How they stand by the standard's charts; `null` where sessions are asked for.
    pub standing: Option<StandingName>,
    /// Was it due before today, and is it not passed?
    pub overdue: bool,
}

/// When a step was passed.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct StepPassed {
    /// The session by which it was.
    pub session: SessionId,
    /// When that was recorded.
    #[schema(format = "date-time")]
    pub at: String,
}

named! {
    /// How a step of a course stands.
    StepState: "state" {
        /// What it asks for is done.
        Passed = "passed",
        /// Trained, and not passed: not yet, or not any more.
        InWork = "in_work",
        /// Not trained yet.
        NotBegun = "not_begun",
    }
}

/// What a course asks of people, and when it is asked.
#[derive(Clone, Debug)]
struct Asking {
    steps: Vec<CourseStep>,
    begins: Day,
    now_ms: i64,
}

impl Cohorts {
    /// How a group has come through its course.
    pub async fn group_course(&self, scope: &Scope, group: GroupId) -> Result<GroupCourse, CohortsError> {
        let group = self.store.groups().get(scope, group).await?;
        let Some(Followed { course, begins, .. }) = group.follows.clone() else {
            return Err(StoreError::NotFound { what: "course" }.into());
        };
        let course = self.store.courses().get(scope, course).await?;
        let mut trainees = self.store.trainees().of_group(scope, group.id, MOST_ROWS as u32 + 1).await?;
        let more = trainees.len() > MOST_ROWS;
        trainees.truncate(MOST_ROWS);
        let rows = self.way(scope, &course, begins, &trainees).await?;
        Ok(GroupCourse { group, course, begins, trainees, rows, more })
    }

    /// How a trainee has come through the courses that they are in, the latest first.
    pub async fn own_courses(&self, scope: &Scope, trainee: &Key) -> Result<Vec<OwnCourse>, CohortsError> {
        let trainee = [self.store.trainees().get(scope, trainee).await?];
        let enrolled = self.store.courses().of_trainee(scope, trainee[0].id).await?;
        let ids: Vec<CourseId> = enrolled.iter().map(|of| of.course_id).collect();
        let plans = self.store.courses().of(scope, &ids).await?;
        let mut courses = Vec::with_capacity(enrolled.len());
        for of in enrolled {
            let Some(course) = plans.iter().find(|plan| plan.id == of.course_id).cloned() else { continue };
            let rows = self.way(scope, &course, of.begins, &trainee).await?;
            courses.extend(rows.into_iter().map(|row| OwnCourse { of: of.clone(), course: course.clone(), row }));
        }
        Ok(courses)
    }

    /// The rows of these trainees. Task by task, and not all at once: a large group's sessions of one task are what is held at a time.
    async fn way(
        &self,
        scope: &Scope,
        course: &Course,
        begins: Day,
        trainees: &[Trainee],
    ) -> Result<Vec<CourseRow>, CohortsError> {
        let asking = Asking { steps: course.steps.clone(), begins, now_ms: self.clock.now_ms() };
        let mut tasks: Vec<TaskId> = course.steps.iter().map(|step| step.task_id).collect();
        tasks.sort();
        tasks.dedup();
        let standards = self.store.standards().in_use_of(scope, &tasks).await?;
        let mut columns: Vec<Vec<StepProgress>> = vec![Vec::new(); course.steps.len()];
        for task in tasks {
            let standard = standards.iter().find(|standard| standard.task_id == task);
            for (at, column) in self.columns(scope, &asking, task, standard, trainees).await? {
                columns[at] = column;
            }
        }
        let mut columns: Vec<_> = columns.into_iter().map(Vec::into_iter).collect();
        let row =
            |trainee: &Trainee| CourseRow::of(trainee.id, columns.iter_mut().filter_map(Iterator::next).collect());
        Ok(trainees.iter().map(row).collect())
    }

    /// How the steps of one task stand, each with its place in the plan, in the order of the trainees.
    async fn columns(
        &self,
        scope: &Scope,
        asking: &Asking,
        task: TaskId,
        standard: Option<&Standard>,
        trainees: &[Trainee],
    ) -> Result<Vec<(usize, Vec<StepProgress>)>, CohortsError> {
        let is_judged = asking.steps.iter().any(|step| step.task_id == task && step.sessions.is_none());
        let definition = standard.filter(|_| is_judged).map(|standard| standard.definition.clone());
        let names = match &definition {
            Some(definition) => Shown::of(&Asked::default(), Some(definition))?.names(),
            None => Vec::new(),
        };
        let pairs: Vec<Trained> = trainees.iter().map(|of| Trained { trainee: of.id, task }).collect();
        let of_each = self.practices(scope, &pairs, &names).await?;
        let (known, asking, trainees) = (self.known.clone(), asking.clone(), trainees.to_vec());
        let calculation = move || {
            let monitor = definition.as_ref().and_then(|definition| known.charts(definition.charts).ok());
            let standard = definition.as_ref().zip(monitor.as_deref());
            let nothing = Practice { earlier: 0, sessions: Vec::new() };
            let of = |trainee: &Trainee| of_each.get(&Trained { trainee: trainee.id, task }).unwrap_or(&nothing);
            let judged: Vec<_> = trainees.iter().map(|of_whom| asking.judged(of(of_whom), standard, of_whom)).collect();
            let steps = asking.steps.iter().enumerate().filter(|(_, step)| step.task_id == task);
            let column = |(at, step)| {
                let told = trainees.iter().zip(&judged).map(|(trainee, told)| asking.told(step, of(trainee), told));
                (at, told.collect())
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

impl Asking {
    fn judged(&self, practice: &Practice, standard: Option<(&Definition, &Monitor)>, whom: &Trainee) -> Judged {
        judged(practice, standard, whom.handedness, self.now_ms).1
    }

    /// How a step stands for somebody who has practised so and is judged so.
    fn told(&self, step: &CourseStep, practice: &Practice, judged: &Judged) -> StepProgress {
        let told = match step.sessions {
            Some(of) => self.by_sessions(of as usize, practice),
            None => by_standard(practice, judged),
        };
        let is_late = step.due(self.begins).is_some_and(|due| due < Day::of(self.now_ms));
        StepProgress { overdue: is_late && told.passed.is_none(), ..told }
    }

    /// A session that is still arriving is none yet, and what somebody has set aside is none any more; whatever else became of it,
    /// practice is practice.
    fn by_sessions(&self, asked: usize, practice: &Practice) -> StepProgress {
        let since_ms = self.begins.begins_ms();
        let counts = |session: &&Practised| {
            !session.is_set_aside && session.status != SessionStatus::Receiving && session.recorded_at_ms >= since_ms
        };
        let counted: Vec<&Practised> = practice.sessions.iter().filter(counts).collect();
        let last = asked.checked_sub(1).and_then(|last| counted.get(last));
        let passed = last.map(|session| StepPassed { session: session.id, at: to_rfc3339(session.recorded_at_ms) });
        let missing = asked.checked_sub(counted.len()).filter(|missing| *missing > 0);
        StepProgress { missing, ..StepProgress::of(counted.len(), passed) }
    }
}

fn by_standard(practice: &Practice, judged: &Judged) -> StepProgress {
    let practised = practice.sessions.iter().filter(|session| !session.is_set_aside).count();
    let passed = judged.passed.as_ref().and_then(|passed| {
        let session = judged.sessions.iter().find(|step| step.number == passed.session)?;
        Some(StepPassed { session: session.id, at: session.recorded_at.clone() })
    });
    let missing = judged.rule.as_ref().filter(|_| passed.is_none()).and_then(missing);
    StepProgress {
        missing,
        rule: judged.rule.clone(),
        standing: judged.charts.as_ref().map(|charts| charts.standing),
        ..StepProgress::of(practice.earlier + practised, passed)
    }
}

/// The passes that an open rule still takes, if all that follow are passes.
fn missing(RuleState { rule, state, have_in_a_row, have_more, .. }: &RuleState) -> Option<usize> {
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
