//! Versions of skill models: their training data, and their withdrawal when that data is erased.

use serde_json::json;

use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::skill::{ModelDefinition, Reading};
use crate::domain::text::Key;
use crate::domain::trainee::Level;
use crate::ids::TraineeId;
use crate::store::testing::{NOW_MS, TestCentre, duration};
use crate::store::{NewSkillModel, PageRequest, StoreError};

/// A model by the duration alone, with these trainees as training data.
fn model(trainees: &[TraineeId]) -> NewSkillModel {
    let share = json!({"value": 0.8, "low": 0.6, "high": 0.9, "people": 24});
    let report = json!({
        "knows": true, "people": [8, 8, 8], "sessions": [8, 8, 8], "left_out": 0, "offered": 1,
        "accuracy": share, "balanced": 0.8, "levels": [], "confusion": [],
        "baseline": {"permutations": 99, "mean": 0.33, "high": 0.5, "p": 0.01},
        "speaking": {"share": 0.9, "right": share, "of_level": [share, null, share]}, "chosen": [],
    });
    let definition = json!({
        "tools": 1, "features": [{"feature": "duration", "mean": 60.0, "deviation": 20.0}], "learner": "lda",
        "parameter": "", "temperature": 1.0, "doubt": 0.1,
        "scorer": {"kind": "linear", "weights": [[1.0], [0.0], [-1.0]], "offsets": [0.0, 0.0, 0.0]},
        "centres": [[1.0], [0.0], [-1.0]], "precision": [4.0], "limit": 3.0, "knows": true,
    });
    NewSkillModel {
        pipeline: "1".to_owned(),
        fingerprint: "0".repeat(64),
        definition: serde_json::from_value(definition).unwrap(),
        report: serde_json::from_value(report).unwrap(),
        trainees: trainees.to_vec(),
    }
}

#[tokio::test]
async fn a_model_is_withdrawn_with_the_first_erased_person_in_its_data() {
    let centre = TestCentre::new().await;
    let (store, service, task) = (&centre.store, Scope::service(), centre.task.id);
    let (ana, ben, eve) =
        (centre.trainee("Ana").await.id, centre.trainee("Ben").await.id, centre.trainee("Eve").await.id);
    let teacher = centre.person("ina", Role::Instructor, None).await;
    let models = store.skill_models();
    assert_eq!(models.in_use(&service, task).await.unwrap(), None);
    let new = model(&[ana, ben]);
    let refused = models.add(&teacher.scope(), task, new.clone()).await;
    assert!(matches!(refused, Err(StoreError::Forbidden { .. })), "{refused:?}");
    let first = models.add(&service, task, new.clone()).await.unwrap();
    assert_eq!((first.version, first.definition.as_ref(), &first.report), (1, Some(&new.definition), &new.report));
    assert_eq!(models.add(&service, task, new.clone()).await.unwrap(), first, "the same is no new version");
    let other = ModelDefinition { parameter: "another".to_owned(), ..new.definition.clone() };
    let second =
        models.add(&service, task, NewSkillModel { definition: other, trainees: vec![eve], ..new.clone() }).await;
    assert_eq!(second.unwrap().version, 2);

    store.trainees().erase(&service, &Key::from(&ben)).await.unwrap();
    let list = models.list(&teacher.scope(), task).await.unwrap();
    assert_eq!(list.iter().map(|model| model.definition.is_some()).collect::<Vec<_>>(), [true, false]);
    assert_eq!((list[1].withdrawn_at_ms, &list[1].report), (Some(NOW_MS), &new.report));
    assert_eq!(models.get(&service, task, 1).await.unwrap(), list[1]);
    assert!(models.list(&Scope::agent(centre.the_box.id), task).await.unwrap().is_empty());
    let late = models.add(&service, task, model(&[ana, ben])).await;
    assert!(matches!(late, Err(StoreError::Refused { .. })), "erased while it was made: {late:?}");
    assert_eq!(models.list(&service, task).await.unwrap().len(), 2);
    let audit = store.audit().list(&service, &PageRequest::default()).await.unwrap();
    assert!(audit.items.iter().any(|entry| (entry.action.as_str(), entry.noun.as_str()) == ("create", "skill_model")));
    store.tasks().delete(&service, &Key::from(&task)).await.unwrap();
    assert!(models.list(&service, task).await.unwrap().is_empty());
}

#[tokio::test]
async fn a_model_is_withdrawn_with_the_first_erased_session_in_its_data() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (models, service) = (centre.store.skill_models(), Scope::service());
    let (ana, ben) = (centre.trainee("Ana").await.id, centre.trainee("Ben").await.id);
    let [anas, bens] = [(ana, "a"), (ben, "b")].map(|(trainee, content)| centre.session(trainee, content));
    let (anas, bens) = (anas.await.id, bens.await.id);
    let made = models.add(&service, centre.task.id, model(&[ana])).await.unwrap();
    assert!(models.is_trained_on(made.id, ana).await.unwrap() && !models.is_trained_on(made.id, ben).await.unwrap());
    centre.store.sessions().erase(&service, bens).await.unwrap();
    assert!(models.in_use(&service, centre.task.id).await.unwrap().unwrap().definition.is_some());
    centre.store.sessions().erase(&service, anas).await.unwrap();
    assert!(models.in_use(&service, centre.task.id).await.unwrap().unwrap().definition.is_none());
}

#[tokio::test]
async fn models_are_made_of_the_last_usable_sessions_of_people_of_a_declared_level() {
    let centre = TestCentre::with_camera_and_colours().await;
    let trainee = async |body: serde_json::Value| {
        centre.store.trainees().create(&Scope::service(), serde_json::from_value(body).unwrap()).await.unwrap().id
    };
    let ana = trainee(serde_json::json!({"name": "Ana", "level": "expert"})).await;
    let ben = trainee(serde_json::json!({"name": "Ben", "level": "expert"})).await;
    let eve = trainee(serde_json::json!({"name": "Eve"})).await;
    for (trainee, days) in [(ana, 0..4), (ben, 0..1), (eve, 0..1)] {
        for day in days {
            centre.practised(trainee, NOW_MS + day, vec![duration(10.0 + day as f64, 1.0)]).await;
        }
    }
    let declared = async |pipeline, each, most| {
        let sessions = centre.store.skill_models().declared(centre.task.id, pipeline, each, most).await.unwrap();
        let value = |readings: &[Reading]| readings[0].value.unwrap();
        sessions.into_iter().map(|s| (s.trainee, s.level, s.tools, value(&s.readings))).collect::<Vec<_>>()
    };
    let anas = |days: &[f64]| days.iter().map(|day| (ana, Level::Expert, 1, 10.0 + day)).collect::<Vec<_>>();
    let mut two = [anas(&[3.0, 2.0]), vec![(ben, Level::Expert, 1, 10.0)]].concat();
    two.sort_by_key(|row| row.0);
    assert_eq!(declared("1", 2, 9).await, two, "Eve has no declared level");
    assert_eq!(declared("1", 3, 1).await, anas(&[3.0, 2.0, 1.0]), "of one person: who practised last");
    assert_eq!(declared("2", 2, 9).await, [], "another version of the program");
}
