//! Accounts at providers of single sign-on, and the people who sign in with them.
//!
//! Only issuer and subject find a person, never a login or an e-mail address: those of another person can be taken at a
//! provider. An identity that made its account here decides its role at each sign-in. One that was linked to an account
//! of this centre only signs in: the role stays as administrators set it here.

use std::net::IpAddr;

use sqlx::SqliteConnection;

use super::audit::note;
use super::columns::Insert;
use super::cookies::{DELETE_COOKIES_OF, NewSignIn, insert_cookie};
use super::error::{StoreError, StoreResult, not_found, taken};
use super::password_links::{DELETE_LINK_OF, DELETE_LINKS_MADE_BY};
use super::people::{COUNT_ADMINISTRATORS, PersonRecord, read_person, require_an_administrator};
use super::tokens::withdraw_tokens;
use super::trainees::{SELECT_CODE, TraineeRecord, insert as insert_trainee};
use super::visibility::{require_administrator, require_sign_in};
use super::{Scope, Store, codes};
use crate::domain::password_state::PasswordState;
use crate::domain::role::Role;
use crate::domain::secret::{PasswordHash, SecretHash};
use crate::domain::single_sign_on::{ProvenIdentity, numbered_login};
use crate::domain::text::{Login, Name};
use crate::ids::{IdentityId, PersonId, TraineeId};

/// Access to the identities.
pub struct IdentityStore<'s>(pub(super) &'s Store);

/// An account at a provider, and the person who signs in with it.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct IdentityRecord {
    /// Its id.
    pub id: IdentityId,
    /// Address of the provider.
    pub issuer: String,
    /// The account's id at the provider.
    pub subject: String,
    /// Who signs in with it.
    pub person_id: PersonId,
    /// The account's name at the provider, at its last use.
    pub label: Name,
    /// True if it made the account here, whose role follows its groups.
    pub follows_groups: bool,
    /// When it was linked, epoch ms.
    pub created_at_ms: i64,
    /// When it last signed in, epoch ms.
    pub last_used_at_ms: Option<i64>,
}

/// A browser to sign in with a provider.
#[derive(Clone, Debug)]
pub struct NewProviderSignIn {
    /// The browser.
    pub sign_in: NewSignIn,
    /// The client's address, for the audit trail.
    pub address: IpAddr,
    /// The ID token, for the sign-out at the provider.
    pub id_token: String,
    /// Whether an unknown person with a role gets an account.
    pub make_accounts: bool,
    /// For a new account: a hash that no password matches.
    pub unmatchable: PasswordHash,
}

/// Why a person who is signed in at the provider is not signed in here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IdentityRefusal {
    /// No group of the person gives a role.
    NoGroup,
    /// The person has no account, and none is made.
    NoAccount,
    /// The groups make staff of a trainee, or the reverse.
    RoleChanged,
    /// The person waits for the erasure.
    BeingErased,
}

/// Longest ID token that is kept, bytes, as the schema has it.
const MAX_ID_TOKEN_BYTES: usize = 8192;
/// Most logins that are tried for a new account.
const MAX_LOGINS: u32 = 1000;

const INSERT_IDENTITY: &str = "
    INSERT INTO identity (id, issuer, subject, person_id, label, follows_groups, created_at_ms, last_used_at_ms)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8)";

const SELECT_IDENTITY: &str = "
    SELECT id, issuer, subject, person_id, label, follows_groups, created_at_ms, last_used_at_ms FROM identity
    WHERE issuer = $1 AND subject = $2";

const SELECT_IDENTITIES: &str = "
    SELECT id, issuer, subject, person_id, label, follows_groups, created_at_ms, last_used_at_ms FROM identity
    WHERE NOT EXISTS (SELECT 1 FROM person JOIN hidden_trainee USING (trainee_id)
                      WHERE person.id = identity.person_id)
    ORDER BY id DESC";

const SELECT_IDENTITIES_OF: &str = "
    SELECT id, issuer, subject, person_id, label, follows_groups, created_at_ms, last_used_at_ms FROM identity
    WHERE person_id = $1 ORDER BY id DESC";

const UPDATE_USED: &str = "UPDATE identity SET last_used_at_ms = $2, label = $3 WHERE id = $1";

const DELETE_IDENTITY: &str = "DELETE FROM identity WHERE id = $1 RETURNING person_id";

const DELETE_OWN_IDENTITY: &str = "DELETE FROM identity WHERE id = $1 AND person_id = $2";

const SELECT_PENDING: &str = "SELECT 1 FROM hidden_trainee WHERE trainee_id = $1";

/// The account of the record that `$1` was merged into.
const SELECT_KEPT_ACCOUNT: &str = "
    SELECT id, login, name, role, trainee_id, password_state, created_at_ms FROM person
    WHERE trainee_id = (SELECT kept_id FROM merged_trainee WHERE merged_trainee.trainee_id = $1)";

const SELECT_LOGIN: &str = "SELECT 1 FROM person WHERE login = $1";

const SELECT_PASSWORD: &str = "SELECT password_hash FROM person WHERE id = $1";

const UPDATE_ROLE: &str = "UPDATE person SET role = $2 WHERE id = $1";

const UPDATE_COOKIE: &str = "UPDATE cookie_session SET identity_id = $2, id_token = $3 WHERE secret_hash = $1";

const SELECT_IDENTITY_OF_COOKIE: &str = "SELECT identity_id FROM cookie_session WHERE secret_hash = $1";

const DELETE_COOKIE: &str = "DELETE FROM cookie_session WHERE secret_hash = $1 RETURNING identity_id, id_token";

impl IdentityRecord {
    fn insert(&self) -> Insert {
        let insert = sqlx::query(INSERT_IDENTITY).bind(self.id).bind(self.issuer.clone()).bind(self.subject.clone());
        let insert = insert.bind(self.person_id).bind(self.label.clone()).bind(self.follows_groups);
        insert.bind(self.created_at_ms).bind(self.last_used_at_ms)
    }
}

impl IdentityStore<'_> {
    /// Signs in a browser of the person of this identity. An unknown person with a role gets an account if
    /// `new` says so; an account that an identity made gets the role of its groups. Without a role, such an account
    /// loses its other sign-ins and its tokens, too.
    pub async fn sign_in(
        &self,
        identity: ProvenIdentity,
        new: NewProviderSignIn,
    ) -> StoreResult<Result<PersonRecord, IdentityRefusal>> {
        let (now_ms, most) = (self.0.now_ms(), self.0.sender_limits().sign_ins);
        let work = || {
            let (identity, new) = (identity.clone(), new.clone());
            async move |tx: &mut SqliteConnection| sign_in(tx, identity, new, most, now_ms).await
        };
        match identity.role {
            // They can sign in even on a full disk, in order to delete something.
            Some(Role::Administrator | Role::Instructor) => self.0.write_with_sign_in_reserve(work).await,
            _ => self.0.write_ending_sign_ins(work()).await,
        }
    }

    /// Links this identity to the calling person.
    ///
    /// # Errors
    /// It belongs to another person, or the person has another identity of this provider.
    pub async fn link(&self, scope: &Scope, identity: ProvenIdentity) -> StoreResult<IdentityRecord> {
        require_sign_in(scope, "linking an account of single sign-on")?;
        let person_id = scope.person().ok_or(not_found("person"))?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let ProvenIdentity { issuer, subject, label, .. } = identity;
                match find(tx, &issuer, &subject).await? {
                    Some(found) if found.person_id == person_id => return Ok(found),
                    Some(_) => return Err(StoreError::Taken { what: "account of single sign-on", existing: None }),
                    None => {}
                }
                let own: Vec<IdentityRecord> =
                    sqlx::query_as(SELECT_IDENTITIES_OF).bind(person_id).fetch_all(&mut *tx).await?;
                if own.iter().any(|own| own.issuer == issuer) {
                    return Err(StoreError::refused(
                        "your account is linked to another account of this provider: remove that link first",
                    ));
                }
                let id = IdentityId::at(now_ms);
                let (follows_groups, created_at_ms, last_used_at_ms) = (false, now_ms, None);
                let made = IdentityRecord {
                    id,
                    issuer,
                    subject,
                    person_id,
                    label,
                    follows_groups,
                    created_at_ms,
                    last_used_at_ms,
                };
                made.insert().execute(&mut *tx).await.map_err(taken("account of single sign-on"))?;
                note(tx, &scope, now_ms, ("link", "identity"), person_id).await?;
                Ok(made)
            })
            .await
    }

    /// All identities, newest first.
    pub async fn list(&self, scope: &Scope) -> StoreResult<Vec<IdentityRecord>> {
        require_administrator(scope, "the list of accounts of single sign-on")?;
        Ok(sqlx::query_as(SELECT_IDENTITIES).fetch_all(self.0.readers()).await?)
    }

    /// The identities of one person: administrators see all of them, other people their own.
    pub async fn of_person(&self, scope: &Scope, person: PersonId) -> StoreResult<Vec<IdentityRecord>> {
        if !scope.is_administrator() && scope.person() != Some(person) {
            return Err(not_found("person"));
        }
        Ok(sqlx::query_as(SELECT_IDENTITIES_OF).bind(person).fetch_all(self.0.readers()).await?)
    }

    /// Removes a link, and ends the sign-ins that were made with it.
    ///
    /// # Errors
    /// No administrator could sign in any more.
    pub async fn remove(&self, scope: &Scope, id: IdentityId) -> StoreResult<()> {
        require_administrator(scope, "removing accounts of single sign-on")?;
        require_sign_in(scope, "removing accounts of single sign-on")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write_ending_sign_ins(async move |tx| {
                let person: Option<PersonId> =
                    sqlx::query_scalar(DELETE_IDENTITY).bind(id).fetch_optional(&mut *tx).await?;
                let person = person.ok_or(not_found("identity"))?;
                require_an_administrator(tx).await?;
                note(tx, &scope, now_ms, ("unlink", "identity"), person).await
            })
            .await
    }

    /// Removes a link of the calling person, and ends the sign-ins that were made with it.
    ///
    /// # Errors
    /// The person has no password, and could not sign in any more.
    pub async fn remove_own(&self, scope: &Scope, id: IdentityId) -> StoreResult<()> {
        require_sign_in(scope, "removing the own account of single sign-on")?;
        let person = scope.person().ok_or(not_found("identity"))?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write_ending_sign_ins(async move |tx| {
                let delete = sqlx::query(DELETE_OWN_IDENTITY).bind(id).bind(person);
                if delete.execute(&mut *tx).await?.rows_affected() == 0 {
                    return Err(not_found("identity"));
                }
                if read_person(tx, person).await?.password_state == PasswordState::Missing {
                    return Err(StoreError::refused(
                        "your account has no password, so you could not sign in without this link: ask an \
                         administrator for a password link first",
                    ));
                }
                note(tx, &scope, now_ms, ("unlink", "identity"), person).await
            })
            .await
    }

    /// Whether this cookie was signed in with a provider.
    pub async fn is_provider_sign_in(&self, secret: SecretHash) -> StoreResult<bool> {
        let found: Option<Option<IdentityId>> =
            sqlx::query_scalar(SELECT_IDENTITY_OF_COOKIE).bind(secret).fetch_optional(self.0.readers()).await?;
        Ok(found.flatten().is_some())
    }

    /// Signs this browser out. `Some` if it was signed in with a provider: its ID token, if that was kept.
    pub async fn sign_out(&self, secret: SecretHash) -> StoreResult<Option<Option<String>>> {
        self.0
            .write_ending_sign_ins(async move |tx| {
                let deleted: Option<(Option<IdentityId>, Option<String>)> =
                    sqlx::query_as(DELETE_COOKIE).bind(secret).fetch_optional(tx).await?;
                Ok(deleted.and_then(|(identity, token)| identity.map(|_| token)))
            })
            .await
    }
}

async fn find(tx: &mut SqliteConnection, issuer: &str, subject: &str) -> StoreResult<Option<IdentityRecord>> {
    let found = sqlx::query_as(SELECT_IDENTITY).bind(issuer.to_owned()).bind(subject.to_owned());
    Ok(found.fetch_optional(tx).await?)
}

async fn sign_in(
    tx: &mut SqliteConnection,
    identity: ProvenIdentity,
    new: NewProviderSignIn,
    most: u32,
    now_ms: i64,
) -> StoreResult<Result<PersonRecord, IdentityRefusal>> {
    let found = find(tx, &identity.issuer, &identity.subject).await?;
    let by = (new.address, now_ms);
    let admitted = match (found, identity.role) {
        (Some(found), role) => admit(tx, found, role, by).await?,
        (None, None) => Err(IdentityRefusal::NoGroup),
        (None, Some(_)) if !new.make_accounts => Err(IdentityRefusal::NoAccount),
        (None, Some(role)) => Ok(make_account(tx, &identity, role, new.unmatchable, by).await?),
    };
    let (person, id) = match admitted {
        Ok(admitted) => admitted,
        Err(refusal) => return Ok(Err(refusal)),
    };
    sqlx::query(UPDATE_USED).bind(id).bind(now_ms).bind(identity.label).execute(&mut *tx).await?;
    let hash: PasswordHash = sqlx::query_scalar(SELECT_PASSWORD).bind(person.id).fetch_one(&mut *tx).await?;
    let secret = new.sign_in.secret;
    // The person proved who they are without the password, so it need not be changed for this sign-in.
    insert_cookie(tx, (person.id, &hash, false), new.sign_in, most, now_ms).await?;
    let id_token = Some(new.id_token).filter(|token| token.len() <= MAX_ID_TOKEN_BYTES);
    sqlx::query(UPDATE_COOKIE).bind(secret).bind(id).bind(id_token).execute(tx).await?;
    Ok(Ok(person))
}

/// The person of a known identity, with the role of its groups. The closed account of a merged record opens that of the
/// kept one.
async fn admit(
    tx: &mut SqliteConnection,
    found: IdentityRecord,
    role: Option<Role>,
    (address, now_ms): (IpAddr, i64),
) -> StoreResult<Result<(PersonRecord, IdentityId), IdentityRefusal>> {
    let person = read_person(tx, found.person_id).await?;
    let kept: Option<PersonRecord> =
        sqlx::query_as(SELECT_KEPT_ACCOUNT).bind(person.trainee_id).fetch_optional(&mut *tx).await?;
    let person = kept.unwrap_or(person);
    let scope = person.scope().at_address(address);
    let is_pending = sqlx::query(SELECT_PENDING).bind(person.trainee_id).fetch_optional(&mut *tx).await?.is_some();
    if is_pending {
        return Ok(Err(IdentityRefusal::BeingErased));
    }
    let refusal = match role {
        None => IdentityRefusal::NoGroup,
        Some(role) if !found.follows_groups || role == person.role => return Ok(Ok((person, found.id))),
        Some(role) if role != Role::Trainee && person.role != Role::Trainee => {
            return Ok(Ok((change_role(tx, person, role, (&scope, now_ms)).await?, found.id)));
        }
        Some(_) => IdentityRefusal::RoleChanged,
    };
    if found.follows_groups && is_last_administrator(tx, &person).await? {
        return Ok(Ok((person, found.id)));
    }
    if found.follows_groups {
        sqlx::query(DELETE_COOKIES_OF).bind(person.id).execute(&mut *tx).await?;
        sqlx::query(DELETE_LINK_OF).bind(person.id).execute(&mut *tx).await?;
        sqlx::query(DELETE_LINKS_MADE_BY).bind(person.id).execute(&mut *tx).await?;
        withdraw_tokens(tx, (&scope, now_ms), person.id, None).await?;
    }
    note(tx, &scope, now_ms, ("refuse", "identity"), person.id).await?;
    Ok(Err(refusal))
}

/// Gives an account of staff the other role of staff, and ends what exceeds it. The last administrator keeps the role:
/// otherwise the centre would have none.
async fn change_role(
    tx: &mut SqliteConnection,
    person: PersonRecord,
    role: Role,
    (scope, now_ms): (&Scope, i64),
) -> StoreResult<PersonRecord> {
    if is_last_administrator(tx, &person).await? {
        return Ok(person);
    }
    sqlx::query(UPDATE_ROLE).bind(person.id).bind(role).execute(&mut *tx).await?;
    sqlx::query(DELETE_COOKIES_OF).bind(person.id).execute(&mut *tx).await?;
    if role != Role::Administrator {
        withdraw_tokens(tx, (scope, now_ms), person.id, Some(role)).await?;
        sqlx::query(DELETE_LINKS_MADE_BY).bind(person.id).execute(&mut *tx).await?;
    }
    note(tx, scope, now_ms, ("change role", "person"), person.id).await?;
    Ok(PersonRecord { role, ..person })
}

/// True for the only administrator, who keeps the role and the access without the groups at the provider.
async fn is_last_administrator(tx: &mut SqliteConnection, person: &PersonRecord) -> StoreResult<bool> {
    let administrators: i64 = sqlx::query_scalar(COUNT_ADMINISTRATORS).fetch_one(&mut *tx).await?;
    let is_last = person.role == Role::Administrator && administrators == 1;
    if is_last {
        tracing::warn!(person = %person.id, "last administrator keeps the role; the groups at the provider do not give it");
    }
    Ok(is_last)
}

/// Makes an account, and for a trainee the trainee, for this identity.
async fn make_account(
    tx: &mut SqliteConnection,
    identity: &ProvenIdentity,
    role: Role,
    unmatchable: PasswordHash,
    (address, now_ms): (IpAddr, i64),
) -> StoreResult<(PersonRecord, IdentityId)> {
    let trainee = match role {
        Role::Trainee => Some(new_trainee(tx, &identity.name, now_ms).await?),
        _ => None,
    };
    let person = PersonRecord {
        id: PersonId::at(now_ms),
        login: free_login(tx, &identity.login).await?,
        name: identity.name.clone(),
        role,
        trainee_id: trainee,
        password_state: PasswordState::Missing,
        created_at_ms: now_ms,
    };
    person.insert(unmatchable).execute(&mut *tx).await.map_err(taken("login"))?;
    let made = IdentityRecord {
        id: IdentityId::at(now_ms),
        issuer: identity.issuer.clone(),
        subject: identity.subject.clone(),
        person_id: person.id,
        label: identity.label.clone(),
        follows_groups: true,
        created_at_ms: now_ms,
        last_used_at_ms: None,
    };
    made.insert().execute(&mut *tx).await.map_err(taken("account of single sign-on"))?;
    let scope = person.scope().at_address(address);
    if let Some(trainee) = trainee {
        note(tx, &scope, now_ms, ("create", "trainee"), trainee).await?;
    }
    note(tx, &scope, now_ms, ("create", "person"), person.id).await?;
    note(tx, &scope, now_ms, ("link", "identity"), person.id).await?;
    Ok((person, made.id))
}

/// Registers a trainee in no group: staff add the trainee to theirs.
async fn new_trainee(tx: &mut SqliteConnection, name: &Name, now_ms: i64) -> StoreResult<TraineeId> {
    let trainee = TraineeRecord {
        id: TraineeId::at(now_ms),
        code: codes::choose(tx, SELECT_CODE, None, name, "trainee").await?,
        name: name.clone(),
        level: None,
        handedness: None,
        created_at_ms: now_ms,
        is_in_several_groups: false,
    };
    insert_trainee(tx, &trainee).await?;
    Ok(trainee.id)
}

/// This login, or the first free one with a number.
async fn free_login(tx: &mut SqliteConnection, wanted: &Login) -> StoreResult<Login> {
    for number in 1..=MAX_LOGINS {
        let login = if number == 1 { wanted.clone() } else { numbered_login(wanted, number) };
        if sqlx::query(SELECT_LOGIN).bind(&login).fetch_optional(&mut *tx).await?.is_none() {
            return Ok(login);
        }
    }
    Err(StoreError::refused(format!("all logins like `{wanted}` are taken: ask an administrator for an account")))
}
