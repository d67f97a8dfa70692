//! What trainees do not see of an exam that is not closed, and what is never edited.
//!
//! Statements that read sessions, their results and jobs in a scope leave out the view `sealed_session` for trainees; a test
//! finds statements that lack it. For all callers these sessions count nowhere meanwhile (view `uncounted_session`).

use super::super::visibility::TraineeAudience;
use super::*;
use crate::domain::role::Role;
use crate::ids::JobId;

/// What an event or a live view is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SealedSubject {
    /// A session.
    Session(SessionId),
    /// A job on a session.
    Job(JobId),
}

/// The attempt that a session is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct ExamOfSession {
    /// The exam.
    pub exam_id: ExamId,
    /// Its state.
    pub state: ExamState,
    /// The number of the attempt.
    pub number: u32,
    /// True if the attempt was voided, so that the session counts nowhere.
    pub is_voided: bool,
}

const SELECT_OF_SESSION: &str = "
    SELECT exam.id AS exam_id, exam.state, attempt.number, attempt.voided_at_ms IS NOT NULL AS is_voided
    FROM exam_attempt AS attempt JOIN exam ON exam.id = attempt.exam_id WHERE attempt.session_id = $1";

const SELECT_IS_SEALED: &str = "
    SELECT EXISTS (SELECT 1 FROM sealed_session
                   WHERE session_id = coalesce((SELECT job.session_id FROM job WHERE job.id = $1), $1))";

const SELECT_IS_ORDERED: &str = "SELECT EXISTS (SELECT 1 FROM exam_attempt WHERE recording_id = $1)";

const SELECT_IS_OF_EXAM: &str = "SELECT EXISTS (SELECT 1 FROM exam_attempt WHERE session_id = $1)";

/// Whether a merge of trainee `$2` into `$1` hides one of two equal recordings that is an attempt of an exam.
const SELECT_HAS_TWIN: &str = "
    SELECT EXISTS (
        SELECT 1 FROM session AS kept JOIN session AS twin
          ON twin.trainee_id = $2 AND twin.task_id = kept.task_id
             AND (twin.box_id = kept.box_id AND twin.video = kept.video OR twin.path_hash = kept.path_hash)
        WHERE kept.trainee_id = $1
          AND EXISTS (SELECT 1 FROM exam_attempt WHERE session_id IN (kept.id, twin.id)))";

const SELECT_IS_RUNNING: &str = "
    SELECT EXISTS (SELECT 1 FROM exam
                   WHERE state = 'running' AND (trainee_id IN ($1, $2) OR box_id IN ($1, $2)))";

impl ExamStore<'_> {
    /// The exam that a session is an attempt of.
    pub async fn of_session(&self, scope: &Scope, session: SessionId) -> StoreResult<Option<ExamOfSession>> {
        self.0.sessions().get(scope, session).await?;
        Ok(sqlx::query_as(SELECT_OF_SESSION).bind(session).fetch_optional(self.0.readers()).await?)
    }

    /// True if this is an attempt of an exam that is not closed: no trainee may see anything of it.
    pub async fn is_sealed(&self, subject: SealedSubject) -> StoreResult<bool> {
        let id = match subject {
            SealedSubject::Session(id) => id.to_string(),
            SealedSubject::Job(id) => id.to_string(),
        };
        Ok(sqlx::query_scalar(SELECT_IS_SEALED).bind(id).fetch_one(self.0.readers()).await?)
    }

    /// True if this recording was ordered for an exam: its candidate does not end it.
    pub async fn is_ordered(&self, recording: FeedId) -> StoreResult<bool> {
        Ok(sqlx::query_scalar(SELECT_IS_ORDERED).bind(recording).fetch_one(self.0.readers()).await?)
    }

    /// The people who may hear of this session or job of a trainee.
    pub async fn audience(&self, subject: SealedSubject, trainee: TraineeId) -> StoreResult<TraineeAudience> {
        let TraineeAudience(mut people) = self.0.trainees().audience(trainee).await?;
        if !people.is_empty() && self.is_sealed(subject).await? {
            people.retain(|(role, _)| *role != Role::Trainee);
            // Administrators see the trainee also without an instructor: the audience must not be empty.
            people.push((Role::Administrator, String::new()));
        }
        Ok(TraineeAudience(people))
    }
}

/// Refuses to change a session that is an attempt of an exam.
pub(in crate::store) async fn refuse_if_of_exam(tx: &mut SqliteConnection, session: SessionId) -> StoreResult<()> {
    match sqlx::query_scalar(SELECT_IS_OF_EXAM).bind(session).fetch_one(tx).await? {
        true => Err(StoreError::ExamSession),
        false => Ok(()),
    }
}

/// Refuses to merge two records of a person that have the same recording, if it is an attempt of an exam: one of the two
/// would be hidden.
pub(in crate::store) async fn refuse_if_twin(
    tx: &mut SqliteConnection,
    [kept, merged]: [TraineeId; 2],
) -> StoreResult<()> {
    match sqlx::query_scalar(SELECT_HAS_TWIN).bind(kept).bind(merged).fetch_one(tx).await? {
        true => Err(StoreError::refused(
            "both records have the same recording, and one of the two is an attempt of an exam: erase the other session, \
             then merge the records",
        )),
        false => Ok(()),
    }
}

/// Refuses to merge or separate records of people or boxes while an exam of one of them is running.
pub(in crate::store) async fn refuse_if_running(
    tx: &mut SqliteConnection,
    records: [impl ToString; 2],
) -> StoreResult<()> {
    let [first, second] = records.map(|record| record.to_string());
    match sqlx::query_scalar(SELECT_IS_RUNNING).bind(first).bind(second).fetch_one(tx).await? {
        true => Err(StoreError::refused("an exam of this person, or in this box, is running: close it first")),
        false => Ok(()),
    }
}
