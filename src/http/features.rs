//! The list of features.

use super::auth::signed_in::Member;
use super::read::Json;
use super::show::PageResponse;
use crate::domain::feature::FeatureInfo;

/// List all features, in display order
#[utoipa::path(get, path = "/features", tag = "sessions", responses((status = OK, body = PageResponse<FeatureInfo>)))]
pub async fn list(_by: Member) -> Json<PageResponse<FeatureInfo>> {
    Json(PageResponse::whole(FeatureInfo::all()))
}
