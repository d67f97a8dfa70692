//! Edits of a scored session: trim it, swap the names of its tools, correct its times, set it aside, say whether it
//! shows its box. Each edit can be undone.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use crate::analysis::QuickAnalysisError;
use crate::domain::clock::{StampFacts, TimeCorrection};
use crate::domain::edit::{EditChange, EditKind, NewEdit, ScoreState, kept_span};
use crate::domain::scope::Scope;
use crate::http::auth::signed_in::{Member, Staff};
use crate::http::error::{HandlerResult, ProblemDocument, ProblemResponse, Refusal};
use crate::http::read::{Json, PathKey, PathPair};
use crate::http::show::{Created, Time};
use crate::http::state::App;
use crate::ids::{EditId, JobId, SessionId};
use crate::store::{self, EditBasis};

/// An edit of a session.
#[derive(Debug, Serialize, ToSchema)]
pub struct EditResponse {
    id: EditId,
    /// The kind of edit.
    kind: EditKind,
    /// Beginning of the edited stretch, seconds of the recording; `null` for an edit of the whole session.
    from_s: Option<f64>,
    /// End of the edited stretch, seconds of the recording; `null` for an edit of the whole session.
    to_s: Option<f64>,
    /// The two tools whose names are swapped.
    tools: Option<[String; 2]>,
    /// The true frame rate of a `retime`, Hz.
    true_frame_rate_hz: Option<f64>,
    /// The true duration of a `retime`, from the first frame to the last, s.
    true_duration_s: Option<f64>,
    /// The reason: plain text, never markup.
    why: String,
    /// Name of the person who made the edit; `null` if the person was deleted, or if the correction came with a recording
    /// that an agent or the service sent.
    who: Option<String>,
    created_at: Time,
    /// True for an answer to the `box_question` that was given while the session was filed under another box: it does
    /// not count now.
    for_other_box: bool,
    /// True for the trim of a part of a cut recording: join the parts to undo it (`GET /sessions/{id}/cuts`).
    of_cut: bool,
    /// When it was undone, and the name of the person; `null`: it is in force.
    undone: Option<Undone>,
}

/// Time and person of an undo.
#[derive(Debug, Serialize, ToSchema)]
pub struct Undone {
    /// Name of the person; `null` if the person was deleted.
    who: Option<String>,
    at: Time,
}

/// A session's edits, and whether its score includes them.
#[derive(Debug, Serialize, ToSchema)]
pub struct EditsResponse {
    /// The edits, oldest first, including those that were undone; at most 200.
    items: Vec<EditResponse>,
    /// The stretch that the trims in force leave; `null`: the whole recording.
    kept: Option<KeptStretch>,
    /// Revision of the edits that change the score. A `POST` with an outdated revision is refused.
    revision: u64,
    /// Whether the score includes the edits in force.
    score: ScoreState,
    /// The job that computes the new score; `null` once the score includes the edits.
    job: Option<JobId>,
    /// Why the new score could not be computed; until then the previous score counts. Retry the job, or undo the edit.
    error: Option<ProblemDocument>,
}

/// The stretch of a recording that trims leave, in seconds.
#[derive(Debug, Serialize, ToSchema)]
pub struct KeptStretch {
    from_s: f64,
    to_s: f64,
}

impl From<store::EditRecord> for EditResponse {
    fn from(edit: store::EditRecord) -> Self {
        let undone_by = edit.undone_by.map(String::from);
        Self {
            id: edit.id,
            kind: edit.kind,
            from_s: edit.from_s,
            to_s: edit.to_s,
            tools: edit.tools,
            true_frame_rate_hz: edit.true_frame_rate_hz,
            true_duration_s: edit.true_duration_s,
            why: edit.why.into(),
            who: edit.who.map(String::from),
            created_at: Time(edit.created_at_ms),
            for_other_box: edit.is_of_other_box,
            of_cut: edit.is_of_cut,
            undone: edit.undone_at_ms.map(|at| Undone { who: undone_by, at: Time(at) }),
        }
    }
}

impl From<store::SessionEdits> for EditsResponse {
    fn from(edits: store::SessionEdits) -> Self {
        let store::SessionEdits { items, revision, score, job, problem } = edits;
        let in_force = items.iter().filter(|edit| edit.is_in_force());
        let changes: Vec<EditChange> = in_force.filter_map(store::EditRecord::change).collect();
        Self {
            kept: kept_span(&changes).map(|[from_s, to_s]| KeptStretch { from_s, to_s }),
            items: items.into_iter().map(EditResponse::from).collect(),
            revision,
            score,
            job,
            error: problem.map(ProblemDocument::from),
        }
    }
}

/// List a session's edits, with their authors and reasons
#[utoipa::path(get, path = "/sessions/{id}/edits", tag = "sessions",
    params(("id" = String, Path, description = "id")), responses((status = OK, body = EditsResponse)))]
pub async fn edits(State(app): State<App>, by: Member, at: PathKey) -> HandlerResult<Json<EditsResponse>> {
    Ok(Json(app.store.edits().of_session(&by.scope, at.id()?).await?.into()))
}

/// Trim a session, swap two tools' names, correct its times, set it aside, or say whether it shows its box
///
/// An edit changes no measurement. After a trim or a swap, the service computes a new result from the stored path and
/// keeps the old ones. Features, quality, evidence and advice of the new result, and of every later one until the edit
/// is undone, cover only the stretch that is left. Trims add up: the stretch inside all of them counts.
///
/// A `retime` gives the true frame rate, or the true time from the first frame to the last. All times of the file are
/// multiplied by one factor, and the recording is tracked again with them, since speeds follow. The latest `retime` in
/// force counts; without one, the times are those of the file, or of the capture rate that the file states. Trims, swaps
/// and comments keep their places in the recording.
///
/// A session that is set aside keeps its score, but counts in no progress, cohort, standard, model or correlation.
///
/// `this_box` and `other_box` answer the `box_question` of a session. After `this_box` the session counts, and later
/// recordings with the same surroundings are not asked about. After `other_box` its values are withheld and it counts
/// nowhere; move it to its box with `POST /sessions/{id}/moves`. Undo an answer before giving the other one.
#[utoipa::path(post, path = "/sessions/{id}/edits", tag = "sessions",
    params(("id" = String, Path, description = "id")), request_body = NewEdit,
    responses((status = CREATED, body = EditResponse)))]
pub async fn edit(
    State(app): State<App>,
    by: Staff,
    at: PathKey,
    Json(new): Json<NewEdit>,
) -> HandlerResult<Created<EditResponse>> {
    let session: SessionId = at.id()?;
    let change = new.change()?;
    app.store.sessions().get(&by.scope, session).await?;
    let (change, checked) = match change {
        EditChange::SetAside | EditChange::ThisBox | EditChange::OtherBox => (change, EditBasis::default()),
        EditChange::Retime(time) => {
            app.check_time(&by.scope, session, time).await?;
            (change, EditBasis::default())
        }
        EditChange::Trim(_) | EditChange::Swap(..) => app.check_change(&by.scope, session, change).await?,
    };
    let basis = EditBasis { revision: new.revision.or(checked.revision), ..checked };
    let edit = app.store.edits().add(&by.scope, session, (change, new.why), basis).await?;
    app.notify_edited(&by.scope, session).await?;
    Ok(Created { location: format!("/api/v1/sessions/{session}/edits/{}", edit.id), made: edit.into() })
}

/// Undo an edit
///
/// It stays in the list, with the time of the undo and the name of the person. A job computes the new score, if the
/// edit changed it.
#[utoipa::path(post, path = "/sessions/{id}/edits/{edit}/undo", tag = "sessions",
    params(("id" = String, Path, description = "id"), ("edit" = String, Path, description = "id of the edit")),
    responses((status = OK, body = EditResponse)))]
pub async fn undo_edit(
    State(app): State<App>,
    by: Staff,
    PathPair(session, edit): PathPair<SessionId, EditId>,
) -> HandlerResult<Json<EditResponse>> {
    let undone = app.store.edits().undo(&by.scope, session, edit).await?;
    app.notify_edited(&by.scope, session).await?;
    Ok(Json(undone.into()))
}

impl App {
    /// Checks the change against the session's path, in a child process. Returns the change as it can be applied, and
    /// what it was checked against.
    pub(super) async fn check_change(
        &self,
        scope: &Scope,
        session: SessionId,
        change: EditChange,
    ) -> HandlerResult<(EditChange, EditBasis)> {
        let (result, in_force) = self.result_with_edits(scope, session).await?;
        let basis = EditBasis { revision: Some(in_force.revision), path: Some(result.trajectory) };
        let is_import = result.versions.calibration.is_none();
        let checked = match self.quick_analysis.check_edit(result.trajectory, in_force, change).await {
            Err(QuickAnalysisError::Crashed(why)) => return Err(ProblemResponse::internal("checking an edit", why)),
            checked => checked?,
        };
        if !checked.has_summary && !is_import {
            return Err(Refusal::Conflict.with(
                "An older version of the program tracked this session, and its result cannot be edited. Track the \
                 session again, then edit it.",
            ));
        }
        Ok((checked.change?, basis))
    }

    /// Checks a correction against the times of the session's result. A session without a result has no known times; its
    /// tracking then checks the correction.
    async fn check_time(&self, scope: &Scope, session: SessionId, time: TimeCorrection) -> HandlerResult<()> {
        let result = self.store.sessions().result(scope, session).await?;
        if let Some(clock) = result.and_then(|result| result.video.clock) {
            time.factor(StampFacts {
                rate_hz: clock.stamped_frame_rate_hz,
                duration_s: clock.stamped_duration_s,
                is_uneven: clock.is_uneven,
            })?;
        }
        Ok(())
    }

    /// Notifies workers of a possible job, and watchers of the session's new state.
    pub(super) async fn notify_edited(&self, scope: &Scope, session: SessionId) -> HandlerResult<()> {
        let session = self.store.sessions().get(scope, session).await?;
        self.notify_session_changed(&session);
        Ok(())
    }
}
