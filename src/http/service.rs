//! State of the service for administrators: versions, storage, backup, settings, and the audit log.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::Administrator;
use super::error::HandlerResult;
use super::read::{Json, Params};
use super::show::{PageResponse, Paging, Time};
use super::state::App;
use crate::store::{AuditEntry, Backup, QueueCounts, StoreResult};
use crate::upkeep::{BackupProgress, BackupSettings, RetentionSettings};

/// Files that the newest backup lacks that are shown; its file `BACKUP` has all.
const MAX_MISSING_SHOWN: usize = 20;

/// State of the service.
#[derive(Debug, Serialize, ToSchema)]
pub struct ServiceState {
    /// Version of the program.
    version: &'static str,
    /// Version of the measuring pipeline. Results of different versions are not compared.
    pipeline: &'static str,
    /// When this process began to serve.
    started_at: Time,
    storage: StorageState,
    queue: QueueState,
    /// The last backup; `null`: none is known.
    last_backup: Option<LastBackup>,
    /// The scheduled backups; `null`: the settings name no folder for them.
    scheduled_backups: Option<ScheduledBackups>,
    /// Why the lists of erasures lack erasures; `null`: they are complete. Meanwhile a restored backup would bring back
    /// people who were erased.
    erasure_list_error: Option<String>,
    /// The command that makes a backup by hand, for the shell of this machine, as the user that the service runs as, or
    /// as an administrator of the machine if it begins with `sudo`. Its last word is the folder of the backup; it must
    /// be new or empty.
    backup_command: String,
    retention: RetentionState,
    settings: SettingsInForce,
}

/// Use of the disk.
#[derive(Debug, Serialize, ToSchema)]
pub struct StorageState {
    /// Number of files with recordings and results.
    files: u64,
    /// Total size of these files, bytes.
    files_bytes: u64,
    /// Size of the database, bytes.
    database_bytes: u64,
    /// Free disk space, bytes.
    free_bytes: u64,
}

/// Number of jobs in the queue.
#[derive(Debug, Serialize, ToSchema)]
pub struct QueueState {
    queued: i64,
    running: i64,
    /// Jobs that are no longer tried because they crashed too often.
    quarantined: i64,
}

/// What is kept for a limited time.
#[derive(Debug, Serialize, ToSchema)]
pub struct RetentionState {
    /// Months after its arrival when the video of a session is deleted; 0: videos are kept until the session is erased.
    videos_months: u32,
    /// Number of videos that will be deleted in the next 30 days.
    next_videos: u64,
    /// Size of these videos, bytes.
    next_bytes: u64,
    /// Days for taking the erasure of a trainee back; 0: it cannot.
    erase_days: u32,
    /// Months for which the log of who opened whose recordings is kept; 0: as long as the trainee.
    access_log_months: u32,
    /// Days after its arrival when a recording without a name is deleted.
    unnamed_days: u32,
}

impl RetentionState {
    async fn of(app: &App) -> StoreResult<Self> {
        let due = app.retention.videos_of_next_month(app.clock.now_ms());
        let (next_videos, next_bytes) = app.store.retention().old_videos(due).await?;
        let RetentionSettings { videos_months, erase_days, access_log_months, unnamed_days } = app.retention;
        Ok(Self { videos_months, next_videos, next_bytes, erase_days, access_log_months, unnamed_days })
    }
}

/// The last backup.
#[derive(Debug, Serialize, ToSchema)]
pub struct LastBackup {
    at: Time,
    /// Number of files in it, all verified.
    files: u64,
}

/// Scheduled backups.
#[derive(Debug, Serialize, ToSchema)]
pub struct ScheduledBackups {
    /// Their folder.
    folder: String,
    /// Time of day in UTC.
    at: String,
    /// How many are kept.
    keep: usize,
    /// Time of the newest one in the folder; `null`: there is none yet.
    newest_at: Option<Time>,
    /// Number of backups in the folder that are of another installation, or of an earlier version, whose backups name
    /// none. The service never deletes them.
    others: usize,
    /// Number of files that the newest one lacks, because they were lost when it was made.
    missing_files: usize,
    /// The first 20 of them, each with the sessions and boxes that refer to it, without trainees.
    missing: Vec<String>,
    /// Why the last attempt failed; `null`: it succeeded, or there was none yet.
    error: Option<String>,
}

impl ScheduledBackups {
    fn of(app: &App) -> Option<Self> {
        let BackupSettings { target, at, keep } = &app.backup_settings;
        let BackupProgress { newest_ms, others, mut missing, error } = app.backup_state.now();
        let (folder, missing_files) = (target.as_ref()?.display().to_string(), missing.len());
        missing.truncate(MAX_MISSING_SHOWN);
        let (at, newest_at) = (at.to_string(), newest_ms.map(Time));
        Some(Self { folder, at, keep: *keep, newest_at, others, missing_files, missing, error })
    }
}

/// Settings in force.
#[derive(Debug, Serialize, ToSchema)]
pub struct SettingsInForce {
    /// Recordings tracked at the same time.
    workers: usize,
    /// Largest recording, bytes.
    max_upload_bytes: u64,
    /// Hours after which an unfinished upload is deleted.
    unfinished_upload_h: u64,
    /// Seconds within which erased data is deleted from the disk.
    erased_within_s: u64,
    /// Minutes without a request after which a sign-in ends.
    idle_min: u64,
    /// Hours after which a sign-in ends in any case.
    sign_in_h: u64,
    /// Failed sign-ins of a login before the next attempt has to wait. The name is older than this rule.
    attempts_per_min: u32,
}

/// An entry of the audit log.
#[derive(Debug, Serialize, ToSchema)]
pub struct AuditChange {
    /// Order of writing; larger is later.
    id: i64,
    at: Time,
    /// `person`, `agent` or `service`.
    by: String,
    /// Name of the person; `null` if `by` is not a person, or if the person was deleted.
    who: Option<String>,
    /// `create`, `change`, `erase`, …
    action: String,
    /// Kind of the changed resource.
    noun: String,
    /// Id of the changed resource, or a number: of the files in a backup, of the tokens that a new password, a new role
    /// or the end of an account withdrew. The log stores no names, so erasing a person leaves no name behind.
    subject: String,
    /// The number of the attempt, for a change of an attempt of an exam; `null` otherwise.
    attempt: Option<u32>,
    /// Present name of the resource; for a session, the name of its trainee. `null` if it has no name or was deleted.
    called: Option<String>,
    /// The reason that the person gave for an edit or a move of a session; `null` otherwise, and if the session was erased.
    why: Option<String>,
    /// Address of the client that sent the request. `null` if the service or a command made the change, if the address
    /// was not yet recorded, or if the person's account was deleted.
    address: Option<String>,
}

/// Read the state of the service
#[utoipa::path(get, path = "/service", tag = "operation", responses((status = OK, body = ServiceState)))]
pub async fn service(State(app): State<App>, by: Administrator) -> HandlerResult<Json<ServiceState>> {
    let (files, files_bytes) = app.store.blobs().total().await?;
    let QueueCounts { queued, running, quarantined } = app.store.jobs().counts().await?;
    let backup = app.store.audit().last_backup(&by.scope).await?;
    let (http, set) = (&app.settings, app.service_info);
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
        scheduled_backups: ScheduledBackups::of(&app),
        erasure_list_error: app.erasure_list_state.error(),
        backup_command: app.backup_command.clone(),
        retention: RetentionState::of(&app).await?,
        last_backup: backup.map(|Backup { at_ms, files }| LastBackup { at: Time(at_ms), files }),
        settings: SettingsInForce {
            workers: set.workers,
            max_upload_bytes: set.max_upload_bytes,
            unfinished_upload_h: set.unfinished_upload_h,
            erased_within_s: set.erased_within_s,
            idle_min: http.idle_min,
            sign_in_h: http.sign_in_h,
            attempts_per_min: http.free_attempts,
        },
    }))
}

/// List the entries of the audit trail: changes of people's data, newest first
#[utoipa::path(get, path = "/audit-entries", tag = "operation", params(Paging),
    responses((status = OK, body = PageResponse<AuditChange>)))]
pub async fn audit(
    State(app): State<App>,
    by: Administrator,
    Params(paging): Params<Paging>,
) -> HandlerResult<Json<PageResponse<AuditChange>>> {
    let page = paging.request("audit-entries", app.settings.page_items)?;
    Ok(Json(PageResponse::of(app.store.audit().list(&by.scope, &page).await?, AuditChange::from)))
}

impl From<AuditEntry> for AuditChange {
    fn from(
        AuditEntry { id, at_ms, actor, action, noun, subject, attempt, who, called, why, address }: AuditEntry,
    ) -> Self {
        let by = actor.split(':').next().unwrap_or_default().to_owned();
        Self { id, at: Time(at_ms), by, who, action, noun, subject, attempt, called, why, address }
    }
}
