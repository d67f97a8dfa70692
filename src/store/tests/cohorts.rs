//! Cohorts: their members, who sees which members, and the members' values.

use serde_json::json;

use crate::domain::feature::FeatureKey;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::session::{FeatureRow, FeatureSpace};
use crate::domain::text::Key;
use crate::ids::{GroupId, TraineeId};
use crate::motion::features::errors::NoErrorBar;
use crate::motion::features::find;
use crate::store::testing::{NOW_MS, TestCentre, duration};
use crate::store::{CohortRecord, PageRequest, StoreError, TraineeRecord};

async fn cohort(centre: &TestCentre, body: serde_json::Value) -> CohortRecord {
    let new = serde_json::from_value(body).unwrap();
    centre.store.cohorts().create(&Scope::service(), new).await.unwrap()
}

async fn trainee(centre: &TestCentre, body: serde_json::Value) -> TraineeRecord {
    let new = serde_json::from_value(body).unwrap();
    centre.store.trainees().create(&Scope::service(), new).await.unwrap()
}

#[tokio::test]
async fn a_cohort_is_a_list_or_all_trainees_that_it_describes() {
    let centre = TestCentre::new().await;
    let ana = trainee(&centre, json!({"name": "Ana", "level": "expert", "handedness": "left"})).await;
    let ben = trainee(&centre, json!({"name": "Ben", "level": "expert", "handedness": "right"})).await;
    let eve = trainee(&centre, json!({"name": "Eve"})).await;
    centre.group("A", &[], &[&ben, &eve]).await;
    let group = centre.store.groups().list(&Scope::service()).await.unwrap()[0].id;
    for (body, expected) in [
        (json!({"name": "All"}), vec![ana.id, ben.id, eve.id]),
        (json!({"name": "Experts", "level": "expert"}), vec![ana.id, ben.id]),
        (json!({"name": "Left", "handedness": "left"}), vec![ana.id]),
        (json!({"name": "A", "group": group}), vec![ben.id, eve.id]),
        (json!({"name": "Experts of A", "group": group, "level": "expert"}), vec![ben.id]),
        (json!({"name": "Listed", "members": [eve.id, ana.id]}), vec![ana.id, eve.id]),
        (json!({"name": "Nobody", "level": "novice"}), vec![]),
    ] {
        let (made, mut expected) = (cohort(&centre, body.clone()).await, expected);
        expected.sort(); // ids made at the same instant are in any order
        assert_eq!(members(&centre, &Scope::service(), &made).await, expected, "{body}");
        assert_eq!(made.people, expected.len() as i64, "{body}");
    }
    let gone = centre.store.groups().delete(&Scope::service(), group).await;
    assert!(matches!(gone, Err(StoreError::InUse { by: "cohorts", .. })), "{gone:?}");
}

async fn members(centre: &TestCentre, scope: &Scope, of: &CohortRecord) -> Vec<TraineeId> {
    let key = Key::from(&of.id);
    let page = centre.store.cohorts().members(scope, &key, &PageRequest::default()).await.unwrap();
    assert_eq!(page.next, None);
    page.items
}

#[tokio::test]
async fn cohorts_and_their_members_come_by_the_page() {
    let centre = TestCentre::new().await;
    let mut ids = Vec::new();
    for name in ["Ana", "Ben", "Eve"] {
        ids.push(centre.trainee(name).await.id);
        cohort(&centre, json!({"name": name})).await;
    }
    ids.sort();
    let (cohorts, service, mut after, mut codes, mut found) =
        (centre.store.cohorts(), Scope::service(), None, Vec::new(), Vec::new());
    for last in [false, false, true] {
        let page = cohorts.list(&service, &PageRequest::new(1, after)).await.unwrap();
        codes.extend(page.items.iter().map(|cohort| cohort.code.to_string()));
        after = page.next;
        assert_eq!(after.is_none(), last);
    }
    assert_eq!(codes, ["ana", "ben", "eve"]);
    for last in [false, true] {
        let page = cohorts.members(&service, &Key::from("ben"), &PageRequest::new(2, after)).await.unwrap();
        found.extend(page.items);
        after = page.next;
        assert_eq!(after.is_none(), last);
    }
    assert_eq!(found, ids);
}

#[tokio::test]
async fn a_cohort_changes_whole_and_names_only_what_is_there() {
    let centre = TestCentre::new().await;
    let (store, service) = (&centre.store, Scope::service());
    let ana = centre.trainee("Ana").await.id;
    let made = cohort(&centre, json!({"name": "Listed", "members": [ana]})).await;
    let new = |body| serde_json::from_value(body).unwrap();
    for (body, what) in [
        (json!({"name": "x", "members": [TraineeId::at(1)]}), "trainee"),
        (json!({"name": "x", "group": GroupId::at(1)}), "group"),
    ] {
        for answer in [
            store.cohorts().create(&service, new(body.clone())).await,
            store.cohorts().replace(&service, made.id, new(body.clone())).await,
        ] {
            assert!(matches!(&answer, Err(StoreError::NotFound { what: found }) if *found == what), "{answer:?}");
        }
    }
    assert_eq!(members(&centre, &service, &made).await, [ana], "a refused change changes nothing");
    let changed = store.cohorts().replace(&service, made.id, new(json!({"name": "Left", "handedness": "left"}))).await;
    let changed = changed.unwrap();
    assert_eq!((changed.code.as_str(), changed.is_list, changed.people), ("listed", false, 0));
    let taken = store.cohorts().create(&service, new(json!({"name": "x", "code": "listed"}))).await;
    assert!(matches!(taken, Err(StoreError::Taken { what: "code", .. })), "{taken:?}");
    store.cohorts().delete(&service, &Key::from("listed")).await.unwrap();
    assert!(store.cohorts().list(&service, &PageRequest::default()).await.unwrap().items.is_empty());
}

#[tokio::test]
async fn people_see_only_cohort_members_in_their_scope() {
    let centre = TestCentre::new().await;
    let (ana, ben) = (centre.trainee("Ana").await, centre.trainee("Ben").await);
    let teacher = centre.person("ina", Role::Instructor, None).await;
    let account = centre.person("ben", Role::Trainee, Some(ben.id)).await;
    centre.group("A", &[&teacher], &[&ana]).await;
    let made = cohort(&centre, json!({"name": "Listed", "members": [ana.id, ben.id]})).await;
    let (cohorts, agent) = (centre.store.cohorts(), Scope::agent(centre.the_box.id));
    for (scope, sees) in [(teacher.scope(), vec![ana.id]), (account.scope(), vec![ben.id])] {
        assert_eq!(cohorts.get(&scope, &Key::from("listed")).await.unwrap().people, 2);
        assert_eq!(members(&centre, &scope, &made).await, sees);
        let new = serde_json::from_value(json!({"name": "Mine"})).unwrap();
        assert!(matches!(cohorts.create(&scope, new).await, Err(StoreError::Forbidden { .. })));
        assert!(matches!(cohorts.delete(&scope, &Key::from("listed")).await, Err(StoreError::Forbidden { .. })));
    }
    assert!(cohorts.list(&agent, &PageRequest::default()).await.unwrap().items.is_empty());
    assert!(cohorts.get(&agent, &Key::from("listed")).await.is_err());
}

fn key(feature: &str) -> FeatureKey {
    FeatureKey::of_session(find(feature).unwrap(), FeatureSpace::Space3d)
}

#[tokio::test]
async fn the_last_sessions_of_each_person_count_and_an_erased_person_is_in_no_cohort() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (ana, ben) = (centre.trainee("Ana").await, centre.trainee("Ben").await);
    for (trainee, seconds) in [(&ana, [90.0, 80.0, 70.0]), (&ben, [50.0, 40.0, 30.0])] {
        for (day, seconds) in seconds.into_iter().enumerate() {
            centre.practised(trainee.id, NOW_MS + day as i64, vec![duration(seconds, 1.0)]).await;
        }
    }
    let made = cohort(&centre, json!({"name": "Listed", "members": [ana.id, ben.id]})).await;
    let values = async |sessions| {
        let rows = centre.store.cohorts().values(made.id, centre.task.id, sessions, &[key("duration")]).await.unwrap();
        let mut values: Vec<(TraineeId, f64)> = rows.iter().map(|row| (row.trainee, row.value)).collect();
        values.sort_by(|a, b| a.1.total_cmp(&b.1));
        values
    };
    assert_eq!(values(2).await, [(ben.id, 30.0), (ben.id, 40.0), (ana.id, 70.0), (ana.id, 80.0)]);
    assert_eq!(values(9).await.len(), 6);
    centre.store.trainees().erase(&Scope::service(), &Key::from(&ben.id)).await.unwrap();
    assert_eq!(values(1).await, [(ana.id, 70.0)]);
    assert_eq!(centre.store.cohorts().get(&Scope::service(), &Key::from(&made.id)).await.unwrap().people, 1);
    let other = centre.store.cohorts().values(made.id, centre.task.id, 5, &[key("path_length")]).await.unwrap();
    assert!(other.is_empty());
}

#[tokio::test]
async fn a_lower_bound_stays_one_and_is_not_among_a_cohort_s_values() {
    let centre = TestCentre::with_camera_and_colours().await;
    let ana = centre.trainee("Ana").await;
    let at_least = FeatureRow { error: Some(Err(NoErrorBar::AtLeast.to_string())), ..duration(20.0, 1.0) };
    centre.practised(ana.id, NOW_MS, vec![duration(30.0, 1.0)]).await;
    centre.practised(ana.id, NOW_MS + 1, vec![at_least]).await;
    let made = cohort(&centre, json!({"name": "All"})).await;
    let rows = centre.store.cohorts().values(made.id, centre.task.id, 9, &[key("duration")]).await.unwrap();
    assert_eq!(rows.iter().map(|row| row.value).collect::<Vec<_>>(), [30.0]);
    let (sessions, service) = (centre.store.sessions(), Scope::service());
    let practice = sessions.practice(&service, ana.id, centre.task.id, &[find("duration").unwrap()], 9).await.unwrap();
    let measured = practice.sessions.iter().flat_map(|session| &session.measured);
    let found: Vec<_> = measured.map(|of| (of.value.unwrap(), of.bar.is_some(), of.is_lower_bound)).collect();
    assert_eq!(found, [(30.0, true, false), (20.0, false, true)]);
}
