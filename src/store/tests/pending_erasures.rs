//! Trainees who wait for their erasure are hidden from all people until it is taken back.

use std::net::Ipv4Addr;
use std::time::Duration;

use crate::domain::cohort::NewCohort;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::{Secret, SecretHash};
use crate::domain::text::Key;
use crate::ids::{SessionId, TraineeId};
use crate::store::testing::TestCentre;
use crate::store::{
    ActsAs, CookieLifetime, Members, NewToken, PageRequest, PersonRecord, SessionFilter, SignInOrigin, StoreError,
};

const WEEK: Duration = Duration::from_secs(7 * 86_400);
const SIGN_IN: CookieLifetime =
    CookieLifetime { idle: Duration::from_secs(3_600), max_age: Duration::from_secs(36_000) };

/// A centre with a trainee `ana` who has an account and a session, in a group of an instructor and in a cohort.
struct HiddenFixture {
    centre: TestCentre,
    ana: TraineeId,
    account: PersonRecord,
    session: SessionId,
    administrator: Scope,
    instructor: Scope,
    token: Secret,
    /// The secret of a link for the account's password.
    link: SecretHash,
}

impl HiddenFixture {
    async fn new() -> Self {
        let centre = TestCentre::with_camera_and_colours().await;
        let ana = centre.trainee("Ana").await;
        centre.trainee("Ben").await;
        let account = centre.person("ana", Role::Trainee, Some(ana.id)).await;
        let (boss, ines) = (
            centre.person("boss", Role::Administrator, None).await,
            centre.person("ines", Role::Instructor, None).await,
        );
        centre.group("Group", &[&ines], &[&ana]).await;
        let session = centre.practised(ana.id, 1_000, vec![]).await.id;
        let cohort: NewCohort =
            serde_json::from_value(serde_json::json!({"name": "Cohort", "members": [ana.id]})).unwrap();
        centre.store.cohorts().create(&Scope::service(), cohort).await.unwrap();
        let (link, day) = (Secret::random().hash(), Duration::from_secs(86_400));
        centre.store.password_links().create(&Scope::service(), account.id, link, day).await.unwrap();
        let token = Secret::random();
        let new = NewToken {
            name: "program".parse().unwrap(),
            acts_as: ActsAs::Person(account.id, Role::Trainee),
            expires_at_ms: None,
            secret: token.hash(),
        };
        centre.store.tokens().create(&Scope::service(), new).await.unwrap();
        let (administrator, instructor) = (boss.scope(), ines.scope());
        Self { centre, ana: ana.id, account, session, administrator, instructor, token, link }
    }

    async fn request(&self) {
        let key = Key::from(&self.ana);
        self.centre.store.pending_erasures().request(&self.administrator, &key, WEEK).await.unwrap();
    }

    /// Where the trainee can be found, through this scope: a name and a number for each place.
    async fn found(&self, scope: &Scope) -> Vec<(&'static str, usize)> {
        let (store, page) = (&self.centre.store, &PageRequest::new(100, None));
        let filter = SessionFilter::default();
        let is_ana = |id: &TraineeId| *id == self.ana;
        let groups = store.groups().list(scope).await.unwrap();
        let mut found = vec![
            (
                "list",
                store.trainees().list(scope, page).await.unwrap().items.iter().filter(|one| is_ana(&one.id)).count(),
            ),
            ("one", store.trainees().get(scope, &Key::from(&self.ana)).await.iter().count()),
            ("named", store.trainees().named(scope, &[self.ana]).await.unwrap().len()),
            ("sessions", store.sessions().list(scope, &filter, page).await.unwrap().items.len()),
            ("session", store.sessions().get(scope, self.session).await.iter().count()),
            ("result", store.sessions().result(scope, self.session).await.iter().flatten().count()),
            ("comments", store.comments().of_session(scope, self.session).await.iter().count()),
            (
                "jobs",
                store
                    .jobs()
                    .list(scope, false, page)
                    .await
                    .unwrap()
                    .items
                    .iter()
                    .filter(|job| job.session_id.is_some())
                    .count(),
            ),
            ("members", groups.iter().map(|group| group.members.trainees.iter().filter(|id| is_ana(id)).count()).sum()),
        ];
        if scope.is_administrator() {
            let people = store.people().list(scope, page).await.unwrap().items;
            found.push(("accounts", people.iter().filter(|person| person.trainee_id == Some(self.ana)).count()));
            found.push(("links", store.password_links().list(scope).await.unwrap().len()));
            found.push(("tokens", store.tokens().list(scope).await.unwrap().len()));
        }
        found
    }
}

#[tokio::test]
async fn a_trainee_who_waits_is_nowhere_and_everywhere_again_when_it_is_taken_back() {
    let at = HiddenFixture::new().await;
    let store = &at.centre.store;
    let before = [at.found(&at.administrator).await, at.found(&at.instructor).await];
    assert!(before.iter().flatten().all(|(_, number)| *number == 1), "{before:?}");
    at.request().await;
    let waiting = [at.found(&at.administrator).await, at.found(&at.instructor).await];
    assert!(waiting.iter().flatten().all(|(_, number)| *number == 0), "{waiting:?}");
    assert_eq!(store.cohorts().list(&at.administrator, &PageRequest::new(9, None)).await.unwrap().items[0].people, 0);
    // The service's own work, such as a running job, still finds the session.
    assert!(store.sessions().get(&Scope::service(), at.session).await.is_ok());
    for scope in [&at.administrator, &at.instructor] {
        let listed = store.pending_erasures().list(scope).await.unwrap();
        assert_eq!((listed.len(), listed[0].trainee_id, listed[0].sessions), (1, at.ana, 1));
        assert_eq!(listed[0].due_at_ms - listed[0].requested_at_ms, 7 * 86_400_000);
    }
    let back = store.pending_erasures().take_back(&at.instructor, &Key::from(&at.ana)).await.unwrap();
    assert_eq!(back.id, at.ana);
    assert_eq!([at.found(&at.administrator).await, at.found(&at.instructor).await], before);
    assert!(store.pending_erasures().take_back(&at.instructor, &Key::from(&at.ana)).await.is_err());
}

#[tokio::test]
async fn a_trainee_who_waits_cannot_sign_in_and_is_signed_out() {
    let at = HiddenFixture::new().await;
    let store = &at.centre.store;
    let (cookie, password) = (Secret::random(), at.centre.password_of(&at.account).await);
    store.cookies().create(cookie.hash(), (&at.account, &password), SIGN_IN, SignInOrigin::default()).await.unwrap();
    assert!(store.tokens().scope_of(at.token.hash()).await.unwrap().is_some());
    at.request().await;
    assert!(store.cookies().person_of(cookie.hash(), SIGN_IN).await.unwrap().is_none());
    assert!(!store.cookies().is_valid(cookie.hash(), SIGN_IN).await.unwrap(), "open connections end");
    assert!(store.people().by_login(&"ana".parse().unwrap()).await.unwrap().is_none());
    assert!(store.tokens().scope_of(at.token.hash()).await.unwrap().is_none());
    let late = store.cookies().create(cookie.hash(), (&at.account, &password), SIGN_IN, SignInOrigin::default()).await;
    assert!(matches!(late, Err(StoreError::NotFound { .. })), "the password was verified before");
    let links = store.password_links();
    assert!(links.look_up(at.link).await.unwrap().is_none(), "it names the account");
    let used = links.set_password(at.link, password, Ipv4Addr::LOCALHOST.into(), vec![]).await;
    assert!(matches!(used, Err(StoreError::NotFound { .. })));
    store.pending_erasures().take_back(&at.administrator, &Key::from(&at.ana)).await.unwrap();
    assert!(store.people().by_login(&"ana".parse().unwrap()).await.unwrap().is_some());
    assert!(store.tokens().scope_of(at.token.hash()).await.unwrap().is_some());
    assert!(links.look_up(at.link).await.unwrap().is_some());
}

#[tokio::test]
async fn an_erasure_that_is_taken_back_after_it_was_listed_as_due_erases_nothing() {
    let at = HiddenFixture::new().await;
    let (pending, key) = (at.centre.store.pending_erasures(), Key::from(&at.ana));
    at.request().await;
    assert!(matches!(pending.erase_due(at.ana).await, Err(StoreError::NotFound { .. })), "not due yet");
    at.centre.clock.advance(WEEK);
    assert_eq!(pending.due().await.unwrap(), [at.ana]);
    pending.take_back(&at.instructor, &key).await.unwrap();
    assert!(matches!(pending.erase_due(at.ana).await, Err(StoreError::NotFound { .. })));
    assert!(at.centre.store.trainees().get(&at.instructor, &key).await.is_ok());
    pending.request(&at.administrator, &key, Duration::ZERO).await.unwrap();
    pending.erase_due(at.ana).await.unwrap();
    assert!(at.centre.store.trainees().get(&Scope::service(), &key).await.is_err());
}

#[tokio::test]
async fn a_group_that_is_changed_meanwhile_keeps_the_trainee_who_waits() {
    let at = HiddenFixture::new().await;
    let store = &at.centre.store;
    at.request().await;
    let group = store.groups().list(&at.administrator).await.unwrap().remove(0);
    let members = Members { trainees: vec![], ..group.members };
    store.groups().set_members(&at.administrator, group.id, members).await.unwrap();
    store.pending_erasures().take_back(&at.administrator, &Key::from(&at.ana)).await.unwrap();
    assert_eq!(store.groups().list(&at.administrator).await.unwrap()[0].members.trainees, [at.ana]);
}

#[tokio::test]
async fn only_staff_who_see_a_trainee_erase_them_or_take_it_back() {
    let at = HiddenFixture::new().await;
    let (store, key) = (&at.centre.store, Key::from(&at.ana));
    let other = at.centre.person("omar", Role::Instructor, None).await.scope();
    let own = at.account.scope();
    let pending = store.pending_erasures();
    assert!(matches!(pending.request(&other, &key, WEEK).await, Err(StoreError::NotFound { .. })));
    assert!(matches!(pending.request(&own, &key, WEEK).await, Err(StoreError::Forbidden { .. })));
    assert!(matches!(pending.list(&own).await, Err(StoreError::Forbidden { .. })));
    at.request().await;
    assert_eq!(pending.list(&other).await.unwrap(), []);
    assert!(matches!(pending.take_back(&other, &key).await, Err(StoreError::NotFound { .. })));
    assert!(matches!(store.trainees().erase(&other, &key).await, Err(StoreError::NotFound { .. })));
    // Erased at once, although they wait.
    store.trainees().erase(&at.instructor, &key).await.unwrap();
    assert_eq!(pending.list(&at.administrator).await.unwrap(), []);
    assert_eq!(store.check().await.unwrap(), Vec::<String>::new());
}
