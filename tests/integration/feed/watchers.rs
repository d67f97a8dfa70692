//! What each further watcher of one live box costs: processor time, memory, missed messages, and whether all frames of the
//! recording are on the disk afterwards. `make live-load` prints it; no assertion depends on the costs.

use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use futures_util::StreamExt;
use serde_json::{Value, json};
use tokio::task::JoinHandle;
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use trocar::domain::feed::record::{FeedRecord, RecordBody};

use super::scene::{Clip, set_up_box};
use super::sender::{Received, Sender, hello, open_at};
use crate::process::{CpuTimes, Process};
use crate::support::{ADMINISTRATOR, Client, let_time_pass};

const FPS: u64 = 25;
/// Numbers of watchers, each measured once in each round.
const WATCHERS: [usize; 3] = [1, 10, 30];
/// Rounds; the medians are printed, because the speed of shared machines changes.
const ROUNDS: usize = 5;
/// Time after the start, and after watchers have joined, that does not count.
const START_TIME: Duration = Duration::from_secs(12);
const JOIN_TIME: Duration = Duration::from_secs(2);
const MEASURE_TIME: Duration = Duration::from_secs(8);

/// What the watchers received.
#[derive(Default)]
struct WatchedCounts {
    positions: AtomicU64,
    pictures: AtomicU64,
    missed: AtomicU64,
}

/// The figures of one number of watchers.
#[derive(Clone, Copy)]
struct Cost {
    /// Processor time of the service, and of its children, ms in a second.
    service_ms: f64,
    children_ms: f64,
    /// Memory of the service, MiB.
    memory_mib: f64,
    /// Positions and pictures that each watcher received in a second.
    positions: f64,
    pictures: f64,
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "measures for minutes: make live-load"]
async fn watchers_of_one_box_that_this_machine_sustains() {
    if std::env::var_os("TROCAR_LOAD").is_some_and(|wanted| wanted != "watchers") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let coding = "-c:v libx264 -preset veryfast -tune zerolatency -b:v 4M -maxrate 4M -bufsize 4M -g 50";
    let Some(clip) = Clip::new(folder.path(), false, coding) else { return };
    let data = folder.path().join("data");
    let process = Process::start(&data);
    let client = Client::of(format!("http://{}", process.address));
    let client = client.signed_in(ADMINISTRATOR.0, process.password.as_deref().unwrap()).await;
    client.make("/api/v1/tasks", json!({"name": "Peg transfer", "code": "peg"})).await;
    client.make("/api/v1/trainees", json!({"name": "Ada", "code": "ada"})).await;
    client.make("/api/v1/boxes", json!({"name": "Box 1", "code": "box-1"})).await;
    set_up_box(&client, "box-1", &clip.scene).await;
    let mut sender = open_at(&process.address, client.headers(), "box-1").await.unwrap();
    let mut message = hello("0198c1f2-6a10-7d3e-9f00-000000000001");
    (message["codec"], message["width"], message["height"]) = (json!("h264"), json!(1920), json!(1080));
    sender.send_json(&message).await;
    let Received::Json(welcome) = sender.receive().await else { panic!("no welcome") };
    sender.epoch = welcome["epoch"].as_u64().unwrap() as u32;
    let session = welcome["session"].as_str().unwrap().to_owned();
    let (sent, is_ending) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let sending = tokio::spawn(send(sender, clip, sent.clone(), is_ending.clone()));
    let_time_pass(START_TIME).await;
    let mut costs: [Vec<Cost>; 3] = Default::default();
    let mut missed = 0;
    for _ in 0..ROUNDS {
        for (watchers, costs) in WATCHERS.into_iter().zip(&mut costs) {
            let (cost, lost) = measure(&process, &client, &session, watchers).await;
            costs.push(cost);
            missed += lost;
        }
    }
    is_ending.store(1, Ordering::Release);
    let mut sender = sending.await.unwrap();
    let frames = sent.load(Ordering::Acquire);
    assert_eq!(sender.end(frames).await, session);
    println!("one box, 1080p H.264 of 4 Mbit/s at {FPS} frames a second; all watchers receive pictures");
    println!(
        "| watchers | service, ms of a processor in a second | its children | memory of the service, MiB | positions, pictures in a second for each |"
    );
    println!("|---|---|---|---|---|");
    rows(&costs).iter().for_each(|row| println!("{row}"));
    let stored = frames_of_recording(&client, &session, folder.path()).await;
    println!("\n{frames} frames were sent, {stored} are in the stored recording; watchers missed {missed} messages");
    assert_eq!(stored, frames, "watchers must not cost frames of the recording");
}

/// Sends frames in real time until `is_ending`; returns the sender.
async fn send(mut sender: Sender, clip: Clip, sent: Arc<AtomicU64>, is_ending: Arc<AtomicU64>) -> Sender {
    let started = Instant::now();
    for at in 0_u64.. {
        if is_ending.load(Ordering::Acquire) > 0 {
            break;
        }
        let due = started + Duration::from_secs(1) / FPS as u32 * at as u32;
        let_time_pass(due.saturating_duration_since(Instant::now())).await;
        let frame = &clip.frames[at as usize % clip.frames.len()];
        let body = RecordBody::Frame { time: at as i64 * 3600, is_key: frame.is_key, payload: &frame.bytes };
        sender.send_record(FeedRecord { epoch: sender.epoch, number: at, body }).await;
        sent.fetch_add(1, Ordering::AcqRel);
    }
    sender
}

/// Measures this many watchers of the session, who all receive pictures; also the number of messages that they missed.
async fn measure(process: &Process, client: &Client, session: &str, watchers: usize) -> (Cost, u64) {
    let received = Arc::new(WatchedCounts::default());
    let watch = |_| tokio::spawn(watch(process.address.clone(), client.clone(), session.to_owned(), received.clone()));
    let watching: Vec<JoinHandle<()>> = (0..watchers).map(watch).collect();
    let_time_pass(JOIN_TIME).await;
    let now = || {
        let service_s = CpuTimes::of(&process.id().to_string()).unwrap().own_s();
        let count = |of: &AtomicU64| of.load(Ordering::Acquire) as f64 / watchers as f64;
        (service_s, process.cpu_s() - service_s, count(&received.positions), count(&received.pictures), Instant::now())
    };
    let before = now();
    let_time_pass(MEASURE_TIME).await;
    let after = now();
    let memory_mib = process.status("VmRSS").parse::<f64>().unwrap() / 1024.0;
    watching.into_iter().for_each(|watcher| watcher.abort());
    let took_s = (after.4 - before.4).as_secs_f64();
    let cost = Cost {
        service_ms: 1e3 * (after.0 - before.0) / took_s,
        children_ms: 1e3 * (after.1 - before.1) / took_s,
        memory_mib,
        positions: (after.2 - before.2) / took_s,
        pictures: (after.3 - before.3) / took_s,
    };
    (cost, received.missed.load(Ordering::Acquire))
}

async fn watch(host: String, client: Client, session: String, received: Arc<WatchedCounts>) {
    let mut request = format!("ws://{host}/api/v1/sessions/{session}/live").into_client_request().unwrap();
    request.headers_mut().extend(client.headers().clone());
    let (mut socket, _) = connect_async(request).await.unwrap();
    while let Some(Ok(message)) = socket.next().await {
        match message {
            Message::Binary(_) => _ = received.pictures.fetch_add(1, Ordering::AcqRel),
            // Not parsed: the cost of the watchers must not be taken for that of the service.
            Message::Text(text) if text.contains(r#""type":"frame""#) => {
                received.positions.fetch_add(1, Ordering::AcqRel);
            }
            Message::Text(text) if text.contains(r#""type":"missed""#) => {
                let missed: Value = serde_json::from_str(&text).unwrap();
                received.missed.fetch_add(missed["count"].as_u64().unwrap(), Ordering::AcqRel);
            }
            _ => {}
        }
    }
}

/// The medians of each number of watchers, as rows of a table.
fn rows(costs: &[Vec<Cost>; 3]) -> Vec<String> {
    let median = |costs: &[Cost], of: fn(&Cost) -> f64| {
        let mut values: Vec<f64> = costs.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let row = |(watchers, costs): (usize, &Vec<Cost>)| {
        format!(
            "| {watchers} | {:.0} | {:.0} | {:.0} | {:.1}, {:.1} |",
            median(costs, |cost| cost.service_ms),
            median(costs, |cost| cost.children_ms),
            median(costs, |cost| cost.memory_mib),
            median(costs, |cost| cost.positions),
            median(costs, |cost| cost.pictures)
        )
    };
    WATCHERS.into_iter().zip(costs).map(row).collect()
}

/// Number of frames in the stored recording.
async fn frames_of_recording(client: &Client, session: &str, folder: &std::path::Path) -> u64 {
    let video = client.get(&format!("/api/v1/sessions/{session}/video")).await;
    assert!(video.status().is_success(), "{}", video.status());
    let file = folder.join("stored.mkv");
    std::fs::write(&file, video.bytes().await.unwrap()).unwrap();
    let entries = ["-v", "error", "-count_packets", "-select_streams", "v:0", "-show_entries"];
    let mut probe = Command::new("ffprobe");
    probe.args(entries).args(["stream=nb_read_packets", "-of", "csv=p=0"]).arg(&file);
    let counted = probe.output().unwrap();
    String::from_utf8_lossy(&counted.stdout).trim().trim_end_matches(',').parse().unwrap()
}
