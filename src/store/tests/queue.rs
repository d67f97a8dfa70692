//! The queue stays fast at any length: frequent queries are answered from an index.

use std::collections::HashSet;
use std::time::{Duration, Instant};

use sqlx::{AssertSqlSafe, Row};

use crate::domain::job::{JobInput, PaletteInput};
use crate::domain::scope::Scope;
use crate::domain::session::NewSession;
use crate::ids::SessionId;
use crate::store::jobs::CLAIM;
use crate::store::sessions::list::SELECT_BY_RECORDING;
use crate::store::sessions::queue_positions::SELECT_QUEUE_POSITIONS;
use crate::store::sessions::result::SELECT_FULCRUMS_BEFORE;
use crate::store::testing::TestCentre;
use crate::store::{PageRequest, SessionFilter, SessionOrderKey};

/// SQLite's query plan of a statement: one line per loop.
async fn plan(centre: &TestCentre, statement: &str) -> Vec<String> {
    let explain = AssertSqlSafe(format!("EXPLAIN QUERY PLAN {statement}"));
    let rows = sqlx::query(explain).fetch_all(centre.store.readers()).await.unwrap();
    rows.iter().map(|row| row.get("detail")).collect()
}

/// Adds `sessions` waiting sessions that all arrived at the same instant.
async fn fill(centre: &TestCentre, sessions: usize) {
    let trainee = centre.trainee("Ana").await.id;
    let news: Vec<NewSession> = (0..sessions).map(|i| centre.new_session(trainee, &format!("clip {i}"))).collect();
    for some in news.chunks(1_000) {
        let (service, sessions) = (Scope::service(), centre.store.sessions());
        let made = some.iter().map(|new| sessions.create(&service, new.clone()));
        futures_util::future::join_all(made).await.into_iter().for_each(|made| drop(made.unwrap()));
    }
}

async fn queue_positions(centre: &TestCentre, most: u32) -> Vec<(SessionId, Option<i64>)> {
    let (service, page) = (Scope::service(), PageRequest::new(most, None));
    let page = centre.store.sessions().list(&service, &SessionFilter::default(), &page).await.unwrap();
    page.items.iter().map(|session| (session.id, session.queue_position)).collect()
}

async fn mark_colours_again(centre: &TestCentre) {
    let annotations = r#"{"tool_diameter_mm":5,"labels":[{"frame":0,"label":"blue","x":1,"y":1,"w":2,"h":2}]}"#;
    let annotations = serde_json::from_str(annotations).unwrap();
    let input = PaletteInput {
        of: centre.the_box.id,
        annotations,
        files: vec![],
        is_video: true,
        frames: vec![],
        empty_box: None,
    };
    centre.store.jobs().enqueue(&Scope::service(), JobInput::Palette(input)).await.unwrap();
}

#[tokio::test]
async fn sessions_by_recording_time_are_read_from_their_index() {
    let centre = TestCentre::new().await;
    let plan = plan(&centre, SELECT_BY_RECORDING).await;
    assert!(plan.iter().any(|step| step.contains("USING INDEX session_recorded")), "{plan:#?}");
    assert!(!plan.iter().any(|step| step.contains("TEMP B-TREE FOR ORDER BY")), "{plan:#?}");
}

#[tokio::test]
async fn the_next_job_is_the_first_of_the_index() {
    let centre = TestCentre::with_camera_and_colours().await;
    let plan = plan(&centre, CLAIM).await;
    assert_eq!(plan.last().unwrap(), "SCAN job USING COVERING INDEX job_waiting", "no sorting: {plan:#?}");
}

#[tokio::test]
async fn queue_positions_are_counted_along_the_index() {
    let centre = TestCentre::with_camera_and_colours().await;
    let plan = plan(&centre, SELECT_QUEUE_POSITIONS).await;
    let from_place_to_place = "SEARCH ahead USING COVERING INDEX job_waiting \
        (turn=? AND (queued_at_ms,id)>(?,?) AND (queued_at_ms,id)<(?,?))";
    assert!(plan.iter().any(|line| line == from_place_to_place), "{plan:#?}");
    assert!(!plan.iter().any(|line| line.starts_with("SCAN job")), "{plan:#?}");
}

#[tokio::test]
async fn earlier_sessions_are_read_in_order_and_only_as_many_as_needed() {
    let centre = TestCentre::with_camera_and_colours().await;
    let plan = plan(&centre, SELECT_FULCRUMS_BEFORE).await;
    let along_the_index =
        "SEARCH session USING COVERING INDEX session_box_order (box_id=? AND (created_at_ms,id)<(?,?))";
    assert_eq!(plan[0], along_the_index, "{plan:#?}");
    assert!(!plan.iter().any(|line| line == "USE TEMP B-TREE FOR ORDER BY"), "{plan:#?}");
}

#[tokio::test]
async fn a_session_waits_for_earlier_ones_that_are_being_tracked() {
    let centre = TestCentre::with_camera_and_colours().await;
    let trainee = centre.trainee("Ana").await.id;
    let mut places = Vec::new();
    for clip in ["a", "b", "c"] {
        centre.clock.advance(Duration::from_millis(1));
        let session = centre.session(trainee, clip).await;
        places.push(SessionOrderKey(session.created_at_ms, session.id));
    }
    let tracked = async |place: usize| {
        centre.store.sessions().has_earlier_running(centre.the_box.id, places[place]).await.unwrap()
    };
    assert!(!tracked(2).await, "waiting sessions do not count");
    let (first, second) = (centre.claim().await.unwrap(), centre.claim().await.unwrap());
    assert_eq!([tracked(0).await, tracked(1).await, tracked(2).await], [false, true, true]);
    centre.store.jobs().release(&first).await.unwrap();
    assert_eq!([tracked(1).await, tracked(2).await], [false, true]);
    centre.store.jobs().release(&second).await.unwrap();
    assert!(!tracked(2).await);
}

#[tokio::test]
async fn queue_positions_count_from_one_behind_jobs_on_boxes() {
    let centre = TestCentre::with_camera_and_colours().await;
    let trainee = centre.trainee("Ana").await.id;
    for clip in ["a", "b", "c", "d", "e"] {
        centre.clock.advance(Duration::from_millis(1)); // arrivals at the same instant have no order
        centre.session(trainee, clip).await;
    }
    let of_all = |places: Vec<(SessionId, Option<i64>)>| places.iter().rev().map(|p| p.1).collect::<Vec<_>>();
    assert_eq!(of_all(queue_positions(&centre, 10).await), [1, 2, 3, 4, 5].map(Some));
    mark_colours_again(&centre).await;
    assert_eq!(of_all(queue_positions(&centre, 10).await), [2, 3, 4, 5, 6].map(Some));
    let (first, second) = (centre.claim().await.unwrap(), centre.claim().await.unwrap());
    assert!(first.job.session_id.is_none() && second.job.session_id.is_some());
    assert_eq!(of_all(queue_positions(&centre, 10).await), [None, Some(1), Some(2), Some(3), Some(4)]);
}

/// `TMPDIR=/dev/shm cargo test --lib ten_thousand -- --ignored --nocapture`
#[tokio::test]
#[ignore = "takes a minute"]
async fn ten_thousand_waiting_jobs_do_not_slow_queries() {
    let centre = TestCentre::with_camera_and_colours().await;
    fill(&centre, 10_000).await;
    let begun = Instant::now();
    let page = queue_positions(&centre, 50).await;
    let list = begun.elapsed();
    let different: HashSet<i64> =
        page.iter().filter_map(|(_, place)| *place).filter(|p| (1..=10_000).contains(p)).collect();
    assert_eq!(different.len(), 50);
    let begun = Instant::now();
    centre.store.sessions().get(&Scope::service(), page[0].0).await.unwrap();
    let one = begun.elapsed();
    let begun = Instant::now();
    centre.claim().await.unwrap();
    let claim = begun.elapsed();
    let begun = Instant::now();
    centre.store.jobs().counts().await.unwrap();
    let counts = begun.elapsed();
    eprintln!("10,000 wait: claim {claim:?}, counts {counts:?}, one session {one:?}, a list of 50 {list:?}");
    assert!(claim.max(counts).max(one).max(list) < Duration::from_millis(100));
}
