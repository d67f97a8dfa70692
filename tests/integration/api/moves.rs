//! Moves of sessions to the right trainee, task or box: what follows, who may do it, and the way back. A recording that is
//! moved to its box is in `box_question.rs`.

use reqwest::{Method, StatusCode, header};
use serde_json::{Value, json};

use super::centre::{Centre, recording, session};
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration};
use crate::process::program;
use crate::support::{Client, Service, problem, read};

const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";

fn address(session: &Value) -> String {
    format!("/api/v1/sessions/{}", session["id"].as_str().unwrap())
}

async fn move_to(client: &Client, at: &str, mut to: Value) -> Value {
    to["why"] = json!("Kim was still signed in.");
    client.make(&format!("{at}/moves"), to).await
}

async fn progress(centre: &Centre, trainee: &str, task: &str) -> Value {
    let path = format!("/api/v1/trainees/{trainee}/progress?task={task}&feature=duration");
    centre.administrator.read(&path).await
}

/// The recording times of the sessions of a progress, and their durations.
fn values(progress: &Value) -> Vec<(String, f64)> {
    let sessions = progress["sessions"].as_array().unwrap().iter().map(|step| step["recorded_at"].as_str().unwrap());
    let points = progress["features"].as_array().unwrap().iter().flat_map(|of| of["points"].as_array().unwrap());
    let values = points.map(|point| point["value"].as_f64().unwrap());
    sessions.map(str::to_owned).zip(values).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn progress_follows_a_session_to_another_trainee_and_task_and_back() {
    let centre = Centre::open().await;
    centre.administrator.make("/api/v1/tasks", json!({"name": "Knots", "code": "knots"})).await;
    let by = json!({"method": "fixed", "limit": 50.0, "unit": "s"});
    let standard = json!({"targets": [{"feature": "duration", "by": by}], "rule": {"in_a_row": 1, "then_more": 0}});
    centre.administrator.make("/api/v1/tasks/peg/standards", standard).await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let ada = planter.trainee("ada").await;
    for (day, seconds) in [40.0, 60.0].into_iter().enumerate() {
        planter.session(ada, NEW_YEAR_MS + day as i64 * DAY_MS, vec![duration(seconds, 1.0)]).await;
    }
    let before = progress(&centre, "ada", "peg").await;
    assert!(before["passed"].is_object(), "{before}");
    let at = address(&before["sessions"][0]);
    centre.trainee.make(&format!("{at}/comments"), json!({"from_s": 1, "text": "I dropped it here."})).await;

    let made = move_to(&centre.administrator, &at, json!({"trainee": "bob"})).await;
    assert_eq!(made["changes"].as_array().unwrap().len(), 1, "{made}");
    let change = &made["changes"][0];
    assert_eq!((&change["part"], &change["from"]["code"]), (&json!("trainee"), &json!("ada")));
    assert_eq!((&change["to"]["code"], &made["why"]), (&json!("bob"), &json!("Kim was still signed in.")));
    let (of_ada, of_bob) = (progress(&centre, "ada", "peg").await, progress(&centre, "bob", "peg").await);
    assert_eq!((values(&of_ada).len(), &of_ada["passed"]), (1, &Value::Null));
    assert_eq!((values(&of_bob)[0].1, of_bob["passed"].is_object()), (40.0, true));
    problem(centre.trainee.get(&at).await, 404, "not-found").await;
    problem(centre.instructor.get(&at).await, 404, "not-found").await;
    assert_eq!(centre.other_trainee.read(&at).await["trainee"]["code"], "bob");
    let seen = centre.other_trainee.read(&format!("{at}/moves")).await;
    let change = &seen["items"][0]["changes"][0];
    assert_eq!((&change["from"], &change["to"]["code"]), (&Value::Null, &json!("bob")), "Bob does not learn of Ada");
    assert_eq!(seen["items"][0]["why"], Value::Null);
    assert_eq!(centre.other_trainee.read(&format!("{at}/comments")).await["items"], json!([]), "nor from her comment");

    move_to(&centre.administrator, &at, json!({"trainee": "ada", "task": "knots"})).await;
    assert_eq!(values(&progress(&centre, "ada", "knots").await)[0].1, 40.0);
    assert_eq!(values(&progress(&centre, "bob", "peg").await), []);
    move_to(&centre.instructor, &at, json!({"task": "peg"})).await;
    assert_eq!(progress(&centre, "ada", "peg").await, before, "as if it had never been moved");
    assert_eq!(centre.trainee.read(&format!("{at}/comments")).await["items"][0]["text"], "I dropped it here.");

    let moves = centre.instructor.read(&format!("{at}/moves")).await;
    let parts: Vec<Vec<&str>> = moves["items"].as_array().unwrap().iter().map(parts_of).collect();
    assert_eq!(parts, [vec!["trainee"], vec!["trainee", "task"], vec!["task"]]);
    let audit = centre.administrator.read("/api/v1/audit-entries?limit=10").await;
    let entry = audit["items"].as_array().unwrap().iter().find(|entry| entry["action"] == "move").unwrap();
    assert_eq!((&entry["noun"], &entry["who"]), (&json!("session"), &json!("ines")));
    assert_eq!(entry["why"], "Kim was still signed in.", "{entry}");
}

fn parts_of(made: &Value) -> Vec<&str> {
    made["changes"].as_array().unwrap().iter().map(|change| change["part"].as_str().unwrap()).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn moves_without_permission_and_impossible_moves_are_refused() {
    let centre = Centre::open().await;
    let made = session(&centre.trainee, "ada", recording(100, 1)).await;
    let at = address(&made);
    let moves = format!("{at}/moves");
    let to_bob = json!({"trainee": "bob", "why": "x"});
    for client in [&centre.trainee, &centre.agent] {
        problem(client.post(&moves, to_bob.clone()).await, 403, "forbidden").await;
    }
    for path in [&moves, &format!("/api/v1/sessions/{MISSING}/moves")] {
        problem(centre.other_instructor.get(path).await, 404, "not-found").await;
        problem(centre.other_instructor.post(path, to_bob.clone()).await, 404, "not-found").await;
    }
    // The instructor of group one does not see Bob.
    problem(centre.instructor.post(&moves, to_bob.clone()).await, 422, "unknown-reference").await;
    for field in ["trainee", "task", "box"] {
        let unknown = json!({field: "nowhere", "why": "x"});
        problem(centre.instructor.post(&moves, unknown).await, 422, "unknown-reference").await;
    }
    for body in [json!({"why": "x"}), json!({"task": "peg"}), json!({"task": "peg", "why": " "}), json!({"to": "peg"})]
    {
        problem(centre.instructor.post(&moves, body).await, 422, "invalid").await;
    }
    problem(centre.instructor.post(&moves, json!({"task": "peg", "why": "x"})).await, 409, "conflict").await;
    let twin = session(&centre.other_trainee, "bob", recording(100, 1)).await;
    let refused = problem(centre.administrator.post(&moves, to_bob).await, 409, "duplicate-recording").await;
    assert_eq!(refused["session"], address(&twin));
    assert_eq!(centre.administrator.read(&moves).await["items"], json!([]), "no refused move is kept");
    assert_eq!(centre.trainee.read(&at).await["trainee"]["code"], "ada");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_same_table_is_moved_to_another_box_and_not_twice_to_one_trainee() {
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    centre.administrator.make("/api/v1/boxes", json!({"name": "Box 2", "code": "box-2"})).await;
    let import = async |trainee: &str| {
        let mut table = "frame,time_s,tool,x_mm,y_mm,z_mm\n".to_owned();
        for frame in 0..200 {
            let time = f64::from(frame) * 0.04;
            table += &format!("{frame},{time},left,{},{},150\n", 20.0 * (time * 1.3).sin(), 20.0 * (time * 0.7).cos());
        }
        let path = format!("/api/v1/sessions/import?task=peg&box=box-1&trainee={trainee}");
        let request =
            centre.administrator.request(Method::POST, &path).header(header::CONTENT_TYPE, "text/csv").body(table);
        let made = read(request.send().await.unwrap(), StatusCode::CREATED).await;
        centre.administrator.read_until(&address(&made), |session| session["status"] == "done").await
    };
    let (of_ada, _) = (import("ada").await, import("bob").await);
    let at = address(&of_ada);
    let to_bob = json!({"trainee": "bob", "why": "x"});
    problem(centre.administrator.post(&format!("{at}/moves"), to_bob).await, 409, "duplicate-recording").await;
    move_to(&centre.administrator, &at, json!({"box": "box-2"})).await;
    let moved = centre.administrator.read(&at).await;
    assert_eq!((&moved["box"]["code"], &moved["status"]), (&json!("box-2"), &json!("done")));
    assert_eq!(moved["features"], of_ada["features"], "another program measured it: the box changes nothing");
}

/// Progress that is read after a thousand random moves equals what a table of the moves says, and after their reversal
/// what it was before.
#[tokio::test(flavor = "multi_thread")]
async fn a_thousand_random_moves_and_their_reversal_leave_every_figure_right() {
    let centre = Centre::open().await;
    let (trainees, tasks) = (["ada", "bob"], ["peg", "knots", "loops"]);
    for code in &tasks[1..] {
        centre.administrator.make("/api/v1/tasks", json!({"name": code, "code": code})).await;
    }
    let database = centre.service.data.path().join("trocar.db");
    let planter = Planter::open(&database).await;
    let mut filed = Vec::new();
    for day in 0..24_i64 {
        let trainee = usize::from(day % 2 == 1);
        let id = planter.trainee(trainees[trainee]).await;
        planter.session(id, NEW_YEAR_MS + day * DAY_MS, vec![duration(30.0 + day as f64, 1.0)]).await;
        filed.push((trainee, 0));
    }
    let read_all = async || {
        let mut all = Vec::new();
        for trainee in trainees {
            for task in tasks {
                all.push(progress(&centre, trainee, task).await);
            }
        }
        all
    };
    let before = read_all().await;
    let steps = before.iter().flat_map(|one| one["sessions"].as_array().unwrap());
    let mut sessions: Vec<(String, String)> = steps
        .map(|step| (step["recorded_at"].as_str().unwrap().to_owned(), step["id"].as_str().unwrap().to_owned()))
        .collect();
    sessions.sort();
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut random = |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below as u64) as usize
    };
    let mut history = Vec::new();
    while history.len() < 1000 {
        let (number, to) = (random(24), (random(2), random(3)));
        if filed[number] == to {
            continue;
        }
        history.push((number, filed[number]));
        filed[number] = to;
        planter.move_session(&sessions[number].1, trainees[to.0], tasks[to.1]).await;
    }
    let expected = |trainee: usize, task: usize| -> Vec<f64> {
        let mine = filed.iter().enumerate().filter(|(_, to)| **to == (trainee, task));
        mine.map(|(day, _)| 30.0 + day as f64).collect()
    };
    for (place, answer) in read_all().await.iter().enumerate() {
        let values: Vec<f64> = values(answer).into_iter().map(|(_, value)| value).collect();
        assert_eq!(values, expected(place / 3, place % 3), "{answer}");
    }
    for (number, to) in history.into_iter().rev() {
        planter.move_session(&sessions[number].1, trainees[to.0], tasks[to.1]).await;
    }
    assert_eq!(read_all().await, before);
    let check = program().args(["admin", "check", "--data"]).arg(centre.service.data.path()).output().unwrap();
    let findings = String::from_utf8(check.stdout).unwrap();
    let unexpected: Vec<&str> = findings.lines().filter(|line| !line.starts_with("missing file")).collect();
    assert!(unexpected.is_empty(), "besides the missing files of planted sessions: {unexpected:#?}");
}
