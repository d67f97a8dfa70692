//! The frames of a source, over its interruptions.
//!
//! | how a source ends | a file | a camera, a live stream |
//! |---|---|---|
//! | it delivers no more | the end of the recording | opened again |
//! | it cannot be read, it is unplugged | lost | opened again |
//! | it falls silent | lost | opened again |
//!
//! A source that cannot be opened again in time is lost, and so is one that has other pictures afterwards.
//!
//! ```text
//! Reading ──interrupted──▶ Pausing ──▶ Opening ──opened──▶ Reading
//!    │                        ▲  │        │
//!    │                        └──┼────────┤ not opened
//!    └── end, or too long away ──┴────────┴──▶ Over
//! ```

use std::future::Future;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::task::{JoinError, JoinHandle};
use tokio::time::{Instant, sleep_until, timeout_at};

use crate::media::{CaptureSource, CapturedFrame, SourceError, SourceInfo};

/// Frames that may wait for the disk; a camera's own queue comes first.
const MAX_WAITING_FRAMES: usize = 32;
/// First and longest pause before a source is opened again; each pause is twice the one before.
const MIN_PAUSE: Duration = Duration::from_millis(500);
const MAX_PAUSE: Duration = Duration::from_secs(10);
/// How long the opening may take. FFmpeg reads up to 5 s of a stream before it knows the codec.
const OPEN_TIMEOUT: Duration = Duration::from_secs(20);

/// Opens a source. Opening and reading end soon after the flag is set.
pub type OpenSource = Arc<dyn Fn(Arc<AtomicBool>) -> Result<CaptureSource, SourceError> + Send + Sync>;

/// How long a source may be away.
#[derive(Clone, Copy, Debug)]
pub struct SourcePatience {
    /// Silence after which a source counts as interrupted: an unplugged one may block its reader for ever.
    pub silence: Duration,
    /// Time after which an interrupted source is lost; zero: at once.
    pub outage: Duration,
}

/// What a source delivers next.
#[derive(Debug)]
pub enum SourceEvent {
    /// The next frame.
    Frame(CapturedFrame),
    /// The first frame after an interruption, and when it arrived. Its times begin anew.
    Resumed(CapturedFrame, Instant),
    /// The source has come to its own end.
    Ended,
    /// The source is lost: why.
    Lost(String),
}

/// Where a recording's frames come from.
pub trait FrameSource: Send {
    /// Properties of the source.
    fn info(&self) -> &SourceInfo;
    /// The next event. The future may be dropped at any time; nothing is lost.
    fn next(&mut self) -> impl Future<Output = SourceEvent> + Send;
}

impl FrameSource for RecordedSource {
    fn info(&self) -> &SourceInfo {
        RecordedSource::info(self)
    }

    async fn next(&mut self) -> SourceEvent {
        RecordedSource::next(self).await
    }
}

/// A source that is opened again when it is interrupted.
pub struct RecordedSource {
    open: OpenSource,
    info: SourceInfo,
    patience: SourcePatience,
    state: ReaderState,
    outage: Option<Outage>,
    /// Called each time that the source was opened again.
    opened_again: Option<Box<dyn Fn() + Send + Sync>>,
    /// Ends the opening and reading of the present source.
    stop: Arc<AtomicBool>,
}

enum ReaderState {
    Reading { frames: mpsc::Receiver<Result<CapturedFrame, SourceError>>, silent_at: Instant },
    Pausing { until: Instant },
    Opening { opening: JoinHandle<Result<CaptureSource, SourceError>>, deadline: Instant },
    Over,
}

/// An interruption that has not ended yet.
struct Outage {
    why: String,
    since: Instant,
    next_pause: Duration,
}

impl RecordedSource {
    /// Opens a source for the first time.
    ///
    /// # Errors
    /// It cannot be opened, or holds no usable video.
    pub async fn open(open: OpenSource, patience: SourcePatience) -> Result<Result<Self, SourceError>, JoinError> {
        let stop = Arc::new(AtomicBool::new(false));
        let (opener, flag) = (open.clone(), stop.clone());
        let source = tokio::task::spawn_blocking(move || opener(flag)).await?;
        Ok(source.map(|source| {
            let info = source.info().clone();
            let state = read(source, patience.silence);
            Self { open, info, patience, state, outage: None, opened_again: None, stop }
        }))
    }

    /// Calls this each time that the source was opened again.
    pub fn when_opened_again(&mut self, call: impl Fn() + Send + Sync + 'static) {
        self.opened_again = Some(Box::new(call));
    }

    /// Properties of the source.
    pub fn info(&self) -> &SourceInfo {
        &self.info
    }

    /// The next event. The future may be dropped at any time; nothing is lost.
    pub async fn next(&mut self) -> SourceEvent {
        loop {
            let why = match &mut self.state {
                ReaderState::Reading { frames, silent_at } => {
                    let silence = self.patience.silence;
                    let read = tokio::select! {
                        biased;
                        read = frames.recv() => read.map(|read| read.map_err(|error| error.to_string())),
                        () = sleep_until(*silent_at) => Some(Err(format!("the source sent nothing for {silence:?}"))),
                    };
                    match read {
                        Some(Ok(frame)) => {
                            *silent_at = Instant::now() + silence;
                            return match self.outage.take() {
                                None => SourceEvent::Frame(frame),
                                Some(_) => SourceEvent::Resumed(frame, Instant::now()),
                            };
                        }
                        Some(Err(why)) => why,
                        None if self.info.has_end => return self.finish(SourceEvent::Ended),
                        None => "the source ended".to_owned(),
                    }
                }
                ReaderState::Pausing { until } => {
                    sleep_until(*until).await;
                    self.begin_opening();
                    continue;
                }
                ReaderState::Opening { opening, deadline } => match timeout_at(*deadline, opening).await {
                    Ok(Ok(Ok(source))) if *source.info() == self.info => {
                        self.state = read(source, self.patience.silence);
                        self.opened_again.iter().for_each(|call| call());
                        continue;
                    }
                    Ok(Ok(Ok(_))) => {
                        let why = "the source has another picture size or coding now; start a new recording";
                        return self.finish(SourceEvent::Lost(why.to_owned()));
                    }
                    Ok(Ok(Err(error))) => error.to_string(),
                    Ok(Err(panic)) => panic.to_string(),
                    Err(_) => format!("the source cannot be opened (no answer within {OPEN_TIMEOUT:?})"),
                },
                ReaderState::Over => return std::future::pending().await,
            };
            if let Some(lost) = self.interrupt(why) {
                return lost;
            }
        }
    }

    /// Stops reading, and plans the next opening unless the source is lost.
    fn interrupt(&mut self, why: String) -> Option<SourceEvent> {
        self.stop.store(true, Ordering::Relaxed);
        let now = Instant::now();
        if self.info.has_end || self.patience.outage.is_zero() {
            return Some(self.finish(SourceEvent::Lost(why)));
        }
        let outage = self.outage.get_or_insert_with(|| Outage { why: why.clone(), since: now, next_pause: MIN_PAUSE });
        let lost_at = outage.since + self.patience.outage;
        if now >= lost_at {
            let lost = format!("{} and was not back after {:?}", outage.why, self.patience.outage);
            return Some(self.finish(SourceEvent::Lost(lost)));
        }
        let until = (now + outage.next_pause).min(lost_at);
        tracing::warn!(
            why,
            pause_ms = (until - now).as_millis() as u64,
            "source interrupted; opened again after the pause"
        );
        outage.next_pause = (2 * outage.next_pause).min(MAX_PAUSE);
        self.state = ReaderState::Pausing { until };
        None
    }

    fn begin_opening(&mut self) {
        self.stop = Arc::new(AtomicBool::new(false));
        let (open, stop) = (self.open.clone(), self.stop.clone());
        let opening = tokio::task::spawn_blocking(move || open(stop));
        self.state = ReaderState::Opening { opening, deadline: Instant::now() + OPEN_TIMEOUT };
    }

    fn finish(&mut self, event: SourceEvent) -> SourceEvent {
        self.stop.store(true, Ordering::Relaxed);
        self.state = ReaderState::Over;
        event
    }
}

impl Drop for RecordedSource {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

fn read(source: CaptureSource, silence: Duration) -> ReaderState {
    ReaderState::Reading { frames: read_on_thread(source), silent_at: Instant::now() + silence }
}

/// Reads a source on a separate thread until it ends or the receiver is dropped.
pub(super) fn read_on_thread(mut source: CaptureSource) -> mpsc::Receiver<Result<CapturedFrame, SourceError>> {
    let (sender, frames) = mpsc::channel(MAX_WAITING_FRAMES);
    std::thread::spawn(move || {
        while let Some(read) = source.next_frame().transpose() {
            let is_last = read.is_err();
            if sender.blocking_send(read).is_err() || is_last {
                return;
            }
        }
    });
    frames
}
