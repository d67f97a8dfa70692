//! Course plans, and which groups follow one. Administrators and the instructors of its groups change a plan; people see
//! all of them. A group's instructors choose the plan that it follows. There is no personal data here.

use std::collections::HashMap;

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreError, StoreResult, in_use, missing, not_found, taken};
use super::owners::{self, OwnedThing, require_owner};
use super::page::{Page, PageRequest};
use super::visibility::{BindScope, require_staff};
use super::{Scope, Store};
use crate::domain::course::{NewCourse, NewStep};
use crate::domain::text::{Code, Name};
use crate::ids::{CourseId, GroupId, TaskId, TraineeId};
use crate::time::Day;

/// Access to the course plans.
pub struct CourseStore<'s>(pub(super) &'s Store);

/// A course plan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CourseRecord {
    /// Its id.
    pub id: CourseId,
    /// What people call it.
    pub name: Name,
    /// Its steps, in order.
    pub steps: Vec<CourseStep>,
    /// When it was made, epoch ms.
    pub created_at_ms: i64,
    /// Those of its groups that the scope sees.
    pub owners: Vec<GroupId>,
}

/// A step of a course plan.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct CourseStep {
    /// The task to practise.
    pub task_id: TaskId,
    /// The task's code.
    pub task_code: Code,
    /// The task's name.
    pub task_name: Name,
    /// Deadline, days after the beginning of the course, if there is one.
    pub within_days: Option<u32>,
    /// Number of sessions to do; `None`: the task's standard must be passed.
    pub sessions: Option<u32>,
}

impl CourseStep {
    /// The last day in time for a course that begins on this day, if there is a deadline.
    pub fn due(&self, begins: Day) -> Option<Day> {
        self.within_days.map(|days| begins.plus_days(days))
    }
}

/// The plan that a group follows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GroupCoursePlan {
    /// The plan.
    pub course: CourseId,
    /// The plan's name.
    pub name: Name,
    /// The course's first day.
    pub begins: Day,
}

/// A course that a trainee takes as a member of one of their groups.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct TraineeCourse {
    /// The group.
    pub group_id: GroupId,
    /// The group's name.
    pub group_name: Name,
    /// The plan that the group follows.
    pub course_id: CourseId,
    /// The course's first day.
    pub begins: Day,
}

#[derive(sqlx::FromRow)]
struct CourseHeadRow {
    id: CourseId,
    name: Name,
    created_at_ms: i64,
    #[sqlx(json)]
    owners: Vec<GroupId>,
}

#[derive(sqlx::FromRow)]
struct CourseStepRow {
    course_id: CourseId,
    #[sqlx(flatten)]
    step: CourseStep,
}

const INSERT_COURSE: &str = "INSERT INTO course (id, name, created_at_ms) VALUES ($1, $2, $3)";

const SELECT_COURSES: &str = "
    SELECT id, name, created_at_ms,
           (SELECT json_group_array(group_id) FROM ownership
            WHERE thing_id = course.id
              AND ($1 = 'administrator'
                   OR group_id IN (SELECT group_id FROM group_instructor WHERE person_id = $2))) AS owners
    FROM course
    WHERE $1 <> 'agent' AND ($3 IS NULL OR name > $3) ORDER BY name LIMIT $4";

const SELECT_NAMED_COURSES: &str = "
    SELECT id, name, created_at_ms,
           (SELECT json_group_array(group_id) FROM ownership
            WHERE thing_id = course.id
              AND ($1 = 'administrator'
                   OR group_id IN (SELECT group_id FROM group_instructor WHERE person_id = $2))) AS owners
    FROM course
    WHERE id IN (SELECT value FROM json_each($3)) AND $1 <> 'agent' ORDER BY name";

const UPDATE_COURSE: &str = "UPDATE course SET name = $2 WHERE id = $1";

const DELETE_STEPS: &str = "DELETE FROM course_step WHERE course_id = $1";

const DELETE_COURSE: &str = "DELETE FROM course WHERE id = $1";

const SET_GROUP_COURSE: &str = "
    INSERT INTO group_course (group_id, course_id, begins)
    VALUES ($1, $2, $3)
    ON CONFLICT (group_id) DO UPDATE SET course_id = excluded.course_id, begins = excluded.begins";

const DELETE_GROUP_COURSE: &str = "DELETE FROM group_course WHERE group_id = $1";

const SELECT_TRAINEE_COURSES: &str = "
    SELECT group_course.group_id, training_group.name AS group_name, course_id, begins
    FROM group_trainee
    JOIN group_course ON group_course.group_id = group_trainee.group_id
    JOIN training_group ON training_group.id = group_trainee.group_id
    WHERE group_trainee.trainee_id = $3
      AND ($1 = 'administrator' OR ($1 = 'trainee' AND $2 = $3)
           OR ($1 = 'instructor' AND EXISTS (SELECT 1 FROM group_instructor
               WHERE group_instructor.group_id = group_trainee.group_id AND person_id = $2)))
    ORDER BY begins DESC, group_name";

const SELECT_STEPS: &str = "
    SELECT course_id, task_id, task.code AS task_code, task.name AS task_name, within_days, sessions
    FROM course_step
    JOIN task ON task.id = task_id
    WHERE course_id IN (SELECT value FROM json_each($1)) ORDER BY course_id, position";

const SELECT_STEP_TASK: &str = "
    SELECT id, name, EXISTS (SELECT 1 FROM standard WHERE task_id = task.id) FROM task WHERE $1 IN (id, code)";

const INSERT_STEP: &str = "
    INSERT INTO course_step (course_id, position, task_id, within_days, sessions) VALUES ($1, $2, $3, $4, $5)";

impl CourseStore<'_> {
    /// Creates a plan.
    pub async fn create(&self, scope: &Scope, new: NewCourse) -> StoreResult<CourseRecord> {
        require_staff(scope, "making course plans")?;
        let (by, now_ms, id) = (scope.clone(), self.0.now_ms(), CourseId::at(self.0.now_ms()));
        self.0
            .write(async move |tx| {
                let insert = sqlx::query(INSERT_COURSE);
                let insert = insert.bind(id).bind(&new.name).bind(now_ms).execute(&mut *tx);
                insert.await.map_err(taken("course's name"))?;
                set_steps(tx, id, &new.steps).await?;
                owners::insert(tx, &by, OwnedThing::Course(id), new.groups).await?;
                note(tx, &by, now_ms, ("create", "course"), id).await
            })
            .await?;
        self.get(scope, id).await
    }

    /// All plans, by name.
    pub async fn list(&self, scope: &Scope, page: &PageRequest) -> StoreResult<Page<CourseRecord>> {
        let rows = sqlx::query_as::<_, CourseHeadRow>(SELECT_COURSES);
        let rows = rows.bind_scope(scope).bind(page.after()).bind(page.row_limit()).fetch_all(self.0.readers()).await?;
        let Page { items, next } = Page::from_rows(rows, page, |row| row.name.to_string());
        Ok(Page { items: self.with_steps(items).await?, next })
    }

    /// One plan.
    pub async fn get(&self, scope: &Scope, id: CourseId) -> StoreResult<CourseRecord> {
        self.of(scope, &[id]).await?.pop().ok_or(not_found("course"))
    }

    /// These plans, by name.
    pub async fn of(&self, scope: &Scope, ids: &[CourseId]) -> StoreResult<Vec<CourseRecord>> {
        let rows = sqlx::query_as::<_, CourseHeadRow>(SELECT_NAMED_COURSES);
        let rows = rows.bind_scope(scope).bind(Json(ids)).fetch_all(self.0.readers()).await?;
        self.with_steps(rows).await
    }

    /// One plan that the scope may change.
    pub async fn changeable(&self, scope: &Scope, id: CourseId) -> StoreResult<CourseRecord> {
        let found = self.get(scope, id).await?;
        require_owner(scope, &found.owners, "changing this course plan")?;
        Ok(found)
    }

    /// Replaces a plan's name and steps; groups that follow it follow the new version.
    pub async fn replace(&self, scope: &Scope, id: CourseId, new: NewCourse) -> StoreResult<CourseRecord> {
        self.changeable(scope, id).await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let update = sqlx::query(UPDATE_COURSE).bind(id).bind(&new.name);
                let updated = update.execute(&mut *tx).await.map_err(taken("course's name"))?;
                if updated.rows_affected() == 0 {
                    return Err(not_found("course"));
                }
                sqlx::query(DELETE_STEPS).bind(id).execute(&mut *tx).await?;
                set_steps(tx, id, &new.steps).await?;
                if let Some(groups) = new.groups {
                    owners::replace(tx, &by, OwnedThing::Course(id), groups).await?;
                }
                note(tx, &by, now_ms, ("change", "course"), id).await
            })
            .await?;
        self.get(scope, id).await
    }

    /// Deletes a plan that no group follows.
    pub async fn delete(&self, scope: &Scope, id: CourseId) -> StoreResult<()> {
        self.changeable(scope, id).await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let delete = sqlx::query(DELETE_COURSE).bind(id).execute(&mut *tx);
                if delete.await.map_err(in_use("course plan", "groups"))?.rows_affected() == 0 {
                    return Err(not_found("course"));
                }
                note(tx, &by, now_ms, ("delete", "course"), id).await
            })
            .await
    }

    /// Makes a group in the scope follow a plan from a day on, in place of its present plan.
    pub async fn follow(&self, scope: &Scope, group: GroupId, course: CourseId, begins: Day) -> StoreResult<()> {
        self.require_group(scope, group, "setting a group's course").await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let set = sqlx::query(SET_GROUP_COURSE);
                let set = set.bind(group).bind(course).bind(begins).execute(&mut *tx);
                set.await.map_err(missing("course"))?;
                note(tx, &by, now_ms, ("set course", "group"), group).await
            })
            .await
    }

    /// Ends a group's course.
    pub async fn unfollow(&self, scope: &Scope, group: GroupId) -> StoreResult<()> {
        self.require_group(scope, group, "ending a group's course").await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let delete = sqlx::query(DELETE_GROUP_COURSE).bind(group);
                if delete.execute(&mut *tx).await?.rows_affected() == 0 {
                    return Err(not_found("course"));
                }
                note(tx, &by, now_ms, ("end course", "group"), group).await
            })
            .await
    }

    /// The courses of a trainee, latest first: those of all their groups, or for an instructor those of the groups that
    /// they teach. The caller has checked that the scope sees the trainee.
    pub async fn of_trainee(&self, scope: &Scope, trainee: TraineeId) -> StoreResult<Vec<TraineeCourse>> {
        let rows = sqlx::query_as(SELECT_TRAINEE_COURSES);
        Ok(rows.bind_scope(scope).bind(trainee).fetch_all(self.0.readers()).await?)
    }

    async fn require_group(&self, scope: &Scope, group: GroupId, what: &'static str) -> StoreResult<()> {
        require_staff(scope, what)?;
        self.0.groups().get(scope, group).await.map(drop)
    }

    async fn with_steps(&self, rows: Vec<CourseHeadRow>) -> StoreResult<Vec<CourseRecord>> {
        let ids: Vec<CourseId> = rows.iter().map(|row| row.id).collect();
        let steps = sqlx::query_as::<_, CourseStepRow>(SELECT_STEPS);
        let mut of_each: HashMap<CourseId, Vec<CourseStep>> = HashMap::with_capacity(rows.len());
        for CourseStepRow { course_id, step } in steps.bind(Json(ids)).fetch_all(self.0.readers()).await? {
            of_each.entry(course_id).or_default().push(step);
        }
        let with = |CourseHeadRow { id, name, created_at_ms, owners }| CourseRecord {
            id,
            name,
            steps: of_each.remove(&id).unwrap_or_default(),
            created_at_ms,
            owners,
        };
        Ok(rows.into_iter().map(with).collect())
    }
}

/// Writes a plan's steps. A step that requires a standard is refused unless the task has one; it will stay, since
/// standards are never deleted.
async fn set_steps(tx: &mut SqliteConnection, id: CourseId, steps: &[NewStep]) -> StoreResult<()> {
    for (position, step) in (0_i64..).zip(steps) {
        let number = position + 1;
        let task = sqlx::query_as::<_, (TaskId, Name, bool)>(SELECT_STEP_TASK);
        let task = task.bind(&step.task).fetch_optional(&mut *tx).await?;
        let (task, name, has_standard) = task.ok_or(not_found("task"))?;
        if step.sessions.is_none() && !has_standard {
            return Err(StoreError::refused(format!(
                "step {number}: “{name}” has no standard to pass yet: set one, or require a number of sessions"
            )));
        }
        let insert = sqlx::query(INSERT_STEP);
        let insert = insert.bind(id).bind(position).bind(task).bind(step.within_days).bind(step.sessions);
        insert.execute(&mut *tx).await.map_err(|error| duplicate_step(error, number, &name))?;
    }
    Ok(())
}

fn duplicate_step(error: sqlx::Error, number: i64, task: &Name) -> StoreError {
    match error.as_database_error() {
        Some(found) if found.is_unique_violation() => StoreError::refused(format!(
            "step {number}: an earlier step requires the same of “{task}”: remove one of the two, or require more \
             sessions"
        )),
        _ => error.into(),
    }
}
