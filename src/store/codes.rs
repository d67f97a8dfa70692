//! Codes of things that came without one.

use sqlx::sqlite::SqliteConnection;

use super::error::{StoreError, StoreResult};
use crate::domain::text::{Code, Name};

/// The code to use: the given one, or one made of the name that `taken` (a query with the code as `$1`) does not find.
pub(super) async fn choose(
    tx: &mut SqliteConnection,
    taken: &'static str,
    given: Option<Code>,
    name: &Name,
    fallback: &'static str,
) -> StoreResult<Code> {
    if let Some(code) = given {
        return Ok(code); // a given code that is taken meets the UNIQUE constraint
    }
    let base = Code::from_name(name, fallback);
    let mut is_free = async |code: &Code| -> StoreResult<bool> {
        let found: Option<i64> = sqlx::query_scalar(taken).bind(code).fetch_optional(&mut *tx).await?;
        Ok(found.is_none())
    };
    if is_free(&base).await? {
        return Ok(base);
    }
    // Numbers are given in turn, so that a taken one has all below it taken, but for what was renamed since: the first free one lies
    // between the last taken and the first free power of two. The five hundredth of one name costs some twenty looks, not five hundred.
    let mut free = 2;
    while !is_free(&base.numbered(free)).await? {
        free = free
            .checked_mul(2)
            .ok_or_else(|| StoreError::refused(format!("no code like `{base}` is left: give one yourself")))?;
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
