//! Exports a task's features of all trainees as a table, for administrators.

use std::collections::HashSet;

use axum::extract::State;
use axum::response::Response;
use serde::Deserialize;
use utoipa::IntoParams;

use crate::domain::files::features::TableFormat;
use crate::domain::scope::Scope;
use crate::domain::session::SessionStatus;
use crate::domain::text::Key;
use crate::http::auth::signed_in::Administrator;
use crate::http::error::HandlerResult;
use crate::http::export::{self, ExportSelection, TraineeIdentifier};
use crate::http::read::{Params, PathKey, reference_problem};
use crate::http::state::App;
use crate::ids::TraineeId;
use crate::store::{PageRequest, SessionFilter};

/// Selects the rows of a table and its format.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct TaskFeaturesQuery {
    /// Format of the table.
    #[serde(default)]
    #[param(inline)]
    format: TableFormat,
    /// Only members of this cohort, by id or code.
    #[param(value_type = Option<String>)]
    cohort: Option<Key>,
    /// How the table identifies trainees. A code may be derived from the name: use ids in a table that
    /// leaves the centre.
    #[serde(default)]
    #[param(inline)]
    trainees: TraineeIdentifier,
}

/// Read all features of a task as one table
///
/// The table contains no names. It has one row for each feature and tool of each session that is done and not set
/// aside, newest sessions first. It is sent while it is read: if the connection closes before the table's end, the
/// export failed.
#[utoipa::path(get, path = "/tasks/{id}/features", tag = "tasks",
    params(("id" = String, Path, description = "id or code"), TaskFeaturesQuery),
    responses((status = OK, description = "The table: session, trainee, task, …", content(
        (Object = "application/json"), (String = "text/csv"), (Vec<u8> = "application/vnd.apache.parquet")))))]
pub async fn features(
    State(app): State<App>,
    by: Administrator,
    PathKey(key): PathKey,
    Params(TaskFeaturesQuery { format, cohort, trainees }): Params<TaskFeaturesQuery>,
) -> HandlerResult<Response> {
    let task = app.store.tasks().get(&by.scope, &key).await?;
    let only = match &cohort {
        Some(key) => Some(members(&app, &by.scope, key).await?),
        None => None,
    };
    let status = Some(SessionStatus::Done);
    let of_task = Some(Key::from(&task.id));
    let filter = SessionFilter { task: of_task, status, only_counting: true, ..SessionFilter::default() };
    let name = format!("features-{}", task.code);
    export::export_sessions(
        app,
        by.scope,
        ExportSelection { filter, only, trainee_identifier: trainees },
        format,
        &name,
    )
    .await
}

/// All members of a cohort, read page by page.
async fn members(app: &App, scope: &Scope, cohort: &Key) -> HandlerResult<HashSet<TraineeId>> {
    let (mut all, mut after) = (HashSet::new(), None);
    loop {
        let page = PageRequest::new(PageRequest::MAX_LIMIT, after);
        let page = app.store.cohorts().members(scope, cohort, &page).await.map_err(reference_problem("cohort"))?;
        all.extend(page.items);
        after = page.next;
        if after.is_none() {
            return Ok(all);
        }
    }
}
