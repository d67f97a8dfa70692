//! Edits of sessions (trim, swap, set aside): they are made, the score follows, and they are undone.

use reqwest::{Method, StatusCode, header};
use serde_json::{Value, json};
use trocar::analysis::paths::SessionPaths;

use super::centre::{Centre, recording, session};
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration};
use crate::support::{Client, Service, problem, read};

const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";

async fn centre_with_worker() -> Centre {
    Centre::open_in(
        Service::start_with(|settings| {
            settings.workers = 1;
            settings.rescoring.look_ms = 10;
        })
        .await,
    )
    .await
}

/// Imports two tools that move to and fro for 20 s at 25 frames a second, the right one three times as far. Returns the
/// session's path.
async fn import_session(centre: &Centre) -> String {
    let mut table = "frame,time_s,tool,x_mm,y_mm,z_mm,sigma_xy_mm,sigma_z_mm\n".to_owned();
    for frame in 0..500 {
        let time = f64::from(frame) * 0.04;
        for (tool, reach) in [("left", 20.0), ("right", 60.0)] {
            let x = reach * (time * 1.3).sin();
            table += &format!("{frame},{time},{tool},{x},{},150,0.1,0.4\n", 20.0 * (time * 0.7).cos());
        }
    }
    let path = "/api/v1/sessions/import?task=peg&box=box-1&trainee=ada";
    let request = centre.instructor.request(Method::POST, path).header(header::CONTENT_TYPE, "text/csv").body(table);
    let made = read(request.send().await.unwrap(), StatusCode::CREATED).await;
    let at = format!("/api/v1/sessions/{}", made["id"].as_str().unwrap());
    centre.instructor.read_until(&at, |session| session["status"] == "done").await;
    at
}

/// Makes an edit and waits for the new score.
async fn make_edit(client: &Client, at: &str, body: Value) -> Value {
    let edit = client.make(&format!("{at}/edits"), body).await;
    wait_for_score(client, at).await;
    edit
}

async fn wait_for_score(client: &Client, at: &str) -> Value {
    client.read_until(&format!("{at}/edits"), |edits| edits["score"] == "current").await
}

async fn undo_edit(client: &Client, at: &str, edit: &Value) -> Value {
    let answer = client.post(&format!("{at}/edits/{}/undo", edit["id"].as_str().unwrap()), Value::Null).await;
    let undone = read(answer, StatusCode::OK).await;
    wait_for_score(client, at).await;
    undone
}

async fn feature_value(client: &Client, at: &str, name: &str, tool: Value) -> f64 {
    let session = client.read(at).await;
    let features = session["features"].as_array().unwrap();
    let is_wanted = |row: &&Value| row["name"] == name && row["space"] == "3d" && row["tool"] == tool;
    features.iter().find(is_wanted).unwrap()["value"].as_f64().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trim_is_scored_and_undoing_it_restores_the_first_result() {
    let centre = centre_with_worker().await;
    let at = import_session(&centre).await;
    let before = centre.instructor.read(&at).await;
    assert!(feature_value(&centre.instructor, &at, "duration", Value::Null).await > 15.0);

    let trim = json!({"kind": "trim", "from_s": 4.0, "to_s": 12.0, "why": "Talked at first.", "revision": 0});
    let edit = make_edit(&centre.instructor, &at, trim).await;
    assert_eq!(
        (&edit["who"], &edit["why"], &edit["undone"]),
        (&json!("ines"), &json!("Talked at first."), &Value::Null)
    );
    let kept = feature_value(&centre.instructor, &at, "duration", Value::Null).await;
    assert!(kept > 5.0 && kept < 8.1, "{kept}");
    let session = centre.instructor.read(&at).await;
    assert_eq!((&session["quality"]["frames"], &session["status"]), (&json!(201), &json!("done")));
    let evidence = centre.trainee.read(&format!("{at}/evidence")).await;
    for stretch in evidence["features"].as_array().unwrap().iter().flat_map(|row| row["stretches"].as_array().unwrap())
    {
        let [from, to] = ["from_s", "to_s"].map(|end| stretch[end].as_f64().unwrap());
        assert!(from >= 3.9 && to <= 12.1, "{stretch}");
    }
    let edits = centre.trainee.read(&format!("{at}/edits")).await;
    assert_eq!((&edits["kept"], &edits["revision"]), (&json!({"from_s": 4.0, "to_s": 12.0}), &json!(1)));

    // A second trim needs the current revision: with the old one it is refused.
    let late = json!({"kind": "trim", "from_s": 6.0, "to_s": 20.0, "why": "x", "revision": 0});
    problem(centre.administrator.post(&format!("{at}/edits"), late).await, 409, "conflict").await;
    let second = json!({"kind": "trim", "from_s": 6.0, "to_s": 99.0, "why": "x", "revision": 1});
    let second = make_edit(&centre.administrator, &at, second).await;
    assert_eq!(second["to_s"], 19.96, "limited to the end of the recording");
    assert!(feature_value(&centre.instructor, &at, "duration", Value::Null).await < 6.1);

    undo_edit(&centre.instructor, &at, &second).await;
    assert_eq!(feature_value(&centre.instructor, &at, "duration", Value::Null).await, kept);
    let withdrawn = undo_edit(&centre.administrator, &at, &edit).await;
    assert_eq!(withdrawn["undone"]["who"], centre.administrator.read("/api/v1/me").await["name"]);
    assert_eq!(undo_edit(&centre.instructor, &at, &edit).await, withdrawn, "undoing again changes nothing");
    let after = centre.instructor.read(&at).await;
    assert_eq!((&after["features"], &after["quality"]), (&before["features"], &before["quality"]));
    let results = centre.instructor.read(&format!("{at}/results")).await;
    let revisions: Vec<&Value> = results["items"].as_array().unwrap().iter().map(|result| &result["edits"]).collect();
    assert_eq!(revisions, [4, 3, 2, 1, 0], "old results stay");
}

#[tokio::test(flavor = "multi_thread")]
async fn times_are_corrected_by_staff_and_not_of_an_imported_table() {
    let centre = centre_with_worker().await;
    let at = import_session(&centre).await;
    let retime = json!({"kind": "retime", "true_frame_rate_hz": 16.4, "why": "The clock in the picture."});
    problem(centre.instructor.post(&format!("{at}/edits"), retime.clone()).await, 409, "conflict").await;
    let made = session(&centre.trainee, "ada", recording(100, 7)).await;
    let at = format!("/api/v1/sessions/{}", made["id"].as_str().unwrap());
    problem(centre.trainee.post(&format!("{at}/edits"), retime.clone()).await, 403, "forbidden").await;
    let edit = centre.instructor.make(&format!("{at}/edits"), retime.clone()).await;
    assert_eq!((&edit["true_frame_rate_hz"], &edit["true_duration_s"]), (&json!(16.4), &Value::Null));
    assert_eq!((&edit["from_s"], &edit["who"]), (&Value::Null, &json!("ines")));
    let both = json!({"kind": "retime", "true_frame_rate_hz": 16.4, "true_duration_s": 60.0, "why": "x"});
    for wrong in
        [both, json!({"kind": "retime", "why": "x"}), json!({"kind": "retime", "true_duration_s": 0.0, "why": "x"})]
    {
        problem(centre.instructor.post(&format!("{at}/edits"), wrong).await, 422, "invalid").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn swapped_tools_have_each_others_numbers_and_rescoring_keeps_them() {
    let centre = centre_with_worker().await;
    let at = import_session(&centre).await;
    let of = async |tool: &str| feature_value(&centre.instructor, &at, "path_length", json!(tool)).await;
    let (left, right) = (of("left").await, of("right").await);
    assert!(right > 2.0 * left);
    let swap = json!({"kind": "swap", "tools": ["left", "right"], "from_s": 0.0, "to_s": 60.0, "why": "Other hands."});
    let edit = make_edit(&centre.instructor, &at, swap).await;
    // Error bars come from replicates that depend on the tool's name.
    let near = |a: f64, b: f64| (a / b - 1.0).abs() < 0.02;
    assert!(
        near(of("left").await, right) && near(of("right").await, left),
        "{} {}",
        of("left").await,
        of("right").await
    );
    let swapped = of("left").await;
    let rows = centre.trainee.get(&format!("{at}/trajectory?format=csv&from_frame=10&to_frame=11")).await.text().await;
    let x = |row: &str| row.split(',').nth(3).unwrap().parse::<f64>().unwrap();
    let rows: Vec<String> = rows.unwrap().lines().map(str::to_owned).collect();
    assert!(rows.len() == 3 && rows[1].contains(",left,") && x(&rows[1]) > 2.0 * x(&rows[2]), "{rows:?}");

    let order = centre.administrator.make("/api/v1/tasks/peg/rescorings", json!({"which": "all"})).await;
    let order = format!("/api/v1/rescorings/{}", order["id"].as_str().unwrap());
    centre.administrator.read_until(&order, |order| order["ended_at"] != Value::Null).await;
    assert_eq!(of("left").await, swapped);
    undo_edit(&centre.instructor, &at, &edit).await;
    assert_eq!((of("left").await, of("right").await), (left, right));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_path_is_sent_trimmed_whole_or_thinned() {
    let centre = centre_with_worker().await;
    let at = import_session(&centre).await;
    let read = async |query: &str| centre.trainee.read(&format!("{at}/trajectory?{query}")).await;
    let rows = |path: &Value| path["columns"]["frame"].as_array().unwrap().len();
    let whole = read("").await;
    make_edit(&centre.instructor, &at, json!({"kind": "trim", "from_s": 4.0, "to_s": 12.0, "why": "x"})).await;
    assert_eq!((rows(&read("").await), read("trimmed=false").await), (402, whole));
    assert_eq!(rows(&read("from_frame=110&to_frame=120").await), 20);
    let thin = read("points=90&trimmed=false").await;
    assert!(rows(&thin) <= 200 && thin["thinned"] == true, "{}", rows(&thin));
    assert_eq!(thin["after_gap"].as_array().unwrap().len(), rows(&thin));
    let all = read("points=500").await;
    assert_eq!((rows(&all), &all["thinned"]), (402, &json!(false)));
    for query in ["points=1", "points=1000000"] {
        problem(centre.trainee.get(&format!("{at}/trajectory?{query}")).await, 422, "invalid").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_that_is_set_aside_counts_nowhere_until_that_is_undone() {
    let centre = Centre::open().await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let ada = planter.trainee("ada").await;
    for (day, seconds) in [40.0, 60.0].into_iter().enumerate() {
        planter.session(ada, NEW_YEAR_MS + day as i64 * DAY_MS, vec![duration(seconds, 1.0)]).await;
    }
    let progress = async || centre.trainee.read("/api/v1/trainees/ada/progress?task=peg&feature=duration").await;
    let id = progress().await["sessions"][1]["id"].as_str().unwrap().to_owned();
    let at = format!("/api/v1/sessions/{id}");
    let aside = json!({"kind": "set_aside", "why": "Another person trained under this name."});
    let edit = centre.instructor.make(&format!("{at}/edits"), aside.clone()).await;
    problem(centre.instructor.post(&format!("{at}/edits"), aside).await, 409, "conflict").await;

    let seen = progress().await;
    assert_eq!(seen["sessions"][1]["set_aside"], "by_hand");
    assert_eq!(centre.trainee.read(&at).await["set_aside"], true, "it stays visible");
    let table = async || {
        let table = centre.administrator.get("/api/v1/tasks/peg/features?format=csv").await.text().await.unwrap();
        table.lines().count() - 1
    };
    assert_eq!(table().await, 1);
    let statements = centre.trainee.read("/api/v1/trainees/ada/xapi").await;
    assert_eq!(statements["statements"].as_array().unwrap().len(), 1);
    let edits = centre.trainee.read(&format!("{at}/edits")).await;
    assert_eq!((&edits["score"], &edits["revision"]), (&json!("current"), &json!(0)), "its score is unchanged");

    let undo = centre.instructor.post(&format!("{at}/edits/{}/undo", edit["id"].as_str().unwrap()), Value::Null).await;
    assert_eq!(read(undo, StatusCode::OK).await["undone"]["who"], "ines");
    assert_eq!((&progress().await["sessions"][1]["set_aside"], table().await), (&Value::Null, 2));
}

#[tokio::test(flavor = "multi_thread")]
async fn edits_without_permission_and_impossible_edits_are_refused() {
    let centre = centre_with_worker().await;
    let at = import_session(&centre).await;
    let edits = format!("{at}/edits");
    let trim = json!({"kind": "trim", "from_s": 4.0, "to_s": 12.0, "why": "x"});
    for client in [&centre.trainee, &centre.agent] {
        problem(client.post(&edits, trim.clone()).await, 403, "forbidden").await;
    }
    let missing = format!("/api/v1/sessions/{MISSING}/edits");
    for path in [&edits, &missing] {
        problem(centre.other_instructor.get(path).await, 404, "not-found").await;
        problem(centre.other_instructor.post(path, trim.clone()).await, 404, "not-found").await;
    }
    let made = make_edit(&centre.instructor, &at, trim).await;
    let undo = format!("{edits}/{}/undo", made["id"].as_str().unwrap());
    problem(centre.other_instructor.post(&undo, Value::Null).await, 404, "not-found").await;
    problem(centre.trainee.post(&undo, Value::Null).await, 403, "forbidden").await;
    problem(centre.instructor.post(&format!("{edits}/{MISSING}/undo"), Value::Null).await, 404, "not-found").await;
    for body in [
        json!({"kind": "trim", "from_s": 40.0, "to_s": 50.0, "why": "x"}),
        json!({"kind": "trim", "from_s": 12.0, "to_s": 20.0, "why": "x"}),
        json!({"kind": "trim", "from_s": 9.0, "to_s": 5.0, "why": "x"}),
        json!({"kind": "trim", "from_s": 5.0, "to_s": 9.0, "why": " "}),
        json!({"kind": "trim", "from_s": 5.0, "to_s": 9.0}),
        json!({"kind": "trim", "from_s": "NaN", "to_s": 9.0, "why": "x"}),
        json!({"kind": "swap", "from_s": 5.0, "to_s": 9.0, "why": "x"}),
        json!({"kind": "swap", "tools": ["left", "green"], "from_s": 5.0, "to_s": 9.0, "why": "x"}),
        json!({"kind": "swap", "tools": ["a\u{7}", "left"], "from_s": 5.0, "to_s": 9.0, "why": "x"}),
        json!({"kind": "swap", "tools": ["x".repeat(5000), "left"], "from_s": 5.0, "to_s": 9.0, "why": "x"}),
        json!({"kind": "set_aside", "from_s": 5.0, "why": "x"}),
        json!({"kind": "forget", "why": "x"}),
    ] {
        problem(centre.instructor.post(&edits, body).await, 422, "invalid").await;
    }
    let kept = centre.trainee.read(&edits).await;
    assert_eq!(kept["items"].as_array().unwrap().len(), 1, "no refused edit is kept");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_check_that_takes_too_long_is_refused_with_the_limit() {
    let centre = Centre::open_in(Service::start_with(|settings| settings.analysis.glance_s = 0).await).await;
    let data = centre.service.data.path();
    let planter = Planter::open(&data.join("trocar.db")).await;
    let paths = SessionPaths {
        tools: vec!["left".to_owned()],
        frame_times_s: vec![0.0, 20.0],
        raw: Vec::new(),
        filtered: Vec::new(),
        smoothed: Vec::new(),
        tracking: None,
        cuts: Vec::new(),
    };
    let session = planter.paths(planter.trainee("ada").await, data, &paths).await;
    let trim = json!({"kind": "trim", "from_s": 4.0, "to_s": 12.0, "why": "x"});
    let edit = centre.instructor.post(&format!("/api/v1/sessions/{session}/edits"), trim).await;
    let path = "/api/v1/sessions/import?task=peg&box=box-1&trainee=ada";
    let table = "frame,time_s,tool,x_mm,y_mm,z_mm\n0,0,left,1,2,150\n";
    let request = centre.instructor.request(Method::POST, path).header(header::CONTENT_TYPE, "text/csv").body(table);
    for answer in [edit, request.send().await.unwrap()] {
        let detail = problem(answer, 422, "invalid").await["detail"].to_string();
        assert!(detail.contains("longer than 0 s") && detail.contains("glance_s"), "{detail}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_that_is_being_tracked_is_edited_later_but_set_aside_at_once() {
    let centre = Centre::open().await;
    Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let made = session(&centre.instructor, "ada", recording(100, 1)).await;
    let edits = format!("/api/v1/sessions/{}/edits", made["id"].as_str().unwrap());
    let trim = json!({"kind": "trim", "from_s": 4.0, "to_s": 12.0, "why": "x"});
    problem(centre.instructor.post(&edits, trim).await, 409, "conflict").await;
    let aside = centre.instructor.make(&edits, json!({"kind": "set_aside", "why": "Interrupted."})).await;
    assert_eq!(aside["kind"], "set_aside");
}
