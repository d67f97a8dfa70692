//! The list of features.

use super::auth::signed_in::Member;
use super::read::Json;
use super::show::Page;
use crate::domain::feature::FeatureInfo;

/// List all features, in display order
#[utoipa::path(get, path = "/features", tag = "sessions", responses((status = OK, body = Page<FeatureInfo>)))]
pub async fn list(_by: Member) -> Json<Page<FeatureInfo>> {
    Json(Page::whole(FeatureInfo::all()))
}
