//! Trainees. Staff register them; a scope sees its own trainees.

use sqlx::types::Json;

use super::audit::note;
use super::error::{StoreError, StoreResult, missing, not_found, taken};
use super::page::{Page, PageRequest};
use super::pending_erasures::SELECT_ACCOUNT_OF_TRAINEE;
use super::record_merges::{give_back_trainee, separate_trainees_from, trainees_merged_into};
use super::retention::forget_box_jobs_of_trainee;
use super::sessions::erase_twins;
use super::tokens::withdraw_tokens;
use super::visibility::{BindScope, SELECT_AUDIENCE, TraineeAudience, require_staff};
use super::{Scope, Store, certificates, codes, skill_models};
use crate::domain::certificate::CertificateEventKind;
use crate::domain::role::Role;
use crate::domain::text::{Code, Key, Name};
use crate::domain::trainee::{Handedness, Level, NewTrainee, TraineeChange};
use crate::ids::{GroupId, PersonId, SessionId, TraineeId};

/// Access to the trainees.
pub struct TraineeStore<'s>(pub(super) &'s Store);

/// A trainee.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct TraineeRecord {
    /// Their id.
    pub id: TraineeId,
    /// Their short unique name.
    pub code: Code,
    /// What people call them.
    pub name: Name,
    /// Level of experience, if known.
    pub level: Option<Level>,
    /// Preferred hand, if known.
    pub handedness: Option<Handedness>,
    /// When they were registered, epoch ms.
    pub created_at_ms: i64,
    /// True if more than one group trains them.
    pub is_in_several_groups: bool,
}

pub(super) const SELECT_CODE: &str = "SELECT 1 FROM trainee WHERE code = $1";

pub(super) const INSERT_GROUP_TRAINEE: &str = "INSERT INTO group_trainee (group_id, trainee_id) VALUES ($1, $2)";

const SELECT_TRAINEES: &str = "
    SELECT id, code, name, level, handedness, created_at_ms,
           (SELECT count(*) > 1 FROM group_trainee WHERE trainee_id = trainee.id) AS is_in_several_groups
    FROM trainee
    WHERE ($1 = 'administrator'
           OR id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($3 IS NULL OR code > $3) ORDER BY code LIMIT $4";

const SELECT_GROUP_TRAINEES: &str = "
    SELECT id, code, name, level, handedness, created_at_ms,
           (SELECT count(*) > 1 FROM group_trainee WHERE trainee_id = trainee.id) AS is_in_several_groups
    FROM trainee
    WHERE id IN (SELECT trainee_id FROM group_trainee WHERE group_id = $3)
      AND ($1 = 'administrator'
           OR id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR id NOT IN (SELECT trainee_id FROM hidden_trainee))
    ORDER BY name, code LIMIT $4";

const SELECT_NAMED_TRAINEES: &str = "
    SELECT id, code, name, level, handedness, created_at_ms,
           (SELECT count(*) > 1 FROM group_trainee WHERE trainee_id = trainee.id) AS is_in_several_groups
    FROM trainee
    WHERE id IN (SELECT value FROM json_each($3))
      AND ($1 = 'administrator'
           OR id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR id NOT IN (SELECT trainee_id FROM hidden_trainee))
    ORDER BY name, code";

pub(super) const SELECT_TRAINEE: &str = "
    SELECT id, code, name, level, handedness, created_at_ms,
           (SELECT count(*) > 1 FROM group_trainee WHERE trainee_id = trainee.id) AS is_in_several_groups
    FROM trainee
    WHERE id = (SELECT coalesce(merged.kept_id, named.id) FROM trainee AS named
                LEFT JOIN merged_trainee AS merged ON merged.trainee_id = named.id WHERE $3 IN (named.id, named.code))
      AND ($1 = 'administrator'
           OR id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR id NOT IN (SELECT trainee_id FROM hidden_trainee))";

const SELECT_GROUP_NAMES: &str = "
    SELECT training_group.name FROM group_trainee JOIN training_group ON training_group.id = group_trainee.group_id
    WHERE group_trainee.trainee_id = $3
      AND ($1 <> 'instructor' OR EXISTS (SELECT 1 FROM group_instructor
           WHERE group_instructor.group_id = group_trainee.group_id AND person_id = $2))
    ORDER BY training_group.name";

const UPDATE_TRAINEE: &str = "
    UPDATE trainee
    SET code = coalesce($2, code), name = coalesce($3, name), level = coalesce($4, level),
        handedness = coalesce($5, handedness)
    WHERE id = $1";

const DELETE_TRAINEE: &str = "DELETE FROM trainee WHERE id = $1";

const INSERT_TRAINEE: &str = "
    INSERT INTO trainee (id, code, name, level, handedness, created_at_ms) VALUES ($1, $2, $3, $4, $5, $6)";

const SELECT_SESSIONS_OF_TRAINEE: &str = "SELECT id FROM session WHERE trainee_id = $1";

const SELECT_TAUGHT_GROUPS: &str = "SELECT group_id FROM group_instructor WHERE person_id = $1";

impl TraineeStore<'_> {
    /// Registers a trainee. An instructor's trainee joins one of the instructor's groups; otherwise no instructor would
    /// see them.
    pub async fn create(&self, scope: &Scope, new: NewTrainee) -> StoreResult<TraineeRecord> {
        require_staff(scope, "registering trainees")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let group = joined_group(tx, &scope, new.group).await?;
                let trainee = TraineeRecord {
                    id: TraineeId::at(now_ms),
                    code: codes::choose(tx, SELECT_CODE, new.code, &new.name, "trainee").await?,
                    name: new.name,
                    level: new.level,
                    handedness: new.handedness,
                    created_at_ms: now_ms,
                    is_in_several_groups: false,
                };
                insert(tx, &trainee).await?;
                if let Some(group) = group {
                    let join = sqlx::query(INSERT_GROUP_TRAINEE).bind(group).bind(trainee.id);
                    join.execute(&mut *tx).await.map_err(missing("group"))?;
                }
                note(tx, &scope, now_ms, ("create", "trainee"), trainee.id).await?;
                Ok(trainee)
            })
            .await
    }

    /// The trainees that the scope sees, by code.
    pub async fn list(&self, scope: &Scope, page: &PageRequest) -> StoreResult<Page<TraineeRecord>> {
        let rows = sqlx::query_as(SELECT_TRAINEES);
        let rows = rows.bind_scope(scope).bind(page.after()).bind(page.row_limit()).fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |trainee: &TraineeRecord| trainee.code.to_string()))
    }

    /// The trainees of a group that the scope sees, by name; at most `most`.
    pub async fn of_group(&self, scope: &Scope, group: GroupId, most: u32) -> StoreResult<Vec<TraineeRecord>> {
        let rows = sqlx::query_as(SELECT_GROUP_TRAINEES);
        Ok(rows.bind_scope(scope).bind(group).bind(most).fetch_all(self.0.readers()).await?)
    }

    /// Those of these trainees that the scope sees, by name.
    pub async fn named(&self, scope: &Scope, ids: &[TraineeId]) -> StoreResult<Vec<TraineeRecord>> {
        let rows = sqlx::query_as(SELECT_NAMED_TRAINEES);
        Ok(rows.bind_scope(scope).bind(Json(ids)).fetch_all(self.0.readers()).await?)
    }

    /// One trainee, by id or code.
    pub async fn get(&self, scope: &Scope, key: &Key) -> StoreResult<TraineeRecord> {
        let row = sqlx::query_as(SELECT_TRAINEE);
        let row = row.bind_scope(scope).bind(key).fetch_optional(self.0.readers()).await?;
        row.ok_or(not_found("trainee"))
    }

    /// The people who see a trainee. No person sees one that does not exist.
    pub async fn audience(&self, trainee: TraineeId) -> StoreResult<TraineeAudience> {
        let rows = sqlx::query_as(SELECT_AUDIENCE).bind(trainee).fetch_all(self.0.readers()).await?;
        Ok(TraineeAudience(rows))
    }

    /// The names of the groups of a trainee in the scope; for an instructor of those that they teach.
    pub async fn groups(&self, scope: &Scope, trainee: TraineeId) -> StoreResult<Vec<Name>> {
        self.get(scope, &Key::from(&trainee)).await?;
        Ok(sqlx::query_scalar(SELECT_GROUP_NAMES).bind_scope(scope).bind(trainee).fetch_all(self.0.readers()).await?)
    }

    /// Changes a trainee.
    pub async fn change(&self, scope: &Scope, key: &Key, change: TraineeChange) -> StoreResult<TraineeRecord> {
        let id = self.get(scope, key).await?.id;
        require_staff(scope, "changing trainees")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let update = sqlx::query(UPDATE_TRAINEE).bind(id).bind(change.code).bind(change.name);
                let update = update.bind(change.level).bind(change.handedness).execute(&mut *tx);
                if update.await.map_err(taken("code"))?.rows_affected() == 0 {
                    return Err(not_found("trainee"));
                }
                note(tx, &by, now_ms, ("change", "trainee"), id).await
            })
            .await?;
        self.get(scope, &Key::from(&id)).await
    }

    /// Erases a trainee with their account, sessions, results and uploads, and withdraws the models trained on them.
    /// The files are deleted with the next collection of unreferenced blobs ([`crate::upkeep`]). A trainee who waits for
    /// their erasure is erased at once.
    pub async fn erase(&self, scope: &Scope, key: &Key) -> StoreResult<()> {
        let id = self.0.pending_erasures().erasable(scope, key).await?;
        let now_ms = self.0.now_ms();
        self.0
            .write_with_delete_reserve(|| {
                let scope = scope.clone();
                async move |tx| erase(tx, &scope, now_ms, id).await
            })
            .await
    }

    /// Erases a trainee's record again, in a restored backup.
    pub(super) async fn erase_again(&self, id: TraineeId) -> StoreResult<()> {
        let id = self.0.pending_erasures().erasable(&Scope::service(), &Key::from(&id)).await?;
        let now_ms = self.0.now_ms();
        let erased =
            || async move |tx: &mut sqlx::SqliteConnection| erase_again(tx, &Scope::service(), now_ms, id).await;
        self.0.write_with_delete_reserve(erased).await
    }
}

/// The records that are erased with a trainee, and their sessions.
pub(super) async fn erased_with(
    tx: &mut sqlx::SqliteConnection,
    id: TraineeId,
) -> StoreResult<(Vec<TraineeId>, Vec<SessionId>)> {
    let records: Vec<TraineeId> = trainees_merged_into(tx, id).await?.into_iter().chain([id]).collect();
    let mut sessions: Vec<SessionId> = Vec::new();
    for record in &records {
        let of_record = sqlx::query_scalar(SELECT_SESSIONS_OF_TRAINEE).bind(record).fetch_all(&mut *tx).await?;
        sessions.extend::<Vec<SessionId>>(of_record);
    }
    Ok((records, sessions))
}

/// Erases a trainee with the records that were merged into theirs, as [`TraineeStore::erase`] does. A session of theirs that
/// was moved from another person may be hidden with a record of that person once more: it is erased, too.
pub(super) async fn erase(
    tx: &mut sqlx::SqliteConnection,
    scope: &Scope,
    now_ms: i64,
    id: TraineeId,
) -> StoreResult<()> {
    give_back_trainee(tx, id, now_ms).await?;
    let (records, sessions) = erased_with(tx, id).await?;
    erase_twins(tx, scope, &sessions, now_ms).await?; // of records that are merged into those of others
    for record in records {
        erase_record(tx, scope, now_ms, record).await?;
    }
    Ok(())
}

/// Erases a trainee's record alone, again in a restored backup. A record that is merged into it there is separated: its own
/// erasure is on the list, unless the two were separated before this one. What was merged into that record stays so. If this
/// record is merged into another one there, the two are separated, since they were before it was erased alone.
pub(super) async fn erase_again(
    tx: &mut sqlx::SqliteConnection,
    scope: &Scope,
    now_ms: i64,
    id: TraineeId,
) -> StoreResult<()> {
    give_back_trainee(tx, id, now_ms).await?;
    separate_trainees_from(tx, id, &[], now_ms).await?;
    erase_record(tx, scope, now_ms, id).await
}

async fn erase_record(tx: &mut sqlx::SqliteConnection, scope: &Scope, now_ms: i64, id: TraineeId) -> StoreResult<()> {
    skill_models::withdraw(tx, id, now_ms).await?;
    forget_box_jobs_of_trainee(tx, id).await?;
    let sessions: Vec<SessionId> = sqlx::query_scalar(SELECT_SESSIONS_OF_TRAINEE).bind(id).fetch_all(&mut *tx).await?;
    certificates::mark(tx, scope, &sessions, CertificateEventKind::SessionErased, now_ms).await?;
    let account: Option<PersonId> =
        sqlx::query_scalar(SELECT_ACCOUNT_OF_TRAINEE).bind(id).fetch_optional(&mut *tx).await?;
    if let Some(account) = account {
        withdraw_tokens(tx, (scope, now_ms), account, None).await?;
    }
    if sqlx::query(DELETE_TRAINEE).bind(id).execute(&mut *tx).await?.rows_affected() == 0 {
        return Err(not_found("trainee"));
    }
    note(tx, scope, now_ms, ("erase", "trainee"), id).await
}

pub(super) async fn insert(tx: &mut sqlx::SqliteConnection, trainee: &TraineeRecord) -> StoreResult<()> {
    let insert = sqlx::query(INSERT_TRAINEE).bind(trainee.id).bind(&trainee.code).bind(&trainee.name);
    let insert = insert.bind(trainee.level).bind(trainee.handedness).bind(trainee.created_at_ms);
    insert.execute(tx).await.map_err(taken("code"))?;
    Ok(())
}

/// The group that a new trainee joins: the one that an administrator chooses; for an instructor the named or the only
/// one of their own groups.
async fn joined_group(
    tx: &mut sqlx::SqliteConnection,
    scope: &Scope,
    wanted: Option<GroupId>,
) -> StoreResult<Option<GroupId>> {
    if scope.role() != Role::Instructor {
        return Ok(wanted);
    }
    let own: Vec<GroupId> = sqlx::query_scalar(SELECT_TAUGHT_GROUPS).bind(scope.subject()).fetch_all(tx).await?;
    match (wanted, own.as_slice()) {
        (Some(group), own) if own.contains(&group) => Ok(Some(group)),
        (Some(_), _) => Err(not_found("group")),
        (None, [only]) => Ok(Some(*only)),
        (None, []) => Err(StoreError::refused(
            "you teach no group yet: make one first, or ask an administrator to add you to one",
        )),
        (None, _) => Err(StoreError::refused("you teach several groups: name the one that the trainee joins")),
    }
}
