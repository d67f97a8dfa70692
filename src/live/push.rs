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

use super::tracking::FeedStopGuard;
use super::{ConnectResult, Connection, FeedService};
use crate::analysis::protocol::{ChildRequest, ChildWork};
use crate::analysis::{AttemptFailure, ChildAttempt, ChildEvent, ChildOutput, run_attempt};
use crate::domain::feed::close_reason::{CloseCode, CloseReason};
use crate::domain::feed::messages::{Hello, ServerMessage};
use crate::domain::feed::record::RecordBody;
use crate::domain::feed::{MAX_DURATION_S, MAX_FRAMES, PROTOCOL};
use crate::domain::problem::Problem;
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::ids::{FeedId, SessionId};
use crate::media::{CapturedFrame, SourceInfo};
use crate::sandbox::{Budget, StopSwitch};
use crate::time::to_rfc3339;

/// Frames that may wait for the log.
const MAX_WAITING_FRAMES: usize = 2;
/// Extra life of the child beyond the longest recording: it starts before the recording and ends after it.
const LIFE_MARGIN: Duration = Duration::from_secs(300);
/// Extra silence of the child beyond the sender's: it can only report after its sender.
const SILENCE_MARGIN: Duration = Duration::from_secs(20);

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
pub struct PushFailure {
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
    Closed(CloseReason),
}

impl From<CloseReason> for PushError {
    fn from(farewell: CloseReason) -> Self {
        PushError::Closed(farewell)
    }
}

impl FeedService {
    /// Receives a pushed stream until it ends or `signed_out` resolves. Call it in a separate task: senders close the
    /// connection right after their last byte.
    ///
    /// # Errors
    /// The push did not end normally. The frames that arrived are a session all the same, if any can be decoded.
    pub async fn push<B>(
        &self,
        push: Push,
        body: B,
        signed_out: impl Future<Output = ()>,
    ) -> Result<SessionId, PushFailure>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let mut taken = PushSession::new(self, push);
        let broken = taken.take_all(body, signed_out).await.err();
        match (broken, taken.end().await) {
            (None, Ok(session)) => Ok(session),
            (None, Err(reason)) => Err(PushFailure { why: reason.into(), session: None }),
            (Some(why), ended) => Err(PushFailure { why, session: ended.ok() }),
        }
    }
}

/// The state of a push.
struct PushSession<'a> {
    feeds: &'a FeedService,
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

impl<'a> PushSession<'a> {
    fn new(feeds: &'a FeedService, push: Push) -> Self {
        let (began_at_ms, connection) = (feeds.0.clock.now_ms(), None);
        Self { feeds, push, began_at_ms, connection, next: 0, gaps: 0, is_cut: false, held_back: None, sync_at: None }
    }

    /// Takes frames until the stream ends or must not continue.
    async fn take_all<B>(&mut self, body: B, signed_out: impl Future<Output = ()>) -> Result<(), PushError>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let (mut demuxer, pipe) = self.feeds.start_demuxer().map_err(|why| PushError::Closed(reason_of_crash(&why)))?;
        let mut pouring = pin!(copy_body(body, pipe, self.feeds.0.settings.silent()));
        let mut signed_out = pin!(signed_out);
        let mut poured = None;
        let mut syncing = pin!(Fuse::terminated());
        loop {
            let has_room = self.connection.as_ref().is_none_or(Connection::has_capacity);
            let sync_at = self.sync_at.filter(|_| syncing.is_terminated());
            tokio::select! {
                biased;
                reason = self.wait_until_closed() => return Err(reason.into()),
                () = &mut signed_out => return Err(CloseReason::signed_out().into()),
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
                () = self.wait_for_capacity(), if !has_room => {}
                event = demuxer.events.recv(), if has_room => match event {
                    Some(ChildEvent::Stream(info)) => self.connect(info).await?,
                    Some(ChildEvent::Coded(frame)) => self.take_frame(frame).await?,
                    Some(_) => {}
                    None => break,
                },
                () = ready(()), if self.has_unwritten() => self.write().await?, // no further frame is ready
            }
        }
        match (poured, demuxer.ended.await) {
            (Some(Err(cut)), _) => Err(cut),
            (_, Err(panic)) => Err(reason_of_crash(&panic).into()),
            (_, Ok(Err(failure))) => Err(push_error(failure)),
            (Some(Ok(())), Ok(Ok(_))) => Ok(()),
            (None, Ok(Ok(_))) => {
                let detail = "the stream ended, but the request continues: push one stream per request";
                Err(PushError::Stream(Problem::new("not-a-stream", "The stream has ended", detail)))
            }
        }
    }

    /// Waits until nothing more may be taken.
    async fn wait_until_closed(&self) -> CloseReason {
        match &self.connection {
            Some(connection) => connection.wait_until_closed().await,
            None => {
                self.feeds.0.shutdown.begun().await;
                CloseReason::service_stopping()
            }
        }
    }

    fn has_unwritten(&self) -> bool {
        self.connection.as_ref().is_some_and(Connection::has_unwritten)
    }

    async fn write(&mut self) -> Result<(), CloseReason> {
        match &mut self.connection {
            Some(connection) => connection.write().await,
            None => Ok(()),
        }
    }

    async fn wait_for_capacity(&self) {
        if let Some(connection) = &self.connection {
            connection.wait_for_capacity().await;
        }
    }

    /// Connects with a hello, once the stream header is known.
    async fn connect(&mut self, info: SourceInfo) -> Result<(), CloseReason> {
        let SourceInfo { codec, size: (width, height), time_base, coded_from, .. } = info;
        if let Some(from) = coded_from {
            tracing::warn!(from, "pushed stream is re-encoded as JPEG; send H.264 to avoid the load");
        }
        let Push { scope, in_box, trainee, task, sender } = self.push.clone();
        let began_at = to_rfc3339(self.began_at_ms);
        let (recording, protocol) = (FeedId::at(self.began_at_ms), PROTOCOL);
        let hello = Hello { protocol, recording, trainee, task, codec, width, height, time_base, began_at, sender };
        self.connection = match self.feeds.connect_push(&scope, &in_box, hello).await? {
            ConnectResult::Open(connection) => Some(connection),
            ConnectResult::Ended(_) => None, // not reached: the id is new
        };
        Ok(())
    }

    async fn take_frame(&mut self, frame: CapturedFrame) -> Result<(), CloseReason> {
        let frame = match self.is_cut {
            true => self.held_back.replace(frame),
            false => Some(frame),
        };
        let (Some(frame), Some(connection)) = (frame, &mut self.connection) else { return Ok(()) };
        connection.record_contact();
        if frame.due_s > MAX_DURATION_S || self.next == MAX_FRAMES {
            let why = format!(
                "a recording has at most {MAX_DURATION_S} s and {MAX_FRAMES} frames: push the rest as another recording"
            );
            return Err(CloseReason::new(CloseCode::TooLarge, why));
        }
        let body = frame.body(self.next, connection.time_base());
        self.gaps += u64::from(matches!(body, RecordBody::Gap { .. }));
        connection.take_local_record(self.next, body).await?;
        self.next += 1;
        if self.sync_at.is_none() {
            self.sync_at = Some(Instant::now() + self.feeds.0.settings.ack());
        }
        Ok(())
    }

    /// Makes a session of the frames that arrived. If that is impossible because the service shuts down, it is done at
    /// its next start.
    async fn end(self) -> Result<SessionId, CloseReason> {
        let Some(mut connection) = self.connection else {
            return Err(CloseReason::new(CloseCode::OutOfPlace, "no frame arrived"));
        };
        if self.gaps > 0 {
            tracing::warn!(gaps = self.gaps, "frames of a pushed stream left out: damaged, too large or out of order");
        }
        match connection.end(self.next).await? {
            ServerMessage::Ended { session, .. } => Ok(session),
            _ => Err(CloseReason::new(CloseCode::Failed, "frames that had arrived are missing")),
        }
    }
}

/// A child that splits a stream into frames; dropping it stops the child.
struct Demuxer {
    events: mpsc::Receiver<ChildEvent>,
    ended: JoinHandle<Result<ChildOutput, AttemptFailure>>,
    _stop: FeedStopGuard,
}

impl FeedService {
    /// Starts a child; returns it with the write end of its pipe.
    fn start_demuxer(&self) -> std::io::Result<(Demuxer, Sender)> {
        let (theirs, ours) = pipe()?;
        let ours = Sender::from_owned_fd(OwnedFd::from(ours))?;
        let inputs = vec![File::from(OwnedFd::from(theirs))];
        let settings = &self.0.settings;
        let budget = Budget {
            slice: Budget::SHORT_SLICE,
            wall: Duration::from_secs_f64(MAX_DURATION_S) + LIFE_MARGIN,
            silence: settings.silent() + SILENCE_MARGIN,
            output_bytes: settings.max_bytes.saturating_mul(2),
            ..self.0.analysis.budget()
        };
        let stop = FeedStopGuard(StopSwitch::new()?);
        let (program, stopping) = (self.0.program.clone(), stop.0.clone());
        let (sender, news) = mpsc::channel(MAX_WAITING_FRAMES);
        let ended = tokio::task::spawn_blocking(move || {
            let request = ChildRequest { threads: 1, work: ChildWork::Demux };
            let what = ChildAttempt { program: &program, request, inputs, budget: &budget, stop: &stopping };
            // A failed send means that the receiver is dropped and the child is being stopped.
            run_attempt(what, |event| drop(sender.blocking_send(event))).0
        });
        Ok((Demuxer { events: news, ended, _stop: stop }, ours))
    }
}

/// Copies a body into a child's pipe and closes it at the end. Only the time spent waiting for the body counts as
/// silence.
async fn copy_body<B>(mut body: B, mut pipe: Sender, silent: Duration) -> Result<(), PushError>
where
    B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
{
    loop {
        let bytes = match timeout(silent, body.next()).await {
            Ok(Some(bytes)) => bytes.map_err(PushError::Cut)?,
            Ok(None) => return Ok(()),
            Err(_) => return Err(CloseReason::new(CloseCode::Silent, "the sender was silent for too long").into()),
        };
        if pipe.write_all(&bytes).await.is_err() {
            std::future::pending::<()>().await; // the child has ended; its result gives the reason
        }
    }
}

fn push_error(failure: AttemptFailure) -> PushError {
    match failure {
        AttemptFailure::Impossible(problem) => PushError::Stream(problem),
        AttemptFailure::Stopped => CloseReason::service_stopping().into(),
        AttemptFailure::Crashed(why) => reason_of_crash(&why).into(),
    }
}

fn reason_of_crash(why: &dyn std::fmt::Display) -> CloseReason {
    counter!("trocar_feed_demuxers_died_total").increment(1);
    CloseReason::new(CloseCode::Failed, format!("the process that reads the stream {why}"))
}
