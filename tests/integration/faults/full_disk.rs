//! Disks that are really full, of a box's computer and of the service: small file systems without a free byte.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;

use reqwest::{Method, StatusCode};
use serde_json::{Value, json};
use trocar::time::SystemClock;

use super::agent::decode;
use crate::api::centre::Centre;
use crate::api::full_disk::SmallDisk;
use crate::box_agent::{BoxComputer, StandingAgent};
use crate::support::{Service, poll, poll_json, read};

const AGENT: &str = "/api/v1/boxes/box-1/agent";
const MIB: usize = 1 << 20;

/// A small file system of a test: mounted by root, or by any user in a mount namespace of its own.
enum TestDisk {
    Mounted { _disk: SmallDisk, folder: tempfile::TempDir },
    InNamespace { holder: Child, path: PathBuf, _folder: tempfile::TempDir },
}

impl TestDisk {
    /// `None` if the system permits neither; the caller's test is then reported as skipped.
    fn new(mib: usize) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        if let Some(disk) = SmallDisk::mount(folder.path(), mib) {
            return Some(Self::Mounted { _disk: disk, folder });
        }
        let mut unshare = Command::new("unshare");
        unshare.args(["--user", "--map-root-user", "--mount", "sh", "-c"]);
        unshare.arg(format!("mount -t tmpfs -o size={mib}m tmpfs \"$0\" && echo mounted && exec cat"));
        let holder = unshare.arg(folder.path()).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().ok();
        let mounted = holder.and_then(|mut holder| {
            let mut said = [0; 8];
            let is_mounted = std::io::Read::read_exact(holder.stdout.as_mut()?, &mut said).is_ok();
            is_mounted.then_some(holder)
        });
        let Some(holder) = mounted else {
            crate::resources::skip("the right to mount a small file system, as root or in a user namespace");
            return None;
        };
        let path = PathBuf::from(format!("/proc/{}/root{}", holder.id(), folder.path().display()));
        Some(Self::InNamespace { holder, path, _folder: folder })
    }

    fn path(&self) -> &Path {
        match self {
            Self::Mounted { folder, .. } => folder.path(),
            Self::InNamespace { path, .. } => path,
        }
    }

    /// Takes all space that is left, to the last byte.
    fn fill(&self) {
        let mut filler = File::options().create(true).append(true).open(self.filler()).unwrap();
        for piece in [MIB, 4096, 1] {
            while filler.write_all(&vec![1; piece]).is_ok() {}
        }
    }

    fn free(&self) {
        fs::remove_file(self.filler()).unwrap();
    }

    fn filler(&self) -> PathBuf {
        self.path().join("filler")
    }
}

impl Drop for TestDisk {
    fn drop(&mut self) {
        if let Self::InNamespace { holder, .. } = self {
            let _ = holder.kill(); // its mounts end with it
            let _ = holder.wait();
        }
    }
}

/// A box that stands by.
struct Box1 {
    centre: Centre,
    computer: BoxComputer,
    agent: StandingAgent,
}

impl Box1 {
    async fn open(service: Service, spool: Option<PathBuf>) -> Self {
        let centre = Centre::open_in(service).await;
        let token = json!({"name": "box 1", "role": "agent", "box": "box-1"});
        let token = centre.administrator.make("/api/v1/tokens", token).await;
        let token = token["token"].as_str().unwrap();
        let computer = match spool {
            Some(spool) => BoxComputer::with_spool(token, 120, spool),
            None => BoxComputer::new(token, 120),
        };
        let agent = computer.stand_by(&format!("http://{}", centre.service.address()), &[]);
        let box_1 = Self { centre, computer, agent };
        box_1.until(|state| state["camera"]["is_open"] == true && !state["clock"].is_null()).await;
        box_1
    }

    async fn until(&self, wanted: impl Fn(&Value) -> bool) -> Value {
        self.centre.administrator.read_until(AGENT, wanted).await
    }

    async fn screen_until(&self, wanted: impl Fn(&Value) -> bool) -> Value {
        let state = async || reqwest::get(self.agent.screen("/state")).await.unwrap().json().await.unwrap();
        poll_json("the screen of the box", state, wanted).await
    }

    async fn press(&self, path: &str) -> reqwest::Response {
        reqwest::Client::new().post(self.agent.screen(path)).json(&json!({})).send().await.unwrap()
    }

    async fn start(&self) {
        let target = json!({"trainee": "ada", "task": "peg"});
        read(self.centre.administrator.post(&format!("{AGENT}/start"), target).await, StatusCode::OK).await;
    }

    async fn stop(&self) {
        let stopped = self.centre.administrator.request(Method::POST, &format!("{AGENT}/stop")).send().await.unwrap();
        read(stopped, StatusCode::OK).await;
    }

    /// Waits for this many more frames of the recording that runs.
    async fn more_frames(&self, more: u64) {
        let frames = |state: &Value| state["state"]["recording"]["frames"].as_u64();
        let before = frames(&self.screen_until(|state| frames(state).is_some()).await);
        self.screen_until(|state| frames(state) > before.map(|before| before + more)).await;
    }

    /// The times of the frames of the newest session, once all that the box has of it has arrived.
    async fn frame_times(&self) -> Vec<f64> {
        self.until(|state| state["recording"].is_null() && state["spool"]["recordings"] == 0).await;
        let arrived = |list: &Value| list["items"][0]["status"].as_str().is_some_and(|status| status != "receiving");
        let list = self.centre.administrator.read_until("/api/v1/sessions", arrived).await;
        let session = list["items"][0]["id"].as_str().unwrap();
        let video = self.centre.administrator.get(&format!("/api/v1/sessions/{session}/video")).await;
        assert_eq!(video.status(), StatusCode::OK);
        let copy = tempfile::NamedTempFile::new().unwrap();
        fs::write(copy.path(), video.bytes().await.unwrap()).unwrap();
        decode(copy.path()).iter().map(|(_, time_s, _)| *time_s).collect()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_box_whose_disk_is_full_says_so_loses_nothing_acknowledged_and_goes_on_when_there_is_space() {
    let Some(disk) = TestDisk::new(96) else { return };
    let box_1 = Box1::open(Service::start().await, Some(disk.path().join("spool"))).await;
    // A recording without a name ends before there is no space for it, and is sent.
    assert_eq!(box_1.press("/start").await.status(), StatusCode::NO_CONTENT);
    box_1.more_frames(25).await;
    disk.fill();
    let state = box_1.screen_until(|state| state["reached_limit"] == "space").await;
    assert_eq!(state["state"]["recording"], Value::Null, "{state}");
    box_1.screen_until(|state| state["last_unnamed"] == "waits").await;
    let refused = box_1.press("/start").await;
    assert_eq!(refused.status(), StatusCode::CONFLICT);
    assert_eq!(refused.json::<Value>().await.unwrap()["kind"], "no-space");
    box_1.until(|state| state["spool"]["is_full"] == true).await;
    disk.free();
    box_1.until(|state| state["spool"]["is_full"] == false).await;

    // A recording of a trainee continues: what the server has is removed, and gives space for what follows.
    box_1.start().await;
    box_1.until(|state| !state["recording"]["session"].is_null()).await;
    box_1.more_frames(25).await;
    disk.fill();
    box_1.more_frames(50).await;
    disk.free();
    box_1.more_frames(25).await;
    box_1.stop().await;
    let times = box_1.frame_times().await;
    assert!(times.len() > 50 && times[20] < 1.0, "what was acknowledged before is there: {times:?}");
    assert!(times.last().unwrap() - times[0] > 4.0, "and what came after it: {times:?}");

    // No recording begins on a full disk, nothing of it remains, and an agent starts there.
    disk.fill();
    let target = json!({"trainee": "ada", "task": "peg"});
    let refused = box_1.centre.administrator.post(&format!("{AGENT}/start"), target).await;
    let refused = crate::support::problem(refused, 409, "conflict").await;
    assert!(refused["detail"].as_str().unwrap().contains("space"), "{refused}");
    assert_eq!(box_1.computer.spooled(), 0);
    let server = format!("http://{}", box_1.centre.service.address());
    let Box1 { centre, computer, agent } = box_1;
    agent.kill();
    let agent = computer.stand_by(&server, &[]);
    let box_1 = Box1 { centre, computer, agent };
    box_1.until(|state| state["camera"]["is_open"] == true && state["spool"]["is_full"] == true).await;
    disk.free();
    box_1.start().await;
    box_1.more_frames(10).await;
    box_1.stop().await;
    assert!(box_1.frame_times().await.len() > 9);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_disk_of_the_service_costs_a_box_no_frame() {
    const STEP_S: f64 = 0.04;
    let Some(disk) = TestDisk::new(64) else { return };
    let data = tempfile::Builder::new().prefix("data").tempdir_in(disk.path()).unwrap();
    let service = Service::start_in(data, Arc::new(SystemClock), |_| ()).await;
    let box_1 = Box1::open(service, None).await;
    box_1.start().await;
    box_1.until(|state| !state["recording"]["session"].is_null()).await;
    box_1.more_frames(25).await;
    disk.fill();
    box_1.screen_until(|state| state["state"]["spool"]["frames"].as_u64() > Some(25)).await;
    let administrator = &box_1.centre.administrator;
    assert_eq!(administrator.get("/api/v1/sessions").await.status(), StatusCode::OK, "reading still works");
    let refused = administrator.post("/api/v1/tasks", json!({"name": "Knots"})).await;
    assert!([StatusCode::CREATED, StatusCode::INSUFFICIENT_STORAGE].contains(&refused.status()), "{refused:?}");
    disk.free();
    poll("a change", async || {
        let made = administrator.post("/api/v1/tasks", json!({"name": "Cuts"})).await;
        made.status().is_success().then_some(())
    })
    .await;
    box_1.screen_until(|state| state["state"]["spool"]["frames"].as_u64() < Some(25)).await;
    box_1.stop().await;
    let times = box_1.frame_times().await;
    let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
    assert!(times.len() > 50 && steps.clone().all(|step| (step - STEP_S).abs() < 0.001), "{times:?}");
}
