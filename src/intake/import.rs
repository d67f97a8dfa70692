//! Imports tables of rows that another tracker measured. A table is parsed strictly, stored as it was sent, and becomes
//! a session once it is durable. It is scored by a job, like a recording.

use bytes::Bytes;
use tokio::sync::OwnedSemaphorePermit;

use super::whole::known;
use super::{Intake, IntakeError, IntakeResult, Recording};
use crate::domain::files::trajectory::{ImportLimits, read_import};
use crate::domain::scope::Scope;
use crate::domain::session::NewSession;
use crate::domain::text::TrackerName;
use crate::media::Limits;
use crate::store::Session;

/// Maximum number of tables that are read at the same time: each is in memory as a whole.
pub(super) const AT_A_TIME: usize = 2;

/// Maximum number of tools in a table: two hands and two assisting tools.
const MOST_TOOLS: usize = 4;

/// Media type of a stored table.
const MEDIA_TYPE: &str = "text/csv";

/// A permit to hold one table in memory.
#[derive(Debug)]
pub struct Room(#[allow(dead_code, reason = "held until the table is read")] OwnedSemaphorePermit);

impl Intake {
    /// Acquires a permit for one more table; call it before reading a byte of the table.
    pub fn room_for_table(&self) -> IntakeResult<Room> {
        let permit = self.imports.clone().try_acquire_owned();
        permit.map(Room).map_err(|_| IntakeError::Importing { most: AT_A_TIME })
    }

    /// Maximum size of a table, bytes.
    pub fn max_table_bytes(&self) -> usize {
        self.settings.import_bytes
    }

    /// Imports a whole table. Call it on a task of its own, since some senders disconnect right after their last byte.
    pub async fn import(
        &self,
        scope: &Scope,
        recording: Recording,
        tracker: TrackerName,
        (table, _room): (Bytes, Room),
    ) -> IntakeResult<Session> {
        if table.is_empty() {
            return Err(IntakeError::Empty);
        }
        let Recording { trainee, task, in_box, filename, recorded_at_ms } = recording;
        let palette = self.store.palettes().latest(&Scope::service(), in_box).await?;
        let tools: Vec<String> = palette.into_iter().flat_map(|p| p.tools).map(|tool| tool.name).collect();
        let (limits, read) = (limits(self.settings.import_rows), table.clone());
        tokio::task::spawn_blocking(move || read_import(&read, &tools, &limits).map(drop)).await??;
        let kept = self.vault.put(&table).await?;
        let (video, media_type) = (kept.blob(), MEDIA_TYPE.to_owned());
        let new = NewSession { trainee, task, in_box, filename, recorded_at_ms, video, media_type };
        let session = self.store.sessions().import(scope, new, tracker).await.map_err(known)?;
        drop(kept); // from here on a row protects the file
        self.tell(&session);
        Ok(session)
    }
}

/// Limits for a table: as large as those for a recording.
fn limits(rows: usize) -> ImportLimits {
    let Limits { duration_s, frames, .. } = Limits::default();
    ImportLimits { rows, tools: MOST_TOOLS, frames, duration_s }
}
