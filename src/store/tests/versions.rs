//! Databases of this and of other versions, opened for reading, for a change, and for an update.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{AssertSqlSafe, ConnectOptions, Connection};

use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::store::testing::{NOW_MS, TestCentre, open};
use crate::store::{SchemaState, Store, StoreError, StoreSettings};
use crate::time::{ManualClock, SharedClock};

fn clock() -> SharedClock {
    ManualClock::at(NOW_MS)
}

async fn read(database: &Path) -> Result<Store, StoreError> {
    Store::open_read_only(database, &StoreSettings::default(), clock()).await
}

/// The closed database of a centre with a trainee.
async fn closed_centre() -> (tempfile::TempDir, PathBuf) {
    let centre = TestCentre::new().await;
    centre.trainee("Ana").await;
    centre.store.close().await;
    let database = centre.folder.path().join("trocar.sqlite");
    (centre.folder, database)
}

fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let paths = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    paths.map(|path| (path.clone(), fs::read(path).unwrap())).collect()
}

async fn change(database: &Path, statement: &'static str) {
    let mut raw: SqliteConnection = SqliteConnectOptions::new().filename(database).connect().await.unwrap();
    sqlx::query(AssertSqlSafe(statement)).execute(&mut raw).await.unwrap();
    raw.close().await.unwrap();
}

#[tokio::test]
async fn a_store_that_only_reads_sees_all_commits_and_changes_no_byte() {
    let centre = TestCentre::new().await;
    centre.trainee("Ana").await; // in the write-ahead log
    let killed = tempfile::tempdir().unwrap();
    for (path, content) in files(centre.folder.path()) {
        fs::write(killed.path().join(path.file_name().unwrap()), content).unwrap();
    }
    let (closed, _) = closed_centre().await;
    let odd = tempfile::Builder::new().prefix("a % b # c ? d").tempdir().unwrap();
    fs::copy(closed.path().join("trocar.sqlite"), odd.path().join("trocar.sqlite")).unwrap();
    for folder in [killed.path(), closed.path(), odd.path()] {
        let before = files(folder);
        let store = read(&folder.join("trocar.sqlite")).await.unwrap();
        assert_eq!(store.check().await.unwrap(), Vec::<String>::new());
        store.trainees().get(&Scope::service(), &Key::from("ana")).await.unwrap();
        let new = serde_json::from_str(r#"{"name":"Ben"}"#).unwrap();
        let refused = store.trainees().create(&Scope::service(), new).await;
        assert!(matches!(refused, Err(StoreError::Unusable(why)) if why.contains("reading only")));
        store.require_unchanged().unwrap();
        store.close().await;
        assert!(files(folder) == before, "{}", folder.display());
    }
}

#[tokio::test]
async fn a_log_without_its_index_is_refused_instead_of_being_ignored() {
    let centre = TestCentre::new().await;
    let copied = tempfile::tempdir().unwrap();
    for name in ["trocar.sqlite", "trocar.sqlite-wal"] {
        fs::copy(centre.folder.path().join(name), copied.path().join(name)).unwrap();
    }
    let refused = read(&copied.path().join("trocar.sqlite")).await;
    assert!(matches!(refused, Err(StoreError::Unusable(why)) if why.contains("start the service once")));
}

#[tokio::test]
async fn a_change_during_a_read_without_a_lock_is_noticed() {
    let (folder, database) = closed_centre().await;
    let store = read(&database).await.unwrap();
    let other = open(&folder, &ManualClock::at(NOW_MS)).await;
    for number in 0..50 {
        let new = serde_json::from_value(serde_json::json!({"name": format!("Trainee {number}")})).unwrap();
        other.trainees().create(&Scope::service(), new).await.unwrap();
    }
    let is_noticed =
        || matches!(store.require_unchanged(), Err(StoreError::Unusable(why)) if why.contains("run it again"));
    assert!(is_noticed(), "in the log");
    other.close().await;
    assert!(is_noticed(), "in the database");
}

#[tokio::test]
async fn only_the_service_opens_a_database_of_an_earlier_version() {
    let settings = StoreSettings::default();
    let (_folder, database) = closed_centre().await;
    assert_eq!(Store::found_schema(&database, &settings).await.unwrap(), SchemaState::Current);
    change(&database, "DELETE FROM _sqlx_migrations WHERE version = (SELECT max(version) FROM _sqlx_migrations)").await;
    assert_eq!(Store::found_schema(&database, &settings).await.unwrap(), SchemaState::Older);
    for opened in [read(&database).await, Store::open_existing(&database, &settings, clock()).await] {
        assert!(matches!(opened, Err(StoreError::OlderSchema)));
    }
}

#[tokio::test]
async fn no_one_opens_a_database_of_a_newer_or_of_another_program() {
    let newer = "INSERT INTO _sqlx_migrations VALUES (9999, 'later', '2027-01-01', TRUE, x'00', 1)";
    let other = "UPDATE _sqlx_migrations SET checksum = x'00' WHERE version = 1";
    for (statement, advice) in [(newer, "install the newer version"), (other, "install the program that made")] {
        let (_folder, database) = closed_centre().await;
        change(&database, statement).await;
        let settings = StoreSettings::default();
        let found_schema = Store::found_schema(&database, &settings).await.map(drop);
        let opened = [
            read(&database).await.map(drop),
            Store::open_existing(&database, &settings, clock()).await.map(drop),
            Store::open(&database, &settings, clock()).await.map(drop),
            found_schema,
        ];
        for refused in opened {
            assert!(matches!(&refused, Err(StoreError::Unusable(why)) if why.contains(advice)), "{refused:?}");
        }
    }
}

#[tokio::test]
async fn a_store_that_must_exist_is_not_created() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("trocar.sqlite");
    assert!(Store::open_existing(&database, &StoreSettings::default(), clock()).await.is_err());
    assert!(read(&database).await.is_err());
    assert_eq!(files(folder.path()).len(), 0);
}

#[tokio::test]
async fn a_missing_an_empty_and_a_database_without_tables_have_no_schema() {
    let folder = tempfile::tempdir().unwrap();
    let (database, settings) = (folder.path().join("trocar.sqlite"), StoreSettings::default());
    assert_eq!(Store::found_schema(&database, &settings).await.unwrap(), SchemaState::Empty);
    let log = folder.path().join("trocar.sqlite-wal");
    fs::write(&database, b"").unwrap();
    fs::write(&log, b"the last changes").unwrap();
    assert_eq!(Store::found_schema(&database, &settings).await.unwrap(), SchemaState::Empty);
    assert_eq!(fs::read(&log).unwrap(), b"the last changes", "SQLite would delete it");
    fs::remove_file(&log).unwrap();
    change(&database, "PRAGMA user_version = 7").await; // writes the first page
    assert!(fs::metadata(&database).unwrap().len() > 0);
    assert_eq!(Store::found_schema(&database, &settings).await.unwrap(), SchemaState::Empty);
    for opened in [read(&database).await, Store::open_existing(&database, &settings, clock()).await] {
        assert!(matches!(opened, Err(StoreError::NoSchema)));
    }
}

#[tokio::test]
async fn a_store_that_only_reads_makes_a_copy_and_changes_no_byte() {
    let (closed, database) = closed_centre().await;
    let copies = tempfile::tempdir().unwrap();
    let copy = copies.path().join("copy.sqlite");
    let before = files(closed.path());
    let store = read(&database).await.unwrap();
    store.snapshot(&copy).await.unwrap();
    store.close().await;
    assert!(files(closed.path()) == before);
    read(&copy).await.unwrap().trainees().get(&Scope::service(), &Key::from("ana")).await.unwrap();
}
