//! Many trainees at once.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::Trainee;
use crate::domain::enrolment::{self, EnrolmentRow, MOST_ROWS, RowProblem};
use crate::http::auth::signed_in::Staff;
use crate::http::error::{Answer, Problem, Refusal};
use crate::http::read::Json;
use crate::http::state::App;
use crate::store::Enrolment;

/// A list of people to enrol.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewEnrolment {
    /// The rows, 1 to 500.
    rows: Vec<EnrolmentRow>,
    /// Only look whether it could be done, and enrol nobody?
    #[serde(default)]
    only_check: bool,
}

/// What came of a list.
#[derive(Serialize, ToSchema)]
pub struct EnrolmentOutcome {
    /// Who is enrolled now, in the order of the rows; nobody, where it was only looked at.
    enrolled: Vec<Trainee>,
    /// What is wrong, row by row; only where it was only looked at.
    problems: Vec<RowProblem>,
}

/// Enrol many trainees at once: all of a list, or nobody
///
/// If any row cannot be used, nobody is enrolled, and `problems` of the refusal names every such row, its field and what is wrong.
/// `only_check` tells the same beforehand.
#[utoipa::path(post, path = "/enrolments", tag = "trainees", request_body = NewEnrolment,
    responses((status = OK, body = EnrolmentOutcome)))]
pub async fn enrol(
    State(app): State<App>,
    by: Staff,
    Json(NewEnrolment { rows, only_check }): Json<NewEnrolment>,
) -> Answer<Json<EnrolmentOutcome>> {
    if !(1..=MOST_ROWS).contains(&rows.len()) {
        return Err(Problem::invalid("rows", format!("are {}; expected 1 to {MOST_ROWS}", rows.len())));
    }
    let outcome = match enrolment::read(&rows) {
        Ok(enrolled) => app.store.trainees().enrol(&by.scope, enrolled, only_check).await?,
        Err(problems) => Enrolment::Refused(problems),
    };
    match outcome {
        Enrolment::Done(made) => {
            Ok(Json(EnrolmentOutcome { enrolled: made.into_iter().map(Trainee::from).collect(), problems: Vec::new() }))
        }
        Enrolment::Refused(problems) if only_check => Ok(Json(EnrolmentOutcome { enrolled: Vec::new(), problems })),
        Enrolment::Refused(problems) => Err(refused(problems)),
    }
}

fn refused(problems: Vec<RowProblem>) -> Problem {
    let rows = problems.iter().map(|problem| problem.row).collect::<std::collections::BTreeSet<_>>().len();
    let what = if rows == 1 { "row cannot" } else { "rows cannot" };
    let detail = format!(
        "{rows} {what} be used, so that nobody was enrolled. Mend what `problems` names and send the list again."
    );
    Refusal::Invalid.with(detail).member("problems", serde_json::json!(problems))
}
