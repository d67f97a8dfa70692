//! Enrols many trainees at once.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::TraineeResponse;
use crate::domain::enrolment::{self, EnrolmentRow, MAX_ROWS, RowProblem};
use crate::http::auth::signed_in::Staff;
use crate::http::error::{FieldError, HandlerResult, ProblemResponse, Refusal};
use crate::http::read::Json;
use crate::http::state::App;
use crate::store::Enrolment;

/// A list of people to enrol.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewEnrolment {
    /// The rows, 1 to 500.
    rows: Vec<EnrolmentRow>,
    /// `true`: only check the rows, and enrol no trainee.
    #[serde(default)]
    only_check: bool,
}

/// Result of an enrolment or of a check.
#[derive(Serialize, ToSchema)]
pub struct EnrolmentOutcome {
    /// The enrolled trainees, in the order of the rows; empty after a check.
    enrolled: Vec<TraineeResponse>,
    /// The problems of a check, row by row; empty after an enrolment.
    problems: Vec<RowProblem>,
}

/// Enrol many trainees at once
///
/// All rows or none: if any row cannot be used, no trainee is enrolled, and `problems` of the refusal lists every such
/// row, its field and the reason. `only_check` returns the same list without enrolling.
#[utoipa::path(post, path = "/enrolments", tag = "trainees", request_body = NewEnrolment,
    responses((status = OK, body = EnrolmentOutcome)))]
pub async fn enrol(
    State(app): State<App>,
    by: Staff,
    Json(NewEnrolment { rows, only_check }): Json<NewEnrolment>,
) -> HandlerResult<Json<EnrolmentOutcome>> {
    if !(1..=MAX_ROWS).contains(&rows.len()) {
        return Err(ProblemResponse::invalid("rows", format!("are {}; expected 1 to {MAX_ROWS}", rows.len())));
    }
    match app.store.trainees().enrol(&by.scope, enrolment::parse_rows(&rows), only_check).await? {
        Enrolment::Done(made) => Ok(Json(EnrolmentOutcome {
            enrolled: made.into_iter().map(|trainee| TraineeResponse::new(trainee, &by.scope)).collect(),
            problems: Vec::new(),
        })),
        Enrolment::Refused(problems) if only_check => Ok(Json(EnrolmentOutcome { enrolled: Vec::new(), problems })),
        Enrolment::Refused(problems) => Err(enrolment_problem(problems)),
    }
}

fn enrolment_problem(problems: Vec<RowProblem>) -> ProblemResponse {
    let rows = problems.iter().map(|problem| problem.row).collect::<std::collections::BTreeSet<_>>().len();
    let what = if rows == 1 { "row cannot" } else { "rows cannot" };
    let detail = format!(
        "{rows} {what} be used, so no trainee was enrolled. Correct the rows listed in `problems` and send the list \
         again."
    );
    let errors = problems.iter().map(|RowProblem { row, field, message }| FieldError {
        field: format!("rows[{}].{field}", row - 1),
        message: message.clone(),
    });
    Refusal::Invalid.with(detail).errors(errors).member("problems", serde_json::json!(problems))
}
