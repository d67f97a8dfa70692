//! Visibility: every role against every noun on personal data, for own, others' and missing things. Others' things must
//! look exactly like missing ones.

use std::time::Duration;

use proptest::prelude::*;

use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::domain::trainee::TraineeChange;
use crate::ids::{JobId, SessionId, TaskId, TraineeId, UploadId};
use crate::motion::features::time::DURATION;
use crate::store::testing::{NOW_MS, TestCentre};
use crate::store::{NewUpload, PageRequest, SessionFilter, Store, StoreError, StoreResult};

/// The things of one trainee.
struct Things {
    trainee: TraineeId,
    task: TaskId,
    session: SessionId,
    job: JobId,
    upload: UploadId,
}

const NOUNS: [&str; 10] =
    ["trainee", "change", "session", "result", "retry", "practice", "last task", "job", "upload", "erase session"];

/// Requests one thing of a trainee; only success or failure matters, not the content.
async fn ask(store: &Store, scope: &Scope, noun: &str, of: &Things) -> StoreResult<()> {
    let trainee = Key::from(&of.trainee);
    match noun {
        "trainee" => store.trainees().get(scope, &trainee).await.map(drop),
        "change" => store.trainees().change(scope, &trainee, TraineeChange::default()).await.map(drop),
        "session" => store.sessions().get(scope, of.session).await.map(drop),
        "result" => store.sessions().result(scope, of.session).await.map(drop),
        "retry" => store.sessions().retry(scope, of.session).await.map(drop),
        "practice" => store.sessions().practice(scope, of.trainee, of.task, &[&DURATION], 10).await.map(drop),
        "last task" => {
            store.sessions().last_task(scope, of.trainee).await?.map(drop).ok_or(StoreError::NotFound { what: "task" })
        }
        "job" => store.jobs().get(scope, of.job).await.map(drop),
        "upload" => store.uploads().get(scope, of.upload).await.map(drop),
        "erase session" => store.sessions().erase(scope, of.session).await,
        noun => panic!("no such noun: {noun}"),
    }
}

/// True if the role may do this with things in its scope.
fn may(role: Role, noun: &str) -> bool {
    match noun {
        "change" | "retry" | "erase session" => matches!(role, Role::Administrator | Role::Instructor),
        _ => role != Role::Agent,
    }
}

async fn things_of(centre: &TestCentre, name: &str) -> Things {
    let trainee = centre.trainee(name).await.id;
    let session = centre.session(trainee, name).await;
    let new = NewUpload {
        id: UploadId::at(NOW_MS),
        trainee,
        task: centre.task.id,
        in_box: centre.the_box.id,
        filename: "clip.mp4".parse().unwrap(),
        metadata: String::new(),
        recorded_at_ms: None,
        time: None,
        length: 5,
        expires_at_ms: NOW_MS + 1_000,
    };
    let upload = centre.store.uploads().create(&Scope::service(), new, 9).await.unwrap().id;
    Things { trainee, task: centre.task.id, session: session.id, job: session.job_id.unwrap(), upload }
}

fn missing() -> Things {
    let (trainee, task) = (TraineeId::at(1), TaskId::at(1));
    Things { trainee, task, session: SessionId::at(1), job: JobId::at(1), upload: UploadId::at(1) }
}

#[tokio::test]
async fn every_role_sees_its_own_and_others_look_like_missing() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (ana, ben) = (things_of(&centre, "Ana").await, things_of(&centre, "Ben").await);
    let instructor = centre.person("ina", Role::Instructor, None).await;
    let account = centre.person("ana", Role::Trainee, Some(ana.trainee)).await;
    let ana_herself = centre.store.trainees().get(&Scope::service(), &Key::from(&ana.trainee)).await.unwrap();
    centre.group("A", &[&instructor], &[&ana_herself]).await;
    let administrator = Scope::administrator(centre.person("ada", Role::Administrator, None).await.id);
    let reaches_ana_only = [instructor.scope(), account.scope()];
    let agent = Scope::agent(centre.the_box.id);
    for noun in NOUNS {
        for scope in &reaches_ana_only {
            let absent = ask(&centre.store, scope, noun, &missing()).await.unwrap_err().to_string();
            let another = ask(&centre.store, scope, noun, &ben).await.unwrap_err().to_string();
            assert_eq!(another, absent, "{} can distinguish another's {noun} from a missing one", scope.role());
        }
        let reaching = [(&administrator, &ben), (&reaches_ana_only[1], &ana), (&reaches_ana_only[0], &ana)];
        for (scope, own) in reaching {
            let answer = ask(&centre.store, scope, noun, own).await;
            match may(scope.role(), noun) {
                true => assert!(answer.is_ok(), "{} {noun}: {answer:?}", scope.role()),
                false => assert!(matches!(answer, Err(StoreError::Forbidden { .. })), "{} {noun}", scope.role()),
            }
        }
    }
    let others_job = ask(&centre.store, &agent, "job", &ana).await;
    assert!(matches!(others_job, Err(StoreError::NotFound { .. })), "{others_job:?}");
}

#[tokio::test]
async fn an_audience_decides_like_a_query_of_each_person() {
    let centre = TestCentre::with_camera_and_colours().await;
    let store = &centre.store;
    let (ana, ben) = (things_of(&centre, "Ana").await, things_of(&centre, "Ben").await);
    let ana_herself = store.trainees().get(&Scope::service(), &Key::from(&ana.trainee)).await.unwrap();
    let (ina, ino) =
        (centre.person("ina", Role::Instructor, None).await, centre.person("ino", Role::Instructor, None).await);
    centre.group("A", &[&ina], &[&ana_herself]).await;
    centre.group("B", &[&ina, &ino], &[&ana_herself]).await;
    let administrator = centre.person("ada", Role::Administrator, None).await.scope();
    let own = |login, trainee| centre.person(login, Role::Trainee, Some(trainee));
    let scopes = [
        administrator.clone(),
        ina.scope(),
        ino.scope(),
        own("ana", ana.trainee).await.scope(),
        own("ben", ben.trainee).await.scope(),
        Scope::agent(centre.the_box.id),
    ];
    for is_waiting in [false, true] {
        if is_waiting {
            let week = Duration::from_secs(7 * 86_400);
            store.pending_erasures().request(&administrator, &Key::from(&ana.trainee), week).await.unwrap();
        }
        let mut seen = 0;
        for things in [&ana, &ben, &missing()] {
            let audience = store.trainees().audience(things.trainee).await.unwrap();
            let shared = store.sessions().shared(things.session).await;
            for scope in &scopes {
                let sees = ask(store, scope, "trainee", things).await.is_ok();
                assert_eq!(audience.includes(scope), sees, "{scope:?}");
                let session = shared.as_ref().ok().and_then(|session| session.seen_by(scope));
                assert_eq!(session.is_some(), ask(store, scope, "session", things).await.is_ok(), "{scope:?}");
                seen += usize::from(sees);
            }
        }
        assert_eq!(seen, if is_waiting { 2 } else { 6 }, "Ana waits for her erasure: {is_waiting}");
    }
}

#[tokio::test]
async fn an_agent_sees_its_box_and_no_person() {
    let centre = TestCentre::with_camera_and_colours().await;
    let ana = things_of(&centre, "Ana").await;
    let new_box = serde_json::from_str(r#"{"name":"Box 2"}"#).unwrap();
    let other = centre.store.boxes().create(&Scope::service(), new_box).await.unwrap();
    let (store, agent) = (&centre.store, Scope::agent(centre.the_box.id));
    for noun in NOUNS.into_iter().filter(|noun| *noun != "upload") {
        let answer = ask(store, &agent, noun, &ana).await;
        assert!(matches!(answer, Err(StoreError::NotFound { .. })), "{noun}: {answer:?}");
    }
    let boxes = store.boxes().list(&agent, &PageRequest::default()).await.unwrap();
    assert_eq!(boxes.items.iter().map(|found| found.id).collect::<Vec<_>>(), [centre.the_box.id]);
    assert!(store.boxes().get(&agent, &Key::from(&other.id)).await.is_err());
    assert!(store.calibrations().in_use(&agent, centre.the_box.id).await.unwrap().is_some());
    assert!(store.tasks().list(&agent, &PageRequest::default()).await.unwrap().items.is_empty());
    assert!(store.trainees().list(&agent, &PageRequest::default()).await.unwrap().items.is_empty());
}

#[tokio::test]
async fn only_administrators_run_the_centre_and_only_staff_change_it() {
    let centre = TestCentre::with_camera_and_colours().await;
    let ana = things_of(&centre, "Ana").await;
    let account = centre.person("ana", Role::Trainee, Some(ana.trainee)).await;
    let instructor = centre.person("ina", Role::Instructor, None).await;
    let store = &centre.store;
    for scope in [account.scope(), instructor.scope(), Scope::agent(centre.the_box.id)] {
        let page = PageRequest::default();
        assert!(matches!(store.people().list(&scope, &page).await, Err(StoreError::Forbidden { .. })));
        assert!(matches!(store.tokens().list(&scope).await, Err(StoreError::Forbidden { .. })));
        assert!(matches!(store.audit().list(&scope, &page).await, Err(StoreError::Forbidden { .. })));
        assert!(matches!(
            store
                .people()
                .get(&scope, centre.person(&format!("x{:?}", scope.role()), Role::Instructor, None).await.id)
                .await,
            Err(StoreError::NotFound { .. })
        ));
    }
    for scope in [account.scope(), Scope::agent(centre.the_box.id)] {
        assert!(store.tasks().create(&scope, serde_json::from_str(r#"{"name":"T"}"#).unwrap()).await.is_err());
        assert!(store.groups().create(&scope, "C".parse().unwrap()).await.is_err());
        assert!(store.boxes().delete(&scope, &Key::from(&centre.the_box.id)).await.is_err());
        assert!(store.trainees().create(&scope, serde_json::from_str(r#"{"name":"T"}"#).unwrap()).await.is_err());
    }
    assert_eq!(store.people().get(&account.scope(), account.id).await.unwrap(), account);
}

#[tokio::test]
async fn a_trainee_cannot_send_a_recording_of_another_trainee() {
    let centre = TestCentre::with_camera_and_colours().await;
    let (ana, ben) = (things_of(&centre, "Ana").await, things_of(&centre, "Ben").await);
    let account = centre.person("ana", Role::Trainee, Some(ana.trainee)).await;
    let own = centre.store.sessions().create(&account.scope(), centre.new_session(ana.trainee, "second try")).await;
    assert!(own.is_ok(), "{own:?}");
    let anothers = centre.store.sessions().create(&account.scope(), centre.new_session(ben.trainee, "a trick")).await;
    assert!(matches!(anothers, Err(StoreError::NotFound { what: "trainee" })), "{anothers:?}");
}

const INSTRUCTORS: usize = 3;
const TRAINEES: usize = 4;
const GROUPS: usize = 3;

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    /// With any groups, an instructor's lists hold exactly the trainees and sessions of the groups that they teach.
    #[test]
    fn lists_hold_exactly_the_trainees_of_the_groups(
        teaches in prop::array::uniform3(prop::array::uniform3(any::<bool>())),
        belongs in prop::array::uniform3(prop::array::uniform4(any::<bool>())),
    ) {
        let runtime = tokio::runtime::Runtime::new().unwrap();
        runtime.block_on(check_lists(teaches, belongs));
    }
}

async fn check_lists(teaches: [[bool; INSTRUCTORS]; GROUPS], belongs: [[bool; TRAINEES]; GROUPS]) {
    let centre = TestCentre::with_camera_and_colours().await;
    let (mut instructors, mut trainees) = (Vec::new(), Vec::new());
    for number in 0..INSTRUCTORS {
        instructors.push(centre.person(&format!("i{number}"), Role::Instructor, None).await);
    }
    for number in 0..TRAINEES {
        let trainee = centre.trainee(&format!("T{number}")).await;
        centre.session(trainee.id, &format!("recording {number}")).await;
        trainees.push(trainee);
    }
    for group in 0..GROUPS {
        let teachers: Vec<_> = instructors.iter().zip(teaches[group]).filter(|(_, t)| *t).map(|(i, _)| i).collect();
        let members: Vec<_> = trainees.iter().zip(belongs[group]).filter(|(_, b)| *b).map(|(t, _)| t).collect();
        centre.group(&format!("G{group}"), &teachers, &members).await;
    }
    for (number, instructor) in instructors.iter().enumerate() {
        let sees = |trainee: usize| (0..GROUPS).any(|group| teaches[group][number] && belongs[group][trainee]);
        let expected: Vec<_> = (0..TRAINEES).filter(|t| sees(*t)).map(|t| trainees[t].id).collect();
        let (scope, page) = (instructor.scope(), PageRequest::default());
        let listed = centre.store.trainees().list(&scope, &page).await.unwrap();
        assert_eq!(listed.items.iter().map(|trainee| trainee.id).collect::<Vec<_>>(), expected);
        let sessions = centre.store.sessions().list(&scope, &SessionFilter::default(), &page).await.unwrap();
        let mut owners: Vec<_> = sessions.items.iter().map(|session| session.trainee_id).collect();
        owners.sort();
        let mut expected = expected;
        expected.sort();
        assert_eq!(owners, expected);
        let jobs = centre.store.jobs().list(&scope, false, &page).await.unwrap();
        assert_eq!(jobs.items.iter().filter(|job| job.session_id.is_some()).count(), expected.len());
    }
}
