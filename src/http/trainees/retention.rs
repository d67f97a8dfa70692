//! How long the videos of one trainee are kept.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::domain::personal_retention::{MAX_MONTHS, NewPersonalRetention, kept_months};
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::{HandlerResult, ProblemResponse};
use crate::http::read::{Json, PathKey};
use crate::http::show::Time;
use crate::http::state::App;
use crate::store::PersonalRetentionRecord;
use crate::upkeep::RetentionSettings;

/// How long the videos of a trainee are kept. Months count from the arrival of a session; 0: until the session is erased.
#[derive(Debug, Serialize, ToSchema)]
pub struct RetentionResponse {
    /// The months that count: the shorter of the trainee's and the centre's, unless a longer time has a `reason`.
    months: u32,
    /// The trainee's own months; `null`: as the centre's setting says.
    own_months: Option<u32>,
    /// The centre's setting.
    centre_months: u32,
    /// Why longer than the centre keeps videos: plain text, never markup; `null` otherwise.
    reason: Option<String>,
    /// Name of the person who set it; `null` if the person was deleted, or if nothing is set.
    who: Option<String>,
    changed_at: Option<Time>,
    /// Number of videos that are kept.
    videos: i64,
    /// When the oldest session arrived whose video is kept; `null`: there is none.
    oldest_at: Option<Time>,
    /// When its video is deleted, at the earliest; `null`: there is none, or it is kept.
    oldest_deleted_at: Option<Time>,
}

impl RetentionResponse {
    /// The answer for a centre with this setting.
    pub(in crate::http) fn new(found: PersonalRetentionRecord, centre_months: u32) -> Self {
        let PersonalRetentionRecord { own_months, reason, who, changed_at_ms, months, oldest_ms, videos } = found;
        let deleted_at_ms = oldest_ms.and_then(|oldest_ms| RetentionSettings::deleted_at_ms(oldest_ms, months));
        let (reason, who) = (reason.map(String::from), who.map(String::from));
        let changed_at = changed_at_ms.map(Time);
        let (oldest_at, oldest_deleted_at) = (oldest_ms.map(Time), deleted_at_ms.map(Time));
        Self { months, own_months, centre_months, reason, who, changed_at, videos, oldest_at, oldest_deleted_at }
    }
}

/// A time to look at before it is set.
#[derive(Clone, Copy, Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RetentionPreviewRequest {
    /// Months; 0: videos are kept; `null`: as the centre's setting says.
    #[serde(deserialize_with = "Option::deserialize")]
    #[schema(required = true)]
    months: Option<u32>,
}

/// What a time would delete at once.
#[derive(Debug, Serialize, ToSchema)]
pub struct RetentionPreview {
    /// True if the time is longer than the centre's, so that it needs a reason.
    needs_reason: bool,
    /// Number of videos.
    videos: u64,
    /// Their size, bytes.
    bytes: u64,
}

/// Read for how long the videos of a trainee are kept
#[utoipa::path(get, path = "/trainees/{id}/retention", tag = "consent",
    params(("id" = String, Path, description = "id or code")), responses((status = OK, body = RetentionResponse)))]
pub async fn retention(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
) -> HandlerResult<Json<RetentionResponse>> {
    let trainee = app.store.trainees().get(&by.scope, &key).await?.id;
    let centre = app.retention.videos_months;
    let found = app.store.personal_retention().of_trainee(&by.scope, trainee, centre).await?;
    Ok(Json(RetentionResponse::new(found, centre)))
}

/// Look at what another time would delete at once
#[utoipa::path(post, path = "/trainees/{id}/retention/preview", tag = "consent",
    params(("id" = String, Path, description = "id or code")), request_body = RetentionPreviewRequest,
    responses((status = OK, body = RetentionPreview)))]
pub async fn preview_retention(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(RetentionPreviewRequest { months }): Json<RetentionPreviewRequest>,
) -> HandlerResult<Json<RetentionPreview>> {
    let trainee = app.store.trainees().get(&by.scope, &key).await?.id;
    let centre = app.retention.videos_months;
    if months.is_some_and(|months| months > MAX_MONTHS) {
        return Err(ProblemResponse::invalid("months", format!("expected at most {MAX_MONTHS}")));
    }
    // Only a time that is longer than the centre's is another one with a reason than without.
    let with_reason = months.map_or(centre, |months| kept_months(centre, Some((months, true))));
    let needs_reason = with_reason != kept_months(centre, months.map(|months| (months, false)));
    let (videos, bytes) = app.store.personal_retention().due_videos(&by.scope, trainee, with_reason).await?;
    Ok(Json(RetentionPreview { needs_reason, videos, bytes }))
}

/// Set for how long the videos of a trainee are kept
///
/// The shorter of this time and the centre's setting counts; a longer time needs a `reason` and counts then. A time that
/// deletes videos at once needs their number in `confirmed_videos` (409 otherwise). Paths, features and ratings stay.
#[utoipa::path(put, path = "/trainees/{id}/retention", tag = "consent",
    params(("id" = String, Path, description = "id or code")), request_body = NewPersonalRetention,
    responses((status = OK, body = RetentionResponse)))]
pub async fn set_retention(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(new): Json<NewPersonalRetention>,
) -> HandlerResult<Json<RetentionResponse>> {
    let trainee = app.store.trainees().get(&by.scope, &key).await?.id;
    let centre = app.retention.videos_months;
    let reason = new.checked_reason(centre)?;
    let own = new.months.map(|months| (months, reason));
    let limits = (centre, new.confirmed_videos);
    let found = app.store.personal_retention().set(&by.scope, trainee, own, limits).await?;
    Ok(Json(RetentionResponse::new(found, centre)))
}
