//! Receives recordings: in resumable pieces (tus), or in one request.
//!
//! ```text
//! begin: check trainee, task, box ─▶ empty file ─▶ row
//! append: bytes ─▶ file ─▶ fdatasync ─▶ count in the row ─▶ acknowledged to the sender     (repeated)
//! finish: file becomes a blob ─▶ session and job in one transaction ─▶ file is deleted
//! ```
//! After an interruption at any point, the next request or the next start continues from the row: no acknowledged byte
//! is lost, and a lost connection costs at most [`CHECKPOINT`] and the bytes on the wire.
//!
//! | file | holds |
//! |---|---|
//! | [`tus`] | parses the protocol's headers |
//! | `begin.rs` | checks trainee, task and box before a byte is sent |
//! | `append.rs` | appends bytes to an upload |
//! | `senders.rs` | a sender that resumes replaces its own broken connection |
//! | `finish.rs` | turns a complete upload into a session |
//! | `whole.rs` | a recording in one request |
//! | `waiting.rs` | recordings that wait for a name |
//! | [`inbox`] | the watched folder of the server |
//! | [`folder`] | the list of a folder, and the times in names |
//! | `import.rs` | a table of rows that another tracker measured |
//! | [`container`] | a recording's media type by its first bytes |

mod append;
mod begin;
pub mod container;
mod error;
mod finish;
pub mod folder;
mod import;
pub mod inbox;
mod senders;
mod settings;
pub mod tus;
mod waiting;
mod whole;

pub use append::{BoxError, Piece, UploadProgress};
pub use begin::{RecordingDescription, ResolvedRecording};
pub use error::{IntakeError, IntakeResult};
pub use finish::finish;
pub use settings::UploadSettings;
pub use waiting::{UnnamedDescription, UnnamedRecording};

use std::sync::Arc;
use std::time::Duration;

use crate::events::{Event, EventBus};
use crate::queue::Queue;
use crate::shutdown::Shutdown;
use crate::store::{SessionRecord, Store};
use crate::time::{SharedClock, millis};
use crate::vault::Vault;
use senders::Senders;

/// An arriving recording is made durable each time after this many bytes, even in the middle of a request. This bounds
/// the loss when a connection breaks. More means fewer syncs; a client should not have to send more than 8 MiB again.
pub const CHECKPOINT: u64 = 4 * 1024 * 1024;

/// Receives recordings. Clones share one state.
#[derive(Clone, Debug)]
pub struct Intake {
    store: Store,
    vault: Vault,
    queue: Queue,
    events: EventBus,
    clock: SharedClock,
    shutdown: Shutdown,
    settings: UploadSettings,
    senders: Arc<Senders>,
}

impl Intake {
    /// Stores recordings in this vault and this store.
    pub fn new(
        (store, vault): (Store, Vault),
        (queue, events): (Queue, EventBus),
        clock: SharedClock,
        shutdown: Shutdown,
        settings: UploadSettings,
    ) -> Self {
        let senders = Senders::new(clock.clone());
        Self { store, vault, queue, events, clock, shutdown, settings, senders }
    }

    /// Maximum length of a recording, bytes.
    pub fn max_bytes(&self) -> u64 {
        self.settings.max_bytes
    }

    /// When an upload that receives bytes now expires unless more arrive, epoch ms.
    fn expires_at_ms(&self) -> i64 {
        self.clock.now_ms() + millis(Duration::from_secs(self.settings.expire_h.saturating_mul(3600)))
    }

    /// Announces a new session: wakes a worker and publishes an event.
    fn announce_session(&self, session: &SessionRecord) {
        let (id, trainee, status) = (session.id, session.trainee_id, session.status());
        self.events.publish(Event::Session { id, trainee, status, progress: 0.0 });
        self.queue.work_arrived();
    }
}
