//! Staff dismiss what needs attention from their own lists: for good or for some days, until something new happens.

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::centre::Centre;
use crate::planted::{DAY_MS, Planter, duration};
use crate::support::{Client, problem, read};
use trocar::motion::PIPELINE_VERSION;
use trocar::time::{Clock as _, SystemClock};

const ATTENTION: &str = "/api/v1/attention";
const DISMISSALS: &str = "/api/v1/attention/dismissals";
const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";

/// The sessions of a list of what needs attention.
fn sessions(of: &Value, kind: &str) -> Vec<String> {
    let id = |item: &Value| item["session"].as_str().unwrap().to_owned();
    of[kind].as_array().unwrap().iter().map(id).collect()
}

/// A dismissal of the first listed entry of this kind, with all its sessions.
fn dismissal(of: &Value, kind: &str) -> Value {
    let first = &of[kind][0];
    json!({"kind": kind, "trainee": first["trainee"]["id"], "task": first["task"]["id"], "sessions": sessions(of, kind)})
}

/// A centre whose trainee Ada has two refused sessions of today.
async fn with_refused() -> (Centre, Planter) {
    let centre = Centre::open().await;
    let mut planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    refuse(&mut planter, 1).await;
    refuse(&mut planter, 2).await;
    (centre, planter)
}

async fn refuse(planter: &mut Planter, hours_ago: i64) {
    let ada = planter.trainee("ada").await;
    let at_ms = SystemClock.now_ms() - hours_ago * DAY_MS / 24;
    planter.result(ada, at_ms, vec![duration(40.0, 1.0)], (PIPELINE_VERSION, "refused")).await;
}

async fn listed(by: &Client) -> Vec<Value> {
    by.read(DISMISSALS).await["items"].as_array().unwrap().clone()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_dismissed_entry_leaves_the_own_list_alone_until_a_new_session_comes_or_it_is_undone() {
    let (centre, mut planter) = with_refused().await;
    let before = centre.instructor.read(ATTENTION).await;
    assert_eq!((sessions(&before, "refused").len(), &before["dismissed"]), (2, &json!(0)), "{before}");
    let made = centre.instructor.make(DISMISSALS, dismissal(&before, "refused")).await;
    assert_eq!((&made["kind"], &made["sessions"], &made["until"]), (&json!("refused"), &json!(2), &Value::Null));
    let after = centre.instructor.read(ATTENTION).await;
    assert_eq!((sessions(&after, "refused").len(), &after["dismissed"]), (0, &json!(1)));
    assert_eq!(sessions(&centre.administrator.read(ATTENTION).await, "refused").len(), 2, "a list of their own");

    refuse(&mut planter, 0).await;
    let again = sessions(&centre.instructor.read(ATTENTION).await, "refused");
    assert_eq!(again.len(), 1, "the new one alone");
    assert!(!sessions(&before, "refused").contains(&again[0]));

    assert_eq!(listed(&centre.instructor).await[0]["trainee"]["code"], "ada");
    assert!(listed(&centre.administrator).await.is_empty());
    let one = format!("{DISMISSALS}/{}", made["id"].as_str().unwrap());
    problem(centre.administrator.delete(&one).await, 404, "not-found").await;
    assert_eq!(centre.instructor.delete(&one).await.status(), StatusCode::NO_CONTENT);
    assert_eq!(sessions(&centre.instructor.read(ATTENTION).await, "refused").len(), 3);
    let audit = centre.administrator.read("/api/v1/audit-entries").await;
    assert!(!audit.to_string().contains("dismissal"), "it changes nothing for others: {audit}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_moved_session_is_listed_again_under_its_new_trainee() {
    let (centre, _) = with_refused().await;
    let before = centre.administrator.read(ATTENTION).await;
    centre.administrator.make(DISMISSALS, dismissal(&before, "refused")).await;
    let session = &sessions(&before, "refused")[0];
    let moved = json!({"trainee": "bob", "why": "Ada was still signed in."});
    centre.administrator.make(&format!("/api/v1/sessions/{session}/moves"), moved).await;
    let after = centre.administrator.read(ATTENTION).await;
    assert_eq!(
        (sessions(&after, "refused"), &after["refused"][0]["trainee"]["code"]),
        (vec![session.clone()], &json!("bob"))
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn an_alarm_is_dismissed_by_its_start_and_a_later_alarm_is_listed() {
    let centre = Centre::open().await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let standard = json!({"targets": [{"feature": "duration", "by": {"method": "fixed", "limit": 50, "unit": "s"}}],
                          "rule": {"in_a_row": 2}, "valid_from": "beginning"});
    centre.instructor.make("/api/v1/tasks/peg/standards", standard).await;
    let (ada, start) = (planter.trainee("ada").await, SystemClock.now_ms() - 60 * DAY_MS);
    for day in 0..2 {
        planter.session(ada, start + day * DAY_MS, vec![duration(40.0, 1.0)]).await; // passed; the first month is over
    }
    let alarm = centre.instructor.read(ATTENTION).await["alarms"][0].clone();
    assert_eq!(alarm["kind"], "due", "{alarm}");
    let of = |since: &str| json!({"kind": "due", "trainee": alarm["trainee"], "task": alarm["task"], "since": since});
    centre.instructor.make(DISMISSALS, of("2020-01-01T00:00:00Z")).await;
    assert_eq!(centre.instructor.read(ATTENTION).await["alarms"][0], alarm, "another alarm was dismissed");
    centre.instructor.make(DISMISSALS, of(alarm["since"].as_str().unwrap())).await;
    assert_eq!(centre.instructor.read(ATTENTION).await["alarms"], json!([]));
    assert_eq!(listed(&centre.instructor).await.len(), 1, "the earlier dismissal of this alarm is replaced");
    assert_eq!(centre.trainee.read(ATTENTION).await["alarms"][0], alarm);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_dismissal_names_what_the_caller_sees_and_a_question_for_the_box_is_only_put_off() {
    let (centre, _) = with_refused().await;
    let right = dismissal(&centre.instructor.read(ATTENTION).await, "refused");
    let with = |key: &str, value: Value| {
        let mut body = right.clone();
        body[key] = value;
        body
    };
    for (wrong, slug, field) in [
        (with("sessions", json!([])), "invalid", "sessions"),
        (with("sessions", json!(vec![MISSING; 21])), "invalid", "sessions"),
        (with("sessions", json!([MISSING])), "unknown-reference", "sessions"),
        (with("trainee", json!(MISSING)), "unknown-reference", "trainee"),
        (with("since", json!("2026-05-01T08:00:00Z")), "invalid", "since"),
        (with("days", json!(0)), "invalid", "days"),
        (with("kind", json!("box_asked")), "invalid", "days"),
        (with("kind", json!("due")), "invalid", "sessions"),
    ] {
        let refused = problem(centre.instructor.post(DISMISSALS, wrong).await, 422, slug).await;
        assert_eq!(refused["errors"][0]["field"], field, "{refused}");
    }
    let other = centre.other_instructor.post(DISMISSALS, right.clone()).await;
    assert_eq!(problem(other, 422, "unknown-reference").await["errors"][0]["field"], "trainee");
    problem(centre.trainee.post(DISMISSALS, right.clone()).await, 403, "forbidden").await;
    let snoozed = read(centre.instructor.post(DISMISSALS, with("days", json!(7))).await, StatusCode::CREATED).await;
    assert!(snoozed["until"].is_string());
    assert!(sessions(&centre.instructor.read(ATTENTION).await, "refused").is_empty());
}
