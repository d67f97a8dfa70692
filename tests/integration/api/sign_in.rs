//! Signing in and out.

use std::sync::Arc;
use std::time::{Duration, Instant};

use reqwest::{Method, Response, StatusCode, header};
use serde_json::json;
use tokio::task::JoinSet;
use trocar::domain::password_state::PasswordState;
use trocar::domain::role::Role;
use trocar::domain::scope::Scope;
use trocar::domain::secret::Password;
use trocar::store::{NewPerson, Store, StoreSettings};
use trocar::time::SystemClock;

use super::centre::{Centre, PASSWORD};
use crate::support::{ADMINISTRATOR, Client, Service, problem, read};

#[tokio::test(flavor = "multi_thread")]
async fn the_first_administrator_signs_in_and_out() {
    let service = Service::start().await;
    let administrator = service.administrator().await;
    let me = administrator.read("/api/v1/me").await;
    assert_eq!((&me["login"], &me["role"]), (&json!("administrator"), &json!("administrator")));
    let out = administrator.post("/api/v1/sign-out", json!({})).await;
    assert_eq!(out.status(), StatusCode::NO_CONTENT);
    problem(administrator.get("/api/v1/me").await, 401, "not-signed-in").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cookie_is_protected_and_new_at_each_sign_in() {
    let service = Service::start().await;
    let answer = service
        .stranger()
        .post("/api/v1/sign-in", json!({"login": ADMINISTRATOR.0, "password": ADMINISTRATOR.1}))
        .await;
    let cookie = answer.headers()[header::SET_COOKIE].to_str().unwrap().to_owned();
    for attribute in ["__Host-trocar=", "HttpOnly", "Secure", "SameSite=Strict", "Path=/"] {
        assert!(cookie.contains(attribute), "{cookie}");
    }
    let (first, second) = (service.administrator().await, service.administrator().await);
    assert_ne!(first.cookie(), second.cookie());
}

#[tokio::test(flavor = "multi_thread")]
async fn signing_in_again_ends_the_sign_in_that_the_browser_had() {
    let service = Service::start().await;
    let first = service.administrator().await;
    let again = first.post("/api/v1/sign-in", json!({"login": ADMINISTRATOR.0, "password": ADMINISTRATOR.1})).await;
    assert_eq!(again.status(), StatusCode::OK);
    problem(first.get("/api/v1/me").await, 401, "not-signed-in").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_unknown_login_and_a_wrong_password_are_the_same_refusal() {
    let service = Service::start().await;
    let stranger = service.stranger();
    let mut answers = Vec::new();
    for login in ["administrator", "missing"] {
        let answer = stranger.post("/api/v1/sign-in", json!({"login": login, "password": "wrong wrong wrong"})).await;
        answers.push(problem(answer, 401, "wrong-credentials").await);
    }
    assert_eq!(answers[0], answers[1]);
}

#[tokio::test(flavor = "multi_thread")]
async fn guessing_is_slowed_down_and_the_answer_says_how_long_to_wait() {
    let service = Service::start_with(|settings| settings.http.free_attempts = 5).await;
    let stranger = service.stranger();
    // Blanks and capital letters make no other login.
    let guess = |login: &str| stranger.post("/api/v1/sign-in", json!({"login": login, "password": "guess"}));
    for login in ["administrator", "administrator ", " Administrator", "ADMINISTRATOR", "administrator\t"] {
        problem(guess(login).await, 401, "wrong-credentials").await;
    }
    let refused = guess("administrator  ").await;
    let wait: u64 = refused.headers()[header::RETRY_AFTER].to_str().unwrap().parse().unwrap();
    assert!((1..=6).contains(&wait), "{wait} s");
    problem(refused, 429, "too-many").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn who_has_signed_in_before_is_not_locked_out_by_the_guesses_of_others() {
    let service = Service::start_with(|settings| {
        settings.http.free_attempts = 2;
        settings.http.trusted_proxies = vec!["127.0.0.0/8".parse().unwrap()];
    })
    .await;
    let sign_in = async |from: &str, browser: Option<&str>, password: &str| {
        let request = service.stranger().request(Method::POST, "/api/v1/sign-in").header("x-forwarded-for", from);
        let request = browser.into_iter().fold(request, |request, cookie| request.header(header::COOKIE, cookie));
        request.json(&json!({"login": ADMINISTRATOR.0, "password": password})).send().await.unwrap()
    };
    let first = sign_in("203.0.113.1", None, ADMINISTRATOR.1).await;
    assert_eq!(first.status(), StatusCode::OK);
    let browser = browser_cookie(&first);
    assert!(browser.contains("HttpOnly") && browser.contains("Max-Age=15552000"), "{browser}");
    let browser = browser.split(';').next().unwrap();
    for guesser in ["198.51.100.1", "198.51.100.2"] {
        problem(sign_in(guesser, None, "guess").await, 401, "wrong-credentials").await;
    }
    problem(sign_in("198.51.100.3", None, ADMINISTRATOR.1).await, 429, "too-many").await;
    let elsewhere = sign_in("198.51.100.4", Some(browser), ADMINISTRATOR.1).await;
    assert_eq!(elsewhere.status(), StatusCode::OK, "a browser that has signed in before");
    let at_home = sign_in("203.0.113.1", None, ADMINISTRATOR.1).await;
    assert_eq!(at_home.status(), StatusCode::OK, "an address that has signed in before");
    let guess = async |n: usize| {
        let request = service.stranger().request(Method::POST, "/api/v1/sign-in");
        let request = request.header("x-forwarded-for", "203.0.113.1");
        request.json(&json!({"login": format!("login{n}"), "password": "guess"})).send().await.unwrap().status()
    };
    let mut guesses = 0;
    while guess(guesses).await != StatusCode::TOO_MANY_REQUESTS {
        guesses += 1;
        assert!(guesses < 100, "one address tries many logins");
    }
    problem(sign_in("203.0.113.1", None, ADMINISTRATOR.1).await, 429, "too-many").await; // as a login that does not exist
    let known = sign_in("203.0.113.1", Some(browser), ADMINISTRATOR.1).await;
    assert_eq!(known.status(), StatusCode::OK, "a known browser at the same address");
}

/// The cookie that recognises a browser.
fn browser_cookie(signed_in: &Response) -> String {
    let cookies = signed_in.headers().get_all(header::SET_COOKIE).iter().map(|cookie| cookie.to_str().unwrap());
    cookies.into_iter().find(|cookie| cookie.starts_with("__Host-trocar-browser=")).unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_flood_of_sign_ins_is_refused_at_once_and_does_not_delay_a_known_browser() {
    let service = Service::start_with(|settings| {
        settings.http.free_attempts = 1000;
        settings.http.trusted_proxies = vec!["127.0.0.0/8".parse().unwrap()];
    })
    .await;
    let stranger = service.stranger();
    let request = |from: &str, login: &str, password: &str| {
        let request = stranger.request(Method::POST, "/api/v1/sign-in").header("x-forwarded-for", from);
        request.json(&json!({"login": login, "password": password}))
    };
    let first = request("203.0.113.1", ADMINISTRATOR.0, ADMINISTRATOR.1).send().await.unwrap();
    let browser = browser_cookie(&first);
    let browser = browser.split(';').next().unwrap();
    let mut flood = JoinSet::new();
    for n in 0..300 {
        let guess = request("198.51.100.1", &format!("login{n}"), "a wrong password");
        flood.spawn(async move { (guess.send().await.unwrap(), Instant::now()) });
    }
    let mut answers = Vec::new();
    while answers.iter().all(|(answer, _): &(Response, Instant)| answer.status() != StatusCode::TOO_MANY_REQUESTS) {
        answers.push(flood.join_next().await.expect("some attempts are refused").unwrap());
    }
    let known = request("203.0.113.2", ADMINISTRATOR.0, ADMINISTRATOR.1).header(header::COOKIE, browser);
    assert_eq!(known.send().await.unwrap().status(), StatusCode::OK);
    let known_since = Instant::now();
    answers.extend(flood.join_all().await);
    let (checked, refused): (Vec<_>, Vec<_>) =
        answers.into_iter().partition(|(answer, _)| answer.status() == StatusCode::UNAUTHORIZED);
    assert!(checked.iter().any(|(_, at)| *at > known_since), "the known browser waited for all of the flood");
    assert!(refused.len() > 100, "only {} are refused", refused.len());
    for (answer, _) in refused {
        assert!(answer.headers().contains_key(header::RETRY_AFTER));
        problem(answer, 429, "too-many").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_class_behind_one_address_signs_in_at_the_same_time() {
    let service = Service::start().await;
    let logins: Vec<String> = (0..40).map(|n| format!("trainer{n}")).collect();
    plant_accounts(&service, &logins).await;
    let mut class = JoinSet::new();
    for login in logins {
        let browser = service.stranger();
        class.spawn(async move {
            browser.post("/api/v1/sign-in", json!({"login": login, "password": PASSWORD})).await.status()
        });
    }
    let statuses = class.join_all().await;
    assert!(statuses.iter().all(|status| *status == StatusCode::OK), "{statuses:?}");
}

/// Creates accounts in the store: their password is hashed once, and the service sees no sign-in before.
async fn plant_accounts(service: &Service, logins: &[String]) {
    let database = service.data.path().join("trocar.db");
    let store = Store::open(&database, &StoreSettings::default(), Arc::new(SystemClock)).await.unwrap();
    let password = Password::new(PASSWORD).unwrap().hash();
    for login in logins {
        let person = NewPerson {
            login: login.parse().unwrap(),
            name: login.parse().unwrap(),
            role: Role::Instructor,
            password: password.clone(),
            password_state: PasswordState::Own,
            trainee: None,
        };
        store.people().create(&Scope::service(), person).await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stranger_cannot_state_another_address() {
    let service = Service::start_with(|settings| settings.http.free_attempts = 1).await;
    let guess = async |n: u8| {
        let request = service.stranger().request(Method::POST, "/api/v1/sign-in");
        let request = request.header("x-forwarded-for", format!("203.0.113.{n}"));
        request.json(&json!({"login": format!("login{n}"), "password": "guess"})).send().await.unwrap().status()
    };
    let mut refused = 0;
    for n in 0..20 {
        refused += usize::from(guess(n).await == StatusCode::TOO_MANY_REQUESTS);
    }
    assert!(refused >= 7, "{refused} of 20 refused: no proxy is trusted");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_works_until_it_is_deleted_and_is_shown_once() {
    let centre = Centre::open().await;
    let made = centre.administrator.make("/api/v1/tokens", json!({"name": "nightly", "role": "administrator"})).await;
    let token = made["token"].as_str().unwrap();
    assert!(token.starts_with("trc_"));
    let program = centre.service.stranger().with_token(token);
    assert_eq!(program.read("/api/v1/me").await["role"], "administrator");
    let list = centre.administrator.read("/api/v1/tokens").await;
    assert!(!list.to_string().contains(token), "{list}");
    let gone = centre.administrator.delete(&format!("/api/v1/tokens/{}", made["id"].as_str().unwrap())).await;
    assert_eq!(gone.status(), StatusCode::NO_CONTENT);
    problem(program.get("/api/v1/me").await, 401, "not-signed-in").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_password_replaces_the_old_one_and_only_the_browser_that_chose_it_stays_signed_in() {
    let centre = Centre::open().await;
    let elsewhere = centre.service.sign_in("ada", PASSWORD).await;
    let wrong =
        centre.trainee.post("/api/v1/me/password", json!({"old": "not it at all", "new": "another password"})).await;
    problem(wrong, 401, "wrong-credentials").await;
    let short = centre.trainee.post("/api/v1/me/password", json!({"old": PASSWORD, "new": "short"})).await;
    problem(short, 422, "invalid").await;
    let repeated = centre.trainee.post("/api/v1/me/password", json!({"old": PASSWORD, "new": "1111111111"})).await;
    let refused = problem(repeated, 422, "invalid").await;
    assert!(refused["detail"].as_str().unwrap().contains("5 different characters"), "{refused}");
    let changed = centre.trainee.post("/api/v1/me/password", json!({"old": PASSWORD, "new": "another password"})).await;
    assert_eq!(changed.status(), StatusCode::NO_CONTENT);
    problem(elsewhere.get("/api/v1/me").await, 401, "not-signed-in").await;
    problem(centre.trainee.get("/api/v1/me").await, 401, "not-signed-in").await; // its cookie may have been stolen
    let stays = centre.trainee.clone().with_cookie_of(&changed);
    assert_eq!(stays.read("/api/v1/me").await["login"], "ada");
    let sign_ins = stays.read("/api/v1/me/sign-ins").await;
    assert_eq!(sign_ins["items"].as_array().unwrap().len(), 1, "{sign_ins}");
    assert_eq!(sign_ins["items"][0]["is_current"], json!(true));
    centre.service.sign_in("ada", "another password").await;
    let old = centre.service.stranger().post("/api/v1/sign-in", json!({"login": "ada", "password": PASSWORD})).await;
    problem(old, 401, "wrong-credentials").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_password_withdraws_the_accounts_tokens_unless_they_are_kept() {
    let centre = Centre::open().await;
    let make = async |by: &Client| {
        let made = by.make("/api/v1/tokens", json!({"name": "nightly", "role": "instructor"})).await;
        centre.service.stranger().with_token(made["token"].as_str().unwrap())
    };
    let change = async |by: &Client, old: &str, new: &str, keep: bool| {
        let body = json!({"old": old, "new": new, "keep_tokens": keep});
        assert_eq!(by.post("/api/v1/me/password", body).await.status(), StatusCode::NO_CONTENT);
    };
    let program = make(&centre.administrator).await;
    change(&centre.administrator, ADMINISTRATOR.1, "another password", true).await;
    assert_eq!(program.read("/api/v1/me").await["role"], "instructor");
    let administrator = centre.service.sign_in(ADMINISTRATOR.0, "another password").await;
    change(&administrator, "another password", "a third password", false).await;
    problem(program.get("/api/v1/me").await, 401, "not-signed-in").await;
    assert_eq!(centre.agent.read("/api/v1/me").await["role"], "agent", "the token of a box stays");

    let administrator = centre.service.sign_in(ADMINISTRATOR.0, "a third password").await;
    let program = make(&administrator).await;
    let me = administrator.read("/api/v1/me").await["id"].as_str().unwrap().to_owned();
    let set = administrator.patch(&format!("/api/v1/people/{me}"), json!({"password": "a fourth password"})).await;
    assert_eq!(set.status(), StatusCode::OK);
    problem(program.get("/api/v1/me").await, 401, "not-signed-in").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_expires_after_a_year_unless_its_maker_says_otherwise() {
    let clock = trocar::time::ManualClock::at(1_800_000_000_000);
    let service = Service::start_with_clock(clock.clone()).await;
    let administrator = service.administrator().await;
    let make = async |expires_at: Option<&str>| {
        let body = json!({"name": "nightly", "role": "instructor", "expires_at": expires_at});
        let made = administrator.make("/api/v1/tokens", body).await;
        (service.stranger().with_token(made["token"].as_str().unwrap()), made["expires_at"].clone())
    };
    let (usual, usual_end) = make(None).await;
    let (lasting, no_end) = make(Some("never")).await;
    let (short, _) = make(Some("2027-02-01T00:00:00Z")).await;
    assert_eq!((usual_end, no_end), (json!("2028-01-15T08:00:00Z"), json!(null)));
    for end in ["soon", "9999-12-31T00:00:00Z", "2027-01-15T07:59:59Z"] {
        let wrong = json!({"name": "x", "role": "instructor", "expires_at": end});
        let refused = problem(administrator.post("/api/v1/tokens", wrong).await, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], "expires_at", "{end}");
    }
    clock.advance(Duration::from_secs(364 * 86_400));
    assert_eq!(usual.read("/api/v1/me").await["role"], "instructor");
    problem(short.get("/api/v1/me").await, 401, "not-signed-in").await;
    clock.advance(Duration::from_secs(2 * 86_400));
    problem(usual.get("/api/v1/me").await, 401, "not-signed-in").await;
    assert_eq!(lasting.read("/api/v1/me").await["role"], "instructor");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_person_lists_and_ends_the_own_sign_ins_and_tokens_and_no_others() {
    let centre = Centre::open().await;
    let elsewhere = centre.service.stranger().with("user-agent", "Tablet of ward 3").signed_in("ada", PASSWORD).await;
    let listed = centre.trainee.read("/api/v1/me/sign-ins").await["items"].clone();
    let other = listed.as_array().unwrap().iter().find(|one| one["is_current"] == json!(false)).unwrap();
    assert_eq!((&other["browser"], &other["address"]), (&json!("Tablet of ward 3"), &json!("127.0.0.1")));
    assert_eq!(listed.as_array().unwrap().len(), 2);
    let address = format!("/api/v1/me/sign-ins/{}", other["id"].as_str().unwrap());
    problem(centre.other_trainee.delete(&address).await, 404, "not-found").await;
    elsewhere.read("/api/v1/me").await;
    assert_eq!(centre.trainee.delete(&address).await.status(), StatusCode::NO_CONTENT);
    problem(elsewhere.get("/api/v1/me").await, 401, "not-signed-in").await;
    problem(centre.trainee.delete(&address).await, 404, "not-found").await;

    let made = centre.administrator.make("/api/v1/tokens", json!({"name": "nightly", "role": "instructor"})).await;
    let mine = centre.administrator.read("/api/v1/me/tokens").await["items"].clone();
    assert_eq!((mine.as_array().unwrap().len(), &mine[0]["name"]), (1, &json!("nightly")), "no agent's token");
    let address = format!("/api/v1/me/tokens/{}", made["id"].as_str().unwrap());
    problem(centre.instructor.delete(&address).await, 404, "not-found").await;
    let program = centre.service.stranger().with_token(made["token"].as_str().unwrap());
    assert!(program.read("/api/v1/me/tokens").await["items"][0]["last_used_at"].is_string());
    assert_eq!(centre.administrator.delete(&address).await.status(), StatusCode::NO_CONTENT);
    problem(program.get("/api/v1/me").await, 401, "not-signed-in").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_deleted_account_is_signed_out_at_once() {
    let centre = Centre::open().await;
    let people = centre.administrator.read("/api/v1/people").await;
    let bob = people["items"].as_array().unwrap().iter().find(|p| p["login"] == "bob").unwrap();
    let gone = centre.administrator.delete(&format!("/api/v1/people/{}", bob["id"].as_str().unwrap())).await;
    assert_eq!(gone.status(), StatusCode::NO_CONTENT);
    problem(centre.other_trainee.get("/api/v1/me").await, 401, "not-signed-in").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_sign_in_ends_after_30_idle_minutes_and_after_12_hours() {
    let clock = trocar::time::ManualClock::at(1_800_000_000_000);
    let service = Service::start_with_clock(clock.clone()).await;
    let administrator = service.administrator().await;
    for _ in 0..(12 * 60 / 29) {
        clock.advance(Duration::from_secs(29 * 60));
        read(administrator.get("/api/v1/me").await, StatusCode::OK).await;
    }
    clock.advance(Duration::from_secs(29 * 60));
    problem(administrator.get("/api/v1/me").await, 401, "not-signed-in").await;

    let administrator = service.administrator().await;
    clock.advance(Duration::from_secs(31 * 60));
    problem(administrator.get("/api/v1/me").await, 401, "not-signed-in").await;
}
