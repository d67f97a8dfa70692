//! What instructors give sessions on forms.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::domain::rating::{self, Form, FormInfo, Mark, NewRating};
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::Answer;
use crate::http::read::{At, Json};
use crate::http::show::{Created, Page, Time};
use crate::http::state::App;
use crate::ids::{RatingId, SessionId};
use crate::store;

/// What a rater gave a session on a form.
#[derive(Debug, Serialize, ToSchema)]
pub struct Rating {
    id: RatingId,
    /// What the rater is called; `null` where they are here no more.
    who: Option<String>,
    /// Is it of who asks?
    own: bool,
    form: Form,
    /// Wording of the form.
    version: i64,
    /// The marks, in the form's order.
    items: Vec<Mark>,
    /// Their sum; `null` where an item was not judged.
    total: Option<u32>,
    /// Was it given before anything of other raters could be seen? Agreement and correlations are made of such alone.
    blind: bool,
    created_at: Time,
}

/// A session's ratings.
#[derive(Debug, Serialize, ToSchema)]
pub struct Ratings {
    /// The last of each rater on each form, newest first. A member of staff sees others' on a form after one of their own; the
    /// session's trainee sees all.
    items: Vec<Rating>,
    /// How many people have rated on each form.
    raters: Vec<Raters>,
}

/// How many people have rated on a form.
#[derive(Debug, Serialize, ToSchema)]
pub struct Raters {
    form: Form,
    raters: usize,
}

impl Rating {
    fn new(rating: store::Rating, scope: &Scope) -> Self {
        let store::Rating { id, person_id, who, form, form_version, items, is_blind, created_at_ms } = rating;
        let own = person_id.is_some() && person_id == scope.person();
        let (who, total, created_at) = (who.map(String::from), rating::total(&items), Time(created_at_ms));
        Self { id, who, own, form, version: form_version, total, items, blind: is_blind, created_at }
    }
}

/// List the forms on which sessions are rated
#[utoipa::path(get, path = "/rating-forms", tag = "ratings", responses((status = OK, body = Page<FormInfo>)))]
pub async fn rating_forms(_by: Member) -> Json<Page<FormInfo>> {
    Json(Page::whole(FormInfo::all()))
}

/// List a session's ratings, as far as one may see them
#[utoipa::path(get, path = "/sessions/{id}/ratings", tag = "ratings",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = Ratings)))]
pub async fn ratings(State(app): State<App>, by: Member, at: At) -> Answer<Json<Ratings>> {
    let store::SeenRatings { items, raters } = app.store.ratings().of_session(&by.scope, at.id()?).await?;
    let items = items.into_iter().map(|rating| Rating::new(rating, &by.scope)).collect();
    let raters = raters.into_iter().map(|(form, raters)| Raters { form, raters }).collect();
    Ok(Json(Ratings { items, raters }))
}

/// Give a session a rating
///
/// Every item of the form is named, with a mark from 1 to 5, or `null` where it was not judged. A rating never changes: the same
/// person's next one on the form takes its place, and the earlier is kept. The session's trainee sees it.
#[utoipa::path(post, path = "/sessions/{id}/ratings", tag = "ratings",
    params(("id" = String, Path, description = "id")), request_body = NewRating,
    responses((status = CREATED, body = Rating)))]
pub async fn rate(State(app): State<App>, by: Staff, at: At, Json(new): Json<NewRating>) -> Answer<Created<Rating>> {
    let session: SessionId = at.id()?;
    let (marks, form) = (new.marks()?, FormInfo::of(new.form));
    let rating = app.store.ratings().give(&by.scope, session, (form.form, form.version), marks).await?;
    let location = format!("/api/v1/sessions/{session}/ratings");
    Ok(Created { location, made: Rating::new(rating, &by.scope) })
}
