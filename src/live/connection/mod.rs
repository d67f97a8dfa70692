//! One connection's side of a feed: it may send until a later connection takes over.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use bytes::Bytes;
use tokio::sync::watch;

use super::recording::{EndTrigger, FinishOutcome};
use super::{FeedPhase, FeedService, FeedState, OpenFeed, reason_of_vault_error};
use crate::domain::feed::close_reason::{CloseCode, CloseReason};
use crate::domain::feed::early_end::EarlyEnd;
use crate::domain::feed::messages::ServerMessage;
use crate::domain::feed::record::{FeedRecord, NotARecord, RecordBody};
use crate::domain::feed::{FrameCodec, TimeBase};
use crate::domain::session::SessionStatus;
use crate::ids::FeedId;
use crate::vault::VaultResult;

/// The connection that may send a recording.
pub struct Connection {
    feeds: FeedService,
    feed: Arc<OpenFeed>,
    epoch: u32,
    current_epoch: watch::Receiver<u32>,
    is_unsynced: bool,
}

impl Connection {
    /// Takes over from any earlier connection.
    pub(super) fn take_over(feeds: FeedService, feed: Arc<OpenFeed>, epoch: u32) -> Self {
        feed.connections.fetch_add(1, Ordering::AcqRel);
        feed.was_closed.store(false, Ordering::Release);
        feeds.publish_status(feed.row.session_id, feed.row.trainee_id, SessionStatus::Receiving);
        feed.epoch.send_if_modified(|now| {
            let is_later = epoch > *now;
            *now = (*now).max(epoch);
            is_later
        });
        let current_epoch = feed.epoch.subscribe();
        feed.tracking.start(&feeds, &feed);
        Self { feeds, feed, epoch, current_epoch, is_unsynced: true }
    }

    /// The first message: what is durable already; or the end, if the recording was being ended when this connection
    /// began.
    pub async fn welcome(&mut self) -> Result<ServerMessage, CloseReason> {
        if let FeedState::Ended(session) = &*self.feed.state.lock().await {
            return Ok(ServerMessage::Ended { session: *session, durable: None });
        }
        let durable = self.make_durable().await?;
        let session = self.feed.row.session_id;
        Ok(ServerMessage::Welcome { session, epoch: self.epoch, durable, token_expires_at: None })
    }

    /// Takes a record. It is durable after the next [`Connection::begin_sync`], and tracked after that or after
    /// [`Connection::write`].
    pub async fn take_record(&mut self, message: Bytes) -> Result<(), CloseReason> {
        let record = FeedRecord::read(&message).map_err(reason_of_bad_record)?;
        self.check_record(&record)?;
        let feed = self.feed.clone();
        let mut state = feed.state.lock().await;
        self.check_may_send()?;
        let records = state.records()?;
        let (first, last) = (record.number, record.last_number());
        let frame = match record.body {
            RecordBody::Frame { time, is_key, .. } => Some((time, is_key || feed.row.codec == FrameCodec::Jpeg)),
            RecordBody::Gap { .. } => None,
        };
        let is_known = match record.body {
            RecordBody::Frame { .. } => records.numbers.contains(first),
            RecordBody::Gap { .. } => records.numbers.contains_all(first, last),
        };
        if is_known {
            return Ok(()); // a repetition: its acknowledgement was lost
        }
        let most = self.feeds.0.settings.max_bytes;
        if records.log.bytes() + message.len() as u64 > most {
            return Err(CloseReason::new(CloseCode::TooLarge, format!("the recording has more than {most} bytes")));
        }
        records.numbers.add(first, last).map_err(|error| CloseReason::new(CloseCode::TooLarge, error.to_string()))?;
        let (offset, bytes) = (records.log.bytes(), message.len());
        let appended = records.log.append(message).await;
        self.close_on_error(appended).await?;
        self.is_unsynced = true;
        if let Some((time, is_key)) = frame {
            feed.note_frame(time);
            feed.tracking.frame_appended(offset, bytes, is_key);
        }
        feed.tracking.bytes_written(records.log.written());
        Ok(())
    }

    /// True if a child waits for records that are not written yet.
    pub fn has_unwritten(&self) -> bool {
        self.feed.tracking.waits_for_log()
    }

    /// Writes the records that arrived, so that they are tracked. Call it once for all records at hand, not for each.
    pub async fn write(&mut self) -> Result<(), CloseReason> {
        let feed = self.feed.clone();
        let mut state = feed.state.lock().await;
        self.check_may_send()?;
        if let FeedState::Receiving(records) = &mut *state {
            let written = records.log.write_waiting().await;
            self.close_on_error(written).await?;
            feed.tracking.bytes_written(records.log.written());
        }
        Ok(())
    }

    /// Takes a frame or gap made by the service, as [`Connection::take_record`] takes a sender's.
    pub(super) async fn take_local_record(&mut self, number: u64, body: RecordBody<'_>) -> Result<(), CloseReason> {
        let record = FeedRecord { epoch: self.epoch, number, body };
        let mut bytes = Vec::with_capacity(record.bytes());
        record.write(&mut bytes);
        self.take_record(bytes.into()).await
    }

    /// The recording's id.
    pub(super) fn recording(&self) -> FeedId {
        self.feed.row.id
    }

    /// Time base of the recording's frames.
    pub(super) fn time_base(&self) -> TimeBase {
        self.feed.time_base
    }

    /// True if another record may arrive. A sender that is too fast for live tracking is slowed down.
    pub fn has_capacity(&self) -> bool {
        self.feed.tracking.has_capacity()
    }

    /// Waits until another record may arrive.
    pub async fn wait_for_capacity(&self) {
        self.feed.tracking.wait_for_capacity().await;
    }

    /// True if there are records for which no sync has begun.
    pub fn is_unsynced(&self) -> bool {
        self.is_unsynced
    }

    /// Begins to make the arrived records durable. The future resolves when they are, with the durable numbers. More
    /// records may arrive meanwhile: a busy disk does not delay them.
    pub async fn begin_sync(
        &mut self,
    ) -> Result<impl Future<Output = Result<Vec<[u64; 2]>, CloseReason>> + use<>, CloseReason> {
        let feed = self.feed.clone();
        let mut state = feed.state.lock().await;
        self.check_may_send()?;
        let records = state.records()?;
        let (bytes, durable) = (records.log.bytes(), records.numbers.ranges().to_vec());
        let syncing = match records.synced < bytes {
            true => {
                let begun = records.log.begin_sync().await;
                let begun = self.close_on_error(begun).await?;
                feed.tracking.bytes_written(records.log.written());
                Some(begun)
            }
            false => None,
        };
        drop(state);
        self.is_unsynced = false;
        Ok(async move {
            if let Some(syncing) = syncing {
                syncing.end().await.map_err(reason_of_vault_error)?;
                if let FeedState::Receiving(records) = &mut *feed.state.lock().await {
                    records.synced = records.synced.max(bytes);
                }
            }
            Ok(durable)
        })
    }

    /// The sender ends the recording with this many frames, and says why if it ends early: returns `Missing` frames, or
    /// `Ended` once it is a session.
    pub async fn end(&mut self, frames: u64, early: Option<EarlyEnd>) -> Result<ServerMessage, CloseReason> {
        let durable = Some(self.make_durable().await?);
        // In a separate task: a sender that disconnects now must not cancel it.
        let (feeds, feed, ending) =
            (self.feeds.clone(), self.feed.clone(), EndTrigger::Requested { epoch: self.epoch, frames, early });
        let ended = self.feeds.0.shutdown.spawn(async move { feeds.finish(&feed, ending).await });
        match ended.await.map_err(|panic| CloseReason::new(CloseCode::Failed, panic.to_string()))?? {
            FinishOutcome::Complete(session) => Ok(ServerMessage::Ended { session, durable }),
            FinishOutcome::Missing(frames) => Ok(ServerMessage::Missing { frames }),
            FinishOutcome::StillSending => {
                Err(CloseReason::new(CloseCode::Superseded, "another connection sends this recording now"))
            }
        }
    }

    /// Waits until nothing more may arrive on this connection and returns why: the service shuts down, a later
    /// connection took over, or a frame does not fit.
    pub async fn wait_until_closed(&self) -> CloseReason {
        tokio::select! {
            biased;
            () = self.feeds.0.shutdown.begun() => CloseReason::service_stopping(),
            reason = self.wait_until_superseded() => reason,
            reason = self.wait_until_refused() => reason,
        }
    }

    /// Waits until a later connection has taken over.
    async fn wait_until_superseded(&self) -> CloseReason {
        let (mine, mut now) = (self.epoch, self.current_epoch.clone());
        let _ = now.wait_for(|now| *now != mine).await; // cannot fail: the feed holds the sender
        match self.check_may_send() {
            Err(reason) => reason,
            Ok(()) => CloseReason::new(CloseCode::Failed, "the recording was removed"),
        }
    }

    /// Waits until a frame does not fit the recording.
    async fn wait_until_refused(&self) -> CloseReason {
        CloseReason::new(CloseCode::OutOfPlace, self.feed.tracking.wait_until_refused().await)
    }

    /// Notes that the sender closed the connection. A connection that fell silent was lost, not closed.
    pub fn record_closed(&self) {
        if self.check_may_send().is_ok() {
            self.feed.was_closed.store(true, Ordering::Release);
        }
    }

    /// Notes a contact with the sender.
    pub fn record_contact(&self) {
        self.feed.last_contact_ms.store(self.feeds.0.clock.monotonic_ms(), Ordering::Release);
    }

    /// Makes the arrived records durable before anything else is done.
    async fn make_durable(&mut self) -> Result<Vec<[u64; 2]>, CloseReason> {
        self.begin_sync().await?.await
    }

    /// Closes the log if it could not be written; the next hello reads it through.
    async fn close_on_error<T>(&self, done: VaultResult<T>) -> Result<T, CloseReason> {
        match done {
            Ok(done) => Ok(done),
            Err(error) => {
                self.feeds.close_feed(&self.feed).await;
                Err(reason_of_vault_error(error))
            }
        }
    }

    fn check_may_send(&self) -> Result<(), CloseReason> {
        if self.feed.phase() == FeedPhase::Removed {
            return Err(CloseReason::new(CloseCode::Unknown, "the session was erased: a new recording needs a new id"));
        }
        if *self.feed.epoch.borrow() == self.epoch {
            return Ok(());
        }
        Err(CloseReason::new(CloseCode::Superseded, "another connection sends this recording now"))
    }

    fn check_record(&self, record: &FeedRecord<'_>) -> Result<(), CloseReason> {
        let wrong = |why: String| Err(CloseReason::new(CloseCode::OutOfPlace, why));
        if record.epoch != self.epoch {
            return wrong(format!("a record of epoch {}; this connection's is {}", record.epoch, self.epoch));
        }
        if let RecordBody::Frame { time, .. } = record.body
            && !(0..=self.feed.max_ticks()).contains(&time)
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
        self.record_contact();
        let before = self.feed.connections.fetch_sub(1, Ordering::AcqRel);
        if before == 1 && self.feed.phase() == FeedPhase::Open {
            let row = &self.feed.row; // pages show that it is interrupted
            self.feeds.publish_status(row.session_id, row.trainee_id, SessionStatus::Receiving);
        }
    }
}

fn reason_of_bad_record(error: NotARecord) -> CloseReason {
    let code = if matches!(error, NotARecord::Length(_)) { CloseCode::TooLarge } else { CloseCode::NotUnderstood };
    CloseReason::new(code, error.to_string())
}

#[cfg(test)]
mod tests;
