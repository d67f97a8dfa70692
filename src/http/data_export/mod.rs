//! What is stored about a person, or about the whole centre, as a ZIP file. It is written while it is sent, so
//! that recordings, paths and the centre's audit trail are never in memory as a whole.
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
use super::connection_slots::ConnectionSlot;
use super::error::{HandlerResult, Refusal};
use super::file::disposition;
use super::read::{Params, PathKey};
use super::state::App;
use crate::domain::scope::Scope;
use crate::store::TraineeRecord;
use crate::time::Day;

/// Exports at a time, one of each account. Each reads all that belongs to a person or to the centre from the disk, and a
/// slow client takes long.
pub const MAX_EXPORTS: usize = 4;
/// Seconds after which a refused client should try again.
const RETRY_AFTER_S: u32 = 60;
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

/// Export what is stored about a trainee
///
/// A ZIP file with the profile, the sessions with features, ratings, comments and edits as JSON, the paths as CSV and the
/// previews. Trainees and administrators also get the account, its sign-ins and the entries of the audit trail about the
/// trainee; instructors get the names of their own groups only. Staff get ratings and comments of others only where they
/// may read them, the trainee gets all. A path, preview, table or video that cannot be read is replaced by a text, such
/// as `path.error.txt`. The file is sent while it is written: a connection that closes before the end leaves an
/// incomplete file. Each account has one export at a time (503 otherwise).
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
    let slot = take_slot(&app, &by.scope)?;
    app.store.audit().record_export(&by.scope, "trainee", trainee.id).await?;
    let write = move |job: &ExportJob, archive: &mut Archive| {
        archive.add_text("README.txt", &format!("{}{}", person::README, person::FILES))?;
        person::add(job, &trainee, "", archive)?;
        person::add_audit(job, &trainee, archive)
    };
    Ok(export(&app, (by.scope, slot), wanted, &name, write))
}

/// Export what is stored in the centre
///
/// A ZIP file with the accounts without their passwords, groups, tasks with their standards, course plans, cohorts with
/// their members, boxes with their latest camera and colours, and the audit trail as JSON, and with a folder for each
/// trainee, as in the export of a trainee. It does not replace a backup: it cannot be restored. Each account has one export
/// at a time (503 otherwise).
#[utoipa::path(get, path = "/data.zip", tag = "operation", params(ExportQuery),
    responses((status = OK, description = "The ZIP file", content_type = "application/zip")))]
pub async fn centre(
    State(app): State<App>,
    by: Administrator,
    Params(wanted): Params<ExportQuery>,
) -> HandlerResult<Response> {
    let name = format!("centre-{}.zip", Day::of(app.clock.now_ms()));
    let slot = take_slot(&app, &by.scope)?;
    app.store.audit().record_export(&by.scope, "centre", "all").await?;
    Ok(export(&app, (by.scope, slot), wanted, &name, centre::add))
}

/// Takes a slot for an export: one of each account, so that a client that reads slowly cannot keep all others waiting.
fn take_slot(app: &App, scope: &Scope) -> HandlerResult<ConnectionSlot> {
    app.exports.take(scope).ok_or_else(|| {
        let refusal = if app.exports.is_full_for(scope) {
            Refusal::TooMany.with("Each account has one export at a time. Wait until yours has ended, or cancel it.")
        } else {
            Refusal::Busy.with(format!(
                "All {MAX_EXPORTS} exports that may run at a time are running. Try again when one has ended."
            ))
        };
        refusal.header(header::RETRY_AFTER, RETRY_AFTER_S)
    })
}

/// Answers with the archive that `write` fills on a thread of its own.
fn export(
    app: &App,
    (scope, slot): (Scope, ConnectionSlot),
    ExportQuery { videos }: ExportQuery,
    name: &str,
    write: impl FnOnce(&ExportJob, &mut Archive) -> Result<(), ExportFailure> + Send + 'static,
) -> Response {
    let (pieces, sent) = mpsc::channel(MAX_WAITING_PIECES);
    let job = ExportJob { app: app.clone(), scope, with_videos: videos, runtime: Handle::current() };
    tokio::task::spawn_blocking(move || {
        let mut archive = Archive::new(pieces.clone());
        let written = write(&job, &mut archive).and_then(|()| archive.finish());
        match written {
            Ok(()) | Err(ExportFailure::Disconnected) => {}
            Err(error) if error.is_gone() => {
                tracing::warn!(%error, "the exported trainee was erased; connection closed before the file's end");
                let _ = pieces.blocking_send(Err(std::io::Error::other(error))); // the client may be gone
            }
            Err(error) => {
                tracing::error!(%error, "data export failed; connection closed before the file's end");
                let _ = pieces.blocking_send(Err(std::io::Error::other(error))); // the client may be gone
            }
        }
        drop((slot, pieces)); // in this order: a client that has read the end can export again
    });
    let headers = [
        (header::CONTENT_TYPE, "application/zip".to_owned()),
        (header::CONTENT_DISPOSITION, disposition("attachment", name)),
    ];
    (headers, Body::from_stream(ReceiverStream::new(sent))).into_response()
}

impl ExportJob {
    /// True if the export has this trainee's account and audit trail: they name staff of other groups, too.
    fn has_account(&self, trainee: &TraineeRecord) -> bool {
        self.scope.is_administrator() || self.scope.own_trainee() == Some(trainee.id)
    }

    /// Waits for a function of the store on this thread.
    fn wait<T>(&self, future: impl Future<Output = T>) -> T {
        self.runtime.block_on(future)
    }
}
