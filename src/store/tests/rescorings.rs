//! Rescoring orders: which sessions they include, how their jobs are queued, and when they end.

use crate::domain::problem::Problem;
use crate::domain::rescoring::{NewRescoring, RescoringSelection, RescoringSource};
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::session::{ForeignPath, NewScore, NewSession};
use crate::ids::SessionId;
use crate::motion::PIPELINE_VERSION;
use crate::rescoring;
use crate::store::testing::{NOW_MS, TestCentre, duration};
use crate::store::{Lease, PageRequest, StoreError};

const OLDER: NewRescoring = NewRescoring { from: RescoringSource::Trajectory, which: RescoringSelection::Older };

/// A centre with `sessions` sessions, scored by version 1.
async fn practised(sessions: i64) -> TestCentre {
    let centre = TestCentre::with_camera_and_colours().await;
    let ana = centre.trainee("Ana").await.id;
    for number in 0..sessions {
        centre.practised(ana, NOW_MS + number, vec![duration(40.0 + number as f64, 1.0)]).await;
    }
    centre
}

async fn score(centre: &TestCentre, lease: &Lease, seconds: f64) {
    let crate::domain::job::JobInput::Rescore(input) = lease.job.input.clone() else { panic!("{:?}", lease.job) };
    let score = NewScore {
        from: input.result,
        pipeline: PIPELINE_VERSION.to_owned(),
        tracked_with: Some("1".to_owned()),
        edits: input.edits,
        features: vec![duration(seconds, 1.0)],
        evidence: Vec::new(),
        quality: serde_json::json!({}),
    };
    centre.store.jobs().finish_rescore(lease, score).await.unwrap();
}

#[tokio::test]
async fn an_order_never_has_more_jobs_in_the_queue_than_allowed() {
    let centre = practised(5).await;
    let (rescorings, service) = (centre.store.rescorings(), Scope::service());
    let id = rescorings.create(&service, centre.task.id, OLDER).await.unwrap();
    for _ in 0..3 {
        rescoring::run_once(&centre.store, 2).await.unwrap();
        assert_eq!(centre.store.jobs().counts().await.unwrap().queued, 2, "after every round");
    }
    for left in [4, 3, 2, 1, 0] {
        let lease = centre.claim().await.unwrap();
        score(&centre, &lease, 100.0).await;
        rescoring::run_once(&centre.store, 2).await.unwrap();
        let counts = rescorings.get(&service, id).await.unwrap();
        assert_eq!(counts.waiting + counts.working, left);
    }
    let ended = rescorings.get(&service, id).await.unwrap();
    assert_eq!((ended.done, ended.apart, ended.changed), (5, 5, 5));
    assert!(ended.ended_at_ms.is_some() && centre.claim().await.is_none());
    assert_eq!(centre.store.count_results().await, 10, "old results stay");
}

#[tokio::test]
async fn a_new_session_goes_before_older_rescoring_jobs() {
    let centre = practised(3).await;
    centre.store.rescorings().create(&Scope::service(), centre.task.id, OLDER).await.unwrap();
    rescoring::run_once(&centre.store, 3).await.unwrap();
    centre.clock.advance(std::time::Duration::from_secs(60));
    let new = centre.session(centre.trainee("Bea").await.id, "new").await;
    assert_eq!(centre.claim().await.unwrap().job.session_id, Some(new.id));
}

#[tokio::test]
async fn a_newer_result_is_not_replaced_by_scoring_the_old_path_again() {
    let centre = practised(1).await;
    let (service, sessions) = (Scope::service(), centre.store.sessions());
    let id = centre.store.rescorings().create(&service, centre.task.id, OLDER).await.unwrap();
    rescoring::run_once(&centre.store, 1).await.unwrap();
    let stale = centre.claim().await.unwrap();
    let session: SessionId = stale.job.session_id.unwrap();
    centre.calibrate().await;
    sessions.retry(&service, session).await.unwrap();
    let lease = centre.claim().await.unwrap();
    centre.clock.advance(std::time::Duration::from_millis(1));
    centre.store.jobs().finish_track(&lease, centre.result(session).await).await.unwrap();
    let tracked = sessions.result(&service, session).await.unwrap().unwrap().id;
    score(&centre, &stale, 100.0).await;
    assert_eq!(sessions.result(&service, session).await.unwrap().unwrap().id, tracked);
    assert_eq!(centre.store.count_results().await, 2);
    rescoring::run_once(&centre.store, 1).await.unwrap();
    let page = centre.store.rescorings().items(&service, id, &PageRequest::default()).await.unwrap();
    assert_eq!(page.items[0].new_result_id, Some(tracked), "what counts now is what is compared");
}

#[tokio::test]
async fn orders_without_permission_or_without_sessions_are_refused() {
    let centre = practised(1).await;
    let instructor = centre.person("ines", Role::Instructor, None).await.scope();
    let (rescorings, service) = (centre.store.rescorings(), Scope::service());
    let refused = rescorings.create(&instructor, centre.task.id, OLDER).await;
    assert!(matches!(refused, Err(StoreError::Forbidden { .. })));
    let id = rescorings.create(&service, centre.task.id, OLDER).await.unwrap();
    assert!(matches!(rescorings.get(&instructor, id).await, Err(StoreError::Forbidden { .. })));
    let second = rescorings.create(&service, centre.task.id, OLDER).await;
    assert!(matches!(second, Err(StoreError::Refused { .. })), "one at a time");
    rescoring::run_once(&centre.store, 1).await.unwrap();
    score(&centre, &centre.claim().await.unwrap(), 40.0).await;
    rescoring::run_once(&centre.store, 1).await.unwrap();
    let nothing = rescorings.create(&service, centre.task.id, OLDER).await;
    assert!(matches!(nothing, Err(StoreError::Refused { .. })), "nothing is older");
    rescorings
        .create(&service, centre.task.id, NewRescoring { which: RescoringSelection::All, ..OLDER })
        .await
        .unwrap();
}

#[tokio::test]
async fn rows_of_another_tracker_are_a_version_of_their_own_and_never_tracked() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (service, trainee) = (Scope::service(), centre.trainee("Ana").await.id);
    let new = NewSession { media_type: "text/csv".to_owned(), ..centre.new_session(trainee, "rows") };
    let path = ForeignPath { tracker: "Kinovea".parse().unwrap(), hash: new.video.hash };
    let session = centre.store.sessions().import(&service, new, path).await.unwrap();
    let lease = centre.claim().await.unwrap();
    assert_eq!(lease.job.kind.name(), "import");
    let mut result = centre.result(session.id).await;
    result.versions.pipeline = crate::domain::session::imported_pipeline_version(&"Kinovea".parse().unwrap());
    (result.versions.calibration, result.versions.palette, result.diagnostics) = (None, None, None);
    centre.store.jobs().finish_track(&lease, result).await.unwrap();
    assert_eq!(
        centre.store.ratings().values(&service, &[session.id]).await.unwrap(),
        [],
        "imported sessions are not correlated"
    );
    let rescorings = centre.store.rescorings();
    assert!(rescorings.create(&service, centre.task.id, OLDER).await.is_err(), "it is of the present version");
    let from_recording = NewRescoring { from: RescoringSource::Recording, which: RescoringSelection::All };
    assert!(rescorings.create(&service, centre.task.id, from_recording).await.is_err(), "there is no recording");
    let again = NewRescoring { which: RescoringSelection::All, ..OLDER };
    rescorings.create(&service, centre.task.id, again).await.unwrap();
    assert_eq!(centre.store.check().await.unwrap(), Vec::<String>::new());
}

#[tokio::test]
async fn an_item_whose_work_failed_keeps_the_reason_and_the_order_ends() {
    let centre = practised(1).await;
    let (rescorings, service) = (centre.store.rescorings(), Scope::service());
    let id = rescorings.create(&service, centre.task.id, OLDER).await.unwrap();
    rescoring::run_once(&centre.store, 1).await.unwrap();
    let lease = centre.claim().await.unwrap();
    centre.store.jobs().fail(&lease, Problem::new("path-alone", "No", "because")).await.unwrap();
    rescoring::run_once(&centre.store, 1).await.unwrap();
    let ended = rescorings.get(&service, id).await.unwrap();
    assert_eq!((ended.failed, ended.ended_at_ms.is_some()), (1, true));
    let page = rescorings.items(&service, id, &PageRequest::default()).await.unwrap();
    assert_eq!(page.items[0].problem.as_ref().unwrap().slug, "path-alone");
    let session = centre.store.sessions().get(&service, page.items[0].session_id).await.unwrap();
    assert_eq!(session.status().name(), "done", "the session's own job determines its status");
}

#[tokio::test]
async fn an_unreadable_result_blocks_only_its_own_comparison() {
    let centre = practised(2).await;
    let (rescorings, service) = (centre.store.rescorings(), Scope::service());
    let id = rescorings.create(&service, centre.task.id, OLDER).await.unwrap();
    rescoring::run_once(&centre.store, 2).await.unwrap();
    for _ in 0..2 {
        let lease = centre.claim().await.unwrap();
        score(&centre, &lease, 100.0).await;
    }
    let damage = "UPDATE result SET tools = '7' WHERE id = (SELECT min(id) FROM result)";
    centre.store.write(async move |tx| Ok(sqlx::query(damage).execute(&mut *tx).await?)).await.unwrap();
    rescoring::run_once(&centre.store, 2).await.unwrap();
    let ended = rescorings.get(&service, id).await.unwrap();
    assert_eq!((ended.done, ended.failed, ended.ended_at_ms.is_some()), (1, 1, true));
    let page = rescorings.items(&service, id, &PageRequest::default()).await.unwrap();
    let problems: Vec<_> = page.items.iter().filter_map(|item| item.problem.as_ref()).collect();
    assert!(problems.len() == 1 && problems[0].slug == "not-compared", "{problems:?}");
    assert_eq!(centre.store.count_results().await, 4, "the new scores stand");
}

#[tokio::test]
async fn a_recording_that_cannot_be_tracked_again_leaves_the_session_as_it_was_until_a_person_asks() {
    let centre = practised(1).await;
    let (rescorings, service) = (centre.store.rescorings(), Scope::service());
    centre.calibrate().await; // a newer camera
    centre.clock.advance(std::time::Duration::from_millis(1)); // the latest job determines the status
    let from_recording = NewRescoring { from: RescoringSource::Recording, which: RescoringSelection::All };
    let id = rescorings.create(&service, centre.task.id, from_recording).await.unwrap();
    rescoring::run_once(&centre.store, 1).await.unwrap();
    let session = rescorings.items(&service, id, &PageRequest::default()).await.unwrap().items[0].session_id;
    let status = async || centre.store.sessions().get(&service, session).await.unwrap().status().name();
    let lease = centre.claim().await.unwrap();
    assert_eq!((lease.job.kind.name(), status().await), ("track", "done"), "under way");
    centre.store.jobs().fail(&lease, Problem::new("other-size", "No", "because")).await.unwrap();
    rescoring::run_once(&centre.store, 1).await.unwrap();
    assert_eq!(rescorings.get(&service, id).await.unwrap().failed, 1);
    assert_eq!(status().await, "done", "its result is there, and counts");
    rescorings
        .create(&service, centre.task.id, NewRescoring { which: RescoringSelection::All, ..OLDER })
        .await
        .unwrap();

    centre.store.jobs().retry(&service, lease.job.id).await.unwrap();
    assert_eq!(status().await, "queued", "a person asked for it");
}
