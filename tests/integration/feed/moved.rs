//! A camera that was moved between two recordings: the positions of the trocars show it, while the second recording
//! arrives and in its result.

use reqwest::{Method, StatusCode, header};
use serde_json::{Value, json};

use super::RECORDING;
use super::live::{Watcher, begin, send, wait_until_done};
use super::scene::{Folder, Scene, set_up_box};
use crate::api::centre::Centre;
use crate::support::{Service, read};

/// Options of scenes that locate a trocar well, at a low frame rate.
const SCENE: &str = "--view side --size 960x540 --fps 10";
const MOVED_MM: f64 = 30.0;
/// Length of the recording with the moved camera, s: about 13 s of a tool's measurements locate its trocar, and a
/// displacement must last for 10 s to be reported live.
const MOVED_S: u32 = 45;
/// How well the displacement of the trocars shows that of the camera, in pictures of 540 lines.
const WITHIN_MM: f64 = 8.0;

async fn upload(centre: &Centre, trainee: &str, task: &str, folder: &Folder) -> Value {
    let path = format!("/api/v1/sessions?trainee={trainee}&task={task}&box=box-1&filename=clip.mp4");
    let clip = std::fs::read(folder.file("clip.mp4")).unwrap();
    let request = centre.administrator.request(Method::POST, &path).header(header::CONTENT_TYPE, "video/mp4");
    let session = read(request.body(clip).send().await.unwrap(), StatusCode::CREATED).await;
    wait_until_done(&centre.administrator, session["id"].as_str().unwrap()).await
}

fn reasons(session: &Value) -> Vec<&str> {
    session["quality"]["reasons"].as_array().unwrap().iter().map(|reason| reason["name"].as_str().unwrap()).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_moved_camera_is_reported_live_and_with_the_result() {
    let options = format!("{SCENE} --seed 9 --seconds {MOVED_S} --camera-moved-mm {MOVED_MM}");
    let Some(moved) = Scene::in_folder(Folder::of(&options)) else { return };
    let before = Folder::of(&format!("{SCENE} --seed 1 --seconds 25"));
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    set_up_box(&centre.administrator, "box-1", &before).await;
    centre.administrator.make("/api/v1/tasks", json!({"name": "Again", "code": "again"})).await;
    for (trainee, task) in [("ada", "peg"), ("bob", "peg"), ("ada", "again"), ("bob", "again")] {
        let session = upload(&centre, trainee, task, &before).await;
        let tools = session["quality"]["tools"].as_array().unwrap();
        assert!(tools.iter().all(|tool| tool["fulcrum"].is_object()), "{tools:?}");
        // A comparison needs at least three earlier sessions.
        let is_compared = (trainee, task) == ("bob", "again");
        assert!(tools.iter().all(|tool| tool["port_shift"].is_object() == is_compared), "{tools:?}");
        assert!(!reasons(&session).iter().any(|reason| reason.ends_with("_moved")), "{}", session["quality"]);
        assert_eq!(session["quality"]["recording"]["box"]["finding"], "same", "{}", session["quality"]);
    }

    let (mut sender, id) = begin(&centre, &moved, RECORDING).await;
    let mut watcher = Watcher::of_tracked(&centre, &id).await;
    let all = moved.frames.len();
    send(&mut sender, &moved, 0..all).await;
    sender.send_json(&json!({"type": "end", "frames": all})).await;
    let mut placements = Vec::new();
    let live = loop {
        let message = watcher.next_of_type("features").await;
        if message["placement"]["camera"].is_object() {
            break message["placement"].clone();
        }
        placements.push(message["placement"].clone());
    };
    assert_eq!(placements[0], Value::Null, "nothing is known at the start");
    assert!((live["camera"]["mm"].as_f64().unwrap() - MOVED_MM).abs() < WITHIN_MM, "{live}");
    assert_eq!(live["ports"], json!([null, null]), "only the camera has moved");

    let session = wait_until_done(&centre.administrator, &id).await;
    assert!(reasons(&session).contains(&"camera_moved"), "{}", session["quality"]);
    assert_eq!(session["quality"]["recording"]["box"]["finding"], "moved", "{}", session["quality"]);
    assert_eq!(session["box_question"], Value::Null, "the same box that moved is not asked about");
    let reason =
        session["quality"]["reasons"].as_array().unwrap().iter().find(|r| r["name"] == "camera_moved").unwrap();
    assert!((reason["figure"].as_f64().unwrap() - MOVED_MM).abs() < WITHIN_MM, "{reason}");
    assert_eq!((reason["severity"].as_str(), reason["limit"].as_f64()), (Some("care"), Some(5.0)));
    assert!(session["features"].as_array().unwrap().iter().any(|feature| feature["value"].is_number()), "kept");
}
