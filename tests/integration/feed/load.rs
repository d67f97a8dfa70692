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
use crate::process::{Process, Processors};
use crate::support::{ADMINISTRATOR, Client};

/// Frames of a box in a second.
const FPS: u64 = 25;
/// Boxes of the first look at what a frame costs.
const PROBE: usize = 8;
/// How long after its beginning a load does not count: until all boxes, which begin at once, have rehearsed their beginnings
/// and caught up; and how long once they have paused.
const BEGINS: Duration = Duration::from_secs(12);
const GOES_ON: Duration = Duration::from_secs(1);
/// How long it counts at a time, and how long where it is looked at once.
const COUNTS: Duration = Duration::from_secs(4);
const COUNTS_LONG: Duration = Duration::from_secs(20);
/// How often bare decoding and boxes take their turns; the medians are told. Machines that others use as well are quicker or
/// slower by a sixth from one second to the next, so turns are short and many.
const ROUNDS: usize = 15;
/// Share of what can be sustained at which latency is measured.
const SHARE: f64 = 0.8;

/// What the boxes of a load share.
struct Load {
    host: String,
    client: Client,
    clip: Arc<Clip>,
    /// Since when they hold, while they do, and how long they have held before.
    holds: Mutex<(Option<Instant>, Duration)>,
    counts: AtomicBool,
    ends: AtomicBool,
    sent: AtomicU64,
    tracked: AtomicU64,
    latencies_ms: Mutex<Vec<f64>>,
}

impl Load {
    /// When to look again whether a frame that would be due then, had nobody held, may be sent; `None` now.
    fn waits_until(&self, due: Instant) -> Option<Instant> {
        let (holds, held) = *self.holds.lock().unwrap();
        let now = Instant::now();
        let until = if holds.is_some() { now + Duration::from_millis(10) } else { due + held };
        (until > now).then_some(until)
    }
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "measures for minutes: make live-load"]
async fn boxes_that_this_machine_sustains() {
    println!("1080p at {FPS} frames a second, every frame tracked; sender, service and watchers on this machine");
    println!(
        "| frames | Mbit/s a box | bare decoding, boxes | sustained, boxes | share | boxes at once | latency, ms: median, 99 % | 99 % in the worst turn | all at once: tracked in time, 99 % |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let folder = tempfile::tempdir().unwrap();
    for (name, coding) in [
        ("H.264", "-c:v libx264 -preset veryfast -tune zerolatency -b:v 4M -maxrate 4M -bufsize 4M -g 50"),
        ("H.264", "-c:v libx264 -preset veryfast -tune zerolatency -b:v 8M -maxrate 8M -bufsize 8M -g 50"),
        ("JPEG", "-c:v mjpeg -pix_fmt yuvj420p -q:v 5"),
    ] {
        let Some(clip) = Clip::new(folder.path(), coding) else { return };
        let clip = Arc::new(clip);
        let probed = at_once(&clip, PROBE, COUNTS).await.boxes;
        let boxes = ((SHARE * probed) as usize).max(1);
        let [bare, sustained, share, usual, most, worst] = by_turns(&clip, boxes).await;
        let all = at_once(&clip, sustained as usize, COUNTS_LONG).await;
        println!(
            "| {name} | {:.1} | {bare:.1} | {sustained:.1} | {share:.0} % | {boxes} | {usual:.1}, {most:.1} | {worst:.1} | {}: {:.1} %, {:.0} |",
            clip.mbit_s(FPS),
            sustained as usize,
            all.in_time,
            all.latency_ms(0.99)
        );
    }
}

/// Medians of what bare decoding and the service sustain by turns, boxes, of the share, %, and of each turn's median latency
/// and its 99th percentile, ms; then the latter in the worst turn.
async fn by_turns(clip: &Arc<Clip>, boxes: usize) -> [f64; 6] {
    let running = Running::begin(clip, boxes).await;
    tokio::time::sleep(BEGINS).await;
    let mut figures: [Vec<f64>; 5] = Default::default();
    for _ in 0..ROUNDS {
        running.hold().await;
        let bare = sustained(bare_s(clip, boxes).await);
        running.go_on();
        tokio::time::sleep(GOES_ON).await;
        let turn = running.turn(COUNTS).await;
        let of_turn = [bare, turn.boxes, 100.0 * turn.boxes / bare, turn.latency_ms(0.5), turn.latency_ms(0.99)];
        figures.iter_mut().zip(of_turn).for_each(|(values, value)| values.push(value));
    }
    running.end().await;
    let worst = figures[4].iter().copied().fold(0.0, f64::max);
    let [bare, boxes, share, usual, most] = figures.map(median);
    [bare, boxes, share, usual, most, worst]
}

/// What so many boxes at once are like, once.
async fn at_once(clip: &Arc<Clip>, boxes: usize, counts: Duration) -> Turn {
    let running = Running::begin(clip, boxes).await;
    tokio::time::sleep(BEGINS).await;
    let turn = running.turn(counts).await;
    running.end().await;
    turn
}

/// Boxes of which all processors together are in time, where a frame takes one of them so many seconds.
fn sustained(frame_s: f64) -> f64 {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    processors as f64 / (FPS as f64 * frame_s)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Seconds of a processor that a frame takes decoders of one thread each, as many as boxes, each at a box's rate; what their start
/// takes is left out.
async fn bare_s(clip: &Clip, decoders: usize) -> f64 {
    let frames = COUNTS.as_secs() * FPS;
    let (all, start) = (decoding_s(clip, decoders, 1 + frames).await, decoding_s(clip, decoders, 1).await);
    (all - start) / (decoders as u64 * frames) as f64
}

/// Seconds of the processors that so many decoders take for so many frames each.
async fn decoding_s(clip: &Clip, decoders: usize, frames: u64) -> f64 {
    let before = Processors::of("self").unwrap().of_ended_s;
    let mut begun = Vec::new();
    for _ in 0..decoders {
        let mut command = Command::new("ffmpeg");
        command.args(["-v", "error", "-nostdin", "-re", "-threads", "1", "-i"]).arg(&clip.file);
        begun.push(command.args(["-frames:v", &frames.to_string(), "-f", "null", "-"]).spawn().unwrap());
        tokio::time::sleep(Duration::from_secs(1) / (FPS as u32 * decoders as u32)).await; // not in step
    }
    begun.into_iter().for_each(|mut decoder| assert!(decoder.wait().unwrap().success()));
    Processors::of("self").unwrap().of_ended_s - before
}

/// What a load was like for a while.
struct Turn {
    /// What is sustained at this cost.
    boxes: f64,
    /// Of the frames that were sent meanwhile, how many were tracked, %.
    in_time: f64,
    /// How long after its frame each position was told, in order.
    latencies_ms: Vec<f64>,
}

impl Turn {
    fn latency_ms(&self, share: f64) -> f64 {
        self.latencies_ms[((self.latencies_ms.len() - 1) as f64 * share) as usize]
    }
}

/// A service with boxes that send.
struct Running {
    load: Arc<Load>,
    senders: Vec<JoinHandle<()>>,
    process: Process,
    _data: TempDir,
}

impl Running {
    async fn begin(clip: &Arc<Clip>, boxes: usize) -> Self {
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
            holds: Mutex::default(),
            counts: AtomicBool::new(false),
            ends: AtomicBool::new(false),
            sent: AtomicU64::new(0),
            tracked: AtomicU64::new(0),
            latencies_ms: Mutex::default(),
        });
        let senders = (0..boxes).map(|number| tokio::spawn(send(load.clone(), number))).collect();
        Self { load, senders, process, _data: data }
    }

    /// What it is like for so long.
    async fn turn(&self, counts: Duration) -> Turn {
        let now = || {
            let count = |of: &AtomicU64| of.load(Ordering::Acquire) as f64;
            (self.process.processors_s(), count(&self.load.sent), count(&self.load.tracked))
        };
        self.load.latencies_ms.lock().unwrap().clear();
        self.load.counts.store(true, Ordering::Release);
        let before = now();
        tokio::time::sleep(counts).await;
        let after = now();
        self.load.counts.store(false, Ordering::Release);
        let mut latencies_ms = std::mem::take(&mut *self.load.latencies_ms.lock().unwrap());
        latencies_ms.sort_by(f64::total_cmp);
        let tracked = after.2 - before.2;
        Turn {
            boxes: sustained((after.0 - before.0) / tracked),
            in_time: 100.0 * tracked / (after.1 - before.1),
            latencies_ms,
        }
    }

    /// Holds the senders, until all that is under way is tracked.
    async fn hold(&self) {
        self.load.holds.lock().unwrap().0 = Some(Instant::now());
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

    /// Lets them go on, as if no time had passed.
    fn go_on(&self) {
        let mut holds = self.load.holds.lock().unwrap();
        let held = holds.0.take().map_or(Duration::ZERO, |since| since.elapsed());
        holds.1 += held;
    }

    async fn end(self) {
        self.load.ends.store(true, Ordering::Release);
        for sender in self.senders {
            sender.await.unwrap();
        }
    }
}

async fn send(load: Arc<Load>, number: usize) {
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
        let frame = &load.clip.frames[at % load.clip.frames.len()];
        let due = started + phase + Duration::from_secs(1) / FPS as u32 * at as u32;
        while let Some(until) = load.waits_until(due) {
            tokio::time::sleep_until(until.into()).await;
        }
        load.sent.fetch_add(1, Ordering::AcqRel);
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
