//! Opens the database: sets and verifies the settings that durability depends on, migrates the schema, then adds the
//! program's kinds of jobs.

use std::path::Path;
use std::time::Duration;

use sqlx::migrate::Migrator;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{ConnectOptions, Connection, SqlitePool};

use super::StoreSettings;
use super::error::{StoreError, StoreResult};
use crate::domain::job::JobKind;

static MIGRATIONS: Migrator = sqlx::migrate!("./migrations");

/// In older versions, a checkpoint that races with a reset of the write-ahead log can corrupt the file.
const MIN_SQLITE: (u32, u32, u32) = (3, 51, 3);

const SNAPSHOT: &str = "VACUUM INTO $1";

const SELECT_VERSION: &str = "SELECT sqlite_version()";

const JOURNAL_MODE: &str = "PRAGMA journal_mode";

const BUSY_TIMEOUT: &str = "PRAGMA busy_timeout";

/// The settings that durability and privacy depend on, with their values.
const SETTINGS: [(&str, i64); 5] = [
    ("PRAGMA synchronous", 2), // FULL
    ("PRAGMA foreign_keys", 1),
    ("PRAGMA secure_delete", 1),
    ("PRAGMA trusted_schema", 0),
    ("PRAGMA temp_store", 2), // MEMORY
];

/// Opens the writing connection and migrates the schema.
pub(super) async fn open_writer(path: &Path, settings: &StoreSettings) -> StoreResult<SqliteConnection> {
    let options = options(path, settings).create_if_missing(true).journal_mode(SqliteJournalMode::Wal);
    let mut connection = options.connect().await?;
    check_version(&mut connection).await?;
    check_settings(&mut connection, settings).await?;
    MIGRATIONS.run(&mut connection).await.map_err(|error| {
        StoreError::Unusable(format!(
            "its schema does not match this program ({error}); was it created by a newer version?"
        ))
    })?;
    store_job_kinds(&mut connection).await?;
    Ok(connection)
}

const INSERT_JOB_KIND: &str = "INSERT INTO job_kind (name, subject) VALUES ($1, $2)";

const SELECT_JOB_KINDS: &str = "SELECT name FROM job_kind";

/// Adds the kinds of jobs that the database does not have yet. Fails if it has one that this program does not know.
async fn store_job_kinds(connection: &mut SqliteConnection) -> StoreResult<()> {
    let stored: Vec<String> = sqlx::query_scalar(SELECT_JOB_KINDS).fetch_all(&mut *connection).await?;
    if let Some(unknown) = stored.iter().find(|name| name.parse::<JobKind>().is_err()) {
        return Err(StoreError::Unusable(format!(
            "it has jobs of the kind `{unknown}`, which this program does not know; was it created by a newer version?"
        )));
    }
    for kind in JobKind::ALL.iter().filter(|kind| !stored.iter().any(|name| name == kind.name())) {
        sqlx::query(INSERT_JOB_KIND).bind(kind.name()).bind(kind.subject().name()).execute(&mut *connection).await?;
    }
    Ok(())
}

/// Page cache of each reading connection, in SQLite's notation: minus KiB. A cohort query reads 10 MiB; with the
/// default of 2 MiB each query would read them from disk again.
const READ_CACHE: &str = "-16384";

/// Opens the pool of reading connections. They cannot write, even if a statement tries to.
pub(super) async fn open_readers(path: &Path, settings: &StoreSettings) -> StoreResult<SqlitePool> {
    let checked = settings.clone();
    let pool = SqlitePoolOptions::new()
        .max_connections(settings.readers)
        .acquire_timeout(Duration::from_millis(settings.busy_timeout_ms))
        .after_connect(move |connection, _| {
            let settings = checked.clone();
            Box::pin(async move { check_settings(connection, &settings).await.map_err(sqlx::Error::config) })
        })
        .connect_with(
            options(path, settings).read_only(true).pragma("query_only", "ON").pragma("cache_size", READ_CACHE),
        )
        .await?;
    Ok(pool)
}

/// Writes a consistent copy of the database to a new file; durable when this returns.
pub(super) async fn snapshot(path: &Path, settings: &StoreSettings, into: &Path) -> StoreResult<()> {
    let unusable = |error: std::io::Error| StoreError::Unusable(format!("its copy `{}`: {error}", into.display()));
    for suffix in ["", "-wal", "-shm"] {
        let mut old = into.as_os_str().to_owned();
        old.push(suffix);
        match std::fs::remove_file(&old) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(unusable(error)),
            _ => {}
        }
    }
    let mut connection = options(path, settings).read_only(true).connect().await?;
    let target = into.to_str().ok_or_else(|| StoreError::refused("the folder's name is not UTF-8"))?.to_owned();
    sqlx::query(SNAPSHOT).bind(target).execute(&mut connection).await?;
    connection.close().await?;
    let folder = into.parent().unwrap_or(into);
    for file in [into, folder] {
        std::fs::File::open(file).and_then(|file| file.sync_all()).map_err(unusable)?;
    }
    Ok(())
}

/// Rows that sqlx may fetch ahead of the consumer. Row by row, every row would wake both threads.
const ROWS_AT_ONCE: usize = 1024;

fn options(path: &Path, settings: &StoreSettings) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(path)
        .synchronous(SqliteSynchronous::Full)
        .foreign_keys(true)
        .busy_timeout(Duration::from_millis(settings.busy_timeout_ms))
        .pragma("secure_delete", "ON")
        .pragma("trusted_schema", "OFF")
        .pragma("temp_store", "MEMORY") // no copy of people's data in a temporary file
        .row_buffer_size(ROWS_AT_ONCE)
        .disable_statement_logging()
}

async fn check_version(connection: &mut SqliteConnection) -> StoreResult<()> {
    let version: String = sqlx::query_scalar(SELECT_VERSION).fetch_one(connection).await?;
    let mut parts = version.split('.').map(|part| part.parse().unwrap_or(0));
    let mut next = || parts.next().unwrap_or(0);
    if (next(), next(), next()) >= MIN_SQLITE {
        return Ok(());
    }
    Err(StoreError::Unusable(format!("SQLite {version} can corrupt its write-ahead log; 3.51.3 or newer is needed")))
}

/// Fails if a setting did not take effect (read-only folder, unusual file system, old library).
async fn check_settings(connection: &mut SqliteConnection, settings: &StoreSettings) -> StoreResult<()> {
    let journal: String = sqlx::query_scalar(JOURNAL_MODE).fetch_one(&mut *connection).await?;
    expect("journal_mode", &journal, "wal")?;
    let busy_timeout_ms = i64::try_from(settings.busy_timeout_ms).unwrap_or(i64::MAX);
    for (pragma, wanted) in SETTINGS.into_iter().chain([(BUSY_TIMEOUT, busy_timeout_ms)]) {
        let found: i64 = sqlx::query_scalar(pragma).fetch_one(&mut *connection).await?;
        expect(pragma, &found.to_string(), &wanted.to_string())?;
    }
    Ok(())
}

fn expect(what: &str, found: &str, wanted: &str) -> StoreResult<()> {
    if found == wanted {
        return Ok(());
    }
    Err(StoreError::Unusable(format!("{what} is {found}, but {wanted} is needed; is the data folder on a local disk?")))
}
