//! The network of a box is away for an hour: the box records on, starts and stops, and afterwards the server has every
//! frame. The pages show what is true within ten seconds of each change.

use std::collections::HashMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::agent::{AgentSetup, decode};
use super::centre::json_of;
use crate::box_agent::{BoxComputer, StandingAgent};
use crate::support::{let_time_pass, poll_json};

const AGENT: &str = "/boxes/box-1/agent";
/// How long a page may show what is no longer true.
const MAX_UNTRUE: Duration = Duration::from_secs(10);
/// Time that the rest of the test needs beside the outage, s.
const MARGIN_S: u64 = 120;

/// A box that stands by, behind a network that can be taken away.
struct Box1 {
    setup: AgentSetup,
    agent: StandingAgent,
    /// How long each change of a page took.
    changes: Vec<(String, Duration)>,
}

impl Box1 {
    async fn screen(&self) -> Value {
        reqwest::get(self.agent.screen("/state")).await.unwrap().json().await.unwrap()
    }

    /// Waits until the box's screen shows this, and fails if that takes too long.
    async fn screen_shows(&mut self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let since = Instant::now();
        let state = poll_json(what, async || self.screen().await, wanted).await;
        self.note(what, since);
        state
    }

    /// The same for the page of the box.
    async fn page_shows(&mut self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let since = Instant::now();
        let state = self.setup.centre.until(AGENT, wanted).await;
        self.note(what, since);
        state
    }

    fn note(&mut self, what: &str, since: Instant) {
        let took = since.elapsed();
        assert!(took < MAX_UNTRUE, "{what}: {took:?}");
        self.changes.push((what.to_owned(), took));
    }

    async fn press(&self, path: &str) {
        let pressed = reqwest::Client::new().post(self.agent.screen(path)).json(&json!({})).send().await.unwrap();
        assert_eq!(pressed.status(), StatusCode::NO_CONTENT, "{path}");
    }

    /// Ends the recording at the box. Returns the number of frames that it had a moment before.
    async fn stop(&mut self) -> u64 {
        let frames = self.screen().await["state"]["recording"]["frames"].as_u64().unwrap();
        self.press("/stop").await;
        self.screen_shows("the screen shows the stop", |state| state["state"]["recording"].is_null()).await;
        frames
    }

    /// Saves the video at an address of the service.
    async fn video(&self, path: &str) -> PathBuf {
        let video = self.setup.centre.get(path).await;
        assert!(video.status().is_success(), "{path}");
        let file = self.setup.folder.path().join("arrived.mp4");
        std::fs::write(&file, video.bytes().await.unwrap()).unwrap();
        file
    }
}

/// The places of a recording's frames in the camera's clip: one after the other, none missing.
fn places(video: &std::path::Path, places: &HashMap<u64, u64>) -> [u64; 2] {
    let found: Vec<u64> = decode(video).iter().map(|(_, _, of)| places[of]).collect();
    let gap = found.windows(2).find(|pair| pair[1] != pair[0] + 1);
    assert_eq!(gap, None, "each frame once, in order");
    [found[0], found[found.len() - 1]]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "takes an hour: make network-outage"]
async fn a_network_that_is_away_for_an_hour_costs_a_box_no_frame() {
    let minutes =
        std::env::var_os("TROCAR_OUTAGE_MINUTES").map_or(60.0, |text| text.to_str().unwrap().parse().unwrap());
    let outage = Duration::from_secs_f64(60.0 * minutes);
    let setup = AgentSetup::new().await;
    let token = json!({"name": "box 1", "role": "agent", "box": "box-1"});
    let token = json_of(setup.centre.create_signed_in("/tokens", &token).await).await;
    let computer = BoxComputer::new(token["token"].as_str().unwrap(), outage.as_secs() as u32 + MARGIN_S as u32);
    let clip: HashMap<u64, u64> = decode(&computer.camera()).into_iter().map(|(index, _, of)| (of, index)).collect();
    let agent = computer.stand_by(&format!("http://{}", setup.relay.host), &[]);
    let mut box_1 = Box1 { setup, agent, changes: Vec::new() };
    box_1.page_shows("the page shows the box", |state| state["camera"]["is_open"] == true).await;
    let check_in = box_1.setup.centre.request(reqwest::Method::PUT, "/boxes/box-1/check-in");
    let check_in = check_in.json(&json!({"trainee": "ada", "task": "pegs"})).send().await.unwrap();
    assert!(check_in.status().is_success());
    box_1.screen_shows("the screen shows the check-in", |state| state["checked_in"].is_object()).await;
    box_1.press("/start").await;
    box_1.page_shows("the page shows the recording", |state| !state["recording"]["session"].is_null()).await;

    box_1.setup.relay.set_silent(true);
    let cut = Instant::now();
    box_1.page_shows("the page shows that the box is silent", |state| state["presence"] == "silent").await;
    box_1.screen_shows("the screen shows the outage", |state| state["is_connected"] == false).await;
    let_time_pass((outage / 2).saturating_sub(cut.elapsed())).await;
    let mut captured = vec![box_1.stop().await];
    box_1.press("/start").await;
    let_time_pass((outage * 3 / 4).saturating_sub(cut.elapsed())).await;
    captured.push(box_1.stop().await);
    box_1.press("/check-out").await;
    box_1.press("/start").await;
    let_time_pass(outage.saturating_sub(cut.elapsed())).await;
    captured.push(box_1.stop().await);
    assert_eq!(box_1.screen().await["last_unnamed"], "kept");
    assert_eq!(box_1.setup.centre.until(AGENT, |_| true).await["presence"], "silent");

    box_1.setup.relay.set_silent(false);
    let back = Instant::now();
    let is_true = |state: &Value| state["presence"] == "live" && state["recording"].is_null();
    box_1.page_shows("the page shows that the box is back", is_true).await;
    box_1.screen_shows("the screen shows the connection", |state| state["is_connected"] == true).await;
    box_1.setup.centre.until(AGENT, |state| state["spool"]["recordings"] == 0).await;
    println!("all recordings are on the server {:.1} s after the network was back", back.elapsed().as_secs_f64());
    assert_eq!(computer.spooled(), 0);

    let arrived = |list: &Value| list["items"].as_array().unwrap().iter().all(|one| one["status"] != "receiving");
    let sessions = box_1.setup.centre.until("/sessions", arrived).await;
    let waiting = box_1.setup.centre.until("/waiting-recordings", |_| true).await;
    let mut runs = Vec::new();
    for (list, at) in [(&sessions, "/sessions"), (&waiting, "/waiting-recordings")] {
        for one in list["items"].as_array().unwrap() {
            let video = box_1.video(&format!("{at}/{}/video", one["id"].as_str().unwrap())).await;
            runs.push(places(&video, &clip));
        }
    }
    assert_eq!(waiting["items"].as_array().unwrap().len(), 1);
    runs.sort_unstable();
    // A recording that the server ended after an hour continues as another one: they may share some seconds.
    let mut joined: Vec<[u64; 2]> = Vec::new();
    for run in runs.iter().copied() {
        match joined.last_mut() {
            Some(last) if runs.len() > captured.len() && run[0] <= last[1] + 1 => last[1] = last[1].max(run[1]),
            _ => joined.push(run),
        }
    }
    let frames: Vec<u64> = joined.iter().map(|[first, last]| last - first + 1).collect();
    for (what, took) in &box_1.changes {
        println!("{what}: after {:.1} s", took.as_secs_f64());
    }
    println!("away {minutes} min: captured {captured:?} frames, on the server {frames:?} in {} recordings", runs.len());
    assert!(minutes >= 59.0 || runs.len() == 3, "{runs:?}");
    assert_eq!(frames.len(), captured.len(), "{joined:?}");
    assert!(frames.iter().zip(&captured).all(|(arrived, captured)| arrived >= captured), "{frames:?} of {captured:?}");
}
