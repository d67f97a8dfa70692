//! Feedback reaches the trainee: what is new until they open the session, on which device they do so, and who may ask.

use std::sync::Arc;

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::ids::PersonId;
use trocar::store::{Store, StoreSettings};
use trocar::time::SystemClock;

use super::centre::{Centre, PASSWORD, recording, session};
use super::ratings::goals;
use crate::planted::{NEW_YEAR_MS, Planter, duration};
use crate::support::{Client, problem, read};

const FEEDBACK: &str = "/api/v1/feedback";

async fn session_of(centre: &Centre, trainee: &str, number: u64) -> String {
    let by = if trainee == "ada" { &centre.instructor } else { &centre.other_instructor };
    let made = session(by, trainee, recording(100, number)).await;
    format!("/api/v1/sessions/{}", made["id"].as_str().unwrap())
}

async fn comment(by: &Client, at: &str, text: &str) {
    by.make(&format!("{at}/comments"), json!({"from_s": 1, "text": text})).await;
}

async fn open(by: &Client, at: &str) -> Value {
    read(by.put(&format!("{at}/opening"), json!({})).await, StatusCode::OK).await
}

fn numbers(feedback: &Value) -> Value {
    let of = |item: &Value| json!([item["comments"], item["ratings"], item["who"]]);
    feedback["items"].as_array().unwrap().iter().map(of).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn feedback_is_new_until_the_trainee_opens_the_session_on_any_device() {
    let centre = Centre::open().await;
    let (first, second) = (session_of(&centre, "ada", 1).await, session_of(&centre, "ada", 2).await);
    assert_eq!(centre.trainee.read(FEEDBACK).await, json!({"items": [], "sessions": 0, "new_results": []}));
    comment(&centre.trainee, &first, "I was lost here.").await;
    assert_eq!(centre.trainee.read(FEEDBACK).await["sessions"], 0, "an own comment is not new");

    comment(&centre.instructor, &first, "Look at the left tip.").await;
    centre.instructor.make(&format!("{first}/ratings"), goals(3)).await;
    centre.instructor.make(&format!("{first}/ratings"), goals(4)).await; // replaces it: one rating
    comment(&centre.administrator, &first, "Better than last week.").await;
    comment(&centre.instructor, &second, "Calm hands.").await;
    let new = centre.trainee.read(FEEDBACK).await;
    assert_eq!(numbers(&new), json!([[1, 0, ["ines"]], [2, 1, ["Administrator", "ines"]]]), "{new}");
    assert_eq!((&new["sessions"], &new["items"][1]["task"]["name"]), (&json!(2), &json!("Peg transfer")));
    assert!(first.ends_with(new["items"][1]["session"].as_str().unwrap()));
    assert_eq!(centre.other_trainee.read(FEEDBACK).await["sessions"], 0, "not theirs");

    // Opened on a phone, it is no longer new at the desk; what is given later is.
    let phone = centre.service.sign_in("ada", PASSWORD).await;
    assert_eq!(open(&phone, &first).await["before"], Value::Null);
    assert_eq!(numbers(&centre.trainee.read(FEEDBACK).await), json!([[1, 0, ["ines"]]]));
    comment(&centre.instructor, &first, "And the right one.").await;
    assert_eq!(numbers(&phone.read(FEEDBACK).await), json!([[1, 0, ["ines"]], [1, 0, ["ines"]]]));
    assert!(open(&phone, &first).await["before"].is_string());

    // The person's export has the openings, and the audit trail none: they change no data of others.
    let audit = centre.administrator.read("/api/v1/audit-entries").await;
    assert!(audit["items"].as_array().unwrap().iter().all(|entry| entry["noun"] != "session_opening"), "{audit}");
}

#[tokio::test(flavor = "multi_thread")]
async fn all_feedback_until_a_moment_is_marked_as_seen_and_later_feedback_stays_new() {
    let centre = Centre::open().await;
    let (first, second) = (session_of(&centre, "ada", 1).await, session_of(&centre, "ada", 2).await);
    comment(&centre.instructor, &first, "One.").await;
    let shown = centre.trainee.read(FEEDBACK).await["items"][0]["latest_at"].clone();
    comment(&centre.instructor, &second, "Two, which the page has not shown.").await;
    let later = centre.trainee.read(FEEDBACK).await;
    assert_ne!(later["items"][0]["latest_at"], shown, "the two were given in the same millisecond");
    let marked = centre.trainee.post("/api/v1/feedback/seen", json!({"until": shown})).await;
    let left = read(marked, StatusCode::OK).await;
    assert_eq!((&left["sessions"], &left["items"][0]["session"]), (&json!(1), &later["items"][0]["session"]));
    let wrong = problem(centre.trainee.post("/api/v1/feedback/seen", json!({"until": "now"})).await, 422, "invalid");
    assert_eq!(wrong.await["errors"][0]["field"], "until");
}

#[tokio::test(flavor = "multi_thread")]
async fn openings_are_private_and_end_with_the_trainee() {
    let centre = Centre::open().await;
    let at = session_of(&centre, "ada", 1).await;
    comment(&centre.instructor, &at, "Here.").await;
    open(&centre.trainee, &at).await;
    for by in [&centre.instructor, &centre.administrator, &centre.agent] {
        problem(by.get(FEEDBACK).await, 403, "forbidden").await;
        problem(by.put(&format!("{at}/opening"), json!({})).await, 403, "forbidden").await;
    }
    problem(centre.other_trainee.put(&format!("{at}/opening"), json!({})).await, 404, "not-found").await;
    let person: PersonId = centre.trainee.read("/api/v1/me").await["id"].as_str().unwrap().parse().unwrap();
    let database = centre.service.data.path().join("trocar.db");
    let store = Store::open(&database, &StoreSettings::default(), Arc::new(SystemClock)).await.unwrap();
    let openings = async || store.feedback().openings(person).await.unwrap().len();
    assert_eq!(openings().await, 1);
    assert_eq!(centre.instructor.delete("/api/v1/trainees/ada").await.status(), StatusCode::NO_CONTENT);
    assert_eq!(openings().await, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_result_is_new_until_the_trainee_opens_the_session() {
    let centre = Centre::open().await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let ada = planter.trainee("ada").await;
    planter.session(ada, NEW_YEAR_MS, vec![duration(40.0, 1.0)]).await;
    let session = centre.trainee.read("/api/v1/sessions").await["items"][0]["id"].clone();
    assert_eq!(centre.trainee.read(FEEDBACK).await["new_results"], json!([session]));
    assert_eq!(centre.other_trainee.read(FEEDBACK).await["new_results"], json!([]));
    open(&centre.trainee, &format!("/api/v1/sessions/{}", session.as_str().unwrap())).await;
    assert_eq!(centre.trainee.read(FEEDBACK).await["new_results"], json!([]));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_comment_of_the_trainee_before_a_move_is_no_feedback_to_the_next() {
    let centre = Centre::open().await;
    let at = session_of(&centre, "ada", 1).await;
    comment(&centre.trainee, &at, "Mine.").await;
    comment(&centre.instructor, &at, "Yours.").await;
    let moved = json!({"trainee": "bob", "why": "Ada was still signed in."});
    centre.administrator.make(&format!("{at}/moves"), moved).await;
    assert_eq!(numbers(&centre.other_trainee.read(FEEDBACK).await), json!([[1, 0, ["ines"]]]));
    assert_eq!(centre.trainee.read(FEEDBACK).await["sessions"], 0);
}
