//! Import of paths from other trackers; export of features and xAPI statements.

use std::path::Path;
use std::time::Duration;

use bytes::Bytes;
use parquet::file::reader::{FileReader, SerializedFileReader};
use reqwest::{Method, Response, StatusCode, header};
use serde_json::{Value, json};
use trocar::domain::session::{FeatureRow, FeatureSpace};
use trocar::motion::PIPELINE_VERSION;
use trocar::settings::Settings;

use super::centre::Centre;
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration, measured};
use crate::process::Process;
use crate::support::{Client, Service, let_time_pass, problem, read};

const HEAD: &str = "frame,time_s,tool,x_mm,y_mm,z_mm";
const IMPORT: &str = "/api/v1/sessions/import?task=peg&box=box-1";

async fn centre_with_worker() -> Centre {
    Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await
}

/// Tools that move to and fro for 20 s at 25 frames a second; `sigma`: the stated error of each row, mm.
fn table(tools: &[&str], sigma: Option<f64>) -> String {
    let mut table = HEAD.to_owned() + if sigma.is_some() { ",sigma_xy_mm,sigma_z_mm\n" } else { "\n" };
    for frame in 0..500 {
        let time = f64::from(frame) * 0.04;
        for (index, tool) in tools.iter().enumerate() {
            let x = 40.0 * (time * 1.3 + index as f64).sin();
            let y = 20.0 * (time * 0.7).cos();
            let sigma = sigma.map(|sigma| format!(",{sigma},{}", sigma * 4.0)).unwrap_or_default();
            table += &format!("{frame},{time},{tool},{x},{y},{}{sigma}\n", 150.0 + 5.0 * (time * 0.9).sin());
        }
    }
    table
}

async fn import(client: &Client, query: &str, table: impl Into<reqwest::Body>) -> Response {
    let request = client.request(Method::POST, &format!("{IMPORT}&{query}")).header(header::CONTENT_TYPE, "text/csv");
    request.body(table).send().await.unwrap()
}

/// Imports a table and waits until it is scored.
async fn import_and_wait(client: &Client, query: &str, table: String) -> Value {
    let made = read(import(client, query, table).await, StatusCode::CREATED).await;
    done(client, made["id"].as_str().unwrap()).await
}

async fn done(client: &Client, id: &str) -> Value {
    let is_done = |session: &Value| session["status"] == "done" || session["status"] == "failed";
    client.read_until(&format!("/api/v1/sessions/{id}"), is_done).await
}

fn feature<'s>(session: &'s Value, name: &str) -> &'s Value {
    let features = session["features"].as_array().unwrap();
    features.iter().find(|feature| feature["name"] == name && feature["space"] == "3d").unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn rows_of_another_tracker_become_a_session_that_names_the_tracker() {
    let centre = centre_with_worker().await;
    let session =
        import_and_wait(&centre.instructor, "trainee=ada&tracker=Kinovea", table(&["left", "right"], None)).await;
    assert_eq!(session["status"], "done", "{session}");
    assert_eq!(session["source"], json!({"kind": "import", "tracker": "Kinovea"}));
    assert_eq!(session["retry_can_help"], false, "there is no recording to score again");
    assert_eq!(session["versions"]["pipeline"], format!("{PIPELINE_VERSION} on rows by Kinovea"));
    assert_eq!(session["versions"]["calibration"], Value::Null);
    assert_eq!((&session["video"]["width"], &session["video"]["frames"]), (&Value::Null, &json!(500)));
    assert_eq!(session["tools"], json!(["left", "right"]));
    let length = feature(&session, "path_length");
    assert!(length["value"].as_f64().unwrap() > 400.0, "{length}");
    assert_eq!(length["error"], Value::Null, "the rows have no stated error");
    assert!(length["no_error"].as_str().unwrap().len() > 10, "{length}");
    assert_eq!(length["no_error_reason"], "errors_not_stated", "{length}");

    // The same rows with stated errors have error bars, and are another session.
    let with_errors = import_and_wait(&centre.instructor, "trainee=ada", table(&["left", "right"], Some(0.1))).await;
    let length = feature(&with_errors, "path_length");
    assert!(length["error"]["low"].as_f64() < length["error"]["high"].as_f64(), "{length}");

    let id = session["id"].as_str().unwrap();
    problem(centre.instructor.get(&format!("/api/v1/sessions/{id}/video")).await, 409, "conflict").await;
    let raw = format!("/api/v1/sessions/{id}/trajectory?kind=raw");
    problem(centre.instructor.get(&raw).await, 409, "conflict").await;
    let csv = centre.instructor.get(&format!("/api/v1/sessions/{id}/trajectory?format=csv")).await;
    assert_eq!(csv.text().await.unwrap().lines().count(), 1001);
    problem(centre.instructor.post(&format!("/api/v1/sessions/{id}/retry"), json!({})).await, 409, "conflict").await;
    let again = import(&centre.instructor, "trainee=ada&tracker=Kinovea", table(&["left", "right"], None)).await;
    assert!(problem(again, 409, "duplicate-recording").await["session"].as_str().unwrap().ends_with(id));
    assert_eq!(
        centre.trainee.read(&format!("/api/v1/sessions/{id}")).await["id"],
        id,
        "trainees see their own imports"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_with_poor_depth_is_compared_in_the_picture_and_says_how_far_off_it_is() {
    let centre = centre_with_worker().await;
    let compared = async |sigma: Option<f64>, tracker: &str| {
        let query = format!("trainee=ada&tracker={tracker}");
        import_and_wait(&centre.instructor, &query, table(&["left", "right"], sigma)).await
    };
    let poor = compared(Some(1.5), "Poor").await;
    let path = |space: &str| {
        let is_path = |one: &&Value| one["name"] == "path_length" && one["space"] == space;
        let paths = poor["features"].as_array().unwrap().iter().filter(is_path);
        let [half, length] = paths.fold([0.0; 2], |[half, length], one| {
            let of = |key: &str| one["error"][key].as_f64().unwrap();
            [half + 0.5 * (of("high") - of("low")), length + one["value"].as_f64().unwrap()]
        });
        half / length
    };
    let stated = &poor["compare_in"];
    assert_eq!(stated["space"], "image", "{stated}");
    for (key, space) in [("path_error_3d", "3d"), ("path_error_image", "image")] {
        assert!((stated[key].as_f64().unwrap() - path(space)).abs() < 1e-9, "{stated}");
    }
    assert!(path("3d") > 0.3 && path("image") < 0.1, "{stated}");
    let needs = |name: &str| feature(&poor, name)["needs_depth"].clone();
    let needed = ["path_length", "working_volume", "duration", "not_seen_share"].map(needs);
    assert_eq!(needed, [true, true, false, false].map(Value::from));

    assert_eq!(compared(Some(0.1), "Good").await["compare_in"]["space"], "3d");
    assert_eq!(compared(None, "Silent").await["compare_in"], Value::Null, "no stated errors");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_table_with_a_row_that_no_hand_reaches_is_refused_until_the_row_is_deleted() {
    let centre = centre_with_worker().await;
    let good = table(&["left", "right"], Some(0.1));
    let (row, x) = (good.lines().nth(21).unwrap(), 40.0 * (0.4f64 * 1.3).sin());
    assert!(row.starts_with(&format!("10,0.4,left,{x},")), "{row}");
    let wrong = good.replace(row, &row.replace(&x.to_string(), "9998"));
    let session = import_and_wait(&centre.instructor, "trainee=ada", wrong).await;
    assert_eq!((&session["status"], &session["quality"]["verdict"]), (&json!("done"), &json!("refused")), "{session}");
    let reasons = session["quality"]["reasons"].as_array().unwrap();
    let [jump, spike] = &reasons[..] else { panic!("{reasons:?}") };
    assert_eq!((&jump["name"], &jump["tool"], &jump["limit"]), (&json!("jump"), &json!("left"), &json!(5.0)));
    assert_eq!((&jump["rows"]["from_frame"], &jump["rows"]["to_frame"]), (&json!(9), &json!(10)));
    let at = json!({"from_frame": 10, "from_s": 0.4, "to_frame": 10, "to_s": 0.4});
    assert_eq!((&spike["name"], &spike["tool"], &spike["rows"]), (&json!("spike"), &json!("left"), &at));
    assert!(spike["finding"].as_str().unwrap().ends_with("; at frame 10 (0.400 s)"), "{spike}");
    for name in ["path_length", "mean_velocity", "peak_velocity"] {
        assert_eq!(feature(&session, name)["value"], Value::Null, "{name}");
    }
    let mended = import_and_wait(&centre.instructor, "trainee=ada", good.replace(&format!("{row}\n"), "")).await;
    assert_eq!(mended["quality"]["verdict"], "valid", "{mended}");
    let value = |name| feature(&mended, name)["value"].as_f64().unwrap();
    assert!(value("mean_velocity") <= value("peak_velocity"), "{mended}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_same_path_is_imported_once_even_if_the_bytes_of_its_table_differ() {
    let centre = Centre::open().await;
    centre.administrator.make("/api/v1/boxes", json!({"name": "Box 2", "code": "box-2"})).await;
    let plain = table(&["left", "right"], None);
    let made = read(import(&centre.administrator, "trainee=ada", plain.clone()).await, StatusCode::CREATED).await;
    let mut lines: Vec<&str> = plain.lines().collect();
    lines[1..].reverse();
    for same in [plain.clone(), plain.replace('\n', "\r\n"), lines.join("\n"), plain.replace(",left,", ", left ,")] {
        for query in ["trainee=ada", "trainee=ada&tracker=Kinovea"] {
            let again = problem(import(&centre.administrator, query, same.clone()).await, 409, "duplicate-recording");
            assert_eq!(again.await["session"], format!("/api/v1/sessions/{}", made["id"].as_str().unwrap()));
        }
    }
    let elsewhere = IMPORT.replace("box-1", "box-2") + "&trainee=ada";
    let elsewhere = centre.administrator.request(Method::POST, &elsewhere).header(header::CONTENT_TYPE, "text/csv");
    problem(elsewhere.body(plain.clone()).send().await.unwrap(), 409, "duplicate-recording").await;
    read(import(&centre.administrator, "trainee=bob", plain.clone()).await, StatusCode::CREATED).await;
    let other = table(&["left", "right"], Some(0.1));
    read(import(&centre.administrator, "trainee=ada", other).await, StatusCode::CREATED).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn imports_need_permission_and_a_bad_table_is_refused_with_line_and_column() {
    let centre = Centre::open_in(Service::start_with(|settings| settings.uploads.import_bytes = 4096).await).await;
    let good = format!("{HEAD}\n0,0,left,1,2,150\n1,0.04,left,1,2,150\n");
    problem(import(&centre.trainee, "trainee=ada", good.clone()).await, 403, "forbidden").await;
    problem(import(&centre.agent, "trainee=ada", good.clone()).await, 403, "forbidden").await;
    let foreign = import(&centre.instructor, "trainee=bob", good.clone()).await;
    assert_eq!(problem(foreign, 422, "unknown-reference").await["field"], "trainee");
    let untyped = centre.instructor.request(Method::POST, &format!("{IMPORT}&trainee=ada")).body(good.clone());
    problem(untyped.send().await.unwrap(), 415, "unsupported-media-type").await;
    problem(import(&centre.instructor, "trainee=ada&tracker=%3Dcmd", good.clone()).await, 422, "invalid").await;
    problem(import(&centre.instructor, "trainee=ada", vec![b'x'; 5000]).await, 413, "too-large").await;
    problem(import(&centre.instructor, "trainee=ada", "").await, 422, "invalid").await;
    for (table, words) in [
        (format!("{HEAD}\n0,0,left,NaN,2,150\n1,1,left,1,2,150\n").into_bytes(), "line 2: `x_mm` is `NaN`"),
        (format!("{HEAD}\n0,1,left,1,2,150\n1,0,left,1,2,150\n").into_bytes(), "line 3: frame 1 at 0 s contradicts"),
        (format!("{HEAD}\n0,0,left,1,2,150\n").into_bytes(), "one row only"),
        (b"a,b\n1,2\n".to_vec(), "no column `frame`"),
        ([HEAD.as_bytes(), b"\n0,0,l\xff,1,2,3\n"].concat(), "line 2: not UTF-8"),
        (format!("{HEAD}\n0,0,=cmd(),1,2,150\n1,1,=cmd(),1,2,150\n").into_bytes(), "line 2: `tool`"),
    ] {
        let refused = problem(import(&centre.instructor, "trainee=ada", table).await, 422, "invalid").await;
        assert!(refused["detail"].as_str().unwrap().contains(words), "{refused}");
        assert_eq!(refused["errors"][0]["field"], "table");
    }
    let sessions = centre.administrator.read("/api/v1/sessions").await;
    assert_eq!(sessions["items"], json!([]), "no refused table is kept");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_box_that_knows_its_tools_takes_only_rows_of_these() {
    let centre = Centre::open().await;
    Planter::open(&centre.service.data.path().join("trocar.db")).await; // the box's one tool is orange
    let rows = |tool: &str| format!("{HEAD}\n0,0,{tool},1,2,150\n1,0.04,{tool},1,2,150\n");
    let refused = problem(import(&centre.instructor, "trainee=ada", rows("green")).await, 422, "invalid").await;
    let expected = "line 2: `tool` is `green`, which the box does not have; its tools are `orange`";
    assert!(refused["detail"].as_str().unwrap().contains(expected), "{refused}");
    read(import(&centre.instructor, "trainee=ada", rows("orange")).await, StatusCode::CREATED).await;
}

/// Ada has two sessions, the newer one over the limit of 50 s, and Bob one.
async fn centre_with_sessions() -> Centre {
    let centre = Centre::open().await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let (ada, bob) = (planter.trainee("ada").await, planter.trainee("bob").await);
    planter.session(ada, NEW_YEAR_MS, vec![duration(40.0, 1.0)]).await;
    planter.session(ada, NEW_YEAR_MS + DAY_MS, vec![duration(60.0, 1.0)]).await;
    planter.session(bob, NEW_YEAR_MS, vec![duration(50.0, 3.0)]).await;
    centre
}

#[tokio::test(flavor = "multi_thread")]
async fn a_value_that_is_lost_in_its_error_bar_says_so_everywhere_unless_the_standard_can_judge_it() {
    let centre = Centre::open().await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let of = |name, unit, value, half| measured(name, unit, Some("orange"), FeatureSpace::Space3d, value, half);
    let rows = vec![
        duration(40.0, 1.0),
        of("path_length", "mm", 270.0, 19.0),
        of("smoothness", "1/mm²", 0.4, 5.4),
        of("idle_share", "1", 0.5, 0.3),
        of("log_dimensionless_jerk", "1", -2.7, 10.0),
        of("path_ratio", "1", 1.3, 0.5),
        FeatureRow { error: Some(Err("not stated".to_owned())), ..of("spread", "mm", 4.0, 1.0) },
        of("wizardry", "1", 1.0, 5.0),
    ];
    planter.session(planter.trainee("ada").await, NEW_YEAR_MS, rows).await;
    let limit =
        json!({"feature": "path_ratio", "tool": "orange", "by": {"method": "fixed", "limit": 2.0, "unit": "1"}});
    let path = format!("/api/v1/sessions/{}", session_of(&centre.trainee, "ada").await);
    let said = async || {
        let session = centre.trainee.read(&path).await;
        let rows = session["features"].as_array().unwrap().clone();
        rows.into_iter().map(|one| json!([one["name"], one["informative"], one["too_uncertain"]])).collect::<Vec<_>>()
    };
    let uncertain = |name: &str, why: &str| json!([name, false, why]);
    let mut expected = vec![
        json!(["duration", true, null]),
        json!(["path_length", true, null]),
        uncertain("smoothness", "as_large_as_value"),
        uncertain("idle_share", "half_of_range"),
        uncertain("log_dimensionless_jerk", "large_factor"),
        uncertain("path_ratio", "as_large_as_value"),
        json!(["spread", null, null]),
        json!(["wizardry", null, null]),
    ];
    assert_eq!(said().await, expected);
    let table = centre.trainee.read(&format!("{path}/features")).await;
    let column: Vec<&Value> = table["items"].as_array().unwrap().iter().map(|row| &row["too_uncertain"]).collect();
    assert_eq!(column, expected.iter().map(|one| &one[2]).collect::<Vec<_>>());

    let standard = json!({"targets": [limit], "rule": {"in_a_row": 1, "then_more": 0}});
    centre.administrator.make("/api/v1/tasks/peg/standards", standard).await;
    expected[5] = json!(["path_ratio", true, null]);
    assert_eq!(said().await, expected, "the whole bar keeps the limit, so the value says what the standard asks");

    let session = centre.trainee.read(&path).await;
    let families = centre.trainee.read("/api/v1/features").await;
    let listed = families["items"].as_array().unwrap().iter().find(|one| one["name"] == "idle_share").unwrap().clone();
    let shown = session["features"].as_array().unwrap().iter().find(|one| one["name"] == "idle_share").unwrap();
    for key in ["family", "better"] {
        assert_eq!(listed[key], shown[key], "{key}");
    }
    assert_eq!((&shown["family"], &shown["better"]), (&json!("time"), &json!("lower")));
}

async fn session_of(client: &Client, trainee: &str) -> String {
    let list = client.read(&format!("/api/v1/sessions?trainee={trainee}")).await;
    list["items"][0]["id"].as_str().unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn features_are_exported_in_three_formats_and_only_in_the_callers_scope() {
    let centre = centre_with_sessions().await;
    let path = format!("/api/v1/sessions/{}/features", session_of(&centre.trainee, "ada").await);
    let json = centre.trainee.read(&path).await;
    let row = &json["items"][0];
    assert_eq!(
        (&row["feature"], &row["value"], &row["low"], &row["high"]),
        (&json!("duration"), &json!(60.0), &json!(59.0), &json!(61.0))
    );
    assert_eq!(
        (&row["trainee"], &row["tool"], &row["pipeline"]),
        (&json!("ada"), &Value::Null, &json!(PIPELINE_VERSION))
    );
    let csv = centre.trainee.get(&format!("{path}?format=csv")).await;
    assert_eq!(csv.headers()[header::CONTENT_TYPE], "text/csv; charset=utf-8");
    let csv = csv.text().await.unwrap();
    assert!(csv.starts_with("session,trainee,task,box,") && csv.lines().count() == 2, "{csv}");
    let parquet = centre.trainee.get(&format!("{path}?format=parquet")).await.bytes().await.unwrap();
    assert_eq!(SerializedFileReader::new(parquet).unwrap().metadata().file_metadata().num_rows(), 1);
    centre.instructor.read(&path).await;
    for client in [&centre.other_instructor, &centre.other_trainee] {
        problem(client.get(&path).await, 404, "not-found").await;
        problem(client.get(&path.replace("/features", "/xapi")).await, 404, "not-found").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn only_administrators_export_a_tasks_table_and_it_contains_no_names() {
    let centre = centre_with_sessions().await;
    let path = "/api/v1/tasks/peg/features";
    for client in [&centre.instructor, &centre.trainee, &centre.agent] {
        problem(client.get(path).await, 403, "forbidden").await;
    }
    let csv = centre.administrator.get(&format!("{path}?format=csv")).await.text().await.unwrap();
    assert_eq!(csv.lines().count(), 4, "{csv}");
    assert!(!csv.contains(",ada,") && !csv.contains(",bob,"), "only ids: {csv}");
    let named = centre.administrator.get(&format!("{path}?format=csv&trainees=code")).await.text().await.unwrap();
    assert!(named.contains(",ada,") && named.contains(",bob,"), "{named}");
    let bob = centre.administrator.read("/api/v1/trainees/bob").await["id"].clone();
    centre.administrator.make("/api/v1/cohorts", json!({"name": "Only Bob", "members": [bob]})).await;
    let some = centre.administrator.read(&format!("{path}?cohort=only-bob")).await;
    assert_eq!(some["items"].as_array().unwrap().len(), 1);
    assert_eq!(some["items"][0]["value"], 50.0);
    let bytes: Bytes = centre.administrator.get(&format!("{path}?format=parquet")).await.bytes().await.unwrap();
    assert_eq!(SerializedFileReader::new(bytes).unwrap().metadata().file_metadata().num_rows(), 3);
    let unknown = centre.administrator.get(&format!("{path}?cohort=missing")).await;
    assert_eq!(problem(unknown, 422, "unknown-reference").await["field"], "cohort");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_table_of_many_pages_has_every_session_once() {
    let centre = Centre::open().await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let ada = planter.trainee("ada").await;
    let rows = (0..130).map(|n| (ada, NEW_YEAR_MS + n, vec![duration(n as f64, 1.0)])).collect();
    planter.sessions(rows).await;
    for format in ["json", "csv", "parquet"] {
        let path = format!("/api/v1/tasks/peg/features?format={format}");
        let bytes = centre.administrator.get(&path).await.bytes().await.unwrap();
        let count = match format {
            "json" => serde_json::from_slice::<Value>(&bytes).unwrap()["items"].as_array().unwrap().len(),
            "csv" => bytes.iter().filter(|byte| **byte == b'\n').count() - 1,
            _ => SerializedFileReader::new(bytes).unwrap().metadata().file_metadata().num_rows() as usize,
        };
        assert_eq!(count, 130, "{format}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn statements_give_the_standards_judgement_of_each_session() {
    let centre = centre_with_sessions().await;
    let ada = session_of(&centre.trainee, "ada").await;
    let path = format!("/api/v1/sessions/{ada}/xapi");
    let before = centre.trainee.read(&path).await;
    assert_eq!(before["verb"]["id"], "http://adlnet.gov/expapi/verbs/completed", "no standard judges it");
    assert_eq!((before["result"].get("success"), before["result"].get("score")), (None, None));
    let limit = json!({"targets": [{"feature": "duration", "by": {"method": "fixed", "limit": 50.0, "unit": "s"}}]});
    centre.administrator.make("/api/v1/tasks/peg/standards", limit).await;
    let failed = centre.trainee.read(&path).await;
    assert_eq!((&failed["verb"]["display"]["en"], &failed["result"]["success"]), (&json!("failed"), &json!(false)));
    assert_ne!(failed["id"], before["id"], "another verb gives another statement");
    let account = &failed["actor"]["account"];
    assert_eq!(
        account["name"],
        centre.administrator.read("/api/v1/trainees/ada").await["id"],
        "an id, because a code may contain a name"
    );
    assert_eq!(account["homePage"], format!("http://{}", centre.service.address()));
    assert!(!failed.to_string().contains("\"name\":\"Ada"), "{failed}");

    let first = centre.trainee.read("/api/v1/trainees/ada/xapi?limit=1").await;
    assert_eq!(first["statements"], json!([failed]));
    let more = first["more"].as_str().unwrap();
    let second = centre.trainee.read(more).await;
    assert_eq!(second["statements"][0]["verb"]["display"]["en"], "passed");
    assert_eq!(second["more"], "", "the last page");
    let undecided = centre.other_trainee.read("/api/v1/trainees/bob/xapi").await;
    assert_eq!(undecided["statements"][0]["verb"]["display"]["en"], "completed", "the error bar covers the limit");
    let (_, cursor_of_ada) = more.split_once('?').unwrap();
    let foreign = centre.administrator.get(&format!("/api/v1/trainees/bob/xapi?{cursor_of_ada}")).await;
    problem(foreign, 422, "invalid").await;
    problem(centre.trainee.get("/api/v1/trainees/bob/xapi").await, 404, "not-found").await;
    problem(centre.instructor.get("/api/v1/trainees/bob/xapi").await, 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn statements_use_the_public_address_from_the_settings() {
    let set = |settings: &mut Settings| settings.http.public_url = Some("https://skills.example/".into());
    let centre = Centre::open_in(Service::start_with(set).await).await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    planter.session(planter.trainee("ada").await, NEW_YEAR_MS, vec![duration(40.0, 1.0)]).await;
    let statement = centre.trainee.read("/api/v1/trainees/ada/xapi").await["statements"][0].clone();
    assert_eq!(statement["actor"]["account"]["homePage"], "https://skills.example");
    assert!(statement["object"]["id"].as_str().unwrap().starts_with("https://skills.example/api/v1/tasks/"));
}

/// Maximum growth of the service while it imports and scores 60,000 rows, KiB. Each row takes up to 120 bytes in the file
/// of the path, and the file grows by doubling. Scored in the service itself, each row took a KiB.
const MAX_IMPORT_GROWTH_KIB: u64 = 32 * 1024;

/// A tool on 60,000 frames. It states no errors, so that scoring is quick.
fn long_table() -> String {
    let mut table = format!("{HEAD}\n");
    for frame in 0..60_000 {
        let time = f64::from(frame) * 0.016;
        table += &format!("{frame},{time:.3},left,{:.2},{:.2},150\n", 40.0 * (time * 1.3).sin(), 20.0 * time.cos());
    }
    table
}

/// Opens a service in a process of its own, with what an import needs.
async fn separate_service(data: &Path) -> (Process, Client) {
    let service = Process::start(data);
    let client = Client::of(format!("http://{}", service.address));
    let client = client.signed_in("administrator", service.password.as_ref().unwrap()).await;
    for (what, code) in [("boxes", "box-1"), ("tasks", "peg"), ("trainees", "ada")] {
        client.make(&format!("/api/v1/{what}"), json!({"name": code, "code": code})).await;
    }
    (service, client)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_long_table_is_read_and_scored_outside_the_service() {
    let data = tempfile::tempdir().unwrap();
    let (service, client) = separate_service(data.path()).await;
    let peak_kib = || service.status("VmHWM").parse::<u64>().unwrap();
    import_and_wait(&client, "trainee=ada", table(&["left", "right"], None)).await;
    let before = peak_kib();
    let session = import_and_wait(&client, "trainee=ada", long_table()).await;
    assert_eq!((&session["status"], &session["video"]["frames"]), (&json!("done"), &json!(60_000)), "{session}");
    let growth = peak_kib().saturating_sub(before);
    assert!(growth < MAX_IMPORT_GROWTH_KIB, "the service grew by {growth} KiB");
}

/// A table with this many rows of two tools that state their errors: scoring it takes the most memory.
fn table_of(rows: usize) -> String {
    let mut table = format!("{HEAD},sigma_xy_mm,sigma_z_mm\n");
    for frame in 0..rows / 2 {
        let time = frame as f64 * 0.04;
        let (x, y) = (40.0 * (time * 1.3).sin(), 20.0 * time.cos());
        for tool in ["left", "right"] {
            table += &format!("{frame},{time:.2},{tool},{x:.2},{y:.2},150,0.1,0.4\n");
        }
    }
    table
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "takes minutes: make largest-table"]
async fn the_largest_table_is_scored_within_the_default_limits() {
    let data = tempfile::tempdir().unwrap();
    let (service, client) = separate_service(data.path()).await;
    let table = table_of(Settings::default().uploads.import_rows);
    let made = read(import(&client, "trainee=ada", table).await, StatusCode::CREATED).await;
    let session = loop {
        let session = client.read(&format!("/api/v1/sessions/{}", made["id"].as_str().unwrap())).await;
        if ["done", "failed"].contains(&session["status"].as_str().unwrap()) {
            break session;
        }
        let_time_pass(Duration::from_secs(1)).await;
    };
    assert_eq!(session["status"], "done", "{session}");
    eprintln!("peak memory of the service: {} KiB", service.status("VmHWM"));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_table_too_long_for_the_memory_of_scoring_is_refused_with_advice() {
    let service = Service::start_with(|settings| settings.analysis.scoring_memory_mib = 8).await;
    let centre = Centre::open_in(service).await;
    let refused = import(&centre.instructor, "trainee=ada", long_table()).await;
    let refused = problem(refused, 422, "invalid").await;
    assert!(refused["detail"].as_str().unwrap().contains("scoring_memory_mib"), "{refused}");
    let sessions = centre.instructor.read("/api/v1/sessions").await;
    assert_eq!(sessions["items"], json!([]));
}
