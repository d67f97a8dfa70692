//! Watching a recording while it arrives: live positions equal those of the causal tracker on the same frames, and the
//! recording's result equals that of the same clip uploaded.

use std::time::{Duration, Instant};

use futures_util::StreamExt;
use reqwest::StatusCode;
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};
use trocar::domain::feed::record::{FeedRecord, RecordBody};
use trocar::motion::features::running::LIVE_FEATURES;

use super::scene::{Scene, causal_path, set_up_box};
use super::sender::{Received, Sender, hello, open};
use super::{ANOTHER, RECORDING};
use crate::api::centre::{Centre, PASSWORD, session, set_members};
use crate::support::{Client, Service, soon};

/// A message to a watcher.
#[derive(Debug)]
enum LiveMessage {
    Json(Value),
    Picture(u64, Vec<u8>),
    Closed,
}

pub(super) struct Watcher(WebSocketStream<MaybeTlsStream<TcpStream>>);

impl Watcher {
    async fn open(centre: &Centre, client: &Client, session: &str) -> Result<Self, u16> {
        let address = format!("ws://{}/api/v1/sessions/{session}/live", centre.service.address());
        let mut request = address.into_client_request().unwrap();
        request.headers_mut().extend(client.headers().clone());
        match soon("watching", connect_async(request)).await {
            Ok((socket, _)) => Ok(Self(socket)),
            Err(Error::Http(answer)) => Err(answer.status().as_u16()),
            Err(error) => panic!("{error}"),
        }
    }

    /// An instructor's watcher, once the recording is tracked.
    pub(super) async fn of_tracked(centre: &Centre, session: &str) -> Self {
        let mut watcher = Self::open(centre, &centre.instructor, session).await.unwrap();
        while watcher.next_of_type("live").await["tools"].is_null() {}
        watcher
    }

    async fn next(&mut self) -> LiveMessage {
        loop {
            match soon("a live message", self.0.next()).await {
                Some(Ok(Message::Text(text))) => return LiveMessage::Json(serde_json::from_str(&text).unwrap()),
                Some(Ok(Message::Binary(bytes))) => {
                    let (head, jpeg) = bytes.split_first_chunk::<8>().unwrap();
                    return LiveMessage::Picture(u64::from_be_bytes(*head), jpeg.to_vec());
                }
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                _ => return LiveMessage::Closed,
            }
        }
    }

    /// The next message of a type.
    pub(super) async fn next_of_type(&mut self, kind: &str) -> Value {
        loop {
            match self.next().await {
                LiveMessage::Json(message) if message["type"] == kind => return message,
                LiveMessage::Closed => panic!("closed before {kind}"),
                _ => {}
            }
        }
    }
}

impl Watcher {
    /// The next message in JSON; `None` once the recording has ended.
    pub(super) async fn next_json_before_end(&mut self) -> Option<Value> {
        loop {
            match self.next().await {
                LiveMessage::Json(message) if message["type"] == "ended" => return None,
                LiveMessage::Json(message) => return Some(message),
                LiveMessage::Picture(..) => {}
                LiveMessage::Closed => panic!("closed before the end"),
            }
        }
    }

    /// The next message of a type; `None` once the recording has ended.
    pub(super) async fn next_before_end(&mut self, kind: &str) -> Option<Value> {
        loop {
            let message = self.next_json_before_end().await?;
            if message["type"] == kind {
                return Some(message);
            }
        }
    }
}

pub(super) async fn centre(scene: &Scene) -> Centre {
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    set_up_box(&centre.administrator, "box-1", &scene.folder).await;
    centre
}

/// Begins to send a scene; returns the session's id too.
pub(super) async fn begin(centre: &Centre, scene: &Scene, recording: &str) -> (Sender, String) {
    let mut sender = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
    let mut message = hello(recording);
    message["codec"] = json!("h264");
    (message["width"], message["height"]) = (json!(scene.size.0), json!(scene.size.1));
    message["time_base"] = json!([1, scene.ticks_per_s]);
    sender.send_json(&message).await;
    let Received::Json(welcome) = sender.receive().await else { panic!("no welcome") };
    assert_eq!(welcome["type"], "welcome", "{welcome}");
    sender.epoch = u32::try_from(welcome["epoch"].as_u64().unwrap()).unwrap();
    (sender, welcome["session"].as_str().unwrap().to_owned())
}

pub(super) async fn send(sender: &mut Sender, scene: &Scene, numbers: std::ops::Range<usize>) {
    for number in numbers {
        let frame = &scene.frames[number];
        let body = RecordBody::Frame { time: frame.time, is_key: frame.is_key, payload: &frame.bytes };
        sender.send_record(FeedRecord { epoch: sender.epoch, number: number as u64, body }).await;
    }
}

pub(super) async fn wait_until_done(client: &Client, session: &str) -> Value {
    let is_done = |session: &Value| {
        assert_ne!(session["status"], "failed", "{session}");
        session["status"] == "done"
    };
    client.read_until(&format!("/api/v1/sessions/{session}"), is_done).await
}

#[tokio::test(flavor = "multi_thread")]
async fn live_positions_equal_the_causal_trackers_and_the_score_equals_that_of_the_uploaded_clip() {
    let Some(scene) = Scene::new(4) else { return };
    let centre = centre(&scene).await;
    let (mut sender, id) = begin(&centre, &scene, RECORDING).await;
    let mut watcher = Watcher::of_tracked(&centre, &id).await;
    let all = scene.frames.len();
    send(&mut sender, &scene, 0..all).await;
    sender.send_json(&json!({"type": "end", "frames": all})).await;

    let (mut frames, mut pictures, mut features) = (Vec::new(), 0, Value::Null);
    let status = loop {
        match watcher.next().await {
            LiveMessage::Json(message) if message["type"] == "frame" => frames.push(message),
            LiveMessage::Json(message) if message["type"] == "features" => features = message["features"].clone(),
            LiveMessage::Json(message) if message["type"] == "ended" => break message["status"].clone(),
            LiveMessage::Json(message) => assert_eq!(message["type"], "live", "{message}"),
            LiveMessage::Picture(_, jpeg) => {
                let picture = image::load_from_memory(&jpeg).unwrap();
                assert_eq!((picture.width(), picture.height()), scene.size);
                pictures += 1;
            }
            LiveMessage::Closed => panic!("closed"),
        }
    };
    assert!(["queued", "tracking", "done"].contains(&status.as_str().unwrap()), "{status}");
    assert_eq!(frames.len(), all, "every frame was tracked");
    assert!(pictures > 0, "a watcher gets pictures");

    let causal = causal_path(&scene);
    let names: Vec<String> = {
        let result = wait_until_done(&centre.instructor, &id).await;
        result["tools"].as_array().unwrap().iter().map(|tool| tool.as_str().unwrap().to_owned()).collect()
    };
    let mut compared = 0;
    for (index, frame) in frames.iter().enumerate() {
        for (tool, name) in frame["tools"].as_array().unwrap().iter().zip(&names) {
            let own = causal.iter().find(|row| row.0 == index as u64 && row.1 == *name).map(|row| row.2);
            let live = tool["tip_mm"].as_array().map(|tip| [0, 1, 2].map(|axis| tip[axis].as_f64().unwrap()));
            match (own, live) {
                (Some(own), Some(live)) => {
                    assert!((0..3).all(|axis| (own[axis] - live[axis]).abs() < 1e-9), "{index}: {own:?} {live:?}");
                    compared += 1;
                }
                (own, live) => assert_eq!(own.is_some(), live.is_some(), "frame {index} of {name}: {own:?} {live:?}"),
            }
        }
    }
    assert!(compared > all, "{compared} of two tools on {all} frames");

    let sent = wait_until_done(&centre.instructor, &id).await;
    let kept = sent["live_features"].as_array().unwrap();
    assert_eq!(kept.len(), 2 * LIVE_FEATURES.len(), "{kept:?}");
    assert_eq!(kept.len(), features.as_array().unwrap().len());
    let clip = std::fs::read(scene.file("clip.mp4")).unwrap();
    let uploaded = session(&centre.administrator, "bob", clip).await;
    let uploaded = wait_until_done(&centre.administrator, uploaded["id"].as_str().unwrap()).await;
    assert_eq!(sent["features"], uploaded["features"], "to the last digit");
    assert_eq!(uploaded["live_features"], Value::Null);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_watcher_first_gets_the_targets_of_the_task() {
    let centre = Centre::open().await;
    let by = json!({"method": "fixed", "limit": 48, "unit": "s"});
    let standard = json!({"targets": [{"feature": "duration", "by": by}]});
    centre.instructor.make("/api/v1/tasks/peg/standards", standard).await;
    let (_sender, welcome) = super::begin(&centre.service, &centre.agent, RECORDING).await;
    let session = welcome["session"].as_str().unwrap();
    let mut watcher = Watcher::open(&centre, &centre.trainee, session).await.unwrap();
    let LiveMessage::Json(first) = watcher.next().await else { panic!("a picture before the targets") };
    assert_eq!((&first["type"], &first["standard"]), (&json!("targets"), &json!(1)));
    let target = &first["targets"][0];
    assert_eq!(
        (&target["feature"], &target["limit"], &target["unit"]),
        (&json!("duration"), &json!(48.0), &json!("s"))
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_box_that_is_not_ready_is_not_tracked_live_and_says_why() {
    let centre = Centre::open().await;
    let (mut sender, welcome) = super::begin(&centre.service, &centre.agent, RECORDING).await;
    let id = welcome["session"].as_str().unwrap().to_owned();
    let mut watcher = Watcher::open(&centre, &centre.trainee, &id).await.unwrap();
    let why = loop {
        let message = watcher.next_of_type("live").await;
        if let Some(why) = message["why"].as_str() {
            break why.to_owned();
        }
    };
    assert!(why.contains("Measure its camera first"), "{why}");
    sender.send_frames(0..3).await;
    drop(sender);
    watcher.next_of_type("waiting").await;
    let (mut sender, _) = super::begin(&centre.service, &centre.agent, RECORDING).await;
    watcher.next_of_type("live").await;
    sender.send_frames(0..3).await;
    sender.end(3).await;
    assert_eq!(watcher.next_of_type("ended").await["status"], "queued");
    assert!(matches!(watcher.next().await, LiveMessage::Closed));
}

#[tokio::test(flavor = "multi_thread")]
async fn strangers_do_not_watch_and_a_session_that_is_over_says_so() {
    let centre = Centre::open().await;
    let (mut sender, welcome) = super::begin(&centre.service, &centre.agent, RECORDING).await;
    let id = welcome["session"].as_str().unwrap().to_owned();
    assert_eq!(Watcher::open(&centre, &centre.service.stranger(), &id).await.err(), Some(401));
    assert_eq!(Watcher::open(&centre, &centre.other_trainee, &id).await.err(), Some(404), "another trainee's session");
    assert_eq!(Watcher::open(&centre, &centre.agent, &id).await.err(), Some(403), "agents send and may not watch");
    assert_eq!(Watcher::open(&centre, &centre.trainee, ANOTHER).await.err(), Some(404));
    sender.send_frames(0..3).await;
    sender.end(3).await;
    let mut watcher = Watcher::open(&centre, &centre.trainee, &id).await.unwrap();
    assert_eq!(watcher.next_of_type("ended").await["status"], "queued");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_live_view_ends_at_once_with_its_sign_in() {
    let centre = Centre::open().await;
    let (mut sender, welcome) = super::begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames(0..3).await;
    let ada = centre.service.sign_in("ada", PASSWORD).await;
    let mut watcher = Watcher::open(&centre, &ada, welcome["session"].as_str().unwrap()).await.unwrap();
    watcher.next_of_type("live").await;
    assert_eq!(ada.post("/api/v1/sign-out", json!({})).await.status(), StatusCode::NO_CONTENT);
    let begun = Instant::now();
    while !matches!(watcher.next().await, LiveMessage::Closed) {}
    assert!(begun.elapsed() < Duration::from_secs(3), "{:?}", begun.elapsed());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_live_view_ends_when_its_person_no_longer_sees_the_session() {
    let centre = Centre::open().await;
    let (mut sender, welcome) = super::begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames(0..3).await;
    let id = welcome["session"].as_str().unwrap();
    let mut ines = Watcher::open(&centre, &centre.instructor, id).await.unwrap();
    let mut ada = Watcher::open(&centre, &centre.trainee, id).await.unwrap();
    ines.next_of_type("live").await;
    ada.next_of_type("live").await;
    set_members(&centre, "One", &["ines"], &[]).await;
    let begun = Instant::now();
    while !matches!(ines.next().await, LiveMessage::Closed) {}
    assert!(begun.elapsed() < Duration::from_secs(7), "{:?}", begun.elapsed());
    assert_eq!(Watcher::open(&centre, &centre.instructor, id).await.err(), Some(404));
    drop(sender); // also without a sender the view of a person who sees the session continues
    ada.next_of_type("waiting").await;
    let (mut sender, _) = super::begin(&centre.service, &centre.agent, RECORDING).await;
    ada.next_of_type("live").await;
    sender.send_frames(0..3).await;
    sender.end(3).await;
    assert_eq!(ada.next_of_type("ended").await["status"], "queued");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_gap_and_late_frames_cost_only_live_positions() {
    let Some(scene) = Scene::new(5) else { return };
    let centre = centre(&scene).await;
    let keys: Vec<usize> = (0..scene.frames.len()).filter(|number| scene.frames[*number].is_key).collect();
    let second = keys[1];
    let (mut sender, id) = begin(&centre, &scene, RECORDING).await;
    let mut watcher = Watcher::of_tracked(&centre, &id).await;
    let all = scene.frames.len();
    send(&mut sender, &scene, 0..20).await;
    send(&mut sender, &scene, second..all).await; // live again after an outage
    send(&mut sender, &scene, 20..second).await; // and then the missing frames
    sender.send_json(&json!({"type": "end", "frames": all})).await;
    let (mut numbers, mut pictures) = (Vec::new(), Vec::new());
    loop {
        match watcher.next().await {
            LiveMessage::Json(message) if message["type"] == "frame" => {
                numbers.push(message["frame"].as_u64().unwrap())
            }
            LiveMessage::Json(message) if message["type"] == "ended" => break,
            LiveMessage::Picture(number, _) => pictures.push(number),
            LiveMessage::Closed => panic!("closed"),
            LiveMessage::Json(_) => {}
        }
    }
    assert!(
        pictures.iter().all(|number| numbers.contains(number)),
        "each picture is of a reported frame: {pictures:?}"
    );
    let live = |number: &u64| *number >= second as u64;
    assert_eq!(numbers.iter().filter(|n| live(n)).count(), all - second);
    assert!(numbers.iter().all(|number| *number < 20 || live(number)), "{numbers:?}");
    let whole = wait_until_done(&centre.instructor, &id).await;
    assert_eq!(whole["video"]["frames"], all, "the recording has all frames");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_change_of_the_picture_size_is_refused_and_earlier_frames_are_kept() {
    let Some(scene) = Scene::new(2) else { return };
    let centre = centre(&scene).await;
    let (mut sender, id) = begin(&centre, &scene, RECORDING).await;
    let mut watcher = Watcher::of_tracked(&centre, &id).await;
    send(&mut sender, &scene, 0..25).await;
    let wrong = super::scene::one_of_another_size(&scene);
    let body = RecordBody::Frame { time: scene.frames[24].time + 9_000, is_key: true, payload: &wrong };
    sender.send_record(FeedRecord { epoch: sender.epoch, number: 25, body }).await;
    assert_eq!(sender.close_code().await, 4422);
    let why = loop {
        if let Some(why) = watcher.next_of_type("live").await["why"].as_str() {
            break why.to_owned();
        }
    };
    assert!(why.contains("640×360") && why.contains("320×180"), "{why}");
    let (mut sender, _) = begin(&centre, &scene, RECORDING).await;
    sender.send_json(&json!({"type": "end", "frames": 26})).await;
    assert!(matches!(sender.next_answer().await, Received::Json(message) if message["type"] == "ended"));
    assert_eq!(wait_until_done(&centre.instructor, &id).await["video"]["frames"], 25);
}
