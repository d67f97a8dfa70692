//! The agent beside a box: sends the frames of its camera to a server while they are recorded, and keeps them in a
//! spool until the server has them.
//!
//! ```text
//! source ──frames──▶ recorder ──▶ spool (disk) ──▶ send_order: live frames first ──▶ connection ──▶ server
//!                                   ◀── removes what is durable on the server ───────────┘
//! ```
//! A recording stays in the spool until the server reports it complete. The next run sends what one run could not
//! send.
//!
//! | file | holds |
//! |---|---|
//! | [`controls`] | switching off a camera's automatic controls |
//! | [`held_controls`] | holding them while a recording runs |
//! | [`source`] | the frames of a source, over its interruptions |
//! | [`recorder`] | frames into the spool as they arrive, with numbers |
//! | [`spool`] | recordings on the disk |
//! | [`recording_file`] | a recording of the spool as a file |
//! | [`send_order`] | what is sent next |
//! | [`connection`] | one connection to the server |
//! | [`sender`] | connections until the recording is complete |
//! | [`standby`] | standing by: camera kept open, commands of the server and of the box's screen |
//! | [`status`] | the agent's state, for display |

pub mod connection;
pub mod controls;
pub mod held_controls;
pub mod recorder;
pub mod recording_file;
pub mod send_order;
pub mod sender;
pub mod source;
pub mod spool;
pub mod standby;
pub mod status;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::{Notify, watch};

use self::spool::Spool;
use self::status::Status;
use crate::ids::{FeedId, SessionId};

/// The state that recorder and sender share. Clones are the same agent.
#[derive(Clone)]
pub struct Agent(Arc<AgentShared>);

struct AgentShared {
    spool: Mutex<Spool>,
    status: Mutex<Status>,
    /// Notified when there may be something to send, or the recording may be ended.
    changed: Notify,
    /// The last recording that the server accepted, and its session.
    accepted: watch::Sender<Option<(FeedId, SessionId)>>,
}

impl Agent {
    /// Creates an agent with this spool.
    pub fn new(spool: Spool) -> Self {
        let (spool, status) = (Mutex::new(spool), Mutex::new(Status::default()));
        let accepted = watch::Sender::new(None);
        Self(Arc::new(AgentShared { spool, status, changed: Notify::new(), accepted }))
    }

    /// The spool. Hold the lock for one operation, never across an await.
    pub fn spool(&self) -> MutexGuard<'_, Spool> {
        self.0.spool.lock().unwrap_or_else(PoisonError::into_inner) // the files are consistent after every step
    }

    /// The agent's state.
    pub fn status(&self) -> MutexGuard<'_, Status> {
        self.0.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The last recording that the server accepted, and its session.
    pub fn accepted(&self) -> watch::Receiver<Option<(FeedId, SessionId)>> {
        self.0.accepted.subscribe()
    }

    /// Makes everything in the spool durable without delaying new records.
    pub async fn sync(&self) {
        let files = self.spool().take_unsynced();
        let synced = tokio::task::spawn_blocking(move || files.iter().try_for_each(|file| file.sync_data())).await;
        if let Ok(Err(error)) = synced {
            tracing::error!(%error, "spool not synced: a power cut may lose frames that the server lacks");
        }
    }

    fn notify_changed(&self) {
        self.0.changed.notify_one();
    }
}
