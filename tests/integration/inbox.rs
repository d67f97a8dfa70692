//! The watched folder: recordings are taken once, although the service is killed; what cannot be taken is refused with
//! words or left alone; the list of the folder assigns.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;
use std::time::Duration;

use rand::RngExt;
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::process::{Process, program};
use crate::support::{Client, let_time_pass, poll_json, poll_until};

/// Half a second of a simulated box.
static CLIP: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let order =
        ["simulate", "--quiet", "--scene", "rest", "--seed", "3", "--seconds", "0.5", "--boards", "0", "--out", "."];
    assert!(program().args(order).current_dir(folder.path()).status().unwrap().success());
    fs::read(folder.path().join("clip.mp4")).unwrap()
});

/// The clip with other bytes: a box that players skip is appended.
fn clip(salt: u32) -> Vec<u8> {
    let mut bytes = CLIP.clone();
    bytes.extend(16_u32.to_be_bytes());
    bytes.extend(b"freesalt");
    bytes.extend(salt.to_be_bytes());
    bytes
}

/// A service that watches a folder.
struct Watched {
    service: Process,
    administrator: Client,
    inbox: TempDir,
    data: TempDir,
}

fn watch(command: &mut Command, inbox: &Path) {
    command.arg("--inbox").arg(inbox).env("TROCAR_INBOX__POLL_S", "1").env("TROCAR_INBOX__SETTLE_S", "1");
}

impl Watched {
    async fn open() -> Self {
        let (data, inbox) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let service = Process::launch(data.path(), |command| watch(command, inbox.path()));
        let client = Client::of(format!("http://{}", service.address));
        let administrator = client.signed_in("administrator", service.password.as_ref().unwrap()).await;
        for (name, code) in [("Ada Novak", "ada"), ("Bob Ray", "bob")] {
            administrator.make("/api/v1/trainees", json!({"name": name, "code": code})).await;
        }
        administrator.make("/api/v1/tasks", json!({"name": "Peg transfer", "code": "peg"})).await;
        administrator.make("/api/v1/boxes", json!({"name": "Box 1", "code": "box-1"})).await;
        Self { service, administrator, inbox, data }
    }

    /// Kills the service and starts it again.
    async fn restart(&mut self, password: &str) {
        let _ = Command::new("kill").args(["-KILL", &self.service.id().to_string()]).status();
        poll_until("the service is gone", || !Path::new(&format!("/proc/{}/fd/0", self.service.id())).exists()).await;
        let inbox = self.inbox.path().to_owned();
        self.service = Process::launch(self.data.path(), |command| watch(command, &inbox));
        let client = Client::of(format!("http://{}", self.service.address));
        self.administrator = client.signed_in("administrator", password).await;
    }

    /// Puts a recording there as a careful program does: under another name at first.
    fn put(&self, path: &str, content: &[u8]) {
        let place = self.inbox.path().join(path);
        fs::create_dir_all(place.parent().unwrap()).unwrap();
        let unfinished = place.with_extension("part");
        fs::write(&unfinished, content).unwrap();
        fs::rename(unfinished, place).unwrap();
    }

    fn at(&self, path: &str) -> PathBuf {
        self.inbox.path().join(path)
    }

    async fn until(&self, path: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        poll_json("recordings are taken", async || self.administrator.read(path).await, wanted).await
    }
}

fn names(page: &Value) -> Vec<String> {
    page["items"].as_array().unwrap().iter().map(|one| one["filename"].as_str().unwrap().to_owned()).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn thirty_files_are_taken_once_each_although_the_service_is_killed() {
    let mut watched = Watched::open().await;
    let password = watched.service.password.clone().unwrap();
    let (mut random, mut put) = (rand::rng(), 0);
    for _ in 0..4 {
        for _ in 0..7 {
            watched.put(&format!("shift {}/{put:02}.mp4", put % 3), &clip(put));
            put += 1;
        }
        let_time_pass(Duration::from_millis(random.random_range(1_000..3_500))).await; // a random moment for the kill
        watched.restart(&password).await;
    }
    watched.put("28.mp4", &clip(28));
    watched.put("again.mp4", &clip(0)); // the same recording under another name
    let all = watched.until("/api/v1/waiting-recordings?limit=200", |page| names(page).len() == 29).await;
    poll_until("the folder is empty", || !watched.at("again.mp4").exists() && !watched.at("28.mp4").exists()).await;
    let unique: BTreeSet<String> = names(&all).into_iter().collect();
    assert_eq!(unique.len(), 29, "each once: {unique:?}");
    for number in 0..28 {
        assert!(watched.at(&format!("taken/shift {}/{number:02}.mp4", number % 3)).exists(), "{number}");
    }
    assert_eq!(names(&watched.administrator.read("/api/v1/waiting-recordings?limit=200").await).len(), 29);
    let check = program().args(["admin", "check", "--data"]).arg(watched.data.path()).output().unwrap();
    assert!(check.status.success(), "{}", String::from_utf8_lossy(&check.stdout));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_list_assigns_and_what_cannot_be_taken_is_refused_or_left() {
    let watched = Watched::open().await;
    let list = "file,trainee,task,box,recorded_at\nada/,ada,Peg transfer,box-1,2024-03-11\nbob/,Bob Ray,knots,box-1,\n";
    fs::write(watched.at("people.csv"), list).unwrap();
    watched.put("ada/1.mp4", &clip(1));
    watched.put("bob/2024-03-12_08-00.mp4", &clip(2));
    watched.put("box-1/ada novak.mp4", &clip(3));
    watched.put("broken.mp4", b"this is no video at all, only its name says so");
    watched.put("notes.txt", b"left alone");
    watched.put(".hidden.mp4", &clip(4));
    symlink("/etc/passwd", watched.at("link.mp4")).unwrap();
    assert!(Command::new("mkfifo").arg(watched.at("pipe.mp4")).status().unwrap().success());

    let sessions = watched.until("/api/v1/sessions", |page| names(page).len() == 1).await;
    let session = &sessions["items"][0];
    assert_eq!((&session["trainee"]["code"], &session["supervision"]), (&json!("ada"), &json!("none")));
    assert!(session["recorded_at"].as_str().unwrap().starts_with("2024-03-11T"), "{session}");
    let waiting = watched.until("/api/v1/waiting-recordings", |page| names(page).len() == 2).await;
    let of = |name: &str| waiting["items"].as_array().unwrap().iter().find(|one| one["filename"] == name).unwrap();
    let (of_bob, unlisted) = (of("2024-03-12_08-00.mp4"), of("ada novak.mp4"));
    assert_eq!((&of_bob["trainee"]["code"], &of_bob["folder"]), (&json!("bob"), &json!("bob")));
    assert!(of_bob["remark"].as_str().unwrap().contains("`knots` is the code or name of no task"), "{of_bob}");
    assert_eq!((&unlisted["proposal"]["trainee"]["code"], &unlisted["remark"]), (&json!("ada"), &Value::Null));
    assert_eq!(unlisted["proposal"]["box"]["code"], "box-1");
    poll_until("what is no video is refused", || watched.at("refused/broken.mp4.why.txt").exists()).await;
    let why = fs::read_to_string(watched.at("refused/broken.mp4.why.txt")).unwrap();
    assert!(why.starts_with("The file is not a readable video: "), "{why}");
    assert!(watched.at("refused/broken.mp4").exists() && !watched.at("broken.mp4").exists());
    for left in ["notes.txt", ".hidden.mp4", "link.mp4", "pipe.mp4", "people.csv"] {
        assert!(fs::symlink_metadata(watched.at(left)).is_ok(), "{left} is left alone");
    }
}
