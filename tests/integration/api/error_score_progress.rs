//! The error score in the progress of a trainee: for each reader exactly what the session's page shows, and no more.

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::motion::PIPELINE_VERSION;
use trocar::motion::features::errors::NoErrorBar;

use super::error_sheets::{FORMULAS, Prepared, colleague, prepared, rate};
use crate::planted::{DAY_MS, NEW_YEAR_MS, duration, plant_arrival};
use crate::support::{Client, problem};

const PROGRESS: &str = "/api/v1/trainees/ada/progress?task=peg";

/// The points of all versions by the session's id: version, value, ends of the bar, number of sheets, reason.
async fn points(by: &Client, query: &str) -> Vec<(String, [Value; 6])> {
    let progress = by.read(&format!("{PROGRESS}{query}")).await;
    let id = |number: &Value| {
        let found = progress["sessions"].as_array().unwrap().iter().find(|session| session["number"] == *number);
        found.unwrap()["id"].as_str().unwrap().to_owned()
    };
    let mut points = Vec::new();
    for series in progress["error_scores"].as_array().unwrap() {
        for point in series["points"].as_array().unwrap() {
            let of = ["value", "low", "high", "sheets"].map(|name| point[name].clone());
            let [value, low, high, sheets] = of;
            let reason = point["none"]["reason"].clone();
            points.push((id(&point["session"]), [series["formula"].clone(), value, low, high, sheets, reason]));
        }
    }
    points.sort_by(|a, b| a.0.cmp(&b.0));
    points
}

/// The same from the pages of the sessions.
async fn shown_by_sessions(by: &Client, sessions: &[String]) -> Vec<(String, [Value; 6])> {
    let mut points = Vec::new();
    for id in sessions {
        let shown = by.read(&format!("/api/v1/sessions/{id}/error-sheets")).await["score"].clone();
        let version = shown["formula"]["version"].clone();
        if version.is_null() {
            continue; // no version scores it
        }
        let [value, low, high] = ["value", "low", "high"].map(|name| shown["score"][name].clone());
        let sheets = if value.is_null() { json!(0) } else { shown["score"]["sheets"].clone() };
        points.push((id.clone(), [version, value, low, high, sheets, shown["none"]["reason"].clone()]));
    }
    points.sort_by(|a, b| a.0.cmp(&b.0));
    points
}

async fn sessions_of_ada(by: &Client) -> Vec<String> {
    let listed = by.read("/api/v1/sessions?trainee=ada&limit=100").await;
    listed["items"].as_array().unwrap().iter().map(|row| row["id"].as_str().unwrap().to_owned()).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn progress_shows_each_reader_exactly_what_the_sessions_show() {
    let Prepared { centre, planter, .. } = prepared().await;
    let database = centre.service.data.path().join("trocar.db");
    let second = colleague(&centre).await;
    let ada = planter.trainee("ada").await;
    let mut at_least = duration(100.0, 1.0);
    at_least.error = Some(Err(NoErrorBar::AtLeast.to_string()));
    let mut unknown = duration(90.0, 1.0);
    unknown.error = Some(Err(NoErrorBar::ErrorsNotStated.to_string()));
    for (number, rows) in [vec![at_least], vec![unknown], vec![]].into_iter().enumerate() {
        planter.session(ada, NEW_YEAR_MS + (number as i64 + 1) * DAY_MS, rows).await;
    }
    let refused = (PIPELINE_VERSION, "refused");
    planter.result(ada, NEW_YEAR_MS + 5 * DAY_MS, vec![duration(120.0, 1.0)], refused).await;
    for number in 6..14 {
        planter.session(ada, NEW_YEAR_MS + number * DAY_MS, vec![duration(100.0 + number as f64, 1.0)]).await;
    }
    let sessions = sessions_of_ada(&centre.administrator).await;
    let address = |id: &String| format!("/api/v1/sessions/{id}");
    // Random sheets of two raters: none, of one, of both, without an amount.
    for (number, id) in sessions.iter().enumerate() {
        for (rater, client) in [&centre.instructor, &second].into_iter().enumerate() {
            if rand::random_range(0..3) > 0 || number % 3 == rater {
                let amount = (rand::random_range(0..5) > 0).then(|| rand::random_range(0.0..9.0));
                rate(client, &address(id), rand::random_range(0..4), amount).await;
            }
        }
    }
    let aside = json!({"kind": "set_aside", "why": "Interrupted."});
    centre.instructor.make(&format!("{}/edits", address(&sessions[2])), aside).await;
    // A second version scores what arrives from 2026 on, and three sessions arrived before it.
    for id in &sessions[5..8] {
        plant_arrival(&database, id, NEW_YEAR_MS - 30 * DAY_MS).await;
    }
    let later = json!({"valid_from": "2026-01-01", "cut_off_s": 400, "time": "measured", "not_below_zero": true,
                       "weights": [{"item": "drops", "weight": 20}]});
    assert_eq!(centre.instructor.make(FORMULAS, later).await["version"], 2);

    for client in [&centre.instructor, &second, &centre.administrator, &centre.trainee] {
        let shown = shown_by_sessions(client, &sessions).await;
        assert_eq!(points(client, "").await, shown);
        assert_eq!(points(client, "&feature=path_length").await, shown, "also where another feature is asked for");
        let versions = |version: i64| shown.iter().filter(|(_, point)| point[0] == version).count();
        assert_eq!((versions(1), versions(2)), (3, sessions.len() - 3));
    }
    // The trainee sees all scores; an administrator who has rated nothing sees none.
    let scored = |points: &[(String, [Value; 6])]| points.iter().filter(|(_, point)| !point[1].is_null()).count();
    assert!(scored(&points(&centre.trainee, "").await) >= 4);
    let blind = points(&centre.administrator, "").await;
    assert_eq!(scored(&blind), 0, "{blind:?}");
    let reasons: Vec<&str> = blind.iter().filter_map(|(_, point)| point[5].as_str()).collect();
    assert!(reasons.contains(&"hidden") && reasons.contains(&"set_aside"), "{reasons:?}");
    assert!(blind.iter().all(|(_, point)| point[4] == 0), "not even the number of sheets: {blind:?}");
    for client in [&centre.other_instructor, &centre.other_trainee] {
        problem(client.get(PROGRESS).await, 404, "not-found").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_without_a_sheet_is_a_gap_and_a_task_without_a_formula_has_no_series() {
    let Prepared { centre, planter, at } = prepared().await;
    let before = points(&centre.instructor, "").await;
    assert_eq!(before.len(), 1, "{before:?}");
    assert_eq!(before[0].1, [json!(1), Value::Null, Value::Null, Value::Null, json!(0), json!("no_sheet")]);
    // An open sheet says nothing, also to its rater.
    centre.instructor.make(&format!("{at}/error-sheets"), json!({})).await;
    assert_eq!(points(&centre.instructor, "").await, before);
    // 300 − 145.2 = 154.8 points without an error, and 154.8 / 300 × 100 = 51.6.
    let amounts = json!({"amounts": {"deviation": 0}});
    assert_eq!(centre.instructor.put(&format!("{at}/error-sheet"), amounts).await.status(), StatusCode::OK);
    let finish = centre.instructor.post(&format!("{at}/error-sheet/finish"), json!({})).await;
    assert_eq!(finish.status(), StatusCode::OK);
    let after = points(&centre.trainee, "").await;
    assert!((after[0].1[1].as_f64().unwrap() - 51.6).abs() < 1e-6, "{after:?}");
    assert!((after[0].1[3].as_f64().unwrap() - after[0].1[2].as_f64().unwrap() - 0.8 / 3.0).abs() < 1e-6, "{after:?}");

    let groups = centre.administrator.read("/api/v1/groups").await;
    let groups: Vec<&Value> = groups["items"].as_array().unwrap().iter().map(|group| &group["id"]).collect();
    let task = json!({"name": "Knot", "code": "knot", "groups": groups});
    centre.administrator.make("/api/v1/tasks", task).await;
    planter.move_session(at.rsplit('/').next().unwrap(), "ada", "knot").await;
    let progress = centre.trainee.read("/api/v1/trainees/ada/progress?task=knot").await;
    assert_eq!(progress["error_scores"], json!([]), "{progress}");
    assert_eq!(progress["sessions"].as_array().unwrap().len(), 1);
}
