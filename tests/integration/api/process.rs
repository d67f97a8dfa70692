//! The program itself: its first start, its orderly end, and kills at any moment.

use std::fs;
use std::io::{BufRead, BufReader, Lines};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

use bytes::Bytes;
use rand::RngExt;
use reqwest::{Method, StatusCode, header};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;
use sha2::{Digest, Sha256};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;

use super::centre::recording;
use super::tus::metadata;
use crate::process::first_password;
use crate::support::{Client, read, soon};

const MIB: usize = 1024 * 1024;

/// `trocar serve` as a separate process.
struct Process {
    child: Child,
    /// Kept open: its later output.
    _stdout: Lines<BufReader<ChildStdout>>,
    base: String,
    /// The administrator's password, if this was the first start.
    password: Option<String>,
}

impl Process {
    /// Starts it on this folder and waits until it prints its address.
    fn start(data: &Path) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trocar"));
        command.args(["serve", "--listen", "127.0.0.1:0", "--workers", "1", "--log", "warn", "--data"]).arg(data);
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let first = lines.next().expect("it prints its address").unwrap();
        let base = first.rsplit(' ').next().unwrap().trim_end_matches('/').to_owned();
        let is_first = !data.join("had-its-first-start").exists();
        let password = is_first.then(|| first_password(data));
        fs::write(data.join("had-its-first-start"), "").unwrap();
        Self { child, _stdout: lines, base, password }
    }

    fn client(&self) -> Client {
        Client::of(self.base.clone())
    }

    async fn administrator(&self, password: &str) -> Client {
        self.client().signed_in("administrator", password).await
    }

    /// Kills it without warning.
    fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Stops it with SIGTERM, as a service manager does. Returns the exit status.
    async fn terminate(mut self) -> Option<i32> {
        kill_process(Pid::from_child(&self.child), Signal::TERM).unwrap();
        let ended = tokio::task::spawn_blocking(move || self.child.wait().unwrap().code());
        soon("the end", ended).await.unwrap()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_second_service_on_the_same_folder_is_refused_in_one_line() {
    let data = tempfile::tempdir().unwrap();
    let process = Process::start(data.path());
    let mut command = Command::new(env!("CARGO_BIN_EXE_trocar"));
    command.args(["serve", "--listen", "127.0.0.1:0", "--log", "error", "--data"]).arg(data.path());
    let second = command.output().unwrap();
    let stderr = String::from_utf8(second.stderr).unwrap();
    assert_eq!(second.status.code(), Some(1));
    assert!(stderr.starts_with("trocar: ") && stderr.lines().count() == 1 && stderr.contains("in use"), "{stderr}");
    process.kill();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_service_stops_in_order_while_streams_and_uploads_are_open() {
    let data = tempfile::tempdir().unwrap();
    let process = Process::start(data.path());
    let administrator = process.administrator(&process.password.clone().unwrap()).await;
    let events = administrator.get("/api/v1/events").await;
    let address = begin(&administrator, MIB).await;
    let (bytes, body) = mpsc::channel::<Result<Bytes, std::io::Error>>(1);
    let sending = patch(&administrator, &address, 0).body(reqwest::Body::wrap_stream(ReceiverStream::new(body))).send();
    let sending = tokio::spawn(sending);
    bytes.send(Ok(Bytes::from(vec![7; 1000]))).await.unwrap();
    let started = std::time::Instant::now();
    assert_eq!(process.terminate().await, Some(0));
    assert!(started.elapsed().as_secs() < 10, "{:?}", started.elapsed());
    let _ = sending.await.unwrap(); // an answer or a cut connection: both are correct
    drop((events, bytes));
}

#[tokio::test(flavor = "multi_thread")]
async fn killed_at_any_moment_of_an_upload_no_acknowledged_byte_is_lost() {
    let data = tempfile::tempdir().unwrap();
    let content = recording(24 * MIB, 11);
    let mut process = Process::start(data.path());
    let password = process.password.clone().unwrap();
    let mut administrator = process.administrator(&password).await;
    let address = begin(&administrator, content.len()).await;
    let mut acknowledged = 0;
    for _ in 0..8 {
        let sent = rand::rng().random_range(0..6 * MIB).min(content.len() - 1 - acknowledged);
        let (bytes, body) = mpsc::channel::<Result<Bytes, std::io::Error>>(1);
        let request =
            patch(&administrator, &address, acknowledged).body(reqwest::Body::wrap_stream(ReceiverStream::new(body)));
        let answer = tokio::spawn(request.send());
        bytes.send(Ok(Bytes::copy_from_slice(&content[acknowledged..acknowledged + sent]))).await.unwrap();
        bytes.reserve().await.unwrap().send(Ok(Bytes::new())); // the first piece was taken from the channel
        process.kill();
        assert!(answer.await.unwrap().is_err());
        process = Process::start(data.path());
        administrator = process.administrator(&password).await;
        let received = offset(&administrator, &address).await;
        assert!(
            received >= acknowledged && received <= acknowledged + sent,
            "{received} after {acknowledged} + {sent}"
        );
        acknowledged = received;
    }
    let last =
        patch(&administrator, &address, acknowledged).body(content[acknowledged..].to_vec()).send().await.unwrap();
    let session = last.headers()["trocar-session"].to_str().unwrap().to_owned();
    process.kill();
    let process = Process::start(data.path());
    let administrator = process.administrator(&password).await;
    let sessions = administrator.read("/api/v1/sessions").await;
    assert_eq!(sessions["items"].as_array().unwrap().len(), 1);
    let video = administrator.get(&format!("/api/v1/sessions/{session}/video")).await.bytes().await.unwrap();
    assert_eq!(Sha256::digest(&video), Sha256::digest(&content));
    process.kill();
}

/// Creates a box, a task and a trainee, and begins an upload. Returns its address.
async fn begin(administrator: &Client, length: usize) -> String {
    administrator.make("/api/v1/boxes", json!({"name": "Box 1"})).await;
    administrator.make("/api/v1/tasks", json!({"name": "Peg"})).await;
    administrator.make("/api/v1/trainees", json!({"name": "Ada"})).await;
    let of_ada = metadata(&[("trainee", "ada"), ("task", "peg"), ("box", "box-1")]);
    let made = super::tus::create(administrator, length, &of_ada).await;
    assert_eq!(made.status(), StatusCode::CREATED);
    made.headers()[header::LOCATION].to_str().unwrap().to_owned()
}

fn patch(client: &Client, address: &str, offset: usize) -> reqwest::RequestBuilder {
    let request = client.request(Method::PATCH, address).header("tus-resumable", "1.0.0");
    request.header("upload-offset", offset).header(header::CONTENT_TYPE, "application/offset+octet-stream")
}

async fn offset(client: &Client, address: &str) -> usize {
    let answer = client.request(Method::HEAD, address).header("tus-resumable", "1.0.0").send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    answer.headers()["upload-offset"].to_str().unwrap().parse().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_service_is_ready_again_soon_after_a_kill() {
    let data = tempfile::tempdir().unwrap();
    Process::start(data.path()).kill();
    let started = std::time::Instant::now();
    let process = Process::start(data.path());
    read(process.client().get("/readyz").await, StatusCode::OK).await;
    assert!(started.elapsed().as_secs() < 5, "{:?}", started.elapsed());
    process.kill();
}
