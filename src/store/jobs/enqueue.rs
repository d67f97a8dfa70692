//! Enqueues jobs, in the transaction that makes the work necessary.

use sqlx::sqlite::SqliteConnection;

use super::super::blobs;
use super::super::columns::integer;
use super::super::error::{StoreResult, missing};
use crate::domain::blob::{Blob, BlobHash};
use crate::domain::job::{JobInput, JobPriority, KeyVersion, RescoreInput, TrackInput};
use crate::ids::{BoxId, CalibrationId, JobId, PaletteId, ResultId, SessionId};
use crate::motion::PIPELINE_VERSION;
use crate::store::edits::{revision, settle_box_question, time_in_force};

/// Inserts a job, or finds the one with the same natural key (kind, input, versions). A failed or quarantined job is
/// queued again.
pub(in crate::store) async fn insert(
    tx: &mut SqliteConnection,
    input: &JobInput,
    now_ms: i64,
    max_attempts: u32,
) -> StoreResult<JobId> {
    insert_with_priority(tx, input, input.facts().priority, now_ms, max_attempts).await
}

const FIND: &str = "SELECT id FROM job WHERE kind = $1 AND input_hash = $2 AND versions = $3";

const INSERT: &str = "
    INSERT INTO job (id, kind, input, input_hash, versions, session_id, box_id, turn, state, max_attempts,
                     created_at_ms, queued_at_ms)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8, 'queued', $9, $10, $10)";

/// The job's files were sent again: a job that has still to read them refers to them.
const LINK_FILE_AGAIN: &str = "
    INSERT INTO job_file (job_id, blob)
    SELECT id, $2 FROM job WHERE id = $1 AND state <> 'done' ON CONFLICT DO NOTHING";

const LINK_FILE: &str = "INSERT INTO job_file (job_id, blob) VALUES ($1, $2) ON CONFLICT DO NOTHING";

/// Like [`insert`], with another priority than the usual one of the input.
async fn insert_with_priority(
    tx: &mut SqliteConnection,
    input: &JobInput,
    priority: JobPriority,
    now_ms: i64,
    max_attempts: u32,
) -> StoreResult<JobId> {
    let facts = input.facts();
    let text = serde_json::to_string(input).unwrap_or_default(); // plain data; the schema refuses an empty text
    let hash = Blob::of(text.as_bytes()).hash;
    let versions = versions(tx, facts.key_version).await?;
    let found = sqlx::query_scalar(FIND).bind(facts.kind).bind(hash).bind(&versions);
    if let Some(id) = found.fetch_optional(&mut *tx).await? {
        requeue(tx, id, now_ms).await?;
        raise_priority(tx, id, priority).await?;
        // The files were sent again. If the job does not need them any more, their rows let them be collected.
        for blob in facts.blobs {
            blobs::record(tx, blob, now_ms).await?;
            sqlx::query(LINK_FILE_AGAIN).bind(id).bind(blob.hash).execute(&mut *tx).await?;
        }
        return Ok(id);
    }
    let id = JobId::at(now_ms);
    let insert = sqlx::query(INSERT).bind(id).bind(facts.kind).bind(text).bind(hash).bind(versions);
    let insert = insert.bind(facts.session).bind(facts.of_box).bind(priority as i64);
    let insert = insert.bind(max_attempts).bind(now_ms);
    insert.execute(&mut *tx).await.map_err(missing("box"))?;
    for blob in facts.blobs {
        blobs::record(tx, blob, now_ms).await?;
        sqlx::query(LINK_FILE).bind(id).bind(blob.hash).execute(&mut *tx).await?;
    }
    Ok(id)
}

const LATEST_CALIBRATION: &str = "SELECT coalesce(max(version), 0) FROM calibration WHERE box_id = $1";

const LATEST_PALETTE: &str = "SELECT coalesce(max(version), 0) FROM palette WHERE box_id = $1";

/// The `versions` part of a job's key.
async fn versions(tx: &mut SqliteConnection, key: KeyVersion) -> StoreResult<String> {
    let (latest, of) = match key {
        KeyVersion::Pipeline => return Ok(format!("pipeline {PIPELINE_VERSION}")),
        KeyVersion::Calibration(of) => (LATEST_CALIBRATION, of),
        KeyVersion::Palette(of) => (LATEST_PALETTE, of),
    };
    let version: i64 = sqlx::query_scalar(latest).bind(of).fetch_one(tx).await?;
    Ok(format!("after {version}"))
}

const RAISE_PRIORITY: &str = "UPDATE job SET turn = min(turn, $2) WHERE id = $1";

/// Raises a job's priority to this one if it is lower: a person now asks for work that a rescoring had queued at low
/// priority.
pub(super) async fn raise_priority(tx: &mut SqliteConnection, id: JobId, priority: JobPriority) -> StoreResult<()> {
    sqlx::query(RAISE_PRIORITY).bind(id).bind(priority as i64).execute(tx).await?;
    Ok(())
}

const REQUEUE: &str = "
    UPDATE job SET state = 'queued', attempt = 0, lost_leases = 0, progress = 0, problem = NULL, queued_at_ms = max($2, queued_at_ms),
                   started_at_ms = NULL, ended_at_ms = NULL
    WHERE id = $1 AND state IN ('failed', 'quarantined')";

/// Queues a failed or quarantined job again with all its attempts; `false` if it is in another state.
pub(super) async fn requeue(tx: &mut SqliteConnection, id: JobId, now_ms: i64) -> StoreResult<bool> {
    Ok(sqlx::query(REQUEUE).bind(id).bind(now_ms).execute(tx).await?.rows_affected() > 0)
}

/// Queues the tracking of a session with the camera and colours of its box that were valid when it was recorded. If it
/// was tracked with them before and with others since, that earlier result becomes the current one again. Returns `None` if the box lacks one of
/// them, if the recording is still arriving or its video was deleted, or if the session was measured by another program.
pub(in crate::store) async fn enqueue_track(
    tx: &mut SqliteConnection,
    session: SessionId,
    now_ms: i64,
    max_attempts: u32,
) -> StoreResult<Option<JobId>> {
    enqueue_track_with_priority(tx, session, JobPriority::Session, now_ms, max_attempts).await
}

const TRACK_INPUT: &str = "
    SELECT blob.hash, blob.bytes, setup.calibration_id AS calibration, setup.palette_id AS palette
    FROM session JOIN blob ON blob.hash = session.video JOIN valid_setup AS setup ON setup.session_id = session.id
    WHERE session.id = $1 AND session.tracker IS NULL AND blob.dropped_at_ms IS NULL";

/// Like [`enqueue_track`], with the given priority.
pub(in crate::store) async fn enqueue_track_with_priority(
    tx: &mut SqliteConnection,
    session: SessionId,
    priority: JobPriority,
    now_ms: i64,
    max_attempts: u32,
) -> StoreResult<Option<JobId>> {
    #[derive(sqlx::FromRow)]
    struct TrackInputRow {
        hash: BlobHash,
        bytes: i64,
        calibration: Option<CalibrationId>,
        palette: Option<PaletteId>,
    }
    let row: Option<TrackInputRow> = sqlx::query_as(TRACK_INPUT).bind(session).fetch_optional(&mut *tx).await?;
    let Some(row) = row else { return Ok(None) };
    let (Some(calibration), Some(palette)) = (row.calibration, row.palette) else { return Ok(None) };
    let video = Blob { hash: row.hash, bytes: row.bytes.unsigned_abs() };
    let (time, time_revision) = time_in_force(tx, session).await?;
    let input = TrackInput { session, video, calibration, palette, time, time_revision };
    let job = insert_with_priority(tx, &JobInput::Track(input.clone()), priority, now_ms, max_attempts).await?;
    recall(tx, job, &input, (now_ms, max_attempts)).await?;
    Ok(Some(job))
}

/// Whether the job is done, but the session has a result with another camera or other colours since, or failed with them.
const SELECT_IS_SUPERSEDED: &str = "
    SELECT job.state = 'done'
           AND (EXISTS (SELECT 1 FROM tracking_job AS latest
                        WHERE latest.session_id = job.session_id AND latest.state IN ('failed', 'quarantined'))
                OR NOT EXISTS (SELECT 1 FROM current_result AS result
                               WHERE result.session_id = job.session_id AND result.calibration_id = $2
                                 AND result.palette_id = $3))
    FROM job WHERE job.id = $1";

/// The latest result of a session by this program with this camera, these colours and these times.
const SELECT_EARLIER_RESULT: &str = "
    SELECT id FROM result
    WHERE session_id = $1 AND calibration_id = $2 AND palette_id = $3 AND time_revision = $4
      AND coalesce(tracked_with, pipeline) = $5
    ORDER BY rowid DESC LIMIT 1";

/// The latest row is the current one, so an earlier one moves to the end.
const MOVE_RESULT_TO_END: &str = "UPDATE result SET rowid = (SELECT max(rowid) + 1 FROM result) WHERE id = $1";

const MOVE_JOB_TO_END: &str = "UPDATE job SET rowid = (SELECT max(rowid) + 1 FROM job) WHERE id = $1";

/// Makes the result of a tracking job that is done the current one again, if the session was tracked with another camera
/// or other colours since: their valid times were changed and changed back. Does nothing for any other job.
async fn recall(
    tx: &mut SqliteConnection,
    job: JobId,
    input: &TrackInput,
    (now_ms, max_attempts): (i64, u32),
) -> StoreResult<()> {
    let is_superseded = sqlx::query_scalar(SELECT_IS_SUPERSEDED).bind(job).bind(input.calibration).bind(input.palette);
    if !is_superseded.fetch_one(&mut *tx).await? {
        return Ok(());
    }
    let result = sqlx::query_scalar(SELECT_EARLIER_RESULT).bind(input.session).bind(input.calibration);
    let result = result.bind(input.palette).bind(integer(input.time_revision)).bind(PIPELINE_VERSION);
    let Some(result): Option<ResultId> = result.fetch_optional(&mut *tx).await? else { return Ok(()) };
    sqlx::query(MOVE_RESULT_TO_END).bind(result).execute(&mut *tx).await?;
    sqlx::query(MOVE_JOB_TO_END).bind(job).execute(&mut *tx).await?;
    settle_box_question(tx, input.session).await?;
    let (session, edits) = (input.session, revision(tx, input.session).await?);
    if let Some(CurrentResult { id, trajectory, edits: made_with, .. }) = current_result(tx, session).await?
        && made_with != edits
    {
        let input = JobInput::Rescore(RescoreInput { session, result: id, trajectory, edits });
        insert(tx, &input, now_ms, max_attempts).await?;
    }
    Ok(())
}

/// Queues the scoring of the current result's path with the edits that are in force. If that path has other times than
/// those in force, because its tracking with them failed, the recording is tracked again instead: a new score would look
/// up to date although the correction is not in its numbers.
pub(in crate::store) async fn enqueue_rescore(
    tx: &mut SqliteConnection,
    session: SessionId,
    now_ms: i64,
    max_attempts: u32,
) -> StoreResult<Option<JobId>> {
    let Some(current) = current_result(tx, session).await? else { return Ok(None) };
    if current.time_revision != time_in_force(tx, session).await?.1 {
        return enqueue_track(tx, session, now_ms, max_attempts).await;
    }
    let edits = revision(tx, session).await?;
    let input = JobInput::Rescore(RescoreInput { session, result: current.id, trajectory: current.trajectory, edits });
    insert(tx, &input, now_ms, max_attempts).await.map(Some)
}

/// Like [`enqueue_rescore`], but only if the current result was made with other edits than those in force. Called after
/// each edit, and after each new result, whose work may have begun before an edit.
pub(in crate::store) async fn enqueue_rescore_if_outdated(
    tx: &mut SqliteConnection,
    session: SessionId,
    now_ms: i64,
    max_attempts: u32,
) -> StoreResult<Option<JobId>> {
    let made_with = current_result(tx, session).await?.map(|current| current.edits);
    if made_with.is_none() || made_with == Some(revision(tx, session).await?) {
        return Ok(None);
    }
    enqueue_rescore(tx, session, now_ms, max_attempts).await
}

const CURRENT_RESULT: &str = "
    SELECT result.id, blob.hash, blob.bytes, result.edits, result.time_revision
    FROM current_result AS result JOIN blob ON blob.hash = result.trajectory WHERE result.session_id = $1";

/// The current result of a session.
pub(super) struct CurrentResult {
    pub(super) id: ResultId,
    /// Its path.
    trajectory: Blob,
    /// The revision of the edits that it was made with.
    edits: u64,
    /// The revision of the times that it was tracked with.
    time_revision: u64,
}

/// The current result of a session; `None` if it has none.
pub(super) async fn current_result(
    tx: &mut SqliteConnection,
    session: SessionId,
) -> StoreResult<Option<CurrentResult>> {
    let row: Option<(ResultId, BlobHash, i64, i64, i64)> =
        sqlx::query_as(CURRENT_RESULT).bind(session).fetch_optional(tx).await?;
    Ok(row.map(|(id, hash, bytes, edits, time_revision)| CurrentResult {
        id,
        trajectory: Blob { hash, bytes: bytes.unsigned_abs() },
        edits: edits.unsigned_abs(),
        time_revision: time_revision.unsigned_abs(),
    }))
}

const SESSIONS_WITHOUT_JOB: &str = "
    SELECT id FROM session
    WHERE box_id = $1 AND NOT EXISTS (SELECT 1 FROM tracking_job WHERE session_id = session.id) ORDER BY id";

/// Queues the sessions of a box that have waited for its camera or colours.
pub(in crate::store) async fn enqueue_waiting_sessions(
    tx: &mut SqliteConnection,
    of: BoxId,
    now_ms: i64,
    max_attempts: u32,
) -> StoreResult<()> {
    let waiting: Vec<SessionId> = sqlx::query_scalar(SESSIONS_WITHOUT_JOB).bind(of).fetch_all(&mut *tx).await?;
    for session in waiting {
        enqueue_track(tx, session, now_ms, max_attempts).await?;
    }
    Ok(())
}
