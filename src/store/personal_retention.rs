//! How long the videos of single trainees are kept ([`crate::domain::personal_retention`]).

use sqlx::sqlite::SqliteConnection;

use super::audit::note;
use super::error::{StoreError, StoreResult};
use super::retention::{SELECT_OLD_VIDEOS, VideoAge};
use super::visibility::{require_staff, require_trainee};
use super::{Scope, Store};
use crate::domain::blob::BlobHash;
use crate::domain::personal_retention::kept_months;
use crate::domain::text::{Key, Name, Remark};
use crate::ids::TraineeId;

/// Access to the times for which the videos of trainees are kept.
pub struct PersonalRetentionStore<'s>(pub(super) &'s Store);

#[derive(sqlx::FromRow)]
struct RetentionRow {
    months: u32,
    reason: Option<Remark>,
    who: Option<Name>,
    changed_at_ms: i64,
}

/// How long a trainee's videos are kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PersonalRetentionRecord {
    /// The trainee's own months; `None`: as the centre's setting says.
    pub own_months: Option<u32>,
    /// Why longer than the centre keeps videos.
    pub reason: Option<Remark>,
    /// Name of the person who set it; `None` if the account was deleted.
    pub who: Option<Name>,
    /// When it was set, epoch ms.
    pub changed_at_ms: Option<i64>,
    /// The months that count; 0: videos are kept.
    pub months: u32,
    /// When the oldest session arrived whose video is still kept, epoch ms.
    pub oldest_ms: Option<i64>,
    /// Number of videos that are still kept.
    pub videos: i64,
}

const SELECT_OWN: &str = "
    SELECT months, reason, person.name AS who, changed_at_ms
    FROM trainee_retention LEFT JOIN person ON person.id = trainee_retention.person_id
    WHERE trainee_retention.trainee_id = $1";

const SELECT_KEPT: &str = "
    SELECT min(session.created_at_ms), count(*) FROM session JOIN blob ON blob.hash = session.video
    WHERE session.trainee_id = $1 AND session.tracker IS NULL AND blob.dropped_at_ms IS NULL";

const UPSERT_OWN: &str = "
    INSERT INTO trainee_retention (trainee_id, months, reason, person_id, changed_at_ms) VALUES ($1, $2, $3, $4, $5)
    ON CONFLICT (trainee_id) DO UPDATE
    SET months = excluded.months, reason = excluded.reason, person_id = excluded.person_id,
        changed_at_ms = excluded.changed_at_ms";

const DELETE_OWN: &str = "DELETE FROM trainee_retention WHERE trainee_id = $1";

impl PersonalRetentionStore<'_> {
    /// How long the videos of a trainee are kept. `centre_months`: the centre's setting.
    pub async fn of_trainee(
        &self,
        scope: &Scope,
        trainee: TraineeId,
        centre_months: u32,
    ) -> StoreResult<PersonalRetentionRecord> {
        self.0.trainees().get(scope, &Key::from(&trainee)).await?;
        let own = sqlx::query_as(SELECT_OWN).bind(trainee).fetch_optional(self.0.readers()).await?;
        let own: Option<RetentionRow> = own;
        let kept = sqlx::query_as(SELECT_KEPT).bind(trainee).fetch_one(self.0.readers()).await?;
        let (oldest_ms, videos): (Option<i64>, i64) = kept;
        let months = kept_months(centre_months, own.as_ref().map(|own| (own.months, own.reason.is_some())));
        let own_months = own.as_ref().map(|own| own.months);
        let changed_at_ms = own.as_ref().map(|own| own.changed_at_ms);
        let (reason, who) = own.map(|own| (own.reason, own.who)).unwrap_or_default();
        Ok(PersonalRetentionRecord { own_months, reason, who, changed_at_ms, months, oldest_ms, videos })
    }

    /// The videos of a trainee that are deleted at once if they are kept for these months: number and size in bytes.
    pub async fn due_videos(&self, scope: &Scope, trainee: TraineeId, months: u32) -> StoreResult<(u64, u64)> {
        self.0.trainees().get(scope, &Key::from(&trainee)).await?;
        require_staff(scope, "changing how long videos are kept")?;
        let mut reader = self.0.readers().acquire().await?;
        due_videos(&mut reader, trainee, months, self.0.now_ms()).await
    }

    /// Sets for how long a trainee's videos are kept; `None`: as the centre's setting says. The reason was checked. At
    /// most `confirmed` videos may be due with it.
    pub async fn set(
        &self,
        scope: &Scope,
        trainee: TraineeId,
        own: Option<(u32, Option<Remark>)>,
        (centre_months, confirmed): (u32, u64),
    ) -> StoreResult<PersonalRetentionRecord> {
        self.0.trainees().get(scope, &Key::from(&trainee)).await?;
        require_staff(scope, "changing how long videos are kept")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                require_trainee(tx, &by, trainee).await?;
                let months = kept_months(centre_months, own.as_ref().map(|(own, reason)| (*own, reason.is_some())));
                let (due, _) = due_videos(tx, trainee, months, now_ms).await?;
                if due > confirmed {
                    return Err(StoreError::refused(format!(
                        "{due} videos would be deleted at once: look at the preview, then confirm this number in \
                         `confirmed_videos`"
                    )));
                }
                match own {
                    Some((months, reason)) => {
                        let upsert = sqlx::query(UPSERT_OWN).bind(trainee).bind(months).bind(reason);
                        upsert.bind(by.person()).bind(now_ms).execute(&mut *tx).await?
                    }
                    None => sqlx::query(DELETE_OWN).bind(trainee).execute(&mut *tx).await?,
                };
                note(tx, &by, now_ms, ("change retention", "trainee"), trainee).await
            })
            .await?;
        self.of_trainee(scope, trainee, centre_months).await
    }
}

/// The videos of one trainee that are due if they are kept for these months.
pub(super) async fn due_videos(
    reader: &mut SqliteConnection,
    trainee: TraineeId,
    months: u32,
    now_ms: i64,
) -> StoreResult<(u64, u64)> {
    let age = VideoAge { now_ms, centre_months: months };
    let rows = age.bind(sqlx::query_as(SELECT_OLD_VIDEOS), -1).bind(trainee).bind(months);
    let rows: Vec<(BlobHash, i64)> = rows.fetch_all(reader).await?;
    Ok((rows.len() as u64, rows.iter().map(|(_, bytes)| bytes.unsigned_abs()).sum()))
}
