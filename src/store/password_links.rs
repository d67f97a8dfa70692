//! Links for choosing a password without the old one: for a new person, and for one who has forgotten the password.
//! Administrators make them for all accounts, instructors for their trainees ([`super::invitations`]). Only the hash of a
//! link's secret is stored. An account has at most one link.
//!
//! A link is valid only while its maker could make it: an administrator, or an instructor of the trainee. So an instructor
//! who leaves a group keeps no way into its trainees' accounts.

use std::net::IpAddr;
use std::time::Duration;

use sqlx::sqlite::SqliteConnection;

use super::audit::note;
use super::cookies::remember_places;
use super::error::{StoreResult, missing, not_found};
use super::people::{PersonRecord, replace_password};
use super::visibility::require_administrator;
use super::{Scope, Store};
use crate::domain::password_state::PasswordState;
use crate::domain::secret::{PasswordHash, SecretHash};
use crate::ids::{PasswordLinkId, PersonId};
use crate::time::millis;

/// Access to the links.
pub struct PasswordLinkStore<'s>(pub(super) &'s Store);

/// A link without its secret, which is not stored.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct PasswordLinkRecord {
    /// Its id.
    pub id: PasswordLinkId,
    /// Whose password it sets.
    pub person_id: PersonId,
    /// When it was made, epoch ms.
    pub created_at_ms: i64,
    /// When it expires, epoch ms.
    pub expires_at_ms: i64,
}

const INSERT_LINK: &str = "
    INSERT INTO password_link (id, person_id, secret_hash, created_at_ms, expires_at_ms, made_by)
    VALUES ($1, $2, $3, $4, $5, $6)";

const SELECT_LINKS: &str = "
    SELECT id, person_id, created_at_ms, expires_at_ms FROM password_link
    WHERE expires_at_ms > $1
      AND NOT EXISTS (SELECT 1 FROM person JOIN hidden_trainee USING (trainee_id)
                      WHERE person.id = password_link.person_id)
      AND (made_by IS NULL
           OR EXISTS (SELECT 1 FROM person AS maker WHERE maker.id = made_by AND maker.role = 'administrator')
           OR EXISTS (SELECT 1 FROM person JOIN visible_trainee USING (trainee_id)
                      WHERE person.id = password_link.person_id AND visible_trainee.role = 'instructor'
                        AND visible_trainee.subject = made_by))
    ORDER BY id DESC";

const SELECT_LINK_OF_SECRET: &str = "
    SELECT id, person_id, created_at_ms, expires_at_ms FROM password_link
    WHERE secret_hash = $1 AND expires_at_ms > $2
      AND NOT EXISTS (SELECT 1 FROM person JOIN hidden_trainee USING (trainee_id)
                      WHERE person.id = password_link.person_id)
      AND (made_by IS NULL
           OR EXISTS (SELECT 1 FROM person AS maker WHERE maker.id = made_by AND maker.role = 'administrator')
           OR EXISTS (SELECT 1 FROM person JOIN visible_trainee USING (trainee_id)
                      WHERE person.id = password_link.person_id AND visible_trainee.role = 'instructor'
                        AND visible_trainee.subject = made_by))";

const SELECT_LINK_PERSON: &str = "
    SELECT id, login, name, role, trainee_id, password_state, created_at_ms FROM person WHERE id = $1";

const DELETE_LINK: &str = "DELETE FROM password_link WHERE id = $1 RETURNING person_id";

pub(super) const DELETE_LINK_OF: &str = "DELETE FROM password_link WHERE person_id = $1";

pub(super) const DELETE_LINKS_MADE_BY: &str = "DELETE FROM password_link WHERE made_by = $1";

pub(super) const DELETE_EXPIRED_LINKS: &str = "DELETE FROM password_link WHERE expires_at_ms <= $1";

pub(super) const DELETE_ALL_LINKS: &str = "DELETE FROM password_link";

impl PasswordLinkStore<'_> {
    /// Makes a link for this person. It replaces the one that the person had, and ends when its maker is no administrator
    /// any more.
    pub async fn create(
        &self,
        scope: &Scope,
        person_id: PersonId,
        secret: SecretHash,
        lifetime: Duration,
    ) -> StoreResult<PasswordLinkRecord> {
        require_administrator(scope, "making links for passwords")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0.write(async move |tx| insert_link(tx, (&scope, now_ms), person_id, secret, lifetime).await).await
    }

    /// All links that are still valid, newest first.
    pub async fn list(&self, scope: &Scope) -> StoreResult<Vec<PasswordLinkRecord>> {
        require_administrator(scope, "the list of links for passwords")?;
        Ok(sqlx::query_as(SELECT_LINKS).bind(self.0.now_ms()).fetch_all(self.0.readers()).await?)
    }

    /// Withdraws a link.
    pub async fn withdraw(&self, scope: &Scope, id: PasswordLinkId) -> StoreResult<()> {
        require_administrator(scope, "withdrawing links for passwords")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let person: Option<PersonId> =
                    sqlx::query_scalar(DELETE_LINK).bind(id).fetch_optional(&mut *tx).await?;
                let person = person.ok_or(not_found("link"))?;
                note(tx, &scope, now_ms, ("withdraw", "password_link"), person).await
            })
            .await
    }

    /// The valid link with this secret, and the person whose password it sets.
    pub async fn look_up(&self, secret: SecretHash) -> StoreResult<Option<(PasswordLinkRecord, PersonRecord)>> {
        let link = sqlx::query_as::<_, PasswordLinkRecord>(SELECT_LINK_OF_SECRET).bind(secret).bind(self.0.now_ms());
        let Some(link) = link.fetch_optional(self.0.readers()).await? else { return Ok(None) };
        let person = sqlx::query_as(SELECT_LINK_PERSON).bind(link.person_id).fetch_optional(self.0.readers()).await?;
        Ok(person.map(|person| (link, person)))
    }

    /// Sets the password of the person whose link has this secret. It ends the person's sign-ins, tokens and the link,
    /// and remembers `places`: the browser and its address. `address` is the client's, for the audit trail. Not found if
    /// the link is not valid any more; then nothing changes.
    pub async fn set_password(
        &self,
        secret: SecretHash,
        password: PasswordHash,
        address: IpAddr,
        places: Vec<SecretHash>,
    ) -> StoreResult<PersonRecord> {
        let now_ms = self.0.now_ms();
        self.0
            .write_ending_sign_ins(async move |tx| {
                let link = sqlx::query_as::<_, PasswordLinkRecord>(SELECT_LINK_OF_SECRET).bind(secret).bind(now_ms);
                let id = link.fetch_optional(&mut *tx).await?.ok_or(not_found("link"))?.person_id;
                let person: PersonRecord = sqlx::query_as(SELECT_LINK_PERSON).bind(id).fetch_one(&mut *tx).await?;
                let scope = person.scope().at_address(address);
                replace_password(tx, (&scope, now_ms), id, (password, PasswordState::Own), None, false).await?;
                remember_places(tx, id, places, now_ms).await?;
                note(tx, &scope, now_ms, ("use", "password_link"), id).await?;
                Ok(PersonRecord { password_state: PasswordState::Own, ..person })
            })
            .await
    }
}

/// Makes a link in place of the one that the account had. The caller has checked that the scope may.
pub(super) async fn insert_link(
    tx: &mut SqliteConnection,
    (scope, created_at_ms): (&Scope, i64),
    person_id: PersonId,
    secret: SecretHash,
    lifetime: Duration,
) -> StoreResult<PasswordLinkRecord> {
    let expires_at_ms = created_at_ms + millis(lifetime).max(1);
    let link = PasswordLinkRecord { id: PasswordLinkId::at(created_at_ms), person_id, created_at_ms, expires_at_ms };
    sqlx::query(DELETE_LINK_OF).bind(person_id).execute(&mut *tx).await?;
    let insert = sqlx::query(INSERT_LINK).bind(link.id).bind(person_id).bind(secret);
    let insert = insert.bind(created_at_ms).bind(expires_at_ms).bind(scope.person());
    insert.execute(&mut *tx).await.map_err(missing("person"))?;
    note(tx, scope, created_at_ms, ("create", "password_link"), person_id).await?;
    Ok(link)
}
