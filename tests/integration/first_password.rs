//! The first administrator's password is in a private file until it is changed, and in no log.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use reqwest::StatusCode;
use serde_json::json;

use crate::process::{Process, first_password, program};
use crate::support::{Client, poll, poll_until};

const CHANGED: &str = "another password";

/// The paths of all files below a folder that hold a text.
fn holders(folder: &Path, text: &str) -> Vec<PathBuf> {
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let holds = |path: &PathBuf| {
        let content = fs::read(path).unwrap_or_default();
        content.windows(text.len()).any(|part| part == text.as_bytes())
    };
    let of = |path: PathBuf| match path.is_dir() {
        true => holders(&path, text),
        false => Some(path).filter(holds).into_iter().collect(),
    };
    paths.flat_map(of).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_password_is_in_a_private_file_until_it_is_changed_and_nowhere_else() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out, log) = (folder.path().join("data"), folder.path().join("out"), folder.path().join("log"));
    let mut command = program();
    command.args(["serve", "--listen", "127.0.0.1:0", "--workers", "1", "--log", "trace", "--data"]).arg(&data);
    command.env("TROCAR_UPKEEP__COLLECT_S", "1").stdin(Stdio::null());
    command.stdout(File::create(&out).unwrap()).stderr(File::create(&log).unwrap());
    let mut service = command.spawn().unwrap();
    let printed = poll("the service's greeting", async || {
        Some(fs::read_to_string(&out).unwrap()).filter(|text| text.contains("has been changed"))
    })
    .await;

    let file = data.join("administrator.password");
    assert!(printed.contains(&file.display().to_string()), "{printed}");
    assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
    let password = first_password(&data);
    let base = printed.lines().next().unwrap().rsplit(' ').next().unwrap().trim_end_matches('/').to_owned();
    let administrator = Client::of(base).signed_in("administrator", &password).await;
    assert_eq!(holders(folder.path(), &password), std::slice::from_ref(&file), "neither output, nor log, nor database");

    let change = json!({"old": password, "new": CHANGED});
    assert_eq!(administrator.post("/api/v1/me/password", change).await.status(), StatusCode::NO_CONTENT);
    poll_until("the deletion of the file", || !file.exists()).await;
    assert_eq!(holders(folder.path(), &password), Vec::<PathBuf>::new());
    service.kill().unwrap();
    service.wait().unwrap();
}

#[test]
fn on_an_occupied_port_no_administrator_is_made_and_the_next_start_makes_one() {
    let folder = tempfile::tempdir().unwrap();
    let occupant = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = occupant.local_addr().unwrap().to_string();
    let mut command = program();
    command.args(["serve", "--listen", &address, "--workers", "1", "--log", "error", "--data"]).arg(folder.path());
    let refused = command.output().unwrap();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert_eq!((refused.status.code(), refused.stdout), (Some(1), Vec::new()), "{said}");
    assert!(said.starts_with("trocar: ") && said.lines().count() == 1, "{said}");
    assert!(said.contains(&address) && said.contains("choose another address with `--listen`"), "{said}");

    assert!(!folder.path().join("administrator.password").exists());
    let list = program().args(["admin", "user", "list", "--data"]).arg(folder.path()).output().unwrap();
    assert!(list.status.success(), "{}", String::from_utf8_lossy(&list.stderr));
    assert_eq!(String::from_utf8(list.stdout).unwrap(), "");
    let _service = Process::start(folder.path());
    assert!(!first_password(folder.path()).is_empty());
}

#[test]
fn the_file_outlives_a_restart_and_goes_when_a_command_replaces_the_password() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("administrator.password");
    let password = Process::start(folder.path()).password.clone().unwrap();
    let service = Process::start(folder.path());
    assert_eq!(first_password(folder.path()), password);
    drop(service); // the command alone deletes the file
    let line = ["admin", "user", "password", "administrator", "--data"];
    let replaced = program().args(line).arg(folder.path()).output().unwrap();
    assert!(replaced.status.success(), "{}", String::from_utf8_lossy(&replaced.stderr));
    assert!(!file.exists());
    let _service = Process::start(folder.path());
    assert!(!file.exists(), "no later start makes another one");
}

#[test]
fn a_program_reads_the_first_password_from_a_pipe_unless_it_is_hidden() {
    for (flag, variable) in [(None, "false"), (Some("--hide-password"), "false"), (None, "true")] {
        let hidden = flag.is_some() || variable == "true";
        let folder = tempfile::tempdir().unwrap();
        let mut command = program();
        command.args(["serve", "--listen", "127.0.0.1:0", "--workers", "1", "--log", "error", "--data"]);
        command.arg(folder.path()).args(flag).env("TROCAR_HIDE_PASSWORD", variable).stdout(Stdio::piped());
        let mut service = command.spawn().unwrap();
        let mut lines = BufReader::new(service.stdout.take().unwrap()).lines().map_while(Result::ok);
        let greeting = lines.find(|line| line.starts_with("Sign in")).unwrap();
        let password = first_password(folder.path());
        service.kill().unwrap();
        service.wait().unwrap();
        assert_eq!(greeting.contains(&password), !hidden, "{greeting}");
        assert_eq!(greeting.contains("administrator.password"), hidden, "{greeting}");
    }
}
