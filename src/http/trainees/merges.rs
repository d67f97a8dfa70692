//! Two records of one person: merging them, and separating them again.

use axum::extract::State;

use crate::domain::record_merge::{NewTraineeMerge, RecordSeparation, TraineeMergePreview};
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::http::auth::signed_in::Administrator;
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey, PathPair, reference_problem};
use crate::http::record_merges::{MergePreviewResponse, MergeResponse};
use crate::http::show::{Created, NamedReference, PageResponse};
use crate::http::state::App;
use crate::ids::MergeId;
use crate::store::TraineeRecord;

/// List the records that were merged into a trainee's, newest first
///
/// Also those that were separated again.
#[utoipa::path(get, path = "/trainees/{id}/merges", tag = "trainees",
    params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = PageResponse<MergeResponse>)))]
pub async fn merges(
    State(app): State<App>,
    by: Administrator,
    PathKey(key): PathKey,
) -> HandlerResult<Json<PageResponse<MergeResponse>>> {
    let kept = app.store.trainees().get(&by.scope, &key).await?.id;
    let merges = app.store.record_merges().of_trainee(&by.scope, kept).await?;
    Ok(Json(PageResponse::whole(merges.into_iter().map(MergeResponse::from))))
}

/// Look at what merging another record of the same person would do
///
/// Nothing is changed.
#[utoipa::path(post, path = "/trainees/{id}/merges/preview", tag = "trainees",
    params(("id" = String, Path, description = "id or code")), request_body = TraineeMergePreview,
    responses((status = OK, body = MergePreviewResponse)))]
pub async fn preview_merge(
    State(app): State<App>,
    by: Administrator,
    PathKey(key): PathKey,
    Json(wanted): Json<TraineeMergePreview>,
) -> HandlerResult<Json<MergePreviewResponse>> {
    let [kept, merged] = app.both_records(&by.scope, [&key, &wanted.trainee]).await?;
    let months = app.retention.videos_months;
    let ids = [kept.id, merged.id];
    let effect = app.store.record_merges().preview_trainees(&by.scope, ids, months).await?;
    let merged = NamedReference { id: merged.id.to_string(), name: merged.name.into(), code: merged.code.to_string() };
    Ok(Json(MergePreviewResponse::new(merged, effect)))
}

/// Merge another record of the same person into this one
///
/// The other record is hidden, and its id and code lead to this one. Its sessions, groups, consents and all else follow
/// this record, and so do progress, standards, courses, comparisons and exports. What both have counts once: of a
/// recording that was filed twice, that of this record; the other one stays, hidden. Name, code, level and preferred hand
/// of this record count; the last two are taken over if it lacks them. The latest decision about recordings counts, and the
/// shorter time for keeping videos. If both have an account, the other one can no longer sign in, and its accounts of
/// single sign-on, tokens and comments go to the one of this record.
///
/// `POST /trainees/{id}/merges/{merge}/separate` takes the merge back. If this record is erased, both are.
#[utoipa::path(post, path = "/trainees/{id}/merges", tag = "trainees",
    params(("id" = String, Path, description = "id or code")), request_body = NewTraineeMerge,
    responses((status = CREATED, body = MergeResponse)))]
pub async fn merge(
    State(app): State<App>,
    by: Administrator,
    PathKey(key): PathKey,
    Json(new): Json<NewTraineeMerge>,
) -> HandlerResult<Created<MergeResponse>> {
    let [kept, merged] = app.both_records(&by.scope, [&key, &new.trainee]).await?;
    let merges = app.store.record_merges();
    let limits = (app.retention.videos_months, new.confirmed_videos);
    let made = merges.merge_trainees(&by.scope, [kept.id, merged.id], new.why, limits).await?;
    let consent = app.store.consents().of_trainee(&by.scope, kept.id).await?;
    if consent.state.ends_running_recordings() {
        let feeds = app.feeds.clone();
        app.shutdown.spawn(async move { feeds.end_recordings_of(kept.id).await });
    }
    app.end_invalid_check_ins_and_waits().await;
    Ok(Created { location: format!("/api/v1/trainees/{}/merges", kept.id), made: made.into() })
}

/// Separate two merged records of one person
///
/// The hidden record gets back what followed and is still there, and is shown again. What arrived since the merge stays with
/// this record; sessions among it can be moved. Accounts that change hands are signed out.
#[utoipa::path(post, path = "/trainees/{id}/merges/{merge}/separate", tag = "trainees",
    params(("id" = String, Path, description = "id or code"), ("merge" = String, Path, description = "id of the merge")),
    request_body = RecordSeparation, responses((status = OK, body = MergeResponse)))]
pub async fn separate(
    State(app): State<App>,
    by: Administrator,
    PathPair(key, merge): PathPair<String, MergeId>,
    Json(wanted): Json<RecordSeparation>,
) -> HandlerResult<Json<MergeResponse>> {
    let kept = app.store.trainees().get(&by.scope, &Key::from(&key)).await?.id;
    let separated = app.store.record_merges().separate_trainees(&by.scope, kept, merge, wanted.why).await?;
    app.end_invalid_check_ins_and_waits().await;
    Ok(Json(separated.into()))
}

impl App {
    /// The record of the address, and the one that the body names.
    async fn both_records(&self, scope: &Scope, [kept, other]: [&Key; 2]) -> HandlerResult<[TraineeRecord; 2]> {
        let kept = self.store.trainees().get(scope, kept).await?;
        let other = self.store.trainees().get(scope, other).await.map_err(reference_problem("trainee"))?;
        Ok([kept, other])
    }
}
