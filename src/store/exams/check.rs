//! Whether closed exams are whole: `trocar admin check` asks.

use super::super::Store;
use super::*;

const SELECT_CLOSED: &str = "
    SELECT id, result FROM exam WHERE state = 'closed' AND ($1 IS NULL OR id > $1) ORDER BY id LIMIT 500";

/// What is wrong with closed exams: each counted attempt has an outcome that its figures give and a statement of the examiner,
/// and the result is the one that they give.
pub(in crate::store) async fn wrong_exams(store: &Store) -> StoreResult<Vec<String>> {
    let (mut wrong, mut after) = (Vec::new(), None::<ExamId>);
    loop {
        let closed: Vec<(ExamId, ExamResult)> =
            sqlx::query_as(SELECT_CLOSED).bind(after).fetch_all(store.readers()).await?;
        let Some((last, _)) = closed.last() else { return Ok(wrong) };
        after = Some(*last);
        let ids: Vec<ExamId> = closed.iter().map(|(id, _)| *id).collect();
        let attempts: Vec<AttemptRecord> =
            sqlx::query_as(SELECT_ATTEMPTS).bind(Json(ids)).fetch_all(store.readers()).await?;
        for (id, result) in closed {
            let counting = attempts.iter().filter(|attempt| attempt.exam_id == id && attempt.counts());
            let is_other = |attempt: &&AttemptRecord| {
                let figures = attempt.figures.as_deref().unwrap_or_default();
                attempt.outcome.is_some_and(|outcome| !outcome.follows_from(figures))
            };
            wrong.extend(counting.clone().filter(is_other).map(|attempt| {
                format!("attempt {} of the closed exam {id} has another outcome than its figures give", attempt.number)
            }));
            let stored = |attempt: &AttemptRecord| {
                let (outcome, completion) = attempt.outcome.zip(attempt.completion)?;
                Some(CountedAttempt { outcome, cause: attempt.cause, completion })
            };
            match counting.map(stored).collect::<Option<Vec<CountedAttempt>>>() {
                None => wrong.push(format!("an attempt of the closed exam {id} is not judged")),
                Some(counted) if result_of(&counted) != Some(result) => {
                    wrong.push(format!("the closed exam {id} has another result than its attempts give"));
                }
                Some(_) => {}
            }
        }
    }
}
