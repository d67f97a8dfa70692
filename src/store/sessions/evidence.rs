//! The evidence of a session's features: the seconds of the recording that determined them. Stored with each result,
//! read for one session at a time.

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::super::Scope;
use super::super::error::StoreResult;
use super::super::visibility::BindScope;
use super::SessionStore;
use crate::domain::evidence::EvidenceRow;
use crate::ids::{ResultId, SessionId};

const SELECT_EVIDENCE: &str = "
    SELECT evidence.rows FROM session
    JOIN current_result AS result ON result.session_id = session.id
    JOIN evidence ON evidence.result_id = result.id
    WHERE session.id = $3
      AND ($1 = 'administrator'
           OR session.trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
      AND ($2 IS 'service' OR session.trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))
      AND ($1 <> 'trainee' OR session.id NOT IN (SELECT session_id FROM sealed_session))";

const INSERT_EVIDENCE: &str = "INSERT INTO evidence (result_id, rows) VALUES ($1, $2)";

impl SessionStore<'_> {
    /// The evidence of a session's latest result; `None` if there is no result or it was stored without evidence.
    pub async fn evidence(&self, scope: &Scope, id: SessionId) -> StoreResult<Option<Vec<EvidenceRow>>> {
        let row: Option<Json<Vec<EvidenceRow>>> =
            sqlx::query_scalar(SELECT_EVIDENCE).bind_scope(scope).bind(id).fetch_optional(self.0.readers()).await?;
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
    let insert = sqlx::query(INSERT_EVIDENCE).bind(result).bind(Json(rows));
    insert.execute(tx).await?;
    Ok(())
}
