//! One connection's side of a feed: it may send until a later connection takes over.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use bytes::Bytes;
use tokio::sync::watch;

use super::recording::{Ending, Finished};
use super::{Feed, Feeds, failed};
use crate::domain::feed::farewell::{Code, Farewell};
use crate::domain::feed::record::{Body, NotARecord, Record};
use crate::domain::feed::words::FromServer;
use crate::domain::feed::{FrameCodec, TimeBase};
use crate::vault::VaultResult;

/// The connection that may send a recording.
pub struct Connection {
    feeds: Feeds,
    feed: Arc<Feed>,
    epoch: u32,
    now: watch::Receiver<u32>,
    is_unsynced: bool,
}

impl Connection {
    /// Takes over from any earlier connection.
    pub(super) fn begin(feeds: Feeds, feed: Arc<Feed>, epoch: u32) -> Self {
        feed.connections.fetch_add(1, Ordering::AcqRel);
        feed.epoch.send_if_modified(|now| {
            let is_later = epoch > *now;
            *now = (*now).max(epoch);
            is_later
        });
        let now = feed.epoch.subscribe();
        feed.follower.begin(&feeds, &feed);
        Self { feeds, feed, epoch, now, is_unsynced: true }
    }

    /// The first message: what is durable already; or the end, if the recording was being ended when this connection
    /// began.
    pub async fn welcome(&mut self) -> Result<FromServer, Farewell> {
        if let Some(session) = self.feed.state.lock().await.ended {
            return Ok(FromServer::Ended { session, durable: None });
        }
        let durable = self.make_durable().await?;
        Ok(FromServer::Welcome { session: self.feed.row.session_id, epoch: self.epoch, durable })
    }

    /// Takes a record. It is durable after the next [`Connection::begin_sync`], and tracked after that or after
    /// [`Connection::write`].
    pub async fn take(&mut self, message: Bytes) -> Result<(), Farewell> {
        let record = Record::read(&message).map_err(not_a_record)?;
        self.check(&record)?;
        let feed = self.feed.clone();
        let mut state = feed.state.lock().await;
        self.may_send()?;
        if state.ended.is_some() {
            return Err(Farewell::new(Code::Done, "the recording has ended"));
        }
        let (first, last) = (record.number, record.last());
        let is_key = match record.body {
            Body::Frame { is_key, .. } => Some(is_key || feed.row.codec == FrameCodec::Jpeg),
            Body::Gap { .. } => None,
        };
        let is_known = match record.body {
            Body::Frame { .. } => state.numbers.contains(first),
            Body::Gap { .. } => state.numbers.contains_all(first, last),
        };
        if is_known {
            return Ok(()); // a repetition: its acknowledgement was lost
        }
        let most = self.feeds.0.settings.max_bytes;
        if state.log.bytes() + message.len() as u64 > most {
            return Err(Farewell::new(Code::TooMuch, format!("the recording has more than {most} bytes")));
        }
        state.numbers.add(first, last).map_err(|error| Farewell::new(Code::TooMuch, error.to_string()))?;
        let (offset, bytes) = (state.log.bytes(), message.len());
        let appended = state.log.append(message).await;
        self.or_close(appended).await?;
        self.is_unsynced = true;
        if let Some(is_key) = is_key {
            feed.follower.came(offset, bytes, is_key);
        }
        feed.follower.wrote(state.log.written());
        Ok(())
    }

    /// True if a child waits for records that are not written yet.
    pub fn holds_back(&self) -> bool {
        self.feed.follower.waits_for_log()
    }

    /// Writes the records that arrived, so that they are tracked. Call it once for all records at hand, not for each.
    pub async fn write(&mut self) -> Result<(), Farewell> {
        let feed = self.feed.clone();
        let mut state = feed.state.lock().await;
        self.may_send()?;
        let written = state.log.write_waiting().await;
        self.or_close(written).await?;
        feed.follower.wrote(state.log.written());
        Ok(())
    }

    /// Takes a frame or gap made by the service, as [`Connection::take_record`] takes a sender's.
    pub(super) async fn take_own(&mut self, number: u64, body: Body<'_>) -> Result<(), Farewell> {
        let record = Record { epoch: self.epoch, number, body };
        let mut bytes = Vec::with_capacity(record.bytes());
        record.write(&mut bytes);
        self.take(bytes.into()).await
    }

    /// Time base of the recording's frames.
    pub(super) fn time_base(&self) -> TimeBase {
        self.feed.time_base
    }

    /// True if another record may arrive. A sender that is too fast for live tracking is slowed down.
    pub fn has_room(&self) -> bool {
        self.feed.follower.has_room()
    }

    /// Waits until another record may arrive.
    pub async fn room(&self) {
        self.feed.follower.room().await;
    }

    /// True if there are records for which no sync has begun.
    pub fn is_unsynced(&self) -> bool {
        self.is_unsynced
    }

    /// Begins to make the arrived records durable. The future resolves when they are, with the durable numbers. More
    /// records may arrive meanwhile: a busy disk does not delay them.
    pub async fn begin_sync(
        &mut self,
    ) -> Result<impl Future<Output = Result<Vec<[u64; 2]>, Farewell>> + use<>, Farewell> {
        let feed = self.feed.clone();
        let mut state = feed.state.lock().await;
        self.may_send()?;
        if state.ended.is_some() {
            return Err(Farewell::new(Code::Done, "the recording has ended"));
        }
        let (bytes, durable) = (state.log.bytes(), state.numbers.ranges().to_vec());
        let syncing = match state.synced < bytes {
            true => {
                let begun = state.log.begin_sync().await;
                let begun = self.or_close(begun).await?;
                feed.follower.wrote(state.log.written());
                Some(begun)
            }
            false => None,
        };
        drop(state);
        self.is_unsynced = false;
        Ok(async move {
            if let Some(syncing) = syncing {
                syncing.end().await.map_err(failed)?;
                let mut state = feed.state.lock().await;
                state.synced = state.synced.max(bytes);
            }
            Ok(durable)
        })
    }

    /// The sender ends the recording with this many frames: returns `Missing` frames, or `Ended` once it is a session.
    pub async fn end(&mut self, frames: u64) -> Result<FromServer, Farewell> {
        let durable = Some(self.make_durable().await?);
        // In a separate task: a sender that disconnects now must not cancel it.
        let (feeds, feed, ending) = (self.feeds.clone(), self.feed.clone(), Ending::Told { epoch: self.epoch, frames });
        let ended = self.feeds.0.shutdown.spawn(async move { feeds.finish(&feed, ending).await });
        match ended.await.map_err(|panic| Farewell::new(Code::Failed, panic.to_string()))?? {
            Finished::Whole(session) => Ok(FromServer::Ended { session, durable }),
            Finished::Missing(frames) => Ok(FromServer::Missing { frames }),
            Finished::GoesOn => Err(Farewell::new(Code::Superseded, "another connection sends this recording now")),
        }
    }

    /// Waits until nothing more may arrive on this connection and returns why: the service shuts down, a later
    /// connection took over, or a frame does not fit.
    pub async fn over(&self) -> Farewell {
        tokio::select! {
            biased;
            () = self.feeds.0.shutdown.begun() => Farewell::service_ends(),
            reason = self.superseded() => reason,
            reason = self.refused() => reason,
        }
    }

    /// Waits until a later connection has taken over.
    async fn superseded(&self) -> Farewell {
        let (mine, mut now) = (self.epoch, self.now.clone());
        let _ = now.wait_for(|now| *now != mine).await; // cannot fail: the feed holds the sender
        match self.may_send() {
            Err(reason) => reason,
            Ok(()) => Farewell::new(Code::Failed, "the recording was removed"),
        }
    }

    /// Waits until a frame does not fit the recording.
    async fn refused(&self) -> Farewell {
        Farewell::new(Code::DoesNotBelong, self.feed.follower.refused().await)
    }

    /// Notes a contact with the sender.
    pub fn heard(&self) {
        self.feed.heard_ms.store(self.feeds.0.clock.passed_ms(), Ordering::Release);
    }

    /// Makes the arrived records durable before anything else is done.
    async fn make_durable(&mut self) -> Result<Vec<[u64; 2]>, Farewell> {
        self.begin_sync().await?.await
    }

    /// Closes the log if it could not be written; the next hello reads it through.
    async fn or_close<T>(&self, done: VaultResult<T>) -> Result<T, Farewell> {
        match done {
            Ok(done) => Ok(done),
            Err(error) => {
                self.feeds.close(&self.feed).await;
                Err(failed(error))
            }
        }
    }

    fn may_send(&self) -> Result<(), Farewell> {
        if self.feed.is_gone.load(Ordering::Acquire) {
            return Err(Farewell::new(Code::Unknown, "the session was erased: a new recording needs a new id"));
        }
        if *self.feed.epoch.borrow() == self.epoch {
            return Ok(());
        }
        Err(Farewell::new(Code::Superseded, "another connection sends this recording now"))
    }

    fn check(&self, record: &Record<'_>) -> Result<(), Farewell> {
        let wrong = |why: String| Err(Farewell::new(Code::DoesNotBelong, why));
        if record.epoch != self.epoch {
            return wrong(format!("a record of epoch {}; this connection's is {}", record.epoch, self.epoch));
        }
        if let Body::Frame { time, .. } = record.body
            && !(0..=self.feed.most_ticks()).contains(&time)
        {
            let seconds = self.feed.time_base.seconds(time);
            return wrong(format!(
                "frame {} at {seconds:.1} s; times count from the start of the recording and end after four hours",
                record.number
            ));
        }
        Ok(())
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.heard();
        self.feed.connections.fetch_sub(1, Ordering::AcqRel);
    }
}

fn not_a_record(error: NotARecord) -> Farewell {
    let code = if matches!(error, NotARecord::Length(_)) { Code::TooMuch } else { Code::NotUnderstood };
    Farewell::new(code, error.to_string())
}

#[cfg(test)]
mod tests;
