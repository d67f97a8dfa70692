//! A recording that is pushed in one request: a live stream of MPEG-TS or Matroska, as FFmpeg and OBS send it.
//!
//! ```text
//! body ─pipe─▶ child: demux ─▶ stream header: a hello ─▶ Connection, as of any sender
//!                              frames: records         ─▶ log, tracking, end
//! ```
//! Only a few frames wait in memory. While the log is slow or tracking is behind, no frame is taken; the child then
//! stops reading, its pipe fills up, and the sender's socket blocks.
//!
//! However a push ends, the frames that arrived become the session. A push cannot be resumed.

use std::fs::File;
use std::future::ready;
use std::io::pipe;
use std::os::fd::OwnedFd;
use std::pin::pin;
use std::time::Duration;

use bytes::Bytes;
use futures_util::future::{Fuse, FusedFuture};
use futures_util::{FutureExt, Stream, StreamExt};
use metrics::counter;
use tokio::io::AsyncWriteExt;
use tokio::net::unix::pipe::Sender;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep_until, timeout};

use super::following::PulledWhenGone;
use super::{Connected, Connection, Feeds};
use crate::analysis::protocol::{Request, Work};
use crate::analysis::{Attempt, Failure, Heard, News, attempt};
use crate::domain::feed::farewell::{Code, Farewell};
use crate::domain::feed::record::Body;
use crate::domain::feed::words::{FromServer, Hello};
use crate::domain::feed::{LONGEST_S, MOST_FRAMES, PROTOCOL};
use crate::domain::problem::Problem;
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::ids::{FeedId, SessionId};
use crate::media::{CapturedFrame, SourceInfo};
use crate::sandbox::{Budget, Stop};
use crate::time::to_rfc3339;

/// Frames that may wait for the log.
const MOST_WAITING: usize = 2;
/// Extra life of the child beyond the longest recording: it starts before the recording and ends after it.
const BEGINNING_AND_END: Duration = Duration::from_secs(300);
/// Extra silence of the child beyond the sender's: it can only report after its sender.
const AFTER_THE_SENDER: Duration = Duration::from_secs(20);

/// Why a body could not be read to its end.
pub type BoxError = Box<dyn std::error::Error + Send + Sync>;

/// The parameters of a push; trainee and task by id or code.
#[derive(Clone, Debug)]
pub struct Push {
    /// The caller.
    pub scope: Scope,
    /// The box.
    pub in_box: Key,
    /// The trainee.
    pub trainee: String,
    /// The task.
    pub task: String,
    /// The sender's program, for display.
    pub sender: String,
}

/// A push that did not end normally.
#[derive(Debug)]
pub struct Broken {
    /// The reason.
    pub why: PushError,
    /// The session made from the frames that arrived, if any could be decoded.
    pub session: Option<SessionId>,
}

/// Why a push did not end normally.
#[derive(Debug, thiserror::Error)]
pub enum PushError {
    /// The body broke off, or arrived too slowly.
    #[error("the connection was cut ({0})")]
    Cut(BoxError),
    /// The stream cannot be used, or not any further.
    #[error("{}", .0.detail)]
    Stream(Problem),
    /// A reason that closes any sender's connection.
    #[error("{}", .0.why)]
    Told(Farewell),
}

impl From<Farewell> for PushError {
    fn from(farewell: Farewell) -> Self {
        PushError::Told(farewell)
    }
}

impl Feeds {
    /// Receives a pushed stream until it ends or `signed_out` resolves. Call it in a separate task: senders close the
    /// connection right after their last byte.
    ///
    /// # Errors
    /// The push did not end normally. The frames that arrived are a session all the same, if any can be decoded.
    pub async fn push<B>(&self, push: Push, body: B, signed_out: impl Future<Output = ()>) -> Result<SessionId, Broken>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let mut taken = Taken::new(self, push);
        let broken = taken.take_all(body, signed_out).await.err();
        match (broken, taken.end().await) {
            (None, Ok(session)) => Ok(session),
            (None, Err(reason)) => Err(Broken { why: reason.into(), session: None }),
            (Some(why), ended) => Err(Broken { why, session: ended.ok() }),
        }
    }
}

/// The state of a push.
struct Taken<'a> {
    feeds: &'a Feeds,
    push: Push,
    began_at_ms: i64,
    /// Present once the stream header is known.
    connection: Option<Connection>,
    /// The number of the next frame.
    next: u64,
    /// Number of frames that were replaced by gaps.
    gaps: u64,
    /// The body broke off. The last frame is then incomplete, so each frame is held back until the next one arrives.
    is_cut: bool,
    held_back: Option<CapturedFrame>,
    sync_at: Option<Instant>,
}

impl<'a> Taken<'a> {
    fn new(feeds: &'a Feeds, push: Push) -> Self {
        let (began_at_ms, connection) = (feeds.0.clock.now_ms(), None);
        Self { feeds, push, began_at_ms, connection, next: 0, gaps: 0, is_cut: false, held_back: None, sync_at: None }
    }

    /// Takes frames until the stream ends or must not continue.
    async fn take_all<B>(&mut self, body: B, signed_out: impl Future<Output = ()>) -> Result<(), PushError>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let (mut demuxer, pipe) = self.feeds.start_demuxer().map_err(|why| PushError::Told(died(&why)))?;
        let mut pouring = pin!(pour(body, pipe, self.feeds.0.settings.silent()));
        let mut signed_out = pin!(signed_out);
        let mut poured = None;
        let mut syncing = pin!(Fuse::terminated());
        loop {
            let has_room = self.connection.as_ref().is_none_or(Connection::has_room);
            let sync_at = self.sync_at.filter(|_| syncing.is_terminated());
            tokio::select! {
                biased;
                reason = self.over() => return Err(reason.into()),
                () = &mut signed_out => return Err(Farewell::signed_out().into()),
                end = &mut pouring, if poured.is_none() => {
                    self.is_cut = end.is_err();
                    poured = Some(end);
                }
                durable = &mut syncing, if !syncing.is_terminated() => drop(durable?),
                () = sleep_until(sync_at.unwrap_or_else(Instant::now)), if sync_at.is_some() => {
                    self.sync_at = None;
                    if let Some(connection) = &mut self.connection {
                        syncing.set(connection.begin_sync().await?.fuse());
                    }
                }
                () = self.room(), if !has_room => {}
                event = demuxer.news.recv(), if has_room => match event {
                    Some(News::Stream(info)) => self.begin(info).await?,
                    Some(News::Coded(frame)) => self.take_frame(frame).await?,
                    Some(_) => {}
                    None => break,
                },
                () = ready(()), if self.holds_back() => self.write().await?, // no further frame is ready
            }
        }
        match (poured, demuxer.ended.await) {
            (Some(Err(cut)), _) => Err(cut),
            (_, Err(panic)) => Err(died(&panic).into()),
            (_, Ok(Err(failure))) => Err(failed(failure)),
            (Some(Ok(())), Ok(Ok(_))) => Ok(()),
            (None, Ok(Ok(_))) => {
                let detail = "the stream ended, but the request continues: push one stream per request";
                Err(PushError::Stream(Problem::new("not-a-stream", "The stream has ended", detail)))
            }
        }
    }

    /// Waits until nothing more may be taken.
    async fn over(&self) -> Farewell {
        match &self.connection {
            Some(connection) => connection.over().await,
            None => {
                self.feeds.0.shutdown.begun().await;
                Farewell::service_ends()
            }
        }
    }

    fn holds_back(&self) -> bool {
        self.connection.as_ref().is_some_and(Connection::holds_back)
    }

    async fn write(&mut self) -> Result<(), Farewell> {
        match &mut self.connection {
            Some(connection) => connection.write().await,
            None => Ok(()),
        }
    }

    async fn room(&self) {
        if let Some(connection) = &self.connection {
            connection.room().await;
        }
    }

    /// Connects with a hello, once the stream header is known.
    async fn begin(&mut self, info: SourceInfo) -> Result<(), Farewell> {
        let SourceInfo { codec, size: (width, height), time_base, coded_from, .. } = info;
        if let Some(from) = coded_from {
            tracing::warn!(from, "pushed stream is re-encoded as JPEG; send H.264 to avoid the load");
        }
        let Push { scope, in_box, trainee, task, sender } = self.push.clone();
        let began_at = to_rfc3339(self.began_at_ms);
        let (recording, protocol) = (FeedId::at(self.began_at_ms), PROTOCOL);
        let hello = Hello { protocol, recording, trainee, task, codec, width, height, time_base, began_at, sender };
        self.connection = match self.feeds.connect_push(&scope, &in_box, hello).await? {
            Connected::Open(connection) => Some(connection),
            Connected::Ended(_) => None, // not reached: the id is new
        };
        Ok(())
    }

    async fn take_frame(&mut self, frame: CapturedFrame) -> Result<(), Farewell> {
        let frame = match self.is_cut {
            true => self.held_back.replace(frame),
            false => Some(frame),
        };
        let (Some(frame), Some(connection)) = (frame, &mut self.connection) else { return Ok(()) };
        connection.heard();
        if frame.due_s > LONGEST_S || self.next == MOST_FRAMES {
            let why = format!(
                "a recording has at most {LONGEST_S} s and {MOST_FRAMES} frames: push the rest as another recording"
            );
            return Err(Farewell::new(Code::TooMuch, why));
        }
        let body = frame.body(self.next, connection.time_base());
        self.gaps += u64::from(matches!(body, Body::Gap { .. }));
        connection.take_own(self.next, body).await?;
        self.next += 1;
        if self.sync_at.is_none() {
            self.sync_at = Some(Instant::now() + self.feeds.0.settings.ack());
        }
        Ok(())
    }

    /// Makes a session of the frames that arrived. If that is impossible because the service shuts down, it is done at
    /// its next start.
    async fn end(self) -> Result<SessionId, Farewell> {
        let Some(mut connection) = self.connection else {
            return Err(Farewell::new(Code::DoesNotBelong, "no frame arrived"));
        };
        if self.gaps > 0 {
            tracing::warn!(gaps = self.gaps, "frames of a pushed stream left out: damaged, too large or out of order");
        }
        match connection.end(self.next).await? {
            FromServer::Ended { session, .. } => Ok(session),
            _ => Err(Farewell::new(Code::Failed, "frames that had arrived are missing")),
        }
    }
}

/// A child that splits a stream into frames; dropping it stops the child.
struct Demuxer {
    news: mpsc::Receiver<News>,
    ended: JoinHandle<Result<Heard, Failure>>,
    _stop: PulledWhenGone,
}

impl Feeds {
    /// Starts a child; returns it with the write end of its pipe.
    fn start_demuxer(&self) -> std::io::Result<(Demuxer, Sender)> {
        let (theirs, ours) = pipe()?;
        let ours = Sender::from_owned_fd(OwnedFd::from(ours))?;
        let inputs = vec![File::from(OwnedFd::from(theirs))];
        let settings = &self.0.settings;
        let budget = Budget {
            slice: Budget::SHORT_SLICE,
            wall: Duration::from_secs_f64(LONGEST_S) + BEGINNING_AND_END,
            silence: settings.silent() + AFTER_THE_SENDER,
            output_bytes: settings.max_bytes.saturating_mul(2),
            ..self.0.analysis.budget()
        };
        let stop = PulledWhenGone(Stop::new()?);
        let (program, stopping) = (self.0.program.clone(), stop.0.clone());
        let (sender, news) = mpsc::channel(MOST_WAITING);
        let ended = tokio::task::spawn_blocking(move || {
            let request = Request { threads: 1, work: Work::Demux };
            let what = Attempt { program: &program, request, inputs, budget: &budget, stop: &stopping };
            // A failed send means that the receiver is dropped and the child is being stopped.
            attempt(what, |event| drop(sender.blocking_send(event))).0
        });
        Ok((Demuxer { news, ended, _stop: stop }, ours))
    }
}

/// Copies a body into a child's pipe and closes it at the end. Only the time spent waiting for the body counts as
/// silence.
async fn pour<B>(mut body: B, mut pipe: Sender, silent: Duration) -> Result<(), PushError>
where
    B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
{
    loop {
        let bytes = match timeout(silent, body.next()).await {
            Ok(Some(bytes)) => bytes.map_err(PushError::Cut)?,
            Ok(None) => return Ok(()),
            Err(_) => return Err(Farewell::new(Code::Silent, "the sender was silent for too long").into()),
        };
        if pipe.write_all(&bytes).await.is_err() {
            std::future::pending::<()>().await; // the child has ended; its result gives the reason
        }
    }
}

fn failed(failure: Failure) -> PushError {
    match failure {
        Failure::Explained(problem) => PushError::Stream(problem),
        Failure::Stopped => Farewell::service_ends().into(),
        Failure::Crashed(why) => died(&why).into(),
    }
}

fn died(why: &dyn std::fmt::Display) -> Farewell {
    counter!("trocar_feed_demuxers_died_total").increment(1);
    Farewell::new(Code::Failed, format!("the process that reads the stream {why}"))
}
