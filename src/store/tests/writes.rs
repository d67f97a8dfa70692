//! The writer: commits of several requests, savepoints, natural keys, and deletion.

use futures_util::future::join_all;

use crate::domain::scope::Scope;
use crate::domain::task::NewTask;
use crate::domain::text::Key;
use crate::domain::trainee::TraineeChange;
use crate::store::testing::{TestCentre, open};
use crate::store::{PageRequest, StoreError};

fn task(name: &str, code: Option<&str>) -> NewTask {
    NewTask {
        name: name.parse().unwrap(),
        code: code.map(|code| code.parse().unwrap()),
        description: None,
        rating_forms: None,
        groups: None,
    }
}

#[tokio::test]
async fn a_request_that_fails_is_rolled_back_alone() {
    let centre = TestCentre::new().await;
    let (tasks, service) = (centre.store.tasks(), Scope::service());
    let wishes = (0..30).map(|n| task(&format!("Task {n}"), (n % 3 == 0).then_some("same")));
    let made = join_all(wishes.map(|wish| tasks.create(&service, wish))).await;
    let refused = made.iter().filter(|made| matches!(made, Err(StoreError::Taken { what: "code", .. }))).count();
    assert_eq!((made.iter().filter(|made| made.is_ok()).count(), refused), (21, 9));
    assert_eq!(tasks.list(&service, &PageRequest::default()).await.unwrap().items.len(), 22); // with the centre's own
}

#[tokio::test]
async fn things_of_one_name_get_codes_of_their_own() {
    let centre = TestCentre::new().await;
    let (tasks, service) = (centre.store.tasks(), Scope::service());
    let made = join_all((0..5).map(|_| tasks.create(&service, task("Knot", None)))).await;
    let mut codes: Vec<_> = made.into_iter().map(|made| made.unwrap().code.to_string()).collect();
    codes.sort();
    assert_eq!(codes, ["knot", "knot-2", "knot-3", "knot-4", "knot-5"]);
}

#[tokio::test]
async fn acknowledged_writes_survive_a_restart() {
    let TestCentre { store, clock, folder, .. } = TestCentre::new().await;
    let service = Scope::service();
    let made = store.tasks().create(&service, task("Knot", None)).await.unwrap();
    let other = open(&folder, &clock).await; // the first one ends without closing anything
    assert_eq!(other.tasks().get(&service, &Key::from("knot")).await.unwrap(), made);
}

#[tokio::test]
async fn pages_follow_each_other_without_gap_or_repetition() {
    let centre = TestCentre::new().await;
    let (tasks, service) = (centre.store.tasks(), Scope::service());
    join_all((0..10).map(|n| tasks.create(&service, task(&format!("Task {n}"), None)))).await;
    let (mut codes, mut after) = (Vec::new(), None);
    loop {
        let page = tasks.list(&service, &PageRequest::new(3, after)).await.unwrap();
        codes.extend(page.items.iter().map(|task| task.code.to_string()));
        after = page.next;
        if after.is_none() {
            break;
        }
    }
    let mut sorted = codes.clone();
    sorted.sort();
    sorted.dedup();
    assert_eq!((codes.len(), &codes), (11, &sorted));
}

#[tokio::test]
async fn a_task_or_box_that_sessions_need_stays() {
    let centre = TestCentre::with_camera_and_colours().await;
    let service = Scope::service();
    centre.session(centre.trainee("Ana").await.id, "video").await;
    let task = centre.store.tasks().delete(&service, &Key::from(&centre.task.id)).await;
    assert!(matches!(task, Err(StoreError::InUse { what: "task", .. })), "{task:?}");
    let the_box = centre.store.boxes().delete(&service, &Key::from(&centre.the_box.id)).await;
    assert!(matches!(the_box, Err(StoreError::InUse { what: "box", .. })), "{the_box:?}");
}

#[tokio::test]
async fn what_a_change_leaves_out_stays() {
    let centre = TestCentre::new().await;
    let service = Scope::service();
    let ana = centre.trainee("Ana").await;
    let change = TraineeChange { level: Some(crate::domain::trainee::Level::Expert), ..TraineeChange::default() };
    let changed = centre.store.trainees().change(&service, &Key::from("ana"), change).await.unwrap();
    assert_eq!((&changed.name, changed.id, changed.level.unwrap().name()), (&ana.name, ana.id, "expert"));
    let audit = centre.store.audit().list(&service, &PageRequest::default()).await.unwrap();
    let last = &audit.items[0];
    assert_eq!((last.action.as_str(), last.subject.as_str()), ("change", ana.id.to_string().as_str()));
}

#[tokio::test]
async fn a_newer_calibration_makes_a_scored_session_scorable_again_and_keeps_the_old_result() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (sessions, service) = (centre.store.sessions(), Scope::service());
    let session = centre.session(centre.trainee("Ana").await.id, "video").await;
    let score = async || {
        let (lease, result) = (centre.claim().await.unwrap(), centre.result(session.id).await);
        centre.store.jobs().finish_track(&lease, result).await.unwrap();
    };
    score().await;
    let again = sessions.retry(&service, session.id).await;
    assert!(matches!(again, Err(StoreError::Refused { .. })), "{again:?}");
    centre.calibrate().await;
    sessions.retry(&service, session.id).await.unwrap();
    centre.clock.advance(std::time::Duration::from_secs(1));
    score().await;
    assert_eq!(centre.store.count_results().await, 2);
    let latest = sessions.result(&service, session.id).await.unwrap().unwrap();
    let calibration = centre.store.calibrations().in_use(&service, centre.the_box.id).await.unwrap().unwrap();
    assert_eq!((latest.versions.calibration, calibration.version), (Some(calibration.id), 2));
}
