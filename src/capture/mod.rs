//! The agent beside a box: frames of its camera go to a server while they are recorded, and lie in a spool until the server
//! has them.
//!
//! ```text
//! media::Source ──frames──▶ recorder ──▶ spool (disk) ──▶ order: live first, the rest behind ──▶ connection ──▶ server
//!                                          ◀── what is durable there goes ──────────────────────────┘
//! ```
//! A recording is in the spool until the server says that it is whole. What one run could not send the next one does.
//!
//! | file | holds |
//! |---|---|
//! | [`controls`] | what a camera regulates by itself, switched off |
//! | [`recorder`] | frames as they come, numbered, into the spool |
//! | [`spool`] | recordings on the disk |
//! | [`order`] | what goes out next |
//! | [`connection`] | one conversation with the server |
//! | [`sender`] | conversations until the recording is whole |
//! | [`status`] | how it stands, for people |

pub mod connection;
pub mod controls;
pub mod order;
pub mod recorder;
pub mod sender;
pub mod spool;
pub mod status;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use self::spool::Spool;
use self::status::Status;

/// What recorder and sender share. Clones are the same agent.
#[derive(Clone)]
pub struct Agent(Arc<Shared>);

struct Shared {
    spool: Mutex<Spool>,
    status: Mutex<Status>,
    /// There may be something to send, or to end.
    changed: Notify,
}

impl Agent {
    /// An agent with this spool.
    pub fn new(spool: Spool) -> Self {
        let (spool, status) = (Mutex::new(spool), Mutex::new(Status::default()));
        Self(Arc::new(Shared { spool, status, changed: Notify::new() }))
    }

    /// Its spool; held for one operation, never across an await.
    pub fn spool(&self) -> MutexGuard<'_, Spool> {
        self.0.spool.lock().unwrap_or_else(PoisonError::into_inner) // files are whole at every step
    }

    /// How it stands.
    pub fn status(&self) -> MutexGuard<'_, Status> {
        self.0.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes everything in the spool durable, without holding up who appends to it.
    pub async fn sync(&self) {
        let files = self.spool().take_unsynced();
        let synced = tokio::task::spawn_blocking(move || files.iter().try_for_each(|file| file.sync_data())).await;
        if let Ok(Err(error)) = synced {
            tracing::error!(%error, "the spool cannot be synced: a power cut may cost what the server does not have yet");
        }
    }

    fn has_changed(&self) {
        self.0.changed.notify_one();
    }
}
