//! Cuts of recordings with two attempts: both parts are scored from their own stretch, each goes its own way, and they are
//! joined again.

use reqwest::{Method, StatusCode, header};
use serde_json::{Value, json};

use super::centre::Centre;
use crate::process::program;
use crate::support::{Client, Service, problem, read};

const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";

/// Two tools that move to and fro for 20 s at 25 frames a second, first slowly and then quickly. `scale` makes another
/// table.
fn table(scale: f64) -> String {
    let mut table = "frame,time_s,tool,x_mm,y_mm,z_mm,sigma_xy_mm,sigma_z_mm\n".to_owned();
    for frame in 0..500 {
        let time = f64::from(frame) * 0.04;
        let pace = if time < 12.0 { 1.0 } else { 2.5 };
        for (tool, reach) in [("left", 20.0), ("right", 40.0)] {
            let x = scale * reach * (time * pace).sin();
            table += &format!("{frame},{time},{tool},{x},{},150,0.1,0.4\n", 20.0 * (time * 0.7).cos());
        }
    }
    table
}

async fn import(client: &Client, trainee: &str, scale: f64) -> reqwest::Response {
    let path = format!("/api/v1/sessions/import?task=peg&box=box-1&trainee={trainee}&recorded_at=2026-01-05T10:00:00Z");
    let request = client.request(Method::POST, &path).header(header::CONTENT_TYPE, "text/csv");
    request.body(table(scale)).send().await.unwrap()
}

/// A centre with one worker, and a scored session of Ada.
async fn open() -> (Centre, String) {
    let start = Service::start_with(|settings| {
        settings.workers = 1;
        settings.rescoring.look_ms = 10;
    });
    let centre = Centre::open_in(start.await).await;
    centre.administrator.make("/api/v1/tasks", json!({"name": "Knots", "code": "knots"})).await;
    let made = read(import(&centre.administrator, "ada", 1.0).await, StatusCode::CREATED).await;
    let at = address(&made["id"]);
    centre.administrator.read_until(&at, |session| session["status"] == "done").await;
    (centre, at)
}

fn address(id: &Value) -> String {
    format!("/api/v1/sessions/{}", id.as_str().unwrap())
}

async fn cut(client: &Client, at: &str, at_s: f64) -> Value {
    client.make(&format!("{at}/cuts"), json!({"at_s": at_s, "why": "Two attempts."})).await
}

/// Waits until both parts are scored with their trims.
async fn wait(client: &Client, parts: [&str; 2]) {
    for part in parts {
        client.read_until(part, |session| session["status"] == "done").await;
        client.read_until(&format!("{part}/edits"), |edits| edits["score"] == "current").await;
    }
}

async fn duration(client: &Client, at: &str) -> f64 {
    let session = client.read(at).await;
    let features = session["features"].as_array().unwrap();
    features.iter().find(|row| row["name"] == "duration").unwrap()["value"].as_f64().unwrap()
}

async fn sessions(client: &Client, trainee: &str, task: &str) -> Vec<String> {
    let path = format!("/api/v1/trainees/{trainee}/progress?task={task}&feature=duration");
    let progress = client.read(&path).await;
    progress["sessions"].as_array().unwrap().iter().map(|step| address(&step["id"])).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_is_cut_into_two_scored_sessions_and_joined_again() {
    let (centre, at) = open().await;
    let by = &centre.instructor;
    let before = by.read(&at).await;
    let whole = duration(by, &at).await;

    let made = cut(by, &at, 12.0).await;
    let second = address(&made["second"]);
    assert_eq!((address(&made["first"]), &made["who"]), (at.clone(), &json!("ines")));
    wait(by, [&at, &second]).await;
    let [one, other] = [duration(by, &at).await, duration(by, &second).await];
    assert!((8.0..12.1).contains(&one) && (4.0..8.1).contains(&other), "{one} and {other} of {whole}");
    let part = by.read(&second).await;
    assert_eq!((&part["trainee"]["code"], &part["recorded_at"]), (&json!("ada"), &json!("2026-01-05T10:00:12Z")));
    assert_eq!(part["created_at"], before["created_at"], "it arrived with the recording");
    assert_eq!(sessions(by, "ada", "peg").await, [at.clone(), second.clone()], "in the order of the recording");
    for part in [&at, &second] {
        let cuts = centre.trainee.read(&format!("{part}/cuts")).await;
        assert_eq!((&cuts["items"][0]["second"], &cuts["items"][0]["why"]), (&made["second"], &Value::Null));
    }
    let edits = by.read(&format!("{second}/edits")).await;
    assert_eq!(edits["items"][0]["of_cut"], true, "{edits}");
    let undo = format!("{second}/edits/{}/undo", edits["items"][0]["id"].as_str().unwrap());
    problem(by.post(&undo, Value::Null).await, 409, "conflict").await;
    let again = problem(import(&centre.administrator, "ada", 1.0).await, 409, "duplicate-recording").await;
    assert_eq!(again["session"], at, "the recording is there already");
    let audit = centre.administrator.read("/api/v1/audit-entries?limit=20").await;
    let entry = audit["items"].as_array().unwrap().iter().find(|entry| entry["action"] == "cut").unwrap();
    assert_eq!((&entry["noun"], &entry["why"]), (&json!("session"), &json!("Two attempts.")));

    let undo = format!("{at}/cuts/{}/undo", made["id"].as_str().unwrap());
    let joined = read(by.post(&undo, Value::Null).await, StatusCode::OK).await;
    assert!(joined["joined_at"].is_string() && joined["second"].is_null(), "{joined}");
    by.read_until(&format!("{at}/edits"), |edits| edits["score"] == "current").await;
    problem(by.get(&second).await, 404, "not-found").await;
    let after = by.read(&at).await;
    assert_eq!((&after["features"], &after["quality"]), (&before["features"], &before["quality"]));
    assert_eq!(read(by.post(&undo, Value::Null).await, StatusCode::OK).await, joined, "joining again changes nothing");
    assert_eq!(sessions(by, "ada", "peg").await, [at]);
    let check = program().args(["admin", "check", "--data"]).arg(centre.service.data.path()).output().unwrap();
    assert!(check.status.success(), "{}", String::from_utf8_lossy(&check.stdout));
}

#[tokio::test(flavor = "multi_thread")]
async fn each_part_goes_its_own_way_and_is_not_joined_then() {
    let (centre, at) = open().await;
    let by = &centre.administrator;
    let made = cut(by, &at, 12.0).await;
    let second = address(&made["second"]);
    wait(by, [&at, &second]).await;
    let undo = format!("{second}/cuts/{}/undo", made["id"].as_str().unwrap());
    let to_bob = json!({"trainee": "bob", "why": "Bob did the second one."});
    by.make(&format!("{second}/moves"), to_bob).await;
    assert_eq!(sessions(by, "ada", "peg").await, std::slice::from_ref(&at));
    assert_eq!(sessions(by, "bob", "peg").await, std::slice::from_ref(&second));
    assert_eq!(by.read(&second).await["same_recordings"], by.read(&at).await["same_recordings"]);
    problem(by.post(&undo, Value::Null).await, 409, "conflict").await;
    by.make(&format!("{second}/moves"), json!({"trainee": "ada", "why": "It was Ada."})).await;

    let third = cut(by, &second, 16.0).await;
    wait(by, [&second, &address(&third["second"])]).await;
    assert!(duration(by, &second).await < 4.1);
    assert_eq!(sessions(by, "ada", "peg").await, [at.clone(), second.clone(), address(&third["second"])]);
    // The same recording of Bob is another one: the parts of Ada cannot be filed beside it.
    read(import(by, "bob", 1.0).await, StatusCode::CREATED).await;
    let beside = json!({"trainee": "bob", "why": "x"});
    problem(by.post(&format!("{second}/moves"), beside).await, 409, "duplicate-recording").await;
    assert_eq!(by.delete(&at).await.status(), StatusCode::NO_CONTENT);
    assert_eq!(sessions(by, "ada", "peg").await, [second.clone(), address(&third["second"])]);
    let undo = format!("{second}/cuts/{}/undo", third["id"].as_str().unwrap());
    read(by.post(&undo, Value::Null).await, StatusCode::OK).await;
    by.read_until(&format!("{second}/edits"), |edits| edits["score"] == "current").await;
    assert_eq!(sessions(by, "ada", "peg").await, [second]);
    let check = program().args(["admin", "check", "--data"]).arg(centre.service.data.path()).output().unwrap();
    assert!(check.status.success(), "{}", String::from_utf8_lossy(&check.stdout));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_hidden_copy_of_a_cut_recording_is_erased_with_its_last_part() {
    let (centre, at) = open().await;
    let by = &centre.administrator;
    by.make("/api/v1/trainees", json!({"name": "Cleo", "code": "cleo"})).await;
    for scale in [1.0, 1.5] {
        read(import(by, "bob", scale).await, StatusCode::CREATED).await;
    }
    let merge = async || {
        let made = by.make("/api/v1/trainees/ada/merges", json!({"trainee": "bob", "why": "One person."})).await;
        format!("/api/v1/trainees/ada/merges/{}/separate", made["id"].as_str().unwrap())
    };
    let recordings_of_bob = async |separate: &str| {
        read(by.post(separate, json!({"why": "Two people."})).await, StatusCode::OK).await;
        by.read("/api/v1/session-count?trainee=bob").await["matching"].clone()
    };
    let merged = merge().await;
    let second = address(&cut(by, &at, 12.0).await["second"]);
    wait(by, [&at, &second]).await;
    assert_eq!(by.delete(&second).await.status(), StatusCode::NO_CONTENT);
    assert_eq!(recordings_of_bob(&merged).await, 2, "Ada still has the first part");

    // Cleo has both parts and is erased: they are erased together.
    let merged = merge().await;
    let second = address(&cut(by, &at, 6.0).await["second"]);
    wait(by, [&at, &second]).await;
    let extent = async |trainee: &str| by.read(&format!("/api/v1/trainees/{trainee}/erasure")).await;
    let counts = |extent: &Value| ["sessions", "hidden_copies", "staying_count"].map(|name| extent[name].clone());
    let all = extent("ada").await;
    assert_eq!(counts(&all), [4, 0, 0].map(Value::from), "Bob's sessions are hers: {all}");
    let size = |scale: f64| table(scale).len();
    assert_eq!(all["bytes"], size(1.0) + size(1.5), "each table is stored once: {all}");
    let move_to_cleo = async |part: &String| {
        by.make(&format!("{part}/moves"), json!({"trainee": "cleo", "why": "It was Cleo."})).await
    };
    move_to_cleo(&at).await;
    // The hidden copy and the table stay for the other part, which is Ada's.
    let one_part = extent("cleo").await;
    assert_eq!(counts(&one_part), [1, 0, 1].map(Value::from), "{one_part}");
    assert_eq!((&one_part["bytes"], address(&one_part["staying"][0]["session"])), (&json!(0), at.clone()));
    assert_eq!(one_part["staying"][0]["task"], "Peg transfer");
    for hidden in ["ada", "Ada", "bob", "Bob", second.rsplit('/').next().unwrap()] {
        assert!(!one_part.to_string().contains(hidden), "{hidden} is another person's: {one_part}");
    }
    move_to_cleo(&second).await;
    let both_parts = extent("cleo").await;
    assert_eq!(counts(&both_parts), [2, 1, 0].map(Value::from), "{both_parts}");
    assert_eq!(both_parts["bytes"], size(1.0), "{both_parts}");
    assert_eq!(by.delete("/api/v1/trainees/cleo").await.status(), StatusCode::NO_CONTENT);
    assert_eq!(recordings_of_bob(&merged).await, 1, "the other recording of Bob");
    let check = program().args(["admin", "check", "--data"]).arg(centre.service.data.path()).output().unwrap();
    assert!(check.status.success(), "{}", String::from_utf8_lossy(&check.stdout));
}

#[tokio::test(flavor = "multi_thread")]
async fn impossible_cuts_are_refused_with_the_field() {
    let (centre, at) = open().await;
    let cuts = format!("{at}/cuts");
    let post = async |by: &Client, body: Value| by.post(&cuts, body).await;
    for at_s in [0.0, -1.0, 99.0, 100_000.0] {
        let refused = problem(post(&centre.instructor, json!({"at_s": at_s, "why": "x"})).await, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], "at_s", "{at_s}");
    }
    for at_s in [0.05, 19.9] {
        problem(post(&centre.instructor, json!({"at_s": at_s, "why": "x"})).await, 422, "invalid").await; // too little
    }
    for body in [json!({"at_s": 5}), json!({"why": "x"}), json!({"at_s": 5, "why": " "}), json!({"at": 5, "why": "x"})]
    {
        problem(post(&centre.instructor, body).await, 422, "invalid").await;
    }
    let body = json!({"at_s": 12, "why": "x"});
    for client in [&centre.trainee, &centre.agent] {
        problem(post(client, body.clone()).await, 403, "forbidden").await;
    }
    problem(post(&centre.other_instructor, body.clone()).await, 404, "not-found").await;
    problem(centre.instructor.post(&format!("{cuts}/{MISSING}/undo"), Value::Null).await, 404, "not-found").await;
    let made = cut(&centre.instructor, &at, 12.0).await;
    let second = address(&made["second"]);
    wait(&centre.instructor, [&at, &second]).await;
    centre.trainee.make(&format!("{second}/comments"), json!({"from_s": 13, "text": "Better."})).await;
    let undo = format!("{cuts}/{}/undo", made["id"].as_str().unwrap());
    problem(centre.instructor.post(&undo, Value::Null).await, 409, "conflict").await;
    assert_eq!(centre.instructor.read(&cuts).await["items"].as_array().unwrap().len(), 1);
}
