//! A session's features as a table, and as an xAPI statement.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use serde::Deserialize;
use serde_json::Value;
use utoipa::{IntoParams, ToSchema};

use crate::domain::access::AccessedPart;
use crate::domain::files::features::TableFormat;
use crate::domain::session::BoxQuestion;
use crate::domain::xapi::{self, ScoredSession, Statement};
use crate::http::auth::signed_in::Member;
use crate::http::error::HandlerResult;
use crate::http::export::{self, TraineeIdentifier};
use crate::http::read::{Json, Params, PathKey};
use crate::http::state::App;
use crate::store::{SessionRecord, SessionResult, StandardRecord};
use crate::time::to_rfc3339;

/// Selects the format of a table.
#[derive(Clone, Copy, Debug, Deserialize, IntoParams, ToSchema)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct FeaturesQuery {
    /// Format of the table.
    #[serde(default)]
    #[param(inline)]
    format: TableFormat,
}

/// Read the features as a table
///
/// One row for each tool and feature, with value, error bar, unit and versions.
#[utoipa::path(get, path = "/sessions/{id}/features", tag = "sessions",
    params(("id" = String, Path, description = "id"), FeaturesQuery),
    responses((status = OK, description = "The table: session, trainee, task, …", content(
        (Object = "application/json"), (String = "text/csv"), (Vec<u8> = "application/vnd.apache.parquet")))))]
pub async fn features(
    State(app): State<App>,
    by: Member,
    at: PathKey,
    Params(FeaturesQuery { format }): Params<FeaturesQuery>,
) -> HandlerResult<Response> {
    let session = app.store.sessions().get(&by.scope, at.id()?).await?;
    let result = app.result(&by.scope, session.id).await?;
    app.note_access(&by.scope, session.id, AccessedPart::Result);
    let rows = export::rows(&session, &result, TraineeIdentifier::Code);
    export::export_session(rows, format, &format!("features-{}", session.id)).await
}

/// Read a session as an xAPI statement
///
/// It conforms to versions 1.0.3 and 2.0 of the specification. The actor is an account of this service, identified by
/// the trainee's id. The verb is `passed` or `failed` if the task's standard could judge the session, else `completed`,
/// as of a session that may show another box. Unknown values are absent.
#[utoipa::path(get, path = "/sessions/{id}/xapi", tag = "sessions", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = Statement)))]
pub async fn xapi(
    State(app): State<App>,
    by: Member,
    at: PathKey,
    headers: HeaderMap,
) -> HandlerResult<Json<Statement>> {
    let session = app.store.sessions().get(&by.scope, at.id()?).await?;
    let result = app.result(&by.scope, session.id).await?;
    app.note_access(&by.scope, session.id, AccessedPart::Result);
    let standard = app.store.standards().at(&by.scope, session.task_id, session.created_at_ms).await?;
    Ok(Json(statement(&app.base_url(&headers), &session, &result, standard.as_ref())))
}

/// The xAPI statement of a session's result.
pub fn statement(
    home: &str,
    session: &SessionRecord,
    result: &SessionResult,
    standard: Option<&StandardRecord>,
) -> Statement {
    let standard = standard.filter(|_| session.box_question.is_none_or(BoxQuestion::counts));
    let judged = |standard: &StandardRecord| {
        let hand = session.trainee_handedness;
        let definition = standard.definition.in_session(&result.hands, hand);
        (standard.version, definition.judge(&result.features, &result.versions.pipeline, hand))
    };
    let trainee = session.trainee_id.to_string();
    xapi::statement(&ScoredSession {
        home,
        session: session.id.to_string(),
        result: result.id.to_string(),
        trainee: &trainee,
        task: (session.task_id.to_string(), session.task_name.as_str()),
        recorded_at: to_rfc3339(session.recorded_at_ms),
        duration_s: result.video.duration_s,
        verdict: result.quality.get("verdict").and_then(Value::as_str),
        tracker: session.tracker.as_ref().map(|tracker| tracker.as_str()),
        versions: &result.versions,
        features: &result.features,
        judged: standard.map(judged),
    })
}
