//! Rights to change: what groups own, who shares it out, and who erases a trainee.

use serde_json::{Value, json};
use sqlx::AssertSqlSafe;

use crate::domain::boxes::BoxChange;
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::job::{JobInput, PaletteInput};
use crate::domain::rights::RightsSettings;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::standard::{ChartDesign, StandardDefinition};
use crate::domain::task::TaskChange;
use crate::domain::text::Key;
use crate::ids::{BoxId, GroupId, TaskId};
use crate::store::testing::TestCentre;
use crate::store::{BoxRecord, CourseRecord, PersonRecord, StoreError, StoreResult, TaskRecord};

/// Two groups with an instructor each.
struct TwoGroups {
    centre: TestCentre,
    ina: PersonRecord,
    omar: PersonRecord,
    /// Ina's group.
    one: GroupId,
    /// Omar's group.
    two: GroupId,
}

impl TwoGroups {
    async fn new() -> Self {
        let centre = TestCentre::with_camera_and_colours().await;
        let ina = centre.person("ina", Role::Instructor, None).await;
        let omar = centre.person("omar", Role::Instructor, None).await;
        centre.group("One", &[&ina], &[]).await;
        centre.group("Two", &[&omar], &[]).await;
        let groups = centre.store.groups().list(&Scope::service()).await.unwrap();
        let (one, two) = (groups[0].id, groups[1].id);
        Self { centre, ina, omar, one, two }
    }

    async fn make_box(&self, scope: &Scope, groups: Value) -> StoreResult<BoxRecord> {
        let new = serde_json::from_value(json!({"name": "Box 2", "groups": groups})).unwrap();
        self.centre.store.boxes().create(scope, new).await
    }

    async fn make_task(&self, scope: &Scope) -> StoreResult<TaskRecord> {
        let new = serde_json::from_value(json!({"name": "Knots"})).unwrap();
        self.centre.store.tasks().create(scope, new).await
    }

    async fn make_course(&self, scope: &Scope) -> StoreResult<CourseRecord> {
        let steps = json!([{"task": self.centre.task.id, "sessions": 1}]);
        let new = serde_json::from_value(json!({"name": "Basics", "steps": steps})).unwrap();
        self.centre.store.courses().create(scope, new).await
    }
}

fn colours(of: BoxId) -> JobInput {
    let text = r#"{"tool_diameter_mm":8,"labels":[{"frame":0,"label":"orange","x":1,"y":1,"w":2,"h":2}]}"#;
    let annotations: AnnotationsFile = serde_json::from_str(text).unwrap();
    JobInput::Palette(PaletteInput { of, annotations, files: vec![], is_video: true, frames: vec![], empty_box: None })
}

fn is_forbidden<T>(result: &StoreResult<T>) -> bool {
    matches!(result, Err(StoreError::Forbidden { whom: "administrators and the instructors of its groups", .. }))
}

#[tokio::test]
async fn instructors_change_only_what_their_groups_own() {
    let groups = TwoGroups::new().await;
    let store = &groups.centre.store;
    let (ina, omar) = (groups.ina.scope(), groups.omar.scope());
    let of_box = groups.make_box(&ina, Value::Null).await.unwrap();
    let task = groups.make_task(&ina).await.unwrap();
    let course = groups.make_course(&ina).await.unwrap();
    for owners in [&of_box.owners, &task.owners, &course.owners] {
        assert_eq!(*owners, [groups.one]);
    }
    let (box_key, task_key) = (Key::from(&of_box.id), Key::from(&task.id));
    let standard = || StandardDefinition { targets: Vec::new(), rule: None, charts: ChartDesign::default() };
    let new_course =
        || serde_json::from_value(json!({"name": "B", "steps": [{"task": "knots", "sessions": 1}]})).unwrap();

    let widened = omar.clone().with_rights(RightsSettings { instructors_edit_all: true, ..RightsSettings::default() });
    for (scope, may) in [(&omar, false), (&ina, true), (&Scope::service(), true), (&widened, true)] {
        let who = scope.role();
        assert_ne!(is_forbidden(&store.boxes().change(scope, &box_key, BoxChange::default()).await), may, "{who}");
        assert_ne!(is_forbidden(&store.tasks().change(scope, &task_key, TaskChange::default()).await), may, "{who}");
        assert_ne!(is_forbidden(&store.courses().replace(scope, course.id, new_course()).await), may, "{who}");
        assert_ne!(is_forbidden(&store.standards().add(scope, task.id, standard(), None).await), may, "{who}");
        assert_ne!(is_forbidden(&store.jobs().enqueue(scope, colours(of_box.id)).await), may, "{who}");
    }
    assert!(is_forbidden(&store.boxes().delete(&omar, &box_key).await));
    assert!(is_forbidden(&store.tasks().delete(&omar, &task_key).await));
    assert!(is_forbidden(&store.courses().delete(&omar, course.id).await));
    assert!(store.boxes().get(&omar, &box_key).await.unwrap().owners.is_empty(), "another's groups are not shown");
    let job = store.jobs().enqueue(&ina, colours(of_box.id)).await.unwrap().id;
    assert!(is_forbidden(&store.jobs().retry(&omar, job).await), "a repeated job would change the box, too");
    store.jobs().retry(&ina, job).await.unwrap();
}

#[tokio::test]
async fn an_instructor_shares_only_among_own_groups_and_other_owners_stay() {
    let groups = TwoGroups::new().await;
    let (store, service) = (&groups.centre.store, Scope::service());
    let (ina, key) = (groups.ina.scope(), Key::from(&groups.centre.the_box.id));
    let set = async |scope: &Scope, to: Vec<GroupId>| {
        store.boxes().change(scope, &key, BoxChange { groups: Some(to), ..BoxChange::default() }).await
    };
    let foreign = set(&ina, vec![groups.two]).await;
    assert!(matches!(foreign, Err(StoreError::NotFound { what: "groups" })), "{foreign:?}");
    let none = set(&ina, vec![]).await;
    assert!(matches!(none, Err(StoreError::Refused { .. })), "{none:?}");
    assert_eq!(set(&ina, vec![groups.one]).await.unwrap().owners, [groups.one]);
    let mut all = store.boxes().get(&service, &key).await.unwrap().owners;
    all.sort();
    let mut both = [groups.one, groups.two];
    both.sort(); // ids of the same millisecond have any order
    assert_eq!(all, both, "the owner that she does not see stays");
    assert!(set(&service, vec![]).await.unwrap().owners.is_empty());
    assert!(is_forbidden(&set(&ina, vec![groups.one]).await), "without a group it is the administrators' alone");
    store.groups().delete(&service, groups.two).await.unwrap();
    assert_eq!(store.check().await.unwrap(), Vec::<String>::new());
}

#[tokio::test]
async fn new_things_belong_to_the_groups_of_their_maker() {
    let groups = TwoGroups::new().await;
    let loner = groups.centre.person("lea", Role::Instructor, None).await.scope();
    for made in [groups.make_box(&loner, Value::Null).await.map(drop), groups.make_task(&loner).await.map(drop)] {
        assert!(matches!(made, Err(StoreError::Refused { .. })), "{made:?}");
    }
    let widened = loner.with_rights(RightsSettings { instructors_edit_all: true, ..RightsSettings::default() });
    assert!(groups.make_box(&widened, Value::Null).await.unwrap().owners.is_empty());
    assert!(groups.make_box(&Scope::service(), Value::Null).await.unwrap().owners.is_empty());
    assert_eq!(groups.make_box(&Scope::service(), json!([groups.two])).await.unwrap().owners, [groups.two]);
    let foreign = groups.make_box(&groups.ina.scope(), json!([groups.two])).await;
    assert!(matches!(foreign, Err(StoreError::NotFound { what: "groups" })), "{foreign:?}");
}

#[tokio::test]
async fn only_administrators_erase_a_trainee_of_several_groups() {
    let centre = TestCentre::new().await;
    let ina = centre.person("ina", Role::Instructor, None).await;
    let (shared, also_shared, own) = (centre.trainee("A").await, centre.trainee("B").await, centre.trainee("C").await);
    centre.group("One", &[&ina], &[&shared, &also_shared, &own]).await;
    centre.group("Two", &[], &[&shared, &also_shared]).await;
    let trainees = centre.store.trainees();
    let ina = ina.scope();
    let seen = trainees.get(&ina, &Key::from(&shared.id)).await.unwrap();
    assert!(seen.is_in_several_groups && !ina.may_erase_trainee(seen.is_in_several_groups));
    let refused = trainees.erase(&ina, &Key::from(&shared.id)).await;
    assert!(matches!(refused, Err(StoreError::Forbidden { whom: "administrators", .. })), "{refused:?}");
    trainees.erase(&ina, &Key::from(&own.id)).await.unwrap();
    let rights = RightsSettings { instructors_erase_shared: true, ..RightsSettings::default() };
    trainees.erase(&ina.with_rights(rights), &Key::from(&also_shared.id)).await.unwrap();
    trainees.erase(&Scope::service(), &Key::from(&shared.id)).await.unwrap();
}

/// The migration's statements run again, on a centre without owners.
#[tokio::test]
async fn what_exists_already_goes_to_the_groups_that_use_it_and_else_to_all() {
    let groups = TwoGroups::new().await;
    let (store, service) = (&groups.centre.store, Scope::service());
    let unused = groups.make_task(&service).await.unwrap();
    let made = groups.make_box(&groups.omar.scope(), Value::Null).await.unwrap();
    let ana = groups.centre.trainee("Ana").await;
    groups.centre.group("Three", &[], &[&ana]).await;
    groups.centre.session(ana.id, "a clip").await;
    let three =
        store.groups().list(&service).await.unwrap().into_iter().find(|g| g.name.as_str() == "Three").unwrap().id;

    let migration = include_str!("../../../migrations/0035_owners.sql");
    let statements = migration.find("INSERT INTO").map(|at| migration[at..].to_owned()).unwrap();
    store
        .write(async move |tx| {
            sqlx::raw_sql(AssertSqlSafe(format!("DELETE FROM ownership; {statements}"))).execute(tx).await?;
            Ok(())
        })
        .await
        .unwrap();

    let of_box = async |id: BoxId| store.boxes().get(&service, &Key::from(&id)).await.unwrap().owners;
    let of_task = async |id: TaskId| store.tasks().get(&service, &Key::from(&id)).await.unwrap().owners;
    assert_eq!(of_box(groups.centre.the_box.id).await, [three], "the group that recorded in it");
    assert_eq!(of_task(groups.centre.task.id).await, [three], "the group that practised it");
    assert_eq!(of_box(made.id).await, [groups.two], "the group of the instructor who made it");
    let mut all = of_task(unused.id).await;
    all.sort();
    let mut three_groups = [groups.one, groups.two, three];
    three_groups.sort();
    assert_eq!(all, three_groups, "no group has used it yet: all may prepare it");
}
