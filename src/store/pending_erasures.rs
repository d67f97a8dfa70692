//! Trainees who wait for their erasure. They and their recordings are hidden from all people meanwhile, and they cannot
//! sign in. Staff can take the erasure back until it is due.

use std::collections::BTreeSet;
use std::time::Duration;

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::cookies::DELETE_COOKIES_OF;
use super::error::{StoreError, StoreResult, not_found};
use super::exams::refuse_if_running;
use super::record_merges::{give_back_trainee, separate_trainees_from, trainee_holder_of, trainees_merged_into};
use super::sessions::twins;
use super::trainees::{TraineeRecord, erase, erased_with};
use super::visibility::{BindScope, require_staff};
use super::{Scope, Store};
use crate::domain::erasure::ErasedKind;
use crate::domain::text::{Code, Key, Name};
use crate::ids::{PersonId, SessionId, TraineeId};
use crate::time::millis;

/// Access to the trainees who wait for their erasure.
pub struct PendingErasureStore<'s>(pub(super) &'s Store);

/// A trainee who waits for their erasure.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct PendingErasure {
    /// Their id.
    pub trainee_id: TraineeId,
    /// Their short unique name.
    pub code: Code,
    /// What people call them.
    pub name: Name,
    /// Number of their sessions.
    pub sessions: i64,
    /// Name of the person who requested it; `None` for the service, or if the account was deleted.
    pub who: Option<Name>,
    /// When it was requested, epoch ms.
    pub requested_at_ms: i64,
    /// When they are erased for good, epoch ms.
    pub due_at_ms: i64,
}

/// What an erasure would delete, and what of the recordings stays with other people.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ErasureExtent {
    /// Number of sessions.
    pub sessions: usize,
    /// Number of hidden sessions with the same recordings, in records that are merged into those of other people.
    pub hidden_copies: usize,
    /// Size of the recordings that are deleted, bytes.
    pub bytes: i64,
    /// Sessions whose whole recording stays with another person, oldest first.
    pub staying: Vec<StayingRecording>,
}

/// A session of an erased trainee whose whole recording stays with another person.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct StayingRecording {
    /// The trainee's own session.
    pub session_id: SessionId,
    /// When it was recorded, epoch ms.
    pub recorded_at_ms: i64,
    /// Name of its task.
    pub task: Name,
}

/// Most trainees in the list.
const MAX_LISTED: i64 = 500;
/// Trainees erased in one round of upkeep.
const ROUND: i64 = 100;

const SELECT_ERASABLE: &str = "
    SELECT id, (SELECT count(*) > 1 FROM group_trainee WHERE trainee_id = trainee.id) FROM trainee
    WHERE $3 IN (id, code)
      AND ($1 = 'administrator'
           OR id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))";

const SELECT_PENDING: &str = "
    SELECT pending.trainee_id, trainee.code, trainee.name, person.name AS who, requested_at_ms, due_at_ms,
           (SELECT count(*) FROM session WHERE session.trainee_id = pending.trainee_id) AS sessions
    FROM pending_erasure AS pending
    JOIN trainee ON trainee.id = pending.trainee_id
    LEFT JOIN person ON person.id = pending.person_id
    WHERE ($1 = 'administrator'
           OR pending.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
    ORDER BY due_at_ms, code LIMIT $3";

/// Size of the recordings of the sessions `$1` (a JSON array) that no other session has.
const SELECT_BYTES: &str = "
    SELECT coalesce(sum(bytes), 0) FROM blob
    WHERE dropped_at_ms IS NULL
      AND hash IN (SELECT video FROM session WHERE id IN (SELECT value FROM json_each($1)))
      AND NOT EXISTS (SELECT 1 FROM session AS other
                      WHERE other.video = blob.hash AND other.id NOT IN (SELECT value FROM json_each($1)))";

/// Selects those of the sessions `$1` (a JSON array) whose recording was cut and stays with another part, which is none of
/// `$1`; and those of `$2`, whose hidden copy stays. A deleted video does not stay.
const SELECT_STAYING: &str = "
    SELECT session.id AS session_id, session.recorded_at_ms, task.name AS task
    FROM session JOIN task ON task.id = session.task_id
    WHERE session.id IN (SELECT value FROM json_each($1))
      AND EXISTS (SELECT 1 FROM blob WHERE hash = session.video AND dropped_at_ms IS NULL)
      AND (session.id IN (SELECT value FROM json_each($2))
           OR EXISTS (SELECT 1 FROM session AS part
                      WHERE part.video = session.video
                        AND coalesce(part.cut_of, part.id) = coalesce(session.cut_of, session.id)
                        AND part.id NOT IN (SELECT value FROM json_each($1))))
    ORDER BY session.recorded_at_ms, session.id";

const SELECT_HAS_MERGES: &str = "SELECT EXISTS (SELECT 1 FROM merged_trainee)";

const INSERT_PENDING: &str = "
    INSERT INTO pending_erasure (trainee_id, requested_at_ms, due_at_ms, person_id) VALUES ($1, $2, $3, $4)
    ON CONFLICT (trainee_id) DO UPDATE SET due_at_ms = excluded.due_at_ms";

const DELETE_PENDING: &str = "DELETE FROM pending_erasure WHERE trainee_id = $1";

pub(super) const INSERT_ERASURE: &str = "INSERT INTO erasure (kind, id, at_ms) VALUES ($1, $2, $3)";

pub(super) const SELECT_ACCOUNT_OF_TRAINEE: &str = "SELECT id FROM person WHERE trainee_id = $1";

const SELECT_IS_MERGED: &str = "SELECT EXISTS (SELECT 1 FROM merged_trainee WHERE trainee_id = $1)";

const SELECT_IS_DUE: &str = "SELECT 1 FROM pending_erasure WHERE trainee_id = $1 AND due_at_ms <= $2";

const SELECT_DUE: &str = "SELECT trainee_id FROM pending_erasure WHERE due_at_ms <= $1 ORDER BY due_at_ms LIMIT $2";

impl PendingErasureStore<'_> {
    /// What erasing this trainee would delete.
    pub async fn extent(&self, scope: &Scope, key: &Key) -> StoreResult<ErasureExtent> {
        let id = self.0.trainees().get(scope, key).await?.id;
        require_staff(scope, "erasing trainees")?;
        let is_merged: bool = sqlx::query_scalar(SELECT_IS_MERGED).bind(id).fetch_one(self.0.readers()).await?;
        if is_merged && !scope.is_service() {
            return Err(StoreError::refused(
                "this record was merged into another one of the same person: separate the two first, or erase the other \
                 one, which erases both",
            ));
        }
        let mut snapshot = self.0.readers().begin().await?;
        let (_, mut sessions) = erased_with(&mut snapshot, id).await?;
        let own = sessions.len();
        let (copies, kept_of) = hidden_copies(&mut snapshot, &sessions).await?;
        let staying = sqlx::query_as(SELECT_STAYING).bind(Json(&sessions)).bind(Json(kept_of));
        let staying = staying.fetch_all(&mut *snapshot).await?;
        sessions.extend(&copies);
        let bytes = sqlx::query_scalar(SELECT_BYTES).bind(Json(sessions)).fetch_one(&mut *snapshot).await?;
        Ok(ErasureExtent { sessions: own, hidden_copies: copies.len(), bytes, staying })
    }

    /// Hides a trainee, signs them out, and erases them after this time. Upkeep does so ([`crate::upkeep`]).
    pub async fn request(&self, scope: &Scope, key: &Key, after: Duration) -> StoreResult<()> {
        self.0.trainees().get(scope, key).await?; // one who waits already is hidden
        let id = self.erasable(scope, key).await?;
        self.insert(scope, id, self.0.now_ms() + millis(after)).await
    }

    /// The id of a trainee that this caller may erase, waiting for it or not.
    pub(super) async fn erasable(&self, scope: &Scope, key: &Key) -> StoreResult<TraineeId> {
        let found: Option<(TraineeId, bool)> =
            sqlx::query_as(SELECT_ERASABLE).bind_scope(scope).bind(key).fetch_optional(self.0.readers()).await?;
        let (id, is_in_several_groups) = found.ok_or(not_found("trainee"))?;
        require_staff(scope, "erasing trainees")?;
        let is_merged: bool = sqlx::query_scalar(SELECT_IS_MERGED).bind(id).fetch_one(self.0.readers()).await?;
        if is_merged && !scope.is_service() {
            return Err(StoreError::refused(
                "this record was merged into another one of the same person: separate the two first, or erase the other \
                 one, which erases both",
            ));
        }
        if scope.may_erase_trainee(is_in_several_groups) {
            Ok(id)
        } else {
            let what = "erasing a trainee who is in several groups";
            Err(StoreError::Forbidden { what, whom: "administrators" })
        }
    }

    /// Lets a trainee wait for an erasure that is due at this time, also on a full disk.
    pub(super) async fn insert(&self, scope: &Scope, id: TraineeId, due_at_ms: i64) -> StoreResult<()> {
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write_with_delete_reserve(|| {
                let scope = scope.clone();
                async move |tx| {
                    if !scope.is_service() {
                        refuse_if_running(tx, [id, id]).await?;
                    }
                    insert(tx, &scope, id, [now_ms, due_at_ms]).await
                }
            })
            .await
    }

    /// Lets a trainee wait again in a restored backup, for an erasure that is due at this time. `with`: the trainees whose
    /// erasure was requested for the same time. A record that is merged into one of these waits with it. All other merges of
    /// the record are undone: they were before the request, or it would name both records.
    pub(super) async fn insert_again(&self, id: TraineeId, due_at_ms: i64, with: Vec<TraineeId>) -> StoreResult<()> {
        let now_ms = self.0.now_ms();
        self.0
            .write_with_delete_reserve(|| {
                let with = with.clone();
                async move |tx| {
                    separate_trainees_from(tx, id, &with, now_ms).await?;
                    match trainee_holder_of(tx, id).await? {
                        Some(holder) if with.contains(&holder) => return Ok(()),
                        _ => give_back_trainee(tx, id, now_ms).await?,
                    }
                    insert(tx, &Scope::service(), id, [now_ms, due_at_ms]).await
                }
            })
            .await
    }

    /// The trainees in the scope who wait for their erasure, the next due first; at most 500.
    pub async fn list(&self, scope: &Scope) -> StoreResult<Vec<PendingErasure>> {
        require_staff(scope, "the list of erasures")?;
        let rows = sqlx::query_as(SELECT_PENDING).bind_scope(scope).bind(MAX_LISTED);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }

    /// Takes an erasure back: the trainee, their account and their recordings are as before. They have to sign in again.
    pub async fn take_back(&self, scope: &Scope, key: &Key) -> StoreResult<TraineeRecord> {
        let id = self.erasable(scope, key).await?;
        if !self.remove(scope, id).await? {
            return Err(not_found("erasure"));
        }
        self.0.trainees().get(scope, &Key::from(&id)).await
    }

    /// Removes a trainee's waiting erasure; `false` if there is none.
    pub(super) async fn remove(&self, scope: &Scope, id: TraineeId) -> StoreResult<bool> {
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                if sqlx::query(DELETE_PENDING).bind(id).execute(&mut *tx).await?.rows_affected() == 0 {
                    return Ok(false);
                }
                for record in trainees_merged_into(tx, id).await?.into_iter().chain([id]) {
                    sqlx::query(DELETE_PENDING).bind(record).execute(&mut *tx).await?;
                    let listed = sqlx::query(INSERT_ERASURE).bind(ErasedKind::TakenBack).bind(record).bind(now_ms);
                    listed.execute(&mut *tx).await?;
                }
                note(tx, &scope, now_ms, ("take back erasure", "trainee"), id).await?;
                Ok(true)
            })
            .await
    }

    /// The trainees whose erasure is due, at most 100.
    pub async fn due(&self) -> StoreResult<Vec<TraineeId>> {
        let rows = sqlx::query_scalar(SELECT_DUE).bind(self.0.now_ms()).bind(ROUND);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }

    /// Erases a trainee whose erasure is due. Not found if it was taken back or put off since the list was read; then
    /// nothing changes.
    pub async fn erase_due(&self, id: TraineeId) -> StoreResult<()> {
        let now_ms = self.0.now_ms();
        self.0
            .write_with_delete_reserve(|| {
                async move |tx| {
                    let due = sqlx::query(SELECT_IS_DUE).bind(id).bind(now_ms);
                    due.fetch_optional(&mut *tx).await?.ok_or(not_found("erasure"))?;
                    erase(tx, &Scope::service(), now_ms, id).await
                }
            })
            .await
    }
}

/// Of these sessions, which are erased together: the hidden ones of other records that are erased with them, and those of
/// whose recording a hidden one stays.
async fn hidden_copies(
    tx: &mut SqliteConnection,
    erased: &[SessionId],
) -> StoreResult<(BTreeSet<SessionId>, BTreeSet<SessionId>)> {
    let (mut copies, mut kept) = (BTreeSet::new(), Vec::new());
    if !sqlx::query_scalar::<_, bool>(SELECT_HAS_MERGES).fetch_one(&mut *tx).await? {
        return Ok(Default::default());
    }
    for id in erased {
        for twin in twins(tx, *id, erased).await?.into_iter().filter(|twin| !erased.contains(&twin.id)) {
            match twin.is_kept {
                true => kept.push((twin.id, *id)),
                false => _ = copies.insert(twin.id),
            }
        }
    }
    let kept_of = kept.into_iter().filter(|(twin, _)| !copies.contains(twin)).map(|(_, of)| of).collect();
    Ok((copies, kept_of))
}

/// Lets a trainee wait for an erasure that is due at this time, with the records that were merged into theirs.
async fn insert(
    tx: &mut SqliteConnection,
    scope: &Scope,
    id: TraineeId,
    [now_ms, due_at_ms]: [i64; 2],
) -> StoreResult<()> {
    let account: Option<PersonId> =
        sqlx::query_scalar(SELECT_ACCOUNT_OF_TRAINEE).bind(id).fetch_optional(&mut *tx).await?;
    if let Some(account) = account {
        sqlx::query(DELETE_COOKIES_OF).bind(account).execute(&mut *tx).await?;
    }
    let insert = sqlx::query(INSERT_PENDING).bind(id).bind(now_ms).bind(due_at_ms).bind(scope.person());
    insert.execute(&mut *tx).await?;
    for record in trainees_merged_into(tx, id).await?.into_iter().chain([id]) {
        let listed = sqlx::query(INSERT_ERASURE).bind(ErasedKind::Pending).bind(record).bind(due_at_ms);
        listed.execute(&mut *tx).await?;
    }
    note(tx, scope, now_ms, ("request erasure", "trainee"), id).await
}
