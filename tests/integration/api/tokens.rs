//! A token gives its role until it ends, and no more: what it makes ends with it, and it opens no other way in.

use std::time::Duration;

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::time::ManualClock;

use super::centre::{Centre, PASSWORD};
use crate::support::{ADMINISTRATOR, Client, Service, problem, read};

/// A program with this new token.
fn program(service: &Service, made: &Value) -> Client {
    service.stranger().with_token(text(&made["token"]))
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap()
}

fn address(made: &Value) -> String {
    format!("/api/v1/tokens/{}", text(&made["id"]))
}

/// The address of the account with this login.
async fn account_of(administrator: &Client, login: &str) -> String {
    let people = administrator.read("/api/v1/people").await;
    let found = people["items"].as_array().unwrap().iter().find(|person| person["login"] == login).unwrap();
    format!("/api/v1/people/{}", text(&found["id"]))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_that_a_token_makes_does_not_outlast_it() {
    let clock = ManualClock::at(1_800_000_000_000);
    let service = Service::start_with_clock(clock.clone()).await;
    let administrator = service.administrator().await;
    let new = |role: &str, end: Option<&str>| json!({"name": "nightly", "role": role, "expires_at": end});
    let (end, later) = ("2027-01-15T09:00:00Z", "2027-01-15T09:00:01Z");
    let short = administrator.make("/api/v1/tokens", new("administrator", Some(end))).await;
    let by_short = program(&service, &short);
    for too_late in ["never", later] {
        let refused = by_short.post("/api/v1/tokens", new("administrator", Some(too_late))).await;
        let refused = problem(refused, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], "expires_at");
        assert!(text(&refused["detail"]).contains(end), "{refused}");
    }
    let made = by_short.make("/api/v1/tokens", new("administrator", None)).await;
    assert_eq!((&made["expires_at"], &made["made_with"]), (&json!(end), &short["id"]));
    let of_made = program(&service, &made).make("/api/v1/tokens", new("instructor", Some(end))).await;
    let agent = json!({"name": "agent", "role": "agent", "box": "box-1"});
    administrator.make("/api/v1/boxes", json!({"name": "Box 1", "code": "box-1"})).await;
    let agent = by_short.make("/api/v1/tokens", agent).await;
    assert_eq!(short["made_with"], Value::Null, "a person made it");
    for made in [&made, &of_made, &agent] {
        program(&service, made).read("/api/v1/me").await;
    }
    let lasting = administrator.make("/api/v1/tokens", new("administrator", Some("never"))).await;
    let of_lasting = program(&service, &lasting).make("/api/v1/tokens", new("instructor", None)).await;
    assert_eq!(of_lasting["expires_at"], "2028-01-15T08:00:00Z", "the default is a year");
    clock.advance(Duration::from_secs(600));
    assert_eq!(administrator.delete(&address(&short)).await.status(), StatusCode::NO_CONTENT);
    for made in [&short, &made, &of_made, &agent] {
        problem(program(&service, made).get("/api/v1/me").await, 401, "not-signed-in").await;
    }
    program(&service, &of_lasting).read("/api/v1/me").await;
    let listed = administrator.read("/api/v1/tokens").await;
    assert_eq!(listed["items"].as_array().unwrap().len(), 2, "{listed}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_withdraws_itself_and_those_that_it_made_and_no_other() {
    let centre = Centre::open().await;
    let new = |role: &str| json!({"name": role, "role": role});
    let full = centre.administrator.make("/api/v1/tokens", new("administrator")).await;
    let less = centre.administrator.make("/api/v1/tokens", new("instructor")).await;
    let (by_full, by_less) = (program(&centre.service, &full), program(&centre.service, &less));
    let own = |made: &Value| address(made).replace("/tokens", "/me/tokens");
    let made = by_full.make("/api/v1/tokens", new("instructor")).await;
    for path in [own(&full), own(&made)] {
        problem(by_less.delete(&path).await, 403, "forbidden").await;
    }
    for path in [own(&less), address(&less)] {
        problem(by_full.delete(&path).await, 403, "forbidden").await;
    }
    assert_eq!(by_full.delete(&address(&made)).await.status(), StatusCode::NO_CONTENT);
    assert_eq!(by_less.delete(&own(&less)).await.status(), StatusCode::NO_CONTENT);
    problem(by_less.get("/api/v1/me").await, 401, "not-signed-in").await;
    assert_eq!(by_full.delete(&own(&full)).await.status(), StatusCode::NO_CONTENT);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_opens_no_other_way_in_and_shuts_no_person_out() {
    let centre = Centre::open().await;
    let administrator = &centre.administrator;
    let (own, ines) = (account_of(administrator, ADMINISTRATOR.0).await, account_of(administrator, "ines").await);
    let sign_ins = administrator.read("/api/v1/me/sign-ins").await;
    let sign_in = format!("/api/v1/me/sign-ins/{}", text(&sign_ins["items"][0]["id"]));
    let link = json!({"person": ines.rsplit('/').next().unwrap()});
    let account =
        |role: &str| json!({"login": format!("new-{role}"), "name": role, "role": role, "password": PASSWORD});
    for role in ["instructor", "administrator"] {
        let token = administrator.make("/api/v1/tokens", json!({"name": role, "role": role})).await;
        let program = program(&centre.service, &token);
        let change = json!({"old": ADMINISTRATOR.1, "new": "another password"});
        for answer in [
            program.post("/api/v1/me/password", change).await,
            program.delete(&sign_in).await,
            program.post("/api/v1/password-links", link.clone()).await,
            program.patch(&own, json!({"password": "another password"})).await,
            program.patch(&ines, json!({"role": "administrator"})).await,
            program.post("/api/v1/people", account("administrator")).await,
        ] {
            problem(answer, 403, "forbidden").await;
        }
    }
    let token = administrator.make("/api/v1/tokens", json!({"name": "school", "role": "administrator"})).await;
    let program = program(&centre.service, &token);
    let rosa = json!({"login": "rosa", "name": "Rosa", "role": "administrator", "password": PASSWORD});
    let rosa = format!("/api/v1/people/{}", text(&administrator.make("/api/v1/people", rosa).await["id"]));
    for answer in [
        program.patch(&rosa, json!({"role": "instructor"})).await,
        program.patch(&rosa, json!({"login": "mallory"})).await,
        program.patch(&rosa, json!({"name": "Mallory", "password": "another password"})).await,
        program.delete(&rosa).await,
    ] {
        problem(answer, 403, "forbidden").await;
    }
    let same = json!({"login": "rosa", "role": "administrator"});
    let same = read(program.patch(&rosa, same).await, StatusCode::OK).await;
    assert_eq!(same["name"], "Rosa", "nothing of a refused change is stored");
    centre.service.sign_in("rosa", PASSWORD).await;
    let made = program.make("/api/v1/people", account("instructor")).await; // programs manage accounts of less rights
    let made = format!("/api/v1/people/{}", text(&made["id"]));
    let password = json!({"login": "newer", "password": "another password"});
    read(program.patch(&made, password).await, StatusCode::OK).await;
    centre.service.sign_in("newer", "another password").await;
    assert_eq!(program.delete(&made).await.status(), StatusCode::NO_CONTENT);
    administrator.make("/api/v1/password-links", link).await;
    let links = program.read("/api/v1/password-links").await;
    let link = format!("/api/v1/password-links/{}", text(&links["items"][0]["id"]));
    problem(program.delete(&link).await, 403, "forbidden").await;
    centre.service.sign_in(ADMINISTRATOR.0, ADMINISTRATOR.1).await;
    administrator.read("/api/v1/me").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_that_exceeds_a_new_role_is_withdrawn_for_good() {
    let centre = Centre::open().await;
    let administrator = &centre.administrator;
    let account = json!({"login": "nora", "name": "Nora", "role": "administrator", "password": PASSWORD});
    let nora = format!("/api/v1/people/{}", text(&administrator.make("/api/v1/people", account).await["id"]));
    let signed_in = centre.service.sign_in("nora", PASSWORD).await;
    let new = |role: &str| json!({"name": role, "role": role});
    let full = signed_in.make("/api/v1/tokens", new("administrator")).await;
    let less = signed_in.make("/api/v1/tokens", new("instructor")).await;
    let made = program(&centre.service, &full).make("/api/v1/tokens", new("instructor")).await;
    let ends = [(&full, 401), (&made, 401), (&less, 200)];
    for role in ["instructor", "administrator"] {
        read(administrator.patch(&nora, json!({"role": role})).await, StatusCode::OK).await;
        for (token, status) in ends {
            let answer = program(&centre.service, token).get("/api/v1/me").await;
            assert_eq!(answer.status(), status, "{role}: {}", token["name"]);
        }
        let own = centre.service.sign_in("nora", PASSWORD).await.read("/api/v1/me/tokens").await;
        assert_eq!(own["items"].as_array().unwrap().len(), 1, "{own}");
    }
}
