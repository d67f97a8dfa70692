//! Visibility rules as SQL conditions. In every statement that uses them, `$1` is the role of the scope and `$2` its
//! subject; `bind_scope` binds both.
//!
//! | what the scope sees | condition, with the column in place of `…` |
//! |---|---|
//! | trainees | `($1 = 'administrator' OR … IN (SELECT trainee_id FROM visible_trainee WHERE …))`, as below |
//! | jobs | the view `visible_job` (`migrations/0018_job_kinds.sql`), which needs `subject IS nullif($2, 'service')` |
//! | boxes: people all, an agent its own | `($1 <> 'agent' OR $2 = …)` |
//! | what all people may read | `$1 <> 'agent'` |
//!
//! The view `visible_trainee` (`migrations/0019_views.sql`) has the trainees of instructors and of trainees. The column
//! stands outside the subquery: inside, a name of the view could hide it.
//!
//! Trainees who wait for their erasure, and records that were merged into another one of the same person, are hidden
//! from all people, and so is all that belongs to them (view `hidden_trainee`). Only the service's
//! own work sees them: its `$2` is [`SERVICE`]. So each condition on trainees is followed by
//! `($2 IS 'service' OR … NOT IN (SELECT trainee_id FROM hidden_trainee))`; a test finds statements that lack it.
//!
//! Where hundreds of callers ask about one trainee at the same moment, one query reads its [`TraineeAudience`], which
//! decides for each of them.

use sqlx::Sqlite;
use sqlx::query::{Query, QueryAs, QueryScalar};
use sqlx::sqlite::{SqliteArguments, SqliteConnection, SqliteRow};

use super::error::{StoreError, StoreResult, not_found};
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::ids::TraineeId;

/// The subject of the service's own scope.
const SERVICE: &str = "service";

/// The subject as the conditions need it.
fn subject(scope: &Scope) -> Option<String> {
    if scope.is_service() { Some(SERVICE.to_owned()) } else { scope.subject() }
}

/// Binds the scope as `$1` and `$2`.
pub(super) trait BindScope: Sized {
    fn bind_scope(self, scope: &Scope) -> Self;
}

impl BindScope for Query<'_, Sqlite, SqliteArguments> {
    fn bind_scope(self, scope: &Scope) -> Self {
        self.bind(scope.role()).bind(subject(scope))
    }
}

impl<T: for<'r> sqlx::FromRow<'r, SqliteRow>> BindScope for QueryAs<'_, Sqlite, T, SqliteArguments> {
    fn bind_scope(self, scope: &Scope) -> Self {
        self.bind(scope.role()).bind(subject(scope))
    }
}

impl<T> BindScope for QueryScalar<'_, Sqlite, T, SqliteArguments>
where
    (T,): for<'r> sqlx::FromRow<'r, SqliteRow>,
{
    fn bind_scope(self, scope: &Scope) -> Self {
        self.bind(scope.role()).bind(subject(scope))
    }
}

const SELECT_VISIBLE_TRAINEE: &str = "
    SELECT 1 FROM trainee
    WHERE id = $3
      AND ($1 = 'administrator'
           OR id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR id NOT IN (SELECT trainee_id FROM hidden_trainee))";

pub(super) const SELECT_AUDIENCE: &str = "
    SELECT role, subject FROM visible_trainee
    WHERE trainee_id = $1 AND trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee)";

/// The people who saw a trainee when it was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TraineeAudience(pub(in crate::store) Vec<(Role, String)>);

impl TraineeAudience {
    /// Whether this scope of a person or agent saw the trainee.
    pub fn includes(&self, scope: &Scope) -> bool {
        // Trainees see themselves, so only one that is missing or waits for erasure has no row.
        let is_named = || scope.subject().is_some_and(|subject| self.0.contains(&(scope.role(), subject)));
        !self.is_empty() && (scope.is_administrator() || is_named())
    }

    /// True if no person saw the trainee: it is missing, was merged, or waits for erasure.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Does the scope reach this trainee?
pub(super) async fn require_trainee(tx: &mut SqliteConnection, scope: &Scope, trainee: TraineeId) -> StoreResult<()> {
    let found: Option<i64> =
        sqlx::query_scalar(SELECT_VISIBLE_TRAINEE).bind_scope(scope).bind(trainee).fetch_optional(tx).await?;
    found.map(drop).ok_or(not_found("trainee"))
}

/// Refuses all but administrators.
pub(super) fn require_administrator(scope: &Scope, what: &'static str) -> StoreResult<()> {
    if scope.is_administrator() { Ok(()) } else { Err(StoreError::Forbidden { what, whom: "administrators" }) }
}

/// Refuses a program with a token.
pub(super) fn require_sign_in(scope: &Scope, what: &'static str) -> StoreResult<()> {
    let whom = "people who sign in with a password";
    if scope.token().is_none() { Ok(()) } else { Err(StoreError::Forbidden { what, whom }) }
}

/// Refuses all but administrators and instructors.
pub(super) fn require_staff(scope: &Scope, what: &'static str) -> StoreResult<()> {
    if scope.is_staff() { Ok(()) } else { Err(StoreError::Forbidden { what, whom: "administrators and instructors" }) }
}
