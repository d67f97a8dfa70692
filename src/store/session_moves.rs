//! Moves of sessions to the right trainee, task or box. Staff make them; each stays on record, and the session can be
//! moved back.
//!
//! Progress, standards, courses and cohorts read the session where it is filed now. Results, jobs and answers to the
//! question for the box belong to one box: they do not count while the session is filed under another one
//! (`migrations/0042_session_moves.sql`).

use serde::Deserialize;
use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::certificates;
use super::consents::require_consent;
use super::edits::settle_box_question;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::exams::refuse_if_of_exam;
use super::jobs::{enqueue_rescore_if_outdated, enqueue_track};
use super::skill_models;
use super::visibility::{BindScope, require_staff, require_trainee};
use super::{Scope, Store};
use crate::domain::blob::BlobHash;
use crate::domain::certificate::CertificateEventKind;
use crate::domain::job::JobState;
use crate::domain::session_move::MovedPart;
use crate::domain::text::{Name, Remark};
use crate::ids::{BoxId, MoveId, SessionId, TaskId, TraineeId};

/// Access to the moves.
pub struct SessionMoveStore<'s>(pub(super) &'s Store);

/// Maximum number of moves of one session.
pub const MAX_MOVES: i64 = 200;

/// The place of a session: its trainee, task and box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct SessionPlace {
    trainee: TraineeId,
    task: TaskId,
    in_box: BoxId,
}

/// Where a session is to be moved; `None`: it stays as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SessionDestination {
    /// The right trainee.
    pub trainee: Option<TraineeId>,
    /// The right task.
    pub task: Option<TaskId>,
    /// The right box.
    pub in_box: Option<BoxId>,
}

/// A trainee, a task or a box that a session was filed under.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub struct FiledUnder {
    /// Its id.
    pub id: String,
    /// Its name.
    pub name: String,
    /// Its code.
    pub code: String,
}

/// A move of a session. Of what a move names, `None` is what was deleted since, or what the reader may not see.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct SessionMoveRecord {
    /// Its id.
    pub id: MoveId,
    /// What it changed.
    #[sqlx(json)]
    pub changes: Vec<MovedPart>,
    /// The trainee before.
    #[sqlx(json(nullable))]
    pub from_trainee: Option<FiledUnder>,
    /// The trainee after.
    #[sqlx(json(nullable))]
    pub to_trainee: Option<FiledUnder>,
    /// The task before.
    #[sqlx(json(nullable))]
    pub from_task: Option<FiledUnder>,
    /// The task after.
    #[sqlx(json(nullable))]
    pub to_task: Option<FiledUnder>,
    /// The box before.
    #[sqlx(json(nullable))]
    pub from_box: Option<FiledUnder>,
    /// The box after.
    #[sqlx(json(nullable))]
    pub to_box: Option<FiledUnder>,
    /// The reason.
    pub why: Remark,
    /// Name of the person; `None` if the account has been deleted, or if the service moved it.
    pub who: Option<Name>,
    /// When, epoch ms.
    pub created_at_ms: i64,
}

/// Selects the moves of session `$3`, oldest first.
const SELECT_MOVES: &str = "
    WITH readable (id, named) AS
        (SELECT id, json_object('id', id, 'name', name, 'code', code) FROM trainee
         WHERE ($1 = 'administrator'
                OR id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
           AND ($2 IS 'service' OR id NOT IN (SELECT trainee_id FROM hidden_trainee))
         UNION ALL SELECT id, json_object('id', id, 'name', name, 'code', code) FROM task
         UNION ALL SELECT id, json_object('id', id, 'name', name, 'code', code) FROM training_box)
    SELECT moved.id, moved.changes, moved.why, mover.name AS who, moved.created_at_ms,
           (SELECT named FROM readable WHERE readable.id =
                coalesce((SELECT kept_id FROM merged_trainee WHERE trainee_id = moved.from_trainee_id), moved.from_trainee_id)) AS from_trainee,
           (SELECT named FROM readable WHERE readable.id =
                coalesce((SELECT kept_id FROM merged_trainee WHERE trainee_id = moved.to_trainee_id), moved.to_trainee_id)) AS to_trainee,
           (SELECT named FROM readable WHERE readable.id = moved.from_task_id) AS from_task,
           (SELECT named FROM readable WHERE readable.id = moved.to_task_id) AS to_task,
           (SELECT named FROM readable WHERE readable.id =
                coalesce((SELECT kept_id FROM merged_box WHERE box_id = moved.from_box_id), moved.from_box_id)) AS from_box,
           (SELECT named FROM readable WHERE readable.id =
                coalesce((SELECT kept_id FROM merged_box WHERE box_id = moved.to_box_id), moved.to_box_id)) AS to_box
    FROM session_move AS moved LEFT JOIN person AS mover ON mover.id = moved.person_id
    WHERE moved.session_id = $3 ORDER BY moved.rowid LIMIT $4";

const SELECT_PLACE: &str = "
    SELECT trainee_id, task_id, box_id, video, path_hash, tracker IS NOT NULL FROM session WHERE id = $1";

const MOVE_SESSION: &str = "UPDATE session SET trainee_id = $2, task_id = $3, box_id = $4 WHERE id = $1";

const INSERT_MOVE: &str = "
    INSERT INTO session_move (id, session_id, person_id, from_trainee_id, to_trainee_id, from_task_id, to_task_id,
                              from_box_id, to_box_id, changes, why, created_at_ms)
    SELECT $1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12
    WHERE (SELECT count(*) FROM session_move WHERE session_id = $2) < $13";

/// A waiting rescoring would compare the result of another task or box.
const CANCEL_RESCORING: &str =
    "UPDATE rescoring_item SET state = 'cancelled' WHERE session_id = $1 AND state = 'waiting'";

const SELECT_UNFINISHED_JOB: &str =
    "SELECT EXISTS (SELECT 1 FROM job WHERE session_id = $1 AND state IN ('queued', 'running'))";

const SELECT_TRACKING_STATE: &str = "SELECT state FROM tracking_job WHERE session_id = $1";

const SELECT_VIDEO_IS_DROPPED: &str = "
    SELECT EXISTS (SELECT 1 FROM session JOIN blob ON blob.hash = session.video
                   WHERE session.id = $1 AND blob.dropped_at_ms IS NOT NULL)";

/// The same recording in a place, or with `$6` the same path of an import, except the other parts of a cut recording that
/// session `$5` is a part of.
const SELECT_SAME_ELSEWHERE: &str = "
    SELECT other.id FROM session AS other JOIN session AS moved ON moved.id = $5
    WHERE other.trainee_id = $1 AND other.task_id = $2
      AND (other.box_id = $3 AND other.video = $4 OR other.path_hash = $6)
      AND coalesce(other.cut_of, other.id) <> coalesce(moved.cut_of, moved.id)
    ORDER BY other.created_at_ms, other.id LIMIT 1";

type PlaceRow = (TraineeId, TaskId, BoxId, Option<BlobHash>, Option<BlobHash>, bool);

impl SessionMoveStore<'_> {
    /// A session's moves, oldest first.
    pub async fn of_session(&self, scope: &Scope, session: SessionId) -> StoreResult<Vec<SessionMoveRecord>> {
        self.0.sessions().get(scope, session).await?;
        self.read(scope, session).await
    }

    /// Moves a session, in one transaction. If it goes to another box, it is tracked with that box's camera and colours,
    /// unless it was before.
    ///
    /// # Errors
    /// The session is still arriving, is filed there already, or the same recording is; for another box also while the
    /// session is being tracked or scored, or if its video was deleted.
    pub async fn add(
        &self,
        scope: &Scope,
        session: SessionId,
        to: SessionDestination,
        why: Remark,
    ) -> StoreResult<SessionMoveRecord> {
        self.0.sessions().get(scope, session).await?;
        require_staff(scope, "moving sessions")?;
        let (by, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        let id = MoveId::at(now_ms);
        self.0
            .write(async move |tx| {
                refuse_if_of_exam(tx, session).await?;
                let row: Option<PlaceRow> = sqlx::query_as(SELECT_PLACE).bind(session).fetch_optional(&mut *tx).await?;
                let (trainee, task, in_box, video, path, is_import) = row.ok_or(not_found("session"))?;
                let from = SessionPlace { trainee, task, in_box };
                let to = from.moved(to);
                if from == to {
                    return Err(StoreError::refused("the session is filed there already"));
                }
                let video = video.ok_or_else(|| {
                    StoreError::refused("the recording is still arriving: wait until it is complete, then move it")
                })?;
                require_trainee(tx, &by, from.trainee).await?;
                require_trainee(tx, &by, to.trainee).await?;
                if from.trainee != to.trainee {
                    require_consent(tx, to.trainee, now_ms).await?;
                }
                let is_other_box = from.in_box != to.in_box;
                let is_other_work = (from.trainee, from.task) != (to.trainee, to.task);
                refuse_duplicate(tx, session, to, (video, path.filter(|_| is_other_work))).await?;
                if is_other_box && !is_import {
                    refuse_if_open(tx, session).await?;
                }
                mark_certificates(tx, &by, session, [from, to], now_ms).await?;
                if is_other_work {
                    skill_models::withdraw_of_session(tx, session, now_ms).await?;
                }
                if is_other_box || from.task != to.task {
                    sqlx::query(CANCEL_RESCORING).bind(session).execute(&mut *tx).await?;
                }
                let moved = sqlx::query(MOVE_SESSION).bind(session).bind(to.trainee).bind(to.task).bind(to.in_box);
                moved.execute(&mut *tx).await.map_err(missing("task or box"))?;
                insert(tx, (id, session), &by, [from, to], why, now_ms).await?;
                if is_other_box {
                    settle_box_question(tx, session).await?;
                    enqueue_for_box(tx, session, is_import, now_ms, attempts).await?;
                }
                note(tx, &by, now_ms, ("move", "session"), session).await
            })
            .await?;
        let all: Vec<SessionMoveRecord> = self.read(scope, session).await?;
        all.into_iter().find(|made| made.id == id).ok_or(not_found("move"))
    }

    async fn read(&self, scope: &Scope, session: SessionId) -> StoreResult<Vec<SessionMoveRecord>> {
        let rows = sqlx::query_as(SELECT_MOVES).bind_scope(scope).bind(session).bind(MAX_MOVES);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }
}

impl SessionPlace {
    /// This place with what a move changes.
    fn moved(self, to: SessionDestination) -> Self {
        Self {
            trainee: to.trainee.unwrap_or(self.trainee),
            task: to.task.unwrap_or(self.task),
            in_box: to.in_box.unwrap_or(self.in_box),
        }
    }
}

/// Puts certificates that rely on the session under review, with what the move changed first.
async fn mark_certificates(
    tx: &mut SqliteConnection,
    by: &Scope,
    session: SessionId,
    [from, to]: [SessionPlace; 2],
    now_ms: i64,
) -> StoreResult<()> {
    let kind = if from.trainee != to.trainee {
        CertificateEventKind::MovedToPerson
    } else if from.task != to.task {
        CertificateEventKind::MovedToTask
    } else {
        CertificateEventKind::MovedToBox
    };
    certificates::mark(tx, by, &[session], kind, now_ms).await
}

/// Queues what the session lacks in its box: its tracking, or a score with the edits that were made elsewhere.
pub(super) async fn enqueue_for_box(
    tx: &mut SqliteConnection,
    session: SessionId,
    is_import: bool,
    now_ms: i64,
    max_attempts: u32,
) -> StoreResult<()> {
    let tracked: Option<JobState> =
        sqlx::query_scalar(SELECT_TRACKING_STATE).bind(session).fetch_optional(&mut *tx).await?;
    match tracked {
        None if !is_import && sqlx::query_scalar(SELECT_VIDEO_IS_DROPPED).bind(session).fetch_one(&mut *tx).await? => {
            return Err(StoreError::refused(
                "the session's video was deleted, so it cannot be tracked with the camera of another box",
            ));
        }
        None => enqueue_track(tx, session, now_ms, max_attempts).await?,
        Some(_) => enqueue_rescore_if_outdated(tx, session, now_ms, max_attempts).await?,
    };
    Ok(())
}

/// Refuses to move the session to a place that has the same recording. `path`: of an import that goes to another trainee
/// or task.
async fn refuse_duplicate(
    tx: &mut SqliteConnection,
    session: SessionId,
    to: SessionPlace,
    (video, path): (BlobHash, Option<BlobHash>),
) -> StoreResult<()> {
    let found = sqlx::query_scalar(SELECT_SAME_ELSEWHERE).bind(to.trainee).bind(to.task).bind(to.in_box);
    let existing: Option<String> = found.bind(video).bind(session).bind(path).fetch_optional(tx).await?;
    existing.map_or(Ok(()), |id| Err(StoreError::Taken { what: "recording", existing: Some(id) }))
}

/// Refuses to move a session to another box while its result for this box is not there yet.
async fn refuse_if_open(tx: &mut SqliteConnection, session: SessionId) -> StoreResult<()> {
    if sqlx::query_scalar(SELECT_UNFINISHED_JOB).bind(session).fetch_one(tx).await? {
        return Err(StoreError::refused(
            "the session is being tracked or scored: wait until it is scored, then move it to another box",
        ));
    }
    Ok(())
}

async fn insert(
    tx: &mut SqliteConnection,
    (id, session): (MoveId, SessionId),
    by: &Scope,
    [from, to]: [SessionPlace; 2],
    why: Remark,
    now_ms: i64,
) -> StoreResult<()> {
    let changed = [
        (from.trainee != to.trainee, MovedPart::Trainee),
        (from.task != to.task, MovedPart::Task),
        (from.in_box != to.in_box, MovedPart::Box),
    ];
    let changes: Vec<MovedPart> =
        changed.into_iter().filter(|(is_changed, _)| *is_changed).map(|part| part.1).collect();
    let insert = sqlx::query(INSERT_MOVE).bind(id).bind(session).bind(by.person());
    let insert = insert.bind(from.trainee).bind(to.trainee).bind(from.task).bind(to.task);
    let insert = insert.bind(from.in_box).bind(to.in_box).bind(Json(changes)).bind(why).bind(now_ms).bind(MAX_MOVES);
    match insert.execute(tx).await.map_err(missing("session"))?.rows_affected() {
        0 => Err(StoreError::refused(format!(
            "the session was moved {MAX_MOVES} times, which is the limit for one session"
        ))),
        _ => Ok(()),
    }
}
