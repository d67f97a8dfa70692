//! Scoring again gives the same bytes, and an order survives kills of the service.

use std::time::Duration;

use reqwest::Method;
use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnection;
use sqlx::{AssertSqlSafe, Connection};
use trocar::motion::PIPELINE_VERSION;

use super::centre::json_of;
use super::{Centre, Dice, padded_bytes};
use crate::support::let_time_pass;

const SESSIONS: usize = 4;

/// A centre with scored sessions. Their results are then changed to state that an older program made them.
async fn centre_with_old_results() -> (Centre, Vec<Value>) {
    let mut centre = Centre::open().await;
    let clip = std::fs::read(centre.scene("clip.mp4")).unwrap();
    let mut sessions = Vec::new();
    for number in 0..SESSIONS {
        let session = centre.send_whole(padded_bytes(&clip, clip.len() + 16 + number)).await;
        centre.ends_with_one_result(&session).await;
        sessions.push(json_of(centre.get(&format!("/sessions/{session}")).await).await);
    }
    centre.kill();
    for sql in ["UPDATE result SET pipeline = '7'", "UPDATE job SET versions = 'pipeline 7' WHERE kind = 'track'"] {
        change(&centre, sql).await;
    }
    centre.restart().await;
    (centre, sessions)
}

/// Changes the database of a stopped service.
async fn change(centre: &Centre, sql: &'static str) {
    let path = centre.data().join("trocar.db");
    let mut raw = SqliteConnection::connect(path.to_str().unwrap()).await.unwrap();
    sqlx::query(AssertSqlSafe(sql)).execute(&mut raw).await.unwrap();
    raw.close().await.unwrap();
}

async fn order(centre: &Centre, order: Value) -> String {
    let answer = centre.request(Method::POST, "/tasks/pegs/rescorings").json(&order).send().await.unwrap();
    json_of(answer).await["id"].as_str().unwrap().to_owned()
}

/// Kills the service `kills` times during an order, then waits for the order's end. Such kills use up no attempt of a
/// job.
async fn ends_through_kills(centre: &mut Centre, id: &str, kills: usize) -> Value {
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    for _ in 0..kills {
        let_time_pass(Duration::from_millis(dice.below(1_500) as u64)).await; // a random moment for the kill
        centre.kill();
        centre.restart().await;
    }
    centre.until(&format!("/rescorings/{id}"), |order| order["ended_at"] != Value::Null).await
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn scoring_stored_paths_again_gives_the_same_bytes_and_survives_kills() {
    let (mut centre, before) = centre_with_old_results().await;
    let id = order(&centre, json!({})).await;
    let ended = ends_through_kills(&mut centre, &id, 2).await;
    assert_eq!((&ended["sessions"]["done"], &ended["progress"]), (&json!(SESSIONS), &json!(1.0)), "{ended}");
    assert_eq!((&ended["changes"]["changed"], &ended["changes"]["apart"]), (&json!(0), &json!(0)), "{ended}");
    for old in &before {
        let path = format!("/sessions/{}", old["id"].as_str().unwrap());
        let new = json_of(centre.get(&path).await).await;
        // Numbers are written in the shortest form that reads back to the same bits.
        assert_eq!(new["features"].to_string(), old["features"].to_string());
        assert_eq!(new["quality"].to_string(), old["quality"].to_string());
        assert_eq!(
            (&new["versions"]["pipeline"], &new["versions"]["tracked_with"]),
            (&json!(PIPELINE_VERSION), &json!("7"))
        );
        let results = json_of(centre.get(&format!("{path}/results")).await).await;
        let in_use: Vec<(&Value, &Value)> =
            results["items"].as_array().unwrap().iter().map(|r| (&r["versions"]["pipeline"], &r["in_use"])).collect();
        assert_eq!(
            in_use,
            [(&json!(PIPELINE_VERSION), &json!(true)), (&json!("7"), &json!(false))],
            "the old result stays"
        );
        assert_eq!(new["status"], "done");
    }
    let again = centre.request(Method::POST, "/tasks/pegs/rescorings").json(&json!({})).send().await.unwrap();
    assert_eq!(again.status(), 409, "no result is older now");
    centre.kill();
    assert_eq!(centre.check(), "");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn recordings_are_tracked_again_behind_new_sessions_and_give_the_same_bytes() {
    let (mut centre, before) = centre_with_old_results().await;
    let id = order(&centre, json!({"from": "recording"})).await;
    let ended = ends_through_kills(&mut centre, &id, 1).await;
    assert_eq!((&ended["sessions"]["done"], &ended["changes"]["changed"]), (&json!(SESSIONS), &json!(0)), "{ended}");
    for old in &before {
        let new = json_of(centre.get(&format!("/sessions/{}", old["id"].as_str().unwrap())).await).await;
        assert_eq!(new["features"].to_string(), old["features"].to_string());
        assert_eq!(
            (&new["versions"]["pipeline"], &new["versions"]["tracked_with"]),
            (&json!(PIPELINE_VERSION), &Value::Null)
        );
    }
    centre.kill();
    assert_eq!(centre.check(), "");
}
