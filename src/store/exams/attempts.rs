//! Attempts: ordered by staff, begun by the recording with the ordered id, judged when they are scored, called completed or
//! broken off by the examiner, voided by administrators.

use super::super::feeds::NewFeed;
use super::super::sessions::result::features_of;
use super::*;
use crate::domain::exam::{AttemptJudgement, AttemptResult, judge};
use crate::domain::hand::ToolHands;
use crate::domain::scope::Actor;
use crate::domain::session::BoxQuestion;
use crate::domain::standard::StandardDefinition;
use crate::domain::trainee::Handedness;
use crate::ids::ResultId;

/// Most recordings that are ordered for one exam.
const MAX_ORDERS: i64 = 60;

const INSERT_ORDER: &str = "
    INSERT INTO exam_attempt (recording_id, exam_id, ordered_by, ordered_at_ms, self_test_id)
    SELECT $1, $2, $3, $4, $5 WHERE (SELECT count(*) FROM exam_attempt WHERE exam_id = $2) < $6";

const DELETE_ORDER: &str = "DELETE FROM exam_attempt WHERE recording_id = $1 AND number IS NULL";

/// The recordings that were ordered for exam `$1` and have not begun, the newest first. Only the newest may begin.
const SELECT_WAITING: &str = "
    SELECT attempt.recording_id, attempt.ordered_at_ms, attempt.number IS NULL
           AND NOT EXISTS (SELECT 1 FROM exam_attempt AS later
                           WHERE later.exam_id = attempt.exam_id AND later.rowid > attempt.rowid) AS may_begin
    FROM exam_attempt AS attempt WHERE attempt.exam_id = $1 AND attempt.number IS NULL ORDER BY attempt.rowid DESC";

const SET_COMPLETION: &str = "
    UPDATE exam_attempt SET completion = $3 WHERE exam_id = $1 AND number = $2 AND voided_at_ms IS NULL";

/// The order of a recording: its exam, the candidate, task, box, examiner and attempts, and whether a later order replaced
/// it.
const SELECT_ORDER: &str = "
    SELECT exam.id AS exam_id, exam.state, exam.trainee_id, exam.task_id, exam.box_id, exam.examiner_id, exam.attempts,
           attempt.number,
           (SELECT count(*) FROM exam_attempt AS used
            WHERE used.exam_id = exam.id AND used.number IS NOT NULL AND used.voided_at_ms IS NULL
              AND used.recording_id <> attempt.recording_id) AS used,
           EXISTS (SELECT 1 FROM exam_attempt AS later
                   WHERE later.exam_id = exam.id AND later.rowid > attempt.rowid) AS is_replaced
    FROM exam_attempt AS attempt JOIN exam ON exam.id = attempt.exam_id
    WHERE attempt.recording_id = $1";

const BEGIN_ATTEMPT: &str = "
    UPDATE exam_attempt
    SET session_id = $2, began_at_ms = coalesce(began_at_ms, $3),
        number = coalesce(number, (SELECT coalesce(max(other.number), 0) + 1 FROM exam_attempt AS other
                                   WHERE other.exam_id = exam_attempt.exam_id))
    WHERE recording_id = $1 RETURNING number";

/// An attempt of a running exam that is scored and not judged yet.
const SELECT_SCORED: &str = "
    SELECT attempt.recording_id, standard.definition, exam.handedness, session.box_question,
           coalesce((result.calibration_id, result.palette_id) = (self_test.calibration_id, self_test.palette_id), 0)
               AS has_tested_set_up,
           EXISTS (SELECT 1 FROM feed WHERE feed.id = attempt.recording_id AND feed.early_end IS NOT NULL)
               AS is_interrupted,
           session.created_at_ms - attempt.ordered_at_ms AS since_order_ms, result.id AS result_id, result.pipeline,
           result.verdict IS 'refused' AS is_refused, result.left_tool, result.right_tool, result.duration_s
    FROM exam_attempt AS attempt
    JOIN exam ON exam.id = attempt.exam_id AND exam.state = 'running'
    JOIN standard ON standard.id = exam.standard_id
    JOIN session ON session.id = attempt.session_id
    JOIN current_result AS result ON result.session_id = session.id
    LEFT JOIN self_test ON self_test.id = attempt.self_test_id
    WHERE attempt.session_id = $1 AND attempt.outcome IS NULL";

const STORE_JUDGEMENT: &str = "
    UPDATE exam_attempt SET outcome = $2, cause = $3, pipeline = $4, figures = $5, judged_at_ms = $6
    WHERE recording_id = $1 AND outcome IS NULL";

const VOID_ATTEMPT: &str = "
    UPDATE exam_attempt SET voided_by = $3, void_reason = $4, voided_at_ms = $5
    WHERE exam_id = $1 AND number = $2 AND voided_at_ms IS NULL";

#[derive(sqlx::FromRow)]
struct OrderRow {
    exam_id: ExamId,
    state: ExamState,
    trainee_id: TraineeId,
    task_id: TaskId,
    box_id: BoxId,
    examiner_id: Option<PersonId>,
    attempts: i64,
    number: Option<i64>,
    used: i64,
    is_replaced: bool,
}

#[derive(sqlx::FromRow)]
struct ScoredRow {
    recording_id: FeedId,
    #[sqlx(json)]
    definition: StandardDefinition,
    handedness: Option<Handedness>,
    box_question: Option<BoxQuestion>,
    has_tested_set_up: bool,
    is_interrupted: bool,
    since_order_ms: i64,
    result_id: ResultId,
    pipeline: String,
    is_refused: bool,
    left_tool: Option<String>,
    right_tool: Option<String>,
    duration_s: f64,
}

/// A recording that was ordered for an exam and has not begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct WaitingAttempt {
    /// The id of the recording.
    pub recording_id: FeedId,
    /// When it was ordered, epoch ms.
    pub ordered_at_ms: i64,
    /// False if a later order replaced it: it is refused when it begins to arrive.
    pub may_begin: bool,
}

/// A recording that begins as an attempt.
#[derive(Clone, Copy, Debug)]
pub(in crate::store) struct AttemptBeginning {
    exam: ExamId,
    /// The examiner, who sees the attempt.
    pub examiner: Option<PersonId>,
}

impl ExamStore<'_> {
    /// Orders the recording of the next attempt and returns the id that the recording must have. The attempt is used when
    /// this recording begins to arrive. A later order replaces one whose recording has not begun. `self_test`: the one that
    /// holds for the box now.
    ///
    /// # Errors
    /// The exam is not running, all attempts are used, or one is being recorded.
    pub async fn order(&self, scope: &Scope, id: ExamId, self_test: SelfTestId) -> StoreResult<FeedId> {
        require_staff(scope, "recording attempts of exams")?;
        self.get(scope, id).await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        let recording = FeedId::at(now_ms);
        self.0
            .write(async move |tx| {
                let (.., attempts, state) = fixed(tx, &by, id).await?;
                if state != ExamState::Running {
                    return Err(StoreError::refused("the exam is not running, so no attempt can be recorded"));
                }
                let begun = attempts_of(tx, id).await?;
                if begun.iter().any(|attempt| attempt.is_receiving) {
                    return Err(StoreError::refused("an attempt is being recorded: end that recording first"));
                }
                if begun.iter().filter(|attempt| attempt.counts()).count() >= attempts as usize {
                    return Err(StoreError::refused("all attempts of the exam are used: close the exam"));
                }
                let insert = sqlx::query(INSERT_ORDER).bind(recording).bind(id).bind(by.person()).bind(now_ms);
                let insert = insert.bind(self_test).bind(MAX_ORDERS).execute(&mut *tx).await;
                if insert.map_err(missing("self-test"))?.rows_affected() == 0 {
                    return Err(StoreError::refused(format!(
                        "{MAX_ORDERS} recordings were ordered for this exam, which is the limit: close or cancel it"
                    )));
                }
                note(tx, &by, now_ms, ("record attempt", "exam"), id).await
            })
            .await?;
        Ok(recording)
    }

    /// Takes an order back that no sender got. Does nothing if its recording has begun.
    pub async fn take_back(&self, scope: &Scope, id: ExamId, recording: FeedId) -> StoreResult<()> {
        require_staff(scope, "recording attempts of exams")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                fixed(tx, &by, id).await?;
                if sqlx::query(DELETE_ORDER).bind(recording).execute(&mut *tx).await?.rows_affected() == 0 {
                    return Ok(());
                }
                note(tx, &by, now_ms, ("take attempt back", "exam"), id).await
            })
            .await
    }

    /// The recordings that were ordered for an exam and have not begun, the newest first.
    pub async fn waiting(&self, scope: &Scope, id: ExamId) -> StoreResult<Vec<WaitingAttempt>> {
        require_staff(scope, "orders of recordings for exams")?;
        self.get(scope, id).await?;
        Ok(sqlx::query_as(SELECT_WAITING).bind(id).fetch_all(self.0.readers()).await?)
    }

    /// Stores what the examiner says of an attempt: completed or broken off.
    ///
    /// # Errors
    /// The exam is not running, or the attempt is voided or still being recorded.
    pub async fn set_completion(
        &self,
        scope: &Scope,
        id: ExamId,
        number: u32,
        completion: AttemptCompletion,
    ) -> StoreResult<ExamRecord> {
        require_staff(scope, "judging attempts of exams")?;
        self.get(scope, id).await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let attempt = open_attempt(tx, &by, id, number).await?;
                if !attempt.counts() {
                    return Err(StoreError::refused("the attempt is voided, so it needs no statement"));
                }
                if attempt.completion == Some(completion) {
                    return Ok(());
                }
                sqlx::query(SET_COMPLETION).bind(id).bind(number).bind(completion).execute(&mut *tx).await?;
                let action = match completion {
                    AttemptCompletion::Completed => "attempt completed",
                    AttemptCompletion::BrokenOff => "attempt broken off",
                };
                note_attempt(tx, &by, now_ms, action, (id, number)).await
            })
            .await?;
        self.get(scope, id).await
    }

    /// Voids an attempt after a technical failure: the candidate has it back.
    ///
    /// # Errors
    /// The exam is not running, the attempt is voided already, or it is still being recorded.
    pub async fn void(&self, scope: &Scope, id: ExamId, number: u32, why: Remark) -> StoreResult<ExamRecord> {
        super::super::visibility::require_administrator(scope, "voiding attempts of exams")?;
        self.get(scope, id).await?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                open_attempt(tx, &by, id, number).await?;
                let void = sqlx::query(VOID_ATTEMPT).bind(id).bind(number).bind(by.person()).bind(why).bind(now_ms);
                if void.execute(&mut *tx).await?.rows_affected() == 0 {
                    return Err(StoreError::refused("the attempt is voided already"));
                }
                note_attempt(tx, &by, now_ms, "void attempt", (id, number)).await
            })
            .await?;
        self.get(scope, id).await
    }
}

/// An attempt of a running exam that is not being recorded.
async fn open_attempt(tx: &mut SqliteConnection, by: &Scope, id: ExamId, number: u32) -> StoreResult<AttemptRecord> {
    let (.., state) = fixed(tx, by, id).await?;
    if state != ExamState::Running {
        return Err(StoreError::refused(
            "the exam is not running: an attempt is called completed, broken off or void only meanwhile",
        ));
    }
    let found = attempts_of(tx, id).await?.into_iter().find(|attempt| attempt.number == number);
    let attempt = found.ok_or(not_found("attempt"))?;
    if attempt.is_receiving {
        return Err(StoreError::refused("the attempt is being recorded: end the recording first"));
    }
    Ok(attempt)
}

/// Checks a recording that begins or is resumed: `None` if it was not ordered for an exam.
///
/// # Errors
/// It was ordered for an exam that takes no such recording now.
pub(in crate::store) async fn begin_attempt(
    tx: &mut SqliteConnection,
    scope: &Scope,
    new: &NewFeed,
) -> StoreResult<Option<AttemptBeginning>> {
    let order: Option<OrderRow> = sqlx::query_as(SELECT_ORDER).bind(new.id).fetch_optional(tx).await?;
    let Some(order) = order else { return Ok(None) };
    let is_sent_rightly = !new.is_push && (scope.is_staff() || scope.actor() == Actor::Agent(new.in_box));
    if !is_sent_rightly || (order.trainee_id, order.task_id, order.box_id) != (new.trainee, new.task, new.in_box) {
        return Err(StoreError::refused(
            "this recording was ordered for an exam of another candidate, task or box, or for another sender",
        ));
    }
    let is_begun = order.number.is_some();
    if order.state != ExamState::Running || order.used >= order.attempts || (order.is_replaced && !is_begun) {
        return Err(StoreError::refused(
            "the exam takes this recording no more: it has ended, its attempts are used, or the attempt was started anew. \
             Look at the page of the exam",
        ));
    }
    Ok(Some(AttemptBeginning { exam: order.exam_id, examiner: order.examiner_id }))
}

/// The recording of an attempt has this session: from now on the attempt is used.
pub(in crate::store) async fn bind_session(
    tx: &mut SqliteConnection,
    by: &Scope,
    (attempt, recording, session): (AttemptBeginning, FeedId, SessionId),
    now_ms: i64,
) -> StoreResult<()> {
    let begin = sqlx::query_scalar(BEGIN_ATTEMPT).bind(recording).bind(session).bind(now_ms);
    let number: u32 = begin.fetch_one(&mut *tx).await?;
    note_attempt(tx, by, now_ms, "begin attempt", (attempt.exam, number)).await
}

/// Judges a scored session if it is an attempt that was not judged yet, in the transaction that stores its first result.
pub(in crate::store) async fn judge_attempt(
    tx: &mut SqliteConnection,
    session: SessionId,
    now_ms: i64,
) -> StoreResult<()> {
    let scored: Option<ScoredRow> = sqlx::query_as(SELECT_SCORED).bind(session).fetch_optional(&mut *tx).await?;
    let Some(scored) = scored else { return Ok(()) };
    let features = features_of(tx, scored.result_id).await?;
    let hands = ToolHands { left: scored.left_tool, right: scored.right_tool };
    let AttemptJudgement { outcome, cause, figures } = judge(
        &scored.definition,
        AttemptResult {
            features: &features,
            hands: &hands,
            handedness: scored.handedness,
            pipeline: &scored.pipeline,
            is_refused: scored.is_refused,
            may_be_other_box: !scored.box_question.is_none_or(BoxQuestion::counts),
            has_tested_set_up: scored.has_tested_set_up,
            is_interrupted: scored.is_interrupted,
            duration_s: scored.duration_s,
            since_order_s: scored.since_order_ms as f64 / 1000.0,
        },
    );
    let store = sqlx::query(STORE_JUDGEMENT).bind(scored.recording_id).bind(outcome).bind(cause);
    let store = store.bind(scored.pipeline).bind(Json(figures)).bind(now_ms);
    store.execute(&mut *tx).await?;
    Ok(())
}
