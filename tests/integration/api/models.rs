//! Models of skill, as a client sees them.

use std::ops::Range;

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::centre::Centre;
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration, measured};
use crate::support::{Client, problem, read};
use trocar::domain::session::{FeatureRow, FeatureSpace};
use trocar::motion::PIPELINE_VERSION;

const MODELS: &str = "/api/v1/tasks/peg/models";
const LEVELS: [&str; 3] = ["expert", "intermediate", "novice"];

/// The features of a session that takes `seconds`; `off` is the person's own deviation.
fn features(seconds: f64, off: f64) -> Vec<FeatureRow> {
    let path = |tool| measured("path_length", "mm", Some(tool), FeatureSpace::Space3d, 900.0 + 40.0 * off, 8.0);
    vec![duration(seconds + 4.0 * off, 0.5), path("orange")]
}

/// Adds people with one session each, alternating between the three levels, which differ by 30 s.
async fn add_people(centre: &Centre, planter: &Planter, numbers: Range<usize>) {
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
    assert_eq!(sessions["items"][0]["verdict"], Value::Null, "lists contain no verdict");
    client.read(&format!("/api/v1/sessions/{id}")).await["verdict"].clone()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_model_judges_a_session_and_is_withdrawn_when_one_of_its_people_is_erased() {
    let centre = Centre::open().await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let ada = planter.trainee("ada").await;
    planter.session(ada, NEW_YEAR_MS, features(41.0, 0.0)).await;
    assert_eq!(verdict(&centre.trainee).await["reason"]["name"], "no_model");

    add_people(&centre, &planter, 0..21).await;
    let refused = problem(centre.administrator.post(MODELS, json!({})).await, 409, "conflict").await;
    assert_eq!(
        (&refused["reason"], &refused["missing"]),
        (&json!("too_few_people"), &json!({"novice": 1, "intermediate": 1, "expert": 1}))
    );
    add_people(&centre, &planter, 21..24).await;
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

    // Everyone may read the report of the model. Its fingerprint, author and scorer are hidden from trainees.
    let read_by_trainee = centre.trainee.read(&format!("{MODELS}/1")).await;
    assert_eq!((&read_by_trainee["report"], &read_by_trainee["fingerprint"]), (&made["report"], &Value::Null));
    assert!(read_by_trainee["who"].is_null() && read_by_trainee["scorer"].is_null());
    problem(centre.trainee.get(&format!("{MODELS}/2")).await, 404, "not-found").await;
    problem(centre.trainee.get(&format!("{MODELS}/first")).await, 404, "not-found").await;

    // The trainee and their instructor see the verdict; others do not see the session.
    let judged = verdict(&centre.trainee).await;
    assert_eq!((&judged["level"], &judged["model"]), (&json!("expert"), &json!(1)), "{judged}");
    assert!(judged["probabilities"]["expert"].as_f64() > Some(0.6) && judged["accuracy"] == *accuracy, "{judged}");
    assert_eq!(judged["accuracy_where_given"], made["report"]["speaking"]["of_level"][2], "{judged}");
    assert_eq!(judged["carried"][0]["feature"], "duration", "{judged}");
    assert_eq!(verdict(&centre.instructor).await, judged);
    let hidden = centre.other_instructor.read("/api/v1/sessions?trainee=ada").await;
    assert_eq!(hidden["items"], json!([]));

    // The model gives no verdict about people in its own training data.
    let list = centre.administrator.read("/api/v1/sessions?trainee=person-1").await;
    let session =
        centre.administrator.read(&format!("/api/v1/sessions/{}", list["items"][0]["id"].as_str().unwrap())).await;
    let withheld = &session["verdict"];
    assert_eq!((&withheld["level"], &withheld["reason"]["name"]), (&Value::Null, &json!("in_training")), "{withheld}");

    // A session that the model cannot judge gets the reason.
    for (day, rows, made, why) in [
        (1, features(900.0, 0.0), (PIPELINE_VERSION, "valid"), "outside"),
        (2, vec![], (PIPELINE_VERSION, "valid"), "not_measured"),
        (3, features(41.0, 0.0), ("1", "valid"), "other_pipeline"),
        (4, features(41.0, 0.0), (PIPELINE_VERSION, "refused"), "refused"),
    ] {
        planter.result(ada, NEW_YEAR_MS + day * DAY_MS, rows, made).await;
        let withheld = verdict(&centre.trainee).await;
        assert_eq!((&withheld["level"], &withheld["reason"]["name"]), (&Value::Null, &json!(why)), "{withheld}");
    }

    // Erasing one of its people withdraws the model, with the reason.
    let erased = centre.administrator.delete("/api/v1/trainees/person-0").await;
    assert_eq!(erased.status(), StatusCode::NO_CONTENT);
    planter.session(ada, NEW_YEAR_MS + 9 * DAY_MS, features(41.0, 0.0)).await;
    assert_eq!(verdict(&centre.trainee).await["reason"]["name"], "withdrawn");
    let withdrawn = centre.trainee.read(MODELS).await["items"][0].clone();
    assert!(withdrawn["withdrawn_at"].is_string() && withdrawn["features"].is_null(), "{withdrawn}");
    let few = problem(centre.administrator.post(MODELS, json!({})).await, 409, "conflict").await;
    assert_eq!(few["missing"]["expert"], 1, "{few}");
}
