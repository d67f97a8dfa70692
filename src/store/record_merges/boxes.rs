//! Merges of two records of one box.
//!
//! The rules for clashes: name, code, view and notes of the kept record count. The versions of the merged record's camera
//! and colours follow with higher numbers; a recording is tracked with the version of its day, as
//! before. Results stay: a session keeps the versions that it was tracked with. Two records that have the same
//! recording of the same trainee and task are not merged, since it would count once only.

use sqlx::sqlite::SqliteConnection;

use super::super::audit::note;
use super::super::exams::refuse_if_running;
use super::super::jobs::enqueue_waiting_sessions;
use super::super::session_moves::enqueue_for_box;
use super::*;
use crate::domain::record_merge::MergedPart as Part;
use crate::domain::text::Key;
use crate::ids::{BoxId, SessionId};

/// What follows a box, in this order, besides the versions of its camera and colours.
pub(super) const OF_BOX: &[Followed] = &[
    Followed {
        part: Part::Sessions,
        take: "UPDATE OR IGNORE session SET box_id = $2 WHERE box_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE session SET box_id = $1
    WHERE box_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM session WHERE box_id = $1",
    },
    Followed {
        part: Part::Answers,
        take: "UPDATE OR IGNORE session_edit SET box_id = $2 WHERE box_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE session_edit SET box_id = $1
    WHERE box_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM session_edit WHERE box_id = $1",
    },
    Followed {
        part: Part::Uploads,
        take: "UPDATE OR IGNORE upload SET box_id = $2 WHERE box_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE upload SET box_id = $1
    WHERE box_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM upload WHERE box_id = $1",
    },
    Followed {
        part: Part::Exams,
        take: "UPDATE OR IGNORE exam SET box_id = $2 WHERE box_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE exam SET box_id = $1
    WHERE box_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM exam WHERE box_id = $1",
    },
    Followed {
        part: Part::WaitingRecordings,
        take: "UPDATE OR IGNORE waiting_recording SET box_id = $2 WHERE box_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE waiting_recording SET box_id = $1
    WHERE box_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM waiting_recording WHERE box_id = $1",
    },
    Followed {
        part: Part::Feeds,
        take: "UPDATE OR IGNORE feed SET box_id = $2 WHERE box_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE feed SET box_id = $1
    WHERE box_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM feed WHERE box_id = $1",
    },
    Followed {
        part: Part::SelfTests,
        take: "UPDATE OR IGNORE self_test SET box_id = $2 WHERE box_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE self_test SET box_id = $1
    WHERE box_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM self_test WHERE box_id = $1",
    },
    Followed {
        part: Part::Jobs,
        take: "UPDATE OR IGNORE job SET box_id = $2 WHERE box_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE job SET box_id = $1
    WHERE box_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM job WHERE box_id = $1",
    },
    Followed {
        part: Part::Tokens,
        take: "UPDATE OR IGNORE token SET box_id = $2 WHERE box_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE token SET box_id = $1
    WHERE box_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM token WHERE box_id = $1",
    },
    Followed {
        part: Part::Groups,
        take: "UPDATE OR IGNORE ownership SET box_id = $2 WHERE box_id = $1 RETURNING group_id",
        give_back: "
    UPDATE OR IGNORE ownership SET box_id = $1
    WHERE box_id = $2 AND group_id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM ownership WHERE box_id = $1",
    },
];

/// Versions that follow with higher numbers.
pub(super) struct FollowedVersions {
    part: MergedPart,
    /// Lists the versions of `$3` with their numbers.
    list: &'static str,
    /// Gives the versions of `$1` to `$2`, with numbers above `$3`.
    pub(super) take: &'static str,
    /// The highest number of `$1`.
    highest: &'static str,
    /// Gives those of merge `$3` back to `$1`, with their old numbers.
    give_back: &'static str,
}

pub(super) const VERSIONS_OF_BOX: [FollowedVersions; 2] = [
    FollowedVersions {
        part: Part::Calibrations,
        list: "
    INSERT INTO record_merge_row (merge_id, part, row_key, version)
    SELECT $1, $2, id, version FROM calibration WHERE box_id = $3",
        take: "UPDATE calibration SET box_id = $2, version = version + $3 WHERE box_id = $1",
        highest: "SELECT coalesce(max(version), 0) FROM calibration WHERE box_id = $1",
        give_back: "
    UPDATE calibration SET box_id = $1, version = listed.version
    FROM (SELECT row_key, version FROM record_merge_row WHERE merge_id = $3 AND part = $4) AS listed
    WHERE calibration.id = listed.row_key AND box_id = $2",
    },
    FollowedVersions {
        part: Part::Palettes,
        list: "
    INSERT INTO record_merge_row (merge_id, part, row_key, version)
    SELECT $1, $2, id, version FROM palette WHERE box_id = $3",
        take: "UPDATE palette SET box_id = $2, version = version + $3 WHERE box_id = $1",
        highest: "SELECT coalesce(max(version), 0) FROM palette WHERE box_id = $1",
        give_back: "
    UPDATE palette SET box_id = $1, version = listed.version
    FROM (SELECT row_key, version FROM record_merge_row WHERE merge_id = $3 AND part = $4) AS listed
    WHERE palette.id = listed.row_key AND box_id = $2",
    },
];

const INSERT_MERGE: &str = "
    INSERT INTO record_merge (id, kept_box_id, merged_box_id, person_id, why, created_at_ms)
    SELECT $1, $2, $3, $4, $5, $6 WHERE (SELECT count(*) FROM record_merge WHERE kept_box_id = $2) < $7";

const SELECT_IS_MERGED: &str = "SELECT EXISTS (SELECT 1 FROM merged_box WHERE box_id IN ($1, $2))";

const SELECT_IS_BUSY: &str = "
    SELECT EXISTS (SELECT 1 FROM session WHERE box_id IN ($1, $2) AND video IS NULL)
        OR EXISTS (SELECT 1 FROM job LEFT JOIN session ON session.id = job.session_id
                   WHERE job.state IN ('queued', 'running')
                     AND (job.box_id IN ($1, $2) OR session.box_id IN ($1, $2)))";

const COUNT_TWINS: &str = "
    SELECT count(*) FROM session JOIN session AS other
      ON other.trainee_id = session.trainee_id AND other.task_id = session.task_id AND other.video = session.video
         AND coalesce(other.cut_of, other.id) <> coalesce(session.cut_of, session.id)
    WHERE session.box_id = $1 AND other.box_id = $2";

const SELECT_MERGE: &str = "
    SELECT merged_box_id, separated_at_ms IS NOT NULL FROM record_merge WHERE id = $1 AND kept_box_id = $2";

const SELECT_LATER_MERGES: &str = "
    SELECT id, merged_box_id FROM record_merge
    WHERE kept_box_id = $1 AND separated_at_ms IS NULL AND rowid > (SELECT rowid FROM record_merge WHERE id = $2)
    ORDER BY rowid";

const SELECT_MERGED_INTO: &str = "SELECT box_id FROM merged_box WHERE kept_id = $1";

/// Sessions of the boxes `$1` and `$2` that have results, but none that counts in their box.
const SELECT_WITHOUT_RESULT: &str = "
    SELECT session.id FROM session
    WHERE session.box_id IN ($1, $2) AND session.video IS NOT NULL AND session.tracker IS NULL
      AND EXISTS (SELECT 1 FROM result WHERE result.session_id = session.id)
      AND NOT EXISTS (SELECT 1 FROM current_result WHERE current_result.session_id = session.id)";

impl RecordMergeStore<'_> {
    /// The merges of other records into this box, newest first, also of those that were separated.
    pub async fn of_box(&self, scope: &Scope, kept: BoxId) -> StoreResult<Vec<RecordMerge>> {
        require_administrator(scope, "merges of records")?;
        self.0.boxes().get(scope, &Key::from(&kept)).await?;
        read(self.0, kept.to_string()).await
    }

    /// What merging these two records of one box would do. Nothing is changed.
    pub async fn preview_boxes(&self, scope: &Scope, [kept, merged]: [BoxId; 2]) -> StoreResult<MergeEffect> {
        require_administrator(scope, "merging records of boxes")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        let preview = async move |tx: &mut SqliteConnection| {
            merge(tx, (&by, &Remark::from_stored("–".to_owned()), now_ms), [kept, merged]).await
        };
        preview_of(self.0, preview).await
    }

    /// Merges two records of one box, in one transaction: `merged` is hidden, and what belongs to it follows `kept`.
    /// Sessions that waited for a camera or colours are queued if there are some now.
    ///
    /// # Errors
    /// They are the same, a recording is arriving or being tracked, or both have the same recording.
    pub async fn merge_boxes(
        &self,
        scope: &Scope,
        [kept, merged]: [BoxId; 2],
        why: Remark,
    ) -> StoreResult<RecordMerge> {
        require_administrator(scope, "merging records of boxes")?;
        let (by, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        self.0
            .write_ending_sign_ins(async move |tx| {
                merge(tx, (&by, &why, now_ms), [kept, merged]).await?;
                enqueue_waiting_sessions(tx, kept, now_ms, attempts).await?;
                note(tx, &by, now_ms, ("merge", "box"), kept).await
            })
            .await?;
        let all = read(self.0, kept.to_string()).await?;
        let mut made = all.into_iter().filter(|made| made.separated_at_ms.is_none());
        made.find(|made| made.merged.id == merged.to_string()).ok_or(not_found("merge"))
    }

    /// Separates two merged records of one box, in one transaction: the hidden one gets back what followed, and is shown
    /// again. What arrived since the merge stays with the kept record; a session among it that was tracked with the camera of
    /// the other one is tracked again.
    ///
    /// # Errors
    /// They are separated already, a recording is arriving or being tracked, the kept record itself was merged into
    /// another one, or a session would have to be tracked again whose video was deleted.
    pub async fn separate_boxes(
        &self,
        scope: &Scope,
        kept: BoxId,
        id: MergeId,
        why: Remark,
    ) -> StoreResult<RecordMerge> {
        require_administrator(scope, "separating records of boxes")?;
        let (by, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        self.0
            .write_ending_sign_ins(async move |tx| {
                let found = sqlx::query_as(SELECT_MERGE).bind(id).bind(kept).fetch_optional(&mut *tx).await?;
                let (merged, is_separated): (BoxId, bool) = found.ok_or(not_found("merge"))?;
                if is_separated {
                    return Err(StoreError::refused("the two records are separated already"));
                }
                refuse_unready(tx, [kept, kept]).await?;
                refuse_if_running(tx, [kept, kept]).await?;
                separate(tx, (&by, &why, now_ms), id, [kept, merged]).await?;
                let unmeasured = sqlx::query_scalar(SELECT_WITHOUT_RESULT).bind(kept).bind(merged);
                let unmeasured: Vec<SessionId> = unmeasured.fetch_all(&mut *tx).await?;
                for session in unmeasured {
                    enqueue_for_box(tx, session, false, now_ms, attempts).await?;
                }
                note(tx, &by, now_ms, ("separate", "box"), kept).await
            })
            .await?;
        read(self.0, kept.to_string()).await?.into_iter().find(|made| made.id == id).ok_or(not_found("merge"))
    }
}

async fn merge(
    tx: &mut SqliteConnection,
    (by, why, now_ms): (&Scope, &Remark, i64),
    [kept, merged]: [BoxId; 2],
) -> StoreResult<MergeEffect> {
    if kept == merged {
        return Err(StoreError::refused("both are the same record: choose another one"));
    }
    refuse_unready(tx, [kept, merged]).await?;
    refuse_if_running(tx, [kept, merged]).await?;
    let twins: i64 = sqlx::query_scalar(COUNT_TWINS).bind(merged).bind(kept).fetch_one(&mut *tx).await?;
    if twins > 0 {
        return Err(StoreError::refused(format!(
            "both records have the same recording of the same trainee and task ({twins}): erase one session of each pair, \
             then merge the records"
        )));
    }
    let id = MergeId::at(now_ms);
    let insert = sqlx::query(INSERT_MERGE).bind(id).bind(kept).bind(merged).bind(by.person()).bind(why);
    if insert.bind(now_ms).bind(MAX_MERGES).execute(&mut *tx).await?.rows_affected() == 0 {
        return Err(StoreError::refused(format!("{MAX_MERGES} records were merged into this one, which is the limit")));
    }
    Ok(MergeEffect { counts: follow(tx, id, [kept, merged]).await?, ..MergeEffect::default() })
}

async fn follow(tx: &mut SqliteConnection, id: MergeId, [kept, merged]: [BoxId; 2]) -> StoreResult<Vec<MergedCount>> {
    let ids = [merged.to_string(), kept.to_string()];
    let mut counts = take(tx, id, OF_BOX, [&ids[0], &ids[1]]).await?;
    for FollowedVersions { part, list, take, highest, .. } in &VERSIONS_OF_BOX {
        let (part, list, take, highest) = (*part, *list, *take, *highest);
        let highest: i64 = sqlx::query_scalar(highest).bind(kept).fetch_one(&mut *tx).await?;
        sqlx::query(list).bind(id).bind(part).bind(merged).execute(&mut *tx).await?;
        let taken = sqlx::query(take).bind(merged).bind(kept).bind(highest).execute(&mut *tx).await?.rows_affected();
        if taken > 0 {
            counts.push(MergedCount { part, follow: i64::try_from(taken).unwrap_or(i64::MAX), stay: 0 });
        }
    }
    Ok(counts)
}

async fn unfollow(tx: &mut SqliteConnection, id: MergeId, [kept, merged]: [BoxId; 2]) -> StoreResult<()> {
    for FollowedVersions { part, give_back, .. } in &VERSIONS_OF_BOX {
        let give_back = *give_back;
        sqlx::query(give_back).bind(merged).bind(kept).bind(id).bind(*part).execute(&mut *tx).await?;
    }
    let ids = [merged.to_string(), kept.to_string()];
    give_back(tx, id, OF_BOX, [&ids[0], &ids[1]]).await?;
    forget_rows(tx, id).await
}

/// Separates two records. The later merges into the kept one are done again, since more may follow now.
async fn separate(
    tx: &mut SqliteConnection,
    (by, why, now_ms): (&Scope, &Remark, i64),
    id: MergeId,
    [kept, merged]: [BoxId; 2],
) -> StoreResult<()> {
    let later: Vec<(MergeId, BoxId)> =
        sqlx::query_as(SELECT_LATER_MERGES).bind(kept).bind(id).fetch_all(&mut *tx).await?;
    for (other, other_merged) in later.iter().rev() {
        unfollow(tx, *other, [kept, *other_merged]).await?;
    }
    unfollow(tx, id, [kept, merged]).await?;
    mark_separated(tx, id, (by, why), now_ms).await?;
    for (other, other_merged) in later {
        follow(tx, other, [kept, other_merged]).await?;
    }
    Ok(())
}

/// The records that were merged into this one.
pub(in crate::store) async fn merged_into(tx: &mut SqliteConnection, kept: BoxId) -> StoreResult<Vec<BoxId>> {
    Ok(sqlx::query_scalar(SELECT_MERGED_INTO).bind(kept).fetch_all(tx).await?)
}

async fn refuse_unready(tx: &mut SqliteConnection, [kept, merged]: [BoxId; 2]) -> StoreResult<()> {
    if sqlx::query_scalar(SELECT_IS_MERGED).bind(kept).bind(merged).fetch_one(&mut *tx).await? {
        return Err(StoreError::refused("one of the records was merged into another one: separate those two first"));
    }
    if sqlx::query_scalar(SELECT_IS_BUSY).bind(kept).bind(merged).fetch_one(tx).await? {
        return Err(StoreError::refused(
            "a recording of the box is arriving or being measured, or its camera or colours are: wait until that has \
             ended",
        ));
    }
    Ok(())
}
