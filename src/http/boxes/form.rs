//! Reads multipart forms with pictures, part by part: text into memory, files into the vault, both within limits.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::task::{Context, Poll};

use axum::BoxError;
use axum::body::{Body, Bytes, HttpBody};
use axum::extract::multipart::{Field, Multipart, MultipartError};
use axum::extract::{FromRequest, Request};
use http_body_util::Limited;
use hyper::body::Frame;

use crate::domain::job::NamedBlob;
use crate::domain::text::FileName;
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::read::{find_cause, unreadable_body};
use crate::http::state::App;
use crate::vault::PinnedBlob;

/// Most parts of a form.
const MAX_PARTS: usize = 200;
/// Longest text part, bytes; enough for the annotations of a long clip.
const MAX_TEXT_BYTES: usize = 4 * 1024 * 1024;
/// Longest head of a part, bytes; one more packet may be read.
const MAX_HEAD_BYTES: i64 = 64 * 1024;

/// A multipart form that is being received.
pub struct MultipartForm {
    parts: Multipart,
    head: HeadCounter,
    app: App,
    parts_read: usize,
}

impl FromRequest<App> for MultipartForm {
    type Rejection = ProblemResponse;

    async fn from_request(request: Request, app: &App) -> Result<Self, ProblemResponse> {
        let limit = usize::try_from(app.settings.max_form_bytes).unwrap_or(usize::MAX);
        let head = HeadCounter::default();
        let of_form =
            |body| FormBody { body: Box::pin(Limited::new(body, limit)), head: head.clone(), is_resting: false };
        let request = request.map(|body| Body::new(of_form(body)));
        let no_form =
            |_| Refusal::UnsupportedMediaType.with("Send a form with `Content-Type: multipart/form-data; boundary=…`.");
        let parts = Multipart::from_request(request, app).await.map_err(no_form)?;
        Ok(Self { parts, head, app: app.clone(), parts_read: 0 })
    }
}

impl MultipartForm {
    /// The next part, in the order of the request.
    pub async fn next(&mut self) -> HandlerResult<Option<FormPart<'_>>> {
        let limit = self.app.settings.max_form_bytes;
        self.head.begin();
        let field = self.parts.next_field().await;
        self.head.end();
        let Some(field) = field.map_err(|error| form_problem(&error, limit))? else { return Ok(None) };
        self.parts_read += 1;
        if self.parts_read > MAX_PARTS {
            return Err(ProblemResponse::invalid(
                "form",
                format!("has more than {MAX_PARTS} parts; send fewer pictures"),
            ));
        }
        let name = field.name().unwrap_or_default().to_owned();
        Ok(Some(FormPart { name, field, app: &self.app }))
    }
}

/// One part of a form.
pub struct FormPart<'f> {
    /// Its name.
    pub name: String,
    field: Field<'f>,
    app: &'f App,
}

impl FormPart<'_> {
    /// Its content as text.
    pub async fn text(mut self) -> HandlerResult<String> {
        let mut text = Vec::new();
        while let Some(bytes) = self.chunk().await? {
            text.extend_from_slice(&bytes);
            if text.len() > MAX_TEXT_BYTES {
                return Err(ProblemResponse::invalid(&self.name, format!("is longer than {MAX_TEXT_BYTES} bytes")));
            }
        }
        String::from_utf8(text).map_err(|_| ProblemResponse::invalid(&self.name, "is not UTF-8 text"))
    }

    /// The problem for a part that the form does not have.
    pub fn unexpected(&self, expected: &str) -> ProblemResponse {
        let shown: String = self.name.chars().take(40).collect();
        ProblemResponse::invalid("form", format!("has an unknown part `{shown}`; expected {expected}"))
    }

    /// Stores its content as a file.
    async fn store(mut self) -> HandlerResult<(PinnedBlob, NamedBlob)> {
        let given = self.field.file_name().and_then(|name| name.parse::<FileName>().ok());
        let name = given.map_or_else(|| self.name.clone(), String::from);
        let mut incoming = self.app.vault.incoming(self.app.settings.max_form_bytes).await?;
        let mut is_empty = true;
        while let Some(bytes) = self.chunk().await? {
            is_empty &= bytes.is_empty();
            incoming.write(&bytes).await?;
        }
        if is_empty {
            return Err(ProblemResponse::invalid(&self.name, "is an empty file"));
        }
        let kept = incoming.finish().await?;
        // The row has no references yet: if no job refers to the file, it is deleted after `kept` is dropped.
        self.app.store.blobs().note(kept.blob()).await?;
        let named = NamedBlob { name, blob: kept.blob() };
        Ok((kept, named))
    }

    async fn chunk(&mut self) -> HandlerResult<Option<Bytes>> {
        let limit = self.app.settings.max_form_bytes;
        self.field.chunk().await.map_err(|error| form_problem(&error, limit))
    }
}

/// Counts the bytes read for the head of a part. The parser keeps a head until its end, however long it is, and searches
/// it again with each packet.
#[derive(Clone, Default)]
struct HeadCounter(Arc<AtomicI64>);

/// While the content of a part is read, which has limits of its own.
const NO_HEAD: i64 = -1;

impl HeadCounter {
    fn begin(&self) {
        self.0.store(0, Ordering::Relaxed);
    }

    fn end(&self) {
        self.0.store(NO_HEAD, Ordering::Relaxed);
    }

    fn add(&self, bytes: usize) {
        if self.0.load(Ordering::Relaxed) != NO_HEAD {
            self.0.fetch_add(bytes as i64, Ordering::Relaxed);
        }
    }

    fn is_too_long(&self) -> bool {
        self.0.load(Ordering::Relaxed) > MAX_HEAD_BYTES
    }
}

/// The head of a part has no end within [`MAX_HEAD_BYTES`].
#[derive(Debug, thiserror::Error)]
#[error("the head of a part is longer than {MAX_HEAD_BYTES} bytes")]
struct HeadTooLong;

/// A body that gives one packet at a time. The parser reads on for as long as there is something to read, so a fast
/// sender would fill the memory.
struct FormBody {
    body: Pin<Box<Limited<Body>>>,
    head: HeadCounter,
    is_resting: bool,
}

impl HttpBody for FormBody {
    type Data = Bytes;
    type Error = BoxError;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, BoxError>>> {
        if std::mem::take(&mut self.is_resting) {
            cx.waker().wake_by_ref();
            return Poll::Pending;
        }
        if self.head.is_too_long() {
            return Poll::Ready(Some(Err(HeadTooLong.into())));
        }
        let polled = self.body.as_mut().poll_frame(cx);
        if let Poll::Ready(Some(Ok(frame))) = &polled {
            self.head.add(frame.data_ref().map_or(0, Bytes::len));
            self.is_resting = true;
        }
        polled
    }
}

/// The problem for a form that could not be read to its end.
fn form_problem(error: &MultipartError, limit: u64) -> ProblemResponse {
    if let Some(too_long) = find_cause::<HeadTooLong>(error) {
        return Refusal::BadRequest.with(format!("The form cannot be read: {too_long}.")).of_field("form");
    }
    match error.status().is_client_error() && error.status() != axum::http::StatusCode::PAYLOAD_TOO_LARGE {
        true => {
            let detail = format!("The form cannot be read: {}. Send it again.", error.body_text());
            Refusal::BadRequest.with(detail).of_field("form")
        }
        false => unreadable_body(error, limit),
    }
}

/// The pictures, or the one video, of a form. Their files stay in the vault at least as long as this value exists.
#[derive(Default)]
pub struct FormPictures {
    /// The files in the order of the form.
    pub files: Vec<NamedBlob>,
    /// The frame that each picture shows; empty if the form does not name frames.
    pub frames: Vec<u64>,
    /// Whether the only file is a video.
    pub is_video: bool,
    kept: Vec<PinnedBlob>,
}

impl FormPictures {
    /// Adds a picture.
    pub async fn add_picture(&mut self, part: FormPart<'_>, frame: Option<u64>) -> HandlerResult<()> {
        if self.is_video {
            return Err(ProblemResponse::invalid(
                &part.name,
                "was sent together with a video; send pictures or a video, not both",
            ));
        }
        self.frames.extend(frame);
        self.add(part).await
    }

    /// Adds the video.
    pub async fn add_video(&mut self, part: FormPart<'_>) -> HandlerResult<()> {
        if !self.files.is_empty() {
            return Err(ProblemResponse::invalid(
                "video",
                "was sent together with other files; send one video, or pictures",
            ));
        }
        self.is_video = true;
        self.add(part).await
    }

    async fn add(&mut self, part: FormPart<'_>) -> HandlerResult<()> {
        let (kept, file) = part.store().await?;
        self.kept.push(kept);
        self.files.push(file);
        Ok(())
    }
}
