//! Cookies, tokens, accounts.

use std::collections::HashSet;
use std::net::Ipv4Addr;
use std::time::Duration;

use crate::domain::password_state::PasswordState;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::{Password, Secret, SecretHash};
use crate::domain::text::Name;
use crate::store::testing::{NOW_MS, TestCentre};
use crate::store::{ActsAs, CookieLifetime, NewSignIn, NewToken, PersonChange, SignInOrigin, StoreError};

const LASTS: CookieLifetime =
    CookieLifetime { idle: Duration::from_secs(30 * 60), max_age: Duration::from_secs(12 * 3600) };

fn sign_in_with(secret: SecretHash) -> NewSignIn {
    NewSignIn { secret, lasts: LASTS, origin: SignInOrigin::default() }
}

#[tokio::test]
async fn a_cookie_counts_until_its_holder_is_idle_too_long_or_half_a_day_has_passed() {
    let centre = TestCentre::new().await;
    let person = centre.person("ina", Role::Instructor, None).await;
    let (cookies, secret) = (centre.store.cookies(), Secret::random().hash());
    cookies
        .create(secret, (&person, &centre.password_of(&person).await), LASTS, SignInOrigin::default())
        .await
        .unwrap();
    for _ in 0..24 {
        assert_eq!(cookies.person_of(secret, LASTS).await.unwrap().map(|holder| holder.person).as_ref(), Some(&person));
        centre.clock.advance(Duration::from_secs(29 * 60));
    }
    assert!(cookies.person_of(secret, LASTS).await.unwrap().is_some()); // 11 h 36 min, never idle
    centre.clock.advance(Duration::from_secs(25 * 60));
    assert_eq!(cookies.person_of(secret, LASTS).await.unwrap(), None); // 12 h 1 min
    assert_eq!(cookies.forget_expired().await.unwrap(), 1);

    let idle = Secret::random().hash();
    cookies.create(idle, (&person, &centre.password_of(&person).await), LASTS, SignInOrigin::default()).await.unwrap();
    centre.clock.advance(Duration::from_secs(30 * 60));
    assert_eq!(cookies.person_of(idle, LASTS).await.unwrap(), None);
}

#[tokio::test]
async fn a_new_password_signs_all_browsers_out_and_in_again_only_the_one_that_chose_it() {
    let centre = TestCentre::new().await;
    let (people, cookies) = (centre.store.people(), centre.store.cookies());
    let person = centre.person("ina", Role::Instructor, None).await;
    let given = (Password::random().hash(), PasswordState::ChangeRequired);
    people.set_password(&Scope::service(), person.id, given, false).await.unwrap();
    let (held, verified) = people.by_login(&person.login).await.unwrap().unwrap();
    let (old, fresh) = (Secret::random().hash(), Secret::random().hash());
    cookies.create(old, (&held, &verified), LASTS, SignInOrigin::default()).await.unwrap();
    let password = Password::new("another horse").unwrap();
    people.set_own_password(&person.scope(), password.hash(), verified, false, sign_in_with(fresh)).await.unwrap();
    assert_eq!(cookies.person_of(old, LASTS).await.unwrap(), None);
    let holder = cookies.person_of(fresh, LASTS).await.unwrap().unwrap();
    assert_eq!((holder.person.id, holder.must_change_password), (person.id, false));
    let (_, hash) = centre.store.people().by_login(&"ina".parse().unwrap()).await.unwrap().unwrap();
    assert!(hash.matches(&password));
}

#[tokio::test]
async fn a_password_that_was_replaced_after_it_was_verified_opens_nothing_and_replaces_nothing() {
    let centre = TestCentre::new().await;
    let (people, service) = (centre.store.people(), Scope::service());
    let ina = centre.person("ina", Role::Instructor, None).await;
    let verified = centre.password_of(&ina).await;
    let new = || (Password::random().hash(), PasswordState::ChangeRequired);
    people.set_password(&service, ina.id, new(), false).await.unwrap();
    let present = centre.password_of(&ina).await;
    let secret = Secret::random().hash();
    let late = centre.store.cookies().create(secret, (&ina, &verified), LASTS, SignInOrigin::default()).await;
    assert!(matches!(late, Err(StoreError::NotFound { .. })), "{late:?}");
    assert_eq!(centre.store.cookies().person_of(secret, LASTS).await.unwrap(), None);
    let late = people.set_own_password(&ina.scope(), new().0, verified, false, sign_in_with(secret)).await;
    assert!(matches!(late, Err(StoreError::NotFound { .. })), "{late:?}");
    assert_eq!(centre.password_of(&ina).await, present);
    assert_eq!(centre.store.cookies().person_of(secret, LASTS).await.unwrap(), None);
    people.set_own_password(&ina.scope(), new().0, present, false, sign_in_with(secret)).await.unwrap();
}

#[tokio::test]
async fn another_role_signs_all_browsers_out_and_another_name_none() {
    let centre = TestCentre::new().await;
    let (people, service) = (centre.store.people(), Scope::service());
    centre.person("root", Role::Administrator, None).await;
    let (ada, ina) =
        (centre.person("ada", Role::Administrator, None).await, centre.person("ina", Role::Instructor, None).await);
    let (of_ada, of_ina) = (Secret::random().hash(), Secret::random().hash());
    centre
        .store
        .cookies()
        .create(of_ada, (&ada, &centre.password_of(&ada).await), LASTS, SignInOrigin::default())
        .await
        .unwrap();
    centre
        .store
        .cookies()
        .create(of_ina, (&ina, &centre.password_of(&ina).await), LASTS, SignInOrigin::default())
        .await
        .unwrap();
    let counts = async |secret| centre.store.cookies().is_valid(secret, LASTS).await.unwrap();
    let same =
        PersonChange { name: Some("Ada".parse().unwrap()), role: Some(Role::Administrator), ..PersonChange::default() };
    people.change(&service, ada.id, same).await.unwrap();
    people.change(&service, ada.id, PersonChange::default()).await.unwrap();
    assert!(counts(of_ada).await);
    let less = PersonChange { role: Some(Role::Instructor), ..PersonChange::default() };
    people.change(&service, ada.id, less).await.unwrap();
    assert!(!counts(of_ada).await);
    assert!(counts(of_ina).await, "another person's");
}

#[tokio::test]
async fn many_sign_ins_are_checked_at_once_and_the_end_of_one_is_announced() {
    let centre = TestCentre::new().await;
    let (ina, cookies) = (centre.person("ina", Role::Instructor, None).await, centre.store.cookies());
    let (password, [first, second, unknown]) = (centre.password_of(&ina).await, [1, 2, 3].map(|n| SecretHash([n; 32])));
    for secret in [first, second] {
        cookies.create(secret, (&ina, &password), LASTS, SignInOrigin::default()).await.unwrap();
    }
    let valid = async || cookies.valid_of(vec![first, second, unknown], LASTS).await.unwrap();
    assert_eq!(valid().await, HashSet::from([first, second]));
    let ended = centre.store.ended_sign_ins();
    assert!(!ended.has_changed().unwrap());
    cookies.delete(first).await.unwrap();
    assert!(ended.has_changed().unwrap());
    assert_eq!(valid().await, HashSet::from([second]));
    centre.clock.advance(LASTS.idle);
    assert_eq!(valid().await, HashSet::new(), "it has idled out");
    assert_eq!(cookies.valid_of(vec![], LASTS).await.unwrap(), HashSet::new());
}

#[tokio::test]
async fn a_token_never_has_more_rights_than_its_person_has_today() {
    let centre = TestCentre::new().await;
    let (tokens, service) = (centre.store.tokens(), Scope::service());
    centre.person("root", Role::Administrator, None).await;
    let ada = centre.person("ada", Role::Administrator, None).await;
    let make = async |acts_as, secret: &Secret| {
        let new = NewToken { name: "t".parse().unwrap(), acts_as, expires_at_ms: None, secret: secret.hash() };
        tokens.create(&service, new).await
    };
    let (full, less) = (Secret::random(), Secret::random());
    make(ActsAs::Person(ada.id, Role::Administrator), &full).await.unwrap();
    make(ActsAs::Person(ada.id, Role::Instructor), &less).await.unwrap();
    assert_eq!(role_of(&centre, &full).await, Some(Role::Administrator));
    assert_eq!(role_of(&centre, &less).await, Some(Role::Instructor));
    let become_one = async |role| {
        let change = PersonChange { role: Some(role), ..PersonChange::default() };
        centre.store.people().change(&service, ada.id, change).await.unwrap();
    };
    become_one(Role::Instructor).await;
    let left = tokens.list(&service).await.unwrap();
    assert_eq!(left.iter().map(|token| token.role).collect::<Vec<_>>(), [Role::Instructor], "the other is withdrawn");
    assert_eq!(role_of(&centre, &full).await, None);
    assert_eq!(role_of(&centre, &less).await, Some(Role::Instructor));
    become_one(Role::Administrator).await;
    assert_eq!(role_of(&centre, &full).await, None, "it does not come back with the role");
    become_one(Role::Instructor).await;
    let more = make(ActsAs::Person(ada.id, Role::Administrator), &Secret::random()).await;
    assert!(matches!(more, Err(StoreError::Refused { .. })), "{more:?}");
}

#[tokio::test]
async fn a_token_is_withdrawn_together_with_the_one_that_made_it() {
    let centre = TestCentre::new().await;
    let (tokens, service) = (centre.store.tokens(), Scope::service());
    let ada = centre.person("ada", Role::Administrator, None).await;
    let make = async |scope: &Scope, acts_as| {
        let secret = Secret::random();
        let new = NewToken { name: "t".parse().unwrap(), acts_as, expires_at_ms: None, secret: secret.hash() };
        (tokens.create(scope, new).await.unwrap(), secret)
    };
    let by = async |secret: &Secret| tokens.scope_of(secret.hash()).await.unwrap().unwrap();
    let (first, of_first) = make(&service, ActsAs::Person(ada.id, Role::Administrator)).await;
    let (second, of_second) = make(&by(&of_first).await, ActsAs::Person(ada.id, Role::Administrator)).await;
    let (_, of_box) = make(&by(&of_second).await, ActsAs::Agent(centre.the_box.id)).await;
    let (_, other) = make(&ada.scope(), ActsAs::Person(ada.id, Role::Instructor)).await;
    assert_eq!((first.made_with, second.made_with), (None, Some(first.id)));
    for withdraw in
        [tokens.delete(&by(&of_second).await, first.id).await, tokens.delete_own(&by(&other).await, first.id).await]
    {
        assert!(matches!(withdraw, Err(StoreError::Forbidden { .. })), "{withdraw:?}");
    }
    tokens.delete(&by(&of_first).await, first.id).await.unwrap();
    for (secret, role) in [(of_first, None), (of_second, None), (of_box, None), (other, Some(Role::Instructor))] {
        assert_eq!(role_of(&centre, &secret).await, role);
    }
}

#[tokio::test]
async fn a_token_changes_no_access_of_an_administrator_and_nothing_of_a_refused_change_is_stored() {
    let centre = TestCentre::new().await;
    let people = centre.store.people();
    let (ada, eve) =
        (centre.person("ada", Role::Administrator, None).await, centre.person("eve", Role::Administrator, None).await);
    let ina = centre.person("ina", Role::Instructor, None).await;
    let secret = Secret::random();
    let acts_as = ActsAs::Person(ada.id, Role::Administrator);
    let new = NewToken { name: "t".parse().unwrap(), acts_as, expires_at_ms: None, secret: secret.hash() };
    centre.store.tokens().create(&ada.scope(), new).await.unwrap();
    let program = centre.store.tokens().scope_of(secret.hash()).await.unwrap().unwrap();
    let (password, none) = (|| (Password::random().hash(), PasswordState::Own), PersonChange::default);
    let present = centre.password_of(&eve).await;
    for (person, change) in [
        (&eve, PersonChange { login: Some("mallory".parse().unwrap()), ..none() }),
        (&eve, PersonChange { role: Some(Role::Instructor), ..none() }),
        (&eve, PersonChange { name: Some("Mallory".parse().unwrap()), password: Some(password()), ..none() }),
        (&ina, PersonChange { role: Some(Role::Administrator), password: Some(password()), ..none() }),
    ] {
        let refused = people.change(&program, person.id, change).await;
        assert!(matches!(refused, Err(StoreError::Forbidden { .. })), "{refused:?}");
        assert_eq!(&people.get(&program, person.id).await.unwrap(), person);
    }
    let set = people.set_password(&program, eve.id, password(), false).await;
    assert!(matches!(set, Err(StoreError::Forbidden { .. })), "{set:?}");
    let deleted = people.delete(&program, eve.id).await;
    assert!(matches!(deleted, Err(StoreError::Forbidden { .. })), "{deleted:?}");
    assert_eq!(centre.password_of(&eve).await, present);

    let (login, role) = (Some(eve.login.clone()), Some(Role::Administrator));
    let same = PersonChange { login, role, name: Some("Eve".parse().unwrap()), ..none() };
    assert_eq!(people.change(&program, eve.id, same).await.unwrap().name.as_str(), "Eve");
    let given = PersonChange { password: Some((password().0, PasswordState::ChangeRequired)), ..none() };
    let changed = people.change(&program, ina.id, given).await.unwrap();
    assert_eq!(changed.password_state, PasswordState::ChangeRequired);
    people.delete(&program, ina.id).await.unwrap();
}

#[tokio::test]
async fn a_link_ends_when_its_maker_is_no_administrator_any_more() {
    let centre = TestCentre::new().await;
    let (people, links, service) = (centre.store.people(), centre.store.password_links(), Scope::service());
    let root = centre.person("root", Role::Administrator, None).await;
    let (ada, eve) =
        (centre.person("ada", Role::Administrator, None).await, centre.person("eve", Role::Administrator, None).await);
    let (ina, ines) =
        (centre.person("ina", Role::Instructor, None).await, centre.person("ines", Role::Instructor, None).await);
    for (maker, person) in [(&root, &ada), (&ada, &ina), (&eve, &ines)] {
        links.create(&maker.scope(), person.id, Secret::random().hash(), Duration::from_secs(3600)).await.unwrap();
    }
    people.change(&service, ada.id, PersonChange::default()).await.unwrap();
    assert_eq!(links.list(&service).await.unwrap().len(), 3);
    let less = PersonChange { role: Some(Role::Instructor), ..PersonChange::default() };
    people.change(&service, ada.id, less).await.unwrap();
    people.delete(&service, eve.id).await.unwrap();
    let left = links.list(&service).await.unwrap();
    assert_eq!(left.iter().map(|link| link.person_id).collect::<Vec<_>>(), [ada.id], "made by another one");
}

/// The role of a token that is still valid.
async fn role_of(centre: &TestCentre, token: &Secret) -> Option<Role> {
    centre.store.tokens().scope_of(token.hash()).await.unwrap().map(|scope| scope.role())
}

#[tokio::test]
async fn a_token_ends_at_its_end_and_with_its_box() {
    let centre = TestCentre::new().await;
    let (tokens, service) = (centre.store.tokens(), Scope::service());
    let secret = Secret::random();
    let new = NewToken {
        name: "box 1".parse().unwrap(),
        acts_as: ActsAs::Agent(centre.the_box.id),
        expires_at_ms: Some(NOW_MS + 10_000),
        secret: secret.hash(),
    };
    tokens.create(&service, new).await.unwrap();
    let of_box = Some(centre.the_box.id.to_string());
    assert_eq!(tokens.scope_of(secret.hash()).await.unwrap().unwrap().subject(), of_box);
    assert!(tokens.list(&service).await.unwrap()[0].last_used_at_ms.is_some());
    centre.clock.advance(Duration::from_secs(10));
    assert_eq!(tokens.scope_of(secret.hash()).await.unwrap(), None);
    centre.store.boxes().delete(&service, &crate::domain::text::Key::from(&centre.the_box.id)).await.unwrap();
    assert!(tokens.list(&service).await.unwrap().is_empty());
}

#[tokio::test]
async fn the_last_administrator_can_neither_go_nor_step_down() {
    let centre = TestCentre::new().await;
    let (people, service) = (centre.store.people(), Scope::service());
    let ada = centre.person("ada", Role::Administrator, None).await;
    assert!(matches!(people.delete(&service, ada.id).await, Err(StoreError::Refused { .. })));
    let demoted = PersonChange { role: Some(Role::Instructor), ..PersonChange::default() };
    assert!(matches!(people.change(&service, ada.id, demoted).await, Err(StoreError::Refused { .. })));
    assert_eq!(people.get(&service, ada.id).await.unwrap(), ada); // undone, not only refused
    centre.person("bob", Role::Administrator, None).await;
    people.delete(&service, ada.id).await.unwrap();
}

#[tokio::test]
async fn the_newest_hundred_places_of_an_account_are_remembered_for_180_days() {
    let centre = TestCentre::new().await;
    let (ada, bob) =
        (centre.person("ada", Role::Instructor, None).await, centre.person("bob", Role::Instructor, None).await);
    let (place, password) = (|n: u8| SecretHash([n; 32]), centre.password_of(&ada).await);
    for n in 0..120 {
        centre.clock.advance(Duration::from_secs(1));
        centre
            .store
            .cookies()
            .create(
                Secret::random().hash(),
                (&ada, &password),
                LASTS,
                SignInOrigin { places: vec![place(n)], ..SignInOrigin::default() },
            )
            .await
            .unwrap();
    }
    let knows = async |person, n| centre.store.cookies().known_place(person, [place(n)]).await.unwrap().is_some();
    assert!(knows(ada.id, 119).await && knows(ada.id, 20).await);
    assert!(!knows(ada.id, 19).await, "the oldest ones are forgotten");
    assert!(!knows(bob.id, 119).await, "another account");
    centre.clock.advance(Duration::from_secs(180 * 86_400 - 50));
    assert!(knows(ada.id, 119).await && !knows(ada.id, 20).await);
    centre.store.cookies().forget_expired().await.unwrap();
    centre.clock.advance(Duration::from_secs(50));
    assert!(!knows(ada.id, 119).await);
}

#[tokio::test]
async fn only_administrators_make_links_for_passwords_and_a_copy_of_the_database_can_forget_them() {
    let centre = TestCentre::new().await;
    let (links, service) = (centre.store.password_links(), Scope::service());
    let ina = centre.person("ina", Role::Instructor, None).await;
    let (secret, day) = (Secret::random().hash(), Duration::from_secs(86_400));
    assert!(matches!(links.create(&ina.scope(), ina.id, secret, day).await, Err(StoreError::Forbidden { .. })));
    assert!(matches!(links.list(&ina.scope()).await, Err(StoreError::Forbidden { .. })));
    let link = links.create(&service, ina.id, secret, day).await.unwrap();
    assert!(matches!(links.withdraw(&ina.scope(), link.id).await, Err(StoreError::Forbidden { .. })));
    assert_eq!(links.look_up(secret).await.unwrap(), Some((link.clone(), ina.clone())));
    centre.store.cookies().forget_all().await.unwrap(); // as a backup does
    assert_eq!(links.look_up(secret).await.unwrap(), None);
    let used = links.set_password(secret, Password::random().hash(), Ipv4Addr::LOCALHOST.into(), vec![]).await;
    assert!(matches!(used, Err(StoreError::NotFound { .. })), "{used:?}");

    links.create(&service, ina.id, secret, day).await.unwrap();
    centre.clock.advance(day);
    centre.store.cookies().forget_expired().await.unwrap();
    let newer = links.create(&service, ina.id, secret, day).await.unwrap();
    assert_eq!(links.list(&service).await.unwrap(), [newer]);
}

#[tokio::test]
async fn a_sign_in_is_held_as_the_state_of_the_password_demands() {
    let centre = TestCentre::new().await;
    let people = centre.store.people();
    let ina = centre.person("ina", Role::Instructor, None).await;
    for (state, from_page, from_program) in [
        (PasswordState::Own, false, false),
        (PasswordState::ChangeInBrowser, true, false),
        (PasswordState::ChangeRequired, true, true),
    ] {
        people.set_password(&Scope::service(), ina.id, (Password::random().hash(), state), false).await.unwrap();
        let ina = people.get(&Scope::service(), ina.id).await.unwrap();
        assert_eq!(ina.password_state, state);
        for (is_page, expected) in [(true, from_page), (false, from_program)] {
            let (secret, origin) = (Secret::random().hash(), SignInOrigin { is_page, ..SignInOrigin::default() });
            centre
                .store
                .cookies()
                .create(secret, (&ina, &centre.password_of(&ina).await), LASTS, origin)
                .await
                .unwrap();
            let holder = centre.store.cookies().person_of(secret, LASTS).await.unwrap().unwrap();
            assert_eq!(holder.must_change_password, expected, "{state}, a page: {is_page}");
        }
    }
}

#[tokio::test]
async fn a_name_that_was_accepted_under_earlier_rules_can_be_read() {
    let centre = TestCentre::new().await;
    let person = centre.person("ina", Role::Instructor, None).await;
    let earlier = "UPDATE person SET name = 'x' || char(8238) || 'y'";
    centre.store.write(async move |tx| Ok(sqlx::query(earlier).execute(tx).await?)).await.unwrap();
    let read = centre.store.people().get(&person.scope(), person.id).await.unwrap();
    assert_eq!(read.name.as_str(), "x\u{202e}y");
    assert!(read.name.as_str().parse::<Name>().is_err(), "a new name is refused");
}
