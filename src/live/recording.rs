//! The end of a feed: its log becomes a recording, and the recording becomes a normal session.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::{Code, Farewell, Feed, Feeds, LiveError, State, failed, is_end};
use crate::analysis::protocol::{AssembleWork, Request, Work};
use crate::analysis::{Attempt, Failure, attempt};
use crate::domain::problem::Problem;
use crate::domain::session::{LiveFeature, SessionStatus};
use crate::ids::SessionId;
use crate::sandbox::{Budget, Stop};
use crate::vault::{Kept, VaultError};

/// Attempts to assemble a recording before it needs an administrator.
const MOST_FAILURES: u32 = 3;
/// How much longer than its log a recording may be: tables of frames.
const TABLES_BYTES: u64 = 64 << 20;

/// Why a recording is to be ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ending {
    /// Its sender, with this epoch, reports that it has this many frames.
    Told { epoch: u32, frames: u64 },
    /// It has no sender, and there was no contact since then (monotonic time).
    Abandoned { since_ms: i64 },
}

/// The result of ending a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Finished {
    /// It is complete and is this session.
    Whole(SessionId),
    /// These frames are missing.
    Missing(Vec<[u64; 2]>),
    /// A sender has connected again.
    GoesOn,
}

impl Feeds {
    /// Assembles a recording from all frames that arrived and makes a session of it. A repeated call returns the same
    /// session. The state stays locked from the check for missing frames to the end of the log, so no frame can be
    /// added meanwhile.
    pub(super) async fn finish(&self, feed: &Arc<Feed>, ending: Ending) -> Result<Finished, Farewell> {
        let mut state = feed.state.lock().await;
        if let Some(session) = state.ended {
            return Ok(Finished::Whole(session));
        }
        if feed.is_gone.load(Ordering::Acquire) {
            return Err(Farewell::new(Code::Unknown, "the session was erased"));
        }
        if feed.failures.load(Ordering::Acquire) >= MOST_FAILURES {
            let why =
                "the recording could not be assembled after several attempts: ask the administrator of the service";
            return Err(Farewell::new(Code::DoesNotBelong, why));
        }
        let not_yet = match ending {
            Ending::Told { epoch, frames } => all_has_come(feed, &state, epoch, frames)?,
            Ending::Abandoned { since_ms } => (!feed.is_abandoned(since_ms)).then_some(Finished::GoesOn),
        };
        if let Some(not_yet) = not_yet {
            return Ok(not_yet);
        }
        if let Err(error) = state.log.sync().await {
            self.close(feed).await;
            return Err(failed(error));
        }
        feed.follower.wrote(state.log.written());
        // Check the disk space before anything ends: no attempt is counted, and it works again once there is space.
        self.0.vault.has_room(state.log.bytes()).await.map_err(failed)?;
        feed.is_finishing.store(true, Ordering::Release);
        let live = feed.follower.end().await;
        let finished = self.store_recording(feed, &mut state, live, ending).await;
        feed.is_finishing.store(false, Ordering::Release);
        finished.map(Finished::Whole)
    }

    async fn store_recording(
        &self,
        feed: &Arc<Feed>,
        state: &mut State,
        live: Option<Vec<LiveFeature>>,
        ending: Ending,
    ) -> Result<SessionId, Farewell> {
        let kept = match self.assemble(feed).await {
            Ok(kept) => kept,
            Err(Failure::Explained(problem)) if problem.slug == Problem::NO_FRAMES => {
                tracing::warn!(feed = %feed.row.id, why = problem.detail, "recording discarded: no decodable frame");
                self.forget(feed, ending).await?;
                return Err(Farewell::new(Code::DoesNotBelong, problem.detail));
            }
            Err(Failure::Stopped) => {
                return Err(Farewell::new(Code::Ending, "the service is shutting down; connect again"));
            }
            Err(Failure::Explained(Problem { detail: why, .. }) | Failure::Crashed(why)) => {
                let failures = feed.failures.fetch_add(1, Ordering::AcqRel) + 1;
                tracing::error!(feed = %feed.row.id, failures, why, "recording could not be assembled");
                return Err(Farewell::new(Code::Failed, format!("the recording could not be assembled: {why}")));
            }
        };
        let session = self.0.store.feeds().end(feed.row.id, kept.blob(), live).await.map_err(LiveError::from)?;
        drop(kept); // from now on its row protects the file
        state.ended = Some(session);
        self.close(feed).await;
        self.0.vault.delete_feed(feed.row.id).await.map_err(LiveError::from)?;
        self.tell(session, feed.row.trainee_id, SessionStatus::Queued);
        self.0.queue.work_arrived();
        Ok(session)
    }

    /// Ends an abandoned recording with the frames that arrived.
    pub(super) async fn end_abandoned(&self, feed: &Arc<Feed>, since_ms: i64) -> Result<(), LiveError> {
        match self.finish(feed, Ending::Abandoned { since_ms }).await {
            Ok(Finished::Whole(_)) => {
                tracing::info!(feed = %feed.row.id, "abandoned recording ended with the frames that arrived");
                Ok(())
            }
            Ok(Finished::Missing(_) | Finished::GoesOn) => Ok(()),
            Err(reason) if reason.code == Code::DoesNotBelong => Ok(()), // discarded or given up, already logged
            Err(reason) => Err(reason.into()),
        }
    }

    /// Discards a recording without a decodable frame. A sender that was only disconnected may start it again.
    async fn forget(&self, feed: &Arc<Feed>, ending: Ending) -> Result<(), Farewell> {
        let _lock = self.0.open.door(feed.row.id).await;
        feed.is_gone.store(true, Ordering::Release);
        let may_come_again = matches!(ending, Ending::Abandoned { .. });
        self.0.store.feeds().forget(feed.row.id, may_come_again).await.map_err(LiveError::from)?;
        self.close(feed).await;
        self.0.vault.delete_feed(feed.row.id).await.map_err(|error| LiveError::from(error).into())
    }

    /// Assembles the recording in a child.
    async fn assemble(&self, feed: &Feed) -> Result<Kept, Failure> {
        let lost = |error: VaultError| Failure::Crashed(format!("hit an error: {error}"));
        let (log, bytes) = self.0.vault.read_feed(feed.row.id).await.map_err(lost)?;
        let made = self.0.vault.make_file().await.map_err(lost)?;
        let output = made.file().map_err(lost)?;
        let work =
            AssembleWork { codec: feed.row.codec, size: (feed.row.width, feed.row.height), time_base: feed.time_base };
        let request = Request { threads: 1, work: Work::Assemble(work) };
        let budget = Budget { file_bytes: bytes + TABLES_BYTES, ..self.0.analysis.budget() };
        let program = self.0.program.clone();
        let stop = Stop::new().map_err(|error| Failure::Crashed(error.to_string()))?;
        let stopping = stop.clone();
        let mut child = tokio::task::spawn_blocking(move || {
            let inputs = vec![log, output];
            attempt(Attempt { program: &program, request, inputs, budget: &budget, stop: &stopping }, |_| ()).0
        });
        let ended = tokio::select! {
            ended = &mut child => ended,
            () = self.0.shutdown.begun() => { stop.pull(); child.await }
        };
        let heard = ended.map_err(|panic| Failure::Crashed(panic.to_string()))??;
        match heard.assembled {
            Some([frames, left_out]) => tracing::info!(feed = %feed.row.id, frames, left_out, "recording assembled"),
            None => return Err(Failure::Crashed("sent no result for the recording".to_owned())),
        }
        made.keep().await.map_err(lost)
    }
}

/// Returns `None` if a recording of this many frames is complete.
fn all_has_come(feed: &Feed, state: &State, epoch: u32, frames: u64) -> Result<Option<Finished>, Farewell> {
    if *feed.epoch.borrow() != epoch {
        return Err(Farewell::new(Code::Superseded, "another connection sends this recording now"));
    }
    let end = state.numbers.end();
    if frames < end || !is_end(frames) {
        let why = format!("the end message announces {frames} frames, but frame {} arrived", end.saturating_sub(1));
        return Err(Farewell::new(Code::DoesNotBelong, why));
    }
    let missing = state.numbers.missing_below(frames);
    Ok(if missing.is_empty() { None } else { Some(Finished::Missing(missing)) })
}
