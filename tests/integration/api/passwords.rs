//! Passwords that another person chose, and links for choosing one.

use std::process::Command;
use std::time::Duration;

use reqwest::{Method, Response, StatusCode, header};
use serde_json::{Value, json};
use trocar::time::ManualClock;

use super::centre::{Centre, PASSWORD};
use super::documents::operations;
use crate::support::{ADMINISTRATOR, Client, Service, problem, read};

const OWN: &str = "a password of one's own";
const NO_ID: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";

/// A client that signs in as the service's own pages do: a browser adds the header.
fn page(service: &Service) -> Client {
    service.stranger().with("origin", &format!("http://{}", service.address()))
}

async fn try_sign_in(service: &Service, login: &str, password: &str) -> Response {
    service.stranger().post("/api/v1/sign-in", json!({"login": login, "password": password})).await
}

/// The id of the account with this login.
async fn id_of(administrator: &Client, login: &str) -> String {
    let people = administrator.read("/api/v1/people").await;
    let found = people["items"].as_array().unwrap().iter().find(|person| person["login"] == login).unwrap();
    found["id"].as_str().unwrap().to_owned()
}

/// Makes a link for the password of this account, and returns its secret.
async fn make_link(administrator: &Client, person: &str) -> String {
    let made = administrator.make("/api/v1/password-links", json!({"person": person})).await;
    made["secret"].as_str().unwrap().to_owned()
}

async fn use_link(service: &Service, secret: &str, new: &str) -> Response {
    service.stranger().post("/api/v1/password-links/use", json!({"secret": secret, "new": new})).await
}

async fn open_link(service: &Service, secret: &str) -> Response {
    service.stranger().post("/api/v1/password-links/open", json!({"secret": secret})).await
}

/// Asserts that this sign-in may do nothing but read who it is, change the password and sign out.
async fn assert_held(client: &Client) {
    let document = client.read("/api/v1/openapi.json").await;
    let mut refused = 0;
    for (path, method, operation) in operations(&document) {
        let is_public = operation["security"].as_array().is_some_and(|ways| ways.iter().all(|way| *way == json!({})))
            || !path.starts_with("/api/v1/");
        let is_sign_out = path.ends_with("/sign-out");
        let is_needed = is_sign_out || matches!(path.as_str(), "/api/v1/me" | "/api/v1/me/password");
        if is_public || is_needed {
            continue;
        }
        let parts = path.split('/').map(|part| if part.starts_with('{') { NO_ID } else { part });
        let method: Method = method.to_uppercase().parse().unwrap();
        let answer = client.request(method.clone(), &parts.collect::<Vec<_>>().join("/"));
        let answer = answer.header("tus-resumable", "1.0.0").json(&json!({})).send().await.unwrap();
        if method == Method::HEAD {
            assert_eq!(answer.status(), StatusCode::FORBIDDEN, "{method} {path}");
        } else {
            let document: Value = answer.json().await.unwrap_or_else(|e| panic!("{method} {path}: {e}"));
            assert_eq!(document["type"], "/problems/password-change-required", "{method} {path}: {document}");
        }
        refused += 1;
    }
    assert!(refused > 90, "{refused} routes were tried");
    assert_eq!(client.read("/api/v1/me").await["must_change_password"], json!(true));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_password_that_must_be_changed_opens_nothing_else() {
    let centre = Centre::open().await;
    let account = json!({"login": "nora", "name": "Nora", "role": "administrator", "password": PASSWORD,
        "must_change_password": true});
    let made = centre.administrator.make("/api/v1/people", account).await;
    assert_eq!(made["password"], "change_required");
    let signed_in = read(try_sign_in(&centre.service, "nora", PASSWORD).await, StatusCode::OK).await;
    assert_eq!(signed_in["must_change_password"], json!(true));
    let nora = centre.service.sign_in("nora", PASSWORD).await;
    assert_held(&nora).await;
    let change = async |old: &str, new: &str| nora.post("/api/v1/me/password", json!({"old": old, "new": new})).await;
    problem(change("not it at all", OWN).await, 401, "wrong-credentials").await;
    let same = problem(change(PASSWORD, PASSWORD).await, 422, "invalid").await;
    assert_eq!(same["errors"][0]["field"], "new");
    let changed = change(PASSWORD, OWN).await;
    assert_eq!(changed.status(), StatusCode::NO_CONTENT);
    problem(nora.get("/api/v1/me").await, 401, "not-signed-in").await;
    let nora = nora.clone().with_cookie_of(&changed);
    assert_eq!(nora.read("/api/v1/me").await["must_change_password"], json!(false));
    nora.read("/api/v1/people").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_administrator_can_demand_the_change_of_a_new_password_and_tokens_stay_valid() {
    let centre = Centre::open().await;
    let made = centre.administrator.make("/api/v1/tokens", json!({"name": "nightly", "role": "administrator"})).await;
    let program = centre.service.stranger().with_token(made["token"].as_str().unwrap());
    let me = id_of(&centre.administrator, ADMINISTRATOR.0).await;
    let set = json!({"password": "a given password", "must_change_password": true, "keep_tokens": true});
    let changed = read(centre.administrator.patch(&format!("/api/v1/people/{me}"), set).await, StatusCode::OK).await;
    assert_eq!(changed["password"], "change_required");
    let held = centre.service.sign_in(ADMINISTRATOR.0, "a given password").await;
    problem(held.get("/api/v1/people").await, 403, "password-change-required").await;
    assert_eq!(held.post("/api/v1/sign-out", json!({})).await.status(), StatusCode::NO_CONTENT);
    program.read("/api/v1/people").await;
    assert_eq!(program.read("/api/v1/me").await["must_change_password"], json!(false));
    // Without the demand, a password is used as it is: programs create accounts for programs.
    let ines = id_of(&program, "ines").await;
    let set = json!({"password": "another given password"});
    read(program.patch(&format!("/api/v1/people/{ines}"), set).await, StatusCode::OK).await;
    centre.service.sign_in("ines", "another given password").await.read("/api/v1/boxes").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_password_binds_the_pages_and_no_program() {
    let service = Service::start().await;
    let program = service.administrator().await;
    assert_eq!(program.read("/api/v1/people").await["items"][0]["password"], "change_in_browser");
    let same = json!({"old": ADMINISTRATOR.1, "new": ADMINISTRATOR.1});
    let same = problem(program.post("/api/v1/me/password", same).await, 422, "invalid").await;
    assert_eq!(same["errors"][0]["field"], "new", "a program's change would free the pages");
    let held = page(&service).signed_in(ADMINISTRATOR.0, ADMINISTRATOR.1).await;
    assert_held(&held).await;
    let change = json!({"old": ADMINISTRATOR.1, "new": OWN});
    assert_eq!(held.post("/api/v1/me/password", change).await.status(), StatusCode::NO_CONTENT);
    let free = page(&service).signed_in(ADMINISTRATOR.0, OWN).await;
    assert_eq!(free.read("/api/v1/people").await["items"][0]["password"], "own");
}

/// Runs a command line of `trocar admin` on the service's data, and returns what it prints.
fn admin(service: &Service, line: &str) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trocar"));
    command.args(["admin", "--data"]).arg(service.data.path()).args(line.split(' '));
    let output = command.output().unwrap();
    assert!(output.status.success(), "{line}: {output:?}");
    String::from_utf8(output.stdout).unwrap().trim().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_password_that_a_command_has_set_binds_the_pages_and_no_program() {
    let service = Service::start().await;
    for line in ["user add nora --role instructor", "user password nora"] {
        let password = admin(&service, line);
        service.sign_in("nora", &password).await.read("/api/v1/boxes").await;
        let held = page(&service).signed_in("nora", &password).await;
        problem(held.get("/api/v1/boxes").await, 403, "password-change-required").await;
        let change = json!({"old": password, "new": OWN});
        assert_eq!(held.post("/api/v1/me/password", change).await.status(), StatusCode::NO_CONTENT);
        page(&service).signed_in("nora", OWN).await.read("/api/v1/boxes").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_link_sets_a_password_once_and_ends_what_the_old_one_opened() {
    let centre = Centre::open().await;
    let made = centre.administrator.make("/api/v1/tokens", json!({"name": "nightly", "role": "instructor"})).await;
    let program = centre.service.stranger().with_token(made["token"].as_str().unwrap());
    let id = id_of(&centre.administrator, ADMINISTRATOR.0).await;
    let secret = make_link(&centre.administrator, &id).await;
    assert_eq!(secret.len(), 43, "32 bytes");
    let list = centre.administrator.read("/api/v1/password-links").await;
    assert_eq!(list["items"][0]["person"], json!(id));
    assert!(!list.to_string().contains(&secret), "{list}");
    let opened = read(open_link(&centre.service, &secret).await, StatusCode::OK).await;
    assert_eq!((&opened["login"], &opened["name"]), (&json!("administrator"), &json!("Administrator")));
    problem(use_link(&centre.service, &secret, "short").await, 422, "invalid").await;
    centre.administrator.read("/api/v1/me").await; // until the link is used, nothing has changed

    let person = read(use_link(&centre.service, &secret, OWN).await, StatusCode::OK).await;
    assert_eq!((&person["login"], &person["password"]), (&json!("administrator"), &json!("own")));
    problem(centre.administrator.get("/api/v1/me").await, 401, "not-signed-in").await;
    problem(program.get("/api/v1/me").await, 401, "not-signed-in").await;
    problem(try_sign_in(&centre.service, ADMINISTRATOR.0, ADMINISTRATOR.1).await, 401, "wrong-credentials").await;
    problem(use_link(&centre.service, &secret, "yet another password").await, 410, "gone").await;
    problem(open_link(&centre.service, &secret).await, 410, "gone").await;
    let again = page(&centre.service).signed_in(ADMINISTRATOR.0, OWN).await;
    assert_eq!(again.read("/api/v1/me").await["must_change_password"], json!(false));
    let audit = again.read("/api/v1/audit-entries").await;
    let entries = audit["items"].as_array().unwrap().iter().filter(|entry| entry["noun"] == "password_link");
    let entries: Vec<_> = entries.map(|entry| (entry["action"].as_str().unwrap(), entry["subject"].clone())).collect();
    assert_eq!(entries, [("use", json!(id)), ("create", json!(id))]);
    assert!(!audit.to_string().contains(&secret));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_newer_link_a_withdrawal_another_password_and_time_end_a_link() {
    let clock = ManualClock::at(1_800_000_000_000);
    let service = Service::start_with_clock(clock.clone()).await;
    let administrator = service.administrator().await;
    let account = json!({"login": "ines", "name": "Ines", "role": "instructor", "password": PASSWORD});
    administrator.make("/api/v1/people", account).await;
    let id = id_of(&administrator, "ines").await;
    let ended = async |secret: &str| {
        problem(open_link(&service, secret).await, 410, "gone").await;
        problem(use_link(&service, secret, OWN).await, 410, "gone").await;
    };

    let first = make_link(&administrator, &id).await;
    let second = make_link(&administrator, &id).await;
    ended(&first).await;
    let list = administrator.read("/api/v1/password-links").await;
    assert_eq!(list["items"].as_array().unwrap().len(), 1);
    let address = format!("/api/v1/password-links/{}", list["items"][0]["id"].as_str().unwrap());
    assert_eq!(administrator.delete(&address).await.status(), StatusCode::NO_CONTENT);
    problem(administrator.delete(&address).await, 404, "not-found").await;
    ended(&second).await;

    let third = make_link(&administrator, &id).await;
    let ines = service.sign_in("ines", PASSWORD).await;
    let change = json!({"old": PASSWORD, "new": "a second password"});
    assert_eq!(ines.post("/api/v1/me/password", change).await.status(), StatusCode::NO_CONTENT);
    ended(&third).await;

    let fourth = make_link(&administrator, &id).await;
    let set = json!({"password": "a third password"});
    read(administrator.patch(&format!("/api/v1/people/{id}"), set).await, StatusCode::OK).await;
    ended(&fourth).await;

    let fifth = make_link(&administrator, &id).await;
    clock.advance(Duration::from_secs(24 * 3600 - 1));
    read(open_link(&service, &fifth).await, StatusCode::OK).await;
    clock.advance(Duration::from_secs(1));
    ended(&fifth).await;
    service.sign_in("ines", "a third password").await;
    let list = service.administrator().await.read("/api/v1/password-links").await;
    assert_eq!(list["items"], json!([]));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_person_needs_no_password_that_another_person_knows() {
    let centre = Centre::open().await;
    let account = json!({"login": "nora", "name": "Nora", "role": "instructor"});
    let made = centre.administrator.make("/api/v1/people", account).await;
    assert_eq!(made["password"], "missing");
    for guess in ["", "nora", PASSWORD] {
        problem(try_sign_in(&centre.service, "nora", guess).await, 401, "wrong-credentials").await;
    }
    let secret = make_link(&centre.administrator, made["id"].as_str().unwrap()).await;
    read(use_link(&centre.service, &secret, OWN).await, StatusCode::OK).await;
    let nora = page(&centre.service).signed_in("nora", OWN).await;
    assert_eq!(nora.read("/api/v1/me").await["must_change_password"], json!(false));
    let account = json!({"login": "olga", "name": "Olga", "role": "instructor", "must_change_password": true});
    let refused = problem(centre.administrator.post("/api/v1/people", account).await, 422, "invalid").await;
    assert_eq!(refused["errors"][0]["field"], "must_change_password");
    let unknown = centre.administrator.post("/api/v1/password-links", json!({"person": NO_ID})).await;
    problem(unknown, 422, "unknown-reference").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn guesses_of_links_count_against_the_address() {
    let service = Service::start_with(|settings| settings.http.free_attempts = 1).await;
    let administrator = service.administrator().await;
    let id = id_of(&administrator, ADMINISTRATOR.0).await;
    let secret = make_link(&administrator, &id).await;
    let mut guesses = 0;
    let refused = loop {
        let guess = if guesses % 2 == 0 { "A".repeat(43) } else { "no secret".to_owned() };
        let answer = open_link(&service, &guess).await;
        guesses += 1;
        assert!(guesses < 40, "an address guesses on");
        if answer.status() != StatusCode::GONE {
            break answer;
        }
    };
    assert!(refused.headers().contains_key(header::RETRY_AFTER));
    problem(refused, 429, "too-many").await;
    read(open_link(&service, &secret).await, StatusCode::OK).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_link_lets_its_browser_sign_in_while_a_stranger_guesses() {
    let service = Service::start_with(|settings| {
        settings.http.free_attempts = 2;
        settings.http.trusted_proxies = vec!["127.0.0.0/8".parse().unwrap()];
    })
    .await;
    let administrator = service.administrator().await;
    let at = |address: &str| service.stranger().with("x-forwarded-for", address);
    let guess_until_refused = async || {
        for n in 0..=255 {
            let guess = json!({"login": ADMINISTRATOR.0, "password": "guess"});
            let answer = at(&format!("198.51.100.{n}")).post("/api/v1/sign-in", guess).await;
            if answer.status() == StatusCode::TOO_MANY_REQUESTS {
                return problem(answer, 429, "too-many").await;
            }
        }
        panic!("a stranger guesses on");
    };
    let assert_lets_in = async |secret: &str, new: &str, network: &str| {
        let used = json!({"secret": secret, "new": new});
        let set = at(&format!("{network}.7")).post("/api/v1/password-links/use", used).await;
        assert_eq!(set.status(), StatusCode::OK, "a link does not wait");
        let cookie = set.headers()[header::SET_COOKIE].to_str().unwrap().split(';').next().unwrap().to_owned();
        assert!(cookie.starts_with("__Host-trocar-browser="), "{cookie}");
        guess_until_refused().await;
        let (elsewhere, sign_in) = (at(&format!("{network}.8")), json!({"login": ADMINISTRATOR.0, "password": new}));
        problem(elsewhere.post("/api/v1/sign-in", sign_in.clone()).await, 429, "too-many").await;
        let known = elsewhere.with("cookie", &cookie).post("/api/v1/sign-in", sign_in).await;
        assert_eq!(known.status(), StatusCode::OK, "the browser that used the link, at another address");
    };
    let refused = guess_until_refused().await;
    assert!(refused["detail"].as_str().unwrap().contains("a link for a new password"), "{refused}");
    assert!(refused["sign_in_wait_s"].as_u64() > Some(0), "{refused}");
    let secret = make_link(&administrator, &id_of(&administrator, ADMINISTRATOR.0).await).await;
    assert_lets_in(&secret, OWN, "192.0.2").await;
    let printed = admin(&service, &format!("user link {}", ADMINISTRATOR.0));
    assert_lets_in(printed.strip_prefix("/choose-password#").unwrap(), "another password", "203.0.113").await;
}
