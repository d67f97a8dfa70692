//! Where a session's features come from, and what to work on next.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::advice::{self, Advice, Measured};
use crate::domain::evidence::EvidenceRow;
use crate::domain::standard::SessionJudgement;
use crate::http::auth::signed_in::Member;
use crate::http::error::Answer;
use crate::http::read::{At, Json};
use crate::http::state::App;
use crate::store;

/// The seconds that made a session's features.
#[derive(Debug, Serialize, ToSchema)]
pub struct Evidence {
    /// Version of the program that made it; `null` while there is no result.
    pipeline: Option<String>,
    /// A row for each feature, in the order in which people read them; `null` where the result has none: it is not there yet,
    /// or is of a program that did not keep them, and scoring the session again makes them.
    features: Option<Vec<EvidenceRow>>,
}

/// What to work on next.
#[derive(Debug, Serialize, ToSchema)]
pub struct AdviceGiven {
    /// Version of the task's standard that the session is held against; `null` without one.
    standard: Option<i64>,
    /// At most three, the most important first.
    items: Vec<Advice>,
    /// Why there is none; `null` where there is.
    none: Option<NoAdvice>,
}

/// Why there is no advice.
#[derive(Debug, Serialize, ToSchema)]
pub struct NoAdvice {
    /// Stable name: `not_scored`, `refused`, `no_standard`, `no_evidence`, `no_seconds` or `nothing_sure`.
    reason: &'static str,
    /// The same in words.
    detail: &'static str,
}

const NOT_SCORED: NoAdvice = NoAdvice { reason: "not_scored", detail: "The session is not scored yet." };
const REFUSED: NoAdvice = NoAdvice {
    reason: "refused",
    detail: "The session is refused: its numbers must not be believed, and nor would advice be.",
};
const NO_STANDARD: NoAdvice = NoAdvice {
    reason: "no_standard",
    detail: "The task has no standard yet, and advice is given against its limits alone. Set one: POST tasks/{id}/standards.",
};
const NO_EVIDENCE: NoAdvice = NoAdvice {
    reason: "no_evidence",
    detail: "The result is of a program that did not keep where features come from. Score the session again.",
};
const NOTHING_SURE: NoAdvice =
    NoAdvice { reason: "nothing_sure", detail: "No feature misses its limit by more than it may be off." };
const NO_SECONDS: NoAdvice = NoAdvice {
    reason: "no_seconds",
    detail: "A limit is missed, but no seconds stand out of which a rule could speak.",
};

/// Read which seconds made a session's features
///
/// Each feature has at most three stretches that do not overlap, the weightiest first, or the reason why it has none. They are
/// the hand's doing: what errors of the path alone could have made is left out, and where a tool was not seen only the features
/// of the view point, with whose doing that was.
#[utoipa::path(get, path = "/sessions/{id}/evidence", tag = "sessions",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = Evidence)))]
pub async fn evidence(State(app): State<App>, by: Member, at: At) -> Answer<Json<Evidence>> {
    let session = app.store.sessions().get(&by.scope, at.id()?).await?;
    let result = app.store.sessions().result(&by.scope, session.id).await?;
    let features = app.store.sessions().evidence(&by.scope, session.id).await?;
    Ok(Json(Evidence { pipeline: result.map(|result| result.versions.pipeline), features }))
}

/// Read what to work on next
///
/// Rules compare a session's features with its task's standard. A rule speaks only where the whole error bar of a feature
/// breaks the limit and there are seconds to look at; of a refused session, and without a standard, none does.
#[utoipa::path(get, path = "/sessions/{id}/advice", tag = "sessions",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = AdviceGiven)))]
pub async fn session_advice(State(app): State<App>, by: Member, at: At) -> Answer<Json<AdviceGiven>> {
    let session = app.store.sessions().get(&by.scope, at.id()?).await?;
    let standard = app.store.standards().in_use(&by.scope, session.task_id).await?;
    let result = app.store.sessions().result(&by.scope, session.id).await?;
    let evidence = app.store.sessions().evidence(&by.scope, session.id).await?;
    let version = standard.as_ref().map(|standard| standard.version);
    let given = advice_of(&session, result, standard, evidence);
    let (items, none) = given.map_or_else(|none| (Vec::new(), Some(none)), |items| (items, None));
    Ok(Json(AdviceGiven { standard: version, items, none }))
}

fn advice_of(
    session: &store::Session,
    result: Option<store::SessionResult>,
    standard: Option<store::Standard>,
    evidence: Option<Vec<EvidenceRow>>,
) -> Result<Vec<Advice>, NoAdvice> {
    let result = result.ok_or(NOT_SCORED)?;
    if result.quality["verdict"] == "refused" {
        return Err(REFUSED);
    }
    let standard = standard.ok_or(NO_STANDARD)?;
    let measured = Measured {
        features: &result.features,
        evidence: &evidence.ok_or(NO_EVIDENCE)?,
        pipeline: &result.versions.pipeline,
        handedness: session.trainee_handedness,
    };
    let items = advice::advise(&standard.definition, measured);
    let judged = standard.definition.judge(&result.features, &result.versions.pipeline, session.trainee_handedness);
    match (items.is_empty(), judged) {
        (false, _) => Ok(items),
        (true, SessionJudgement::Fail) => Err(NO_SECONDS),
        (true, _) => Err(NOTHING_SURE),
    }
}
