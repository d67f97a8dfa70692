//! The evidence of a session's features: the seconds of the recording that determined them. Stored with each result,
//! read for one session at a time.

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::super::Scope;
use super::super::error::StoreResult;
use super::super::visibility::{BindScope, sees_trainee};
use super::SessionStore;
use crate::domain::evidence::EvidenceRow;
use crate::ids::{ResultId, SessionId};

impl SessionStore<'_> {
    /// The evidence of a session's latest result; `None` if there is no result or it was stored without evidence.
    pub async fn evidence(&self, scope: &Scope, id: SessionId) -> StoreResult<Option<Vec<EvidenceRow>>> {
        let row = sqlx::query_scalar(concat!(
            "SELECT evidence.rows FROM session
             JOIN result ON result.id = (SELECT latest.id FROM result AS latest WHERE latest.session_id = session.id
                                         ORDER BY latest.created_at_ms DESC, latest.id DESC LIMIT 1)
             JOIN evidence ON evidence.result_id = result.id
             WHERE session.id = $3 AND ",
            sees_trainee!("session.trainee_id")
        ));
        let row: Option<Json<Vec<EvidenceRow>>> =
            row.bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await?;
        match row {
            Some(Json(rows)) => Ok(Some(rows)),
            None => self.get(scope, id).await.map(|_| None),
        }
    }
}

/// Stores a result's evidence, in the same transaction as the result.
pub(in crate::store) async fn insert(
    tx: &mut SqliteConnection,
    result: ResultId,
    rows: Vec<EvidenceRow>,
) -> StoreResult<()> {
    let insert = sqlx::query("INSERT INTO evidence (result_id, rows) VALUES ($1, $2)").bind(result).bind(Json(rows));
    insert.execute(tx).await?;
    Ok(())
}
