//! Error items and score formulas of tasks. Every member may read them; administrators and the instructors of the
//! task's groups may set them. A version never changes.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::domain::error_sheet::{ErrorExample, ErrorItem, NewErrorList, NewScoreFormula, ScoreFormula};
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::{HandlerResult, unknown_reference};
use crate::http::read::{Json, PathKey, reference_problem};
use crate::http::sessions::ErrorScoreResponse;
use crate::http::show::{Created, PageResponse, Time};
use crate::http::state::App;
use crate::ids::{ErrorListId, ScoreFormulaId, SessionId, TaskId};
use crate::store;
use crate::time::Day;

pub use crate::cohorts::ErrorAgreement;

/// A version of a task's list of error items.
#[derive(Debug, Serialize, ToSchema)]
pub struct ErrorListResponse {
    id: ErrorListId,
    /// 1, 2, … within the task; the highest is the one in use.
    version: i64,
    /// The items in their order; none if no sheets are begun any more.
    items: Vec<ErrorItem>,
    /// Name of the person who set it; `null` for trainees, and if the person was deleted.
    who: Option<String>,
    created_at: Time,
}

/// A version of a task's score formula.
#[derive(Debug, Serialize, ToSchema)]
pub struct ScoreFormulaResponse {
    id: ScoreFormulaId,
    /// 1, 2, … within the task.
    version: i64,
    /// The first day of the sessions that it scores; `null`: all. A session is scored by the highest version that is
    /// valid on the day on which the session arrived.
    valid_from: Option<Day>,
    #[serde(flatten)]
    definition: ScoreFormula,
    /// Name of the person who set it; `null` for trainees, and if the person was deleted.
    who: Option<String>,
    created_at: Time,
}

/// A formula to be tried on a session.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FormulaPreview {
    /// The formula.
    formula: NewScoreFormula,
    /// A session of the task.
    session: SessionId,
}

impl ErrorListResponse {
    /// The list as this scope may see it.
    pub fn new(list: store::ErrorListRecord, scope: &Scope) -> Self {
        let store::ErrorListRecord { id, version, items, who, created_at_ms, .. } = list;
        Self { id, version, items, who: who.filter(|_| scope.is_staff()), created_at: Time(created_at_ms) }
    }
}

impl ScoreFormulaResponse {
    /// The formula as this scope may see it.
    pub fn new(formula: store::ScoreFormulaRecord, scope: &Scope) -> Self {
        let store::ScoreFormulaRecord { id, version, definition, valid_from, who, created_at_ms, .. } = formula;
        let who = who.filter(|_| scope.is_staff());
        Self { id, version, valid_from, definition, who, created_at: Time(created_at_ms) }
    }
}

/// List examples of error items and formulas to start from
///
/// They are ours, in the manner of the tasks of the Fundamentals of Laparoscopic Surgery, and not official.
#[utoipa::path(get, path = "/error-examples", tag = "ratings",
    responses((status = OK, body = PageResponse<ErrorExample>)))]
pub async fn error_examples(_by: Member) -> Json<PageResponse<ErrorExample>> {
    Json(PageResponse::whole(ErrorExample::all()))
}

/// List a task's lists of error items, newest first
///
/// The first one is in use.
#[utoipa::path(get, path = "/tasks/{id}/error-lists", tag = "ratings",
    params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = PageResponse<ErrorListResponse>)))]
pub async fn error_lists(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
) -> HandlerResult<Json<PageResponse<ErrorListResponse>>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    let lists = app.store.error_lists().list(&by.scope, of).await?;
    Ok(Json(PageResponse::whole(lists.into_iter().map(|list| ErrorListResponse::new(list, &by.scope)))))
}

/// Set a task's error items
///
/// The result is the next version, unless the version in use is the same. Sheets keep the version that they were begun
/// with. An item keeps its short name, kind and unit in all versions. For administrators and the instructors of the
/// task's groups.
#[utoipa::path(post, path = "/tasks/{id}/error-lists", tag = "ratings",
    params(("id" = String, Path, description = "id or code")), request_body = NewErrorList,
    responses((status = CREATED, body = ErrorListResponse)))]
pub async fn set_error_list(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(new): Json<NewErrorList>,
) -> HandlerResult<Created<ErrorListResponse>> {
    let of = app.store.tasks().changeable(&by.scope, &key).await?.id;
    let versions = app.store.error_lists().list(&by.scope, of).await?;
    let earlier: Vec<ErrorItem> = versions.into_iter().flat_map(|version| version.items).collect();
    let list = app.store.error_lists().add(&by.scope, of, new.items(&earlier)?).await?;
    let location = format!("/api/v1/tasks/{of}/error-lists");
    Ok(Created { location, made: ErrorListResponse::new(list, &by.scope) })
}

/// List a task's score formulas, newest first
#[utoipa::path(get, path = "/tasks/{id}/score-formulas", tag = "ratings",
    params(("id" = String, Path, description = "id or code")),
    responses((status = OK, body = PageResponse<ScoreFormulaResponse>)))]
pub async fn score_formulas(
    State(app): State<App>,
    by: Member,
    PathKey(key): PathKey,
) -> HandlerResult<Json<PageResponse<ScoreFormulaResponse>>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    let formulas = app.store.score_formulas().list(&by.scope, of).await?;
    Ok(Json(PageResponse::whole(formulas.into_iter().map(|formula| ScoreFormulaResponse::new(formula, &by.scope)))))
}

/// Set a task's score formula
///
/// The score is the cut-off time − time − the errors, each times its weight; then it is scaled. The result is the next
/// version, unless the newest version is the same. It scores sessions that arrive on `valid_from` or later;
/// without that day, a task's first version scores all sessions. For
/// administrators and the instructors of the task's groups.
#[utoipa::path(post, path = "/tasks/{id}/score-formulas", tag = "ratings",
    params(("id" = String, Path, description = "id or code")), request_body = NewScoreFormula,
    responses((status = CREATED, body = ScoreFormulaResponse)))]
pub async fn set_score_formula(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(new): Json<NewScoreFormula>,
) -> HandlerResult<Created<ScoreFormulaResponse>> {
    let of = app.store.tasks().changeable(&by.scope, &key).await?.id;
    let is_first = app.store.score_formulas().list(&by.scope, of).await?.is_empty();
    let first_day = new.first_day(Day::of(app.clock.now_ms()), is_first)?;
    let definition = new.checked(&app.items_in_use(&by.scope, of).await?)?;
    let formula = app.store.score_formulas().add(&by.scope, of, definition, first_day).await?;
    let location = format!("/api/v1/tasks/{of}/score-formulas");
    Ok(Created { location, made: ScoreFormulaResponse::new(formula, &by.scope) })
}

/// Compute a session's score by a formula without setting it
///
/// The rules of the task's own score hold: without a finished sheet there is no score, and sheets of others are hidden
/// until the caller has finished one.
#[utoipa::path(post, path = "/tasks/{id}/score-formulas/previews", tag = "ratings",
    params(("id" = String, Path, description = "id or code")), request_body = FormulaPreview,
    responses((status = OK, body = ErrorScoreResponse)))]
pub async fn preview_score_formula(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
    Json(FormulaPreview { formula, session }): Json<FormulaPreview>,
) -> HandlerResult<Json<ErrorScoreResponse>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    let formula = formula.checked(&app.items_in_use(&by.scope, of).await?)?;
    let session = app.store.sessions().get(&by.scope, session).await.map_err(reference_problem("session"))?;
    if session.task_id != of {
        return Err(unknown_reference("session", "session of this task"));
    }
    let sheets = app.store.error_sheets().of_session(&by.scope, session.id).await?;
    let score = app.cohorts.score_by(&by.scope, &session, &sheets, &formula).await?;
    Ok(Json(ErrorScoreResponse::tried(score)))
}

/// Read the agreement of raters on a task's error items
///
/// Intraclass correlations (two-way random effects, absolute agreement) of counts and amounts, and for counts and items
/// of yes or no the share of people who got the same value from all raters, with 95 % intervals. They use blind
/// finished sheets of people who were judged by the same raters; each person counts once, with the newest such session.
/// Limited to people that the caller may see.
#[utoipa::path(get, path = "/tasks/{id}/error-agreement", tag = "ratings",
    params(("id" = String, Path, description = "id or code")), responses((status = OK, body = ErrorAgreement)))]
pub async fn error_agreement(
    State(app): State<App>,
    by: Staff,
    PathKey(key): PathKey,
) -> HandlerResult<Json<ErrorAgreement>> {
    let of = app.store.tasks().get(&by.scope, &key).await?.id;
    Ok(Json(app.cohorts.error_agreement(&by.scope, of).await?))
}

impl App {
    /// The items of the task's list in use; none without a list.
    async fn items_in_use(&self, scope: &Scope, of: TaskId) -> HandlerResult<Vec<ErrorItem>> {
        Ok(self.store.error_lists().in_use(scope, of).await?.map(|list| list.items).unwrap_or_default())
    }
}
