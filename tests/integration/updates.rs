//! An update of the program: the copy of the database before it, the way back, and what commands of another version do.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Arc;

use reqwest::StatusCode;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions, Connection};
use trocar::store::{Store, StoreSettings};
use trocar::time::SystemClock;

use crate::api::full_disk::SmallDisk;
use crate::old_data::OldData;
use crate::process::{Process, command, program};
use crate::support::{Service, poll_until};

/// The schema's version in the oldest data folder.
const OLD_VERSION: i64 = 17;

/// Opens a database file as it is.
async fn raw(database: &Path) -> SqliteConnection {
    SqliteConnectOptions::new().filename(database).connect().await.unwrap()
}

async fn version(database: &Path) -> i64 {
    let mut raw = raw(database).await;
    let version = sqlx::query_scalar("SELECT max(version) FROM _sqlx_migrations").fetch_one(&mut raw).await.unwrap();
    raw.close().await.unwrap();
    version
}

/// The contents of a folder's files. SQLite's journal may come and go meanwhile.
fn bytes_of(folder: &Path) -> Vec<u8> {
    fs::read_dir(folder).unwrap().flat_map(|entry| fs::read(entry.unwrap().path()).unwrap_or_default()).collect()
}

/// The files that a copy of the database expects and the data folder lacks.
async fn lost_files(data: &Path, copy: &Path) -> Vec<String> {
    let mut old = raw(copy).await;
    let expected: Vec<String> = sqlx::query_scalar("SELECT hash FROM blob").fetch_all(&mut old).await.unwrap();
    old.close().await.unwrap();
    assert!(!expected.is_empty());
    let is_lost = |hash: &String| !data.join("blobs").join(&hash[..2]).join(hash).exists();
    expected.into_iter().filter(is_lost).collect()
}

fn holds(bytes: &[u8], text: &str) -> bool {
    bytes.windows(text.len()).any(|part| part == text.as_bytes())
}

#[tokio::test(flavor = "multi_thread")]
async fn an_update_keeps_a_copy_for_the_earlier_program_without_people_who_are_erased_later() {
    let OldData { folder, data, password, .. } = OldData::oldest();
    let copy = data.join("before-update").join("trocar.db");
    let start = async |folder| {
        let change = |settings: &mut trocar::settings::Settings| {
            settings.data = data.clone();
            settings.upkeep.collect_s = 1;
        };
        Service::start_in(folder, Arc::new(SystemClock), change).await
    };
    let service = start(folder).await;
    assert_eq!(lost_files(&data, &copy).await, Vec::<String>::new(), "after the way back");
    let made = fs::metadata(&copy).unwrap().modified().unwrap();
    assert_eq!(version(&copy).await, OLD_VERSION);
    assert!(version(&data.join("trocar.db")).await > OLD_VERSION);
    for private in [&copy, &data.join("before-update")] {
        assert_eq!(fs::metadata(private).unwrap().permissions().mode() & 0o077, 0, "{}", private.display());
    }
    assert!(holds(&bytes_of(&data.join("before-update")), "Ada Novak"));

    let administrator = service.sign_in("administrator", &password).await;
    assert_eq!(administrator.delete("/api/v1/trainees/ada").await.status(), StatusCode::NO_CONTENT);
    let is_erased = || !holds(&bytes_of(&data.join("before-update")), "Ada Novak");
    poll_until("the erasure in the copy", is_erased).await;
    let mut old = raw(&copy).await;
    let names: Vec<String> = sqlx::query_scalar("SELECT name FROM trainee").fetch_all(&mut old).await.unwrap();
    assert_eq!(names, ["Bob Örn"], "the others stay in the copy");
    old.close().await.unwrap();

    let folder = service.stop().await;
    assert_eq!(lost_files(&data, &copy).await, Vec::<String>::new(), "after the erasure");
    let service = start(folder).await; // nothing to adapt: no other copy
    let now = (version(&copy).await, fs::metadata(&copy).unwrap().modified().unwrap());
    assert_eq!(now, (OLD_VERSION, made), "it is kept no longer because a person was erased in it");
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_update_that_fails_leaves_the_database_to_the_earlier_program() {
    let OldData { folder: _folder, data, .. } = OldData::oldest();
    let database = data.join("trocar.db");
    let mut old = raw(&database).await;
    // One of the last migrations makes a table of this name; those before it succeed.
    sqlx::query("CREATE TABLE erasure (x)").execute(&mut old).await.unwrap();
    old.close().await.unwrap();
    let ended = command(&data).output().unwrap();
    let stderr = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(1), "{stderr}");
    assert!(stderr.lines().count() == 1 && stderr.contains("stays as it was"), "{stderr}");
    assert_eq!(version(&database).await, OLD_VERSION);
    let mut old = raw(&database).await;
    let tables: i64 = sqlx::query_scalar("SELECT count(*) FROM sqlite_schema WHERE name = 'job_kind'")
        .fetch_one(&mut old)
        .await
        .unwrap();
    assert_eq!(tables, 0, "the first missing migration makes this table");
    old.close().await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn an_update_without_space_for_the_copy_changes_nothing_and_works_once_there_is_some() {
    const DISK_MIB: usize = 32;
    let folder = tempfile::tempdir().unwrap();
    let Some(_disk) = SmallDisk::mount(folder.path(), DISK_MIB) else {
        crate::resources::skip("the right to mount a small file system");
        return;
    };
    let old = OldData::oldest();
    let copied = Command::new("cp").arg("-a").arg(&old.data).arg(folder.path()).status().unwrap();
    assert!(copied.success());
    let data = folder.path().join("data");
    let filler = folder.path().join("filler");
    let mut filling = fs::File::create(&filler).unwrap();
    while filling.write_all(&[1; 4096]).is_ok() {}
    filling.set_len(filling.metadata().unwrap().len().saturating_sub(1 << 20)).unwrap(); // the copy needs more
    let ended = command(&data).output().unwrap();
    let stderr = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("free some space") && stderr.contains("Nothing was changed"), "{stderr}");
    assert!(!data.join("before-update").exists());
    fs::remove_file(&filler).unwrap();
    assert_eq!(version(&data.join("trocar.db")).await, OLD_VERSION);
    drop(Process::start(&data));
    assert_eq!(version(&data.join("before-update/trocar.db")).await, OLD_VERSION);
}

/// What a person gets from a command, with its exit status.
fn run(data: &Path, line: &str) -> Output {
    program().args(["admin", "--data"]).arg(data).args(line.split(' ')).output().unwrap()
}

/// Names and contents of the files directly in a folder.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    paths.filter(|path| path.is_file()).map(|path| (path.clone(), fs::read(path).unwrap())).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn commands_refuse_a_database_of_another_version_and_change_nothing() {
    let OldData { folder, data, .. } = OldData::oldest();
    let backup = format!("backup {}", folder.path().join("backup").display());
    let commands =
        ["check", "user list", "token list", "user add eve --role instructor", "user delete ada", backup.as_str()];
    let before = files(&data);
    for (index, line) in commands.iter().enumerate() {
        let refused = run(&data, line);
        let stderr = String::from_utf8_lossy(&refused.stderr);
        assert_eq!(refused.status.code(), Some(1), "{line}: {stderr}");
        assert!(stderr.contains("older than this program") && stderr.contains("start the service once"), "{stderr}");
        if index < 3 {
            assert!(files(&data) == before, "{line} changes a file");
        }
    }
    assert_eq!(version(&data.join("trocar.db")).await, OLD_VERSION);
    assert!(!folder.path().join("backup").exists());
    fs::write(data.join("BACKUP"), "").unwrap();
    let refused = run(&data, "check");
    let stderr = String::from_utf8_lossy(&refused.stderr);
    assert!(stderr.contains("earlier version") && stderr.contains("admin restore"), "{stderr}");
    assert!(!stderr.contains("start the service"), "the service refuses a backup: {stderr}");

    let newer = tempfile::tempdir().unwrap();
    let database = newer.path().join("trocar.db");
    let store = Store::open(&database, &StoreSettings::default(), Arc::new(SystemClock)).await.unwrap();
    store.close().await;
    let mut later = raw(&database).await;
    let migration = "INSERT INTO _sqlx_migrations VALUES (9999, 'later', '2027-01-01', TRUE, x'00', 1)";
    sqlx::query(migration).execute(&mut later).await.unwrap();
    later.close().await.unwrap();
    for line in &commands[..5] {
        let refused = run(newer.path(), line);
        let stderr = String::from_utf8_lossy(&refused.stderr);
        assert_eq!(refused.status.code(), Some(1), "{line}: {stderr}");
        assert!(stderr.contains("install the newer version"), "{line}: {stderr}");
    }
}

#[test]
fn a_new_data_folder_has_no_copy() {
    let folder = tempfile::tempdir().unwrap();
    let _service = Process::start(folder.path());
    assert!(!folder.path().join("before-update").exists());
}
