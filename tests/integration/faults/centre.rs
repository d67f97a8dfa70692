//! A real service process with a box, a trainee and a task, and a client of it.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use reqwest::{Client, Method, RequestBuilder, Response, StatusCode};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;

use super::Dice;
use crate::process::{Launch, Process, program};
use crate::support::{PATIENCE, let_time_pass, poll_json};

/// Maximum time of a start after a kill.
const MAX_START_TIME: Duration = Duration::from_secs(5);

/// A real service process with a box, a trainee and a task.
pub struct Centre {
    process: Option<Process>,
    launch: Launch,
    /// The service's folder.
    data: PathBuf,
    base: String,
    token: String,
    /// The administrator's sign-in.
    cookie: String,
    http: Client,
    /// The slowest start after a kill so far.
    pub slowest_start: Duration,
    /// Holds the scene and, unless `data` is elsewhere, the data.
    folder: TempDir,
}

impl Centre {
    /// A centre whose box has camera and colours, so that recordings are tracked.
    pub async fn open() -> Self {
        Self::open_with(|_| ()).await
    }

    /// The same, with a changed start of the service.
    pub async fn open_with(launch: Launch) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("data");
        Self::open_at(folder, data, launch).await
    }

    /// The same, with the data in another folder.
    pub async fn open_at(folder: TempDir, data: PathBuf, launch: Launch) -> Self {
        let centre = Self::open_bare(folder, data, launch).await;
        centre.set_up_box().await;
        centre
    }

    /// A centre whose box still lacks camera and colours: no job runs beside the requests.
    pub async fn open_bare(folder: TempDir, data: PathBuf, launch: Launch) -> Self {
        simulate(&folder.path().join("scene"));
        let process = Process::launch(&data, launch);
        let (base, password) = (api_base(&process), process.password.clone());
        let mut centre = Self {
            process: Some(process),
            launch,
            data,
            base,
            token: String::new(),
            cookie: String::new(),
            http: Client::new(),
            slowest_start: Duration::ZERO,
            folder,
        };
        centre.sign_in(&password.expect("the first start has a password")).await;
        for (path, name) in [("/boxes", "Box 1"), ("/trainees", "Ada"), ("/tasks", "Pegs")] {
            centre.create(path, name).await;
        }
        centre
    }

    /// Creates an object with a name.
    pub async fn create(&self, path: &str, name: &str) {
        json_of(self.request(Method::POST, path).json(&json!({"name": name})).send().await.unwrap()).await;
    }

    /// A file of the scene that is recorded.
    pub fn scene(&self, file: &str) -> PathBuf {
        self.folder.path().join("scene").join(file)
    }

    /// The token of the centre's programs.
    pub fn token(&self) -> &str {
        &self.token
    }

    /// The service's folder.
    pub fn data(&self) -> &Path {
        &self.data
    }

    /// The service's process.
    pub fn process(&self) -> &Process {
        self.process.as_ref().expect("it runs")
    }

    async fn sign_in(&mut self, password: &str) {
        let body = json!({"login": "administrator", "password": password});
        let answer = self.http.post(format!("{}/sign-in", self.base)).json(&body).send().await.unwrap();
        self.cookie = answer.headers()["set-cookie"].to_str().unwrap().split(';').next().unwrap().to_owned();
        let token = json!({"name": "faults", "role": "administrator"});
        self.token =
            json_of(self.create_signed_in("/tokens", &token).await).await["token"].as_str().unwrap().to_owned();
    }

    /// Creates what a token does not suffice for.
    pub async fn create_signed_in(&self, path: &str, body: &Value) -> Response {
        let request = self.http.post(format!("{}{path}", self.base)).header("cookie", &self.cookie);
        request.json(body).send().await.unwrap()
    }

    async fn set_up_box(&self) {
        let camera = std::fs::read(self.scene("camera.json")).unwrap();
        let put =
            self.request(Method::PUT, "/boxes/box-1/camera").header("content-type", "application/json").body(camera);
        assert!(put.send().await.unwrap().status().is_success());
        let form = reqwest::multipart::Form::new()
            .text("annotations", std::fs::read_to_string(self.scene("annotations.json")).unwrap())
            .part("video", reqwest::multipart::Part::bytes(std::fs::read(self.scene("clip.mp4")).unwrap()));
        let queued =
            json_of(self.request(Method::POST, "/boxes/box-1/palettes").multipart(form).send().await.unwrap()).await;
        let job = queued["job"].as_str().unwrap().to_owned();
        let state =
            self.until(&format!("/jobs/{job}"), |job| job["state"] != "queued" && job["state"] != "running").await;
        assert_eq!(state["state"], "done", "{state}");
    }

    pub fn request(&self, method: Method, path: &str) -> RequestBuilder {
        self.http.request(method, format!("{}{path}", self.base)).bearer_auth(&self.token)
    }

    pub async fn get(&self, path: &str) -> Response {
        self.request(Method::GET, path).send().await.unwrap()
    }

    pub async fn begin_upload(&self, length: usize) -> String {
        let fields = [("filename", "clip.mp4"), ("trainee", "ada"), ("task", "pegs"), ("box", "box-1")];
        let metadata = fields.map(|(key, value)| format!("{key} {}", base64(value))).join(",");
        let request = self.request(Method::POST, "/uploads").header("tus-resumable", "1.0.0");
        let request = request.header("upload-length", length).header("upload-metadata", metadata);
        let answer = request.send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::CREATED);
        let location = answer.headers()["location"].to_str().unwrap();
        location.rsplit('/').next().unwrap().to_owned()
    }

    pub async fn offset(&self, upload: &str) -> usize {
        let answer = self.request(Method::HEAD, &format!("/uploads/{upload}")).header("tus-resumable", "1.0.0");
        let answer = answer.send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::OK);
        answer.headers()["upload-offset"].to_str().unwrap().parse().unwrap()
    }

    pub async fn patch(&self, upload: &str, offset: usize, piece: &[u8]) -> Response {
        let request = self.request(Method::PATCH, &format!("/uploads/{upload}")).header("tus-resumable", "1.0.0");
        let request = request.header("upload-offset", offset).header("content-type", "application/offset+octet-stream");
        request.body(piece.to_vec()).send().await.unwrap()
    }

    /// Sends one piece that is acknowledged, then half of another one whose rest never follows. Returns the
    /// acknowledged offset.
    pub async fn send_until_killed(&self, upload: &str, recording: &[u8], offset: usize, piece: usize) -> usize {
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

    pub async fn send_rest(&self, upload: &str, recording: &[u8], offset: usize) -> String {
        let answer = self.patch(upload, offset, &recording[offset..]).await;
        assert_eq!(answer.status(), StatusCode::NO_CONTENT);
        answer.headers()["trocar-session"].to_str().unwrap().to_owned()
    }

    pub async fn send_whole(&self, recording: Vec<u8>) -> String {
        let path = "/sessions?trainee=ada&task=pegs&box=box-1&filename=clip.mp4";
        let request = self.request(Method::POST, path).header("content-type", "video/mp4").body(recording);
        json_of(request.send().await.unwrap()).await["id"].as_str().unwrap().to_owned()
    }

    /// Polls until the answer is as wanted. A kill would end a stream of events, so this client does not use one.
    pub async fn until(&self, path: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        poll_json(path, async || json_of(self.get(path).await).await, wanted).await
    }

    /// Waits for the session's end. A job whose child was killed three times is quarantined: it is then retried, as a
    /// person would.
    pub async fn ends_with_one_result(&self, session: &str) {
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

    /// Kills the service.
    pub fn kill(&mut self) {
        drop(self.process.take()); // SIGKILL
    }

    /// Starts the service again; it must be ready within [`MAX_START_TIME`].
    pub async fn restart(&mut self) {
        let begun = Instant::now();
        let process = Process::launch(&self.data, self.launch);
        assert!(process.password.is_none(), "the administrator still exists");
        self.base = api_base(&process);
        self.process = Some(process);
        let ready = self.http.get(format!("http://{}/readyz", self.host())).send().await.unwrap();
        assert_eq!(ready.status(), StatusCode::OK);
        self.slowest_start = self.slowest_start.max(begun.elapsed());
        assert!(begun.elapsed() < MAX_START_TIME, "ready after {:?}", begun.elapsed());
    }

    /// Waits until a child runs, and `moment` longer, and kills it, or another child if it ended meanwhile. `false` if
    /// the session's job ended first.
    pub async fn kill_a_child(&self, session: &str, moment: Duration) -> bool {
        let begun = Instant::now();
        loop {
            assert!(begun.elapsed() < PATIENCE, "no child to kill, and {session} does not end");
            if self.children().is_empty() {
                let status = json_of(self.get(&format!("/sessions/{session}")).await).await["status"].take();
                if status == "done" || status == "failed" {
                    return false;
                }
                continue;
            }
            let_time_pass(moment.mul_f64(1.0 / (1.0 + begun.elapsed().as_secs_f64()))).await;
            if self.children().iter().any(|&child| kill_process(child, Signal::KILL).is_ok()) {
                return true;
            }
        }
    }

    /// The present children of the service.
    pub fn children(&self) -> Vec<Pid> {
        let threads = std::fs::read_dir(format!("/proc/{}/task", self.process().id())).unwrap().flatten();
        let lists = threads.filter_map(|thread| std::fs::read_to_string(thread.path().join("children")).ok());
        lists
            .flat_map(|list| {
                list.split_whitespace().filter_map(|id| Pid::from_raw(id.parse().ok()?)).collect::<Vec<_>>()
            })
            .collect()
    }

    /// The findings of `trocar admin check` in the folder of a stopped service; empty if there are none.
    pub fn check(&self) -> String {
        let check = program().args(["admin", "check", "--thorough", "--data"]).arg(&self.data).output().unwrap();
        let output = [check.stdout, check.stderr].concat();
        if check.status.success() { String::new() } else { String::from_utf8_lossy(&output).into_owned() }
    }

    pub fn host(&self) -> String {
        self.base.trim_start_matches("http://").trim_end_matches("/api/v1").to_owned()
    }
}

fn api_base(process: &Process) -> String {
    format!("http://{}/api/v1", process.address)
}

fn simulate(folder: &Path) {
    let made = program()
        .args("simulate --quiet --scene pegs --seed 5 --seconds 2 --size 640x360 --boards 0 --out".split(' '))
        .arg(folder)
        .status();
    assert!(made.unwrap().success());
}

/// The clip with an MP4 `free` box behind it: it has the wanted length and is still a recording.
pub fn padded(clip: &Path, length: usize) -> Vec<u8> {
    padded_bytes(&std::fs::read(clip).unwrap(), length)
}

pub fn padded_bytes(clip: &[u8], length: usize) -> Vec<u8> {
    let padding = length - clip.len();
    let mut bytes = clip.to_vec();
    bytes.extend(u32::try_from(padding).unwrap().to_be_bytes());
    bytes.extend(b"free");
    let mut dice = Dice(length as u64 | 1);
    bytes.resize_with(length, || dice.next() as u8);
    bytes
}

pub async fn json_of(answer: Response) -> Value {
    let (status, address) = (answer.status(), answer.url().clone());
    let text = answer.text().await.unwrap();
    assert!(status.is_success(), "{address}: {status}: {text}");
    serde_json::from_str(&text).unwrap()
}

fn base64(text: &str) -> String {
    use base64::Engine;
    base64::engine::general_purpose::STANDARD.encode(text)
}
