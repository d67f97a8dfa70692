//! Exams when something goes wrong: an agent that refuses or is silent, attempts without a result, voided attempts, erased
//! records, rows that were changed behind the program's back. And what the candidate hears meanwhile.

use futures_util::{SinkExt, StreamExt};
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use trocar::domain::box_agent::PROTOCOL;
use trocar::domain::box_agent::messages::AgentMessage;
use trocar::domain::box_agent::state::{AgentState, BoxCameraState};

use super::centre::{recording, session};
use super::exams::{EXAMS, ExamCentre, MARKER, answer_text, change, detail, execute, post, text_of};
use super::streams::Watcher;
use crate::feed::sender;
use crate::planted::{NEW_YEAR_MS, duration};
use crate::support::{Client, problem, read, soon};

/// An agent that does with commands what the test wants.
struct ScriptedAgent(tokio_tungstenite::WebSocketStream<tokio_tungstenite::MaybeTlsStream<tokio::net::TcpStream>>);

impl ScriptedAgent {
    async fn stand_by(of: &ExamCentre) -> Self {
        let address = format!("ws://{}/api/v1/boxes/box-1/agent-connection", of.centre.service.address());
        let mut request = address.into_client_request().unwrap();
        request.headers_mut().extend(of.centre.agent.headers().clone());
        let mut agent = Self(tokio_tungstenite::connect_async(request).await.unwrap().0);
        agent.send(&AgentMessage::Hello { protocol: PROTOCOL, program: "a test".to_owned() }).await;
        let camera = BoxCameraState { is_open: true, ..BoxCameraState::default() };
        let state = AgentState { camera, ..AgentState::default() };
        agent.send(&AgentMessage::State { sent_at_ms: 0, state: Box::new(state) }).await;
        of.centre.instructor.read_until("/api/v1/boxes/box-1/agent", |state| state["camera"]["is_open"] == true).await;
        agent
    }

    async fn send(&mut self, message: &AgentMessage) {
        self.0.send(Message::text(serde_json::to_string(message).unwrap())).await.unwrap();
    }

    /// The next order to record.
    async fn start(&mut self) -> Value {
        soon("an order", async {
            loop {
                let Message::Text(text) = self.0.next().await.unwrap().unwrap() else { continue };
                let message: Value = serde_json::from_str(text.as_str()).unwrap();
                if message["type"] == "start" {
                    return message;
                }
            }
        })
        .await
    }
}

async fn actions(of: &ExamCentre) -> Vec<(String, Option<u64>)> {
    let audit = of.centre.administrator.read("/api/v1/audit-entries?limit=60").await;
    let of_exams = audit["items"].as_array().unwrap().iter().filter(|entry| entry["noun"] == "exam");
    of_exams.map(|entry| (entry["action"].as_str().unwrap().to_owned(), entry["attempt"].as_u64())).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn an_agent_that_refuses_or_does_not_answer_uses_no_attempt() {
    let of = ExamCentre::open().await;
    let (centre, exam) = (&of.centre, of.running(1).await);
    let mut agent = ScriptedAgent::stand_by(&of).await;
    let path = format!("{exam}/attempts");
    let order = async || centre.instructor.post(&path, json!({"way": "agent"})).await;
    let refuse = async {
        let start = agent.start().await;
        let refused = Some("the camera is missing".to_owned());
        agent.send(&AgentMessage::Done { command: start["command"].as_u64().unwrap(), refused }).await;
    };
    let (refused, ()) = tokio::join!(order(), refuse);
    let refused = problem(refused, 409, "conflict").await;
    assert_eq!(detail(&refused), "The box refused: the camera is missing.");
    let after = centre.instructor.read(&exam).await;
    assert_eq!((&after["attempts_used"], &after["attempts"], &after["waiting"]), (&json!(0), &json!([]), &json!([])));
    assert_eq!(actions(&of).await[0], ("take attempt back".to_owned(), None));

    let vanish = async {
        let start = agent.start().await;
        drop(agent); // the line breaks before the answer
        start
    };
    let (silent, start) = tokio::join!(order(), vanish);
    let silent = problem(silent, 409, "conflict").await;
    assert!(detail(&silent).contains("did not answer") && detail(&silent).contains("whether it records"), "{silent}");
    let after = centre.instructor.read(&exam).await;
    assert_eq!((&after["attempts_used"], &after["attempts"]), (&json!(0), &json!([])), "{after}");
    assert_eq!(after["waiting"][0]["may_begin"], true, "the box may have begun: {after}");
    // It had begun: its recording is the attempt, and no ordinary session that the candidate sees.
    let (mut sender, _) = sender::begin(&centre.service, &centre.agent, start["recording"].as_str().unwrap()).await;
    sender.send_frames(0..5).await;
    sender.end(5).await;
    let begun = centre.instructor.read(&exam).await;
    assert_eq!((&begun["attempts_used"], &begun["waiting"]), (&json!(1), &json!([])));
    assert_eq!(centre.trainee.read("/api/v1/sessions").await["items"], json!([]));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_voided_attempt_keeps_its_number_and_counts_nowhere() {
    let of = ExamCentre::open().await;
    let (administrator, instructor) = (&of.centre.administrator, &of.centre.instructor);
    let ada = of.planter.trainee("ada").await;
    of.planter.session(ada, NEW_YEAR_MS, vec![duration(47.0, 1.0)]).await;
    let exam = of.running(1).await;
    let session = of.attempt(&exam, vec![duration(MARKER, 1.0)]).await;
    let why = json!({"reason": "The lamp failed."});
    read(administrator.post(&format!("{exam}/attempts/1/void"), why).await, StatusCode::OK).await;
    of.attempt(&exam, vec![duration(40.0, 1.0)]).await;
    let closed = of.close(&exam).await;
    let numbers: Vec<(&Value, bool)> = closed["attempts"]
        .as_array()
        .unwrap()
        .iter()
        .map(|attempt| (&attempt["number"], attempt["voided_at"].is_null()))
        .collect();
    assert_eq!(numbers, [(&json!(1), false), (&json!(2), true)]);
    let issue = json!({"language": "de", "accept_local_address": true});
    let made = instructor.make(&format!("{exam}/certificates"), issue).await;
    let said = &made["content"]["exam"];
    assert_eq!((&said["attempts_used"], &said["voided"]), (&json!(1), &json!([1])));
    assert_eq!(made["content"]["sessions"][0]["number"], 2);
    let about = |action: &str| (action.to_owned(), Some(2));
    let entries = actions(&of).await;
    for expected in [about("begin attempt"), about("attempt completed"), ("void attempt".to_owned(), Some(1))] {
        assert!(entries.contains(&expected), "{expected:?} in {entries:?}");
    }

    let progress = of.centre.trainee.read("/api/v1/trainees/ada/progress?task=peg").await;
    let steps: Vec<(&Value, &Value)> =
        progress["sessions"].as_array().unwrap().iter().map(|step| (&step["set_aside"], &step["trial"])).collect();
    let (passed, none) = (json!("passed"), Value::Null);
    let voided = json!("voided");
    assert_eq!(steps, [(&none, &passed), (&voided, &none), (&none, &passed)], "{progress}");
    let seen = of.centre.trainee.read(&format!("/api/v1/sessions/{session}")).await;
    assert_eq!((&seen["voided"], &seen["judgement"]), (&json!(true), &none), "{seen}");
    let listed = instructor.read("/api/v1/sessions?trainee=ada").await;
    let in_list = listed["items"].as_array().unwrap().iter().find(|one| one["id"] == session.as_str()).unwrap();
    assert_eq!(in_list["voided"], true);
    let passed = instructor.read("/api/v1/sessions?trainee=ada&outcome=passed").await;
    assert!(passed["items"].as_array().unwrap().iter().all(|one| one["id"] != session.as_str()), "{passed}");
    let distribution = instructor.read("/api/v1/tasks/peg/distribution?feature=duration").await;
    assert_eq!(distribution["groups"][0]["values"], json!([43.5]), "the median of 47 and 40 s: {distribution}");
    let (_, data) = answer_text(&of.centre.trainee, "/api/v1/trainees/ada/data.zip").await;
    assert!(data.contains("\"voided\": true") || data.contains("\"voided\":true"), "the person's own data say it");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_attempt_without_a_result_is_voided_or_leaves_the_exam_undecided() {
    let of = ExamCentre::open().await;
    let (instructor, exam) = (&of.centre.instructor, of.running(1).await);
    of.record(&exam).await;
    of.planter.fail_next().await;
    assert_eq!(instructor.read(&exam).await["attempts"][0]["outcome"], "failed");
    let why = json!({"reason": "The camera failed."});
    let voided = of.centre.administrator.post(&format!("{exam}/attempts/1/void"), why).await;
    assert_eq!(read(voided, StatusCode::OK).await["attempts_used"], 0);
    let session = of.record(&exam).await;
    execute(&of.database(), &format!("DELETE FROM job WHERE session_id = '{session}'")).await.unwrap();
    let lacking = instructor.read(&exam).await;
    assert_eq!(
        (&lacking["attempts"][1]["state"], &lacking["attempts"][1]["outcome"]),
        (&json!("judged"), &json!("failed"))
    );
    assert_eq!(lacking["result_if_closed"], Value::Null, "the examiner has not said whether it was completed");
    let said = read(of.say(&exam, 2, "completed").await, StatusCode::OK).await;
    assert_eq!(said["result_if_closed"], "undecided");
    assert_eq!(of.close(&exam).await["result"], "undecided");
    assert_eq!(of.planter.store().check().await.unwrap(), Vec::<String>::new());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_value_that_was_not_measured_leaves_the_exam_undecided_unless_it_is_voided() {
    let of = ExamCentre::open().await;
    let (instructor, exam) = (&of.centre.instructor, of.running(2).await);
    of.attempt(&exam, vec![duration(60.0, 1.0)]).await; // missed
    of.attempt(&exam, Vec::new()).await; // the camera was partly covered
    for number in [1, 2] {
        read(of.say(&exam, number, "completed").await, StatusCode::OK).await;
    }
    let seen = instructor.read(&exam).await;
    assert_eq!(
        (&seen["attempts"][1]["cause"], &seen["result_if_closed"]),
        (&json!("not_measured"), &json!("undecided"))
    );
    assert_eq!(of.centre.trainee.read(&exam).await["result_if_closed"], Value::Null);
    let why = json!({"reason": "A drape covered the camera."});
    let voided = of.centre.administrator.post(&format!("{exam}/attempts/2/void"), why).await;
    assert_eq!(read(voided, StatusCode::OK).await["result_if_closed"], "not_passed");
    let outdated = instructor.request(Method::POST, &format!("{exam}/close?expected_result=undecided")).send().await;
    problem(outdated.unwrap(), 409, "conflict").await;
    assert_eq!(instructor.read(&exam).await["state"], "running", "nothing has changed");
    let unknown = instructor.request(Method::POST, &format!("{exam}/close?expected_result=won")).send().await;
    problem(unknown.unwrap(), 400, "bad-request").await;
    let closed = instructor.request(Method::POST, &format!("{exam}/close?expected_result=not_passed")).send().await;
    let closed = read(closed.unwrap(), StatusCode::OK).await;
    assert_eq!((&closed["result"], &closed["result_if_closed"]), (&json!("not_passed"), &Value::Null));
}

#[tokio::test(flavor = "multi_thread")]
async fn an_attempt_that_may_be_of_another_box_waits_for_no_answer() {
    let of = ExamCentre::open().await;
    let (instructor, exam) = (&of.centre.instructor, of.running(1).await);
    of.attempt(&exam, vec![duration(30.0, 1.0)]).await;
    execute(&of.database(), "UPDATE session SET box_question = 'asked'").await.unwrap();
    let waits = instructor.read("/api/v1/attention").await["box_asked"].clone();
    assert_eq!(waits, json!([]), "an attempt is never edited, so no one could answer");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_candidate_hears_nothing_of_an_attempt_before_the_exam_is_closed() {
    let of = ExamCentre::open().await;
    let centre = &of.centre;
    let exam = of.running(1).await;
    let (mut own, mut staff) = (Watcher::open(&centre.trainee).await, Watcher::open(&centre.instructor).await);
    let attempt = of.attempt(&exam, vec![duration(MARKER, 1.0)]).await;
    // The events before this one are all that the candidate got.
    let fence = session(&centre.administrator, "ada", recording(100, 1)).await["id"].as_str().unwrap().to_owned();
    let heard = own.until(&fence).await;
    for secret in [attempt.as_str(), &MARKER.to_string(), "passed", "duration"] {
        assert!(!heard.contains(secret), "{secret} in {heard}");
    }
    assert!(staff.until(&fence).await.contains(&attempt), "staff hear of it");
    of.close(&exam).await;
    assert!(own.until(&attempt).await.contains(&attempt));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_candidate_does_not_see_at_the_box_what_an_attempt_showed() {
    let of = ExamCentre::open().await;
    let (centre, exam) = (&of.centre, of.running(1).await);
    let attempt = of.attempt(&exam, vec![duration(MARKER, 1.0)]).await;
    let moved = r#"[{"name": "camera_moved", "cause": "camera_moved"}]"#;
    let set = format!(
        "UPDATE result SET quality = json_set(quality, '$.reasons', json('{moved}')) WHERE session_id = '{attempt}'"
    );
    execute(&of.database(), &set).await.unwrap();
    let reasons = async |client: &Client| client.read("/api/v1/boxes/box-1").await["self_test_reasons"].clone();
    assert_eq!(reasons(&centre.instructor).await, json!(["camera_moved"]));
    assert_eq!(reasons(&centre.trainee).await, json!([]));
    of.close(&exam).await;
    assert_eq!(reasons(&centre.trainee).await, json!(["camera_moved"]));
}

const ROWS: &str = "SELECT CAST((SELECT count(*) FROM exam) + (SELECT count(*) FROM exam_attempt)
    + (SELECT count(*) FROM session) + (SELECT count(*) FROM certificate WHERE exam_id IS NOT NULL) AS TEXT)";

#[tokio::test(flavor = "multi_thread")]
async fn erasing_a_person_erases_the_exams_of_all_merged_records() {
    let of = ExamCentre::open().await;
    let administrator = &of.centre.administrator;
    let planned = of.plan(1).await;
    let exam = of.running(2).await;
    of.attempt(&exam, vec![duration(60.0, 1.0)]).await;
    let why = json!({"reason": "The lamp failed."});
    read(administrator.post(&format!("{exam}/attempts/1/void"), why).await, StatusCode::OK).await;
    of.attempt(&exam, vec![duration(40.0, 1.0)]).await;
    of.close(&exam).await;
    let issue = json!({"language": "en", "accept_local_address": true});
    let made = of.centre.instructor.make(&format!("{exam}/certificates"), issue).await;
    let merge = json!({"trainee": "ada", "why": "Registered twice."});
    administrator.make("/api/v1/trainees/bob/merges", merge).await;
    problem(administrator.delete("/api/v1/trainees/ada").await, 409, "conflict").await; // it belongs to bob now
    assert_eq!(administrator.read(&exam).await["result"], "passed");
    assert_eq!(administrator.delete("/api/v1/trainees/bob").await.status(), StatusCode::NO_CONTENT);
    for gone in [&exam, &planned] {
        assert_eq!(administrator.get(gone).await.status(), StatusCode::NOT_FOUND);
    }
    assert_eq!(text_of(&of.database(), ROWS).await, "0");
    let check = format!("/api/v1/certificate-checks/{}", made["content"]["code"].as_str().unwrap());
    let public = of.centre.service.stranger().read(&check).await;
    assert_eq!((&public["state"], &public["content"]), (&json!("erased"), &Value::Null));
    assert_eq!(of.planter.store().check().await.unwrap(), Vec::<String>::new());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_twin_of_an_attempt_is_erased_only_with_the_person() {
    let of = ExamCentre::open().await;
    let (centre, administrator) = (&of.centre, &of.centre.administrator);
    for trainee in ["ada", "bob"] {
        session(administrator, trainee, recording(100, 1)).await;
    }
    administrator.make("/api/v1/trainees/bob/merges", json!({"trainee": "ada", "why": "Registered twice."})).await;
    let of_ada = "SELECT id FROM session WHERE trainee_id = (SELECT id FROM trainee WHERE code = 'ada')";
    let hidden = text_of(&of.database(), of_ada).await;
    let shown = administrator.read("/api/v1/sessions").await["items"][0]["id"].as_str().unwrap().to_owned();
    assert_ne!(hidden, shown);
    let new = json!({"trainee": "bob", "task": "peg", "box": "box-1", "attempts": 1});
    let exam = format!("{EXAMS}/{}", administrator.make(EXAMS, new).await["id"].as_str().unwrap());
    read(administrator.post(&format!("{exam}/start"), json!({"identity": "badge"})).await, StatusCode::OK).await;
    let plant = format!(
        "INSERT INTO exam_attempt (recording_id, exam_id, ordered_at_ms, number, began_at_ms, session_id)
         SELECT 'a recording of thirty-six characters', id, 0, 1, 0, '{hidden}' FROM exam"
    );
    execute(&of.database(), &plant).await.unwrap();
    problem(administrator.delete(&format!("/api/v1/sessions/{shown}")).await, 409, "exam-session").await;
    assert_eq!(
        text_of(&of.database(), "SELECT CAST(count(*) AS TEXT) FROM session").await,
        "2",
        "nothing is half erased"
    );
    let erased = administrator.delete("/api/v1/trainees/bob").await;
    assert_eq!(erased.status(), StatusCode::NO_CONTENT, "{}", erased.text().await.unwrap());
    assert_eq!(text_of(&of.database(), ROWS).await, "0");
    assert_eq!(centre.administrator.read(EXAMS).await["items"], json!([]));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_result_that_was_changed_in_the_database_is_found() {
    let of = ExamCentre::open().await;
    let exam = of.running(1).await;
    of.attempt(&exam, vec![duration(60.0, 1.0)]).await;
    assert_eq!(of.close(&exam).await["result"], "not_passed");
    let (database, store) = (of.database(), of.planter.store());
    assert_eq!(store.check().await.unwrap(), Vec::<String>::new());
    change(&database, "UPDATE exam SET result = 'passed'", "exam_ends_once").await;
    let found = store.check().await.unwrap();
    assert!(found.len() == 1 && found[0].contains("another result than its attempts"), "{found:?}");
    change(&database, "UPDATE exam_attempt SET outcome = 'passed'", "exam_attempt_is_judged_once").await;
    let found = store.check().await.unwrap();
    assert!(found.len() == 1 && found[0].contains("another outcome than its figures"), "{found:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_database_refuses_each_change_of_what_is_fixed() {
    let of = ExamCentre::open().await;
    let exam = of.running(2).await;
    for _ in 0..2 {
        of.attempt(&exam, vec![duration(60.0, 1.0)]).await;
    }
    let why = json!({"reason": "The lamp failed."});
    read(of.centre.administrator.post(&format!("{exam}/attempts/1/void"), why).await, StatusCode::OK).await;
    let number = "the number of an attempt never changes";
    let refused_while_running = [
        ("UPDATE exam SET task_id = 'x'", "what was fixed for an exam never changes"),
        ("UPDATE exam SET standard_id = 'x'", "what was fixed for an exam never changes"),
        ("UPDATE exam SET attempts = 3", "what was fixed for an exam never changes"),
        ("UPDATE exam SET planned_at_ms = 0", "what was fixed for an exam never changes"),
        ("UPDATE exam SET identity = 'known'", "fixed at the start"),
        ("UPDATE exam SET examiner = 'x'", "fixed at the start"),
        ("UPDATE exam SET handedness = 'left'", "fixed at the start"),
        ("UPDATE exam SET started_at_ms = started_at_ms + 1", "fixed at the start"),
        ("UPDATE exam_attempt SET outcome = 'passed'", "judged once"),
        ("UPDATE exam_attempt SET figures = '[]'", "judged once"),
        ("UPDATE exam_attempt SET cause = NULL", "judged once"),
        ("UPDATE exam_attempt SET pipeline = 'x'", "judged once"),
        ("UPDATE exam_attempt SET number = number + 10", number),
        ("UPDATE exam_attempt SET number = NULL, began_at_ms = NULL", number),
        ("UPDATE exam_attempt SET began_at_ms = 0", number),
        ("UPDATE exam_attempt SET recording_id = 'x'", number),
        ("UPDATE exam_attempt SET session_id = 'x'", "the session of an attempt never changes"),
        ("UPDATE exam_attempt SET void_reason = 'x' WHERE number = 1", "voided once"),
        ("UPDATE exam_attempt SET void_reason = NULL, voided_at_ms = NULL WHERE number = 1", "voided once"),
        ("DELETE FROM exam_attempt", "erased only with its exam"),
        ("DELETE FROM exam", "erased only with the person"),
    ];
    let refused_at_the_end = [
        ("UPDATE exam SET result = 'passed'", "that has ended never changes"),
        ("UPDATE exam SET state = 'running', result = NULL, ended_at_ms = NULL", "that has ended never changes"),
        ("UPDATE exam SET ended_at_ms = ended_at_ms + 1", "that has ended never changes"),
        ("UPDATE exam_attempt SET completion = 'broken_off'", "never changes after the exam"),
        ("UPDATE exam_attempt SET void_reason = 'x', voided_at_ms = 1 WHERE number = 2", "before the end of the exam"),
        ("DELETE FROM exam_attempt WHERE number = 1", "erased only with its exam"),
        ("DELETE FROM exam", "erased only with the person"),
    ];
    for (sql, why) in refused_while_running {
        refused(&of, sql, why).await;
    }
    of.close(&exam).await;
    let before = of.centre.instructor.read(&exam).await;
    for (sql, why) in refused_while_running.into_iter().chain(refused_at_the_end) {
        refused(&of, sql, why).await;
    }
    assert_eq!(of.centre.instructor.read(&exam).await, before);
    assert_eq!(post(&of.centre.instructor, &format!("{exam}/cancel")).await.status(), StatusCode::CONFLICT);
}

async fn refused(of: &ExamCentre, sql: &str, why: &str) {
    let error = execute(&of.database(), sql).await.expect_err(sql).to_string();
    assert!(error.contains(why), "{sql}: {error}");
}
