//! Merges of two records of one person.
//!
//! The rules for clashes: name, code, level and preferred hand of the kept record count; what it lacks of the last two, it
//! takes over. Of two decisions about recordings the latest counts, of two times for keeping videos the shorter one. If
//! both have an account, that of the merged record is closed, and its identities, tokens and comments follow. A recording
//! that both records have stays with the merged record. Memberships that both have are one.

use sqlx::sqlite::SqliteConnection;

use super::super::audit::note;
use super::super::consents::state_of;
use super::super::cookies::DELETE_COOKIES_OF;
use super::super::exams::{refuse_if_running, refuse_if_twin};
use super::super::password_links::DELETE_LINK_OF;
use super::super::skill_models;
use super::*;
use crate::domain::record_merge::MergedPart as Part;
use crate::domain::text::{Code, Key, Login};
use crate::domain::trainee::{Handedness, Level};

/// What follows a trainee, in this order. Entries of the access log about a session follow it by a trigger.
pub(super) const OF_TRAINEE: &[Followed] = &[
    Followed {
        part: Part::Sessions,
        take: "
    UPDATE OR IGNORE session SET trainee_id = $2
    WHERE trainee_id = $1
      AND NOT EXISTS (SELECT 1 FROM session AS same WHERE same.trainee_id = $2 AND same.task_id = session.task_id
                      AND coalesce(same.cut_of, same.id) <> coalesce(session.cut_of, session.id)
                      AND (same.path_hash = session.path_hash
                           OR same.box_id = session.box_id AND same.video = session.video))
    RETURNING id",
        give_back: "
    UPDATE OR IGNORE session SET trainee_id = $1
    WHERE trainee_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM session WHERE trainee_id = $1",
    },
    Followed {
        part: Part::Uploads,
        take: "UPDATE OR IGNORE upload SET trainee_id = $2 WHERE trainee_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE upload SET trainee_id = $1
    WHERE trainee_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM upload WHERE trainee_id = $1",
    },
    Followed {
        part: Part::Groups,
        take: "UPDATE OR IGNORE group_trainee SET trainee_id = $2 WHERE trainee_id = $1 RETURNING group_id",
        give_back: "
    UPDATE OR IGNORE group_trainee SET trainee_id = $1
    WHERE trainee_id = $2 AND group_id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM group_trainee WHERE trainee_id = $1",
    },
    Followed {
        part: Part::Cohorts,
        take: "UPDATE OR IGNORE cohort_member SET trainee_id = $2 WHERE trainee_id = $1 RETURNING cohort_id",
        give_back: "
    UPDATE OR IGNORE cohort_member SET trainee_id = $1
    WHERE trainee_id = $2 AND cohort_id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM cohort_member WHERE trainee_id = $1",
    },
    Followed {
        part: Part::Consents,
        take: "UPDATE OR IGNORE consent SET trainee_id = $2 WHERE trainee_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE consent SET trainee_id = $1
    WHERE trainee_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM consent WHERE trainee_id = $1",
    },
    Followed {
        part: Part::AccessEntries,
        take: "
    UPDATE OR IGNORE access_entry SET trainee_id = $2 WHERE trainee_id = $1 AND session_id IS NULL
    RETURNING CAST(id AS TEXT)",
        give_back: "
    UPDATE OR IGNORE access_entry SET trainee_id = $1
    WHERE trainee_id = $2
      AND CAST(id AS TEXT) IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM access_entry WHERE trainee_id = $1 AND session_id IS NULL",
    },
    Followed {
        part: Part::Dismissals,
        take: "UPDATE OR IGNORE attention_dismissal SET trainee_id = $2 WHERE trainee_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE attention_dismissal SET trainee_id = $1
    WHERE trainee_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM attention_dismissal WHERE trainee_id = $1",
    },
    Followed {
        part: Part::Certificates,
        take: "UPDATE OR IGNORE certificate SET trainee_id = $2 WHERE trainee_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE certificate SET trainee_id = $1
    WHERE trainee_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM certificate WHERE trainee_id = $1",
    },
    Followed {
        part: Part::Exams,
        take: "UPDATE OR IGNORE exam SET trainee_id = $2 WHERE trainee_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE exam SET trainee_id = $1
    WHERE trainee_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM exam WHERE trainee_id = $1",
    },
    Followed {
        part: Part::WaitingRecordings,
        take: "UPDATE OR IGNORE waiting_recording SET trainee_id = $2 WHERE trainee_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE waiting_recording SET trainee_id = $1
    WHERE trainee_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM waiting_recording WHERE trainee_id = $1",
    },
    Followed {
        part: Part::Account,
        take: "UPDATE OR IGNORE person SET trainee_id = $2 WHERE trainee_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE person SET trainee_id = $1
    WHERE trainee_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM person WHERE trainee_id = $1",
    },
];

/// What follows an account into the account of the kept record.
pub(super) const OF_ACCOUNT: &[Followed] = &[
    Followed {
        part: Part::Comments,
        take: "UPDATE OR IGNORE comment SET person_id = $2 WHERE person_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE comment SET person_id = $1
    WHERE person_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM comment WHERE person_id = $1",
    },
    Followed {
        part: Part::Identities,
        take: "UPDATE OR IGNORE identity SET person_id = $2 WHERE person_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE identity SET person_id = $1
    WHERE person_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM identity WHERE person_id = $1",
    },
    Followed {
        part: Part::Tokens,
        take: "UPDATE OR IGNORE token SET person_id = $2 WHERE person_id = $1 RETURNING id",
        give_back: "
    UPDATE OR IGNORE token SET person_id = $1
    WHERE person_id = $2 AND id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM token WHERE person_id = $1",
    },
    Followed {
        part: Part::Openings,
        take: "UPDATE OR IGNORE session_opening SET person_id = $2 WHERE person_id = $1 RETURNING session_id",
        give_back: "
    UPDATE OR IGNORE session_opening SET person_id = $1
    WHERE person_id = $2 AND session_id IN (SELECT row_key FROM record_merge_row WHERE merge_id = $3 AND part = $4)",
        count: "SELECT count(*) FROM session_opening WHERE person_id = $1",
    },
];

const INSERT_MERGE: &str = "
    INSERT INTO record_merge (id, kept_trainee_id, merged_trainee_id, person_id, why, created_at_ms)
    SELECT $1, $2, $3, $4, $5, $6 WHERE (SELECT count(*) FROM record_merge WHERE kept_trainee_id = $2) < $7";

const SELECT_RECEIVING: &str = "SELECT EXISTS (SELECT 1 FROM session WHERE trainee_id = $1 AND video IS NULL)";

const SELECT_HIDDEN: &str = "SELECT EXISTS (SELECT 1 FROM hidden_trainee WHERE trainee_id IN ($1, $2))";

const SELECT_ACCOUNT: &str = "SELECT id, login FROM person WHERE trainee_id = $1";

const TAKE_LEVEL: &str = "
    UPDATE trainee SET level = (SELECT level FROM trainee WHERE id = $1)
    WHERE id = $2 AND level IS NULL AND (SELECT level FROM trainee WHERE id = $1) IS NOT NULL RETURNING level";

const TAKE_HANDEDNESS: &str = "
    UPDATE trainee SET handedness = (SELECT handedness FROM trainee WHERE id = $1)
    WHERE id = $2 AND handedness IS NULL AND (SELECT handedness FROM trainee WHERE id = $1) IS NOT NULL
    RETURNING handedness";

const NOTE_TAKEN: &str = "UPDATE record_merge SET taken_level = $2, taken_handedness = $3 WHERE id = $1";

/// Takes back what the kept record `$2` took over, unless it was changed since.
const GIVE_LEVEL_BACK: &str = "
    UPDATE trainee SET level = NULL WHERE id = $2 AND level = (SELECT taken_level FROM record_merge WHERE id = $1)";

const GIVE_HANDEDNESS_BACK: &str = "
    UPDATE trainee SET handedness = NULL
    WHERE id = $2 AND handedness = (SELECT taken_handedness FROM record_merge WHERE id = $1)";

const SELECT_MERGE: &str = "
    SELECT merged_trainee_id, separated_at_ms IS NOT NULL FROM record_merge WHERE id = $1 AND kept_trainee_id = $2";

/// The merges since `$2` into the record `$1`, and into those that it was merged into itself.
const SELECT_LATER_MERGES: &str = "
    WITH RECURSIVE holder (id) AS
        (VALUES ($1)
         UNION SELECT kept_trainee_id FROM record_merge JOIN holder ON merged_trainee_id = holder.id
         WHERE separated_at_ms IS NULL)
    SELECT id, kept_trainee_id, merged_trainee_id FROM record_merge
    WHERE kept_trainee_id IN (SELECT id FROM holder) AND separated_at_ms IS NULL
      AND rowid > (SELECT rowid FROM record_merge WHERE id = $2)
    ORDER BY rowid";

const SELECT_DIRECT_MERGES: &str = "
    SELECT id, merged_trainee_id FROM record_merge
    WHERE kept_trainee_id = $1 AND separated_at_ms IS NULL ORDER BY rowid DESC";

const SELECT_MERGE_OF: &str = "
    SELECT id, kept_trainee_id FROM record_merge WHERE merged_trainee_id = $1 AND separated_at_ms IS NULL";

/// `$1`: the kept record, which the caller has read in its scope.
const SELECT_MERGED_RECORDS: &str = "
    SELECT trainee.id, trainee.code, trainee.name, trainee.level, trainee.handedness, trainee.created_at_ms, person.login,
           (SELECT created_at_ms FROM record_merge
            WHERE merged_trainee_id = trainee.id AND separated_at_ms IS NULL) AS merged_at_ms
    FROM merged_trainee JOIN trainee ON trainee.id = merged_trainee.trainee_id
    LEFT JOIN person ON person.trainee_id = trainee.id
    WHERE merged_trainee.kept_id = $1 ORDER BY trainee.code";

const SELECT_MERGED_INTO: &str = "SELECT trainee_id FROM merged_trainee WHERE kept_id = $1";

const SELECT_ACCOUNTS_OF_MERGE: &str = "
    SELECT row_key FROM record_merge_row WHERE merge_id = $1 AND part = 'account'";

/// Ends sign-ins with an identity that another account has now.
const DELETE_COOKIES_OF_MOVED_IDENTITIES: &str = "
    DELETE FROM cookie_session
    WHERE identity_id IS NOT NULL
      AND person_id <> (SELECT identity.person_id FROM identity WHERE identity.id = cookie_session.identity_id)";

/// A record that is merged into another one of the same person.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct MergedRecord {
    /// Its id.
    pub id: TraineeId,
    /// Its short unique name.
    pub code: Code,
    /// Its name.
    pub name: Name,
    /// Its level of experience, if known.
    pub level: Option<Level>,
    /// Its preferred hand, if known.
    pub handedness: Option<Handedness>,
    /// When it was registered, epoch ms.
    pub created_at_ms: i64,
    /// Login of its account, if that was closed.
    pub login: Option<Login>,
    /// When it was merged, epoch ms.
    pub merged_at_ms: i64,
}

impl RecordMergeStore<'_> {
    /// The merges of other records into this trainee, newest first, also of those that were separated.
    pub async fn of_trainee(&self, scope: &Scope, kept: TraineeId) -> StoreResult<Vec<RecordMerge>> {
        require_administrator(scope, "merges of records")?;
        self.0.trainees().get(scope, &Key::from(&kept)).await?;
        read(self.0, kept.to_string()).await
    }

    /// The records that are merged into a trainee's, with what is hidden of them.
    pub async fn records_of(&self, scope: &Scope, kept: TraineeId) -> StoreResult<Vec<MergedRecord>> {
        self.0.trainees().get(scope, &Key::from(&kept)).await?;
        Ok(sqlx::query_as(SELECT_MERGED_RECORDS).bind(kept).fetch_all(self.0.readers()).await?)
    }

    /// What merging these two records of one person would do. Nothing is changed.
    pub async fn preview_trainees(
        &self,
        scope: &Scope,
        [kept, merged]: [TraineeId; 2],
        centre_months: u32,
    ) -> StoreResult<MergeEffect> {
        require_administrator(scope, "merging records of people")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        let preview = async move |tx: &mut SqliteConnection| {
            let why = Remark::from_stored("–".to_owned());
            merge(tx, (&by, &why, now_ms), [kept, merged], centre_months).await
        };
        preview_of(self.0, preview).await
    }

    /// Merges two records of one person, in one transaction: `merged` is hidden, and what belongs to it follows `kept`. At
    /// most `confirmed_videos` videos may be deleted by it. Accounts that change hands are signed out.
    ///
    /// # Errors
    /// They are the same, one of them waits for the erasure, or a recording of the merged one is arriving.
    pub async fn merge_trainees(
        &self,
        scope: &Scope,
        [kept, merged]: [TraineeId; 2],
        why: Remark,
        (centre_months, confirmed_videos): (u32, u64),
    ) -> StoreResult<RecordMerge> {
        require_administrator(scope, "merging records of people")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write_ending_sign_ins(async move |tx| {
                let effect = merge(tx, (&by, &why, now_ms), [kept, merged], centre_months).await?;
                if effect.due_videos > confirmed_videos {
                    return Err(StoreError::refused(format!(
                        "{} videos would be deleted at once: look at the preview, then confirm this number in \
                         `confirmed_videos`",
                        effect.due_videos
                    )));
                }
                for account in effect.signed_out {
                    sign_out(tx, account).await?;
                }
                note(tx, &by, now_ms, ("merge", "trainee"), kept).await
            })
            .await?;
        let all = read(self.0, kept.to_string()).await?;
        let mut made = all.into_iter().filter(|made| made.separated_at_ms.is_none());
        made.find(|made| made.merged.id == merged.to_string()).ok_or(not_found("merge"))
    }

    /// Separates two merged records of one person, in one transaction: the hidden one gets back what followed, and is shown
    /// again. What arrived since the merge stays with the kept record.
    ///
    /// # Errors
    /// They are separated already, or the kept record itself was merged into another one.
    pub async fn separate_trainees(
        &self,
        scope: &Scope,
        kept: TraineeId,
        id: MergeId,
        why: Remark,
    ) -> StoreResult<RecordMerge> {
        require_administrator(scope, "separating records of people")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write_ending_sign_ins(async move |tx| {
                let found = sqlx::query_as(SELECT_MERGE).bind(id).bind(kept).fetch_optional(&mut *tx).await?;
                let (merged, is_separated): (TraineeId, bool) = found.ok_or(not_found("merge"))?;
                if is_separated {
                    return Err(StoreError::refused("the two records are separated already"));
                }
                refuse_hidden(tx, [kept, kept]).await?;
                refuse_if_running(tx, [kept, kept]).await?;
                separate(tx, (&by, &why, now_ms), id, [kept, merged]).await?;
                note(tx, &by, now_ms, ("separate", "trainee"), kept).await
            })
            .await?;
        read(self.0, kept.to_string()).await?.into_iter().find(|made| made.id == id).ok_or(not_found("merge"))
    }
}

/// Merges two records. Returns what it did.
async fn merge(
    tx: &mut SqliteConnection,
    (by, why, now_ms): (&Scope, &Remark, i64),
    [kept, merged]: [TraineeId; 2],
    centre_months: u32,
) -> StoreResult<MergeEffect> {
    if kept == merged {
        return Err(StoreError::refused("both are the same record: choose another one"));
    }
    refuse_hidden(tx, [kept, merged]).await?;
    refuse_if_running(tx, [kept, merged]).await?;
    refuse_if_twin(tx, [kept, merged]).await?;
    if sqlx::query_scalar(SELECT_RECEIVING).bind(merged).fetch_one(&mut *tx).await? {
        return Err(StoreError::refused(
            "a recording of the person is still arriving: wait until it is complete, then merge the records",
        ));
    }
    skill_models::withdraw(tx, kept, now_ms).await?;
    skill_models::withdraw(tx, merged, now_ms).await?;
    let id = MergeId::at(now_ms);
    let insert = sqlx::query(INSERT_MERGE).bind(id).bind(kept).bind(merged).bind(by.person()).bind(why);
    if insert.bind(now_ms).bind(MAX_MERGES).execute(&mut *tx).await?.rows_affected() == 0 {
        return Err(StoreError::refused(format!("{MAX_MERGES} records were merged into this one, which is the limit")));
    }
    let before = retention::due(tx, kept, centre_months, now_ms).await?
        + retention::due(tx, merged, centre_months, now_ms).await?;
    let accounts = [account_of(tx, kept).await?, account_of(tx, merged).await?];
    let mut effect = follow(tx, id, [kept, merged], true).await?;
    let [own, other] = accounts;
    effect.closed_login = own.and_then(|_| other.as_ref().map(|(_, login)| login.clone()));
    effect.signed_out = other.map(|(account, _)| account).into_iter().collect();
    effect.due_videos = retention::due(tx, kept, centre_months, now_ms).await?.saturating_sub(before);
    effect.consent = Some(state_of(tx, kept, now_ms).await?);
    Ok(effect)
}

/// Lets follow what can. Returns what it did to the records. `with_months`: also the months for keeping videos.
async fn follow(
    tx: &mut SqliteConnection,
    id: MergeId,
    [kept, merged]: [TraineeId; 2],
    with_months: bool,
) -> StoreResult<MergeEffect> {
    let level = sqlx::query_scalar(TAKE_LEVEL).bind(merged).bind(kept).fetch_optional(&mut *tx).await?;
    let hand = sqlx::query_scalar(TAKE_HANDEDNESS).bind(merged).bind(kept).fetch_optional(&mut *tx).await?;
    let (level, hand): (Option<String>, Option<String>) = (level, hand);
    let (takes_level, takes_handedness) = (level.is_some(), hand.is_some());
    sqlx::query(NOTE_TAKEN).bind(id).bind(level).bind(hand).execute(&mut *tx).await?;
    let ids = [merged.to_string(), kept.to_string()];
    let mut counts = take(tx, id, OF_TRAINEE, [&ids[0], &ids[1]]).await?;
    if with_months {
        counts.extend(retention::take(tx, id, [kept, merged]).await?);
    }
    if let [Some((own, _)), Some((closed, _))] = [account_of(tx, kept).await?, account_of(tx, merged).await?] {
        let accounts = [closed.to_string(), own.to_string()];
        counts.extend(take(tx, id, OF_ACCOUNT, [&accounts[0], &accounts[1]]).await?);
    }
    sqlx::query(DELETE_COOKIES_OF_MOVED_IDENTITIES).execute(tx).await?;
    Ok(MergeEffect { counts, takes_level, takes_handedness, ..MergeEffect::default() })
}

/// Gives back what followed. Returns false if the kept record got other months for keeping videos since: they stay.
async fn unfollow(tx: &mut SqliteConnection, id: MergeId, [kept, merged]: [TraineeId; 2]) -> StoreResult<bool> {
    if let [Some((own, _)), Some((closed, _))] = [account_of(tx, kept).await?, account_of(tx, merged).await?] {
        let accounts = [closed.to_string(), own.to_string()];
        give_back(tx, id, OF_ACCOUNT, [&accounts[0], &accounts[1]]).await?;
    }
    let ids = [merged.to_string(), kept.to_string()];
    give_back(tx, id, OF_TRAINEE, [&ids[0], &ids[1]]).await?;
    let are_months_unchanged = retention::give_back(tx, id, [kept, merged]).await?;
    for restore in [GIVE_LEVEL_BACK, GIVE_HANDEDNESS_BACK] {
        sqlx::query(restore).bind(id).bind(kept).execute(&mut *tx).await?;
    }
    sqlx::query(DELETE_COOKIES_OF_MOVED_IDENTITIES).execute(&mut *tx).await?;
    forget_rows(tx, id).await?;
    Ok(are_months_unchanged)
}

/// Separates two records. The later merges into the kept one are done again, since more may follow now; so are those of the
/// kept one into others.
async fn separate(
    tx: &mut SqliteConnection,
    (by, why, now_ms): (&Scope, &Remark, i64),
    id: MergeId,
    [kept, merged]: [TraineeId; 2],
) -> StoreResult<()> {
    skill_models::withdraw(tx, kept, now_ms).await?;
    let accounts = sqlx::query_scalar(SELECT_ACCOUNTS_OF_MERGE).bind(id).fetch_all(&mut *tx).await?;
    for account in accounts {
        sign_out(tx, account).await?;
    }
    let later: Vec<(MergeId, TraineeId, TraineeId)> =
        sqlx::query_as(SELECT_LATER_MERGES).bind(kept).bind(id).fetch_all(&mut *tx).await?;
    let mut undone = Vec::new();
    for (other, into, of) in later.into_iter().rev() {
        skill_models::withdraw(tx, into, now_ms).await?;
        let are_months_unchanged = unfollow(tx, other, [into, of]).await?;
        undone.push((other, [into, of], are_months_unchanged));
    }
    unfollow(tx, id, [kept, merged]).await?;
    mark_separated(tx, id, (by, why), now_ms).await?;
    for (other, records, with_months) in undone.into_iter().rev() {
        follow(tx, other, records, with_months).await?;
    }
    Ok(())
}

/// Before a merged record alone is erased, as in a backup from before its separation: it gets back what followed.
pub(in crate::store) async fn give_back_all(
    tx: &mut SqliteConnection,
    merged: TraineeId,
    now_ms: i64,
) -> StoreResult<()> {
    let found = sqlx::query_as(SELECT_MERGE_OF).bind(merged).fetch_optional(&mut *tx).await?;
    let Some((id, kept)): Option<(MergeId, TraineeId)> = found else { return Ok(()) };
    let why = Remark::from_stored("–".to_owned());
    separate(tx, (&Scope::service(), &why, now_ms), id, [kept, merged]).await
}

/// Separates the records that were merged into this one, except these. What was merged into one of those stays so.
pub(in crate::store) async fn separate_all_of(
    tx: &mut SqliteConnection,
    kept: TraineeId,
    except: &[TraineeId],
    now_ms: i64,
) -> StoreResult<()> {
    let direct: Vec<(MergeId, TraineeId)> = sqlx::query_as(SELECT_DIRECT_MERGES).bind(kept).fetch_all(&mut *tx).await?;
    let why = Remark::from_stored("–".to_owned());
    for (id, merged) in direct.into_iter().filter(|(_, merged)| !except.contains(merged)) {
        separate(tx, (&Scope::service(), &why, now_ms), id, [kept, merged]).await?;
    }
    Ok(())
}

/// The record that this one was merged into.
pub(in crate::store) async fn holder_of(
    tx: &mut SqliteConnection,
    merged: TraineeId,
) -> StoreResult<Option<TraineeId>> {
    let found: Option<(MergeId, TraineeId)> = sqlx::query_as(SELECT_MERGE_OF).bind(merged).fetch_optional(tx).await?;
    Ok(found.map(|(_, kept)| kept))
}

/// The records that were merged into this one.
pub(in crate::store) async fn merged_into(tx: &mut SqliteConnection, kept: TraineeId) -> StoreResult<Vec<TraineeId>> {
    Ok(sqlx::query_scalar(SELECT_MERGED_INTO).bind(kept).fetch_all(tx).await?)
}

async fn refuse_hidden(tx: &mut SqliteConnection, [kept, merged]: [TraineeId; 2]) -> StoreResult<()> {
    if sqlx::query_scalar(SELECT_HIDDEN).bind(kept).bind(merged).fetch_one(tx).await? {
        return Err(StoreError::refused(
            "one of the records waits for its erasure, or was merged into another one: undo that first",
        ));
    }
    Ok(())
}

async fn account_of(tx: &mut SqliteConnection, trainee: TraineeId) -> StoreResult<Option<(PersonId, String)>> {
    Ok(sqlx::query_as(SELECT_ACCOUNT).bind(trainee).fetch_optional(tx).await?)
}

/// Ends the sign-ins of an account that changes hands, and its link for a password.
async fn sign_out(tx: &mut SqliteConnection, account: PersonId) -> StoreResult<()> {
    sqlx::query(DELETE_COOKIES_OF).bind(account).execute(&mut *tx).await?;
    sqlx::query(DELETE_LINK_OF).bind(account).execute(tx).await?;
    Ok(())
}
