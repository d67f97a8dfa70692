//! A thousand slow clients: other clients do not wait for them, and they take little memory.

use std::time::{Duration, Instant};

use reqwest::{Method, StatusCode};
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval};

use super::Centre;
use crate::support::let_time_pass;

/// Clients of each kind.
const OF_EACH: usize = 250;
/// Pause between two bytes, or pieces, of a slow client: within the service's timeouts and above its minimum rate.
const DRIP: Duration = Duration::from_millis(500);
/// How long the test sends requests: longer than the head of a request may take.
const LOAD_TIME: Duration = Duration::from_secs(45);
/// Pause between two requests of the test.
const REQUEST_INTERVAL: Duration = Duration::from_millis(25);
/// What the slow clients may add to the 99th percentile of the answer times, beyond doubling it.
const SLACK: Duration = Duration::from_millis(10);
/// Answers that a client requests and does not read.
const LARGE_ANSWERS: usize = 20;
/// Maximum memory that the slow clients may take.
const MAX_MEMORY_KIB: u64 = 32 * 1024;

/// How a client is slow.
#[derive(Clone, Copy)]
pub enum Slow {
    /// It connects and sends nothing.
    Silent,
    /// The head of its request arrives in small pieces.
    Head,
    /// Its recording arrives slightly above the minimum rate.
    Body,
    /// It requests more than the buffers of the connection hold, and reads nothing.
    NotReading,
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "takes a minute and two thousand descriptors: make slow-clients"]
async fn a_thousand_slow_clients_do_not_affect_others() {
    rlimit::increase_nofile_limit(8_192).unwrap();
    let centre = Centre::open().await;
    let quiet = ask(&centre, LOAD_TIME / 3).await;
    let before = resident_kib(&centre);
    let mut slow_clients = JoinSet::new();
    for kind in [Slow::Silent, Slow::Head, Slow::Body, Slow::NotReading] {
        for _ in 0..OF_EACH {
            slow_clients.spawn(run_slow_client(kind, centre.host(), centre.token().to_owned()));
        }
    }
    let loaded = ask(&centre, LOAD_TIME).await;
    let grown = resident_kib(&centre).saturating_sub(before);
    let descriptors = std::fs::read_dir(format!("/proc/{}/fd", centre.process().id())).unwrap().count();
    eprintln!(
        "p50 and p99 alone {quiet:?}, among {} slow clients {loaded:?}; memory grew {grown} KiB; {descriptors} descriptors",
        4 * OF_EACH
    );
    assert!(descriptors > 3 * OF_EACH, "the slow clients are connected");
    assert!(loaded.1 <= 2 * quiet.1 + SLACK);
    assert!(grown <= MAX_MEMORY_KIB);
}

/// Requests the sessions at regular times. Returns the median and the 99th percentile of the answer times.
async fn ask(centre: &Centre, during: Duration) -> (Duration, Duration) {
    let mut times = Vec::new();
    let (begun, mut ticks) = (Instant::now(), interval(REQUEST_INTERVAL));
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    while begun.elapsed() < during {
        ticks.tick().await;
        let asked = Instant::now();
        let answer = centre.request(Method::GET, "/sessions").send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::OK);
        answer.bytes().await.unwrap();
        times.push(asked.elapsed());
    }
    times.sort();
    (times[times.len() / 2], times[times.len() * 99 / 100])
}

/// Runs a slow client for ever: it connects again when the service ends its connection.
pub async fn run_slow_client(how: Slow, host: String, token: String) {
    loop {
        if let Ok(wire) = TcpStream::connect(&host).await {
            let _ = drip(how, wire, &host, &token).await; // the service may end the connection
        }
        let_time_pass(DRIP).await;
    }
}

async fn drip(how: Slow, mut wire: TcpStream, host: &str, token: &str) -> std::io::Result<()> {
    let head = |line: &str| format!("{line} HTTP/1.1\r\nhost: {host}\r\nauthorization: Bearer {token}\r\n");
    match how {
        Slow::Silent => std::future::pending().await,
        Slow::Head => {
            wire.write_all(head("GET /api/v1/sessions").as_bytes()).await?;
            loop {
                let_time_pass(DRIP).await;
                wire.write_all(b"x-more: 1\r\n").await?;
            }
        }
        Slow::Body => {
            let line = "POST /api/v1/sessions?trainee=ada&task=pegs&box=box-1&filename=slow.mp4";
            let length = "content-type: video/mp4\r\ncontent-length: 100000000\r\n\r\n";
            wire.write_all((head(line) + length).as_bytes()).await?;
            loop {
                let_time_pass(DRIP).await;
                wire.write_all(&[0; 700]).await?;
            }
        }
        Slow::NotReading => {
            let asked = (head("GET /api/v1/openapi.json") + "\r\n").repeat(LARGE_ANSWERS);
            wire.write_all(asked.as_bytes()).await?;
            std::future::pending().await
        }
    }
}

fn resident_kib(centre: &Centre) -> u64 {
    centre.process().status("VmRSS").parse().unwrap()
}
