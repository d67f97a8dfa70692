//! Enrols many trainees at once.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::TraineeResponse;
use super::invitations::MadeInvitation;
use crate::domain::enrolment::{self, EnrolmentRow, MAX_ROWS, RowProblem};
use crate::domain::secret::Secret;
use crate::domain::text::Name;
use crate::http::auth::signed_in::{Staff, require_sign_in};
use crate::http::error::{FieldError, HandlerResult, ProblemResponse, Refusal};
use crate::http::read::Json;
use crate::http::state::App;
use crate::store::{EnrolledTrainee, EnrolmentInvitations, EnrolmentOptions};

/// A list of people to enrol.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewEnrolment {
    /// The rows, 1 to 500.
    rows: Vec<EnrolmentRow>,
    /// `true`: only check the rows, and change nothing.
    #[serde(default)]
    only_check: bool,
    /// `true`: make the groups that do not exist. An instructor teaches the groups that they make. `false`: a row that
    /// names such a group is refused.
    #[serde(default)]
    make_groups: bool,
    /// `true`: make an account for each trainee, and a link for choosing its password, as `POST /invitations` does. A
    /// token does not suffice.
    #[serde(default)]
    invite: bool,
}

/// Result of an enrolment or of a check.
#[derive(Serialize, ToSchema)]
pub struct EnrolmentOutcome {
    /// The enrolled trainees, in the order of the rows; empty after a check.
    enrolled: Vec<TraineeResponse>,
    /// The problems of a check, row by row; empty after an enrolment.
    problems: Vec<RowProblem>,
    /// The groups that were made, or will be.
    new_groups: Vec<Name>,
    /// The invitations of the enrolled trainees, in the order of the rows; empty without `invite`.
    invitations: Vec<MadeInvitation>,
}

/// Enrol many trainees at once
///
/// All rows or none: if any row cannot be used, nothing is changed, and `problems` of the refusal lists every such row,
/// its field and the reason. `only_check` returns the same list, and the groups that would be made.
#[utoipa::path(post, path = "/enrolments", tag = "trainees", request_body = NewEnrolment,
    responses((status = OK, body = EnrolmentOutcome)))]
pub async fn enrol(
    State(app): State<App>,
    by: Staff,
    Json(NewEnrolment { rows, only_check, make_groups, invite }): Json<NewEnrolment>,
) -> HandlerResult<Json<EnrolmentOutcome>> {
    if !(1..=MAX_ROWS).contains(&rows.len()) {
        return Err(ProblemResponse::invalid("rows", format!("are {}; expected 1 to {MAX_ROWS}", rows.len())));
    }
    let (mut secrets, mut invitations) = (Vec::new(), None);
    if invite {
        require_sign_in(&by.scope)?;
        secrets.extend(rows.iter().map(|_| Secret::random()));
        let terms = app.invitation_terms(&by.scope, false).await?;
        invitations = Some(EnrolmentInvitations { terms, secrets: secrets.iter().map(Secret::hash).collect() });
    }
    let options = EnrolmentOptions { only_check, make_groups, invitations };
    let done = app.store.trainees().enrol(&by.scope, enrolment::parse_rows(&rows), options).await?;
    if !done.problems.is_empty() && !only_check {
        return Err(enrolment_problem(done.problems));
    }
    let (mut enrolled, mut invitations) = (Vec::new(), Vec::new());
    for (index, EnrolledTrainee { trainee, invitation }) in done.enrolled.into_iter().enumerate() {
        enrolled.push(TraineeResponse::new(trainee, &by.scope));
        let made = invitation.zip(secrets.get(index));
        invitations.extend(made.map(|((person, link), secret)| MadeInvitation::new(person, &link, secret)));
    }
    let (problems, new_groups) = (done.problems, done.new_groups);
    Ok(Json(EnrolmentOutcome { enrolled, problems, new_groups, invitations }))
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
