//! Writes frames into the spool as they arrive, with numbers.

use std::time::Duration;

use tokio::sync::mpsc;
use tokio::task::{JoinHandle, block_in_place};
use tokio::time::{Instant, interval, sleep_until};

use super::Agent;
use crate::domain::feed::record::{FeedRecord, RecordBody};
use crate::domain::feed::{MAX_DURATION_S, MAX_FRAMES, TimeBase};
use crate::media::{CaptureSource, CapturedFrame};
use crate::shutdown::Shutdown;

/// Frames that may wait for the disk; a camera's own queue comes first.
const MAX_WAITING_FRAMES: usize = 32;
/// Interval between syncs of the spool. A power cut loses at most this much of what the server does not have, and what
/// arrived during a sync.
const SYNC_INTERVAL: Duration = Duration::from_millis(400);

/// Longest silence of a source; an unplugged one may block its reader for ever.
const SOURCE_TIMEOUT: Duration = Duration::from_secs(30);

/// How a recording is made.
#[derive(Clone, Copy, Debug)]
pub struct RecordingRules {
    /// True if frames are taken at the times that they carry, as a camera would deliver them.
    pub is_paced: bool,
    /// The recording ends after this many seconds.
    pub seconds: Option<f64>,
    /// Time base of the frames.
    pub time_base: TimeBase,
}

/// Reads a source on a separate thread until it ends or the receiver is dropped.
pub fn read_source(mut source: CaptureSource) -> mpsc::Receiver<CapturedFrame> {
    let (sender, frames) = mpsc::channel(MAX_WAITING_FRAMES);
    std::thread::spawn(move || {
        loop {
            match source.next_frame() {
                Ok(Some(frame)) => {
                    if sender.blocking_send(frame).is_err() {
                        return; // the receiver was dropped
                    }
                }
                Ok(None) => return,
                Err(error) => return tracing::error!(%error, "the source failed; the recording ends here"),
            }
        }
    });
    frames
}

/// Appends frames to the live recording until the source ends, the time is over or `ending` begins. Returns their
/// number.
pub async fn record(
    agent: &Agent,
    mut frames: mpsc::Receiver<CapturedFrame>,
    rules: RecordingRules,
    ending: &Shutdown,
) -> u64 {
    let seconds = rules.seconds.unwrap_or(MAX_DURATION_S).min(MAX_DURATION_S);
    let mut silent_at = Instant::now() + SOURCE_TIMEOUT;
    let mut first = None;
    let mut number = 0;
    let mut sync = interval(SYNC_INTERVAL);
    let mut syncing = BackgroundSync::default();
    loop {
        let frame = tokio::select! {
            biased;
            () = ending.begun() => break,
            _ = sync.tick() => { syncing.begin(agent); continue; }
            frame = frames.recv() => frame,
            () = sleep_until(silent_at) => {
                tracing::error!("the source sent nothing for 30 s; the recording ends here");
                break;
            }
        };
        let Some(frame) = frame else { break };
        silent_at = Instant::now() + SOURCE_TIMEOUT;
        let first = *first.get_or_insert_with(Instant::now);
        if frame.due_s >= seconds || number == MAX_FRAMES {
            tracing::info!(seconds, number, "the recording has reached its length");
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
        agent.notify_changed();
    }
    syncing.end().await;
    block_in_place(|| agent.spool().end_live());
    agent.sync().await;
    agent.notify_changed();
    number
}

/// A sync that runs beside the recording, one at a time: a slow disk must not delay the camera.
#[derive(Default)]
struct BackgroundSync(Option<JoinHandle<()>>);

impl BackgroundSync {
    /// Starts a sync, unless one is running.
    fn begin(&mut self, agent: &Agent) {
        if self.0.as_ref().is_none_or(JoinHandle::is_finished) {
            let agent = agent.clone();
            self.0 = Some(tokio::spawn(async move { agent.sync().await }));
        }
    }

    /// Waits for the running sync.
    async fn end(&mut self) {
        if let Some(running) = self.0.take() {
            let _ = running.await; // a panic is logged where it happened
        }
    }
}

/// Appends a frame; a frame that cannot be sent becomes a gap.
fn append(agent: &Agent, number: u64, frame: &CapturedFrame, time_base: TimeBase) {
    let body = frame.body(number, time_base);
    if let RecordBody::Gap { .. } = body {
        let (time_s, bytes) = (time_base.seconds(frame.time), frame.bytes.len());
        tracing::warn!(number, time_s, bytes, "frame replaced by a gap: damaged, too large or out of order");
    }
    if let Err(error) = block_in_place(|| agent.spool().append(&FeedRecord { epoch: 0, number, body })) {
        tracing::error!(number, %error, "frame lost: the spool cannot be written");
    }
}
