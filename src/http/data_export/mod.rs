//! Everything that is stored about a person, or about the whole centre, as a ZIP file. It is written while it is sent, so
//! that an export of any size needs the memory of one session.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | the routes |
//! | `person.rs` | the files of one person |
//! | `centre.rs` | the files of the centre |
//! | `archive.rs` | the ZIP file that is sent while it is written |

mod archive;
mod centre;
mod person;

use std::sync::Arc;

use axum::body::Body;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use tokio::runtime::Handle;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use utoipa::IntoParams;

use self::archive::{Archive, ExportFailure};
use super::auth::signed_in::{Administrator, Member};
use super::error::{HandlerResult, Refusal};
use super::file::disposition;
use super::read::{Params, PathKey};
use super::state::App;
use crate::domain::scope::Scope;
use crate::store::TraineeRecord;
use crate::time::Day;

/// Exports at a time. Each reads all that belongs to a person or to the centre from the disk.
pub const MAX_EXPORTS: usize = 2;
/// Pieces of an export that may wait for the client; each has at most 64 KiB.
const MAX_WAITING_PIECES: usize = 8;

/// Selects what an export contains.
#[derive(Clone, Copy, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ExportQuery {
    /// `true`: with the videos, as they were sent. They make the file large.
    #[serde(default)]
    videos: bool,
}

/// What is written into an export.
struct ExportJob {
    app: App,
    /// The caller's scope.
    scope: Scope,
    with_videos: bool,
    /// The runtime that runs the store's functions, which are awaited on the export's thread.
    runtime: Handle,
}

/// Export everything that is stored about a trainee
///
/// A ZIP file with the profile, the account, the sessions with features, ratings, comments and edits as JSON, the paths as
/// CSV, the previews, and the entries of the audit trail about the trainee. It is sent while it is written: a connection
/// that closes before the end leaves an incomplete file. A trainee exports the own data; staff export those of trainees in
/// their scope. Instructors get ratings and comments of others only where they may read them.
#[utoipa::path(get, path = "/trainees/{id}/data.zip", tag = "trainees",
    params(("id" = String, Path, description = "id or code"), ExportQuery),
    responses((status = OK, description = "The ZIP file", content_type = "application/zip")))]
pub async fn trainee(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
    Params(wanted): Params<ExportQuery>,
) -> HandlerResult<Response> {
    let trainee = app.store.trainees().get(&by.scope, &key).await?;
    let name = format!("{}-{}.zip", trainee.code, Day::of(app.clock.now_ms()));
    app.store.audit().record_export(&by.scope, "trainee", trainee.id).await?;
    let write = move |job: &ExportJob, archive: &mut Archive| {
        archive.add_text("README.txt", person::README)?;
        person::add(job, &trainee, "", archive)
    };
    export(&app, by.scope, wanted, &name, write)
}

/// Export everything that is stored in the centre
///
/// A ZIP file with groups, tasks and standards, boxes, cohorts, courses, accounts without their passwords and the audit
/// trail, and with a folder for each trainee, as in the export of a trainee. It does not replace a backup: it cannot be
/// restored.
#[utoipa::path(get, path = "/data.zip", tag = "operation", params(ExportQuery),
    responses((status = OK, description = "The ZIP file", content_type = "application/zip")))]
pub async fn centre(
    State(app): State<App>,
    by: Administrator,
    Params(wanted): Params<ExportQuery>,
) -> HandlerResult<Response> {
    let name = format!("centre-{}.zip", Day::of(app.clock.now_ms()));
    app.store.audit().record_export(&by.scope, "centre", "all").await?;
    export(&app, by.scope, wanted, &name, centre::add)
}

/// Answers with the archive that `write` fills on a thread of its own.
fn export(
    app: &App,
    scope: Scope,
    ExportQuery { videos }: ExportQuery,
    name: &str,
    write: impl FnOnce(&ExportJob, &mut Archive) -> Result<(), ExportFailure> + Send + 'static,
) -> HandlerResult<Response> {
    let Ok(permit) = Arc::clone(&app.exports).try_acquire_owned() else {
        let detail = format!("{MAX_EXPORTS} exports are being sent at the moment. Try again when one has ended.");
        return Err(Refusal::Busy.with(detail).header(header::RETRY_AFTER, 60));
    };
    let (pieces, sent) = mpsc::channel(MAX_WAITING_PIECES);
    let job = ExportJob { app: app.clone(), scope, with_videos: videos, runtime: Handle::current() };
    tokio::task::spawn_blocking(move || {
        let _permit = permit;
        let mut archive = Archive::new(pieces.clone());
        let written = write(&job, &mut archive).and_then(|()| archive.finish());
        match written {
            Ok(()) | Err(ExportFailure::Disconnected) => {}
            Err(error) => {
                tracing::error!(%error, "data export failed; connection closed before the file's end");
                let _ = pieces.blocking_send(Err(std::io::Error::other(error))); // the client may be gone
            }
        }
    });
    let headers = [
        (header::CONTENT_TYPE, "application/zip".to_owned()),
        (header::CONTENT_DISPOSITION, disposition("attachment", name)),
    ];
    Ok((headers, Body::from_stream(ReceiverStream::new(sent))).into_response())
}

impl ExportJob {
    /// The scope that reads a trainee's ratings and comments: an administrator exports all of them for the trainee.
    fn scope_for(&self, trainee: &TraineeRecord) -> Scope {
        if self.scope.is_administrator() { self.scope.on_behalf_of(trainee.id) } else { self.scope.clone() }
    }

    /// Waits for a function of the store on this thread.
    fn wait<T>(&self, future: impl Future<Output = T>) -> T {
        self.runtime.block_on(future)
    }
}
