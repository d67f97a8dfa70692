//! The copy of the database that is made before a newer program changes its schema.
//!
//! The copy has the schema of the earlier program, so it is never opened as a [`Store`]. Only names that every schema
//! has are used in it.

use std::path::Path;

use sqlx::types::Json;
use sqlx::{ConnectOptions, Connection};

use super::error::StoreResult;
use super::schema_version::{SchemaState, schema_state};
use super::{Store, StoreSettings, open};
use crate::domain::erasure::{ErasedKind, Erasure};

const DELETE_ERASED_SESSIONS: &str = "DELETE FROM session WHERE id IN (SELECT value FROM json_each($1))";

const DELETE_ERASED_TRAINEES: &str = "DELETE FROM trainee WHERE id IN (SELECT value FROM json_each($1))";

const DELETE_ERASED_PEOPLE: &str = "DELETE FROM person WHERE id IN (SELECT value FROM json_each($1))";

impl Store {
    /// True if a database exists at this path and [`Store::open`] would change its schema. Call it before.
    ///
    /// # Errors
    /// A newer program made the schema.
    pub async fn must_migrate(path: &Path, settings: &StoreSettings) -> StoreResult<bool> {
        if !path.exists() {
            return Ok(false);
        }
        let mut connection = open::options(path, settings).read_only(true).connect().await?;
        let state = schema_state(&mut connection).await?;
        connection.close().await?;
        Ok(state == SchemaState::Older)
    }

    /// Like [`Store::snapshot`], of a database that is not open yet.
    pub async fn copy_file(path: &Path, settings: &StoreSettings, into: &Path) -> StoreResult<()> {
        open::snapshot(path, settings, into).await
    }

    /// Erases people and recordings in a copy as well; no byte of them is left in it when this returns. The ids in
    /// `erasures` may be unknown there.
    pub async fn erase_in_copy(copy: &Path, erasures: &[Erasure]) -> StoreResult<()> {
        let mut connection = open::options(copy, &StoreSettings::default()).connect().await?;
        let mut tx = connection.begin().await?;
        // Accounts last: those of trainees are deleted with them.
        for (kind, statement) in [
            (ErasedKind::Session, DELETE_ERASED_SESSIONS),
            (ErasedKind::Trainee, DELETE_ERASED_TRAINEES),
            (ErasedKind::Person, DELETE_ERASED_PEOPLE),
        ] {
            let ids: Vec<&str> =
                erasures.iter().filter(|erasure| erasure.kind == kind).map(|e| e.id.as_str()).collect();
            sqlx::query(statement).bind(Json(ids)).execute(&mut *tx).await?;
        }
        tx.commit().await?;
        Ok(connection.close().await?)
    }
}
