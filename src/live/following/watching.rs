//! The watcher's end of what is followed.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Weak};

use tokio::sync::{broadcast, watch};

use super::Following;
use crate::analysis::protocol::Followed;
use crate::domain::feed::TimeBase;
use crate::live::Feed;
use crate::store;

/// A watcher's end.
pub struct Watch {
    /// The recording.
    pub row: store::Feed,
    /// The clock of its frames.
    pub time_base: TimeBase,
    /// Whether it is tracked.
    pub following: watch::Receiver<Following>,
    /// What its frames show.
    pub news: broadcast::Receiver<Arc<Followed>>,
    /// Whether pictures are wanted.
    pub viewer: Option<Viewer>,
    pub(super) feed: Weak<Feed>, // weak: whoever watches does not keep a recording open
}

impl Watch {
    /// Does anybody send the recording?
    pub fn is_sent(&self) -> bool {
        self.feed.upgrade().is_some_and(|feed| feed.is_sent())
    }
}

/// One that wants pictures, for as long as it is kept.
pub struct Viewer(Arc<AtomicUsize>); // not the follower itself: its news would never end

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
