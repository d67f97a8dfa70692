//! Accounts that can sign in. For administrators only, except the functions that sign-in itself needs.

use super::audit::note;
use super::columns::Insert;
use super::cookies::{DELETE_COOKIES_OF, NewSignIn, insert_sign_in};
use super::error::{StoreError, StoreResult, missing, not_found, taken};
use super::page::{Page, PageRequest};
use super::password_links::{DELETE_LINK_OF, DELETE_LINKS_MADE_BY};
use super::tokens::withdraw_tokens;
use super::visibility::{require_administrator, require_sign_in};
use super::{Scope, Store};
use crate::domain::password_state::PasswordState;
use crate::domain::role::Role;
use crate::domain::secret::PasswordHash;
use crate::domain::text::{Key, Login, Name};
use crate::ids::{PersonId, TraineeId};

/// Access to the accounts.
pub struct PersonStore<'s>(pub(super) &'s Store);

/// A person with an account.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct PersonRecord {
    /// Their id.
    pub id: PersonId,
    /// Their login name.
    pub login: Login,
    /// What people call them.
    pub name: Name,
    /// Their role; never [`Role::Agent`].
    pub role: Role,
    /// Their trainee, for [`Role::Trainee`] only.
    pub trainee_id: Option<TraineeId>,
    /// Who chose their password, and whether it must be changed.
    pub password_state: PasswordState,
    /// When the account was made, epoch ms.
    pub created_at_ms: i64,
}

/// A new account.
#[derive(Clone, Debug)]
pub struct NewPerson {
    /// Their login name.
    pub login: Login,
    /// What people call them.
    pub name: Name,
    /// Their role.
    pub role: Role,
    /// The hash of their password; one that no password matches for [`PasswordState::Missing`].
    pub password: PasswordHash,
    /// Who chose it, and whether it must be changed.
    pub password_state: PasswordState,
    /// Their trainee: required for [`Role::Trainee`], refused otherwise.
    pub trainee: Option<TraineeId>,
}

/// Changes to an account; absent fields stay as they are.
#[derive(Clone, Debug, Default)]
pub struct PersonChange {
    /// New login.
    pub login: Option<Login>,
    /// New name.
    pub name: Option<Name>,
    /// New role: administrator or instructor. Refused for a trainee's account.
    pub role: Option<Role>,
    /// The hash of a new password, who chose it, and whether it must be changed.
    pub password: Option<(PasswordHash, PasswordState)>,
    /// With a new password: keep the account's tokens.
    pub keep_tokens: bool,
}

impl PersonChange {
    /// The part of the change that a program with a token may not make: it would give the program another way in, or
    /// shut an administrator out. `None` if a program may make all of it.
    fn needs_sign_in(&self, present: &PersonRecord) -> Option<&'static str> {
        if present.role != Role::Administrator {
            return (self.role == Some(Role::Administrator)).then_some("making an administrator");
        }
        let is_new_login = self.login.as_ref().is_some_and(|login| *login != present.login);
        let is_new_role = self.role.is_some_and(|role| role != present.role);
        (is_new_login || is_new_role || self.password.is_some())
            .then_some("changing the login, role or password of an administrator")
    }
}

impl PersonRecord {
    /// Their scope. To be called only by code that has just verified their identity.
    pub fn scope(&self) -> Scope {
        match (self.role, self.trainee_id) {
            (Role::Administrator, _) => Scope::administrator(self.id),
            (_, Some(trainee)) => Scope::trainee(self.id, trainee),
            // An instructor without groups sees no trainee. The schema allows no person with the role agent.
            (Role::Instructor | Role::Trainee | Role::Agent, None) => Scope::instructor(self.id),
        }
    }
}

const INSERT_PERSON: &str = "
    INSERT INTO person (id, login, name, role, password_hash, password_state, trainee_id, created_at_ms)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8)";

const SELECT_PEOPLE: &str = "
    SELECT id, login, name, role, trainee_id, password_state, created_at_ms FROM person
    WHERE ($1 IS NULL OR login > $1)
      AND NOT EXISTS (SELECT 1 FROM hidden_trainee WHERE hidden_trainee.trainee_id = person.trainee_id)
    ORDER BY login LIMIT $2";

pub(super) const SELECT_PERSON: &str = "
    SELECT id, login, name, role, trainee_id, password_state, created_at_ms FROM person WHERE id = $1";

pub(super) const SELECT_PERSON_OF: &str = "
    SELECT id, login, name, role, trainee_id, password_state, created_at_ms FROM person WHERE trainee_id = $1";

const UPDATE_PERSON: &str = "
    UPDATE person
    SET login = coalesce($2, login), name = coalesce($3, name), role = coalesce($4, role)
    WHERE id = $1
    RETURNING id, login, name, role, trainee_id, password_state, created_at_ms";

const DELETE_PERSON: &str = "DELETE FROM person WHERE id = $1";

const UPDATE_PASSWORD: &str = "
    UPDATE person SET password_hash = $2, password_state = $3 WHERE id = $1 AND ($4 IS NULL OR password_hash = $4)";

const SELECT_BY_LOGIN: &str = "
    SELECT id, login, name, role, trainee_id, password_state, created_at_ms, password_hash FROM person
    WHERE login = $1
      AND NOT EXISTS (SELECT 1 FROM hidden_trainee WHERE hidden_trainee.trainee_id = person.trainee_id)";

const COUNT_PASSWORD: &str = "SELECT count(*) FROM person WHERE password_hash = $1";

const COUNT_PEOPLE: &str = "SELECT count(*) FROM person";

const SELECT_ACCOUNT_OF: &str = "SELECT id FROM person WHERE trainee_id = $1";

/// The administrators who can sign in, with a password or at the provider of single sign-on.
pub(super) const COUNT_ADMINISTRATORS: &str = "
    SELECT count(*) FROM person WHERE role = 'administrator'
    AND (password_state <> 'missing' OR EXISTS (SELECT 1 FROM identity WHERE person_id = person.id))";

impl PersonRecord {
    pub(super) fn insert(&self, password: PasswordHash) -> Insert {
        let insert = sqlx::query(INSERT_PERSON).bind(self.id).bind(&self.login).bind(&self.name).bind(self.role);
        insert.bind(password).bind(self.password_state).bind(self.trainee_id).bind(self.created_at_ms)
    }
}

impl PersonStore<'_> {
    /// Creates an account.
    pub async fn create(&self, scope: &Scope, new: NewPerson) -> StoreResult<PersonRecord> {
        require_administrator(scope, "making accounts")?;
        if new.role == Role::Agent {
            return Err(StoreError::refused("an agent is a program: make a token for it"));
        }
        if (new.role == Role::Trainee) != new.trainee.is_some() {
            return Err(StoreError::refused(
                "an account with the role trainee must name its trainee, and no other account may",
            ));
        }
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        let person = PersonRecord {
            id: PersonId::at(now_ms),
            login: new.login,
            name: new.name,
            role: new.role,
            trainee_id: new.trainee,
            password_state: new.password_state,
            created_at_ms: now_ms,
        };
        self.0
            .write(async move |tx| {
                refuse_second_account(tx, person.trainee_id).await?;
                person.insert(new.password).execute(&mut *tx).await.map_err(taken_or_missing)?;
                note(tx, &scope, now_ms, ("create", "person"), person.id).await?;
                Ok(person)
            })
            .await
    }

    /// All accounts, by login.
    pub async fn list(&self, scope: &Scope, page: &PageRequest) -> StoreResult<Page<PersonRecord>> {
        require_administrator(scope, "the list of accounts")?;
        let rows = sqlx::query_as(SELECT_PEOPLE);
        let rows = rows.bind(page.after()).bind(page.row_limit()).fetch_all(self.0.readers()).await?;
        Ok(Page::from_rows(rows, page, |person: &PersonRecord| person.login.to_string()))
    }

    /// One account: administrators see all of them, other people their own.
    pub async fn get(&self, scope: &Scope, id: PersonId) -> StoreResult<PersonRecord> {
        if !scope.is_administrator() && scope.person() != Some(id) {
            return Err(not_found("person"));
        }
        let person = sqlx::query_as(SELECT_PERSON).bind(id).fetch_optional(self.0.readers()).await?;
        person.ok_or(not_found("person"))
    }

    /// The account of a trainee in the scope, if they have one.
    pub async fn of_trainee(&self, scope: &Scope, trainee: TraineeId) -> StoreResult<Option<PersonRecord>> {
        self.0.trainees().get(scope, &Key::from(&trainee)).await?;
        Ok(sqlx::query_as(SELECT_PERSON_OF).bind(trainee).fetch_optional(self.0.readers()).await?)
    }

    /// Changes an account. The last administrator keeps that role. A new role signs all browsers of the account out,
    /// which also ends their open connections: those were opened with the rights of the old role. It withdraws the
    /// tokens that exceed it, and the links for passwords that a former administrator made. A new password ends what
    /// [`PersonStore::set_password`] says.
    ///
    /// # Errors
    /// A program with a token makes an administrator, or changes the login, role or password of one.
    pub async fn change(&self, scope: &Scope, id: PersonId, change: PersonChange) -> StoreResult<PersonRecord> {
        require_administrator(scope, "changing accounts")?;
        if matches!(change.role, Some(Role::Agent | Role::Trainee)) {
            return Err(StoreError::refused(
                "an account can become an administrator's or an instructor's only: make another account for a \
                 trainee, a token for an agent",
            ));
        }
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write_ending_sign_ins(async move |tx| {
                let present = read_person(tx, id).await?;
                if let Some(what) = change.needs_sign_in(&present) {
                    require_sign_in(&scope, what)?;
                }
                if change.role.is_some() {
                    require_role_may_change(&present)?;
                }
                if change.role.is_some_and(|role| role != present.role) {
                    sqlx::query(DELETE_COOKIES_OF).bind(id).execute(&mut *tx).await?;
                }
                if let Some(new) = change.password {
                    replace_password(tx, (&scope, now_ms), id, new, None, change.keep_tokens).await?;
                    note(tx, &scope, now_ms, ("set password", "person"), id).await?;
                }
                let changed =
                    sqlx::query_as(UPDATE_PERSON).bind(id).bind(change.login).bind(change.name).bind(change.role);
                let person: PersonRecord = changed.fetch_one(&mut *tx).await.map_err(taken("login"))?;
                require_an_administrator(tx).await?;
                if person.role != Role::Administrator {
                    withdraw_tokens(tx, (&scope, now_ms), id, Some(person.role)).await?;
                }
                if present.role == Role::Administrator && person.role != Role::Administrator {
                    sqlx::query(DELETE_LINKS_MADE_BY).bind(id).execute(&mut *tx).await?;
                }
                note(tx, &scope, now_ms, ("change", "person"), id).await?;
                Ok(person)
            })
            .await
    }

    /// Deletes an account with its cookies, its tokens with those that they made, and the links for passwords that it
    /// made. The last administrator cannot be deleted.
    ///
    /// # Errors
    /// A program with a token deletes an administrator.
    pub async fn delete(&self, scope: &Scope, id: PersonId) -> StoreResult<()> {
        require_administrator(scope, "deleting accounts")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write_ending_sign_ins(async move |tx| {
                if read_person(tx, id).await?.role == Role::Administrator {
                    require_sign_in(&scope, "deleting an administrator")?;
                }
                withdraw_tokens(tx, (&scope, now_ms), id, None).await?;
                sqlx::query(DELETE_PERSON).bind(id).execute(&mut *tx).await?;
                require_an_administrator(tx).await?;
                note(tx, &scope, now_ms, ("delete", "person"), id).await
            })
            .await
    }

    /// Sets a password, signs all browsers of the account out, and withdraws its link for a password, and its tokens
    /// with those that they made unless they are to be kept.
    ///
    /// # Errors
    /// A program with a token sets the password of an administrator.
    pub async fn set_password(
        &self,
        scope: &Scope,
        id: PersonId,
        new: (PasswordHash, PasswordState),
        keep_tokens: bool,
    ) -> StoreResult<()> {
        require_administrator(scope, "setting passwords")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write_ending_sign_ins(async move |tx| {
                if read_person(tx, id).await?.role == Role::Administrator {
                    require_sign_in(&scope, "setting the password of an administrator")?;
                }
                replace_password(tx, (&scope, now_ms), id, new, None, keep_tokens).await?;
                note(tx, &scope, now_ms, ("set password", "person"), id).await
            })
            .await
    }

    /// Changes the caller's own password, and ends what [`PersonStore::set_password`] says. Then it signs in the browser
    /// that sent the change, with another cookie: the old one may have been stolen. `verified` is the hash that the old
    /// password matched; the account is not found if it has another password by now.
    ///
    /// # Errors
    /// The caller is a program with a token.
    pub async fn set_own_password(
        &self,
        scope: &Scope,
        new: PasswordHash,
        verified: PasswordHash,
        keep_tokens: bool,
        sign_in: NewSignIn,
    ) -> StoreResult<()> {
        require_sign_in(scope, "changing the own password")?;
        let id = scope.person().ok_or(not_found("person"))?;
        let (scope, now_ms, most) = (scope.clone(), self.0.now_ms(), self.0.sender_limits().sign_ins);
        self.0
            .write_ending_sign_ins(async move |tx| {
                let own = (new.clone(), PasswordState::Own);
                replace_password(tx, (&scope, now_ms), id, own, Some(verified), keep_tokens).await?;
                let person = read_person(tx, id).await?;
                insert_sign_in(tx, (&person, &new), sign_in, most, now_ms).await?;
                note(tx, &scope, now_ms, ("set password", "person"), id).await
            })
            .await
    }

    /// For sign-in: the account with this login and its password's hash.
    pub async fn by_login(&self, login: &Login) -> StoreResult<Option<(PersonRecord, PasswordHash)>> {
        #[derive(sqlx::FromRow)]
        struct LoginRow {
            #[sqlx(flatten)]
            person: PersonRecord,
            password_hash: PasswordHash,
        }
        let row: Option<LoginRow> =
            sqlx::query_as(SELECT_BY_LOGIN).bind(login).fetch_optional(self.0.readers()).await?;
        Ok(row.map(|row| (row.person, row.password_hash)))
    }

    /// True if this is the stored hash of an account's password.
    pub async fn has_password(&self, hash: &PasswordHash) -> StoreResult<bool> {
        let accounts: i64 = sqlx::query_scalar(COUNT_PASSWORD).bind(hash).fetch_one(self.0.readers()).await?;
        Ok(accounts > 0)
    }

    /// The number of accounts: 0 at the first start.
    pub async fn count(&self) -> StoreResult<i64> {
        Ok(sqlx::query_scalar(COUNT_PEOPLE).fetch_one(self.0.readers()).await?)
    }
}

/// The links to accounts at the provider that were made while signed in: a stranger at an open browser may have made one.
const DELETE_OWN_IDENTITIES: &str = "DELETE FROM identity WHERE person_id = $1 AND follows_groups = 0";

/// Sets a password, and ends what could be used with the old one: sign-ins, the link for a password, links to accounts
/// at the provider of single sign-on, and tokens unless they are to be kept. With `verified`, only if that is still the hash of the password. `by`: the caller and the time,
/// epoch ms, for the audit trail.
pub(super) async fn replace_password(
    tx: &mut sqlx::SqliteConnection,
    by: (&Scope, i64),
    id: PersonId,
    (password, state): (PasswordHash, PasswordState),
    verified: Option<PasswordHash>,
    keep_tokens: bool,
) -> StoreResult<()> {
    let set = sqlx::query(UPDATE_PASSWORD).bind(id).bind(password).bind(state).bind(verified);
    if set.execute(&mut *tx).await?.rows_affected() == 0 {
        return Err(not_found("person"));
    }
    sqlx::query(DELETE_COOKIES_OF).bind(id).execute(&mut *tx).await?;
    sqlx::query(DELETE_LINK_OF).bind(id).execute(&mut *tx).await?;
    sqlx::query(DELETE_OWN_IDENTITIES).bind(id).execute(&mut *tx).await?;
    if keep_tokens { Ok(()) } else { withdraw_tokens(tx, by, id, None).await }
}

/// The account as it is in this transaction.
pub(super) async fn read_person(tx: &mut sqlx::SqliteConnection, id: PersonId) -> StoreResult<PersonRecord> {
    let person = sqlx::query_as(SELECT_PERSON).bind(id).fetch_optional(tx).await?;
    person.ok_or(not_found("person"))
}

/// Refuses another role for a trainee's account, which would take the trainee's recordings from the person.
fn require_role_may_change(present: &PersonRecord) -> StoreResult<()> {
    present.trainee_id.map_or(Ok(()), |_| {
        Err(StoreError::refused("the account of a trainee keeps its role: make another account for the person's work"))
    })
}

/// Refuses a second account for a trainee. The check comes before the insert, since SQLite does not say which key an
/// insert violated.
async fn refuse_second_account(tx: &mut sqlx::SqliteConnection, trainee: Option<TraineeId>) -> StoreResult<()> {
    let existing: Option<String> = sqlx::query_scalar(SELECT_ACCOUNT_OF).bind(trainee).fetch_optional(tx).await?;
    existing.map_or(Ok(()), |id| Err(StoreError::Taken { what: "trainee's account", existing: Some(id) }))
}

fn taken_or_missing(error: sqlx::Error) -> StoreError {
    match error.as_database_error() {
        Some(e) if e.is_unique_violation() => taken("login")(error),
        _ => missing("trainee")(error),
    }
}

/// Refuses a change after which no administrator could sign in.
pub(super) async fn require_an_administrator(tx: &mut sqlx::SqliteConnection) -> StoreResult<()> {
    let left: i64 = sqlx::query_scalar(COUNT_ADMINISTRATORS).fetch_one(tx).await?;
    if left > 0 { Ok(()) } else { Err(StoreError::refused("this is the last administrator: create another one first")) }
}
