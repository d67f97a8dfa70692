//! Codes for things that were created without one.

use sqlx::sqlite::SqliteConnection;

use super::error::{StoreError, StoreResult};
use crate::domain::text::{Code, Name};

/// Returns the given code, or derives a free one from the name. `taken` is a query that finds a row if the code `$1` is
/// in use.
pub(super) async fn choose(
    tx: &mut SqliteConnection,
    taken: &'static str,
    given: Option<Code>,
    name: &Name,
    fallback: &'static str,
) -> StoreResult<Code> {
    if let Some(code) = given {
        return Ok(code); // if it is taken, the UNIQUE constraint refuses it
    }
    free(tx, taken, Code::from_name(name, fallback)).await
}

/// The code itself, or with the first free number. `taken` is a query that finds a row if the code `$1` is in use.
pub(super) async fn free(tx: &mut SqliteConnection, taken: &'static str, base: Code) -> StoreResult<Code> {
    let mut is_free = async |code: &Code| -> StoreResult<bool> {
        let found: Option<i64> = sqlx::query_scalar(taken).bind(code).fetch_optional(&mut *tx).await?;
        Ok(found.is_none())
    };
    if is_free(&base).await? {
        return Ok(base);
    }
    // Numbers are assigned in ascending order, so all numbers below a taken one are taken, except for rows that were
    // renamed since. The first free number lies between the last taken and the first free power of two. The 500th thing
    // of one name therefore costs about 20 queries, not 500.
    let mut free = 2;
    while !is_free(&base.numbered(free)).await? {
        free = free
            .checked_mul(2)
            .ok_or_else(|| StoreError::refused(format!("no code like `{base}` is free: enter one yourself")))?;
    }
    let mut taken = free / 2; // 1 is the code without a number
    while free - taken > 1 {
        let middle = taken + (free - taken) / 2;
        match is_free(&base.numbered(middle)).await? {
            true => free = middle,
            false => taken = middle,
        }
    }
    Ok(base.numbered(free))
}
