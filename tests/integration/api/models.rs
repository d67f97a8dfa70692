//! Models of skill, as a client sees them.

use std::ops::Range;

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::centre::Centre;
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration, measured};
use crate::support::{Client, problem, read};
use trocar::domain::session::{FeatureRow, FeatureSpace};
use trocar::pipeline::PIPELINE_VERSION;

const MODELS: &str = "/api/v1/tasks/peg/models";
const LEVELS: [&str; 3] = ["expert", "intermediate", "novice"];

/// What somebody who takes so long measures; `off` is their own.
fn features(seconds: f64, off: f64) -> Vec<FeatureRow> {
    let path = |tool| measured("path_length", "mm", Some(tool), FeatureSpace::Space3d, 900.0 + 40.0 * off, 8.0);
    vec![duration(seconds + 4.0 * off, 0.5), path("orange")]
}

/// People of the three levels in turn with one session each; levels lie half a minute apart.
async fn people(centre: &Centre, planter: &Planter, numbers: Range<usize>) {
    for number in numbers {
        let (level, name) = (LEVELS[number % 3], format!("person-{number}"));
        centre.administrator.make("/api/v1/trainees", json!({"name": name, "level": level})).await;
        let off = ((number * 37) % 23) as f64 / 11.0 - 1.0;
        let rows = features(40.0 + 30.0 * (number % 3) as f64, off);
        planter.session(planter.trainee(&name).await, NEW_YEAR_MS + number as i64, rows).await;
    }
}

/// The verdict of Ada's last session.
async fn verdict(client: &Client) -> Value {
    let sessions = client.read("/api/v1/sessions?trainee=ada").await;
    let id = sessions["items"][0]["id"].as_str().unwrap();
    assert_eq!(sessions["items"][0]["verdict"], Value::Null, "lists have none");
    client.read(&format!("/api/v1/sessions/{id}")).await["verdict"].clone()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_model_is_made_of_people_judges_a_session_and_goes_with_the_first_of_them() {
    let centre = Centre::open().await;
    let planter = Planter::beside(&centre.service.data.path().join("trocar.db")).await;
    let ada = planter.trainee("ada").await;
    planter.session(ada, NEW_YEAR_MS, features(41.0, 0.0)).await;
    assert_eq!(verdict(&centre.trainee).await["reason"]["name"], "no_model");

    people(&centre, &planter, 0..21).await;
    let refused = problem(centre.administrator.post(MODELS, json!({})).await, 409, "conflict").await;
    assert_eq!(
        (&refused["reason"], &refused["missing"]),
        (&json!("too_few_people"), &json!({"novice": 1, "intermediate": 1, "expert": 1}))
    );
    people(&centre, &planter, 21..24).await;
    for client in [&centre.instructor, &centre.trainee, &centre.agent] {
        problem(client.post(MODELS, json!({})).await, 403, "forbidden").await;
    }
    let made = read(centre.administrator.post(MODELS, json!({})).await, StatusCode::CREATED).await;
    assert_eq!(
        (&made["version"], &made["report"]["people"], &made["report"]["knows"]),
        (&json!(1), &json!([8, 8, 8]), &json!(true))
    );
    let (accuracy, baseline) = (&made["report"]["accuracy"], &made["report"]["baseline"]);
    assert!(accuracy["low"].as_f64() > Some(0.5) && accuracy["people"] == 24, "{made}");
    assert!(baseline["p"].as_f64() <= Some(0.05) && baseline["permutations"] == 99, "{made}");
    assert_eq!(made["fingerprint"].as_str().unwrap().len(), 64);

    // Everybody reads what it is worth; whose values it is made of, nobody.
    let read_by_trainee = centre.trainee.read(&format!("{MODELS}/1")).await;
    assert_eq!((&read_by_trainee["report"], &read_by_trainee["fingerprint"]), (&made["report"], &Value::Null));
    assert!(read_by_trainee["who"].is_null() && read_by_trainee["scorer"].is_null());
    problem(centre.trainee.get(&format!("{MODELS}/2")).await, 404, "not-found").await;
    problem(centre.trainee.get(&format!("{MODELS}/first")).await, 404, "not-found").await;

    // The trainee and those who teach them see what it says; others do not see the session.
    let said = verdict(&centre.trainee).await;
    assert_eq!((&said["level"], &said["model"]), (&json!("expert"), &json!(1)), "{said}");
    assert!(said["probabilities"]["expert"].as_f64() > Some(0.6) && said["accuracy"] == *accuracy, "{said}");
    assert_eq!(said["accuracy_where_given"], made["report"]["speaking"]["of_level"][2], "{said}");
    assert_eq!(said["carried"][0]["feature"], "duration", "{said}");
    assert_eq!(verdict(&centre.instructor).await, said);
    let hidden = centre.other_instructor.read("/api/v1/sessions?trainee=ada").await;
    assert_eq!(hidden["items"], json!([]));

    // Of those whom it was made of it says nothing.
    let theirs = centre.administrator.read("/api/v1/sessions?trainee=person-1").await;
    let theirs =
        centre.administrator.read(&format!("/api/v1/sessions/{}", theirs["items"][0]["id"].as_str().unwrap())).await;
    let said = &theirs["verdict"];
    assert_eq!((&said["level"], &said["reason"]["name"]), (&Value::Null, &json!("in_training")), "{said}");

    // What it cannot judge it says so of.
    for (day, rows, made, why) in [
        (1, features(900.0, 0.0), (PIPELINE_VERSION, "valid"), "outside"),
        (2, vec![], (PIPELINE_VERSION, "valid"), "not_measured"),
        (3, features(41.0, 0.0), ("1", "valid"), "other_pipeline"),
        (4, features(41.0, 0.0), (PIPELINE_VERSION, "refused"), "refused"),
    ] {
        planter.result(ada, NEW_YEAR_MS + day * DAY_MS, rows, made).await;
        let said = verdict(&centre.trainee).await;
        assert_eq!((&said["level"], &said["reason"]["name"]), (&Value::Null, &json!(why)), "{said}");
    }

    // With one of them the model goes, and says why.
    let erased = centre.administrator.delete("/api/v1/trainees/person-0").await;
    assert_eq!(erased.status(), StatusCode::NO_CONTENT);
    planter.session(ada, NEW_YEAR_MS + 9 * DAY_MS, features(41.0, 0.0)).await;
    assert_eq!(verdict(&centre.trainee).await["reason"]["name"], "withdrawn");
    let withdrawn = centre.trainee.read(MODELS).await["items"][0].clone();
    assert!(withdrawn["withdrawn_at"].is_string() && withdrawn["features"].is_null(), "{withdrawn}");
    let few = problem(centre.administrator.post(MODELS, json!({})).await, 409, "conflict").await;
    assert_eq!(few["missing"]["expert"], 1, "{few}");
}
