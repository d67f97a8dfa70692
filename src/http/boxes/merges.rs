//! Two records of one box: merging them, and separating them again.

use axum::extract::State;

use crate::domain::record_merge::{BoxMergePreview, NewBoxMerge, RecordSeparation};
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::http::auth::signed_in::Administrator;
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey, PathPair, reference_problem};
use crate::http::record_merges::{MergePreviewResponse, MergeResponse};
use crate::http::show::{Created, NamedReference, PageResponse};
use crate::http::state::App;
use crate::ids::MergeId;
use crate::store::BoxRecord;

/// List the records that were merged into a box's, newest first
///
/// Also those that were separated again.
#[utoipa::path(get, path = "/boxes/{id}/merges", tag = "boxes",
    params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = PageResponse<MergeResponse>)))]
pub async fn merges(
    State(app): State<App>,
    by: Administrator,
    PathKey(key): PathKey,
) -> HandlerResult<Json<PageResponse<MergeResponse>>> {
    let kept = app.store.boxes().get(&by.scope, &key).await?.id;
    let merges = app.store.record_merges().of_box(&by.scope, kept).await?;
    Ok(Json(PageResponse::whole(merges.into_iter().map(MergeResponse::from))))
}

/// Look at what merging another record of the same box would do
///
/// Nothing is changed.
#[utoipa::path(post, path = "/boxes/{id}/merges/preview", tag = "boxes",
    params(("id" = String, Path, description = "id or code")), request_body = BoxMergePreview,
    responses((status = OK, body = MergePreviewResponse)))]
pub async fn preview_merge(
    State(app): State<App>,
    by: Administrator,
    PathKey(key): PathKey,
    Json(wanted): Json<BoxMergePreview>,
) -> HandlerResult<Json<MergePreviewResponse>> {
    let [kept, merged] = app.both_boxes(&by.scope, [&key, &wanted.other_box]).await?;
    let effect = app.store.record_merges().preview_boxes(&by.scope, [kept.id, merged.id]).await?;
    let merged = NamedReference { id: merged.id.to_string(), name: merged.name.into(), code: merged.code.to_string() };
    Ok(Json(MergePreviewResponse::new(merged, effect)))
}

/// Merge another record of the same box into this one
///
/// The other record is hidden, and its id and code lead to this one. Its sessions, versions of camera and colours,
/// self-tests, tokens and groups follow this record. The versions get higher numbers and stay valid from the same
/// time on, so recordings are tracked with the version of their day. Results stay as they are. Name, code, view and notes of
/// this record count.
///
/// Refused while a recording of one of them is arriving or being measured, and if both have the same recording of the same
/// trainee and task. `POST /boxes/{id}/merges/{merge}/separate` takes the merge back.
#[utoipa::path(post, path = "/boxes/{id}/merges", tag = "boxes",
    params(("id" = String, Path, description = "id or code")), request_body = NewBoxMerge,
    responses((status = CREATED, body = MergeResponse)))]
pub async fn merge(
    State(app): State<App>,
    by: Administrator,
    PathKey(key): PathKey,
    Json(new): Json<NewBoxMerge>,
) -> HandlerResult<Created<MergeResponse>> {
    let [kept, merged] = app.both_boxes(&by.scope, [&key, &new.other_box]).await?;
    let made = app.store.record_merges().merge_boxes(&by.scope, [kept.id, merged.id], new.why).await?;
    app.queue.work_arrived();
    Ok(Created { location: format!("/api/v1/boxes/{}/merges", kept.id), made: made.into() })
}

/// Separate two merged records of one box
///
/// The hidden record gets back what followed and is still there, and is shown again. What arrived since the merge stays with
/// this record; a session among it that was tracked with the camera of the other one is tracked again.
#[utoipa::path(post, path = "/boxes/{id}/merges/{merge}/separate", tag = "boxes",
    params(("id" = String, Path, description = "id or code"), ("merge" = String, Path, description = "id of the merge")),
    request_body = RecordSeparation, responses((status = OK, body = MergeResponse)))]
pub async fn separate(
    State(app): State<App>,
    by: Administrator,
    PathPair(key, merge): PathPair<String, MergeId>,
    Json(wanted): Json<RecordSeparation>,
) -> HandlerResult<Json<MergeResponse>> {
    let kept = app.store.boxes().get(&by.scope, &Key::from(&key)).await?.id;
    let made = app.store.record_merges().separate_boxes(&by.scope, kept, merge, wanted.why).await?;
    app.queue.work_arrived();
    Ok(Json(made.into()))
}

impl App {
    /// The record of the address, and the one that the body names.
    async fn both_boxes(&self, scope: &Scope, [kept, other]: [&Key; 2]) -> HandlerResult<[BoxRecord; 2]> {
        let kept = self.store.boxes().get(scope, kept).await?;
        let other = self.store.boxes().get(scope, other).await.map_err(reference_problem("box"))?;
        Ok([kept, other])
    }
}
