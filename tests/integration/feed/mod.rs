//! Feeds over real connections to the real service: acknowledged frames stay; late or wrong input is refused.

mod bare;
mod interrupted;
mod limits;
mod live;
mod load;
mod moved;
pub mod push;
pub mod scene;
mod seen;
pub mod sender;
mod watchers;

use std::io::Write;
use std::time::Duration;

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::domain::feed::record::{HEADER_BYTES, MAX_HOLE_BYTES};
use trocar::media::{MediaLimits, VideoFile};
use trocar::time::{Clock, ManualClock, SystemClock, to_rfc3339};

use crate::api::centre::Centre;
use crate::support::{Client, Service, let_time_pass, poll, poll_until, problem, read, soon, with_advancing_clock};
use sender::{FRAME_TICKS, Received, SIZE, begin, hello, open};

const RECORDING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";
const ANOTHER: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a45";

/// Numbers of the frames of a session's recording, by their times.
async fn frames_of(client: &Client, session: &str) -> Vec<u64> {
    let video = client.get(&format!("/api/v1/sessions/{session}/video")).await;
    assert_eq!(video.status(), StatusCode::OK);
    numbers_in(&video.bytes().await.unwrap())
}

/// Numbers of the frames of a recording, by their times.
pub fn numbers_in(video: &[u8]) -> Vec<u64> {
    let path = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(path.path(), video).unwrap();
    let mut video = VideoFile::open(path.reopen().unwrap(), MediaLimits::default()).unwrap();
    let mut numbers = Vec::new();
    while let Some(picture) = video.next_picture().unwrap() {
        let frame = picture.frame();
        assert_eq!((frame.width(), frame.height()), (SIZE.0 as usize, SIZE.1 as usize));
        let ticks = frame.time_s * 90_000.0;
        assert!((ticks - ticks.round()).abs() < 1e-6, "times are unchanged: {ticks}");
        numbers.push(ticks.round() as u64 / FRAME_TICKS as u64);
    }
    numbers
}

#[tokio::test(flavor = "multi_thread")]
async fn frames_become_a_session_like_any_other() {
    let centre = Centre::open().await;
    let (mut sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    assert_eq!((&welcome["epoch"], &welcome["durable"]), (&json!(1), &json!([])));
    let session = welcome["session"].as_str().unwrap().to_owned();
    sender.send_frames(0..50).await;
    sender.wait_for_ack(json!([[0, 49]])).await;

    let address = format!("/api/v1/sessions/{session}");
    let arriving = centre.instructor.read(&address).await;
    assert_eq!((&arriving["status"], &arriving["video"]["bytes"]), (&json!("receiving"), &Value::Null));
    let listed = centre.instructor.read("/api/v1/sessions?status=receiving").await;
    assert_eq!(listed["items"][0]["id"], session);
    let video = centre.instructor.get(&format!("{address}/video")).await;
    assert_eq!(video.status(), StatusCode::NOT_FOUND, "there is no video yet");

    assert_eq!(sender.end(50).await, session);
    let whole = centre.instructor.read(&address).await;
    assert_eq!(whole["status"], "queued");
    assert_eq!(frames_of(&centre.instructor, &session).await, (0..50).collect::<Vec<_>>());

    // A sender that missed the last message says hello again.
    let mut again = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
    again.send_json(&hello(RECORDING)).await;
    assert_eq!(again.receive().await, Received::Json(json!({"type": "ended", "session": session})));
    assert_eq!(again.close_code().await, 1000);
}

#[tokio::test(flavor = "multi_thread")]
async fn sender_and_box_say_ahead_that_the_agents_token_expires() {
    let centre = Centre::open().await;
    let (mut sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    assert!(welcome.get("token_expires_at").is_none(), "a year is left: {welcome}");
    assert!(centre.instructor.read("/api/v1/boxes/box-1").await["agent_token_expires_at"].is_null());
    sender.send_frames(0..1).await;
    sender.end(1).await;

    let in_ten_days = to_rfc3339((SystemClock.now_ms() / 1000 + 864_000) * 1000);
    let token = json!({"name": "short", "role": "agent", "box": "box-1", "expires_at": in_ten_days});
    let token = centre.administrator.make("/api/v1/tokens", token).await;
    let agent = centre.service.stranger().with_token(token["token"].as_str().unwrap());
    let unused = centre.instructor.read("/api/v1/boxes/box-1").await;
    assert!(unused["agent_token_expires_at"].is_null(), "no agent uses it yet: {unused}");
    let (_sender, welcome) = begin(&centre.service, &agent, ANOTHER).await;
    assert_eq!(welcome["token_expires_at"], in_ten_days);
    let boxes = centre.instructor.read("/api/v1/boxes").await;
    assert_eq!(boxes["items"][0]["agent_token_expires_at"], in_ten_days);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_last_message_says_that_frames_and_gaps_to_the_end_are_durable() {
    let centre = Centre::open().await;
    let (mut sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames((0..10).chain(15..20)).await;
    sender.send_gap(10, 14).await;
    sender.send_json(&json!({"type": "end", "frames": 20})).await; // possibly before any acknowledgement
    let ended = json!({"type": "ended", "session": welcome["session"], "durable": [[0, 19]]});
    assert_eq!(sender.next_answer().await, Received::Json(ended));
    assert_eq!(sender.close_code().await, 1000);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_that_cannot_begin_leaves_no_session_and_may_be_sent_again() {
    let centre = Centre::open().await;
    let in_the_way = centre.service.data.path().join("feeds").join(RECORDING);
    std::fs::create_dir(&in_the_way).unwrap();
    let mut refused = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
    refused.send_json(&hello(RECORDING)).await;
    assert_eq!(refused.close_code().await, 4500);
    assert_eq!(centre.instructor.read("/api/v1/sessions").await["items"], json!([]));
    std::fs::remove_dir(&in_the_way).unwrap();
    let (mut sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    assert_eq!(welcome["epoch"], 1);
    sender.send_frames(0..5).await;
    assert_eq!(sender.end(5).await, welcome["session"].as_str().unwrap());
}

#[tokio::test(flavor = "multi_thread")]
async fn after_a_cut_the_next_connection_sends_live_frames_first_and_then_the_missing_ones() {
    let centre = Centre::open().await;
    let (mut sender, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames(0..20).await;
    sender.wait_for_ack(json!([[0, 19]])).await;
    drop(sender);

    let (mut sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    assert_eq!((&welcome["epoch"], &welcome["durable"]), (&json!(2), &json!([[0, 19]])));
    sender.send_frames(40..50).await; // live
    sender.wait_for_ack(json!([[0, 19], [40, 49]])).await;
    sender.send_frames(15..30).await; // older frames; some are durable already
    sender.send_json(&json!({"type": "end", "frames": 50})).await;
    assert_eq!(sender.next_answer().await, Received::Json(json!({"type": "missing", "frames": [[30, 39]]})));
    sender.send_gap(30, 39).await;
    let session = sender.end(50).await;
    assert_eq!(frames_of(&centre.instructor, &session).await, (0..30).chain(40..50).collect::<Vec<_>>());
}

#[tokio::test(flavor = "multi_thread")]
async fn acknowledged_frames_survive_a_restart_of_the_service() {
    let centre = Centre::open().await;
    let (mut sender, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames(0..30).await;
    sender.wait_for_ack(json!([[0, 29]])).await;
    let agent = centre.agent.clone();
    let data = centre.service.stop().await;
    assert_eq!(sender.close_code().await, 1012);

    // A record that is cut off at the end of the log does not count as a record.
    let log = data.path().join("feeds").join(RECORDING);
    let whole = std::fs::metadata(&log).unwrap().len();
    std::fs::File::options().append(true).open(&log).unwrap().set_len(whole - 5).unwrap();

    let service = Service::start_in(data, std::sync::Arc::new(trocar::time::SystemClock), |_| ()).await;
    let (mut sender, welcome) = begin(&service, &agent, RECORDING).await;
    assert_eq!((&welcome["epoch"], &welcome["durable"]), (&json!(2), &json!([[0, 28]])));
    sender.send_frames(29..31).await;
    let session = sender.end(31).await;
    assert_eq!(frames_of(&service.administrator().await, &session).await, (0..31).collect::<Vec<_>>());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_log_that_is_slow_to_read_delays_no_other_box() {
    const LENGTH: u32 = 200_000;
    let centre = Centre::open().await;
    centre.administrator.make("/api/v1/boxes", json!({"name": "Box 2", "code": "box-2"})).await;
    let token = json!({"name": "beside box 2", "role": "agent", "box": "box-2"});
    let token = centre.administrator.make("/api/v1/tokens", token).await["token"].clone();
    begin(&centre.service, &centre.agent, RECORDING).await;
    let agent = centre.agent.clone();
    let data = centre.service.stop().await;
    // A pipe replaces the log: the service reads its bytes and then waits for more.
    let log = data.path().join("feeds").join(RECORDING);
    std::fs::remove_file(&log).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&log).status().unwrap().success());
    let mut pipe = std::fs::File::options().read(true).write(true).open(&log).unwrap();

    let service = Service::start_in(data, std::sync::Arc::new(trocar::time::SystemClock), |_| ()).await;
    let mut slow = open(&service, agent.headers(), "box-1").await.unwrap();
    slow.send_json(&hello(RECORDING)).await;
    let mut head = [0; HEADER_BYTES];
    head[0] = 1; // a frame
    head[24..28].copy_from_slice(&LENGTH.to_be_bytes());
    let half = [&head[..], &[7; LENGTH as usize / 2]].concat();
    let pipe = soon("the log is read", async {
        // More than a pipe holds: the write ends only if the service reads.
        let write = move || pipe.write_all(&half).map(|()| pipe);
        tokio::task::spawn_blocking(write).await.unwrap().unwrap()
    });
    let mut pipe = pipe.await;

    let other = service.stranger().with_token(token.as_str().unwrap());
    let mut quick = open(&service, other.headers(), "box-2").await.unwrap();
    quick.send_json(&hello(ANOTHER)).await;
    assert!(matches!(quick.receive().await, Received::Json(message) if message["type"] == "welcome"));

    pipe.write_all(&[7; LENGTH as usize / 2]).unwrap(); // the record is whole, and damaged
    // The service finds no record within its search limit and takes this for the log's end. It cannot truncate a pipe.
    let rest = MAX_HOLE_BYTES - LENGTH as usize + 4 * HEADER_BYTES; // no more: unread bytes must fit into the pipe
    let written = tokio::task::spawn_blocking(move || pipe.write_all(&vec![0; rest]));
    soon("the rest is read", written).await.unwrap().unwrap();
    assert_eq!(slow.close_code().await, 4500);
}

#[tokio::test(flavor = "multi_thread")]
async fn only_the_latest_connection_of_a_recording_may_send() {
    let centre = Centre::open().await;
    let (mut old, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    old.send_frames(0..5).await;
    old.wait_for_ack(json!([[0, 4]])).await;
    let (mut new, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    old.send_frames(5..9).await; // held up on the way
    assert_eq!(old.close_code().await, 4410);
    new.send_frames(9..10).await;
    new.wait_for_ack(json!([[0, 4], [9, 9]])).await;

    // A record with the old epoch is refused on every connection.
    new.send_frame(1, 5, 5 * FRAME_TICKS).await;
    assert_eq!(new.close_code().await, 4422);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_box_sends_one_recording_at_a_time() {
    let centre = Centre::open().await;
    let (first, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    let mut second = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
    second.send_json(&hello(ANOTHER)).await;
    assert_eq!(second.close_code().await, 4409);
    drop(first);
    begin_when_free(&centre, ANOTHER).await;
}

/// A connection of the box's agent and its session, once the service has noticed the end of the connection before.
async fn begin_when_free(centre: &Centre, recording: &str) -> (sender::Sender, String) {
    for _ in 0..100 {
        let mut sender = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
        sender.send_json(&hello(recording)).await;
        if let Received::Json(message) = sender.receive().await
            && message["type"] == "welcome"
        {
            sender.epoch = u32::try_from(message["epoch"].as_u64().unwrap()).unwrap();
            return (sender, message["session"].as_str().unwrap().to_owned());
        }
    }
    panic!("the box is busy although no connection sends");
}

#[tokio::test(flavor = "multi_thread")]
async fn strangers_and_foreign_pages_are_refused_before_hello() {
    let centre = Centre::open().await;
    centre.administrator.make("/api/v1/boxes", json!({"name": "Box 2", "code": "box-2"})).await;
    let opened = async |client: &Client, in_box| open(&centre.service, client.headers(), in_box).await.err();
    assert_eq!(opened(&centre.service.stranger(), "box-1").await, Some(401));
    assert_eq!(opened(&centre.agent, "box-2").await, Some(404), "another box's agent");
    assert_eq!(opened(&centre.agent, "box-9").await, Some(404));
    let foreign = centre.trainee.clone().with("origin", "http://evil.example");
    assert_eq!(opened(&foreign, "box-1").await, Some(403));
    assert_eq!(opened(&centre.trainee, "box-1").await, None, "people may send their own");
    problem(centre.agent.get("/api/v1/boxes/box-1/feed").await, 400, "bad-request").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_withdrawn_token_closes_its_feed() {
    let centre = Centre::open().await;
    let (mut sender, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    let tokens = centre.administrator.read("/api/v1/tokens").await;
    let id = tokens["items"][0]["id"].as_str().unwrap();
    assert_eq!(centre.administrator.delete(&format!("/api/v1/tokens/{id}")).await.status(), StatusCode::NO_CONTENT);
    assert_eq!(sender.close_code().await, 4401);
}

#[tokio::test(flavor = "multi_thread")]
async fn frames_keep_a_sign_in_alive_and_idle_people_are_signed_out() {
    const PART: Duration = Duration::from_secs(20 * 60); // of the 30 minutes after which idle people are signed out
    let clock = ManualClock::at(1_795_000_000_000);
    let centre = Centre::open_in(Service::start_with_clock(clock.clone()).await).await;
    let (mut sender, _) = begin(&centre.service, &centre.trainee, RECORDING).await;
    for minutes in 0..4 {
        sender.send_frames(minutes..minutes + 1).await;
        sender.wait_for_ack(json!([[0, minutes]])).await;
        clock.advance(PART);
    }
    sender.send_frames(4..5).await;
    sender.wait_for_ack(json!([[0, 4]])).await;
    centre.trainee.read("/api/v1/me").await;
    let idle = centre.other_trainee.get("/api/v1/me").await;
    assert_eq!(idle.status(), StatusCode::UNAUTHORIZED);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainee_cannot_send_the_recording_of_another_trainee() {
    let centre = Centre::open().await;
    let mut sender = open(&centre.service, centre.other_trainee.headers(), "box-1").await.unwrap();
    sender.send_json(&hello(RECORDING)).await; // a recording of Ada
    assert_eq!(sender.close_code().await, 4404);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_first_message_is_refused_with_its_code() {
    let centre = Centre::open().await;
    let changed = |key: &str, value: Value| {
        let mut hello = hello(RECORDING);
        hello[key] = value;
        hello
    };
    let wrong = [
        (json!({"type": "end", "frames": 1}), 4400),
        (changed("protocol", json!(2)), 4400),
        (changed("codec", json!("png")), 4400),
        (changed("width", json!(60_000)), 4400),
        (changed("time_base", json!([1, 25])), 4400),
        (changed("began_at", json!("yesterday")), 4400),
        (changed("recording", json!("mine")), 4400),
        (changed("colour", json!("blue")), 4400),
        (changed("trainee", json!("missing")), 4404),
        (changed("task", json!("nothing")), 4404),
        (changed("sender", json!("x".repeat(9000))), 4413),
    ];
    for (message, code) in wrong {
        let mut sender = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
        sender.send_json(&message).await;
        assert_eq!(sender.close_code().await, code, "{message}");
    }
    let none = centre.administrator.read("/api/v1/sessions").await;
    assert_eq!(none["items"], json!([]), "no session was begun");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_record_closes_the_feed_and_costs_no_acknowledged_frame() {
    let centre = Centre::open().await;
    let mut damaged = Vec::new();
    let body = trocar::domain::feed::record::RecordBody::Frame { time: 0, is_key: true, payload: &[1, 2, 3] };
    trocar::domain::feed::record::FeedRecord { epoch: 1, number: 9, body }.write(&mut damaged);
    damaged[33] ^= 1;
    let wrong: [(Vec<u8>, u16); 4] =
        [(damaged, 4400), (b"nonsense".to_vec(), 4400), (vec![0; 2 << 20], 4413), (Vec::new(), 4400)];
    for (bytes, code) in wrong {
        let (mut sender, _) = begin(&centre.service, &centre.agent, RECORDING).await;
        sender.send_frames(0..3).await;
        sender.send_bytes(bytes).await;
        assert_eq!(sender.close_code().await, code);
    }
    let (mut sender, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frame(sender.epoch, 3, i64::MAX).await; // from the future
    assert_eq!(sender.close_code().await, 4422);
    let (mut sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    assert_eq!(welcome["durable"], json!([[0, 2]]));
    sender.send_json(&json!({"type": "end", "frames": 2})).await; // fewer than were sent
    assert_eq!(sender.close_code().await, 4422);
    let (mut sender, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    let session = sender.end(3).await;
    assert_eq!(frames_of(&centre.instructor, &session).await, [0, 1, 2]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_without_a_frame_that_can_be_shown_leaves_no_session() {
    let centre = Centre::open().await;
    let mut sender = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
    let mut h264 = hello(RECORDING);
    h264["codec"] = json!("h264");
    sender.send_json(&h264).await;
    let Received::Json(welcome) = sender.receive().await else { panic!("no welcome") };
    sender.epoch = 1;
    sender.send_frames(0..3).await; // without any parameter set
    sender.send_json(&json!({"type": "end", "frames": 3})).await;
    assert_eq!(sender.close_code().await, 4422);
    let session = welcome["session"].as_str().unwrap();
    read(centre.instructor.get(&format!("/api/v1/sessions/{session}")).await, StatusCode::NOT_FOUND).await;
    assert!(std::fs::read_dir(centre.service.data.path().join("feeds")).unwrap().next().is_none(), "no log is left");
}

#[tokio::test(flavor = "multi_thread")]
async fn erasing_a_session_that_arrives_ends_its_feed() {
    let centre = Centre::open().await;
    let (mut sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames(0..5).await;
    sender.wait_for_ack(json!([[0, 4]])).await;
    let session = format!("/api/v1/sessions/{}", welcome["session"].as_str().unwrap());
    assert_eq!(centre.instructor.delete(&session).await.status(), StatusCode::NO_CONTENT);
    sender.send_json(&json!({"type": "end", "frames": 5})).await;
    let code = sender.close_code().await;
    assert!([4404, 4500].contains(&code), "{code}");

    // The sender cannot create an erased session again.
    let mut again = open(&centre.service, centre.agent.headers(), "box-1").await.unwrap();
    again.send_json(&hello(RECORDING)).await;
    assert_eq!(again.close_code().await, 4404);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_abandoned_recording_ends_with_the_frames_that_arrived() {
    let clock = ManualClock::at(1_795_000_000_000);
    let centre = Centre::open_in(Service::start_with_clock(clock.clone()).await).await;
    let (mut sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames((0..10).chain(15..20)).await;
    sender.wait_for_ack(json!([[0, 9], [15, 19]])).await;
    drop(sender);
    let session = format!("/api/v1/sessions/{}", welcome["session"].as_str().unwrap());
    let status = async |client: &Client| client.read(&session).await["status"].as_str().unwrap().to_owned();
    clock.advance(Duration::from_secs(1700));
    assert_eq!(status(&centre.administrator).await, "receiving", "an agent that lost its server may still come back");
    clock.set_forward(Duration::from_secs(4000));
    let administrator = centre.service.administrator().await;
    for _ in 0..3 {
        clock.advance(Duration::from_secs(30));
        let_time_pass(Duration::from_millis(100)).await;
        assert_eq!(status(&administrator).await, "receiving", "setting the clock does not end a recording");
    }
    poll("the end", async || {
        clock.advance(Duration::from_secs(1800));
        let administrator = centre.service.administrator().await;
        (status(&administrator).await == "queued").then_some(())
    })
    .await;
    let id = session.rsplit('/').next().unwrap();
    let administrator = centre.service.administrator().await;
    assert_eq!(frames_of(&administrator, id).await, (0..10).chain(15..20).collect::<Vec<_>>());
}

#[tokio::test(flavor = "multi_thread")]
async fn missing_frames_are_still_accepted_after_ending_without_them_has_failed() {
    let clock = ManualClock::at(1_795_000_000_000);
    let centre = Centre::open_in(Service::start_with_clock(clock.clone()).await).await;
    let (mut sender, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames((0..10).chain(15..20)).await;
    sender.wait_for_ack(json!([[0, 9], [15, 19]])).await;
    drop(sender);
    // The service assembles no recording while it cannot measure the free space.
    let (incoming, away) = ["incoming", "away"].map(|name| centre.service.data.path().join(name)).into();
    std::fs::rename(&incoming, &away).unwrap();
    for _ in 0..4 {
        let_time_pass(Duration::from_millis(250)).await;
        clock.advance(Duration::from_secs(1800));
    }
    let_time_pass(Duration::from_millis(250)).await;
    std::fs::rename(&away, &incoming).unwrap();

    let (mut sender, welcome) = begin(&centre.service, &centre.agent, RECORDING).await;
    assert_eq!(welcome["durable"], json!([[0, 9], [15, 19]]));
    sender.send_frames(10..15).await;
    let session = sender.end(20).await;
    assert_eq!(frames_of(&centre.service.administrator().await, &session).await, (0..20).collect::<Vec<_>>());
}

#[tokio::test(flavor = "multi_thread")]
async fn an_erased_log_is_deleted_while_another_recording_is_being_ended() {
    const FIRST: usize = 200_000; // more than a pipe holds: the write ends only if the service reads
    let centre = Centre::open().await;
    begin_when_free(&centre, RECORDING).await;
    let (_, session) = begin_when_free(&centre, ANOTHER).await;
    let data = centre.service.stop().await;
    let feeds = data.path().join("feeds");
    let (slow, erased) = (feeds.join(RECORDING), feeds.join(ANOTHER));
    // A pipe replaces the log: the service reads it while it is open for writing.
    std::fs::remove_file(&slow).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&slow).status().unwrap().success());
    let mut pipe = std::fs::File::options().read(true).write(true).open(&slow).unwrap();

    let clock = ManualClock::at(1_795_000_000_000);
    let service = Service::start_in(data, clock.clone(), |settings| settings.live.abandoned_s = 100).await;
    clock.advance(Duration::from_secs(200));
    let write = move || pipe.write_all(&[0; FIRST]).map(|()| pipe);
    let written = tokio::task::spawn_blocking(write);
    let read = soon("the log is read", written);
    let mut pipe = with_advancing_clock(&clock, Duration::from_secs(30), read).await.unwrap().unwrap();
    let administrator = service.administrator().await;
    assert_eq!(administrator.delete(&format!("/api/v1/sessions/{session}")).await.status(), StatusCode::NO_CONTENT);
    let deleted = poll_until("the erased log's end", || !erased.exists());
    with_advancing_clock(&clock, Duration::from_secs(30), deleted).await;
    // The service finds no record within its search limit and takes this for the log's end.
    let rest = MAX_HOLE_BYTES + 4 * HEADER_BYTES - FIRST;
    let written = tokio::task::spawn_blocking(move || pipe.write_all(&vec![0; rest]));
    soon("the rest is read", written).await.unwrap().unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn an_unreadable_recording_does_not_stop_others_from_ending() {
    let centre = Centre::open().await;
    for recording in [RECORDING, ANOTHER] {
        let (mut sender, _) = begin_when_free(&centre, recording).await;
        sender.send_frames(0..3).await;
        sender.wait_for_ack(json!([[0, 2]])).await;
    }
    let data = centre.service.stop().await;
    let log = data.path().join("feeds").join(RECORDING); // the recording that the service checks first
    std::fs::remove_file(&log).unwrap();
    std::fs::create_dir(&log).unwrap();

    let clock = ManualClock::at(1_795_000_000_000);
    let service = Service::start_in(data, clock.clone(), |_| ()).await;
    poll("the other's end", async || {
        clock.advance(Duration::from_secs(1800));
        let queued = service.administrator().await.read("/api/v1/sessions?status=queued").await;
        (queued["items"].as_array().unwrap().len() == 1).then_some(())
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn pictures_of_another_size_are_left_out() {
    let centre = Centre::open().await;
    let (mut sender, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    sender.send_frames(0..5).await;
    let mut other = std::io::Cursor::new(Vec::new());
    image::RgbImage::new(80, 60).write_to(&mut other, image::ImageFormat::Jpeg).unwrap();
    let body = trocar::domain::feed::record::RecordBody::Frame {
        time: 5 * FRAME_TICKS,
        is_key: true,
        payload: other.get_ref(),
    };
    sender.send_record(trocar::domain::feed::record::FeedRecord { epoch: sender.epoch, number: 5, body }).await;
    sender.send_frames(6..9).await;
    let session = sender.end(9).await;
    assert_eq!(frames_of(&centre.instructor, &session).await, [0, 1, 2, 3, 4, 6, 7, 8]);
}
