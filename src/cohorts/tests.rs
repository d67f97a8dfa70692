//! Progress, on the database of a small centre.

use serde_json::json;

use super::answer::{PassedBy, ProgressAnswer, RuleStanding, SetAside, StandingName, TrialName};
use super::{Cohorts, ProgressSelection};
use crate::domain::edit::EditChange;
use crate::domain::scope::Scope;
use crate::domain::session::FeatureRow;
use crate::domain::text::{Key, Remark};
use crate::ids::TraineeId;
use crate::store::EditBasis;
use crate::store::testing::{NOW_MS, TestCentre, duration};

const DAY_MS: i64 = 86_400_000;

/// A centre with a standard for its task: at most 50 s, with this pass rule.
pub(super) async fn with_standard(rule: serde_json::Value) -> (TestCentre, Cohorts) {
    let centre = TestCentre::with_camera_and_colours().await;
    let cohorts = Cohorts::new(centre.store.clone(), centre.clock.clone());
    let target = json!({"feature": "duration", "by": {"method": "fixed", "limit": 50, "unit": "s"}});
    let new = serde_json::from_value(json!({"targets": [target], "rule": rule})).unwrap();
    let proposal = cohorts.propose(&Scope::service(), centre.task.id, new).await.unwrap();
    let definition = proposal.definition().unwrap();
    centre.store.standards().add(&Scope::service(), centre.task.id, definition).await.unwrap();
    (centre, cohorts)
}

/// A session that is being tracked.
async fn wait(centre: &TestCentre, trainee: TraineeId, day: i64) {
    let new = centre.new_session(trainee, &format!("waits since day {day}"));
    let new = crate::domain::session::NewSession { recorded_at_ms: Some(NOW_MS + day * DAY_MS), ..new };
    centre.store.sessions().create(&Scope::service(), new).await.unwrap();
    centre.claim().await.unwrap();
}

async fn progress(cohorts: &Cohorts) -> ProgressAnswer {
    let asked = ProgressSelection { task: Some(Key::from("peg-transfer")), ..ProgressSelection::default() };
    cohorts.progress(&Scope::service(), &Key::from("ana"), asked).await.unwrap().answer
}

#[tokio::test]
async fn a_pending_session_breaks_a_row_only_if_it_arrived_between_two_passes() {
    let (centre, cohorts) = with_standard(json!({"in_a_row": 2})).await;
    let ana = centre.trainee("Ana").await.id;
    let nothing = progress(&cohorts).await;
    assert_eq!((nothing.sessions.len(), nothing.charts.unwrap().standing), (0, StandingName::NotYet));
    centre.practised(ana, NOW_MS, vec![duration(40.0, 1.0)]).await;
    centre.practised(ana, NOW_MS + 2 * DAY_MS, vec![duration(40.0, 1.0)]).await;
    assert_eq!(progress(&cohorts).await.rule.unwrap().met_at, Some(2));
    wait(&centre, ana, 3).await;
    assert_eq!(progress(&cohorts).await.rule.unwrap().met_at, Some(2), "a pending session at the end changes nothing");
    wait(&centre, ana, 1).await;
    let stated = progress(&cohorts).await;
    assert_eq!(stated.rule.unwrap().state, RuleStanding::Met, "a stated time between the passes changes nothing");
    assert_eq!(stated.sessions.len(), 4);

    let (centre, cohorts) = with_standard(json!({"in_a_row": 2})).await;
    let ana = centre.trainee("Ana").await.id;
    centre.practised(ana, NOW_MS, vec![duration(40.0, 1.0)]).await;
    wait(&centre, ana, 1).await;
    centre.practised(ana, NOW_MS + 2 * DAY_MS, vec![duration(40.0, 1.0)]).await;
    wait(&centre, ana, 3).await;
    let now = progress(&cohorts).await;
    let rule = now.rule.unwrap();
    assert_eq!((rule.state, rule.have_in_a_row, rule.unknown), (RuleStanding::Open, Some(1), Some(1)), "may be a miss");
    let trials: Vec<_> = now.sessions.iter().map(|step| (step.trial, step.set_aside)).collect();
    let (passed, pending) = ((Some(TrialName::Passed), None), Some(SetAside::Pending));
    assert_eq!(trials, [passed, (Some(TrialName::Unknown), pending), passed, (None, pending)]);
}

#[tokio::test]
async fn after_a_relapse_there_are_no_refreshers_and_no_pass() {
    let (centre, cohorts) = with_standard(serde_json::Value::Null).await;
    let ana = centre.trainee("Ana").await.id;
    for day in 0..17 {
        centre.practised(ana, NOW_MS + day * DAY_MS, vec![duration(40.0, 1.0)]).await;
    }
    let proficient = progress(&cohorts).await;
    assert_eq!(proficient.charts.unwrap().standing, StandingName::Proficient);
    let passed = proficient.passed.unwrap();
    assert_eq!((passed.by, passed.session, passed.sessions.len()), (PassedBy::Charts, 17, 17));
    let due: Vec<String> = proficient.reminders.into_iter().map(|reminder| reminder.due_at).collect();
    assert_eq!(due, [16 + 30, 16 + 91].map(|day| crate::time::to_rfc3339(NOW_MS + day * DAY_MS)));
    for day in 17..22 {
        centre.practised(ana, NOW_MS + day * DAY_MS, vec![duration(60.0, 1.0)]).await;
    }
    let relapsed = progress(&cohorts).await;
    assert_eq!((relapsed.charts.unwrap().standing, relapsed.reminders), (StandingName::Relapsed, Vec::new()));
    assert_eq!(relapsed.passed, None);
    for day in 22..39 {
        centre.practised(ana, NOW_MS + day * DAY_MS, vec![duration(40.0, 1.0)]).await;
    }
    let again = progress(&cohorts).await.passed.unwrap();
    assert!(again.sessions.iter().all(|number| *number > 22), "passes before the relapse do not count: {again:?}");
}

#[tokio::test]
async fn the_answer_lists_the_passes_that_met_the_rule() {
    let (centre, cohorts) = with_standard(json!({"in_a_row": 2, "then_more": 1})).await;
    let ana = centre.trainee("Ana").await.id;
    for (day, seconds) in [40.0, 60.0, 40.0, 40.0, 60.0].into_iter().enumerate() {
        centre.practised(ana, NOW_MS + day as i64 * DAY_MS, vec![duration(seconds, 1.0)]).await;
    }
    assert_eq!(progress(&cohorts).await.passed, None);
    for day in 5..8 {
        centre.practised(ana, NOW_MS + day * DAY_MS, vec![duration(40.0, 1.0)]).await;
    }
    let passed = progress(&cohorts).await.passed.unwrap();
    assert_eq!((passed.by, passed.session, passed.sessions), (PassedBy::Rule, 6, vec![3, 4, 6]));
}

#[tokio::test]
async fn a_session_that_is_set_aside_is_no_trial() {
    let (centre, cohorts) = with_standard(json!({"in_a_row": 2})).await;
    let ana = centre.trainee("Ana").await.id;
    centre.practised(ana, NOW_MS, vec![duration(40.0, 1.0)]).await;
    let other = centre.practised(ana, NOW_MS + DAY_MS, vec![duration(90.0, 1.0)]).await;
    centre.practised(ana, NOW_MS + 2 * DAY_MS, vec![duration(40.0, 1.0)]).await;
    assert_eq!(progress(&cohorts).await.rule.unwrap().met_at, None);
    let why: Remark = "Somebody else trained under this name.".parse().unwrap();
    centre
        .store
        .edits()
        .add(&Scope::service(), other.id, (EditChange::SetAside, why), EditBasis::default())
        .await
        .unwrap();
    let now = progress(&cohorts).await;
    assert_eq!(now.rule.unwrap().met_at, Some(3));
    assert_eq!(now.passed.unwrap().sessions, [1, 3]);
    let passed = (Some(TrialName::Passed), None);
    let trials: Vec<_> = now.sessions.iter().map(|step| (step.trial, step.set_aside)).collect();
    assert_eq!(trials, [passed, (None, Some(SetAside::ByHand)), passed]);
}

#[tokio::test]
async fn a_curve_along_the_cameras_axes_is_of_one_camera() {
    let centre = TestCentre::with_camera_and_colours().await;
    let cohorts = Cohorts::new(centre.store.clone(), centre.clock.clone());
    let ana = centre.trainee("Ana").await.id;
    let both = |n: i32| {
        let seconds = 40.0 + 60.0 * f64::from(-n).exp();
        vec![duration(seconds, 1.0), FeatureRow { name: "depth_travelled".to_owned(), ..duration(seconds, 1.0) }]
    };
    for n in 0..6 {
        centre.practised(ana, NOW_MS + i64::from(n) * DAY_MS, both(n)).await;
    }
    centre.calibrate().await;
    for n in 6..9 {
        centre.practised(ana, NOW_MS + i64::from(n) * DAY_MS, both(n)).await;
    }
    let learning = async |feature: &str| {
        let asked = ProgressSelection {
            task: Some(Key::from("peg-transfer")),
            feature: Some(feature.to_owned()),
            ..ProgressSelection::default()
        };
        let course = cohorts.progress(&Scope::service(), &Key::from("ana"), asked).await.unwrap().answer;
        let series = course.features.into_iter().next().unwrap();
        assert_eq!(series.points.len(), 9);
        series.learning
    };
    assert_eq!(learning("duration").await.curve.unwrap().sessions, 9);
    let depth = learning("depth_travelled").await;
    assert_eq!((depth.curve, depth.withheld.unwrap().missing), (None, Some(3)), "three with the newest camera");
}
