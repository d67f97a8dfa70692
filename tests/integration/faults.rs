//! The service and its children killed without warning, at random moments: nothing that was acknowledged is lost, every
//! job ends, and there is one result for each session.
//!
//! `TROCAR_KILLS` says how often each is killed: a few times in every run, 50 times by `make kills`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use reqwest::{Client, Method, RequestBuilder, Response, StatusCode};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tempfile::TempDir;
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;

use crate::process::Process;

/// A start after a kill may take this long.
const READY: Duration = Duration::from_secs(5);
/// Longest wait for work to end.
const PATIENCE: Duration = Duration::from_secs(120);
/// Bytes of the recording that is uploaded: a clip with padding behind it.
const UPLOAD: usize = 24 << 20;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_acknowledged_byte_is_lost_when_the_service_is_killed_during_an_upload() {
    let mut centre = Centre::open().await;
    let recording = padded(&centre.scene.join("clip.mp4"), UPLOAD);
    let upload = centre.begin_upload(recording.len()).await;
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    let mut acknowledged = 0;
    for _ in 0..kills() {
        let piece = 1 + dice.below(UPLOAD / (2 * kills()));
        acknowledged = centre.send_until_killed(&upload, &recording, acknowledged, piece).await;
        centre.kill_and_restart().await;
        let kept = centre.offset(&upload).await;
        assert!(kept >= acknowledged, "{acknowledged} bytes were acknowledged, {kept} are there");
        acknowledged = kept;
    }
    let session = centre.send_rest(&upload, &recording, acknowledged).await;
    let video = centre.get(&format!("/sessions/{session}/video")).await.bytes().await.unwrap();
    assert_eq!(Sha256::digest(&video), Sha256::digest(&recording), "the recording is whole");
    centre.ends_with_one_result(&session).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_job_ends_with_one_result_however_often_service_and_children_are_killed() {
    let mut centre = Centre::open().await;
    let clip = std::fs::read(centre.scene.join("clip.mp4")).unwrap();
    let mut dice = Dice(0x2545_f491_4f6c_dd1d);
    let mut sessions = Vec::new();
    for round in 0..kills() {
        let padding = clip.len() + 16 + round; // another length, another recording
        sessions.push(centre.send_whole(padded_bytes(&clip, padding)).await);
        tokio::time::sleep(Duration::from_millis(20 + dice.below(400) as u64)).await; // the moment of the kill, by chance
        if round % 2 == 0 {
            centre.kill_and_restart().await;
        } else {
            centre.kill_children();
        }
    }
    for session in &sessions {
        centre.ends_with_one_result(session).await;
    }
}

/// A box, a trainee and a task in a real process of the service.
struct Centre {
    process: Option<Process>,
    data: TempDir,
    scene: PathBuf,
    base: String,
    token: String,
    http: Client,
}

impl Centre {
    async fn open() -> Self {
        let data = tempfile::tempdir().unwrap();
        let scene = data.path().join("scene");
        simulate(&scene);
        let process = Process::start(&data.path().join("data"));
        let (base, password) = (interface(&process), process.password.clone());
        let mut centre = Self { process: Some(process), data, scene, base, token: String::new(), http: Client::new() };
        centre.sign_in(&password.expect("the first start tells the password")).await;
        centre.furnish().await;
        centre
    }

    async fn sign_in(&mut self, password: &str) {
        let body = json!({"login": "administrator", "password": password});
        let answer = self.http.post(format!("{}/sign-in", self.base)).json(&body).send().await.unwrap();
        let cookie = answer.headers()["set-cookie"].to_str().unwrap().split(';').next().unwrap().to_owned();
        let token = json!({"name": "faults", "role": "administrator"});
        let request = self.http.post(format!("{}/tokens", self.base)).header("cookie", cookie).json(&token);
        self.token = json_of(request.send().await.unwrap()).await["token"].as_str().unwrap().to_owned();
    }

    async fn furnish(&self) {
        for (path, name) in [("/boxes", "Box 1"), ("/trainees", "Ada"), ("/tasks", "Pegs")] {
            json_of(self.request(Method::POST, path).json(&json!({"name": name})).send().await.unwrap()).await;
        }
        let camera = std::fs::read(self.scene.join("camera.json")).unwrap();
        let put =
            self.request(Method::PUT, "/boxes/box-1/camera").header("content-type", "application/json").body(camera);
        assert!(put.send().await.unwrap().status().is_success());
        let form = reqwest::multipart::Form::new()
            .text("annotations", std::fs::read_to_string(self.scene.join("annotations.json")).unwrap())
            .part("video", reqwest::multipart::Part::bytes(std::fs::read(self.scene.join("clip.mp4")).unwrap()));
        let queued =
            json_of(self.request(Method::PUT, "/boxes/box-1/palette").multipart(form).send().await.unwrap()).await;
        let job = queued["job"].as_str().unwrap().to_owned();
        let state =
            self.until(&format!("/jobs/{job}"), |job| job["state"] != "queued" && job["state"] != "running").await;
        assert_eq!(state["state"], "done", "{state}");
    }

    fn request(&self, method: Method, path: &str) -> RequestBuilder {
        self.http.request(method, format!("{}{path}", self.base)).bearer_auth(&self.token)
    }

    async fn get(&self, path: &str) -> Response {
        self.request(Method::GET, path).send().await.unwrap()
    }

    async fn begin_upload(&self, length: usize) -> String {
        let said = [("filename", "clip.mp4"), ("trainee", "ada"), ("task", "pegs"), ("box", "box-1")];
        let metadata = said.map(|(key, value)| format!("{key} {}", base64(value))).join(",");
        let request = self.request(Method::POST, "/uploads").header("tus-resumable", "1.0.0");
        let request = request.header("upload-length", length).header("upload-metadata", metadata);
        let answer = request.send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::CREATED);
        let place = answer.headers()["location"].to_str().unwrap();
        place.rsplit('/').next().unwrap().to_owned()
    }

    async fn offset(&self, upload: &str) -> usize {
        let answer = self.request(Method::HEAD, &format!("/uploads/{upload}")).header("tus-resumable", "1.0.0");
        let answer = answer.send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::OK);
        answer.headers()["upload-offset"].to_str().unwrap().parse().unwrap()
    }

    async fn patch(&self, upload: &str, offset: usize, piece: &[u8]) -> Response {
        let request = self.request(Method::PATCH, &format!("/uploads/{upload}")).header("tus-resumable", "1.0.0");
        let request = request.header("upload-offset", offset).header("content-type", "application/offset+octet-stream");
        request.body(piece.to_vec()).send().await.unwrap()
    }

    /// Sends one piece that is acknowledged, then half of another one whose rest never comes. Returns what the service
    /// said it has.
    async fn send_until_killed(&self, upload: &str, recording: &[u8], offset: usize, piece: usize) -> usize {
        let end = (offset + piece).min(recording.len() - 1);
        let answer = self.patch(upload, offset, &recording[offset..end]).await;
        assert_eq!(answer.status(), StatusCode::NO_CONTENT);
        let acknowledged: usize = answer.headers()["upload-offset"].to_str().unwrap().parse().unwrap();
        let rest = &recording[acknowledged..];
        let head = format!(
            "PATCH /api/v1/uploads/{upload} HTTP/1.1\r\nhost: {host}\r\nauthorization: Bearer {token}\r\ntus-resumable: 1.0.0\r\n\
             upload-offset: {acknowledged}\r\ncontent-type: application/offset+octet-stream\r\ncontent-length: {length}\r\n\r\n",
            host = self.host(),
            token = self.token,
            length = rest.len()
        );
        let mut wire = TcpStream::connect(self.host()).await.unwrap();
        wire.write_all(head.as_bytes()).await.unwrap();
        wire.write_all(&rest[..rest.len() / 2]).await.unwrap();
        acknowledged
    }

    async fn send_rest(&self, upload: &str, recording: &[u8], offset: usize) -> String {
        let answer = self.patch(upload, offset, &recording[offset..]).await;
        assert_eq!(answer.status(), StatusCode::NO_CONTENT);
        answer.headers()["trocar-session"].to_str().unwrap().to_owned()
    }

    async fn send_whole(&self, recording: Vec<u8>) -> String {
        let path = "/sessions?trainee=ada&task=pegs&box=box-1&filename=clip.mp4";
        let request = self.request(Method::POST, path).header("content-type", "video/mp4").body(recording);
        json_of(request.send().await.unwrap()).await["id"].as_str().unwrap().to_owned()
    }

    /// Asks again and again until the answer is as wanted: what a client does that does not listen to events, which a
    /// kill would end.
    async fn until(&self, path: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let seen = json_of(self.get(path).await).await;
            if wanted(&seen) {
                return seen;
            }
            assert!(begun.elapsed() < PATIENCE, "{path} is still {seen}");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// Waits for the session's end. A child killed three times is quarantined: then a person tries again.
    async fn ends_with_one_result(&self, session: &str) {
        let ended = |s: &Value| s["status"] == "done" || s["status"] == "failed";
        let mut seen = self.until(&format!("/sessions/{session}"), ended).await;
        if seen["quarantined"] == true {
            self.request(Method::POST, &format!("/sessions/{session}/retry")).send().await.unwrap();
            seen = self.until(&format!("/sessions/{session}"), ended).await;
        }
        assert_eq!(seen["status"], "done", "{seen}");
        let features = seen["features"].as_array().unwrap();
        let mut names: Vec<String> =
            features.iter().map(|f| format!("{} {} {}", f["name"], f["tool"], f["space"])).collect();
        let all = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), all, "each feature is there once");
        assert!(all > 0);
    }

    async fn kill_and_restart(&mut self) {
        drop(self.process.take()); // SIGKILL
        let begun = Instant::now();
        let process = Process::start(&self.data.path().join("data"));
        assert!(process.password.is_none(), "the administrator is still there");
        self.base = interface(&process);
        self.process = Some(process);
        let ready = self.http.get(format!("http://{}/readyz", self.host())).send().await.unwrap();
        assert_eq!(ready.status(), StatusCode::OK);
        assert!(begun.elapsed() < READY, "ready after {:?}", begun.elapsed());
    }

    fn kill_children(&self) {
        let Some(parent) = self.process.as_ref().map(Process::id) else { return };
        let children = std::fs::read_to_string(format!("/proc/{parent}/task/{parent}/children")).unwrap_or_default();
        let of_threads = std::fs::read_dir(format!("/proc/{parent}/task")).unwrap().flatten();
        let all = of_threads.filter_map(|task| std::fs::read_to_string(task.path().join("children")).ok());
        for pid in all.chain([children]).flat_map(|list| list.split_whitespace().map(str::to_owned).collect::<Vec<_>>())
        {
            let _ = Command::new("kill").args(["-9", &pid]).stderr(Stdio::null()).status(); // it may have ended already
        }
    }

    fn host(&self) -> String {
        self.base.trim_start_matches("http://").trim_end_matches("/api/v1").to_owned()
    }
}

fn interface(process: &Process) -> String {
    format!("http://{}/api/v1", process.address)
}

fn simulate(folder: &Path) {
    let made = Command::new(env!("CARGO_BIN_EXE_trocar"))
        .args("simulate --quiet --scene pegs --seed 5 --seconds 2 --size 640x360 --boards 0 --out".split(' '))
        .arg(folder)
        .status();
    assert!(made.unwrap().success());
}

/// The clip with an MP4 `free` box behind it: as long as asked for, and still a recording.
fn padded(clip: &Path, length: usize) -> Vec<u8> {
    padded_bytes(&std::fs::read(clip).unwrap(), length)
}

fn padded_bytes(clip: &[u8], length: usize) -> Vec<u8> {
    let padding = length - clip.len();
    let mut bytes = clip.to_vec();
    bytes.extend(u32::try_from(padding).unwrap().to_be_bytes());
    bytes.extend(b"free");
    let mut dice = Dice(length as u64 | 1);
    bytes.resize_with(length, || dice.next() as u8);
    bytes
}

async fn json_of(answer: Response) -> Value {
    let (status, address) = (answer.status(), answer.url().clone());
    let text = answer.text().await.unwrap();
    assert!(status.is_success(), "{address}: {status}: {text}");
    serde_json::from_str(&text).unwrap()
}

fn base64(text: &str) -> String {
    use base64::Engine;
    base64::engine::general_purpose::STANDARD.encode(text)
}

fn kills() -> usize {
    std::env::var_os("TROCAR_KILLS").and_then(|n| n.to_str()?.parse().ok()).unwrap_or(3)
}

/// Marsaglia's xorshift64: the same moments in every run.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit.max(1) as u64) as usize
    }
}
