//! Stores results in the transaction that ends the job, under the job's lease. A worker that has lost the lease stores
//! nothing.

use sqlx::sqlite::SqliteConnection;
use sqlx::types::Json;

use super::super::calibrations::{self, CalibrationRecord};
use super::super::columns::integer;
use super::super::comments::scale_comments;
use super::super::edits::{revision, scale_edits, settle_box_question, time_in_force};
use super::super::error::StoreResult;
use super::super::error_sheets::scale_marks;
use super::super::exams::judge_attempt;
use super::super::palettes::{self, PaletteRecord};
use super::super::sessions::evidence;
use super::super::{StoreError, blobs, self_tests, surroundings};
use super::enqueue::{current_result, enqueue_rescore_if_outdated, enqueue_track, enqueue_waiting_sessions};
use super::lease::end_as_done;
use super::{JobStore, Lease};
use crate::domain::calibration::NewCalibration;
use crate::domain::evidence::EvidenceRow;
use crate::domain::job::JobInput;
use crate::domain::palette::{NewPalette, PaletteAdvice};
use crate::domain::self_test::NewSelfTest;
use crate::domain::session::{FeatureRow, NewResult, NewScore, ResultClock};
use crate::ids::{BoxId, CalibrationId, JobId, PaletteId, ResultId, SessionId};

const SET_ADVICE: &str = "UPDATE job SET advice = $2 WHERE id = $1";

const RELEASE_FILES: &str = "DELETE FROM job_file WHERE job_id = $1";

/// Of the files of a palette job, the picture of the empty box is kept: tracking needs it, and it shows no person.
const RELEASE_MARKED_FILES: &str = "
    DELETE FROM job_file
    WHERE job_id = $1
      AND blob IS NOT (SELECT json_extract(input, '$.empty_box.blob.hash') FROM job WHERE id = $1)";

impl JobStore<'_> {
    /// Stores the result of tracking a session. If the session already has a result of the same versions, edits and times,
    /// that one stays, because the same input gives the same numbers. If the session was edited since it was assessed, it is
    /// scored again.
    ///
    /// Nothing is stored if the times were corrected meanwhile, since that edit has queued its own job. If the result has
    /// other times than the one before, edits, comments and marks of errors follow it. If another version of the box's
    /// camera or colours is valid for the recording by now, the session is tracked again with it, which applies its edits,
    /// too.
    pub async fn finish_track(&self, held: &Lease, result: NewResult) -> StoreResult<()> {
        let session = held.job.session_id.ok_or_else(|| wrong_kind("a session"))?;
        let (time_revision, setup) = match &held.job.input {
            JobInput::Track(input) => (input.time_revision, Some((input.calibration, input.palette))),
            _ => (0, None), // an import, whose times are never corrected
        };
        let (id, token, now_ms, attempts) = (held.job.id, held.token, self.0.now_ms(), self.0.max_attempts());
        self.0
            .write(async move |tx| {
                end_as_done(tx, id, token, now_ms).await?;
                if time_in_force(tx, session).await?.1 != time_revision {
                    return Ok(());
                }
                let ratio = factor_of(result.video.clock) / current_factor(tx, session).await?;
                if let Some(picture) = &result.surroundings {
                    surroundings::insert_of_session(tx, session, picture).await?;
                }
                let is_new = insert_result(tx, (session, id, time_revision), result, now_ms).await?;
                if is_new && ratio != 1.0 {
                    scale_edits(tx, session, ratio).await?;
                    scale_comments(tx, session, ratio).await?;
                    scale_marks(tx, session, ratio).await?;
                }
                settle_box_question(tx, session).await?;
                let is_outdated = setup.is_some() && setup != setup_in_force(tx, session).await?;
                if is_outdated && enqueue_track(tx, session, now_ms, attempts).await?.is_some() {
                    return Ok(());
                }
                enqueue_rescore_if_outdated(tx, session, now_ms, attempts).await?;
                judge_attempt(tx, session, now_ms).await
            })
            .await
    }

    /// Stores the result of scoring a stored path again, beside the earlier results. Nothing is stored if another
    /// result is current by now, since its path is newer, or if the session was edited meanwhile, since that edit has
    /// queued its own job.
    pub async fn finish_rescore(&self, held: &Lease, score: NewScore) -> StoreResult<()> {
        let session = held.job.session_id.ok_or_else(|| wrong_kind("a session"))?;
        let (id, token, now_ms) = (held.job.id, held.token, self.0.now_ms());
        self.0
            .write(async move |tx| {
                end_as_done(tx, id, token, now_ms).await?;
                let current = current_result(tx, session).await?.map(|current| current.id);
                if current != Some(score.from) || score.edits != revision(tx, session).await? {
                    return Ok(());
                }
                insert_score(tx, id, score, now_ms).await?;
                settle_box_question(tx, session).await
            })
            .await
    }

    /// Stores the next version of a box's camera, releases the photos, and queues the sessions that waited for it.
    pub async fn finish_calibration(&self, held: &Lease, new: NewCalibration) -> StoreResult<CalibrationRecord> {
        let of = box_of(held)?;
        let (id, token, now_ms, attempts) = (held.job.id, held.token, self.0.now_ms(), self.0.max_attempts());
        self.0
            .write(async move |tx| {
                end_as_done(tx, id, token, now_ms).await?;
                sqlx::query(RELEASE_FILES).bind(id).execute(&mut *tx).await?;
                let calibration = calibrations::insert(tx, of, new, now_ms).await?;
                enqueue_waiting_sessions(tx, of, now_ms, attempts).await?;
                Ok(calibration)
            })
            .await
    }

    /// Stores the advice on tape colours in the job itself and releases its picture, which is not needed any more.
    pub async fn finish_advice(&self, held: &Lease, advice: PaletteAdvice) -> StoreResult<()> {
        let (id, token, now_ms) = (held.job.id, held.token, self.0.now_ms());
        self.0
            .write(async move |tx| {
                end_as_done(tx, id, token, now_ms).await?;
                sqlx::query(SET_ADVICE).bind(id).bind(Json(advice)).execute(&mut *tx).await?;
                sqlx::query(RELEASE_FILES).bind(id).execute(&mut *tx).await?;
                Ok(())
            })
            .await
    }

    /// Stores the next version of a box's colours, releases the marked pictures, which may show a person, and queues the
    /// sessions that waited for them. The picture of the empty box stays.
    pub async fn finish_palette(&self, held: &Lease, new: NewPalette) -> StoreResult<PaletteRecord> {
        let of = box_of(held)?;
        let (id, token, now_ms, attempts) = (held.job.id, held.token, self.0.now_ms(), self.0.max_attempts());
        self.0
            .write(async move |tx| {
                end_as_done(tx, id, token, now_ms).await?;
                sqlx::query(RELEASE_MARKED_FILES).bind(id).execute(&mut *tx).await?;
                let picture = new.surroundings.clone();
                let palette = palettes::insert(tx, of, new, now_ms).await?;
                if let Some(picture) = picture {
                    surroundings::insert_of_palette(tx, palette.id, &picture).await?;
                }
                enqueue_waiting_sessions(tx, of, now_ms, attempts).await?;
                Ok(palette)
            })
            .await
    }

    /// Stores a box's self-test and releases its recording, which is not needed any more.
    pub async fn finish_self_test(&self, held: &Lease, new: NewSelfTest) -> StoreResult<()> {
        let of = box_of(held)?;
        let (id, token, now_ms) = (held.job.id, held.token, self.0.now_ms());
        self.0
            .write(async move |tx| {
                end_as_done(tx, id, token, now_ms).await?;
                sqlx::query(RELEASE_FILES).bind(id).execute(&mut *tx).await?;
                self_tests::insert(tx, of, new, now_ms).await
            })
            .await
    }
}

const SETUP_IN_FORCE: &str = "SELECT calibration_id, palette_id FROM valid_setup WHERE session_id = $1";

/// The versions of camera and colours that are valid for a session's recording now.
async fn setup_in_force(
    tx: &mut SqliteConnection,
    session: SessionId,
) -> StoreResult<Option<(CalibrationId, PaletteId)>> {
    let found: Option<(Option<CalibrationId>, Option<PaletteId>)> =
        sqlx::query_as(SETUP_IN_FORCE).bind(session).fetch_optional(tx).await?;
    Ok(found.and_then(|(calibration, palette)| calibration.zip(palette)))
}

const LATEST_CLOCK: &str = "SELECT clock FROM result WHERE session_id = $1 ORDER BY rowid DESC LIMIT 1";

/// The factor of the times that the session's edits and comments have: those of its latest result, of any box; 1 if
/// there is none.
async fn current_factor(tx: &mut SqliteConnection, session: SessionId) -> StoreResult<f64> {
    let clock: Option<Option<Json<ResultClock>>> =
        sqlx::query_scalar(LATEST_CLOCK).bind(session).fetch_optional(tx).await?;
    Ok(factor_of(clock.flatten().map(|Json(clock)| clock)))
}

/// The factor between the file's stamps and these times. Without a clock, the times are the stamps.
fn factor_of(clock: Option<ResultClock>) -> f64 {
    clock.map_or(1.0, |clock| clock.applied.factor)
}

fn box_of(held: &Lease) -> StoreResult<BoxId> {
    held.job.box_id.ok_or_else(|| wrong_kind("a box"))
}

fn wrong_kind(expected: &str) -> StoreError {
    StoreError::refused(format!("this result belongs to a job on {expected}, but the job has none"))
}

const INSERT_RESULT: &str = "
    INSERT INTO result (id, session_id, pipeline, calibration_id, palette_id, model, width, height, frames, duration_s,
                        tools, quality, score, trajectory, diagnostics, preview, created_at_ms, tracked_with, edits,
                        clock, time_revision)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, $16, $17, $18, $19, $20, $21)
    ON CONFLICT DO NOTHING RETURNING id";

/// Inserts a result with its features and evidence; `false` if the session has that result already.
async fn insert_result(
    tx: &mut SqliteConnection,
    (session, job, time_revision): (SessionId, JobId, u64),
    new: NewResult,
    now_ms: i64,
) -> StoreResult<bool> {
    for blob in [Some(new.trajectory), new.diagnostics, new.preview].into_iter().flatten() {
        blobs::record(tx, blob, now_ms).await?;
    }
    let insert = sqlx::query_scalar(INSERT_RESULT).bind(ResultId::at(now_ms)).bind(session);
    let versions = new.versions;
    let insert = insert.bind(versions.pipeline).bind(versions.calibration).bind(versions.palette).bind(versions.model);
    let insert = insert.bind(new.video.width).bind(new.video.height).bind(integer(new.video.frames));
    let insert = insert.bind(new.video.duration_s).bind(Json(new.tools)).bind(Json(new.quality));
    let insert = insert.bind(new.score.map(Json)).bind(new.trajectory.hash).bind(new.diagnostics.map(|blob| blob.hash));
    let insert = insert
        .bind(new.preview.map(|blob| blob.hash))
        .bind(now_ms)
        .bind(versions.tracked_with)
        .bind(integer(new.edits))
        .bind(new.video.clock.map(Json))
        .bind(integer(time_revision));
    let inserted: Option<ResultId> = insert.fetch_optional(&mut *tx).await?;
    let Some(result) = inserted else { return Ok(false) };
    insert_features_and_evidence(tx, job, result, new.features, new.evidence).await?;
    Ok(true)
}

const INSERT_SCORE: &str = "
    INSERT INTO result (id, session_id, pipeline, calibration_id, palette_id, model, width, height, frames, duration_s,
                        tools, quality, score, trajectory, diagnostics, preview, created_at_ms, tracked_with, edits,
                        clock, time_revision)
    SELECT $1, session_id, $2, calibration_id, palette_id, NULL, width, height, frames, duration_s,
           tools, $3, NULL, trajectory, diagnostics, preview, $4, $5, $7, clock, time_revision FROM result WHERE id = $6
    ON CONFLICT DO NOTHING RETURNING id";

/// Inserts a new result for the path of an earlier one, with that result's files, video facts, camera and colours.
async fn insert_score(tx: &mut SqliteConnection, job: JobId, new: NewScore, now_ms: i64) -> StoreResult<()> {
    let insert = sqlx::query_scalar(INSERT_SCORE)
        .bind(ResultId::at(now_ms))
        .bind(new.pipeline)
        .bind(Json(new.quality))
        .bind(now_ms);
    let insert = insert.bind(new.tracked_with).bind(new.from).bind(integer(new.edits));
    let inserted: Option<ResultId> = insert.fetch_optional(&mut *tx).await?;
    match inserted {
        Some(result) => insert_features_and_evidence(tx, job, result, new.features, new.evidence).await,
        None => Ok(()),
    }
}

const LINK_RESCORING: &str = "UPDATE rescoring_item SET new_result_id = $2 WHERE job_id = $1 AND state = 'working'";

const INSERT_FEATURE: &str = "
    INSERT INTO feature (result_id, position, name, title, unit, tool, space, value, not_enough,
                         as_measured, sigma, low, high, no_error)
    VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14)";

/// Inserts a new result's features and evidence, and links the result to the rescoring item that ordered it, if there
/// is one. A value that is a lower bound gets a `low` and no `high`.
async fn insert_features_and_evidence(
    tx: &mut SqliteConnection,
    job: JobId,
    result: ResultId,
    features: Vec<FeatureRow>,
    evidence: Vec<EvidenceRow>,
) -> StoreResult<()> {
    evidence::insert(tx, result, evidence).await?;
    sqlx::query(LINK_RESCORING).bind(job).bind(result).execute(&mut *tx).await?;
    for (position, feature) in features.into_iter().enumerate() {
        let lower_bound = feature.value.as_ref().ok().copied().filter(|_| feature.is_lower_bound());
        let insert = sqlx::query(INSERT_FEATURE)
            .bind(result)
            .bind(integer(position as u64))
            .bind(feature.name)
            .bind(feature.title);
        let insert = insert.bind(feature.unit).bind(feature.tool).bind(feature.space);
        let insert = insert.bind(feature.value.as_ref().ok().copied()).bind(feature.value.err());
        let (bar, no_bar) = feature.error.transpose().map_or_else(|reason| (None, Some(reason)), |bar| (bar, None));
        let insert = insert.bind(bar.map(|bar| bar.as_measured)).bind(bar.map(|bar| bar.sigma));
        let insert = insert.bind(bar.map(|bar| bar.low).or(lower_bound)).bind(bar.map(|bar| bar.high)).bind(no_bar);
        insert.execute(&mut *tx).await?;
    }
    Ok(())
}
