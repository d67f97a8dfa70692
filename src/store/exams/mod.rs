//! Exams: planned by staff, started by an examiner, closed with a result that never changes.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | exams: plan, read, start, cancel, close |
//! | `attempts.rs` | attempts: ordered, begun by their recording, judged, completed or broken off, voided |
//! | `check.rs` | whether closed exams have the result that their attempts give |
//! | `seal.rs` | what trainees do not see of an exam that is not closed, and what is never edited |

mod attempts;
mod check;
mod seal;

use std::collections::HashMap;

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::{note, note_attempt};
use super::consents::require_consent;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::page::{Page, PageRequest};
use super::visibility::{BindScope, require_staff, require_trainee};
use super::{Scope, Store};
use crate::domain::exam::{
    AttemptCause, AttemptCompletion, AttemptOutcome, AttemptState, CountedAttempt, ExamResult, ExamState,
    IdentityCheck, JudgedFigure, result_of,
};
use crate::domain::job::JobState;
use crate::domain::text::{Code, Name, Remark};
use crate::ids::{BoxId, ExamId, FeedId, PersonId, SelfTestId, SessionId, StandardId, TaskId, TraineeId};
use crate::time::Day;

pub use attempts::WaitingAttempt;
pub(super) use attempts::{begin_attempt, bind_session, judge_attempt};
pub(super) use check::wrong_exams;
pub use seal::{ExamOfSession, SealedSubject};
pub(super) use seal::{refuse_if_of_exam, refuse_if_running, refuse_if_twin};

/// Most exams of one trainee.
const MAX_OF_TRAINEE: i64 = 500;

/// Access to the exams.
pub struct ExamStore<'s>(pub(super) &'s Store);

/// What is fixed when an exam is planned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlannedExam {
    /// The candidate.
    pub trainee: TraineeId,
    /// The task.
    pub task: TaskId,
    /// The box.
    pub in_box: BoxId,
    /// The version of the standard that judges it.
    pub standard: StandardId,
    /// How many attempts the candidate has.
    pub attempts: u32,
    /// The day on which it is to be held.
    pub day: Option<Day>,
}

/// An exam.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct ExamRecord {
    /// Its id.
    pub id: ExamId,
    /// The candidate.
    pub trainee_id: TraineeId,
    /// Name of the candidate.
    pub trainee_name: Name,
    /// Code of the candidate.
    pub trainee_code: Code,
    /// The task.
    pub task_id: TaskId,
    /// Name of the task.
    pub task_name: Name,
    /// Code of the task.
    pub task_code: Code,
    /// The box.
    pub box_id: BoxId,
    /// Name of the box.
    pub box_name: Name,
    /// Code of the box.
    pub box_code: Code,
    /// The version of the standard that judges it.
    pub standard_id: StandardId,
    /// Its number within the task.
    pub standard_version: i64,
    /// How many attempts the candidate has.
    pub attempts: u32,
    /// The day on which it is to be held.
    pub day: Option<Day>,
    /// Its state.
    pub state: ExamState,
    /// Name of the person who planned it; `None` if the account was deleted.
    pub planned_by: Option<Name>,
    /// When, epoch ms.
    pub planned_at_ms: i64,
    /// How the examiner confirmed who the candidate is; `None` before the start.
    pub identity: Option<IdentityCheck>,
    /// Name of the examiner; `None` before the start.
    pub examiner: Option<Name>,
    /// When it was started, epoch ms.
    pub started_at_ms: Option<i64>,
    /// Its result; `None` before it is closed.
    pub result: Option<ExamResult>,
    /// Name of the person who closed or cancelled it.
    pub ended_by: Option<Name>,
    /// When, epoch ms.
    pub ended_at_ms: Option<i64>,
    /// The attempts that have begun, in their order.
    #[sqlx(skip)]
    pub begun: Vec<AttemptRecord>,
}

/// An attempt that has begun, as the scope may see it.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct AttemptRecord {
    /// Its exam.
    pub exam_id: ExamId,
    /// 1, 2, … in the order of beginning.
    pub number: u32,
    /// When it began, epoch ms.
    pub began_at_ms: i64,
    /// Its session; `None` if nothing could be kept, or if it is sealed.
    pub session_id: Option<SessionId>,
    /// What it was judged as.
    pub outcome: Option<AttemptOutcome>,
    /// Why it is undecided.
    pub cause: Option<AttemptCause>,
    /// Version of the measurement that was judged.
    pub pipeline: Option<String>,
    /// The values and limits that were judged.
    #[sqlx(json(nullable))]
    pub figures: Option<Vec<JudgedFigure>>,
    /// When it was judged, epoch ms.
    pub judged_at_ms: Option<i64>,
    /// What the examiner says of it; `None`: not said yet, or sealed.
    pub completion: Option<AttemptCompletion>,
    /// Name of the person who voided it.
    pub voided_by: Option<Name>,
    /// Why it was voided.
    pub void_reason: Option<Remark>,
    /// When, epoch ms; `None`: it counts.
    pub voided_at_ms: Option<i64>,
    is_receiving: bool,
    job_state: Option<JobState>,
    /// True if the caller may not see more yet.
    #[sqlx(skip)]
    is_sealed: bool,
}

impl AttemptRecord {
    /// Where it is.
    pub fn state(&self) -> AttemptState {
        match self.settled() {
            _ if self.is_receiving => AttemptState::Recording,
            _ if self.is_sealed => AttemptState::Sealed,
            Some(_) => AttemptState::Judged,
            None => AttemptState::Scoring,
        }
    }

    /// True if it uses up one of the candidate's attempts.
    pub fn counts(&self) -> bool {
        self.voided_at_ms.is_none()
    }

    /// Its outcome; a recording that cannot be measured, or that nothing measures, has failed. `None` while it is recorded or
    /// measured, and while it is sealed.
    pub fn settled(&self) -> Option<AttemptOutcome> {
        if self.is_receiving || self.is_sealed {
            return None;
        }
        let is_measured = matches!(self.job_state, Some(JobState::Queued | JobState::Running));
        let has_failed = self.session_id.is_none() || !is_measured;
        self.outcome.or(has_failed.then_some(AttemptOutcome::Failed))
    }

    /// As the result of the exam depends on it; `None` while it has no outcome, or the examiner has not said whether it was
    /// completed.
    fn counted(&self) -> Option<CountedAttempt> {
        let (outcome, completion) = self.settled().zip(self.completion)?;
        Some(CountedAttempt { outcome, cause: self.cause, completion })
    }

    /// What the candidate may know of it while the exam is not closed.
    fn sealed(self) -> Self {
        Self {
            session_id: None,
            outcome: None,
            cause: None,
            pipeline: None,
            figures: None,
            judged_at_ms: None,
            completion: None,
            job_state: None,
            is_sealed: true,
            ..self
        }
    }
}

impl ExamRecord {
    /// How many attempts are used.
    pub fn used(&self) -> u32 {
        u32::try_from(self.begun.iter().filter(|attempt| attempt.counts()).count()).unwrap_or(u32::MAX)
    }

    /// The numbers of the attempts that were voided. They keep their numbers.
    pub fn voided(&self) -> Vec<u32> {
        self.begun.iter().filter(|attempt| !attempt.counts()).map(|attempt| attempt.number).collect()
    }

    /// The first attempt that counts and passed.
    pub fn passing(&self) -> Option<&AttemptRecord> {
        let mut counting = self.begun.iter().filter(|attempt| attempt.counts());
        counting.find(|attempt| attempt.counted().is_some_and(CountedAttempt::is_passed))
    }

    /// The result if a running exam were closed now; `None` if it cannot be closed yet, and for one that does not run.
    pub fn result_if_closed(&self) -> Option<ExamResult> {
        let counted = counted_attempts(&self.begun).ok().filter(|_| self.state == ExamState::Running)?;
        result_of(&counted)
    }
}

/// Selects exams of a list.
#[derive(Clone, Copy, Debug, Default)]
pub struct ExamFilter {
    /// Only those of this trainee.
    pub trainee: Option<TraineeId>,
    /// Only those in this state.
    pub state: Option<ExamState>,
}

const SELECT_EXAMS: &str = "
    SELECT exam.id, exam.trainee_id, trainee.name AS trainee_name, trainee.code AS trainee_code,
           exam.task_id, task.name AS task_name, task.code AS task_code,
           exam.box_id, training_box.name AS box_name, training_box.code AS box_code,
           exam.standard_id, standard.version AS standard_version, exam.attempts, exam.day, exam.state,
           planner.name AS planned_by, exam.planned_at_ms, exam.identity, exam.examiner, exam.started_at_ms, exam.result,
           ender.name AS ended_by, exam.ended_at_ms
    FROM exam
    JOIN trainee ON trainee.id = exam.trainee_id
    JOIN task ON task.id = exam.task_id
    JOIN training_box ON training_box.id = exam.box_id
    JOIN standard ON standard.id = exam.standard_id
    LEFT JOIN person AS planner ON planner.id = exam.planned_by
    LEFT JOIN person AS ender ON ender.id = exam.ended_by
    WHERE ($3 IS NULL OR exam.id = $3) AND ($4 IS NULL OR exam.trainee_id = $4) AND ($5 IS NULL OR exam.state = $5)
      AND ($1 = 'administrator'
           OR exam.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR exam.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($6 IS NULL OR exam.id < $6)
    ORDER BY exam.id DESC LIMIT $7";

const SELECT_ATTEMPTS: &str = "
    SELECT attempt.exam_id, attempt.number, attempt.began_at_ms, attempt.session_id, attempt.outcome, attempt.cause,
           attempt.pipeline, attempt.figures, attempt.judged_at_ms, attempt.completion, voider.name AS voided_by,
           attempt.void_reason, attempt.voided_at_ms, session.id IS NOT NULL AND session.video IS NULL AS is_receiving,
           job.state AS job_state
    FROM exam_attempt AS attempt
    LEFT JOIN session ON session.id = attempt.session_id
    LEFT JOIN tracking_job AS job ON job.session_id = session.id
    LEFT JOIN person AS voider ON voider.id = attempt.voided_by
    WHERE attempt.exam_id IN (SELECT value FROM json_each($1)) AND attempt.number IS NOT NULL
    ORDER BY attempt.exam_id, attempt.number";

const COUNT_OF_TRAINEE: &str = "SELECT count(*) FROM exam WHERE trainee_id = $1";

const INSERT_EXAM: &str = "
    INSERT INTO exam (id, trainee_id, task_id, box_id, standard_id, attempts, day, state, planned_by, planned_at_ms)
    VALUES ($1, $2, $3, $4, $5, $6, $7, 'planned', $8, $9)";

const SELECT_FIXED: &str = "SELECT trainee_id, box_id, attempts, state FROM exam WHERE id = $1";

const SELECT_OTHER_RUNNING: &str = "
    SELECT trainee_id = $1 FROM exam WHERE state = 'running' AND (trainee_id = $1 OR box_id = $2) LIMIT 1";

const START_EXAM: &str = "
    UPDATE exam SET state = 'running', identity = $2, examiner_id = $3,
                    examiner = (SELECT name FROM person WHERE person.id = $3), self_test_id = $4,
                    handedness = (SELECT handedness FROM trainee WHERE trainee.id = exam.trainee_id),
                    started_at_ms = max($5, planned_at_ms)
    WHERE id = $1 AND state = 'planned'";

const END_EXAM: &str = "
    UPDATE exam SET state = $2, result = $3, ended_by = $4, ended_at_ms = max($5, planned_at_ms) WHERE id = $1";

const NOTE_FAILED: &str = "
    UPDATE exam_attempt SET outcome = 'failed', judged_at_ms = $3
    WHERE exam_id = $1 AND number = $2 AND outcome IS NULL";

/// Candidate, box, number of attempts and state.
type FixedRow = (TraineeId, BoxId, u32, ExamState);

impl ExamStore<'_> {
    /// Plans an exam.
    ///
    /// # Errors
    /// The trainee does not consent to recordings.
    pub async fn plan(&self, scope: &Scope, new: PlannedExam) -> StoreResult<ExamRecord> {
        require_staff(scope, "planning exams")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        let id = ExamId::at(now_ms);
        self.0
            .write(async move |tx| {
                require_trainee(tx, &by, new.trainee).await?;
                require_consent(tx, new.trainee, now_ms).await?;
                let count: i64 = sqlx::query_scalar(COUNT_OF_TRAINEE).bind(new.trainee).fetch_one(&mut *tx).await?;
                if count >= MAX_OF_TRAINEE {
                    return Err(StoreError::refused(format!(
                        "the trainee has {MAX_OF_TRAINEE} exams, which is the limit for one person"
                    )));
                }
                let insert = sqlx::query(INSERT_EXAM).bind(id).bind(new.trainee).bind(new.task).bind(new.in_box);
                let insert = insert.bind(new.standard).bind(new.attempts).bind(new.day).bind(by.person()).bind(now_ms);
                insert.execute(&mut *tx).await.map_err(missing("task, box or standard"))?;
                note(tx, &by, now_ms, ("plan", "exam"), id).await
            })
            .await?;
        self.get(scope, id).await
    }

    /// The exams that the scope sees, the newest first.
    pub async fn list(&self, scope: &Scope, filter: ExamFilter, page: &PageRequest) -> StoreResult<Page<ExamRecord>> {
        let rows = sqlx::query_as(SELECT_EXAMS).bind_scope(scope).bind(None::<ExamId>).bind(filter.trainee);
        let rows = rows.bind(filter.state).bind(page.after()).bind(page.row_limit());
        let mut found =
            Page::from_rows(rows.fetch_all(self.0.readers()).await?, page, |exam: &ExamRecord| exam.id.to_string());
        self.fill_attempts(scope, &mut found.items).await?;
        Ok(found)
    }

    /// One exam.
    pub async fn get(&self, scope: &Scope, id: ExamId) -> StoreResult<ExamRecord> {
        let row = sqlx::query_as(SELECT_EXAMS).bind_scope(scope).bind(id).bind(None::<TraineeId>);
        let row = row.bind(None::<ExamState>).bind(None::<String>).bind(1).fetch_optional(self.0.readers()).await?;
        let mut exam: ExamRecord = row.ok_or(not_found("exam"))?;
        self.fill_attempts(scope, std::slice::from_mut(&mut exam)).await?;
        Ok(exam)
    }

    /// Adds the attempts to exams that the scope sees. The candidate sees no figure of one that is not closed.
    async fn fill_attempts(&self, scope: &Scope, exams: &mut [ExamRecord]) -> StoreResult<()> {
        let ids: Vec<ExamId> = exams.iter().map(|exam| exam.id).collect();
        let rows: Vec<AttemptRecord> =
            sqlx::query_as(SELECT_ATTEMPTS).bind(Json(ids)).fetch_all(self.0.readers()).await?;
        let mut of_each: HashMap<ExamId, Vec<AttemptRecord>> = HashMap::new();
        for attempt in rows {
            of_each.entry(attempt.exam_id).or_default().push(attempt);
        }
        for exam in exams {
            let begun = of_each.remove(&exam.id).unwrap_or_default();
            let is_sealed = !scope.is_staff() && exam.state == ExamState::Running;
            let without_reason =
                |attempt: AttemptRecord| AttemptRecord { void_reason: None, voided_by: None, ..attempt };
            exam.begun = match (is_sealed, scope.is_staff()) {
                (_, true) => begun,
                (true, _) => begun.into_iter().map(|attempt| without_reason(attempt.sealed())).collect(),
                (false, _) => begun.into_iter().map(without_reason).collect(),
            };
        }
        Ok(())
    }

    /// Starts an exam: the caller has confirmed who the candidate is. `self_test`: the one that the box passed today.
    ///
    /// # Errors
    /// It is not planned, the candidate does not consent to recordings, or an exam of this candidate or in this box is
    /// running.
    pub async fn start(
        &self,
        scope: &Scope,
        id: ExamId,
        identity: IdentityCheck,
        self_test: SelfTestId,
    ) -> StoreResult<ExamRecord> {
        require_staff(scope, "starting exams")?;
        let examiner = scope.person().ok_or(StoreError::Forbidden { what: "starting exams", whom: "people" })?;
        self.get(scope, id).await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let (trainee, in_box, _, state) = fixed(tx, &by, id).await?;
                if state != ExamState::Planned {
                    return Err(StoreError::refused("the exam has begun or ended already: look at it again"));
                }
                require_consent(tx, trainee, now_ms).await?;
                refuse_second(tx, trainee, in_box).await?;
                let start = sqlx::query(START_EXAM).bind(id).bind(identity).bind(examiner).bind(self_test).bind(now_ms);
                start.execute(&mut *tx).await.map_err(missing("self-test"))?;
                note(tx, &by, now_ms, ("start", "exam"), id).await
            })
            .await?;
        self.get(scope, id).await
    }

    /// Cancels an exam while no attempt counts. One that is cancelled already stays as it is.
    ///
    /// # Errors
    /// It is closed, or an attempt counts.
    pub async fn cancel(&self, scope: &Scope, id: ExamId) -> StoreResult<ExamRecord> {
        require_staff(scope, "cancelling exams")?;
        let exam = self.get(scope, id).await?;
        if exam.state == ExamState::Cancelled {
            return Ok(exam);
        }
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let (.., state) = fixed(tx, &by, id).await?;
                let begun = attempts_of(tx, id).await?;
                let is_open = matches!(state, ExamState::Planned | ExamState::Running);
                if !is_open || begun.iter().any(AttemptRecord::counts) {
                    return Err(StoreError::refused(
                        "an attempt was made, or the exam has ended: an exam is cancelled only before its first attempt. \
                         Close it instead",
                    ));
                }
                end(tx, &by, id, (ExamState::Cancelled, None), now_ms).await?;
                note(tx, &by, now_ms, ("cancel", "exam"), id).await
            })
            .await?;
        self.get(scope, id).await
    }

    /// Closes an exam with its result. From then on the candidate sees it. `expected`: the result that the examiner saw.
    ///
    /// # Errors
    /// It is not running, no attempt counts, one is not judged yet, the examiner has not said whether it was completed, or the
    /// result is another one than expected.
    pub async fn close(&self, scope: &Scope, id: ExamId, expected: Option<ExamResult>) -> StoreResult<ExamRecord> {
        require_staff(scope, "closing exams")?;
        self.get(scope, id).await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let (.., state) = fixed(tx, &by, id).await?;
                if state != ExamState::Running {
                    return Err(StoreError::refused("the exam is not running, so it cannot be closed"));
                }
                let begun = attempts_of(tx, id).await?;
                for attempt in begun.iter().filter(|attempt| attempt.settled() == Some(AttemptOutcome::Failed)) {
                    let failed = sqlx::query(NOTE_FAILED).bind(id).bind(attempt.number).bind(now_ms);
                    failed.execute(&mut *tx).await?;
                }
                let result = result_of(&counted_attempts(&begun)?)
                    .ok_or_else(|| StoreError::refused("no attempt counts: record one, or cancel the exam"))?;
                if expected.is_some_and(|expected| expected != result) {
                    return Err(StoreError::refused(
                        "the result of the exam has changed meanwhile: look at the attempts and the result again, then close it",
                    ));
                }
                end(tx, &by, id, (ExamState::Closed, Some(result)), now_ms).await?;
                note(tx, &by, now_ms, ("close", "exam"), id).await
            })
            .await?;
        self.get(scope, id).await
    }
}

/// What was fixed of an exam whose candidate the scope sees, and its state.
async fn fixed(tx: &mut SqliteConnection, by: &Scope, id: ExamId) -> StoreResult<FixedRow> {
    let row: Option<FixedRow> = sqlx::query_as(SELECT_FIXED).bind(id).fetch_optional(&mut *tx).await?;
    let row = row.ok_or(not_found("exam"))?;
    require_trainee(tx, by, row.0).await?;
    Ok(row)
}

async fn attempts_of(tx: &mut SqliteConnection, id: ExamId) -> StoreResult<Vec<AttemptRecord>> {
    Ok(sqlx::query_as(SELECT_ATTEMPTS).bind(Json([id])).fetch_all(tx).await?)
}

/// The attempts that count, with outcome and completion.
fn counted_attempts(begun: &[AttemptRecord]) -> StoreResult<Vec<CountedAttempt>> {
    let mut counted = Vec::new();
    for attempt in begun {
        let number = attempt.number;
        if attempt.is_receiving || (attempt.counts() && attempt.settled().is_none()) {
            return Err(StoreError::refused(format!(
                "attempt {number} is still being recorded or measured: wait until it is judged"
            )));
        }
        if attempt.counts() {
            counted.push(attempt.counted().ok_or_else(|| {
                StoreError::refused(format!(
                    "say first whether the task of attempt {number} was completed or broken off, then close the exam"
                ))
            })?);
        }
    }
    Ok(counted)
}

async fn end(
    tx: &mut SqliteConnection,
    by: &Scope,
    id: ExamId,
    (state, result): (ExamState, Option<ExamResult>),
    now_ms: i64,
) -> StoreResult<()> {
    let ended = sqlx::query(END_EXAM).bind(id).bind(state).bind(result).bind(by.person()).bind(now_ms);
    ended.execute(tx).await?;
    Ok(())
}

/// Refuses a second exam of this candidate, or in this box.
async fn refuse_second(tx: &mut SqliteConnection, trainee: TraineeId, in_box: BoxId) -> StoreResult<()> {
    let other = sqlx::query_scalar(SELECT_OTHER_RUNNING).bind(trainee).bind(in_box).fetch_optional(tx).await?;
    match other {
        None => Ok(()),
        Some(true) => Err(StoreError::refused("another exam of this trainee is running: close it first")),
        Some(false) => Err(StoreError::refused("another exam is running in this box: close it first")),
    }
}
