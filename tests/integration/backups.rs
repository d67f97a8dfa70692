//! Backups by the real program: stopped within a file, of a data folder that has lost files, and their metrics.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tempfile::TempDir;
use trocar::domain::blob::Blob;

use crate::api::centre::{Centre, recording, session};
use crate::process::{Process, program};
use crate::support::{ADMINISTRATOR, Client, soon};

/// The longest time that a backup takes to end after a stop. Without the stop it would read the same file for ever.
const AT_ONCE: Duration = Duration::from_secs(6);

/// A data folder with a session.
struct DataWithSession {
    folder: TempDir,
    /// Id of the session.
    session: String,
    /// The file of its recording.
    recording: PathBuf,
    /// The file's path in the data folder.
    name: String,
}

impl DataWithSession {
    async fn new() -> Self {
        let centre = Centre::open().await;
        let content = recording(10_000, 1);
        let name = Blob::of(&content).hash.file();
        let made = session(&centre.trainee, "ada", content).await;
        let folder = centre.service.stop().await;
        let session = made["id"].as_str().unwrap().to_owned();
        Self { session, recording: folder.path().join(&name), folder, name }
    }

    /// Puts a pipe in the place of the recording: its reader waits for bytes.
    fn replace_by_pipe(&self) {
        fs::remove_file(&self.recording).unwrap();
        let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
        rustix::fs::mkfifoat(rustix::fs::CWD, &self.recording, mode).unwrap();
    }

    /// Waits until a process reads the recording, sends it a SIGTERM, and feeds it until it closes the pipe.
    async fn stop_within_the_file(&self, process: Pid) {
        let pipe = self.recording.clone();
        let fed = tokio::task::spawn_blocking(move || {
            let mut pipe = File::options().write(true).open(pipe).unwrap();
            pipe.write_all(&[0; 4096]).unwrap();
            kill_process(process, Signal::TERM).unwrap();
            while pipe.write_all(&[0; 4096]).is_ok() {}
        });
        soon("the end of the reading", fed).await.unwrap();
    }

    fn admin(&self, words: &[&str]) -> Command {
        let mut command = program();
        command.args(["admin", "--data"]).arg(self.folder.path()).args(words);
        command
    }
}

/// The names in a folder.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn text(output: &[u8]) -> String {
    String::from_utf8_lossy(output).into_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_that_is_stopped_during_a_backup_ends_at_once_and_in_order() {
    let data = DataWithSession::new().await;
    data.replace_by_pipe();
    let target = tempfile::tempdir().unwrap();
    let log = data.folder.path().join("service.log");
    let mut service = program()
        .args(["serve", "--listen", "127.0.0.1:0", "--workers", "1", "--log", "info", "--data"])
        .arg(data.folder.path())
        .env("TROCAR_BACKUP__TARGET", target.path())
        .stdout(Stdio::piped())
        .stderr(File::create(&log).unwrap())
        .spawn()
        .unwrap();
    let mut printed = BufReader::new(service.stdout.take().unwrap()).lines();
    assert!(printed.any(|line| line.unwrap().contains("listens on"))); // from then on it handles signals
    data.stop_within_the_file(Pid::from_child(&service)).await;
    let since = Instant::now();
    let ended = tokio::task::spawn_blocking(move || service.wait().unwrap());
    let status = soon("the end of the service", ended).await.unwrap();
    let (took, log) = (since.elapsed(), fs::read_to_string(log).unwrap());
    assert!(status.success() && took < AT_ONCE, "{status} after {took:?}: {log}");
    let line = log.lines().find(|line| line.contains("interrupted by the stop")).unwrap_or_else(|| panic!("{log}"));
    assert!(line.contains("INFO"), "{line}");
    for word in ["panicked", "did not end in time", "damaged", "ERROR"] {
        assert!(!log.contains(word), "{word} in {log}");
    }
    let left = names(target.path());
    assert!(left.iter().all(|name| name == "erasures"), "{left:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_command_that_is_stopped_during_a_backup_leaves_nothing() {
    let data = DataWithSession::new().await;
    data.replace_by_pipe();
    let target = tempfile::tempdir().unwrap();
    let to = target.path().join("by-hand");
    let mut backup = data.admin(&["backup"]);
    let backup = backup.arg(&to).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    data.stop_within_the_file(Pid::from_child(&backup)).await;
    let ended = tokio::task::spawn_blocking(move || backup.wait_with_output().unwrap());
    let Output { status, stderr, .. } = soon("the end of the command", ended).await.unwrap();
    assert_eq!(status.code(), Some(1), "{}", text(&stderr));
    assert!(text(&stderr).contains("interrupted by the stop"), "{}", text(&stderr));
    assert_eq!(names(target.path()), Vec::<String>::new());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_backup_by_hand_that_lacks_files_is_made_fails_and_names_them_and_so_does_its_restore() {
    let data = DataWithSession::new().await;
    fs::remove_file(&data.recording).unwrap();
    let line =
        format!("missing file {}: recording of session {} (trainee ada, task peg, box box-1)", data.name, data.session);
    let target = tempfile::tempdir().unwrap();
    let (backup, restored) = (target.path().join("backup"), target.path().join("restored"));
    let checked = data.admin(&["check"]).output().unwrap();
    let made = data.admin(&["backup"]).arg(&backup).output().unwrap();
    let mut restore = program();
    restore.args(["admin", "restore", "--without-erasures"]).arg(&backup).arg("--data").arg(&restored);
    for ended in [checked, made, restore.output().unwrap()] {
        let (stdout, stderr) = (text(&ended.stdout), text(&ended.stderr));
        assert_eq!(ended.status.code(), Some(1), "{stdout}{stderr}");
        assert!(stdout.lines().any(|printed| printed == line), "{line} in {stdout}");
        assert!(stderr.contains("to the same place in the data folder"), "{stderr}");
    }
    let mark = fs::read_to_string(backup.join("BACKUP")).unwrap();
    assert!(mark.starts_with("This folder is a backup with missing files.") && mark.contains(&line), "{mark}");
    drop(Process::start(&restored)); // the service runs on it
}

#[tokio::test(flavor = "multi_thread")]
async fn the_metrics_of_backups_exist_before_the_first_backup_and_name_its_time_and_losses_then() {
    let data = DataWithSession::new().await;
    fs::remove_file(&data.recording).unwrap();
    let target = tempfile::tempdir().unwrap();
    let metrics = async |target: &Path| {
        let service = Process::launch(data.folder.path(), |command| {
            command.env("TROCAR_BACKUP__TARGET", target);
        });
        let client = Client::of(format!("http://{}", service.address));
        let read = async |name: &str| {
            let metrics = client.get("/metrics").await.text().await.unwrap();
            let line = metrics.lines().find_map(|line| line.strip_prefix(name)).unwrap_or_else(|| panic!("{metrics}"));
            line.trim().parse::<f64>().unwrap()
        };
        let administrator = client.clone().signed_in(ADMINISTRATOR.0, ADMINISTRATOR.1).await;
        let tried = |state: &Value| {
            let plan = &state["scheduled_backups"];
            !plan["error"].is_null() || !plan["newest_at"].is_null()
        };
        let state = administrator.read_until("/api/v1/service", tried).await;
        let at_s = read("trocar_backup_last_success_timestamp_seconds").await;
        (at_s, read("trocar_backup_missing_files").await, state["scheduled_backups"].clone())
    };
    let (at_s, missing, plan) = metrics(&target.path().join("not mounted")).await;
    assert_eq!((at_s, missing), (0.0, 0.0), "{plan}");
    let (at_s, missing, plan) = metrics(target.path()).await;
    assert!(at_s > 1.7e9, "{at_s}");
    assert_eq!((missing, &plan["missing_files"], &plan["error"]), (1.0, &1.into(), &Value::Null));
    assert!(plan["missing"][0].as_str().unwrap().contains(&data.session), "{plan}");
}
