//! Active senders. A sender that resumes after a broken connection replaces its own old connection.
//!
//! A connection that breaks without a signal (a cable pulled, a tablet asleep) looks like a slow one for as long as the
//! minimum rate allows, and holds the upload's lock. A client that resumes first asks for the upload's progress. That
//! request ends a piece without new bytes for [`SILENCE`], after its bytes are durable. A piece that is still arriving
//! is never interrupted; a second one beside it is refused.

use std::collections::HashMap;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio_util::sync::CancellationToken;

use crate::ids::UploadId;
use crate::time::{SharedClock, millis};

/// A piece is silent if no byte has arrived for this time.
const SILENCE: Duration = Duration::from_secs(2);

/// The pieces that are arriving.
#[derive(Debug)]
pub(super) struct Senders {
    clock: SharedClock,
    active: Mutex<HashMap<UploadId, Arc<Sender>>>,
}

/// One piece that is arriving.
#[derive(Debug)]
struct Sender {
    last_byte_ms: AtomicI64,
    /// Requests that the piece end.
    end_requested: CancellationToken,
    /// Set when it has ended.
    ended: CancellationToken,
}

/// Registration of an arriving piece. Only the holder of the upload's lock creates one.
#[derive(Debug)]
pub(super) struct SenderGuard {
    id: UploadId,
    sender: Arc<Sender>,
    senders: Arc<Senders>,
}

impl Senders {
    pub fn new(clock: SharedClock) -> Arc<Self> {
        Arc::new(Self { clock, active: Mutex::default() })
    }

    /// Registers a piece that begins to arrive.
    pub fn register(self: &Arc<Self>, id: UploadId) -> SenderGuard {
        let sender = Arc::new(Sender {
            last_byte_ms: AtomicI64::new(self.clock.now_ms()),
            end_requested: CancellationToken::new(),
            ended: CancellationToken::new(),
        });
        self.active().insert(id, sender.clone());
        SenderGuard { id, sender, senders: self.clone() }
    }

    /// Ends a silent piece and waits until its bytes are durable.
    pub async fn end_silent(&self, id: UploadId) {
        let found = self.active().get(&id).cloned();
        let Some(sender) = found else { return };
        if self.clock.now_ms() - sender.last_byte_ms.load(Ordering::Relaxed) >= millis(SILENCE) {
            sender.end_requested.cancel();
            sender.ended.cancelled().await;
        }
    }

    fn active(&self) -> MutexGuard<'_, HashMap<UploadId, Arc<Sender>>> {
        self.active.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl SenderGuard {
    /// Records that bytes arrived.
    pub fn record_bytes(&self) {
        self.sender.last_byte_ms.store(self.senders.clock.now_ms(), Ordering::Relaxed);
    }

    /// Waits until the same sender resumes on another connection.
    pub async fn resumed_elsewhere(&self) {
        self.sender.end_requested.cancelled().await;
    }
}

impl Drop for SenderGuard {
    fn drop(&mut self) {
        self.senders.active().remove(&self.id);
        self.sender.ended.cancel();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::ManualClock;

    #[tokio::test]
    async fn only_a_silent_sender_is_ended() {
        let clock = ManualClock::at(1_000_000);
        let senders = Senders::new(clock.clone());
        let id = UploadId::at(0);
        let sending = senders.register(id);
        clock.advance(Duration::from_millis(1_999));
        senders.end_silent(id).await;
        assert!(!sending.sender.end_requested.is_cancelled());
        sending.record_bytes();
        clock.advance(Duration::from_millis(1_999));
        senders.end_silent(id).await;
        assert!(!sending.sender.end_requested.is_cancelled());
        clock.advance(Duration::from_millis(1));
        let receiver = tokio::spawn(async move { sending.resumed_elsewhere().await });
        senders.end_silent(id).await;
        receiver.await.unwrap();
        senders.end_silent(id).await;
    }
}
