//! Jobs in the caller's scope: work on sessions of the caller's trainees and, for staff, on boxes.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::auth::signed_in::{Member, Staff};
use super::error::{HandlerResult, ProblemDocument};
use super::read::{Json, Params, PathKey};
use super::show::{PageResponse, Paging, Time};
use super::state::App;
use crate::domain::job::{JobKind, JobState};
use crate::domain::palette::PaletteAdvice;
use crate::ids::{BoxId, JobId, SessionId};
use crate::store;

/// A job: one unit of background work.
#[derive(Debug, Serialize, ToSchema)]
pub struct JobResponse {
    id: JobId,
    /// Kind of work. Advice on tapes is `advise`, also in jobs that earlier versions listed as `palette`.
    kind: JobKind,
    state: JobState,
    /// Share done, 0 to 1.
    progress: f64,
    /// Why it failed, or why its last attempt crashed.
    error: Option<ProblemDocument>,
    /// Number of the present attempt: attempts whose child process crashed or timed out, plus this one.
    attempt: i64,
    /// Crashed attempts after which the job is quarantined.
    max_attempts: i64,
    /// The session that the job works on; `null`: none.
    session: Option<SessionId>,
    /// The box that the job works on; `null`: none.
    #[serde(rename = "box")]
    of_box: Option<BoxId>,
    /// The tapes that suit the box, once a job of the kind `advise` has ranked them; always `null` in lists.
    advice: Option<PaletteAdvice>,
    created_at: Time,
    started_at: Option<Time>,
    ended_at: Option<Time>,
}

impl From<store::JobRecord> for JobResponse {
    fn from(job: store::JobRecord) -> Self {
        Self {
            id: job.id,
            kind: job.kind,
            state: job.state,
            progress: job.progress,
            error: job.problem.map(ProblemDocument::from),
            attempt: job.attempt,
            max_attempts: job.max_attempts,
            session: job.session_id,
            of_box: job.box_id,
            advice: None,
            created_at: Time(job.created_at_ms),
            started_at: job.started_at_ms.map(Time),
            ended_at: job.ended_at_ms.map(Time),
        }
    }
}

/// A job that was queued.
#[derive(Debug, Serialize, ToSchema)]
pub struct QueuedJobResponse {
    /// The job's id. Read its state at `/api/v1/jobs/{id}`, or watch the events.
    pub job: JobId,
}

/// Selects jobs.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct JobsQuery {
    /// Only jobs that wait or run.
    #[serde(default)]
    open: bool,
    /// Most items on the page, 1 to 200.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next` of the previous page.
    cursor: Option<String>,
}

/// List the jobs that the caller may see, newest first
#[utoipa::path(get, path = "/jobs", tag = "jobs", params(JobsQuery),
    responses((status = OK, body = PageResponse<JobResponse>)))]
pub async fn list(
    State(app): State<App>,
    by: Member,
    Params(which): Params<JobsQuery>,
) -> HandlerResult<Json<PageResponse<JobResponse>>> {
    let page = Paging::new(which.limit, which.cursor).request("jobs", app.settings.page_items)?;
    let jobs = app.store.jobs().list(&by.scope, which.open, &page).await?;
    Ok(Json(PageResponse::of(jobs, JobResponse::from)))
}

/// Read one job
#[utoipa::path(get, path = "/jobs/{id}", tag = "jobs", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = JobResponse)))]
pub async fn get(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<JobResponse>> {
    let mut job = app.store.jobs().get(&by.scope, at.id()?).await?;
    let advice = job.advice.take();
    Ok(Json(JobResponse { advice, ..job.into() }))
}

/// Queue a failed or quarantined job again
#[utoipa::path(post, path = "/jobs/{id}/retry", tag = "jobs", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = JobResponse)))]
pub async fn retry(State(app): State<App>, by: Staff, at: PathKey) -> HandlerResult<Json<JobResponse>> {
    let job = app.store.jobs().retry(&by.scope, at.id()?).await?;
    app.queue.work_arrived();
    Ok(Json(job.into()))
}
