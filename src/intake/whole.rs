//! Receives a recording in one request: it is hashed while it is written and becomes a session once it is durable. If
//! the connection breaks, nothing is kept.

use bytes::Bytes;
use futures_util::{Stream, StreamExt};

use super::append::BoxError;
use super::finish::media_type_of;
use super::{Intake, IntakeError, IntakeResult, ResolvedRecording};
use crate::domain::scope::Scope;
use crate::domain::session::NewSession;
use crate::store::{SessionRecord, StoreError};
use crate::vault::PinnedBlob;

impl Intake {
    /// Receives a whole recording. Call it on a task of its own, since some senders disconnect right after their last
    /// byte.
    pub async fn take_whole<B>(
        &self,
        scope: &Scope,
        recording: ResolvedRecording,
        bytes: B,
    ) -> IntakeResult<SessionRecord>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let kept = self.store_whole(bytes, self.settings.max_bytes).await?;
        let ResolvedRecording { trainee, task, in_box, filename, recorded_at_ms, time } = recording;
        let media_type = media_type_of(&self.vault, kept.blob().hash).await?.to_owned();
        let video = kept.blob();
        let new = NewSession { trainee, task, in_box, filename, recorded_at_ms, video, media_type, time };
        let session = self.store.sessions().create(scope, new).await.map_err(already_exists)?;
        drop(kept); // from here on a row protects the file
        self.announce_session(&session);
        Ok(session)
    }

    /// Stores a body of at most `most` bytes, or nothing.
    pub(super) async fn store_whole<B>(&self, mut bytes: B, most: u64) -> IntakeResult<PinnedBlob>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let mut incoming = self.vault.incoming(most).await?;
        let mut received = 0;
        let ending = self.shutdown.begun();
        tokio::pin!(ending);
        loop {
            let next = tokio::select! {
                next = bytes.next() => next,
                () = &mut ending => return Err(IntakeError::EndingUnsaved),
            };
            let Some(next) = next else { break };
            let next = next.map_err(IntakeError::ConnectionLost)?;
            incoming.write(&next).await?;
            received += next.len();
        }
        if received == 0 { Err(IntakeError::Empty) } else { Ok(incoming.finish().await?) }
    }
}

pub(super) fn already_exists(error: StoreError) -> IntakeError {
    match error {
        StoreError::Taken { existing: Some(session), .. } => IntakeError::AlreadyExists { session },
        other => other.into(),
    }
}
