//! Streams that are pushed in one request, while the service or its child is killed: the part that arrived becomes a
//! session, at once or at the next start.

use reqwest::Method;
use rustix::process::{Signal, kill_process};
use serde_json::Value;

use super::Centre;
use crate::feed::push::Pushing;
use crate::feed::scene::remuxed;
use crate::support::{poll_until, problem};

const PATH: &str = "/boxes/box-1/feed.ts?trainee=ada&task=pegs";

/// Begins a push and sends a part of its stream. Returns the push and its session.
async fn begin_push(centre: &Centre, stream: &[u8]) -> (Pushing, String) {
    let mut pushing = Pushing::begin(centre.request(Method::PUT, PATH));
    pushing.send(&stream[..stream.len() * 4 / 5]).await;
    let arrives = |sessions: &Value| sessions["items"][0]["id"].is_string();
    let sessions = centre.until("/sessions?status=receiving", arrives).await;
    let logs = centre.data().join("feeds");
    let has_bytes = |log: std::fs::DirEntry| log.metadata().unwrap().len() > 0;
    poll_until("frames in the log", || std::fs::read_dir(&logs).unwrap().flatten().any(has_bytes)).await;
    (pushing, sessions["items"][0]["id"].as_str().unwrap().to_owned())
}

async fn centre() -> Centre {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    Centre::open_bare(folder, data, |_| ()).await
}

#[tokio::test(flavor = "multi_thread")]
async fn the_stored_part_of_a_push_becomes_a_session_at_the_next_start_after_a_kill() {
    let mut centre = centre().await;
    let Some(stream) = remuxed(&centre.scene("clip.mp4"), "mpegts") else { return };
    let (pushing, session) = begin_push(&centre, &stream).await;
    centre.kill();
    pushing.cut().await;
    centre.restart().await;
    centre.until(&format!("/sessions/{session}"), |session| session["status"] != "receiving").await;
    let video = centre.get(&format!("/sessions/{session}/video")).await;
    assert!(!video.bytes().await.unwrap().is_empty());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_push_whose_child_dies_ends_with_the_part_that_arrived() {
    let centre = centre().await;
    let Some(stream) = remuxed(&centre.scene("clip.mp4"), "matroska") else { return };
    let (pushing, session) = begin_push(&centre, &stream).await;
    let children = centre.children(); // the box has no camera and colours, so no child tracks
    assert_eq!(children.len(), 1);
    kill_process(children[0], Signal::KILL).unwrap();
    let refused = problem(pushing.answered().await, 500, "internal").await;
    assert!(refused["detail"].as_str().unwrap().contains("killed"), "{refused}");
    assert_eq!(refused["session"], format!("/api/v1/sessions/{session}"));
    centre.until(&format!("/sessions/{session}"), |session| session["status"] != "receiving").await;
}
