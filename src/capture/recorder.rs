//! Frames as they come, numbered, into the spool.

use std::time::Duration;

use tokio::sync::mpsc;
use tokio::task::{JoinHandle, block_in_place};
use tokio::time::{Instant, interval, sleep_until};

use super::Agent;
use crate::domain::feed::record::{Body, Record};
use crate::domain::feed::{LONGEST_S, MOST_FRAMES, TimeBase};
use crate::media::{CapturedFrame, Source};
use crate::shutdown::Shutdown;

/// Frames that may wait for the disk; a camera's own queue comes before them.
const MOST_WAITING: usize = 32;
/// How often what was captured is made durable. A power cut costs so much of what the server does not have, and what a
/// sync takes.
const SYNC_EVERY: Duration = Duration::from_millis(400);

/// How long a source may give nothing; one that is unplugged may hold its reader for ever.
const SOURCE_SILENCE: Duration = Duration::from_secs(30);

/// How a recording is made.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    /// Are frames taken at the times that they bear, as a camera would give them?
    pub is_paced: bool,
    /// The recording ends after so many seconds.
    pub seconds: Option<f64>,
    /// The clock of the frames' times.
    pub time_base: TimeBase,
}

/// Reads a source on a thread of its own until it ends or nobody wants more.
pub fn frames_of(mut source: Source) -> mpsc::Receiver<CapturedFrame> {
    let (sender, frames) = mpsc::channel(MOST_WAITING);
    std::thread::spawn(move || {
        loop {
            match source.next_frame() {
                Ok(Some(frame)) => {
                    if sender.blocking_send(frame).is_err() {
                        return; // nobody wants more
                    }
                }
                Ok(None) => return,
                Err(error) => return tracing::error!(%error, "the source fails: the recording ends here"),
            }
        }
    });
    frames
}

/// Appends frames to the live recording until the source, the time or `ending` ends it. Returns how many there were.
pub async fn record(agent: &Agent, mut frames: mpsc::Receiver<CapturedFrame>, rules: Rules, ending: &Shutdown) -> u64 {
    let seconds = rules.seconds.unwrap_or(LONGEST_S).min(LONGEST_S);
    let mut silent_at = Instant::now() + SOURCE_SILENCE;
    let mut first = None;
    let mut number = 0;
    let mut sync = interval(SYNC_EVERY);
    let mut syncing = Syncing::default();
    loop {
        let frame = tokio::select! {
            biased;
            () = ending.begun() => break,
            _ = sync.tick() => { syncing.begin(agent); continue; }
            frame = frames.recv() => frame,
            () = sleep_until(silent_at) => {
                tracing::error!("the source gives nothing any more: the recording ends here");
                break;
            }
        };
        let Some(frame) = frame else { break };
        silent_at = Instant::now() + SOURCE_SILENCE;
        let first = *first.get_or_insert_with(Instant::now);
        if frame.due_s >= seconds || number == MOST_FRAMES {
            tracing::info!(seconds, number, "the recording has its length");
            break;
        }
        let due = first + Duration::from_secs_f64(frame.due_s.max(0.0));
        while rules.is_paced && Instant::now() < due && !ending.is_begun() {
            tokio::select! {
                () = ending.begun() => {}
                _ = sync.tick() => syncing.begin(agent),
                () = sleep_until(due) => {}
            }
        }
        append(agent, number, &frame, rules.time_base);
        number += 1;
        agent.status().captured = number;
        agent.has_changed();
    }
    syncing.end().await;
    block_in_place(|| agent.spool().end());
    agent.sync().await;
    agent.has_changed();
    number
}

/// A sync beside the recording, one at a time: a slow disk must not hold up the camera.
#[derive(Default)]
struct Syncing(Option<JoinHandle<()>>);

impl Syncing {
    /// Begins one, unless one goes on.
    fn begin(&mut self, agent: &Agent) {
        if self.0.as_ref().is_none_or(JoinHandle::is_finished) {
            let agent = agent.clone();
            self.0 = Some(tokio::spawn(async move { agent.sync().await }));
        }
    }

    /// Waits for the one that goes on.
    async fn end(&mut self) {
        if let Some(going_on) = self.0.take() {
            let _ = going_on.await; // a panic is logged where it happened
        }
    }
}

/// Appends a frame; one that no feed can have is a gap.
fn append(agent: &Agent, number: u64, frame: &CapturedFrame, time_base: TimeBase) {
    let body = frame.body(number, time_base);
    if let Body::Gap { .. } = body {
        let (time_s, bytes) = (time_base.seconds(frame.time), frame.bytes.len());
        tracing::warn!(number, time_s, bytes, "a frame that cannot be sent: damaged, too long or out of time");
    }
    if let Err(error) = block_in_place(|| agent.spool().append(&Record { epoch: 0, number, body })) {
        tracing::error!(number, %error, "a frame is lost: the spool cannot be written");
    }
}
