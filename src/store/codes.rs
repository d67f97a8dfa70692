//! Codes of things that came without one.

use sqlx::sqlite::SqliteConnection;

use super::error::{StoreError, StoreResult};
use crate::domain::text::{Code, Name};

/// Names tried before giving up: more things of one name than this want codes of their own.
const MOST_TRIED: u32 = 1_000;

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
    for number in 1..=MOST_TRIED {
        let code = if number == 1 { base.clone() } else { base.numbered(number) };
        let found: Option<i64> = sqlx::query_scalar(taken).bind(&code).fetch_optional(&mut *tx).await?;
        if found.is_none() {
            return Ok(code);
        }
    }
    Err(StoreError::refused(format!("there are {MOST_TRIED} codes like `{base}` already: give one yourself")))
}
