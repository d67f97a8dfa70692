//! Maintenance of recordings without a sender: ends abandoned ones with the frames that arrived, and removes the logs
//! of erased ones.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::{Feed, Feeds, LiveError};
use crate::domain::scope::Scope;
use crate::ids::FeedId;
use crate::store::{self, StoreError};
use crate::time::millis;

/// Time after which the child of a recording without a sender is stopped.
const IDLE: Duration = Duration::from_secs(300);
/// Interval between two checks for abandoned recordings.
const LOOK_EVERY: Duration = Duration::from_secs(20);

impl Feeds {
    /// Ends abandoned recordings and removes erased ones until the service shuts down. Both run side by side: erased
    /// data must go soon, and assembling a recording takes long.
    pub async fn keep(&self) {
        tokio::join!(self.keep_ending(), self.keep_removing());
    }

    async fn keep_ending(&self) {
        let mut unheard = HashMap::new();
        while !self.0.shutdown.is_begun() {
            if let Err(error) = self.look_after_all(&mut unheard).await {
                tracing::warn!(%error, "check for abandoned recordings failed; repeated in 20 s");
            }
            self.rest().await;
        }
    }

    async fn keep_removing(&self) {
        while !self.0.shutdown.is_begun() {
            if let Err(error) = self.remove_erased().await {
                tracing::warn!(%error, "removal of erased recordings failed; repeated in 20 s");
            }
            self.rest().await;
        }
    }

    async fn rest(&self) {
        tokio::select! {
            () = self.0.shutdown.begun() => {}
            () = self.0.clock.sleep(LOOK_EVERY) => {}
        }
    }

    /// Ends abandoned recordings. `unheard` holds, for each recording that no connection has named since this service
    /// started, when its wait began. Times are monotonic, so setting the clock forward ends nothing.
    async fn look_after_all(&self, unheard: &mut HashMap<FeedId, i64>) -> Result<(), LiveError> {
        let unfinished = self.0.store.feeds().unfinished().await?;
        unheard.retain(|id, _| unfinished.iter().any(|row| row.id == *id));
        for row in unfinished {
            if self.0.shutdown.is_begun() {
                break;
            }
            // An unreadable recording must not prevent the others from being ended.
            if let Err(error) = self.look_after(&row, unheard).await {
                tracing::warn!(%error, feed = %row.id, "abandoned recording not ended; repeated in 20 s");
            }
        }
        Ok(())
    }

    async fn look_after(&self, row: &store::Feed, unheard: &mut HashMap<FeedId, i64>) -> Result<(), LiveError> {
        let (id, passed_ms) = (row.id, self.0.clock.passed_ms());
        let abandoned_ms = passed_ms - millis(self.0.settings.abandoned());
        let since_ms = if row.is_push { passed_ms + 1 } else { abandoned_ms }; // a push cannot be resumed
        let known = self.0.open.all.lock().await.get(&id).cloned();
        let feed = match known {
            Some(feed) => {
                unheard.remove(&id); // its wait starts again if it is closed
                feed
            }
            None if *unheard.entry(id).or_insert(passed_ms) >= since_ms => return Ok(()),
            None => match self.enter_unheard(id, since_ms).await? {
                Some(feed) => feed,
                None => return Ok(()),
            },
        };
        feed.follower.let_go_if(|| feed.is_abandoned(passed_ms - millis(IDLE)));
        if feed.is_abandoned(since_ms) { self.end_abandoned(&feed, since_ms).await } else { Ok(()) }
    }

    /// Opens the log of a recording without a connection since some time before `since_ms`.
    async fn enter_unheard(&self, id: FeedId, since_ms: i64) -> Result<Option<Arc<Feed>>, LiveError> {
        let _lock = self.0.open.door(id).await;
        if let Some(feed) = self.0.open.all.lock().await.get(&id) {
            return Ok(Some(feed.clone())); // opened by a connection meanwhile
        }
        let row = match self.0.store.feeds().get(&Scope::service(), id).await {
            Ok(row) if row.ended_at_ms.is_none() => row,
            Ok(_) | Err(StoreError::NotFound { .. }) => return Ok(None), // or it ended meanwhile
            Err(error) => return Err(error.into()),
        };
        let feed = self.enter(row).await?;
        feed.heard_ms.store(since_ms - 1, Ordering::Release);
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
        let _lock = self.0.open.door(id).await;
        if self.is_needed(id).await? {
            return Ok(()); // its row was created after the listing
        }
        if let Some(erased) = self.0.open.all.lock().await.remove(&id) {
            erased.is_gone.store(true, Ordering::Release);
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
