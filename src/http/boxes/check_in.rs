//! Checking in at a box: the recordings that are started there are of this trainee. A trainee proves to stand at the box
//! with the code that its screen shows as a QR code, or types code and PIN there. Staff check trainees in without a code.

use axum::extract::State;
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::BoxAgentResponse;
use crate::domain::box_agent::pin::CheckInPin;
use crate::http::auth::password::HashRequester;
use crate::http::auth::signed_in::{BySignIn, Member};
use crate::http::error::{HandlerResult, ProblemResponse, Refusal};
use crate::http::read::{Json, PathKey};
use crate::http::show::Time;
use crate::http::state::App;
use crate::store::{BoxCommand, StoreError};

/// A check-in at a box.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewCheckIn {
    /// The code that the box shows. Trainees need it; staff may leave it out.
    #[serde(default)]
    code: Option<String>,
    /// The trainee, by id or code; a trainee may leave it out.
    #[serde(default)]
    trainee: Option<String>,
    /// The task of the next recording, by id or code; it can also be chosen at the box.
    #[serde(default)]
    task: Option<String>,
}

/// Check a trainee in at a box
///
/// It ends ten minutes after the last recording, at the box, with `DELETE`, or when another trainee checks in. If the
/// consent is missing (403), a code of the box is used up all the same: the box says so, and starts no recording without a
/// name by a key.
#[utoipa::path(put, path = "/boxes/{id}/check-in", tag = "boxes",
    params(("id" = String, Path, description = "id or code")), request_body = NewCheckIn,
    responses((status = OK, body = BoxAgentResponse)))]
pub async fn check_in(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
    Json(new): Json<NewCheckIn>,
) -> HandlerResult<Json<BoxAgentResponse>> {
    let of = app.store.boxes().get(&by.scope, &key).await?.id;
    let trainee = app.named_trainee(&by.scope, new.trainee.as_deref()).await?;
    let task = match &new.task {
        Some(key) => Some(app.named_task(&by.scope, key).await?),
        None => None,
    };
    if let Err(refused) = app.store.consents().require(&by.scope, trainee.id).await {
        let is_at_box = || new.code.as_deref().is_some_and(|code| app.box_agents.use_check_in_code(of, code));
        if matches!(refused, StoreError::ConsentMissing { .. }) && is_at_box() {
            app.box_agents.refuse_phone_check_in(of);
        }
        return Err(refused.into());
    }
    if app.box_agents.was_recording(of) {
        let why = match app.box_agents.view(of).is_online {
            true => "The box is recording. Check in when the recording has ended.",
            false => {
                "The box has no connection, and was recording when it was last heard of. Check in when it is back."
            }
        };
        return Err(Refusal::Conflict.with(why));
    }
    let is_at_box = new.code.as_deref().is_some_and(|code| app.box_agents.use_check_in_code(of, code));
    if !is_at_box && (new.code.is_some() || !by.scope.is_staff()) {
        let why = "is not a code that the box shows now; scan the code on its screen again";
        return Err(ProblemResponse::invalid("code", why));
    }
    let about = (of, trainee.id);
    app.store.box_agents().note_command(&by.scope, &by.scope, BoxCommand::CheckIn, about).await?;
    app.box_agents.check_in(of, trainee, by.scope.clone(), task);
    app.announce_check_in(of).await?;
    Ok(Json(app.box_agent_response(&by.scope, of, None).await?))
}

/// End the check-in at a box
///
/// For staff who see the trainee, and for the trainee. Without a check-in nothing changes.
#[utoipa::path(delete, path = "/boxes/{id}/check-in", tag = "boxes",
    params(("id" = String, Path, description = "id or code")), responses((status = NO_CONTENT)))]
pub async fn check_out(State(app): State<App>, by: Member, PathKey(key): PathKey) -> HandlerResult<StatusCode> {
    let of = app.store.boxes().get(&by.scope, &key).await?.id;
    let Some(check_in) = app.box_agents.view(of).check_in else { return Ok(StatusCode::NO_CONTENT) };
    let about = (of, check_in.trainee.id);
    app.store.box_agents().note_command(&by.scope, &by.scope, BoxCommand::CheckOut, about).await?;
    app.box_agents.check_out(of);
    app.announce_check_in(of).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Whether the caller has a PIN for boxes.
#[derive(Debug, Serialize, ToSchema)]
pub struct PinResponse {
    /// When it was set; `null`: there is none.
    set_at: Option<Time>,
}

/// A PIN to set.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewPin {
    /// 4 to 8 digits; not one digit repeated, and no run such as 1234.
    #[schema(format = Password)]
    pin: String,
}

/// Read whether the own account has a PIN for boxes
#[utoipa::path(get, path = "/me/pin", tag = "sign-in", responses((status = OK, body = PinResponse)))]
pub async fn pin(State(app): State<App>, by: Member) -> HandlerResult<Json<PinResponse>> {
    let set_at = app.store.check_in_pins().own_set_at(&by.scope).await?.map(Time);
    Ok(Json(PinResponse { set_at }))
}

/// Set the PIN that the own account checks in with at boxes
///
/// Only trainees have one. It opens nothing but the check-in. A token does not suffice.
#[utoipa::path(put, path = "/me/pin", tag = "sign-in", request_body = NewPin,
    responses((status = OK, body = PinResponse)))]
pub async fn set_pin(
    State(app): State<App>,
    BySignIn(by): BySignIn<Member>,
    Json(new): Json<NewPin>,
) -> HandlerResult<Json<PinResponse>> {
    app.store.check_in_pins().own_set_at(&by.scope).await?; // refuses callers who are no trainees
    let pin =
        CheckInPin::new(&new.pin)?.into_password().ok_or_else(|| ProblemResponse::invalid("pin", "is too long"))?;
    let place = app.password_hasher.take_place(HashRequester::Account(by.scope.actor()))?;
    app.store.check_in_pins().set(&by.scope, place.hash(pin).await?).await?;
    let set_at = app.store.check_in_pins().own_set_at(&by.scope).await?.map(Time);
    Ok(Json(PinResponse { set_at }))
}

/// Remove the PIN of the own account
///
/// A token does not suffice.
#[utoipa::path(delete, path = "/me/pin", tag = "sign-in", responses((status = NO_CONTENT)))]
pub async fn remove_pin(State(app): State<App>, BySignIn(by): BySignIn<Member>) -> HandlerResult<StatusCode> {
    app.store.check_in_pins().remove(&by.scope).await?;
    Ok(StatusCode::NO_CONTENT)
}
