//! A watcher of a recording that arrives.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock, Weak};

use bytes::Bytes;
use tokio::sync::{broadcast, watch};

use super::TrackingState;
use crate::analysis::protocol::FollowReply;
use crate::live::OpenFeed;
use crate::store;

/// A watcher of one recording.
pub struct FeedWatcher {
    /// The recording's row.
    pub row: store::FeedRow,
    /// Whether the recording is tracked.
    pub state: watch::Receiver<TrackingState>,
    /// The child's replies.
    pub replies: broadcast::Receiver<Arc<SharedReply>>,
    /// Present if the watcher wants pictures.
    pub viewer: Option<Viewer>,
    pub(super) feed: Weak<OpenFeed>, // weak: a watcher does not keep a recording open
}

/// A child's reply, for all watchers.
pub struct SharedReply {
    /// The reply.
    pub reply: FollowReply,
    /// Its messages; the first watcher that sends them encodes them for all.
    pub messages: OnceLock<Vec<EncodedMessage>>,
}

impl From<FollowReply> for SharedReply {
    fn from(reply: FollowReply) -> Self {
        Self { reply, messages: OnceLock::new() }
    }
}

/// A message as it is sent to watchers.
pub enum EncodedMessage {
    /// Text in UTF-8.
    Text(Bytes),
    /// A picture, for watchers that want pictures.
    Picture(Bytes),
}

impl FeedWatcher {
    /// True if a connection sends the recording.
    pub fn has_sender(&self) -> bool {
        self.feed.upgrade().is_some_and(|feed| feed.has_sender())
    }
}

/// Counts a watcher that wants pictures, for as long as it exists.
pub struct Viewer(Arc<AtomicUsize>); // not the supervisor itself: the stream of replies would then never end

impl Viewer {
    pub(super) fn new(among: &Arc<AtomicUsize>) -> Self {
        among.fetch_add(1, Ordering::AcqRel);
        Self(among.clone())
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}
