//! The guide through the first steps of a new centre.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::auth::signed_in::Staff;
use super::error::HandlerResult;
use super::read::Json;
use super::state::App;
use crate::domain::role::Role;
use crate::ids::BoxId;
use crate::store::FirstStepsRecord;

/// The first steps of a centre, in their order.
#[derive(Debug, Serialize, ToSchema)]
pub struct FirstSteps {
    /// True if the caller sees no session yet.
    is_empty: bool,
    steps: Vec<FirstStep>,
    /// The first box that lacks its camera or colours; `null`: there is none.
    box_to_set_up: Option<BoxId>,
}

/// A first step.
#[derive(Debug, Serialize, ToSchema)]
pub struct FirstStep {
    step: FirstStepKind,
    /// The data of the centre show that it was done.
    is_done: bool,
}

/// What a first step is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FirstStepKind {
    /// The caller has chosen the password of the own account.
    Password,
    /// The centre has a name. For administrators.
    Centre,
    /// The caller teaches a group. For instructors.
    Group,
    /// There is a task.
    Task,
    /// There is a box.
    Box,
    /// A box has a camera and colours.
    BoxSetup,
    /// There is a trainee.
    People,
    /// There is a session.
    Recording,
}

impl FirstSteps {
    fn new(found: &FirstStepsRecord, role: Role) -> Self {
        let of_role = match role {
            Role::Instructor => (FirstStepKind::Group, found.has_group),
            _ => (FirstStepKind::Centre, found.has_name),
        };
        let steps = [
            (FirstStepKind::Password, found.has_own_password),
            of_role,
            (FirstStepKind::Task, found.has_task),
            (FirstStepKind::Box, found.has_box),
            (FirstStepKind::BoxSetup, found.has_ready_box),
            (FirstStepKind::People, found.has_trainee),
            (FirstStepKind::Recording, found.has_session),
        ];
        let steps = steps.into_iter().map(|(step, is_done)| FirstStep { step, is_done }).collect();
        Self { is_empty: !found.has_session, steps, box_to_set_up: found.box_to_set_up }
    }
}

/// Read which first steps of a new centre are done
///
/// For administrators and instructors, each with the steps that they can do.
#[utoipa::path(get, path = "/first-steps", tag = "operation", responses((status = OK, body = FirstSteps)))]
pub async fn first_steps(State(app): State<App>, by: Staff) -> HandlerResult<Json<FirstSteps>> {
    let found = app.store.first_steps().get(&by.scope).await?;
    Ok(Json(FirstSteps::new(&found, by.scope.role())))
}
