//! Cuts of recordings with two attempts. The session keeps the part before the cut; a second one is made for the rest, with
//! the same video. A trim limits each to its part, so the first is scored again, and the second one tracked and scored anew.
//! The parts can be joined again while nothing was built on the second one.

use sqlx::sqlite::SqliteConnection;

use super::audit::note;
use super::edits::{self, EditBasis};
use super::error::{StoreError, StoreResult, not_found};
use super::exams::refuse_if_of_exam;
use super::jobs::{self, enqueue_track};
use super::sessions::DELETE_SESSION;
use super::visibility::{BindScope, require_staff, require_trainee};
use super::{Scope, Store, certificates, skill_models};
use crate::domain::blob::{Blob, BlobHash};
use crate::domain::certificate::CertificateEventKind;
use crate::domain::edit::EditChange;
use crate::domain::job::{ImportInput, JobInput};
use crate::domain::text::{Name, Remark, TrackerName};
use crate::ids::{CutId, EditId, SessionId, TraineeId};

/// Access to the cuts.
pub struct SessionCutStore<'s>(pub(super) &'s Store);

/// Maximum number of cuts of one session.
const MAX_CUTS: i64 = 50;

/// A cut of a recording. Of its parts, `None` is what was erased, or what the reader may not see.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct SessionCutRecord {
    /// Its id.
    pub id: CutId,
    /// The session with the part before the cut.
    pub first_id: Option<SessionId>,
    /// The session with the part after it.
    pub second_id: Option<SessionId>,
    /// Where it was cut, seconds of the recording.
    pub at_s: f64,
    /// The reason.
    pub why: Remark,
    /// Name of the person; `None` if the account has been deleted, or for the service.
    pub who: Option<Name>,
    /// When, epoch ms.
    pub created_at_ms: i64,
    /// When the parts were joined again, epoch ms.
    pub joined_at_ms: Option<i64>,
}

/// Selects the cuts that session `$3` is a part of, oldest first.
const SELECT_CUTS: &str = "
    WITH readable (id) AS
        (SELECT id FROM session
         WHERE ($1 = 'administrator'
                OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
           AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee)))
    SELECT cut.id, (SELECT id FROM readable WHERE readable.id = cut.first_id) AS first_id,
           (SELECT id FROM readable WHERE readable.id = cut.second_id) AS second_id,
           cut.at_s, cut.why, maker.name AS who, cut.created_at_ms, cut.joined_at_ms
    FROM session_cut AS cut LEFT JOIN person AS maker ON maker.id = cut.person_id
    WHERE $3 IN (cut.first_id, cut.second_id) ORDER BY cut.rowid LIMIT $4";

const COUNT_CUTS: &str = "SELECT count(*) FROM session_cut WHERE first_id = $1";

const SELECT_CUTTABLE: &str = "
    SELECT session.trainee_id, session.tracker, blob.hash, blob.bytes, blob.dropped_at_ms IS NOT NULL
    FROM session JOIN blob ON blob.hash = session.video WHERE session.id = $1";

/// Trainee, tracker, file, its bytes, and whether it was deleted.
type CuttableRow = (TraineeId, Option<TrackerName>, BlobHash, i64, bool);

/// The second part arrived with the first one, and was recorded when it begins: `$3` ms after the whole recording began.
const INSERT_PART: &str = "
    INSERT INTO session (id, trainee_id, task_id, box_id, filename, media_type, video, recorded_at_ms, recorded_at_source,
                         created_at_ms, tracker, path_hash, date_known, supervision, supervised_by, supervised_at_ms, is_part,
                         cut_of)
    SELECT $2, trainee_id, task_id, box_id, filename, media_type, video,
           recorded_at_ms + $3 - coalesce((SELECT CAST(at_s * 1000 AS INTEGER) FROM session_cut
                                           WHERE second_id = session.id AND joined_at_ms IS NULL), 0),
           recorded_at_source,
           created_at_ms, tracker, path_hash, date_known, supervision, supervised_by, supervised_at_ms, 1,
           coalesce(cut_of, id)
    FROM session WHERE id = $1";

/// A part of a session that followed a merge follows it, too: a separation gives both back.
const FOLLOW_MERGES: &str = "
    INSERT INTO record_merge_row (merge_id, part, row_key)
    SELECT merge_id, part, $2 FROM record_merge_row WHERE part = 'sessions' AND row_key = $1";

const INSERT_CUT: &str = "
    INSERT INTO session_cut (id, first_id, second_id, first_edit_id, second_edit_id, at_s, person_id, why, created_at_ms)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9)";

const SELECT_CUT: &str = "
    SELECT first_id, second_id, first_edit_id, joined_at_ms IS NOT NULL FROM session_cut WHERE id = $1";

/// What was built on the second part `$2` of cut `$1` since, or whether its first part was cut again. Later cuts whose parts
/// were joined again left nothing but their trims, which are undone.
const SELECT_HAS_GROWN: &str = "
    SELECT EXISTS (SELECT 1 FROM rating WHERE session_id = $2)
        OR EXISTS (SELECT 1 FROM comment WHERE session_id = $2)
        OR EXISTS (SELECT 1 FROM error_sheet WHERE session_id = $2)
        OR EXISTS (SELECT 1 FROM session_cut WHERE first_id = $2 AND joined_at_ms IS NULL)
        OR EXISTS (SELECT 1 FROM session_cut AS later JOIN session_cut AS cut ON cut.id = $1
                   WHERE later.first_id = cut.first_id AND later.joined_at_ms IS NULL AND later.id > cut.id)
        OR EXISTS (SELECT 1 FROM session_edit JOIN session_cut AS cut ON cut.id = $1
                   WHERE session_edit.session_id = $2
                     AND session_edit.id NOT IN (SELECT joined.first_edit_id FROM session_cut AS joined
                                                 WHERE joined.first_id = $2 AND joined.joined_at_ms IS NOT NULL
                                                   AND joined.first_edit_id IS NOT NULL)
                     AND (session_edit.created_at_ms > cut.created_at_ms OR session_edit.undone_at_ms > cut.created_at_ms))";

const SELECT_IS_ELSEWHERE: &str = "
    SELECT (first.trainee_id, first.task_id, first.box_id) IS NOT (second.trainee_id, second.task_id, second.box_id)
    FROM session AS first, session AS second WHERE first.id = $1 AND second.id = $2";

const JOIN_PARTS: &str = "UPDATE session_cut SET joined_by = $2, joined_at_ms = $3 WHERE id = $1";

/// Also a trim that the second part got from the first one when it was cut.
const SELECT_IS_CUT: &str = "
    SELECT EXISTS (SELECT 1 FROM session_cut WHERE $1 IN (first_edit_id, second_edit_id) AND joined_at_ms IS NULL)
        OR EXISTS (SELECT 1 FROM session_edit AS edit
                   JOIN session_cut AS cut ON cut.second_id = edit.session_id AND cut.joined_at_ms IS NULL
                   WHERE edit.id = $1 AND edit.kind = 'trim' AND edit.created_at_ms <= cut.created_at_ms)";

impl SessionCutStore<'_> {
    /// The cuts that a session is a part of, oldest first.
    pub async fn of_session(&self, scope: &Scope, session: SessionId) -> StoreResult<Vec<SessionCutRecord>> {
        self.0.sessions().get(scope, session).await?;
        let rows = sqlx::query_as(SELECT_CUTS).bind_scope(scope).bind(session).bind(MAX_CUTS);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }

    /// Cuts a session, in one transaction. `end_s`: the end of the recording. Both parts were checked against the path of
    /// `basis`.
    ///
    /// # Errors
    /// The session is not scored yet, was edited meanwhile, or its video was deleted.
    pub async fn add(
        &self,
        scope: &Scope,
        session: SessionId,
        ([at_s, end_s], why): ([f64; 2], Remark),
        basis: EditBasis,
    ) -> StoreResult<SessionCutRecord> {
        self.0.sessions().get(scope, session).await?;
        require_staff(scope, "cutting sessions")?;
        let (by, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        let id = CutId::at(now_ms);
        self.0
            .write(async move |tx| {
                let found = sqlx::query_as(SELECT_CUTTABLE).bind(session).fetch_optional(&mut *tx).await?;
                let source: CuttableRow = found.ok_or(not_found("session"))?;
                let (trainee, .., is_dropped) = source;
                require_trainee(tx, &by, trainee).await?;
                refuse_if_of_exam(tx, session).await?;
                refuse_uncuttable(tx, session, is_dropped).await?;
                let second = SessionId::at(now_ms);
                let insert = sqlx::query(INSERT_PART).bind(session).bind(second).bind((at_s * 1000.0) as i64);
                insert.execute(&mut *tx).await?;
                sqlx::query(FOLLOW_MERGES).bind(session).bind(second).execute(&mut *tx).await?;
                skill_models::withdraw_of_session(tx, session, now_ms).await?;
                edits::copy_in_force(tx, [session, second], now_ms).await?;
                // Trainees see the reasons of edits, but not that of a cut: it may name others.
                let unsaid = Remark::from_stored("–".to_owned());
                let first_edit = (session, EditChange::Trim([0.0, at_s]), unsaid.clone());
                let first_edit = edits::add_trim(tx, (&by, now_ms, attempts), first_edit, basis).await?;
                let second_edit = (second, EditChange::Trim([at_s, end_s]), unsaid);
                let second_edit = edits::insert_trim(tx, (&by, now_ms), second_edit).await?;
                let insert = sqlx::query(INSERT_CUT).bind(id).bind(session).bind(second).bind(first_edit);
                let insert = insert.bind(second_edit).bind(at_s).bind(by.person()).bind(why).bind(now_ms);
                insert.execute(&mut *tx).await?;
                enqueue_second(tx, second, source, now_ms, attempts).await?;
                note(tx, &by, now_ms, ("cut", "session"), session).await?;
                note(tx, &by, now_ms, ("create", "session"), second).await
            })
            .await?;
        self.get(scope, session, id).await
    }

    /// Joins the parts of a cut again, in one transaction: the second session is erased, and the first one has the whole
    /// recording again. Parts that were joined already stay as they are.
    ///
    /// # Errors
    /// Something was built on the second part, or it is filed elsewhere.
    pub async fn join(&self, scope: &Scope, session: SessionId, id: CutId) -> StoreResult<SessionCutRecord> {
        self.0.sessions().get(scope, session).await?;
        require_staff(scope, "joining sessions")?;
        let (by, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        let first = self
            .0
            .write(async move |tx| {
                let found = sqlx::query_as(SELECT_CUT).bind(id).fetch_optional(&mut *tx).await?;
                let (first, second, trim, is_joined): (Option<SessionId>, Option<SessionId>, Option<EditId>, bool) =
                    found.ok_or(not_found("cut"))?;
                if ![first, second].contains(&Some(session)) {
                    return Err(not_found("cut"));
                }
                if is_joined {
                    return Ok(session);
                }
                let (Some(first), Some(second), Some(trim)) = (first, second, trim) else {
                    return Err(StoreError::refused("one of the two parts was erased, so they cannot be joined"));
                };
                refuse_if_of_exam(tx, first).await?;
                refuse_if_of_exam(tx, second).await?;
                refuse_unjoinable(tx, id, [first, second]).await?;
                skill_models::withdraw_of_session(tx, first, now_ms).await?;
                sqlx::query(JOIN_PARTS).bind(id).bind(by.person()).bind(now_ms).execute(&mut *tx).await?;
                edits::undo_trim(tx, (&by, now_ms, attempts), first, trim).await?;
                certificates::mark(tx, &by, &[second], CertificateEventKind::SessionErased, now_ms).await?;
                sqlx::query(DELETE_SESSION).bind(second).execute(&mut *tx).await?;
                note(tx, &by, now_ms, ("erase", "session"), second).await?;
                note(tx, &by, now_ms, ("join", "session"), first).await?;
                Ok(first)
            })
            .await?;
        self.get(scope, first, id).await
    }

    async fn get(&self, scope: &Scope, session: SessionId, id: CutId) -> StoreResult<SessionCutRecord> {
        self.of_session(scope, session).await?.into_iter().find(|cut| cut.id == id).ok_or(not_found("cut"))
    }
}

/// Queues the tracking of the second part, or the import of its table.
async fn enqueue_second(
    tx: &mut SqliteConnection,
    second: SessionId,
    (_, tracker, hash, bytes, _): CuttableRow,
    now_ms: i64,
    attempts: u32,
) -> StoreResult<()> {
    if let Some(tracker) = tracker {
        let table = Blob { hash, bytes: bytes.unsigned_abs() };
        let input = JobInput::Import(ImportInput { session: second, table, tracker });
        return jobs::insert(tx, &input, now_ms, attempts).await.map(drop);
    }
    match enqueue_track(tx, second, now_ms, attempts).await? {
        Some(_) => Ok(()),
        None => Err(StoreError::refused(
            "the second part cannot be tracked: the session's box has no camera or no tape colours",
        )),
    }
}

async fn refuse_uncuttable(tx: &mut SqliteConnection, session: SessionId, is_dropped: bool) -> StoreResult<()> {
    if is_dropped {
        return Err(StoreError::refused("the session's video was deleted, so its second part cannot be tracked"));
    }
    let cuts: i64 = sqlx::query_scalar(COUNT_CUTS).bind(session).fetch_one(tx).await?;
    match cuts < MAX_CUTS {
        true => Ok(()),
        false => Err(StoreError::refused(format!("the session was cut {MAX_CUTS} times, which is the limit"))),
    }
}

async fn refuse_unjoinable(tx: &mut SqliteConnection, cut: CutId, [first, second]: [SessionId; 2]) -> StoreResult<()> {
    if sqlx::query_scalar(SELECT_IS_ELSEWHERE).bind(first).bind(second).fetch_one(&mut *tx).await? {
        return Err(StoreError::refused(
            "the two parts are filed under different trainees, tasks or boxes: move one of them first",
        ));
    }
    if sqlx::query_scalar(SELECT_HAS_GROWN).bind(cut).bind(second).fetch_one(tx).await? {
        return Err(StoreError::refused(
            "a part was cut again, or the second part has ratings, comments, error sheets or edits of its own, which would \
             be lost: leave the recording cut, or undo and delete them first",
        ));
    }
    Ok(())
}

/// Refuses to undo the trim that a cut made: both sessions would count the same part.
pub(super) async fn refuse_if_cut(tx: &mut SqliteConnection, edit: EditId) -> StoreResult<()> {
    if sqlx::query_scalar(SELECT_IS_CUT).bind(edit).fetch_one(tx).await? {
        return Err(StoreError::refused("this trim belongs to a cut of the recording: join the two parts instead"));
    }
    Ok(())
}
