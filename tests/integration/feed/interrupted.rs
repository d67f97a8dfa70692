//! Recordings whose sender is gone, and limits of a box and its senders.

use std::time::Duration;

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::time::{Clock, ManualClock, to_rfc3339};

use super::sender::{Received, Sender, begin, hello, open};
use super::{ANOTHER, RECORDING, frames_of};
use crate::api::centre::Centre;
use crate::support::{Client, Service, let_time_pass, poll, problem, read};

/// A hello of a page of a browser, which keeps nothing once it is closed.
fn hello_of_page(recording: &str) -> Value {
    let mut hello = hello(recording);
    hello["resumes"] = json!(false);
    hello
}

/// Sends ten frames as a page of a browser does, and returns the connection and the session.
async fn record(centre: &Centre, client: &Client, recording: &str) -> (Sender, String) {
    let mut sender = open(&centre.service, client.headers(), "box-1").await.unwrap();
    sender.send_json(&hello_of_page(recording)).await;
    let Received::Json(welcome) = sender.receive().await else { panic!("no welcome") };
    sender.epoch = u32::try_from(welcome["epoch"].as_u64().unwrap()).unwrap();
    sender.send_frames(0..10).await;
    sender.wait_for_ack(json!([[0, 9]])).await;
    (sender, welcome["session"].as_str().unwrap().to_owned())
}

/// The status after this much time. The clock advances in steps, so that the service notices each.
async fn status_after(centre: &Centre, clock: &ManualClock, seconds: u64, session: &str) -> Value {
    advance(clock, seconds).await;
    centre.service.administrator().await.read(&format!("/api/v1/sessions/{session}")).await["status"].clone()
}

async fn advance(clock: &ManualClock, seconds: u64) {
    for _ in 0..seconds {
        clock.advance(Duration::from_secs(1));
        let_time_pass(Duration::from_millis(2)).await;
    }
}

async fn centre_with_clock() -> (Centre, std::sync::Arc<ManualClock>) {
    let clock = ManualClock::at(1_800_000_000_000);
    let centre = Centre::open_in(Service::start_with_clock(clock.clone()).await).await;
    (centre, clock)
}

/// The other end of the session's live view, once it says that the recording has no sender.
async fn waits(centre: &Centre, session: &str) {
    poll("the end of the connection", async || {
        let ended = centre.trainee.post(&format!("/api/v1/sessions/{session}/end"), json!({})).await;
        (ended.status() != StatusCode::CONFLICT).then_some(ended)
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_of_a_closed_page_ends_by_itself_within_two_minutes() {
    let (centre, clock) = centre_with_clock().await;
    let (sender, session) = record(&centre, &centre.trainee, RECORDING).await;
    drop(sender);
    assert_eq!(status_after(&centre, &clock, 60, &session).await, "receiving");
    poll("the end", async || (status_after(&centre, &clock, 10, &session).await == "queued").then_some(())).await;
    let administrator = centre.service.administrator().await;
    assert_eq!(frames_of(&administrator, &session).await, (0..10).collect::<Vec<_>>());
    let ended = administrator.read(&format!("/api/v1/sessions/{session}")).await;
    assert_eq!(ended["early_end"], json!({"cause": "sender_gone", "detail": null}));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_start_that_a_sender_states_is_marked_and_an_impossible_one_gives_way_to_the_arrival() {
    let (centre, clock) = centre_with_clock().await;
    let arrival = to_rfc3339(clock.now_ms());
    for (frames, began_at, is_kept) in [
        (1, "2027-01-15T07:00:00Z", true), // an hour before
        (2, "2026-11-01T12:00:00Z", true),
        (3, "2026-10-01T12:00:00Z", false), // 106 days before
        (4, "1970-01-01T00:00:10Z", false),
        (5, "2027-01-15T08:00:01Z", false), // a second later
        (6, "2099-01-01T00:00:00Z", false),
    ] {
        let mut hello = hello(&format!("0198c1f2-6a10-7d3e-9f00-5c3b8f1d2b{frames:02}"));
        hello["began_at"] = json!(began_at);
        let mut sender = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
        sender.send_json(&hello).await;
        let Received::Json(welcome) = sender.receive().await else { panic!("no welcome") };
        sender.epoch = u32::try_from(welcome["epoch"].as_u64().unwrap()).unwrap();
        sender.send_frames(0..frames).await;
        let session = sender.end(frames).await;
        let whole = centre.instructor.read(&format!("/api/v1/sessions/{session}")).await;
        let (wanted, source) = if is_kept { (began_at, "claimed") } else { (arrival.as_str(), "arrival") };
        assert_eq!(
            (&whole["recorded_at"], &whole["recorded_at_source"]),
            (&json!(wanted), &json!(source)),
            "{began_at}"
        );
        assert_eq!(whole["created_at"], arrival.as_str());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_of_an_agent_stays_open_for_an_hour() {
    let (centre, clock) = centre_with_clock().await;
    let (mut sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames(0..10).await;
    sender.wait_for_ack(json!([[0, 9]])).await;
    drop(sender);
    let session = welcome["session"].as_str().unwrap();
    assert_eq!(status_after(&centre, &clock, 600, session).await, "receiving");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_trainee_ends_an_interrupted_recording_at_once() {
    let centre = Centre::open().await;
    let (sender, session) = record(&centre, &centre.trainee, RECORDING).await;
    let address = format!("/api/v1/sessions/{session}/end");
    problem(centre.trainee.post(&address, json!({})).await, 409, "conflict").await;
    problem(centre.other_trainee.post(&address, json!({})).await, 404, "not-found").await;
    problem(centre.agent.post(&address, json!({})).await, 403, "forbidden").await;
    drop(sender);
    let ended = poll("the end of the connection", async || {
        let ended = centre.trainee.post(&address, json!({})).await;
        (ended.status() != StatusCode::CONFLICT).then_some(ended)
    })
    .await;
    assert_eq!(read(ended, StatusCode::OK).await["status"], "queued");
    assert_eq!(frames_of(&centre.instructor, &session).await, (0..10).collect::<Vec<_>>());
    let ended = centre.trainee.read(&format!("/api/v1/sessions/{session}")).await;
    assert_eq!(ended["early_end"], json!({"cause": "by_person", "detail": null}));
    problem(centre.trainee.post(&address, json!({})).await, 409, "conflict").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn errors_that_are_marked_while_a_recording_arrives_stay_when_it_is_complete() {
    let (centre, _clock) = centre_with_clock().await;
    let list = json!({"items": [{"name": "Drops", "kind": "count"}]});
    centre.instructor.make("/api/v1/tasks/peg/error-lists", list).await;
    let (sender, session) = record(&centre, &centre.trainee, RECORDING).await;
    let at = format!("/api/v1/sessions/{session}");
    centre.instructor.make(&format!("{at}/error-sheets"), json!({})).await;
    centre.instructor.make(&format!("{at}/error-marks"), json!({"item": "drops", "at_s": 0.2})).await;
    drop(sender);
    waits(&centre, &session).await;
    assert_eq!(centre.instructor.read(&at).await["status"], "queued");
    let finished = centre.instructor.post(&format!("{at}/error-sheet/finish"), json!({})).await;
    let finished = read(finished, StatusCode::OK).await;
    assert_eq!((&finished["marks"][0]["at_s"], &finished["values"][0]["value"]), (&json!(0.2), &json!(1.0)));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_that_ends_normally_in_the_end_has_no_note_of_an_earlier_attempt() {
    for (last, cause) in [(json!({}), json!(null)), (json!({"source_lost": "b"}), json!("source_lost"))] {
        let centre = Centre::open().await;
        let (mut sender, session) = record(&centre, &centre.trainee, RECORDING).await;
        sender.send_json(&json!({"type": "end", "frames": 11, "source_lost": "a"})).await;
        assert_eq!(sender.next_answer().await, Received::Json(json!({"type": "missing", "frames": [[10, 10]]})));
        sender.send_frames([10]).await;
        let mut end = json!({"type": "end", "frames": 11});
        end.as_object_mut().unwrap().extend(last.as_object().unwrap().clone());
        sender.send_json(&end).await;
        let Received::Json(ended) = sender.next_answer().await else { panic!("not ended") };
        assert_eq!(ended["type"], "ended", "{ended}");
        let shown = centre.instructor.read(&format!("/api/v1/sessions/{session}")).await;
        assert_eq!(shown["early_end"]["cause"], cause, "{shown}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_trainee_deletes_an_arriving_recording_but_no_complete_one() {
    let centre = Centre::open().await;
    let (sender, session) = record(&centre, &centre.trainee, RECORDING).await;
    drop(sender);
    let address = format!("/api/v1/sessions/{session}");
    problem(centre.other_trainee.delete(&address).await, 404, "not-found").await;
    assert_eq!(centre.trainee.delete(&address).await.status(), StatusCode::NO_CONTENT);
    problem(centre.trainee.get(&address).await, 404, "not-found").await;

    let (sender, session) = record(&centre, &centre.trainee, ANOTHER).await;
    drop(sender);
    waits(&centre, &session).await;
    problem(centre.trainee.delete(&format!("/api/v1/sessions/{session}")).await, 403, "forbidden").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_groups_instructor_ends_an_interrupted_recording_and_deletes_it_before_or_after() {
    let centre = Centre::open().await;
    for (recording, ends) in [(RECORDING, true), (ANOTHER, false)] {
        let (sender, session) = record(&centre, &centre.trainee, recording).await;
        drop(sender);
        let address = format!("/api/v1/sessions/{session}");
        let end = format!("{address}/end");
        let left = centre.instructor.read_until(&address, |session| session["interruption"].is_object()).await;
        assert_eq!(left["status"], "receiving");
        problem(centre.other_instructor.post(&end, json!({})).await, 404, "not-found").await;
        problem(centre.other_instructor.delete(&address).await, 404, "not-found").await;
        if ends {
            assert_eq!(read(centre.instructor.post(&end, json!({})).await, StatusCode::OK).await["status"], "queued");
            assert_eq!(frames_of(&centre.instructor, &session).await, (0..10).collect::<Vec<_>>());
            let ended = centre.trainee.read(&address).await;
            assert_eq!(ended["early_end"], json!({"cause": "by_person", "detail": null}));
        }
        assert_eq!(centre.instructor.delete(&address).await.status(), StatusCode::NO_CONTENT);
        problem(centre.instructor.get(&address).await, 404, "not-found").await;
        problem(centre.trainee.get(&address).await, 404, "not-found").await;
    }
}

/// True if a new recording of this person may begin. The connection then closes without a frame.
async fn is_accepted(centre: &Centre, client: &Client, trainee: &str) -> bool {
    let mut hello = hello_of_page(&uuid::Uuid::now_v7().to_string());
    hello["trainee"] = json!(trainee);
    poll("the end of the connection before", async || {
        let mut sender = open(&centre.service, client.headers(), "box-1").await.ok()?;
        sender.send_json(&hello).await;
        match sender.receive().await {
            Received::Json(welcome) => Some(welcome["type"] == "welcome"),
            Received::Closed(4409, reason) => (!reason.contains("sending another recording")).then_some(false),
            other => panic!("{other:?}"),
        }
    })
    .await
}

#[tokio::test(flavor = "multi_thread")]
async fn hellos_of_people_leave_the_boxs_agent_a_place() {
    let centre = Centre::open_in(Service::start_with(|settings| settings.live.max_unfinished = 6).await).await;
    let mut accepted = 0;
    for client in [&centre.trainee, &centre.other_trainee, &centre.instructor, &centre.administrator] {
        let trainee = if std::ptr::eq(client, &centre.other_trainee) { "bob" } else { "ada" };
        for _ in 0..3 {
            accepted += usize::from(is_accepted(&centre, client, trainee).await);
        }
    }
    assert_eq!(accepted, 3, "half of the box's places");
    super::begin_when_free(&centre, RECORDING).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_without_a_frame_ends_after_two_minutes_even_of_an_agent() {
    let (centre, clock) = centre_with_clock().await;
    let (sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    drop(sender);
    let address = format!("/api/v1/sessions/{}", welcome["session"].as_str().unwrap());
    poll("the end", async || {
        advance(&clock, 20).await;
        let answer = centre.service.administrator().await.get(&address).await;
        (answer.status() == StatusCode::NOT_FOUND).then_some(())
    })
    .await;
    assert!(clock.now_ms() < 1_800_000_000_000 + 600_000);
}
