//! A ZIP file that is sent while it is written: its writer blocks while the client is slow.

use std::io::{self, Read, Write};

use bytes::Bytes;
use serde::Serialize;
use tokio::sync::mpsc::Sender;
use zip::write::{SimpleFileOptions, StreamWriter};
use zip::{CompressionMethod, ZipWriter};

use crate::analysis::stored_rows::StoredRowsError;
use crate::http::error::{ProblemResponse, Refusal};
use crate::store::StoreError;
use crate::vault::VaultError;

/// Bytes sent at a time.
const PIECE_BYTES: usize = 64 * 1024;

/// Why an export ended early.
#[derive(Debug, thiserror::Error)]
pub(super) enum ExportFailure {
    /// The client closed the connection.
    #[error("the client closed the connection")]
    Disconnected,
    /// An error of the store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// An error of the vault.
    #[error(transparent)]
    Vault(#[from] VaultError),
    /// An answer of the API, which an export repeats, could not be made.
    #[error("{0:?}")]
    Answer(ProblemResponse),
    /// A file could not be read, or not be written as a table or as JSON.
    #[error("{0}")]
    File(String),
}

impl ExportFailure {
    /// True if what was to be added no longer exists.
    pub(super) fn is_gone(&self) -> bool {
        match self {
            Self::Store(StoreError::NotFound { .. }) | Self::Vault(VaultError::NotFound) => true,
            Self::Answer(problem) => problem.refusal == Refusal::NotFound,
            _ => false,
        }
    }
}

/// `None` if what was to be added no longer exists: people and sessions are erased while an export is written.
pub(super) fn unless_gone<T>(added: Result<T, impl Into<ExportFailure>>) -> Result<Option<T>, ExportFailure> {
    match added.map_err(Into::into) {
        Err(failure) if failure.is_gone() => Ok(None),
        added => added.map(Some),
    }
}

impl From<StoredRowsError> for ExportFailure {
    fn from(error: StoredRowsError) -> Self {
        match error {
            StoredRowsError::Vault(error) => error.into(),
            other => Self::File(other.to_string()),
        }
    }
}

impl From<ProblemResponse> for ExportFailure {
    fn from(problem: ProblemResponse) -> Self {
        Self::Answer(problem)
    }
}

impl From<io::Error> for ExportFailure {
    fn from(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::BrokenPipe { Self::Disconnected } else { Self::File(error.to_string()) }
    }
}

impl From<zip::result::ZipError> for ExportFailure {
    fn from(error: zip::result::ZipError) -> Self {
        match error {
            zip::result::ZipError::Io(error) => error.into(),
            other => Self::File(other.to_string()),
        }
    }
}

/// The ZIP file of an export.
pub(super) struct Archive {
    zip: ZipWriter<StreamWriter<PieceSender>>,
}

impl Archive {
    /// A file whose pieces are sent to this channel.
    pub(super) fn new(pieces: Sender<io::Result<Bytes>>) -> Self {
        Self {
            zip: ZipWriter::new_stream(PieceSender {
                pieces,
                buffer: Vec::with_capacity(PIECE_BYTES),
                is_closed: false,
            }),
        }
    }

    /// Adds a text.
    pub(super) fn add_text(&mut self, name: &str, text: &str) -> Result<(), ExportFailure> {
        self.start(name, CompressionMethod::Deflated)?.write_all(text.as_bytes())?;
        Ok(())
    }

    /// Adds a value as JSON for people and programs.
    pub(super) fn add_json(&mut self, name: &str, value: &impl Serialize) -> Result<(), ExportFailure> {
        let text = serde_json::to_string_pretty(value).map_err(|error| ExportFailure::File(error.to_string()))?;
        self.add_text(name, &text)
    }

    /// Begins a file that is compressed, and returns its writer.
    pub(super) fn add_written(&mut self, name: &str) -> Result<&mut impl Write, ExportFailure> {
        self.start(name, CompressionMethod::Deflated)
    }

    /// Adds a file that is compressed already, such as a video.
    pub(super) fn add_file(&mut self, name: &str, mut file: impl Read) -> Result<(), ExportFailure> {
        io::copy(&mut file, self.start(name, CompressionMethod::Stored)?)?;
        Ok(())
    }

    /// Ends the file and sends the rest.
    pub(super) fn finish(self) -> Result<(), ExportFailure> {
        self.zip.finish()?.into_inner().flush()?;
        Ok(())
    }

    fn start(
        &mut self,
        name: &str,
        method: CompressionMethod,
    ) -> Result<&mut ZipWriter<StreamWriter<PieceSender>>, ExportFailure> {
        // The size of a file is not known before it is written, and a video may have more than 4 GiB.
        self.zip.start_file(name, SimpleFileOptions::default().compression_method(method).large_file(true))?;
        Ok(&mut self.zip)
    }
}

/// Sends what is written, in pieces; blocks while the client is slow. The first piece that the client does not take is an
/// error; what the ZIP writer adds after that, when it is dropped, is discarded.
struct PieceSender {
    pieces: Sender<io::Result<Bytes>>,
    buffer: Vec<u8>,
    is_closed: bool,
}

impl Write for PieceSender {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(PIECE_BYTES - self.buffer.len());
        self.buffer.extend_from_slice(&bytes[..taken]);
        if self.buffer.len() == PIECE_BYTES {
            self.flush()?;
        }
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        let piece = std::mem::replace(&mut self.buffer, Vec::with_capacity(PIECE_BYTES));
        if piece.is_empty() || self.is_closed {
            return Ok(());
        }
        self.is_closed = self.pieces.blocking_send(Ok(piece.into())).is_err();
        if self.is_closed { Err(io::ErrorKind::BrokenPipe.into()) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_no_longer_exists_is_left_out() {
        let gone: [ExportFailure; 3] = [
            StoreError::NotFound { what: "session" }.into(),
            StoredRowsError::Vault(VaultError::NotFound).into(),
            ProblemResponse::not_found().into(),
        ];
        for failure in gone {
            assert!(matches!(unless_gone::<()>(Err(failure)), Ok(None)));
        }
        for failure in [VaultError::Damaged.into(), ExportFailure::Disconnected] {
            assert!(unless_gone::<()>(Err::<(), ExportFailure>(failure)).is_err());
        }
    }
}
