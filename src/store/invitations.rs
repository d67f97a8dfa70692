//! Invitations: the account of a trainee, together with a link for choosing its password. Staff invite the trainees in
//! their scope. An invitation never concerns the account of an administrator or instructor.

use std::time::Duration;

use sqlx::sqlite::SqliteConnection;

use super::audit::note;
use super::codes;
use super::error::{StoreError, StoreResult};
use super::password_links::{PasswordLinkRecord, insert_link};
use super::people::{PersonRecord, SELECT_PERSON_OF};
use super::trainees::{SELECT_TRAINEE, TraineeRecord};
use super::visibility::{BindScope, require_sign_in, require_staff};
use super::{Scope, Store};
use crate::domain::enrolment::{RowProblem, row_problem};
use crate::domain::password_state::PasswordState;
use crate::domain::role::Role;
use crate::domain::secret::{PasswordHash, SecretHash};
use crate::domain::text::{Code, Key, Login, Name};
use crate::ids::{GroupId, PersonId, TraineeId};

/// Access to the invitations.
pub struct InvitationStore<'s>(pub(super) &'s Store);

/// A trainee to invite.
#[derive(Clone, Debug)]
pub struct Invitee {
    /// The trainee, by id or code.
    pub trainee: Key,
    /// The login of the account, if it is made now; derived from the trainee's code without one.
    pub login: Option<Login>,
    /// The hash of the secret of the link.
    pub secret: SecretHash,
}

/// What is common to the invitations of a request.
#[derive(Clone, Debug)]
pub struct InvitationTerms {
    /// A hash that no password matches, for the accounts that are made.
    pub no_password: PasswordHash,
    /// How long a link for the first password is valid.
    pub first: Duration,
    /// How long a link is valid that replaces a password which the trainee has chosen.
    pub replacement: Duration,
    /// Make links for trainees who have chosen a password, too. Otherwise they are left out.
    pub also_with_password: bool,
}

/// An invitation that was made. Its secret is known to the caller only.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InvitationRecord {
    /// The trainee's account.
    pub person: PersonRecord,
    /// The link for its password.
    pub link: PasswordLinkRecord,
    /// Its place in the request.
    pub index: usize,
}

/// The outcome of a request for invitations.
#[derive(Clone, Debug, PartialEq)]
pub enum Invitations {
    /// Made, in the order of the request, without trainees who have a password.
    Made(Vec<InvitationRecord>),
    /// None was made, because of these rows.
    Refused(Vec<RowProblem>),
}

/// How a trainee signs in.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct TraineeAccount {
    /// The trainee.
    pub trainee_id: TraineeId,
    /// Their code.
    pub code: Code,
    /// Their name.
    pub name: Name,
    /// Their account, if they have one.
    pub person_id: Option<PersonId>,
    /// Its login.
    pub login: Option<Login>,
    /// Who chose its password.
    pub password_state: Option<PasswordState>,
    /// When the link for its password expires, epoch ms; `None` without a link that is still valid.
    pub link_expires_at_ms: Option<i64>,
}

const SELECT_ACCOUNTS: &str = "
    SELECT trainee.id AS trainee_id, trainee.code, trainee.name, person.id AS person_id, person.login,
           person.password_state, password_link.expires_at_ms AS link_expires_at_ms
    FROM trainee
    LEFT JOIN person ON person.trainee_id = trainee.id
    LEFT JOIN password_link ON password_link.person_id = person.id AND password_link.expires_at_ms > $3
          AND (made_by IS NULL
               OR EXISTS (SELECT 1 FROM person AS maker WHERE maker.id = made_by AND maker.role = 'administrator')
               OR EXISTS (SELECT 1 FROM visible_trainee AS seen
                          WHERE seen.trainee_id = trainee.id AND seen.role = 'instructor' AND seen.subject = made_by))
    WHERE ($1 = 'administrator'
           OR trainee.id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR trainee.id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($4 IS NULL OR trainee.id IN (SELECT trainee_id FROM group_trainee WHERE group_id = $4))
    ORDER BY trainee.name, trainee.code";

pub(super) const SELECT_LOGIN: &str = "SELECT 1 FROM person WHERE login = $1";

impl InvitationStore<'_> {
    /// How the trainees in the scope sign in, by name; with a group only those of its trainees.
    pub async fn accounts(&self, scope: &Scope, group: Option<GroupId>) -> StoreResult<Vec<TraineeAccount>> {
        require_staff(scope, "the accounts of trainees")?;
        let rows = sqlx::query_as(SELECT_ACCOUNTS).bind_scope(scope).bind(self.0.now_ms()).bind(group);
        Ok(rows.fetch_all(self.0.readers()).await?)
    }

    /// Makes the missing accounts of these trainees, and a link for each password. A new link replaces the one before.
    /// Either all are made or none.
    ///
    /// # Errors
    /// A trainee is not in the scope, or the caller is a program with a token.
    pub async fn create(
        &self,
        scope: &Scope,
        invitees: Vec<Invitee>,
        terms: InvitationTerms,
    ) -> StoreResult<Invitations> {
        require_staff(scope, "inviting trainees")?;
        require_sign_in(scope, "inviting trainees")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write(async move |tx| {
                let mut found = Vec::with_capacity(invitees.len());
                let mut problems = Vec::new();
                for (index, invitee) in invitees.iter().enumerate() {
                    let trainee: Option<TraineeRecord> = sqlx::query_as(SELECT_TRAINEE)
                        .bind_scope(&scope)
                        .bind(&invitee.trainee)
                        .fetch_optional(&mut *tx)
                        .await?;
                    let trainee = trainee.ok_or(StoreError::NotFound { what: "trainee" })?;
                    problems.extend(login_problem(tx, index, trainee.id, invitee.login.as_ref()).await?);
                    found.push(trainee);
                }
                problems.extend(repeated_logins(&invitees));
                if !problems.is_empty() {
                    return Ok(Invitations::Refused(problems));
                }
                let mut made = Vec::new();
                for index in by_given_logins(&invitees) {
                    let (trainee, invitee) = (&found[index], &invitees[index]);
                    let wanted = (invitee.login.clone(), invitee.secret);
                    let invited = invite(tx, (&scope, now_ms), trainee, wanted, &terms).await?;
                    made.extend(invited.map(|(person, link)| InvitationRecord { person, link, index }));
                }
                made.sort_by_key(|invitation| invitation.index);
                Ok(Invitations::Made(made))
            })
            .await
    }
}

/// Given logins come first, derived ones use what is left.
fn by_given_logins(invitees: &[Invitee]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..invitees.len()).collect();
    order.sort_by_key(|index| invitees[*index].login.is_none());
    order
}

fn repeated_logins(invitees: &[Invitee]) -> Vec<RowProblem> {
    let mut met = std::collections::HashSet::new();
    let repeated = invitees.iter().enumerate().filter_map(|(index, invitee)| {
        let login = invitee.login.as_ref()?;
        (!met.insert(login)).then(|| row_problem(index + 1, "login", format!("`{login}` is given twice in this list")))
    });
    repeated.collect()
}

/// Why a login that the request gives cannot be used for this trainee.
async fn login_problem(
    tx: &mut SqliteConnection,
    index: usize,
    trainee: TraineeId,
    login: Option<&Login>,
) -> StoreResult<Option<RowProblem>> {
    let Some(login) = login else { return Ok(None) };
    let account: Option<PersonRecord> = sqlx::query_as(SELECT_PERSON_OF).bind(trainee).fetch_optional(&mut *tx).await?;
    let why = match account {
        Some(account) if account.login == *login => return Ok(None),
        Some(account) => format!("cannot be changed here: the trainee signs in as `{}`", account.login),
        None if is_taken(tx, login).await? => format!("`{login}` is already taken; choose another"),
        None => return Ok(None),
    };
    Ok(Some(row_problem(index + 1, "login", why)))
}

/// True if an account has this login.
pub(super) async fn is_taken(tx: &mut SqliteConnection, login: &Login) -> StoreResult<bool> {
    let found: Option<i64> = sqlx::query_scalar(SELECT_LOGIN).bind(login).fetch_optional(tx).await?;
    Ok(found.is_some())
}

const SELECT_HAS_IDENTITY: &str = "SELECT EXISTS (SELECT 1 FROM identity WHERE person_id = $1)";

/// Makes the account of a trainee if it is missing, and a link for its password. `None`: the trainee has chosen a
/// password or signs in with the provider of single sign-on, and the terms leave such trainees out. The caller has checked that the trainee is in the scope.
pub(super) async fn invite(
    tx: &mut SqliteConnection,
    (scope, now_ms): (&Scope, i64),
    trainee: &TraineeRecord,
    (login, secret): (Option<Login>, SecretHash),
    terms: &InvitationTerms,
) -> StoreResult<Option<(PersonRecord, PasswordLinkRecord)>> {
    let account: Option<PersonRecord> =
        sqlx::query_as(SELECT_PERSON_OF).bind(trainee.id).fetch_optional(&mut *tx).await?;
    let person = match account {
        Some(account) => account,
        None => make_account(tx, (scope, now_ms), trainee, login, terms).await?,
    };
    if person.role != Role::Trainee {
        return Err(StoreError::NotFound { what: "trainee" }); // the schema's CHECK allows no other role
    }
    let has_identity: bool = sqlx::query_scalar(SELECT_HAS_IDENTITY).bind(person.id).fetch_one(&mut *tx).await?;
    let can_sign_in = person.password_state != PasswordState::Missing || has_identity;
    if can_sign_in && !terms.also_with_password {
        return Ok(None);
    }
    let lifetime = if can_sign_in { terms.replacement } else { terms.first };
    let link = insert_link(tx, (scope, now_ms), person.id, secret, lifetime).await?;
    Ok(Some((person, link)))
}

async fn make_account(
    tx: &mut SqliteConnection,
    (scope, now_ms): (&Scope, i64),
    trainee: &TraineeRecord,
    login: Option<Login>,
    terms: &InvitationTerms,
) -> StoreResult<PersonRecord> {
    let login = match login {
        Some(login) => login,
        None => free_login(tx, &trainee.code).await?,
    };
    let person = PersonRecord {
        id: PersonId::at(now_ms),
        login,
        name: trainee.name.clone(),
        role: Role::Trainee,
        trainee_id: Some(trainee.id),
        password_state: PasswordState::Missing,
        created_at_ms: now_ms,
    };
    person.insert(terms.no_password.clone()).execute(&mut *tx).await.map_err(super::error::taken("login"))?;
    note(tx, scope, now_ms, ("create", "person"), person.id).await?;
    Ok(person)
}

/// A free login: the code of the trainee, which people know already, with a number if it is taken.
async fn free_login(tx: &mut SqliteConnection, code: &Code) -> StoreResult<Login> {
    let free = codes::free(tx, SELECT_LOGIN, code.clone()).await?;
    let login = free.as_str().parse::<Login>();
    login.map_err(|_| StoreError::refused(format!("no login like `{code}` is free: enter one yourself")))
}
