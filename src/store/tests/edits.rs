//! Edits of sessions: which result is current in any order of events, and what no longer counts.

use std::time::Duration;

use serde_json::json;

use crate::domain::blob::Blob;
use crate::domain::clock::{ClockBasis, RecordingClock, TimeCorrection};
use crate::domain::comment::NewComment;
use crate::domain::edit::{EditChange, ScoreState};
use crate::domain::feature::FeatureKey;
use crate::domain::job::JobInput;
use crate::domain::problem::Problem;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::session::{BoxQuestion, FeatureSpace, NewResult, NewScore, NewSession, ResultClock, VideoFacts};
use crate::domain::text::Key;
use crate::ids::{SessionId, TraineeId};
use crate::motion::PIPELINE_VERSION;
use crate::motion::features::time::DURATION;
use crate::motion::quality::BoxAnswer;
use crate::rescoring;
use crate::store::testing::{NOW_MS, TestCentre, duration};
use crate::store::{EditBasis, EditRecord, Lease, PageRequest, SessionResult, StoreError};

const TRIM: EditChange = EditChange::Trim([2.0, 5.0]);

async fn add(centre: &TestCentre, session: SessionId, change: EditChange) -> Result<EditRecord, StoreError> {
    let why = "It began late.".parse().unwrap();
    centre.clock.advance(Duration::from_millis(1));
    centre.store.edits().add(&Scope::service(), session, (change, why), EditBasis::default()).await
}

async fn practised() -> (TestCentre, TraineeId, SessionId) {
    let centre = TestCentre::with_camera_and_colours().await;
    let ana = centre.trainee("Ana").await.id;
    let session = centre.practised(ana, NOW_MS, vec![duration(40.0, 1.0)]).await.id;
    (centre, ana, session)
}

/// Finishes the job with this duration and this revision of the edits.
async fn score(centre: &TestCentre, lease: &Lease, seconds: f64, edits: u64) {
    let JobInput::Rescore(input) = lease.job.input.clone() else { panic!("{:?}", lease.job) };
    centre.clock.advance(Duration::from_millis(1)); // the latest counts
    let score = NewScore {
        from: input.result,
        pipeline: PIPELINE_VERSION.to_owned(),
        tracked_with: Some("1".to_owned()),
        edits,
        features: vec![duration(seconds, 1.0)],
        evidence: Vec::new(),
        quality: json!({}),
    };
    centre.store.jobs().finish_rescore(lease, score).await.unwrap();
}

async fn current_result(centre: &TestCentre, session: SessionId) -> SessionResult {
    centre.store.sessions().result(&Scope::service(), session).await.unwrap().unwrap()
}

async fn score_state(centre: &TestCentre, session: SessionId) -> ScoreState {
    centre.store.edits().of_session(&Scope::service(), session).await.unwrap().score
}

#[tokio::test]
async fn each_edit_and_each_undoing_makes_one_result_and_the_last_counts() {
    let (centre, _, session) = practised().await;
    let edit = add(&centre, session, TRIM).await.unwrap();
    assert_eq!(score_state(&centre, session).await, ScoreState::Waiting);
    let lease = centre.claim().await.unwrap();
    assert_eq!(score_state(&centre, session).await, ScoreState::Working);
    let in_force = centre.store.edits().in_force(session).await.unwrap();
    assert_eq!((in_force.revision, in_force.changes), (1, vec![TRIM]));
    score(&centre, &lease, 3.0, 1).await;
    assert_eq!(
        (current_result(&centre, session).await.edits, score_state(&centre, session).await),
        (1, ScoreState::Current)
    );

    centre.store.edits().undo(&Scope::service(), session, edit.id).await.unwrap();
    centre.store.edits().undo(&Scope::service(), session, edit.id).await.unwrap();
    assert!(centre.store.edits().in_force(session).await.unwrap().changes.is_empty());
    score(&centre, &centre.claim().await.unwrap(), 40.0, 2).await;
    assert_eq!(current_result(&centre, session).await.edits, 2);
    assert_eq!((centre.store.count_results().await, centre.claim().await), (3, None), "undone once");
    let audit = centre.store.audit().list(&Scope::service(), &PageRequest::default()).await.unwrap().items;
    let noted =
        |action: &str, subject: String| audit.iter().filter(|e| e.action == action && e.subject == subject).count();
    assert_eq!((noted("trim", session.to_string()), noted("undo", edit.id.to_string())), (1, 1));
}

#[tokio::test]
async fn a_score_that_was_begun_before_an_edit_is_thrown_away_and_the_edits_own_follows() {
    let (centre, _, session) = practised().await;
    add(&centre, session, TRIM).await.unwrap();
    let stale = centre.claim().await.unwrap();
    add(&centre, session, EditChange::Trim([3.0, 5.0])).await.unwrap();
    score(&centre, &stale, 3.0, 1).await;
    assert_eq!((current_result(&centre, session).await.edits, centre.store.count_results().await), (0, 1));
    score(&centre, &centre.claim().await.unwrap(), 2.0, 2).await;
    assert_eq!(
        (current_result(&centre, session).await.edits, score_state(&centre, session).await),
        (2, ScoreState::Current)
    );
}

#[tokio::test]
async fn a_recording_that_is_tracked_again_keeps_its_edits_and_those_made_meanwhile() {
    let (centre, _, session) = practised().await;
    add(&centre, session, TRIM).await.unwrap();
    score(&centre, &centre.claim().await.unwrap(), 3.0, 1).await;
    centre.calibrate().await;
    centre.clock.advance(Duration::from_millis(1));
    centre.store.sessions().retry(&Scope::service(), session).await.unwrap();
    let refused = add(&centre, session, TRIM).await;
    assert!(matches!(refused, Err(StoreError::Refused { .. })), "while it is tracked: {refused:?}");
    // Its result is from before the trim, as if the trim had been made during the assessment.
    let lease = centre.claim().await.unwrap();
    centre.clock.advance(Duration::from_millis(1));
    centre.store.jobs().finish_track(&lease, centre.result(session).await).await.unwrap();
    assert_eq!(score_state(&centre, session).await, ScoreState::Waiting, "it is scored again by itself");
    score(&centre, &centre.claim().await.unwrap(), 3.0, 1).await;
    assert_eq!(
        (current_result(&centre, session).await.edits, score_state(&centre, session).await),
        (1, ScoreState::Current)
    );

    // A result with the present edits needs no further job.
    centre.calibrate().await;
    centre.clock.advance(Duration::from_millis(1));
    centre.store.sessions().retry(&Scope::service(), session).await.unwrap();
    let result = NewResult { edits: 1, ..centre.result(session).await };
    centre.store.jobs().finish_track(&centre.claim().await.unwrap(), result).await.unwrap();
    assert_eq!((score_state(&centre, session).await, centre.claim().await), (ScoreState::Current, None));
}

#[tokio::test]
async fn a_path_that_cannot_be_tracked_again_is_scored_with_the_edits_made_meanwhile() {
    let (centre, _, session) = practised().await;
    add(&centre, session, TRIM).await.unwrap();
    score(&centre, &centre.claim().await.unwrap(), 3.0, 1).await;
    centre.calibrate().await;
    centre.clock.advance(Duration::from_millis(1));
    centre.store.sessions().retry(&Scope::service(), session).await.unwrap();
    let lease = centre.claim().await.unwrap();
    // The camera is calibrated once more and the video is deleted, so the recording cannot be tracked with that camera.
    centre.clock.advance(Duration::from_millis(1));
    centre.calibrate().await;
    let drop_video = "UPDATE blob SET dropped_at_ms = 1 WHERE hash = (SELECT video FROM session WHERE id = $1)";
    centre
        .store
        .write(async move |tx| {
            sqlx::query(drop_video).bind(session).execute(tx).await?;
            Ok(())
        })
        .await
        .unwrap();
    centre.store.jobs().finish_track(&lease, centre.result(session).await).await.unwrap();
    assert_eq!(score_state(&centre, session).await, ScoreState::Waiting);
    score(&centre, &centre.claim().await.unwrap(), 3.0, 1).await;
    assert_eq!(score_state(&centre, session).await, ScoreState::Current);
}

const RETIME: EditChange = EditChange::Retime(TimeCorrection::FrameRate(60.0));

/// Finishes the tracking with this factor between stamps and times, and with this revision of the edits.
async fn track(centre: &TestCentre, session: SessionId, factor: f64, edits: u64) {
    let lease = centre.claim().await.unwrap();
    assert!(matches!(lease.job.input, JobInput::Track(_)), "{:?}", lease.job);
    centre.clock.advance(Duration::from_millis(1));
    let result = retimed(centre, session, factor, edits).await;
    centre.store.jobs().finish_track(&lease, result).await.unwrap();
}

async fn retimed(centre: &TestCentre, session: SessionId, factor: f64, edits: u64) -> NewResult {
    let result = centre.result(session).await;
    let applied = RecordingClock { basis: ClockBasis::FrameRate, factor, capture_rate_hz: None };
    let clock = ResultClock {
        applied,
        stamped_frame_rate_hz: Some(30.0),
        stamped_duration_s: 9.97,
        is_uneven: false,
        starts_at_s: 0.5,
    };
    NewResult { edits, video: VideoFacts { clock: Some(clock), ..result.video }, ..result }
}

#[tokio::test]
async fn corrected_times_are_tracked_again_and_edits_and_comments_keep_their_places() {
    let (centre, ana, session) = practised().await;
    let (service, edits) = (Scope::service(), centre.store.edits());
    add(&centre, session, TRIM).await.unwrap();
    score(&centre, &centre.claim().await.unwrap(), 3.0, 1).await;
    let own = centre.person("ana", Role::Trainee, Some(ana)).await.scope();
    let new: NewComment = serde_json::from_value(json!({"from_s": 4.0, "to_s": 6.0, "text": "Here."})).unwrap();
    centre.store.comments().add(&own, session, new, [4.0, 6.0]).await.unwrap();

    let edit = add(&centre, session, RETIME).await.unwrap();
    assert_eq!((edit.true_frame_rate_hz, edit.true_duration_s), (Some(60.0), None));
    assert_eq!(score_state(&centre, session).await, ScoreState::Waiting);
    assert_eq!(edits.in_force(session).await.unwrap().changes, [TRIM, RETIME], "in the shown times until then");
    track(&centre, session, 0.5, 2).await;
    assert_eq!((score_state(&centre, session).await, centre.claim().await), (ScoreState::Current, None));
    assert_eq!(edits.in_force(session).await.unwrap().changes, [EditChange::Trim([1.0, 2.5]), RETIME]);
    let comments = centre.store.comments().of_session(&own, session).await.unwrap().items;
    assert_eq!((comments[0].from_s, comments[0].to_s), (2.0, 3.0));
    let clock = current_result(&centre, session).await.video.clock.unwrap();
    assert_eq!((clock.applied.factor, clock.stamped_frame_rate_hz), (0.5, Some(30.0)));

    // A score of the new path keeps its clock.
    let trim = add(&centre, session, EditChange::Trim([1.5, 2.5])).await.unwrap();
    score(&centre, &centre.claim().await.unwrap(), 1.0, 3).await;
    assert_eq!(current_result(&centre, session).await.video.clock, Some(clock));
    edits.undo(&service, session, trim.id).await.unwrap();
    score(&centre, &centre.claim().await.unwrap(), 1.0, 4).await;

    edits.undo(&service, session, edit.id).await.unwrap();
    track(&centre, session, 1.0, 5).await;
    assert_eq!((score_state(&centre, session).await, centre.claim().await), (ScoreState::Current, None));
    assert_eq!(edits.in_force(session).await.unwrap().changes, [TRIM]);
    let audit = centre.store.audit().list(&service, &PageRequest::default()).await.unwrap().items;
    assert!(audit.iter().any(|entry| entry.action == "retime" && entry.subject == session.to_string()));
}

#[tokio::test]
async fn an_edit_that_was_checked_on_a_path_with_other_times_is_refused() {
    let (centre, _, session) = practised().await;
    let (service, edits) = (Scope::service(), centre.store.edits());
    add(&centre, session, RETIME).await.unwrap();
    let basis = async || {
        let (result, in_force) = centre.store.sessions().result_with_edits(&service, session).await.unwrap().unwrap();
        EditBasis { revision: Some(in_force.revision), path: Some(result.trajectory) }
    };
    let stale = basis().await;
    let lease = centre.claim().await.unwrap();
    centre.clock.advance(Duration::from_millis(1));
    let path = Blob::of(b"a path with other times");
    let result = NewResult { trajectory: path, ..retimed(&centre, session, 0.5, 1).await };
    centre.store.jobs().finish_track(&lease, result).await.unwrap();
    let why = || "It began late.".parse().unwrap();
    let refused = edits.add(&service, session, (TRIM, why()), stale).await.unwrap_err();
    assert!(refused.to_string().contains("tracked again"), "{refused}");

    let fresh = basis().await;
    assert_eq!((fresh.revision, fresh.path), (stale.revision, Some(path.hash)), "the revision alone shows nothing");
    edits.add(&service, session, (TRIM, why()), fresh).await.unwrap();
    score(&centre, &centre.claim().await.unwrap(), 3.0, 2).await;
    let after_score = EditBasis { revision: Some(2), ..fresh };
    edits.add(&service, session, (EditChange::Trim([3.0, 5.0]), why()), after_score).await.unwrap();
}

#[tokio::test]
async fn after_a_failed_correction_an_edit_tracks_again_and_never_scores_the_path_with_the_old_times() {
    let (centre, _, session) = practised().await;
    add(&centre, session, RETIME).await.unwrap();
    let lease = centre.claim().await.unwrap();
    centre.store.jobs().fail(&lease, Problem::new("child-killed", "Title", "because")).await.unwrap();
    add(&centre, session, TRIM).await.unwrap();
    assert_eq!(score_state(&centre, session).await, ScoreState::Waiting);
    track(&centre, session, 0.5, 2).await;
    assert_eq!((score_state(&centre, session).await, centre.claim().await), (ScoreState::Current, None));
    let kept = centre.store.edits().in_force(session).await.unwrap().changes;
    assert!(kept.contains(&EditChange::Trim([1.0, 2.5])), "{kept:?}");
}

#[tokio::test]
async fn a_result_that_exists_moves_no_edit_and_one_with_other_times_is_another_result() {
    let (centre, _, session) = practised().await;
    add(&centre, session, TRIM).await.unwrap();
    score(&centre, &centre.claim().await.unwrap(), 3.0, 1).await;
    let edit = add(&centre, session, RETIME).await.unwrap();
    track(&centre, session, 0.5, 2).await;
    assert_eq!(centre.store.count_results().await, 3);
    centre.store.edits().undo(&Scope::service(), session, edit.id).await.unwrap();
    track(&centre, session, 1.0, 2).await; // states the edits of the result before it, whose times are others
    assert_eq!(centre.store.count_results().await, 4);
    assert_eq!(centre.store.edits().in_force(session).await.unwrap().changes, [TRIM]);

    score(&centre, &centre.claim().await.unwrap(), 3.0, 3).await;
    let same = retimed(&centre, session, 0.5, 2).await;
    centre.calibrate().await;
    centre.store.sessions().retry(&Scope::service(), session).await.unwrap();
    centre.store.jobs().finish_track(&centre.claim().await.unwrap(), same).await.unwrap();
    assert_eq!(centre.store.count_results().await, 5, "the same versions, edits and times");
    assert_eq!(centre.store.edits().in_force(session).await.unwrap().changes, [TRIM]);
}

#[tokio::test]
async fn a_path_with_times_from_before_a_correction_is_thrown_away() {
    let (centre, _, session) = practised().await;
    centre.calibrate().await;
    centre.clock.advance(Duration::from_millis(1));
    let order = serde_json::from_value(json!({"which": "all", "from": "recording"})).unwrap();
    centre.store.rescorings().create(&Scope::service(), centre.task.id, order).await.unwrap();
    rescoring::run_once(&centre.store, 1).await.unwrap();
    let stale = centre.claim().await.unwrap();
    assert!(matches!(stale.job.input, JobInput::Track(_)), "{:?}", stale.job);
    add(&centre, session, RETIME).await.unwrap();
    let result = retimed(&centre, session, 1.0, 1).await;
    centre.store.jobs().finish_track(&stale, result).await.unwrap();
    assert_eq!(centre.store.count_results().await, 1, "the times of the stale path are wrong");
    track(&centre, session, 0.5, 1).await;
    assert_eq!(
        (score_state(&centre, session).await, current_result(&centre, session).await.edits),
        (ScoreState::Current, 1)
    );
}

#[tokio::test]
async fn a_correction_that_does_not_fit_can_be_replaced_although_nothing_was_scored() {
    let centre = TestCentre::with_camera_and_colours().await;
    let ana = centre.trainee("Ana").await.id;
    let new = NewSession { time: Some(TimeCorrection::Duration(9_000.0)), ..centre.new_session(ana, "clip") };
    let session = centre.store.sessions().create(&Scope::service(), new).await.unwrap().id;
    let queued = add(&centre, session, RETIME).await;
    assert!(matches!(queued, Err(StoreError::Refused { .. })), "while it waits: {queued:?}");
    let lease = centre.claim().await.unwrap();
    centre.store.jobs().fail(&lease, Problem::new("impossible-time", "Title", "because")).await.unwrap();
    assert!(add(&centre, session, TRIM).await.is_err(), "there is no path");
    add(&centre, session, RETIME).await.unwrap();
    track(&centre, session, 0.5, 2).await;
    assert_eq!(current_result(&centre, session).await.edits, 2);
}

#[tokio::test]
async fn work_that_fails_says_so_and_the_old_score_stays() {
    let (centre, _, session) = practised().await;
    add(&centre, session, TRIM).await.unwrap();
    let lease = centre.claim().await.unwrap();
    centre.store.jobs().fail(&lease, Problem::new("input-gone", "Gone", "because")).await.unwrap();
    let edits = centre.store.edits().of_session(&Scope::service(), session).await.unwrap();
    assert_eq!((edits.score, edits.job), (ScoreState::Failed, Some(lease.job.id)));
    assert_eq!(edits.problem.unwrap().slug, "input-gone");
    let seen = centre.store.sessions().get(&Scope::service(), session).await.unwrap();
    assert_eq!((seen.status().name(), current_result(&centre, session).await.edits), ("done", 0));
}

#[tokio::test]
async fn two_people_who_edit_at_once_notice_each_other() {
    let seen = |revision| EditBasis { revision: Some(revision), path: None };
    let (centre, _, session) = practised().await;
    let (edits, service) = (centre.store.edits(), Scope::service());
    let why = || "Why.".parse().unwrap();
    edits.add(&service, session, (TRIM, why()), seen(0)).await.unwrap();
    let late = edits.add(&service, session, (TRIM, why()), seen(0)).await;
    assert!(matches!(late, Err(StoreError::Refused { .. })), "{late:?}");
    edits.add(&service, session, (EditChange::SetAside, why()), seen(0)).await.unwrap();
    edits.add(&service, session, (TRIM, why()), seen(1)).await.unwrap();
}

#[tokio::test]
async fn what_is_set_aside_is_in_no_cohort_no_model_and_no_practice_that_counts() {
    let (centre, ana, first) = practised().await;
    let second = centre.practised(ana, NOW_MS + 1, vec![duration(90.0, 1.0)]).await.id;
    let service = Scope::service();
    let new = serde_json::from_value(json!({"name": "Listed", "members": [ana]})).unwrap();
    let cohort = centre.store.cohorts().create(&service, new).await.unwrap();
    let key = FeatureKey::of_session(&DURATION, FeatureSpace::Space3d);
    let values = async || {
        let rows =
            centre.store.cohorts().values(cohort.id, centre.task.id, 1, std::slice::from_ref(&key)).await.unwrap();
        rows.iter().map(|row| row.value).collect::<Vec<f64>>()
    };
    let level = serde_json::from_value(json!({"level": "novice"})).unwrap();
    centre.store.trainees().change(&service, &Key::from(&ana), level).await.unwrap();
    let declared = async || centre.store.skill_models().declared(centre.task.id, "1", 9, 9).await.unwrap().len();
    assert_eq!((values().await, declared().await), (vec![90.0], 2));
    let edit = add(&centre, second, EditChange::SetAside).await.unwrap();
    assert_eq!((values().await, declared().await), (vec![40.0], 1), "the last one that counts");
    let practice = centre.store.sessions().practice(&service, ana, centre.task.id, &[&DURATION], 9).await.unwrap();
    let shown: Vec<(SessionId, bool)> = practice.sessions.iter().map(|one| (one.id, one.is_uncounted)).collect();
    assert_eq!(shown, [(first, false), (second, true)]);
    let rated = centre.store.ratings().values(&service, &[first, second]).await.unwrap();
    assert!(rated.iter().all(|value| value.session == first) && !rated.is_empty());
    centre.store.edits().undo(&service, second, edit.id).await.unwrap();
    assert_eq!((values().await, declared().await), (vec![90.0], 2));
    assert_eq!(centre.claim().await, None, "no score depends on it");
}

#[tokio::test]
async fn trainees_see_only_their_own_edits_and_make_none() {
    let (centre, ana, session) = practised().await;
    let eve = centre.trainee("Eve").await;
    let own = centre.person("ana", Role::Trainee, Some(ana)).await.scope();
    let other = centre.person("eve", Role::Trainee, Some(eve.id)).await.scope();
    let teacher = centre.person("ines", Role::Instructor, None).await;
    let edit = add(&centre, session, TRIM).await.unwrap();
    let edits = centre.store.edits();
    assert_eq!(edits.of_session(&own, session).await.unwrap().items, std::slice::from_ref(&edit));
    let refused = edits.undo(&own, session, edit.id).await;
    assert!(matches!(refused, Err(StoreError::Forbidden { .. })));
    for scope in [other, teacher.scope()] {
        assert!(matches!(edits.of_session(&scope, session).await, Err(StoreError::NotFound { .. })));
        assert!(matches!(edits.undo(&scope, session, edit.id).await, Err(StoreError::NotFound { .. })));
        let made = edits.add(&scope, session, (TRIM, "Why.".parse().unwrap()), EditBasis::default()).await;
        assert!(matches!(made, Err(StoreError::NotFound { .. })));
    }
    centre.store.sessions().erase(&Scope::service(), session).await.unwrap();
    assert_eq!(centre.store.check().await.unwrap(), Vec::<String>::new(), "erased with its session");
}

#[tokio::test]
async fn a_session_that_may_show_another_box_counts_only_after_the_answer_that_it_is_this_one() {
    let (centre, ana, first) = practised().await;
    let second = centre.session(ana, "a recording of another box").await.id;
    let lease = centre.claim().await.unwrap();
    let quality = json!({"verdict": "usable_with_care", "recording": {"box": {"finding": "doubtful"}}});
    let result = NewResult { quality, features: vec![duration(90.0, 1.0)], ..centre.result(second).await };
    centre.store.jobs().finish_track(&lease, result).await.unwrap();
    let service = Scope::service();
    let new = serde_json::from_value(json!({"name": "Listed", "members": [ana]})).unwrap();
    let cohort = centre.store.cohorts().create(&service, new).await.unwrap();
    let key = FeatureKey::of_session(&DURATION, FeatureSpace::Space3d);
    let found = async || {
        let rows =
            centre.store.cohorts().values(cohort.id, centre.task.id, 9, std::slice::from_ref(&key)).await.unwrap();
        let practice = centre.store.sessions().practice(&service, ana, centre.task.id, &[], 9).await.unwrap();
        let counted = practice.sessions.iter().filter(|one| !one.is_uncounted).count();
        let rated = centre.store.ratings().values(&service, &[first, second]).await.unwrap();
        let question = centre.store.sessions().get(&service, second).await.unwrap().box_question;
        let asked = centre.store.sessions().box_asked(&service, 9).await.unwrap().len();
        (question, [rows.len(), counted, rated.len(), asked])
    };
    assert_eq!(found().await, (Some(BoxQuestion::Asked), [1, 1, 1, 1]));
    let other = add(&centre, second, EditChange::OtherBox).await.unwrap();
    assert_eq!(found().await, (Some(BoxQuestion::OtherBox), [1, 1, 1, 0]));
    let twice = add(&centre, second, EditChange::ThisBox).await.unwrap_err();
    assert!(twice.to_string().contains("answered already"), "{twice}");
    centre.store.edits().undo(&service, second, other.id).await.unwrap();
    assert_eq!(found().await, (Some(BoxQuestion::Asked), [1, 1, 1, 1]));
    add(&centre, second, EditChange::ThisBox).await.unwrap();
    assert_eq!(found().await, (Some(BoxQuestion::ThisBox), [2, 2, 2, 0]));
    let in_force = centre.store.edits().in_force(second).await.unwrap();
    assert_eq!((in_force.revision, in_force.changes), (3, vec![]), "an answer changes the verdict, not the path");
    assert_eq!(in_force.box_answer, Some(BoxAnswer::ThisBox));
    let audit = centre.store.audit().list(&service, &PageRequest::default()).await.unwrap().items;
    for action in ["other_box", "undo", "this_box"] {
        assert!(audit.iter().any(|entry| entry.action == action), "{action}");
    }
}
