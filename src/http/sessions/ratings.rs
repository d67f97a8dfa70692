//! Ratings of sessions by instructors, on standard forms.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::access::AccessedPart;
use crate::domain::rating::{self, ApplicableTotal, FormInfo, ItemMark, NewRating, RatingForm};
use crate::domain::scope::Scope;
use crate::domain::task::require_form;
use crate::domain::text::Key;
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey};
use crate::http::show::{Created, PageResponse, Time};
use crate::http::state::App;
use crate::ids::{RatingId, SessionId};
use crate::store;

/// A rating of a session on a form.
#[derive(Debug, Serialize, ToSchema)]
pub struct RatingResponse {
    id: RatingId,
    /// Name of the rater; `null` if the person was deleted.
    who: Option<String>,
    /// True if it is the caller's own rating.
    own: bool,
    form: RatingForm,
    /// Version of the form's wording.
    version: i64,
    /// The marks, in the form's order.
    items: Vec<ItemMark>,
    /// Sum of the marks of all items of the form; `null` if an item was not judged or does not apply.
    total: Option<u32>,
    /// Sum of the marks of the items that apply, and the highest possible sum of these items; `null` if one of them was
    /// not judged. Totals of different items are not comparable: agreement and correlations never mix them.
    applicable_total: Option<ApplicableTotal>,
    /// The rater's remark on the whole session: plain text, never markup.
    remark: Option<String>,
    /// True if the rater could see nothing of other raters before. Agreement and correlations use only such ratings.
    blind: bool,
    created_at: Time,
}

/// A session's ratings.
#[derive(Debug, Serialize, ToSchema)]
pub struct RatingsResponse {
    /// The latest rating of each rater on each form, newest first. Staff see other ratings on a form after rating the
    /// session on it themselves; the session's trainee sees all.
    items: Vec<RatingResponse>,
    /// Number of raters on each form.
    raters: Vec<RaterCount>,
}

/// Number of raters on a form.
#[derive(Debug, Serialize, ToSchema)]
pub struct RaterCount {
    form: RatingForm,
    raters: usize,
}

impl RatingResponse {
    fn new(rating: store::RatingRecord, scope: &Scope) -> Self {
        let store::RatingRecord { id, person_id, who, form, form_version, items, remark, is_blind, created_at_ms } =
            rating;
        let own = person_id.is_some() && person_id == scope.person();
        Self {
            id,
            who: who.map(String::from),
            own,
            form,
            version: form_version,
            total: rating::total(&items),
            applicable_total: rating::applicable_total(&items),
            items,
            remark: remark.map(String::from),
            blind: is_blind,
            created_at: Time(created_at_ms),
        }
    }
}

/// List the rating forms
#[utoipa::path(get, path = "/rating-forms", tag = "ratings", responses((status = OK, body = PageResponse<FormInfo>)))]
pub async fn rating_forms(_by: Member) -> Json<PageResponse<FormInfo>> {
    Json(PageResponse::whole(FormInfo::all()))
}

/// List a session's ratings that the caller may see
#[utoipa::path(get, path = "/sessions/{id}/ratings", tag = "ratings",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = RatingsResponse)))]
pub async fn ratings(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<RatingsResponse>> {
    let session = at.id()?;
    let ratings = app.ratings_of(&by.scope, session).await?;
    app.note_access(&by.scope, session, AccessedPart::Remarks);
    Ok(Json(ratings))
}

impl App {
    /// The ratings of a session that the scope may see.
    pub(in crate::http) async fn ratings_of(
        &self,
        scope: &Scope,
        session: SessionId,
    ) -> HandlerResult<RatingsResponse> {
        let store::VisibleRatings { items, raters } = self.store.ratings().of_session(scope, session).await?;
        let items = items.into_iter().map(|rating| RatingResponse::new(rating, scope)).collect();
        let raters = raters.into_iter().map(|(form, raters)| RaterCount { form, raters }).collect();
        Ok(RatingsResponse { items, raters })
    }
}

/// Rate a session
///
/// The body names every item of the form with a mark from 1 to 5, or `null` if it was not judged. Items that do not exist
/// in the session's task are named in `does_not_apply`; the total is then that of the others. The form is one of the
/// task's `rating_forms`. A rating never changes: a person's next rating on the same form replaces it in the list, and the
/// earlier one is kept. The session's trainee sees it.
#[utoipa::path(post, path = "/sessions/{id}/ratings", tag = "ratings",
    params(("id" = String, Path, description = "id")), request_body = NewRating,
    responses((status = CREATED, body = RatingResponse)))]
pub async fn rate(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Json(new): Json<NewRating>,
) -> HandlerResult<Created<RatingResponse>> {
    let session: SessionId = at.id()?;
    let new = new.check()?;
    let rated = app.store.sessions().get(&by.scope, session).await?;
    let task = app.store.tasks().get(&by.scope, &Key::from(&rated.task_id)).await?;
    require_form(task.rating_forms.as_deref(), new.form)?;
    let rating = app.store.ratings().give(&by.scope, session, new).await?;
    app.notify_session_changed(&rated);
    let location = format!("/api/v1/sessions/{session}/ratings");
    Ok(Created { location, made: RatingResponse::new(rating, &by.scope) })
}
