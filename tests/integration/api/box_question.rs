//! A recording that is filed under the wrong box: it is asked about, counts nowhere until staff answer, and each answer
//! has its effect. The boxes are simulated: each number has a mat, a lens and a mounting of its own, with the same
//! tapes.

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::centre::{Centre, session};
use crate::feed::scene::{Folder, set_up_box};
use crate::support::{Client, Service, problem, read};

const ADA: &str = "/api/v1/trainees/ada/progress?task=peg";

/// A recording of six seconds. In a smaller picture, the tools are too thin to be measured well.
fn scene(options: &str) -> Folder {
    Folder::of(&format!("--size 960x540 --seconds 6 {options}"))
}

/// A centre whose box 1 is the simulated box 1.
async fn centre() -> Centre {
    let centre = Centre::open_in(
        Service::start_with(|settings| {
            settings.workers = 1;
            settings.rescoring.look_ms = 10;
        })
        .await,
    )
    .await;
    set_up_box(&centre.administrator, "box-1", &scene("--seed 3")).await;
    centre
}

/// Uploads a recording to box 1 and waits for its result. Returns the session.
async fn upload(centre: &Centre, trainee: &str, of: &Folder) -> Value {
    let clip = std::fs::read(of.file("clip.mp4")).unwrap();
    let made = session(&centre.administrator, trainee, clip).await;
    let is_done = |session: &Value| {
        assert_ne!(session["status"], "failed", "{session}");
        session["status"] == "done"
    };
    centre.administrator.read_until(&address(&made), is_done).await
}

fn address(session: &Value) -> String {
    format!("/api/v1/sessions/{}", session["id"].as_str().unwrap())
}

/// Answers, waits for the new score, and returns the edit and the session.
async fn answer(client: &Client, at: &str, kind: &str) -> (Value, Value) {
    let edit = client.make(&format!("{at}/edits"), json!({"kind": kind, "why": "I watched it."})).await;
    (edit, scored(client, at).await)
}

async fn undo(client: &Client, at: &str, edit: &Value) -> Value {
    let undone = client.post(&format!("{at}/edits/{}/undo", edit["id"].as_str().unwrap()), Value::Null).await;
    read(undone, StatusCode::OK).await;
    scored(client, at).await
}

async fn scored(client: &Client, at: &str) -> Value {
    client.read_until(&format!("{at}/edits"), |edits| edits["score"] == "current").await;
    client.read(at).await
}

fn finding(session: &Value) -> &str {
    session["quality"]["recording"]["box"]["finding"].as_str().unwrap()
}

fn box_reasons(session: &Value) -> Vec<&str> {
    let names = session["quality"]["reasons"].as_array().unwrap().iter().map(|reason| reason["name"].as_str().unwrap());
    names.filter(|name| name.contains("box")).collect()
}

fn values(session: &Value) -> usize {
    session["features"].as_array().unwrap().iter().filter(|feature| feature["value"].is_number()).count()
}

fn judged(session: &Value) -> usize {
    session["features"].as_array().unwrap().iter().filter(|feature| feature["judgement"].is_string()).count()
}

/// The step of the trainee's progress that is this session.
async fn step(centre: &Centre, session: &Value) -> Value {
    let progress = centre.instructor.read(ADA).await;
    progress["sessions"].as_array().unwrap().iter().find(|step| step["id"] == session["id"]).unwrap().clone()
}

async fn move_to(centre: &Centre, at: &str, of_box: &str) -> Value {
    centre.instructor.make(&format!("{at}/moves"), json!({"box": of_box, "why": "The wrong box was chosen."})).await;
    centre.instructor.read(at).await
}

/// The session waits for its box without the numbers of the other one, is measured there, and both results stay.
async fn move_to_its_box_and_back(centre: &Centre, at: &str, withheld: &Value) {
    centre.administrator.make("/api/v1/boxes", json!({"name": "Box 2", "code": "box-2"})).await;
    let waits = move_to(centre, at, "box-2").await;
    assert_eq!((&waits["status"], &waits["box_question"]), (&json!("queued"), &Value::Null), "{waits}");
    assert_eq!((&waits["features"], &waits["result"]), (&json!([]), &Value::Null));
    assert!(waits["error"]["type"].as_str().unwrap().ends_with("box-not-ready"), "{waits}");
    set_up_box(&centre.administrator, "box-2", &scene("--seed 5 --box 2")).await;
    let right = centre.instructor.read_until(at, |session| session["status"] == "done").await;
    assert_eq!((finding(&right), &right["box_question"]), ("same", &Value::Null), "{}", right["quality"]);
    let edits = centre.instructor.read(&format!("{at}/edits")).await;
    assert_eq!((&edits["items"][0]["for_other_box"], &edits["score"]), (&json!(true), &json!("current")));
    let results = centre.instructor.read(&format!("{at}/results")).await;
    assert_eq!(results["items"].as_array().unwrap().len(), 3, "{results}");
    assert_eq!(results["items"][0]["id"], right["result"], "the current one first");

    let back = move_to(centre, at, "box-1").await;
    assert_eq!((&back["status"], &back["box_question"]), (&json!("done"), &json!("other_box")));
    assert_eq!((&back["features"], &back["quality"]), (&withheld["features"], &withheld["quality"]));
    assert_eq!(move_to(centre, at, "box-2").await["features"], right["features"], "without tracking it again");
    move_to(centre, at, "box-1").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_of_another_box_counts_nowhere_until_it_is_answered() {
    let centre = centre().await;
    // Not the duration: the recording ends in mid-motion, so its duration is a lower bound that no standard judges.
    let by = json!({"method": "fixed", "limit": 60_000.0, "unit": "mm"});
    let limit = json!({"targets": [{"feature": "path_length", "tool": "orange", "by": by}],
                       "rule": {"in_a_row": 1, "then_more": 0}});
    centre.instructor.make("/api/v1/tasks/peg/standards", limit).await;
    let other = upload(&centre, "ada", &scene("--seed 4 --box 2")).await;
    let at = address(&other);
    assert_eq!((finding(&other), &other["box_question"]), ("doubtful", &json!("asked")), "{}", other["quality"]);
    assert_eq!(box_reasons(&other), ["box_surroundings"]);
    assert!(values(&other) > 10, "the numbers are shown, with the reason");
    assert_eq!((judged(&other), &other["verdict"]), (0, &Value::Null), "no standard and no model judges it");
    let progress = centre.instructor.read(ADA).await;
    assert_eq!(progress["passed"], Value::Null, "{progress}");
    let seen = step(&centre, &other).await;
    assert_eq!((&seen["set_aside"], &seen["trial"]), (&json!("box_asked"), &Value::Null));
    assert_eq!(centre.instructor.read("/api/v1/attention").await["box_asked"][0]["session"], other["id"]);
    assert_eq!(centre.other_instructor.read("/api/v1/attention").await["box_asked"], json!([]), "not in the scope");
    let statement = centre.instructor.read(&format!("{at}/xapi")).await;
    assert!(statement["verb"]["id"].as_str().unwrap().ends_with("completed"), "{statement}");
    let own_answer = json!({"kind": "this_box", "why": "Of course."});
    problem(centre.trainee.post(&format!("{at}/edits"), own_answer).await, 403, "forbidden").await;

    let (edit, withheld) = answer(&centre.instructor, &at, "other_box").await;
    assert_eq!((&withheld["box_question"], &withheld["quality"]["verdict"]), (&json!("other_box"), &json!("refused")));
    assert_eq!((values(&withheld), box_reasons(&withheld)), (0, vec!["other_box"]));
    assert_eq!(step(&centre, &other).await["set_aside"], "other_box");
    assert_eq!(centre.instructor.read("/api/v1/attention").await["box_asked"], json!([]));
    let second = json!({"kind": "this_box", "why": "No, it is."});
    problem(centre.instructor.post(&format!("{at}/edits"), second).await, 409, "conflict").await;

    move_to_its_box_and_back(&centre, &at, &withheld).await;
    let asked_again = undo(&centre.instructor, &at, &edit).await;
    assert_eq!((&asked_again["box_question"], values(&asked_again)), (&json!("asked"), values(&other)));
    let (_, counted) = answer(&centre.instructor, &at, "this_box").await;
    assert_eq!((&counted["box_question"], box_reasons(&counted)), (&json!("this_box"), vec![]));
    assert!(judged(&counted) == 1 && values(&counted) == values(&other), "{}", counted["features"]);
    let seen = step(&centre, &other).await;
    assert_eq!((&seen["set_aside"], &seen["trial"]), (&Value::Null, &json!("passed")));
    assert!(centre.instructor.read(ADA).await["passed"].is_object(), "now it counts");

    let audit = centre.administrator.read("/api/v1/audit-entries?limit=20").await;
    let actions: Vec<&str> =
        audit["items"].as_array().unwrap().iter().map(|entry| entry["action"].as_str().unwrap()).collect();
    for action in ["other_box", "undo", "this_box"] {
        assert!(actions.contains(&action), "{actions:?}");
    }

    let next = upload(&centre, "ada", &scene("--seed 5 --box 2")).await;
    assert_eq!(
        (finding(&next), &next["box_question"]),
        ("same", &Value::Null),
        "a person confirmed these surroundings"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn recordings_of_the_box_are_not_asked_about_even_after_a_nudge() {
    let centre = centre().await;
    let own = upload(&centre, "ada", &scene("--seed 6")).await;
    assert_eq!((finding(&own), &own["box_question"]), ("same", &Value::Null), "{}", own["quality"]["recording"]["box"]);
    for (trainee, mm) in [("ada", 6), ("bob", -9)] {
        let nudged = upload(&centre, trainee, &scene(&format!("--seed 7 --camera-moved-mm {mm}"))).await;
        let found = (finding(&nudged), &nudged["box_question"]);
        assert_eq!(found, ("moved", &Value::Null), "{mm} mm: {}", nudged["quality"]["recording"]["box"]);
        assert_eq!(step_or_null(&centre, trainee, &nudged).await, Value::Null, "it counts");
    }
}

/// Why the session does not count in its trainee's progress.
async fn step_or_null(centre: &Centre, trainee: &str, session: &Value) -> Value {
    let progress = centre.administrator.read(&format!("/api/v1/trainees/{trainee}/progress?task=peg")).await;
    let steps = progress["sessions"].as_array().unwrap();
    steps.iter().find(|step| step["id"] == session["id"]).unwrap()["set_aside"].clone()
}
