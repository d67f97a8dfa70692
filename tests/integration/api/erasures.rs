//! Erasing a trainee: at once, or so that it can be taken back; and videos that are kept for a limited time.

use std::time::Duration;

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::time::ManualClock;

use super::centre::{Centre, PASSWORD, recording, session};
use crate::support::{Service, problem, with_advancing_clock};

/// 2026-11-21 20:14 UTC.
const NOW_MS: i64 = 1_795_292_040_000;

#[tokio::test(flavor = "multi_thread")]
async fn an_erasure_from_the_page_hides_the_trainee_and_can_be_taken_back() {
    let centre = Centre::open().await;
    let id = session(&centre.trainee, "ada", recording(100, 1)).await["id"].as_str().unwrap().to_owned();
    let extent = centre.instructor.read("/api/v1/trainees/ada/erasure").await;
    assert_eq!((&extent["sessions"], &extent["bytes"], &extent["days"]), (&json!(1), &json!(100), &json!(7)));

    let erased = centre.instructor.delete("/api/v1/trainees/ada?can_be_taken_back=true").await;
    assert_eq!(erased.status(), StatusCode::NO_CONTENT);
    problem(centre.trainee.get("/api/v1/me").await, 401, "not-signed-in").await;
    let sign_in = json!({"login": "ada", "password": PASSWORD});
    problem(centre.service.stranger().post("/api/v1/sign-in", sign_in).await, 401, "wrong-credentials").await;
    for client in [&centre.administrator, &centre.instructor] {
        for path in ["trainees/ada", "trainees/ada/erasure", "trainees/ada/data.zip", &format!("sessions/{id}")] {
            problem(client.get(&format!("/api/v1/{path}")).await, 404, "not-found").await;
        }
        let again = client.delete("/api/v1/trainees/ada?can_be_taken_back=true").await;
        problem(again, 404, "not-found").await;
        let pending = client.read("/api/v1/pending-erasures").await;
        assert_eq!((&pending["items"][0]["code"], &pending["items"][0]["who"]), (&json!("ada"), &json!("ines")));
    }
    assert_eq!(centre.other_instructor.read("/api/v1/pending-erasures").await["items"], json!([]));
    problem(centre.other_instructor.post("/api/v1/trainees/ada/restore", json!({})).await, 404, "not-found").await;
    problem(centre.other_trainee.get("/api/v1/pending-erasures").await, 403, "forbidden").await;

    let back = centre.instructor.post("/api/v1/trainees/ada/restore", json!({})).await;
    assert_eq!(back.status(), StatusCode::OK);
    problem(centre.instructor.post("/api/v1/trainees/ada/restore", json!({})).await, 404, "not-found").await;
    let trainee = centre.service.sign_in("ada", PASSWORD).await;
    assert_eq!(trainee.read("/api/v1/sessions").await["items"][0]["id"], json!(id));
}

#[tokio::test(flavor = "multi_thread")]
async fn by_default_a_trainee_is_erased_at_once_also_while_they_wait() {
    let centre = Centre::open().await;
    assert_eq!(centre.instructor.delete("/api/v1/trainees/ada?can_be_taken_back=true").await.status(), 204);
    for (client, trainee) in [(&centre.instructor, "ada"), (&centre.administrator, "bob")] {
        assert_eq!(client.delete(&format!("/api/v1/trainees/{trainee}")).await.status(), StatusCode::NO_CONTENT);
    }
    assert_eq!(centre.administrator.read("/api/v1/pending-erasures").await["items"], json!([]));
    problem(centre.administrator.post("/api/v1/trainees/ada/restore", json!({})).await, 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn with_no_days_in_the_settings_an_erasure_cannot_be_taken_back() {
    let centre = Centre::open_in(Service::start_with(|settings| settings.retention.erase_days = 0).await).await;
    assert_eq!(centre.administrator.read("/api/v1/trainees/ada/erasure").await["days"], json!(0));
    assert_eq!(centre.administrator.delete("/api/v1/trainees/ada?can_be_taken_back=true").await.status(), 204);
    assert_eq!(centre.administrator.read("/api/v1/pending-erasures").await["items"], json!([]));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_video_that_is_too_old_is_gone_and_every_answer_says_so() {
    let clock = ManualClock::at(NOW_MS);
    let service = Service::start_in(tempfile::tempdir().unwrap(), clock.clone(), |settings| {
        settings.retention.videos_months = 1;
    });
    let centre = Centre::open_in(service.await).await;
    let old = session(&centre.administrator, "ada", recording(100, 1)).await["id"].as_str().unwrap().to_owned();
    let retention = centre.administrator.read("/api/v1/service").await["retention"].clone();
    assert_eq!((&retention["videos_months"], &retention["next_videos"]), (&json!(1), &json!(0)));
    clock.advance(Duration::from_secs(5 * 86_400));
    let administrator = centre.service.administrator().await;
    let retention = administrator.read("/api/v1/service").await["retention"].clone();
    assert_eq!((&retention["next_videos"], &retention["next_bytes"]), (&json!(1), &json!(100)), "announced");
    clock.advance(Duration::from_secs(30 * 86_400));
    let administrator = centre.service.administrator().await;
    let path = format!("/api/v1/sessions/{old}");
    let is_deleted = |session: &Value| !session["video"]["deleted_at"].is_null();
    let upkeep = administrator.read_until(&path, is_deleted);
    let shown = with_advancing_clock(&clock, Duration::from_secs(21), upkeep).await;
    assert_eq!((&shown["video"]["bytes"], &shown["retry_can_help"]), (&json!(100), &json!(false)));
    let gone = problem(administrator.get(&format!("{path}/video")).await, 410, "gone").await;
    assert!(gone["detail"].as_str().unwrap().starts_with("The video was deleted on"), "{gone}");
    problem(administrator.post(&format!("{path}/retry"), json!({})).await, 409, "conflict").await;
    assert_eq!(administrator.read("/api/v1/service").await["storage"]["files"], json!(0));
}
