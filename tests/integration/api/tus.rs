//! Resumable uploads, as a tus client sends them.

use std::sync::Arc;
use std::time::Duration;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bytes::Bytes;
use reqwest::{Method, Response, StatusCode, header};
use sha1::{Digest, Sha1};
use sha2::Sha256;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use trocar::time::{ManualClock, SystemClock};

use super::centre::{Centre, recording};
use crate::support::{Client, Service, poll, poll_until, problem, read, soon};

const MIB: usize = 1024 * 1024;

/// An unfinished upload.
pub struct Upload {
    client: Client,
    pub address: String,
}

pub fn metadata(pairs: &[(&str, &str)]) -> String {
    pairs.iter().map(|(key, value)| format!("{key} {}", STANDARD.encode(value))).collect::<Vec<_>>().join(",")
}

fn for_ada() -> String {
    metadata(&[("filename", "clip.mp4"), ("trainee", "ada"), ("task", "peg"), ("box", "box-1")])
}

/// Creates an upload.
pub async fn create(client: &Client, length: usize, metadata: &str) -> Response {
    client
        .request(Method::POST, "/api/v1/uploads")
        .header("tus-resumable", "1.0.0")
        .header("upload-length", length)
        .header("upload-metadata", metadata)
        .send()
        .await
        .unwrap()
}

impl Upload {
    /// Begins an upload for Ada.
    pub async fn begin(client: &Client, length: usize) -> Self {
        let answer = create(client, length, &for_ada()).await;
        assert_eq!(answer.status(), StatusCode::CREATED);
        assert_eq!(answer.headers()["tus-resumable"], "1.0.0");
        assert!(answer.headers().contains_key("upload-expires"));
        let address = answer.headers()[header::LOCATION].to_str().unwrap().to_owned();
        Self { client: client.clone(), address }
    }

    pub fn request(&self, method: Method) -> reqwest::RequestBuilder {
        self.client.request(method, &self.address).header("tus-resumable", "1.0.0")
    }

    fn patch_at(&self, offset: usize) -> reqwest::RequestBuilder {
        self.request(Method::PATCH)
            .header("upload-offset", offset)
            .header(header::CONTENT_TYPE, "application/offset+octet-stream")
    }

    /// Sends bytes.
    pub async fn patch(&self, offset: usize, bytes: &[u8]) -> Response {
        self.patch_at(offset).body(bytes.to_vec()).send().await.unwrap()
    }

    /// The offset that the service has reached.
    pub async fn offset(&self) -> usize {
        let answer = self.request(Method::HEAD).send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::OK);
        assert_eq!(answer.headers()[header::CACHE_CONTROL], "no-store");
        answer.headers()["upload-offset"].to_str().unwrap().parse().unwrap()
    }

    /// Begins to send and leaves the body open. Bytes in the channel are sent; dropping the channel ends the body
    /// properly; an error cuts the connection.
    fn open_patch(&self, offset: usize) -> (mpsc::Sender<Result<Bytes, std::io::Error>>, PendingAnswer) {
        let (bytes, body) = mpsc::channel(1);
        let request = self.patch_at(offset).body(reqwest::Body::wrap_stream(ReceiverStream::new(body)));
        (bytes, tokio::spawn(request.send()))
    }
}

type PendingAnswer = tokio::task::JoinHandle<reqwest::Result<Response>>;

fn session_of(answer: &Response) -> String {
    answer.headers()["trocar-session"].to_str().unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_in_two_parts_becomes_a_session() {
    let centre = Centre::open().await;
    let content = recording(300_000, 1);
    let upload = Upload::begin(&centre.trainee, content.len()).await;
    assert_eq!(upload.offset().await, 0);
    let half = upload.patch(0, &content[..100_000]).await;
    assert_eq!(half.status(), StatusCode::NO_CONTENT);
    assert_eq!(half.headers()["upload-offset"], "100000");
    let whole = upload.patch(100_000, &content[100_000..]).await;
    assert_eq!(whole.headers()["upload-offset"], "300000");
    let id = session_of(&whole);
    let session = centre.trainee.read(&format!("/api/v1/sessions/{id}")).await;
    assert_eq!(session["filename"], "clip.mp4");
    assert_eq!(session["trainee"]["code"], "ada");
    assert_eq!(session["status"], "queued");
    let video = centre.trainee.get(&format!("/api/v1/sessions/{id}/video")).await;
    assert_eq!(video.bytes().await.unwrap(), content);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_bytes_may_be_sent_with_the_creation() {
    let centre = Centre::open().await;
    let content = recording(1000, 2);
    let answer = centre
        .trainee
        .request(Method::POST, "/api/v1/uploads")
        .header("tus-resumable", "1.0.0")
        .header("upload-length", content.len())
        .header("upload-metadata", for_ada())
        .header(header::CONTENT_TYPE, "application/offset+octet-stream")
        .body(content.clone())
        .send()
        .await
        .unwrap();
    assert_eq!(answer.status(), StatusCode::CREATED);
    assert_eq!(answer.headers()["upload-offset"], "1000");
    centre.trainee.read(&format!("/api/v1/sessions/{}", session_of(&answer))).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cut_connection_loses_at_most_eight_mebibytes() {
    let centre = Centre::open().await;
    let content = recording(20 * MIB, 3);
    let upload = Upload::begin(&centre.trainee, content.len()).await;
    let sent = 15 * MIB;
    let (bytes, answer) = upload.open_patch(0);
    bytes.send(Ok(Bytes::copy_from_slice(&content[..sent]))).await.unwrap();
    // The channel has space again once the body's stream has taken the first piece.
    bytes.send(Err(std::io::Error::other("cut"))).await.unwrap();
    assert!(answer.await.unwrap().is_err(), "the client's own connection broke");
    let kept = unlocked_offset(&upload).await;
    assert!(sent - kept <= 8 * MIB, "{kept} of {sent} kept");
    let rest = upload.patch(kept, &content[kept..]).await;
    assert_eq!(rest.status(), StatusCode::NO_CONTENT);
    let video = centre.trainee.get(&format!("/api/v1/sessions/{}/video", session_of(&rest))).await;
    assert_eq!(Sha256::digest(video.bytes().await.unwrap()), Sha256::digest(&content));
}

/// The offset once the service has noticed that the client is gone: until then the upload is locked.
async fn unlocked_offset(upload: &Upload) -> usize {
    poll("the notice of the cut", async || {
        let offset = upload.offset().await;
        let probe = upload.patch(offset, &[]).await;
        match probe.status() {
            StatusCode::LOCKED => None,
            StatusCode::NO_CONTENT => Some(offset),
            StatusCode::CONFLICT => None, // the offset has moved in between
            other => panic!("{other}"),
        }
    })
    .await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_writer_at_the_same_time_is_refused() {
    let centre = Centre::open_in(Service::start_with_clock(ManualClock::at(1_800_000_000_000)).await).await;
    let content = recording(6 * MIB, 4);
    let upload = Upload::begin(&centre.trainee, content.len()).await;
    let (bytes, answer) = upload.open_patch(0);
    bytes.send(Ok(Bytes::copy_from_slice(&content[..5 * MIB]))).await.unwrap();
    // A checkpoint shows that the first writer is active. It is never silent, since the clock does not move.
    soon("a checkpoint", async { while upload.offset().await < 4 * MIB {} }).await;
    let kept = upload.offset().await;
    problem(upload.patch(kept, &content[kept..]).await, 423, "locked").await;
    bytes.send(Ok(Bytes::copy_from_slice(&content[5 * MIB..]))).await.unwrap();
    drop(bytes);
    let answer = answer.await.unwrap().unwrap();
    assert_eq!(answer.headers()["upload-offset"], content.len().to_string().as_str());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_returning_sender_takes_over_from_its_silent_connection() {
    let clock = ManualClock::at(1_800_000_000_000);
    let centre = Centre::open_in(Service::start_with_clock(clock.clone()).await).await;
    let content = recording(6 * MIB, 9);
    let upload = Upload::begin(&centre.trainee, content.len()).await;
    let (bytes, silent) = upload.open_patch(0);
    bytes.send(Ok(Bytes::copy_from_slice(&content[..5 * MIB]))).await.unwrap();
    // While bytes arrive, a request for the offset changes nothing.
    soon("a checkpoint", async { while upload.offset().await < 4 * MIB {} }).await;
    // Bytes in transit when the clock moves end the silence: a sender that gets "locked" asks again.
    let rest = soon("the takeover", async {
        loop {
            clock.advance(Duration::from_secs(3));
            let kept = upload.offset().await;
            let rest = upload.patch(kept, &content[kept..]).await;
            if rest.status() != StatusCode::LOCKED {
                break rest;
            }
        }
    })
    .await;
    assert_eq!(rest.status(), StatusCode::NO_CONTENT);
    assert_eq!(rest.headers()["upload-offset"], content.len().to_string().as_str());
    let left = silent.await.unwrap().unwrap();
    problem(left, 409, "conflict").await;
    drop(bytes);
}

#[tokio::test(flavor = "multi_thread")]
async fn bytes_that_differ_from_their_checksum_are_dropped() {
    let centre = Centre::open().await;
    let content = recording(5000, 5);
    let upload = Upload::begin(&centre.trainee, content.len()).await;
    let with =
        |sum: String, bytes: &[u8]| upload.patch_at(0).header("upload-checksum", sum).body(bytes.to_vec()).send();
    let sha1 = format!("sha1 {}", STANDARD.encode(Sha1::digest(&content)));
    let sha256 = format!("sha256 {}", STANDARD.encode(Sha256::digest(&content[..2000])));
    let mut spoiled = content.clone();
    spoiled[4999] ^= 1;
    problem(with(sha1.clone(), &spoiled).await.unwrap(), 460, "checksum-mismatch").await;
    assert_eq!(upload.offset().await, 0);
    problem(with("md5 AAAA".to_owned(), &content).await.unwrap(), 400, "bad-request").await;
    assert_eq!(with(sha256, &content[..2000]).await.unwrap().status(), StatusCode::NO_CONTENT);
    let rest = format!("sha1 {}", STANDARD.encode(Sha1::digest(&content[2000..])));
    let last =
        upload.patch_at(2000).header("upload-checksum", rest).body(content[2000..].to_vec()).send().await.unwrap();
    let video = centre.trainee.get(&format!("/api/v1/sessions/{}/video", session_of(&last))).await;
    assert_eq!(video.bytes().await.unwrap(), content);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_finished_upload_names_its_session_in_every_answer() {
    let centre = Centre::open().await;
    let content = recording(1000, 6);
    let upload = Upload::begin(&centre.trainee, content.len()).await;
    let id = session_of(&upload.patch(0, &content).await);
    for _ in 0..2 {
        let head = upload.request(Method::HEAD).send().await.unwrap();
        assert_eq!(session_of(&head), id);
        assert_eq!(head.headers()["upload-offset"], "1000");
        assert!(!head.headers().contains_key("trocar-duplicate"), "the session is this upload's own");
        let again = upload.patch(1000, &[]).await;
        assert!(!again.headers().contains_key("trocar-duplicate"));
        assert_eq!((again.status(), session_of(&again)), (StatusCode::NO_CONTENT, id.clone()));
    }
    let sessions = centre.trainee.read("/api/v1/sessions").await;
    assert_eq!(sessions["items"].as_array().unwrap().len(), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_same_recording_again_gives_the_same_session_and_says_so() {
    let centre = Centre::open().await;
    let content = recording(1000, 7);
    let first = Upload::begin(&centre.trainee, content.len()).await;
    let id = session_of(&first.patch(0, &content).await);
    let second = Upload::begin(&centre.trainee, content.len()).await;
    let answer = second.patch(0, &content).await;
    assert_eq!(answer.status(), StatusCode::NO_CONTENT);
    assert_eq!((session_of(&answer), &answer.headers()["trocar-duplicate"]), (id.clone(), &"true".parse().unwrap()));
    let of = |head: reqwest::Response| head.headers().get("trocar-duplicate").cloned();
    let head = |upload: &Upload| upload.request(Method::HEAD).send();
    assert_eq!(of(head(&second).await.unwrap()), Some("true".parse().unwrap()), "also in later answers");
    assert_eq!(of(head(&first).await.unwrap()), None);
    let in_one_call = super::centre::send(&centre.trainee, "ada", content).await;
    let refused = problem(in_one_call, 409, "duplicate-recording").await;
    assert_eq!(refused["session"], format!("/api/v1/sessions/{id}"));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_terminated_upload_is_gone() {
    let centre = Centre::open().await;
    let upload = Upload::begin(&centre.trainee, 1000).await;
    upload.patch(0, &[1; 500]).await;
    assert_eq!(upload.request(Method::DELETE).send().await.unwrap().status(), StatusCode::NO_CONTENT);
    problem(upload.patch(500, &[1; 500]).await, 404, "not-found").await;
    assert_eq!(upload.request(Method::HEAD).send().await.unwrap().status(), StatusCode::NOT_FOUND);
    let left = std::fs::read_dir(centre.service.data.path().join("uploads")).unwrap().count();
    assert_eq!(left, 0, "no file remains");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_abandoned_upload_expires() {
    let clock = ManualClock::at(1_800_000_000_000);
    let centre = Centre::open_in(Service::start_with_clock(clock.clone()).await).await;
    let upload = Upload::begin(&centre.administrator, 1000).await;
    upload.patch(0, &[1; 500]).await;
    clock.advance(Duration::from_secs(49 * 3600));
    let administrator = centre.service.administrator().await;
    let upload = Upload { client: administrator, address: upload.address };
    let answer = upload.patch(500, &[1; 500]).await;
    assert!([StatusCode::GONE, StatusCode::NOT_FOUND].contains(&answer.status()), "{}", answer.status());
    let uploads = centre.service.data.path().join("uploads");
    poll_until("the deletion of the file", || std::fs::read_dir(&uploads).unwrap().count() == 0).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_continues_after_a_restart_of_the_service() {
    let centre = Centre::open().await;
    let content = recording(2 * MIB, 8);
    let upload = Upload::begin(&centre.administrator, content.len()).await;
    upload.patch(0, &content[..MIB]).await;
    let path = upload.address.replace(&format!("http://{}", centre.service.address()), "");
    let service = Service::start_in(centre.service.stop().await, Arc::new(SystemClock), |_| ()).await;
    let administrator = service.administrator().await;
    let upload = Upload { client: administrator.clone(), address: path };
    assert_eq!(upload.offset().await, MIB);
    let id = session_of(&upload.patch(MIB, &content[MIB..]).await);
    let video = administrator.get(&format!("/api/v1/sessions/{id}/video")).await;
    assert_eq!(video.bytes().await.unwrap(), content);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_that_cannot_become_a_session_is_refused_before_a_byte_is_sent() {
    let centre = Centre::open().await;
    let of = |trainee: &str, task: &str, in_box: &str| {
        metadata(&[("filename", "a.mp4"), ("trainee", trainee), ("task", task), ("box", in_box)])
    };
    for (field, metadata) in [
        ("trainee", of("missing", "peg", "box-1")),
        ("trainee", of("bob", "peg", "box-1")),
        ("task", of("ada", "knots", "box-1")),
        ("box", of("ada", "peg", "box-9")),
    ] {
        let refused = problem(create(&centre.trainee, 10, &metadata).await, 422, "unknown-reference").await;
        assert_eq!(refused["field"], field);
    }
    problem(create(&centre.trainee, 10, "").await, 422, "invalid").await;
    problem(create(&centre.trainee, 10, "trainee !!").await, 400, "bad-request").await;
    problem(create(&centre.trainee, 9 * 1024 * MIB, &for_ada()).await, 413, "too-large").await;
    problem(create(&centre.trainee, 0, &for_ada()).await, 422, "invalid").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_protocol_is_described_and_its_mistakes_are_explained() {
    let centre = Centre::open().await;
    let options = centre.trainee.request(Method::OPTIONS, "/api/v1/uploads").send().await.unwrap();
    assert_eq!(options.headers()["tus-version"], "1.0.0");
    assert_eq!(options.headers()["tus-max-size"], (8 * 1024 * MIB).to_string().as_str());
    assert_eq!(options.headers()["tus-checksum-algorithm"], "sha1,sha256");
    for extension in ["creation", "creation-with-upload", "termination", "checksum", "expiration"] {
        assert!(options.headers()["tus-extension"].to_str().unwrap().split(',').any(|e| e == extension));
    }
    let upload = Upload::begin(&centre.trainee, 1000).await;
    let old =
        centre.trainee.request(Method::HEAD, &upload.address).header("tus-resumable", "0.2.2").send().await.unwrap();
    assert_eq!(
        (old.status(), &old.headers()["tus-version"]),
        (StatusCode::PRECONDITION_FAILED, &"1.0.0".parse().unwrap())
    );
    problem(upload.patch(1, &[0; 10]).await, 409, "conflict").await;
    problem(upload.patch(0, &[0; 1001]).await, 413, "too-large").await;
    let plain = upload.request(Method::PATCH).header("upload-offset", 0).header(header::CONTENT_TYPE, "text/plain");
    problem(plain.body("x").send().await.unwrap(), 415, "unsupported-media-type").await;
    let nowhere = upload.request(Method::PATCH).header(header::CONTENT_TYPE, "application/offset+octet-stream");
    problem(nowhere.body("x").send().await.unwrap(), 400, "bad-request").await;
    assert_eq!(upload.offset().await, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_of_another_person_is_not_found() {
    let centre = Centre::open().await;
    let upload = Upload::begin(&centre.trainee, 1000).await;
    for other in [&centre.other_trainee, &centre.other_instructor] {
        let theirs = Upload { client: other.clone(), address: upload.address.clone() };
        assert_eq!(theirs.request(Method::HEAD).send().await.unwrap().status(), StatusCode::NOT_FOUND);
        problem(theirs.patch(0, &[1; 10]).await, 404, "not-found").await;
        problem(theirs.request(Method::DELETE).send().await.unwrap(), 404, "not-found").await;
    }
    assert_eq!(upload.offset().await, 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainee_without_sessions_gets_an_empty_page() {
    let centre = Centre::open().await;
    let sessions = read(centre.trainee.get("/api/v1/sessions").await, StatusCode::OK).await;
    assert_eq!(sessions, serde_json::json!({"items": [], "next": null}));
}
