//! Feeds through a proxy that does what networks do, to a service that is killed: no acknowledged frame is missing or
//! doubled, and every hole is a gap that somebody spoke of.
//!
//! Each recording meets ten faults. `TROCAR_FEEDS` says how many recordings there are: some in every run, 500 by
//! `make feed-faults`.

use std::time::Duration;

use reqwest::header::{HeaderMap, HeaderValue};
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use trocar::domain::feed::numbers::Numbers;
use uuid::Uuid;

use super::{Centre, Dice};
use crate::feed::numbers_in;
use crate::feed::sender::{Heard, Sender, hello, open_at};

/// Faults that each recording meets.
const FAULTS: usize = 10;
/// How long a sender listens for acknowledgements between two faults.
const LISTEN: Duration = Duration::from_millis(130);

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_acknowledged_frame_is_lost_or_doubled_whatever_happens_on_the_way() {
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
            recording.go_on(&mut centre, &mut dice, fault).await;
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
    /// Those that nobody has any more, by whatever reason: told as gaps.
    lost: Numbers,
    /// Those that only the service can have.
    doubtful: Vec<u64>,
    /// Everything that was ever acknowledged.
    acknowledged: Numbers,
    line: Option<Line>,
    /// Lines that nobody has closed.
    old: Vec<Line>,
}

/// A connection, and what has been sent on it.
struct Line {
    sender: Sender,
    proxy: watch::Sender<Mode>,
    sent: Numbers,
}

impl Recording {
    fn new(dice: &mut Dice) -> Self {
        Self {
            id: Uuid::from_u64_pair(dice.next(), dice.next()).to_string(),
            captured: 0,
            lost: Numbers::default(),
            doubtful: Vec::new(),
            acknowledged: Numbers::default(),
            line: None,
            old: Vec::new(),
        }
    }

    /// Captures and sends some frames, and meets a fault.
    async fn go_on(&mut self, centre: &mut Centre, dice: &mut Dice, fault: usize) {
        self.captured += 2 + dice.below(8) as u64;
        self.send(centre, fault == 7).await;
        match fault {
            0 => self.leave(Mode::Cut),
            1 => self.leave(Mode::Hold), // half-open: neither end knows
            2 => {
                // What lies on the way arrives after a later connection has begun.
                self.leave(Mode::Hold);
                self.captured += 3;
                if let Some(late) = self.old.last_mut() {
                    late.sender.frames(self.captured - 3..self.captured).await;
                }
                self.send(centre, false).await;
                if let Some(late) = self.old.last_mut() {
                    late.proxy.send_replace(Mode::Pass);
                }
            }
            3 => {
                let again = self.captured.saturating_sub(10)..self.captured;
                let kept: Vec<u64> = again.filter(|number| !self.lost.contains(*number)).collect();
                if let Some(line) = &mut self.line {
                    line.sender.frames(kept).await;
                }
            }
            4 => {
                if let Some(line) = &self.line {
                    line.proxy.send_replace(Mode::Hold);
                    tokio::time::sleep(Duration::from_millis(20 + dice.below(180) as u64)).await;
                    line.proxy.send_replace(Mode::Pass);
                }
            }
            5 => {
                tokio::time::sleep(Duration::from_millis(dice.below(120) as u64)).await;
                centre.kill();
                centre.restart().await;
                self.line = None;
            }
            6 => {
                // The sender is killed before its last frames were in its spool, and forgets what it was told.
                self.line = None;
                self.doubtful.extend(self.captured - 2..self.captured);
            }
            8 => {
                self.lost.add(self.captured, self.captured + 1).unwrap(); // the camera gave none
                self.captured += 2;
            }
            9 => self.leave(Mode::CutAfter(dice.below(3000))), // in the middle of a record
            _ => {}
        }
        self.listen(LISTEN).await;
    }

    /// Turns to another connection; this one is left as it is.
    fn leave(&mut self, mode: Mode) {
        if let Some(line) = self.line.take() {
            line.proxy.send_replace(mode);
            self.old.push(line);
        }
    }

    /// Sends what was not acknowledged and not sent on this line: live first, the rest behind.
    async fn send(&mut self, centre: &Centre, backwards: bool) {
        self.connect(centre).await;
        let Some(line) = &mut self.line else { return };
        let open = |number: &u64| !self.acknowledged.contains(*number) && !line.sent.contains(*number);
        let mut due: Vec<u64> = (0..self.captured).filter(open).collect();
        let live = due.len().saturating_sub(4);
        due.rotate_left(live);
        if backwards {
            due.reverse();
        }
        for number in due {
            if self.lost.contains(number) {
                line.sender.gap(number, number).await;
            } else {
                line.sender.frames([number]).await;
            }
            line.sent.add(number, number).unwrap();
        }
    }

    /// Connects, if there is no connection; what was acknowledged must still be there.
    async fn connect(&mut self, centre: &Centre) {
        while self.line.is_none() {
            let (host, proxy) = proxy_to(centre.host()).await;
            let mut headers = HeaderMap::new();
            let token = HeaderValue::from_str(&format!("Bearer {}", centre.token())).unwrap();
            headers.insert("authorization", token);
            let mut sender = open_at(&host, &headers, "box-1").await.unwrap();
            let mut hello = hello(&self.id);
            hello["task"] = json!("pegs");
            sender.say(&hello).await;
            match sender.hear().await {
                Heard::Word(welcome) if welcome["type"] == "welcome" => {
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
                    self.line = Some(Line { sender, proxy, sent: Numbers::default() });
                }
                // The recording before this one was left half-open: its box is busy until that is found out.
                Heard::Closed(4409, _) => tokio::time::sleep(Duration::from_millis(200)).await,
                other => panic!("{other:?} instead of a welcome"),
            }
        }
    }

    /// Hears acknowledgements for a while.
    async fn listen(&mut self, long: Duration) {
        let Some(line) = &mut self.line else { return };
        let until = tokio::time::Instant::now() + long;
        while let Ok(heard) = tokio::time::timeout_at(until, line.sender.hear()).await {
            match heard {
                Heard::Word(word) if word["type"] == "ack" => self.acknowledged = numbers(&word["durable"]),
                Heard::Word(word) => panic!("{word} though nothing was asked"),
                Heard::Closed(..) | Heard::Cut => {
                    self.line = None;
                    return;
                }
            }
        }
    }

    /// Sends all that is left, ends the recording, and looks at what became of it.
    async fn end(mut self, centre: &mut Centre, dice: &mut Dice) {
        let session = loop {
            self.send(centre, dice.below(2) == 0).await;
            let Some(line) = &mut self.line else { continue };
            line.sender.say(&json!({"type": "end", "frames": self.captured})).await;
            match line.sender.answer().await {
                Heard::Word(word) if word["type"] == "ended" => break word["session"].as_str().unwrap().to_owned(),
                Heard::Word(word) if word["type"] == "missing" => panic!("{word}: all of it was sent"),
                _ => self.line = None,
            }
        };
        let video = centre.get(&format!("/sessions/{session}/video")).await;
        assert!(video.status().is_success());
        let shown = numbers_in(&video.bytes().await.unwrap());
        let kept: Vec<u64> = (0..self.captured).filter(|number| !self.lost.contains(*number)).collect();
        let expected: Vec<u64> = kept.iter().map(|number| number - kept[0]).collect(); // time begins with the first frame
        assert_eq!(shown, expected, "each frame is there once, but for the gaps");
        for line in self.old {
            line.proxy.send_replace(Mode::Cut);
        }
    }
}

fn numbers(ranges: &Value) -> Numbers {
    let mut numbers = Numbers::default();
    for range in ranges.as_array().unwrap() {
        numbers.add(range[0].as_u64().unwrap(), range[1].as_u64().unwrap()).unwrap();
    }
    numbers
}

/// What the proxy does with bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    /// Passes them on.
    Pass,
    /// Keeps them until it is told otherwise.
    Hold,
    /// Passes so many more to the service, and then ends both connections.
    CutAfter(usize),
    /// Ends both connections.
    Cut,
}

/// A proxy for one connection: where it listens, and how it is told what to do.
async fn proxy_to(service: String) -> (String, watch::Sender<Mode>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let host = listener.local_addr().unwrap().to_string();
    let (tell, told) = watch::channel(Mode::Pass);
    tokio::spawn(async move {
        let (client, _) = listener.accept().await.unwrap();
        let Ok(service) = TcpStream::connect(service).await else { return };
        let ((from_client, to_client), (from_service, to_service)) = (client.into_split(), service.into_split());
        tokio::join!(pass(from_client, to_service, told.clone()), pass(from_service, to_client, told));
    });
    (host, tell)
}

async fn pass(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, mut told: watch::Receiver<Mode>) {
    let mut buffer = vec![0; 16 << 10];
    let mut passed_since_told = 0;
    loop {
        let read = tokio::select! {
            read = from.read(&mut buffer) => read.unwrap_or(0),
            ended = told.wait_for(|mode| *mode == Mode::Cut) => { let _ = ended; 0 }
        };
        if read == 0 || told.wait_for(|mode| *mode != Mode::Hold).await.is_err() {
            return;
        }
        let mode = *told.borrow();
        let passed = match mode {
            Mode::CutAfter(most) => read.min(most.saturating_sub(passed_since_told)),
            Mode::Cut => return,
            _ => read,
        };
        if to.write_all(&buffer[..passed]).await.is_err() || passed < read {
            return;
        }
        if matches!(mode, Mode::CutAfter(_)) {
            passed_since_told += passed;
        }
    }
}
