//! Feeds through a proxy that imitates network faults, to a service that is killed: no acknowledged frame is missing or
//! doubled, and every missing frame was reported as a gap.
//!
//! Each recording meets ten faults. `TROCAR_FEEDS` is the number of recordings: six in an ordinary run, 500 by
//! `make feed-faults`.

use std::time::Duration;

use reqwest::header::{HeaderMap, HeaderValue};
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use trocar::domain::feed::numbers::FrameNumbers;
use uuid::Uuid;

use super::{Centre, Dice};
use crate::feed::numbers_in;
use crate::feed::sender::{Received, Sender, hello, open_at};
use crate::support::let_time_pass;

/// Faults that each recording meets.
const FAULTS: usize = 10;
/// How long a sender waits for acknowledgements between two faults.
const ACK_TIME: Duration = Duration::from_millis(130);

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_acknowledged_frame_is_lost_or_doubled_by_faults_on_the_way() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let mut centre = Centre::open_bare(folder, data, |_| ()).await;
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    let mut met = [0; FAULTS];
    for _ in 0..feeds() {
        let mut recording = Recording::new(&mut dice);
        for _ in 0..FAULTS {
            let fault = dice.below(FAULTS);
            met[fault] += 1;
            recording.meet_fault(&mut centre, &mut dice, fault).await;
        }
        recording.end(&mut centre, &mut dice).await;
    }
    eprintln!(
        "{} feeds met faults of each kind: {met:?}; ready again after {:?} at most",
        feeds(),
        centre.slowest_start
    );
}

fn feeds() -> usize {
    std::env::var_os("TROCAR_FEEDS").and_then(|n| n.to_str()?.parse().ok()).unwrap_or(6)
}

/// A recording as its sender knows it.
struct Recording {
    id: String,
    /// Frames captured so far.
    captured: u64,
    /// Frames that no longer exist anywhere: they are reported as gaps.
    lost: FrameNumbers,
    /// Frames that only the service can have.
    doubtful: Vec<u64>,
    /// Everything that was ever acknowledged.
    acknowledged: FrameNumbers,
    connection: Option<Connection>,
    /// Earlier connections that are not closed.
    abandoned: Vec<Connection>,
}

/// A connection, and the frames that were sent on it.
struct Connection {
    sender: Sender,
    proxy: watch::Sender<Mode>,
    sent: FrameNumbers,
}

impl Recording {
    fn new(dice: &mut Dice) -> Self {
        Self {
            id: Uuid::from_u64_pair(dice.next(), dice.next()).to_string(),
            captured: 0,
            lost: FrameNumbers::default(),
            doubtful: Vec::new(),
            acknowledged: FrameNumbers::default(),
            connection: None,
            abandoned: Vec::new(),
        }
    }

    /// Captures and sends some frames, and meets a fault.
    async fn meet_fault(&mut self, centre: &mut Centre, dice: &mut Dice, fault: usize) {
        self.captured += 2 + dice.below(8) as u64;
        self.send(centre, fault == 7).await;
        match fault {
            0 => self.abandon(Mode::Cut),
            1 => self.abandon(Mode::Hold), // half-open: neither end notices
            2 => {
                // Frames in transit arrive after a later connection has begun.
                self.abandon(Mode::Hold);
                self.captured += 3;
                if let Some(late) = self.abandoned.last_mut() {
                    late.sender.send_frames(self.captured - 3..self.captured).await;
                }
                self.send(centre, false).await;
                if let Some(late) = self.abandoned.last_mut() {
                    late.proxy.send_replace(Mode::Pass);
                }
            }
            3 => {
                let again = self.captured.saturating_sub(10)..self.captured;
                let kept: Vec<u64> = again.filter(|number| !self.lost.contains(*number)).collect();
                if let Some(connection) = &mut self.connection {
                    connection.sender.send_frames(kept).await;
                }
            }
            4 => {
                if let Some(connection) = &self.connection {
                    connection.proxy.send_replace(Mode::Hold);
                    let_time_pass(Duration::from_millis(20 + dice.below(180) as u64)).await;
                    connection.proxy.send_replace(Mode::Pass);
                }
            }
            5 => {
                let_time_pass(Duration::from_millis(dice.below(120) as u64)).await;
                centre.kill();
                centre.restart().await;
                self.connection = None;
            }
            6 => {
                // The sender is killed before its last frames are in its spool.
                self.connection = None;
                self.doubtful.extend(self.captured - 2..self.captured);
            }
            8 => {
                self.lost.add(self.captured, self.captured + 1).unwrap(); // the camera gave no frame
                self.captured += 2;
            }
            9 => self.abandon(Mode::CutAfter(dice.below(3000))), // in the middle of a record
            _ => {}
        }
        self.receive_acks(ACK_TIME).await;
    }

    /// Abandons the connection in this mode; the next send opens another one.
    fn abandon(&mut self, mode: Mode) {
        if let Some(connection) = self.connection.take() {
            connection.proxy.send_replace(mode);
            self.abandoned.push(connection);
        }
    }

    /// Sends the frames that were neither acknowledged nor sent on this connection: live frames first, then the rest.
    async fn send(&mut self, centre: &Centre, backwards: bool) {
        self.connect(centre).await;
        let Some(connection) = &mut self.connection else { return };
        let open = |number: &u64| !self.acknowledged.contains(*number) && !connection.sent.contains(*number);
        let mut due: Vec<u64> = (0..self.captured).filter(open).collect();
        let live = due.len().saturating_sub(4);
        due.rotate_left(live);
        if backwards {
            due.reverse();
        }
        for number in due {
            if self.lost.contains(number) {
                connection.sender.send_gap(number, number).await;
            } else {
                connection.sender.send_frames([number]).await;
            }
            connection.sent.add(number, number).unwrap();
        }
    }

    /// Connects if there is no connection; all acknowledged frames must still be there.
    async fn connect(&mut self, centre: &Centre) {
        while self.connection.is_none() {
            let (host, proxy) = proxy_to(centre.host()).await;
            let mut headers = HeaderMap::new();
            let token = HeaderValue::from_str(&format!("Bearer {}", centre.token())).unwrap();
            headers.insert("authorization", token);
            let mut sender = open_at(&host, &headers, "box-1").await.unwrap();
            let mut hello = hello(&self.id);
            hello["task"] = json!("pegs");
            sender.send_json(&hello).await;
            match sender.receive().await {
                Received::Json(welcome) if welcome["type"] == "welcome" => {
                    sender.epoch = u32::try_from(welcome["epoch"].as_u64().unwrap()).unwrap();
                    let durable = numbers(&welcome["durable"]);
                    let forgotten: Vec<&[u64; 2]> = self
                        .acknowledged
                        .ranges()
                        .iter()
                        .filter(|[first, last]| !(*first..=*last).all(|number| durable.contains(number)))
                        .collect();
                    assert!(forgotten.is_empty(), "{forgotten:?} were acknowledged, {durable:?} are there");
                    for number in self.doubtful.drain(..).filter(|number| !durable.contains(*number)) {
                        self.lost.add(number, number).unwrap();
                    }
                    self.acknowledged = durable;
                    self.connection = Some(Connection { sender, proxy, sent: FrameNumbers::default() });
                }
                // The recording before this one was left half-open: its box is busy until the service notices.
                Received::Closed(4409, _) => let_time_pass(Duration::from_millis(200)).await,
                other => panic!("{other:?} instead of a welcome"),
            }
        }
    }

    /// Receives acknowledgements for a while.
    async fn receive_acks(&mut self, long: Duration) {
        let Some(connection) = &mut self.connection else { return };
        let until = tokio::time::Instant::now() + long;
        while let Ok(message) = tokio::time::timeout_at(until, connection.sender.receive()).await {
            match message {
                Received::Json(message) if message["type"] == "ack" => self.acknowledged = numbers(&message["durable"]),
                Received::Json(message) => panic!("{message} without a request"),
                Received::Closed(..) | Received::Disconnected => {
                    self.connection = None;
                    return;
                }
            }
        }
    }

    /// Sends all remaining frames, ends the recording, and checks its session.
    async fn end(mut self, centre: &mut Centre, dice: &mut Dice) {
        let session = loop {
            self.send(centre, dice.below(2) == 0).await;
            let Some(connection) = &mut self.connection else { continue };
            connection.sender.send_json(&json!({"type": "end", "frames": self.captured})).await;
            match connection.sender.next_answer().await {
                Received::Json(message) if message["type"] == "ended" => {
                    break message["session"].as_str().unwrap().to_owned();
                }
                Received::Json(message) if message["type"] == "missing" => panic!("{message}: all of it was sent"),
                _ => self.connection = None,
            }
        };
        let video = centre.get(&format!("/sessions/{session}/video")).await;
        assert!(video.status().is_success());
        let shown = numbers_in(&video.bytes().await.unwrap());
        let kept: Vec<u64> = (0..self.captured).filter(|number| !self.lost.contains(*number)).collect();
        // Times begin with the first frame.
        let expected: Vec<u64> = kept.iter().map(|number| number - kept[0]).collect();
        assert_eq!(shown, expected, "each frame is there once, except the gaps");
        for connection in self.abandoned {
            connection.proxy.send_replace(Mode::Cut);
        }
    }
}

fn numbers(ranges: &Value) -> FrameNumbers {
    let mut numbers = FrameNumbers::default();
    for range in ranges.as_array().unwrap() {
        numbers.add(range[0].as_u64().unwrap(), range[1].as_u64().unwrap()).unwrap();
    }
    numbers
}

/// How the proxy treats bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    /// Passes them on.
    Pass,
    /// Holds them back until the mode changes.
    Hold,
    /// Passes this number of bytes, then ends both connections.
    CutAfter(usize),
    /// Ends both connections.
    Cut,
}

/// A proxy for one connection. Returns its address and the sender that sets its mode.
async fn proxy_to(service: String) -> (String, watch::Sender<Mode>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let host = listener.local_addr().unwrap().to_string();
    let (set_mode, mode) = watch::channel(Mode::Pass);
    tokio::spawn(async move {
        let (client, _) = listener.accept().await.unwrap();
        let Ok(service) = TcpStream::connect(service).await else { return };
        let ((from_client, to_client), (from_service, to_service)) = (client.into_split(), service.into_split());
        tokio::join!(pass(from_client, to_service, mode.clone()), pass(from_service, to_client, mode));
    });
    (host, set_mode)
}

async fn pass(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, mut modes: watch::Receiver<Mode>) {
    let mut buffer = vec![0; 16 << 10];
    let mut passed_before_cut = 0;
    loop {
        let read = tokio::select! {
            read = from.read(&mut buffer) => read.unwrap_or(0),
            ended = modes.wait_for(|mode| *mode == Mode::Cut) => { let _ = ended; 0 }
        };
        if read == 0 || modes.wait_for(|mode| *mode != Mode::Hold).await.is_err() {
            return;
        }
        let mode = *modes.borrow();
        let passed = match mode {
            Mode::CutAfter(limit) => read.min(limit.saturating_sub(passed_before_cut)),
            Mode::Cut => return,
            _ => read,
        };
        if to.write_all(&buffer[..passed]).await.is_err() || passed < read {
            return;
        }
        if matches!(mode, Mode::CutAfter(_)) {
            passed_before_cut += passed;
        }
    }
}
