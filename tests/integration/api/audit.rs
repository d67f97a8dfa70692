//! The audit trail has the address of the client that sent each request, and loses it with the person.

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::centre::{Centre, PASSWORD, recording, session};
use crate::support::{Client, Service, read};

/// A password that a person chooses.
const OWN: &str = "a password of my own";

/// A centre whose service takes this machine for a trusted proxy.
async fn behind_proxy() -> Centre {
    let trust = Service::start_with(|settings| settings.http.trusted_proxies = vec!["127.0.0.0/8".parse().unwrap()]);
    Centre::open_in(trust.await).await
}

/// The client, with the address that a proxy states.
fn at(client: &Client, address: &str) -> Client {
    client.clone().with("x-forwarded-for", address)
}

/// The entries of the audit trail, newest first.
async fn entries(centre: &Centre) -> Vec<Value> {
    centre.administrator.read("/api/v1/audit-entries?limit=50").await["items"].as_array().unwrap().clone()
}

/// The number of entries with this address.
async fn count_of(centre: &Centre, address: &str) -> usize {
    entries(centre).await.iter().filter(|entry| entry["address"] == address).count()
}

/// The id of the account with this login.
async fn account_of(centre: &Centre, login: &str) -> String {
    let people = centre.administrator.read("/api/v1/people").await;
    let found = people["items"].as_array().unwrap().iter().find(|person| person["login"] == login).unwrap();
    found["id"].as_str().unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_direct_client_has_its_own_address_and_cannot_choose_another() {
    let centre = Centre::open().await;
    let stating = at(&centre.instructor, "203.0.113.7").with("forwarded", "for=203.0.113.7");
    for (client, name) in [(&centre.instructor, "Cutting"), (&stating, "Knots")] {
        client.make("/api/v1/tasks", json!({"name": name})).await;
        let last = &entries(&centre).await[0];
        assert_eq!((&last["called"], &last["address"]), (&json!(name), &json!("127.0.0.1")));
    }
    let first = entries(&centre).await.pop().unwrap();
    assert_eq!((&first["by"], &first["address"]), (&json!("service"), &Value::Null), "the first account");
}

#[tokio::test(flavor = "multi_thread")]
async fn behind_a_trusted_proxy_every_change_has_the_address_of_its_client() {
    let centre = behind_proxy().await;
    let ines = account_of(&centre, "ines").await;
    at(&centre.instructor, "203.0.113.1").make("/api/v1/tasks", json!({"name": "Cutting"})).await;
    session(&at(&centre.instructor, "203.0.113.2"), "ada", recording(100, 1)).await;
    let change = json!({"old": PASSWORD, "new": OWN});
    let changed = at(&centre.trainee, "2001:db8::3").post("/api/v1/me/password", change).await;
    assert_eq!(changed.status(), StatusCode::NO_CONTENT);
    let administrator = at(&centre.administrator, "192.0.2.9, 203.0.113.4"); // the client itself added the first one
    let link = administrator.make("/api/v1/password-links", json!({"person": ines})).await;
    let used = json!({"secret": link["secret"], "new": OWN});
    let stranger = at(&centre.service.stranger(), "203.0.113.5");
    read(stranger.post("/api/v1/password-links/use", used).await, StatusCode::OK).await;
    let last = entries(&centre).await.into_iter().take(5);
    let last: Vec<_> = last.map(|entry| json!([entry["action"], entry["noun"], entry["address"]])).collect();
    let expected = json!([
        ["use", "password_link", "203.0.113.5"],
        ["create", "password_link", "203.0.113.4"],
        ["set password", "person", "2001:db8::3"],
        ["create", "session", "203.0.113.2"],
        ["create", "task", "203.0.113.1"],
    ]);
    assert_eq!(json!(last), expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn erasing_a_person_removes_their_addresses_from_the_audit_trail() {
    let centre = behind_proxy().await;
    let (own, of_staff) = ("203.0.113.1", "203.0.113.2");
    session(&at(&centre.trainee, own), "ada", recording(100, 1)).await;
    session(&at(&centre.instructor, of_staff), "ada", recording(100, 2)).await;
    assert_eq!((count_of(&centre, own).await, count_of(&centre, of_staff).await), (1, 1));
    let erased = at(&centre.instructor, of_staff).delete("/api/v1/trainees/ada").await;
    assert_eq!(erased.status(), StatusCode::NO_CONTENT);
    assert_eq!((count_of(&centre, own).await, count_of(&centre, of_staff).await), (0, 2));
    let ines = account_of(&centre, "ines").await;
    let deleted = centre.administrator.delete(&format!("/api/v1/people/{ines}")).await;
    assert_eq!(deleted.status(), StatusCode::NO_CONTENT);
    assert_eq!(count_of(&centre, of_staff).await, 0);
    assert!(count_of(&centre, "127.0.0.1").await > 0, "the administrator's changes keep their address");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_audit_trail_has_the_number_of_tokens_that_a_change_withdrew() {
    let centre = Centre::open().await;
    let account = json!({"login": "nora", "name": "Nora", "role": "administrator", "password": PASSWORD});
    let id = centre.administrator.make("/api/v1/people", account).await["id"].as_str().unwrap().to_owned();
    let change = async |change: Value| {
        let changed = centre.administrator.patch(&format!("/api/v1/people/{id}"), change).await;
        assert_eq!(changed.status(), StatusCode::OK);
    };
    let make_token = async |by: &Client, role: &str| {
        let made = by.make("/api/v1/tokens", json!({"name": "nightly", "role": role})).await;
        centre.service.stranger().with_token(made["token"].as_str().unwrap())
    };
    let nora = centre.service.sign_in("nora", PASSWORD).await;
    make_token(&nora, "instructor").await;
    let changed = nora.post("/api/v1/me/password", json!({"old": PASSWORD, "new": OWN})).await;
    assert_eq!(changed.status(), StatusCode::NO_CONTENT);

    let nora = nora.with_cookie_of(&changed);
    let program = make_token(&nora, "administrator").await;
    program.make("/api/v1/tokens", json!({"name": "box", "role": "agent", "box": "box-1"})).await;
    make_token(&nora, "instructor").await;
    change(json!({"role": "instructor"})).await; // the instructor's token stays
    change(json!({"password": PASSWORD})).await;
    change(json!({"password": OWN})).await; // no token is left

    change(json!({"role": "administrator"})).await;
    make_token(&centre.service.sign_in("nora", OWN).await, "administrator").await;
    let link = centre.administrator.make("/api/v1/password-links", json!({"person": id})).await;
    let used = json!({"secret": link["secret"], "new": PASSWORD});
    read(centre.service.stranger().post("/api/v1/password-links/use", used).await, StatusCode::OK).await;
    make_token(&centre.service.sign_in("nora", PASSWORD).await, "administrator").await;
    let deleted = centre.administrator.delete(&format!("/api/v1/people/{id}")).await;
    assert_eq!(deleted.status(), StatusCode::NO_CONTENT);

    let entries = entries(&centre).await;
    let withdrawn: Vec<_> =
        entries.iter().filter(|entry| entry["noun"] == "tokens").map(|entry| &entry["subject"]).collect();
    assert_eq!(withdrawn, ["1", "1", "1", "2", "1"], "newest first: {entries:?}");
    assert!(entries.iter().filter(|entry| entry["noun"] == "tokens").all(|entry| entry["action"] == "withdraw"));
}
