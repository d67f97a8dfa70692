//! Boxes that stand by: their state, start and stop from the dashboard and at the box, check-in with code and PIN.

use std::time::{Duration, Instant};

use reqwest::{Method, StatusCode};
use serde_json::{Value, json};
use trocar::media::{MediaLimits, VideoFile};

use super::centre::Centre;
use crate::box_agent::{BoxComputer, StandingAgent};
use crate::support::{Client, Service, poll, poll_json, problem, read};

pub(super) const AGENT: &str = "/api/v1/boxes/box-1/agent";
const DAY_MS: i64 = 86_400_000;

/// A centre whose box has a computer.
pub(super) struct Box1 {
    pub(super) centre: Centre,
    computer: BoxComputer,
}

impl Box1 {
    async fn open() -> Self {
        Self::with_clip(60).await
    }

    /// The same with a camera that ends and begins again after some seconds.
    async fn with_clip(seconds: u32) -> Self {
        Self::with_computer(|token| BoxComputer::new(token, seconds)).await
    }

    /// The same with the computer that is made with the box's token.
    pub(super) async fn with_computer(make: impl FnOnce(&str) -> BoxComputer) -> Self {
        Self::of(Centre::open().await, make).await
    }

    /// The same with a service that phones can open.
    async fn open_for_phones() -> Self {
        let public = Some("https://trocar.example".to_owned());
        let service = Service::start_with(|settings| settings.http.public_url = public).await;
        Self::of(Centre::open_in(service).await, |token| BoxComputer::new(token, 60)).await
    }

    async fn of(centre: Centre, make: impl FnOnce(&str) -> BoxComputer) -> Self {
        let token = json!({"name": "box 1", "role": "agent", "box": "box-1"});
        let token = centre.administrator.make("/api/v1/tokens", token).await;
        let computer = make(token["token"].as_str().unwrap());
        Self { centre, computer }
    }

    /// Starts the agent, and waits until its camera is open.
    pub(super) async fn stand_by(&self, arguments: &[&str]) -> StandingAgent {
        let server = format!("http://{}", self.centre.service.address());
        let agent = self.computer.stand_by(&server, arguments);
        self.until(|state| state["camera"]["is_open"] == true).await;
        agent
    }

    pub(super) async fn until(&self, wanted: impl Fn(&Value) -> bool) -> Value {
        self.centre.administrator.read_until(AGENT, wanted).await
    }

    pub(super) async fn start(&self, by: &Client, body: Value) -> reqwest::Response {
        by.post(&format!("{AGENT}/start"), body).await
    }

    pub(super) async fn stop(&self, by: &Client) -> reqwest::Response {
        by.request(Method::POST, &format!("{AGENT}/stop")).send().await.unwrap()
    }

    /// The newest session, once it has arrived.
    pub(super) async fn session(&self) -> Value {
        let arrived = |list: &Value| list["items"][0]["status"].as_str().is_some_and(|status| status != "receiving");
        let list = self.centre.administrator.read_until("/api/v1/sessions", arrived).await;
        self.centre.administrator.read(&format!("/api/v1/sessions/{}", list["items"][0]["id"].as_str().unwrap())).await
    }
}

pub(super) async fn screen_state(agent: &StandingAgent) -> Value {
    reqwest::get(agent.screen("/state")).await.unwrap().json().await.unwrap()
}

pub(super) async fn screen_until(agent: &StandingAgent, wanted: impl Fn(&Value) -> bool) -> Value {
    poll_json("the screen of the box", async || screen_state(agent).await, wanted).await
}

pub(super) async fn press(agent: &StandingAgent, path: &str, body: Value) -> reqwest::Response {
    reqwest::Client::new().post(agent.screen(path)).json(&body).send().await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_dashboard_starts_and_stops_a_box_within_two_seconds() {
    let box_1 = Box1::open().await;
    let (instructor, other) = (&box_1.centre.instructor, &box_1.centre.other_instructor);
    let never = box_1.centre.trainee.read(AGENT).await;
    assert_eq!((&never["presence"], &never["last_seen_at"]), (&json!("never"), &Value::Null));
    let ada = json!({"trainee": "ada", "task": "peg"});
    let refused = problem(box_1.start(instructor, ada.clone()).await, 409, "conflict").await;
    assert!(refused["detail"].as_str().unwrap().contains("silent"), "{refused}");

    let agent = box_1.stand_by(&[]).await;
    let live = box_1.until(|state| !state["clock"].is_null() && !state["light"].is_null()).await;
    assert_eq!((&live["presence"], &live["camera"]["width"]), (&json!("live"), &json!(320)));
    assert!(live["clock"]["offset_ms"].as_i64().unwrap().abs() < 1000 && live["clock"]["is_wrong"] == false, "{live}");
    assert!(live["program"].as_str().unwrap().starts_with("trocar agent "));
    let listed = box_1.centre.trainee.read("/api/v1/boxes").await;
    assert_eq!(listed["items"][0]["agent"]["presence"], "live");
    assert_eq!(box_1.centre.trainee.read("/api/v1/agents").await["items"][0]["presence"], "live");

    let began = Instant::now();
    let answer = read(box_1.start(instructor, ada.clone()).await, StatusCode::OK).await;
    assert_eq!(answer["recording"]["trainee"]["code"], "ada", "{answer}");
    let running = box_1.until(|state| !state["recording"]["session"].is_null()).await;
    let first_frame = began.elapsed();
    eprintln!("from the start on the dashboard to the first frame at the server: {first_frame:?}");
    assert!(first_frame < Duration::from_secs(2), "{first_frame:?}");
    problem(box_1.start(&box_1.centre.administrator, ada).await, 409, "conflict").await;
    let seen = other.read(AGENT).await;
    assert_eq!(seen["recording"]["trainee"], Value::Null, "the other instructor does not see who it is");
    assert_eq!((&seen["recording"]["session"], seen["recording"]["frames"].is_u64()), (&Value::Null, true));
    problem(box_1.stop(other).await, 409, "conflict").await;
    poll("some frames", async || {
        let state = instructor.read(AGENT).await;
        (state["recording"]["frames"].as_u64().unwrap() > 20).then_some(())
    })
    .await;
    read(box_1.stop(&box_1.centre.trainee).await, StatusCode::OK).await;
    problem(box_1.stop(&box_1.centre.trainee).await, 409, "conflict").await;
    let session = box_1.session().await;
    assert_eq!(session["id"], running["recording"]["session"]);
    assert_eq!((&session["trainee"]["code"], &session["date_known"]), (&json!("ada"), &json!(true)));
    assert!(session["early_end"].is_null());
    box_1.until(|state| state["spool"]["recordings"] == 0).await;

    let audit = box_1.centre.administrator.read("/api/v1/audit-entries?limit=8").await;
    let entries: Vec<(&str, &str)> = audit["items"].as_array().unwrap().iter().map(entry).collect();
    for wanted in [("start recording", "box"), ("start recording", "trainee"), ("stop recording", "box")] {
        assert!(entries.contains(&wanted), "{wanted:?} in {entries:?}");
    }
    let killed = Instant::now();
    agent.kill();
    box_1.until(|state| state["presence"] == "silent" && state["camera"].is_null()).await;
    assert!(killed.elapsed() < Duration::from_secs(10));
}

fn entry(of: &Value) -> (&str, &str) {
    (of["action"].as_str().unwrap(), of["noun"].as_str().unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn trainees_record_themselves_only_and_not_without_consent() {
    let box_1 = Box1::open().await;
    let _agent = box_1.stand_by(&[]).await;
    let (ada, bob) = (&box_1.centre.trainee, json!({"trainee": "bob", "task": "peg"}));
    problem(box_1.start(ada, bob.clone()).await, 422, "unknown-reference").await;
    problem(box_1.start(&box_1.centre.instructor, bob).await, 422, "unknown-reference").await;
    problem(box_1.start(ada, json!({"task": "nothing"})).await, 422, "unknown-reference").await;
    let no_trainee =
        problem(box_1.start(&box_1.centre.administrator, json!({"task": "peg"})).await, 422, "invalid").await;
    assert_eq!(no_trainee["errors"][0]["field"], "trainee");
    let text = json!({"en": {"title": "Recordings", "body": "We record you."}, "required_from": "2020-01-01"});
    box_1.centre.administrator.make("/api/v1/consent-texts", text).await;
    problem(box_1.start(ada, json!({"task": "peg"})).await, 403, "consent-missing").await;
    let camera = json!({"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320, "cy": 240});
    let put = box_1.centre.administrator.put("/api/v1/boxes/box-1/camera", camera).await;
    assert!(put.status().is_success());
    let consent = json!({"text": box_1.centre.trainee.read("/api/v1/consent-texts").await["items"][0]["id"], "decision": "given"});
    ada.make("/api/v1/trainees/ada/consents", consent).await;
    let size = problem(box_1.start(ada, json!({"task": "peg"})).await, 409, "conflict").await;
    assert!(size["detail"].as_str().unwrap().contains("320×240"), "{size}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainee_checks_in_with_the_code_on_the_screen_and_records_there() {
    let box_1 = Box1::open_for_phones().await;
    let agent = box_1.stand_by(&["--require-check-in"]).await;
    let refused = press(&agent, "/start", json!({})).await;
    assert_eq!(refused.status(), StatusCode::CONFLICT);
    let why: Value = refused.json().await.unwrap();
    assert_eq!(why["kind"], "needs-check-in", "{why}");
    let state = screen_until(&agent, |state| state["check_in_address"].is_string()).await;
    let address = state["check_in_address"].as_str().unwrap();
    let (page, code) = address.split_once('#').unwrap();
    assert_eq!(page, "https://trocar.example/check-in?box=box-1");
    assert_eq!(box_1.until(|_| true).await["unreachable_server"], Value::Null);

    let (ada, check_in) = (&box_1.centre.trainee, "/api/v1/boxes/box-1/check-in");
    let wrong = problem(ada.put(check_in, json!({"code": "nonsense"})).await, 422, "invalid").await;
    assert_eq!(wrong["errors"][0]["field"], "code");
    problem(ada.put(check_in, json!({})).await, 422, "invalid").await;
    problem(ada.put(check_in, json!({"code": code, "trainee": "bob"})).await, 422, "unknown-reference").await;
    let checked_in = read(ada.put(check_in, json!({"code": code, "task": "peg"})).await, StatusCode::OK).await;
    assert_eq!(checked_in["checked_in"]["trainee"]["code"], "ada", "{checked_in}");
    problem(box_1.centre.other_trainee.put(check_in, json!({"code": code})).await, 422, "invalid").await;
    screen_until(&agent, |state| state["check_in_address"].as_str().is_some_and(|next| next != address)).await;
    let hidden = box_1.centre.other_trainee.read(AGENT).await;
    assert_eq!(hidden["checked_in"]["trainee"], Value::Null);
    problem(box_1.centre.other_trainee.delete(check_in).await, 404, "not-found").await;

    let state = screen_until(&agent, |state| state["checked_in"].is_object()).await;
    assert_eq!(state["checked_in"]["task"]["name"], "Peg transfer", "{state}");
    assert_eq!(press(&agent, "/start", json!({})).await.status(), StatusCode::NO_CONTENT);
    screen_until(&agent, |state| state["state"]["recording"]["session"].is_string()).await;
    assert_eq!(press(&agent, "/stop", json!({})).await.status(), StatusCode::NO_CONTENT);
    let session = box_1.session().await;
    assert_eq!((&session["trainee"]["code"], &session["task"]["code"]), (&json!("ada"), &json!("peg")));
    let state = screen_until(&agent, |state| state["checked_in"]["last"]["status"] == "queued").await;
    assert_eq!(state["checked_in"]["last"]["session"], session["id"]);
    assert_eq!(press(&agent, "/check-out", json!({})).await.status(), StatusCode::NO_CONTENT);
    box_1.until(|state| state["checked_in"].is_null()).await;
    let staff = box_1.centre.instructor.put(check_in, json!({"trainee": "ada"})).await;
    assert_eq!(read(staff, StatusCode::OK).await["checked_in"]["trainee"]["code"], "ada", "staff need no code");
    assert_eq!(ada.delete(check_in).await.status(), StatusCode::NO_CONTENT);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainee_checks_in_with_a_pin_and_wrong_pins_are_counted() {
    let box_1 = Box1::open().await;
    let ada = &box_1.centre.trainee;
    assert_eq!(ada.read("/api/v1/me/pin").await, json!({"set_at": null}));
    for (pin, by) in [("1234", ada), ("12a4", ada), ("12", ada)] {
        problem(by.put("/api/v1/me/pin", json!({"pin": pin})).await, 422, "invalid").await;
    }
    problem(box_1.centre.instructor.put("/api/v1/me/pin", json!({"pin": "2580"})).await, 403, "forbidden").await;
    let set = read(ada.put("/api/v1/me/pin", json!({"pin": "2580"})).await, StatusCode::OK).await;
    assert!(set["set_at"].is_string());

    let agent = box_1.stand_by(&[]).await;
    let typed = |trainee: &str, pin: &str| json!({"trainee": trainee, "pin": pin});
    for (trainee, pin) in [("ada", "2581"), ("no-such-code", "2580"), ("bob", "2580"), ("ada", "x")] {
        assert_eq!(press(&agent, "/check-in", typed(trainee, pin)).await.status(), StatusCode::NO_CONTENT);
        let state = screen_until(&agent, |state| !state["refusal"].is_null()).await;
        assert_eq!(state["refusal"][0], "wrong", "{trainee} {pin}");
    }
    press(&agent, "/check-in", typed("Ada ", "2580")).await;
    let state = screen_until(&agent, |state| state["checked_in"].is_object()).await;
    assert_eq!(state["checked_in"]["trainee"]["name"], "ada");
    let task = state["checked_in"]["tasks"][0]["id"].clone();
    assert_eq!(press(&agent, "/task", json!({"task": "other"})).await.status(), StatusCode::CONFLICT);
    assert_eq!(press(&agent, "/task", json!({"task": task})).await.status(), StatusCode::NO_CONTENT);
    box_1.until(|state| state["checked_in"]["task"]["code"] == "peg").await;
    let audit = box_1.centre.administrator.read("/api/v1/audit-entries?limit=4").await;
    let of_agent = |entry: &Value| entry["action"] == "check in" && entry["by"] == "agent";
    assert!(audit["items"].as_array().unwrap().iter().any(of_agent), "{audit}");

    assert_eq!(ada.delete("/api/v1/me/pin").await.status(), StatusCode::NO_CONTENT);
    for _ in 0..9 {
        press(&agent, "/check-in", typed("ada", "2580")).await;
        screen_until(&agent, |state| !state["refusal"].is_null()).await;
    }
    let state = screen_state(&agent).await;
    assert_eq!(state["refusal"][0], "too-many", "{state}");
    assert!(state["refusal"][1].as_u64().unwrap() > 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_screen_answers_its_own_computer_only() {
    let box_1 = Box1::open().await;
    let agent = box_1.stand_by(&[]).await;
    let page = reqwest::get(agent.screen("/")).await.unwrap();
    assert!(page.headers()["content-security-policy"].to_str().unwrap().contains("default-src 'none'"));
    assert!(page.text().await.unwrap().contains("box_screen/screen.js"));
    let client = reqwest::Client::new();
    let other_host = client.get(agent.screen("/state")).header("host", "evil.example").send().await.unwrap();
    assert_eq!(other_host.status(), StatusCode::FORBIDDEN);
    let start = client.post(agent.screen("/start"));
    let foreign = start.json(&json!({})).header("origin", "http://evil.example").send().await.unwrap();
    assert_eq!(foreign.status(), StatusCode::FORBIDDEN);
    let form = client.post(agent.screen("/start")).body("{}").send().await.unwrap();
    assert_eq!(form.status(), StatusCode::FORBIDDEN);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_clock_that_is_off_by_a_day_is_reported_and_recordings_get_the_right_time() {
    let box_1 = Box1::open().await;
    for offset_ms in [DAY_MS, -DAY_MS] {
        let _agent = box_1.stand_by(&["--clock-offset-ms", &offset_ms.to_string()]).await;
        let state = box_1.until(|state| state["clock"]["is_wrong"] == true).await;
        let measured_ms = state["clock"]["offset_ms"].as_i64().unwrap();
        assert!((measured_ms + offset_ms).abs() < 2000, "{state}");
        let ada = &box_1.centre.trainee;
        read(box_1.start(ada, json!({"task": "peg"})).await, StatusCode::OK).await;
        box_1.until(|state| state["recording"]["frames"].as_u64() > Some(5)).await;
        read(box_1.stop(ada).await, StatusCode::OK).await;
        let session = box_1.session().await;
        let recorded_ms = trocar::time::from_rfc3339(session["recorded_at"].as_str().unwrap()).unwrap();
        let created_ms = trocar::time::from_rfc3339(session["created_at"].as_str().unwrap()).unwrap();
        assert!((0..20_000).contains(&(created_ms - recorded_ms)), "{session}");
        assert_eq!(session["recorded_at_source"], "claimed");
        box_1.until(|state| state["spool"]["recordings"] == 0).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_camera_that_is_unplugged_is_reported_and_the_recording_goes_on_when_it_is_back() {
    let box_1 = Box1::with_clip(2).await;
    let _agent = box_1.stand_by(&[]).await;
    let ada = &box_1.centre.trainee;
    read(box_1.start(ada, json!({"task": "peg"})).await, StatusCode::OK).await;
    let (camera, away) = (box_1.computer.camera(), box_1.computer.camera().with_extension("away"));
    std::fs::rename(&camera, &away).unwrap();
    let unplugged = Instant::now();
    let missing = box_1.until(|state| state["camera"]["missing_s"].as_f64() > Some(1.5)).await;
    assert!(unplugged.elapsed() < Duration::from_secs(10));
    assert_eq!((&missing["camera"]["is_open"], missing["camera"]["why"].is_string()), (&json!(false), true));
    assert!(missing["recording"].is_object(), "it goes on: {missing}");
    std::fs::rename(&away, &camera).unwrap();
    let plugged_in = Instant::now();
    let frames = missing["recording"]["frames"].as_u64().unwrap();
    box_1.until(|state| state["recording"]["frames"].as_u64() > Some(frames + 10)).await;
    assert!(plugged_in.elapsed() < Duration::from_secs(10));
    read(box_1.stop(ada).await, StatusCode::OK).await;
    assert!(box_1.session().await["early_end"].is_null());
}

#[tokio::test(flavor = "multi_thread")]
async fn an_agent_that_is_killed_sends_the_rest_at_its_next_start_and_says_that_it_was_broken_off() {
    let box_1 = Box1::open().await;
    let agent = box_1.stand_by(&[]).await;
    read(box_1.start(&box_1.centre.trainee, json!({"task": "peg"})).await, StatusCode::OK).await;
    box_1.until(|state| state["recording"]["frames"].as_u64() > Some(30)).await;
    agent.kill();
    assert_eq!(box_1.computer.spooled(), 1);
    let _agent = box_1.stand_by(&[]).await;
    let session = box_1.session().await;
    assert_eq!(session["trainee"]["code"], "ada");
    assert_eq!(session["early_end"]["cause"], "sender_gone", "{session}");
    assert!(session["early_end"]["detail"].as_str().unwrap().contains("switched off"), "{session}");
    box_1.until(|state| state["spool"]["recordings"] == 0).await;
    assert_eq!(box_1.computer.spooled(), 0);
}

/// The recordings that wait for a name, once there are so many.
async fn waiting(box_1: &Box1, count: usize) -> Vec<Value> {
    let all = |list: &Value| list["items"].as_array().is_some_and(|items| items.len() == count);
    let list = box_1.centre.instructor.read_until("/api/v1/waiting-recordings", all).await;
    list["items"].as_array().unwrap().clone()
}

/// Number of pictures in the file of a recording that waits for a name, and how long it is, s.
async fn pictures(box_1: &Box1, waiting: &Value) -> (u64, f64) {
    let path = format!("/api/v1/waiting-recordings/{}/video", waiting["id"].as_str().unwrap());
    let video = box_1.centre.instructor.request(Method::GET, &path).send().await.unwrap();
    let bytes = std::io::Cursor::new(video.bytes().await.unwrap());
    let mut video = VideoFile::open(bytes, MediaLimits::default()).unwrap();
    let times: Vec<f64> =
        std::iter::from_fn(|| video.next_picture().unwrap()).map(|picture| picture.frame().time_s).collect();
    (times.len() as u64, times.last().unwrap() - times[0])
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_check_in_a_recording_waits_for_a_name() {
    let box_1 = Box1::open().await;
    let agent = box_1.stand_by(&["--clock-offset-ms", &DAY_MS.to_string()]).await;
    box_1.until(|state| state["clock"]["is_wrong"] == true).await;
    let (instructor, ada) = (&box_1.centre.instructor, &box_1.centre.trainee);
    assert_eq!(press(&agent, "/start", json!({})).await.status(), StatusCode::NO_CONTENT);
    let running = box_1.until(|state| state["recording"]["frames"].as_u64() > Some(25)).await;
    let recording = &running["recording"];
    assert_eq!((&recording["is_unnamed"], &recording["trainee"]), (&json!(true), &Value::Null), "{recording}");
    // A check-in during the recording would look as if it named it.
    problem(instructor.put("/api/v1/boxes/box-1/check-in", json!({"trainee": "ada"})).await, 409, "conflict").await;
    press(&agent, "/check-in", json!({"trainee": "ada", "pin": "2580"})).await;
    screen_until(&agent, |state| state["refusal"][0] == "recording").await;
    let refused = problem(box_1.stop(ada).await, 409, "conflict").await;
    assert!(refused["detail"].as_str().unwrap().contains("without a name"), "{refused}");
    read(box_1.stop(&box_1.centre.other_instructor).await, StatusCode::OK).await;
    screen_until(&agent, |state| state["last_unnamed"] == "waits").await;
    let first = waiting(&box_1, 1).await.remove(0);
    assert_eq!((&first["box"]["code"], &first["source"]), (&json!("box-1"), &json!("agent")), "{first}");
    assert_eq!((&first["trainee"], &first["task"]), (&Value::Null, &Value::Null));
    let time = |field: &str| trocar::time::from_rfc3339(first[field].as_str().unwrap()).unwrap();
    assert!((0..20_000).contains(&(time("arrived_at") - time("recorded_at"))), "the clock is off by a day: {first}");
    let (count, seconds) = pictures(&box_1, &first).await;
    assert!(count > 25 && (seconds - (count - 1) as f64 / 25.0).abs() < 0.01, "{count} pictures in {seconds} s");

    for (by, body, status) in [
        (ada, json!({"without_name": true}), 403),
        (instructor, json!({"without_name": true, "trainee": "ada"}), 422),
        (instructor, json!({"trainee": "ada"}), 422),
    ] {
        assert_eq!(box_1.start(by, body.clone()).await.status(), status, "{body}");
    }
    let started = box_1.start(instructor, json!({"without_name": true, "task": "peg"})).await;
    assert_eq!(read(started, StatusCode::OK).await["recording"]["task"]["code"], "peg");
    assert_eq!(ada.read(AGENT).await["recording"]["task"], Value::Null, "trainees do not see what it is");
    box_1.until(|state| state["recording"]["frames"].as_u64() > Some(5)).await;
    read(box_1.stop(instructor).await, StatusCode::OK).await;
    let second = waiting(&box_1, 2).await.into_iter().find(|one| one["id"] != first["id"]).unwrap();
    assert_eq!(second["task"]["code"], "peg");
    let named = json!({"items": [{"id": second["id"], "trainee": "ada"}]});
    let named = read(instructor.post("/api/v1/waiting-recordings/assign", named).await, StatusCode::OK).await;
    assert!(named["results"][0]["session"].is_string(), "{named}");
    let audit = box_1.centre.administrator.read("/api/v1/audit-entries?limit=20").await;
    let entries: Vec<(&str, &str)> = audit["items"].as_array().unwrap().iter().map(entry).collect();
    for wanted in [("start recording without a name", "box"), ("stop recording", "box")] {
        assert!(entries.contains(&wanted), "{wanted:?} in {entries:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_without_a_name_survives_a_power_cut_and_arrives_once() {
    let box_1 = Box1::open().await;
    let agent = box_1.stand_by(&[]).await;
    assert_eq!(press(&agent, "/start", json!({})).await.status(), StatusCode::NO_CONTENT);
    box_1.until(|state| state["recording"]["frames"].as_u64() > Some(50)).await;
    agent.kill();
    let copy = box_1.computer.spool().with_extension("copy");
    let spool = box_1.computer.spool();
    let cp = |from: &std::path::Path, to: &std::path::Path| {
        assert!(std::process::Command::new("cp").arg("-r").arg(from).arg(to).status().unwrap().success());
    };
    cp(&spool, &copy);
    let agent = box_1.stand_by(&[]).await;
    let arrived = waiting(&box_1, 1).await.remove(0);
    assert!(pictures(&box_1, &arrived).await.0 > 20, "at most the last second is lost");
    agent.kill();
    // The answer was lost: the agent sends the same recording again.
    std::fs::remove_dir_all(&spool).unwrap();
    cp(&copy, &spool);
    let _agent = box_1.stand_by(&[]).await;
    box_1.until(|state| state["spool"]["recordings"] == 0 && state["spool"]["refused"].is_null()).await;
    assert_eq!(waiting(&box_1, 1).await[0]["id"], arrived["id"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_without_a_name_that_fills_the_spool_ends_and_arrives_whole() {
    const SPOOL_BYTES: u64 = 1 << 20;
    let box_1 = Box1::open().await;
    let agent = box_1.stand_by(&["--spool-bytes", &SPOOL_BYTES.to_string()]).await;
    assert_eq!(press(&agent, "/start", json!({})).await.status(), StatusCode::NO_CONTENT);
    let ended = screen_until(&agent, |state| state["reached_limit"] == "space").await;
    assert_eq!(ended["state"]["recording"], Value::Null, "{ended}");
    screen_until(&agent, |state| state["last_unnamed"] == "waits").await;
    let arrived = waiting(&box_1, 1).await.remove(0);
    let bytes = arrived["bytes"].as_u64().unwrap();
    assert!((SPOOL_BYTES * 3 / 4..SPOOL_BYTES).contains(&bytes), "far more than half of the spool: {bytes}");
    let (count, seconds) = pictures(&box_1, &arrived).await;
    assert!((seconds - (count - 1) as f64 / 25.0).abs() < 0.01, "no frame was dropped: {count} in {seconds} s");
    box_1.until(|state| state["spool"]["recordings"] == 0 && state["spool"]["is_full"] == false).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_check_in_ends_at_once_with_the_consent_and_with_the_record() {
    let box_1 = Box1::open().await;
    let agent = box_1.stand_by(&[]).await;
    let (admin, ada) = (&box_1.centre.administrator, &box_1.centre.trainee);
    let text = json!({"en": {"title": "Recordings", "body": "We record you."}, "required_from": "2020-01-01"});
    let text = admin.make("/api/v1/consent-texts", text).await["id"].clone();
    let decide = async |decision: &str| {
        ada.make("/api/v1/trainees/ada/consents", json!({"text": text, "decision": decision})).await;
    };
    let check_in = async |trainee: &str| {
        let put = admin.put("/api/v1/boxes/box-1/check-in", json!({"trainee": trainee})).await;
        read(put, StatusCode::OK).await;
        screen_until(&agent, |state| state["checked_in"].is_object() && state["check_in_end"].is_null()).await;
    };
    let ended = async |why: &str| {
        assert_eq!(admin.read(AGENT).await["checked_in"], Value::Null, "at once");
        screen_until(&agent, |state| state["checked_in"].is_null() && state["check_in_end"] == why).await;
    };
    decide("given").await;
    check_in("ada").await;
    decide("withdrawn").await;
    ended("no-consent").await;
    // The pedal does not record the same person without a name; the button that says so does.
    let refused = press(&agent, "/start", json!({})).await;
    assert_eq!(refused.status(), StatusCode::CONFLICT);
    let why: Value = refused.json().await.unwrap();
    assert_eq!(why["kind"], "needs-button", "{why}");
    assert_eq!(press(&agent, "/start", json!({"without_name": true})).await.status(), StatusCode::NO_CONTENT);
    assert_eq!(screen_state(&agent).await["needs_unnamed_button"], false);
    assert_eq!(press(&agent, "/stop", json!({})).await.status(), StatusCode::NO_CONTENT);
    // An agent that had no connection when the check-in ended hears of it at its next one.
    decide("given").await;
    box_1.until(|state| state["recording"].is_null()).await;
    check_in("ada").await;
    agent.kill();
    decide("withdrawn").await;
    let agent = box_1.stand_by(&[]).await;
    screen_until(&agent, |state| state["needs_unnamed_button"] == true && state["check_in_end"] == "no-consent").await;
    decide("given").await;
    let check_in = async |trainee: &str| {
        let put = admin.put("/api/v1/boxes/box-1/check-in", json!({"trainee": trainee})).await;
        read(put, StatusCode::OK).await;
        screen_until(&agent, |state| state["checked_in"].is_object() && state["check_in_end"].is_null()).await;
        assert_eq!(screen_state(&agent).await["needs_unnamed_button"], false);
    };
    let ended = async |why: &str| {
        assert_eq!(admin.read(AGENT).await["checked_in"], Value::Null, "at once");
        screen_until(&agent, |state| state["checked_in"].is_null() && state["check_in_end"] == why).await;
    };
    check_in("ada").await;
    let other = admin.make("/api/v1/trainees", json!({"name": "Ada N", "code": "ada-n"})).await;
    let merged = json!({"trainee": "ada", "why": "one person"});
    read(
        admin.post(&format!("/api/v1/trainees/{}/merges", other["id"].as_str().unwrap()), merged).await,
        StatusCode::CREATED,
    )
    .await;
    ended("no-record").await;
    check_in("ada-n").await;
    assert_eq!(admin.delete("/api/v1/trainees/ada-n").await.status(), StatusCode::NO_CONTENT);
    ended("no-record").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_check_in_with_the_phone_that_is_refused_for_missing_consent_reaches_the_box() {
    let box_1 = Box1::open_for_phones().await;
    let agent = box_1.stand_by(&[]).await;
    let (admin, ada) = (&box_1.centre.administrator, &box_1.centre.trainee);
    let text = json!({"en": {"title": "Recordings", "body": "We record you."}, "required_from": "2020-01-01"});
    let text = admin.make("/api/v1/consent-texts", text).await["id"].clone();
    let next_code = async |last: &str| {
        let next = |state: &Value| state["check_in_address"].as_str().is_some_and(|next| !next.ends_with(last));
        let state = screen_until(&agent, next).await;
        state["check_in_address"].as_str().unwrap().split_once('#').unwrap().1.to_owned()
    };
    let code = next_code("#none").await;
    let put = async |code: &str| ada.put("/api/v1/boxes/box-1/check-in", json!({"code": code})).await;
    problem(put("nonsense").await, 403, "consent-missing").await;
    assert_eq!(screen_state(&agent).await["is_phone_refused"], false, "the person may be elsewhere");
    problem(put(&code).await, 403, "consent-missing").await;
    let state = screen_until(&agent, |state| state["is_phone_refused"] == true).await;
    assert_eq!((&state["needs_unnamed_button"], &state["checked_in"]), (&json!(true), &Value::Null));
    let refused = press(&agent, "/start", json!({})).await;
    assert_eq!(refused.status(), StatusCode::CONFLICT);
    assert_eq!(refused.json::<Value>().await.unwrap()["kind"], "needs-button");
    assert_eq!(screen_state(&agent).await["state"]["recording"], Value::Null);
    // An agent that starts again hears of it, and the code was used up.
    let state_of = |state: &Value| (state["is_phone_refused"].clone(), state["needs_unnamed_button"].clone());
    ada.make("/api/v1/trainees/ada/consents", json!({"text": text, "decision": "given"})).await;
    problem(put(&code).await, 422, "invalid").await;
    agent.kill();
    let agent = box_1.stand_by(&[]).await;
    screen_until(&agent, |state| state_of(state) == (json!(true), json!(true))).await;
    let state = screen_until(&agent, |state| state["check_in_address"].is_string()).await;
    let code = state["check_in_address"].as_str().unwrap().split_once('#').unwrap().1.to_owned();
    read(put(&code).await, StatusCode::OK).await;
    let state = screen_until(&agent, |state| state["checked_in"].is_object()).await;
    assert_eq!(state_of(&state), (json!(false), json!(false)));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_that_phones_cannot_open_shows_no_code_and_says_so() {
    let box_1 = Box1::open().await;
    let agent = box_1.stand_by(&["--language", "de"]).await;
    let server = format!("http://{}", box_1.centre.service.address());
    let state = screen_until(&agent, |state| !state["unreachable_server"].is_null()).await;
    assert_eq!((&state["unreachable_server"], &state["check_in_address"]), (&json!(server), &Value::Null));
    let seen = box_1.centre.instructor.read(AGENT).await;
    assert_eq!(seen["unreachable_server"], server, "{seen}");
    let page = reqwest::get(agent.screen("/")).await.unwrap().text().await.unwrap();
    assert!(page.contains("data-language=\"de\""), "{page}");
    assert_eq!(seen["spool"]["is_full"], false);
}
