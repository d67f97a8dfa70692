//! How many boxes this machine sustains, against bare decoding of the same frames in the same run, and how long a frame takes
//! to become a position. `make live-load` prints it; nothing here judges by time.

use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use futures_util::StreamExt;
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::task::JoinHandle;
use tokio_tungstenite::connect_async_with_config;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use trocar::domain::feed::record::{Body, Record};

use super::scene::{Clip, furnish};
use super::sender::{Heard, hello, open_at, short_words};
use crate::process::Process;
use crate::support::{ADMINISTRATOR, Client};

/// Frames of a box in a second.
const FPS: u64 = 25;
/// Boxes that send as fast as they may, to see what the machine can do.
const FLAT_OUT: usize = 6;
/// How long after its beginning a load does not count: until all boxes, which begin at once, have rehearsed their beginnings
/// and caught up; and how long once they have paused.
const BEGINS: Duration = Duration::from_secs(12);
const GOES_ON: Duration = Duration::from_secs(1);
/// How long it counts: flat out, and for latency.
const COUNTS: Duration = Duration::from_secs(4);
const COUNTS_LATENCY: Duration = Duration::from_secs(4);
/// How often bare decoding and boxes take their turns, and how often latencies are measured; the medians are told. Machines that others
/// use as well are quicker or slower by a sixth from one second to the next, so turns are short and many.
const ROUNDS: usize = 15;
/// Share of what can be sustained at which latency is measured.
const SHARE: f64 = 0.8;

/// What the boxes of a load share.
struct Load {
    host: String,
    client: Client,
    clip: Arc<Clip>,
    sends: AtomicBool,
    counts: AtomicBool,
    ends: AtomicBool,
    tracked: AtomicU64,
    latencies_ms: Mutex<Vec<f64>>,
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "measures for minutes: make live-load"]
async fn boxes_that_this_machine_sustains() {
    println!("1080p at {FPS} frames a second, every frame tracked; sender, service and watchers on this machine");
    println!(
        "| frames | Mbit/s a box | bare decoding, boxes | sustained, boxes | share | boxes at once | latency, ms: median, 99 % | 99 % in the worst turn |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let folder = tempfile::tempdir().unwrap();
    for (name, coding) in [
        ("H.264", "-c:v libx264 -preset veryfast -tune zerolatency -b:v 4M -maxrate 4M -bufsize 4M -g 50"),
        ("H.264", "-c:v libx264 -preset veryfast -tune zerolatency -b:v 8M -maxrate 8M -bufsize 8M -g 50"),
        ("JPEG", "-c:v mjpeg -pix_fmt yuvj420p -q:v 5"),
    ] {
        let Some(clip) = Clip::new(folder.path(), coding) else { return };
        let clip = Arc::new(clip);
        let [bare, sustained, share] = flat_out(&clip).await;
        let boxes = ((SHARE * sustained).floor() as usize).max(1);
        let [usual, most, worst] = latencies_ms(&clip, boxes).await;
        println!(
            "| {name} | {:.1} | {bare:.1} | {sustained:.1} | {share:.0} % | {boxes} | {usual:.1}, {most:.1} | {worst:.1} |",
            clip.mbit_s(FPS)
        );
    }
}

/// Boxes that bare decoding and the service sustain by turns, and the share, %: medians.
async fn flat_out(clip: &Arc<Clip>) -> [f64; 3] {
    let running = Running::begin(clip, FLAT_OUT, None).await;
    tokio::time::sleep(BEGINS).await;
    let (mut bare, mut sustained, mut shares) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        running.pause().await;
        bare.push(bare_fps(clip) / FPS as f64);
        running.load.sends.store(true, Ordering::Release);
        tokio::time::sleep(GOES_ON).await;
        let before = running.load.tracked.load(Ordering::Acquire);
        let began = Instant::now();
        tokio::time::sleep(COUNTS).await;
        let tracked = (running.load.tracked.load(Ordering::Acquire) - before) as f64;
        sustained.push(tracked / began.elapsed().as_secs_f64() / FPS as f64);
        shares.push(100.0 * sustained[sustained.len() - 1] / bare[bare.len() - 1]);
    }
    running.end().await;
    [bare, sustained, shares].map(median)
}

/// How long after its frame each position is told, ms, with so many boxes at once: the median and the 99th percentile, medians of all
/// turns, and the latter in the worst turn.
async fn latencies_ms(clip: &Arc<Clip>, boxes: usize) -> [f64; 3] {
    let running = Running::begin(clip, boxes, Some(FPS)).await;
    tokio::time::sleep(BEGINS).await;
    let (mut usual, mut most) = (Vec::new(), Vec::new());
    running.load.counts.store(true, Ordering::Release);
    for _ in 0..ROUNDS {
        tokio::time::sleep(COUNTS_LATENCY).await;
        let mut of_turn = std::mem::take(&mut *running.load.latencies_ms.lock().unwrap());
        of_turn.sort_by(f64::total_cmp);
        let at = |share: f64| of_turn[((of_turn.len() - 1) as f64 * share) as usize];
        usual.push(at(0.5));
        most.push(at(0.99));
    }
    running.end().await;
    let worst = most.iter().copied().fold(0.0, f64::max);
    [median(usual), median(most), worst]
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Frames that decoders of one thread each decode in a second, as many at a time as boxes send; what their start takes is left out.
fn bare_fps(clip: &Clip) -> f64 {
    let took = |frames: usize| {
        let started = Instant::now();
        let decode = || {
            let mut command = Command::new("ffmpeg");
            command.args(["-v", "error", "-nostdin", "-threads", "1", "-i"]).arg(&clip.file);
            command.args(["-frames:v", &frames.to_string(), "-f", "null", "-"]).spawn().unwrap()
        };
        let decoders: Vec<_> = (0..FLAT_OUT).map(|_| decode()).collect();
        decoders.into_iter().for_each(|mut decoder| assert!(decoder.wait().unwrap().success()));
        started.elapsed().as_secs_f64()
    };
    let (start, all) = (took(1), took(clip.frames.len()));
    (FLAT_OUT * (clip.frames.len() - 1)) as f64 / (all - start)
}

/// A service with boxes that send.
struct Running {
    load: Arc<Load>,
    senders: Vec<JoinHandle<()>>,
    _process: Process,
    _data: TempDir,
}

impl Running {
    /// So many boxes, at this rate or as fast as they may.
    async fn begin(clip: &Arc<Clip>, boxes: usize, fps: Option<u64>) -> Self {
        let data = TempDir::new().unwrap();
        let process = Process::start(&data.path().join("data"));
        let base = format!("http://{}", process.address);
        let client = Client::of(base).signed_in(ADMINISTRATOR.0, process.password.as_deref().unwrap()).await;
        client.make("/api/v1/tasks", json!({"name": "Peg transfer", "code": "peg"})).await;
        client.make("/api/v1/trainees", json!({"name": "Ada", "code": "ada"})).await;
        for number in 0..boxes {
            client
                .make("/api/v1/boxes", json!({"name": format!("Box {number}"), "code": format!("box-{number}")}))
                .await;
            furnish(&client, &format!("box-{number}"), &clip.scene).await;
        }
        let load = Arc::new(Load {
            host: process.address.clone(),
            client,
            clip: clip.clone(),
            sends: AtomicBool::new(true),
            counts: AtomicBool::new(false),
            ends: AtomicBool::new(false),
            tracked: AtomicU64::new(0),
            latencies_ms: Mutex::default(),
        });
        let senders = (0..boxes).map(|number| tokio::spawn(send(load.clone(), number, fps))).collect();
        Self { load, senders, _process: process, _data: data }
    }

    /// Holds the senders, until all that is under way is tracked.
    async fn pause(&self) {
        self.load.sends.store(false, Ordering::Release);
        let mut before = u64::MAX;
        loop {
            let tracked = self.load.tracked.load(Ordering::Acquire);
            if tracked == before {
                return;
            }
            before = tracked;
            tokio::time::sleep(Duration::from_millis(300)).await;
        }
    }

    async fn end(self) {
        self.load.ends.store(true, Ordering::Release);
        for sender in self.senders {
            sender.await.unwrap();
        }
    }
}

async fn send(load: Arc<Load>, number: usize, fps: Option<u64>) {
    let mut sender = open_at(&load.host, load.client.headers(), &format!("box-{number}")).await.unwrap();
    let mut word = hello(&format!("0198c1f2-6a10-7d3e-9f00-{number:012x}"));
    let codec = if load.clip.is_jpeg { "jpeg" } else { "h264" };
    (word["codec"], word["width"], word["height"]) = (json!(codec), json!(1920), json!(1080));
    sender.say(&word).await;
    let Heard::Word(welcome) = sender.hear().await else { panic!("no welcome") };
    assert_eq!(welcome["type"], "welcome", "{welcome}");
    sender.epoch = welcome["epoch"].as_u64().unwrap() as u32;
    let sent: Arc<Mutex<Vec<Instant>>> = Arc::default();
    let watcher = tokio::spawn(watch(load.clone(), welcome["session"].as_str().unwrap().to_owned(), sent.clone()));
    let started = Instant::now();
    // Boxes do not begin in step, and so their key frames do not come together.
    let phase = Duration::from_millis(157 * number as u64 % 2000);
    for at in 0.. {
        if load.ends.load(Ordering::Acquire) {
            break;
        }
        while !load.sends.load(Ordering::Acquire) {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        let frame = &load.clip.frames[at % load.clip.frames.len()];
        if let Some(fps) = fps {
            let due = started + phase + Duration::from_nanos(1_000_000_000 / fps * at as u64);
            tokio::time::sleep_until(due.into()).await;
        }
        sent.lock().unwrap().push(Instant::now());
        let body = Body::Frame { time: at as i64 * 3600, is_key: frame.is_key, payload: &frame.bytes };
        sender.record(Record { epoch: sender.epoch, number: at as u64, body }).await;
    }
    watcher.abort();
}

/// Counts the positions that are told, and how long after their frames.
async fn watch(load: Arc<Load>, session: String, sent: Arc<Mutex<Vec<Instant>>>) {
    let address = format!("ws://{}/api/v1/sessions/{session}/live?pictures=false", load.host);
    let mut request = address.into_client_request().unwrap();
    request.headers_mut().extend(load.client.headers().clone());
    let (mut socket, _) = connect_async_with_config(request, Some(short_words()), false).await.unwrap();
    while let Some(Ok(message)) = socket.next().await {
        let Message::Text(text) = message else { continue };
        let word: Value = serde_json::from_str(&text).unwrap();
        if word["type"] == "frame" {
            load.tracked.fetch_add(1, Ordering::AcqRel);
            if !load.counts.load(Ordering::Acquire) {
                continue;
            }
            let frame = word["frame"].as_u64().unwrap() as usize;
            let took = sent.lock().unwrap()[frame].elapsed();
            load.latencies_ms.lock().unwrap().push(took.as_secs_f64() * 1e3);
        }
        assert_ne!(word["type"], "missed", "the watcher is slow, not the service");
    }
}
