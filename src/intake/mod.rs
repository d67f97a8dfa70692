//! Recordings arriving: in pieces that survive every cut (tus), or in one call.
//!
//! ```text
//! begin: who, what, where are checked ─▶ empty file ─▶ row
//! append: bytes ─▶ file ─▶ fdatasync ─▶ row says how many ─▶ the sender hears of them     (again and again)
//! finish: file becomes a blob ─▶ session and job in one transaction ─▶ file goes
//! ```
//! Whatever ends in between, the next request or the next start goes on from the row: no byte that the sender heard of is
//! lost, and a cut costs at most [`CHECKPOINT`] and what was on the wire.
//!
//! | file | holds |
//! |---|---|
//! | [`tus`] | what the protocol's headers say |
//! | `begin.rs` | which trainee, task and box; refused before a byte is sent |
//! | `append.rs` | bytes into an upload |
//! | `senders.rs` | a sender who comes back takes over from their own broken connection |
//! | `finish.rs` | a whole upload becomes a session |
//! | `whole.rs` | a recording in one call |
//! | `import.rs` | a table of rows that another tracker measured |
//! | [`container`] | a recording's media type by its first bytes |

mod append;
mod begin;
pub mod container;
mod error;
mod finish;
mod import;
mod senders;
mod settings;
pub mod tus;
mod whole;

pub use append::{Piece, Received};
pub use begin::{About, Recording};
pub use error::{IntakeError, IntakeResult};
pub use finish::finish;
pub use import::Room;
pub use settings::UploadSettings;

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::Semaphore;

use crate::events::{Event, Events};
use crate::queue::Queue;
use crate::shutdown::Shutdown;
use crate::store::{Session, Store};
use crate::time::{SharedClock, millis};
use crate::vault::Vault;
use senders::Senders;

/// Bytes after which an arriving recording is made durable though the request goes on: most of what a cut costs. More
/// means fewer syncs; a client should not have to send more than 8 MiB again.
pub const CHECKPOINT: u64 = 4 * 1024 * 1024;

/// Where recordings arrive. Clones are the same place.
#[derive(Clone, Debug)]
pub struct Intake {
    store: Store,
    vault: Vault,
    queue: Queue,
    events: Events,
    clock: SharedClock,
    shutdown: Shutdown,
    settings: UploadSettings,
    senders: Arc<Senders>,
    /// Places for tables that are being read.
    imports: Arc<Semaphore>,
}

impl Intake {
    /// Puts recordings into this vault and this store.
    pub fn new(
        (store, vault): (Store, Vault),
        (queue, events): (Queue, Events),
        clock: SharedClock,
        shutdown: Shutdown,
        settings: UploadSettings,
    ) -> Self {
        let senders = Senders::new(clock.clone());
        let imports = Arc::new(Semaphore::new(import::AT_A_TIME));
        Self { store, vault, queue, events, clock, shutdown, settings, senders, imports }
    }

    /// Longest recording, bytes.
    pub fn max_bytes(&self) -> u64 {
        self.settings.max_bytes
    }

    /// When an upload that goes on now is forgotten unless it goes on again, epoch ms.
    fn expires_at_ms(&self) -> i64 {
        self.clock.now_ms() + millis(Duration::from_secs(self.settings.expire_h.saturating_mul(3600)))
    }

    /// Tells workers and watchers of a new session.
    fn tell(&self, session: &Session) {
        let (id, trainee, status) = (session.id, session.trainee_id, session.status());
        self.events.tell(Event::Session { id, trainee, status, progress: 0.0 });
        self.queue.work_arrived();
    }
}
