//! How many recordings one person may send at once. Other people and the agents of boxes send meanwhile.

use reqwest::{Method, Response, header};
use serde_json::{Value, json};

use super::RECORDING;
use super::sender::{Received, Sender, begin, hello, open};
use crate::api::centre::Centre;
use crate::support::{Client, poll, problem};

/// A box for each recording that a person may send at once: a box sends one at a time.
const BOXES: [&str; 4] = ["box-2", "box-3", "box-4", "box-5"];
/// A box without a sender.
const FREE_BOX: &str = "box-6";

async fn centre_with_boxes() -> Centre {
    let centre = Centre::open().await;
    for code in BOXES.into_iter().chain([FREE_BOX]) {
        centre.administrator.make("/api/v1/boxes", json!({"name": code, "code": code})).await;
    }
    centre
}

/// A connection to this box that has said hello, and the answer.
async fn say_hello(
    centre: &Centre,
    (client, trainee): (&Client, &str),
    in_box: &str,
    recording: &str,
) -> (Sender, Received) {
    let mut hello = hello(recording);
    hello["trainee"] = json!(trainee);
    let connect = async || open(&centre.service, client.headers(), in_box).await.ok();
    let mut sender = poll("a free slot for a connection", connect).await;
    sender.send_json(&hello).await;
    let answer = sender.receive().await;
    (sender, answer)
}

/// A connection to this box that may send a recording, and the welcome message.
async fn begin_in(centre: &Centre, of: (&Client, &str), in_box: &str, recording: &str) -> (Sender, Value) {
    let (mut sender, answer) = say_hello(centre, of, in_box, recording).await;
    let Received::Json(welcome) = answer else { panic!("{answer:?} in {in_box}") };
    assert_eq!(welcome["type"], "welcome", "{welcome}");
    sender.epoch = u32::try_from(welcome["epoch"].as_u64().unwrap()).unwrap();
    (sender, welcome)
}

/// The answer to a request for a connection, if it is refused.
async fn refusal(client: &Client, in_box: &str) -> Response {
    let request = client.request(Method::GET, &format!("/api/v1/boxes/{in_box}/feed"));
    let upgrade = request.header(header::CONNECTION, "Upgrade").header(header::UPGRADE, "websocket");
    let key = upgrade.header(header::SEC_WEBSOCKET_KEY, "dGhlIHNhbXBsZSBub25jZQ==");
    key.header(header::SEC_WEBSOCKET_VERSION, "13").send().await.unwrap()
}

fn new_id() -> String {
    uuid::Uuid::now_v7().to_string()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_fifth_connection_of_a_person_is_refused_and_others_send_meanwhile() {
    let centre = centre_with_boxes().await;
    let (ada, bob) = ((&centre.trainee, "ada"), (&centre.other_trainee, "bob"));
    let mut hers = Vec::new();
    for in_box in BOXES {
        hers.push(begin_in(&centre, ada, in_box, &new_id()).await.0);
    }
    let refused = problem(refusal(ada.0, FREE_BOX).await, 429, "too-many").await;
    assert!(refused["detail"].as_str().unwrap().contains("End one of them"), "{refused}");
    let (mut his, _) = begin_in(&centre, bob, FREE_BOX, &new_id()).await;
    let (mut agents, _) = begin(&centre.service, &centre.agent, RECORDING).await;
    for sender in [&mut hers[0], &mut his, &mut agents] {
        sender.send_frames(0..1).await;
        sender.wait_for_ack(json!([[0, 0]])).await;
    }
    his.end(1).await;
    hers.remove(0).end(1).await;
    begin_in(&centre, ada, FREE_BOX, &new_id()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_person_with_four_unfinished_recordings_resumes_them_but_begins_no_fifth() {
    let centre = centre_with_boxes().await;
    let (ada, bob) = ((&centre.trainee, "ada"), (&centre.other_trainee, "bob"));
    let recordings: Vec<String> = BOXES.iter().map(|_| new_id()).collect();
    for (in_box, recording) in BOXES.iter().zip(&recordings) {
        begin_in(&centre, ada, in_box, recording).await; // the connection is lost at once
    }
    let (_, answer) = say_hello(&centre, ada, FREE_BOX, &new_id()).await;
    let Received::Closed(4409, why) = answer else { panic!("{answer:?}") };
    assert!(why.contains("you have 4 unfinished recordings: end them"), "{why}");
    let (_resumed, welcome) = begin_in(&centre, ada, BOXES[0], &recordings[0]).await;
    assert_eq!(welcome["epoch"], 2);
    begin_in(&centre, bob, FREE_BOX, &new_id()).await;
    begin(&centre.service, &centre.agent, RECORDING).await;
}
