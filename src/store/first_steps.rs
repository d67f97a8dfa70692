//! What a new centre has, and lacks: for the guide through the first steps. It is read from the data, so a step counts
//! as done however it was done.

use super::error::StoreResult;
use super::visibility::{BindScope, require_staff};
use super::{Scope, Store};
use crate::ids::BoxId;

/// Access to the first steps.
pub struct FirstStepsStore<'s>(pub(super) &'s Store);

/// What the centre has, as the scope sees it.
#[derive(Clone, Debug, PartialEq, Eq, sqlx::FromRow)]
pub struct FirstStepsRecord {
    /// The caller has chosen the password of the own account.
    pub has_own_password: bool,
    /// The centre has a name.
    pub has_name: bool,
    /// The caller sees a group.
    pub has_group: bool,
    /// There is a task.
    pub has_task: bool,
    /// There is a box.
    pub has_box: bool,
    /// A box has a camera and colours, so that its recordings are measured.
    pub has_ready_box: bool,
    /// The first box that lacks one of them.
    pub box_to_set_up: Option<BoxId>,
    /// The caller sees a trainee.
    pub has_trainee: bool,
    /// The caller sees a session.
    pub has_session: bool,
}

const SELECT_FIRST_STEPS: &str = "
    SELECT EXISTS (SELECT 1 FROM person WHERE id = $3 AND password_state = 'own') AS has_own_password,
           EXISTS (SELECT 1 FROM centre WHERE name IS NOT NULL) AS has_name,
           EXISTS (SELECT 1 FROM training_group
                   WHERE $1 = 'administrator'
                      OR EXISTS (SELECT 1 FROM group_instructor WHERE group_id = training_group.id AND person_id = $2)
                  ) AS has_group,
           EXISTS (SELECT 1 FROM task) AS has_task,
           EXISTS (SELECT 1 FROM training_box) AS has_box,
           EXISTS (SELECT 1 FROM training_box WHERE id IN (SELECT box_id FROM calibration)
                                                AND id IN (SELECT box_id FROM palette)) AS has_ready_box,
           (SELECT id FROM training_box
            WHERE (id NOT IN (SELECT box_id FROM calibration) OR id NOT IN (SELECT box_id FROM palette))
              AND id NOT IN (SELECT box_id FROM merged_box) ORDER BY id LIMIT 1) AS box_to_set_up,
           EXISTS (SELECT 1 FROM trainee
                   WHERE ($1 = 'administrator'
                          OR id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
                     AND ($2 IS 'service' OR id NOT IN (SELECT trainee_id FROM hidden_trainee))) AS has_trainee,
           EXISTS (SELECT 1 FROM session
                   WHERE ($1 = 'administrator'
                          OR trainee_id IN (SELECT trainee_id FROM visible_trainee WHERE role = $1 AND subject = $2))
                     AND ($2 IS 'service' OR trainee_id NOT IN (SELECT trainee_id FROM hidden_trainee))) AS has_session";

impl FirstStepsStore<'_> {
    /// What the centre has, as staff see it.
    pub async fn get(&self, scope: &Scope) -> StoreResult<FirstStepsRecord> {
        require_staff(scope, "the first steps")?;
        let row = sqlx::query_as(SELECT_FIRST_STEPS).bind_scope(scope).bind(scope.person());
        Ok(row.fetch_one(self.0.readers()).await?)
    }
}
