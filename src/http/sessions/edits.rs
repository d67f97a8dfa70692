//! What people change about a scored session: trim it, exchange its tools' names, set it aside. Each can be undone.

use axum::extract::{Path, State};
use serde::Serialize;
use utoipa::ToSchema;

use crate::analysis::edits::fitting;
use crate::analysis::paths::Paths;
use crate::domain::edit::{Change, EditKind, NewEdit, ScoreState, kept};
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::{Answer, Problem, ProblemDocument, Refusal};
use crate::http::read::{At, Json};
use crate::http::show::{Created, Time};
use crate::http::state::App;
use crate::ids::{EditId, JobId, SessionId};
use crate::store;

/// A change of a session.
#[derive(Debug, Serialize, ToSchema)]
pub struct Edit {
    id: EditId,
    /// What is changed.
    kind: EditKind,
    /// From which second of the recording; `null` of what is about the whole session.
    from_s: Option<f64>,
    /// To which.
    to_s: Option<f64>,
    /// The two tools that change names.
    tools: Option<[String; 2]>,
    /// Why: text, never markup.
    why: String,
    /// Who made it; `null` where they are here no more.
    who: Option<String>,
    created_at: Time,
    /// By whom and when it was undone; `null`: it is in force.
    undone: Option<Undone>,
}

/// That an edit was undone.
#[derive(Debug, Serialize, ToSchema)]
pub struct Undone {
    /// By whom; `null` where they are here no more.
    who: Option<String>,
    at: Time,
}

/// A session's edits, and how its score stands to them.
#[derive(Debug, Serialize, ToSchema)]
pub struct Edits {
    /// The oldest first, those that were undone included; at most 200.
    items: Vec<Edit>,
    /// What is left by the trims in force; `null`: all of the recording.
    kept: Option<Kept>,
    /// Which state of its trims and swaps this is. A `POST` that names it is refused if there is another by then.
    revision: u64,
    /// Is the score made with the edits in force?
    score: ScoreState,
    /// The work that makes it; `null` where it is made.
    job: Option<JobId>,
    /// Why it could not be made; the score is that of before. The job can be tried again, or the edit be undone.
    error: Option<ProblemDocument>,
}

/// What is left of a recording.
#[derive(Debug, Serialize, ToSchema)]
pub struct Kept {
    from_s: f64,
    to_s: f64,
}

impl From<store::Edit> for Edit {
    fn from(edit: store::Edit) -> Self {
        let store::Edit { id, kind, from_s, to_s, tools, why, who, created_at_ms, undone_by, undone_at_ms } = edit;
        let undone = undone_at_ms.map(|at| Undone { who: undone_by.map(String::from), at: Time(at) });
        let (why, who, created_at) = (why.into(), who.map(String::from), Time(created_at_ms));
        Self { id, kind, from_s, to_s, tools, why, who, created_at, undone }
    }
}

impl From<store::SessionEdits> for Edits {
    fn from(edits: store::SessionEdits) -> Self {
        let store::SessionEdits { items, revision, score, job, problem } = edits;
        let in_force = items.iter().filter(|edit| edit.undone_at_ms.is_none());
        let changes: Vec<Change> = in_force.filter_map(store::Edit::change).collect();
        Self {
            kept: kept(&changes).map(|[from_s, to_s]| Kept { from_s, to_s }),
            items: items.into_iter().map(Edit::from).collect(),
            revision,
            score,
            job,
            error: problem.map(ProblemDocument::from),
        }
    }
}

/// List what was changed about a session, by whom and why
#[utoipa::path(get, path = "/sessions/{id}/edits", tag = "sessions",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = Edits)))]
pub async fn edits(State(app): State<App>, by: Member, at: At) -> Answer<Json<Edits>> {
    Ok(Json(app.store.edits().of_session(&by.scope, at.id()?).await?.into()))
}

/// Trim a session, exchange two tools' names over a stretch, or set it aside
///
/// Nothing that was measured is touched. A trim or a swap is followed by a new result, made of the stored path and kept beside the
/// old ones; its features, quality, evidence and advice are of what is left, and so is every later result until the edit is undone.
/// Trims add up: what lies within all of them counts. A session that is set aside keeps its score, and counts in no progress, cohort,
/// standard, model or correlation.
#[utoipa::path(post, path = "/sessions/{id}/edits", tag = "sessions",
    params(("id" = String, Path, description = "id")), request_body = NewEdit,
    responses((status = CREATED, body = Edit)))]
pub async fn edit(State(app): State<App>, by: Staff, at: At, Json(new): Json<NewEdit>) -> Answer<Created<Edit>> {
    let session: SessionId = at.id()?;
    let change = new.change()?;
    app.store.sessions().get(&by.scope, session).await?;
    let (change, seen) = match change {
        Change::SetAside => (change, None),
        Change::Trim(_) | Change::Swap(..) => app.fitting(&by.scope, session, change).await?,
    };
    let edit = app.store.edits().add(&by.scope, session, (change, new.why), new.revision.or(seen)).await?;
    app.tell_edited(&by.scope, session).await?;
    Ok(Created { location: format!("/api/v1/sessions/{session}/edits/{}", edit.id), made: edit.into() })
}

/// Undo an edit: it stays in the list, with who undid it and when
#[utoipa::path(delete, path = "/sessions/{id}/edits/{edit}", tag = "sessions",
    params(("id" = String, Path, description = "id"), ("edit" = String, Path, description = "id of the edit")),
    responses((status = OK, body = Edit)))]
pub async fn undo_edit(
    State(app): State<App>,
    by: Staff,
    Path((session, edit)): Path<(String, String)>,
) -> Answer<Json<Edit>> {
    let (session, edit) = session.parse().ok().zip(edit.parse().ok()).ok_or_else(Problem::not_found)?;
    let undone = app.store.edits().undo(&by.scope, session, edit).await?;
    app.tell_edited(&by.scope, session).await?;
    Ok(Json(undone.into()))
}

impl App {
    /// The change as it can be made to the session's path, and the revision for which that holds.
    async fn fitting(&self, scope: &Scope, session: SessionId, change: Change) -> Answer<(Change, Option<u64>)> {
        let result = self.result(scope, session).await?;
        let in_force = self.store.edits().in_force(session).await?;
        let stored = self.vault.read(result.trajectory, super::trajectory::MOST).await?;
        let is_import = result.versions.calibration.is_none();
        // A long session takes a moment to read: not on a thread that serves others.
        let looked = tokio::task::spawn_blocking(move || {
            let paths =
                Paths::from_bytes(&stored).map_err(|cause| Problem::internal("reading a stored trajectory", cause))?;
            if paths.tracking.is_none() && !is_import {
                return Err(Refusal::Conflict.with(
                    "The program that tracked it did not keep all that a score depends on. Track the session again, then edit it.",
                ));
            }
            Ok((fitting(&paths, &in_force, change)?, Some(in_force.revision)))
        });
        looked.await.map_err(|cause| Problem::internal("reading a stored trajectory", cause))?
    }

    /// Tells workers that there may be work, and those who watch that the session stands differently.
    async fn tell_edited(&self, scope: &Scope, session: SessionId) -> Answer<()> {
        let session = self.store.sessions().get(scope, session).await?;
        self.tell_session(&session);
        Ok(())
    }
}
