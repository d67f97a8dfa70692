//! The flow of a recording from the upload to the score.

use std::time::Duration;

use crate::domain::blob::Blob;
use crate::domain::calibration::NewCalibration;
use crate::domain::clock::TimeCorrection;
use crate::domain::edit::EditChange;
use crate::domain::job::JobInput;
use crate::domain::scope::Scope;
use crate::domain::session::{NewResult, SessionStatus};
use crate::ids::UploadId;
use crate::motion::features::path::PATH_LENGTH;
use crate::store::testing::{LEASE, NOW_MS, TestCentre, duration};
use crate::store::{FinishedUpload, NewUpload, StoreError};

#[tokio::test]
async fn an_upload_becomes_a_session_that_is_tracked_and_scored() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (store, service) = (&centre.store, Scope::service());
    let trainee = centre.trainee("Ana").await;
    let new = NewUpload {
        id: UploadId::at(NOW_MS),
        trainee: trainee.id,
        task: centre.task.id,
        in_box: centre.the_box.id,
        filename: "clip.mp4".parse().unwrap(),
        metadata: "filename Y2xpcC5tcDQ=".to_owned(),
        recorded_at_ms: Some(NOW_MS - 60_000),
        time: Some(TimeCorrection::FrameRate(16.4)),
        length: 5,
        expires_at_ms: NOW_MS + 1_000,
    };
    let upload = store.uploads().create(&service, new, 9).await.unwrap();
    let uploads = store.uploads();
    let finish = || uploads.finish(&service, upload.id, Blob::of(b"video"), "video/mp4".to_owned());
    let early = finish().await;
    assert!(matches!(early, Err(StoreError::Refused { .. })), "{early:?}");
    store.uploads().advance(upload.id, 5, NOW_MS + 2_000).await.unwrap();
    let first = finish().await.unwrap();
    let FinishedUpload { session: id, is_new: true, is_duplicate: false } = first else { panic!("{first:?}") };
    assert_eq!(finish().await.unwrap(), FinishedUpload { is_new: false, ..first }, "its own session is no duplicate");

    let session = store.sessions().get(&service, id).await.unwrap();
    assert_eq!((session.status(), session.queue_position), (SessionStatus::Queued, Some(1)));
    assert_eq!((session.video_blob().unwrap().bytes, session.recorded_at_ms), (5, NOW_MS - 60_000));
    let lease = centre.claim().await.unwrap();
    let JobInput::Track(input) = &lease.job.input else { panic!("{:?}", lease.job) };
    let given = TimeCorrection::FrameRate(16.4);
    assert_eq!((input.time, input.time_revision), (Some(given), 1));
    assert_eq!(store.edits().in_force(id).await.unwrap().changes, [EditChange::Retime(given)]);
    store.jobs().heartbeat(&lease, 0.5, LEASE).await.unwrap();
    let session = store.sessions().get(&service, id).await.unwrap();
    assert_eq!((session.status(), session.job_progress), (SessionStatus::Tracking, Some(0.5)));

    let result = NewResult { edits: 1, ..centre.result(id).await };
    store.jobs().finish_track(&lease, result.clone()).await.unwrap();
    let session = store.sessions().get(&service, id).await.unwrap();
    assert_eq!(session.status(), SessionStatus::Done);
    let stored = store.sessions().result(&service, id).await.unwrap().unwrap();
    assert_eq!((&stored.features, &stored.versions), (&result.features, &result.versions));
    assert_eq!((stored.video, &stored.quality), (result.video, &result.quality));
    let practice = store.sessions().practice(&service, trainee.id, centre.task.id, &[&PATH_LENGTH], 10).await.unwrap();
    let [practised] = &practice.sessions[..] else { panic!("{practice:?}") };
    assert_eq!((practised.id, practised.status, practice.earlier), (session.id, SessionStatus::Done, 0));
    let [measured] = &practised.measured[..] else { panic!("only what was asked for: {practised:?}") };
    assert_eq!(
        (measured.value, measured.bar),
        (Some(123.456_789_012_345), Some([121.456_789_012_345, 125.456_789_012_345]))
    );
    assert_eq!(practised.result.as_ref().map(|outcome| outcome.refused), Some(false));
    assert_eq!(store.sessions().last_task(&service, trainee.id).await.unwrap(), Some(centre.task.id));
}

#[tokio::test]
async fn a_recording_that_comes_before_camera_and_colours_waits_and_says_for_what() {
    let centre = TestCentre::new().await;
    let service = Scope::service();
    let session = centre.session(centre.trainee("Ana").await.id, "video").await;
    assert_eq!(session.status(), SessionStatus::Queued);
    assert!(session.problem().unwrap().detail.contains("camera was not measured yet, and its tool colours"));
    centre.calibrate().await;
    let session = centre.store.sessions().get(&service, session.id).await.unwrap();
    assert!(session.problem().unwrap().detail.contains("Its tool colours were not marked yet"));
    centre.give_colours().await;
    let session = centre.store.sessions().get(&service, session.id).await.unwrap();
    assert_eq!((session.queue_position, session.problem()), (Some(1), None));
}

#[tokio::test]
async fn the_same_recording_twice_names_the_session_that_has_it() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (ana, ben) = (centre.trainee("Ana").await, centre.trainee("Ben").await);
    let first = centre.session(ana.id, "video").await;
    let twice = centre.store.sessions().create(&Scope::service(), centre.new_session(ana.id, "video")).await;
    let Err(StoreError::Taken { what: "recording", existing }) = twice else { panic!("{twice:?}") };
    assert_eq!(existing, Some(first.id.to_string()));
    centre.session(ben.id, "video").await; // another trainee may have the same file
}

#[tokio::test]
async fn the_result_that_was_stored_last_counts_although_the_clock_was_set_back() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (sessions, service) = (centre.store.sessions(), Scope::service());
    let trainee = centre.trainee("Ana").await;
    let id = centre.practised(trainee.id, NOW_MS, vec![duration(40.0, 1.0)]).await.id;
    centre.clock.set_back(Duration::from_secs(86_400));
    // Another camera of that moment: the session may be tracked again.
    let other = NewCalibration { valid_from_ms: Some(NOW_MS), ..TestCentre::new_calibration() };
    centre.store.calibrations().add(&service, centre.the_box.id, other).await.unwrap();
    assert_eq!(sessions.retry(&service, id).await.unwrap().status(), SessionStatus::Queued);
    let lease = centre.claim().await.unwrap();
    let result = NewResult { features: vec![duration(60.0, 1.0)], ..centre.result(id).await };
    centre.store.jobs().finish_track(&lease, result).await.unwrap();
    assert_eq!(sessions.get(&service, id).await.unwrap().status(), SessionStatus::Done);
    let current = sessions.result(&service, id).await.unwrap().unwrap();
    assert_eq!(current.features[0].value, Ok(60.0));
    assert_eq!(sessions.results(&service, id, 10).await.unwrap()[0].id, current.id, "newest first");
}
