//! Edits of scored sessions: made and undone by staff, never deleted. People who may see a session see its edits, with
//! their authors and reasons.
//!
//! A trim, a swap, a time correction or an answer whether the recording shows its box makes a new result necessary; its
//! job is queued in the same transaction. Trims and swaps are applied to the stored path, answers to the verdict on it.
//! Other times change the path itself, so the recording is tracked again. Each of these edits that is made or undone
//! increases the *revision* of the session's edits. A result names its revision, so that a result that was begun before
//! an edit is noticed ([`enqueue_rescore_if_outdated`]).

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::audit::note;
use super::certificates;
use super::error::{StoreError, StoreResult, missing, not_found};
use super::exams::refuse_if_of_exam;
use super::jobs::{enqueue_rescore_if_outdated, enqueue_track};
use super::session_cuts::refuse_if_cut;
use super::sessions::SELECT_CURRENT_RESULT;
use super::visibility::require_staff;
use super::{Scope, Store};
use crate::domain::blob::BlobHash;
use crate::domain::certificate::CertificateEventKind;
use crate::domain::clock::TimeCorrection;
use crate::domain::edit::{EditChange, EditKind, EditsInForce, ScoreState};
use crate::domain::job::JobState;
use crate::domain::problem::Problem;
use crate::domain::text::{Invalid, Name, Remark};
use crate::ids::{EditId, JobId, PersonId, SessionId};

/// Access to the edits.
pub struct EditStore<'s>(pub(super) &'s Store);

/// Maximum number of edits of one session, including undone ones.
pub const MAX_EDITS: i64 = 200;

/// An edit of a session.
#[derive(Clone, Debug, PartialEq, sqlx::FromRow)]
pub struct EditRecord {
    /// Its id.
    pub id: EditId,
    /// The kind of change.
    pub kind: EditKind,
    /// For an answer to the question for the box: true if the session was filed under another box then, so that the
    /// answer does not count now.
    pub is_of_other_box: bool,
    /// True for the trim of a part of a cut recording: it is undone by joining the parts.
    pub is_of_cut: bool,
    /// Beginning, seconds of the recording.
    pub from_s: Option<f64>,
    /// End, seconds of the recording.
    pub to_s: Option<f64>,
    /// The two tools that swap names.
    #[sqlx(json(nullable))]
    pub tools: Option<[String; 2]>,
    /// The true frame rate, Hz.
    pub true_frame_rate_hz: Option<f64>,
    /// The true time from the first frame to the last, s.
    pub true_duration_s: Option<f64>,
    /// The reason.
    pub why: Remark,
    /// Name of the author; `None` if the account has been deleted, or if an agent sent the correction with a recording.
    pub who: Option<Name>,
    /// When, epoch ms.
    pub created_at_ms: i64,
    /// Name of the person who undid it; `None` if it is in force or the account has been deleted.
    pub undone_by: Option<Name>,
    /// When it was undone, epoch ms; `None` while it is in force.
    pub undone_at_ms: Option<i64>,
}

/// What an edit was decided on and checked against. `None` is not compared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EditBasis {
    /// The revision of the session's edits.
    pub revision: Option<u64>,
    /// The session's path. Tracking with other times makes another path and scales the spans of all edits, without
    /// another revision.
    pub path: Option<BlobHash>,
}

/// A session's edits, and whether its score is up to date with them.
#[derive(Clone, Debug, PartialEq)]
pub struct SessionEdits {
    /// All of them, oldest first.
    pub items: Vec<EditRecord>,
    /// Number of trims, swaps, time corrections and answers made and undone so far.
    pub revision: u64,
    /// Whether the score was made with the edits in force.
    pub score: ScoreState,
    /// The job that makes the new score; `None` if the score is up to date.
    pub job: Option<JobId>,
    /// Why that job failed.
    pub problem: Option<Problem>,
}

impl EditRecord {
    /// Does it count now?
    pub fn is_in_force(&self) -> bool {
        self.undone_at_ms.is_none() && !self.is_of_other_box
    }

    /// The change that it makes.
    pub fn change(&self) -> Option<EditChange> {
        let span = self.from_s.zip(self.to_s).map(|(from, to)| [from, to]);
        match (self.kind, span, &self.tools) {
            (EditKind::Trim, Some(span), _) => Some(EditChange::Trim(span)),
            (EditKind::Swap, Some(span), Some(tools)) => Some(EditChange::Swap(tools.clone(), span)),
            (EditKind::Retime, ..) => time_of(self.true_frame_rate_hz, self.true_duration_s).map(EditChange::Retime),
            (EditKind::SetAside, ..) => Some(EditChange::SetAside),
            (EditKind::ThisBox, ..) => Some(EditChange::ThisBox),
            (EditKind::OtherBox, ..) => Some(EditChange::OtherBox),
            _ => None, // the schema ensures the fields that each kind needs
        }
    }
}

/// Selects the [`EditRecord`]s of session `$1`, oldest first.
const SELECT_EDITS: &str = "
    SELECT edit.id, edit.kind, edit.kind IN ('this_box', 'other_box') AND edit.box_id IS NOT session.box_id AS is_of_other_box,
           EXISTS (SELECT 1 FROM session_cut AS cut
                   WHERE (cut.first_edit_id = edit.id OR cut.second_edit_id = edit.id)
                     AND cut.joined_at_ms IS NULL) AS is_of_cut,
           edit.from_s, edit.to_s, edit.tools, edit.true_frame_rate_hz, edit.true_duration_s, edit.why,
           maker.name AS who, edit.created_at_ms, undoer.name AS undone_by, edit.undone_at_ms
    FROM session_edit AS edit
    JOIN session ON session.id = edit.session_id
    LEFT JOIN person AS maker ON maker.id = edit.person_id
    LEFT JOIN person AS undoer ON undoer.id = edit.undone_by
    WHERE edit.session_id = $1 ORDER BY edit.rowid LIMIT $2";

/// Selects the revision of the edits that session `$1` was scored with.
const SELECT_SCORED_EDITS: &str = "SELECT edits FROM current_result WHERE session_id = $1";

/// Selects the job that makes the session's new score: it scores the path, or tracks the recording with other times.
const SELECT_RESCORE_JOB: &str = "
    SELECT id, state, problem FROM job
    WHERE session_id = $1 AND kind IN ('rescore', 'track') ORDER BY rowid DESC LIMIT 1";

const SELECT_AUTHOR: &str = "SELECT person_id FROM session_edit WHERE id = $1";

const UNDO_EDIT: &str = "
    UPDATE session_edit
    SET undone_at_ms = max($2, created_at_ms), undone_by = $3
    WHERE id = $1 AND undone_at_ms IS NULL";

const INSERT_EDIT: &str = "
    INSERT INTO session_edit (id, session_id, person_id, kind, from_s, to_s, tools, true_frame_rate_hz, true_duration_s,
                              why, created_at_ms, box_id)
    SELECT $1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11,
           CASE WHEN $4 IN ('this_box', 'other_box') THEN (SELECT box_id FROM session WHERE id = $2) END
    WHERE (SELECT count(*) FROM session_edit WHERE session_id = $2) < $12";

const SELECT_CURRENT_PATH: &str = "SELECT trajectory FROM current_result WHERE session_id = $1";

const SELECT_TRACKING_STATE: &str = "SELECT state FROM tracking_job WHERE session_id = $1";

const SELECT_REVISION: &str = "
    SELECT count(*) + count(undone_at_ms) FROM session_edit WHERE session_id = $1 AND kind <> 'set_aside'";

const SELECT_TIME_REVISION: &str = "
    SELECT count(*) + count(undone_at_ms) FROM session_edit WHERE session_id = $1 AND kind = 'retime'";

const SELECT_TIME_IN_FORCE: &str = "
    SELECT true_frame_rate_hz, true_duration_s FROM session_edit
    WHERE session_id = $1 AND kind = 'retime' AND undone_at_ms IS NULL ORDER BY rowid DESC LIMIT 1";

const SCALE_EDITS: &str = "
    UPDATE session_edit SET from_s = min(from_s * $2, 86400), to_s = min(to_s * $2, 86400)
    WHERE session_id = $1 AND from_s * $2 < 86400";

impl EditStore<'_> {
    /// A session's edits.
    pub async fn of_session(&self, scope: &Scope, session: SessionId) -> StoreResult<SessionEdits> {
        self.0.sessions().get(scope, session).await?;
        let items: Vec<EditRecord> =
            sqlx::query_as(SELECT_EDITS).bind(session).bind(MAX_EDITS).fetch_all(self.0.readers()).await?;
        let revision = revision_of(&items);
        let of = |score| SessionEdits { items, revision, score, job: None, problem: None };
        let made_with: Option<i64> =
            sqlx::query_scalar(SELECT_SCORED_EDITS).bind(session).fetch_optional(self.0.readers()).await?;
        if made_with.is_none_or(|made_with| made_with.unsigned_abs() == revision) {
            return Ok(of(ScoreState::Current));
        }
        let job = sqlx::query_as(SELECT_RESCORE_JOB);
        let job: Option<(JobId, JobState, Option<Json<Problem>>)> =
            job.bind(session).fetch_optional(self.0.readers()).await?;
        Ok(match job {
            None => of(ScoreState::Waiting),
            Some((id, state, problem)) => SessionEdits {
                job: Some(id),
                problem: problem.map(|Json(problem)| problem).filter(|_| score_state(state) == ScoreState::Failed),
                ..of(score_state(state))
            },
        })
    }

    /// The edits that the session must be scored with.
    pub async fn in_force(&self, session: SessionId) -> StoreResult<EditsInForce> {
        let mut reader = self.0.readers().acquire().await?;
        in_force(&mut reader, session).await
    }

    /// Makes an edit. It is refused if the session is no longer as it was when the edit was decided and checked.
    pub async fn add(
        &self,
        scope: &Scope,
        session: SessionId,
        (change, why): (EditChange, Remark),
        basis: EditBasis,
    ) -> StoreResult<EditRecord> {
        let is_import = self.0.sessions().get(scope, session).await?.tracker.is_some();
        require_staff(scope, "editing sessions")?;
        if is_import && change.kind() == EditKind::Retime {
            return Err(StoreError::refused(
                "another program measured this session and set its times: correct them there, and import the table again",
            ));
        }
        if is_import && change.box_answer().is_some() {
            return Err(StoreError::refused(
                "another program measured this session: whether the box is right is known there",
            ));
        }
        let (by, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        let id = EditId::at(now_ms);
        self.0
            .write(async move |tx| {
                refuse_if_of_exam(tx, session).await?;
                let kind = change.kind();
                refuse_if_open(tx, session, kind).await?;
                refuse_if_changed(tx, session, kind, basis).await?;
                certificates::mark(tx, &by, &[session], CertificateEventKind::SessionChanged, now_ms).await?;
                insert(tx, (id, session, by.person()), &change, why, now_ms).await?;
                settle_box_question(tx, session).await?;
                enqueue_new_score(tx, session, kind, now_ms, attempts).await?;
                note(tx, &by, now_ms, (kind.name(), "session"), session).await
            })
            .await?;
        self.get(scope, session, id).await
    }

    /// Undoes an edit; one that is undone already stays as it is.
    pub async fn undo(&self, scope: &Scope, session: SessionId, id: EditId) -> StoreResult<EditRecord> {
        let edit = self.get(scope, session, id).await?;
        require_staff(scope, "editing sessions")?;
        let (by, now_ms, attempts) = (scope.clone(), self.0.now_ms(), self.0.max_attempts());
        self.0
            .write(async move |tx| {
                refuse_if_of_exam(tx, session).await?;
                refuse_if_cut(tx, id).await?;
                undo(tx, (&by, now_ms, attempts), (session, edit.kind), id).await
            })
            .await?;
        self.get(scope, session, id).await
    }

    async fn get(&self, scope: &Scope, session: SessionId, id: EditId) -> StoreResult<EditRecord> {
        let all = self.of_session(scope, session).await?.items;
        all.into_iter().find(|edit| edit.id == id).ok_or(not_found("edit"))
    }
}

/// Undoes an edit; one that is undone already stays as it is.
async fn undo(
    tx: &mut SqliteConnection,
    (by, now_ms, attempts): (&Scope, i64, u32),
    (session, kind): (SessionId, EditKind),
    id: EditId,
) -> StoreResult<()> {
    refuse_if_open(tx, session, kind).await?;
    let update = sqlx::query(UNDO_EDIT).bind(id).bind(now_ms).bind(by.person()).execute(&mut *tx).await?;
    if update.rows_affected() == 0 {
        return Ok(());
    }
    certificates::mark(tx, by, &[session], CertificateEventKind::SessionChanged, now_ms).await?;
    settle_box_question(tx, session).await?;
    enqueue_new_score(tx, session, kind, now_ms, attempts).await?;
    note(tx, by, now_ms, ("undo", "session_edit"), id).await
}

/// Undoes the trim that a cut made.
pub(super) async fn undo_trim(
    tx: &mut SqliteConnection,
    by: (&Scope, i64, u32),
    session: SessionId,
    id: EditId,
) -> StoreResult<()> {
    undo(tx, by, (session, EditKind::Trim), id).await
}

/// Trims a scored session in the transaction of its caller, and queues its new score. Returns the edit.
pub(super) async fn add_trim(
    tx: &mut SqliteConnection,
    (by, now_ms, attempts): (&Scope, i64, u32),
    (session, change, why): (SessionId, EditChange, Remark),
    basis: EditBasis,
) -> StoreResult<EditId> {
    refuse_if_open(tx, session, EditKind::Trim).await?;
    refuse_if_changed(tx, session, EditKind::Trim, basis).await?;
    let id = insert_trim(tx, (by, now_ms), (session, change, why)).await?;
    certificates::mark(tx, by, &[session], CertificateEventKind::SessionChanged, now_ms).await?;
    enqueue_new_score(tx, session, EditKind::Trim, now_ms, attempts).await?;
    Ok(id)
}

/// Trims a session that has no score yet.
pub(super) async fn insert_trim(
    tx: &mut SqliteConnection,
    (by, now_ms): (&Scope, i64),
    (session, change, why): (SessionId, EditChange, Remark),
) -> StoreResult<EditId> {
    let id = EditId::at(now_ms);
    insert(tx, (id, session, by.person()), &change, why, now_ms).await?;
    note(tx, by, now_ms, (change.kind().name(), "session"), session).await?;
    Ok(id)
}

/// Copies the trims, swaps and time corrections in force of one session to another one with the same recording.
pub(super) async fn copy_in_force(
    tx: &mut SqliteConnection,
    [from, to]: [SessionId; 2],
    now_ms: i64,
) -> StoreResult<()> {
    let items: Vec<EditRecord> = sqlx::query_as(SELECT_EDITS).bind(from).bind(MAX_EDITS).fetch_all(&mut *tx).await?;
    for edit in items.into_iter().filter(EditRecord::is_in_force) {
        let author = sqlx::query_scalar(SELECT_AUTHOR).bind(edit.id).fetch_optional(&mut *tx).await?.flatten();
        let change = edit.change();
        if let Some(change @ (EditChange::Trim(_) | EditChange::Swap(..) | EditChange::Retime(_))) = change {
            insert(tx, (EditId::at(now_ms), to, author), &change, edit.why, now_ms).await?;
        }
    }
    Ok(())
}

/// The edits that the session must be scored with. In a transaction, they belong to the result that it reads.
pub(super) async fn in_force(reader: &mut SqliteConnection, session: SessionId) -> StoreResult<EditsInForce> {
    let items: Vec<EditRecord> = sqlx::query_as(SELECT_EDITS).bind(session).bind(MAX_EDITS).fetch_all(reader).await?;
    let in_force = items.iter().filter(|edit| affects_score(edit.kind) && edit.is_in_force());
    let (answers, changes): (Vec<EditChange>, Vec<EditChange>) =
        in_force.filter_map(EditRecord::change).partition(|change| change.box_answer().is_some());
    let box_answer = answers.iter().find_map(EditChange::box_answer);
    Ok(EditsInForce { revision: revision_of(&items), changes, box_answer })
}

/// Queues the work that an edit of this kind makes necessary.
async fn enqueue_new_score(
    tx: &mut SqliteConnection,
    session: SessionId,
    kind: EditKind,
    now_ms: i64,
    max_attempts: u32,
) -> StoreResult<()> {
    match kind {
        EditKind::Retime => {
            let queued = enqueue_track(tx, session, now_ms, max_attempts).await?;
            // A session that was never queued waits for its camera or recording, and is then tracked with these times.
            if queued.is_none() && tracking_state(tx, session).await?.is_some() {
                return Err(StoreError::refused(
                    "the session cannot be tracked with other times: its recording was deleted, or its box has no camera or \
                     tape colours",
                ));
            }
        }
        EditKind::Trim | EditKind::Swap | EditKind::SetAside | EditKind::ThisBox | EditKind::OtherBox => {
            enqueue_rescore_if_outdated(tx, session, now_ms, max_attempts).await?;
        }
    }
    Ok(())
}

/// The reason of a time correction that arrived with the recording.
const GIVEN_WITH_RECORDING: &str = "Given with the recording.";

/// Adds the time correction that a sender gave with a new recording.
pub(super) async fn insert_with_recording(
    tx: &mut SqliteConnection,
    scope: &Scope,
    session: SessionId,
    time: TimeCorrection,
    now_ms: i64,
) -> StoreResult<()> {
    let why = GIVEN_WITH_RECORDING.parse().map_err(|invalid: Invalid| StoreError::refused(invalid.to_string()))?;
    let change = EditChange::Retime(time);
    insert(tx, (EditId::at(now_ms), session, scope.person()), &change, why, now_ms).await?;
    note(tx, scope, now_ms, (change.kind().name(), "session"), session).await
}

/// Multiplies the times of a session's edits, because its recording has other times now.
pub(super) async fn scale_edits(tx: &mut SqliteConnection, session: SessionId, ratio: f64) -> StoreResult<()> {
    sqlx::query(SCALE_EDITS).bind(session).bind(ratio).execute(tx).await?;
    Ok(())
}

/// The time correction in force, and how many were made and undone.
pub(super) async fn time_in_force(
    tx: &mut SqliteConnection,
    session: SessionId,
) -> StoreResult<(Option<TimeCorrection>, u64)> {
    let revision: i64 = sqlx::query_scalar(SELECT_TIME_REVISION).bind(session).fetch_one(&mut *tx).await?;
    let given: Option<(Option<f64>, Option<f64>)> =
        sqlx::query_as(SELECT_TIME_IN_FORCE).bind(session).fetch_optional(tx).await?;
    Ok((given.and_then(|(rate, duration)| time_of(rate, duration)), revision.unsigned_abs()))
}

/// The stored correction.
pub(super) fn time_of(frame_rate_hz: Option<f64>, duration_s: Option<f64>) -> Option<TimeCorrection> {
    frame_rate_hz.map(TimeCorrection::FrameRate).or(duration_s.map(TimeCorrection::Duration))
}

const SETTLE_BOX_QUESTION: &str = "
    UPDATE session SET box_question = CASE
        WHEN EXISTS (SELECT 1 FROM session_edit
                     WHERE session_id = $1 AND session_edit.box_id = session.box_id AND kind = 'other_box'
                       AND undone_at_ms IS NULL) THEN 'other_box'
        WHEN EXISTS (SELECT 1 FROM session_edit
                     WHERE session_id = $1 AND session_edit.box_id = session.box_id AND kind = 'this_box'
                       AND undone_at_ms IS NULL) THEN 'this_box'
        WHEN (SELECT json_extract(quality, '$.recording.box.finding') FROM current_result
              WHERE session_id = $1) = 'doubtful' THEN 'asked' END
    WHERE id = $1
      AND NOT EXISTS (SELECT 1 FROM exam_attempt WHERE session_id = $1 AND outcome IS NOT NULL)";

/// Sets whether a person has to say, or has said, that the session's recording shows its box. Called after each new
/// result, each edit and each move to another box. Of a judged attempt of an exam the question stays as it was judged: no person can answer it.
pub(super) async fn settle_box_question(tx: &mut SqliteConnection, session: SessionId) -> StoreResult<()> {
    sqlx::query(SETTLE_BOX_QUESTION).bind(session).execute(tx).await?;
    Ok(())
}

async fn insert(
    tx: &mut SqliteConnection,
    (id, session, person): (EditId, SessionId, Option<PersonId>),
    change: &EditChange,
    why: Remark,
    now_ms: i64,
) -> StoreResult<()> {
    let [from_s, to_s] = change.span().map_or([None; 2], |span| span.map(Some));
    let tools = match change {
        EditChange::Swap(tools, _) => Some(Json(tools)),
        _ => None,
    };
    let time = match change {
        EditChange::Retime(time) => Some(*time),
        _ => None,
    };
    let insert = sqlx::query(INSERT_EDIT);
    let insert = insert.bind(id).bind(session).bind(person).bind(change.kind()).bind(from_s).bind(to_s).bind(tools);
    let insert = insert.bind(time.and_then(TimeCorrection::frame_rate_hz));
    let insert = insert.bind(time.and_then(TimeCorrection::duration_s));
    let insert = insert.bind(why).bind(now_ms).bind(MAX_EDITS).execute(tx).await;
    let insert = insert.map_err(|error| duplicate_or_missing(error, change.kind()))?;
    match insert.rows_affected() {
        0 => Err(StoreError::refused(format!(
            "the session was edited {MAX_EDITS} times, which is the limit for one session"
        ))),
        _ => Ok(()),
    }
}

fn duplicate_or_missing(error: sqlx::Error, kind: EditKind) -> StoreError {
    match error.as_database_error() {
        Some(e) if e.is_unique_violation() && kind.is_box_answer() => {
            StoreError::refused("whether it is this box is answered already: undo that answer first")
        }
        Some(e) if e.is_unique_violation() => StoreError::refused("the session is already set aside"),
        _ => missing("session")(error),
    }
}

/// Refuses an edit of the path while the session has no path or is being tracked.
async fn refuse_if_open(tx: &mut SqliteConnection, session: SessionId, kind: EditKind) -> StoreResult<()> {
    if !affects_score(kind) {
        return Ok(());
    }
    if matches!(tracking_state(tx, session).await?, Some(JobState::Queued | JobState::Running)) {
        return Err(StoreError::refused("the session is being tracked: wait until it is scored, then edit it"));
    }
    if kind == EditKind::Retime {
        return Ok(()); // also of a session that could not be tracked, perhaps because of its times
    }
    let result: Option<String> = sqlx::query_scalar(SELECT_CURRENT_RESULT).bind(session).fetch_optional(tx).await?;
    result.map(drop).ok_or_else(|| StoreError::refused("the session cannot be edited before it is scored"))
}

/// Refuses an edit that was decided or checked on what is outdated by now.
async fn refuse_if_changed(
    tx: &mut SqliteConnection,
    session: SessionId,
    kind: EditKind,
    basis: EditBasis,
) -> StoreResult<()> {
    let now = revision(tx, session).await?;
    if affects_score(kind) && basis.revision.is_some_and(|seen| seen != now) {
        return Err(StoreError::refused("another person has edited this session meanwhile: reload it, then decide"));
    }
    if let Some(checked) = basis.path {
        let path: Option<BlobHash> = sqlx::query_scalar(SELECT_CURRENT_PATH).bind(session).fetch_optional(tx).await?;
        if path != Some(checked) {
            return Err(StoreError::refused("the session was tracked again meanwhile: reload it, then decide"));
        }
    }
    Ok(())
}

/// The state of the latest tracking of the session; `None` if it was never queued.
async fn tracking_state(tx: &mut SqliteConnection, session: SessionId) -> StoreResult<Option<JobState>> {
    Ok(sqlx::query_scalar(SELECT_TRACKING_STATE).bind(session).fetch_optional(tx).await?)
}

/// True if the score depends on edits of this kind. Setting a session aside does not change its score.
fn affects_score(kind: EditKind) -> bool {
    kind != EditKind::SetAside
}

fn score_state(state: JobState) -> ScoreState {
    match state {
        JobState::Running => ScoreState::Working,
        JobState::Failed | JobState::Quarantined => ScoreState::Failed,
        JobState::Queued | JobState::Done => ScoreState::Waiting, // done: the next job is queued at once
    }
}

/// Number of trims, swaps, time corrections and answers made and undone. It never decreases.
fn revision_of(items: &[EditRecord]) -> u64 {
    let of = |edit: &EditRecord| if affects_score(edit.kind) { 1 + u64::from(edit.undone_at_ms.is_some()) } else { 0 };
    items.iter().map(of).sum()
}

/// Like [`revision_of`], read in a transaction.
pub(super) async fn revision(tx: &mut SqliteConnection, session: SessionId) -> StoreResult<u64> {
    let revision: i64 = sqlx::query_scalar(SELECT_REVISION).bind(session).fetch_one(tx).await?;
    Ok(revision.unsigned_abs())
}
