//! Visibility rules as SQL conditions. In every statement that uses them, `$1` is the role of the scope and `$2` its
//! subject; `bind_scope` binds both.

use sqlx::Sqlite;
use sqlx::query::{Query, QueryAs, QueryScalar};
use sqlx::sqlite::{SqliteArguments, SqliteConnection, SqliteRow};

use super::error::{StoreError, StoreResult, not_found};
use crate::domain::scope::Scope;
use crate::ids::TraineeId;

/// The trainee in this column is within the scope.
macro_rules! sees_trainee {
    ($column:literal) => {
        concat!(
            "($1 = 'administrator' OR ($1 = 'trainee' AND $2 = ",
            $column,
            ") OR ($1 = 'instructor' AND EXISTS (",
            "SELECT 1 FROM group_trainee JOIN group_instructor USING (group_id) ",
            "WHERE group_trainee.trainee_id = ",
            $column,
            " AND group_instructor.person_id = $2)))"
        )
    };
}

/// The box in this column is within the scope: people see all boxes, an agent its own.
macro_rules! sees_box {
    ($column:literal) => {
        concat!("($1 <> 'agent' OR $2 = ", $column, ")")
    };
}

pub(super) use {sees_box, sees_trainee};

/// Binds the scope as `$1` and `$2`.
pub(super) trait BindScope: Sized {
    fn bind_scope(self, scope: &Scope) -> Self;
}

impl BindScope for Query<'_, Sqlite, SqliteArguments> {
    fn bind_scope(self, scope: &Scope) -> Self {
        self.bind(scope.role()).bind(scope.subject())
    }
}

impl<T: for<'r> sqlx::FromRow<'r, SqliteRow>> BindScope for QueryAs<'_, Sqlite, T, SqliteArguments> {
    fn bind_scope(self, scope: &Scope) -> Self {
        self.bind(scope.role()).bind(scope.subject())
    }
}

impl<T> BindScope for QueryScalar<'_, Sqlite, T, SqliteArguments>
where
    (T,): for<'r> sqlx::FromRow<'r, SqliteRow>,
{
    fn bind_scope(self, scope: &Scope) -> Self {
        self.bind(scope.role()).bind(scope.subject())
    }
}

/// Does the scope reach this trainee?
pub(super) async fn require_trainee(tx: &mut SqliteConnection, scope: &Scope, trainee: TraineeId) -> StoreResult<()> {
    let sql = concat!("SELECT 1 FROM trainee WHERE id = $3 AND ", sees_trainee!("trainee.id"));
    let found: Option<i64> = sqlx::query_scalar(sql).bind_scope(scope).bind(trainee).fetch_optional(tx).await?;
    found.map(drop).ok_or(not_found("trainee"))
}

/// Refuses all but administrators.
pub(super) fn require_administrator(scope: &Scope, what: &'static str) -> StoreResult<()> {
    if scope.is_administrator() { Ok(()) } else { Err(StoreError::Forbidden { what, whom: "administrators" }) }
}

/// Refuses all but administrators and instructors.
pub(super) fn require_staff(scope: &Scope, what: &'static str) -> StoreResult<()> {
    if scope.is_staff() { Ok(()) } else { Err(StoreError::Forbidden { what, whom: "administrators and instructors" }) }
}
