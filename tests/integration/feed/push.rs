//! Streams that are pushed in one request: the session is the clip, or the part of it that arrived. Everything else is
//! refused with a reason.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Cursor;
use std::time::Duration;

use reqwest::{Body, Method, Response, StatusCode};
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio_stream::wrappers::ReceiverStream;
use trocar::media::{MediaLimits, VideoFile};
use trocar::motion::features::running::LIVE_FEATURES;
use trocar::settings::Settings;

use super::live::{Watcher, wait_until_done};
use super::scene::{Scene, remuxed, set_up_box, slowed};
use super::sender::{hello, open};
use super::{ANOTHER, RECORDING, begin};
use crate::api::centre::{Centre, recording, session};
use crate::support::{Client, Service, problem, read, soon};

const PATH: &str = "/api/v1/boxes/box-1/feed.ts?trainee=ada&task=peg";

/// A request whose body is sent piece by piece.
pub struct Pushing {
    body: Option<mpsc::Sender<Result<Vec<u8>, std::io::Error>>>,
    answer: JoinHandle<reqwest::Result<Response>>,
}

impl Pushing {
    pub fn begin(request: reqwest::RequestBuilder) -> Self {
        let (body, pieces) = mpsc::channel(1);
        let request = request.body(Body::wrap_stream(ReceiverStream::new(pieces)));
        let answer = tokio::spawn(request.send());
        Self { body: Some(body), answer }
    }

    /// Sends bytes, some thousands at a time.
    pub async fn send(&mut self, bytes: &[u8]) {
        for piece in bytes.chunks(8192) {
            // If the service has answered already, the rest has no receiver.
            let _ = soon("sending", self.body.as_mut().unwrap().send(Ok(piece.to_vec()))).await;
        }
    }

    /// Ends the body properly and waits for the answer.
    pub async fn end(mut self) -> Response {
        self.body = None;
        self.answered().await
    }

    /// Waits for the answer while the body stays open.
    pub async fn answered(self) -> Response {
        soon("the answer", self.answer).await.unwrap().unwrap()
    }

    /// Cuts the connection: a body that fails is not ended.
    pub async fn cut(self) {
        let cut = Err(std::io::Error::other("cut"));
        let _ = soon("cutting", self.body.unwrap().send(cut)).await; // it may be cut already
        let _ = soon("the cut", self.answer).await; // no answer comes
    }
}

fn push(client: &Client) -> Pushing {
    Pushing::begin(client.request(Method::PUT, PATH))
}

async fn put(client: &Client, path: &str, bytes: Vec<u8>) -> Response {
    client.request(Method::PUT, path).body(bytes).send().await.unwrap()
}

/// Waits for the one session that is being received, and returns its id.
async fn arriving(client: &Client) -> String {
    let arrives = |sessions: &Value| sessions["items"][0]["id"].is_string();
    let sessions = client.read_until("/api/v1/sessions?status=receiving", arrives).await;
    sessions["items"][0]["id"].as_str().unwrap().to_owned()
}

/// Waits until the service has ended a session by itself.
async fn wait_for_end(client: &Client, id: &str) {
    client.read_until(&format!("/api/v1/sessions/{id}"), |session| session["status"] != "receiving").await;
}

/// Time of a picture, s, and a hash of its samples.
type PictureHash = (f64, u64);

/// The pictures of a session's recording.
async fn pictures_of(client: &Client, id: &str) -> Vec<PictureHash> {
    let video = client.get(&format!("/api/v1/sessions/{id}/video")).await;
    assert_eq!(video.status(), StatusCode::OK);
    pictures_in(video.bytes().await.unwrap().to_vec())
}

fn pictures_in(video: Vec<u8>) -> Vec<PictureHash> {
    let mut video = VideoFile::open(Cursor::new(video), MediaLimits::default()).unwrap();
    let pictures = std::iter::from_fn(|| video.next_picture().unwrap());
    let hashes = pictures.map(|picture| {
        let (frame, mut hash) = (picture.frame(), DefaultHasher::new());
        for plane in [frame.y, frame.u, frame.v] {
            (0..plane.height).for_each(|row| plane.row(row).hash(&mut hash));
        }
        (frame.time_s, hash.finish())
    });
    hashes.collect()
}

/// True if `all` contains each of `some`. Times may differ by the rounding of containers.
fn are_among(some: &[PictureHash], all: &[PictureHash]) -> bool {
    some.iter().all(|(time, hash)| all.iter().any(|other| (time - other.0).abs() < 6e-4 && *hash == other.1))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_pushed_stream_is_tracked_as_it_arrives_and_becomes_the_whole_clip() {
    let Some(scene) = Scene::new(4) else { return };
    // The stream waits for the first position, which may take long.
    let patient = |settings: &mut Settings| {
        settings.workers = 1;
        (settings.http.body_grace_s, settings.live.silent_s) = (60.0, 60);
    };
    let centre = Centre::open_in(Service::start_with(patient).await).await;
    set_up_box(&centre.administrator, "box-1", &scene.folder).await;
    let clip = std::fs::read(scene.file("clip.mp4")).unwrap();
    let uploaded = session(&centre.administrator, "bob", clip.clone()).await;
    let uploaded = wait_until_done(&centre.administrator, uploaded["id"].as_str().unwrap()).await;
    let clip = pictures_in(clip);
    for container in ["mpegts", "matroska"] {
        let Some(stream) = remuxed(&scene.file("clip.mp4"), container) else { return };
        let (first, rest) = stream.split_at(stream.len() * 4 / 5);
        let mut pushing = push(&centre.agent);
        pushing.send(first).await;
        let id = arriving(&centre.instructor).await;
        let mut watcher = Watcher::of_tracked(&centre, &id).await;
        let position = watcher.next_of_type("frame").await; // while the body is still open
        assert!(position["tools"].is_array(), "{position}");
        pushing.send(rest).await;
        let answer = pushing.end().await;
        let location = answer.headers().get("location").cloned();
        assert_eq!(read(answer, StatusCode::CREATED).await, json!({"id": id}), "an agent sees only the id");
        assert_eq!(location.unwrap(), format!("/api/v1/sessions/{id}"));
        let pushed = wait_until_done(&centre.instructor, &id).await;
        assert_eq!(pushed["live_features"].as_array().unwrap().len(), 2 * LIVE_FEATURES.len());
        let shown = pictures_of(&centre.instructor, &id).await;
        assert!(shown.len() == clip.len() && are_among(&shown, &clip), "{container}: {shown:?}");
        if container == "mpegts" {
            assert_eq!(pushed["features"], uploaded["features"], "to the last digit");
        }
    }
}

/// 20 s by its stamps, sent in 15 s: its clock runs a third too fast, and a person has to say so.
#[tokio::test(flavor = "multi_thread")]
async fn a_stream_whose_stamps_run_at_another_pace_than_it_arrives_is_named_until_its_time_is_corrected() {
    const PIECES: usize = 150;
    let Some(scene) = Scene::new(4) else { return };
    let centre = Centre::open_in(Service::start_with(|settings| settings.workers = 1).await).await;
    set_up_box(&centre.administrator, "box-1", &scene.folder).await;
    let Some(stream) = slowed(&scene.file("clip.mp4"), "mpegts", 5) else { return };
    let mut pushing = push(&centre.administrator);
    let mut tick = tokio::time::interval(Duration::from_millis(100));
    for piece in stream.chunks(stream.len().div_ceil(PIECES)) {
        tick.tick().await;
        pushing.send(piece).await;
    }
    let id = read(pushing.end().await, StatusCode::CREATED).await["id"].as_str().unwrap().to_owned();
    let video = wait_until_done(&centre.instructor, &id).await["video"].take();
    let [arrived_s, stamped_s] = ["arrived_s", "stamped_s"].map(|key| video["arrival"][key].as_f64().unwrap());
    assert!((0.65..0.85).contains(&(arrived_s / stamped_s)), "{video}");
    assert_eq!(video["may_run_at_wrong_pace"], true, "{video}");
    let edit = json!({"kind": "retime", "true_duration_s": 15.0, "why": "A clock in the picture."});
    let retimed = centre.instructor.post(&format!("/api/v1/sessions/{id}/edits"), edit).await;
    assert_eq!(retimed.status(), StatusCode::CREATED);
    let corrected = |session: &Value| session["video"]["clock"]["basis"] == "duration";
    let session = centre.instructor.read_until(&format!("/api/v1/sessions/{id}"), corrected).await;
    assert_eq!(session["video"]["may_run_at_wrong_pace"], false, "{session}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cut_stream_ends_with_the_part_that_arrived_and_the_box_is_free_again() {
    let Some(scene) = Scene::new(3) else { return };
    let centre = Centre::open().await;
    let clip = pictures_in(std::fs::read(scene.file("clip.mp4")).unwrap());
    for container in ["mpegts", "matroska"] {
        let stream = remuxed(&scene.file("clip.mp4"), container).unwrap();
        let mut pushing = push(&centre.trainee);
        pushing.send(&stream[..stream.len() * 7 / 10]).await;
        let id = arriving(&centre.instructor).await;
        pushing.cut().await;
        wait_for_end(&centre.instructor, &id).await;
        let shown = pictures_of(&centre.instructor, &id).await;
        assert!(shown.len() > clip.len() / 3 && shown.len() < clip.len(), "{container}: {} frames", shown.len());
        assert!(are_among(&shown, &clip), "{container}: no picture is damaged: {shown:?}");
        // Pictures near the cut may be missing, since they arrive in another order than they are shown in.
        assert!(are_among(&clip[..shown.len() - 4], &shown), "{container}: {shown:?}");
    }
    let whole = put(&centre.trainee, PATH, remuxed(&scene.file("clip.mp4"), "mpegts").unwrap()).await;
    let whole = read(whole, StatusCode::CREATED).await;
    assert_eq!((&whole["status"], &whole["trainee"]["code"]), (&json!("queued"), &json!("ada")));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_silent_sender_times_out_and_the_part_that_arrived_becomes_a_session() {
    let Some(scene) = Scene::new(3) else { return };
    let centre = Centre::open_in(Service::start_with(|settings| settings.live.silent_s = 1).await).await;
    let stream = remuxed(&scene.file("clip.mp4"), "mpegts").unwrap();
    let mut pushing = push(&centre.administrator);
    pushing.send(&stream[..stream.len() / 2]).await;
    let refused = problem(pushing.answered().await, 408, "too-slow").await;
    let location = refused["session"].as_str().unwrap();
    let session = centre.instructor.read(location).await;
    assert_eq!((&session["status"], &session["recorded_at_source"]), (&json!("queued"), &json!("arrival")));
    assert_eq!(session["early_end"]["cause"], "sender_gone", "{session}");
    assert!(session["early_end"]["detail"].as_str().unwrap().len() > 10, "{session}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_body_that_is_no_video_stream_is_refused_and_leaves_nothing() {
    let centre = Centre::open().await;
    let mut noise = recording(1 << 16, 7);
    noise.drain(..32);
    let secret = centre.service.data.path().join("trocar.db");
    let nested = format!("ffconcat version 1.0\nfile {}\n", secret.display());
    for (what, bytes) in [
        ("noise", noise),
        ("an MP4 head", recording(1 << 16, 8)),
        ("a playlist", nested.into_bytes()),
        ("nothing", vec![]),
    ] {
        let refused = problem(put(&centre.agent, PATH, bytes).await, 422, "invalid").await;
        assert!(refused["detail"].as_str().unwrap().contains("-f mpegts"), "{what}: {refused}");
        assert_eq!(refused["session"], Value::Null);
    }
    assert_eq!(centre.administrator.read("/api/v1/sessions").await["items"], json!([]), "no session was begun");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_push_without_permission_or_trainee_is_refused_before_the_stream_is_read() {
    let centre = Centre::open().await;
    centre.administrator.make("/api/v1/boxes", json!({"name": "Box 2", "code": "box-2"})).await;
    let at = |in_box: &str, query: &str| format!("/api/v1/boxes/{in_box}/feed.ts?{query}");
    let refused: [(&Client, String, u16, &str); 7] = [
        (&centre.service.stranger().with_token("trc_nonsense"), PATH.to_owned(), 401, "not-signed-in"),
        (&centre.agent, at("box-2", "trainee=ada&task=peg"), 404, "not-found"),
        (&centre.administrator, at("box-9", "trainee=ada&task=peg"), 404, "not-found"),
        (&centre.agent, at("box-1", "trainee=missing&task=peg"), 422, "unknown-reference"),
        (&centre.instructor, at("box-1", "trainee=bob&task=peg"), 422, "unknown-reference"),
        (&centre.agent, at("box-1", "task=peg"), 422, "invalid"),
        (&centre.agent, at("box-1", "trainee=ada"), 422, "invalid"),
    ];
    for (client, path, status, slug) in refused {
        let pushing = Pushing::begin(client.request(Method::PUT, &path)); // without any byte of the body
        let answer = pushing.answered().await;
        assert_eq!(answer.headers()["connection"], "close", "its next request must not meet a closing connection");
        problem(answer, status, slug).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_sender_that_asks_first_is_answered_before_it_sends() {
    let centre = Centre::open().await;
    let asked = async |client: &Client| {
        let mut wire = TcpStream::connect(centre.service.address()).await.unwrap();
        let token = client.headers().get("authorization").map_or("", |token| token.to_str().unwrap());
        let head = format!(
            "PUT {PATH} HTTP/1.1\r\nhost: box\r\nauthorization: {token}\r\ntransfer-encoding: chunked\r\n\
             expect: 100-continue\r\n\r\n"
        );
        wire.write_all(head.as_bytes()).await.unwrap();
        let mut line = vec![0; 12];
        soon("an answer", wire.read_exact(&mut line)).await.unwrap();
        String::from_utf8(line).unwrap()
    };
    assert_eq!(asked(&centre.agent).await, "HTTP/1.1 100");
    assert_eq!(asked(&centre.service.stranger().with_token("trc_nonsense")).await, "HTTP/1.1 401");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_box_sends_one_stream_at_a_time_by_feed_or_push() {
    let Some(scene) = Scene::new(2) else { return };
    let stream = remuxed(&scene.file("clip.mp4"), "mpegts").unwrap();
    let centre = Centre::open().await;
    let (feed, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    problem(push(&centre.agent).answered().await, 409, "conflict").await;
    drop(feed);
    soon("a box that is free", async {
        while put(&centre.agent, PATH, b"no stream".to_vec()).await.status() == StatusCode::CONFLICT {}
    })
    .await;

    let mut pushing = push(&centre.agent);
    pushing.send(&stream[..stream.len() * 4 / 5]).await;
    let both_arrive = |sessions: &Value| sessions["items"].as_array().unwrap().len() == 2;
    centre.instructor.read_until("/api/v1/sessions?status=receiving", both_arrive).await;
    problem(push(&centre.agent).answered().await, 409, "conflict").await;
    let mut other = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
    other.send_json(&hello(ANOTHER)).await;
    assert_eq!(other.close_code().await, 4409);
    pushing.send(&stream[stream.len() * 4 / 5..]).await;
    assert_eq!(pushing.end().await.status(), StatusCode::CREATED);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_that_is_withdrawn_or_a_session_that_is_erased_ends_the_push() {
    let Some(scene) = Scene::new(3) else { return };
    let stream = remuxed(&scene.file("clip.mp4"), "mpegts").unwrap();
    let centre = Centre::open().await;
    let mut pushing = push(&centre.administrator);
    pushing.send(&stream[..stream.len() * 4 / 5]).await;
    let session = format!("/api/v1/sessions/{}", arriving(&centre.instructor).await);
    assert_eq!(centre.instructor.delete(&session).await.status(), StatusCode::NO_CONTENT);
    pushing.send(&stream[stream.len() * 4 / 5..]).await;
    let answer = pushing.end().await;
    assert!([410, 500].contains(&answer.status().as_u16()), "{}", answer.status());

    let mut pushing = push(&centre.agent);
    pushing.send(&stream[..stream.len() * 4 / 5]).await;
    arriving(&centre.instructor).await;
    let tokens = centre.administrator.read("/api/v1/tokens").await;
    let id = tokens["items"][0]["id"].as_str().unwrap();
    centre.administrator.delete(&format!("/api/v1/tokens/{id}")).await;
    let refused = problem(pushing.answered().await, 401, "not-signed-in").await;
    let location = refused["session"].as_str().unwrap();
    assert_eq!(centre.instructor.read(location).await["status"], "queued", "the part that arrived is kept");
}
