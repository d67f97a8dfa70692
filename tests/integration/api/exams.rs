//! Exams: planned, started by an examiner, recorded live, judged once by the fixed standard, closed; what the candidate sees
//! meanwhile, and what can never be changed.

use std::collections::BTreeSet;
use std::io::{Cursor, Read};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

use reqwest::{Method, StatusCode};
use serde_json::{Value, json};
use trocar::domain::session::FeatureRow;

use super::centre::{Centre, recording, send};
use crate::box_agent::BoxComputer;
use crate::feed::sender;
use crate::planted::{NEW_YEAR_MS, Planter, duration, plant_self_test};
use crate::process::program;
use crate::support::{Client, poll_json, problem, read};

pub(super) const EXAMS: &str = "/api/v1/exams";
/// A value that is nowhere else in the centre.
pub(super) const MARKER: f64 = 41.375;

/// A centre with a standard of the task `peg`, and a box that passed its self-test.
pub(super) struct ExamCentre {
    pub centre: Centre,
    pub planter: Planter,
    /// Frames of the next recording: each has another number, since the same recording is no second attempt.
    frames: AtomicU64,
}

impl ExamCentre {
    pub async fn open() -> Self {
        let this = Self::untested().await;
        this.self_test("green").await;
        this
    }

    pub async fn untested() -> Self {
        let centre = Centre::open().await;
        set_limit(&centre, 50.5).await;
        let mut planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
        planter.duration_s = 0.2; // shorter than any recording lasts
        Self { centre, planter, frames: AtomicU64::new(4) }
    }

    pub fn database(&self) -> PathBuf {
        self.centre.service.data.path().join("trocar.db")
    }

    pub async fn self_test(&self, light: &str) {
        plant_self_test(&self.database(), "box-1", light).await;
    }

    pub async fn plan(&self, attempts: u32) -> String {
        let new = json!({"trainee": "ada", "task": "peg", "box": "box-1", "attempts": attempts});
        address(&self.centre.instructor.make(EXAMS, new).await)
    }

    pub async fn start(&self, exam: &str) -> Value {
        let start = self.centre.instructor.post(&format!("{exam}/start"), json!({"identity": "badge"})).await;
        read(start, StatusCode::OK).await
    }

    pub async fn running(&self, attempts: u32) -> String {
        let exam = self.plan(attempts).await;
        self.start(&exam).await;
        exam
    }

    pub async fn order(&self, exam: &str) -> String {
        let made = self.centre.instructor.make(&format!("{exam}/attempts"), json!({"way": "browser"})).await;
        made["recording"].as_str().unwrap().to_owned()
    }

    /// Records an attempt that is not scored yet. Returns its session.
    pub async fn record(&self, exam: &str) -> String {
        let ordered = self.order(exam).await;
        let (mut sender, _) = sender::begin(&self.centre.service, &self.centre.agent, &ordered).await;
        let frames = self.frames.fetch_add(1, Ordering::Relaxed);
        sender.send_frames(0..frames).await;
        sender.end(frames).await
    }

    /// The same, scored with these features.
    pub async fn attempt(&self, exam: &str, features: Vec<FeatureRow>) -> String {
        let session = self.record(exam).await;
        self.planter.finish_next(features).await;
        session
    }

    /// Says of an attempt whether it was completed.
    pub async fn say(&self, exam: &str, number: u32, completion: &str) -> reqwest::Response {
        let said = json!({"completion": completion});
        let request = self.centre.instructor.request(Method::PUT, &format!("{exam}/attempts/{number}/completion"));
        request.json(&said).send().await.unwrap()
    }

    /// Says that each attempt was completed, unless it was said of it, and closes the exam.
    pub async fn close(&self, exam: &str) -> Value {
        let attempts = self.centre.instructor.read(exam).await["attempts"].clone();
        for attempt in attempts.as_array().unwrap() {
            if attempt["voided_at"].is_null() && attempt["completion"].is_null() {
                let number = u32::try_from(attempt["number"].as_u64().unwrap()).unwrap();
                read(self.say(exam, number, "completed").await, StatusCode::OK).await;
            }
        }
        let closed = self.centre.instructor.request(Method::POST, &format!("{exam}/close")).send().await.unwrap();
        read(closed, StatusCode::OK).await
    }

    pub async fn try_close(&self, exam: &str) -> reqwest::Response {
        self.centre.instructor.request(Method::POST, &format!("{exam}/close")).send().await.unwrap()
    }
}

async fn set_limit(centre: &Centre, limit: f64) {
    let by = json!({"method": "fixed", "limit": limit, "unit": "s"});
    let standard = json!({"targets": [{"feature": "duration", "by": by}], "rule": {"in_a_row": 2, "then_more": 0},
        "valid_from": "now"});
    centre.administrator.make("/api/v1/tasks/peg/standards", standard).await;
}

fn address(exam: &Value) -> String {
    format!("{EXAMS}/{}", exam["id"].as_str().unwrap())
}

pub(super) fn detail(of: &Value) -> &str {
    of["detail"].as_str().unwrap()
}

pub(super) async fn post(client: &Client, path: &str) -> reqwest::Response {
    client.request(Method::POST, path).send().await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn an_exam_is_planned_started_recorded_closed_and_certified() {
    let of = ExamCentre::open().await;
    let (centre, instructor) = (&of.centre, &of.centre.instructor);
    let exam = of.plan(2).await;
    set_limit(centre, 10.0).await; // a later version does not judge it
    let planned = instructor.read(&exam).await;
    assert_eq!((&planned["state"], &planned["standard_version"]), (&json!("planned"), &json!(1)), "{planned}");
    assert_eq!(planned["box_check"]["is_ready"], true, "{planned}");
    problem(instructor.post(&format!("{exam}/attempts"), json!({"way": "browser"})).await, 409, "conflict").await;
    let started = of.start(&exam).await;
    assert_eq!((&started["examiner"], &started["identity"]), (&json!("ines"), &json!("badge")));

    of.attempt(&exam, vec![duration(60.0, 1.0)]).await;
    let session = of.attempt(&exam, vec![duration(MARKER, 1.0)]).await;
    let judged = instructor.read(&exam).await;
    let outcomes: Vec<&Value> = judged["attempts"].as_array().unwrap().iter().map(|one| &one["outcome"]).collect();
    assert_eq!(outcomes, [&json!("not_passed"), &json!("passed")], "{judged}");
    let figure = &judged["attempts"][1]["figures"][0];
    assert_eq!(
        (&figure["limit"], &figure["value"], &figure["judgement"]),
        (&json!(50.5), &json!(MARKER), &json!("pass"))
    );
    let supervised = instructor.read(&format!("/api/v1/sessions/{session}")).await;
    assert_eq!((&supervised["supervised_by"], &supervised["exam"]["attempt"]), (&json!("ines"), &json!(2)));
    let more = problem(instructor.post(&format!("{exam}/attempts"), json!({"way": "browser"})).await, 409, "conflict");
    assert!(detail(&more.await).contains("All attempts"));

    let closed = of.close(&exam).await;
    assert_eq!((&closed["result"], &closed["attempts_used"]), (&json!("passed"), &json!(2)));
    problem(of.try_close(&exam).await, 409, "conflict").await;
    let seen = centre.trainee.read(&exam).await;
    assert_eq!((&seen["result"], &seen["attempts"]), (&json!("passed"), &closed["attempts"]));
    let made =
        instructor.make(&format!("{exam}/certificates"), json!({"language": "en", "accept_local_address": true})).await;
    let content = &made["content"];
    assert_eq!((&content["basis"], &content["format"]), (&json!("exam"), &json!(2)));
    let said = json!({"held_on": content["issued_on"], "examiner": "ines", "identity": "badge", "attempts_used": 2,
        "attempts_allowed": 2});
    assert_eq!(content["exam"], said);
    assert_eq!((&content["standard"]["version"], &content["sessions"][0]["number"]), (&json!(1), &json!(2)));
    let twice =
        instructor.post(&format!("{exam}/certificates"), json!({"language": "en", "accept_local_address": true})).await;
    problem(twice, 409, "conflict").await;
    let check = format!("/api/v1/certificate-checks/{}", content["code"].as_str().unwrap());
    let public = centre.service.stranger().read(&check).await;
    assert_eq!((&public["content"], &public["state"]), (content, &json!("valid")));
    verify_says_so(&of, &made, "2 of 2 used").await;

    let audit = centre.administrator.read("/api/v1/audit-entries?limit=40").await;
    let actions: BTreeSet<&str> = audit["items"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|entry| entry["noun"] == "exam")
        .map(|entry| entry["action"].as_str().unwrap())
        .collect();
    let expected = ["plan", "start", "record attempt", "begin attempt", "attempt completed", "close"];
    assert_eq!(actions, BTreeSet::from(expected));
}

async fn verify_says_so(of: &ExamCentre, certificate: &Value, used: &str) {
    let pdf = format!("/api/v1/certificates/{}/pdf", certificate["id"].as_str().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("certificate.pdf");
    std::fs::write(&file, of.centre.trainee.get(&pdf).await.bytes().await.unwrap()).unwrap();
    let data = of.centre.service.data.path();
    let output = program().arg("verify").arg(&file).arg("--data").arg(data).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    for line in ["passed an exam", "by ines", "badge with a photo", used, "Genuine and valid"] {
        assert!(said.contains(line), "{line} in {said}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_planned_or_started_is_refused_with_a_sentence() {
    let of = ExamCentre::untested().await;
    let (administrator, instructor) = (&of.centre.administrator, &of.centre.instructor);
    let new = json!({"trainee": "ada", "task": "peg", "box": "box-1", "attempts": 1});
    let with = |key: &str, value: Value| {
        let mut new = new.clone();
        new[key] = value;
        new
    };
    for attempts in [0, 4] {
        let refused = problem(instructor.post(EXAMS, with("attempts", json!(attempts))).await, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], "attempts");
    }
    problem(instructor.post(EXAMS, with("trainee", json!("bob"))).await, 422, "unknown-reference").await;
    problem(instructor.post(EXAMS, with("day", json!("tomorrow"))).await, 422, "invalid").await;
    administrator.make("/api/v1/tasks", json!({"name": "Cutting", "code": "cut"})).await;
    let refused = problem(instructor.post(EXAMS, with("task", json!("cut"))).await, 409, "conflict").await;
    assert!(detail(&refused).contains("no standard"), "{refused}");

    let exam = of.plan(1).await;
    let start = async || instructor.post(&format!("{exam}/start"), json!({"identity": "known"})).await;
    assert_eq!(problem(start().await, 409, "conflict").await["box_problems"], json!(["not_tested_today"]));
    of.self_test("red").await;
    assert_eq!(problem(start().await, 409, "conflict").await["box_problems"], json!(["not_passed"]));
    of.self_test("yellow").await;
    let camera = json!({"width": 640, "height": 480, "fx": 501, "fy": 501, "cx": 320, "cy": 240});
    administrator.put("/api/v1/boxes/box-1/camera", camera).await;
    assert_eq!(problem(start().await, 409, "conflict").await["box_problems"], json!(["changed_since"]));
    of.self_test("yellow").await;
    let second = of.plan(1).await;
    read(start().await, StatusCode::OK).await;
    let again = instructor.post(&format!("{second}/start"), json!({"identity": "known"})).await;
    assert!(detail(&problem(again, 409, "conflict").await).contains("this trainee is running"));
    let of_bob = administrator.make(EXAMS, with("trainee", json!("bob"))).await;
    let again = administrator.post(&format!("{}/start", address(&of_bob)), json!({"identity": "known"})).await;
    assert!(detail(&problem(again, 409, "conflict").await).contains("in this box"));
    problem(of.try_close(&exam).await, 409, "conflict").await; // no attempt
    assert_eq!(post(instructor, &format!("{exam}/cancel")).await.status(), StatusCode::NO_CONTENT);
    assert_eq!(post(instructor, &format!("{exam}/cancel")).await.status(), StatusCode::NO_CONTENT);
    let listed = of.centre.trainee.read("/api/v1/exams?state=cancelled").await;
    assert_eq!(listed["items"].as_array().unwrap().len(), 1);
    assert_eq!(of.centre.other_trainee.read(EXAMS).await["items"].as_array().unwrap().len(), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn only_an_ordered_live_recording_is_an_attempt() {
    let of = ExamCentre::open().await;
    let centre = &of.centre;
    let exam = of.running(2).await;
    send(&centre.instructor, "ada", recording(100, 1)).await; // a file is none
    assert_eq!(centre.instructor.read(&exam).await["attempts_used"], 0);
    let (first, second) = (of.order(&exam).await, of.order(&exam).await);
    let refusal = async |client: &Client, recording: &str, trainee: &str| {
        let mut hello = sender::hello(recording);
        hello["trainee"] = json!(trainee);
        let mut sender = sender::open(&centre.service, client.headers(), "box-1").await.unwrap();
        sender.send_json(&hello).await;
        sender.close_code().await
    };
    assert_eq!(refusal(&centre.agent, &first, "ada").await, 4404, "a later order replaced it");
    assert_eq!(refusal(&centre.agent, &second, "bob").await, 4404, "of another person");
    assert_eq!(refusal(&centre.trainee, &second, "ada").await, 4404, "sent by the candidate");
    let (mut running, _) = sender::begin(&centre.service, &centre.agent, &second).await;
    assert_eq!(centre.instructor.read(&exam).await["attempts"][0]["state"], "recording");
    let order = json!({"way": "browser"});
    problem(centre.instructor.post(&format!("{exam}/attempts"), order.clone()).await, 409, "conflict").await;
    problem(post(&centre.instructor, &format!("{exam}/cancel")).await, 409, "conflict").await;
    running.send_frames(0..4).await;
    running.end(4).await;
    of.planter.fail_next().await; // the file that was sent before
    of.planter.fail_next().await;
    assert_eq!(centre.instructor.read(&exam).await["attempts"][0]["outcome"], "failed");
    let silent = centre.instructor.post(&format!("{exam}/attempts"), json!({"way": "agent"})).await;
    assert!(detail(&problem(silent, 409, "conflict").await).contains("silent"));
    let late = of.order(&exam).await;
    let waiting = centre.instructor.read(&exam).await["waiting"].clone();
    let may_begin: Vec<&Value> = waiting.as_array().unwrap().iter().map(|one| &one["may_begin"]).collect();
    assert_eq!(may_begin, [true, false], "{waiting}");
    assert_eq!(of.close(&exam).await["result"], "undecided");
    assert_eq!(refusal(&centre.agent, &late, "ada").await, 4404, "the exam is closed");
}

#[tokio::test(flavor = "multi_thread")]
async fn doubt_never_passes_and_a_judgement_stays() {
    let mut of = ExamCentre::open().await;
    let exam = of.running(3).await;
    of.attempt(&exam, vec![duration(50.0, 1.0)]).await; // the limit lies within the error bar
    let session = of.record(&exam).await;
    problem(of.try_close(&exam).await, 409, "conflict").await; // not judged yet
    of.planter.finish_next_as(vec![duration(40.0, 1.0)], "refused").await;
    of.planter.duration_s = 600.0;
    of.attempt(&exam, vec![duration(40.0, 1.0)]).await; // longer than the time since its order
    let judged = of.centre.instructor.read(&exam).await;
    let said: Vec<(&Value, &Value)> =
        judged["attempts"].as_array().unwrap().iter().map(|one| (&one["outcome"], &one["cause"])).collect();
    let (undecided, refused) = (json!("undecided"), json!("refused"));
    assert_eq!(said, [(&undecided, &json!("error_bar")), (&refused, &Value::Null), (&undecided, &json!("not_live"))]);
    let of_all = json!({"from": "trajectory", "which": "all"});
    of.centre.administrator.make("/api/v1/tasks/peg/rescorings", of_all).await;
    for _ in 0..3 {
        of.planter.rescore("a later version", |_| duration(20.0, 1.0)).await;
    }
    let result = of.centre.instructor.read(&format!("/api/v1/sessions/{session}")).await;
    assert_eq!(result["features"][0]["value"], 20.0, "{result}");
    let mut closed = of.close(&exam).await;
    for attempt in closed["attempts"].as_array_mut().unwrap() {
        attempt["completion"] = Value::Null; // the only change since
    }
    assert_eq!((&closed["attempts"], &closed["result"]), (&judged["attempts"], &undecided));
    let certificate = of
        .centre
        .instructor
        .post(&format!("{exam}/certificates"), json!({"language": "en", "accept_local_address": true}))
        .await;
    problem(certificate, 409, "conflict").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_administrator_gives_an_attempt_back_after_a_failure() {
    let of = ExamCentre::open().await;
    let exam = of.running(1).await;
    let voided = of.attempt(&exam, vec![duration(60.0, 1.0)]).await;
    let (path, why) = (format!("{exam}/attempts/1/void"), json!({"reason": "The lamp failed."}));
    problem(of.centre.instructor.post(&path, why.clone()).await, 403, "forbidden").await;
    let administrator = &of.centre.administrator;
    problem(administrator.post(&format!("{exam}/attempts/2/void"), why.clone()).await, 404, "not-found").await;
    problem(administrator.post(&path, json!({"reason": ""})).await, 422, "invalid").await;
    let given_back = read(administrator.post(&path, why.clone()).await, StatusCode::OK).await;
    assert_eq!((&given_back["attempts_used"], &given_back["attempts"][0]["void_reason"]), (&json!(0), &why["reason"]));
    problem(administrator.post(&path, why.clone()).await, 409, "conflict").await;
    of.attempt(&exam, vec![duration(40.0, 1.0)]).await;
    let closed = of.close(&exam).await;
    assert_eq!((&closed["result"], &closed["attempts_used"]), (&json!("passed"), &json!(1)));
    let made = of
        .centre
        .instructor
        .make(&format!("{exam}/certificates"), json!({"language": "en", "accept_local_address": true}))
        .await;
    let said = (&made["content"]["exam"]["attempts_used"], &made["content"]["sessions"][0]["number"]);
    assert_eq!(said, (&json!(1), &json!(2)), "numbered in the order of beginning");
    verify_says_so(&of, &made, "1 of 1 used, attempt 1 declared void").await;
    let audit = administrator.read("/api/v1/audit-entries?limit=40").await;
    let entries = audit["items"].as_array().unwrap();
    let of_void = entries.iter().find(|entry| entry["action"] == "void attempt").unwrap();
    assert_eq!(of_void["why"], why["reason"]);
    problem(administrator.post(&format!("{exam}/attempts/2/void"), why).await, 409, "conflict").await;
    let seen = of.centre.trainee.read(&exam).await;
    assert_eq!(seen["attempts"][0]["void_reason"], Value::Null);
    let progress = of.centre.administrator.read("/api/v1/trainees/ada/progress?task=peg").await;
    let trials: Vec<(&Value, bool)> = progress["sessions"]
        .as_array()
        .unwrap()
        .iter()
        .map(|step| (&step["trial"], step["id"] == voided.as_str()))
        .collect();
    assert_eq!(trials.len(), 2, "{progress}");
    assert!(trials.iter().all(|(trial, is_voided)| *is_voided == (**trial != json!("passed"))), "{progress}");
}

/// The answer to a request for the live view.
async fn live_status(client: &Client, session: &str) -> StatusCode {
    let live = client.request(Method::GET, &format!("/api/v1/sessions/{session}/live"));
    let live =
        live.header("connection", "upgrade").header("upgrade", "websocket").header("sec-websocket-version", "13");
    live.header("sec-websocket-key", "dGhlIHNhbXBsZSBub25jZQ==").send().await.unwrap().status()
}

/// The bodies that a client reads, unpacked if they are an export.
pub(super) async fn answer_text(client: &Client, path: &str) -> (StatusCode, String) {
    let answer = client.get(path).await;
    let status = answer.status();
    let bytes = answer.bytes().await.unwrap();
    let Ok(mut archive) = zip::ZipArchive::new(Cursor::new(bytes.to_vec())) else {
        return (status, String::from_utf8_lossy(&bytes).into_owned());
    };
    let mut text = String::new();
    for at in 0..archive.len() {
        let mut entry = archive.by_index(at).unwrap();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        text.push_str(&format!("{}\n{}\n", entry.name().unwrap(), String::from_utf8_lossy(&bytes)));
    }
    (status, text)
}

/// Every GET route, with what its parameters stand for.
async fn all_addresses(centre: &Centre, exam: &str, session: &str) -> Vec<String> {
    let document = centre.administrator.read("/api/v1/openapi.json").await;
    let job = centre.administrator.read(&format!("/api/v1/sessions/{session}")).await;
    assert_eq!(job["status"], "done");
    let jobs = centre.administrator.read("/api/v1/jobs?limit=200").await;
    let job = jobs["items"].as_array().unwrap().iter().find(|job| job["session"] == session).unwrap();
    let job = job["id"].as_str().unwrap();
    let mut found = Vec::new();
    for (path, methods) in document["paths"].as_object().unwrap() {
        let streams = ["/events", "/live", "/feed", "/agent-connection"];
        if methods["get"].is_null() || streams.iter().any(|end| path.ends_with(end)) || path.contains("/uploads") {
            continue;
        }
        let id = match path.split('/').nth(3).unwrap_or_default() {
            "sessions" => session,
            "trainees" => "ada",
            "tasks" => "peg",
            "boxes" => "box-1",
            "jobs" => job,
            "exams" => exam.rsplit('/').next().unwrap(),
            _ => "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44",
        };
        found.push(path.replace("{id}", id).replace("{version}", "1"));
    }
    for query in [
        "/api/v1/trainees/ada/progress?task=peg",
        "/api/v1/trainees/ada/progress?task=peg&feature=duration",
        "/api/v1/sessions?order=recorded",
        "/api/v1/sessions?status=done",
        "/api/v1/sessions?outcome=passed",
        "/api/v1/sessions?trainee=ada&task=peg",
        "/api/v1/session-count?task=peg",
        "/api/v1/tasks/peg/distribution?feature=duration",
        "/api/v1/jobs?limit=200",
        "/api/v1/trainees/ada/data.zip?videos=true",
    ] {
        found.push(query.to_owned());
    }
    assert!(found.len() > 60, "{found:?}");
    found
}

#[tokio::test(flavor = "multi_thread")]
async fn no_route_shows_a_trainee_a_figure_before_the_exam_is_closed() {
    let of = ExamCentre::open().await;
    let centre = &of.centre;
    let ada = of.planter.trainee("ada").await;
    of.planter.session(ada, NEW_YEAR_MS, vec![duration(47.0, 1.0)]).await;
    let count = async |client: &Client| client.read("/api/v1/session-count").await["all"].clone();
    let before = count(&centre.trainee).await;
    let exam = of.running(2).await;
    let session = of.attempt(&exam, vec![duration(MARKER, 1.0)]).await;
    let marker = MARKER.to_string();
    for path in all_addresses(centre, &exam, &session).await {
        for client in [&centre.trainee, &centre.other_trainee] {
            let (status, text) = answer_text(client, &path).await;
            assert!(!text.contains(&marker), "{path} shows the figure: {status} {text}");
            assert!(!text.contains(&session), "{path} names the session: {status} {text}");
            if path.starts_with(&format!("/api/v1/sessions/{session}")) {
                assert_eq!(status, StatusCode::NOT_FOUND, "{path}");
            }
        }
    }
    let (_, seen_by_staff) = answer_text(&centre.instructor, &format!("/api/v1/sessions/{session}")).await;
    assert!(seen_by_staff.contains(&marker), "the test looks for the right text");
    assert_eq!(count(&centre.trainee).await, before);
    let sealed = centre.trainee.read(&exam).await;
    let attempt = &sealed["attempts"][0];
    assert_eq!(
        (&attempt["state"], &attempt["outcome"], &attempt["session"]),
        (&json!("sealed"), &Value::Null, &Value::Null)
    );
    assert_eq!(live_status(&centre.trainee, &session).await, StatusCode::NOT_FOUND);
    // It counts nowhere for anyone meanwhile.
    let progress = centre.administrator.read("/api/v1/trainees/ada/progress?task=peg").await;
    assert_eq!(progress["sessions"].as_array().unwrap().len(), 1, "{progress}");

    of.close(&exam).await;
    let seen = centre.trainee.read(&format!("/api/v1/sessions/{session}")).await;
    assert_eq!(seen["features"][0]["value"], MARKER);
    let progress = centre.trainee.read("/api/v1/trainees/ada/progress?task=peg").await;
    assert_eq!(progress["sessions"].as_array().unwrap().len(), 2, "{progress}");
    assert!(answer_text(&centre.trainee, "/api/v1/trainees/ada/data.zip").await.1.contains(&marker));
    let events = answer_text(&centre.other_trainee, &exam).await;
    assert_eq!(events.0, StatusCode::NOT_FOUND);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_that_arrives_is_sealed_from_its_first_frame() {
    let of = ExamCentre::open().await;
    let (centre, exam) = (&of.centre, of.running(1).await);
    let ordered = of.order(&exam).await;
    let (mut sender, welcome) = sender::begin(&centre.service, &centre.agent, &ordered).await;
    sender.send_frames(0..4).await;
    let session = welcome["session"].as_str().unwrap();
    assert_eq!(live_status(&centre.trainee, session).await, StatusCode::NOT_FOUND);
    for noun in ["", "/features", "/edits"] {
        let path = format!("/api/v1/sessions/{session}{noun}");
        assert_eq!(centre.trainee.get(&path).await.status(), StatusCode::NOT_FOUND, "{path}");
    }
    problem(centre.trainee.delete(&format!("/api/v1/sessions/{session}")).await, 404, "not-found").await;
    problem(post(&centre.trainee, &format!("/api/v1/sessions/{session}/end")).await, 404, "not-found").await;
    problem(centre.instructor.delete(&format!("/api/v1/sessions/{session}")).await, 409, "exam-session").await;
    let listed = centre.trainee.read("/api/v1/sessions").await;
    assert_eq!(listed["items"], json!([]));
    sender.end(4).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_of_an_exam_can_be_edited_and_the_person_can_be_erased() {
    let of = ExamCentre::open().await;
    let (centre, administrator) = (&of.centre, &of.centre.administrator);
    let exam = of.running(1).await;
    let session = of.attempt(&exam, vec![duration(40.0, 1.0)]).await;
    for is_closed in [false, true] {
        if is_closed {
            of.close(&exam).await;
        }
        let path = format!("/api/v1/sessions/{session}");
        let requests = [
            (Method::POST, "/moves", json!({"trainee": "bob", "why": "Wrong."})),
            (Method::POST, "/edits", json!({"kind": "set_aside", "why": "Wrong."})),
            (Method::POST, "/edits", json!({"kind": "other_box", "why": "Wrong."})),
            (Method::PUT, "/supervision", json!({"supervised": false})),
            (Method::DELETE, "", json!({})),
        ];
        for (method, noun, body) in requests {
            let request = administrator.request(method.clone(), &format!("{path}{noun}")).json(&body);
            let refused = problem(request.send().await.unwrap(), 409, "exam-session").await;
            assert!(detail(&refused).contains("exam"), "{method} {noun}: {refused}");
        }
        let moves = administrator.read(&format!("{path}/moves")).await;
        assert_eq!(moves["items"], json!([]));
    }
    let items = [json!({"item": "depth_perception", "mark": 1})];
    let _ = administrator
        .post(&format!("/api/v1/sessions/{session}/ratings"), json!({"form": "goals", "items": items}))
        .await;
    assert_eq!(centre.trainee.read(&exam).await["result"], "passed");
    let gone = administrator.delete("/api/v1/trainees/ada").await;
    assert_eq!(gone.status(), StatusCode::NO_CONTENT);
    assert_eq!(administrator.get(&exam).await.status(), StatusCode::NOT_FOUND);
    assert_eq!(administrator.read(EXAMS).await["items"], json!([]));
}

#[tokio::test(flavor = "multi_thread")]
async fn exams_follow_merged_records_unless_one_is_running() {
    let of = ExamCentre::open().await;
    let administrator = &of.centre.administrator;
    let exam = of.running(1).await;
    of.attempt(&exam, vec![duration(40.0, 1.0)]).await;
    let merge = json!({"trainee": "ada", "why": "Registered twice."});
    let refused =
        problem(administrator.post("/api/v1/trainees/bob/merges", merge.clone()).await, 409, "conflict").await;
    assert!(detail(&refused).contains("exam"), "{refused}");
    of.close(&exam).await;
    let made = administrator.make("/api/v1/trainees/bob/merges", merge).await;
    let moved = administrator.read(&exam).await;
    assert_eq!((&moved["trainee"]["code"], &moved["result"]), (&json!("bob"), &json!("passed")));
    let undo = format!("/api/v1/trainees/bob/merges/{}/separate", made["id"].as_str().unwrap());
    let separated = administrator.post(&undo, json!({"why": "Two people."})).await;
    assert!(separated.status().is_success(), "{}", separated.text().await.unwrap());
    assert_eq!(administrator.read(&exam).await["trainee"]["code"], "ada");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_box_records_an_attempt_and_its_screen_shows_no_result_before_the_end() {
    let mut of = ExamCentre::untested().await;
    let token = json!({"name": "box 1", "role": "agent", "box": "box-1"});
    let token = of.centre.administrator.make("/api/v1/tokens", token).await;
    let computer = BoxComputer::new(token["token"].as_str().unwrap(), 60);
    let camera = json!({"width": 320, "height": 240, "fx": 250, "fy": 250, "cx": 160, "cy": 120});
    of.centre.administrator.put("/api/v1/boxes/box-1/camera", camera).await;
    of.planter.take_current_set_up().await;
    of.self_test("green").await;
    let (centre, instructor) = (&of.centre, &of.centre.instructor);
    let agent = computer.stand_by(&format!("http://{}", centre.service.address()), &[]);
    instructor.read_until("/api/v1/boxes/box-1/agent", |state| state["camera"]["is_open"] == true).await;
    // Staff check the candidate in: the screen must not show what staff may see.
    read(instructor.put("/api/v1/boxes/box-1/check-in", json!({"trainee": "ada"})).await, StatusCode::OK).await;
    let exam = of.running(1).await;
    assert_eq!(instructor.read(&exam).await["has_agent"], true);
    instructor.make(&format!("{exam}/attempts"), json!({"way": "agent"})).await;
    let recorded = |exam: &Value| exam["attempts"][0]["session"].is_string();
    let session = instructor.read_until(&exam, recorded).await["attempts"][0]["session"].clone();
    let frames = |state: &Value| state["recording"]["frames"].as_u64().is_some_and(|frames| frames > 20);
    instructor.read_until("/api/v1/boxes/box-1/agent", frames).await;
    problem(post(&centre.trainee, "/api/v1/boxes/box-1/agent/stop").await, 409, "conflict").await;
    read(post(instructor, "/api/v1/boxes/box-1/agent/stop").await, StatusCode::OK).await;
    instructor.read_until(&exam, |exam| exam["attempts"][0]["state"] == "scoring").await;
    of.planter.finish_next(vec![duration(MARKER, 1.0)]).await;
    assert_eq!(instructor.read(&exam).await["attempts"][0]["outcome"], "passed");
    let screen = async || reqwest::get(agent.screen("/state")).await.unwrap().json::<Value>().await.unwrap();
    let idle = poll_json("the screen", screen, |state| state["state"]["recording"].is_null()).await;
    assert_eq!((&idle["checked_in"]["trainee"]["name"], &idle["checked_in"]["last"]), (&json!("ada"), &Value::Null));
    of.close(&exam).await;
    let last = poll_json("the screen", screen, |state| state["checked_in"]["last"]["status"] == "done").await;
    assert_eq!(last["checked_in"]["last"]["session"], session);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_broken_off_or_interrupted_attempt_is_never_passed() {
    let of = ExamCentre::open().await;
    let instructor = &of.centre.instructor;
    let exam = of.running(2).await;
    let ordered = of.order(&exam).await;
    let (mut sender, welcome) = sender::begin(&of.centre.service, &of.centre.agent, &ordered).await;
    sender.send_frames(0..3).await;
    sender.wait_for_ack(json!([[0, 2]])).await;
    drop(sender); // staff end it from elsewhere
    let end = format!("/api/v1/sessions/{}/end", welcome["session"].as_str().unwrap());
    poll_json("the end", async || json!(post(instructor, &end).await.status().as_u16()), |status| *status == 200).await;
    instructor.read_until(&exam, |exam| exam["attempts"][0]["state"] == "scoring").await;
    of.planter.finish_next(vec![duration(20.0, 1.0)]).await;
    let judged = instructor.read(&exam).await;
    let first = &judged["attempts"][0];
    assert_eq!((&first["outcome"], &first["cause"]), (&json!("undecided"), &json!("interrupted")), "{judged}");

    of.attempt(&exam, vec![duration(20.0, 1.0)]).await; // stopped in the usual way before the task was done
    let unsaid = problem(of.try_close(&exam).await, 409, "conflict").await;
    assert!(detail(&unsaid).contains("completed or broken off"), "{unsaid}");
    problem(of.say(&exam, 3, "completed").await, 404, "not-found").await;
    problem(of.say(&exam, 2, "perhaps").await, 422, "invalid").await;
    read(of.say(&exam, 2, "completed").await, StatusCode::OK).await;
    let said = read(of.say(&exam, 2, "broken_off").await, StatusCode::OK).await;
    assert_eq!(
        (&said["attempts"][1]["outcome"], &said["attempts"][1]["completion"]),
        (&json!("passed"), &json!("broken_off"))
    );
    assert_eq!(of.centre.trainee.read(&exam).await["attempts"][1]["completion"], Value::Null);
    let closed = of.close(&exam).await;
    assert_eq!(closed["result"], "not_passed", "the interrupted attempt is used without a pass");
    problem(of.say(&exam, 2, "completed").await, 409, "conflict").await;
    let certificate =
        instructor.post(&format!("{exam}/certificates"), json!({"language": "en", "accept_local_address": true})).await;
    problem(certificate, 409, "conflict").await;
    let store = of.planter.store();
    assert_eq!(store.check().await.unwrap(), Vec::<String>::new());
    change(&of.database(), "UPDATE exam_attempt SET completion = NULL", "exam_attempt_is_completed_before_the_end")
        .await;
    let found = store.check().await.unwrap();
    assert!(found.len() == 1 && found[0].contains("not judged"), "{found:?}");
}

pub(super) async fn text_of(database: &std::path::Path, sql: &'static str) -> String {
    use sqlx::ConnectOptions;
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(database);
    let mut connection = options.connect().await.unwrap();
    sqlx::query_scalar(sql).fetch_one(&mut connection).await.unwrap()
}

/// Changes rows although a trigger forbids it.
pub(super) async fn change(database: &std::path::Path, sql: &str, trigger: &str) {
    execute(database, &format!("DROP TRIGGER {trigger}")).await.unwrap();
    execute(database, sql).await.unwrap();
}

/// Runs a statement behind the back of the service.
pub(super) async fn execute(database: &std::path::Path, sql: &str) -> sqlx::Result<()> {
    use sqlx::{ConnectOptions, Connection, Executor};
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(database);
    let mut connection = options.connect().await?;
    let done = connection.execute(sqlx::AssertSqlSafe(sql.to_owned())).await;
    connection.close().await?;
    done.map(drop)
}

#[tokio::test(flavor = "multi_thread")]
async fn the_box_is_checked_before_each_attempt_and_what_measures_is_what_was_tested() {
    let mut of = ExamCentre::open().await;
    let exam = of.running(2).await;
    let camera = json!({"width": 640, "height": 480, "fx": 501, "fy": 501, "cx": 320, "cy": 240});
    of.centre.administrator.put("/api/v1/boxes/box-1/camera", camera).await;
    let refused = of.centre.instructor.post(&format!("{exam}/attempts"), json!({"way": "browser"})).await;
    assert_eq!(problem(refused, 409, "conflict").await["box_problems"], json!(["changed_since"]));
    assert_eq!(of.centre.instructor.read(&exam).await["box_check"]["is_ready"], false);
    of.self_test("green").await;
    of.attempt(&exam, vec![duration(40.0, 1.0)]).await; // the planter measures with the camera before
    let judged = of.centre.instructor.read(&exam).await;
    let first = &judged["attempts"][0];
    assert_eq!((&first["outcome"], &first["cause"]), (&json!("undecided"), &json!("set_up")), "{judged}");
    of.planter.take_current_set_up().await;
    of.attempt(&exam, vec![duration(40.0, 1.0)]).await;
    assert_eq!(of.close(&exam).await["result"], "passed");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_later_score_neither_blocks_the_certificate_nor_asks_for_the_box() {
    let of = ExamCentre::open().await;
    let exam = of.running(1).await;
    let session = of.attempt(&exam, vec![duration(40.0, 1.0)]).await;
    of.close(&exam).await;
    let of_all = json!({"from": "trajectory", "which": "all"});
    of.centre.administrator.make("/api/v1/tasks/peg/rescorings", of_all).await;
    let refused = json!({"frames": 300, "verdict": "refused", "reasons": [], "tools": [],
        "recording": {"box": {"finding": "doubtful"}}});
    of.planter.rescore_as("a later version", refused, |_| duration(90.0, 1.0)).await;
    let seen = of.centre.instructor.read(&format!("/api/v1/sessions/{session}")).await;
    assert_eq!((&seen["features"][0]["value"], &seen["box_question"]), (&json!(90.0), &Value::Null), "{seen}");
    of.centre
        .instructor
        .make(&format!("{exam}/certificates"), json!({"language": "en", "accept_local_address": true}))
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_order_that_the_box_refuses_is_taken_back() {
    let of = ExamCentre::open().await;
    let exam = of.running(1).await;
    let first = of.order(&exam).await;
    let silent = of.centre.instructor.post(&format!("{exam}/attempts"), json!({"way": "agent"})).await;
    assert!(detail(&problem(silent, 409, "conflict").await).contains("silent"));
    let (mut sender, _) = sender::begin(&of.centre.service, &of.centre.agent, &first).await;
    sender.send_frames(0..5).await;
    sender.end(5).await;
    assert_eq!(of.centre.instructor.read(&exam).await["attempts_used"], 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_preferred_hand_is_that_of_the_start() {
    let of = ExamCentre::open().await;
    let hand = async |of: &ExamCentre, hand: &str| {
        let change = of.centre.administrator.request(Method::PATCH, "/api/v1/trainees/ada");
        assert!(change.json(&json!({"handedness": hand})).send().await.unwrap().status().is_success());
    };
    hand(&of, "left").await;
    let exam = of.running(1).await;
    hand(&of, "right").await;
    assert_eq!(text_of(&of.database(), "SELECT handedness FROM exam").await, "left", "{exam}");
}

#[tokio::test(flavor = "multi_thread")]
async fn records_with_the_recording_of_an_attempt_are_not_merged() {
    let of = ExamCentre::open().await;
    let (centre, exam) = (&of.centre, of.running(1).await);
    of.attempt(&exam, vec![duration(40.0, 1.0)]).await;
    of.close(&exam).await;
    let mut sender = sender::open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
    let mut hello = sender::hello("0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a45");
    hello["trainee"] = json!("bob");
    sender.send_json(&hello).await;
    sender.receive().await;
    sender.epoch = 1;
    sender.send_frames(0..4).await;
    sender.end(4).await;
    let merge = json!({"trainee": "ada", "why": "Registered twice."});
    let refused = centre.administrator.post("/api/v1/trainees/bob/merges", merge).await;
    assert!(detail(&problem(refused, 409, "conflict").await).contains("attempt of an exam"));
}
