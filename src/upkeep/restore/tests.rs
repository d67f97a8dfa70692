//! Backups that are restored: nothing is lost, and erased people do not come back.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::{ErasureListChoice, Restored, restore};
use crate::domain::blob::Blob;
use crate::domain::erasure::{ErasedKind, Erasure};
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::ids::{FeedId, MergeId, SessionId, TraineeId};
use crate::shutdown::Shutdown;
use crate::store::{PageRequest, Store, StoreSettings};
use crate::time::{Clock, to_rfc3339};
use crate::upkeep::tests::UpkeepFixture;
use crate::upkeep::{
    BACKUP_MARK, BackupProgress, BackupSettings, BackupState, ERASURE_LIST, ErasureListState, ErasureLists,
    UpkeepError, back_up, complete_backups, run_backups,
};
use crate::vault::tests::{feed_pipe, make_pipe};

const DATABASE: &str = "trocar.sqlite";

/// Opens a restored folder, and returns the names of its trainees.
async fn trainees(bench: &UpkeepFixture, folder: &Path) -> Vec<String> {
    let store =
        Store::open(&folder.join(DATABASE), &StoreSettings::default(), bench.centre.clock.clone()).await.unwrap();
    let page = store.trainees().list(&Scope::service(), &PageRequest::new(100, None)).await.unwrap();
    store.close().await;
    page.items.into_iter().map(|trainee| trainee.name.to_string()).collect()
}

/// All bytes of a folder, file after file.
fn all_bytes(folder: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        bytes.extend(if path.is_dir() { all_bytes(&path) } else { fs::read(&path).unwrap() });
    }
    bytes
}

fn holds(folder: &Path, text: &str) -> bool {
    all_bytes(folder).windows(text.len()).any(|part| part == text.as_bytes())
}

struct Backups {
    bench: UpkeepFixture,
    target: tempfile::TempDir,
}

impl Backups {
    /// A centre with two trainees, a backup of it, and afterwards one of the trainees erased.
    async fn with_an_erasure_after_the_backup() -> (Self, PathBuf) {
        let bench = UpkeepFixture::new().await;
        let (ana, ben) = (bench.centre.trainee("Ana Planted").await.id, bench.centre.trainee("Ben").await.id);
        bench.centre.person("ana", Role::Trainee, Some(ana)).await;
        let gone = bench.session(ben, "a recording that is erased alone").await;
        bench.session(ana, "the planted recording").await;
        bench.session(ben, "another recording").await;
        let made = Self { target: tempfile::tempdir().unwrap(), bench };
        let backup = made.back_up("monday").await;
        let store = &made.bench.centre.store;
        store.trainees().erase(&Scope::service(), &Key::from(&ana)).await.unwrap();
        store.sessions().erase(&Scope::service(), gone.id).await.unwrap();
        (made, backup)
    }

    async fn back_up(&self, name: &str) -> PathBuf {
        let (to, clock) = (self.target.path().join(name), self.bench.centre.clock.clone());
        back_up((&self.bench.centre.store, &self.bench.vault), &to, DATABASE, clock, &Shutdown::new()).await.unwrap();
        to
    }

    /// The lists of a service that starts with this folder of backups.
    fn lists(&self, target: &Path) -> ErasureLists {
        ErasureLists::new(self.bench.centre.folder.path(), Some(target), ErasureListState::default())
    }

    async fn list_erasures(&self) {
        self.lists(self.target.path()).update(&self.bench.centre.store, self.now_ms()).await.unwrap();
    }

    fn now_ms(&self) -> i64 {
        self.bench.centre.clock.now_ms()
    }

    /// The text of the list beside the backups.
    fn list(&self) -> String {
        fs::read_to_string(self.target.path().join(ERASURE_LIST)).unwrap()
    }

    async fn restore(
        &self,
        backup: &Path,
        erasures: Option<ErasureListChoice>,
    ) -> Result<(PathBuf, Restored), UpkeepError> {
        let to = self.target.path().join(format!("restored {}", fs::read_dir(self.target.path()).unwrap().count()));
        let clock = self.bench.centre.clock.clone();
        let restored = restore(backup, &to, erasures, DATABASE, clock, &Shutdown::new()).await?;
        Ok((to, restored))
    }
}

#[tokio::test]
async fn people_who_were_erased_after_a_backup_do_not_come_back_with_it() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    backups.list_erasures().await;
    let (folder, restored) = backups.restore(&backup, Some(ErasureListChoice::default())).await.unwrap();
    // One trainee and the sessions of both.
    assert_eq!((restored.files, restored.erased_again.len(), restored.kept), (1, 3, vec![]));
    assert_eq!(trainees(&backups.bench, &folder).await, ["Ben"]);
    for planted in ["Ana Planted", "the planted recording", "a recording that is erased alone"] {
        assert!(holds(&backup, planted), "the backup itself has it");
        assert!(!holds(&folder, planted), "{planted}");
    }
    assert!(holds(&folder, "another recording"));
    // The list of the restored folder names them, too: for the next backup that is restored.
    assert_eq!(fs::read_to_string(folder.join(ERASURE_LIST)).unwrap(), backups.list());
}

/// A recording that arrived while the first backup was made, and was complete in the second.
struct ArrivedRecording {
    backups: Backups,
    feed: FeedId,
    session: SessionId,
    during: PathBuf,
}

impl ArrivedRecording {
    async fn new() -> Self {
        let bench = UpkeepFixture::new().await;
        let ana = bench.centre.trainee("Ana").await.id;
        let backups = Backups { target: tempfile::tempdir().unwrap(), bench };
        let feed = backups.bench.feed(ana, |_| {}).await;
        let session = backups.bench.centre.store.feeds().get(&Scope::service(), feed).await.unwrap().session_id;
        let during = backups.back_up("during").await;
        Self { backups, feed, session, during }
    }

    /// The recording is complete two minutes after its beginning.
    async fn complete(&self) {
        self.backups.bench.centre.clock.advance(Duration::from_secs(120));
        let video = self.backups.bench.vault.put(b"the complete recording").await.unwrap();
        self.backups.bench.centre.store.feeds().end(self.feed, video.blob(), None, None).await.unwrap();
    }

    async fn open(&self, folder: &Path) -> Store {
        let clock = self.backups.bench.centre.clock.clone();
        Store::open(&folder.join(DATABASE), &StoreSettings::default(), clock).await.unwrap()
    }

    /// Adds a line to the list beside the backups: the session was erased then.
    async fn list_as_erased(&self, at_ms: i64) {
        self.backups.list_erasures().await;
        let line = format!("session {} {}\n", self.session, to_rfc3339(at_ms));
        fs::write(self.backups.target.path().join(ERASURE_LIST), line + &self.backups.list()).unwrap();
    }
}

#[tokio::test]
async fn a_backup_during_a_recording_does_not_count_the_recording_as_erased() {
    let recording = ArrivedRecording::new().await;
    let (backups, during, session) = (&recording.backups, &recording.during, recording.session);
    recording.complete().await;
    let after = backups.back_up("after").await;
    backups.list_erasures().await;
    // The first backup is restored, and a service runs on it.
    let (folder, _) = backups.restore(during, Some(ErasureListChoice::default())).await.unwrap();
    let again = recording.open(&folder).await;
    assert_eq!(again.erasures().after(0, 9).await.unwrap(), [], "the copy erased nothing");
    let mut lists = ErasureLists::new(&folder, Some(backups.target.path()), ErasureListState::default());
    lists.update(&again, backups.now_ms()).await.unwrap();
    again.close().await;
    assert!(!backups.list().contains(&session.to_string()), "{}", backups.list());
    let (folder, restored) = backups.restore(&after, Some(ErasureListChoice::default())).await.unwrap();
    assert_eq!((restored.erased_again.len(), restored.kept), (0, vec![]));
    recording.open(&folder).await.sessions().get(&Scope::service(), session).await.unwrap();
}

#[tokio::test]
async fn a_session_that_was_completed_after_its_listed_erasure_is_kept_and_named() {
    let recording = ArrivedRecording::new().await;
    let (backups, session) = (&recording.backups, recording.session);
    let during_ms = backups.now_ms() + 60_000;
    recording.complete().await;
    let after = backups.back_up("after").await;
    // So did the backups of earlier versions, once a service had run on one of them.
    recording.list_as_erased(during_ms).await;
    let (folder, restored) = backups.restore(&after, Some(ErasureListChoice::default())).await.unwrap();
    assert_eq!(restored.erased_again, Vec::<String>::new());
    let [kept] = restored.kept.as_slice() else { panic!("{:?}", restored.kept) };
    assert!(kept.starts_with(&format!("session {session} (")) && kept.contains(&to_rfc3339(during_ms)), "{kept}");
    let again = recording.open(&folder).await;
    again.sessions().get(&Scope::service(), session).await.unwrap();
    // The service does not take the entry over, so no copy of the database loses the session either.
    ErasureLists::new(&folder, None, ErasureListState::default()).update(&again, backups.now_ms()).await.unwrap();
    assert_eq!(again.erasures().after(0, 9).await.unwrap(), []);
    again.close().await;

    // If it is really erased later, the list gets this time as well, and the session does not come back.
    let erased = Erasure { kind: ErasedKind::Session, id: session.to_string(), at_ms: backups.now_ms() + 1 };
    backups.bench.centre.store.erasures().add(vec![erased]).await.unwrap();
    backups.list_erasures().await;
    assert_eq!(backups.list().matches(&session.to_string()).count(), 2, "{}", backups.list());
    let (folder, restored) = backups.restore(&after, Some(ErasureListChoice::default())).await.unwrap();
    let [erased] = restored.erased_again.as_slice() else { panic!("{:?}", restored.erased_again) };
    assert!(
        erased.starts_with(&format!("session {session} (task ")) && erased.contains("listed as erased at"),
        "{erased}"
    );
    assert_eq!(restored.kept, Vec::<String>::new());
    let again = recording.open(&folder).await;
    assert!(again.sessions().get(&Scope::service(), session).await.is_err());
    // The restored service lists nothing again: it knows the time of each erasure.
    let before = backups.list();
    let mut lists = ErasureLists::new(&folder, Some(backups.target.path()), ErasureListState::default());
    lists.update(&again, backups.now_ms()).await.unwrap();
    let erasures = |list: &str| list.lines().filter(|line| !line.starts_with("complete ")).count();
    assert_eq!(erasures(&backups.list()), erasures(&before), "{}", backups.list());
}

#[tokio::test]
async fn a_session_that_was_erased_after_its_recording_is_erased_again() {
    let recording = ArrivedRecording::new().await;
    recording.complete().await;
    let after = recording.backups.back_up("after").await;
    recording.list_as_erased(recording.backups.now_ms()).await; // at the moment when it was complete
    let (_, restored) = recording.backups.restore(&after, Some(ErasureListChoice::default())).await.unwrap();
    assert_eq!((restored.erased_again.len(), restored.kept), (1, vec![]));
}

#[tokio::test]
async fn a_restore_leaves_the_backup_alone_and_hides_the_data_from_other_users() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    fs::remove_dir(backup.join("incoming")).unwrap(); // an empty folder, which some copying programs leave out
    fs::set_permissions(backup.join(DATABASE), fs::Permissions::from_mode(0o644)).unwrap();
    let (folder, _) = backups.restore(&backup, None).await.unwrap();
    assert_eq!(fs::metadata(folder.join(DATABASE)).unwrap().permissions().mode() & 0o777, 0o600);
    assert!(!backup.join("incoming").exists());
}

#[tokio::test]
async fn a_restore_that_was_interrupted_leaves_no_data_folder() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    backups.list_erasures().await;
    let to = backups.target.path().join("restored");
    let (clock, stop) = (backups.bench.centre.clock.clone(), Shutdown::new());
    stop.begin();
    let stopped = restore(&backup, &to, Some(ErasureListChoice::default()), DATABASE, clock.clone(), &stop).await;
    assert!(matches!(stopped, Err(UpkeepError::Interrupted)), "{stopped:?}");
    assert!(!to.exists());

    // After a kill the service does not run on it, and the next restore replaces it. So it was with earlier versions.
    fs::create_dir(&to).unwrap();
    let mark = "This folder is being restored. If that was interrupted, delete it and restore again.\n";
    fs::write(to.join(BACKUP_MARK), mark).unwrap();
    fs::write(to.join(DATABASE), "half, with people to erase").unwrap();
    let unfinished = backups.restore(&to, Some(ErasureListChoice::default())).await.unwrap_err();
    assert!(matches!(unfinished, UpkeepError::UnfinishedBackup(_)), "{unfinished}");
    let restored =
        restore(&backup, &to, Some(ErasureListChoice::default()), DATABASE, clock, &Shutdown::new()).await.unwrap();
    assert_eq!((restored.erased_again.len(), restored.missing), (3, vec![]));
    assert!(!to.join(BACKUP_MARK).exists());
    assert_eq!(trainees(&backups.bench, &to).await, ["Ben"]);
}

#[tokio::test]
async fn a_restore_that_ends_within_a_file_leaves_no_data_folder() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    let (to, pipe) = (backups.target.path().join("restored"), backup.join(Blob::of(b"another recording").hash.file()));
    fs::remove_file(&pipe).unwrap();
    make_pipe(&pipe);
    let (clock, stop) = (backups.bench.centre.clock.clone(), Shutdown::new());
    let (begun, marked) = (stop.clone(), to.clone());
    let writing = std::thread::spawn(move || {
        let mut mark = String::new();
        feed_pipe(&pipe, || {
            assert!(marked.join(DATABASE).exists());
            mark = fs::read_to_string(marked.join(BACKUP_MARK)).unwrap_or_default();
            begun.begin();
        });
        mark
    });
    let stopped = restore(&backup, &to, None, DATABASE, clock, &stop).await;
    assert!(matches!(stopped, Err(UpkeepError::Interrupted)), "{stopped:?}");
    assert!(!to.exists());
    let mark = writing.join().unwrap();
    assert!(mark.contains("not finished"), "{mark}");
}

#[tokio::test]
async fn a_backup_without_a_readable_file_is_not_restored() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    let files = ["a recording that is erased alone", "the planted recording", "another recording"]
        .map(|content| backup.join(Blob::of(content.as_bytes()).hash.file()));
    for file in &files {
        fs::remove_file(file).unwrap();
        fs::create_dir(file).unwrap(); // as on a disk that fails: the file cannot be read
    }
    let refused = backups.restore(&backup, None).await.unwrap_err();
    assert!(matches!(&refused, UpkeepError::Unreadable { path, .. } if *path == backup), "{refused}");
    assert!(refused.to_string().contains("none of its 3 files could be read"), "{refused}");
    assert_eq!(fs::read_dir(backups.target.path()).unwrap().count(), 1, "nothing is left");
    fs::remove_dir(&files[0]).unwrap();
    fs::write(&files[0], "a recording that is erased alone").unwrap();
    assert_eq!(backups.restore(&backup, None).await.unwrap().1.missing.len(), 2, "one file is enough");
}

#[tokio::test]
async fn a_backup_that_lacks_files_is_restored_and_they_are_named() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    let service = Scope::service();
    let ben = backups.bench.centre.store.trainees().get(&service, &Key::from("ben")).await.unwrap().id;
    let (lost, kept) = (backups.bench.session(ben, "lost before").await, backups.bench.session(ben, "damaged").await);
    fs::remove_file(backups.bench.path_of(lost.video.unwrap())).unwrap();
    let later = backups.back_up("tuesday").await;
    fs::write(later.join(kept.video.unwrap().file()), "dbmaged").unwrap(); // on the disk of the backups
    let (folder, restored) = backups.restore(&later, None).await.unwrap();
    assert!(!folder.join(BACKUP_MARK).exists(), "the service can run on it");
    assert!(holds(&folder, "another recording") && !holds(&folder, "dbmaged"));
    let mut named: Vec<String> = restored.missing.iter().map(ToString::to_string).collect();
    named.sort();
    let expected = [
        format!("damaged file {}: recording of session {}", kept.video.unwrap().file(), kept.id),
        format!("missing file {}: recording of session {}", lost.video.unwrap().file(), lost.id),
    ];
    assert!(
        named.len() == 2 && named.iter().zip(&expected).all(|(one, beginning)| one.starts_with(beginning)),
        "{named:?}"
    );
    assert_eq!(backups.restore(&backup, None).await.unwrap().1.missing, [], "the earlier one lacks none");
}

#[tokio::test]
async fn people_whose_erasure_was_requested_after_a_backup_wait_for_it_again() {
    let bench = UpkeepFixture::new().await;
    let (ana, ben) = (bench.centre.trainee("Ana").await.id, bench.centre.trainee("Ben").await.id);
    let backups = Backups { target: tempfile::tempdir().unwrap(), bench };
    let before = backups.back_up("monday").await;
    let (store, service) = (&backups.bench.centre.store, Scope::service());
    let week = Duration::from_secs(7 * 86_400);
    for trainee in [ana, ben] {
        store.pending_erasures().request(&service, &Key::from(&trainee), week).await.unwrap();
    }
    let between = backups.back_up("tuesday").await;
    store.pending_erasures().take_back(&service, &Key::from(&ben)).await.unwrap();
    backups.list_erasures().await;
    let due = store.pending_erasures().list(&service).await.unwrap();
    assert_eq!(due.iter().map(|one| one.trainee_id).collect::<Vec<_>>(), [ana]);
    for backup in [before, between] {
        let (folder, restored) = backups.restore(&backup, Some(ErasureListChoice::default())).await.unwrap();
        assert_eq!((restored.erased_again.len(), restored.kept), (0, vec![]));
        let clock = backups.bench.centre.clock.clone();
        let again = Store::open(&folder.join(DATABASE), &StoreSettings::default(), clock).await.unwrap();
        let waiting = again.pending_erasures().list(&service).await.unwrap();
        assert_eq!(
            waiting.iter().map(|one| (one.trainee_id, one.due_at_ms)).collect::<Vec<_>>(),
            [(ana, due[0].due_at_ms)]
        );
        again.close().await;
    }
    // A second update of the lists adds nothing.
    let list = backups.list();
    backups.list_erasures().await;
    assert_eq!(backups.list(), list);
}

#[tokio::test]
async fn a_request_that_cannot_be_repeated_is_named_and_the_others_are_repeated() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    let backups = Backups { target: tempfile::tempdir().unwrap(), bench };
    let backup = backups.back_up("monday").await;
    let (store, week) = (&backups.bench.centre.store, Duration::from_secs(7 * 86_400));
    store.pending_erasures().request(&Scope::service(), &Key::from(&ana), week).await.unwrap();
    backups.list_erasures().await;
    let damaged = format!("pending ana 2026-11-21T20:14:00Z\n{}", backups.list());
    fs::write(backups.target.path().join(ERASURE_LIST), damaged).unwrap();
    let (folder, restored) = backups.restore(&backup, Some(ErasureListChoice::default())).await.unwrap();
    assert_eq!(restored.kept, ["pending ana: `ana` in the list of erasures is not an id"]);
    let clock = backups.bench.centre.clock.clone();
    let again = Store::open(&folder.join(DATABASE), &StoreSettings::default(), clock).await.unwrap();
    let waiting = again.pending_erasures().list(&Scope::service()).await.unwrap();
    assert_eq!(waiting.into_iter().map(|one| one.trainee_id).collect::<Vec<_>>(), [ana]);
}

#[tokio::test]
async fn a_backup_whose_database_is_empty_is_refused() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    fs::write(backup.join(DATABASE), b"").unwrap();
    let refused = backups.restore(&backup, None).await.unwrap_err();
    assert!(matches!(&refused, UpkeepError::NoBackup(_)), "{refused}");
}

#[tokio::test]
async fn without_a_list_of_erasures_nothing_is_restored_unless_told_so() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    let refused = backups.restore(&backup, Some(ErasureListChoice::default())).await.unwrap_err();
    assert!(matches!(&refused, UpkeepError::NoList(_)), "{refused}");
    assert!(refused.to_string().contains("--without-erasures"), "{refused}");
    assert_eq!(fs::read_dir(backups.target.path()).unwrap().count(), 1, "nothing was made");
    let (folder, restored) = backups.restore(&backup, None).await.unwrap();
    assert_eq!((restored.files, restored.erased_again.len()), (3, 0));
    assert_eq!(trainees(&backups.bench, &folder).await, ["Ana Planted", "Ben"]);
}

#[tokio::test]
async fn a_list_of_erasures_is_only_appended_to_and_survives_a_power_cut() {
    const MARK_BYTES: usize = 67;
    let (backups, _) = Backups::with_an_erasure_after_the_backup().await;
    backups.list_erasures().await;
    let before = backups.list();
    assert!(before.lines().any(|line| line.starts_with("trainee ")), "{before}");
    assert!(before.lines().any(|line| line.starts_with("person ")), "the account of the trainee: {before}");
    backups.list_erasures().await; // as after a restart
    assert_eq!(backups.list(), before);
    // A power cut leaves a part of a line.
    for lost in [10, MARK_BYTES + 10] {
        fs::write(backups.target.path().join(ERASURE_LIST), &before[..before.len() - lost]).unwrap();
        backups.list_erasures().await;
        assert_eq!(backups.list(), before);
    }
}

#[tokio::test]
async fn a_damaged_list_is_written_anew_if_the_database_has_all_its_erasures() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    backups.list_erasures().await;
    let (before, store) = (backups.list(), &backups.bench.centre.store);
    let mut lines: Vec<&str> = before.lines().collect();
    lines[1] = "\u{1}garbage";
    let (damaged, path) = (lines.join("\n") + "\n", backups.target.path().join(ERASURE_LIST));
    fs::write(&path, &damaged).unwrap();
    let refused = backups.restore(&backup, Some(ErasureListChoice::default())).await.unwrap_err();
    assert!(refused.to_string().contains("line 2 is damaged"), "{refused}");
    backups.list_erasures().await;
    assert_eq!(backups.list(), before);
    let names = fs::read_dir(backups.target.path()).unwrap().map(|entry| entry.unwrap());
    let aside: Vec<_> =
        names.filter(|entry| entry.file_name().to_str().unwrap().starts_with("erasures.damaged-")).collect();
    assert_eq!(aside.len(), 1);
    assert_eq!(fs::read_to_string(aside[0].path()).unwrap(), damaged);

    // An erasure that only the list has: the damaged line may have been another one.
    let foreign = "trainee 0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44 2026-11-21T20:14:00Z\n";
    fs::write(&path, format!("{foreign}garbage\n{before}")).unwrap();
    let state = ErasureListState::default();
    let folder = backups.bench.centre.folder.path();
    let mut lists = ErasureLists::new(folder, Some(backups.target.path()), state.clone());
    lists.keep(store, backups.now_ms()).await;
    let error = state.error().unwrap();
    assert!(error.contains("line 2 is damaged") && error.contains(path.to_str().unwrap()), "{error}");
    assert_eq!(backups.list(), format!("{foreign}garbage\n{before}"), "it stays as it is");
    fs::write(&path, format!("{foreign}{before}")).unwrap(); // corrected by hand
    lists.keep(store, backups.now_ms()).await;
    assert_eq!(state.error(), None);
}

#[tokio::test]
async fn a_list_says_until_when_it_is_complete_without_an_erasure_and_a_deleted_one_is_whole_again() {
    let (backups, _) = Backups::with_an_erasure_after_the_backup().await;
    let (store, clock) = (&backups.bench.centre.store, backups.bench.centre.clock.clone());
    let mut lists = backups.lists(backups.target.path());
    lists.update(store, clock.now_ms()).await.unwrap();
    let first = backups.list();
    for _ in 0..3 {
        clock.advance(Duration::from_secs(3600));
        lists.update(store, clock.now_ms()).await.unwrap();
    }
    assert_eq!(backups.list(), first, "the list does not grow each hour");
    clock.advance(Duration::from_secs(3 * 3600));
    lists.update(store, clock.now_ms()).await.unwrap();
    let marked = backups.list();
    let last = marked.lines().last().unwrap();
    assert!(last.starts_with("complete ") && last.ends_with(&to_rfc3339(clock.now_ms())), "{last}");
    fs::remove_file(backups.target.path().join(ERASURE_LIST)).unwrap();
    lists.update(store, clock.now_ms()).await.unwrap();
    let erasures = |text: &str| text.lines().filter(|line| !line.starts_with("complete ")).count();
    assert_eq!(erasures(&backups.list()), erasures(&first), "{}", backups.list());
}

#[tokio::test]
async fn an_old_list_is_used_only_if_its_time_is_accepted() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    backups.list_erasures().await;
    let until_ms = backups.now_ms();
    backups.bench.centre.clock.advance(Duration::from_secs(86_400));
    let (_, restored) = backups.restore(&backup, Some(ErasureListChoice::default())).await.unwrap();
    assert_eq!(restored.known_until_ms, Some(until_ms), "a day is too short for a question");
    backups.bench.centre.clock.advance(Duration::from_secs(1));
    let refused = backups.restore(&backup, Some(ErasureListChoice::default())).await.unwrap_err();
    let accept = format!("--erasures-until {}", to_rfc3339(until_ms));
    assert!(matches!(&refused, UpkeepError::ShortList { .. }) && refused.to_string().contains(&accept), "{refused}");
    let accepted = |until_ms| Some(ErasureListChoice { file: None, until_ms: Some(until_ms) });
    backups.restore(&backup, accepted(until_ms + 1)).await.unwrap_err();
    let (_, restored) = backups.restore(&backup, accepted(until_ms)).await.unwrap();
    assert_eq!((restored.erased_again.len(), restored.known_until_ms), (3, Some(until_ms)));
    // A list of an earlier version has no marks: its last erasure is the last that is known.
    let earlier: String = backups
        .list()
        .lines()
        .filter(|line| !line.starts_with("complete "))
        .fold(String::new(), |text, line| text + line + "\n");
    let last = earlier.lines().last().unwrap().rsplit(' ').next().unwrap().to_owned();
    fs::write(backups.target.path().join(ERASURE_LIST), &earlier).unwrap();
    let (_, restored) = backups.restore(&backup, accepted(crate::time::from_rfc3339(&last).unwrap())).await.unwrap();
    assert_eq!(restored.erased_again.len(), 3);
}

#[tokio::test]
async fn a_list_ends_when_the_service_has_another_folder_for_backups() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    let (backups, next) = (Backups { target: tempfile::tempdir().unwrap(), bench }, tempfile::tempdir().unwrap());
    let backup = backups.back_up("monday").await;
    backups.list_erasures().await;
    let store = &backups.bench.centre.store;
    let mut lists = backups.lists(next.path());
    lists.update(store, backups.now_ms()).await.unwrap();
    store.trainees().erase(&Scope::service(), &Key::from(&ana)).await.unwrap();
    lists.update(store, backups.now_ms()).await.unwrap();
    assert!(backups.list().lines().last().unwrap().starts_with("ended "), "{}", backups.list());
    let refused = backups.restore(&backup, Some(ErasureListChoice::default())).await.unwrap_err().to_string();
    let newer = next.path().join(ERASURE_LIST);
    assert!(refused.contains(&format!("continued it in `{}`", newer.display())), "{refused}");
    let accepted = ErasureListChoice { until_ms: Some(backups.now_ms()), ..ErasureListChoice::default() };
    let (folder, _) = backups.restore(&backup, Some(accepted)).await.unwrap();
    assert_eq!(trainees(&backups.bench, &folder).await, ["Ana"]);
    let named = ErasureListChoice { file: Some(newer), ..ErasureListChoice::default() };
    let (folder, restored) = backups.restore(&backup, Some(named)).await.unwrap();
    assert_eq!((trainees(&backups.bench, &folder).await, restored.erased_again.len()), (Vec::new(), 1));
    // The service has the first folder again: its list is complete again.
    backups.list_erasures().await;
    let (_, restored) = backups.restore(&backup, Some(ErasureListChoice::default())).await.unwrap();
    assert_eq!(restored.erased_again.len(), 1);
}

#[tokio::test]
async fn the_list_of_another_installation_is_refused() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    let (other, elsewhere) = (UpkeepFixture::new().await, tempfile::tempdir().unwrap());
    let mut lists = ErasureLists::new(other.centre.folder.path(), Some(elsewhere.path()), ErasureListState::default());
    lists.update(&other.centre.store, backups.now_ms()).await.unwrap();
    let file = Some(elsewhere.path().join(ERASURE_LIST));
    let refused = backups.restore(&backup, Some(ErasureListChoice { file, until_ms: None })).await.unwrap_err();
    assert!(matches!(&refused, UpkeepError::ForeignList(_)), "{refused}");
}

#[tokio::test]
async fn erasures_that_only_the_list_of_the_data_folder_has_reach_the_database_and_the_other_list() {
    let (backups, _) = Backups::with_an_erasure_after_the_backup().await;
    // An earlier version restored the folder: only the list has this erasure.
    let erased = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";
    let line = format!("trainee {erased} 2026-11-21T20:14:00Z");
    fs::write(backups.bench.centre.folder.path().join(ERASURE_LIST), format!("{line}\n")).unwrap();
    backups.list_erasures().await;
    assert!(backups.list().lines().any(|listed| listed == line), "{}", backups.list());
    backups.list_erasures().await; // as after a restart
    let recorded = backups.bench.centre.store.erasures().after(0, 100).await.unwrap();
    assert_eq!(recorded.iter().filter(|(_, erasure)| erasure.id == erased).count(), 1);
}

#[tokio::test]
async fn a_restored_database_has_the_erasures_of_people_who_were_not_in_the_backup() {
    let bench = UpkeepFixture::new().await;
    let backups = Backups { target: tempfile::tempdir().unwrap(), bench };
    let backup = backups.back_up("monday").await;
    let store = &backups.bench.centre.store;
    let ben = backups.bench.centre.trainee("Ben").await.id; // perhaps in a later backup
    store.trainees().erase(&Scope::service(), &Key::from(&ben)).await.unwrap();
    backups.list_erasures().await;
    let (folder, restored) = backups.restore(&backup, Some(ErasureListChoice::default())).await.unwrap();
    assert_eq!(restored.erased_again.len(), 0);
    fs::remove_file(folder.join(ERASURE_LIST)).unwrap();
    let clock = backups.bench.centre.clock.clone();
    let again = Store::open(&folder.join(DATABASE), &StoreSettings::default(), clock).await.unwrap();
    assert_eq!(again.installation().id().await.unwrap(), store.installation().id().await.unwrap());
    let mut lists = ErasureLists::new(&folder, None, ErasureListState::default());
    lists.update(&again, backups.now_ms()).await.unwrap();
    again.close().await;
    let list = fs::read_to_string(folder.join(ERASURE_LIST)).unwrap();
    assert!(list.contains(&format!("trainee {ben} ")), "{list}");
}

/// Makes the scheduled backups of a centre for some days.
async fn back_up_daily(bench: &UpkeepFixture, settings: &BackupSettings, days: usize) -> BackupState {
    let (state, shutdown, clock) = (BackupState::default(), Shutdown::new(), bench.centre.clock.clone());
    let until = (clock.clone() as _, &shutdown);
    let running = run_backups((&bench.centre.store, &bench.vault), settings, DATABASE, until, &state);
    let watch = async {
        let mut newest = None;
        for day in 0..days {
            if day > 0 {
                clock.advance(Duration::from_secs(86_400));
            }
            while state.now().newest_ms == newest {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
            newest = state.now().newest_ms;
        }
        shutdown.begin();
    };
    tokio::join!(running, watch);
    state
}

#[tokio::test]
async fn a_backup_is_made_each_day_and_the_last_ones_are_kept() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    bench.session(ana, "video").await;
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("partial-of-an-interrupted-one")).unwrap();
    fs::write(folder.path().join("a file of somebody"), b"stays").unwrap();
    let settings = BackupSettings { target: Some(folder.path().to_owned()), keep: 2, ..BackupSettings::default() };
    back_up_daily(&bench, &settings, 4).await;
    let kept = complete_backups(folder.path()).unwrap();
    assert_eq!(kept.len(), 2);
    assert!(kept.windows(2).all(|pair| pair[1].0 - pair[0].0 == 86_400_000), "{kept:?}");
    assert!(folder.path().join("a file of somebody").exists());
    assert!(!folder.path().join("partial-of-an-interrupted-one").exists());
}

#[tokio::test]
async fn an_empty_service_with_the_same_folder_leaves_the_backups_of_the_real_one_alone() {
    let (real, empty) = (UpkeepFixture::new().await, UpkeepFixture::new().await);
    let folder = tempfile::tempdir().unwrap();
    let settings = BackupSettings { target: Some(folder.path().to_owned()), keep: 2, ..BackupSettings::default() };
    assert_eq!(back_up_daily(&real, &settings, 2).await.now().others, 0);
    let mut backups: Vec<PathBuf> =
        complete_backups(folder.path()).unwrap().into_iter().map(|(_, path)| path).collect();
    let without_id = folder.path().join("trocar-2026-11-01T02-30-00Z"); // of an earlier version
    fs::create_dir(&without_id).unwrap();
    fs::write(without_id.join(BACKUP_MARK), "This folder is a backup.\n").unwrap();
    let partial = folder.path().join("partial-of-the-real-one");
    fs::create_dir(&partial).unwrap();
    fs::copy(backups[0].join(BACKUP_MARK), partial.join(BACKUP_MARK)).unwrap();
    backups.extend([without_id, partial]);
    empty.centre.clock.advance(Duration::from_secs(3 * 86_400));
    let began_ms = empty.centre.clock.now_ms();
    let state = back_up_daily(&empty, &settings, 4).await;
    assert_eq!(backups.iter().filter(|path| !path.exists()).count(), 0);
    assert_eq!(complete_backups(folder.path()).unwrap().len(), 2 + 1 + 2, "it keeps two of its own");
    assert_eq!((state.now().others, state.now().newest_ms), (3, Some(began_ms + 3 * 86_400_000)));
}

#[tokio::test]
async fn backups_that_lack_files_count_but_never_displace_the_last_complete_one() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    bench.session(ana, "a video").await;
    let lost = bench.session(ana, "a lost video").await;
    let folder = tempfile::tempdir().unwrap();
    let settings = BackupSettings { target: Some(folder.path().to_owned()), keep: 1, ..BackupSettings::default() };
    let (state, shutdown, clock) = (BackupState::default(), Shutdown::new(), bench.centre.clock.clone());
    let data = (&bench.centre.store, &bench.vault);
    let running = run_backups(data, &settings, DATABASE, (clock.clone(), &shutdown), &state);
    let watch = async {
        let mut newest = None;
        for missing in [0, 1, 1] {
            while state.now().newest_ms == newest {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
            let progress = state.now();
            assert_eq!((progress.missing.len(), &progress.error), (missing, &None));
            assert!(progress.missing.iter().all(|file| file.contains(&lost.id.to_string())), "{progress:?}");
            assert!(!progress.missing.iter().any(|file| file.contains("trainee")), "{progress:?}");
            newest = progress.newest_ms;
            if missing == 0 {
                fs::remove_file(bench.path_of(lost.video.unwrap())).unwrap();
            }
            clock.advance(Duration::from_secs(86_400));
        }
        shutdown.begin();
    };
    tokio::join!(running, watch);
    let kept = complete_backups(folder.path()).unwrap();
    assert!(holds(&kept[0].1, "a lost video"), "the last complete one stays: {kept:?}");
    assert!(kept.len() <= 3 && kept[1..].iter().all(|(_, path)| !holds(path, "a lost video")), "{kept:?}");

    // After a restart the state says what the newest one lacks.
    let (state, shutdown) = (BackupState::default(), Shutdown::new());
    let (target, at) = (settings.target.clone(), settings.at);
    let settings = BackupSettings { target, at, keep: 9 };
    let running = run_backups(data, &settings, DATABASE, (clock.clone(), &shutdown), &state);
    let watch = async {
        while state.now().newest_ms.is_none() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        assert_eq!(state.now().missing.len(), 1);
        shutdown.begin();
    };
    tokio::join!(running, watch);
}

#[tokio::test]
async fn a_stop_during_a_scheduled_backup_ends_it_at_once_without_a_failure() {
    let bench = UpkeepFixture::new().await;
    let video = bench.session(bench.centre.trainee("Ana").await.id, "video").await.video.unwrap();
    let pipe = bench.path_of(video);
    fs::remove_file(&pipe).unwrap();
    make_pipe(&pipe);
    let folder = tempfile::tempdir().unwrap();
    let settings = BackupSettings { target: Some(folder.path().to_owned()), ..BackupSettings::default() };
    let (state, shutdown) = (BackupState::default(), Shutdown::new());
    let begun = shutdown.clone();
    let writing = std::thread::spawn(move || feed_pipe(&pipe, || begun.begin()));
    let until = (bench.centre.clock.clone() as _, &shutdown);
    run_backups((&bench.centre.store, &bench.vault), &settings, DATABASE, until, &state).await;
    writing.join().unwrap();
    assert_eq!(state.now(), BackupProgress::default());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[tokio::test]
async fn a_folder_that_cannot_be_used_is_reported_and_stops_nothing() {
    let bench = UpkeepFixture::new().await;
    let gone = tempfile::tempdir().unwrap().path().join("gone");
    let settings = BackupSettings { target: Some(gone.clone()), ..BackupSettings::default() };
    let (state, shutdown) = (BackupState::default(), Shutdown::new());
    let until = (bench.centre.clock.clone() as _, &shutdown);
    let running = run_backups((&bench.centre.store, &bench.vault), &settings, DATABASE, until, &state);
    let watch = async {
        while state.now().error.is_none() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        shutdown.begin();
    };
    tokio::join!(running, watch);
    assert!(state.now().error.unwrap().contains(&gone.display().to_string()));
}

#[tokio::test]
async fn a_failure_is_forgotten_once_the_folder_can_be_used_again() {
    let bench = UpkeepFixture::new().await;
    let parent = tempfile::tempdir().unwrap();
    let (folder, away) = (parent.path().join("backups"), parent.path().join("away"));
    fs::create_dir(&folder).unwrap();
    let settings = BackupSettings { target: Some(folder.clone()), ..BackupSettings::default() };
    back_up_daily(&bench, &settings, 1).await;
    fs::rename(&folder, &away).unwrap();
    let (state, shutdown, clock) = (BackupState::default(), Shutdown::new(), bench.centre.clock.clone());
    let until = (clock.clone() as _, &shutdown);
    let running = run_backups((&bench.centre.store, &bench.vault), &settings, DATABASE, until, &state);
    let watch = async {
        while state.now().error.is_none() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        fs::rename(&away, &folder).unwrap();
        clock.advance(Duration::from_secs(3600));
        let forgotten = async {
            while state.now().error.is_some() {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        tokio::time::timeout(Duration::from_secs(10), forgotten).await.unwrap();
        shutdown.begin();
    };
    tokio::join!(running, watch);
    assert_eq!(complete_backups(&folder).unwrap().len(), 1, "no other backup was due");
}

#[tokio::test]
async fn an_unfinished_backup_whose_mark_cannot_be_read_is_not_deleted() {
    let bench = UpkeepFixture::new().await;
    let folder = tempfile::tempdir().unwrap();
    let partial = folder.path().join("partial-2026-11-28T02-30-00Z");
    fs::create_dir_all(partial.join(BACKUP_MARK)).unwrap(); // cannot be read as a file
    let settings = BackupSettings { target: Some(folder.path().to_owned()), ..BackupSettings::default() };
    let (state, shutdown) = (BackupState::default(), Shutdown::new());
    let until = (bench.centre.clock.clone() as _, &shutdown);
    let running = run_backups((&bench.centre.store, &bench.vault), &settings, DATABASE, until, &state);
    let watch = async {
        while state.now() == BackupProgress::default() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        shutdown.begin();
    };
    tokio::join!(running, watch);
    assert!(partial.exists());
    assert!(state.now().error.unwrap().contains(partial.to_str().unwrap()));
}

/// A chain of records of one person: that of Ana was merged into that of Ben, which was merged into that of Cleo. Each has a
/// session.
struct Chain {
    backups: Backups,
    backup: PathBuf,
    people: [TraineeId; 3],
    sessions: [SessionId; 3],
    merges: [MergeId; 2],
}

impl Chain {
    async fn in_a_backup() -> Self {
        let bench = UpkeepFixture::new().await;
        let (mut people, mut sessions) = (Vec::new(), Vec::new());
        for name in ["Ana", "Ben", "Cleo"] {
            let trainee = bench.centre.trainee(name).await.id;
            sessions.push(bench.session(trainee, &format!("the recording of {name}")).await.id);
            people.push(trainee);
        }
        let people: [TraineeId; 3] = people.try_into().unwrap();
        let mut merges = Vec::new();
        for pair in [[people[1], people[0]], [people[2], people[1]]] {
            let why = "One person.".parse().unwrap();
            let merged = bench.centre.store.record_merges().merge_trainees(&Scope::service(), pair, why, (0, 0)).await;
            merges.push(merged.unwrap().id);
        }
        let (sessions, merges) = (sessions.try_into().unwrap(), merges.try_into().unwrap());
        let backups = Backups { target: tempfile::tempdir().unwrap(), bench };
        let backup = backups.back_up("monday").await;
        Self { backups, backup, people, sessions, merges }
    }

    fn store(&self) -> &Store {
        &self.backups.bench.centre.store
    }

    /// Separates all records again, after the backup.
    async fn separate(&self) {
        for (kept, merge) in [(self.people[2], self.merges[1]), (self.people[1], self.merges[0])] {
            let why = "Three people.".parse().unwrap();
            self.store().record_merges().separate_trainees(&Scope::service(), kept, merge, why).await.unwrap();
        }
    }

    async fn restored(&self) -> Store {
        self.backups.list_erasures().await;
        let (folder, _) = self.backups.restore(&self.backup, Some(ErasureListChoice::default())).await.unwrap();
        let clock = self.backups.bench.centre.clock.clone();
        Store::open(&folder.join(DATABASE), &StoreSettings::default(), clock).await.unwrap()
    }

    /// Whose each of the three sessions is; `None`: erased.
    async fn owners(&self, store: &Store) -> [Option<TraineeId>; 3] {
        let mut owners = [None; 3];
        for (owner, session) in owners.iter_mut().zip(self.sessions) {
            *owner = store.sessions().get(&Scope::service(), session).await.ok().map(|session| session.trainee_id);
        }
        owners
    }

    /// The people who wait for their erasure.
    async fn waiting(&self, store: &Store) -> Vec<TraineeId> {
        let listed = store.pending_erasures().list(&Scope::service()).await.unwrap();
        listed.into_iter().map(|pending| pending.trainee_id).collect()
    }
}

#[tokio::test]
async fn of_merged_records_a_restore_erases_exactly_those_that_were_erased() {
    for erased in 0..3 {
        let chain = Chain::in_a_backup().await;
        chain.separate().await;
        let key = Key::from(&chain.people[erased]);
        chain.store().trainees().erase(&Scope::service(), &key).await.unwrap();
        let store = chain.restored().await;
        let [ana, ben, cleo] = chain.people;
        // In the backup, Cleo's record has all; what is left of the chain stays merged.
        let expected = match erased {
            0 => [None, Some(cleo), Some(cleo)],
            1 => [Some(ana), None, Some(cleo)],
            _ => [Some(ben), Some(ben), None],
        };
        assert_eq!(chain.owners(&store).await, expected, "the record {erased} was erased");
    }
    let chain = Chain::in_a_backup().await;
    chain.store().trainees().erase(&Scope::service(), &Key::from(&chain.people[2])).await.unwrap();
    let store = chain.restored().await;
    assert_eq!(chain.owners(&store).await, [None; 3], "they were erased as one person");
}

#[tokio::test]
async fn of_merged_records_exactly_those_wait_again_whose_erasure_was_requested() {
    let week = Duration::from_secs(7 * 86_400);
    let chain = Chain::in_a_backup().await;
    let cleo = Key::from(&chain.people[2]);
    chain.store().pending_erasures().request(&Scope::service(), &cleo, week).await.unwrap();
    let store = chain.restored().await;
    assert_eq!(chain.waiting(&store).await, [chain.people[2]], "the merged records wait with the one that is shown");
    store.pending_erasures().take_back(&Scope::service(), &cleo).await.unwrap();
    assert_eq!(chain.waiting(&store).await, []);
    assert_eq!(chain.owners(&store).await, [Some(chain.people[2]); 3]);

    for requested in 0..3 {
        let chain = Chain::in_a_backup().await;
        chain.separate().await;
        let key = Key::from(&chain.people[requested]);
        chain.store().pending_erasures().request(&Scope::service(), &key, week).await.unwrap();
        let store = chain.restored().await;
        assert_eq!(chain.waiting(&store).await, [chain.people[requested]]);
        let owners = chain.owners(&store).await;
        let own = chain.people[requested];
        for (number, owner) in owners.iter().enumerate() {
            assert_eq!(*owner == Some(own), number == requested, "{requested}: {owners:?} of {:?}", chain.people);
        }
        chain.backups.bench.centre.clock.advance(week);
        store.pending_erasures().erase_due(own).await.unwrap();
        let left = chain.owners(&store).await;
        assert!((0..3).all(|number| left[number].is_none() == (number == requested)), "{left:?}");
    }
}
