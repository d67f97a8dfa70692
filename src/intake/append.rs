//! Receives pieces of uploads: bytes are written, synced and recorded before they are acknowledged.

use std::error::Error;

use bytes::Bytes;
use futures_util::{Stream, StreamExt};

use super::finish::finish;
use super::senders::SenderGuard;
use super::tus::{Checksum, RunningSum};
use super::{CHECKPOINT, Intake, IntakeError, IntakeResult};
use crate::domain::scope::Scope;
use crate::ids::UploadId;
use crate::store::{FinishedUpload, StoreError, UploadRecord};
use crate::vault::{UploadFile, VaultError};

/// Any error of the connection while a piece arrives.
pub type BoxError = Box<dyn Error + Send + Sync>;

/// A piece of a recording.
pub struct Piece<B> {
    /// Where it begins: the number of bytes before it.
    pub offset: u64,
    /// Its length in bytes, if the sender states it.
    pub length: Option<u64>,
    /// The checksum that its bytes must have.
    pub checksum: Option<Checksum>,
    /// Its bytes.
    pub bytes: B,
}

/// The progress of an upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UploadProgress {
    /// Bytes that are durable.
    pub received: u64,
    /// When it expires unless more bytes arrive, epoch ms.
    pub expires_at_ms: i64,
    /// Its outcome, once it is complete.
    pub finished: Option<FinishedUpload>,
}

impl Intake {
    /// An upload that the scope sees and that has not expired.
    pub async fn upload(&self, scope: &Scope, id: UploadId) -> IntakeResult<UploadRecord> {
        let upload = self.store.uploads().get(scope, id).await?;
        if upload.session_id.is_none() && upload.expires_at_ms <= self.clock.now_ms() {
            return Err(IntakeError::Expired);
        }
        Ok(upload)
    }

    /// Appends a piece. Call it on a task of its own, so that it runs to its end even if the sender disconnects.
    pub async fn append<B>(&self, scope: &Scope, id: UploadId, piece: Piece<B>) -> IntakeResult<UploadProgress>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let seen = self.upload(scope, id).await?;
        if seen.session_id.is_none() {
            self.receive(scope, id, seen.received, piece).await?;
        } else if piece.offset != seen.received {
            return Err(IntakeError::Offset { received: seen.received });
        }
        self.progress(scope, id).await
    }

    /// The progress of an upload, for a sender that wants to resume. Ends the sender's own broken connection.
    pub async fn resume(&self, scope: &Scope, id: UploadId) -> IntakeResult<UploadProgress> {
        self.upload(scope, id).await?;
        self.senders.end_silent(id).await;
        self.progress(scope, id).await
    }

    /// The progress of an upload. A complete upload that did not become a session yet, because of an interruption,
    /// becomes one.
    async fn progress(&self, scope: &Scope, id: UploadId) -> IntakeResult<UploadProgress> {
        let upload = self.upload(scope, id).await?;
        let (received, expires_at_ms) = (upload.received, upload.expires_at_ms);
        let finished = if received == upload.length { Some(self.finish(scope, &upload).await?) } else { None };
        Ok(UploadProgress { received, expires_at_ms, finished })
    }

    /// Deletes an upload at the sender's request. A piece that is just arriving fails.
    pub async fn terminate(&self, scope: &Scope, id: UploadId) -> IntakeResult<()> {
        self.store.uploads().delete(scope, id).await?;
        Ok(self.vault.delete_upload(id).await?)
    }

    async fn finish(&self, scope: &Scope, upload: &UploadRecord) -> IntakeResult<FinishedUpload> {
        let finished = finish(&self.store, &self.vault, scope, upload).await?;
        if finished.is_new {
            self.announce_session(&self.store.sessions().get(scope, finished.session).await?);
        }
        Ok(finished)
    }

    /// Receives a piece under the upload's lock.
    async fn receive<B>(&self, scope: &Scope, id: UploadId, noted: u64, piece: Piece<B>) -> IntakeResult<()>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let file = self.vault.open_upload(id, noted).await;
        let file = file.map_err(|error| if is_gone(&error) { not_found() } else { error.into() })?;
        // Read again under the lock: the earlier read may be out of date.
        let upload = self.upload(scope, id).await?;
        if piece.offset != upload.received || upload.received != noted {
            return Err(IntakeError::Offset { received: upload.received });
        }
        let left = upload.length - upload.received;
        if piece.length.is_some_and(|length| length > left) {
            return Err(IntakeError::TooLong { most: left });
        }
        let (sending, sum) = (self.senders.register(id), piece.checksum.map(Checksum::begin));
        ArrivingPiece { intake: self, sending: &sending, id, file, noted, most: upload.length, sum }
            .receive(piece.bytes)
            .await
    }
}

/// True if the file disappeared between reading the row and locking: the upload was deleted or has just become a
/// session.
fn is_gone(error: &VaultError) -> bool {
    matches!(error, VaultError::NotFound)
}

fn not_found() -> IntakeError {
    IntakeError::Store(StoreError::NotFound { what: "upload" })
}

/// A piece that is arriving.
struct ArrivingPiece<'i> {
    intake: &'i Intake,
    sending: &'i SenderGuard,
    id: UploadId,
    file: UploadFile,
    /// Bytes that are durable according to the row.
    noted: u64,
    /// Length of the whole recording, bytes.
    most: u64,
    sum: Option<RunningSum>,
}

impl ArrivingPiece<'_> {
    async fn receive<B>(mut self, mut bytes: B) -> IntakeResult<()>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let received = self.write_all(&mut bytes).await;
        // Bytes with a checksum must not count before it has been verified: the next piece cuts them off.
        if let Some(sum) = self.sum.take() {
            received?;
            if !sum.matches() {
                return Err(IntakeError::ChecksumMismatch);
            }
            return self.sync_and_record().await;
        }
        self.sync_and_record().await?;
        received
    }

    /// Writes arriving bytes. Makes them durable from time to time, unless a checksum must be verified first.
    async fn write_all<B>(&mut self, bytes: &mut B) -> IntakeResult<()>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let ending = self.intake.shutdown.begun();
        tokio::pin!(ending);
        loop {
            let next = tokio::select! {
                next = bytes.next() => next,
                () = &mut ending => return Err(IntakeError::Ending),
                () = self.sending.resumed_elsewhere() => return Err(IntakeError::Resumed),
            };
            let Some(next) = next else { return Ok(()) };
            self.sending.record_bytes();
            self.write_chunk(next.map_err(IntakeError::ConnectionLost)?).await?;
        }
    }

    async fn write_chunk(&mut self, bytes: Bytes) -> IntakeResult<()> {
        if self.file.appended() + bytes.len() as u64 > self.most {
            return Err(IntakeError::TooLong { most: self.most });
        }
        if let Some(sum) = &mut self.sum {
            sum.update(&bytes);
        }
        self.note_first_byte().await?;
        self.file.append(&bytes).await?;
        if self.sum.is_none() && self.file.appended() - self.noted >= CHECKPOINT {
            self.sync_and_record().await?;
        }
        Ok(())
    }

    /// Notes that the first byte of an upload has arrived: it no longer expires as an empty one, however long it takes
    /// until its bytes are durable.
    async fn note_first_byte(&mut self) -> IntakeResult<()> {
        if self.noted == 0 && self.file.appended() == 0 {
            self.intake.store.uploads().advance(self.id, 0, self.intake.expires_at_ms()).await?;
        }
        Ok(())
    }

    /// Makes the written bytes durable and records them: file first, row second.
    async fn sync_and_record(&mut self) -> IntakeResult<()> {
        let received = self.file.sync().await?;
        if received > self.noted {
            self.intake.store.uploads().advance(self.id, received, self.intake.expires_at_ms()).await?;
            self.noted = received;
        }
        Ok(())
    }
}
