//! Orders to score sessions again, as administrators see them.

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::motion::PIPELINE_VERSION;

use super::centre::Centre;
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration};
use crate::support::{Service, problem, read};

const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";
const ORDERS: &str = "/api/v1/tasks/peg/rescorings";

/// Three sessions of Ada and one of Bob, with results of an older program; the limit is 50 s.
async fn centre_with_old_results() -> (Centre, Planter) {
    let service = Service::start_with(|settings| {
        settings.rescoring.look_ms = 10;
        settings.rescoring.open = 2;
    });
    let centre = Centre::open_in(service.await).await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let (ada, bob) = (planter.trainee("ada").await, planter.trainee("bob").await);
    for (day, seconds) in [40.0, 45.0, 60.0].into_iter().enumerate() {
        let rows = vec![duration(seconds, 1.0)];
        planter.result(ada, NEW_YEAR_MS + day as i64 * DAY_MS, rows, ("7", "valid")).await;
    }
    planter.result(bob, NEW_YEAR_MS, vec![duration(30.0, 1.0)], ("7", "valid")).await;
    let limit = json!({"targets": [{"feature": "duration", "by": {"method": "fixed", "limit": 50.0, "unit": "s"}}]});
    centre.administrator.make("/api/v1/tasks/peg/standards", limit).await;
    (centre, planter)
}

/// Waits until the order is as wanted.
async fn until(centre: &Centre, id: &str, wanted: impl Fn(&Value) -> bool) -> Value {
    centre.administrator.read_until(&format!("/api/v1/rescorings/{id}"), wanted).await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_report_lists_changes_by_session_and_trainee_with_changed_judgements_first() {
    let (centre, planter) = centre_with_old_results().await;
    let made = centre.administrator.make(ORDERS, json!({"from": "trajectory", "which": "older"})).await;
    assert_eq!((&made["sessions"]["all"], &made["standard"], &made["progress"]), (&json!(4), &json!(1), &json!(0.0)));
    let id = made["id"].as_str().unwrap();
    problem(centre.administrator.post(ORDERS, json!({})).await, 409, "conflict").await;

    // At most two are in the queue at a time. Meanwhile the sessions keep their status.
    let working = until(&centre, id, |order| order["sessions"]["working"] == 2).await;
    assert_eq!(working["sessions"]["waiting"], 2, "the queue is not flooded");
    let sessions = centre.administrator.read("/api/v1/sessions").await;
    assert!(sessions["items"].as_array().unwrap().iter().all(|session| session["status"] == "done"), "{sessions}");

    // The new results for 40, 45, 60 and 30 s: equal but for rounding, much slower, a bit faster, a bit slower.
    for _ in 0..4 {
        planter
            .rescore(PIPELINE_VERSION, |old| match old as i64 {
                40 => duration(40.0 * (1.0 + 1e-13), 1.0),
                45 => duration(55.0, 1.0),
                60 => duration(59.5, 1.0),
                _ => duration(31.0, 1.0),
            })
            .await;
    }
    let ended = until(&centre, id, |order| order["ended_at"] != Value::Null).await;
    assert_eq!(ended["changes"], json!({"no_longer_passed": 1, "now_passed": 0, "apart": 1, "changed": 3}));
    assert_eq!((&ended["sessions"]["done"], &ended["progress"]), (&json!(4), &json!(1.0)));

    let page = centre.administrator.read(&format!("/api/v1/rescorings/{id}/sessions?limit=1")).await;
    let first = &page["items"][0];
    assert_eq!((&first["old"]["judgement"], &first["new"]["judgement"]), (&json!("pass"), &json!("fail")));
    assert_eq!(
        (&first["old"]["versions"]["pipeline"], &first["new"]["versions"]["pipeline"]),
        (&json!("7"), &json!(PIPELINE_VERSION))
    );
    let feature = &first["features"][0];
    assert_eq!((&feature["feature"], &feature["change"]), (&json!("duration"), &json!("apart")));
    assert_eq!(feature["old"], json!({"value": 45.0, "low": 44.0, "high": 46.0}));
    assert_eq!(feature["new"], json!({"value": 55.0, "low": 54.0, "high": 56.0}));
    for list in ["sessions", "trainees"] {
        let page = centre.administrator.read(&format!("/api/v1/rescorings/{id}/{list}?limit=1")).await;
        let of_another = format!("/api/v1/rescorings/{MISSING}/{list}?cursor={}", page["next"].as_str().unwrap());
        problem(centre.administrator.get(&of_another).await, 422, "invalid").await;
    }
    let (mut changed, mut next) = (vec![first["changed"].clone()], page["next"].clone());
    while let Some(cursor) = next.as_str() {
        let page =
            centre.administrator.read(&format!("/api/v1/rescorings/{id}/sessions?limit=1&cursor={cursor}")).await;
        changed.extend(page["items"].as_array().unwrap().iter().map(|item| item["changed"].clone()));
        next = page["next"].clone();
    }
    assert_eq!(changed, [1, 1, 1, 0].map(|n| json!(n)), "every session once, unchanged ones last");

    let first = centre.administrator.read(&format!("/api/v1/rescorings/{id}/trainees?limit=1")).await;
    assert_eq!((&first["items"][0]["trainee"]["code"], &first["items"][0]["sessions"]), (&json!("ada"), &json!(3)));
    assert_eq!(first["items"][0]["changes"]["no_longer_passed"], 1);
    let cursor = first["next"].as_str().unwrap();
    let second = centre.administrator.read(&format!("/api/v1/rescorings/{id}/trainees?cursor={cursor}")).await;
    assert_eq!((&second["items"][0]["trainee"]["code"], &second["next"]), (&json!("bob"), &Value::Null));

    // Progress counts rescored sessions as the new version, and sets none aside.
    let progress = centre.trainee.read("/api/v1/trainees/ada/progress?task=peg&feature=duration").await;
    assert_eq!(progress["pipeline"], PIPELINE_VERSION);
    let steps = progress["sessions"].as_array().unwrap();
    assert!(steps.len() == 3 && steps.iter().all(|step| step["set_aside"] == Value::Null), "{progress}");
    let list = centre.administrator.read("/api/v1/rescorings").await;
    assert_eq!(list["items"][0]["id"], id);
}

#[tokio::test(flavor = "multi_thread")]
async fn one_new_result_sets_the_old_ones_aside_until_they_are_scored_again() {
    let (centre, planter) = centre_with_old_results().await;
    let ada = planter.trainee("ada").await;
    planter.result(ada, NEW_YEAR_MS + 9 * DAY_MS, vec![duration(40.0, 1.0)], (PIPELINE_VERSION, "valid")).await;
    let aside = async || {
        let progress = centre.trainee.read("/api/v1/trainees/ada/progress?task=peg&feature=duration").await;
        progress["sessions"].as_array().unwrap().iter().filter(|step| step["set_aside"] == "other_version").count()
    };
    assert_eq!(aside().await, 3);
    let id = centre.administrator.make(ORDERS, json!({})).await["id"].as_str().unwrap().to_owned();
    for _ in 0..4 {
        planter.rescore(PIPELINE_VERSION, |old| duration(old, 1.0)).await;
    }
    let ended = until(&centre, &id, |order| order["ended_at"] != Value::Null).await;
    assert_eq!(ended["sessions"]["all"], 4, "the new one is not older: {ended}");
    assert_eq!(aside().await, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_edited_meanwhile_is_no_difference_between_the_programs() {
    let (centre, planter) = centre_with_old_results().await;
    let id = centre.administrator.make(ORDERS, json!({})).await["id"].as_str().unwrap().to_owned();
    until(&centre, &id, |order| order["sessions"]["working"] == 2).await;
    let items = async || {
        let report = centre.administrator.read(&format!("/api/v1/rescorings/{id}/sessions")).await;
        report["items"].as_array().unwrap().clone()
    };
    let waiting = items().await.into_iter().find(|item| item["state"] == "waiting").unwrap();
    let edited = waiting["session"].as_str().unwrap().to_owned();
    planter.trim(edited.parse().unwrap()).await;
    let work = async {
        loop {
            planter.rescore(PIPELINE_VERSION, |old| duration(old / 2.0, 1.0)).await; // until the order has ended
        }
    };
    let ended = tokio::select! {
        ended = until(&centre, &id, |order| order["ended_at"] != Value::Null) => ended,
        () = work => unreachable!(),
    };
    assert_eq!((&ended["sessions"]["done"], &ended["sessions"]["failed"]), (&json!(3), &json!(1)), "{ended}");
    assert_eq!(ended["changes"]["changed"], 3, "{ended}");
    let reported: Vec<_> = items().await.into_iter().filter(|item| item["session"] == *edited).collect();
    assert!(reported[0]["error"]["type"].as_str().unwrap().ends_with("edited-meanwhile"), "{}", reported[0]);
    assert_eq!(reported[0]["features"], json!([]), "{}", reported[0]);
}

#[tokio::test(flavor = "multi_thread")]
async fn new_sessions_come_before_rescorings_in_the_queue() {
    let (centre, planter) = centre_with_old_results().await;
    let id = centre.administrator.make(ORDERS, json!({})).await["id"].as_str().unwrap().to_owned();
    until(&centre, &id, |order| order["sessions"]["working"] == 2).await;
    let sent = super::centre::session(&centre.trainee, "ada", super::centre::recording(100, 7)).await;
    let shown = centre.trainee.read(&format!("/api/v1/sessions/{}", sent["id"].as_str().unwrap())).await;
    assert_eq!(shown["queue_position"], 1, "no job is before it");
    assert_eq!(planter.next_kind().await, "track");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cancelled_order_leaves_the_remaining_sessions_unchanged() {
    let (centre, planter) = centre_with_old_results().await;
    let id = centre.administrator.make(ORDERS, json!({})).await["id"].as_str().unwrap().to_owned();
    until(&centre, &id, |order| order["sessions"]["working"] == 2).await;
    planter.rescore(PIPELINE_VERSION, |old| duration(old, 1.0)).await;
    until(&centre, &id, |order| order["sessions"]["done"] == 1).await;
    let cancel = format!("/api/v1/rescorings/{id}/cancel");
    assert_eq!(centre.administrator.post(&cancel, Value::Null).await.status(), StatusCode::NO_CONTENT);
    let ended = until(&centre, &id, |order| order["ended_at"] != Value::Null).await;
    assert_eq!((&ended["sessions"]["done"], &ended["sessions"]["cancelled"]), (&json!(1), &json!(3)), "{ended}");
    let open = centre.administrator.read("/api/v1/jobs?open=true").await;
    assert_eq!(open["items"], json!([]), "nothing is left in the queue");
    assert_eq!(
        centre.administrator.post(&cancel, Value::Null).await.status(),
        StatusCode::NO_CONTENT,
        "the order has ended already"
    );
    let made = centre.administrator.make(ORDERS, json!({})).await;
    assert_eq!(made["sessions"]["all"], 3, "finished sessions are not scored again");
}

#[tokio::test(flavor = "multi_thread")]
async fn only_administrators_order_and_read_and_cancel() {
    let (centre, _) = centre_with_old_results().await;
    let id = centre.administrator.make(ORDERS, json!({})).await["id"].as_str().unwrap().to_owned();
    for client in [&centre.instructor, &centre.trainee, &centre.agent] {
        problem(client.post(ORDERS, json!({})).await, 403, "forbidden").await;
        for part in ["", "/sessions", "/trainees"] {
            problem(client.get(&format!("/api/v1/rescorings/{id}{part}")).await, 403, "forbidden").await;
        }
        problem(client.post(&format!("/api/v1/rescorings/{id}/cancel"), Value::Null).await, 403, "forbidden").await;
    }
    let missing = "/api/v1/rescorings/0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";
    for part in ["", "/sessions", "/trainees"] {
        problem(centre.administrator.get(&format!("{missing}{part}")).await, 404, "not-found").await;
    }
    problem(centre.administrator.post(&format!("{missing}/cancel"), Value::Null).await, 404, "not-found").await;
    problem(centre.administrator.post(ORDERS, json!({"from": "memory"})).await, 422, "invalid").await;
    // A session that is erased meanwhile leaves the order.
    let session = centre.administrator.read("/api/v1/sessions").await["items"][0]["id"].as_str().unwrap().to_owned();
    centre.administrator.delete(&format!("/api/v1/sessions/{session}")).await;
    assert_eq!(
        read(centre.administrator.get(&format!("/api/v1/rescorings/{id}")).await, StatusCode::OK).await["sessions"]["all"],
        3
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_that_cannot_be_scored_again_says_why_and_keeps_its_old_result() {
    let (centre, planter) = centre_with_old_results().await;
    let id = centre.administrator.make(ORDERS, json!({})).await["id"].as_str().unwrap().to_owned();
    for _ in 0..4 {
        planter.refuse_rescoring().await;
    }
    let ended = until(&centre, &id, |order| order["ended_at"] != Value::Null).await;
    assert_eq!(ended["sessions"]["failed"], 4);
    let page = centre.administrator.read(&format!("/api/v1/rescorings/{id}/sessions")).await;
    assert_eq!(page["items"][0]["error"]["type"], "/problems/path-alone");
    let sessions = centre.administrator.read("/api/v1/sessions").await;
    let keeps_its_result = |session: &Value| session["status"] == "done" && session["versions"]["pipeline"] == "7";
    assert!(sessions["items"].as_array().unwrap().iter().all(keeps_its_result), "{sessions}");
}
