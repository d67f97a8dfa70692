//! Limits of one sender: no person and no box can use up what others need.

use std::time::Duration;

use reqwest::{Method, StatusCode};
use serde_json::json;
use trocar::time::ManualClock;

use super::centre::{Centre, recording, send, session};
use super::tus::{Upload, create, metadata};
use crate::support::{Client, Service, problem};

fn for_trainee(trainee: &str) -> String {
    metadata(&[("filename", "clip.mp4"), ("trainee", trainee), ("task", "peg"), ("box", "box-1")])
}

#[tokio::test(flavor = "multi_thread")]
async fn one_trainee_cannot_take_the_places_of_all_uploads() {
    let centre = Centre::open_in(
        Service::start_with(|settings| {
            settings.store.senders.uploads = 3;
            settings.uploads.max_unfinished = 5;
        })
        .await,
    )
    .await;
    // All at once: the limit is checked where the place is taken.
    let requests = (0..10).map(|_| create(&centre.trainee, 1000, ""));
    let answers = futures_util::future::join_all(requests).await;
    let taken = answers.iter().filter(|answer| answer.status() == StatusCode::CREATED).count();
    assert_eq!(taken, 0, "the metadata are missing");
    let (about_ada, about_bob) = (for_trainee("ada"), for_trainee("bob"));
    let requests = (0..10).map(|_| create(&centre.trainee, 1000, &about_ada));
    let answers = futures_util::future::join_all(requests).await;
    let taken = answers.iter().filter(|answer| answer.status() == StatusCode::CREATED).count();
    assert_eq!(taken, 3);
    for answer in answers.into_iter().filter(|answer| answer.status() != StatusCode::CREATED) {
        let refused = problem(answer, 429, "too-many").await;
        assert_eq!(refused["limit"], 3, "{refused}");
    }
    for _ in 0..2 {
        assert_eq!(create(&centre.other_trainee, 1000, &about_bob).await.status(), StatusCode::CREATED);
    }
    let refused = problem(create(&centre.other_trainee, 1000, &about_bob).await, 429, "too-many").await;
    assert_eq!(refused["limit"], 5, "the limit of all senders: {refused}");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_without_a_byte_ends_after_minutes_and_frees_its_place_at_once() {
    let clock = ManualClock::at(1_800_000_000_000);
    let service = Service::start_in(tempfile::tempdir().unwrap(), clock.clone(), |s| s.store.senders.uploads = 1).await;
    let centre = Centre::open_in(service).await;
    let upload = Upload::begin(&centre.trainee, 1000).await;
    problem(create(&centre.trainee, 1000, &for_trainee("ada")).await, 429, "too-many").await;
    clock.advance(Duration::from_secs(11 * 60));
    let ended = upload.request(Method::HEAD).send().await.unwrap().status();
    assert!([StatusCode::GONE, StatusCode::NOT_FOUND].contains(&ended), "{ended}"); // expired, or deleted already
    let upload = Upload::begin(&centre.trainee, 1000).await;
    upload.patch(0, &[1; 500]).await;
    clock.advance(Duration::from_secs(11 * 60));
    assert_eq!(upload.offset().await, 500, "an upload with a byte waits for 48 hours");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainee_has_a_daily_limit_and_staff_have_none() {
    let clock = ManualClock::at(1_800_000_000_000);
    let start = |change: fn(&mut trocar::settings::Settings)| {
        Service::start_in(tempfile::tempdir().unwrap(), clock.clone(), change)
    };
    let centre = Centre::open_in(start(|settings| settings.store.senders.daily_recordings = 2).await).await;
    let send_next = async |client: &Client, salt| send(client, "ada", recording(100, salt)).await;
    session(&centre.trainee, "ada", recording(100, 1)).await;
    let announced = Upload::begin(&centre.trainee, 1000).await;
    problem(create(&centre.trainee, 1000, &for_trainee("ada")).await, 429, "too-many").await;
    announced.request(Method::DELETE).send().await.unwrap();
    session(&centre.trainee, "ada", recording(100, 2)).await;
    problem(send_next(&centre.trainee, 3).await, 429, "too-many").await;
    for salt in 4..8 {
        assert_eq!(send_next(&centre.instructor, salt).await.status(), StatusCode::CREATED);
    }
    clock.advance(Duration::from_secs(25 * 3600));
    let trainee = centre.service.sign_in("ada", super::centre::PASSWORD).await;
    assert_eq!(send_next(&trainee, 3).await.status(), StatusCode::CREATED);

    let centre = Centre::open_in(start(|settings| settings.store.senders.daily_bytes = 1000).await).await;
    session(&centre.trainee, "ada", recording(600, 1)).await;
    problem(create(&centre.trainee, 401, &for_trainee("ada")).await, 429, "too-many").await;
    problem(send(&centre.trainee, "ada", recording(401, 2)).await, 429, "too-many").await;
    session(&centre.trainee, "ada", recording(400, 2)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_further_sign_in_of_a_person_ends_the_one_that_was_idle_longest() {
    let clock = ManualClock::at(1_800_000_000_000);
    let service =
        Service::start_in(tempfile::tempdir().unwrap(), clock.clone(), |s| s.store.senders.sign_ins = 3).await;
    let mut browsers = Vec::new();
    for _ in 0..4 {
        browsers.push(service.administrator().await);
        clock.advance(Duration::from_secs(120));
    }
    problem(browsers[0].get("/api/v1/me").await, 401, "not-signed-in").await;
    for browser in &browsers[1..] {
        browser.read("/api/v1/me").await;
    }
    let sign_ins = browsers[3].read("/api/v1/me/sign-ins").await;
    assert_eq!(sign_ins["items"].as_array().unwrap().len(), 3, "{sign_ins}");
    assert_eq!(sign_ins["items"].as_array().unwrap().iter().filter(|one| one["is_current"] == json!(true)).count(), 1);
}
