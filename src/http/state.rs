//! The state that all handlers share.

use std::ops::Deref;
use std::sync::Arc;

use metrics_exporter_prometheus::PrometheusHandle;

use super::auth::open_sign_ins::OpenSignIns;
use super::auth::password::PasswordHasher;
use super::auth::throttle::Throttle;
use super::connection_slots::ConnectionSlots;
use super::events::PreparedEvent;
use super::heavy::HeavyAnswers;
use super::sessions::WatchedSessions;
use super::settings::HttpSettings;
use super::single_sign_on::SingleSignOn;
use crate::access_log::AccessLog;
use crate::analysis::QuickAnalysis;
use crate::analysis::stored_rows::StoredIndexes;
use crate::box_agents::BoxAgents;
use crate::certificates::Certificates;
use crate::cohorts::Cohorts;
use crate::domain::rights::RightsSettings;
use crate::events::EventBus;
use crate::intake::Intake;
use crate::live::FeedService;
use crate::queue::Queue;
use crate::shutdown::Shutdown;
use crate::store::Store;
use crate::time::SharedClock;
use crate::upkeep::{BackupSettings, BackupState, ErasureListState, RetentionSettings};
use crate::vault::Vault;

/// The parts of the service that handlers use. Clones share them.
#[derive(Clone)]
pub struct App(Arc<AppParts>);

/// What [`App`] holds.
pub struct AppParts {
    /// The database.
    pub store: Store,
    /// The files.
    pub vault: Vault,
    /// Uploads of recordings.
    pub intake: Intake,
    /// The job queue.
    pub queue: Queue,
    /// Events about changes.
    pub events: EventBus,
    /// The same events, prepared for the event streams.
    pub prepared_events: EventBus<Arc<PreparedEvent>>,
    /// The sessions with live views.
    pub watched_sessions: WatchedSessions,
    /// The clock.
    pub clock: SharedClock,
    /// The shutdown signal and the tasks to wait for.
    pub shutdown: Shutdown,
    /// Limits of the HTTP server.
    pub settings: HttpSettings,
    /// What instructors may do beyond their own groups.
    pub rights: RightsSettings,
    /// Settings of other parts, and the start time, as administrators see them.
    pub service_info: ServiceInfo,
    /// Limit on failed sign-ins.
    pub throttle: Throttle,
    /// The sign-ins and tokens with open streams.
    pub open_sign_ins: OpenSignIns,
    /// Single sign-on; `None` if the settings name no provider.
    pub single_sign_on: Option<SingleSignOn>,
    /// Queues for the hashes of passwords.
    pub password_hasher: PasswordHasher,
    /// Issues certificates.
    pub certificates: Certificates,
    /// Standards, reference groups, progress.
    pub cohorts: Cohorts,
    /// Live feeds: recordings arriving frame by frame.
    pub feeds: FeedService,
    /// Slots for the connections of live feeds.
    pub feed_slots: ConnectionSlots,
    /// The agents that stand by at boxes.
    pub box_agents: BoxAgents,
    /// Slots for their connections.
    pub agent_slots: ConnectionSlots,
    /// Analyses single pictures while the user waits.
    pub quick_analysis: QuickAnalysis,
    /// Slots for event streams and live views.
    pub watcher_slots: ConnectionSlots,
    /// Slots for large answers.
    pub heavy_answers: HeavyAnswers,
    /// Indexes of stored paths and diagnostics.
    pub stored_indexes: StoredIndexes,
    /// State of the scheduled backups.
    pub backup_state: BackupState,
    /// Whether all erasures are listed.
    pub erasure_list_state: ErasureListState,
    /// When and where backups are made.
    pub backup_settings: BackupSettings,
    /// The command that makes a backup by hand.
    pub backup_command: String,
    /// How long videos and erased people are kept.
    pub retention: RetentionSettings,
    /// Who opens whose recordings.
    pub access_log: AccessLog,
    /// Slots for exports of a person or of the centre, which read everything that belongs to them.
    pub exports: ConnectionSlots,
    /// Metrics for Prometheus.
    pub metrics: PrometheusHandle,
}

/// Settings outside [`HttpSettings`] that administrators can read.
#[derive(Clone, Copy, Debug)]
pub struct ServiceInfo {
    /// Version of the measuring pipeline.
    pub pipeline: &'static str,
    /// When this process began to serve, epoch ms.
    pub started_at_ms: i64,
    /// True if the service itself speaks HTTPS.
    pub is_https: bool,
    /// Recordings tracked at the same time.
    pub workers: usize,
    /// Largest recording, bytes.
    pub max_upload_bytes: u64,
    /// Hours after which an unfinished upload is deleted.
    pub unfinished_upload_h: u64,
    /// Seconds within which erased data is deleted from the disk.
    pub erased_within_s: u64,
}

impl App {
    /// The state made of these parts.
    pub fn new(parts: AppParts) -> Self {
        Self(Arc::new(parts))
    }
}

impl Deref for App {
    type Target = AppParts;

    fn deref(&self) -> &AppParts {
        &self.0
    }
}
