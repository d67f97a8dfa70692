//! The PINs that trainees check in with at boxes. Each account of a trainee may have one; only its hash is stored.

use super::audit::note;
use super::error::{StoreError, StoreResult};
use super::visibility::require_sign_in;
use super::{Scope, Store};
use crate::domain::scope::Actor;
use crate::domain::secret::PasswordHash;
use crate::domain::text::Key;
use crate::ids::{PersonId, TraineeId};

/// Access to the PINs.
pub struct CheckInPinStore<'s>(pub(super) &'s Store);

/// The PIN of a trainee, with what the check-in needs.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct CheckInPinRecord {
    /// The account.
    pub person_id: PersonId,
    /// The trainee.
    pub trainee_id: TraineeId,
    /// The hash of the PIN.
    pub pin_hash: PasswordHash,
}

const SELECT_SET_AT: &str = "SELECT set_at_ms FROM check_in_pin WHERE person_id = $1";

const SELECT_SET_AT_OF_TRAINEE: &str = "
    SELECT set_at_ms FROM check_in_pin JOIN person ON person.id = person_id WHERE person.trainee_id = $1";

const UPSERT_PIN: &str = "
    INSERT INTO check_in_pin (person_id, pin_hash, set_at_ms) VALUES ($1, $2, $3)
    ON CONFLICT (person_id) DO UPDATE SET pin_hash = excluded.pin_hash, set_at_ms = excluded.set_at_ms";

const DELETE_PIN: &str = "DELETE FROM check_in_pin WHERE person_id = $1";

const SELECT_PIN: &str = "
    SELECT person_id, person.trainee_id, pin_hash
    FROM check_in_pin JOIN person ON person.id = person_id JOIN trainee ON trainee.id = person.trainee_id
    WHERE trainee.code = $1 AND person.role = 'trainee'
      AND trainee.id NOT IN (SELECT trainee_id FROM hidden_trainee)";

impl CheckInPinStore<'_> {
    /// When the caller's own PIN was set, epoch ms; `None`: there is none.
    pub async fn own_set_at(&self, scope: &Scope) -> StoreResult<Option<i64>> {
        let (person, _) = account(scope)?;
        Ok(sqlx::query_scalar(SELECT_SET_AT).bind(person).fetch_optional(self.0.readers()).await?)
    }

    /// When the PIN of a trainee was set, epoch ms; `None`: there is none.
    pub async fn set_at(&self, scope: &Scope, trainee: TraineeId) -> StoreResult<Option<i64>> {
        self.0.trainees().get(scope, &Key::from(&trainee)).await?;
        Ok(sqlx::query_scalar(SELECT_SET_AT_OF_TRAINEE).bind(trainee).fetch_optional(self.0.readers()).await?)
    }

    /// Sets the caller's own PIN.
    pub async fn set(&self, scope: &Scope, pin: PasswordHash) -> StoreResult<()> {
        let (person, trainee) = account(scope)?;
        require_sign_in(scope, "setting a PIN")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                sqlx::query(UPSERT_PIN).bind(person).bind(pin).bind(now_ms).execute(&mut *tx).await?;
                note(tx, &by, now_ms, ("set pin", "trainee"), trainee).await
            })
            .await
    }

    /// Removes the caller's own PIN.
    pub async fn remove(&self, scope: &Scope) -> StoreResult<()> {
        let (person, trainee) = account(scope)?;
        require_sign_in(scope, "removing a PIN")?;
        let (by, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                if sqlx::query(DELETE_PIN).bind(person).execute(&mut *tx).await?.rows_affected() == 0 {
                    return Ok(());
                }
                note(tx, &by, now_ms, ("remove pin", "trainee"), trainee).await
            })
            .await
    }

    /// The PIN of the trainee with this code, to check an attempt at a box; `None`: no such trainee, or no PIN.
    pub async fn by_code(&self, scope: &Scope, code: &str) -> StoreResult<Option<CheckInPinRecord>> {
        if !matches!(scope.actor(), Actor::Agent(_)) {
            return Err(StoreError::Forbidden { what: "checking a PIN", whom: "the agents of boxes" });
        }
        Ok(sqlx::query_as(SELECT_PIN).bind(code).fetch_optional(self.0.readers()).await?)
    }
}

/// The caller's account and trainee. Only trainees have PINs.
fn account(scope: &Scope) -> StoreResult<(PersonId, TraineeId)> {
    let own = scope.person().zip(scope.own_trainee());
    own.ok_or(StoreError::Forbidden { what: "a PIN for the box", whom: "trainees" })
}
