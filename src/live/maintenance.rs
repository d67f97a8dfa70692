//! Maintenance of recordings without a sender: ends abandoned ones with the frames that arrived, and removes the logs
//! of erased ones.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::settings::LastContact;
use super::{FeedPhase, FeedService, LiveError, OpenFeed};
use crate::domain::scope::Scope;
use crate::ids::FeedId;
use crate::store::{self, StoreError};
use crate::time::millis;

/// Time after which the child of a recording without a sender is stopped.
const MAX_IDLE: Duration = Duration::from_secs(300);
/// Interval between two checks for abandoned recordings.
const CHECK_INTERVAL: Duration = Duration::from_secs(20);

impl FeedService {
    /// Ends abandoned recordings and removes erased ones until the service shuts down. Both run side by side: erased
    /// data must go soon, and assembling a recording takes long.
    pub async fn maintain(&self) {
        tokio::join!(self.run_ending(), self.run_removal());
    }

    async fn run_ending(&self) {
        let mut unheard = HashMap::new();
        while !self.0.shutdown.is_begun() {
            if let Err(error) = self.end_all_abandoned(&mut unheard).await {
                tracing::warn!(%error, "check for abandoned recordings failed; repeated in 20 s");
            }
            self.pause().await;
        }
    }

    async fn run_removal(&self) {
        while !self.0.shutdown.is_begun() {
            if let Err(error) = self.remove_erased().await {
                tracing::warn!(%error, "removal of erased recordings failed; repeated in 20 s");
            }
            self.pause().await;
        }
    }

    async fn pause(&self) {
        tokio::select! {
            () = self.0.shutdown.begun() => {}
            () = self.0.clock.sleep(CHECK_INTERVAL) => {}
        }
    }

    /// Ends abandoned recordings. `unheard` holds, for each recording that no connection has named since this service
    /// started, when its wait began. Times are monotonic, so setting the clock forward ends nothing.
    async fn end_all_abandoned(&self, unheard: &mut HashMap<FeedId, i64>) -> Result<(), LiveError> {
        let unfinished = self.0.store.feeds().unfinished().await?;
        unheard.retain(|id, _| unfinished.iter().any(|row| row.id == *id));
        for row in unfinished {
            if self.0.shutdown.is_begun() {
                break;
            }
            // An unreadable recording must not prevent the others from being ended.
            if let Err(error) = self.check_unfinished(&row, unheard).await {
                tracing::warn!(%error, feed = %row.id, "abandoned recording not ended; repeated in 20 s");
            }
        }
        Ok(())
    }

    async fn check_unfinished(
        &self,
        row: &store::FeedRow,
        unheard: &mut HashMap<FeedId, i64>,
    ) -> Result<(), LiveError> {
        let (id, passed_ms) = (row.id, self.0.clock.monotonic_ms());
        let known = self.0.open.all.lock().await.get(&id).cloned();
        let contact = known.as_ref().map_or(LastContact::UNKNOWN, |feed| feed.last_contact());
        let abandoned_ms = passed_ms - millis(self.0.settings.patience(row.resumes, contact));
        let since_ms = if row.is_push { passed_ms + 1 } else { abandoned_ms }; // a push cannot be resumed
        let feed = match known {
            Some(feed) => {
                unheard.remove(&id); // its wait starts again if it is closed
                feed
            }
            None if *unheard.entry(id).or_insert(passed_ms) >= since_ms => return Ok(()),
            None => match self.open_unheard(id, since_ms).await? {
                Some(feed) => feed,
                None => return Ok(()),
            },
        };
        feed.tracking.stop_if(|| feed.is_abandoned(passed_ms - millis(MAX_IDLE)));
        if feed.is_abandoned(since_ms) { self.end_abandoned(&feed, since_ms).await } else { Ok(()) }
    }

    /// Opens the log of a recording without a connection since some time before `since_ms`.
    pub(super) async fn open_unheard(&self, id: FeedId, since_ms: i64) -> Result<Option<Arc<OpenFeed>>, LiveError> {
        let _lock = self.0.open.lock_feed(id).await;
        if let Some(feed) = self.0.open.all.lock().await.get(&id) {
            return Ok(Some(feed.clone())); // opened by a connection meanwhile
        }
        let row = match self.0.store.feeds().get(&Scope::service(), id).await {
            Ok(row) if row.ended_at_ms.is_none() => row,
            Ok(_) | Err(StoreError::NotFound { .. }) => return Ok(None), // or it ended meanwhile
            Err(error) => return Err(error.into()),
        };
        let feed = self.open_feed(row).await?;
        feed.last_contact_ms.store(since_ms - 1, Ordering::Release);
        self.0.open.all.lock().await.insert(id, feed.clone());
        Ok(Some(feed))
    }

    async fn remove_erased(&self) -> Result<(), LiveError> {
        for id in self.0.vault.feed_logs().await? {
            if let Err(error) = self.remove_if_erased(id).await {
                tracing::warn!(%error, feed = %id, "log of an erased recording not removed; repeated in 20 s");
            }
        }
        Ok(())
    }

    async fn remove_if_erased(&self, id: FeedId) -> Result<(), LiveError> {
        if self.is_needed(id).await? {
            return Ok(()); // before taking its lock, which may be held while its log is read
        }
        let _lock = self.0.open.lock_feed(id).await;
        if self.is_needed(id).await? {
            return Ok(()); // its row was created after the listing
        }
        if let Some(erased) = self.0.open.all.lock().await.remove(&id) {
            erased.set_phase(FeedPhase::Removed);
            erased.epoch.send_replace(u32::MAX); // closes the connection that still sends it
        }
        Ok(self.0.vault.delete_feed(id).await?)
    }

    async fn is_needed(&self, id: FeedId) -> Result<bool, LiveError> {
        match self.0.store.feeds().get(&Scope::service(), id).await {
            Ok(row) => Ok(row.ended_at_ms.is_none()),
            Err(StoreError::NotFound { .. }) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }
}
