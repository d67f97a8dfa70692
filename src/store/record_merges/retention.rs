//! What merges do with the own months for keeping videos: the shorter time of the two records counts. Months that were set
//! since a merge belong to the kept record: a separation does not give them to the other one, and a merge that is done
//! again does not replace them.

use serde::{Deserialize, Serialize};
use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::super::personal_retention::due_videos;
use super::*;
use crate::domain::personal_retention::kept_months;
use crate::domain::record_merge::MergedPart as Part;

/// Months of a trainee, as the table has them.
#[derive(Debug, Serialize, Deserialize, sqlx::FromRow)]
struct OwnMonthsRow {
    months: u32,
    reason: Option<Remark>,
    person_id: Option<PersonId>,
    changed_at_ms: i64,
}

impl OwnMonthsRow {
    /// True if videos are kept for a shorter time than with `other`; 0 months are for ever.
    fn is_shorter_than(&self, other: &Self) -> bool {
        self.months != 0 && (other.months == 0 || self.months < other.months)
    }

    /// True if they are the same decision. The person who took it may have been deleted since.
    fn is_decision(&self, other: &Self) -> bool {
        (self.months, &self.reason, self.changed_at_ms) == (other.months, &other.reason, other.changed_at_ms)
    }
}

/// Gives the months of `$1` to `$2`, unless that one has its own.
pub(super) const TAKE: &str = "UPDATE OR IGNORE trainee_retention SET trainee_id = $2 WHERE trainee_id = $1";

const SELECT: &str = "
    SELECT months, reason, person_id, changed_at_ms FROM trainee_retention WHERE trainee_id = $1";

const DELETE: &str = "DELETE FROM trainee_retention WHERE trainee_id = $1";

const NOTE_REPLACED: &str = "UPDATE record_merge SET kept_retention = $2 WHERE id = $1";

const NOTE_AFTER: &str = "UPDATE record_merge SET retention_after = $2 WHERE id = $1";

const SELECT_NOTES: &str = "
    SELECT kept_retention, retention_after,
           EXISTS (SELECT 1 FROM record_merge_row WHERE merge_id = record_merge.id AND part = 'retention')
    FROM record_merge WHERE id = $1";

/// Months that were replaced, months after the merge, and whether these are those of the merged record.
type NotesRow = (Option<Json<OwnMonthsRow>>, Option<Json<Option<OwnMonthsRow>>>, bool);

/// The person who set them may have been deleted since.
const INSERT: &str = "
    INSERT INTO trainee_retention (trainee_id, months, reason, person_id, changed_at_ms)
    VALUES ($1, $2, $3, (SELECT id FROM person WHERE id = $4), $5) ON CONFLICT DO NOTHING";

/// Lets the months of `merged` follow if those of `kept` are longer, or if it has none. Returns what it did, unless neither
/// has any.
pub(super) async fn take(
    tx: &mut SqliteConnection,
    merge: MergeId,
    [kept, merged]: [TraineeId; 2],
) -> StoreResult<Option<MergedCount>> {
    let (own, other) = (own_months(tx, kept).await?, own_months(tx, merged).await?);
    let is_shorter = own.as_ref().zip(other.as_ref()).is_some_and(|(own, other)| other.is_shorter_than(own));
    let (replaced, has_other) = (own.filter(|_| is_shorter), other.is_some());
    if replaced.is_some() {
        sqlx::query(DELETE).bind(kept).execute(&mut *tx).await?;
    }
    sqlx::query(NOTE_REPLACED).bind(merge).bind(replaced.map(Json)).execute(&mut *tx).await?;
    let has_followed = sqlx::query(TAKE).bind(merged).bind(kept).execute(&mut *tx).await?.rows_affected() > 0;
    if has_followed {
        sqlx::query(LIST_ROWS).bind(merge).bind(Part::Retention).bind(Json([merged])).execute(&mut *tx).await?;
    }
    let after = own_months(tx, kept).await?;
    sqlx::query(NOTE_AFTER).bind(merge).bind(Json(after)).execute(tx).await?;
    let (follow, stay) = (i64::from(has_followed), i64::from(!has_followed));
    Ok(has_other.then_some(MergedCount { part: Part::Retention, follow, stay }))
}

/// Gives the months back that followed with a merge, and the kept record those that they replaced. Months that the kept
/// record got since stay with it; returns false then.
pub(super) async fn give_back(
    tx: &mut SqliteConnection,
    merge: MergeId,
    [kept, merged]: [TraineeId; 2],
) -> StoreResult<bool> {
    let (replaced, after, have_followed): NotesRow =
        sqlx::query_as(SELECT_NOTES).bind(merge).fetch_one(&mut *tx).await?;
    let now = own_months(tx, kept).await?;
    let is_unchanged = match (&now, &after) {
        (Some(now), Some(Json(Some(after)))) => now.is_decision(after),
        (None, Some(Json(None))) => true,
        _ => false,
    };
    let Some(Json(Some(months))) = after.filter(|_| have_followed) else { return Ok(is_unchanged) };
    if is_unchanged {
        sqlx::query(DELETE).bind(kept).execute(&mut *tx).await?;
        if let Some(Json(replaced)) = replaced {
            insert(tx, kept, replaced).await?;
        }
    }
    insert(tx, merged, months).await?;
    Ok(is_unchanged)
}

async fn own_months(tx: &mut SqliteConnection, trainee: TraineeId) -> StoreResult<Option<OwnMonthsRow>> {
    Ok(sqlx::query_as(SELECT).bind(trainee).fetch_optional(tx).await?)
}

async fn insert(tx: &mut SqliteConnection, trainee: TraineeId, row: OwnMonthsRow) -> StoreResult<()> {
    let insert = sqlx::query(INSERT).bind(trainee).bind(row.months).bind(row.reason).bind(row.person_id);
    insert.bind(row.changed_at_ms).execute(tx).await?;
    Ok(())
}

/// The number of a trainee's videos that are due to be deleted.
pub(super) async fn due(
    tx: &mut SqliteConnection,
    trainee: TraineeId,
    centre_months: u32,
    now_ms: i64,
) -> StoreResult<u64> {
    let own = own_months(tx, trainee).await?;
    let months = kept_months(centre_months, own.map(|own| (own.months, own.reason.is_some())));
    Ok(due_videos(tx, trainee, months, now_ms).await?.0)
}
