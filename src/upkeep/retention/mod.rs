//! What is kept for a limited time: videos, pictures of failed jobs, and people who wait for their erasure.

use std::time::Duration;

use serde::Deserialize;

use super::update_copy::has_update_copy;
use super::{Attempts, UpkeepError, UpkeepResult};
use crate::store::{MAX_ACCESS_ENTRIES, Store, StoreError, VideoAge};
use crate::vault::Vault;

/// Settings of retention.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RetentionSettings {
    /// Months after its arrival when the video of a session is deleted. Path, features and preview stay, so the session
    /// can be scored again, but not tracked again. 0, the default: videos are kept until the session is erased.
    pub videos_months: u32,
    /// Days for taking back the erasure of a trainee on the pages. More: a mistake is noticed in time; fewer:
    /// the data is gone earlier. 0: it is gone at once. Default 7.
    pub erase_days: u32,
    /// Months for which the log of who opened whose recordings is kept. More: trainees can look back further; fewer: less
    /// is stored about the staff. 0: as long as the trainee. Default 24.
    pub access_log_months: u32,
    /// Days for which a recording waits for a name; then it is deleted. More: there is more time to recognise the
    /// person; fewer: recordings without a known consent are gone earlier. 1 to 365, default 30.
    pub unnamed_days: u32,
}

impl Default for RetentionSettings {
    fn default() -> Self {
        Self { videos_months: 0, erase_days: 7, access_log_months: 24, unnamed_days: 30 }
    }
}

/// A twelfth of a year, ms; the statement of the store that selects old videos has the same number.
const MONTH_MS: i64 = 2_629_800_000;
const DAY_MS: i64 = 86_400_000;

/// Time for retrying a failed job of a box with the pictures that were sent, ms. A day: the person who sent
/// them looks at the result within minutes, and the pictures may show a trainee.
const FAILED_PICTURES_MS: i64 = 24 * 3_600_000;
/// Videos per query.
const ROUND: u32 = 100;

impl RetentionSettings {
    /// The videos that are due at this time, with what is set for single trainees.
    pub fn videos_at(&self, now_ms: i64) -> VideoAge {
        VideoAge { now_ms, centre_months: self.videos_months }
    }

    /// The videos that are due within the next 30 days.
    pub fn videos_of_next_month(&self, now_ms: i64) -> VideoAge {
        self.videos_at(now_ms + 30 * 86_400_000)
    }

    /// When a video is deleted that arrived at this time and is kept for these months, epoch ms; `None`: it is kept.
    pub fn deleted_at_ms(arrived_ms: i64, months: u32) -> Option<i64> {
        (months > 0).then(|| arrived_ms + i64::from(months) * MONTH_MS)
    }

    /// Entries of the log of who opened recordings are deleted that are from before this time, epoch ms.
    fn access_log_before_ms(&self, now_ms: i64) -> i64 {
        if self.access_log_months == 0 { 0 } else { now_ms - i64::from(self.access_log_months) * MONTH_MS }
    }

    /// When a recording without a name is deleted that arrived at this time, epoch ms.
    pub fn unnamed_until_ms(&self, arrived_ms: i64) -> i64 {
        arrived_ms + i64::from(self.unnamed_days) * DAY_MS
    }

    /// Time for taking an erasure back; `None`: it cannot.
    pub fn erase_after(&self) -> Option<Duration> {
        (self.erase_days > 0).then(|| Duration::from_secs(u64::from(self.erase_days) * 86_400))
    }
}

/// Erases the people whose erasure is due, and deletes the videos and pictures that are not kept any longer. A step that
/// fails stops no other.
///
/// # Errors
/// The first failure.
pub async fn apply_retention(
    (store, vault): (&Store, &Vault),
    settings: &RetentionSettings,
    now_ms: i64,
) -> UpkeepResult<()> {
    let mut steps = Attempts::default();
    steps.note(erase_due(store).await);
    // The earlier program knows no session without its video: it would report them as lost after the way back.
    if steps.note(has_update_copy(vault)) == Some(false) {
        steps.note(drop_videos(store, vault, settings.videos_at(now_ms)).await);
    }
    steps.note(forget_accesses(store, settings.access_log_before_ms(now_ms)).await);
    steps.note(forget_unnamed(store, now_ms - i64::from(settings.unnamed_days) * DAY_MS).await);
    let before_ms = now_ms - FAILED_PICTURES_MS;
    steps.note(store.retention().release_failed_pictures(before_ms).await.map_err(UpkeepError::from));
    steps.finish(())
}

async fn erase_due(store: &Store) -> UpkeepResult<()> {
    let mut attempts = Attempts::default();
    for trainee in store.pending_erasures().due().await? {
        let erased = match store.pending_erasures().erase_due(trainee).await {
            Err(StoreError::NotFound { .. }) => Ok(()), // erased or taken back meanwhile
            erased => erased.map_err(UpkeepError::from),
        };
        attempts.note(erased);
    }
    attempts.finish(())
}

/// Deletes what is not kept any longer of the log of who opened recordings.
async fn forget_accesses(store: &Store, before_ms: i64) -> UpkeepResult<()> {
    while store.access_log().forget(before_ms, MAX_ACCESS_ENTRIES).await? {}
    Ok(())
}

/// Deletes the recordings that have waited for a name for too long.
async fn forget_unnamed(store: &Store, before_ms: i64) -> UpkeepResult<()> {
    while store.waiting_recordings().forget(before_ms, ROUND).await? {}
    Ok(())
}

/// Deletes old videos: row first, file second. A file that a crash leaves is removed at the next start.
async fn drop_videos(store: &Store, vault: &Vault, age: VideoAge) -> UpkeepResult<()> {
    let mut attempts = Attempts::default();
    loop {
        let dropped = store.retention().drop_videos(age, ROUND).await?;
        for hash in &dropped {
            // The same recording may just be sent again, which makes its file needed again.
            let is_free = async { UpkeepResult::Ok(!store.blobs().has(*hash).await?) };
            attempts.note(vault.delete_if(*hash, is_free).await);
        }
        if dropped.len() < ROUND as usize {
            return attempts.finish(());
        }
    }
}

#[cfg(test)]
mod tests;
