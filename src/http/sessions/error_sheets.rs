//! Error sheets of sessions: what raters count while they watch, and the score that it gives.

use axum::extract::State;
use axum::http::StatusCode;
use serde::Serialize;
use utoipa::ToSchema;

use crate::cohorts::ErrorScoreAnswer;
use crate::cohorts::answer::NoScore;
use crate::domain::access::AccessedPart;
use crate::domain::error_sheet::{
    ErrorItem, ErrorScore, ItemValue, NewErrorMark, NewSheetValues, NoErrorScore, values_of,
};
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::HandlerResult;
use crate::http::read::{Json, PathKey, PathPair};
use crate::http::show::{Created, Time};
use crate::http::state::App;
use crate::http::tasks::{ErrorListResponse, ScoreFormulaResponse};
use crate::ids::{ErrorMarkId, ErrorSheetId, SessionId};
use crate::store;

/// An error on a sheet.
#[derive(Debug, Serialize, ToSchema)]
pub struct ErrorMarkResponse {
    id: ErrorMarkId,
    /// Short name of the item.
    item: String,
    /// Second of the recording; `null`: not at one moment.
    at_s: Option<f64>,
}

/// A rater's error sheet of a session.
#[derive(Debug, Serialize, ToSchema)]
pub struct ErrorSheetResponse {
    id: ErrorSheetId,
    /// Name of the rater; `null` if the person was deleted.
    who: Option<String>,
    /// True if it is the caller's own sheet.
    own: bool,
    /// Version of the task's list that it is filled in with.
    list: i64,
    /// The items of that list.
    items: Vec<ErrorItem>,
    /// What it says of each item.
    values: Vec<ItemValue>,
    /// The marks of counted items and of yes, in order of time.
    marks: Vec<ErrorMarkResponse>,
    /// The time that the rater measured, s; `null`: none was typed.
    time_s: Option<f64>,
    /// True if the rater could not see the sheets of others before; `null` while it is open.
    blind: Option<bool>,
    /// False if it is filled in with the list of another task: it is kept, and does not count.
    counts: bool,
    /// Name of the task of its list.
    task: String,
    created_at: Time,
    /// When it was finished; `null` while it is open. Only a finished sheet says anything about errors.
    finished_at: Option<Time>,
}

/// A session's error sheets, and the score that they give.
#[derive(Debug, Serialize, ToSchema)]
pub struct ErrorSheetsResponse {
    /// The version of the task's list that is in use; `null` if the task has none.
    list: Option<ErrorListResponse>,
    /// The caller's open sheet; `null`: there is none.
    open: Option<ErrorSheetResponse>,
    /// The latest finished sheet of each rater, oldest first. Staff see those of others after finishing one themselves;
    /// the session's trainee sees all.
    items: Vec<ErrorSheetResponse>,
    /// Number of finished sheets by others that are hidden until the caller has finished one.
    hidden: usize,
    /// The score, or why there is none.
    score: ErrorScoreResponse,
}

/// The score of a session by a formula.
#[derive(Debug, Serialize, ToSchema)]
pub struct ErrorScoreResponse {
    /// The version of the task's formula; `null` if none is valid on the day of the session, or if a formula was tried.
    formula: Option<ScoreFormulaResponse>,
    /// The score with its parts; `null` if `none` says why.
    score: Option<ErrorScore>,
    /// Why there is no score.
    none: Option<NoScore>,
}

impl From<store::ErrorMarkRecord> for ErrorMarkResponse {
    fn from(store::ErrorMarkRecord { id, item, at_s, .. }: store::ErrorMarkRecord) -> Self {
        Self { id, item, at_s }
    }
}

impl ErrorSheetResponse {
    fn new(sheet: store::ErrorSheetRecord, scope: &Scope) -> Self {
        let own = sheet.person_id.is_some() && sheet.person_id == scope.person();
        let values = values_of(&sheet.items, sheet.marks.iter().map(|mark| (mark.item.as_str(), mark.amount)));
        let marks = sheet.marks.into_iter().filter(|mark| mark.amount.is_none()).map(ErrorMarkResponse::from).collect();
        Self {
            id: sheet.id,
            who: sheet.who.map(String::from),
            own,
            list: sheet.version,
            items: sheet.items,
            values,
            marks,
            time_s: sheet.time_s,
            blind: sheet.is_blind,
            counts: sheet.counts,
            task: sheet.task_name.into(),
            created_at: Time(sheet.created_at_ms),
            finished_at: sheet.finished_at_ms.map(Time),
        }
    }
}

impl ErrorScoreResponse {
    /// The score by a formula that was tried.
    pub(in crate::http) fn tried(score: Result<ErrorScore, NoErrorScore>) -> Self {
        let none = score.as_ref().err().copied().map(NoScore::from);
        Self { formula: None, score: score.ok(), none }
    }

    fn new(ErrorScoreAnswer { formula, score }: ErrorScoreAnswer, scope: &Scope) -> Self {
        let formula = formula.map(|formula| ScoreFormulaResponse::new(formula, scope));
        Self { formula, ..Self::tried(score) }
    }
}

impl App {
    /// The error sheets of a session that the scope may see, with the score.
    pub(in crate::http) async fn error_sheets_of(
        &self,
        scope: &Scope,
        session: SessionId,
    ) -> HandlerResult<ErrorSheetsResponse> {
        let session = self.store.sessions().get(scope, session).await?;
        let sheets = self.store.error_sheets().of_session(scope, session.id).await?;
        let score = self.cohorts.error_score(scope, &session, &sheets).await?;
        let list = self.store.error_lists().in_use(scope, session.task_id).await?;
        let store::VisibleErrorSheets { open, finished, hidden } = sheets;
        Ok(ErrorSheetsResponse {
            list: list.map(|list| ErrorListResponse::new(list, scope)),
            open: open.map(|sheet| ErrorSheetResponse::new(sheet, scope)),
            items: finished.into_iter().map(|sheet| ErrorSheetResponse::new(sheet, scope)).collect(),
            hidden,
            score: ErrorScoreResponse::new(score, scope),
        })
    }
}

/// List a session's error sheets that the caller may see, with the score
///
/// The score uses the finished sheets. Without one, the session is not rated: that is not the same as no errors.
#[utoipa::path(get, path = "/sessions/{id}/error-sheets", tag = "ratings",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = ErrorSheetsResponse)))]
pub async fn error_sheets(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<ErrorSheetsResponse>> {
    let session = at.id()?;
    let sheets = app.error_sheets_of(&by.scope, session).await?;
    app.note_access(&by.scope, session, AccessedPart::Remarks);
    Ok(Json(sheets))
}

/// Begin the caller's error sheet of a session
///
/// Also while the recording is arriving. If the caller has an open sheet, that one is returned. If the caller has
/// finished one, the new sheet corrects it and begins as its copy: the finished one counts until the correction is
/// finished. No other person sees an open sheet.
#[utoipa::path(post, path = "/sessions/{id}/error-sheets", tag = "ratings",
    params(("id" = String, Path, description = "id")), responses((status = CREATED, body = ErrorSheetResponse)))]
pub async fn begin_error_sheet(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
) -> HandlerResult<Created<ErrorSheetResponse>> {
    let session: SessionId = at.id()?;
    let sheet = app.store.error_sheets().begin(&by.scope, session).await?;
    let location = format!("/api/v1/sessions/{session}/error-sheets");
    Ok(Created { location, made: ErrorSheetResponse::new(sheet, &by.scope) })
}

/// Set the typed values of the caller's open error sheet
///
/// The amounts and the time replace those before. An amount that is left out is unknown, not zero.
#[utoipa::path(put, path = "/sessions/{id}/error-sheet", tag = "ratings",
    params(("id" = String, Path, description = "id")), request_body = NewSheetValues,
    responses((status = OK, body = ErrorSheetResponse)))]
pub async fn set_error_values(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Json(values): Json<NewSheetValues>,
) -> HandlerResult<Json<ErrorSheetResponse>> {
    let session: SessionId = at.id()?;
    values.check(&app.store.error_sheets().open_items(&by.scope, session).await?)?;
    let sheet = app.store.error_sheets().set_values(&by.scope, session, values).await?;
    Ok(Json(ErrorSheetResponse::new(sheet, &by.scope)))
}

/// Discard the caller's open error sheet
///
/// A finished sheet that it would have corrected stays.
#[utoipa::path(delete, path = "/sessions/{id}/error-sheet", tag = "ratings",
    params(("id" = String, Path, description = "id")), responses((status = NO_CONTENT)))]
pub async fn discard_error_sheet(State(app): State<App>, by: Staff, at: PathKey) -> HandlerResult<StatusCode> {
    app.store.error_sheets().discard(&by.scope, at.id()?).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Finish the caller's open error sheet
///
/// Now it counts, and says that what is not on it was not seen. The session's trainee reads it.
#[utoipa::path(post, path = "/sessions/{id}/error-sheet/finish", tag = "ratings",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = ErrorSheetResponse)))]
pub async fn finish_error_sheet(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
) -> HandlerResult<Json<ErrorSheetResponse>> {
    let sheet = app.store.error_sheets().finish(&by.scope, at.id()?).await?;
    Ok(Json(ErrorSheetResponse::new(sheet, &by.scope)))
}

/// Mark an error on the caller's open error sheet
///
/// A sheet takes at most 500 marks; an item of yes or no is marked once.
#[utoipa::path(post, path = "/sessions/{id}/error-marks", tag = "ratings",
    params(("id" = String, Path, description = "id")), request_body = NewErrorMark,
    responses((status = CREATED, body = ErrorMarkResponse)))]
pub async fn mark_error(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Json(new): Json<NewErrorMark>,
) -> HandlerResult<Created<ErrorMarkResponse>> {
    let session: SessionId = at.id()?;
    new.check(&app.store.error_sheets().open_items(&by.scope, session).await?)?;
    let mark = app.store.error_sheets().mark(&by.scope, session, new).await?;
    let location = format!("/api/v1/sessions/{session}/error-marks/{}", mark.id);
    Ok(Created { location, made: mark.into() })
}

/// Take a mark back from the caller's open error sheet
#[utoipa::path(delete, path = "/sessions/{id}/error-marks/{mark}", tag = "ratings",
    params(("id" = String, Path, description = "id"), ("mark" = String, Path, description = "id of the mark")),
    responses((status = NO_CONTENT)))]
pub async fn unmark_error(
    State(app): State<App>,
    by: Staff,
    PathPair(session, mark): PathPair<SessionId, ErrorMarkId>,
) -> HandlerResult<StatusCode> {
    app.store.error_sheets().unmark(&by.scope, session, mark).await?;
    Ok(StatusCode::NO_CONTENT)
}
