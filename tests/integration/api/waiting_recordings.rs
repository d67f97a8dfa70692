//! Recordings that wait for a name: who sends and sees them, their assignment, and that they are measured only with a
//! name.

use std::sync::Arc;
use std::time::Duration;

use reqwest::{Method, Response, StatusCode, header};
use serde_json::{Value, json};
use trocar::time::{Clock, ManualClock, SystemClock};

use super::centre::{Centre, recording, session};
use crate::planted::plant_owner;
use crate::process::program;
use crate::support::{Client, Service, poll_json, problem, read, with_advancing_clock};

const LIST: &str = "/api/v1/waiting-recordings";
const COUNT: &str = "/api/v1/waiting-recording-count";
const ASSIGN: &str = "/api/v1/waiting-recordings/assign";
const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";

async fn send(client: &Client, query: &str, content: Vec<u8>) -> Response {
    let request = client.request(Method::POST, &format!("{LIST}?{query}")).header(header::CONTENT_TYPE, "video/mp4");
    request.body(content).send().await.unwrap()
}

async fn waiting(client: &Client, query: &str, salt: u64) -> Value {
    read(send(client, query, recording(200, salt)).await, StatusCode::CREATED).await
}

async fn assign(client: &Client, items: Value) -> Vec<Value> {
    let answer = read(client.post(ASSIGN, json!({"items": items})).await, StatusCode::OK).await;
    answer["results"].as_array().unwrap().clone()
}

async fn listed(client: &Client, query: &str) -> Vec<String> {
    let page = client.read(&format!("{LIST}?{query}")).await;
    page["items"].as_array().unwrap().iter().map(|one| one["filename"].as_str().unwrap().to_owned()).collect()
}

fn id(of: &Value) -> &str {
    of["id"].as_str().unwrap()
}

fn slug(result: &Value) -> &str {
    result["problem"]["type"].as_str().unwrap_or_default().trim_start_matches("/problems/")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_of_a_box_becomes_the_session_of_the_person_whom_staff_name() {
    let centre = Centre::open().await;
    let sent = waiting(&centre.agent, "filename=07.mp4&recorded_at=2026-03-11T09:30:00Z", 1).await;
    assert_eq!(
        (&sent["source"], &sent["box"]["code"], &sent["task"]),
        (&json!("agent"), &json!("box-1"), &Value::Null)
    );
    assert_eq!(centre.administrator.read("/api/v1/sessions").await["items"], json!([]), "it is no session yet");
    assert_eq!(centre.administrator.read("/api/v1/jobs").await["items"], json!([]), "it is not measured");
    let found = centre.instructor.read(&format!("{LIST}/{}", id(&sent))).await;
    assert_eq!((&found["filename"], &found["recorded_at"]), (&json!("07.mp4"), &json!("2026-03-11T09:30:00Z")));
    assert_eq!(centre.instructor.read(COUNT).await, json!({"count": 1, "kept_days": 30}));

    let results = assign(&centre.instructor, json!([{"id": sent["id"], "trainee": "ada", "task": "peg"}])).await;
    assert_eq!((&results[0]["session"], &results[0]["problem"]), (&sent["id"], &Value::Null), "{results:?}");
    assert_eq!(results[0]["waits_for_box"], true, "the box has no camera yet");
    let session = centre.trainee.read(&format!("/api/v1/sessions/{}", id(&sent))).await;
    assert_eq!((&session["trainee"]["code"], &session["box"]["code"]), (&json!("ada"), &json!("box-1")));
    assert_eq!((&session["recorded_at"], &session["created_at"]), (&sent["recorded_at"], &sent["arrived_at"]));
    assert_eq!(session["supervision"], "none", "a name given later says nothing about who saw the attempt");
    assert_eq!(session["filename"], "07.mp4");
    assert_eq!(centre.instructor.read(COUNT).await["count"], 0);
    problem(centre.instructor.get(&format!("{LIST}/{}", id(&sent))).await, 404, "not-found").await;
    let entries = centre.administrator.read("/api/v1/audit-entries").await;
    let of_it = entries["items"].as_array().unwrap().iter().filter(|entry| entry["subject"] == sent["id"]);
    let actions: Vec<(&str, &str)> =
        of_it.map(|entry| (entry["noun"].as_str().unwrap(), entry["action"].as_str().unwrap())).collect();
    let expected = [("waiting_recording", "assign"), ("session", "create"), ("waiting_recording", "create")];
    assert_eq!(actions, expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn each_recording_of_a_request_has_a_result_of_its_own() {
    let centre = Centre::open().await;
    let by = &centre.administrator;
    let mut sent = Vec::new();
    for salt in 0..5 {
        sent.push(waiting(by, &format!("filename={salt}.mp4&box=box-1"), salt).await);
    }
    let of_bob = session(by, "bob", recording(200, 3)).await;
    let text = json!({"en": {"title": "Recordings", "body": "We record."}, "required_from": "2026-01-01"});
    let text = by.make("/api/v1/consent-texts", text).await;
    let refused = json!({"decision": "refused", "text": text["id"]});
    centre.trainee.make("/api/v1/trainees/ada/consents", refused).await;
    let given = json!({"decision": "given", "text": text["id"]});
    centre.other_trainee.make("/api/v1/trainees/bob/consents", given).await;

    let results = assign(
        by,
        json!([
            {"id": sent[0]["id"], "trainee": "ada", "task": "peg"},
            {"id": sent[1]["id"], "trainee": "bob"},
            {"id": sent[2]["id"], "trainee": "nobody-here", "task": "peg"},
            {"id": sent[3]["id"], "trainee": "bob", "task": "peg"},
            {"id": MISSING, "trainee": "bob", "task": "peg"},
            {"id": sent[4]["id"], "trainee": "bob", "task": "peg", "recorded_at": "2026-02-01T10:00:00Z", "supervised": true},
            {"id": sent[4]["id"], "trainee": "bob", "task": "peg"},
        ]),
    )
    .await;
    let slugs: Vec<&str> = results.iter().map(slug).collect();
    assert_eq!(
        slugs,
        ["consent-missing", "invalid", "unknown-reference", "duplicate-recording", "not-found", "", "not-found"]
    );
    assert_eq!(results[1]["problem"]["errors"][0]["field"], "task");
    assert_eq!(results[2]["problem"]["field"], "trainee");
    assert_eq!(results[3]["problem"]["session"], format!("/api/v1/sessions/{}", id(&of_bob)));
    let made = by.read(&format!("/api/v1/sessions/{}", id(&sent[4]))).await;
    assert_eq!((&made["supervision"], &made["recorded_at"]), (&json!("marked"), &json!("2026-02-01T10:00:00Z")));
    assert_eq!(listed(by, "").await, ["3.mp4", "2.mp4", "1.mp4", "0.mp4"], "the others wait on");
    problem(by.post(ASSIGN, json!({"items": []})).await, 422, "invalid").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_box_sends_only_from_itself_and_the_same_recording_waits_once() {
    let centre = Centre::open().await;
    centre.administrator.make("/api/v1/boxes", json!({"name": "Box 2", "code": "box-2"})).await;
    let other = send(&centre.agent, "box=box-2", recording(200, 1)).await;
    assert_eq!(problem(other, 422, "unknown-reference").await["field"], "box");
    problem(send(&centre.trainee, "", recording(200, 1)).await, 403, "forbidden").await;
    problem(send(&centre.agent, "", Vec::new()).await, 422, "invalid").await;
    problem(send(&centre.agent, "recorded_at=yesterday", recording(200, 1)).await, 422, "invalid").await;
    let first = waiting(&centre.agent, "task=peg", 1).await;
    assert_eq!(first["task"]["code"], "peg");
    let again = problem(send(&centre.agent, "", recording(200, 1)).await, 409, "duplicate-recording").await;
    assert_eq!(again["waiting_recording"], format!("{LIST}/{}", id(&first)));
    assign(&centre.administrator, json!([{"id": first["id"], "trainee": "ada"}])).await;
    for (client, sees) in [(&centre.agent, false), (&centre.other_instructor, false), (&centre.instructor, true)] {
        let again = problem(send(client, "", recording(200, 1)).await, 409, "duplicate-recording").await;
        assert_eq!(again["session"].is_string(), sees, "{again}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn lists_are_filtered_by_box_day_and_source_and_propose_what_names_say() {
    let centre = Centre::open().await;
    let by = &centre.administrator;
    by.make("/api/v1/trainees", json!({"name": "Ada Novak", "code": "ada-novak"})).await;
    waiting(&centre.agent, "filename=box.mp4&recorded_at=2026-03-11T23:59:00Z", 1).await;
    waiting(by, "filename=novak_ada-peg-transfer%203.mp4&recorded_at=2026-03-12T00:00:00Z", 2).await;
    waiting(by, "filename=bob.mp4&box=box-1&recorded_at=2026-03-10T12:00:00Z", 3).await;
    assert_eq!(listed(by, "box=box-1").await, ["box.mp4", "bob.mp4"]);
    assert_eq!(listed(by, "day=2026-03-11").await, ["box.mp4"]);
    assert_eq!(listed(by, "source=upload").await, ["novak_ada-peg-transfer 3.mp4", "bob.mp4"]);
    assert_eq!(listed(by, "from=2026-03-10T12:00:00Z&before=2026-03-12T00:00:00Z").await, ["box.mp4", "bob.mp4"]);
    problem(by.get(&format!("{LIST}?day=monday")).await, 422, "invalid").await;
    let first = by.read(&format!("{LIST}?limit=1")).await;
    let proposal = &first["items"][0]["proposal"];
    assert_eq!((&proposal["trainee"]["code"], &proposal["task"]["code"]), (&json!("ada-novak"), &json!("peg")));
    let next = first["next"].as_str().unwrap();
    assert_eq!(listed(by, &format!("limit=1&cursor={next}")).await, ["box.mp4"]);
    let of_bob = |page: Value| page["items"][2]["proposal"]["trainee"]["code"].clone();
    assert_eq!(of_bob(by.read(LIST).await), "bob");
    assert_eq!(of_bob(centre.instructor.read(LIST).await), Value::Null, "only trainees whom the caller sees");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_discarded_recording_is_gone_and_erasing_a_person_takes_what_is_theirs() {
    let centre = Centre::open().await;
    let by = &centre.administrator;
    let one = waiting(by, "filename=one.mp4", 1).await;
    let of_bob = waiting(by, "filename=of-bob.mp4", 2).await;
    let bob = by.read("/api/v1/trainees/bob").await;
    plant_owner(&centre.service.data.path().join("trocar.db"), id(&of_bob), id(&bob)).await;
    assert_eq!(listed(&centre.instructor, "").await, ["one.mp4"], "what is Bob's is hidden from another group");
    assert_eq!(listed(&centre.other_instructor, "").await, ["of-bob.mp4", "one.mp4"]);
    let gone = centre.instructor.delete(&format!("{LIST}/{}", id(&one))).await;
    assert_eq!(gone.status(), StatusCode::NO_CONTENT);
    problem(by.get(&format!("{LIST}/{}/video", id(&one))).await, 404, "not-found").await;
    assert_eq!(by.delete("/api/v1/trainees/bob").await.status(), StatusCode::NO_CONTENT);
    assert_eq!(by.read(COUNT).await["count"], 0);
    let erased = session(by, "ada", recording(200, 9)).await;
    assert_eq!(by.delete(&format!("/api/v1/sessions/{}", id(&erased))).await.status(), StatusCode::NO_CONTENT);
    waiting(by, "filename=again.mp4", 9).await;
    assert_eq!(by.read(COUNT).await["count"], 1, "an erased recording that is sent again is new");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_without_a_name_is_deleted_after_its_days() {
    let clock = ManualClock::at(SystemClock.now_ms());
    let centre = Centre::open_in(Service::start_with_clock(clock.clone()).await).await;
    let kept = waiting(&centre.administrator, "filename=old.mp4", 1).await;
    assert!(kept["deleted_at"].as_str() > kept["arrived_at"].as_str());
    clock.advance(Duration::from_secs(29 * 86_400));
    let administrator = centre.service.administrator().await;
    assert_eq!(administrator.read(COUNT).await["count"], 1);
    clock.advance(Duration::from_secs(86_400));
    let administrator = centre.service.administrator().await;
    let emptied = async || administrator.read(COUNT).await;
    let step = Duration::from_secs(5);
    let gone = poll_json("the recording is deleted", emptied, |count| count["count"] == 0);
    with_advancing_clock(&Arc::clone(&clock), step, gone).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn staff_look_at_a_picture_and_the_video_before_they_name_a_person() {
    let centre = Centre::open().await;
    let folder = tempfile::tempdir().unwrap();
    let order = ["simulate", "--quiet", "--scene", "rest", "--seconds", "1", "--boards", "0", "--out", "."];
    assert!(program().args(order).current_dir(folder.path()).status().unwrap().success());
    let clip = std::fs::read(folder.path().join("clip.mp4")).unwrap();
    let sent = read(send(&centre.agent, "filename=a.mp4", clip.clone()).await, StatusCode::CREATED).await;
    let at = format!("{LIST}/{}", id(&sent));
    let picture = centre.instructor.get(&format!("{at}/preview.jpg")).await;
    assert_eq!(
        (picture.status(), &picture.headers()[header::CONTENT_TYPE]),
        (StatusCode::OK, &"image/jpeg".parse().unwrap())
    );
    assert!(picture.bytes().await.unwrap().starts_with(&[0xff, 0xd8]));
    let part = centre.instructor.request(Method::GET, &format!("{at}/video")).header(header::RANGE, "bytes=4-9");
    let part = part.send().await.unwrap();
    assert_eq!(part.status(), StatusCode::PARTIAL_CONTENT);
    assert_eq!(part.bytes().await.unwrap()[..], clip[4..10]);

    let broken = waiting(&centre.agent, "filename=b.mp4", 5).await;
    let at = format!("{LIST}/{}", id(&broken));
    problem(centre.instructor.get(&format!("{at}/preview.jpg")).await, 404, "not-found").await;
    let why = centre.instructor.read(&at).await["unreadable"].clone();
    assert!(why.as_str().unwrap().starts_with("The recording was cut off. "), "{why}");
}
