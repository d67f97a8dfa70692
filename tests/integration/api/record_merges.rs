//! Merges of two records of one person or of one box: what follows, what clashes, who may do it, and the way back. A law
//! with random corrections is in `corrections.rs`.

use reqwest::{Method, Response, StatusCode, header};
use serde_json::{Value, json};

use super::centre::{Centre, PASSWORD, recording, send, session, set_members};
use super::data_export::export;
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration};
use crate::process::program;
use crate::support::{problem, read};

const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";
const MERGES: &str = "/api/v1/trainees/ada/merges";

async fn merge(centre: &Centre, kept: &str, merged: &str) -> Value {
    let body = json!({"trainee": merged, "why": "She was registered twice."});
    centre.administrator.make(&format!("/api/v1/trainees/{kept}/merges"), body).await
}

async fn separate(centre: &Centre, of: &str, merge: &Value) -> Value {
    let path = format!("{of}/{}/separate", merge["id"].as_str().unwrap());
    read(centre.administrator.post(&path, json!({"why": "They are two people."})).await, StatusCode::OK).await
}

/// The durations that the progress of a trainee shows, and whether the standard is passed.
async fn progress(centre: &Centre, trainee: &str) -> (Vec<f64>, bool) {
    let path = format!("/api/v1/trainees/{trainee}/progress?task=peg&feature=duration");
    let progress = centre.administrator.read(&path).await;
    let points = progress["features"].as_array().unwrap().iter().flat_map(|of| of["points"].as_array().unwrap());
    (points.map(|point| point["value"].as_f64().unwrap()).collect(), progress["passed"].is_object())
}

fn codes(page: &Value) -> Vec<&str> {
    page["items"].as_array().unwrap().iter().map(|one| one["code"].as_str().unwrap()).collect()
}

fn count(preview: &Value, part: &str) -> (i64, i64) {
    let of = preview["parts"].as_array().unwrap().iter().find(|one| one["part"] == part);
    of.map_or((0, 0), |one| (one["follow"].as_i64().unwrap(), one["stay"].as_i64().unwrap()))
}

fn assert_clean(centre: &Centre) {
    let check = program().args(["admin", "check", "--data"]).arg(centre.service.data.path()).output().unwrap();
    let findings = String::from_utf8(check.stdout).unwrap();
    let is_expected = |line: &&str| line.starts_with("missing file") || line.starts_with("no data is lost");
    let unexpected: Vec<&str> = findings.lines().filter(|line| !is_expected(line)).collect();
    assert!(unexpected.is_empty(), "besides the missing files of planted sessions: {unexpected:#?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn two_records_of_one_person_are_merged_and_separated() {
    let centre = Centre::open().await;
    let by = json!({"method": "fixed", "limit": 50.0, "unit": "s"});
    let standard = json!({"targets": [{"feature": "duration", "by": by}], "rule": {"in_a_row": 2, "then_more": 0}});
    centre.administrator.make("/api/v1/tasks/peg/standards", standard).await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let (ada, bob) = (planter.trainee("ada").await, planter.trainee("bob").await);
    for (day, (trainee, seconds)) in [(ada, 40.0), (bob, 41.0), (ada, 60.0), (bob, 30.0)].into_iter().enumerate() {
        planter.session(trainee, NEW_YEAR_MS + day as i64 * DAY_MS, vec![duration(seconds, 1.0)]).await;
    }
    centre.administrator.patch("/api/v1/trainees/bob", json!({"level": "novice", "handedness": "left"})).await;
    let before = (progress(&centre, "ada").await, progress(&centre, "bob").await);
    assert_eq!(before, ((vec![40.0, 60.0], false), (vec![41.0, 30.0], true)));

    let preview = centre.administrator.post(&format!("{MERGES}/preview"), json!({"trainee": "bob"})).await;
    let preview = read(preview, StatusCode::OK).await;
    assert_eq!((count(&preview, "sessions"), count(&preview, "groups")), ((2, 0), (1, 0)), "{preview}");
    assert_eq!((&preview["closed_login"], &preview["takes_level"]), (&json!("bob"), &json!(true)));
    assert_eq!(progress(&centre, "bob").await, before.1, "a preview changes nothing");

    let made = merge(&centre, "ada", "bob").await;
    assert_eq!((&made["merged"]["code"], &made["why"]), (&json!("bob"), &json!("She was registered twice.")));
    assert_eq!(progress(&centre, "ada").await, (vec![40.0, 41.0, 60.0, 30.0], true));
    let followed = centre.administrator.read("/api/v1/trainees/bob").await;
    assert_eq!((&followed["code"], &followed["level"]), (&json!("ada"), &json!("novice")), "the old code leads there");
    assert_eq!(codes(&centre.administrator.read("/api/v1/trainees").await), ["ada"]);
    let count_of = async |query: &str| {
        centre.administrator.read(&format!("/api/v1/session-count?{query}")).await["matching"].clone()
    };
    assert_eq!((count_of("trainee=bob").await, count_of("trainee=ada").await), (json!(4), json!(4)));
    assert_eq!(codes(&centre.other_instructor.read("/api/v1/trainees").await), ["ada"], "the groups follow");
    let sent = send(&centre.administrator, "bob", recording(200, 9)).await;
    let sent = read(sent, StatusCode::CREATED).await;
    assert_eq!(sent["trainee"]["code"], "ada", "a program that knows the old code goes on");
    let audit = centre.administrator.read("/api/v1/audit-entries?limit=20").await;
    let entry = audit["items"].as_array().unwrap().iter().find(|entry| entry["action"] == "merge").unwrap();
    assert_eq!((&entry["noun"], &entry["why"]), (&json!("trainee"), &json!("She was registered twice.")));
    assert_clean(&centre);

    let undone = separate(&centre, MERGES, &made).await;
    assert_eq!(undone["separated_why"], "They are two people.");
    assert_eq!((progress(&centre, "ada").await, progress(&centre, "bob").await), before);
    assert_eq!(codes(&centre.administrator.read("/api/v1/trainees").await), ["ada", "bob"]);
    assert_eq!((count_of("trainee=bob").await, count_of("trainee=ada").await), (json!(2), json!(3)));
    assert_eq!(centre.administrator.read("/api/v1/trainees/ada").await["level"], Value::Null);
    assert_eq!(codes(&centre.other_instructor.read("/api/v1/trainees").await), ["bob"]);
    let path = format!("{MERGES}/{}/separate", made["id"].as_str().unwrap());
    problem(centre.administrator.post(&path, json!({"why": "x"})).await, 409, "conflict").await;
    assert_clean(&centre);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_both_records_have_counts_once_and_is_given_back() {
    let centre = Centre::open().await;
    set_members(&centre, "One", &["ines"], &["ada", "bob"]).await;
    let kept = session(&centre.administrator, "ada", recording(100, 1)).await;
    let twin = session(&centre.administrator, "bob", recording(100, 1)).await;
    let other = session(&centre.administrator, "bob", recording(100, 2)).await;
    let address = |session: &Value| format!("/api/v1/sessions/{}", session["id"].as_str().unwrap());
    let comment = json!({"from_s": 1, "text": "I dropped it here."});
    centre.other_trainee.make(&format!("{}/comments", address(&other)), comment).await;
    let retention = |months: u32| json!({"months": months, "reason": "A study."});
    for (trainee, months) in [("ada", 24), ("bob", 12)] {
        centre.administrator.put(&format!("/api/v1/trainees/{trainee}/retention"), retention(months)).await;
    }
    let months = async |trainee: &str| {
        centre.administrator.read(&format!("/api/v1/trainees/{trainee}/retention")).await["own_months"].clone()
    };

    let preview = centre.administrator.post(&format!("{MERGES}/preview"), json!({"trainee": "bob"})).await;
    let preview = read(preview, StatusCode::OK).await;
    assert_eq!((count(&preview, "sessions"), count(&preview, "groups")), ((1, 1), (1, 1)), "{preview}");
    assert_eq!((count(&preview, "account"), count(&preview, "comments")), ((0, 1), (1, 0)), "{preview}");
    let made = merge(&centre, "ada", "bob").await;
    problem(centre.administrator.get(&address(&twin)).await, 404, "not-found").await;
    assert_eq!(centre.trainee.read(&address(&other)).await["trainee"]["code"], "ada");
    let comments = centre.trainee.read(&format!("{}/comments", address(&other))).await;
    assert_eq!(comments["items"][0]["text"], "I dropped it here.");
    assert_eq!(months("ada").await, 12, "the shorter time counts");
    problem(centre.other_trainee.get("/api/v1/me").await, 401, "not-signed-in").await;
    let sign_in = json!({"login": "bob", "password": PASSWORD});
    problem(centre.service.stranger().post("/api/v1/sign-in", sign_in).await, 401, "wrong-credentials").await;
    let again = send(&centre.administrator, "bob", recording(100, 1)).await;
    assert_eq!(problem(again, 409, "duplicate-recording").await["session"], address(&kept));

    separate(&centre, MERGES, &made).await;
    let bob = centre.service.sign_in("bob", PASSWORD).await;
    assert_eq!(bob.read(&address(&twin)).await["trainee"]["code"], "bob");
    assert_eq!(bob.read(&format!("{}/comments", address(&other))).await["items"].as_array().unwrap().len(), 1);
    assert_eq!((months("ada").await, months("bob").await), (json!(24), json!(12)));
    problem(centre.trainee.get(&address(&other)).await, 404, "not-found").await;
    assert_eq!(codes(&centre.instructor.read("/api/v1/trainees").await), ["ada", "bob"]);
    assert_clean(&centre);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_account_of_the_only_record_with_one_opens_the_kept_record() {
    let centre = Centre::open().await;
    centre.administrator.make("/api/v1/trainees", json!({"name": "Ada Novak", "code": "novak"})).await;
    let of_bob = session(&centre.administrator, "bob", recording(100, 2)).await;
    let made = merge(&centre, "novak", "bob").await;
    problem(centre.other_trainee.get("/api/v1/me").await, 401, "not-signed-in").await;
    let bob = centre.service.sign_in("bob", PASSWORD).await;
    assert_eq!(codes(&bob.read("/api/v1/trainees").await), ["novak"]);
    let address = format!("/api/v1/sessions/{}", of_bob["id"].as_str().unwrap());
    assert_eq!(bob.read(&address).await["trainee"]["code"], "novak");
    separate(&centre, "/api/v1/trainees/novak/merges", &made).await;
    problem(bob.get("/api/v1/me").await, 401, "not-signed-in").await;
    assert_eq!(codes(&centre.service.sign_in("bob", PASSWORD).await.read("/api/v1/trainees").await), ["bob"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn later_merges_follow_when_an_earlier_one_is_separated() {
    let centre = Centre::open().await;
    for code in ["cleo", "dora"] {
        centre.administrator.make("/api/v1/trainees", json!({"name": code, "code": code})).await;
    }
    set_members(&centre, "One", &["ines"], &["cleo", "dora"]).await;
    let first = merge(&centre, "ada", "cleo").await;
    let second = merge(&centre, "ada", "dora").await;
    assert_eq!(codes(&centre.instructor.read("/api/v1/trainees").await), ["ada"]);
    separate(&centre, MERGES, &first).await;
    let seen = centre.instructor.read("/api/v1/trainees").await;
    assert_eq!(codes(&seen), ["ada", "cleo"], "the membership of Dora follows, which that of Cleo had replaced");
    let chained = merge(&centre, "bob", "ada").await;
    let path = format!("{MERGES}/{}/separate", second["id"].as_str().unwrap());
    problem(centre.administrator.post(&path, json!({"why": "x"})).await, 404, "not-found").await;
    assert_eq!(centre.administrator.read("/api/v1/trainees/dora").await["code"], "bob");
    separate(&centre, "/api/v1/trainees/bob/merges", &chained).await;
    separate(&centre, MERGES, &second).await;
    assert_eq!(codes(&centre.instructor.read("/api/v1/trainees").await), ["cleo", "dora"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn erasing_the_kept_record_erases_the_merged_one() {
    let centre = Centre::open().await;
    session(&centre.administrator, "ada", recording(100, 1)).await;
    let twin = session(&centre.administrator, "bob", recording(100, 1)).await;
    let made = merge(&centre, "ada", "bob").await;
    problem(centre.administrator.delete("/api/v1/trainees/bob").await, 409, "conflict").await;
    let extent = centre.administrator.read("/api/v1/trainees/ada/erasure").await;
    assert_eq!(extent["sessions"], 2, "{extent}");
    assert_eq!(centre.administrator.delete("/api/v1/trainees/ada").await.status(), StatusCode::NO_CONTENT);
    assert_eq!(codes(&centre.administrator.read("/api/v1/trainees").await), Vec::<&str>::new());
    for code in ["ada", "bob"] {
        problem(centre.administrator.get(&format!("/api/v1/trainees/{code}")).await, 404, "not-found").await;
    }
    let path = format!("{MERGES}/{}/separate", made["id"].as_str().unwrap());
    problem(centre.administrator.post(&path, json!({"why": "x"})).await, 404, "not-found").await;
    let address = format!("/api/v1/sessions/{}", twin["id"].as_str().unwrap());
    problem(centre.administrator.get(&address).await, 404, "not-found").await;
    assert_eq!(centre.administrator.read("/api/v1/people").await["items"].as_array().unwrap().len(), 3);
    centre.administrator.make("/api/v1/trainees", json!({"name": "Bob", "code": "bob"})).await;
    assert_clean(&centre);
}

#[tokio::test(flavor = "multi_thread")]
async fn erasing_a_session_erases_the_hidden_one_with_the_same_recording() {
    let centre = Centre::open().await;
    let kept = session(&centre.administrator, "ada", recording(100, 1)).await;
    for salt in [1, 2] {
        session(&centre.administrator, "bob", recording(100, salt)).await;
    }
    let made = merge(&centre, "ada", "bob").await;
    centre.administrator.delete(&format!("/api/v1/sessions/{}", kept["id"].as_str().unwrap())).await;
    separate(&centre, MERGES, &made).await;
    let count = centre.administrator.read("/api/v1/session-count").await;
    assert_eq!(count["all"], 1, "{count}");
}

#[tokio::test(flavor = "multi_thread")]
async fn erasing_a_session_that_was_moved_erases_the_hidden_one_with_the_same_recording() {
    let centre = Centre::open().await;
    centre.administrator.make("/api/v1/tasks", json!({"name": "Knots", "code": "knots"})).await;
    let kept = session(&centre.administrator, "ada", recording(100, 1)).await;
    for salt in [1, 2] {
        session(&centre.administrator, "bob", recording(100, salt)).await;
    }
    let made = merge(&centre, "ada", "bob").await;
    let at = format!("/api/v1/sessions/{}", kept["id"].as_str().unwrap());
    centre.administrator.make(&format!("{at}/moves"), json!({"task": "knots", "why": "It was knots."})).await;
    assert_eq!(centre.administrator.delete(&at).await.status(), StatusCode::NO_CONTENT);
    separate(&centre, MERGES, &made).await;
    let count = centre.administrator.read("/api/v1/session-count").await;
    assert_eq!(count["all"], 1, "only the other recording of Bob is left: {count}");
}

#[tokio::test(flavor = "multi_thread")]
async fn erasing_a_person_erases_the_hidden_copies_of_recordings_that_were_moved_to_them() {
    let centre = Centre::open().await;
    centre.administrator.make("/api/v1/trainees", json!({"name": "Cleo", "code": "cleo"})).await;
    let kept = session(&centre.administrator, "ada", recording(100, 1)).await;
    for salt in [1, 2] {
        session(&centre.administrator, "bob", recording(100, salt)).await;
    }
    let made = merge(&centre, "ada", "bob").await;
    let moves = format!("/api/v1/sessions/{}/moves", kept["id"].as_str().unwrap());
    centre.administrator.make(&moves, json!({"trainee": "cleo", "why": "It was Cleo."})).await;
    assert_eq!(centre.administrator.delete("/api/v1/trainees/cleo").await.status(), StatusCode::NO_CONTENT);
    separate(&centre, MERGES, &made).await;
    let count = centre.administrator.read("/api/v1/session-count?trainee=bob").await;
    assert_eq!(count["matching"], 1, "the copy of Cleo's recording is erased: {count}");
    assert_clean(&centre);
}

#[tokio::test(flavor = "multi_thread")]
async fn months_that_were_set_after_a_merge_stay_with_the_kept_record() {
    let centre = Centre::open().await;
    centre.administrator.make("/api/v1/trainees", json!({"name": "Cleo", "code": "cleo"})).await;
    let set = async |trainee: &str, months: u32| {
        let own = json!({"months": months, "reason": "A study."});
        let path = format!("/api/v1/trainees/{trainee}/retention");
        read(centre.administrator.put(&path, own).await, StatusCode::OK).await;
    };
    let months = async |trainee: &str| {
        centre.administrator.read(&format!("/api/v1/trainees/{trainee}/retention")).await["own_months"].clone()
    };
    set("ada", 24).await;
    set("bob", 12).await;
    set("cleo", 6).await;
    let first = merge(&centre, "ada", "bob").await;
    assert_eq!(months("ada").await, 12);
    set("ada", 36).await;
    separate(&centre, MERGES, &first).await;
    assert_eq!((months("ada").await, months("bob").await), (json!(36), json!(12)));

    let first = merge(&centre, "ada", "bob").await;
    let second = merge(&centre, "ada", "cleo").await;
    assert_eq!(months("ada").await, 6);
    set("ada", 48).await;
    separate(&centre, MERGES, &first).await;
    assert_eq!(
        (months("ada").await, months("bob").await),
        (json!(48), json!(12)),
        "the merge with Cleo changes nothing"
    );
    separate(&centre, MERGES, &second).await;
    assert_eq!((months("ada").await, months("cleo").await), (json!(48), json!(6)));

    let first = merge(&centre, "bob", "cleo").await;
    let back = json!({"months": null});
    read(centre.administrator.put("/api/v1/trainees/bob/retention", back).await, StatusCode::OK).await;
    separate(&centre, "/api/v1/trainees/bob/merges", &first).await;
    assert_eq!((months("bob").await, months("cleo").await), (Value::Null, json!(6)));
    assert_clean(&centre);
}

#[tokio::test(flavor = "multi_thread")]
async fn impossible_merges_are_refused_with_the_field() {
    let centre = Centre::open().await;
    let with = |trainee: &str| json!({"trainee": trainee, "why": "x"});
    let post = async |body: Value| centre.administrator.post(MERGES, body).await;
    problem(post(with("ada")).await, 409, "conflict").await;
    let unknown = problem(post(with("nobody")).await, 422, "unknown-reference").await;
    assert_eq!(unknown["field"], "trainee");
    let blank = problem(post(json!({"trainee": "bob", "why": " "})).await, 422, "invalid").await;
    assert_eq!(blank["errors"][0]["field"], "why");
    for body in [json!({"trainee": "bob"}), json!({"why": "x"}), json!({"trainee": "bob", "why": "x", "box": "y"})] {
        problem(post(body).await, 422, "invalid").await;
    }
    problem(centre.instructor.post(MERGES, with("bob")).await, 403, "forbidden").await;
    let path = format!("{MERGES}/{MISSING}/separate");
    problem(centre.administrator.post(&path, json!({"why": "x"})).await, 404, "not-found").await;
    centre.administrator.delete("/api/v1/trainees/bob?can_be_taken_back=true").await;
    problem(post(with("bob")).await, 422, "unknown-reference").await;
    assert_eq!(centre.administrator.read(MERGES).await["items"], json!([]));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_export_of_a_person_has_the_merged_records() {
    let centre = Centre::open().await;
    session(&centre.administrator, "ada", recording(100, 1)).await;
    let twin = session(&centre.administrator, "bob", recording(100, 1)).await;
    merge(&centre, "ada", "bob").await;
    let files = export(&centre.trainee, "/api/v1/trainees/ada/data.zip").await;
    let profile: Value = serde_json::from_slice(&files["profile.json"]).unwrap();
    let merged = &profile["merged_records"][0];
    assert_eq!((&merged["code"], &merged["login"]), (&json!("bob"), &json!("bob")));
    let id = twin["id"].as_str().unwrap();
    let is_twin = |name: &&String| name.starts_with("sessions-filed-twice/") && name.contains(id);
    assert!(files.keys().any(|name| is_twin(&name)), "{:?}", files.keys());
}

/// Sends a recording of Ada in this box.
async fn send_to(centre: &Centre, code: &str, content: Vec<u8>) -> Response {
    let path = format!("/api/v1/sessions?trainee=ada&task=peg&box={code}&filename=clip.mp4");
    let request = centre.administrator.request(Method::POST, &path).header(header::CONTENT_TYPE, "video/mp4");
    request.body(content).send().await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn two_records_of_one_box_are_merged_and_separated() {
    let centre = Centre::open().await;
    let database = centre.service.data.path().join("trocar.db");
    centre.administrator.make("/api/v1/boxes", json!({"name": "Box 2", "code": "box-2"})).await;
    let first = Planter::open(&database).await;
    let second = Planter::open_box(&database, "box-2").await;
    let ada = first.trainee("ada").await;
    first.session(ada, NEW_YEAR_MS, vec![duration(40.0, 1.0)]).await;
    second.session(ada, NEW_YEAR_MS + DAY_MS, vec![duration(30.0, 1.0)]).await;
    let token = json!({"name": "beside box 2", "role": "agent", "box": "box-2"});
    let token = centre.administrator.make("/api/v1/tokens", token).await;
    let box_of_token = async || {
        let tokens = centre.administrator.read("/api/v1/tokens").await;
        let found = tokens["items"].as_array().unwrap().iter().find(|one| one["id"] == token["id"]).unwrap().clone();
        let of = format!("/api/v1/boxes/{}", found["box"].as_str().unwrap());
        centre.administrator.read(&of).await["code"].clone()
    };
    let merges = "/api/v1/boxes/box-1/merges";
    let body = json!({"box": "box-2", "why": "It was registered twice."});
    let counts = async || {
        let of = async |code: &str| {
            centre.administrator.read(&format!("/api/v1/session-count?box={code}")).await["matching"].clone()
        };
        (of("box-1").await, of("box-2").await)
    };
    let versions = async |code: &str| -> Vec<i64> {
        let page = centre.administrator.read(&format!("/api/v1/boxes/{code}/calibrations")).await;
        page["items"].as_array().unwrap().iter().map(|one| one["version"].as_i64().unwrap()).collect()
    };
    assert_eq!((progress(&centre, "ada").await.0, counts().await), (vec![40.0, 30.0], (json!(1), json!(1))));
    let preview = centre.administrator.post(&format!("{merges}/preview"), json!({"box": "box-2"})).await;
    let preview = read(preview, StatusCode::OK).await;
    assert_eq!((count(&preview, "sessions"), count(&preview, "calibrations")), ((1, 0), (1, 0)), "{preview}");

    let made = centre.administrator.make(merges, body.clone()).await;
    assert_eq!(made["merged"]["code"], "box-2");
    assert_eq!((progress(&centre, "ada").await.0, counts().await), (vec![40.0, 30.0], (json!(2), json!(2))));
    assert_eq!(versions("box-2").await, [2, 1]);
    assert_eq!(codes(&centre.administrator.read("/api/v1/boxes").await), ["box-1"]);
    assert_eq!(box_of_token().await, "box-1", "the agent of the other record goes on");
    let sent = read(send_to(&centre, "box-2", recording(100, 7)).await, StatusCode::CREATED).await;
    assert_eq!(sent["box"]["code"], "box-1");
    problem(centre.administrator.delete("/api/v1/boxes/box-2").await, 409, "conflict").await;
    let path = format!("{merges}/{}/separate", made["id"].as_str().unwrap());
    problem(centre.administrator.post(&path, json!({"why": "x"})).await, 409, "conflict").await; // being tracked
    first.finish_next(vec![duration(20.0, 1.0)]).await;
    read(centre.administrator.post(&path, json!({"why": "Two boxes."})).await, StatusCode::OK).await;
    assert_eq!((counts().await, versions("box-2").await), ((json!(2), json!(1)), vec![1]));
    assert_eq!(codes(&centre.administrator.read("/api/v1/boxes").await), ["box-1", "box-2"]);
    assert_eq!(box_of_token().await, "box-2");
    assert_eq!(progress(&centre, "ada").await.0, [40.0, 30.0, 20.0]);
    assert_clean(&centre);

    for code in ["box-1", "box-2"] {
        read(send_to(&centre, code, recording(100, 3)).await, StatusCode::CREATED).await;
        first.finish_next(vec![duration(25.0, 1.0)]).await;
    }
    let refused = problem(centre.administrator.post(merges, body.clone()).await, 409, "conflict").await;
    assert!(refused["detail"].as_str().unwrap().contains("same recording"), "{refused}");
    problem(centre.instructor.post(merges, body).await, 403, "forbidden").await;
    problem(centre.administrator.post(merges, json!({"box": "box-1", "why": "x"})).await, 409, "conflict").await;
    let unknown = json!({"box": "box-9", "why": "x"});
    assert_eq!(
        problem(centre.administrator.post(merges, unknown).await, 422, "unknown-reference").await["field"],
        "box"
    );
}
