//! Who needs attention: recent sessions that staff should look at, and the alarms of the standards' charts.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::Member;
use super::error::HandlerResult;
use super::read::Json;
use super::show::{NamedReference, Time};
use super::state::App;
use crate::cohorts::{Alarm, Alarms};
use crate::ids::SessionId;
use crate::store::AttentionItem;

const DAY_MS: i64 = 86_400_000;
/// Age limit of the listed sessions.
const RECENT_MS: i64 = 14 * DAY_MS;
/// A task counts as rated if one of its sessions was rated within this time.
const RATED_WINDOW_MS: i64 = 90 * DAY_MS;
/// Most sessions in each list.
const MAX_SESSIONS: u32 = 20;

/// What needs attention, among the trainees in the caller's scope.
#[derive(Debug, Serialize, ToSchema)]
pub struct Attention {
    /// Relapses and due refreshers, latest first.
    alarms: Vec<Alarm>,
    /// True if more people trained recently than were checked for alarms.
    more: bool,
    /// Sessions that may show another box: until a person says whether it is the box, they count nowhere. At most 20.
    box_asked: Vec<SessionToReview>,
    /// Sessions of the last 14 days that the quality gate refused, at most 20.
    refused: Vec<SessionToReview>,
    /// Unrated sessions of the last 14 days, of tasks whose sessions are rated; at most 20. Empty for trainees.
    unrated: Vec<SessionToReview>,
}

/// A session that staff should look at.
#[derive(Debug, Serialize, ToSchema)]
pub struct SessionToReview {
    session: SessionId,
    trainee: NamedReference,
    task: NamedReference,
    recorded_at: Time,
}

/// Read what needs attention
///
/// Lists alarms, sessions that may show another box, refused sessions and unrated sessions.
/// `GET /sessions?status=failed` lists failed sessions.
#[utoipa::path(get, path = "/attention", tag = "trainees", responses((status = OK, body = Attention)))]
pub async fn attention(State(app): State<App>, by: Member) -> HandlerResult<Json<Attention>> {
    let (sessions, now_ms) = (app.store.sessions(), app.clock.now_ms());
    let (since, rated_since) = (now_ms.saturating_sub(RECENT_MS), now_ms.saturating_sub(RATED_WINDOW_MS));
    let Alarms { items, more } = app.cohorts.alarms(&by.scope).await?;
    let refused = sessions.refused_since(&by.scope, since, MAX_SESSIONS).await?;
    let box_asked = sessions.box_asked(&by.scope, MAX_SESSIONS).await?;
    let unrated = match by.scope.is_staff() {
        true => sessions.unrated_since(&by.scope, since, rated_since, MAX_SESSIONS).await?,
        false => Vec::new(),
    };
    let wanting = |sessions: Vec<AttentionItem>| sessions.into_iter().map(SessionToReview::from).collect();
    let (box_asked, refused, unrated) = (wanting(box_asked), wanting(refused), wanting(unrated));
    Ok(Json(Attention { alarms: items, more, box_asked, refused, unrated }))
}

impl From<AttentionItem> for SessionToReview {
    fn from(of: AttentionItem) -> Self {
        let trainee = (of.trainee_id.to_string(), of.trainee_name.to_string(), of.trainee_code.to_string());
        let task = (of.task_id.to_string(), of.task_name.to_string(), of.task_code.to_string());
        let named = |(id, name, code)| NamedReference { id, name, code };
        Self { session: of.id, trainee: named(trainee), task: named(task), recorded_at: Time(of.recorded_at_ms) }
    }
}
