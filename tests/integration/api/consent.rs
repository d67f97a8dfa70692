//! Consent to recordings, how long the videos of one trainee are kept, and who looked at whose recordings.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::time::Duration;

use reqwest::{Method, Response, StatusCode, header};
use serde_json::{Value, json};
use trocar::time::{Clock, Day, ManualClock, SystemClock};

use super::centre::{Centre, PASSWORD, recording, send, session};
use super::tus::{Upload, create, metadata};
use crate::feed::sender::{Received, begin, hello, open};
use crate::support::{Client, Service, poll, poll_json, problem, read, with_advancing_clock};

const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";
const RECORDING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";
const ANOTHER: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a45";
const CONSENT: &str = "/api/v1/trainees/ada/consent";
const CONSENTS: &str = "/api/v1/trainees/ada/consents";
const ENTRIES: &str = "/api/v1/trainees/ada/access-entries";
const RETENTION: &str = "/api/v1/trainees/ada/retention";

fn today() -> Day {
    Day::of(SystemClock.now_ms())
}

/// Publishes a text that is required from this day on.
async fn publish(centre: &Centre, required_from: Option<Day>) -> Value {
    let text = json!({"en": {"title": "Recordings", "body": "We record your hands."}, "required_from": required_from});
    centre.administrator.make("/api/v1/consent-texts", text).await
}

async fn give(client: &Client, text: &Value) -> Value {
    client.make(CONSENTS, json!({"decision": "given", "text": text["id"]})).await
}

async fn withdraw(client: &Client) -> Value {
    client.make(CONSENTS, json!({"decision": "withdrawn"})).await
}

async fn import(client: &Client) -> Response {
    let mut table = "frame,time_s,tool,x_mm,y_mm,z_mm\n".to_owned();
    for frame in 0..200 {
        let time = f64::from(frame) * 0.04;
        table += &format!("{frame},{time},left,{},{},150\n", 20.0 * (time * 1.3).sin(), 20.0 * (time * 0.7).cos());
    }
    let path = "/api/v1/sessions/import?task=peg&box=box-1&trainee=ada";
    let request = client.request(Method::POST, path).header(header::CONTENT_TYPE, "text/csv").body(table);
    request.send().await.unwrap()
}

fn for_ada() -> String {
    metadata(&[("filename", "clip.mp4"), ("trainee", "ada"), ("task", "peg"), ("box", "box-1")])
}

async fn state(client: &Client) -> Value {
    client.read("/api/v1/trainees/ada").await["consent"].clone()
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_asked_without_a_text_and_nothing_stops_before_the_day() {
    let centre = Centre::open().await;
    assert_eq!(centre.trainee.read("/api/v1/consent-texts").await["items"], json!([]));
    assert_eq!(state(&centre.instructor).await, "not_needed");
    session(&centre.trainee, "ada", recording(100, 1)).await;

    let offered = publish(&centre, None).await;
    assert_eq!((&offered["version"], &offered["required_from"]), (&json!(1), &Value::Null));
    assert_eq!(state(&centre.instructor).await, "not_needed");
    let first = publish(&centre, Some(today().plus_days(2))).await;
    assert_eq!(state(&centre.instructor).await, "due");
    let due = centre.trainee.read(CONSENT).await;
    assert!(due["due_at"].is_string(), "{due}");
    session(&centre.trainee, "ada", recording(100, 2)).await;

    let effect = format!("/api/v1/consent-texts/effect?text={}", first["id"].as_str().unwrap());
    let without = centre.administrator.read(&effect).await;
    let expected = json!({"trainees": 2, "without_consent": 2, "active_without_consent": 1, "without_account": 0});
    assert_eq!(without, expected);
    let given = give(&centre.trainee, &first).await;
    assert_eq!((&given["state"], &given["history"][0]["how"]), (&json!("given"), &json!("signed_in")));
    assert_eq!((&given["history"][0]["version"], &given["history"][0]["who"]), (&json!(2), &json!("ada")));
    assert_eq!(centre.administrator.read(&effect).await["without_consent"], 1);

    let change = format!("/api/v1/consent-texts/{}", first["id"].as_str().unwrap());
    let now = json!({"required_from": today()});
    assert_eq!(read(centre.administrator.patch(&change, now).await, StatusCode::OK).await["body"], Value::Null);
    problem(send(&centre.other_trainee, "bob", recording(100, 3)).await, 403, "consent-missing").await;
    session(&centre.trainee, "ada", recording(100, 3)).await;
    let never = json!({"required_from": null});
    read(centre.administrator.patch(&change, never).await, StatusCode::OK).await;
    session(&centre.other_trainee, "bob", recording(100, 3)).await;
    let listed = centre.trainee.read("/api/v1/consent-texts").await;
    assert_eq!((&listed["items"][0]["id"], &listed["items"][0]["who"]), (&first["id"], &Value::Null));
    let audit = centre.administrator.read("/api/v1/audit-entries?limit=50").await;
    let found = |action: &str, noun: &str| {
        audit["items"].as_array().unwrap().iter().any(|entry| entry["action"] == action && entry["noun"] == noun)
    };
    assert!(found("publish", "consent_text") && found("change", "consent_text") && found("record consent", "trainee"));
}

#[tokio::test(flavor = "multi_thread")]
async fn every_way_of_a_recording_needs_the_consent() {
    let centre = Centre::open().await;
    let of_bob = session(&centre.other_trainee, "bob", recording(100, 9)).await;
    let moves = format!("/api/v1/sessions/{}/moves", of_bob["id"].as_str().unwrap());
    let text = publish(&centre, Some(today())).await;
    let refused = async || {
        let detail = problem(send(&centre.trainee, "ada", recording(100, 1)).await, 403, "consent-missing").await;
        problem(create(&centre.trainee, 5, &for_ada()).await, 403, "consent-missing").await;
        problem(import(&centre.instructor).await, 403, "consent-missing").await;
        let to_ada = json!({"trainee": "ada", "why": "x"});
        problem(centre.administrator.post(&moves, to_ada).await, 403, "consent-missing").await;
        for client in [&centre.agent, &centre.trainee] {
            let mut sender = open(&centre.service, client.headers(), "box-1").await.unwrap();
            sender.send_json(&hello(RECORDING)).await;
            let Received::Closed(4404, why) = sender.receive().await else { panic!("not refused") };
            assert!(why.contains("consent"), "{why}");
        }
        let push = "/api/v1/boxes/box-1/feed.ts?trainee=ada&task=peg";
        let pushed = centre.agent.request(Method::PUT, push).body(recording(500, 1)).send().await.unwrap();
        problem(pushed, 403, "consent-missing").await;
        assert_eq!(centre.instructor.read("/api/v1/sessions").await["items"], json!([]), "there is no session");
        detail
    };
    assert_eq!(refused().await["consent"], "missing");
    let refusal = json!({"decision": "refused", "text": text["id"]});
    assert_eq!(centre.trainee.make(CONSENTS, refusal).await["state"], "refused");
    assert_eq!(refused().await["consent"], "refused");

    give(&centre.trainee, &text).await;
    session(&centre.trainee, "ada", recording(100, 1)).await;
    assert_eq!(create(&centre.trainee, 5, &for_ada()).await.status(), StatusCode::CREATED);
    read(import(&centre.instructor).await, StatusCode::CREATED).await;
    centre.administrator.make(&moves, json!({"trainee": "ada", "why": "x"})).await;
    let (mut sender, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames(0..5).await;
    sender.end(5).await;
    assert_eq!(withdraw(&centre.trainee).await["state"], "withdrawn");
    assert_eq!(centre.instructor.read("/api/v1/sessions").await["items"].as_array().unwrap().len(), 4, "they stay");
    problem(send(&centre.instructor, "ada", recording(100, 5)).await, 403, "consent-missing").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_withdrawal_ends_a_running_recording_and_keeps_what_arrived() {
    let centre = Centre::open().await;
    let text = publish(&centre, Some(today())).await;
    give(&centre.trainee, &text).await;
    let upload = Upload::begin(&centre.trainee, 1_000).await;
    let content = recording(1_000, 3);
    assert!(upload.patch(0, &content[..400]).await.status().is_success());
    let (mut sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames(0..10).await;
    sender.wait_for_ack(json!([[0, 9]])).await;

    withdraw(&centre.trainee).await;
    let session = format!("/api/v1/sessions/{}", welcome["session"].as_str().unwrap());
    let ended = centre.instructor.read_until(&session, |session| session["status"] != "receiving").await;
    assert_eq!(ended["early_end"]["detail"], "the trainee decided against recordings", "{ended}");
    sender.send_frames(10..12).await;
    assert_eq!(sender.close_code().await, 1000, "a frame that comes later is not taken");
    let video = centre.instructor.get(&format!("{session}/video")).await.bytes().await.unwrap();
    assert_eq!(crate::feed::numbers_in(&video), (0..10).collect::<Vec<_>>());
    let mut next = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
    next.send_json(&hello(ANOTHER)).await;
    assert!(matches!(next.receive().await, Received::Closed(4404, _)));

    // An upload that has begun keeps its bytes; it becomes a session if the trainee consents again.
    problem(upload.patch(400, &content[400..]).await, 403, "consent-missing").await;
    assert_eq!(centre.instructor.read("/api/v1/sessions").await["items"].as_array().unwrap().len(), 1);
    give(&centre.trainee, &text).await;
    assert_eq!(upload.offset().await, 1_000);
    assert_eq!(centre.instructor.read("/api/v1/sessions").await["items"].as_array().unwrap().len(), 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn staff_record_papers_and_bad_decisions_are_refused() {
    let centre = Centre::open().await;
    for body in [
        json!({}),
        json!({"en": {"title": "x", "body": "  "}}),
        json!({"en": {"title": "", "body": "y"}}),
        json!({"en": {"title": "x", "body": "y"}, "required_from": "tomorrow"}),
    ] {
        problem(centre.administrator.post("/api/v1/consent-texts", body).await, 422, "invalid").await;
    }
    let text = publish(&centre, Some(today())).await;
    let id = &text["id"];
    let missing = json!({"decision": "given", "text": MISSING, "signed_on": today()});
    problem(centre.instructor.post(CONSENTS, missing).await, 422, "unknown-reference").await;
    let no_text = json!({"decision": "given", "signed_on": today()});
    problem(centre.instructor.post(CONSENTS, no_text).await, 422, "unknown-reference").await;
    let no_paper = json!({"decision": "given", "text": id});
    let refused = problem(centre.instructor.post(CONSENTS, no_paper).await, 422, "invalid").await;
    assert_eq!(refused["errors"][0]["field"], "signed_on");
    let future = json!({"decision": "given", "text": id, "signed_on": today().plus_days(3)});
    problem(centre.instructor.post(CONSENTS, future).await, 422, "invalid").await;
    let own_paper = json!({"decision": "given", "text": id, "signed_on": today()});
    problem(centre.trainee.post(CONSENTS, own_paper.clone()).await, 422, "invalid").await;
    problem(centre.trainee.post(CONSENTS, json!({"decision": "withdrawn"})).await, 409, "conflict").await;

    let made = centre.instructor.make(CONSENTS, own_paper).await;
    let entry = &made["history"][0];
    let day = today().to_string();
    assert_eq!((&entry["how"], &entry["who"], &entry["signed_on"]), (&json!("paper"), &json!("ines"), &json!(day)));
    problem(centre.trainee.post(CONSENTS, json!({"decision": "refused", "text": id})).await, 409, "conflict").await;
    assert_eq!(withdraw(&centre.instructor).await["history"][0]["how"], "staff");
    let old_paper = json!({"decision": "given", "text": id, "signed_on": "2020-01-31"});
    problem(centre.instructor.post(CONSENTS, old_paper).await, 409, "conflict").await;
    assert_eq!(centre.trainee.read(CONSENT).await["history"].as_array().unwrap().len(), 2);
    assert_eq!(state(&centre.administrator).await, "withdrawn");
}

/// The files of an export.
async fn export(client: &Client) -> BTreeMap<String, String> {
    let bytes = client.get("/api/v1/trainees/ada/data.zip").await.bytes().await.unwrap();
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    let mut files = BTreeMap::new();
    for index in 0..archive.len() {
        let mut file = archive.by_index(index).unwrap();
        let (name, mut content) = (file.name().unwrap().into_owned(), Vec::new());
        file.read_to_end(&mut content).unwrap();
        files.insert(name, String::from_utf8_lossy(&content).into_owned());
    }
    files
}

#[tokio::test(flavor = "multi_thread")]
async fn the_trainee_reads_who_looked_and_a_played_video_is_one_entry() {
    let centre = Centre::open().await;
    let made = session(&centre.trainee, "ada", recording(2_000, 1)).await;
    let id = made["id"].as_str().unwrap();
    let at = format!("/api/v1/sessions/{id}");
    for client in [&centre.trainee, &centre.instructor, &centre.administrator] {
        client.read("/api/v1/sessions").await; // a list does not count
    }
    centre.trainee.read(&at).await;
    problem(centre.other_instructor.get(&at).await, 404, "not-found").await;
    for part in 0..40 {
        let video = centre.instructor.request(Method::GET, &format!("{at}/video"));
        let video =
            video.header(header::RANGE, format!("bytes={}-{}", part * 50, part * 50 + 49)).send().await.unwrap();
        assert_eq!(video.status(), StatusCode::PARTIAL_CONTENT);
    }
    centre.instructor.read(&format!("{at}/comments")).await;
    let token = json!({"name": "report maker", "role": "administrator"});
    let token = centre.administrator.make("/api/v1/tokens", token).await;
    let program = centre.service.stranger().with_token(token["token"].as_str().unwrap());
    program.read(&at).await;

    let two = |page: &Value| {
        page["items"]
            .as_array()
            .is_some_and(|items| items.len() == 2 && items[1]["parts"].as_array().unwrap().len() == 2)
    };
    let read_entries = async || centre.trainee.read(ENTRIES).await;
    let seen = poll_json("the entries", read_entries, two).await;
    let [by_program, by_ines] = [&seen["items"][0], &seen["items"][1]];
    assert_eq!((&by_ines["who"], &by_ines["role"]), (&json!("ines"), &json!("instructor")));
    assert_eq!((&by_ines["session"], &by_ines["task"]), (&json!(id), &json!("Peg transfer")));
    assert_eq!((&by_ines["parts"], &by_ines["program"]), (&json!(["video", "remarks"]), &Value::Null));
    assert_eq!((&by_program["program"], &by_program["parts"]), (&json!("report maker"), &json!(["result"])));
    problem(centre.instructor.get(ENTRIES).await, 403, "forbidden").await;
    problem(centre.other_trainee.get(ENTRIES).await, 404, "not-found").await;

    // The exports hold what belongs to the person; an instructor's leaves out who looked.
    let text = publish(&centre, None).await;
    give(&centre.trainee, &text).await;
    let own = export(&centre.trainee).await;
    assert!(own["access.json"].contains("report maker") && own["consent.json"].contains("signed_in"));
    assert!(own["retention.json"].contains("centre_months"));
    assert!(!export(&centre.instructor).await.contains_key("access.json"));
    let exported = |page: &Value| page["items"][0]["parts"] == json!(["export"]);
    let seen = poll_json("the export", read_entries, exported).await;
    assert_eq!((&seen["items"][0]["session"], &seen["items"][0]["who"]), (&Value::Null, &json!("ines")));

    // A viewer who leaves is a deleted person, and the name of the token goes, too.
    let people = centre.administrator.read("/api/v1/people").await;
    let ines = people["items"].as_array().unwrap().iter().find(|one| one["login"] == "ines").unwrap();
    centre.administrator.delete(&format!("/api/v1/people/{}", ines["id"].as_str().unwrap())).await;
    let seen = centre.trainee.read(ENTRIES).await;
    assert!(seen["items"].as_array().unwrap().iter().all(|entry| entry["who"] != "ines"), "{seen}");
    // An erased session leaves its entries; the erased trainee leaves nothing.
    assert_eq!(centre.administrator.delete(&at).await.status(), StatusCode::NO_CONTENT);
    assert_eq!(centre.trainee.read(ENTRIES).await["items"][1]["session"], Value::Null);
    centre.administrator.delete("/api/v1/trainees/ada").await;
    problem(centre.administrator.get(ENTRIES).await, 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_persons_own_time_deletes_videos_only_after_the_number_is_confirmed() {
    let clock = ManualClock::at(1_800_000_000_000);
    let service = Service::start_with_clock(clock.clone()).await;
    let centre = Centre::open_in(service).await;
    let of_ada = session(&centre.trainee, "ada", recording(500, 1)).await;
    let of_bob = session(&centre.other_trainee, "bob", recording(500, 2)).await;
    clock.advance(Duration::from_secs(70 * 86_400));
    let administrator = centre.service.administrator().await;
    let instructor = centre.service.sign_in("ines", PASSWORD).await;
    session(&instructor, "ada", recording(500, 3)).await;

    let now = instructor.read(RETENTION).await;
    assert_eq!((&now["months"], &now["own_months"], &now["videos"]), (&json!(0), &Value::Null, &json!(2)));
    assert_eq!(now["oldest_deleted_at"], Value::Null);
    let preview = format!("{RETENTION}/preview");
    let looked = read(instructor.post(&preview, json!({"months": 2})).await, StatusCode::OK).await;
    assert_eq!(looked, json!({"needs_reason": false, "videos": 1, "bytes": 500}));
    let two_months = json!({"months": 2});
    problem(instructor.put(RETENTION, two_months).await, 409, "conflict").await;
    problem(instructor.put(RETENTION, json!({"months": 2_000})).await, 422, "invalid").await;
    problem(instructor.put(RETENTION, json!({"reason": "x"})).await, 422, "invalid").await;
    let three = read(instructor.put(RETENTION, json!({"months": 3})).await, StatusCode::OK).await;
    assert_eq!((&three["months"], &three["who"]), (&json!(3), &json!("ines")));
    assert!(three["oldest_deleted_at"].is_string(), "{three}");
    let confirmed = json!({"months": 2, "confirmed_videos": 1});
    read(instructor.put(RETENTION, confirmed).await, StatusCode::OK).await;

    let video = format!("/api/v1/sessions/{}/video", of_ada["id"].as_str().unwrap());
    let gone = poll("the end of the video", async || {
        let answer = instructor.get(&video).await;
        (answer.status() == StatusCode::GONE).then_some(())
    });
    with_advancing_clock(&clock, Duration::from_secs(21), gone).await;
    let kept = administrator.get(&format!("/api/v1/sessions/{}/video", of_bob["id"].as_str().unwrap())).await;
    assert_eq!(kept.status(), StatusCode::OK, "another trainee's video stays");
    let after = instructor.read(RETENTION).await;
    assert_eq!((&after["videos"], &after["months"]), (&json!(1), &json!(2)));
    let back = read(instructor.put(RETENTION, json!({"months": null})).await, StatusCode::OK).await;
    assert_eq!((&back["months"], &back["own_months"]), (&json!(0), &Value::Null));
}
