//! Merges of two records of one person, or of one box. What belongs to the merged record follows the kept one, and the
//! merged record is hidden; its id and code lead to the kept one. Each row that follows is on a list, so that the records
//! can be separated again.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | what both kinds of merges share |
//! | `trainees.rs` | what follows a person, and the rules for clashes |
//! | `retention.rs` | the months for which a person's videos are kept |
//! | `boxes.rs` | what follows a box |
//!
//! A new table that refers to trainees, accounts or boxes needs one entry in the list of its file; a test names tables
//! that lack one. A row that cannot follow, because the kept record has the same already, stays with the merged record.
//! It counts nowhere meanwhile.

mod boxes;
mod retention;
mod trainees;

use std::sync::mpsc;

use serde::Deserialize;
use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::error::{StoreError, StoreResult, not_found};
use super::session_moves::FiledUnder;
use super::visibility::require_administrator;
use super::{Scope, Store};
use crate::domain::consent::ConsentState;
use crate::domain::record_merge::MergedPart;
use crate::domain::text::{Name, Remark};
use crate::ids::{MergeId, PersonId, TraineeId};

pub use trainees::MergedRecord;

pub(super) use boxes::merged_into as boxes_merged_into;
pub(super) use trainees::{
    give_back_all as give_back_trainee, holder_of as trainee_holder_of, merged_into as trainees_merged_into,
    separate_all_of as separate_trainees_from,
};

/// Access to the merges.
pub struct RecordMergeStore<'s>(pub(super) &'s Store);

/// Maximum number of merges of one record.
const MAX_MERGES: i64 = 200;

/// The rows of one table that follow the kept record.
struct Followed {
    part: MergedPart,
    /// Gives the rows of `$1` to `$2`, except those that `$2` has already, and returns their keys.
    take: &'static str,
    /// Gives those rows of merge `$3` back to `$1` that `$2` still has.
    give_back: &'static str,
    /// Counts what is left with `$1`.
    count: &'static str,
}

/// How many rows of a part follow, and how many stay with the merged record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub struct MergedCount {
    /// What the rows are.
    pub part: MergedPart,
    /// Number of rows that follow the kept record.
    pub follow: i64,
    /// Number of rows that stay with the merged record, because the kept one has the same.
    pub stay: i64,
}

/// What a merge does.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MergeEffect {
    /// The rows; parts without any are left out.
    pub counts: Vec<MergedCount>,
    /// The kept record takes over the level.
    pub takes_level: bool,
    /// The kept record takes over the preferred hand.
    pub takes_handedness: bool,
    /// Videos that are deleted at once, because the shorter of two times for keeping videos counts.
    pub due_videos: u64,
    /// Whether the person consents to recordings afterwards; `None` for a box.
    pub consent: Option<ConsentState>,
    /// Login of the account that cannot sign in any more.
    pub closed_login: Option<String>,
    /// Accounts that were signed out.
    signed_out: Vec<PersonId>,
}

/// A merge of two records.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct RecordMerge {
    /// Its id.
    pub id: MergeId,
    /// The merged record.
    #[sqlx(json)]
    pub merged: FiledUnder,
    /// What follows the kept record, while they are merged.
    #[sqlx(json)]
    pub follow: Vec<PartCount>,
    /// The reason.
    pub why: Remark,
    /// Name of the person; `None` if the account has been deleted, or for the service.
    pub who: Option<Name>,
    /// When, epoch ms.
    pub created_at_ms: i64,
    /// Why they were separated; `None`: they are merged.
    pub separated_why: Option<Remark>,
    /// Name of the person who separated them.
    pub separated_who: Option<Name>,
    /// When, epoch ms.
    pub separated_at_ms: Option<i64>,
}

/// Number of rows of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub struct PartCount {
    /// What the rows are.
    pub part: MergedPart,
    /// How many there are.
    pub rows: i64,
}

const SELECT_MERGES: &str = "
    SELECT merge.id, merge.why, maker.name AS who, merge.created_at_ms, merge.separated_why,
           separator.name AS separated_who, merge.separated_at_ms,
           (SELECT json_object('id', record.id, 'name', record.name, 'code', record.code)
            FROM (SELECT id, name, code FROM trainee UNION ALL SELECT id, name, code FROM training_box) AS record
            WHERE record.id = coalesce(merge.merged_trainee_id, merge.merged_box_id)) AS merged,
           (SELECT json_group_array(json_object('part', part, 'rows', rows))
            FROM (SELECT part, count(*) AS rows FROM record_merge_row WHERE merge_id = merge.id GROUP BY part)) AS follow
    FROM record_merge AS merge
    LEFT JOIN person AS maker ON maker.id = merge.person_id
    LEFT JOIN person AS separator ON separator.id = merge.separated_by
    WHERE $1 IN (merge.kept_trainee_id, merge.kept_box_id) ORDER BY merge.rowid DESC LIMIT $2";

const LIST_ROWS: &str = "
    INSERT INTO record_merge_row (merge_id, part, row_key) SELECT $1, $2, value FROM json_each($3)
    WHERE TRUE ON CONFLICT DO NOTHING";

const DELETE_ROWS: &str = "DELETE FROM record_merge_row WHERE merge_id = $1";

const SEPARATE: &str = "
    UPDATE record_merge SET separated_by = $2, separated_why = $3, separated_at_ms = $4
    WHERE id = $1 AND separated_at_ms IS NULL";

/// The merges of this record, newest first, also of those that were separated.
async fn read(store: &Store, kept: String) -> StoreResult<Vec<RecordMerge>> {
    Ok(sqlx::query_as(SELECT_MERGES).bind(kept).bind(MAX_MERGES).fetch_all(store.readers()).await?)
}

/// Gives the rows of `from` to `to`, lists them, and counts what stays.
async fn take(
    tx: &mut SqliteConnection,
    merge: MergeId,
    followed: &[Followed],
    [from, to]: [&str; 2],
) -> StoreResult<Vec<MergedCount>> {
    let mut counts = Vec::new();
    for Followed { part, take, count, .. } in followed {
        let (take, count) = (*take, *count);
        let keys: Vec<String> = sqlx::query_scalar(take).bind(from).bind(to).fetch_all(&mut *tx).await?;
        let stay: i64 = sqlx::query_scalar(count).bind(from).fetch_one(&mut *tx).await?;
        let follow = i64::try_from(keys.len()).unwrap_or(i64::MAX);
        if follow > 0 {
            sqlx::query(LIST_ROWS).bind(merge).bind(*part).bind(Json(keys)).execute(&mut *tx).await?;
        }
        if follow + stay > 0 {
            counts.push(MergedCount { part: *part, follow, stay });
        }
    }
    Ok(counts)
}

/// Gives the rows of a merge back.
async fn give_back(
    tx: &mut SqliteConnection,
    merge: MergeId,
    followed: &[Followed],
    [to, from]: [&str; 2],
) -> StoreResult<()> {
    for Followed { part, give_back, .. } in followed.iter().rev() {
        let give_back = *give_back;
        sqlx::query(give_back).bind(to).bind(from).bind(merge).bind(*part).execute(&mut *tx).await?;
    }
    Ok(())
}

/// Marks a merge as separated.
async fn mark_separated(
    tx: &mut SqliteConnection,
    merge: MergeId,
    (by, why): (&Scope, &Remark),
    now_ms: i64,
) -> StoreResult<()> {
    let separate = sqlx::query(SEPARATE).bind(merge).bind(by.person()).bind(why).bind(now_ms);
    if separate.execute(&mut *tx).await?.rows_affected() == 0 {
        return Err(StoreError::refused("the two records are separated already"));
    }
    Ok(())
}

/// Empties the list of what followed.
async fn forget_rows(tx: &mut SqliteConnection, merge: MergeId) -> StoreResult<()> {
    sqlx::query(DELETE_ROWS).bind(merge).execute(tx).await?;
    Ok(())
}

/// What this work would do: its transaction is undone.
async fn preview_of<F>(store: &Store, work: F) -> StoreResult<MergeEffect>
where
    F: AsyncFnOnce(&mut SqliteConnection) -> StoreResult<MergeEffect> + Send + 'static,
{
    let (send, effect) = mpsc::channel();
    let undone = store.write(async move |tx| {
        let done = work(tx).await?;
        if send.send(done).is_err() {
            tracing::debug!("the preview of a merge is not awaited any more");
        }
        Err::<(), _>(StoreError::refused("this was a preview"))
    });
    match (undone.await, effect.try_recv()) {
        (_, Ok(effect)) => Ok(effect),
        (Err(error), Err(_)) => Err(error),
        (Ok(()), Err(_)) => Err(not_found("preview")),
    }
}

/// The statements that let rows follow.
#[cfg(test)]
pub(super) fn take_statements() -> Vec<&'static str> {
    let followed = trainees::OF_TRAINEE.iter().chain(trainees::OF_ACCOUNT).chain(boxes::OF_BOX);
    let versions = boxes::VERSIONS_OF_BOX.iter().map(|of| of.take);
    followed.map(|of| of.take).chain([retention::TAKE]).chain(versions).collect()
}
