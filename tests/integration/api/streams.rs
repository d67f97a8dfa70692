//! Server-sent events: each client gets only events in its scope, and streams end with the service.

use std::time::{Duration, Instant};

use futures_util::StreamExt;
use reqwest::{StatusCode, header};
use serde_json::{Value, json};

use super::centre::{Centre, PASSWORD, recording, session, set_members};
use crate::support::{Client, let_time_pass, problem, read, soon};

/// The events of one client, one at a time.
pub(super) struct Watcher {
    bytes: std::pin::Pin<Box<dyn futures_util::Stream<Item = reqwest::Result<bytes::Bytes>> + Send>>,
    text: String,
}

impl Watcher {
    pub async fn open(client: &Client) -> Self {
        let answer = client.get("/api/v1/events").await;
        assert_eq!(answer.status(), StatusCode::OK);
        assert!(answer.headers()[header::CONTENT_TYPE].to_str().unwrap().starts_with("text/event-stream"));
        Self { bytes: Box::pin(answer.bytes_stream()), text: String::new() }
    }

    /// The next event; `None` at the stream's end.
    async fn next(&mut self) -> Option<(String, Value)> {
        loop {
            if let Some((block, rest)) = self.text.split_once("\n\n") {
                let (block, rest) = (block.to_owned(), rest.to_owned());
                self.text = rest;
                let line = |key: &str| block.lines().find_map(|line| line.strip_prefix(key)).map(str::trim);
                if let (Some(name), Some(data)) = (line("event:"), line("data:")) {
                    return Some((name.to_owned(), serde_json::from_str(data).unwrap()));
                }
                continue; // a comment that keeps the connection alive
            }
            let more = self.bytes.next().await?.ok()?;
            self.text.push_str(std::str::from_utf8(&more).unwrap());
        }
    }

    /// All events up to the first that contains this text, with their names.
    pub async fn until(&mut self, wanted: &str) -> String {
        let mut heard = String::new();
        soon(wanted, async {
            while !heard.contains(wanted) {
                let (name, data) = self.next().await.expect("the stream continues");
                heard.push_str(&format!("{name} {data}\n"));
            }
        })
        .await;
        heard
    }

    /// Asserts that the stream ends now, and not with a later check of its sign-in.
    async fn assert_ends_at_once(mut self, why: &str) {
        let begun = Instant::now();
        soon(why, async { while self.next().await.is_some() {} }).await;
        assert!(begun.elapsed() < Duration::from_secs(3), "{why}: after {:?}", begun.elapsed());
    }

    async fn next_named(&mut self, name: &str) -> Value {
        soon(name, async {
            loop {
                let (was, data) = self.next().await.expect("the stream continues");
                if was == name {
                    return data;
                }
            }
        })
        .await
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_session_is_announced_only_to_people_who_may_see_it() {
    let centre = Centre::open().await;
    let mut own = Watcher::open(&centre.trainee).await;
    let mut foreign = Watcher::open(&centre.other_trainee).await;
    let adas = session(&centre.trainee, "ada", recording(100, 1)).await["id"].clone();
    let bobs = session(&centre.other_trainee, "bob", recording(100, 2)).await["id"].clone();
    let event = own.next_named("session").await;
    assert_eq!((&event["id"], &event["status"]), (&adas, &"queued".into()));
    assert_eq!(foreign.next_named("session").await["id"], bobs, "Ada's event came first and was not sent to Bob");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_open_stream_follows_the_rights_of_its_person() {
    let centre = Centre::open().await;
    let (mut ines, mut ada) = (Watcher::open(&centre.instructor).await, Watcher::open(&centre.trainee).await);
    let mut number = 0;
    let mut announce = async |trainee: &str| {
        number += 1;
        session(&centre.administrator, trainee, recording(100, number)).await["id"].clone()
    };
    let of_ada = announce("ada").await;
    assert_eq!(ines.next_named("session").await["id"], of_ada);
    assert_eq!(ada.next_named("session").await["id"], of_ada);

    set_members(&centre, "One", &["ines"], &["bob"]).await;
    let (of_ada, of_bob) = (announce("ada").await, announce("bob").await);
    assert_eq!(ines.next_named("session").await["id"], of_bob, "Ada's event came first, after she had left the group");
    assert_eq!(ada.next_named("session").await["id"], of_ada);

    set_members(&centre, "One", &["ines"], &["ada"]).await;
    let (_, of_ada) = (announce("bob").await, announce("ada").await);
    assert_eq!(ines.next_named("session").await["id"], of_ada, "Bob's event came first");
    assert_eq!(ada.next_named("session").await["id"], of_ada);
}

#[tokio::test(flavor = "multi_thread")]
async fn every_open_page_gets_an_event_of_a_person_who_sees_the_trainee() {
    let centre = Centre::open().await;
    let clients = [&centre.administrator, &centre.instructor, &centre.trainee, &centre.other_instructor];
    let mut pages = Vec::new();
    for number in 0..40 {
        pages.push((number, Watcher::open(clients[number % clients.len()]).await));
    }
    let of_ada = session(&centre.administrator, "ada", recording(100, 1)).await["id"].clone();
    let of_bob = session(&centre.administrator, "bob", recording(100, 2)).await["id"].clone();
    for (number, mut page) in pages {
        let expected = if number % clients.len() == 3 { &of_bob } else { &of_ada };
        assert_eq!(page.next_named("session").await["id"], *expected, "page {number}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_new_watcher_gets_the_state_of_the_queue_at_once() {
    let centre = Centre::open().await;
    let queue = Watcher::open(&centre.trainee).await.next_named("queue").await;
    assert!(queue["queued"].is_u64() && queue["running"].is_u64(), "{queue}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stream_ends_with_the_service() {
    let centre = Centre::open().await;
    let mut watcher = Watcher::open(&centre.administrator).await;
    let stopping = tokio::spawn(centre.service.stop());
    soon("the end of the stream", async { while watcher.next().await.is_some() {} }).await;
    soon("the end of the service", stopping).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_busy_stream_ends_soon_after_its_token_was_withdrawn() {
    let centre = Centre::open().await;
    let token = json!({"name": "watcher", "role": "administrator"});
    let token = centre.administrator.make("/api/v1/tokens", token).await;
    let program = centre.service.stranger().with_token(token["token"].as_str().unwrap());
    let mut watcher = Watcher::open(&program).await;
    let path = format!("/api/v1/tokens/{}", token["id"].as_str().unwrap());
    assert_eq!(centre.administrator.delete(&path).await.status(), StatusCode::NO_CONTENT);
    // Events that follow each other faster than the stream checks its sign-in.
    let events = async {
        for number in 0..60 {
            session(&centre.administrator, "ada", recording(100, number)).await;
            let_time_pass(Duration::from_millis(500)).await;
        }
    };
    let end = async { while watcher.next().await.is_some() {} };
    tokio::select! {
        () = end => {}
        () = events => panic!("the stream continues without a sign-in"),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stream_ends_at_once_with_its_sign_in() {
    let centre = Centre::open().await;
    let administrator = &centre.administrator;
    let mut stays = Watcher::open(administrator).await;
    let people = administrator.read("/api/v1/people").await;
    let account = |login: &str| {
        let found = people["items"].as_array().unwrap().iter().find(|person| person["login"] == login).unwrap();
        format!("/api/v1/people/{}", found["id"].as_str().unwrap())
    };

    let ada = centre.service.sign_in("ada", PASSWORD).await;
    let watcher = Watcher::open(&ada).await;
    assert_eq!(ada.post("/api/v1/sign-out", json!({})).await.status(), StatusCode::NO_CONTENT);
    watcher.assert_ends_at_once("signing out").await;

    let watcher = Watcher::open(&centre.service.sign_in("ada", PASSWORD).await).await;
    let sign_ins = centre.trainee.read("/api/v1/me/sign-ins").await;
    let other = sign_ins["items"].as_array().unwrap().iter().find(|one| one["is_current"] == false).unwrap();
    let address = format!("/api/v1/me/sign-ins/{}", other["id"].as_str().unwrap());
    assert_eq!(centre.trainee.delete(&address).await.status(), StatusCode::NO_CONTENT);
    watcher.assert_ends_at_once("the end of a sign-in on the account page").await;

    let watcher = Watcher::open(&centre.service.sign_in("bob", PASSWORD).await).await;
    let change = json!({"old": PASSWORD, "new": "another password"});
    assert_eq!(centre.other_trainee.post("/api/v1/me/password", change).await.status(), StatusCode::NO_CONTENT);
    watcher.assert_ends_at_once("a new password").await;

    let watcher = Watcher::open(&centre.instructor).await;
    let change = json!({"password": "another password"});
    read(administrator.patch(&account("ines"), change).await, StatusCode::OK).await;
    watcher.assert_ends_at_once("a password that an administrator sets").await;

    let watcher = Watcher::open(&centre.other_instructor).await;
    read(administrator.patch(&account("omar"), json!({"role": "administrator"})).await, StatusCode::OK).await;
    watcher.assert_ends_at_once("another role").await;

    let made = administrator.make("/api/v1/tokens", json!({"name": "watcher", "role": "instructor"})).await;
    let program = centre.service.stranger().with_token(made["token"].as_str().unwrap());
    let watcher = Watcher::open(&program).await;
    let address = format!("/api/v1/tokens/{}", made["id"].as_str().unwrap());
    assert_eq!(administrator.delete(&address).await.status(), StatusCode::NO_CONTENT);
    watcher.assert_ends_at_once("the withdrawal of a token").await;

    let watcher = Watcher::open(&centre.trainee).await;
    assert_eq!(administrator.delete("/api/v1/trainees/ada").await.status(), StatusCode::NO_CONTENT);
    watcher.assert_ends_at_once("the erasure of a trainee").await;

    session(administrator, "bob", recording(100, 1)).await;
    stays.next_named("session").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn streams_have_a_limit() {
    let service = crate::support::Service::start_with(|settings| settings.http.max_event_streams = 1).await;
    let administrator = service.administrator().await;
    let _first = Watcher::open(&administrator).await;
    problem(administrator.get("/api/v1/events").await, 503, "busy").await;
}
