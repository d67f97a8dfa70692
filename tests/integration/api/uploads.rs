//! A recording in one request, and requests that are refused.

use std::io;

use bytes::Bytes;
use reqwest::{Method, StatusCode, header};
use serde_json::json;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;

use super::centre::{Centre, recording, send, session};
use crate::support::{Client, Service, poll_until, problem, read};

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_in_one_request_becomes_a_session() {
    let centre = Centre::open().await;
    let answer = send(&centre.instructor, "ada", recording(5000, 1)).await;
    let location = answer.headers()[header::LOCATION].to_str().unwrap().to_owned();
    let made = read(answer, StatusCode::CREATED).await;
    assert_eq!(location, format!("/api/v1/sessions/{}", made["id"].as_str().unwrap()));
    assert_eq!(made, centre.instructor.read(&location).await);
    assert_eq!(made["video"]["bytes"], 5000);
    assert_eq!(made["video"]["media_type"], "video/mp4");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_in_one_request_that_a_shutdown_cuts_must_be_sent_again() {
    let centre = Centre::open().await;
    let (bytes, body) = mpsc::channel::<io::Result<Bytes>>(1);
    let request = centre.trainee.request(Method::POST, "/api/v1/sessions?trainee=ada&task=peg&box=box-1");
    let request = request.header(header::CONTENT_TYPE, "video/mp4");
    let answer = tokio::spawn(request.body(reqwest::Body::wrap_stream(ReceiverStream::new(body))).send());
    bytes.send(Ok(recording(1000, 1).into())).await.unwrap();
    let incoming = centre.service.data.path().join("incoming");
    poll_until("the first bytes", || std::fs::read_dir(&incoming).is_ok_and(|files| files.count() > 0)).await;
    let (_data, answer) = tokio::join!(centre.service.stop(), answer);
    let refused = problem(answer.unwrap().unwrap(), 503, "busy").await;
    let detail = refused["detail"].as_str().unwrap();
    assert!(detail.contains("send it again") && !detail.contains("continue"), "{detail}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_true_frame_rate_or_duration_comes_with_the_recording() {
    let centre = Centre::open().await;
    let send_as = async |by: &Client, given: &str, salt| {
        let path = format!("/api/v1/sessions?trainee=ada&task=peg&box=box-1&{given}");
        let request = by.request(Method::POST, &path).header(header::CONTENT_TYPE, "video/mp4");
        request.body(recording(100, salt)).send().await.unwrap()
    };
    let send = async |given: &str, salt| send_as(&centre.instructor, given, salt).await;
    for (salt, (name, number)) in [("true_frame_rate_hz", 16.4), ("true_duration_s", 61.5)].into_iter().enumerate() {
        let made = read(send(&format!("{name}={number}"), salt as u64).await, StatusCode::CREATED).await;
        let edits = centre.instructor.read(&format!("/api/v1/sessions/{}/edits", made["id"].as_str().unwrap())).await;
        let edit = &edits["items"][0];
        assert_eq!((&edit["kind"], &edit[name]), (&"retime".into(), &number.into()));
        assert_eq!(
            (&edit["who"], &edit["undone"]),
            (&centre.instructor.read("/api/v1/me").await["name"], &json!(null))
        );
    }
    for (given, field) in [
        ("true_frame_rate_hz=fast", "true_frame_rate_hz"),
        ("true_frame_rate_hz=0", "true_frame_rate_hz"),
        ("true_duration_s=NaN", "true_duration_s"),
        ("true_frame_rate_hz=16.4&true_duration_s=60", "true_duration_s"),
    ] {
        let refused = problem(send(given, 9).await, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], field, "{refused}");
    }
    problem(send_as(&centre.trainee, "true_duration_s=30", 9).await, 403, "forbidden").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_that_curl_declares_as_a_form_is_accepted() {
    let centre = Centre::open().await;
    let path = "/api/v1/sessions?trainee=ada&task=peg&box=box-1&recorded_at=2026-11-20T09:30:00%2B01:00";
    let request = centre.trainee.request(Method::POST, path);
    let answer = request.header(header::CONTENT_TYPE, "application/x-www-form-urlencoded").body(recording(100, 1));
    let made = read(answer.send().await.unwrap(), StatusCode::CREATED).await;
    assert_eq!(made["recorded_at"], "2026-11-20T08:30:00Z");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_says_whether_its_sender_or_its_arrival_gives_its_time() {
    let centre = Centre::open().await;
    let stated = "/api/v1/sessions?trainee=ada&task=peg&box=box-1&recorded_at=2026-11-20T08:30:00Z";
    let request = centre.trainee.request(Method::POST, stated).header(header::CONTENT_TYPE, "video/mp4");
    let stated = read(request.body(recording(100, 1)).send().await.unwrap(), StatusCode::CREATED).await;
    let unstated = session(&centre.trainee, "ada", recording(100, 2)).await;
    assert_eq!(unstated["recorded_at"], unstated["created_at"]);
    let listed = centre.trainee.read("/api/v1/sessions").await;
    let progress = centre.trainee.read("/api/v1/trainees/ada/progress?task=peg").await;
    for (made, source) in [(stated, "claimed"), (unstated, "arrival")] {
        assert_eq!(made["recorded_at_source"], source);
        for list in [&listed["items"], &progress["sessions"]] {
            let shown = list.as_array().unwrap().iter().find(|one| one["id"] == made["id"]).unwrap();
            for key in ["recorded_at", "recorded_at_source", "created_at"] {
                assert_eq!(shown[key], made[key], "{key}");
            }
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_longer_than_the_limit_is_refused_with_the_limit() {
    let centre = Centre::open_in(Service::start_with(|s| s.uploads.max_bytes = 1000).await).await;
    let refused = problem(send(&centre.trainee, "ada", recording(1001, 1)).await, 413, "too-large").await;
    assert_eq!(refused["limit_bytes"], 1000);
    session(&centre.trainee, "ada", recording(1000, 1)).await;
    let left = std::fs::read_dir(centre.service.data.path().join("uploads")).unwrap().count();
    assert_eq!(left, 0, "no part of a refused recording remains");
}

async fn send_empty(centre: &Centre) -> reqwest::Response {
    centre.trainee.request(Method::POST, "/api/v1/sessions?trainee=ada&task=peg&box=box-1").send().await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn an_empty_body_is_no_recording() {
    let centre = Centre::open().await;
    problem(send_empty(&centre).await, 422, "invalid").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_deleted_session_takes_its_recording_along() {
    let centre = Centre::open().await;
    let made = session(&centre.instructor, "ada", recording(5000, 1)).await;
    let path = format!("/api/v1/sessions/{}", made["id"].as_str().unwrap());
    assert_eq!(centre.instructor.delete(&path).await.status(), StatusCode::NO_CONTENT);
    problem(centre.instructor.get(&path).await, 404, "not-found").await;
    session(&centre.instructor, "ada", recording(5000, 1)).await;
}
