//! Recordings that begin by themselves with the first movement in the picture of a box.

use reqwest::{Method, StatusCode};
use serde_json::{Value, json};
use trocar::media::{MediaLimits, VideoFile};

use super::box_agents::{AGENT, Box1, press, screen_until};
use crate::box_agent::BoxComputer;
use crate::support::{problem, read};

/// A mat with noise. From the fifth second on, a dark rod comes in from the left and moves on.
const ROD: &str = "color=c=gray:s=320x240:r=25,noise=alls=8:allf=t[mat];color=c=black:s=40x30:r=25[rod];\
                   [mat][rod]overlay=x='if(lt(t,5),-40,20*(t-5)-39)':y=90";

/// A box whose camera shows [`ROD`] again and again.
async fn box_with_rod() -> Box1 {
    Box1::with_computer(|token| BoxComputer::with_picture(token, 15, ROD)).await
}

/// When the rod comes in in the recording of a session, s: the first picture that is dark at the left.
async fn rod_comes_s(box_1: &Box1, session: &Value) -> f64 {
    let path = format!("/api/v1/sessions/{}/video", session["id"].as_str().unwrap());
    let video = box_1.centre.instructor.request(Method::GET, &path).send().await.unwrap();
    let mut video =
        VideoFile::open(std::io::Cursor::new(video.bytes().await.unwrap()), MediaLimits::default()).unwrap();
    let mut first_s = None;
    while let Some(picture) = video.next_picture().unwrap() {
        let frame = picture.frame();
        let first = *first_s.get_or_insert(frame.time_s);
        if frame.y.row(105)[4] < 60 {
            return frame.time_s - first;
        }
    }
    panic!("the rod is not in the recording");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_begins_with_the_first_movement_and_shows_the_picture_at_rest_before() {
    let box_1 = box_with_rod().await;
    let (instructor, other) = (&box_1.centre.instructor, &box_1.centre.other_instructor);
    let _agent = box_1.stand_by(&[]).await;
    let ada = json!({"trainee": "ada", "task": "peg", "on_movement": true});
    let unnamed =
        problem(box_1.start(instructor, json!({"without_name": true, "on_movement": true})).await, 422, "invalid")
            .await;
    assert_eq!(unnamed["errors"][0]["field"], "on_movement");

    let answer = read(box_1.start(instructor, ada).await, StatusCode::OK).await;
    assert_eq!((&answer["awaited_start"]["trainee"]["code"], &answer["recording"]), (&json!("ada"), &Value::Null));
    assert_eq!(answer["can_start_on_movement"], true);
    assert_eq!(
        other.read(AGENT).await["awaited_start"]["trainee"],
        Value::Null,
        "the other instructor does not see who it is"
    );
    problem(box_1.stop(other).await, 409, "conflict").await;
    box_1.until(|state| state["awaited_start"]["is_picture_still"] == true).await;
    let running = box_1.until(|state| !state["recording"]["session"].is_null()).await;
    assert_eq!((&running["awaited_start"], &running["recording"]["task"]["code"]), (&Value::Null, &json!("peg")));
    box_1.until(|state| state["recording"]["frames"].as_u64().is_some_and(|frames| frames > 75)).await;
    read(box_1.stop(instructor).await, StatusCode::OK).await;
    let session = box_1.session().await;
    let comes_s = rod_comes_s(&box_1, &session).await;
    eprintln!("the rod comes in after {comes_s:.2} s of the recording");
    assert!((1.5..=2.5).contains(&comes_s), "{comes_s}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wait_that_staff_ordered_ends_with_the_consent_and_with_the_record() {
    let box_1 = box_with_rod().await;
    let (admin, ada) = (&box_1.centre.administrator, &box_1.centre.trainee);
    let text = json!({"en": {"title": "Recordings", "body": "We record you."}, "required_from": "2020-01-01"});
    let text = admin.make("/api/v1/consent-texts", text).await["id"].clone();
    let decide = async |decision: &str| {
        ada.make("/api/v1/trainees/ada/consents", json!({"text": text, "decision": decision})).await;
    };
    decide("given").await;
    let _agent = box_1.stand_by(&[]).await;
    let order = async || {
        let ordered = json!({"trainee": "ada", "task": "peg", "on_movement": true});
        read(box_1.start(&box_1.centre.instructor, ordered).await, StatusCode::OK).await;
        let state = box_1.until(|state| state["awaited_start"].is_object()).await;
        assert_eq!(state["checked_in"], Value::Null, "a check-in that ends would end the wait");
    };
    let has_ended = async || {
        let state = box_1.until(|state| state["awaited_start"].is_null()).await;
        assert_eq!(state["recording"], Value::Null);
    };
    order().await;
    decide("withdrawn").await;
    has_ended().await;

    decide("given").await;
    order().await;
    let erased = admin.request(Method::DELETE, "/api/v1/trainees/ada?can_be_taken_back=true").send().await.unwrap();
    assert!(erased.status().is_success(), "{}", erased.status());
    has_ended().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_box_that_starts_by_itself_awaits_the_first_movement_after_a_check_in() {
    let box_1 = box_with_rod().await;
    let (ada, check_in) = (&box_1.centre.trainee, "/api/v1/boxes/box-1/check-in");
    let agent = box_1.stand_by(&["--start-on-movement"]).await;
    let nameless = press(&agent, "/start", json!({"on_movement": true})).await;
    assert_eq!(nameless.status(), StatusCode::CONFLICT);
    let both = press(&agent, "/start", json!({"on_movement": true, "without_name": true})).await;
    assert_eq!(both.status(), StatusCode::BAD_REQUEST);

    read(box_1.centre.instructor.put(check_in, json!({"trainee": "ada"})).await, StatusCode::OK).await;
    let state = screen_until(&agent, |state| state["checked_in"].is_object()).await;
    assert_eq!(state["state"]["awaited_start"], Value::Null, "no task is chosen");
    let task = state["checked_in"]["tasks"][0]["id"].clone();
    press(&agent, "/task", json!({"task": task})).await;
    screen_until(&agent, |state| state["state"]["awaited_start"].is_object()).await;
    box_1.until(|state| state["awaited_start"]["task"]["code"] == "peg").await;

    // Not any more at the word of the person at the box, of another page, and with the check-in.
    assert_eq!(press(&agent, "/stop", json!({})).await.status(), StatusCode::NO_CONTENT);
    box_1.until(|state| state["awaited_start"].is_null()).await;
    problem(box_1.stop(ada).await, 409, "conflict").await;
    assert_eq!(press(&agent, "/start", json!({"on_movement": true})).await.status(), StatusCode::NO_CONTENT);
    box_1.until(|state| state["awaited_start"].is_object()).await;
    read(box_1.stop(ada).await, StatusCode::OK).await;
    box_1.until(|state| state["awaited_start"].is_null()).await;
    press(&agent, "/start", json!({"on_movement": true})).await;
    press(&agent, "/check-out", json!({})).await;
    box_1.until(|state| state["awaited_start"].is_null() && state["checked_in"].is_null()).await;

    // At once while a movement is awaited: nothing from before is shown.
    read(ada.put(check_in, json!({"task": "peg"})).await, StatusCode::UNPROCESSABLE_ENTITY).await;
    read(box_1.centre.instructor.put(check_in, json!({"trainee": "ada", "task": "peg"})).await, StatusCode::OK).await;
    screen_until(&agent, |state| state["state"]["awaited_start"].is_object()).await;
    assert_eq!(press(&agent, "/start", json!({})).await.status(), StatusCode::NO_CONTENT);
    let state = screen_until(&agent, |state| state["state"]["recording"].is_object()).await;
    assert!(state["state"]["recording"]["recorded_s"].as_f64().unwrap() < 1.0, "{state}");
    assert_eq!(state["state"]["awaited_start"], Value::Null);
    assert_eq!(press(&agent, "/stop", json!({})).await.status(), StatusCode::NO_CONTENT);
    let state = screen_until(&agent, |state| state["state"]["recording"].is_null()).await;
    assert_eq!(state["state"]["awaited_start"], Value::Null, "the next one is asked for");
    assert_eq!(box_1.session().await["trainee"]["code"], "ada");

    // Staff ask for it, and the key at the box starts that recording, not one without a name.
    press(&agent, "/check-out", json!({})).await;
    box_1.until(|state| state["checked_in"].is_null()).await;
    let ordered = json!({"trainee": "ada", "task": "peg", "on_movement": true});
    read(box_1.start(&box_1.centre.instructor, ordered).await, StatusCode::OK).await;
    screen_until(&agent, |state| state["awaited"] == "ada").await;
    assert_eq!(press(&agent, "/start", json!({})).await.status(), StatusCode::NO_CONTENT);
    screen_until(&agent, |state| state["recorded"] == "ada" && state["awaited"].is_null()).await;
    assert_eq!(press(&agent, "/stop", json!({})).await.status(), StatusCode::NO_CONTENT);
    box_1.until(|state| state["recording"].is_null() && state["spool"]["recordings"] == 0).await;
}
