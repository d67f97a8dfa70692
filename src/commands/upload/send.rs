//! Sends one recording by tus: continues an upload that an earlier run began, or begins one.

use std::io::SeekFrom;
use std::time::Duration;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use hyper::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use tokio::fs::File;
use tokio::io::AsyncSeekExt;
use tokio::time::sleep;

use super::client::{Answer, RequestError, ServiceClient};
use super::journal::{BegunUpload, Journal};
use super::plan::PlannedRecording;
use crate::time::to_rfc3339;

const TUS_RESUMABLE: HeaderName = HeaderName::from_static("tus-resumable");
const UPLOAD_LENGTH: HeaderName = HeaderName::from_static("upload-length");
const UPLOAD_OFFSET: HeaderName = HeaderName::from_static("upload-offset");
const UPLOAD_METADATA: HeaderName = HeaderName::from_static("upload-metadata");
const TROCAR_SESSION: HeaderName = HeaderName::from_static("trocar-session");
const TROCAR_DUPLICATE: HeaderName = HeaderName::from_static("trocar-duplicate");

/// Attempts in a row without a byte more on the service: with the pauses, about four minutes.
const MAX_ATTEMPTS: u32 = 12;
/// Pause after the first failed attempt; each further one takes twice as long.
const FIRST_PAUSE: Duration = Duration::from_secs(1);
const MAX_PAUSE: Duration = Duration::from_secs(30);

/// A recording that has arrived.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Arrived {
    /// Its session.
    pub session: String,
    /// True if the service had it before.
    pub is_duplicate: bool,
}

/// Why a recording was not sent.
#[derive(Debug, thiserror::Error)]
pub enum SendError {
    /// The service was not reached, or refuses this recording.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// The file cannot be read, or the journal cannot be written.
    #[error("{doing}: {source}")]
    File {
        /// What was being done.
        doing: &'static str,
        source: std::io::Error,
    },
    /// The service's answer is none of tus.
    #[error("the service's answer has no `{0}`: is a proxy between that changes the headers?")]
    Header(&'static str),
    /// The file has another length than before.
    #[error("the file has changed since it was read: run the command again")]
    Changed,
}

impl SendError {
    fn is_passing(&self) -> bool {
        matches!(self, Self::Request(error) if error.is_passing())
    }

    /// True if no further recording can be sent either.
    pub fn ends_all(&self) -> bool {
        match self {
            Self::Request(RequestError::Refused { status, .. }) => {
                matches!(*status, StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN) || self.is_passing()
            }
            Self::Request(RequestError::Connection(_)) => true,
            Self::File { doing, .. } => *doing == WRITING_JOURNAL,
            _ => false,
        }
    }
}

const WRITING_JOURNAL: &str = "writing the journal";

/// Sends a recording, as often as it takes.
pub async fn send(
    service: &ServiceClient,
    recording: &PlannedRecording,
    journal: &mut Journal,
) -> Result<Arrived, SendError> {
    let (mut failed, mut reached) = (0, 0);
    loop {
        let error = match attempt(service, recording, journal, &mut reached).await {
            Ok(Some(arrived)) => return Ok(arrived),
            Ok(None) => {
                failed = 0; // it has moved on
                continue;
            }
            Err(error) => error,
        };
        failed += 1;
        if !error.is_passing() || failed >= MAX_ATTEMPTS {
            return Err(error);
        }
        let stated = match &error {
            SendError::Request(RequestError::Refused { wait, .. }) => *wait,
            _ => None,
        };
        let pause = stated.unwrap_or(FIRST_PAUSE * 2_u32.saturating_pow(failed - 1)).min(MAX_PAUSE);
        tracing::debug!(%error, ?pause, "sending failed; trying again");
        sleep(pause).await;
    }
}

/// One attempt, from what the service has. `Ok(None)`: more bytes arrived, but not all.
async fn attempt(
    service: &ServiceClient,
    recording: &PlannedRecording,
    journal: &mut Journal,
    reached: &mut u64,
) -> Result<Option<Arrived>, SendError> {
    let metadata = metadata(recording);
    let begun = journal.upload_of(&recording.file).cloned().filter(|upload| upload.service == service.address());
    let state = match begun {
        Some(upload) if upload.metadata == metadata => {
            find(service, &upload.address).await?.map(|at| (upload.address, at))
        }
        Some(upload) => {
            // The map was changed since: the upload would become a session of another trainee, task, box or time.
            let _ = service.request(Method::DELETE, &upload.address, tus()).await;
            None
        }
        None => None,
    };
    let (address, answer) = match state {
        Some(found) => found,
        None => {
            let (address, answer) = begin(service, recording, &metadata).await?;
            let upload = BegunUpload { address: address.clone(), metadata, service: service.address() };
            let noted = journal.note(&recording.file, recording.hash, Some(upload));
            noted.map_err(|source| SendError::File { doing: WRITING_JOURNAL, source })?;
            (address, answer)
        }
    };
    if let Some(arrived) = arrived(&answer) {
        return Ok(Some(arrived));
    }
    let offset = number(&answer, &UPLOAD_OFFSET).ok_or(SendError::Header("Upload-Offset"))?;
    let is_further = offset > *reached;
    *reached = offset.max(*reached);
    match send_rest(service, recording, &address, offset).await {
        Ok(answer) => arrived(&answer).map(Some).ok_or(SendError::Header("Trocar-Session")),
        Err(error) if error.is_passing() && is_further => Ok(None),
        Err(error) => Err(error),
    }
}

/// The state of an upload; `None` if the service does not know it any more.
async fn find(service: &ServiceClient, address: &str) -> Result<Option<Answer>, RequestError> {
    match service.request(Method::HEAD, address, tus()).await {
        Ok(answer) => Ok(Some(answer)),
        Err(RequestError::Refused { status: StatusCode::NOT_FOUND | StatusCode::GONE, .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

async fn begin(
    service: &ServiceClient,
    recording: &PlannedRecording,
    metadata: &str,
) -> Result<(String, Answer), SendError> {
    let mut headers = tus();
    headers.insert(UPLOAD_LENGTH, HeaderValue::from(recording.file.bytes));
    headers.insert(UPLOAD_METADATA, HeaderValue::try_from(metadata).map_err(|_| SendError::Header("Upload-Metadata"))?);
    let answer = service.request(Method::POST, "/uploads", headers).await?;
    let address = answer.headers.get(header::LOCATION).and_then(|value| value.to_str().ok());
    let address = address.ok_or(SendError::Header("Location"))?.to_owned();
    Ok((address, answer))
}

async fn send_rest(
    service: &ServiceClient,
    recording: &PlannedRecording,
    address: &str,
    offset: u64,
) -> Result<Answer, SendError> {
    let reading = |source| SendError::File { doing: "reading the recording", source };
    let mut file = File::open(&recording.file.place).await.map_err(reading)?;
    if file.metadata().await.map_err(reading)?.len() != recording.file.bytes || offset > recording.file.bytes {
        return Err(SendError::Changed);
    }
    file.seek(SeekFrom::Start(offset)).await.map_err(reading)?;
    let rest = recording.file.bytes - offset;
    let mut headers = tus();
    headers.insert(UPLOAD_OFFSET, HeaderValue::from(offset));
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/offset+octet-stream"));
    headers.insert(header::CONTENT_LENGTH, HeaderValue::from(rest));
    Ok(service.send_file(address, headers, file, rest).await?)
}

/// What the service is sent about a recording.
fn metadata(recording: &PlannedRecording) -> String {
    let name = recording.file.path.rsplit('/').next().unwrap_or_default();
    let target = &recording.target;
    let mut pairs = vec![
        ("filename", name.to_owned()),
        ("trainee", target.trainee.id.clone()),
        ("task", target.task.id.clone()),
        ("box", target.in_box.id.clone()),
    ];
    pairs.extend(recording.recorded_at.map(|recorded| ("recorded_at", to_rfc3339(recorded.at_ms))));
    let pairs: Vec<String> = pairs.iter().map(|(key, value)| format!("{key} {}", STANDARD.encode(value))).collect();
    pairs.join(",")
}

fn tus() -> HeaderMap {
    HeaderMap::from_iter([(TUS_RESUMABLE, HeaderValue::from_static("1.0.0"))])
}

fn arrived(answer: &Answer) -> Option<Arrived> {
    let session = answer.headers.get(TROCAR_SESSION)?.to_str().ok()?.to_owned();
    Some(Arrived { session, is_duplicate: answer.headers.get(TROCAR_DUPLICATE).is_some_and(|value| value == "true") })
}

fn number(answer: &Answer, name: &HeaderName) -> Option<u64> {
    answer.headers.get(name)?.to_str().ok()?.parse().ok()
}
