//! The child that splits a pushed stream into frames, and the copying of the body into its pipe.

use std::fs::File;
use std::io::pipe;
use std::os::fd::OwnedFd;
use std::time::Duration;

use bytes::Bytes;
use futures_util::{Stream, StreamExt};
use metrics::counter;
use tokio::io::AsyncWriteExt;
use tokio::net::unix::pipe::Sender;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::{BoxError, PushError};
use crate::analysis::protocol::{ChildRequest, ChildWork, DemuxWork};
use crate::analysis::{AttemptFailure, ChildAttempt, ChildEvent, ChildOutput, run_attempt};
use crate::domain::feed::MAX_DURATION_S;
use crate::domain::feed::close_reason::{CloseCode, CloseReason};
use crate::live::FeedService;
use crate::live::tracking::FeedStopGuard;
use crate::sandbox::{Budget, StopSwitch};

/// Frames that may wait for the log.
const MAX_WAITING_FRAMES: usize = 2;
/// Extra life of the child beyond the longest recording: it starts before the recording and ends after it.
const LIFE_MARGIN: Duration = Duration::from_secs(300);
/// Extra silence of the child beyond the sender's: it can only report after its sender.
const SILENCE_MARGIN: Duration = Duration::from_secs(20);

/// A child that splits a stream into frames; dropping it stops the child.
pub(super) struct Demuxer {
    pub(super) events: mpsc::Receiver<ChildEvent>,
    pub(super) ended: JoinHandle<Result<ChildOutput, AttemptFailure>>,
    _stop: FeedStopGuard,
}

impl FeedService {
    /// Starts a child; returns it with the write end of its pipe.
    pub(super) fn start_demuxer(&self) -> std::io::Result<(Demuxer, Sender)> {
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
        let asked_by = tracing::Span::current();
        let ended = tokio::task::spawn_blocking(move || {
            let request = ChildRequest { threads: 1, work: ChildWork::Demux(DemuxWork) };
            let what = ChildAttempt { program: &program, request, inputs, budget: &budget, stop: &stopping };
            // A failed send means that the receiver is dropped and the child is being stopped.
            asked_by.in_scope(|| run_attempt(what, |event| drop(sender.blocking_send(event))).0)
        });
        Ok((Demuxer { events: news, ended, _stop: stop }, ours))
    }
}

/// Copies a body into a child's pipe and closes it at the end. Only the time spent waiting for the body counts as
/// silence.
pub(super) async fn copy_body<B>(mut body: B, mut pipe: Sender, silent: Duration) -> Result<(), PushError>
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

pub(super) fn push_error(failure: AttemptFailure) -> PushError {
    match failure {
        AttemptFailure::Impossible(problem) => PushError::Stream(problem),
        AttemptFailure::Stopped => CloseReason::service_stopping().into(),
        AttemptFailure::Crashed(why) | AttemptFailure::TimedOut(why) => reason_of_crash(&why).into(),
    }
}

pub(super) fn reason_of_crash(why: &dyn std::fmt::Display) -> CloseReason {
    counter!("trocar_feed_demuxers_died_total").increment(1);
    CloseReason::new(CloseCode::Failed, format!("the process that reads the stream {why}"))
}
