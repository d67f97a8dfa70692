//! Backups that are restored: nothing is lost, and erased people do not come back.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::{Restored, restore};
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::shutdown::Shutdown;
use crate::store::{PageRequest, Store, StoreSettings};
use crate::upkeep::tests::UpkeepFixture;
use crate::upkeep::{
    BACKUP_MARK, BackupProgress, BackupSettings, BackupState, ERASURE_LIST, ErasureLists, UpkeepError, back_up,
    complete_backups, run_backups,
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

    async fn list_erasures(&self) {
        let mut lists = ErasureLists::new(self.bench.centre.folder.path(), Some(self.target.path()));
        lists.update(&self.bench.centre.store).await.unwrap();
    }

    async fn restore(
        &self,
        backup: &Path,
        erasures: Option<Option<PathBuf>>,
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
    let (folder, restored) = backups.restore(&backup, Some(None)).await.unwrap();
    // One trainee and the sessions of both.
    assert_eq!((restored.files, restored.erased_again, restored.kept), (1, 3, vec![]));
    assert_eq!(trainees(&backups.bench, &folder).await, ["Ben"]);
    for planted in ["Ana Planted", "the planted recording", "a recording that is erased alone"] {
        assert!(holds(&backup, planted), "the backup itself has it");
        assert!(!holds(&folder, planted), "{planted}");
    }
    assert!(holds(&folder, "another recording"));
    // The list of the restored folder names them, too: for the next backup that is restored.
    let list = fs::read_to_string(folder.join(ERASURE_LIST)).unwrap();
    assert_eq!(list, fs::read_to_string(backups.target.path().join(ERASURE_LIST)).unwrap());
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
    let stopped = restore(&backup, &to, Some(None), DATABASE, clock.clone(), &stop).await;
    assert!(matches!(stopped, Err(UpkeepError::Interrupted)), "{stopped:?}");
    assert!(!to.exists());

    // After a kill the service does not run on it, and the next restore replaces it. So it was with earlier versions.
    fs::create_dir(&to).unwrap();
    let mark = "This folder is being restored. If that was interrupted, delete it and restore again.\n";
    fs::write(to.join(BACKUP_MARK), mark).unwrap();
    fs::write(to.join(DATABASE), "half, with people to erase").unwrap();
    let unfinished = backups.restore(&to, Some(None)).await.unwrap_err();
    assert!(matches!(unfinished, UpkeepError::UnfinishedBackup(_)), "{unfinished}");
    let restored = restore(&backup, &to, Some(None), DATABASE, clock, &Shutdown::new()).await.unwrap();
    assert_eq!((restored.erased_again, restored.missing), (3, vec![]));
    assert!(!to.join(BACKUP_MARK).exists());
    assert_eq!(trainees(&backups.bench, &to).await, ["Ben"]);
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
        let (folder, restored) = backups.restore(&backup, Some(None)).await.unwrap();
        assert_eq!((restored.erased_again, restored.kept), (0, vec![]));
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
    let list = fs::read_to_string(backups.target.path().join(ERASURE_LIST)).unwrap();
    backups.list_erasures().await;
    assert_eq!(fs::read_to_string(backups.target.path().join(ERASURE_LIST)).unwrap(), list);
}

#[tokio::test]
async fn without_a_list_of_erasures_nothing_is_restored_unless_told_so() {
    let (backups, backup) = Backups::with_an_erasure_after_the_backup().await;
    let refused = backups.restore(&backup, Some(None)).await.unwrap_err();
    assert!(matches!(&refused, UpkeepError::NoList(_)), "{refused}");
    assert!(refused.to_string().contains("--without-erasures"), "{refused}");
    assert_eq!(fs::read_dir(backups.target.path()).unwrap().count(), 1, "nothing was made");
    let (folder, restored) = backups.restore(&backup, None).await.unwrap();
    assert_eq!((restored.files, restored.erased_again), (3, 0));
    assert_eq!(trainees(&backups.bench, &folder).await, ["Ana Planted", "Ben"]);
}

#[tokio::test]
async fn a_list_of_erasures_is_only_appended_to_and_survives_a_power_cut() {
    let (backups, _) = Backups::with_an_erasure_after_the_backup().await;
    let list = backups.target.path().join(ERASURE_LIST);
    backups.list_erasures().await;
    let before = fs::read_to_string(&list).unwrap();
    assert!(before.lines().any(|line| line.starts_with("trainee ")), "{before}");
    assert!(before.lines().any(|line| line.starts_with("person ")), "the account of the trainee: {before}");
    backups.list_erasures().await; // as after a restart
    assert_eq!(fs::read_to_string(&list).unwrap(), before);
    // A power cut leaves a part of the last line.
    let cut = &before[..before.len() - 10];
    fs::write(&list, cut).unwrap();
    backups.list_erasures().await;
    assert_eq!(fs::read_to_string(&list).unwrap(), before);
    fs::write(&list, "trainee nonsense\n").unwrap();
    let mut lists = ErasureLists::new(backups.bench.centre.folder.path(), Some(backups.target.path()));
    assert!(matches!(lists.update(&backups.bench.centre.store).await, Err(UpkeepError::List { .. })));
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
    let (state, shutdown, clock) = (BackupState::default(), Shutdown::new(), bench.centre.clock.clone());
    let running =
        run_backups((&bench.centre.store, &bench.vault), &settings, DATABASE, (clock.clone(), &shutdown), &state);
    let watch = async {
        let count = || complete_backups(folder.path()).unwrap().len();
        let mut newest = None;
        for _ in 0..4 {
            while state.now().newest_ms == newest {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
            newest = state.now().newest_ms;
            clock.advance(Duration::from_secs(86_400));
        }
        assert!((2..=3).contains(&count()), "{}", count());
        shutdown.begin();
    };
    tokio::join!(running, watch);
    let kept = complete_backups(folder.path()).unwrap();
    assert!(kept.windows(2).all(|pair| pair[1].0 - pair[0].0 == 86_400_000), "{kept:?}");
    assert!(folder.path().join("a file of somebody").exists());
    assert!(!folder.path().join("partial-of-an-interrupted-one").exists());
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
