//! Which versions of a box's camera and colours a recording is tracked with.

use std::time::Duration;

use proptest::prelude::*;

use crate::domain::blob::Blob;
use crate::domain::calibration::NewCalibration;
use crate::domain::edit::EditChange;
use crate::domain::feed::FrameCodec;
use crate::domain::job::{JobInput, TrackInput};
use crate::domain::scope::Scope;
use crate::domain::session::{NewResult, NewSession, SessionStatus, Versions};
use crate::ids::{CalibrationId, FeedId, SessionId};
use crate::motion::PIPELINE_VERSION;
use crate::store::testing::{NOW_MS, TestCentre, duration};
use crate::store::{EditBasis, Lease, NewFeed, StoreError};
use crate::time::Clock;

const DAY_MS: i64 = 86_400_000;

impl TestCentre {
    async fn calibration(&self, valid_from_ms: Option<i64>) -> CalibrationId {
        let new = NewCalibration { valid_from_ms, ..Self::new_calibration() };
        self.store.calibrations().add(&Scope::service(), self.the_box.id, new).await.unwrap().id
    }

    async fn recorded_at(&self, content: &str, at_ms: i64) -> SessionId {
        let trainee = self.trainee(&format!("Trainee {content}")).await.id;
        let new = NewSession { recorded_at_ms: Some(at_ms), ..self.new_session(trainee, content) };
        self.store.sessions().create(&Scope::service(), new).await.unwrap().id
    }

    async fn claim_tracking(&self) -> (Lease, TrackInput) {
        let lease = self.claim().await.unwrap();
        let JobInput::Track(input) = lease.job.input.clone() else { panic!("{:?}", lease.job) };
        (lease, input)
    }

    /// Tracks the session that is next in the queue, with this duration.
    async fn track(&self, seconds: f64) -> CalibrationId {
        let (lease, input) = self.claim_tracking().await;
        let of_session = self.result(input.session).await;
        let versions = Versions {
            pipeline: PIPELINE_VERSION.to_owned(),
            calibration: Some(input.calibration),
            palette: Some(input.palette),
            ..of_session.versions
        };
        let result = NewResult { versions, features: vec![duration(seconds, 1.0)], ..of_session };
        self.store.jobs().finish_track(&lease, result).await.unwrap();
        input.calibration
    }

    async fn shown(&self, id: SessionId) -> f64 {
        let result = self.store.sessions().result(&Scope::service(), id).await.unwrap().unwrap();
        *result.features[0].value.as_ref().unwrap()
    }
}

#[tokio::test]
async fn a_recording_is_tracked_with_the_camera_and_colours_of_its_day() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (first_camera, first_colours) = (centre.in_use_camera().await, centre.in_use_colours().await);
    centre.clock.advance(Duration::from_millis(10 * DAY_MS.unsigned_abs()));
    centre.calibration(None).await;
    centre.give_colours().await;
    let (new_camera, new_colours) = (centre.in_use_camera().await, centre.in_use_colours().await);
    assert!(first_camera != new_camera && first_colours != new_colours);
    for (content, at_ms, camera, colours) in [
        ("before the box was set up", NOW_MS - DAY_MS, first_camera, first_colours),
        ("on the first day", NOW_MS + 1, first_camera, first_colours),
        ("before the camera was moved", NOW_MS + 10 * DAY_MS - 1, first_camera, first_colours),
        ("since then", NOW_MS + 10 * DAY_MS, new_camera, new_colours),
        ("by a clock that is ahead", NOW_MS + 11 * DAY_MS, new_camera, new_colours),
    ] {
        let id = centre.recorded_at(content, at_ms).await;
        let (_, input) = centre.claim_tracking().await;
        assert_eq!((input.session, input.calibration, input.palette), (id, camera, colours), "{content}");
    }
}

#[tokio::test]
async fn a_session_whose_camera_was_replaced_while_it_waited_is_tracked_again_with_the_right_one() {
    let centre = TestCentre::with_camera_and_colours().await;
    let first = centre.in_use_camera().await;
    let id = centre.recorded_at("clip", NOW_MS + DAY_MS).await;
    centre.clock.advance(Duration::from_secs(3600));
    let right = centre.calibration(Some(NOW_MS + DAY_MS)).await;
    assert_eq!(centre.track(10.0).await, first, "the job has begun with the camera of its day");
    let session = centre.store.sessions().get(&Scope::service(), id).await.unwrap();
    assert_eq!(session.status(), SessionStatus::Queued);
    assert_eq!(centre.track(11.0).await, right);
    assert_eq!(centre.shown(id).await, 11.0);
    assert!(centre.claim().await.is_none(), "once only");
}

#[tokio::test]
async fn a_camera_of_an_earlier_day_does_not_replace_the_one_in_use() {
    let centre = TestCentre::with_camera_and_colours().await;
    let in_use = centre.in_use_camera().await;
    let earlier = centre.calibration(Some(NOW_MS - 400 * DAY_MS)).await;
    assert_eq!(centre.in_use_camera().await, in_use);
    centre.recorded_at("old", NOW_MS - DAY_MS).await;
    assert_eq!(centre.claim_tracking().await.1.calibration, earlier);
    centre.recorded_at("older than all", NOW_MS - 500 * DAY_MS).await;
    assert_eq!(centre.claim_tracking().await.1.calibration, earlier);
    centre.recorded_at("new", NOW_MS).await;
    assert_eq!(centre.claim_tracking().await.1.calibration, in_use);
}

#[tokio::test]
async fn the_clock_beside_a_box_may_be_minutes_slow_after_a_calibration() {
    let centre = TestCentre::with_camera_and_colours().await;
    let first = centre.in_use_camera().await;
    centre.clock.advance(Duration::from_secs(3600));
    let new = centre.calibration(None).await;
    let trainee = centre.trainee("Ana").await.id;
    for (minutes_slow, expected) in [(3, new), (30, first)] {
        let new_feed = NewFeed {
            id: FeedId::at(NOW_MS),
            trainee,
            task: centre.task.id,
            in_box: centre.the_box.id,
            codec: FrameCodec::Jpeg,
            size: (640, 480),
            time_base: [1, 90_000].try_into().unwrap(),
            began_at_ms: centre.clock.now_ms() - minutes_slow * 60_000,
            sender: "an agent".to_owned(),
            is_push: false,
            resumes: true,
        };
        let feed = centre.store.feeds().open(&Scope::service(), new_feed, 9).await.unwrap();
        let video = Blob::of(format!("{minutes_slow}").as_bytes());
        let session = centre.store.feeds().end(feed.id, video, None, None).await.unwrap();
        let (_, input) = centre.claim_tracking().await;
        assert_eq!((input.session, input.calibration), (session, expected), "{minutes_slow} min");
    }
}

#[tokio::test]
async fn a_mended_camera_takes_the_place_of_the_wrong_one_and_gives_it_back() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (store, service, of) = (&centre.store, Scope::service(), centre.the_box.id);
    let wrong = centre.in_use_camera().await;
    let id = centre.recorded_at("clip", NOW_MS).await;
    assert_eq!(centre.track(40.0).await, wrong);
    centre.clock.advance(Duration::from_secs(600));
    let mended = centre.calibration(None).await;
    let versions = store.box_versions();
    let used = versions.of_session(&service, id).await.unwrap().unwrap().calibration;
    assert_eq!((used.version, used.is_later, used.valid_version), (1, false, None), "it was recorded before");
    let refused = store.sessions().retry(&service, id).await;
    assert!(matches!(refused, Err(StoreError::Refused { .. })), "{refused:?}");

    versions.set_calibration_valid_from(&service, (of, mended), Some(NOW_MS)).await.unwrap();
    let used = versions.of_session(&service, id).await.unwrap().unwrap().calibration;
    assert_eq!((used.version, used.valid_version), (1, Some(2)), "the result says that another version is valid");
    store.sessions().retry(&service, id).await.unwrap();
    assert_eq!((centre.track(50.0).await, centre.shown(id).await), (mended, 50.0));

    // Edited meanwhile, so the first result has to be scored again when it comes back.
    let trim = (EditChange::Trim([1.0, 2.0]), "Talked at first.".parse().unwrap());
    store.edits().add(&service, id, trim, EditBasis::default()).await.unwrap();
    let lease = centre.claim().await.unwrap();
    assert!(matches!(lease.job.input, JobInput::Rescore(_)), "{:?}", lease.job);
    versions.set_calibration_valid_from(&service, (of, mended), None).await.unwrap();
    store.sessions().retry(&service, id).await.unwrap();
    assert_eq!(centre.shown(id).await, 40.0, "the result with the first camera counts again, without tracking");
    let used = versions.of_session(&service, id).await.unwrap().unwrap().calibration;
    assert_eq!((used.version, used.valid_version), (1, None));
    let rescored = centre.claim().await.unwrap();
    let JobInput::Rescore(input) = &rescored.job.input else { panic!("{:?}", rescored.job) };
    let current = store.sessions().result(&service, id).await.unwrap().unwrap();
    assert_eq!(input.result, current.id);
    let refused = store.sessions().retry(&service, id).await;
    assert!(matches!(refused, Err(StoreError::Refused { .. })), "{refused:?}");
}

#[tokio::test]
async fn a_recording_that_failed_with_the_other_camera_has_its_result_again() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (store, service) = (&centre.store, Scope::service());
    let id = centre.recorded_at("clip", NOW_MS).await;
    centre.track(40.0).await;
    let other = centre.calibration(Some(NOW_MS)).await;
    store.sessions().retry(&service, id).await.unwrap();
    let (lease, _) = centre.claim_tracking().await;
    store.jobs().fail(&lease, crate::domain::problem::Problem::new("x", "x", "x")).await.unwrap();
    assert_eq!(store.sessions().get(&service, id).await.unwrap().status(), SessionStatus::Failed);
    let earlier = Some(NOW_MS - DAY_MS);
    store.box_versions().set_calibration_valid_from(&service, (centre.the_box.id, other), earlier).await.unwrap();
    assert_eq!(store.sessions().retry(&service, id).await.unwrap().status(), SessionStatus::Done);
    assert_eq!(centre.shown(id).await, 40.0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    /// Any versions and any recordings: the version that became valid last before the recording, the later one of two; else
    /// the one that became valid first.
    #[test]
    fn the_version_follows_the_rule(
        dates in proptest::collection::vec(0_i64..20, 1..6),
        recorded in proptest::collection::vec(0_i64..22, 1..8),
    ) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let centre = TestCentre::new().await;
            centre.give_colours().await;
            let mut versions = Vec::new();
            for (version, day) in dates.iter().enumerate() {
                versions.push((*day, version, centre.calibration(Some(NOW_MS - (30 - day) * DAY_MS)).await));
            }
            for (number, day) in recorded.iter().enumerate() {
                centre.recorded_at(&number.to_string(), NOW_MS - (30 - day) * DAY_MS).await;
                let tracked_with = centre.claim_tracking().await.1.calibration;
                let valid = versions.iter().filter(|(from, ..)| from <= day).max_by_key(|(from, version, _)| (*from, *version));
                let first = || versions.iter().min_by_key(|(from, version, _)| (*from, -(*version as i64))).unwrap();
                assert_eq!(tracked_with, valid.unwrap_or_else(first).2, "{dates:?} {day}");
            }
        });
    }
}

impl TestCentre {
    async fn in_use_camera(&self) -> CalibrationId {
        self.store.calibrations().in_use(&Scope::service(), self.the_box.id).await.unwrap().unwrap().id
    }

    async fn in_use_colours(&self) -> crate::ids::PaletteId {
        self.store.palettes().in_use(&Scope::service(), self.the_box.id).await.unwrap().unwrap().id
    }
}

#[tokio::test]
async fn a_recording_of_the_day_before_the_first_set_up_belongs_to_it() {
    let centre = TestCentre::with_camera_and_colours().await;
    let made_at = centre.clock.now_ms();
    for (hours, is_later) in [(23, false), (25, true)] {
        let id = centre.recorded_at(&format!("clip-{hours}"), made_at - hours * 3_600_000).await;
        centre.track(40.0).await;
        let used = centre.store.box_versions().of_session(&Scope::service(), id).await.unwrap().unwrap();
        assert_eq!((used.calibration.is_later, used.palette.is_later), (is_later, is_later), "{hours} h before");
    }
}
