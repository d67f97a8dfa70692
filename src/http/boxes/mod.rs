//! Box trainers, their camera calibrations, tool colours and self-tests.

mod calibrations;
mod form;
mod looks;
mod palette;
mod self_tests;

use axum::extract::State;
use axum::http::StatusCode;
pub use calibrations::*;
pub use looks::*;
pub use palette::*;
pub use self_tests::*;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::{Member, Staff};
use super::error::Answer;
use super::read::{At, Json, Params};
use super::show::{Created, Page, Paging, Time};
use super::state::App;
use crate::domain::boxes::{BoxChange, BoxTool, NewBox};
use crate::domain::files::annotations::View;
use crate::domain::scope::Scope;
use crate::domain::text::{Code, Name, Paragraphs};
use crate::ids::BoxId;
use crate::store;

/// A box trainer and its setup: camera, colours, self-test.
#[derive(Debug, Serialize, ToSchema)]
pub struct TrainingBox {
    id: BoxId,
    code: Code,
    name: Name,
    /// Where the camera is placed.
    view: Option<View>,
    notes: Paragraphs,
    created_at: Time,
    /// The camera calibration in use; `null`: none, and recordings wait until there is one.
    calibration: Option<Calibration>,
    /// Version of the colours in use; `null`: none, and recordings wait until there are some.
    palette: Option<i64>,
    /// The tools whose colours were learned.
    tools: Vec<BoxTool>,
    /// The traffic light of today's last self-test; `null`: no self-test today.
    self_test: Option<TodaysLight>,
}

impl App {
    /// A box with its calibration, colours and self-test of today.
    async fn show_box(&self, scope: &Scope, found: store::TrainingBox) -> Answer<TrainingBox> {
        let calibration = self.store.calibrations().latest(scope, found.id).await?;
        let palette = self.store.palettes().latest(scope, found.id).await?;
        Ok(TrainingBox {
            id: found.id,
            code: found.code,
            name: found.name,
            view: found.view,
            notes: found.notes,
            created_at: Time(found.created_at_ms),
            calibration: calibration.map(Calibration::from),
            palette: palette.as_ref().map(|palette| palette.version),
            self_test: self.light_of_today(scope, found.id).await?,
            tools: palette.map(|palette| palette.tools).unwrap_or_default(),
        })
    }
}

/// List the boxes
#[utoipa::path(get, path = "/boxes", tag = "boxes", params(Paging), responses((status = OK, body = Page<TrainingBox>)))]
pub async fn list(
    State(app): State<App>,
    by: Member,
    Params(paging): Params<Paging>,
) -> Answer<Json<Page<TrainingBox>>> {
    let page = paging.request(app.settings.page_items)?;
    let store::Page { items, next } = app.store.boxes().list(&by.scope, &page).await?;
    let mut shown = Vec::with_capacity(items.len());
    for found in items {
        shown.push(app.show_box(&by.scope, found).await?);
    }
    Ok(Json(Page { items: shown, next }))
}

/// Register a box
#[utoipa::path(post, path = "/boxes", tag = "boxes", request_body = NewBox, responses((status = CREATED, body = TrainingBox)))]
pub async fn create(State(app): State<App>, by: Staff, Json(new): Json<NewBox>) -> Answer<Created<TrainingBox>> {
    let made = app.store.boxes().create(&by.scope, new).await?;
    let location = format!("/api/v1/boxes/{}", made.id);
    Ok(Created { location, made: app.show_box(&by.scope, made).await? })
}

/// Read one box
#[utoipa::path(get, path = "/boxes/{id}", tag = "boxes", params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = TrainingBox)))]
pub async fn get(State(app): State<App>, by: Member, At(key): At) -> Answer<Json<TrainingBox>> {
    let found = app.store.boxes().get(&by.scope, &key).await?;
    Ok(Json(app.show_box(&by.scope, found).await?))
}

/// Change a box
#[utoipa::path(patch, path = "/boxes/{id}", tag = "boxes", params(("id" = String, Path, description = "id or code")),
    request_body = BoxChange, responses((status = OK, body = TrainingBox)))]
pub async fn change(
    State(app): State<App>,
    by: Staff,
    At(key): At,
    Json(change): Json<BoxChange>,
) -> Answer<Json<TrainingBox>> {
    let changed = app.store.boxes().change(&by.scope, &key, change).await?;
    Ok(Json(app.show_box(&by.scope, changed).await?))
}

/// Delete a box that has no sessions
#[utoipa::path(delete, path = "/boxes/{id}", tag = "boxes", params(("id" = String, Path, description = "id or code")),
    responses((status = NO_CONTENT)))]
pub async fn delete(State(app): State<App>, by: Staff, At(key): At) -> Answer<StatusCode> {
    app.store.boxes().delete(&by.scope, &key).await?;
    Ok(StatusCode::NO_CONTENT)
}
