//! The number of boxes that this machine sustains, compared with plain decoding of the same frames in the same run, and
//! the latency from a frame to its position. `make live-load` prints both; no assertion depends on them.

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
use trocar::domain::feed::record::{FeedRecord, RecordBody};

use super::scene::{Clip, set_up_box};
use super::sender::{Received, hello, open_at, short_messages};
use crate::process::{CpuTimes, Process};
use crate::support::{ADMINISTRATOR, Client, let_time_pass};

/// Frames of a box in a second.
const FPS: u64 = 25;
/// Boxes in the first measurement of a frame's cost.
const PROBE: usize = 8;
/// Time after the start of a load that does not count: all boxes start at once, rehearse the start of their recordings
/// and catch up.
const START_TIME: Duration = Duration::from_secs(12);
/// The same with bare tools: all boxes are learned at once, for four seconds of a processor each.
const BARE_START_TIME: Duration = Duration::from_secs(60);
/// Time after a pause that does not count.
const RESUME_TIME: Duration = Duration::from_secs(1);
/// Duration of one measurement of several, and of a single measurement.
const MEASURE_TIME: Duration = Duration::from_secs(4);
const LONG_MEASURE_TIME: Duration = Duration::from_secs(20);
/// Rounds of plain decoding and boxes in alternation; the medians are printed. The speed of shared machines changes by
/// a sixth from one second to the next, so rounds are short and many.
const ROUNDS: usize = 15;
/// Share of the sustained boxes that the latency is measured at.
const SHARE: f64 = 0.8;

/// What all boxes of a load share.
struct Load {
    host: String,
    client: Client,
    /// The agent of each box.
    agents: Vec<Client>,
    clip: Arc<Clip>,
    /// The start of the present pause, if there is one, and the total of earlier pauses.
    pauses: Mutex<(Option<Instant>, Duration)>,
    is_measuring: AtomicBool,
    is_ending: AtomicBool,
    sent: AtomicU64,
    tracked: AtomicU64,
    latencies_ms: Mutex<Vec<f64>>,
}

impl Load {
    /// When to check again whether the frame that is due at `due`, without pauses, may be sent; `None`: it may be sent.
    fn waits_until(&self, due: Instant) -> Option<Instant> {
        let (pause, paused) = *self.pauses.lock().unwrap();
        let now = Instant::now();
        let until = if pause.is_some() { now + Duration::from_millis(10) } else { due + paused };
        (until > now).then_some(until)
    }
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "measures for minutes: make live-load"]
async fn boxes_that_this_machine_sustains() {
    println!("1080p at {FPS} frames a second, every frame tracked; sender, service and watchers on this machine");
    println!(
        "| tools | frames | Mbit/s a box | plain decoding, boxes | sustained, boxes | share | boxes at once | latency, ms: median, 99 % | 99 % in the worst round | all at once: tracked in time, 99 % |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let folder = tempfile::tempdir().unwrap();
    let h264 = ["4M", "8M"].map(|rate| {
        format!("-c:v libx264 -preset veryfast -tune zerolatency -b:v {rate} -maxrate {rate} -bufsize {rate} -g 50")
    });
    for (tools, name, coding) in [
        ("tape", "H.264", h264[0].as_str()),
        ("tape", "H.264", &h264[1]),
        ("tape", "JPEG", "-c:v mjpeg -pix_fmt yuvj420p -q:v 5"),
        ("bare", "H.264", &h264[0]),
    ] {
        if std::env::var_os("TROCAR_LOAD").is_some_and(|wanted| wanted != tools) {
            continue;
        }
        let Some(clip) = Clip::new(folder.path(), tools == "bare", coding) else { return };
        let clip = Arc::new(clip);
        let probed = measure_once(&clip, PROBE, MEASURE_TIME).await.boxes;
        let boxes = ((SHARE * probed) as usize).max(1);
        let [plain, sustained, share, usual, high, worst] = measure_alternating(&clip, boxes).await;
        let all = measure_once(&clip, sustained as usize, LONG_MEASURE_TIME).await;
        println!(
            "| {tools} | {name} | {:.1} | {plain:.1} | {sustained:.1} | {share:.0} % | {boxes} | {usual:.1}, {high:.1} | {worst:.1} | {}: {:.1} %, {:.0} |",
            clip.mbit_s(FPS),
            sustained as usize,
            all.in_time,
            all.latency_ms(0.99)
        );
    }
}

/// Alternates plain decoding and the service. Returns medians over the rounds: boxes that plain decoding and the
/// service sustain, their share, %, and each round's median latency and 99th percentile, ms; then the 99th percentile
/// of the worst round.
async fn measure_alternating(clip: &Arc<Clip>, boxes: usize) -> [f64; 6] {
    let running = Running::begin(clip, boxes).await;
    let_time_pass(start_time(clip)).await;
    let mut figures: [Vec<f64>; 5] = Default::default();
    for _ in 0..ROUNDS {
        running.pause().await;
        let plain = sustained(decoding_s_per_frame(clip, boxes).await);
        running.resume();
        let_time_pass(RESUME_TIME).await;
        let round = running.measure(MEASURE_TIME).await;
        let of_round = [plain, round.boxes, 100.0 * round.boxes / plain, round.latency_ms(0.5), round.latency_ms(0.99)];
        figures.iter_mut().zip(of_round).for_each(|(values, value)| values.push(value));
    }
    running.end().await;
    let worst = figures[4].iter().copied().fold(0.0, f64::max);
    let [plain, boxes, share, usual, high] = figures.map(median);
    [plain, boxes, share, usual, high, worst]
}

/// Measures a number of boxes at once, without alternation.
async fn measure_once(clip: &Arc<Clip>, boxes: usize, time: Duration) -> Measurement {
    let running = Running::begin(clip, boxes).await;
    let_time_pass(start_time(clip)).await;
    let measurement = running.measure(time).await;
    running.end().await;
    measurement
}

fn start_time(clip: &Clip) -> Duration {
    if clip.is_bare { BARE_START_TIME } else { START_TIME }
}

/// Boxes that all processors together can keep up with, if a frame takes one processor `frame_s` seconds.
fn sustained(frame_s: f64) -> f64 {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    processors as f64 / (FPS as f64 * frame_s)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// CPU seconds per frame of `decoders` single-threaded decoders, each at the rate of a box, without their start.
async fn decoding_s_per_frame(clip: &Clip, decoders: usize) -> f64 {
    let frames = MEASURE_TIME.as_secs() * FPS;
    let (all, start) = (decoding_s(clip, decoders, 1 + frames).await, decoding_s(clip, decoders, 1).await);
    (all - start) / (decoders as u64 * frames) as f64
}

/// CPU seconds that `decoders` decoders take for `frames` frames each.
async fn decoding_s(clip: &Clip, decoders: usize, frames: u64) -> f64 {
    let before = CpuTimes::of("self").unwrap().ended_children_s;
    let mut begun = Vec::new();
    for _ in 0..decoders {
        let mut command = Command::new("ffmpeg");
        command.args(["-v", "error", "-nostdin", "-re", "-threads", "1", "-i"]).arg(&clip.file);
        begun.push(command.args(["-frames:v", &frames.to_string(), "-f", "null", "-"]).spawn().unwrap());
        let_time_pass(Duration::from_secs(1) / (FPS as u32 * decoders as u32)).await; // they must not run in step
    }
    begun.into_iter().for_each(|mut decoder| assert!(decoder.wait().unwrap().success()));
    CpuTimes::of("self").unwrap().ended_children_s - before
}

/// The figures of a load over some time.
struct Measurement {
    /// Boxes that the machine sustains at this cost.
    boxes: f64,
    /// Frames that were tracked meanwhile, % of those sent.
    in_time: f64,
    /// Latency of each position after its frame, sorted.
    latencies_ms: Vec<f64>,
}

impl Measurement {
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
        let client = Client::of(base.clone()).signed_in(ADMINISTRATOR.0, process.password.as_deref().unwrap()).await;
        client.make("/api/v1/tasks", json!({"name": "Peg transfer", "code": "peg"})).await;
        client.make("/api/v1/trainees", json!({"name": "Ada", "code": "ada"})).await;
        let mut agents = Vec::with_capacity(boxes); // a person may only send four recordings at a time
        for number in 0..boxes {
            client
                .make("/api/v1/boxes", json!({"name": format!("Box {number}"), "code": format!("box-{number}")}))
                .await;
            set_up_box(&client, &format!("box-{number}"), &clip.scene).await;
            let token = json!({"name": "beside the box", "role": "agent", "box": format!("box-{number}")});
            let token = client.make("/api/v1/tokens", token).await;
            agents.push(Client::of(base.clone()).with_token(token["token"].as_str().unwrap()));
        }
        let load = Arc::new(Load {
            host: process.address.clone(),
            client,
            agents,
            clip: clip.clone(),
            pauses: Mutex::default(),
            is_measuring: AtomicBool::new(false),
            is_ending: AtomicBool::new(false),
            sent: AtomicU64::new(0),
            tracked: AtomicU64::new(0),
            latencies_ms: Mutex::default(),
        });
        let senders = (0..boxes).map(|number| tokio::spawn(send(load.clone(), number))).collect();
        Self { load, senders, process, _data: data }
    }

    /// Measures the load for this time.
    async fn measure(&self, time: Duration) -> Measurement {
        let now = || {
            let count = |of: &AtomicU64| of.load(Ordering::Acquire) as f64;
            (self.process.cpu_s(), count(&self.load.sent), count(&self.load.tracked))
        };
        self.load.latencies_ms.lock().unwrap().clear();
        self.load.is_measuring.store(true, Ordering::Release);
        let before = now();
        let_time_pass(time).await;
        let after = now();
        self.load.is_measuring.store(false, Ordering::Release);
        let mut latencies_ms = std::mem::take(&mut *self.load.latencies_ms.lock().unwrap());
        latencies_ms.sort_by(f64::total_cmp);
        let tracked = after.2 - before.2;
        Measurement {
            boxes: sustained((after.0 - before.0) / tracked),
            in_time: 100.0 * tracked / (after.1 - before.1),
            latencies_ms,
        }
    }

    /// Pauses the senders and waits until all sent frames are tracked.
    async fn pause(&self) {
        self.load.pauses.lock().unwrap().0 = Some(Instant::now());
        let mut before = u64::MAX;
        loop {
            let tracked = self.load.tracked.load(Ordering::Acquire);
            if tracked == before {
                return;
            }
            before = tracked;
            let_time_pass(Duration::from_millis(300)).await; // no frame must arrive in it
        }
    }

    /// Resumes the senders as if no time had passed.
    fn resume(&self) {
        let mut pauses = self.load.pauses.lock().unwrap();
        let paused = pauses.0.take().map_or(Duration::ZERO, |since| since.elapsed());
        pauses.1 += paused;
    }

    async fn end(self) {
        self.load.is_ending.store(true, Ordering::Release);
        for sender in self.senders {
            sender.await.unwrap();
        }
    }
}

async fn send(load: Arc<Load>, number: usize) {
    let mut sender = open_at(&load.host, load.agents[number].headers(), &format!("box-{number}")).await.unwrap();
    let mut message = hello(&format!("0198c1f2-6a10-7d3e-9f00-{number:012x}"));
    let codec = if load.clip.is_jpeg { "jpeg" } else { "h264" };
    (message["codec"], message["width"], message["height"]) = (json!(codec), json!(1920), json!(1080));
    sender.send_json(&message).await;
    let Received::Json(welcome) = sender.receive().await else { panic!("no welcome") };
    assert_eq!(welcome["type"], "welcome", "{welcome}");
    sender.epoch = welcome["epoch"].as_u64().unwrap() as u32;
    let sent: Arc<Mutex<Vec<Instant>>> = Arc::default();
    let watcher = tokio::spawn(watch(load.clone(), welcome["session"].as_str().unwrap().to_owned(), sent.clone()));
    let started = Instant::now();
    // Boxes do not start in step, so that their key frames do not coincide.
    let phase = Duration::from_millis(157 * number as u64 % 2000);
    for at in 0.. {
        if load.is_ending.load(Ordering::Acquire) {
            break;
        }
        let frame = &load.clip.frames[at % load.clip.frames.len()];
        let due = started + phase + Duration::from_secs(1) / FPS as u32 * at as u32;
        while let Some(until) = load.waits_until(due) {
            let_time_pass(until.saturating_duration_since(Instant::now())).await;
        }
        load.sent.fetch_add(1, Ordering::AcqRel);
        sent.lock().unwrap().push(Instant::now());
        let body = RecordBody::Frame { time: at as i64 * 3600, is_key: frame.is_key, payload: &frame.bytes };
        sender.send_record(FeedRecord { epoch: sender.epoch, number: at as u64, body }).await;
    }
    watcher.abort();
}

/// Counts the positions that arrive, and records their latency.
async fn watch(load: Arc<Load>, session: String, sent: Arc<Mutex<Vec<Instant>>>) {
    let address = format!("ws://{}/api/v1/sessions/{session}/live?pictures=false", load.host);
    let mut request = address.into_client_request().unwrap();
    request.headers_mut().extend(load.client.headers().clone());
    let (mut socket, _) = connect_async_with_config(request, Some(short_messages()), false).await.unwrap();
    while let Some(Ok(message)) = socket.next().await {
        let Message::Text(text) = message else { continue };
        let message: Value = serde_json::from_str(&text).unwrap();
        if message["type"] == "frame" {
            load.tracked.fetch_add(1, Ordering::AcqRel);
            if !load.is_measuring.load(Ordering::Acquire) {
                continue;
            }
            let frame = message["frame"].as_u64().unwrap() as usize;
            let took = sent.lock().unwrap()[frame].elapsed();
            load.latencies_ms.lock().unwrap().push(took.as_secs_f64() * 1e3);
        }
        assert_ne!(message["type"], "missed", "the watcher is slow, not the service");
    }
}
