//! Looking after recordings that nobody sends: what was abandoned is ended with what came, what was erased is cleared up.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::{Feed, Feeds, LiveError};
use crate::domain::scope::Scope;
use crate::ids::FeedId;
use crate::store::StoreError;
use crate::time::millis;

/// How long a child waits for a sender that has gone.
const IDLE: Duration = Duration::from_secs(300);
/// How often abandoned recordings are looked for.
const LOOK_EVERY: Duration = Duration::from_secs(20);

impl Feeds {
    /// Ends what was abandoned and clears up, again and again until the service ends.
    pub async fn keep(&self) {
        let mut unheard = HashMap::new();
        while !self.0.shutdown.is_begun() {
            if let Err(error) = self.look_after(&mut unheard).await {
                tracing::warn!(%error, "looking after feeds");
            }
            tokio::select! {
                () = self.0.shutdown.begun() => {}
                () = self.0.clock.sleep(LOOK_EVERY) => {}
            }
        }
    }

    /// Removes the logs of what was erased, and ends what was abandoned. `unheard` remembers since when a recording that no
    /// connection has named in this life of the service has been waiting, epoch ms.
    async fn look_after(&self, unheard: &mut HashMap<FeedId, i64>) -> Result<(), LiveError> {
        self.remove_erased().await?;
        let unfinished = self.0.store.feeds().unfinished().await?;
        let now_ms = self.0.clock.now_ms();
        let abandoned_ms = now_ms - millis(self.0.settings.abandoned());
        unheard.retain(|id, _| unfinished.iter().any(|row| row.id == *id));
        for row in unfinished {
            if self.0.shutdown.is_begun() {
                break;
            }
            let id = row.id;
            let since_ms = if row.is_push { now_ms + 1 } else { abandoned_ms }; // nobody can come again and push the rest
            let known = self.0.open.all.lock().await.get(&id).cloned();
            let feed = match known {
                Some(feed) => {
                    unheard.remove(&id); // its wait begins anew when it is forgotten
                    feed
                }
                None if *unheard.entry(id).or_insert(now_ms) >= since_ms => continue,
                None => match self.enter_unheard(id, since_ms).await? {
                    Some(feed) => feed,
                    None => continue,
                },
            };
            if feed.is_abandoned(now_ms - millis(IDLE)) {
                feed.follower.let_go(); // a child for whoever comes again; until then its memory is others'
            }
            if feed.is_abandoned(since_ms)
                && let Err(error) = self.end_abandoned(&feed, since_ms).await
            {
                tracing::warn!(%error, feed = %id, "ending an abandoned recording");
            }
        }
        Ok(())
    }

    /// Opens the log of a recording that was not heard of since some time before then, epoch ms.
    async fn enter_unheard(&self, id: FeedId, since_ms: i64) -> Result<Option<Arc<Feed>>, LiveError> {
        let _door = self.0.open.door(id).await;
        if let Some(feed) = self.0.open.all.lock().await.get(&id) {
            return Ok(Some(feed.clone())); // a connection came meanwhile
        }
        let row = match self.0.store.feeds().get(&Scope::service(), id).await {
            Ok(row) if row.ended_at_ms.is_none() => row,
            Ok(_) | Err(StoreError::NotFound { .. }) => return Ok(None), // or came and went
            Err(error) => return Err(error.into()),
        };
        let feed = self.enter(row).await?;
        feed.heard_ms.store(since_ms - 1, Ordering::Release);
        self.0.open.all.lock().await.insert(id, feed.clone());
        Ok(Some(feed))
    }

    async fn remove_erased(&self) -> Result<(), LiveError> {
        for id in self.0.vault.feed_logs().await? {
            // Asked again while nobody can enter it: a row may have come since.
            let _door = self.0.open.door(id).await;
            let is_needed = match self.0.store.feeds().get(&Scope::service(), id).await {
                Ok(row) => row.ended_at_ms.is_none(),
                Err(StoreError::NotFound { .. }) => false,
                Err(error) => return Err(error.into()),
            };
            if !is_needed {
                if let Some(erased) = self.0.open.all.lock().await.remove(&id) {
                    erased.is_gone.store(true, Ordering::Release);
                    erased.epoch.send_replace(u32::MAX); // whoever still sends it is told
                }
                self.0.vault.delete_feed(id).await?;
            }
        }
        Ok(())
    }
}
