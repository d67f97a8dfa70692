//! Videos, pictures of boxes and people are kept for a limited time, and nothing else goes with them.

use std::path::PathBuf;
use std::time::Duration;

use super::super::tests::{UpkeepFixture, holds};
use super::{RetentionSettings, apply_retention};
use crate::domain::blob::Blob;
use crate::domain::clock::TimeCorrection;
use crate::domain::edit::EditChange;
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::job::{CalibrateInput, JobInput, JobKind, NamedBlob, PaletteInput};
use crate::domain::palette::NewPalette;
use crate::domain::personal_retention::kept_months;
use crate::domain::problem::Problem;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::session::SessionStatus;
use crate::domain::text::Key;
use crate::ids::JobId;
use crate::shutdown::Shutdown;
use crate::store::testing::TestCentre;
use crate::store::{
    AccessKey, AccessedRecordings, EditBasis, HOUR_MS, Lease, NewAccess, PageRequest, Store, StoreError, StoreSettings,
    VideoAge,
};
use crate::time::Clock;
use crate::upkeep::{UPDATE_COPY_FOLDER, back_up, clear_up, recover};
use crate::vision::surroundings::Surroundings;

/// As long as the texts that the tests search for.
const MARKER: &str = "Qvinx";
const DAY: Duration = Duration::from_secs(86_400);

impl UpkeepFixture {
    /// A round of upkeep.
    async fn upkeep(&self, settings: &RetentionSettings) {
        let store = &self.centre.store;
        apply_retention((store, &self.vault), settings, self.centre.clock.now_ms()).await.unwrap();
        clear_up(store, &self.vault).await.unwrap();
    }

    fn holds(&self, text: &str) -> bool {
        holds(self.centre.folder.path(), text)
    }

    /// Copies the database, as the start after an update does; the path of the copy.
    async fn copy_as_before_an_update(&self) -> PathBuf {
        let copy = self.centre.folder.path().join(UPDATE_COPY_FOLDER).join("trocar.sqlite");
        std::fs::create_dir(copy.parent().unwrap()).unwrap();
        self.centre.store.snapshot(&copy).await.unwrap();
        copy
    }

    /// Queues the learning of colours from a picture with this content, and claims the job.
    async fn palette_job(&self, content: &str) -> Lease {
        self.palette_job_with(content, None).await
    }

    /// The same with a picture of the empty box.
    async fn palette_job_with(&self, content: &str, empty_box: Option<Blob>) -> Lease {
        let empty_box = empty_box.map(|blob| NamedBlob { name: "empty.jpg".to_owned(), blob });
        let annotations = TestCentre::new_palette().annotations;
        let kept = self.vault.put(content.as_bytes()).await.unwrap();
        let file = NamedBlob { name: "frame_0.png".to_owned(), blob: kept.blob() };
        let of = self.centre.the_box.id;
        let input = PaletteInput { of, annotations, files: vec![file], is_video: false, frames: vec![0], empty_box };
        self.centre.store.jobs().enqueue(&Scope::service(), JobInput::Palette(input)).await.unwrap();
        self.centre.claim().await.unwrap()
    }
}

fn months(videos_months: u32) -> RetentionSettings {
    RetentionSettings { videos_months, ..RetentionSettings::default() }
}

fn refusal<T: std::fmt::Debug>(result: Result<T, StoreError>) -> String {
    match result {
        Err(StoreError::Refused { why }) => why,
        other => panic!("not refused: {other:?}"),
    }
}

#[tokio::test]
async fn an_old_video_is_deleted_and_its_path_can_be_scored_again() {
    let bench = UpkeepFixture::new().await;
    let (store, service) = (&bench.centre.store, Scope::service());
    let (ana, ben) = (bench.centre.trainee("Ana").await.id, bench.centre.trainee("Ben").await.id);
    let old = bench.session(ana, "an old video").await;
    bench.score(&old).await;
    bench.centre.clock.advance(40 * DAY);
    let young = bench.session(ana, "a young video").await;
    bench.score(&young).await;
    bench.centre.clock.advance(40 * DAY);
    bench.upkeep(&months(0)).await;
    bench.upkeep(&months(3)).await;
    assert!(bench.path_of(old.video.unwrap()).exists(), "it is kept for three months");
    let (path, of_ana) =
        (store.sessions().result(&service, old.id).await.unwrap().unwrap().trajectory, old.video.unwrap());
    let due = months(2).videos_at(bench.centre.clock.now_ms());
    assert_eq!(store.retention().old_videos(due).await.unwrap(), (1, 12));

    bench.upkeep(&months(2)).await;
    assert!(!bench.path_of(of_ana).exists() && bench.path_of(young.video.unwrap()).exists());
    assert!(bench.path_of(path).exists());
    assert_eq!(bench.findings().await, [], "the check expects no file");
    let shown = store.sessions().get(&service, old.id).await.unwrap();
    assert_eq!(shown.video_dropped_at_ms, Some(bench.centre.clock.now_ms()));
    assert_eq!((shown.video, shown.status()), (old.video, SessionStatus::Done));
    let why = refusal(store.sessions().retry(&service, old.id).await);
    assert!(why.contains("was deleted on"), "{why}");
    let retime = (EditChange::Retime(TimeCorrection::FrameRate(30.0)), "slow".parse().unwrap());
    assert!(refusal(store.edits().add(&service, old.id, retime, EditBasis::default()).await).contains("deleted"));
    let trim = (EditChange::Trim([1.0, 5.0]), "a pause".parse().unwrap());
    store.edits().add(&service, old.id, trim, EditBasis::default()).await.unwrap();
    assert_eq!(bench.centre.claim().await.unwrap().job.kind, JobKind::Rescore);

    // A backup has no such file either, and a person who sends the same recording again has it.
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("backup");
    let (clock, stop) = (bench.centre.clock.clone(), Shutdown::new());
    back_up((store, &bench.vault), &to, "trocar.sqlite", clock, &stop).await.unwrap();
    assert!(!holds(&to, "an old video") && holds(&to, "a young video"));
    bench.session(ben, "an old video").await;
    bench.upkeep(&months(2)).await;
    assert!(bench.path_of(of_ana).exists());
    assert_eq!(bench.findings().await, []);
}

#[tokio::test]
async fn a_video_that_still_has_to_be_tracked_is_kept_until_then() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    let waiting = bench.session(ana, "a waiting video").await;
    bench.centre.clock.advance(400 * DAY);
    bench.upkeep(&months(1)).await;
    assert!(bench.path_of(waiting.video.unwrap()).exists());
    bench.score(&waiting).await;
    bench.upkeep(&months(1)).await;
    assert!(!bench.path_of(waiting.video.unwrap()).exists());
}

#[tokio::test]
async fn a_file_that_a_crash_left_of_a_dropped_video_is_removed_at_the_start() {
    let bench = UpkeepFixture::new().await;
    let old = bench.session(bench.centre.trainee("Ana").await.id, "an old video").await;
    bench.score(&old).await;
    let later = VideoAge { now_ms: bench.centre.clock.now_ms() + 40 * 86_400_000, centre_months: 1 };
    let dropped = bench.centre.store.retention().drop_videos(later, 9).await.unwrap();
    assert_eq!(dropped, [old.video.unwrap()], "the crash comes before the file is deleted");
    recover(&bench.centre.store, &bench.vault).await.unwrap();
    assert!(!bench.path_of(old.video.unwrap()).exists());
    assert_eq!(bench.findings().await, []);
}

#[tokio::test]
async fn an_erasure_that_is_due_leaves_no_byte_and_one_taken_back_leaves_all() {
    let bench = UpkeepFixture::new().await;
    let (store, service, settings) = (&bench.centre.store, Scope::service(), RetentionSettings::default());
    let (ana, ben) = (bench.centre.trainee(&format!("{MARKER} Smith")).await, bench.centre.trainee("Ben").await);
    bench.score(&bench.session(ana.id, &format!("video of {MARKER}")).await).await;
    bench.session(ben.id, "video of Ben").await;
    let after = settings.erase_after().unwrap();
    for trainee in [&ana, &ben] {
        store.pending_erasures().request(&service, &Key::from(&trainee.id), after).await.unwrap();
    }
    bench.centre.clock.advance(after - Duration::from_secs(1));
    bench.upkeep(&settings).await;
    assert!(bench.holds(MARKER) && bench.holds("video of Ben"));
    store.pending_erasures().take_back(&service, &Key::from(&ben.id)).await.unwrap();
    bench.centre.clock.advance(Duration::from_secs(1));
    bench.upkeep(&settings).await;
    assert!(!bench.holds(MARKER) && bench.holds("video of Ben"));
    assert_eq!(store.pending_erasures().list(&service).await.unwrap(), []);
    assert_eq!(bench.findings().await, []);
}

#[tokio::test]
async fn a_boxs_finished_job_keeps_no_picture() {
    let bench = UpkeepFixture::new().await;
    let store = &bench.centre.store;
    let colours = bench.palette_job(&format!("a frame with {MARKER}")).await;
    let photo = bench.vault.put(format!("a board held by {MARKER}").as_bytes()).await.unwrap().blob();
    let files = vec![NamedBlob { name: "photo.jpg".to_owned(), blob: photo }];
    let board = "9x6".parse().unwrap();
    let input = CalibrateInput { of: bench.centre.the_box.id, board, square_mm: 21.0, files, is_video: false };
    store.jobs().enqueue(&Scope::service(), JobInput::Calibrate(input)).await.unwrap();
    let camera = bench.centre.claim().await.unwrap();
    bench.upkeep(&RetentionSettings::default()).await;
    assert!(bench.holds(MARKER), "the jobs still read them");
    store.jobs().finish_palette(&colours, TestCentre::new_palette()).await.unwrap();
    store.jobs().finish_calibration(&camera, TestCentre::new_calibration()).await.unwrap();
    bench.upkeep(&RetentionSettings::default()).await;
    assert!(!bench.holds(MARKER));
    assert_eq!(bench.findings().await, []);
}

#[tokio::test]
async fn the_picture_of_the_empty_box_stays_when_the_marked_pictures_go() {
    let bench = UpkeepFixture::new().await;
    let store = &bench.centre.store;
    let empty = bench.vault.put(b"a box without tools").await.unwrap().blob();
    let colours = bench.palette_job_with(&format!("a frame with {MARKER}"), Some(empty)).await;
    store.jobs().finish_palette(&colours, TestCentre::new_palette()).await.unwrap();
    bench.upkeep(&RetentionSettings::default()).await;
    assert!(!bench.holds(MARKER) && bench.holds("a box without tools"));
    let of = bench.centre.the_box.id;
    assert_eq!(store.jobs().done_palette_inputs(of).await.unwrap(), [], "its marked pictures are gone");
    assert_eq!(bench.findings().await, []);
}

#[tokio::test]
async fn a_picture_of_the_empty_box_that_went_with_a_person_is_not_kept_for_the_next_colours() {
    let bench = UpkeepFixture::new().await;
    let (store, service, of) = (&bench.centre.store, Scope::service(), bench.centre.the_box.id);
    let ana = bench.centre.trainee("Ana").await.id;
    bench.score(&bench.session(ana, "video of Ana").await).await;
    let empty = bench.vault.put(b"a box without tools").await.unwrap().blob();
    let learned = bench.palette_job_with("video of Ana", Some(empty)).await;
    let annotations = serde_json::json!({"needs": 2, "tool_diameter_mm": 5, "empty_box": empty.hash.to_string(),
        "tools": [{"tool": "left", "marker": {"kind": "shaft"}}],
        "labels": [{"frame": 0, "label": "shaft", "x": 1, "y": 1, "w": 2, "h": 2}]});
    let annotations = AnnotationsFile::parse(&annotations.to_string()).unwrap();
    let tools = annotations.marked_tools().unwrap().into_iter().map(Into::into).collect();
    let new = NewPalette { annotations, tools, ..TestCentre::new_palette() };
    store.jobs().finish_palette(&learned, new).await.unwrap();
    assert_eq!(store.palettes().empty_box(&service, of).await.unwrap(), Some(empty));
    store.trainees().erase(&service, &Key::from(&ana)).await.unwrap();
    assert_eq!(store.palettes().empty_box(&service, of).await.unwrap(), None);
}

#[tokio::test]
async fn pictures_of_a_failed_job_can_be_used_again_for_a_day() {
    let bench = UpkeepFixture::new().await;
    let (store, service) = (&bench.centre.store, Scope::service());
    let fail = async |content: &str| -> JobId {
        let lease = bench.palette_job(content).await;
        store.jobs().fail(&lease, Problem::new("x", "x", "x")).await.unwrap().id
    };
    let job = fail(&format!("a frame with {MARKER}")).await;
    bench.centre.clock.advance(DAY - Duration::from_secs(1));
    bench.upkeep(&RetentionSettings::default()).await;
    store.jobs().retry(&service, job).await.unwrap();
    let lease = bench.centre.claim().await.unwrap();
    assert_eq!(lease.job.id, job);
    store.jobs().fail(&lease, Problem::new("x", "x", "x")).await.unwrap();
    bench.centre.clock.advance(DAY);
    bench.upkeep(&RetentionSettings::default()).await;
    assert!(!bench.holds(MARKER));
    assert!(refusal(store.jobs().retry(&service, job).await).contains("send them again"));
    // Sent again, the job reads them again.
    assert_eq!(fail(&format!("a frame with {MARKER}")).await, job);
    bench.upkeep(&RetentionSettings::default()).await;
    assert!(bench.holds(MARKER));
    assert_eq!(bench.findings().await, []);
}

#[tokio::test]
async fn a_boxs_jobs_that_read_a_persons_recording_go_with_the_person() {
    let bench = UpkeepFixture::new().await;
    let (store, service) = (&bench.centre.store, Scope::service());
    let (ana, ben) = (bench.centre.trainee("Ana").await.id, bench.centre.trainee("Ben").await.id);
    let video = format!("video of {MARKER}");
    bench.score(&bench.session(ana, &video).await).await;
    let queued = bench.palette_job(&video).await;
    let of_ben = bench.session(ben, "video of Ben").await;
    bench.score(&of_ben).await;
    let other = bench.palette_job("video of Ben").await;
    store.trainees().erase(&service, &Key::from(&ana)).await.unwrap();
    bench.upkeep(&RetentionSettings::default()).await;
    assert!(!bench.holds(MARKER));
    assert!(store.jobs().get(&service, queued.job.id).await.is_err());
    assert!(store.jobs().get(&service, other.job.id).await.is_ok(), "it reads the recording of another person");
    store.sessions().erase(&service, of_ben.id).await.unwrap();
    assert!(store.jobs().get(&service, other.job.id).await.is_err());
    assert_eq!(bench.findings().await, []);
}

#[tokio::test]
async fn the_grey_picture_of_a_box_that_was_made_of_a_persons_recording_goes_with_the_person() {
    let bench = UpkeepFixture::new().await;
    let (store, service, of) = (&bench.centre.store, Scope::service(), bench.centre.the_box.id);
    let (ana, ben) = (bench.centre.trainee("Ana").await.id, bench.centre.trainee("Ben").await.id);
    bench.score(&bench.session(ana, "video of Ana").await).await;
    let of_ben = bench.session(ben, "video of Ben").await;
    bench.score(&of_ben).await;
    let learned = bench.palette_job("video of Ana").await;
    let surroundings = Surroundings::new(24, 24, vec![90; 24 * 24]);
    assert!(surroundings.is_some());
    let new = NewPalette { surroundings, ..TestCentre::new_palette() };
    let palette = store.jobs().finish_palette(&learned, new).await.unwrap().id;
    let pictures = async || store.surroundings().of_box(palette, of, of_ben.id).await.unwrap().len();
    assert_eq!(pictures().await, 1);
    let copy = bench.copy_as_before_an_update().await;
    store.sessions().erase(&service, of_ben.id).await.unwrap();
    assert_eq!(pictures().await, 1, "it shows the recording of another person");
    store.trainees().erase(&service, &Key::from(&ana)).await.unwrap();
    assert_eq!(pictures().await, 0);
    assert!(store.palettes().get(&service, palette).await.is_ok(), "the colours stay: numbers");
    clear_up(store, &bench.vault).await.unwrap();
    let copied = Store::open(&copy, &StoreSettings::default(), bench.centre.clock.clone()).await.unwrap();
    assert_eq!(copied.surroundings().of_box(palette, of, of_ben.id).await.unwrap().len(), 0, "in the copy");
    assert!(copied.jobs().get(&service, learned.job.id).await.is_err());
    assert!(copied.palettes().get(&service, palette).await.is_ok());
}

#[tokio::test]
async fn an_old_video_stays_while_the_copy_before_an_update_needs_it() {
    let bench = UpkeepFixture::new().await;
    let ana = bench.centre.trainee("Ana").await.id;
    let old = bench.session(ana, "an old video").await;
    bench.score(&old).await;
    let copy = bench.copy_as_before_an_update().await;
    bench.centre.clock.advance(80 * DAY);
    bench.upkeep(&months(2)).await;
    assert!(bench.path_of(old.video.unwrap()).exists());
    std::fs::remove_dir_all(copy.parent().unwrap()).unwrap();
    bench.upkeep(&months(2)).await;
    assert!(!bench.path_of(old.video.unwrap()).exists());
}

#[tokio::test]
async fn the_statement_for_old_videos_follows_the_rule_of_the_months() {
    let bench = UpkeepFixture::new().await;
    let (store, service) = (&bench.centre.store, Scope::service());
    let trainee = bench.centre.trainee("Ana").await.id;
    let session = bench.session(trainee, "an old video").await;
    bench.score(&session).await; // a job that waits still needs the video
    let arrived_ms = session.created_at_ms;
    for centre_months in [0, 1, 3, 6] {
        for own in
            [None, Some((0, None)), Some((0, Some("x"))), Some((3, None)), Some((3, Some("x"))), Some((9, Some("x")))]
        {
            let stored = own.map(|(months, reason)| (months, reason.map(|text: &str| text.parse().unwrap())));
            store.personal_retention().set(&service, trainee, stored, (centre_months, 9)).await.unwrap();
            let months = kept_months(centre_months, own.map(|(months, reason)| (months, reason.is_some())));
            let deleted_at_ms = RetentionSettings::deleted_at_ms(arrived_ms, months);
            for day in [1, 31, 92, 184, 275] {
                let now_ms = arrived_ms + day * 86_400_000;
                let due = store.retention().old_videos(VideoAge { now_ms, centre_months }).await.unwrap().0;
                let is_due = deleted_at_ms.is_some_and(|at_ms| at_ms < now_ms);
                assert_eq!(due, u64::from(is_due), "centre {centre_months}, own {own:?}, day {day}");
            }
        }
    }
}

#[tokio::test]
async fn the_access_log_forgets_old_entries_and_those_beyond_its_limit() {
    let bench = UpkeepFixture::new().await;
    let store = &bench.centre.store;
    let trainee = bench.centre.trainee("Ana").await.id;
    let session = bench.session(trainee, "a video").await.id;
    let person = bench.centre.person("root", Role::Administrator, None).await;
    let entry = |hour: i64| {
        let opened = AccessedRecordings::Session(session);
        let key = AccessKey { opened, person: person.id, role: Role::Administrator, token: None, hour };
        NewAccess { key, at_ms: hour * HOUR_MS, parts: 1 }
    };
    let log = store.access_log();
    log.write((0..10).map(entry).chain((0..10).map(entry)).collect()).await.unwrap();
    let hours = async || {
        let page = log.of_trainee(&Scope::service(), trainee, &PageRequest::default()).await.unwrap();
        page.items.iter().map(|entry| entry.at_ms / HOUR_MS).collect::<Vec<_>>()
    };
    assert_eq!(hours().await, [9, 8, 7, 6, 5, 4, 3, 2, 1, 0], "each hour has one entry");
    while log.forget(3 * HOUR_MS, 1_000).await.unwrap() {}
    assert_eq!(hours().await, [9, 8, 7, 6, 5, 4, 3]);
    while log.forget(0, 4).await.unwrap() {}
    assert_eq!(hours().await, [9, 8, 7, 6]);
}
