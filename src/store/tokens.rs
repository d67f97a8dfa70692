//! Access tokens of programs. A token acts as the person who made it, with at most their rights, or as the agent of one
//! box.

use sqlx::sqlite::SqliteConnection;

use super::audit::note;
use super::columns::Insert;
use super::error::{StoreError, StoreResult, ignore_full_or_busy, missing, not_found};
use super::visibility::{require_administrator, require_sign_in};
use super::{Scope, Store};
use crate::domain::role::Role;
use crate::domain::scope::CallingToken;
use crate::domain::secret::SecretHash;
use crate::domain::text::Name;
use crate::ids::{BoxId, PersonId, TokenId, TraineeId};

/// Access to the tokens.
pub struct TokenStore<'s>(pub(super) &'s Store);

/// A token without its secret, which is not stored.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct TokenRecord {
    /// Its id.
    pub id: TokenId,
    /// Its purpose, for people.
    pub name: Name,
    /// Its role.
    pub role: Role,
    /// The person that it acts as; `None` for an agent.
    pub person_id: Option<PersonId>,
    /// The agent's box.
    pub box_id: Option<BoxId>,
    /// The token that made it; `None`: a person who was signed in, or a command.
    pub made_with: Option<TokenId>,
    /// When it was made, epoch ms.
    pub created_at_ms: i64,
    /// When it expires, epoch ms.
    pub expires_at_ms: Option<i64>,
    /// Its last request, precise to a minute, epoch ms.
    pub last_used_at_ms: Option<i64>,
}

/// A token to create.
#[derive(Clone, Debug)]
pub struct NewToken {
    /// Its purpose, for people.
    pub name: Name,
    /// Who it acts as.
    pub acts_as: ActsAs,
    /// When it expires, epoch ms; `None`: it is valid until it is deleted.
    pub expires_at_ms: Option<i64>,
    /// The hash of its secret.
    pub secret: SecretHash,
}

/// Who a token acts as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ActsAs {
    /// As a person, in that person's role; a token for an administrator may also have a lesser role.
    Person(PersonId, Role),
    /// As the agent of a box.
    Agent(BoxId),
}

/// `last_used_at_ms` is written only when it is older than this, ms.
const USED_RESOLUTION_MS: i64 = 60_000;

#[derive(sqlx::FromRow)]
struct TokenScopeRow {
    #[sqlx(flatten)]
    token: TokenRecord,
    trainee_id: Option<TraineeId>,
}

const INSERT_TOKEN: &str = "
    INSERT INTO token (id, secret_hash, name, role, person_id, box_id, made_with, created_at_ms, expires_at_ms)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9)";

const SELECT_TOKENS: &str = "
    SELECT id, name, role, person_id, box_id, made_with, created_at_ms, expires_at_ms, last_used_at_ms FROM token
    WHERE NOT EXISTS (SELECT 1 FROM person JOIN hidden_trainee ON hidden_trainee.trainee_id = person.trainee_id
                      WHERE person.id = token.person_id)
    ORDER BY id DESC";

const SELECT_TOKENS_OF: &str = "
    SELECT id, name, role, person_id, box_id, made_with, created_at_ms, expires_at_ms, last_used_at_ms FROM token
    WHERE person_id = $1 ORDER BY id DESC";

const DELETE_OWN_TOKEN: &str = "DELETE FROM token WHERE id = $1 AND person_id = $2";

/// With NULL for `$2` it deletes all of them.
const DELETE_TOKENS_OF: &str = "DELETE FROM token WHERE person_id = $1 AND role IS NOT $2";

const COUNT_TOKENS: &str = "SELECT count(*) FROM token";

const DELETE_TOKEN: &str = "DELETE FROM token WHERE id = $1";

const SELECT_OWN_OR_MADE: &str = "SELECT 1 FROM token WHERE id = $1 AND $2 IN (id, made_with)";

const SELECT_TOKEN_SCOPE: &str = "
    SELECT token.id, token.name, token.role, person_id, box_id, made_with, token.created_at_ms, expires_at_ms,
           last_used_at_ms, person.trainee_id
    FROM token
    LEFT JOIN person ON person.id = person_id
    WHERE secret_hash = $1 AND (expires_at_ms IS NULL OR expires_at_ms > $2)
      AND (token.role IN ('agent', person.role) OR person.role = 'administrator')
      AND NOT EXISTS (SELECT 1 FROM hidden_trainee WHERE hidden_trainee.trainee_id = person.trainee_id)";

const UPDATE_LAST_USED: &str = "
    UPDATE token SET last_used_at_ms = max($2, coalesce(last_used_at_ms, $2)) WHERE id = $1";

const SELECT_EXPIRY: &str = "SELECT expires_at_ms FROM token WHERE secret_hash = $1";

const SELECT_AGENT_EXPIRY: &str = "
    SELECT expires_at_ms FROM token WHERE box_id = $1 AND last_used_at_ms IS NOT NULL
    ORDER BY last_used_at_ms DESC, id DESC LIMIT 1";

const SELECT_ROLE: &str = "SELECT role FROM person WHERE id = $1";

impl TokenRecord {
    fn insert(&self, secret: SecretHash) -> Insert {
        let insert = sqlx::query(INSERT_TOKEN).bind(self.id).bind(secret).bind(&self.name).bind(self.role);
        let insert = insert.bind(self.person_id).bind(self.box_id).bind(self.made_with);
        insert.bind(self.created_at_ms).bind(self.expires_at_ms)
    }
}

impl TokenStore<'_> {
    /// Makes a token. If another token makes it, it is withdrawn together with that one.
    pub async fn create(&self, scope: &Scope, new: NewToken) -> StoreResult<TokenRecord> {
        require_administrator(scope, "making tokens")?;
        let (role, person_id, box_id) = match new.acts_as {
            ActsAs::Person(_, Role::Agent) => return Err(StoreError::refused("an agent's token names its box")),
            ActsAs::Person(person, role) => (role, Some(person), None),
            ActsAs::Agent(of) => (Role::Agent, None, Some(of)),
        };
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        if new.expires_at_ms.is_some_and(|end| end <= now_ms) {
            return Err(StoreError::refused("the token would have expired already"));
        }
        let token = TokenRecord {
            id: TokenId::at(now_ms),
            name: new.name,
            role,
            person_id,
            box_id,
            made_with: scope.token().map(|token| token.id),
            created_at_ms: now_ms,
            expires_at_ms: new.expires_at_ms,
            last_used_at_ms: None,
        };
        self.0
            .write(async move |tx| {
                require_rights(tx, new.acts_as).await?;
                token.insert(new.secret).execute(&mut *tx).await.map_err(missing("box or person"))?;
                note(tx, &scope, now_ms, ("create", "token"), token.id).await?;
                Ok(token)
            })
            .await
    }

    /// All tokens, newest first.
    pub async fn list(&self, scope: &Scope) -> StoreResult<Vec<TokenRecord>> {
        require_administrator(scope, "the list of tokens")?;
        Ok(sqlx::query_as(SELECT_TOKENS).fetch_all(self.0.readers()).await?)
    }

    /// The tokens that act as the calling person, newest first.
    pub async fn of_person(&self, scope: &Scope) -> StoreResult<Vec<TokenRecord>> {
        Ok(sqlx::query_as(SELECT_TOKENS_OF).bind(scope.person()).fetch_all(self.0.readers()).await?)
    }

    /// Withdraws a token that acts as the calling person, and those that it made.
    pub async fn delete_own(&self, scope: &Scope, id: TokenId) -> StoreResult<()> {
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write_ending_sign_ins(async move |tx| {
                require_own_or_made(tx, &scope, id).await?;
                let delete = sqlx::query(DELETE_OWN_TOKEN).bind(id).bind(scope.person());
                if delete.execute(&mut *tx).await?.rows_affected() == 0 {
                    return Err(not_found("token"));
                }
                note(tx, &scope, now_ms, ("delete", "token"), id).await
            })
            .await
    }

    /// Withdraws a token, and those that it made.
    pub async fn delete(&self, scope: &Scope, id: TokenId) -> StoreResult<()> {
        require_administrator(scope, "deleting tokens")?;
        let (scope, now_ms) = (scope.clone(), self.0.now_ms());
        self.0
            .write_ending_sign_ins(async move |tx| {
                require_own_or_made(tx, &scope, id).await?;
                let deleted = sqlx::query(DELETE_TOKEN).bind(id).execute(&mut *tx).await?;
                if deleted.rows_affected() == 0 {
                    return Err(not_found("token"));
                }
                note(tx, &scope, now_ms, ("delete", "token"), id).await
            })
            .await
    }

    /// The scope of this token, if it is still valid; records that it was used. A token never has more rights than its
    /// person has today.
    pub async fn scope_of(&self, secret: SecretHash) -> StoreResult<Option<Scope>> {
        let now_ms = self.0.now_ms();
        let row = sqlx::query_as::<_, TokenScopeRow>(SELECT_TOKEN_SCOPE);
        let Some(row) = row.bind(secret).bind(now_ms).fetch_optional(self.0.readers()).await? else { return Ok(None) };
        if row.token.last_used_at_ms.is_none_or(|used| now_ms - used > USED_RESOLUTION_MS) {
            ignore_full_or_busy(self.record_used(row.token.id, now_ms).await)?;
        }
        Ok(scope(&row))
    }

    /// When this token expires, epoch ms; `None` if it never does, or does not exist.
    pub async fn expiry_of(&self, secret: SecretHash) -> StoreResult<Option<i64>> {
        let row = sqlx::query_scalar(SELECT_EXPIRY).bind(secret);
        let row: Option<Option<i64>> = row.fetch_optional(self.0.readers()).await?;
        Ok(row.flatten())
    }

    /// When the token of a box's agent expires, epoch ms: the one that was used last. `None` if it never does, or if no
    /// agent has used one.
    pub async fn agent_expiry(&self, of: BoxId) -> StoreResult<Option<i64>> {
        let row = sqlx::query_scalar(SELECT_AGENT_EXPIRY).bind(of);
        let row: Option<Option<i64>> = row.fetch_optional(self.0.readers()).await?;
        Ok(row.flatten())
    }

    async fn record_used(&self, id: TokenId, now_ms: i64) -> StoreResult<()> {
        self.0
            .write(async move |tx| {
                sqlx::query(UPDATE_LAST_USED).bind(id).bind(now_ms).execute(tx).await?;
                Ok(())
            })
            .await
    }
}

/// Withdraws a person's tokens, but for those of the role in `keeps`, and the tokens that they made. The audit trail
/// gets the number of withdrawn tokens, if there are any.
pub(super) async fn withdraw_tokens(
    tx: &mut SqliteConnection,
    (scope, now_ms): (&Scope, i64),
    person: PersonId,
    keeps: Option<Role>,
) -> StoreResult<()> {
    let before: i64 = sqlx::query_scalar(COUNT_TOKENS).fetch_one(&mut *tx).await?;
    sqlx::query(DELETE_TOKENS_OF).bind(person).bind(keeps).execute(&mut *tx).await?;
    let left: i64 = sqlx::query_scalar(COUNT_TOKENS).fetch_one(&mut *tx).await?;
    if left == before { Ok(()) } else { note(tx, scope, now_ms, ("withdraw", "tokens"), before - left).await }
}

/// Refuses a program that withdraws a token other than its own and those that it made. The answer is the same for a
/// missing one.
async fn require_own_or_made(tx: &mut SqliteConnection, scope: &Scope, id: TokenId) -> StoreResult<()> {
    let Some(calling) = scope.token() else { return Ok(()) };
    let found = sqlx::query(SELECT_OWN_OR_MADE).bind(id).bind(calling.id).fetch_optional(tx).await?;
    found.map_or_else(|| require_sign_in(scope, "withdrawing a token that this one has not made"), |_| Ok(()))
}

/// Refuses a token with more rights than its person has: it would never be accepted.
async fn require_rights(tx: &mut SqliteConnection, acts_as: ActsAs) -> StoreResult<()> {
    let ActsAs::Person(person, wanted) = acts_as else { return Ok(()) };
    let has: Option<Role> = sqlx::query_scalar(SELECT_ROLE).bind(person).fetch_optional(tx).await?;
    match has.ok_or(not_found("person"))? {
        has if has == wanted => Ok(()),
        Role::Administrator if wanted == Role::Instructor => Ok(()),
        has => Err(StoreError::refused(format!(
            "this person's role is {has}: a token for them cannot have the role {wanted}"
        ))),
    }
}

fn scope(TokenScopeRow { token, trainee_id }: &TokenScopeRow) -> Option<Scope> {
    let scope = match token.role {
        Role::Administrator => Scope::administrator(token.person_id?),
        Role::Instructor => Scope::instructor(token.person_id?),
        Role::Trainee => Scope::trainee(token.person_id?, (*trainee_id)?),
        Role::Agent => Scope::agent(token.box_id?),
    };
    Some(scope.by_token(CallingToken { id: token.id, expires_at_ms: token.expires_at_ms }))
}
