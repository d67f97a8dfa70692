//! Imports tables of rows that another tracker measured. A table is parsed strictly, stored as it was sent, and becomes
//! a session once it is durable. It is scored by a job, like a recording.

use bytes::Bytes;
use tokio::sync::OwnedSemaphorePermit;

use super::whole::already_exists;
use super::{Intake, IntakeError, IntakeResult, ResolvedRecording};
use crate::domain::files::trajectory::{ImportLimits, read_import};
use crate::domain::scope::Scope;
use crate::domain::session::NewSession;
use crate::domain::text::TrackerName;
use crate::media::MediaLimits;
use crate::store::SessionRecord;

/// Maximum number of tables that are read at the same time: each is in memory as a whole.
pub(super) const MAX_CONCURRENT_IMPORTS: usize = 2;

/// Maximum number of tools in a table: two hands and two assisting tools.
const MAX_TOOLS: usize = 4;

/// Media type of a stored table.
const MEDIA_TYPE: &str = "text/csv";

/// A permit to hold one table in memory.
#[derive(Debug)]
pub struct ImportPermit {
    /// Held until the table is read.
    _permit: OwnedSemaphorePermit,
}

impl Intake {
    /// Acquires a permit for one more table; call it before reading a byte of the table.
    pub fn acquire_import_permit(&self) -> IntakeResult<ImportPermit> {
        let permit = self.imports.clone().try_acquire_owned();
        let too_many = |_| IntakeError::TooManyImports { most: MAX_CONCURRENT_IMPORTS };
        permit.map(|permit| ImportPermit { _permit: permit }).map_err(too_many)
    }

    /// Maximum size of a table, bytes.
    pub fn max_table_bytes(&self) -> usize {
        self.settings.import_bytes
    }

    /// Imports a whole table. Call it on a task of its own, since some senders disconnect right after their last byte.
    pub async fn import(
        &self,
        scope: &Scope,
        recording: ResolvedRecording,
        tracker: TrackerName,
        (table, _room): (Bytes, ImportPermit),
    ) -> IntakeResult<SessionRecord> {
        if table.is_empty() {
            return Err(IntakeError::Empty);
        }
        let ResolvedRecording { trainee, task, in_box, filename, recorded_at_ms, time: _ } = recording;
        let palette = self.store.palettes().latest(&Scope::service(), in_box).await?;
        let tools: Vec<String> = palette.into_iter().flat_map(|p| p.tools).map(|tool| tool.name).collect();
        let (limits, read) = (limits(self.settings.import_rows), table.clone());
        tokio::task::spawn_blocking(move || read_import(&read, &tools, &limits).map(drop)).await??;
        let kept = self.vault.put(&table).await?;
        let (video, media_type) = (kept.blob(), MEDIA_TYPE.to_owned());
        let new = NewSession { trainee, task, in_box, filename, recorded_at_ms, video, media_type, time: None };
        let session = self.store.sessions().import(scope, new, tracker).await.map_err(already_exists)?;
        drop(kept); // from here on a row protects the file
        self.announce_session(&session);
        Ok(session)
    }
}

/// Limits for a table: as large as those for a recording.
fn limits(rows: usize) -> ImportLimits {
    let MediaLimits { duration_s, frames, .. } = MediaLimits::default();
    ImportLimits { rows, tools: MAX_TOOLS, frames, duration_s }
}
