//! Reads multipart forms with pictures, part by part: text into memory, files into the vault, both within limits.

use axum::extract::multipart::{Field, Multipart, MultipartError};
use axum::extract::{FromRequest, Request};
use http_body_util::Limited;

use crate::domain::job::NamedBlob;
use crate::domain::text::FileName;
use crate::http::error::{Answer, Problem, Refusal};
use crate::http::read::unreadable;
use crate::http::state::App;
use crate::vault::Kept;

/// Most parts of a form.
const MOST_PARTS: usize = 200;
/// Longest text part, bytes; enough for the annotations of a long clip.
const MOST_TEXT: usize = 4 * 1024 * 1024;

/// A multipart form that is being received.
pub struct Form {
    parts: Multipart,
    app: App,
    seen: usize,
}

impl FromRequest<App> for Form {
    type Rejection = Problem;

    async fn from_request(request: Request, app: &App) -> Result<Self, Problem> {
        let limit = usize::try_from(app.settings.max_form_bytes).unwrap_or(usize::MAX);
        let request = request.map(|body| axum::body::Body::new(Limited::new(body, limit)));
        let no_form =
            |_| Refusal::UnsupportedMediaType.with("Send a form with `Content-Type: multipart/form-data; boundary=…`.");
        let parts = Multipart::from_request(request, app).await.map_err(no_form)?;
        Ok(Self { parts, app: app.clone(), seen: 0 })
    }
}

impl Form {
    /// The next part, in the order of the request.
    pub async fn next(&mut self) -> Answer<Option<Part<'_>>> {
        let limit = self.app.settings.max_form_bytes;
        let Some(field) = self.parts.next_field().await.map_err(|error| broken(&error, limit))? else {
            return Ok(None);
        };
        self.seen += 1;
        if self.seen > MOST_PARTS {
            return Err(Problem::invalid("form", format!("has more than {MOST_PARTS} parts; send fewer pictures")));
        }
        let name = field.name().unwrap_or_default().to_owned();
        Ok(Some(Part { name, field, app: &self.app }))
    }
}

/// One part of a form.
pub struct Part<'f> {
    /// Its name.
    pub name: String,
    field: Field<'f>,
    app: &'f App,
}

impl Part<'_> {
    /// Its content as text.
    pub async fn text(mut self) -> Answer<String> {
        let mut text = Vec::new();
        while let Some(bytes) = self.chunk().await? {
            text.extend_from_slice(&bytes);
            if text.len() > MOST_TEXT {
                return Err(Problem::invalid(&self.name, format!("is longer than {MOST_TEXT} bytes")));
            }
        }
        String::from_utf8(text).map_err(|_| Problem::invalid(&self.name, "is not UTF-8 text"))
    }

    /// The problem for a part that the form does not have.
    pub fn unexpected(&self, expected: &str) -> Problem {
        let shown: String = self.name.chars().take(40).collect();
        Problem::invalid("form", format!("has an unknown part `{shown}`; expected {expected}"))
    }

    /// Stores its content as a file.
    async fn store(mut self) -> Answer<(Kept, NamedBlob)> {
        let given = self.field.file_name().and_then(|name| name.parse::<FileName>().ok());
        let name = given.map_or_else(|| self.name.clone(), String::from);
        let mut incoming = self.app.vault.incoming(self.app.settings.max_form_bytes).await?;
        let mut is_empty = true;
        while let Some(bytes) = self.chunk().await? {
            is_empty &= bytes.is_empty();
            incoming.write(&bytes).await?;
        }
        if is_empty {
            return Err(Problem::invalid(&self.name, "is an empty file"));
        }
        let kept = incoming.finish().await?;
        // The row has no references yet: if no job refers to the file, it is deleted after `kept` is dropped.
        self.app.store.blobs().note(kept.blob()).await?;
        let named = NamedBlob { name, blob: kept.blob() };
        Ok((kept, named))
    }

    async fn chunk(&mut self) -> Answer<Option<axum::body::Bytes>> {
        let limit = self.app.settings.max_form_bytes;
        self.field.chunk().await.map_err(|error| broken(&error, limit))
    }
}

/// The problem for a form that could not be read to its end.
fn broken(error: &MultipartError, limit: u64) -> Problem {
    match error.status().is_client_error() && error.status() != axum::http::StatusCode::PAYLOAD_TOO_LARGE {
        true => Refusal::BadRequest.with(format!("The form cannot be read: {}. Send it again.", error.body_text())),
        false => unreadable(error, limit),
    }
}

/// The pictures, or the one video, of a form. Their files stay in the vault at least as long as this value exists.
#[derive(Default)]
pub struct Pictures {
    /// The files in the order of the form.
    pub files: Vec<NamedBlob>,
    /// The frame that each picture shows; empty if the form does not name frames.
    pub frames: Vec<u64>,
    /// Whether the only file is a video.
    pub is_video: bool,
    kept: Vec<Kept>,
}

impl Pictures {
    /// Adds a picture.
    pub async fn add_picture(&mut self, part: Part<'_>, frame: Option<u64>) -> Answer<()> {
        if self.is_video {
            return Err(Problem::invalid(
                &part.name,
                "was sent together with a video; send pictures or a video, not both",
            ));
        }
        self.frames.extend(frame);
        self.add(part).await
    }

    /// Adds the video.
    pub async fn add_video(&mut self, part: Part<'_>) -> Answer<()> {
        if !self.files.is_empty() {
            return Err(Problem::invalid("video", "was sent together with other files; send one video, or pictures"));
        }
        self.is_video = true;
        self.add(part).await
    }

    async fn add(&mut self, part: Part<'_>) -> Answer<()> {
        let (kept, file) = part.store().await?;
        self.kept.push(kept);
        self.files.push(file);
        Ok(())
    }
}
