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
//!
//! ```text
//! body:      Arriving ──▶ Complete | Cut: the last frame is held back
//! recording: none ──stream header──▶ PushedRecording
//! ```

mod demuxer;

use std::future::ready;
use std::pin::pin;

use bytes::Bytes;
use futures_util::future::{Fuse, FusedFuture};
use futures_util::{FutureExt, Stream};
use tokio::time::{Instant, sleep_until};

use demuxer::{copy_body, push_error, reason_of_crash};

use super::{ConnectResult, Connection, FeedService};
use crate::analysis::ChildEvent;
use crate::domain::feed::arrival::ArrivalMeter;
use crate::domain::feed::close_reason::{CloseCode, CloseReason};
use crate::domain::feed::early_end::{EarlyEnd, EarlyEndCause};
use crate::domain::feed::messages::{Hello, ServerMessage};
use crate::domain::feed::record::RecordBody;
use crate::domain::feed::{MAX_DURATION_S, MAX_FRAMES, PROTOCOL};
use crate::domain::problem::Problem;
use crate::domain::scope::Scope;
use crate::domain::text::Key;
use crate::ids::{FeedId, SessionId};
use crate::media::{CapturedFrame, SourceInfo};
use crate::time::to_rfc3339;

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
    fn from(reason: CloseReason) -> Self {
        PushError::Closed(reason)
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
        let early = broken.as_ref().map(|why| EarlyEnd::of(EarlyEndCause::SenderGone).with(&why.to_string()));
        match (broken, taken.end(early).await) {
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
    began: Instant,
    body: PushedBody,
    /// Present once the stream header is known.
    recording: Option<PushedRecording>,
}

/// The body of a push.
enum PushedBody {
    /// Bytes may arrive.
    Arriving,
    /// All bytes were copied to the child.
    Complete,
    /// The body broke off. Its last frame is incomplete, so each frame is held back until the next one is ready.
    Cut { why: PushError, held_back: Option<CapturedFrame> },
}

/// The recording that a push makes.
struct PushedRecording {
    connection: Connection,
    /// The number of the next frame.
    next: u64,
    /// Number of frames that were replaced by gaps.
    gaps: u64,
    /// When the frames that are not durable yet are synced.
    sync_at: Option<Instant>,
    arrival: ArrivalMeter,
}

impl<'a> PushSession<'a> {
    fn new(feeds: &'a FeedService, push: Push) -> Self {
        let began_at_ms = feeds.0.clock.now_ms();
        Self { feeds, push, began_at_ms, began: Instant::now(), body: PushedBody::Arriving, recording: None }
    }

    /// Takes frames until the stream ends or must not continue.
    async fn take_all<B>(&mut self, body: B, signed_out: impl Future<Output = ()>) -> Result<(), PushError>
    where
        B: Stream<Item = Result<Bytes, BoxError>> + Unpin,
    {
        let (mut demuxer, pipe) = self.feeds.start_demuxer().map_err(|why| PushError::Closed(reason_of_crash(&why)))?;
        let mut pouring = pin!(copy_body(body, pipe, self.feeds.0.settings.silent()));
        let mut signed_out = pin!(signed_out);
        let mut syncing = pin!(Fuse::terminated());
        loop {
            let has_room = self.connection().is_none_or(Connection::has_capacity);
            let sync_at = self.recording.as_ref().and_then(|recording| recording.sync_at);
            let sync_at = sync_at.filter(|_| syncing.is_terminated());
            tokio::select! {
                biased;
                reason = self.wait_until_closed() => return Err(reason.into()),
                () = &mut signed_out => return Err(CloseReason::signed_out().into()),
                end = &mut pouring, if matches!(self.body, PushedBody::Arriving) => self.body = match end {
                    Ok(()) => PushedBody::Complete,
                    Err(why) => PushedBody::Cut { why, held_back: None },
                },
                durable = &mut syncing, if !syncing.is_terminated() => drop(durable?),
                () = sleep_until(sync_at.unwrap_or_else(Instant::now)), if sync_at.is_some() => {
                    if let Some(recording) = &mut self.recording {
                        recording.sync_at = None;
                        syncing.set(recording.connection.begin_sync().await?.fuse());
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
        match (std::mem::replace(&mut self.body, PushedBody::Complete), demuxer.ended.await) {
            (PushedBody::Cut { why, .. }, _) => Err(why),
            (_, Err(panic)) => Err(reason_of_crash(&panic).into()),
            (_, Ok(Err(failure))) => Err(push_error(failure)),
            (PushedBody::Complete, Ok(Ok(_))) => Ok(()),
            (PushedBody::Arriving, Ok(Ok(_))) => {
                let detail = "the stream ended, but the request continues: push one stream per request";
                Err(PushError::Stream(Problem::new("not-a-stream", "The stream has ended", detail)))
            }
        }
    }

    fn connection(&self) -> Option<&Connection> {
        self.recording.as_ref().map(|recording| &recording.connection)
    }

    /// Waits until nothing more may be taken.
    async fn wait_until_closed(&self) -> CloseReason {
        match self.connection() {
            Some(connection) => connection.wait_until_closed().await,
            None => {
                self.feeds.0.shutdown.begun().await;
                CloseReason::service_stopping()
            }
        }
    }

    fn has_unwritten(&self) -> bool {
        self.connection().is_some_and(Connection::has_unwritten)
    }

    async fn write(&mut self) -> Result<(), CloseReason> {
        match &mut self.recording {
            Some(recording) => recording.connection.write().await,
            None => Ok(()),
        }
    }

    async fn wait_for_capacity(&self) {
        if let Some(connection) = self.connection() {
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
        let hello = Hello {
            protocol: PROTOCOL,
            recording: FeedId::at(self.began_at_ms),
            trainee,
            task,
            codec,
            width,
            height,
            time_base,
            began_at,
            sender,
            resumes: false,
        };
        self.recording = match self.feeds.connect_push(&scope, &in_box, hello).await? {
            ConnectResult::Open(connection) => {
                Some(PushedRecording { connection, next: 0, gaps: 0, sync_at: None, arrival: ArrivalMeter::default() })
            }
            ConnectResult::Ended(_) => None, // not reached: the id is new
        };
        Ok(())
    }

    async fn take_frame(&mut self, frame: CapturedFrame) -> Result<(), CloseReason> {
        if let Some(recording) = &mut self.recording {
            recording.arrival.add(self.began.elapsed().as_secs_f64(), frame.due_s);
        }
        let frame = match &mut self.body {
            PushedBody::Cut { held_back, .. } => held_back.replace(frame),
            PushedBody::Arriving | PushedBody::Complete => Some(frame),
        };
        let (Some(frame), Some(recording)) = (frame, &mut self.recording) else { return Ok(()) };
        let PushedRecording { connection, next, gaps, sync_at, .. } = recording;
        connection.record_contact();
        if frame.due_s > MAX_DURATION_S || *next == MAX_FRAMES {
            let why = format!(
                "a recording has at most {MAX_DURATION_S} s and {MAX_FRAMES} frames: push the rest as another recording"
            );
            return Err(CloseReason::new(CloseCode::TooLarge, why));
        }
        let body = frame.body(*next, connection.time_base());
        *gaps += u64::from(matches!(body, RecordBody::Gap { .. }));
        connection.take_local_record(*next, body).await?;
        *next += 1;
        sync_at.get_or_insert_with(|| Instant::now() + self.feeds.0.settings.ack());
        Ok(())
    }

    /// Makes a session of the frames that arrived. If that is impossible because the service shuts down, it is done at
    /// its next start.
    async fn end(self, early: Option<EarlyEnd>) -> Result<SessionId, CloseReason> {
        let Some(PushedRecording { mut connection, next, gaps, arrival, .. }) = self.recording else {
            return Err(CloseReason::new(CloseCode::OutOfPlace, "no frame arrived"));
        };
        if gaps > 0 {
            tracing::warn!(gaps, "frames of a pushed stream left out: damaged, too large or out of order");
        }
        if let Some(arrival) = arrival.arrival()
            && let Err(error) = self.feeds.0.store.feeds().note_arrival(connection.recording(), arrival).await
        {
            tracing::warn!(%error, "the arrival of a pushed stream could not be noted"); // the recording counts for more
        }
        match connection.end(next, early).await? {
            ServerMessage::Ended { session, .. } => Ok(session),
            _ => Err(CloseReason::new(CloseCode::Failed, "frames that had arrived are missing")),
        }
    }
}
