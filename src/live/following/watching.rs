//! A watcher of a recording that arrives.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Weak};

use tokio::sync::{broadcast, watch};

use super::Following;
use crate::analysis::protocol::Followed;
use crate::domain::feed::TimeBase;
use crate::live::Feed;
use crate::store;

/// A watcher of one recording.
pub struct Watch {
    /// The recording's row.
    pub row: store::Feed,
    /// Time base of its frames.
    pub time_base: TimeBase,
    /// Whether the recording is tracked.
    pub following: watch::Receiver<Following>,
    /// The child's replies.
    pub news: broadcast::Receiver<Arc<Followed>>,
    /// Present if the watcher wants pictures.
    pub viewer: Option<Viewer>,
    pub(super) feed: Weak<Feed>, // weak: a watcher does not keep a recording open
}

impl Watch {
    /// True if a connection sends the recording.
    pub fn is_sent(&self) -> bool {
        self.feed.upgrade().is_some_and(|feed| feed.is_sent())
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
