//! Writes features as a table: of one session, or of many. Many sessions are read and sent page by page, so that a
//! table of any length needs the memory of one page.

use std::collections::HashSet;

use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures_util::stream::try_unfold;
use serde::Deserialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::error::{HandlerResult, ProblemResponse};
use super::file::disposition;
use super::state::App;
use crate::domain::files::features::{ExportRow, ExportedSession, FeatureTable, TableFormat, TableProblem};
use crate::domain::scope::Scope;
use crate::ids::TraineeId;
use crate::store::{Cursor, PageRequest, SessionFilter, SessionRecord, SessionResult, StoreError};
use crate::time::to_rfc3339;

/// Sessions that are read at a time; they give some thousands of rows.
const SESSIONS_PER_PAGE: u32 = 50;

/// How a table identifies trainees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum TraineeIdentifier {
    /// By id, which does not identify the person outside the centre.
    #[default]
    Id,
    /// By code. A code is derived from the name unless another was chosen.
    Code,
}

/// Why an export failed; the client sees the connection close before the table's end.
#[derive(Debug, thiserror::Error)]
enum ExportError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Table(#[from] TableProblem),
    #[error(transparent)]
    Thread(#[from] tokio::task::JoinError),
}

/// The table rows of a session.
pub fn rows(session: &SessionRecord, result: &SessionResult, called: TraineeIdentifier) -> Vec<ExportRow> {
    let whose = ExportedSession {
        session: session.id.to_string(),
        trainee: match called {
            TraineeIdentifier::Id => session.trainee_id.to_string(),
            TraineeIdentifier::Code => session.trainee_code.to_string(),
        },
        task: session.task_code.to_string(),
        in_box: session.box_code.to_string(),
        recorded_at: to_rfc3339(session.recorded_at_ms),
        tracker: session.tracker.as_ref().map(ToString::to_string),
        verdict: result.quality.get("verdict").and_then(Value::as_str).map(str::to_owned),
        versions: result.versions.clone(),
    };
    result.features.iter().map(|feature| ExportRow::new(&whose, feature)).collect()
}

/// Answers with the table of one session.
pub async fn export_session(rows: Vec<ExportRow>, format: TableFormat, name: &str) -> HandlerResult<Response> {
    let written = tokio::task::spawn_blocking(move || {
        let mut table = FeatureTable::new(format)?;
        let mut bytes = table.write(&rows)?;
        bytes.extend(table.finish()?);
        Ok::<_, TableProblem>(bytes)
    });
    let bytes = written.await.map_err(|cause| ProblemResponse::internal("writing features", cause))?;
    let bytes = bytes.map_err(|cause| ProblemResponse::internal("writing features", cause))?;
    Ok((StatusCode::OK, headers(format, name), bytes).into_response())
}

/// The sessions of a long table.
pub struct ExportSelection {
    /// Trainee, task and other filters.
    pub filter: SessionFilter,
    /// Only sessions of these trainees; `None`: of all.
    pub only: Option<HashSet<TraineeId>>,
    /// How the table identifies trainees.
    pub trainee_identifier: TraineeIdentifier,
}

/// State of a long table: the cursor of the next page and the table so far, or the end.
enum ExportState {
    NextPage(Option<Cursor>, FeatureTable),
    Finished,
}

/// Answers with the table of many sessions, which is sent while it is read: each page is read after the previous one
/// was sent. It occupies a slot for heavy answers.
pub async fn export_sessions(
    app: App,
    scope: Scope,
    many: ExportSelection,
    format: TableFormat,
    name: &str,
) -> HandlerResult<Response> {
    let slot = app.heavy_answers.take(&scope).await?;
    let table = FeatureTable::new(format).map_err(|cause| ProblemResponse::internal("writing features", cause))?;
    let parts =
        try_unfold((app, scope, many, ExportState::NextPage(None, table)), |(app, scope, many, place)| async move {
            let ExportState::NextPage(after, table) = place else { return Ok::<_, ExportError>(None) };
            let (bytes, place) = next_part(&app, &scope, &many, (after, table)).await?;
            Ok(Some((Bytes::from(bytes), (app, scope, many, place))))
        });
    Ok((StatusCode::OK, headers(format, name), slot.stream(None, parts)).into_response())
}

async fn next_part(
    app: &App,
    scope: &Scope,
    many: &ExportSelection,
    (after, table): (Option<Cursor>, FeatureTable),
) -> Result<(Vec<u8>, ExportState), ExportError> {
    let page = app.store.sessions().list(scope, &many.filter, &PageRequest::new(SESSIONS_PER_PAGE, after)).await?;
    let mut found = Vec::new();
    for session in &page.items {
        if many.only.as_ref().is_some_and(|only| !only.contains(&session.trainee_id)) {
            continue;
        }
        match app.store.sessions().result(scope, session.id).await {
            Ok(Some(result)) => found.extend(rows(session, &result, many.trainee_identifier)),
            Ok(None) | Err(StoreError::NotFound { .. }) => {} // the session was erased after the page was read
            Err(error) => return Err(error.into()),
        }
    }
    let next = page.next;
    let written = tokio::task::spawn_blocking(move || {
        let mut table = table;
        let mut bytes = table.write(&found)?;
        match next {
            Some(next) => Ok((bytes, ExportState::NextPage(Some(next), table))),
            None => {
                bytes.extend(table.finish()?);
                Ok((bytes, ExportState::Finished))
            }
        }
    });
    written.await?
}

fn headers(format: TableFormat, name: &str) -> HeaderMap {
    let mut headers = HeaderMap::new();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(format.media_type()));
    let name = format!("{name}.{}", format.extension());
    headers.extend(HeaderValue::try_from(disposition("inline", &name)).map(|name| (header::CONTENT_DISPOSITION, name)));
    headers
}
