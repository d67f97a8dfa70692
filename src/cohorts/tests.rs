//! Progress, on the database of a small centre.

use serde_json::json;

use super::answer::{FeatureSeries, PassedBy, ProgressAnswer, RuleStanding, SetAside, StandingName, TrialName};
use super::{Cohorts, ProgressSelection};
use crate::domain::edit::EditChange;
use crate::domain::hand::Hand;
use crate::domain::scope::Scope;
use crate::domain::session::FeatureRow;
use crate::domain::standard::StandardStart;
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
    centre.store.standards().add(&Scope::service(), centre.task.id, definition, None).await.unwrap();
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

/// Sets a version of the task's standard: at most `limit` s, twice in a row.
async fn set_limit(centre: &TestCentre, cohorts: &Cohorts, limit: f64, start: Option<StandardStart>) {
    let target = json!({"feature": "duration", "by": {"method": "fixed", "limit": limit, "unit": "s"}});
    let new = serde_json::from_value(json!({"targets": [target], "rule": {"in_a_row": 2}})).unwrap();
    let proposal = cohorts.propose(&Scope::service(), centre.task.id, new).await.unwrap();
    let definition = proposal.definition().unwrap();
    centre.store.standards().add(&Scope::service(), centre.task.id, definition, start).await.unwrap();
}

/// The outcome and the judging version of each session.
fn outcomes(answer: &ProgressAnswer) -> Vec<(Option<TrialName>, Option<i64>)> {
    answer.sessions.iter().map(|step| (step.trial, step.standard)).collect()
}

#[tokio::test]
async fn a_new_version_judges_only_what_arrives_later_and_takes_nothing_back() {
    let (centre, cohorts) = with_standard(json!({"in_a_row": 2})).await;
    let ana = centre.trainee("Ana").await.id;
    for day in 0..2 {
        centre.practised(ana, NOW_MS + day * DAY_MS, vec![duration(40.0, 1.0)]).await;
    }
    let earned = progress(&cohorts).await.passed.unwrap();
    assert_eq!((earned.standard, earned.session), (1, 2));
    centre.clock.advance(std::time::Duration::from_secs(60));
    for limit in [10.0, 5.0] {
        set_limit(&centre, &cohorts, limit, None).await;
        centre.clock.advance(std::time::Duration::from_secs(60));
    }
    let after = progress(&cohorts).await;
    assert_eq!(after.passed.as_ref(), Some(&earned), "what was earned stays");
    let passed = (Some(TrialName::Passed), Some(1));
    assert_eq!(outcomes(&after), [passed, passed]);
    assert_eq!(after.rule.unwrap().have_in_a_row, Some(0), "the new version begins with its own sessions");
    // 7 s would have met version 2, but version 3 judges it.
    centre.practised(ana, NOW_MS + 2 * DAY_MS, vec![duration(7.0, 0.1)]).await;
    let third = progress(&cohorts).await;
    assert_eq!(outcomes(&third)[2], (Some(TrialName::Failed), Some(3)));
    for day in 3..5 {
        centre.practised(ana, NOW_MS + day * DAY_MS, vec![duration(4.0, 0.1)]).await;
    }
    let again = progress(&cohorts).await.passed.unwrap();
    assert_eq!((again.standard, again.session, again.sessions), (3, 5, vec![4, 5]));
}

#[tokio::test]
async fn an_easier_version_does_not_pass_earlier_sessions_unless_it_says_so() {
    let (centre, cohorts) = with_standard(json!({"in_a_row": 2})).await;
    let ana = centre.trainee("Ana").await.id;
    for day in 0..2 {
        centre.practised(ana, NOW_MS + day * DAY_MS, vec![duration(60.0, 1.0)]).await;
    }
    centre.clock.advance(std::time::Duration::from_secs(60));
    set_limit(&centre, &cohorts, 100.0, None).await;
    assert_eq!(progress(&cohorts).await.passed, None);
    set_limit(&centre, &cohorts, 100.0, Some(StandardStart::Beginning)).await;
    let passed = progress(&cohorts).await.passed.unwrap();
    assert_eq!((passed.standard, passed.session), (3, 2), "a version for all sessions, set on purpose");
}

#[tokio::test]
async fn the_effect_names_the_trainees_whose_state_would_change_and_changes_nothing() {
    let (centre, cohorts) = with_standard(json!({"in_a_row": 2})).await;
    let (ana, ben) = (centre.trainee("Ana").await.id, centre.trainee("Ben").await.id);
    for day in 0..2 {
        centre.practised(ana, NOW_MS + day * DAY_MS, vec![duration(60.0, 1.0)]).await;
        centre.practised(ben, NOW_MS + day * DAY_MS, vec![duration(40.0, 1.0)]).await;
    }
    centre.clock.advance(std::time::Duration::from_secs(60));
    let target = json!({"feature": "duration", "by": {"method": "fixed", "limit": 100.0, "unit": "s"}});
    let new = json!({"targets": [target], "rule": {"in_a_row": 2}});
    let new = serde_json::from_value(new).unwrap();
    let definition = cohorts.propose(&Scope::service(), centre.task.id, new).await.unwrap().definition().unwrap();
    let service = Scope::service();
    let effect = |start| cohorts.effect(&service, centre.task.id, definition.clone(), start);
    let from_now = effect(None).await.unwrap();
    let names = |effect: &super::StandardEffect| -> Vec<String> {
        effect.trainees.iter().map(|touched| touched.name.clone()).collect()
    };
    assert_eq!(names(&from_now), ["Ben"], "a met rule begins anew, an open one without passes does not change");
    let ben = &from_now.trainees[0];
    assert_eq!((ben.before.passed, ben.after.passed, ben.judged_anew), (Some(1), Some(1), 0), "and stays passed");
    let of_all = effect(Some(StandardStart::Beginning)).await.unwrap();
    assert_eq!(names(&of_all), ["Ana", "Ben"]);
    let ana = &of_all.trainees[0];
    assert_eq!((ana.before.passed, ana.after.passed, ana.judged_anew), (None, Some(2), 2));
    assert_eq!(of_all.valid_from, None);
    assert_eq!(centre.store.standards().of_tasks(&Scope::service(), &[centre.task.id]).await.unwrap().len(), 1);
}

/// A place of a trocar that is not known.
const UNKNOWN: [f64; 3] = [f64::NAN; 3];

/// The feature of a tool, and the quality document of two tools whose trocars are at these places.
fn two_tools(values: [(&str, f64); 2], places: [[f64; 3]; 2]) -> (Vec<FeatureRow>, serde_json::Value) {
    let row = |(tool, value): (&str, f64)| FeatureRow {
        tool: Some(tool.to_owned()),
        name: "path_length".to_owned(),
        unit: "mm".to_owned(),
        ..duration(value, 1.0)
    };
    let tool = |((tool, _), at_mm): (&(&str, f64), [f64; 3])| json!({"tool": tool, "fulcrum": {"at_mm": at_mm, "covariance_mm2": [4, 0, 0, 4, 0, 9]}});
    let tools: Vec<_> = values.iter().zip(places).map(tool).collect();
    (values.map(row).into(), json!({"frames": 300, "tools": tools}))
}

#[tokio::test]
async fn a_limit_for_a_hand_holds_in_every_box_and_is_not_judged_where_the_hand_is_unknown() {
    let centre = TestCentre::with_camera_and_colours().await;
    let cohorts = Cohorts::new(centre.store.clone(), centre.clock.clone());
    let by = json!({"method": "fixed", "limit": 100, "unit": "mm"});
    let target = json!({"feature": "path_length", "in_hand": "left", "by": by});
    let new = serde_json::from_value(json!({"targets": [target]})).unwrap();
    let definition = cohorts.propose(&Scope::service(), centre.task.id, new).await.unwrap().definition().unwrap();
    centre.store.standards().add(&Scope::service(), centre.task.id, definition, None).await.unwrap();
    let ana = centre.trainee("Ana").await.id;
    let (left, right) = ([-60.0, 5.0, 300.0], [60.0, -5.0, 300.0]);
    // The tool in the left hand is short in two boxes with other names, and long when the tools are exchanged.
    for (day, values, places) in [
        (0, [("orange", 50.0), ("cyan", 150.0)], [left, right]),
        (1, [("scissors", 150.0), ("grasper", 50.0)], [right, left]),
        (2, [("orange", 150.0), ("cyan", 50.0)], [left, right]),
        (3, [("orange", 50.0), ("cyan", 50.0)], [[0.0, -60.0, 300.0], [1.0, 60.0, 300.0]]), // one above the other
        (4, [("orange", 50.0), ("cyan", 50.0)], [[0.0, 0.0, 300.0], [5.0, 0.0, 300.0]]),    // within their errors
        (5, [("orange", 150.0), ("cyan", 50.0)], [left, UNKNOWN]),                          // as in the sessions before
        (6, [("orange", 50.0), ("cyan", 150.0)], [[3.0, 0.0, 300.0], UNKNOWN]),             // near the middle
    ] {
        let (features, quality) = two_tools(values, places);
        centre.practised_as(ana, NOW_MS + day * DAY_MS, features, quality).await;
    }
    let answer = progress(&cohorts).await;
    let trials: Vec<_> = answer.sessions.iter().map(|step| step.trial).collect();
    use TrialName::{Failed, Passed, Unknown};
    assert_eq!(trials, [Passed, Passed, Failed, Unknown, Unknown, Failed, Unknown].map(Some));
    let points: Vec<_> = answer.features[0].points.iter().map(|point| point.value).collect();
    assert_eq!(points, [50.0, 50.0, 150.0, 150.0].map(Some), "only sessions whose hand is known");
    assert_eq!(answer.features[0].of.in_hand, Some(Hand::Left));

    // Without a hand or tool in the request, each session is in one series of a tool.
    let series = async |tool: Option<&str>| {
        let (task, feature) = (Some(Key::from("peg-transfer")), Some("path_length".to_owned()));
        let asked = ProgressSelection { task, feature, tool: tool.map(str::to_owned), ..ProgressSelection::default() };
        cohorts.progress(&Scope::service(), &Key::from("ana"), asked).await.unwrap().answer.features
    };
    let all = series(None).await;
    let values = |is_meant: &dyn Fn(&FeatureSeries) -> bool| -> Vec<f64> {
        let found = all.iter().find(|of| is_meant(of)).unwrap();
        found.points.iter().filter_map(|point| point.value).collect()
    };
    assert_eq!(values(&|of| of.of.in_hand == Some(Hand::Left)), [50.0, 50.0, 150.0, 150.0]);
    assert_eq!(values(&|of| of.of.tool.as_deref() == Some("orange")), [50.0; 3], "only sessions whose hand is unknown");
    let orange = series(Some("orange")).await;
    assert_eq!(orange[0].points.len(), 6, "a tool that is asked for has all its sessions");
}

#[tokio::test]
async fn after_a_new_version_a_relapse_needs_proficiency_under_it() {
    let (centre, cohorts) = with_standard(serde_json::Value::Null).await;
    let ana = centre.trainee("Ana").await.id;
    for day in 0..17 {
        centre.practised(ana, NOW_MS + day * DAY_MS, vec![duration(40.0, 1.0)]).await;
    }
    centre.clock.advance(std::time::Duration::from_secs(60));
    set_limit(&centre, &cohorts, 50.0, None).await;
    centre.clock.advance(std::time::Duration::from_secs(60));
    for day in 17..25 {
        centre.practised(ana, NOW_MS + day * DAY_MS, vec![duration(60.0, 1.0)]).await;
    }
    let after = progress(&cohorts).await;
    let charts = after.charts.unwrap();
    assert_eq!((charts.standing, charts.judged), (StandingName::NotYet, 8), "its charts begin with its own sessions");
    assert_eq!(after.passed.map(|passed| passed.standard), Some(1), "what was earned stays");
}
