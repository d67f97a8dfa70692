//! The version of a database's schema: the migrations that it has, compared with those of this program.

use sqlx::Connection;
use sqlx::migrate::Migrator;
use sqlx::sqlite::SqliteConnection;

use super::error::{StoreError, StoreResult};
use crate::domain::job::JobKind;

static MIGRATIONS: Migrator = sqlx::migrate!("./migrations");

/// What an administrator does about a database of a newer program.
const NEWER: &str = "a newer version of this program has changed it: install the newer version again, which loses nothing. To \
     go back to the state before the update, which loses what came after it: stop the service, move \
     all files `trocar.db*` out of the data folder and `before-update/trocar.db` to their place, and \
     start the earlier version; docs/operations.md, Update, has the commands, and what the lists of \
     erasures need";

/// How a database's schema compares with this program's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SchemaState {
    /// It has no schema yet.
    Empty,
    /// It lacks migrations of this program.
    Older,
    /// It has all migrations of this program, and no other.
    Current,
}

const COUNT_MIGRATION_TABLES: &str =
    "SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name = '_sqlx_migrations'";

const SELECT_MIGRATIONS: &str = "SELECT version, checksum FROM _sqlx_migrations ORDER BY version";

const SELECT_JOB_KINDS: &str = "SELECT name FROM job_kind";

const INSERT_JOB_KIND: &str = "INSERT INTO job_kind (name, subject) VALUES ($1, $2)";

/// Compares the schemas.
///
/// # Errors
/// The database has a migration or a kind of job that this program does not know, or another text of a migration.
pub(super) async fn schema_state(connection: &mut SqliteConnection) -> StoreResult<SchemaState> {
    if sqlx::query_scalar::<_, i64>(COUNT_MIGRATION_TABLES).fetch_one(&mut *connection).await? == 0 {
        return Ok(SchemaState::Empty);
    }
    let applied: Vec<(i64, Vec<u8>)> = sqlx::query_as(SELECT_MIGRATIONS).fetch_all(&mut *connection).await?;
    for (version, checksum) in &applied {
        let known = MIGRATIONS.iter().find(|migration| migration.version == *version);
        let known = known.ok_or_else(|| StoreError::Unusable(format!("{NEWER} (migration {version})")))?;
        if *known.checksum != **checksum {
            return Err(StoreError::Unusable(format!(
                "its migration {version} differs from this program's: install the program that made the database"
            )));
        }
    }
    if applied.len() < MIGRATIONS.iter().count() {
        return Ok(SchemaState::Older);
    }
    refuse_unknown_kind(&job_kinds(connection).await?)?;
    Ok(SchemaState::Current)
}

/// Refuses a database that the commands of this program cannot use as it is.
pub(super) async fn require_current(connection: &mut SqliteConnection) -> StoreResult<()> {
    match schema_state(connection).await? {
        SchemaState::Current => Ok(()),
        SchemaState::Older => Err(StoreError::OlderSchema),
        SchemaState::Empty => Err(StoreError::NoSchema),
    }
}

/// Applies the missing migrations and adds the kinds of jobs that the database lacks. The migrations share one
/// transaction: if one fails, or the process ends, the program before the update can use the database as it was.
pub(super) async fn migrate(connection: &mut SqliteConnection) -> StoreResult<()> {
    if schema_state(connection).await? != SchemaState::Current {
        let mut tx = connection.begin_with("BEGIN IMMEDIATE").await?;
        MIGRATIONS.run(&mut *tx).await.map_err(|error| {
            StoreError::Unusable(format!(
                "its schema could not be adapted to this program, and it stays as it was ({error})"
            ))
        })?;
        tx.commit().await?;
    }
    let stored = job_kinds(connection).await?;
    refuse_unknown_kind(&stored)?;
    for kind in JobKind::ALL.iter().filter(|kind| !stored.iter().any(|name| name == kind.name())) {
        sqlx::query(INSERT_JOB_KIND).bind(kind.name()).bind(kind.subject().name()).execute(&mut *connection).await?;
    }
    Ok(())
}

async fn job_kinds(connection: &mut SqliteConnection) -> StoreResult<Vec<String>> {
    Ok(sqlx::query_scalar(SELECT_JOB_KINDS).fetch_all(connection).await?)
}

/// Fails if this program does not know one of these kinds of jobs.
fn refuse_unknown_kind(stored: &[String]) -> StoreResult<()> {
    match stored.iter().find(|name| name.parse::<JobKind>().is_err()) {
        Some(unknown) => Err(StoreError::Unusable(format!("{NEWER} (jobs of the kind `{unknown}`)"))),
        None => Ok(()),
    }
}
