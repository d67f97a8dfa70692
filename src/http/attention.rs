//! Who needs somebody: what came lately and wants to be looked at, and what the standards' charts say.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::Member;
use super::error::Answer;
use super::read::Json;
use super::show::{Named, Time};
use super::state::App;
use crate::cohorts::{Alarm, Alarms};
use crate::ids::SessionId;
use crate::store::Waiting;

const DAY_MS: i64 = 86_400_000;
/// What came before is told no more.
const LATELY_MS: i64 = 14 * DAY_MS;
/// A task on which nobody rated for so long is one that is not rated.
const RATED_MS: i64 = 90 * DAY_MS;
/// Sessions of a kind that are told at most.
const MOST: u32 = 20;

/// Who needs somebody, of those whom one sees.
#[derive(Debug, Serialize, ToSchema)]
pub struct Attention {
    /// Relapses, and refreshers that are due, the latest first.
    alarms: Vec<Alarm>,
    /// Did more people train lately than were looked at?
    more: bool,
    /// Sessions of the last fortnight that the quality gate refused, at most twenty.
    refused: Vec<Wanting>,
    /// Sessions of the last fortnight that nobody has rated, of tasks that are rated; at most twenty. For staff.
    unrated: Vec<Wanting>,
}

/// A session that wants somebody.
#[derive(Debug, Serialize, ToSchema)]
pub struct Wanting {
    session: SessionId,
    trainee: Named,
    task: Named,
    recorded_at: Time,
}

/// Read who needs somebody
///
/// What failed is in `GET /sessions?status=failed`.
#[utoipa::path(get, path = "/attention", tag = "trainees", responses((status = OK, body = Attention)))]
pub async fn attention(State(app): State<App>, by: Member) -> Answer<Json<Attention>> {
    let (sessions, now_ms) = (app.store.sessions(), app.clock.now_ms());
    let (since, rated_since) = (now_ms.saturating_sub(LATELY_MS), now_ms.saturating_sub(RATED_MS));
    let Alarms { items, more } = app.cohorts.alarms(&by.scope).await?;
    let refused = sessions.refused_since(&by.scope, since, MOST).await?;
    let unrated = match by.scope.is_staff() {
        true => sessions.unrated_since(&by.scope, since, rated_since, MOST).await?,
        false => Vec::new(),
    };
    let wanting = |sessions: Vec<Waiting>| sessions.into_iter().map(Wanting::from).collect();
    Ok(Json(Attention { alarms: items, more, refused: wanting(refused), unrated: wanting(unrated) }))
}

impl From<Waiting> for Wanting {
    fn from(of: Waiting) -> Self {
        let trainee = (of.trainee_id.to_string(), of.trainee_name.to_string(), of.trainee_code.to_string());
        let task = (of.task_id.to_string(), of.task_name.to_string(), of.task_code.to_string());
        let named = |(id, name, code)| Named { id, name, code };
        Self { session: of.id, trainee: named(trainee), task: named(task), recorded_at: Time(of.recorded_at_ms) }
    }
}
