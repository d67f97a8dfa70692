//! Imports tables of rows that another tracker measured. A table is stored while it arrives, checked in a child process,
//! and then becomes a session. It is scored by a job, like a recording.

use bytes::Bytes;
use futures_util::Stream;

use super::append::BoxError;
use super::whole::already_exists;
use super::{Intake, IntakeResult, ResolvedRecording};
use crate::analysis::protocol::CheckTableWork;
use crate::domain::scope::Scope;
use crate::domain::session::{ForeignPath, NewSession};
use crate::store::SessionRecord;
use crate::vault::PinnedBlob;

/// Media type of a stored table.
const MEDIA_TYPE: &str = "text/csv";

impl Intake {
    /// Maximum size of a table, bytes.
    pub fn max_table_bytes(&self) -> u64 {
        self.settings.import_bytes as u64
    }

    /// Stores a table as it arrives. If nothing refers to it later, it is deleted.
    pub async fn store_table<B>(&self, bytes: B) -> IntakeResult<PinnedBlob>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        self.store_whole(bytes, self.max_table_bytes()).await
    }

    /// What a table for this recording's box must satisfy.
    pub async fn table_limits(&self, recording: &ResolvedRecording) -> IntakeResult<CheckTableWork> {
        let palette = self.store.palettes().in_use(&Scope::service(), recording.in_box).await?;
        let known_tools = palette.into_iter().flat_map(|p| p.tools).map(|tool| tool.name).collect();
        Ok(CheckTableWork { known_tools, max_bytes: self.max_table_bytes(), max_rows: self.settings.import_rows })
    }

    /// Makes a session of a stored and checked table.
    pub async fn import(
        &self,
        scope: &Scope,
        recording: ResolvedRecording,
        path: ForeignPath,
        table: PinnedBlob,
    ) -> IntakeResult<SessionRecord> {
        let ResolvedRecording { trainee, task, in_box, filename, recorded_at_ms, time: _ } = recording;
        let (video, media_type) = (table.blob(), MEDIA_TYPE.to_owned());
        let new = NewSession { trainee, task, in_box, filename, recorded_at_ms, video, media_type, time: None };
        let session = self.store.sessions().import(scope, new, path).await.map_err(already_exists)?;
        drop(table); // from here on a row protects the file
        self.announce_session(&session);
        Ok(session)
    }
}
