//! Steps of a course, on the database of a small centre.

use std::time::Duration;

use serde_json::{Value, json};

use super::super::tests::with_standard;
use super::{CourseRow, StepProgress, StepState};
use crate::cohorts::Cohorts;
use crate::domain::edit::EditChange;
use crate::domain::scope::Scope;
use crate::domain::session::NewSession;
use crate::domain::text::Key;
use crate::ids::TraineeId;
use crate::store::EditBasis;
use crate::store::testing::{NOW_MS, TestCentre, duration};
use crate::time::{Clock, Day};

const DAY_MS: i64 = 86_400_000;

/// Creates a group with the trainee Ana, which follows a course with these steps since `days_ago` days. Returns Ana's
/// id.
async fn group_in_course(centre: &TestCentre, days_ago: i64, steps: Value) -> TraineeId {
    let ana = centre.trainee("Ana").await;
    centre.group("Autumn", &[], &[&ana]).await;
    let service = Scope::service();
    let new = serde_json::from_value(json!({"name": "Basics", "steps": steps})).unwrap();
    let course = centre.store.courses().create(&service, new).await.unwrap();
    let group = centre.store.groups().list(&service).await.unwrap()[0].id;
    let begins = Day::of(NOW_MS - days_ago * DAY_MS);
    centre.store.courses().follow(&service, group, course.id, begins).await.unwrap();
    ana.id
}

async fn row(centre: &TestCentre, cohorts: &Cohorts) -> CourseRow {
    let group = centre.store.groups().list(&Scope::service()).await.unwrap()[0].id;
    let table = cohorts.group_course(&Scope::service(), group).await.unwrap();
    let own = cohorts.own_courses(&Scope::service(), &Key::from("ana")).await.unwrap();
    assert_eq!([&table.rows[0]], [&own[0].row], "the trainee sees the same as the table shows");
    own[0].row.clone()
}

fn states(row: &CourseRow) -> Vec<StepState> {
    row.steps.iter().map(|step| step.state).collect()
}

#[tokio::test]
async fn a_step_is_passed_with_its_task_and_until_then_says_what_is_missing() {
    let (centre, cohorts) = with_standard(json!({"in_a_row": 2, "then_more": 1})).await;
    let ana = group_in_course(&centre, 30, json!([{"task": "peg-transfer"}])).await;
    let step = async || row(&centre, &cohorts).await.steps.remove(0);
    let StepProgress { state, sessions, missing, passed, .. } = step().await;
    assert_eq!((state, sessions, missing, passed), (StepState::NotBegun, 0, Some(3), None));
    centre.practised(ana, NOW_MS, vec![duration(60.0, 1.0)]).await;
    centre.practised(ana, NOW_MS + DAY_MS, vec![duration(40.0, 1.0)]).await;
    let StepProgress { state, sessions, missing, .. } = step().await;
    assert_eq!((state, sessions, missing), (StepState::InWork, 2, Some(2)), "one of two in a row, and one more");
    centre.practised(ana, NOW_MS + 2 * DAY_MS, vec![duration(40.0, 1.0)]).await;
    let last = centre.practised(ana, NOW_MS + 3 * DAY_MS, vec![duration(40.0, 1.0)]).await;
    let StepProgress { state, missing, passed, .. } = step().await;
    assert_eq!((state, missing, passed.unwrap().session), (StepState::Passed, None, last.id));
}

#[tokio::test]
async fn a_step_is_overdue_after_its_last_day_until_it_is_passed() {
    let (centre, cohorts) = with_standard(json!({"in_a_row": 1})).await;
    let ana = group_in_course(
        &centre,
        6,
        json!([{"task": "peg-transfer", "within_days": 7}, {"task": "peg-transfer", "sessions": 9}]),
    )
    .await;
    let ends_ms = Day::of(NOW_MS - 6 * DAY_MS).plus_days(8).start_ms(); // the seventh day after the first is the last
    let overdue = async || row(&centre, &cohorts).await.steps.iter().map(|step| step.overdue).collect::<Vec<_>>();
    let until = |end_ms: i64| centre.clock.advance(Duration::from_millis((end_ms - centre.clock.now_ms()) as u64));
    until(ends_ms - 1);
    assert_eq!(overdue().await, [false, false], "on its last day it is in time");
    until(ends_ms);
    assert_eq!(overdue().await, [true, false], "and a step without a due day is never late");
    centre.practised(ana, ends_ms, vec![duration(40.0, 1.0)]).await;
    assert_eq!(overdue().await, [false, false], "a step that is passed late is passed");
}

#[tokio::test]
async fn a_passed_standard_counts_from_any_time_and_practice_from_the_first_day() {
    let (centre, cohorts) = with_standard(json!({"in_a_row": 1})).await;
    let steps = json!([{"task": "peg-transfer"}, {"task": "peg-transfer", "sessions": 2}]);
    let ana = group_in_course(&centre, 6, steps).await;
    let first_ms = Day::of(NOW_MS - 6 * DAY_MS).start_ms();
    centre.practised(ana, first_ms - 1, vec![duration(40.0, 1.0)]).await;
    let before = row(&centre, &cohorts).await;
    assert_eq!(states(&before), [StepState::Passed, StepState::NotBegun]);
    assert_eq!((before.next, before.steps[1].missing), (Some(2), Some(2)));
    centre.practised(ana, first_ms, vec![duration(90.0, 1.0)]).await;
    let one = row(&centre, &cohorts).await;
    assert_eq!((one.steps[1].state, one.steps[1].sessions, one.steps[1].missing), (StepState::InWork, 1, Some(1)));
    let second = centre.practised(ana, first_ms + DAY_MS, vec![duration(90.0, 1.0)]).await;
    centre.practised(ana, first_ms + 2 * DAY_MS, vec![duration(90.0, 1.0)]).await;
    let done = row(&centre, &cohorts).await;
    let passed = done.steps[1].passed.clone().unwrap();
    assert_eq!(
        (done.next, done.steps[1].sessions, passed.session),
        (None, 3, second.id),
        "the second session passed it"
    );
}

#[tokio::test]
async fn practice_counts_with_any_result_unless_it_is_set_aside() {
    let (centre, cohorts) = with_standard(json!({"in_a_row": 1})).await;
    let ana = group_in_course(&centre, 1, json!([{"task": "peg-transfer", "sessions": 2}])).await;
    let first = centre.practised(ana, NOW_MS, vec![duration(90.0, 1.0)]).await;
    let new = NewSession { recorded_at_ms: Some(NOW_MS + 1), ..centre.new_session(ana, "waits in the queue") };
    centre.store.sessions().create(&Scope::service(), new).await.unwrap();
    assert_eq!(states(&row(&centre, &cohorts).await), [StepState::Passed]);
    let why = "Somebody else trained under this name.".parse().unwrap();
    centre
        .store
        .edits()
        .add(&Scope::service(), first.id, (EditChange::SetAside, why), EditBasis::default())
        .await
        .unwrap();
    assert_eq!(states(&row(&centre, &cohorts).await), [StepState::InWork]);
}

#[tokio::test]
async fn after_a_relapse_the_step_is_open_again() {
    let (centre, cohorts) = with_standard(Value::Null).await;
    let ana = group_in_course(&centre, 1, json!([{"task": "peg-transfer"}])).await;
    for day in 0..22 {
        let seconds = if day < 17 { 40.0 } else { 60.0 };
        centre.practised(ana, NOW_MS + day * DAY_MS, vec![duration(seconds, 1.0)]).await;
    }
    let row = row(&centre, &cohorts).await;
    assert_eq!((states(&row), row.next), (vec![StepState::InWork], Some(1)));
    assert_eq!(row.steps[0].missing, None, "without a rule the missing number is unknown");
}
