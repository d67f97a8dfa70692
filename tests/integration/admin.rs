//! `trocar admin` beside a running service, after a kill and after an orderly end.

use std::collections::BTreeMap;
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};
use trocar::upkeep::complete_backups;

use crate::api::full_disk::SmallDisk;
use crate::process::{Process, command, program};
use crate::support::{Client, poll, poll_until};

/// The longest wait for the database's lock, ms, in the test that holds it.
const SHORT_WAIT_MS: &str = "100";
/// The id of the system's user and group without privileges.
const UNPRIVILEGED: u32 = 65_534;
/// Name of a stored file: the SHA-256 of its content.
const STORED: &str = "ab00000000000000000000000000000000000000000000000000000000000000";

/// `trocar admin` on a data folder with the words of a line.
fn admin(data: &Path, line: &str) -> Command {
    let mut command = program();
    command.args(["admin", "--data"]).arg(data).args(line.split(' '));
    command
}

fn run(data: &Path, line: &str) -> Output {
    admin(data, line).output().unwrap()
}

/// Runs a command that must succeed, and returns its standard output.
fn succeed(data: &Path, line: &str) -> String {
    let ended = run(data, line);
    assert!(ended.status.success(), "{line}: {}", String::from_utf8_lossy(&ended.stderr));
    String::from_utf8(ended.stdout).unwrap()
}

/// All paths below a folder, with the contents of files.
fn everything(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        match path.is_dir() {
            true => found.extend(everything(&path)),
            false => drop(found.insert(path.clone(), fs::read(&path).unwrap())),
        }
        found.entry(path).or_default();
    }
    found
}

/// Runs the commands that only read; the folder must stay as it is to the last byte, and they must see `login`.
fn read_without_a_change(data: &Path, state: &str, login: &str) {
    let before = everything(data);
    for line in ["check --thorough", "user list", "token list"] {
        let printed = succeed(data, line);
        assert!(line != "user list" || printed.contains(login), "{state}: {printed}");
        let changed = everything(data).into_iter().find(|(path, content)| before.get(path) != Some(content));
        assert_eq!(changed.map(|(path, _)| path), None, "{state}: `{line}` changes this file");
        assert_eq!(everything(data).len(), before.len(), "{state}: `{line}` removes a file");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn commands_that_only_read_change_no_byte_of_the_data_folder() {
    let folder = tempfile::tempdir().unwrap();
    let service = Process::start(folder.path());
    let client = Client::of(format!("http://{}", service.address));
    let administrator = client.signed_in("administrator", service.password.as_deref().unwrap()).await;
    let new = json!({"login": "in-the-log", "name": "I", "role": "instructor", "password": "a password of tests"});
    administrator.make("/api/v1/people", new).await; // its row is in the write-ahead log, perhaps only there
    let id = Pid::from_raw(service.id().cast_signed()).unwrap();
    kill_process(id, Signal::STOP).unwrap(); // so that only the command could change something
    read_without_a_change(folder.path(), "beside a service", "in-the-log");
    drop(service);
    read_without_a_change(folder.path(), "after a kill", "in-the-log");
    succeed(folder.path(), "user add last --role instructor"); // the last connection empties and removes the log
    assert!(!folder.path().join("trocar.db-wal").exists());
    read_without_a_change(folder.path(), "after an orderly end", "last");
}

#[tokio::test(flavor = "multi_thread")]
async fn accounts_change_beside_a_service_that_writes_and_a_deleted_one_leaves_no_trace() {
    const NAME: &str = "Qvinxly";
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path();
    let service = Process::launch(data, |command| {
        command.env("TROCAR_UPKEEP__COLLECT_S", "1");
    });
    let client = Client::of(format!("http://{}", service.address));
    let administrator = client.clone().signed_in("administrator", service.password.as_deref().unwrap()).await;
    let writes = tokio::spawn(async move {
        for number in 0..40 {
            administrator.make("/api/v1/trainees", json!({"name": format!("Trainee {number}")})).await;
        }
    });
    let mut password = String::new();
    for number in 0..3 {
        password = succeed(data, &format!("user add of-{number} --role instructor --name {NAME}")).trim().to_owned();
    }
    let token = succeed(data, "token add reports --acts-for of-0");
    writes.await.unwrap();
    client.clone().signed_in("of-2", &password).await;
    client.with_token(token.trim()).read("/api/v1/tasks").await;

    for number in 0..3 {
        succeed(data, &format!("user delete of-{number}"));
    }
    let holds = |content: &Vec<u8>| content.windows(NAME.len()).any(|part| part == NAME.as_bytes());
    poll_until("the end of the deleted accounts' traces", || {
        let database = ["trocar.db", "trocar.db-wal"].map(|file| fs::read(data.join(file)).unwrap_or_default());
        !database.iter().any(holds)
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_command_that_waits_too_long_for_the_database_changes_nothing_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    drop(Process::start(folder.path()));
    let database = folder.path().join("trocar.db");
    let mut other = SqliteConnectOptions::new().filename(&database).connect().await.unwrap();
    let holder = other.begin_with("BEGIN IMMEDIATE").await.unwrap();
    let mut command = admin(folder.path(), "user add eve --role instructor");
    let refused = command.env("TROCAR_STORE__BUSY_TIMEOUT_MS", SHORT_WAIT_MS).output().unwrap();
    let stderr = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("busy") && stderr.contains("try again"), "{stderr}");
    holder.rollback().await.unwrap();
    assert!(!succeed(folder.path(), "user list").contains("eve"));
    succeed(folder.path(), "user add eve --role instructor");
}

#[test]
fn a_backup_can_be_checked_but_not_changed() {
    let folder = tempfile::tempdir().unwrap();
    let (data, backup) = (folder.path().join("data"), folder.path().join("backup"));
    drop(Process::start(&data));
    succeed(&data, &format!("backup {}", backup.display()));
    read_without_a_change(&backup, "a backup", "administrator");
    let refused = run(&backup, "user add eve --role instructor");
    let stderr = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("is a backup"), "{stderr}");
}

#[test]
fn the_help_of_every_command_says_which_folder_is_the_default() {
    for command in ["restore", "backup", "check"] {
        let help = program().args(["admin", command, "--help"]).output().unwrap();
        let help = String::from_utf8(help.stdout).unwrap();
        assert!(help.contains("[default: trocar-data"), "{command}:\n{help}");
    }
}

/// Standard error of a command that must fail with this status, in one line.
fn refusal(mut command: Command, status: i32) -> String {
    let ended = command.output().unwrap();
    let stderr = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(status), "{command:?}: {stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
    stderr
}

#[test]
fn a_lost_database_is_neither_made_anew_nor_are_its_files_deleted() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path();
    drop(Process::start(data));
    let (database, stored) = (data.join("trocar.db"), data.join("blobs/ab").join(STORED));
    fs::write(&stored, b"a recording").unwrap();
    for name in ["trocar.db", "trocar.db-wal", "trocar.db-shm"] {
        fs::remove_file(data.join(name)).unwrap();
    }
    for state in ["missing", "empty"] {
        let commands = ["check", "user list", "user add eve --role instructor", "token list"];
        let refused = commands.map(|line| refusal(admin(data, line), 2)).into_iter();
        for stderr in refused.chain([refusal(command(data), 1)]) {
            let advises = ["stored files", "admin restore", "empty folder"].iter().all(|part| stderr.contains(part));
            assert!(advises, "{state}: {stderr}");
        }
        assert!(stored.exists());
        assert_eq!(fs::metadata(&database).map_or(0, |found| found.len()), 0, "{state}");
        fs::write(&database, b"").unwrap();
    }
}

#[test]
fn files_that_no_row_names_are_deleted_on_request_while_the_service_is_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path();
    let service = Process::start(data);
    let stored = data.join("blobs/ab").join(STORED);
    fs::write(&stored, b"of another database").unwrap();
    let stderr = refusal(admin(data, "delete-orphans"), 2);
    assert!(stderr.contains("stop it first") && stored.exists(), "{stderr}");
    drop(service);
    assert!(succeed(data, "delete-orphans").starts_with("deleted: 1 file that"));
    assert!(!stored.exists());
}

#[test]
fn a_user_without_rights_learns_whose_folder_it_is() {
    if !rustix::process::getuid().is_root() {
        crate::resources::skip("the right to run a command as another user");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), Permissions::from_mode(0o755)).unwrap();
    let (data, backup) = (folder.path().join("data"), folder.path().join("backup"));
    drop(Process::start(&data));
    succeed(&data, &format!("backup {}", backup.display()));
    let restore = format!("restore {} --without-erasures", backup.display());
    let new = folder.path().join("new");
    let add = "user add eve --role trainee";
    let commands = [(&data, "check"), (&data, "user list"), (&data, add), (&new, restore.as_str())];
    for (data, line) in commands {
        let mut command = admin(data, line);
        command.uid(UNPRIVILEGED).gid(UNPRIVILEGED);
        let stderr = refusal(command, 1);
        assert!(stderr.contains("permission denied") && stderr.contains("sudo -u root"), "{line}: {stderr}");
    }
}

#[test]
fn a_data_folder_on_a_read_only_disk_can_be_backed_up_but_not_changed() {
    let disk = tempfile::tempdir().unwrap();
    let backups = tempfile::tempdir().unwrap();
    let Some(_mounted) = SmallDisk::mount(disk.path(), 64) else {
        crate::resources::skip("the right to mount a small file system");
        return;
    };
    let remount = |how: &str| {
        let mounted = Command::new("mount").args(["-o", &format!("remount,{how}")]).arg(disk.path()).status().unwrap();
        assert!(mounted.success());
    };
    let data = disk.path().join("data");
    drop(Process::start(&data));
    for state in ["killed", "ended"] {
        remount("ro");
        let backup = backups.path().join(state);
        succeed(&data, &format!("backup {}", backup.display()));
        assert!(succeed(&backup, "check --thorough").contains("no data is lost"));
        assert!(succeed(&backup, "user list").contains("administrator"));
        let stderr = refusal(admin(&data, "user add eve --role instructor"), 1);
        assert!(stderr.contains("is on a read-only disk"), "{stderr}");
        remount("rw");
        succeed(&data, &format!("user add {state} --role instructor")); // the last connection removes the log
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn erased_people_do_not_come_back_from_a_folder_that_the_service_used_before() {
    let folder = tempfile::tempdir().unwrap();
    let [data, first, second] = ["data", "first", "second"].map(|name| folder.path().join(name));
    for target in [&first, &second] {
        fs::create_dir(target).unwrap();
    }
    let start = |target: &Path| {
        Process::launch(&data, |command| {
            command.env("TROCAR_BACKUP__TARGET", target).env("TROCAR_UPKEEP__COLLECT_S", "1");
        })
    };
    let without = Process::start(&data);
    let password = without.password.clone().unwrap();
    let administrator = async |service: &Process| {
        Client::of(format!("http://{}", service.address)).signed_in("administrator", &password).await
    };
    administrator(&without).await.make("/api/v1/trainees", json!({"name": "Erika Weg", "code": "erika"})).await;
    drop(without);
    let service = start(&first);
    let backup = poll("a scheduled backup", async || Some(complete_backups(&first).unwrap().pop()?.1)).await;
    poll_until("the list beside the backups", || first.join("erasures").exists()).await;
    drop(service);
    let service = start(&second);
    assert!(administrator(&service).await.delete("/api/v1/trainees/erika").await.status().is_success());
    let list = second.join("erasures");
    poll_until("the erasure", || fs::read_to_string(&list).is_ok_and(|text| text.contains("trainee "))).await;
    drop(service);

    let restored = |name: &str| folder.path().join(name);
    let line = format!("restore {}", backup.display());
    let refused = run(&restored("refused"), &line);
    let stderr = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains(&format!("continued it in `{}`", list.display())), "{stderr}");
    assert!(!restored("refused").exists());
    let (_, confirm) = stderr.split_once("--erasures-until ").unwrap();
    let until = confirm.split('`').next().unwrap();
    let printed = succeed(&restored("confirmed"), &format!("{line} --erasures-until {until}"));
    assert!(printed.contains("erased again: 0") && printed.contains(&format!("known until: {until}")), "{printed}");
    let printed = succeed(&restored("named"), &format!("{line} --erasures {}", list.display()));
    assert!(printed.contains("erased again: 1 people and recordings"), "{printed}");
    assert!(printed.contains("erased again: trainee ") && printed.contains(", listed as erased at 20"), "{printed}");
    assert!(printed.contains("sudo systemctl start trocar"), "{printed}");
}
