//! A thousand slow clients: nobody else waits for them, and they take no memory to speak of.

use std::time::{Duration, Instant};

use reqwest::{Method, StatusCode};
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval};

use super::Centre;

/// Clients of each kind.
const OF_EACH: usize = 250;
/// Between two bytes, or pieces, of a slow client: ended neither by the service's times nor by its least rate.
const DRIP: Duration = Duration::from_millis(500);
/// How long the service is asked, longer than a request's head may take.
const SIEGE: Duration = Duration::from_secs(45);
const BETWEEN: Duration = Duration::from_millis(25);
/// What the slow clients may add to the slowest hundredth of answers, beyond doubling it.
const SLACK: Duration = Duration::from_millis(10);
/// Answers that a deaf client asks for.
const LARGE_ANSWERS: usize = 20;
const MEMORY_KIB: u64 = 32 * 1024;

/// How a client is slow.
#[derive(Clone, Copy)]
enum Slow {
    /// It connects and says nothing.
    Silent,
    /// Its request's head comes byte by byte.
    Head,
    /// Its recording comes at a little more than the least rate.
    Body,
    /// It asks for more than fits between us and reads nothing of it.
    Deaf,
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "takes a minute and two thousand descriptors: make slow-clients"]
async fn a_thousand_slow_clients_hurt_nobody_else() {
    rlimit::increase_nofile_limit(8_192).unwrap();
    let centre = Centre::open().await;
    let quiet = ask(&centre, SIEGE / 3).await;
    let before = resident_kib(&centre);
    let mut siege = JoinSet::new();
    for kind in [Slow::Silent, Slow::Head, Slow::Body, Slow::Deaf] {
        for _ in 0..OF_EACH {
            siege.spawn(besiege(kind, centre.host(), centre.token().to_owned()));
        }
    }
    let besieged = ask(&centre, SIEGE).await;
    let grown = resident_kib(&centre).saturating_sub(before);
    let descriptors = std::fs::read_dir(format!("/proc/{}/fd", centre.process().id())).unwrap().count();
    eprintln!(
        "p50 and p99 alone {quiet:?}, among {} slow clients {besieged:?}; memory grew {grown} KiB; {descriptors} descriptors",
        4 * OF_EACH
    );
    assert!(descriptors > 3 * OF_EACH, "they are really there");
    assert!(besieged.1 <= 2 * quiet.1 + SLACK);
    assert!(grown <= MEMORY_KIB);
}

/// Asks for the sessions at even times; the answers' median and 99th percentile.
async fn ask(centre: &Centre, during: Duration) -> (Duration, Duration) {
    let mut times = Vec::new();
    let (begun, mut ticks) = (Instant::now(), interval(BETWEEN));
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

/// Is slow for ever: whoever is shown the door comes again.
async fn besiege(how: Slow, host: String, token: String) {
    loop {
        if let Ok(wire) = TcpStream::connect(&host).await {
            let _ = drip(how, wire, &host, &token).await; // ended by the service, as it should be
        }
        tokio::time::sleep(DRIP).await;
    }
}

async fn drip(how: Slow, mut wire: TcpStream, host: &str, token: &str) -> std::io::Result<()> {
    let head = |line: &str| format!("{line} HTTP/1.1\r\nhost: {host}\r\nauthorization: Bearer {token}\r\n");
    match how {
        Slow::Silent => std::future::pending().await,
        Slow::Head => {
            wire.write_all(head("GET /api/v1/sessions").as_bytes()).await?;
            loop {
                tokio::time::sleep(DRIP).await;
                wire.write_all(b"x-more: 1\r\n").await?;
            }
        }
        Slow::Body => {
            let line = "POST /api/v1/sessions?trainee=ada&task=pegs&box=box-1&filename=slow.mp4";
            let length = "content-type: video/mp4\r\ncontent-length: 100000000\r\n\r\n";
            wire.write_all((head(line) + length).as_bytes()).await?;
            loop {
                tokio::time::sleep(DRIP).await;
                wire.write_all(&[0; 700]).await?;
            }
        }
        Slow::Deaf => {
            let asked = (head("GET /api/v1/openapi.json") + "\r\n").repeat(LARGE_ANSWERS);
            wire.write_all(asked.as_bytes()).await?;
            std::future::pending().await
        }
    }
}

fn resident_kib(centre: &Centre) -> u64 {
    centre.process().status("VmRSS").parse().unwrap()
}
