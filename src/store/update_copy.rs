//! The copy of the database that is made before a newer program changes its schema.
//!
//! The copy has the schema of the earlier program, so it is never opened as a [`Store`]. Only names that every schema
//! has are used in it.

use std::collections::HashSet;
use std::path::Path;
use std::{fs, io};

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;
use sqlx::{ConnectOptions, Connection};

use super::disk_reserve::require_space;
use super::erasures::parse;
use super::error::{StoreError, StoreResult};
use super::retention::{
    DELETE_BOX_JOBS_OF_SESSION, DELETE_BOX_JOBS_OF_TRAINEE, forget_box_jobs_of_session, forget_box_jobs_of_trainee,
};
use super::schema_version::{SchemaState, schema_state};
use super::{Store, StoreSettings, open, skill_models};
use crate::domain::blob::BlobHash;
use crate::domain::erasure::{ErasedKind, Erasure};
use crate::ids::{SessionId, TraineeId};

const SELECT_TABLES: &str = "SELECT name FROM sqlite_schema WHERE type = 'table'";

const SELECT_PRESENT: &str = "
    SELECT id FROM trainee WHERE id IN (SELECT value FROM json_each($1))
    UNION ALL SELECT id FROM session WHERE id IN (SELECT value FROM json_each($1))";

const DELETE_ERASED_SESSIONS: &str = "DELETE FROM session WHERE id IN (SELECT value FROM json_each($1))";

/// A session may still have been waiting for its name when the copy was made: it had the same id.
const DELETE_ERASED_WAITING: &str = "DELETE FROM waiting_recording WHERE id IN (SELECT value FROM json_each($1))";

const DELETE_ERASED_TRAINEES: &str = "DELETE FROM trainee WHERE id IN (SELECT value FROM json_each($1))";

const DELETE_ERASED_PEOPLE: &str = "DELETE FROM person WHERE id IN (SELECT value FROM json_each($1))";

const SELECT_FILES: &str = "SELECT hash FROM blob";

const RELEASE_FILES: &str = "DELETE FROM job_file WHERE blob IN (SELECT value FROM json_each($1))";

/// The earlier program would delete them at its start.
const DELETE_UNREFERENCED: &str = "DELETE FROM blob WHERE hash NOT IN (SELECT hash FROM blob_reference)";

impl Store {
    /// The schema of the database at this path; `Empty` if there is no such file. Call it before [`Store::open`], which
    /// would make or change the schema.
    ///
    /// # Errors
    /// A newer program made the schema. [`StoreError::NoSpaceToOpen`] on a full disk without a reserve.
    pub async fn found_schema(path: &Path, settings: &StoreSettings) -> StoreResult<SchemaState> {
        // A file without a byte is not even opened: SQLite would delete a write-ahead log beside it.
        match fs::metadata(path) {
            Ok(found) if found.len() > 0 => {}
            Ok(_) => return Ok(SchemaState::Empty),
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(SchemaState::Empty),
            Err(error) => return Err(StoreError::Unusable(format!("`{}`: {error}", path.display()))),
        }
        require_space(path).await?;
        let mut connection = open::options(path, settings).read_only(true).connect().await?;
        let state = schema_state(&mut connection).await?;
        connection.close().await?;
        Ok(state)
    }

    /// Like [`Store::snapshot`], of a database that is not open yet.
    pub async fn copy_file(path: &Path, settings: &StoreSettings, into: &Path) -> StoreResult<()> {
        open::snapshot(path, settings, into).await
    }

    /// Erases people and recordings in a copy as well, with the models and the boxes' pictures that were made of them;
    /// no byte of them is left in it when this returns. The ids in `erasures` may be unknown there.
    pub async fn erase_in_copy(copy: &Path, erasures: &[Erasure]) -> StoreResult<()> {
        let mut connection = open::options(copy, &StoreSettings::default()).connect().await?;
        let mut tx = connection.begin().await?;
        erase_derived_data(&mut tx, erasures).await?;
        let mut deleted = 0;
        let tables: Vec<String> = sqlx::query_scalar(SELECT_TABLES).fetch_all(&mut *tx).await?;
        let waiting = tables.iter().any(|name| name == "waiting_recording");
        let waiting = waiting.then_some((ErasedKind::Session, DELETE_ERASED_WAITING));
        // Accounts last: those of trainees are deleted with them.
        for (kind, statement) in waiting.into_iter().chain([
            (ErasedKind::Session, DELETE_ERASED_SESSIONS),
            (ErasedKind::Trainee, DELETE_ERASED_TRAINEES),
            (ErasedKind::Person, DELETE_ERASED_PEOPLE),
        ]) {
            let ids: Vec<&str> =
                erasures.iter().filter(|erasure| erasure.kind == kind).map(|e| e.id.as_str()).collect();
            deleted += sqlx::query(statement).bind(Json(ids)).execute(&mut *tx).await?.rows_affected();
        }
        if deleted > 0 {
            sqlx::query(DELETE_UNREFERENCED).execute(&mut *tx).await?;
        }
        tx.commit().await?;
        Ok(connection.close().await?)
    }

    /// The files that a copy has a row of.
    pub async fn files_of_copy(copy: &Path) -> StoreResult<Vec<BlobHash>> {
        // Not read-only: SQLite may have to undo an erasure that a crash interrupted.
        let mut connection = open::options(copy, &StoreSettings::default()).connect().await?;
        let files = sqlx::query_scalar(SELECT_FILES).fetch_all(&mut connection).await?;
        connection.close().await?;
        Ok(files)
    }

    /// Removes deleted files from the jobs of a copy. Their rows go unless something else refers to them.
    pub async fn release_in_copy(copy: &Path, deleted: &[BlobHash]) -> StoreResult<()> {
        let mut connection = open::options(copy, &StoreSettings::default()).connect().await?;
        let mut tx = connection.begin().await?;
        let hashes: Vec<String> = deleted.iter().map(ToString::to_string).collect();
        sqlx::query(RELEASE_FILES).bind(Json(hashes)).execute(&mut *tx).await?;
        sqlx::query(DELETE_UNREFERENCED).execute(&mut *tx).await?;
        tx.commit().await?;
        Ok(connection.close().await?)
    }
}

/// Withdraws models and deletes boxes' jobs and pictures in a copy, as the live erasure does, before the people and
/// recordings that they were made of are erased. Tables that the copy's schema does not have yet are skipped.
async fn erase_derived_data(tx: &mut SqliteConnection, erasures: &[Erasure]) -> StoreResult<()> {
    let ids: Vec<&str> = erasures.iter().map(|erasure| erasure.id.as_str()).collect();
    let present: Vec<String> = sqlx::query_scalar(SELECT_PRESENT).bind(Json(ids)).fetch_all(&mut *tx).await?;
    if present.is_empty() {
        return Ok(()); // the usual case, since every erasure is repeated with each round of upkeep
    }
    let present: HashSet<String> = present.into_iter().collect();
    let tables: Vec<String> = sqlx::query_scalar(SELECT_TABLES).fetch_all(&mut *tx).await?;
    let has = |table: &str| tables.iter().any(|name| name == table);
    let (has_models, has_pictures) = (has("skill_model_trainee"), has("palette_surroundings"));
    for Erasure { kind, id, at_ms } in erasures.iter().filter(|erasure| present.contains(&erasure.id)) {
        match kind {
            ErasedKind::Trainee => {
                let id: TraineeId = parse(id)?;
                if has_models {
                    skill_models::withdraw(tx, id, *at_ms).await?;
                }
                if has_pictures {
                    forget_box_jobs_of_trainee(tx, id).await?;
                } else {
                    sqlx::query(DELETE_BOX_JOBS_OF_TRAINEE).bind(id).execute(&mut *tx).await?;
                }
            }
            ErasedKind::Session => {
                let id: SessionId = parse(id)?;
                if has_models {
                    skill_models::withdraw_of_session(tx, id, *at_ms).await?;
                }
                if has_pictures {
                    forget_box_jobs_of_session(tx, id).await?;
                } else {
                    sqlx::query(DELETE_BOX_JOBS_OF_SESSION).bind(id).execute(&mut *tx).await?;
                }
            }
            ErasedKind::Person | ErasedKind::Pending | ErasedKind::TakenBack => {}
        }
    }
    Ok(())
}
