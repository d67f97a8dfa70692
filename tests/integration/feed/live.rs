//! Watching a recording while it arrives: what is told is what the causal tracker says of the same frames, and what comes of
//! the recording is what comes of the same clip uploaded.

use std::time::Duration;

use futures_util::StreamExt;
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};
use trocar::domain::feed::record::{Body, Record};
use trocar::pipeline::features::running::LIVE;

use super::scene::{SIZE, Scene, causal_path, furnish};
use super::sender::{Heard, Sender, hello, open};
use super::{ANOTHER, RECORDING};
use crate::api::centre::{Centre, session};
use crate::support::{Client, Service, soon};

/// What a watcher was told.
#[derive(Debug)]
enum Told {
    Word(Value),
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

    /// An instructor's, once the recording is tracked.
    pub(super) async fn of_tracked(centre: &Centre, session: &str) -> Self {
        let mut watcher = Self::open(centre, &centre.instructor, session).await.unwrap();
        while watcher.word("live").await["tools"].is_null() {}
        watcher
    }

    async fn next(&mut self) -> Told {
        loop {
            match soon("news", self.0.next()).await {
                Some(Ok(Message::Text(text))) => return Told::Word(serde_json::from_str(&text).unwrap()),
                Some(Ok(Message::Binary(bytes))) => {
                    let (head, jpeg) = bytes.split_first_chunk::<8>().unwrap();
                    return Told::Picture(u64::from_be_bytes(*head), jpeg.to_vec());
                }
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                _ => return Told::Closed,
            }
        }
    }

    /// The next word of a type.
    pub(super) async fn word(&mut self, kind: &str) -> Value {
        loop {
            match self.next().await {
                Told::Word(word) if word["type"] == kind => return word,
                Told::Closed => panic!("closed before {kind}"),
                _ => {}
            }
        }
    }
}

pub(super) async fn centre(scene: &Scene) -> Centre {
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    furnish(&centre.administrator, "box-1", &scene.folder).await;
    centre
}

/// Begins to send a scene; returns the session's id too.
pub(super) async fn begin(centre: &Centre, scene: &Scene, recording: &str) -> (Sender, String) {
    let mut sender = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
    let mut word = hello(recording);
    word["codec"] = json!("h264");
    (word["width"], word["height"]) = (json!(SIZE.0), json!(SIZE.1));
    word["time_base"] = json!([1, scene.ticks_per_s]);
    sender.say(&word).await;
    let Heard::Word(welcome) = sender.hear().await else { panic!("no welcome") };
    assert_eq!(welcome["type"], "welcome", "{welcome}");
    sender.epoch = u32::try_from(welcome["epoch"].as_u64().unwrap()).unwrap();
    (sender, welcome["session"].as_str().unwrap().to_owned())
}

pub(super) async fn send(sender: &mut Sender, scene: &Scene, numbers: std::ops::Range<usize>) {
    for number in numbers {
        let frame = &scene.frames[number];
        let body = Body::Frame { time: frame.time, is_key: frame.is_key, payload: &frame.bytes };
        sender.record(Record { epoch: sender.epoch, number: number as u64, body }).await;
    }
}

pub(super) async fn done(client: &Client, session: &str) -> Value {
    soon("the result", async {
        loop {
            let session = client.read(&format!("/api/v1/sessions/{session}")).await;
            if session["status"] == "done" {
                return session;
            }
            assert_ne!(session["status"], "failed", "{session}");
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    })
    .await
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_told_live_is_what_the_causal_tracker_says_and_the_score_is_that_of_the_uploaded_clip() {
    let Some(scene) = Scene::new(4) else { return };
    let centre = centre(&scene).await;
    let (mut sender, id) = begin(&centre, &scene, RECORDING).await;
    let mut watcher = Watcher::of_tracked(&centre, &id).await;
    let all = scene.frames.len();
    send(&mut sender, &scene, 0..all).await;
    sender.say(&json!({"type": "end", "frames": all})).await;

    let (mut frames, mut pictures, mut features) = (Vec::new(), 0, Value::Null);
    let status = loop {
        match watcher.next().await {
            Told::Word(word) if word["type"] == "frame" => frames.push(word),
            Told::Word(word) if word["type"] == "features" => features = word["features"].clone(),
            Told::Word(word) if word["type"] == "ended" => break word["status"].clone(),
            Told::Word(word) => assert_eq!(word["type"], "live", "{word}"),
            Told::Picture(_, jpeg) => {
                let picture = image::load_from_memory(&jpeg).unwrap();
                assert_eq!((picture.width(), picture.height()), SIZE);
                pictures += 1;
            }
            Told::Closed => panic!("closed"),
        }
    };
    assert!(["queued", "tracking", "done"].contains(&status.as_str().unwrap()), "{status}");
    assert_eq!(frames.len(), all, "every frame was tracked");
    assert!(pictures > 0, "a watcher sees the picture");

    let causal = causal_path(&scene);
    let names: Vec<String> = {
        let result = done(&centre.instructor, &id).await;
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

    let sent = done(&centre.instructor, &id).await;
    let kept = sent["live_features"].as_array().unwrap();
    assert_eq!(kept.len(), 2 * LIVE.len(), "{kept:?}");
    assert_eq!(kept.len(), features.as_array().unwrap().len());
    let clip = std::fs::read(scene.file("clip.mp4")).unwrap();
    let uploaded = session(&centre.administrator, "bob", clip).await;
    let uploaded = done(&centre.administrator, uploaded["id"].as_str().unwrap()).await;
    assert_eq!(sent["features"], uploaded["features"], "to the last digit");
    assert_eq!(uploaded["live_features"], Value::Null);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_watcher_is_told_first_what_the_task_asks_for() {
    let centre = Centre::open().await;
    let by = json!({"method": "fixed", "limit": 48, "unit": "s"});
    let standard = json!({"targets": [{"feature": "duration", "by": by}]});
    centre.instructor.make("/api/v1/tasks/peg/standards", standard).await;
    let (_sender, welcome) = super::begin(&centre.service, &centre.agent, RECORDING).await;
    let session = welcome["session"].as_str().unwrap();
    let mut watcher = Watcher::open(&centre, &centre.trainee, session).await.unwrap();
    let Told::Word(first) = watcher.next().await else { panic!("a picture before the targets") };
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
        let word = watcher.word("live").await;
        if let Some(why) = word["why"].as_str() {
            break why.to_owned();
        }
    };
    assert!(why.contains("calibrated"), "{why}");
    sender.frames(0..3).await;
    drop(sender);
    watcher.word("waiting").await;
    let (mut sender, _) = super::begin(&centre.service, &centre.agent, RECORDING).await;
    watcher.word("live").await;
    sender.frames(0..3).await;
    sender.end(3).await;
    assert_eq!(watcher.word("ended").await["status"], "queued");
    assert!(matches!(watcher.next().await, Told::Closed));
}

#[tokio::test(flavor = "multi_thread")]
async fn strangers_do_not_watch_and_a_session_that_is_over_says_so() {
    let centre = Centre::open().await;
    let (mut sender, welcome) = super::begin(&centre.service, &centre.agent, RECORDING).await;
    let id = welcome["session"].as_str().unwrap().to_owned();
    assert_eq!(Watcher::open(&centre, &centre.service.stranger(), &id).await.err(), Some(401));
    assert_eq!(Watcher::open(&centre, &centre.other_trainee, &id).await.err(), Some(404), "somebody else's");
    assert_eq!(Watcher::open(&centre, &centre.agent, &id).await.err(), Some(403), "agents send, and see nobody");
    assert_eq!(Watcher::open(&centre, &centre.trainee, ANOTHER).await.err(), Some(404));
    sender.frames(0..3).await;
    sender.end(3).await;
    let mut watcher = Watcher::open(&centre, &centre.trainee, &id).await.unwrap();
    assert_eq!(watcher.word("ended").await["status"], "queued");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_hole_and_late_frames_cost_live_positions_only() {
    let Some(scene) = Scene::new(5) else { return };
    let centre = centre(&scene).await;
    let keys: Vec<usize> = (0..scene.frames.len()).filter(|number| scene.frames[*number].is_key).collect();
    let second = keys[1];
    let (mut sender, id) = begin(&centre, &scene, RECORDING).await;
    let mut watcher = Watcher::of_tracked(&centre, &id).await;
    let all = scene.frames.len();
    send(&mut sender, &scene, 0..20).await;
    send(&mut sender, &scene, second..all).await; // live again after an outage
    send(&mut sender, &scene, 20..second).await; // and the rest behind it
    sender.say(&json!({"type": "end", "frames": all})).await;
    let (mut numbers, mut pictures) = (Vec::new(), Vec::new());
    loop {
        match watcher.next().await {
            Told::Word(word) if word["type"] == "frame" => numbers.push(word["frame"].as_u64().unwrap()),
            Told::Word(word) if word["type"] == "ended" => break,
            Told::Picture(number, _) => pictures.push(number),
            Told::Closed => panic!("closed"),
            Told::Word(_) => {}
        }
    }
    assert!(pictures.iter().all(|number| numbers.contains(number)), "pictures of frames that were told: {pictures:?}");
    let live = |number: &u64| *number >= second as u64;
    assert_eq!(numbers.iter().filter(|n| live(n)).count(), all - second);
    assert!(numbers.iter().all(|number| *number < 20 || live(number)), "{numbers:?}");
    let whole = done(&centre.instructor, &id).await;
    assert_eq!(whole["video"]["frames"], all, "the recording has them all");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_box_that_sends_another_size_is_told_and_what_came_before_is_kept() {
    let Some(scene) = Scene::new(2) else { return };
    let centre = centre(&scene).await;
    let (mut sender, id) = begin(&centre, &scene, RECORDING).await;
    let mut watcher = Watcher::of_tracked(&centre, &id).await;
    send(&mut sender, &scene, 0..25).await;
    let wrong = super::scene::one_of_another_size(&scene);
    let body = Body::Frame { time: scene.frames[24].time + 9_000, is_key: true, payload: &wrong };
    sender.record(Record { epoch: sender.epoch, number: 25, body }).await;
    assert_eq!(sender.closed().await, 4422);
    let why = loop {
        if let Some(why) = watcher.word("live").await["why"].as_str() {
            break why.to_owned();
        }
    };
    assert!(why.contains("640×360") && why.contains("320×180"), "{why}");
    let (mut sender, _) = begin(&centre, &scene, RECORDING).await;
    sender.say(&json!({"type": "end", "frames": 26})).await;
    assert!(matches!(sender.answer().await, Heard::Word(word) if word["type"] == "ended"));
    assert_eq!(done(&centre.instructor, &id).await["video"]["frames"], 25);
}
