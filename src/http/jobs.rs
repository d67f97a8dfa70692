//! The queue as one sees it: work on the sessions of one's trainees, and, for staff, on boxes.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::auth::signed_in::{Member, Staff};
use super::error::{Answer, ProblemDocument};
use super::read::{At, Json, Params};
use super::show::{Page, Paging, Time};
use super::state::App;
use crate::domain::job::{JobKind, JobState};
use crate::domain::palette::PaletteAdvice;
use crate::ids::{BoxId, JobId, SessionId};
use crate::store;

/// A piece of work.
#[derive(Debug, Serialize, ToSchema)]
pub struct Job {
    id: JobId,
    kind: JobKind,
    state: JobState,
    /// Share done, 0 to 1.
    progress: f64,
    /// Why it failed, or what happened when it last crashed.
    error: Option<ProblemDocument>,
    /// Claims that ended in a crash or silence, and the present one.
    attempt: i64,
    /// Crashes after which it is quarantined.
    max_attempts: i64,
    /// The session it is about, if it is about one.
    session: Option<SessionId>,
    /// The box it is about, if it is about one.
    #[serde(rename = "box")]
    of_box: Option<BoxId>,
    /// Which tapes suit the box, once that was found out; only where one job is read.
    advice: Option<PaletteAdvice>,
    created_at: Time,
    started_at: Option<Time>,
    ended_at: Option<Time>,
}

impl From<store::Job> for Job {
    fn from(job: store::Job) -> Self {
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
pub struct Queued {
    /// Its id: watch it at `/api/v1/jobs/{id}` or in the events.
    pub job: JobId,
}

/// Which jobs.
#[derive(Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct Which {
    /// Only those that wait or run.
    #[serde(default)]
    open: bool,
    /// Most items of the page, 1 to 200.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next` of the page before.
    cursor: Option<String>,
}

/// List the jobs that one sees, newest first
#[utoipa::path(get, path = "/jobs", tag = "jobs", params(Which), responses((status = OK, body = Page<Job>)))]
pub async fn list(State(app): State<App>, by: Member, Params(which): Params<Which>) -> Answer<Json<Page<Job>>> {
    let page = Paging::new(which.limit, which.cursor).request(app.settings.page_items)?;
    let jobs = app.store.jobs().list(&by.scope, which.open, &page).await?;
    Ok(Json(Page::of(jobs, Job::from)))
}

/// Read one job
#[utoipa::path(get, path = "/jobs/{id}", tag = "jobs", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = Job)))]
pub async fn get(State(app): State<App>, by: Member, at: At) -> Answer<Json<Job>> {
    let mut job = app.store.jobs().get(&by.scope, at.id()?).await?;
    let advice = job.advice.take();
    Ok(Json(Job { advice, ..job.into() }))
}

/// Queue a job again that has failed or was quarantined
#[utoipa::path(post, path = "/jobs/{id}/retry", tag = "jobs", params(("id" = String, Path, description = "id")),
    responses((status = OK, body = Job)))]
pub async fn retry(State(app): State<App>, by: Staff, at: At) -> Answer<Json<Job>> {
    let job = app.store.jobs().retry(&by.scope, at.id()?).await?;
    app.queue.work_arrived();
    Ok(Json(job.into()))
}
