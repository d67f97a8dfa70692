//! The seconds that determined a session's features, and advice on what to practise next.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::access::AccessedPart;
use crate::domain::advice::{self, Advice, MeasuredSession};
use crate::domain::evidence::EvidenceRow;
use crate::domain::standard::SessionJudgement;
use crate::http::auth::signed_in::Member;
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey};
use crate::http::state::App;
use crate::store;

/// The seconds that determined a session's features.
#[derive(Debug, Serialize, ToSchema)]
pub struct EvidenceResponse {
    /// Version of the program that computed the result; `null` while there is no result.
    pipeline: Option<String>,
    /// One row for each feature, in display order. `null` if there is no result yet, or if an older program computed it
    /// without evidence; scoring the session again adds it.
    features: Option<Vec<EvidenceRow>>,
}

/// What to practise next.
#[derive(Debug, Serialize, ToSchema)]
pub struct AdviceResponse {
    /// Version of the task's standard that the session is compared with; `null`: the task has no standard.
    standard: Option<i64>,
    /// At most three pieces of advice, the most important first.
    items: Vec<Advice>,
    /// Why there is no advice; `null` if there is some.
    none: Option<NoAdvice>,
}

/// Why there is no advice.
#[derive(Debug, Serialize, ToSchema)]
pub struct NoAdvice {
    /// Stable name: `not_scored`, `refused`, `no_standard`, `no_evidence`, `no_seconds` or `nothing_sure`.
    reason: &'static str,
    /// The reason in words, for people.
    detail: &'static str,
}

const NOT_SCORED: NoAdvice = NoAdvice { reason: "not_scored", detail: "The session is not scored yet." };
const REFUSED: NoAdvice =
    NoAdvice { reason: "refused", detail: "The quality check refused this session, so there is no advice on it." };
const NO_STANDARD: NoAdvice = NoAdvice {
    reason: "no_standard",
    detail: "No standard of the task counts for this session. Advice compares a session with a standard's limits.",
};
const NO_EVIDENCE: NoAdvice = NoAdvice {
    reason: "no_evidence",
    detail: "An older version of the program scored this session. Score it again to get advice.",
};
const NOTHING_SURE: NoAdvice =
    NoAdvice { reason: "nothing_sure", detail: "No feature misses its limit by more than its measurement error." };
const NO_SECONDS: NoAdvice = NoAdvice {
    reason: "no_seconds",
    detail: "A limit is missed, but no moment of the session stands out as the cause.",
};

/// Read which seconds determined a session's features
///
/// Each feature has at most three stretches that do not overlap, the weightiest first, or the reason why it has none.
/// Stretches show the trainee's movement: those that measurement errors of the path alone could explain are left out.
/// Stretches where a tool was not seen appear only for the features of the view, with the cause.
#[utoipa::path(get, path = "/sessions/{id}/evidence", tag = "sessions",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = EvidenceResponse)))]
pub async fn evidence(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<EvidenceResponse>> {
    let session = app.store.sessions().get(&by.scope, at.id()?).await?;
    let result = app.store.sessions().result(&by.scope, session.id).await?;
    let features = app.store.sessions().evidence(&by.scope, session.id).await?;
    app.note_access(&by.scope, session.id, AccessedPart::Result);
    Ok(Json(EvidenceResponse { pipeline: result.map(|result| result.versions.pipeline), features }))
}

/// Read what to practise next
///
/// Rules compare a session's features with its task's standard. A rule gives advice only if the whole error bar of a
/// feature breaks the limit and there are seconds to look at. There is no advice for a refused session, or without a
/// standard.
#[utoipa::path(get, path = "/sessions/{id}/advice", tag = "sessions",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = AdviceResponse)))]
pub async fn session_advice(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<AdviceResponse>> {
    let session = app.store.sessions().get(&by.scope, at.id()?).await?;
    let standard = app.store.standards().at(&by.scope, session.task_id, session.created_at_ms).await?;
    let result = app.store.sessions().result(&by.scope, session.id).await?;
    let evidence = app.store.sessions().evidence(&by.scope, session.id).await?;
    app.note_access(&by.scope, session.id, AccessedPart::Result);
    let version = standard.as_ref().map(|standard| standard.version);
    let given = advice_of(&session, result, standard, evidence);
    let (items, none) = given.map_or_else(|none| (Vec::new(), Some(none)), |items| (items, None));
    Ok(Json(AdviceResponse { standard: version, items, none }))
}

fn advice_of(
    session: &store::SessionRecord,
    result: Option<store::SessionResult>,
    standard: Option<store::StandardRecord>,
    evidence: Option<Vec<EvidenceRow>>,
) -> Result<Vec<Advice>, NoAdvice> {
    let result = result.ok_or(NOT_SCORED)?;
    if result.quality["verdict"] == "refused" {
        return Err(REFUSED);
    }
    let standard = standard.ok_or(NO_STANDARD)?;
    let measured = MeasuredSession {
        features: &result.features,
        evidence: &evidence.ok_or(NO_EVIDENCE)?,
        pipeline: &result.versions.pipeline,
        handedness: session.trainee_handedness,
    };
    let definition = standard.definition.in_session(&result.hands, session.trainee_handedness);
    let items = advice::advise(&definition, measured);
    let judged = definition.judge(&result.features, &result.versions.pipeline, session.trainee_handedness);
    match (items.is_empty(), judged) {
        (false, _) => Ok(items),
        (true, SessionJudgement::Fail) => Err(NO_SECONDS),
        (true, _) => Err(NOTHING_SURE),
    }
}
