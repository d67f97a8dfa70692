//! What those who run the centre look at: versions, storage, backup, settings, and who changed what.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::Administrator;
use super::error::Answer;
use super::read::{Json, Params};
use super::show::{Page, Paging, Time};
use super::state::App;
use crate::store::{AuditEntry, Backup, QueueCounts};

/// How the service stands.
#[derive(Debug, Serialize, ToSchema)]
pub struct ServiceState {
    /// Version of the program.
    version: &'static str,
    /// Version of what measures: results of different ones are not compared.
    pipeline: &'static str,
    /// Since when it runs.
    started_at: Time,
    storage: StorageState,
    queue: QueueState,
    /// The last backup that `trocar admin backup` made; `null`: none is known.
    last_backup: Option<LastBackup>,
    settings: SettingsInForce,
}

/// Room on the disk.
#[derive(Debug, Serialize, ToSchema)]
pub struct StorageState {
    /// Files of recordings and results.
    files: u64,
    /// Their bytes together.
    files_bytes: u64,
    /// Bytes of the database.
    database_bytes: u64,
    /// Bytes that the disk still has.
    free_bytes: u64,
}

/// Work that waits.
#[derive(Debug, Serialize, ToSchema)]
pub struct QueueState {
    queued: i64,
    running: i64,
    /// Set aside after crashing again and again.
    quarantined: i64,
}

/// A backup that was made.
#[derive(Debug, Serialize, ToSchema)]
pub struct LastBackup {
    at: Time,
    /// How many files it holds, all verified.
    files: u64,
}

/// Settings in force.
#[derive(Debug, Serialize, ToSchema)]
pub struct SettingsInForce {
    /// Recordings tracked at the same time.
    workers: usize,
    /// Largest recording, bytes.
    max_upload_bytes: u64,
    /// Hours after which an unfinished upload is forgotten.
    unfinished_upload_h: u64,
    /// Seconds within which what was erased has left the disk.
    erased_within_s: u64,
    /// Minutes without a request after which a sign-in ends.
    idle_min: u64,
    /// Hours after which it ends in any case.
    sign_in_h: u64,
    /// Attempts to sign in that a login has in a minute.
    attempts_per_min: u32,
}

/// One change.
#[derive(Debug, Serialize, ToSchema)]
pub struct AuditChange {
    /// Order of writing; larger is later.
    id: i64,
    at: Time,
    /// `person`, `agent` or `service`.
    by: String,
    /// What the person is called; `null` where it was none, or one who is here no more.
    who: Option<String>,
    /// `create`, `change`, `erase`, …
    action: String,
    /// What kind of thing was changed.
    noun: String,
    /// Its id. Names are not kept here: who is erased leaves none behind.
    subject: String,
    /// What it is called now, of a session: whose it is; `null` where it has no name, or is here no more.
    called: Option<String>,
}

/// Read how the service stands
#[utoipa::path(get, path = "/service", tag = "operation", responses((status = OK, body = ServiceState)))]
pub async fn service(State(app): State<App>, by: Administrator) -> Answer<Json<ServiceState>> {
    let (files, files_bytes) = app.store.blobs().total().await?;
    let QueueCounts { queued, running, quarantined } = app.store.jobs().counts().await?;
    let backup = app.store.audit().last_backup(&by.scope).await?;
    let (http, set) = (&app.settings, app.in_force);
    Ok(Json(ServiceState {
        version: env!("CARGO_PKG_VERSION"),
        pipeline: set.pipeline,
        started_at: Time(set.started_at_ms),
        storage: StorageState {
            files,
            files_bytes,
            database_bytes: app.store.bytes().await?,
            free_bytes: app.vault.free_bytes().await?,
        },
        queue: QueueState { queued, running, quarantined },
        last_backup: backup.map(|Backup { at_ms, files }| LastBackup { at: Time(at_ms), files }),
        settings: SettingsInForce {
            workers: set.workers,
            max_upload_bytes: set.max_upload_bytes,
            unfinished_upload_h: set.unfinished_upload_h,
            erased_within_s: set.erased_within_s,
            idle_min: http.idle_min,
            sign_in_h: http.sign_in_h,
            attempts_per_min: http.attempts_per_min,
        },
    }))
}

/// List who changed what of people's data, newest first
#[utoipa::path(get, path = "/audit", tag = "operation", params(Paging), responses((status = OK, body = Page<AuditChange>)))]
pub async fn audit(
    State(app): State<App>,
    by: Administrator,
    Params(paging): Params<Paging>,
) -> Answer<Json<Page<AuditChange>>> {
    let page = paging.request(app.settings.page_items)?;
    Ok(Json(Page::of(app.store.audit().list(&by.scope, &page).await?, AuditChange::from)))
}

impl From<AuditEntry> for AuditChange {
    fn from(AuditEntry { id, at_ms, actor, action, noun, subject, who, called }: AuditEntry) -> Self {
        let by = actor.split(':').next().unwrap_or_default().to_owned();
        Self { id, at: Time(at_ms), by, who, action, noun, subject, called }
    }
}
