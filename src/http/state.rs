//! What every handler can reach.

use std::ops::Deref;
use std::sync::Arc;

use metrics_exporter_prometheus::PrometheusHandle;
use tokio::sync::Semaphore;

use super::auth::throttle::Throttle;
use super::places::Places;
use super::settings::HttpSettings;
use crate::analysis::Glances;
use crate::cohorts::Cohorts;
use crate::events::Events;
use crate::intake::Intake;
use crate::live::Feeds;
use crate::queue::Queue;
use crate::shutdown::Shutdown;
use crate::store::Store;
use crate::time::SharedClock;
use crate::vault::Vault;

/// The service as handlers see it. Clones are the same service.
#[derive(Clone)]
pub struct App(Arc<Parts>);

/// What [`App`] holds.
pub struct Parts {
    /// What the centre knows.
    pub store: Store,
    /// The files.
    pub vault: Vault,
    /// Recordings arriving.
    pub intake: Intake,
    /// Work that waits.
    pub queue: Queue,
    /// What changed, for those who watch.
    pub events: Events,
    /// What time it is.
    pub clock: SharedClock,
    /// The end of the service.
    pub shutdown: Shutdown,
    /// Limits.
    pub settings: HttpSettings,
    /// What else is set, and since when it runs, for those who run the service.
    pub in_force: InForce,
    /// Attempts to sign in.
    pub throttle: Throttle,
    /// Standards, reference groups, progress.
    pub cohorts: Cohorts,
    /// Recordings arriving frame by frame.
    pub feeds: Feeds,
    /// Places for their connections.
    pub feed_places: Arc<Semaphore>,
    /// Looks at pictures while people wait.
    pub glances: Glances,
    /// Places for event streams and watchers.
    pub streams: Places,
    /// Numbers for the people who run the service.
    pub metrics: PrometheusHandle,
}

/// What is set elsewhere than in [`HttpSettings`].
#[derive(Clone, Copy, Debug)]
pub struct InForce {
    /// Version of what measures.
    pub pipeline: &'static str,
    /// When this process began to serve, epoch ms.
    pub started_at_ms: i64,
    /// Recordings tracked at the same time.
    pub workers: usize,
    /// Largest recording, bytes.
    pub max_upload_bytes: u64,
    /// Hours after which an unfinished upload is forgotten.
    pub unfinished_upload_h: u64,
    /// Seconds within which what was erased has left the disk.
    pub erased_within_s: u64,
}

impl App {
    /// Puts the parts together.
    pub fn new(parts: Parts) -> Self {
        Self(Arc::new(parts))
    }
}

impl Deref for App {
    type Target = Parts;

    fn deref(&self) -> &Parts {
        &self.0
    }
}
