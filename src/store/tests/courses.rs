//! Course plans: what they may require, who changes them, and what prevents their deletion.

use serde_json::{Value, json};

use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::standard::{ChartDesign, StandardDefinition};
use crate::domain::text::Key;
use crate::ids::{CourseId, GroupId};
use crate::store::testing::{NOW_MS, TestCentre};
use crate::store::{CourseRecord, PageRequest, StoreError, StoreResult};
use crate::time::Day;

async fn make(centre: &TestCentre, scope: &Scope, name: &str, steps: Value) -> StoreResult<CourseRecord> {
    let new = serde_json::from_value(json!({"name": name, "steps": steps})).unwrap();
    centre.store.courses().create(scope, new).await
}

async fn ask_for_a_standard(centre: &TestCentre) {
    let definition = StandardDefinition { targets: Vec::new(), rule: None, charts: ChartDesign::default() };
    centre.store.standards().add(&Scope::service(), centre.task.id, definition, None).await.unwrap();
}

async fn group(centre: &TestCentre, name: &str) -> GroupId {
    let groups = centre.store.groups().list(&Scope::service()).await.unwrap();
    groups.into_iter().find(|group| group.name.as_str() == name).unwrap().id
}

#[tokio::test]
async fn a_plan_keeps_its_steps_in_their_order_and_is_changed_as_a_whole() {
    let centre = TestCentre::new().await;
    let ina = centre.person("ina", Role::Instructor, None).await;
    centre.group("Mondays", &[&ina], &[]).await;
    let ina = ina.scope();
    ask_for_a_standard(&centre).await;
    let by_id = centre.task.id.to_string();
    let first = json!({"task": "peg-transfer", "sessions": 3, "within_days": 7});
    let steps = json!([first, {"task": by_id}, {"task": by_id, "sessions": 1}]);
    let made = make(&centre, &ina, "Basics", steps).await.unwrap();
    let asked: Vec<_> = made.steps.iter().map(|step| (step.task_id, step.within_days, step.sessions)).collect();
    let task = centre.task.id;
    assert_eq!(asked, [(task, Some(7), Some(3)), (task, None, None), (task, None, Some(1))]);
    let new = serde_json::from_value(json!({"name": "Advanced", "steps": [{"task": "peg-transfer"}]})).unwrap();
    let changed = centre.store.courses().replace(&ina, made.id, new).await.unwrap();
    assert_eq!((changed.id, changed.name.as_str(), changed.steps.len()), (made.id, "Advanced", 1));
    let trail = centre.store.audit().list(&Scope::service(), &PageRequest::default()).await.unwrap().items;
    let noted: Vec<_> =
        trail.iter().filter(|entry| entry.noun == "course").map(|entry| entry.action.as_str()).collect();
    assert_eq!(noted, ["change", "create"]);
    centre.store.courses().delete(&ina, made.id).await.unwrap();
    let gone = centre.store.courses().get(&ina, made.id).await;
    assert!(matches!(gone, Err(StoreError::NotFound { what: "course" })), "{gone:?}");
}

#[tokio::test]
async fn a_plan_that_cannot_be_passed_is_refused_and_leaves_nothing() {
    let centre = TestCentre::new().await;
    let service = Scope::service();
    let refused = |made: StoreResult<CourseRecord>, words: &str| match made {
        Err(StoreError::Refused { why }) => assert!(why.contains(words), "{why}"),
        other => panic!("{other:?}"),
    };
    refused(make(&centre, &service, "A", json!([{"task": "peg-transfer"}])).await, "no standard");
    let twice =
        json!([{"task": "peg-transfer", "sessions": 3}, {"task": "peg-transfer", "sessions": 3, "within_days": 1}]);
    refused(make(&centre, &service, "A", twice).await, "step 2");
    let missing = make(&centre, &service, "A", json!([{"task": "knots", "sessions": 1}])).await;
    assert!(matches!(missing, Err(StoreError::NotFound { what: "task" })), "{missing:?}");
    let one = json!([{"task": "peg-transfer", "sessions": 1}]);
    make(&centre, &service, "A", one.clone()).await.unwrap();
    let taken = make(&centre, &service, "A", one).await;
    assert!(matches!(taken, Err(StoreError::Taken { .. })), "{taken:?}");
    assert_eq!(centre.store.courses().list(&service, &PageRequest::default()).await.unwrap().items.len(), 1);
}

#[tokio::test]
async fn plans_come_by_the_page_and_by_name() {
    let centre = TestCentre::new().await;
    for name in ["C", "A", "B"] {
        make(&centre, &Scope::service(), name, json!([{"task": "peg-transfer", "sessions": 1}])).await.unwrap();
    }
    let list = async |after| centre.store.courses().list(&Scope::service(), &PageRequest::new(2, after)).await.unwrap();
    let first = list(None).await;
    let second = list(first.next.clone()).await;
    let names: Vec<_> = first.items.iter().chain(&second.items).map(|course| course.name.as_str()).collect();
    assert_eq!((names, second.next), (vec!["A", "B", "C"], None));
}

#[tokio::test]
async fn what_a_course_needs_stays_and_a_group_takes_its_course_with_it() {
    let centre = TestCentre::new().await;
    let (store, service) = (&centre.store, Scope::service());
    let course = make(&centre, &service, "A", json!([{"task": "peg-transfer", "sessions": 1}])).await.unwrap();
    let task = store.tasks().delete(&service, &Key::from("peg-transfer")).await;
    assert!(matches!(task, Err(StoreError::InUse { what: "task", .. })), "{task:?}");
    centre.group("Autumn", &[], &[]).await;
    let autumn = group(&centre, "Autumn").await;
    let begins = Day::of(NOW_MS);
    store.courses().follow(&service, autumn, course.id, begins).await.unwrap();
    store.courses().follow(&service, autumn, course.id, begins.plus_days(1)).await.unwrap();
    let followed = store.groups().get(&service, autumn).await.unwrap().follows.unwrap();
    assert_eq!((followed.course, followed.begins), (course.id, begins.plus_days(1)), "the later one counts");
    let used = store.courses().delete(&service, course.id).await;
    assert!(matches!(used, Err(StoreError::InUse { by: "groups", .. })), "{used:?}");
    store.groups().delete(&service, autumn).await.unwrap();
    store.courses().delete(&service, course.id).await.unwrap();
    store.tasks().delete(&service, &Key::from("peg-transfer")).await.unwrap();
    assert_eq!(store.check().await.unwrap(), Vec::<String>::new());
}

#[tokio::test]
async fn only_instructors_of_a_group_choose_its_course() {
    let centre = TestCentre::new().await;
    let (store, service, begins) = (&centre.store, Scope::service(), Day::of(NOW_MS));
    let (ina, omar) =
        (centre.person("ina", Role::Instructor, None).await, centre.person("omar", Role::Instructor, None).await);
    let ana = centre.trainee("Ana").await;
    let account = centre.person("ana", Role::Trainee, Some(ana.id)).await;
    centre.group("One", &[&ina], &[&ana]).await;
    centre.group("Two", &[&omar], &[&ana]).await;
    let course = make(&centre, &ina.scope(), "A", json!([{"task": "peg-transfer", "sessions": 1}])).await.unwrap();
    let (one, two) = (group(&centre, "One").await, group(&centre, "Two").await);
    let foreign = store.courses().follow(&ina.scope(), two, course.id, begins).await;
    assert!(matches!(foreign, Err(StoreError::NotFound { what: "group" })), "{foreign:?}");
    for (by, group) in [(&ina, one), (&omar, two)] {
        store.courses().follow(&by.scope(), group, course.id, begins).await.unwrap();
    }
    let unknown = store.courses().follow(&ina.scope(), one, CourseId::at(1), begins).await;
    assert!(matches!(unknown, Err(StoreError::NotFound { what: "course" })), "{unknown:?}");
    let groups_of = async |scope: Scope| {
        let of = store.courses().of_trainee(&scope, ana.id).await.unwrap();
        of.into_iter().map(|of| of.group_id).collect::<Vec<_>>()
    };
    assert_eq!(groups_of(account.scope()).await, [one, two]);
    assert_eq!(groups_of(service.clone()).await, [one, two]);
    assert_eq!(groups_of(ina.scope()).await, [one], "of the groups that she teaches");
    let own = make(&centre, &account.scope(), "Mine", json!([{"task": "peg-transfer", "sessions": 1}])).await;
    assert!(matches!(own, Err(StoreError::Forbidden { .. })), "{own:?}");
    assert!(store.courses().get(&account.scope(), course.id).await.is_ok(), "plans are for everybody");
    assert!(store.courses().get(&Scope::agent(centre.the_box.id), course.id).await.is_err());
    let ended = store.courses().unfollow(&omar.scope(), one).await;
    assert!(matches!(ended, Err(StoreError::NotFound { what: "group" })), "{ended:?}");
    store.courses().unfollow(&ina.scope(), one).await.unwrap();
    assert_eq!(groups_of(account.scope()).await, [two]);
}
