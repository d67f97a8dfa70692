//! Opens the database: sets and verifies the settings that durability depends on.
//!
//! | function | for | schema |
//! |---|---|---|
//! | [`Store::open`] | the service | is created and migrated |
//! | [`Store::open_existing`] | commands that change something | must be this program's |
//! | [`Store::open_read_only`] | commands that only read | must be this program's |

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64};
use std::time::Duration;

use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{ConnectOptions, Connection, SqlitePool};
use tokio::sync::watch;

use super::disk_reserve::{DiskReserve, require_space};
use super::error::{StoreError, StoreResult};
use super::schema_version::{migrate, require_current};
use super::writer::Writer;
use super::{Store, StoreInner, StoreSettings};
use crate::time::SharedClock;

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

impl Store {
    /// Opens the database at this path, creates it if it is missing, and migrates its schema.
    ///
    /// # Errors
    /// [`StoreError::NoSpaceToOpen`] on a full disk without a reserve.
    pub async fn open(path: &Path, settings: &StoreSettings, clock: SharedClock) -> StoreResult<Self> {
        require_space(path).await?;
        let connection = open_writer(path, settings).await?;
        let store = Self::with_writer(connection, path, settings, clock).await?;
        store.restore_reserves().await;
        Ok(store)
    }

    /// Opens a database that exists and has this program's schema, to change something while a service may use it.
    ///
    /// # Errors
    /// The schema is another version's. [`StoreError::NoSpaceToOpen`] on a full disk without a reserve.
    pub async fn open_existing(path: &Path, settings: &StoreSettings, clock: SharedClock) -> StoreResult<Self> {
        require_space(path).await?;
        let connection = open_existing_writer(path, settings).await?;
        Self::with_writer(connection, path, settings, clock).await
    }

    /// Opens a database that exists and has this program's schema, to read it without changing a byte of its folder.
    /// At the end, [`Store::require_unchanged`] says whether the reads can be relied on.
    ///
    /// # Errors
    /// The schema is another version's.
    pub async fn open_read_only(path: &Path, settings: &StoreSettings, clock: SharedClock) -> StoreResult<Self> {
        let (address, opened) = unchanged_address(path)?;
        let readers = open_unchanged(&address, settings).await?;
        Ok(Self::with_parts((path, address), settings, clock, (readers, None, opened)))
    }

    async fn with_writer(
        connection: SqliteConnection,
        path: &Path,
        settings: &StoreSettings,
        clock: SharedClock,
    ) -> StoreResult<Self> {
        let readers = open_readers(path, settings).await?;
        let writer = Writer::start(connection, settings.waiting_writes, settings.writes_per_commit)
            .map_err(|error| StoreError::Unusable(format!("its writer thread cannot start: {error}")))?;
        Ok(Self::with_parts((path, path.to_owned()), settings, clock, (readers, Some(writer), None)))
    }

    fn with_parts(
        (path, address): (&Path, PathBuf),
        settings: &StoreSettings,
        clock: SharedClock,
        (readers, writer, opened): (SqlitePool, Option<Writer>, Option<FileStamp>),
    ) -> Self {
        Self {
            inner: Arc::new(StoreInner {
                path: path.to_owned(),
                address,
                readers,
                writer,
                opened,
                clock,
                settings: settings.clone(),
                delete_reserve: DiskReserve::for_deletes(path),
                sign_in_reserve: DiskReserve::for_sign_in(path),
                ended_sign_ins: watch::Sender::new(()),
                has_erased_data: AtomicBool::new(true), // perhaps before the last restart
                last_purged: AtomicI64::new(-1),
            }),
        }
    }

    /// Fails if the database was written while a store of [`Store::open_read_only`] read it without a lock. A service
    /// that was started meanwhile writes to the log first.
    pub fn require_unchanged(&self) -> StoreResult<()> {
        let StoreInner { path, opened, .. } = &*self.inner;
        let Some(opened) = opened else { return Ok(()) };
        let has_log = fs::metadata(with_suffix(path, "-wal")).is_ok_and(|log| log.len() > 0);
        if has_log || FileStamp::of(path)? != *opened {
            return Err(StoreError::Unusable(
                "the service was started or the data changed during this command: run it again".to_owned(),
            ));
        }
        Ok(())
    }
}

/// Opens the writing connection, creates the database if it is missing, and migrates the schema.
async fn open_writer(path: &Path, settings: &StoreSettings) -> StoreResult<SqliteConnection> {
    let options = options(path, settings).create_if_missing(true).journal_mode(SqliteJournalMode::Wal);
    let mut connection = options.connect().await?;
    check_version(&mut connection).await?;
    check_settings(&mut connection, settings).await?;
    migrate(&mut connection).await?;
    Ok(connection)
}

/// Opens the writing connection to a database that exists and has this program's schema. A service may use it, too:
/// SQLite lets one of them write at a time, and the other one waits for `busy_timeout_ms`.
async fn open_existing_writer(path: &Path, settings: &StoreSettings) -> StoreResult<SqliteConnection> {
    let mut connection = options(path, settings).connect().await?;
    require_current(&mut connection).await?;
    check_settings(&mut connection, settings).await?;
    Ok(connection)
}

/// Page cache of each reading connection, in SQLite's notation: minus KiB. A cohort query reads 10 MiB; with the
/// default of 2 MiB each query would read them from disk again.
const READ_CACHE: &str = "-16384";

/// Opens the pool of reading connections. They cannot write, even if a statement tries to.
async fn open_readers(path: &Path, settings: &StoreSettings) -> StoreResult<SqlitePool> {
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

/// A database file at one moment, to see later whether it was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct FileStamp {
    inode: u64,
    bytes: u64,
    /// Time of the last change, s and ns.
    changed: (i64, i64),
}

impl FileStamp {
    pub fn of(path: &Path) -> StoreResult<Self> {
        let found = fs::metadata(path).map_err(|error| unusable(path, &error))?;
        Ok(Self { inode: found.ino(), bytes: found.len(), changed: (found.mtime(), found.mtime_nsec()) })
    }
}

/// SQLite's address of a database for reading connections that change no byte of the folder, also not of the log and
/// its index.
///
/// With `mode=ro` alone, SQLite would create both files or write the index. If both exist, a service has the database
/// open or was killed: then SQLite reads the index, or makes one in memory. If the log is empty or missing, the file
/// itself is complete, and SQLite reads it without any lock. The file's stamp is returned in that case, so that a change
/// by a service that is started meanwhile does not pass unnoticed.
fn unchanged_address(path: &Path) -> StoreResult<(PathBuf, Option<FileStamp>)> {
    let bytes_of = |suffix| fs::metadata(with_suffix(path, suffix)).map(|found| found.len()).ok();
    let (parameter, stamp) = match (bytes_of("-wal"), bytes_of("-shm")) {
        (Some(_), Some(_)) => ("readonly_shm=1", None),
        (None | Some(0), _) => ("immutable=1", Some(FileStamp::of(path)?)),
        (Some(_), None) => {
            let why = "its write-ahead log has no index beside it (`-shm`): start the service once, which makes one; \
                       if the disk is read-only, copy the data folder to another disk first";
            return Err(StoreError::Unusable(why.to_owned()));
        }
    };
    Ok((address_of(path, parameter)?, stamp))
}

/// Opens reading connections to this address. The schema must be this program's.
async fn open_unchanged(address: &Path, settings: &StoreSettings) -> StoreResult<SqlitePool> {
    let pool = SqlitePoolOptions::new()
        .max_connections(settings.readers)
        .acquire_timeout(Duration::from_millis(settings.busy_timeout_ms))
        .connect_with(options(address, settings).read_only(true).pragma("query_only", "ON"))
        .await?;
    require_current(&mut *pool.acquire().await?).await?;
    Ok(pool)
}

/// SQLite's address of a file, with a parameter that has no option in sqlx.
fn address_of(path: &Path, parameter: &str) -> StoreResult<PathBuf> {
    let path = std::path::absolute(path).map_err(|error| unusable(path, &error))?;
    let path = text_of(&path)?.replace('%', "%25").replace('?', "%3f").replace('#', "%23");
    Ok(PathBuf::from(format!("file://{path}?{parameter}")))
}

fn text_of(path: &Path) -> StoreResult<&str> {
    path.to_str().ok_or_else(|| StoreError::refused("the folder's name is not UTF-8"))
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

fn unusable(path: &Path, error: &std::io::Error) -> StoreError {
    StoreError::Unusable(format!("`{}`: {error}", path.display()))
}

/// Writes a consistent copy of the database at this path or address to a new file; durable when this returns.
pub(super) async fn snapshot(address: &Path, settings: &StoreSettings, into: &Path) -> StoreResult<()> {
    for suffix in ["", "-wal", "-shm"] {
        match fs::remove_file(with_suffix(into, suffix)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(unusable(into, &error)),
            _ => {}
        }
    }
    let mut connection = options(address, settings).read_only(true).connect().await?;
    let target = text_of(into)?.to_owned();
    sqlx::query(SNAPSHOT).bind(target).execute(&mut connection).await?;
    connection.close().await?;
    let folder = into.parent().unwrap_or(into);
    for file in [into, folder] {
        fs::File::open(file).and_then(|file| file.sync_all()).map_err(|error| unusable(into, &error))?;
    }
    Ok(())
}

/// Rows that sqlx may fetch ahead of the consumer. Row by row, every row would wake both threads.
const ROWS_AT_ONCE: usize = 1024;

pub(super) fn options(path: &Path, settings: &StoreSettings) -> SqliteConnectOptions {
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
