//! Signed-in browsers: the hash of each cookie and its expiry. Known places: browsers and addresses that have signed in
//! to an account before, or have set its password with a link.

use std::collections::HashSet;
use std::time::Duration;

use sqlx::SqliteConnection;
use sqlx::types::Json;

use super::Store;
use super::error::{StoreResult, ignore_full_or_busy, not_found};
use super::password_links::{DELETE_ALL_LINKS, DELETE_EXPIRED_LINKS};
use super::people::PersonRecord;
use crate::domain::role::Role;
use crate::domain::secret::{PasswordHash, SecretHash};
use crate::ids::PersonId;
use crate::time::millis;

/// Access to the signed-in browsers.
pub struct CookieStore<'s>(pub(super) &'s Store);

/// How long a sign-in lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CookieLifetime {
    /// It ends after this time without a request.
    pub idle: Duration,
    /// It ends after this time even if it is in use.
    pub max_age: Duration,
}

/// From where a browser signs in.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SignInOrigin {
    /// The browser's name as it states it, at most 200 characters.
    pub browser: String,
    /// The client's address.
    pub address: String,
    /// True if one of the service's pages signs in, false for a program.
    pub is_page: bool,
    /// The places to remember: the browser and its address.
    pub places: Vec<SecretHash>,
}

/// A browser to sign in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewSignIn {
    /// The hash of its cookie.
    pub secret: SecretHash,
    /// How long it lasts.
    pub lasts: CookieLifetime,
    /// From where.
    pub origin: SignInOrigin,
}

/// A browser where a person is signed in.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct SignInRecord {
    /// Names it; part of the hash of its secret.
    pub id: String,
    /// The browser's name as it states it; empty if unknown.
    pub browser: String,
    /// The client's address at the sign-in; empty if unknown.
    pub address: String,
    /// When it signed in, epoch ms.
    pub created_at_ms: i64,
    /// Its last request, precise to a minute, epoch ms.
    pub last_seen_at_ms: i64,
    /// True for the browser that asks.
    pub is_current: bool,
}

/// A place is forgotten this long after its last sign-in.
pub const KNOWN_PLACE_LIFETIME: Duration = Duration::from_secs(180 * 86_400);
/// Most places remembered of an account.
const MAX_KNOWN_PLACES: i64 = 100;

/// `last_seen_at_ms` is written only when it is older than this, ms: an fsync for every request would cost too much.
const SEEN_RESOLUTION_MS: i64 = 60_000;

/// The person of a valid cookie.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct CookieHolder {
    /// The person.
    #[sqlx(flatten)]
    pub person: PersonRecord,
    /// True if this sign-in may only change the password.
    pub must_change_password: bool,
    last_seen_at_ms: i64,
}

const INSERT_COOKIE: &str = "
    INSERT INTO cookie_session (secret_hash, person_id, created_at_ms, last_seen_at_ms, expires_at_ms, browser, address,
                                must_change_password)
    SELECT $1, id, $3, $3, $4, $5, $6, $7 FROM person
    WHERE id = $2 AND password_hash = $8
      AND NOT EXISTS (SELECT 1 FROM hidden_trainee WHERE hidden_trainee.trainee_id = person.trainee_id)";

const DELETE_SURPLUS_COOKIES: &str = "
    DELETE FROM cookie_session WHERE person_id = $1 AND secret_hash <> $2 AND secret_hash NOT IN
        (SELECT secret_hash FROM cookie_session WHERE person_id = $1 AND secret_hash <> $2
         ORDER BY last_seen_at_ms DESC, secret_hash LIMIT $3 - 1)";

const SELECT_SIGN_INS: &str = "
    SELECT lower(hex(substr(secret_hash, 1, 8))) AS id, browser, address, created_at_ms, last_seen_at_ms,
           secret_hash IS $4 AS is_current
    FROM cookie_session WHERE person_id = $1 AND expires_at_ms > $2 AND last_seen_at_ms > $3
    ORDER BY last_seen_at_ms DESC, id";

const DELETE_SIGN_IN: &str = "
    DELETE FROM cookie_session WHERE person_id = $1 AND lower(hex(substr(secret_hash, 1, 8))) = $2";

const SELECT_PERSON: &str = "
    SELECT person.id, login, name, role, trainee_id, password_state, person.created_at_ms, must_change_password,
           last_seen_at_ms
    FROM cookie_session JOIN person ON person.id = person_id
    WHERE secret_hash = $1 AND expires_at_ms > $2 AND last_seen_at_ms > $3
      AND NOT EXISTS (SELECT 1 FROM hidden_trainee WHERE hidden_trainee.trainee_id = person.trainee_id)";

const SELECT_VALID: &str = "
    SELECT 1 FROM cookie_session WHERE secret_hash = $1 AND expires_at_ms > $2 AND last_seen_at_ms > $3";

const SELECT_VALID_OF: &str = "
    SELECT secret_hash FROM cookie_session
    WHERE secret_hash IN (SELECT unhex(value) FROM json_each($1)) AND expires_at_ms > $2 AND last_seen_at_ms > $3";

const REMEMBER_PLACE: &str = "
    INSERT INTO known_place (person_id, place_hash, last_used_at_ms) VALUES ($1, $2, $3)
    ON CONFLICT DO UPDATE SET last_used_at_ms = max(last_used_at_ms, excluded.last_used_at_ms)";

const DELETE_SURPLUS_PLACES: &str = "
    DELETE FROM known_place WHERE person_id = $1 AND place_hash NOT IN
        (SELECT place_hash FROM known_place WHERE person_id = $1 ORDER BY last_used_at_ms DESC, place_hash LIMIT $2)";

const SELECT_PLACE: &str = "
    SELECT 1 FROM known_place WHERE person_id = $1 AND place_hash = $2 AND last_used_at_ms > $3";

const DELETE_OLD_PLACES: &str = "DELETE FROM known_place WHERE last_used_at_ms <= $1";

const DELETE_COOKIE: &str = "DELETE FROM cookie_session WHERE secret_hash = $1";

pub(super) const DELETE_COOKIES_OF: &str = "DELETE FROM cookie_session WHERE person_id = $1";

const DELETE_EXPIRED: &str = "DELETE FROM cookie_session WHERE expires_at_ms <= $1";

const DELETE_ALL: &str = "DELETE FROM cookie_session";

const UPDATE_LAST_SEEN: &str = "
    UPDATE cookie_session SET last_seen_at_ms = max($2, last_seen_at_ms) WHERE secret_hash = $1";

impl CookieStore<'_> {
    /// Signs in a browser of this person, and remembers the places that it signs in from. Of a person with too many
    /// sign-ins, the one that was idle longest ends. Instructors and administrators can sign in even on a full disk, in
    /// order to delete something.
    ///
    /// `verified` is the hash that the password matched. If the account has another password by now, or waits for its
    /// erasure, the person is not found: verifying takes a while, and what happens meanwhile must end this sign-in, too.
    pub async fn create(
        &self,
        secret: SecretHash,
        (person, verified): (&PersonRecord, &PasswordHash),
        lasts: CookieLifetime,
        origin: SignInOrigin,
    ) -> StoreResult<()> {
        let (now_ms, most) = (self.0.now_ms(), self.0.sender_limits().sign_ins);
        let new = NewSignIn { secret, lasts, origin };
        let insert = || {
            let (person, verified, new) = (person.clone(), verified.clone(), new.clone());
            async move |tx: &mut SqliteConnection| insert_sign_in(tx, (&person, &verified), new, most, now_ms).await
        };
        match person.role {
            Role::Instructor | Role::Administrator => self.0.write_with_sign_in_reserve(insert).await,
            Role::Trainee | Role::Agent => self.0.write_ending_sign_ins(insert()).await,
        }
    }

    /// The first of these places that has signed in to the account before.
    pub async fn known_place(
        &self,
        person: PersonId,
        places: impl IntoIterator<Item = SecretHash>,
    ) -> StoreResult<Option<SecretHash>> {
        let oldest_ms = self.0.now_ms() - millis(KNOWN_PLACE_LIFETIME);
        for place in places {
            let known = sqlx::query(SELECT_PLACE).bind(person).bind(place).bind(oldest_ms);
            if known.fetch_optional(self.0.readers()).await?.is_some() {
                return Ok(Some(place));
            }
        }
        Ok(None)
    }

    /// The person of this cookie, if it is still valid; records that they were seen.
    pub async fn person_of(&self, secret: SecretHash, lasts: CookieLifetime) -> StoreResult<Option<CookieHolder>> {
        let now_ms = self.0.now_ms();
        let row = sqlx::query_as::<_, CookieHolder>(SELECT_PERSON);
        let row = row.bind(secret).bind(now_ms).bind(now_ms - millis(lasts.idle));
        let Some(row) = row.fetch_optional(self.0.readers()).await? else { return Ok(None) };
        if now_ms - row.last_seen_at_ms > SEEN_RESOLUTION_MS.min(millis(lasts.idle) / 2) {
            ignore_full_or_busy(self.record_seen(secret, now_ms).await)?;
        }
        Ok(Some(row))
    }

    /// True if this cookie is still valid. Does not record that the person was seen: for connections that stay open
    /// unattended.
    pub async fn is_valid(&self, secret: SecretHash, lasts: CookieLifetime) -> StoreResult<bool> {
        let now_ms = self.0.now_ms();
        let row = sqlx::query(SELECT_VALID).bind(secret).bind(now_ms).bind(now_ms - millis(lasts.idle));
        Ok(row.fetch_optional(self.0.readers()).await?.is_some())
    }

    /// Those of these cookies that are still valid, like [`CookieStore::is_valid`].
    pub async fn valid_of(&self, secrets: Vec<SecretHash>, lasts: CookieLifetime) -> StoreResult<HashSet<SecretHash>> {
        if secrets.is_empty() {
            return Ok(HashSet::new());
        }
        let hex = |secret: &SecretHash| secret.0.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        let secrets = Json(secrets.iter().map(hex).collect::<Vec<_>>());
        let now_ms = self.0.now_ms();
        let rows = sqlx::query_scalar::<_, Vec<u8>>(SELECT_VALID_OF);
        let rows =
            rows.bind(secrets).bind(now_ms).bind(now_ms - millis(lasts.idle)).fetch_all(self.0.readers()).await?;
        Ok(rows.into_iter().filter_map(|hash| hash.try_into().ok().map(SecretHash)).collect())
    }

    /// The browsers where this person is signed in, the last used first; `current` is the cookie that asks.
    pub async fn of_person(
        &self,
        person: PersonId,
        current: Option<SecretHash>,
        lasts: CookieLifetime,
    ) -> StoreResult<Vec<SignInRecord>> {
        let now_ms = self.0.now_ms();
        let rows = sqlx::query_as(SELECT_SIGN_INS).bind(person).bind(now_ms).bind(now_ms - millis(lasts.idle));
        Ok(rows.bind(current).fetch_all(self.0.readers()).await?)
    }

    /// Signs out one of this person's browsers.
    pub async fn end(&self, person: PersonId, id: String) -> StoreResult<()> {
        self.0
            .write_ending_sign_ins(async move |tx| {
                let deleted = sqlx::query(DELETE_SIGN_IN).bind(person).bind(id).execute(tx).await?;
                if deleted.rows_affected() == 0 { Err(not_found("sign-in")) } else { Ok(()) }
            })
            .await
    }

    /// Signs out a browser that signs in again. On a full disk the old cookie stays until it is idle for too long.
    pub async fn delete_replaced(&self, secret: SecretHash) -> StoreResult<()> {
        ignore_full_or_busy(self.delete(secret).await)
    }

    /// Signs one browser out; an unknown cookie is no error.
    pub async fn delete(&self, secret: SecretHash) -> StoreResult<()> {
        self.0
            .write_ending_sign_ins(async move |tx| {
                sqlx::query(DELETE_COOKIE).bind(secret).execute(tx).await?;
                Ok(())
            })
            .await
    }

    /// Deletes expired cookies and links for passwords, and places that were not used for long. Idle cookies are
    /// invalid at once, but are deleted only when they expire.
    pub async fn forget_expired(&self) -> StoreResult<u64> {
        let now_ms = self.0.now_ms();
        self.0
            .write(async move |tx| {
                let oldest_ms = now_ms - millis(KNOWN_PLACE_LIFETIME);
                sqlx::query(DELETE_OLD_PLACES).bind(oldest_ms).execute(&mut *tx).await?;
                sqlx::query(DELETE_EXPIRED_LINKS).bind(now_ms).execute(&mut *tx).await?;
                let delete = sqlx::query(DELETE_EXPIRED).bind(now_ms);
                Ok(delete.execute(tx).await?.rows_affected())
            })
            .await
    }

    /// Signs all browsers out, and withdraws all links for passwords.
    pub async fn forget_all(&self) -> StoreResult<()> {
        self.0
            .write_ending_sign_ins(async move |tx| {
                sqlx::query(DELETE_ALL_LINKS).execute(&mut *tx).await?;
                sqlx::query(DELETE_ALL).execute(tx).await?;
                Ok(())
            })
            .await
    }

    async fn record_seen(&self, secret: SecretHash, now_ms: i64) -> StoreResult<()> {
        self.0
            .write(async move |tx| {
                sqlx::query(UPDATE_LAST_SEEN).bind(secret).bind(now_ms).execute(tx).await?;
                Ok(())
            })
            .await
    }
}

/// Signs a browser in, as [`CookieStore::create`] says; `most` is the number of sign-ins that the person may have.
pub(super) async fn insert_sign_in(
    tx: &mut SqliteConnection,
    (person, verified): (&PersonRecord, &PasswordHash),
    sign_in: NewSignIn,
    most: u32,
    now_ms: i64,
) -> StoreResult<()> {
    let must_change = person.password_state.must_change(sign_in.origin.is_page);
    insert_cookie(tx, (person.id, verified, must_change), sign_in, most, now_ms).await
}

/// Signs a browser in to the account `id` if its password still has this hash. `most`: see [`insert_sign_in`].
pub(super) async fn insert_cookie(
    tx: &mut SqliteConnection,
    (id, hash, must_change): (PersonId, &PasswordHash, bool),
    NewSignIn { secret, lasts, origin }: NewSignIn,
    most: u32,
    now_ms: i64,
) -> StoreResult<()> {
    let expires_at_ms = now_ms + millis(lasts.max_age).max(1);
    let insert = sqlx::query(INSERT_COOKIE).bind(secret).bind(id).bind(now_ms).bind(expires_at_ms);
    let insert = insert.bind(origin.browser).bind(origin.address).bind(must_change).bind(hash);
    if insert.execute(&mut *tx).await?.rows_affected() == 0 {
        return Err(not_found("person"));
    }
    sqlx::query(DELETE_SURPLUS_COOKIES).bind(id).bind(secret).bind(most).execute(&mut *tx).await?;
    remember_places(tx, id, origin.places, now_ms).await
}

/// Remembers places that have signed in to this account, or have set its password with a link.
pub(super) async fn remember_places(
    tx: &mut SqliteConnection,
    person: PersonId,
    places: Vec<SecretHash>,
    now_ms: i64,
) -> StoreResult<()> {
    for place in places {
        sqlx::query(REMEMBER_PLACE).bind(person).bind(place).bind(now_ms).execute(&mut *tx).await?;
    }
    sqlx::query(DELETE_SURPLUS_PLACES).bind(person).bind(MAX_KNOWN_PLACES).execute(tx).await?;
    Ok(())
}
