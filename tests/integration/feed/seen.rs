//! How well tools are seen while a recording arrives, and in its result: by one definition.

use serde_json::{Value, json};

use super::RECORDING;
use super::live::{Watcher, begin, centre, send, wait_until_done};
use super::scene::{Folder, Scene};
use crate::api::centre::Centre;

/// How far the shares of frames may differ: the whole recording shows the trocar, which confirms or rejects single
/// measurements (docs/quality_gate.md).
const MAX_DIFFERENCE: f64 = 0.03;

/// Pictures of this size show depth well enough: the error of a live position is below its limit from the start.
const SCENE: &str = "--seed 5 --seconds 8 --size 1280x720";

/// Sends a scene; returns the last message to watchers about each tool, and the finished session.
async fn send_all(centre: &Centre, scene: &Scene) -> (Vec<Value>, Value) {
    let (mut sender, id) = begin(centre, scene, RECORDING).await;
    let mut watcher = Watcher::of_tracked(centre, &id).await;
    let all = scene.frames.len();
    send(&mut sender, scene, 0..all).await;
    sender.send_json(&json!({"type": "end", "frames": all})).await;
    let mut seen = Vec::new();
    while let Some(features) = watcher.next_before_end("features").await {
        seen.clone_from(features["seen"].as_array().unwrap());
    }
    (seen, wait_until_done(&centre.instructor, &id).await)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_that_live_calls_good_is_not_refused() {
    let Some(scene) = Scene::in_folder(Folder::of(SCENE)) else { return };
    let centre = centre(&scene).await;
    let (seen, session) = send_all(&centre, &scene).await;
    let tools = session["quality"]["tools"].as_array().unwrap();
    assert_eq!((seen.len(), tools.len()), (2, 2), "{seen:?}");
    for (live, result) in seen.iter().zip(tools) {
        assert_eq!(live["reason"], Value::Null, "live calls it good: {live}");
        let [live, result] = [live, result].map(|tool| tool["coverage"].as_f64().unwrap());
        assert!(live >= 0.9 && (live - result).abs() <= MAX_DIFFERENCE, "{live} live, {result} in the result");
    }
    assert_ne!(session["quality"]["verdict"], "refused", "{}", session["quality"]["reasons"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_tool_that_would_refuse_the_session_is_not_called_good_live() {
    let Some(other) = Scene::in_folder(Folder::of(&format!("{SCENE} --tapes orange,lime"))) else { return };
    let Some(known) = Scene::in_folder(Folder::of(SCENE)) else { return };
    let centre = centre(&known).await;
    let (seen, session) = send_all(&centre, &other).await;
    let result = &session["quality"];
    let cyan = seen.iter().zip(result["tools"].as_array().unwrap()).find(|(_, tool)| tool["tool"] == "cyan").unwrap().0;
    assert!(cyan["coverage"].as_f64().is_none_or(|share| share < 0.5) && cyan["reason"].is_object(), "{cyan} {result}");
    let orange =
        seen.iter().zip(result["tools"].as_array().unwrap()).find(|(_, tool)| tool["tool"] == "orange").unwrap();
    assert_eq!(orange.0["reason"], Value::Null, "{orange:?}");
}
