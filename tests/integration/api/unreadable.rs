//! Recordings that cannot be read: the session says why, and states no figure that is not measured.

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::centre::{Centre, recording, session};
use crate::feed::scene::{Folder, set_up_box};
use crate::support::Service;

/// What is known only of a recording that was decoded.
const OF_PICTURES: [&str; 5] = ["width", "height", "frames", "duration_s", "clock"];

#[tokio::test(flavor = "multi_thread")]
async fn an_unreadable_recording_says_why_and_has_no_size_and_no_frames() {
    let scene = Folder::of("--seed 3 --seconds 2 --size 640x360");
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    set_up_box(&centre.administrator, "box-1", &scene).await;
    let text = "Dear diary, this is no video.\n".repeat(100).into_bytes();
    for (content, problem, advice) in [
        (text, "/problems/not-a-video", "accepted are MP4/MOV"),
        (recording(5_000, 9), "/problems/recording-cut-off", "before its index was written"),
    ] {
        let made = session(&centre.trainee, "ada", content.clone()).await;
        let address = format!("/api/v1/sessions/{}", made["id"].as_str().unwrap());
        let failed = centre.trainee.read_until(&address, |session| session["status"] == "failed").await;
        let (error, video) = (&failed["error"], &failed["video"]);
        assert_eq!((&error["type"], &error["status"]), (&json!(problem), &json!(422)));
        assert!(error["detail"].as_str().unwrap().contains(advice), "{error}");
        assert_eq!((&video["bytes"], &video["sha256"]), (&json!(content.len()), &made["video"]["sha256"]));
        assert!(OF_PICTURES.iter().all(|key| video[*key].is_null()), "{video}");
        assert_eq!((&failed["retry_can_help"], &failed["quarantined"]), (&json!(false), &json!(false)));
        assert_eq!((&failed["features"], &failed["tools"], &failed["quality"]), (&json!([]), &json!([]), &Value::Null));
        assert_eq!(centre.trainee.read(&format!("{address}/results")).await["items"], json!([]));
        for part in ["trajectory?format=csv&kind=smoothed", "features", "diagnostics", "preview.jpg"] {
            let answer = centre.trainee.get(&format!("{address}/{part}")).await;
            assert_eq!(answer.status(), StatusCode::CONFLICT, "{part}");
        }
        assert_eq!(centre.trainee.get(&format!("{address}/video")).await.bytes().await.unwrap(), content);
    }

    let made = session(&centre.trainee, "ada", std::fs::read(scene.file("clip.mp4")).unwrap()).await;
    let address = format!("/api/v1/sessions/{}", made["id"].as_str().unwrap());
    let done = centre.trainee.read_until(&address, |session| session["status"] == "done").await;
    let video = &done["video"];
    assert_eq!((&video["width"], &video["height"], &done["error"]), (&json!(640), &json!(360), &Value::Null));
    assert!(OF_PICTURES.iter().all(|key| !video[*key].is_null()), "{video}");
    assert_eq!(done["retry_can_help"], true);
}
