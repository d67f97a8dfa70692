//! Single sign-on with a provider whose answers the tests choose. A whole provider and a browser are in
//! `tests/browser/single_sign_on.test.mjs`.

mod provider;

use std::sync::Arc;
use std::time::Duration;

use reqwest::{Response, StatusCode, header};
use serde_json::{Value, json};
use tempfile::TempDir;
use trocar::domain::role::Role;
use trocar::domain::single_sign_on::GroupRoles;
use trocar::settings::Settings;
use trocar::time::{ManualClock, SharedClock, SystemClock};

use super::centre::PASSWORD;
use crate::support::{ADMINISTRATOR, Client, Service, poll, problem, read};
use provider::{CLIENT, Fault, Provider};

const START: &str = "/api/v1/single-sign-on/start";
const FINISH: &str = "/api/v1/single-sign-on/finish";

/// A service that signs people in with a provider.
struct SetUp {
    service: Service,
    provider: Provider,
    _secret: TempDir,
}

impl SetUp {
    async fn open() -> Self {
        Self::open_with(Arc::new(SystemClock), |_| ()).await
    }

    async fn open_with(clock: SharedClock, change: impl FnOnce(&mut Settings)) -> Self {
        let provider = Provider::start().await;
        let secret = tempfile::tempdir().unwrap();
        let settings = settings_for(provider.issuer(), &secret);
        let data = tempfile::tempdir().unwrap();
        let service = Service::start_in(data, clock, |all| {
            settings(all);
            change(all);
        });
        let set_up = Self { service: service.await, provider, _secret: secret };
        set_up.wait_until_known().await;
        set_up
    }

    async fn wait_until_known(&self) {
        poll("a sign-in that can begin", async || {
            let begun = self.service.stranger().post(START, json!({})).await;
            (begun.status() == StatusCode::OK).then_some(())
        })
        .await;
    }

    /// Begins a sign-in, and visits the provider. Returns the browser and the state.
    async fn begin(&self, browser: Client, path: &str, body: Value) -> (Client, String) {
        let answer = browser.post(path, body).await;
        let attempt = cookie_of(&answer);
        let browser = match browser.headers().get(header::COOKIE) {
            Some(_) => browser.clone().with("cookie", &format!("{}; {attempt}", browser.cookie())),
            None => browser.with("cookie", &attempt),
        };
        let begun = read(answer, StatusCode::OK).await;
        (browser, self.provider.visit(begun["address"].as_str().unwrap()))
    }

    /// Signs in with a new browser, as the account that the provider has now.
    async fn sign_in(&self) -> Response {
        let (browser, state) = self.begin(self.service.stranger(), START, json!({})).await;
        browser.post(FINISH, json!({"state": state, "code": "a-code"})).await
    }

    /// The same, which must work. Returns the browser, and the person.
    async fn signed_in(&self) -> (Client, Value) {
        let answer = self.sign_in().await;
        let browser = self.service.stranger();
        let browser = if answer.status() == StatusCode::OK { browser.with_cookie_of(&answer) } else { browser };
        let person = read(answer, StatusCode::OK).await["person"].clone();
        (browser, person)
    }

    /// The same, which must be refused with this reason.
    async fn refused(&self, reason: &str) {
        let answer = self.sign_in().await;
        assert!(!answer.headers().contains_key(header::SET_COOKIE), "{reason}");
        let refused = problem(answer, 403, "single-sign-on").await;
        assert_eq!(refused["reason"], reason, "{refused}");
    }
}

/// Settings of single sign-on with this provider.
fn settings_for(issuer: String, folder: &TempDir) -> impl FnOnce(&mut Settings) + use<> {
    let file = folder.path().join("secret");
    std::fs::write(&file, format!("{}\n", CLIENT.1)).unwrap();
    move |settings| {
        let of = &mut settings.single_sign_on;
        of.issuer = Some(issuer);
        of.client_id = Some(CLIENT.0.to_owned());
        of.client_secret_file = Some(file);
        of.name = Some("Test hospital".to_owned());
        let roles = [("admins", Role::Administrator), ("teachers", Role::Instructor), ("students", Role::Trainee)];
        of.roles = GroupRoles::from_iter(roles.map(|(group, role)| (group.to_owned(), role)));
    }
}

/// Name and value of the first cookie that an answer sets.
fn cookie_of(answer: &Response) -> String {
    let cookie = answer.headers()[header::SET_COOKIE].to_str().unwrap();
    cookie.split(';').next().unwrap().to_owned()
}

/// What the audit trail says, newest first: action and noun.
async fn trail(administrator: &Client) -> Vec<String> {
    let entries = administrator.read("/api/v1/audit-entries").await;
    let text = |entry: &Value| format!("{} {}", entry["action"].as_str().unwrap(), entry["noun"].as_str().unwrap());
    entries["items"].as_array().unwrap().iter().map(text).collect()
}

#[tokio::test]
async fn a_first_sign_in_makes_an_account_whose_role_follows_the_groups() {
    let set_up = SetUp::open().await;
    let administrator = set_up.service.administrator().await;
    let described = set_up.service.stranger().read("/api/v1/single-sign-on").await;
    assert_eq!(described, json!({"is_set_up": true, "name": "Test hospital"}));

    set_up.provider.sign_in_as("ines", &["teachers", "others"]);
    let (first, ines) = set_up.signed_in().await;
    assert_eq!((&ines["login"], &ines["name"]), (&json!("ines"), &json!("Name of ines")));
    assert_eq!((&ines["role"], &ines["password"]), (&json!("instructor"), &json!("missing")));
    let me = first.read("/api/v1/me").await;
    assert_eq!((&me["must_change_password"], &me["has_password"]), (&json!(false), &json!(false)));
    assert_eq!(me["by_single_sign_on"], true);
    assert_eq!(trail(&administrator).await[..2], ["link identity", "create person"]);

    set_up.provider.move_groups_to_user_info();
    let (second, same) = set_up.signed_in().await;
    assert_eq!(same["id"], ines["id"], "the user info has the groups");

    set_up.provider.sign_in_as("ines", &["teachers", "admins"]);
    let (third, same) = set_up.signed_in().await;
    assert_eq!((&same["id"], &same["role"]), (&ines["id"], &json!("administrator")));
    assert_eq!(trail(&administrator).await[0], "change role person");
    assert_eq!(second.get("/api/v1/me").await.status(), StatusCode::UNAUTHORIZED, "opened with the old role");
    let token = third.make("/api/v1/tokens", json!({"name": "A program", "role": "administrator"})).await;
    let program = set_up.service.stranger().with_token(token["token"].as_str().unwrap());
    program.read("/api/v1/me").await;

    set_up.provider.sign_in_as("ines", &["others"]);
    set_up.refused("no-group").await;
    assert_eq!(trail(&administrator).await[..2], ["refuse identity", "withdraw tokens"]);
    for ended in [&third, &program] {
        assert_eq!(ended.get("/api/v1/me").await.status(), StatusCode::UNAUTHORIZED, "the access is gone");
    }
    set_up.provider.sign_in_as("ines", &["teachers"]);
    let (_, same) = set_up.signed_in().await;
    assert_eq!((&same["id"], &same["role"]), (&ines["id"], &json!("instructor")));
}

#[tokio::test]
async fn an_account_of_this_centre_is_never_taken_by_its_login() {
    let set_up = SetUp::open().await;
    set_up.provider.sign_in_as(ADMINISTRATOR.0, &["teachers"]);
    let (_, person) = set_up.signed_in().await;
    assert_eq!((&person["login"], &person["role"]), (&json!("administrator-2"), &json!("instructor")));
    set_up.service.administrator().await;
}

#[tokio::test]
async fn hostile_answers_sign_no_person_in() {
    let set_up = SetUp::open().await;
    set_up.provider.sign_in_as("mallory", &["admins"]);
    for fault in [
        Fault::Audience,
        Fault::Issuer,
        Fault::Nonce,
        Fault::Expired,
        Fault::Key,
        Fault::Unsigned,
        Fault::SharedSecret,
        Fault::AccessToken,
        Fault::NoIdToken,
        Fault::NotJson,
    ] {
        set_up.provider.fail(fault);
        let refused = problem(set_up.sign_in().await, 403, "single-sign-on").await;
        assert_eq!(refused["reason"], "untrusted", "{fault:?}");
    }
    set_up.provider.fail(Fault::Refused);
    set_up.refused("refused").await;
    for fault in [Fault::Huge, Fault::Redirect] {
        set_up.provider.fail(fault);
        let status = set_up.sign_in().await.status();
        assert!(status == StatusCode::FORBIDDEN || status == StatusCode::SERVICE_UNAVAILABLE, "{fault:?}: {status}");
    }
    set_up.provider.sign_in_as("mallory", &["admins"]);
    set_up.provider.move_groups_to_user_info();
    set_up.provider.fail(Fault::UserInfoOfOther);
    set_up.refused("untrusted").await;
    let administrator = set_up.service.administrator().await;
    assert_eq!(administrator.read("/api/v1/identities").await["items"], json!([]));
    set_up.provider.fail(Fault::None);
    set_up.signed_in().await;
}

#[tokio::test]
async fn an_answer_belongs_to_one_browser_and_is_used_once() {
    let clock = ManualClock::at(1_700_000_000_000);
    let set_up = SetUp::open_with(clock.clone(), |_| ()).await;
    set_up.provider.sign_in_as("ines", &["teachers"]);
    let (browser, state) = set_up.begin(set_up.service.stranger(), START, json!({"next": "/sessions?x=1"})).await;
    let answer = json!({"state": state, "code": "a-code"});
    let (other, _) = set_up.begin(set_up.service.stranger(), START, json!({})).await;
    for thief in [&other, &set_up.service.stranger()] {
        assert_eq!(problem(thief.post(FINISH, answer.clone()).await, 410, "gone").await["reason"], "expired");
    }
    // The provider takes part in the last sign-in that began.
    let (browser, state) = set_up.begin(browser, START, json!({"next": "/sessions?x=1"})).await;
    let answer = json!({"state": state, "code": "a-code"});
    let finished = read(browser.post(FINISH, answer.clone()).await, StatusCode::OK).await;
    assert_eq!((&finished["next"], &finished["linked"]), (&json!("/sessions?x=1"), &json!(false)));
    problem(browser.post(FINISH, answer).await, 410, "gone").await;

    let (browser, state) = set_up.begin(set_up.service.stranger(), START, json!({})).await;
    clock.advance(Duration::from_secs(601));
    problem(browser.post(FINISH, json!({"state": state, "code": "a-code"})).await, 410, "gone").await;
    let (browser, state) = set_up.begin(set_up.service.stranger(), START, json!({})).await;
    let denied = browser.post(FINISH, json!({"state": state, "error": "access_denied"})).await;
    assert_eq!(problem(denied, 403, "single-sign-on").await["reason"], "cancelled");
    let (browser, state) = set_up.begin(set_up.service.stranger(), START, json!({})).await;
    let mixed = browser.post(FINISH, json!({"state": state, "code": "a-code", "iss": "https://other.example"})).await;
    assert_eq!(problem(mixed, 403, "single-sign-on").await["reason"], "untrusted");
    for next in ["https://evil.example", "//evil.example", "/\\evil.example"] {
        problem(set_up.service.stranger().post(START, json!({"next": next})).await, 422, "invalid").await;
    }
}

#[tokio::test]
async fn a_hospital_behind_one_address_signs_in_at_the_same_time() {
    let set_up = SetUp::open().await;
    set_up.provider.sign_in_as("ines", &["teachers"]);
    for _ in 0..120 {
        read(set_up.service.stranger().post(START, json!({})).await, StatusCode::OK).await;
    }
    set_up.signed_in().await;
}

#[tokio::test]
async fn the_provider_may_be_down_and_may_change_its_keys() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let (address, secret) = (listener.local_addr().unwrap(), tempfile::tempdir().unwrap());
    drop(listener); // nothing answers there
    let service = Service::start_with(settings_for(format!("http://{address}"), &secret)).await;
    service.administrator().await;
    let down = problem(service.stranger().post(START, json!({})).await, 503, "busy").await;
    assert_eq!(down["reason"], "unreachable");
    let listener = tokio::net::TcpListener::bind(address).await.unwrap();
    let set_up = SetUp { service, provider: Provider::start_at(listener), _secret: secret };
    set_up.wait_until_known().await;
    set_up.provider.sign_in_as("ines", &["teachers"]);
    set_up.provider.change_key();
    poll("a sign-in with the new key", async || (set_up.sign_in().await.status() == StatusCode::OK).then_some(()))
        .await;
}

#[tokio::test]
async fn a_person_links_an_account_and_keeps_the_role_of_this_centre() {
    let set_up = SetUp::open().await;
    let administrator = set_up.service.administrator().await;
    for login in ["omar", "olga"] {
        let account = json!({"login": login, "name": login, "role": "instructor", "password": PASSWORD});
        administrator.make("/api/v1/people", account).await;
    }
    set_up.provider.sign_in_as("omar-at-work", &["students"]);
    let omar = set_up.service.sign_in("omar", PASSWORD).await;
    for given in [json!({}), json!({"password": "not the right one"})] {
        problem(omar.post("/api/v1/me/identities", given).await, 401, "wrong-credentials").await;
    }
    let own = json!({"password": PASSWORD});
    let (browser, state) = set_up.begin(omar.clone(), "/api/v1/me/identities", own.clone()).await;
    let answer = json!({"state": state, "code": "a-code"});
    let linked = read(browser.post(FINISH, answer).await, StatusCode::OK).await;
    assert_eq!((&linked["linked"], &linked["person"]["login"]), (&json!(true), &json!("omar")));
    let linked = omar.read("/api/v1/me/identities").await["items"][0].clone();
    assert_eq!((&linked["label"], &linked["follows_groups"]), (&json!("omar-at-work"), &json!(false)));

    let (by_provider, person) = set_up.signed_in().await;
    assert_eq!((&person["login"], &person["role"]), (&json!("omar"), &json!("instructor")), "not a trainee");
    set_up.provider.sign_in_as("omar-at-work", &[]);
    set_up.refused("no-group").await;
    by_provider.read("/api/v1/me").await;

    // Another person cannot take it, and a browser that is signed in to another account cannot finish it.
    set_up.provider.sign_in_as("omar-at-work", &["teachers"]);
    let olga = set_up.service.sign_in("olga", PASSWORD).await;
    let (browser, state) = set_up.begin(olga.clone(), "/api/v1/me/identities", own.clone()).await;
    let taken = browser.post(FINISH, json!({"state": state, "code": "a-code"})).await;
    assert_eq!(problem(taken, 403, "single-sign-on").await["reason"], "linked-elsewhere");
    set_up.provider.sign_in_as("olga-at-work", &["teachers"]);
    let (browser, state) = set_up.begin(olga, "/api/v1/me/identities", own).await;
    let attempt = browser.cookie().split("; ").last().unwrap().to_owned();
    let swapped = omar.clone().with("cookie", &format!("{}; {attempt}", omar.cookie()));
    problem(swapped.post(FINISH, json!({"state": state, "code": "a-code"})).await, 410, "gone").await;

    let listed = administrator.read("/api/v1/identities").await["items"].clone();
    assert_eq!(listed.as_array().unwrap().len(), 1);
    let path = format!("/api/v1/identities/{}", listed[0]["id"].as_str().unwrap());
    assert_eq!(administrator.delete(&path).await.status(), StatusCode::NO_CONTENT);
    assert_eq!(by_provider.get("/api/v1/me").await.status(), StatusCode::UNAUTHORIZED, "it ended with the link");
    omar.read("/api/v1/me").await;
    assert_eq!(trail(&administrator).await[0], "unlink identity");
}

#[tokio::test]
async fn a_sign_out_ends_the_sign_in_at_the_provider_too() {
    let set_up = SetUp::open().await;
    set_up.provider.sign_in_as("ines", &["teachers"]);
    let (browser, _) = set_up.signed_in().await;
    let own = browser.read("/api/v1/me/identities").await["items"][0]["id"].as_str().unwrap().to_owned();
    problem(browser.delete(&format!("/api/v1/me/identities/{own}")).await, 409, "conflict").await;
    let ended = read(browser.post("/api/v1/single-sign-on/sign-out", json!({})).await, StatusCode::OK).await;
    let address: reqwest::Url = ended["address"].as_str().unwrap().parse().unwrap();
    let value = |name: &str| address.query_pairs().find(|(key, _)| key == name).unwrap().1.into_owned();
    assert_eq!(address.path(), "/end");
    assert_eq!(value("post_logout_redirect_uri"), format!("http://{}/", set_up.service.address()));
    assert_eq!(value("id_token_hint").split('.').count(), 3);
    assert_eq!(browser.get("/api/v1/me").await.status(), StatusCode::UNAUTHORIZED);
    let by_password = set_up.service.administrator().await;
    let ended = read(by_password.post("/api/v1/single-sign-on/sign-out", json!({})).await, StatusCode::OK).await;
    assert_eq!(ended, json!({"address": null}));
}

#[tokio::test]
async fn a_trainee_gets_a_record_and_is_erased_with_the_link() {
    let set_up = SetUp::open().await;
    let administrator = set_up.service.administrator().await;
    set_up.provider.sign_in_as("ada", &["students"]);
    let (ada, person) = set_up.signed_in().await;
    let trainee = person["trainee"].as_str().unwrap().to_owned();
    assert_eq!(administrator.read(&format!("/api/v1/trainees/{trainee}")).await["name"], "Name of ada");
    let export = ada.get(&format!("/api/v1/trainees/{trainee}/data.zip")).await.bytes().await.unwrap();
    let mut export = zip::ZipArchive::new(std::io::Cursor::new(export)).unwrap();
    let profile = std::io::read_to_string(export.by_name("profile.json").unwrap()).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&profile).unwrap()["identities"][0]["subject"], "ada");

    set_up.provider.sign_in_as("ada", &["teachers"]);
    set_up.refused("role-changed").await;
    assert_eq!(ada.get("/api/v1/me").await.status(), StatusCode::UNAUTHORIZED);
    set_up.provider.sign_in_as("ada", &["students"]);
    let later = format!("/api/v1/trainees/{trainee}?can_be_taken_back=true");
    assert_eq!(administrator.delete(&later).await.status(), StatusCode::NO_CONTENT);
    set_up.refused("being-erased").await;
    assert_eq!(administrator.read("/api/v1/identities").await["items"], json!([]), "hidden meanwhile");
    let now = administrator.delete(&format!("/api/v1/trainees/{trainee}")).await;
    assert_eq!(now.status(), StatusCode::NO_CONTENT);
    let (_, again) = set_up.signed_in().await;
    assert_ne!(again["id"], person["id"], "the link went with the person");
}

#[tokio::test]
async fn accounts_are_made_only_if_the_settings_say_so() {
    let closed = |settings: &mut Settings| settings.single_sign_on.make_accounts = false;
    let set_up = SetUp::open_with(Arc::new(SystemClock), closed).await;
    set_up.provider.sign_in_as("ines", &["admins"]);
    set_up.refused("no-account").await;
    let without = Service::start().await;
    problem(without.stranger().post(START, json!({})).await, 409, "conflict").await;
    assert_eq!(without.stranger().read("/api/v1/single-sign-on").await["is_set_up"], false);
}

#[tokio::test]
async fn the_last_administrator_keeps_the_role_and_the_path_of_the_service_is_in_the_address() {
    let below = |settings: &mut Settings| {
        settings.http.base_path = "/trocar".parse().unwrap();
        settings.http.public_url = Some("https://skills.example/trocar/".to_owned());
    };
    let set_up = SetUp::open_with(Arc::new(SystemClock), below).await;
    set_up.provider.sign_in_as("ines", &["admins"]);
    let (ines, person) = set_up.signed_in().await;
    assert_eq!(set_up.provider.redirect(), "https://skills.example/trocar/single-sign-on");
    let people = ines.read("/api/v1/people").await;
    let other = people["items"].as_array().unwrap().iter().find(|one| one["id"] != person["id"]).unwrap();
    let path = format!("/api/v1/people/{}", other["id"].as_str().unwrap());
    assert_eq!(ines.delete(&path).await.status(), StatusCode::NO_CONTENT);
    set_up.provider.sign_in_as("ines", &["teachers"]);
    let (_, same) = set_up.signed_in().await;
    assert_eq!(same["role"], "administrator");
    // With the link the service would lose the only account that can administer it.
    let made = json!({"login": "late", "name": "Late", "role": "administrator"});
    let late = ines.make("/api/v1/people", made).await;
    let identities = ines.read("/api/v1/identities").await;
    let link = format!("/api/v1/identities/{}", identities["items"][0]["id"].as_str().unwrap());
    problem(ines.delete(&link).await, 409, "conflict").await;
    let chosen = json!({"password": "a door with four hinges"});
    let answer = ines.patch(&format!("/api/v1/people/{}", late["id"].as_str().unwrap()), chosen).await;
    read(answer, StatusCode::OK).await;
    assert_eq!(ines.delete(&link).await.status(), StatusCode::NO_CONTENT);
}
