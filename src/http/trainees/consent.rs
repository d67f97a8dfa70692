//! The consent of a trainee to recordings: given, refused or withdrawn by the trainee, or recorded by staff.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::consent::{ConsentDecision, ConsentMeans, ConsentState, NewConsent};
use crate::http::auth::signed_in::{Member, require_sign_in};
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey, reference_problem};
use crate::http::show::{Created, Time};
use crate::http::state::App;
use crate::ids::{ConsentId, ConsentTextId};
use crate::store::{ConsentRecord, StoreError, TraineeConsent};
use crate::time::Day;

/// Whether a trainee consents to recordings.
#[derive(Debug, Serialize, ToSchema)]
pub struct ConsentResponse {
    /// The state now. With `missing`, `refused` and `withdrawn` new recordings are refused.
    state: ConsentState,
    /// With `due`: from when on new recordings are refused; otherwise `null`.
    due_at: Option<Time>,
    /// The decisions, newest first.
    history: Vec<ConsentEntry>,
}

/// A decision about recordings.
#[derive(Debug, Serialize, ToSchema)]
pub struct ConsentEntry {
    id: ConsentId,
    decision: ConsentDecision,
    how: ConsentMeans,
    /// The text that it is about.
    text: ConsentTextId,
    /// The version of that text.
    version: i64,
    /// The day on the paper; `null` unless `how` is `paper`.
    signed_on: Option<Day>,
    /// Name of the person who recorded it: the trainee, or staff; `null` if the person was deleted.
    who: Option<String>,
    created_at: Time,
}

impl From<ConsentRecord> for ConsentEntry {
    fn from(record: ConsentRecord) -> Self {
        let ConsentRecord { id, decision, how, text_id, version, signed_on, who, created_at_ms } = record;
        let (who, created_at) = (who.map(String::from), Time(created_at_ms));
        Self { id, decision, how, text: text_id, version, signed_on, who, created_at }
    }
}

impl From<TraineeConsent> for ConsentResponse {
    fn from(consent: TraineeConsent) -> Self {
        let TraineeConsent { state, due_at_ms, history } = consent;
        Self { state, due_at: due_at_ms.map(Time), history: history.into_iter().map(ConsentEntry::from).collect() }
    }
}

/// Read whether a trainee consents to recordings, with all decisions
#[utoipa::path(get, path = "/trainees/{id}/consent", tag = "consent",
    params(("id" = String, Path, description = "id or code")), responses((status = OK, body = ConsentResponse)))]
pub async fn consent(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
) -> HandlerResult<Json<ConsentResponse>> {
    let trainee = app.store.trainees().get(&by.scope, &key).await?.id;
    Ok(Json(app.store.consents().of_trainee(&by.scope, trainee).await?.into()))
}

/// Record a decision of a trainee about recordings
///
/// Trainees decide about their own recordings after signing in; a token does not suffice. Staff record a signed paper with
/// its day, or that a trainee refuses or withdraws. A refusal and a withdrawal stop new recordings at once: a live
/// recording that is running ends with the frames that arrived. Recordings that exist stay until they are erased.
#[utoipa::path(post, path = "/trainees/{id}/consents", tag = "consent",
    params(("id" = String, Path, description = "id or code")), request_body = NewConsent,
    responses((status = CREATED, body = ConsentResponse)))]
pub async fn record_consent(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
    Json(new): Json<NewConsent>,
) -> HandlerResult<Created<ConsentResponse>> {
    let is_own = by.scope.own_trainee().is_some();
    if is_own {
        require_sign_in(&by.scope)?;
    }
    let trainee = app.store.trainees().get(&by.scope, &key).await?.id;
    let how = new.means(is_own, Day::of(app.clock.now_ms()))?;
    let recorded = app.store.consents().record(&by.scope, trainee, new, how).await;
    let recorded = recorded.map_err(|error| match error {
        error @ StoreError::NotFound { what: "text" } => reference_problem("text")(error),
        other => other.into(),
    })?;
    if recorded.state.ends_running_recordings() {
        let feeds = app.feeds.clone();
        app.shutdown.spawn(async move { feeds.end_recordings_of(trainee).await });
        app.end_invalid_check_ins_and_waits().await;
    }
    Ok(Created { location: format!("/api/v1/trainees/{trainee}/consent"), made: recorded.into() })
}
