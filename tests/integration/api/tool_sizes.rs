//! Corrected sizes of a box's tools: a new version of its colours, without new marks.

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::centre::Centre;
use crate::planted::Planter;
use crate::support::{problem, read};

#[tokio::test(flavor = "multi_thread")]
async fn corrected_sizes_keep_the_marks_and_impossible_ones_are_refused() {
    let centre = Centre::open().await;
    let at = "/api/v1/boxes/box-1/tool-sizes";
    let sizes = |tools: Value| json!({"tools": tools});
    let orange =
        |diameter_mm: f64| sizes(json!([{"tool": "orange", "diameter_mm": diameter_mm, "band_length_mm": 20.0}]));
    problem(centre.instructor.put(at, orange(5.2)).await, 409, "conflict").await;
    Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let palettes = async || centre.instructor.read("/api/v1/boxes/box-1/palettes").await["items"].clone();
    let before = palettes().await[0].clone();
    assert_eq!((&before["version"], &before["tools"][0]["diameter_mm"]), (&json!(1), &json!(8.0)));

    let made = read(centre.instructor.put(at, orange(5.2)).await, StatusCode::OK).await;
    assert_eq!((&made["version"], &made["tools"][0]["diameter_mm"]), (&json!(2), &json!(5.2)));
    assert_eq!(made["tools"][0]["band_length_mm"], 20.0);
    assert_eq!((&made["counts"], &made["verdicts"]), (&before["counts"], &before["verdicts"]));
    assert_eq!(made["annotations"]["labels"], before["annotations"]["labels"]);
    let again = read(centre.instructor.put(at, orange(5.2)).await, StatusCode::OK).await;
    assert_eq!(again["id"], made["id"], "the same sizes make no new version");
    let of_box = centre.trainee.read("/api/v1/boxes/box-1").await;
    assert_eq!(of_box["tools"][0]["diameter_mm"], 5.2);
    let audit = centre.administrator.read("/api/v1/audit-entries?limit=1").await;
    assert_eq!(
        (&audit["items"][0]["action"], &audit["items"][0]["noun"]),
        (&json!("change tool sizes"), &json!("box"))
    );

    for (tools, reason) in [
        (json!([{"tool": "orange", "diameter_mm": 50.0}]), "expected 2 to 15 mm"),
        (json!([{"tool": "orange", "diameter_mm": 5.0, "band_length_mm": 2.8}]), "expected 5 to 150 mm"),
        (json!([]), "has no new size"),
        (
            json!([{"tool": "orange", "diameter_mm": 5.0}, {"tool": "cyan", "diameter_mm": 5.0}]),
            "is not among the tools",
        ),
        (json!([{"tool": "orange", "diameter_mm": 5.0, "marker": {"kind": "shaft"}}]), "another kind of marker"),
    ] {
        let refused = problem(centre.instructor.put(at, sizes(tools)).await, 422, "invalid").await;
        let error = &refused["errors"][0];
        assert_eq!(error["field"], "tools");
        assert!(error["message"].as_str().unwrap().contains(reason), "{error}");
    }
    assert_eq!(palettes().await.as_array().unwrap().len(), 2);
}
