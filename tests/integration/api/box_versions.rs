//! Which calibration and colours a recording is tracked with, and the dates that staff give to versions.

use serde_json::{Value, json};

use super::centre::Centre;
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration, plant_palette};
use crate::support::{problem, read};

const CAMERA: &str = "/api/v1/boxes/box-1/camera";

async fn versions(centre: &Centre, of: &str) -> Vec<Value> {
    centre.administrator.read(&format!("/api/v1/boxes/box-1/{of}")).await["items"].as_array().unwrap().clone()
}

fn address(of: &str, version: &Value) -> String {
    format!("/api/v1/boxes/box-1/{of}/{}", version["id"].as_str().unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_says_which_versions_it_was_tracked_with_and_which_are_valid_now() {
    let centre = Centre::open().await;
    let database = centre.service.data.path().join("trocar.db");
    let planter = Planter::open(&database).await;
    let ada = planter.trainee("ada").await;
    planter.session(ada, NEW_YEAR_MS, vec![duration(40.0, 1.0)]).await;
    let sessions = centre.administrator.read("/api/v1/sessions").await;
    assert_eq!(sessions["items"][0]["setup"], Value::Null, "not in lists");
    let sha256 = sessions["items"][0]["video"]["sha256"].as_str().unwrap();
    for (client, found) in [(&centre.trainee, 1), (&centre.instructor, 1), (&centre.other_instructor, 0)] {
        let same = client.read(&format!("/api/v1/sessions?sha256={sha256}")).await;
        assert_eq!(same["items"].as_array().unwrap().len(), found, "{same}");
    }
    let other = "0".repeat(64);
    assert_eq!(centre.trainee.read(&format!("/api/v1/sessions?sha256={other}")).await["items"], json!([]));
    problem(centre.trainee.get("/api/v1/sessions?sha256=x").await, 422, "invalid").await;
    let at = format!("/api/v1/sessions/{}", sessions["items"][0]["id"].as_str().unwrap());
    let setup = async || centre.trainee.read(&at).await["setup"].clone();

    let first = versions(&centre, "calibrations").await.remove(0);
    assert_eq!((&first["in_use"], &first["valid_from"]), (&json!(true), &first["created_at"]));
    let before = setup().await;
    for part in ["calibration", "palette"] {
        let used = &before[part];
        assert_eq!(
            (&used["version"], &used["is_later"], &used["valid_version"]),
            (&json!(1), &json!(true), &Value::Null)
        );
    }
    // The camera of an earlier day, from a file.
    let earlier = json!({"width": 640, "height": 480, "fx": 510, "fy": 510, "cx": 320, "cy": 240});
    let put = centre.instructor.put(&format!("{CAMERA}?valid_from=2025-06-01T00:00:00Z"), earlier).await;
    let added = read(put, reqwest::StatusCode::OK).await;
    assert_eq!((&added["version"], &added["in_use"]), (&json!(2), &json!(false)));
    assert_eq!(centre.instructor.read(CAMERA).await["fx"], 500.1, "recordings made now keep their camera");
    assert_eq!(centre.instructor.read("/api/v1/boxes/box-1").await["calibration"]["version"], 1);
    assert_eq!(setup().await["calibration"]["valid_version"], 2, "the result is of version 1");

    let dated = json!({"valid_from": "2025-12-31T00:00:00Z"});
    let all =
        read(centre.instructor.patch(&address("calibrations", &first), dated).await, reqwest::StatusCode::OK).await;
    assert_eq!(all["items"][1]["valid_from"], "2025-12-31T00:00:00Z");
    let used = setup().await["calibration"].clone();
    assert_eq!((&used["is_later"], &used["valid_version"]), (&json!(false), &Value::Null));
    let own = json!({"valid_from": null});
    centre.instructor.patch(&address("calibrations", &first), own.clone()).await;
    assert_eq!(versions(&centre, "calibrations").await[1]["valid_from"], first["created_at"]);

    let of = centre.administrator.read("/api/v1/boxes/box-1").await["id"].as_str().unwrap().to_owned();
    plant_palette(&database, &of, 2, NEW_YEAR_MS - DAY_MS).await;
    assert_eq!(setup().await["palette"]["valid_version"], 2);
    let palettes = versions(&centre, "palettes").await;
    let [first, second] = [1, 2].map(|version| palettes.iter().find(|one| one["version"] == version).unwrap());
    assert_eq!((&second["in_use"], &first["in_use"]), (&json!(false), &json!(true)));
    let late = json!({"valid_from": "2026-02-01T00:00:00Z"});
    centre.instructor.patch(&address("palettes", second), late).await;
    let later = json!({"valid_from": "2026-01-03T00:00:00Z"}); // more than a day after the recording
    centre.instructor.patch(&address("palettes", first), later).await;
    assert_eq!(setup().await["palette"]["valid_version"], Value::Null);

    let audit = centre.administrator.read("/api/v1/audit-entries?limit=20").await;
    let changes = audit["items"].as_array().unwrap().iter().filter(|entry| entry["action"] == "change");
    let nouns: Vec<(&str, &str)> =
        changes.map(|entry| (entry["noun"].as_str().unwrap(), entry["called"].as_str().unwrap())).collect();
    assert_eq!(
        nouns[..4],
        [("palette", "Box 1"), ("palette", "Box 1"), ("calibration", "Box 1"), ("calibration", "Box 1")]
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn impossible_dates_are_refused_by_name() {
    let centre = Centre::open().await;
    Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let at = address("calibrations", &versions(&centre, "calibrations").await[0]);
    for wrong in
        [json!({"valid_from": "yesterday"}), json!({"valid_from": "2999-01-01T00:00:00Z"}), json!({"valid_from": 1})]
    {
        let refused = problem(centre.administrator.patch(&at, wrong.clone()).await, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], "valid_from", "{wrong}");
    }
    problem(centre.administrator.patch(&at, json!({})).await, 422, "invalid").await;
    let camera = json!({"width": 640, "height": 480, "fx": 510, "fy": 510, "cx": 320, "cy": 240});
    let late = centre.administrator.put(&format!("{CAMERA}?valid_from=2999-01-01T00:00:00Z"), camera).await;
    problem(late, 422, "invalid").await;
    // A version of another box.
    centre.administrator.make("/api/v1/boxes", json!({"name": "Box 2", "code": "box-2"})).await;
    let of_another = at.replace("box-1", "box-2");
    problem(centre.administrator.patch(&of_another, json!({"valid_from": null})).await, 404, "not-found").await;
    assert_eq!(versions(&centre, "calibrations").await.len(), 1);
}
