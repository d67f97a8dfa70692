//! The end of a feed: its log becomes a recording, and the recording becomes a normal session.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::{
    CloseCode, CloseReason, FeedPhase, FeedService, FeedState, LiveError, OpenFeed, ReceivedRecords, is_valid_end,
    reason_of_vault_error,
};
use crate::analysis::protocol::{AssembleWork, ChildRequest, ChildWork};
use crate::analysis::{AttemptFailure, ChildAttempt, run_attempt};
use crate::domain::feed::early_end::{EarlyEnd, EarlyEndCause};
use crate::domain::problem::Problem;
use crate::domain::session::{LiveFeature, SessionStatus};
use crate::ids::{SessionId, TraineeId};
use crate::sandbox::{Budget, StopSwitch};
use crate::store::FeedRow;
use crate::vault::{PinnedBlob, VaultError};

/// Attempts to assemble a recording before it needs an administrator.
const MAX_FAILURES: u32 = 3;
/// Why a recording ended early, for people.
const CONSENT_ENDED: &str = "the trainee decided against recordings";
/// How much longer than its log a recording may be: tables of frames.
const MAX_TABLE_BYTES: u64 = 64 << 20;

/// Why a recording is to be ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum EndTrigger {
    /// Its sender, with this epoch, reports that it has this many frames, and why it ends early, if it does.
    Requested { epoch: u32, frames: u64, early: Option<EarlyEnd> },
    /// The trainee decided against recordings: it ends also while it is being sent.
    ConsentEnded,
    /// It has no sender, and there was no contact since then (monotonic time).
    Abandoned { since_ms: i64, cause: EarlyEndCause },
}

impl EndTrigger {
    /// Why the recording ends early; `None` if its sender meant it to end.
    fn early_end(self) -> Option<EarlyEnd> {
        match self {
            Self::Requested { early, .. } => early,
            Self::ConsentEnded => Some(EarlyEnd::of(EarlyEndCause::ByPerson).with(CONSENT_ENDED)),
            Self::Abandoned { cause, .. } => Some(EarlyEnd::of(cause)),
        }
    }
}

/// The result of ending a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum FinishOutcome {
    /// It is complete and is this session.
    Complete(SessionId),
    /// These frames are missing.
    Missing(Vec<[u64; 2]>),
    /// A sender has connected again.
    StillSending,
}

impl FeedService {
    /// Assembles a recording from all frames that arrived and makes a session of it. A repeated call returns the same
    /// session. The state stays locked from the check for missing frames to the end of the log, so no frame can be
    /// added meanwhile.
    pub(super) async fn finish(&self, feed: &Arc<OpenFeed>, ending: EndTrigger) -> Result<FinishOutcome, CloseReason> {
        let mut state = feed.state.lock().await;
        let records = match &mut *state {
            FeedState::Receiving(records) => records,
            FeedState::Ended(session) => return Ok(FinishOutcome::Complete(*session)),
        };
        if feed.phase() == FeedPhase::Removed {
            return Err(CloseReason::new(CloseCode::Unknown, "the session was erased"));
        }
        if feed.failures.load(Ordering::Acquire) >= MAX_FAILURES {
            let why =
                "the recording could not be assembled after several attempts: ask the administrator of the service";
            return Err(CloseReason::new(CloseCode::OutOfPlace, why));
        }
        let not_yet = match ending {
            EndTrigger::Requested { epoch, frames, .. } => check_complete(feed, records, epoch, frames)?,
            EndTrigger::ConsentEnded => None,
            EndTrigger::Abandoned { since_ms, .. } => {
                (!feed.is_abandoned(since_ms)).then_some(FinishOutcome::StillSending)
            }
        };
        if let Some(not_yet) = not_yet {
            return Ok(not_yet);
        }
        if let Err(error) = records.log.sync().await {
            self.close_feed(feed).await;
            return Err(reason_of_vault_error(error));
        }
        feed.tracking.bytes_written(records.log.written());
        // Check the disk space before anything ends: no attempt is counted, and it works again once there is space.
        self.0.vault.require_space(records.log.bytes()).await.map_err(reason_of_vault_error)?;
        feed.set_phase(FeedPhase::Finishing);
        let live = feed.tracking.finish().await;
        let finished = self.store_recording(feed, &mut state, live, ending).await;
        feed.set_phase(FeedPhase::Open);
        finished.map(FinishOutcome::Complete)
    }

    async fn store_recording(
        &self,
        feed: &Arc<OpenFeed>,
        state: &mut FeedState,
        live: Option<Vec<LiveFeature>>,
        ending: EndTrigger,
    ) -> Result<SessionId, CloseReason> {
        let kept = match self.assemble(feed).await {
            Ok(kept) => kept,
            Err(AttemptFailure::Impossible(problem)) if problem.slug == Problem::NO_FRAMES => {
                tracing::warn!(feed = %feed.row.id, why = problem.detail, "recording discarded: no decodable frame");
                self.discard(feed, &ending).await?;
                return Err(CloseReason::new(CloseCode::OutOfPlace, problem.detail));
            }
            Err(AttemptFailure::Stopped) => {
                return Err(CloseReason::new(
                    CloseCode::ServiceStopping,
                    "the service is shutting down; connect again",
                ));
            }
            Err(
                AttemptFailure::Impossible(Problem { detail: why, .. })
                | AttemptFailure::Crashed(why)
                | AttemptFailure::TimedOut(why),
            ) => {
                let failures = feed.failures.fetch_add(1, Ordering::AcqRel) + 1;
                tracing::error!(feed = %feed.row.id, failures, why, "recording could not be assembled");
                return Err(CloseReason::new(
                    CloseCode::Failed,
                    format!("the recording could not be assembled: {why}"),
                ));
            }
        };
        // Only now: a sender that comes back after an interrupted attempt ends the recording in another way.
        let early = ending.early_end();
        let ended = self.0.store.feeds().end(feed.row.id, kept.blob(), live, early).await;
        let session = ended.map_err(LiveError::from)?;
        drop(kept); // from now on its row protects the file
        *state = FeedState::Ended(session);
        self.close_feed(feed).await;
        self.0.vault.delete_feed(feed.row.id).await.map_err(LiveError::from)?;
        self.publish_status(session, feed.row.trainee_id, SessionStatus::Queued);
        self.0.queue.work_arrived();
        Ok(session)
    }

    /// Ends a recording whose sender is gone, at a person's request, with the frames that arrived.
    ///
    /// # Errors
    /// It is being sent, has ended already, or has no frame that can be decoded: then it is deleted.
    pub async fn end_interrupted(&self, session: SessionId) -> Result<SessionId, CloseReason> {
        let row = self.0.store.feeds().of_session(session).await.map_err(LiveError::from)?;
        let row = row.ok_or_else(|| CloseReason::new(CloseCode::Done, "the recording has ended already"))?;
        let now_ms = self.0.clock.monotonic_ms() + 1; // later than any contact
        let known = self.0.open.all.lock().await.get(&row.id).cloned();
        let feed = match known {
            Some(feed) => feed,
            None => self
                .open_unheard(row.id, now_ms)
                .await?
                .ok_or_else(|| CloseReason::new(CloseCode::Done, "the recording has ended already"))?,
        };
        let (feeds, ending) =
            (self.clone(), EndTrigger::Abandoned { since_ms: now_ms, cause: EarlyEndCause::ByPerson });
        let ended = self.0.shutdown.spawn(async move { feeds.finish(&feed, ending).await });
        match ended.await.map_err(|panic| CloseReason::new(CloseCode::Failed, panic.to_string()))?? {
            FinishOutcome::Complete(session) => Ok(session),
            FinishOutcome::Missing(_) | FinishOutcome::StillSending => {
                Err(CloseReason::new(CloseCode::Busy, "the box is sending this recording: stop it there"))
            }
        }
    }

    /// Ends the recordings of a trainee who decided against recordings, with the frames that arrived, also while they are
    /// being sent. One that cannot be ended now receives nothing more, and [`FeedService::maintain`] ends it.
    pub async fn end_recordings_of(&self, trainee: TraineeId) {
        let unfinished = match self.0.store.feeds().unfinished().await {
            Ok(rows) => rows,
            Err(error) => return tracing::error!(%error, %trainee, "recordings of a trainee without consent not ended"),
        };
        for row in unfinished.into_iter().filter(|row| row.trainee_id == trainee) {
            let id = row.id;
            if let Err(reason) = self.end_without_consent(row).await {
                tracing::warn!(feed = %id, why = reason.why, "recording without consent not ended; ended by upkeep later");
            }
        }
    }

    async fn end_without_consent(&self, row: FeedRow) -> Result<(), CloseReason> {
        let known = self.0.open.all.lock().await.get(&row.id).cloned();
        let feed = match known {
            Some(feed) => feed,
            None => match self.open_unheard(row.id, self.0.clock.monotonic_ms()).await? {
                Some(feed) => feed,
                None => return Ok(()), // it has ended meanwhile
            },
        };
        match self.finish(&feed, EndTrigger::ConsentEnded).await {
            Ok(_) => Ok(()),
            Err(reason) => {
                feed.epoch.send_replace(u32::MAX); // closes the connection that still sends it
                self.close_feed(&feed).await;
                Err(reason)
            }
        }
    }

    /// Ends an abandoned recording with the frames that arrived.
    pub(super) async fn end_abandoned(&self, feed: &Arc<OpenFeed>, since_ms: i64) -> Result<(), LiveError> {
        match self.finish(feed, EndTrigger::Abandoned { since_ms, cause: EarlyEndCause::SenderGone }).await {
            Ok(FinishOutcome::Complete(_)) => {
                tracing::info!(feed = %feed.row.id, "abandoned recording ended with the frames that arrived");
                Ok(())
            }
            Ok(FinishOutcome::Missing(_) | FinishOutcome::StillSending) => Ok(()),
            Err(reason) if reason.code == CloseCode::OutOfPlace => Ok(()), // discarded or given up, already logged
            Err(reason) => Err(reason.into()),
        }
    }

    /// Discards a recording without a decodable frame. A sender that was only disconnected may start it again.
    async fn discard(&self, feed: &Arc<OpenFeed>, ending: &EndTrigger) -> Result<(), CloseReason> {
        let _lock = self.0.open.lock_feed(feed.row.id).await;
        feed.set_phase(FeedPhase::Removed);
        let may_come_again = matches!(ending, EndTrigger::Abandoned { .. }); // one without consent does not come back
        self.0.store.feeds().forget(feed.row.id, may_come_again).await.map_err(LiveError::from)?;
        self.close_feed(feed).await;
        self.0.vault.delete_feed(feed.row.id).await.map_err(|error| LiveError::from(error).into())
    }

    /// Assembles the recording in a child.
    async fn assemble(&self, feed: &OpenFeed) -> Result<PinnedBlob, AttemptFailure> {
        let lost = |error: VaultError| AttemptFailure::Crashed(format!("hit an error: {error}"));
        let (log, bytes) = self.0.vault.read_feed(feed.row.id).await.map_err(lost)?;
        let made = self.0.vault.create_temporary_file().await.map_err(lost)?;
        let output = made.file().map_err(lost)?;
        let work =
            AssembleWork { codec: feed.row.codec, size: (feed.row.width, feed.row.height), time_base: feed.time_base };
        let request = ChildRequest { threads: 1, work: ChildWork::Assemble(work) };
        let budget = Budget { file_bytes: bytes + MAX_TABLE_BYTES, ..self.0.analysis.budget() };
        let program = self.0.program.clone();
        let stop = StopSwitch::new().map_err(|error| AttemptFailure::Crashed(error.to_string()))?;
        let stopping = stop.clone();
        let span = tracing::warn_span!("feed", feed = %feed.row.id);
        let mut child = tokio::task::spawn_blocking(move || {
            let inputs = vec![log, output];
            let what = ChildAttempt { program: &program, request, inputs, budget: &budget, stop: &stopping };
            span.in_scope(|| run_attempt(what, |_| ()).0)
        });
        let ended = tokio::select! {
            ended = &mut child => ended,
            () = self.0.shutdown.begun() => { stop.pull(); child.await }
        };
        let child_output = ended.map_err(|panic| AttemptFailure::Crashed(panic.to_string()))??;
        match child_output.assembled {
            Some([frames, left_out]) => tracing::info!(feed = %feed.row.id, frames, left_out, "recording assembled"),
            None => return Err(AttemptFailure::Crashed("sent no result for the recording".to_owned())),
        }
        made.keep().await.map_err(lost)
    }
}

/// Returns `None` if a recording of this many frames is complete.
fn check_complete(
    feed: &OpenFeed,
    records: &ReceivedRecords,
    epoch: u32,
    frames: u64,
) -> Result<Option<FinishOutcome>, CloseReason> {
    if *feed.epoch.borrow() != epoch {
        return Err(CloseReason::new(CloseCode::Superseded, "another connection sends this recording now"));
    }
    let end = records.numbers.end();
    if frames < end || !is_valid_end(frames) {
        let why = format!("the end message announces {frames} frames, but frame {} arrived", end.saturating_sub(1));
        return Err(CloseReason::new(CloseCode::OutOfPlace, why));
    }
    let missing = records.numbers.missing_below(frames);
    Ok(if missing.is_empty() { None } else { Some(FinishOutcome::Missing(missing)) })
}
