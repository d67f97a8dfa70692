//! All results of a session: which one is in use, and the versions behind each.

use axum::extract::State;
use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use crate::domain::access::AccessedPart;
use crate::domain::session::Versions;
use crate::http::auth::signed_in::Member;
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey};
use crate::http::show::{PageResponse, Time};
use crate::http::state::App;
use crate::ids::ResultId;
use crate::store::SessionResult;

/// Most results in the list. There is one for each combination of program, calibration and colours that was used.
const MAX_RESULTS: u32 = 200;

/// A result of a session.
#[derive(Debug, Serialize, ToSchema)]
pub struct ResultSummary {
    id: ResultId,
    /// True for the latest result, whose features the session shows.
    in_use: bool,
    /// `valid`, `usable_with_care` or `refused`; `null` in results of earlier versions.
    verdict: Option<String>,
    /// Versions of the program, calibration and colours that it was computed with.
    versions: Versions,
    /// `revision` of the session's edits that it includes; 0: no edits.
    edits: u64,
    created_at: Time,
}

/// List all results of a session, the one in use first
#[utoipa::path(get, path = "/sessions/{id}/results", tag = "sessions",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = PageResponse<ResultSummary>)))]
pub async fn results(
    State(app): State<App>,
    by: Member,
    at: PathKey,
) -> HandlerResult<Json<PageResponse<ResultSummary>>> {
    let session = at.id()?;
    let results = app.store.sessions().results(&by.scope, session, MAX_RESULTS).await?;
    app.note_access(&by.scope, session, AccessedPart::Result);
    let shown = results.into_iter().enumerate().map(|(place, result)| ResultSummary::of(result, place == 0));
    Ok(Json(PageResponse::whole(shown)))
}

impl ResultSummary {
    fn of(result: SessionResult, in_use: bool) -> Self {
        let verdict = result.quality.get("verdict").and_then(Value::as_str).map(str::to_owned);
        let (edits, created_at) = (result.edits, Time(result.created_at_ms));
        Self { id: result.id, in_use, verdict, versions: result.versions, edits, created_at }
    }
}
