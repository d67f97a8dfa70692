//! The erasures of this database. A trigger writes each in the transaction that deletes the row.

use std::str::FromStr;

use super::error::{StoreError, StoreResult};
use super::pending_erasures::INSERT_ERASURE;
use super::{Scope, Store};
use crate::domain::erasure::{ErasedKind, Erasure};
use crate::domain::text::Key;
use crate::ids::TraineeId;

/// Access to the erasures.
pub struct ErasureStore<'s>(pub(super) &'s Store);

#[derive(sqlx::FromRow)]
struct ErasureRow {
    number: i64,
    kind: ErasedKind,
    id: String,
    at_ms: i64,
}

const SELECT_ERASURES: &str = "SELECT number, kind, id, at_ms FROM erasure WHERE number > $1 ORDER BY number LIMIT $2";

pub(super) const SELECT_LAST_ERASURE: &str = "SELECT coalesce(max(number), 0) FROM erasure";

const SELECT_COMPLETED_LATER: &str = "
    SELECT max(ended_at_ms) FROM feed WHERE session_id = $1 AND created_at_ms <= $2 AND ended_at_ms > $2";

const UPDATE_ERASURE_TIME: &str = "UPDATE erasure SET at_ms = $3 WHERE kind = $1 AND id = $2 AND at_ms > $3";

impl ErasureStore<'_> {
    /// Number of the last erasure; 0 if there is none.
    pub async fn last(&self) -> StoreResult<i64> {
        Ok(sqlx::query_scalar(SELECT_LAST_ERASURE).fetch_one(self.0.readers()).await?)
    }

    /// Erasures after the one with this number, with their numbers, in order; at most `most`.
    pub async fn after(&self, number: i64, most: u32) -> StoreResult<Vec<(i64, Erasure)>> {
        let rows = sqlx::query_as::<_, ErasureRow>(SELECT_ERASURES).bind(number).bind(most);
        let rows = rows.fetch_all(self.0.readers()).await?;
        Ok(rows
            .into_iter()
            .map(|ErasureRow { number, kind, id, at_ms }| (number, Erasure { kind, id, at_ms }))
            .collect())
    }

    /// Adds erasures that happened after the backup that this database was restored from. Their ids must be valid.
    pub async fn add(&self, erasures: Vec<Erasure>) -> StoreResult<()> {
        self.0
            .write(async move |tx| {
                for Erasure { kind, id, at_ms } in erasures {
                    sqlx::query(INSERT_ERASURE).bind(kind).bind(id).bind(at_ms).execute(&mut *tx).await?;
                }
                Ok(())
            })
            .await
    }

    /// When the recording of a session was complete, if it still arrived at the time of this erasure, epoch ms. Then the
    /// session was not erased: a recording that is erased while it arrives is never completed.
    pub async fn completed_later(&self, Erasure { kind, id, at_ms }: &Erasure) -> StoreResult<Option<i64>> {
        match kind {
            ErasedKind::Session => {
                let completed = sqlx::query_scalar(SELECT_COMPLETED_LATER).bind(id).bind(at_ms);
                Ok(completed.fetch_one(self.0.readers()).await?)
            }
            ErasedKind::Trainee | ErasedKind::Person | ErasedKind::Pending | ErasedKind::TakenBack => Ok(None),
        }
    }

    /// Gives erasures that were repeated the time when they first happened: a session that is listed with an earlier time
    /// than the database has would be listed again.
    pub async fn restore_times(&self, repeated: Vec<Erasure>) -> StoreResult<()> {
        self.0
            .write(async move |tx| {
                for Erasure { kind, id, at_ms } in repeated.into_iter().filter(Erasure::is_final) {
                    sqlx::query(UPDATE_ERASURE_TIME).bind(kind).bind(id).bind(at_ms).execute(&mut *tx).await?;
                }
                Ok(())
            })
            .await
    }

    /// Erases again what this erasure names. Returns false if it does not exist. One that was taken back waits no more; one
    /// that is requested is for [`Self::wait_again`].
    pub async fn repeat(&self, Erasure { kind, id, .. }: &Erasure) -> StoreResult<bool> {
        let service = Scope::service();
        let erased = match kind {
            ErasedKind::Trainee => self.0.trainees().erase_again(parse(id)?).await,
            ErasedKind::Session => match self.0.sessions().erase(&service, parse(id)?).await {
                // In the restored backup it may still wait for its name: it has the same id.
                Err(StoreError::NotFound { .. }) => self.0.waiting_recordings().discard(&service, parse(id)?).await,
                erased => erased,
            },
            ErasedKind::Person => self.0.people().delete(&service, parse(id)?).await,
            ErasedKind::Pending => return Ok(false),
            ErasedKind::TakenBack => {
                return self.0.pending_erasures().remove(&service, parse(id)?).await.map(|_| false);
            }
        };
        match erased {
            Ok(()) => Ok(true),
            Err(StoreError::NotFound { .. }) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Lets a trainee wait again until the erasure is due that was requested for them, after all else was repeated. Exactly
    /// the records wait that are named in `all` requests: a record that is merged into another one here waits with that one if
    /// both are due at the same time, since they were merged when the erasure was requested. Otherwise the two are separated.
    pub async fn wait_again(&self, requested: &Erasure, all: &[Erasure]) -> StoreResult<()> {
        let (id, due_at_ms): (TraineeId, i64) = (parse(&requested.id)?, requested.at_ms);
        match self.0.trainees().get(&Scope::service(), &Key::from(&id)).await {
            Ok(_) => {
                let with = all.iter().filter(|one| one.at_ms == due_at_ms).filter_map(|one| parse(&one.id).ok());
                self.0.pending_erasures().insert_again(id, due_at_ms, with.collect()).await
            }
            Err(StoreError::NotFound { .. }) => Ok(()),
            Err(error) => Err(error),
        }
    }
}

pub(super) fn parse<T: FromStr>(id: &str) -> StoreResult<T> {
    id.parse().map_err(|_| StoreError::refused(format!("`{id}` in the list of erasures is not an id")))
}
