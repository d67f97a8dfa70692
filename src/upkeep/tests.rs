//! Tests of files and database together: after a crash at any point, the next start makes both consistent.

use std::collections::HashMap;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::backup::verify_copy;
use super::{
    BACKUP_MARK, BackupMark, BackupReport, Finding, LostFile, Recovered, UpkeepError, UpkeepResult, back_up, check,
    clear_up, delete_orphans, prepare_database, recover,
};
use crate::domain::blob::{Blob, BlobHash};
use crate::domain::feed::FrameCodec;
use crate::domain::feed::record::{FeedRecord, HEADER_BYTES, RecordBody};
use crate::domain::scope::Scope;
use crate::domain::session::NewSession;
use crate::domain::text::Key;
use crate::ids::{FeedId, TraineeId, UploadId};
use crate::shutdown::Shutdown;
use crate::store::testing::{NOW_MS, TestCentre};
use crate::store::{NewFeed, NewUpload, SessionRecord, Store, StoreSettings};
use crate::time::Clock;
use crate::vault::tests::{feed_pipe, make_pipe};
use crate::vault::{FileLoss, Vault};

pub(super) struct UpkeepFixture {
    pub(super) centre: TestCentre,
    pub(super) vault: Vault,
}

impl UpkeepFixture {
    pub(super) async fn new() -> Self {
        let centre = TestCentre::with_camera_and_colours().await;
        let vault = Vault::open(centre.folder.path()).await.unwrap();
        Self { centre, vault }
    }

    /// Creates a session as the service does: file first, row second.
    pub(super) async fn session(&self, trainee: TraineeId, content: &str) -> SessionRecord {
        let kept = self.vault.put(content.as_bytes()).await.unwrap();
        let new = NewSession { video: kept.blob(), ..self.centre.new_session(trainee, content) };
        self.centre.store.sessions().create(&Scope::service(), new).await.unwrap()
    }

    /// Tracks and scores a session, with its files in the vault.
    pub(super) async fn score(&self, session: &SessionRecord) {
        let lease = self.centre.claim().await.unwrap();
        let trajectory = self.vault.put(format!("trajectory of {}", session.id).as_bytes()).await.unwrap();
        let diagnostics = self.vault.put(format!("diagnostics of {}", session.id).as_bytes()).await.unwrap();
        let mut result = self.centre.result(session.id).await;
        (result.trajectory, result.diagnostics) = (trajectory.blob(), Some(diagnostics.blob()));
        self.centre.store.jobs().finish_track(&lease, result).await.unwrap();
    }

    /// The path of a file in the data folder.
    pub(super) fn path_of(&self, hash: BlobHash) -> PathBuf {
        let hash = hash.to_string();
        self.centre.folder.path().join("blobs").join(&hash[..2]).join(hash)
    }

    /// An upload of five bytes, `noted` of them recorded as durable.
    async fn upload(&self, trainee: TraineeId, in_file: &[u8], noted: u64) -> UploadId {
        let id = UploadId::at(NOW_MS);
        let mut file = self.vault.create_upload(id).await.unwrap();
        let new = NewUpload {
            id,
            trainee,
            task: self.centre.task.id,
            in_box: self.centre.the_box.id,
            filename: "clip.mp4".parse().unwrap(),
            metadata: String::new(),
            recorded_at_ms: None,
            time: None,
            length: 5,
            expires_at_ms: NOW_MS + 1_000,
        };
        let uploads = self.centre.store.uploads();
        uploads.create(&Scope::service(), new, 9).await.unwrap();
        file.append(in_file).await.unwrap();
        file.sync().await.unwrap();
        uploads.advance(id, noted, NOW_MS + 1_000).await.unwrap();
        id
    }

    /// A feed of five frames; `spoil` may damage its log.
    pub(super) async fn feed(&self, trainee: TraineeId, spoil: impl FnOnce(&mut Vec<u8>)) -> FeedId {
        let new = NewFeed {
            id: FeedId::at(NOW_MS),
            trainee,
            task: self.centre.task.id,
            in_box: self.centre.the_box.id,
            codec: FrameCodec::Jpeg,
            size: (640, 360),
            time_base: [1, 90_000].try_into().unwrap(),
            began_at_ms: NOW_MS,
            sender: "a test".into(),
            is_push: false,
            resumes: true,
        };
        let id = new.id;
        self.centre.store.feeds().open(&Scope::service(), new, 9).await.unwrap();
        let mut log = Vec::new();
        for number in 0..5 {
            let body = RecordBody::Frame { time: 3600 * number as i64, is_key: true, payload: b"a picture" };
            FeedRecord { epoch: 1, number, body }.write(&mut log);
        }
        spoil(&mut log);
        fs::write(self.centre.folder.path().join("feeds").join(id.to_string()), log).unwrap();
        id
    }

    async fn recover(&self) -> Recovered {
        recover(&self.centre.store, &self.vault).await.unwrap()
    }

    pub(super) async fn findings(&self) -> Vec<Finding> {
        check(&self.centre.store, &self.vault, true).await.unwrap()
    }

    async fn back_up(&self, to: &Path) -> UpkeepResult<BackupReport> {
        let (data, clock) = ((&self.centre.store, &self.vault), self.centre.clock.clone());
        back_up(data, to, "trocar.sqlite", clock, &Shutdown::new()).await
    }
}

#[tokio::test]
async fn a_centre_at_work_is_clean_and_its_recovery_changes_nothing() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    let session = bench.session(ana, "video").await;
    bench.score(&session).await;
    bench.upload(ana, b"vi", 2).await;
    assert_eq!(bench.findings().await, []);
    assert_eq!(bench.recover().await, Recovered::default());
    assert_eq!(bench.findings().await, []);
}

#[tokio::test]
async fn what_is_left_between_file_and_row_is_cleared_and_nothing_else() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    bench.session(ana, "video").await;
    let data = bench.centre.folder.path();
    fs::write(data.join("incoming").join("half"), b"ha").unwrap(); // killed while a blob was written
    let orphan = bench.vault.put(b"orphan").await.unwrap().blob(); // killed between name and row
    bench.vault.create_upload(UploadId::at(1)).await.unwrap(); // killed between file and row of an upload
    assert_eq!(bench.findings().await, [Finding::OrphanFile(orphan.hash)]);
    let recovered = bench.recover().await;
    assert_eq!((recovered.half_written, recovered.orphan_blobs, recovered.orphan_uploads), (1, 1, 1));
    assert_eq!(bench.findings().await, []);
    bench.vault.read(Blob::of(b"video").hash, 100).await.unwrap();
}

#[tokio::test]
async fn many_files_without_a_row_are_kept_until_a_person_has_them_deleted() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    let video = bench.session(ana, "video").await.video.unwrap();
    for number in 0..20 {
        drop(bench.vault.put(format!("named by the right database: {number}").as_bytes()).await.unwrap());
    }
    let recovered = bench.recover().await;
    assert_eq!((recovered.orphan_blobs, recovered.kept_orphans), (0, 20));
    let many = Finding::ManyOrphans { orphans: 20, files: 21 };
    assert!(many.is_loss() && many.to_string().contains("put the right database back"), "{many}");
    assert!(many.to_string().contains("or their deletion failed earlier"), "{many}");
    let findings = bench.findings().await;
    assert_eq!((findings.len(), findings.last()), (21, Some(&many)));
    assert_eq!(delete_orphans(&bench.centre.store, &bench.vault).await.unwrap(), 20);
    assert_eq!(bench.findings().await, []);
    assert!(bench.path_of(video).exists());
}

#[tokio::test]
async fn a_folder_that_has_lost_its_database_gets_no_new_one() {
    type LeaveRemains = fn(&Path);
    let remains: [(&str, LeaveRemains); 6] = [
        ("stored files", |data| {
            let hash = Blob::of(b"video").hash.to_string();
            fs::write(data.join("blobs").join(&hash[..2]).join(&hash), b"video").unwrap();
        }),
        ("uploads", |data| fs::write(data.join("uploads").join(UploadId::at(1).to_string()), b"vi").unwrap()),
        ("live recordings", |data| fs::write(data.join("feeds").join(FeedId::at(1).to_string()), b"").unwrap()),
        ("a list of erasures", |data| fs::write(data.join("erasures"), b"").unwrap()),
        ("a copy from before an update", |data| {
            fs::create_dir(data.join("before-update")).unwrap();
            fs::write(data.join("before-update/trocar.db"), b"copy").unwrap();
        }),
        ("a write-ahead log", |data| fs::write(data.join("trocar.db-wal"), b"changes").unwrap()),
    ];
    for (what, leave) in remains {
        let folder = tempfile::tempdir().unwrap();
        let vault = Vault::open(folder.path()).await.unwrap();
        let database = folder.path().join("trocar.db");
        let prepare = async || prepare_database(&vault, &database, &StoreSettings::default()).await;
        prepare().await.expect("a first start that was interrupted leaves empty folders");
        leave(folder.path());
        let refused = prepare().await.unwrap_err().to_string();
        assert!(refused.contains(&format!("holds {what} of an earlier one")), "{refused}");
        assert!(refused.contains("admin restore") && refused.contains("an empty folder"), "{refused}");
        assert!(refused.contains("Copy the folders `uploads` and `feeds` aside first"), "{refused}");
        assert!(!database.exists());
        fs::write(&database, b"").unwrap();
        assert!(matches!(prepare().await, Err(UpkeepError::LostDatabase { .. })), "{what}");
        assert_eq!(fs::metadata(&database).unwrap().len(), 0);
    }
}

#[tokio::test]
async fn an_upload_keeps_its_acknowledged_bytes_and_a_complete_one_becomes_its_session() {
    let bench = UpkeepFixture::new().await;
    let (ana, service) = (bench.centre.trainee("Ana").await.id, Scope::service());
    let longer = bench.upload(ana, b"vid", 2).await; // killed between sync and row
    let whole = bench.upload(ana, b"video", 5).await; // killed between row and session
    let recovered = bench.recover().await;
    assert_eq!((recovered.finished_uploads, recovered.set_back_uploads), (1, 0));
    assert_eq!(bench.centre.store.uploads().get(&service, longer).await.unwrap().received, 2);
    let session = bench.centre.store.uploads().get(&service, whole).await.unwrap().session_id.unwrap();
    let session = bench.centre.store.sessions().get(&service, session).await.unwrap();
    assert_eq!(bench.vault.read(session.video.unwrap(), 100).await.unwrap(), b"video");
    assert_eq!(bench.vault.upload_files().await.unwrap(), [longer]);
}

#[tokio::test]
async fn a_lying_disk_sets_an_upload_back_to_what_is_there_and_the_check_says_so() {
    let bench = UpkeepFixture::new().await;
    let (ana, service) = (bench.centre.trainee("Ana").await.id, Scope::service());
    let id = bench.upload(ana, b"vid", 4).await;
    assert_eq!(bench.findings().await, [Finding::ShortUpload(id)]);
    assert_eq!(bench.recover().await.set_back_uploads, 1);
    assert_eq!(bench.centre.store.uploads().get(&service, id).await.unwrap().received, 3);
}

/// The file of a finding, which must name the session of this trainee.
fn lost(finding: Finding, trainee: &str) -> (BlobHash, FileLoss) {
    let Finding::LostFile(file) = finding else { panic!("{finding}") };
    let shown = file.to_string();
    let of = format!("recording of session {} (trainee {trainee}, task ", file.uses[0].session_id.unwrap());
    assert!(shown.starts_with(&format!("{} file {}: {of}", file.loss, file.hash.file())), "{shown}");
    (file.hash, file.loss)
}

#[tokio::test]
async fn a_missing_and_a_damaged_file_are_losses() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    let (gone, damaged) =
        (bench.session(ana, "gone").await.video.unwrap(), bench.session(ana, "damaged").await.video.unwrap());
    fs::remove_file(bench.path_of(gone)).unwrap();
    fs::write(bench.path_of(damaged), b"dbmaged").unwrap();
    let findings = bench.findings().await;
    assert!(findings.iter().all(Finding::is_loss));
    let mut found: Vec<(BlobHash, FileLoss)> = findings.into_iter().map(|finding| lost(finding, "ana")).collect();
    found.sort_by_key(|(_, loss)| *loss == FileLoss::Damaged);
    assert_eq!(found, [(gone, FileLoss::Missing), (damaged, FileLoss::Damaged)]);
}

#[tokio::test]
async fn a_file_that_cannot_be_deleted_stops_no_other_step() {
    let bench = UpkeepFixture::new().await;
    let (store, service) = (&bench.centre.store, Scope::service());
    let ana = bench.centre.trainee("Ana").await.id;
    let mut erased = Vec::new();
    for video in ["one", "two", "three"] {
        let session = bench.session(ana, video).await;
        store.sessions().erase(&service, session.id).await.unwrap();
        erased.push(bench.path_of(session.video.unwrap()));
    }
    let expired = bench.upload(ana, b"part1", 3).await;
    bench.centre.clock.advance(std::time::Duration::from_secs(365 * 86_400));
    let upload = bench.centre.folder.path().join("uploads").join(expired.to_string());
    for stubborn in [&erased[0], &erased[1], &upload] {
        fs::remove_file(stubborn).unwrap();
        fs::create_dir_all(stubborn.join("in the way")).unwrap();
    }
    assert!(clear_up(store, &bench.vault).await.is_err(), "the failure is reported");
    assert!(!erased[2].exists());
}

#[tokio::test]
async fn a_recording_that_two_sessions_share_goes_with_the_second() {
    let bench = UpkeepFixture::new().await;
    let (store, service) = (&bench.centre.store, Scope::service());
    let (ana, ben) = (bench.centre.trainee("Ana").await.id, bench.centre.trainee("Ben").await.id);
    let (first, second) = (bench.session(ana, "same video").await, bench.session(ben, "same video").await);
    store.sessions().erase(&service, first.id).await.unwrap();
    clear_up(store, &bench.vault).await.unwrap();
    assert!(bench.vault.open_blob(first.video.unwrap()).await.is_ok());
    store.sessions().erase(&service, second.id).await.unwrap();
    clear_up(store, &bench.vault).await.unwrap();
    assert!(bench.vault.open_blob(first.video.unwrap()).await.is_err());
    assert_eq!(bench.findings().await, []);
}

#[tokio::test]
async fn a_recording_whose_person_was_erased_while_it_was_put_is_gone_with_the_next_round() {
    let bench = UpkeepFixture::new().await;
    let (store, service) = (&bench.centre.store, Scope::service());
    let (ana, ben) = (bench.centre.trainee("Ana").await.id, bench.centre.trainee("Ben").await.id);
    let kept = bench.vault.put(b"of Ana").await.unwrap();
    let erased = kept.blob();
    store.trainees().erase(&service, &Key::from(&ana)).await.unwrap();
    clear_up(store, &bench.vault).await.unwrap();
    assert!(bench.path_of(erased.hash).exists(), "its row may still come");
    let new = NewSession { video: erased, ..bench.centre.new_session(ana, "of Ana") };
    store.sessions().create(&service, new).await.unwrap_err();
    drop(kept);
    let stays = bench.session(ben, "of Ben").await.video.unwrap();
    clear_up(store, &bench.vault).await.unwrap();
    assert!(!bench.path_of(erased.hash).exists());
    assert!(bench.path_of(stays).exists());
    assert_eq!(bench.vault.released(), []);
}

#[tokio::test]
async fn an_analysed_picture_is_removed_once_it_is_released() {
    let bench = UpkeepFixture::new().await;
    let store = &bench.centre.store;
    let held = bench.vault.put(b"a photo of the board").await.unwrap();
    store.blobs().note(held.blob()).await.unwrap();
    clear_up(store, &bench.vault).await.unwrap();
    assert!(bench.vault.open_blob(held.blob().hash).await.is_ok(), "it is in use");
    let hash = held.blob().hash;
    drop(held);
    clear_up(store, &bench.vault).await.unwrap();
    assert!(bench.vault.open_blob(hash).await.is_err());
    assert_eq!(bench.findings().await, []);
}

#[tokio::test]
async fn no_byte_of_an_erased_trainee_is_left_in_the_data_folder() {
    const MARKER: &str = "Qvinx"; // as long as the uploads are
    let bench = UpkeepFixture::new().await;
    let (store, service) = (&bench.centre.store, Scope::service());
    let marked = bench.centre.trainee(&format!("{MARKER} Smith")).await;
    let session = bench.session(marked.id, &format!("video of {MARKER}")).await;
    bench.score(&session).await;
    bench.upload(marked.id, MARKER.as_bytes(), 3).await; // still arriving
    bench.upload(marked.id, MARKER.as_bytes(), 5).await; // whole: becomes a session
    bench.recover().await;
    bench.centre.person(&MARKER.to_lowercase(), crate::domain::role::Role::Trainee, Some(marked.id)).await;
    let others = bench.centre.trainee("Ana").await.id;
    bench.session(others, "video of somebody else").await;
    assert!(holds(bench.centre.folder.path(), MARKER));

    store.trainees().erase(&service, &Key::from(&marked.id)).await.unwrap();
    clear_up(store, &bench.vault).await.unwrap();
    assert!(!holds(bench.centre.folder.path(), MARKER));
    assert!(!holds(bench.centre.folder.path(), &MARKER.to_lowercase()));
    assert_eq!(bench.findings().await, []);
    bench.vault.read(Blob::of(b"video of somebody else").hash, 100).await.unwrap();
}

#[tokio::test]
async fn an_upload_that_is_just_being_created_is_not_removed() {
    let bench = UpkeepFixture::new().await;
    let id = UploadId::at(NOW_MS);
    let between_file_and_row = bench.vault.create_upload(id).await.unwrap();
    clear_up(&bench.centre.store, &bench.vault).await.unwrap();
    assert_eq!(bench.vault.upload_files().await.unwrap(), [id]);
    drop(between_file_and_row);
    clear_up(&bench.centre.store, &bench.vault).await.unwrap();
    assert_eq!(bench.vault.upload_files().await.unwrap(), []);
}

#[tokio::test]
async fn an_upload_whose_time_is_over_is_forgotten() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    let id = bench.upload(ana, b"vi", 2).await;
    clear_up(&bench.centre.store, &bench.vault).await.unwrap();
    assert_eq!(bench.vault.upload_files().await.unwrap(), [id]);
    bench.centre.clock.advance(std::time::Duration::from_secs(1));
    clear_up(&bench.centre.store, &bench.vault).await.unwrap();
    assert_eq!(bench.vault.upload_files().await.unwrap(), []);
    assert!(bench.centre.store.uploads().get(&Scope::service(), id).await.is_err());
}

#[tokio::test]
async fn a_backup_is_a_data_folder_with_everything_but_what_is_still_arriving() {
    let bench = UpkeepFixture::new().await;
    let (store, service) = (&bench.centre.store, Scope::service());
    let ana = bench.centre.trainee("Ana").await.id;
    let session = bench.session(ana, "video").await;
    bench.score(&session).await;
    bench.upload(ana, b"vi", 2).await;
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("backup");
    let clock = bench.centre.clock.clone();
    let copied = bench.back_up(&to).await.unwrap();
    assert_eq!(copied, BackupReport { files: 3, missing: vec![] }); // recording, trajectory, diagnostics
    assert_eq!(BackupMark::read(&to).unwrap(), Some(BackupMark::Backup { missing: vec![] }));
    assert!(!to.join("lock").exists());
    let noted = store.audit().last_backup(&service).await.unwrap().unwrap();
    assert_eq!((noted.at_ms, noted.files), (clock.now_ms(), 3));
    bench.session(ana, "made after the backup").await;

    let copy = Store::open(&to.join("trocar.sqlite"), &StoreSettings::default(), clock).await.unwrap();
    let files = Vault::open(&to).await.unwrap();
    assert_eq!(check(&copy, &files, true).await.unwrap(), []);
    assert_eq!(
        copy.sessions().result(&service, session.id).await.unwrap(),
        store.sessions().result(&service, session.id).await.unwrap()
    );
    assert_eq!(files.read(session.video.unwrap(), 100).await.unwrap(), b"video");
    assert_eq!(copy.uploads().unfinished().await.unwrap(), []);
    let again = bench.back_up(&to).await;
    assert!(matches!(again, Err(UpkeepError::Used(_))), "{again:?}");
}

#[tokio::test]
async fn a_backup_during_work_is_sound() {
    let bench = UpkeepFixture::new().await;
    let (store, service) = (&bench.centre.store, Scope::service());
    let ana = bench.centre.trainee("Ana").await.id;
    for number in 0..5 {
        bench.session(ana, &format!("early video {number}")).await;
    }
    let working = async {
        for number in 0..20 {
            let session = bench.session(ana, &format!("video {number}")).await;
            if number % 2 == 0 {
                store.sessions().erase(&service, session.id).await.unwrap();
                clear_up(store, &bench.vault).await.unwrap();
            }
        }
    };
    let folder = tempfile::tempdir().unwrap();
    let (copied, ()) = tokio::join!(bench.back_up(folder.path()), working);
    let copied = copied.unwrap();
    assert!(copied.files >= 5 && copied.missing.is_empty(), "{copied:?}");
}

#[tokio::test]
async fn a_backup_of_a_centre_that_has_lost_files_holds_all_others_and_names_them() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    let (missing, damaged) =
        (bench.session(ana, "missing").await.video.unwrap(), bench.session(ana, "damaged").await.video.unwrap());
    bench.session(ana, "a video that is there").await;
    fs::remove_file(bench.path_of(missing)).unwrap();
    fs::write(bench.path_of(damaged), b"dbmaged").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let report = bench.back_up(folder.path()).await.unwrap();
    assert_eq!(report.files, 1);
    assert!(holds(folder.path(), "a video that is there") && !holds(folder.path(), "dbmaged"));
    let named: Vec<String> = report.missing.iter().map(LostFile::to_string).collect();
    assert_eq!(BackupMark::read(folder.path()).unwrap(), Some(BackupMark::Backup { missing: named }));
    let mut found: Vec<_> = report.missing.into_iter().map(|file| lost(Finding::LostFile(file), "ana")).collect();
    found.sort_by_key(|(_, loss)| *loss == FileLoss::Damaged);
    assert_eq!(found, [(missing, FileLoss::Missing), (damaged, FileLoss::Damaged)]);
}

#[tokio::test]
async fn a_failed_backup_leaves_nothing_and_an_interrupted_one_is_replaced() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    let video = bench.session(ana, "video").await.video.unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (new, prepared) = (folder.path().join("new"), folder.path().join("prepared"));
    fs::create_dir(&prepared).unwrap();
    for to in [&new, &prepared] {
        // A stop within the file, which is a pipe here.
        let (pipe, stop) = (bench.path_of(video), Shutdown::new());
        fs::remove_file(&pipe).unwrap();
        make_pipe(&pipe);
        let (begun, marked) = (stop.clone(), to.join(BACKUP_MARK));
        let writing = std::thread::spawn(move || {
            let mut mark = String::new();
            feed_pipe(&pipe, || {
                mark = fs::read_to_string(&marked).unwrap_or_default();
                begun.begin();
            });
            fs::remove_file(&pipe).unwrap();
            fs::write(&pipe, "video").unwrap();
            mark
        });
        let (data, clock) = ((&bench.centre.store, &bench.vault), bench.centre.clock.clone());
        let stopped = back_up(data, to, "trocar.sqlite", clock, &stop).await;
        assert!(matches!(stopped, Err(UpkeepError::Interrupted)), "{stopped:?}");
        let mark = writing.join().unwrap();
        assert!(mark.contains("not finished") && !mark.contains("is a backup"), "{mark}");
    }
    assert!(!new.exists());
    assert_eq!(fs::read_dir(&prepared).unwrap().count(), 0, "only what the backup wrote is removed");

    // As after a kill: the mark says that it is not finished.
    bench.back_up(&new).await.unwrap();
    let finished = fs::read_to_string(new.join(BACKUP_MARK)).unwrap();
    let unfinished =
        "This folder is not finished. If no backup or restore is writing it, delete it, or repeat the command.\n";
    fs::write(new.join(BACKUP_MARK), unfinished).unwrap();
    fs::write(new.join("trocar.sqlite"), "half").unwrap();
    fs::write(new.join("blobs").join("left"), "behind").unwrap();
    let other = Vault::open_existing(&new);
    let writing = other.lock().await.unwrap();
    let refused = bench.back_up(&new).await.unwrap_err().to_string();
    assert!(refused.contains("in use: another command is writing it"), "{refused}");
    assert!(refused.contains(new.to_str().unwrap()), "{refused}");
    drop(writing);
    assert_eq!(bench.back_up(&new).await.unwrap().files, 1);
    assert!(!new.join("blobs").join("left").exists());
    assert_eq!(fs::read_to_string(new.join(BACKUP_MARK)).unwrap(), finished);

    fs::write(prepared.join("a file of another kind"), "stays").unwrap();
    fs::write(prepared.join(BACKUP_MARK), "my own notes about backups\n").unwrap();
    assert!(matches!(bench.back_up(&prepared).await, Err(UpkeepError::Used(_))));
    assert_eq!(fs::read_dir(&prepared).unwrap().count(), 2);
}

#[tokio::test]
async fn the_failure_of_a_finished_copy_names_no_trainee() {
    let bench = UpkeepFixture::new().await;
    let session = bench.session(bench.centre.trainee("Ana").await.id, "video").await;
    fs::remove_file(bench.path_of(session.video.unwrap())).unwrap();
    let (lost, stop) = (HashMap::new(), Shutdown::new());
    let unsound = verify_copy(&bench.centre.store, &bench.vault, &lost, &stop).await.unwrap_err().to_string();
    assert!(unsound.contains(&session.id.to_string()) && unsound.contains("task "), "{unsound}");
    assert!(!unsound.contains("trainee"), "{unsound}");
}

#[tokio::test]
async fn a_backup_that_cannot_be_written_leaves_nothing_and_reports_no_loss() {
    let bench = UpkeepFixture::new().await;
    let video = bench.session(bench.centre.trainee("Ana").await.id, "video").await.video.unwrap();
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("backup");
    let (pipe, place) = (bench.path_of(video), to.join(video.file()));
    fs::remove_file(&pipe).unwrap();
    make_pipe(&pipe);
    let writing = std::thread::spawn(move || {
        let mut pipe = fs::OpenOptions::new().write(true).open(&pipe).unwrap();
        pipe.write_all(b"video").unwrap();
        fs::remove_dir(place.parent().unwrap()).unwrap(); // while the file is copied, so that it cannot get its name
    });
    let failed = bench.back_up(&to).await;
    writing.join().unwrap();
    assert!(failed.is_err(), "{failed:?}");
    assert!(!to.exists());
}

/// True if any file below the folder contains these bytes.
pub(super) fn holds(folder: &Path, marker: &str) -> bool {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).any(|path| {
        if path.is_dir() {
            return holds(&path, marker);
        }
        let content = fs::read(&path).unwrap();
        content.windows(marker.len()).any(|window| window == marker.as_bytes())
    })
}

#[tokio::test]
async fn feeds_are_checked_record_by_record_and_against_their_rows() {
    const RECORD: usize = HEADER_BYTES + 9;
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    bench.feed(ana, |_| ()).await;
    bench.feed(ana, |log| log.truncate(4 * RECORD + 20)).await; // cut within the last record: not acknowledged
    bench.feed(ana, |log| log.truncate(0)).await;
    bench.feed(ana, |log| log.resize(log.len() + (3 << 20), 0)).await; // a tail of zeros: never synced
    let again = |log: &mut Vec<u8>| {
        let lost = log[2 * RECORD..3 * RECORD].to_vec();
        log[2 * RECORD + HEADER_BYTES] ^= 1;
        log.extend(lost); // it was not acknowledged, so the sender sent it again
    };
    bench.feed(ana, again).await;
    assert_eq!(bench.findings().await, []);
    let flipped = bench.feed(ana, |log| log[2 * RECORD + HEADER_BYTES] ^= 1).await;
    let damaged = Finding::DamagedFeed(flipped, vec![[2, 2]]);
    assert!(
        damaged.to_string().contains("lacks the frames 2 to 2: those that were acknowledged to its sender are lost")
    );
    assert_eq!(bench.findings().await, std::slice::from_ref(&damaged));
    let headless = bench.feed(ana, |log| log[RECORD..3 * RECORD].fill(0)).await;
    let missing = bench.feed(ana, |_| ()).await;
    let feeds = bench.centre.folder.path().join("feeds");
    fs::remove_file(feeds.join(missing.to_string())).unwrap();
    let orphan = FeedId::at(NOW_MS);
    fs::write(feeds.join(orphan.to_string()), b"").unwrap();
    let mut expected = [
        (flipped, damaged),
        (headless, Finding::DamagedFeed(headless, vec![[1, 2]])),
        (missing, Finding::MissingFeed(missing)),
        (orphan, Finding::OrphanFeed(orphan)),
    ];
    expected.sort_by_key(|(id, _)| id.to_string());
    assert_eq!(bench.findings().await, expected.map(|(_, finding)| finding));
}
