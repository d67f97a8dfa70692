//! The end of a feed: its log becomes a recording, the recording a session like any other.

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

/// Attempts to put a recording together before it is left for somebody to look at.
const MOST_FAILURES: u32 = 3;
/// What a recording may be longer than its log: tables of frames.
const TABLES_BYTES: u64 = 64 << 20;

/// Who ends a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ending {
    /// Its sender, of this epoch, says that it has so many frames.
    Told { epoch: u32, frames: u64 },
    /// Nobody sends it any more, and nothing was heard of it since then, by the time that has passed.
    Abandoned { since_ms: i64 },
}

/// What became of a recording that was to be ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Finished {
    /// It is whole, and this session.
    Whole(SessionId),
    /// These frames have not come.
    Missing(Vec<[u64; 2]>),
    /// Somebody sends it after all.
    GoesOn,
}

impl Feeds {
    /// Makes a recording of all that came, and a session of it. Again gives the same session. From the look at what has
    /// come to the end of the log nobody can add to it.
    pub(super) async fn finish(&self, feed: &Arc<Feed>, ending: Ending) -> Result<Finished, Farewell> {
        let mut state = feed.state.lock().await;
        if let Some(session) = state.ended {
            return Ok(Finished::Whole(session));
        }
        if feed.is_gone.load(Ordering::Acquire) {
            return Err(Farewell::new(Code::Unknown, "the session was erased"));
        }
        if feed.failures.load(Ordering::Acquire) >= MOST_FAILURES {
            let why = "the recording could not be put together, again and again: ask whoever runs the service";
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
        // Asked before anything ends: no attempt is counted, and it works again once there is space.
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
                tracing::warn!(feed = %feed.row.id, why = problem.detail, "nothing is kept of a feed");
                self.forget(feed, ending).await?;
                return Err(Farewell::new(Code::DoesNotBelong, problem.detail));
            }
            Err(Failure::Stopped) => return Err(Farewell::new(Code::Ending, "the service ends; come again")),
            Err(Failure::Explained(Problem { detail: why, .. }) | Failure::Crashed(why)) => {
                let failures = feed.failures.fetch_add(1, Ordering::AcqRel) + 1;
                tracing::error!(feed = %feed.row.id, failures, why, "a recording could not be put together");
                return Err(Farewell::new(Code::Failed, format!("the recording could not be put together: {why}")));
            }
        };
        let session = self.0.store.feeds().end(feed.row.id, kept.blob(), live).await.map_err(LiveError::from)?;
        drop(kept); // only now does a row protect the file
        state.ended = Some(session);
        self.close(feed).await;
        self.0.vault.delete_feed(feed.row.id).await.map_err(LiveError::from)?;
        self.tell(session, feed.row.trainee_id, SessionStatus::Queued);
        self.0.queue.work_arrived();
        Ok(session)
    }

    /// Ends a recording that nobody sends any more with what came.
    pub(super) async fn end_abandoned(&self, feed: &Arc<Feed>, since_ms: i64) -> Result<(), LiveError> {
        match self.finish(feed, Ending::Abandoned { since_ms }).await {
            Ok(Finished::Whole(_)) => {
                tracing::info!(feed = %feed.row.id, "nobody ended a recording: it ends with what came");
                Ok(())
            }
            Ok(Finished::Missing(_) | Finished::GoesOn) => Ok(()),
            Err(farewell) if farewell.code == Code::DoesNotBelong => Ok(()), // forgotten or given up, and said so
            Err(farewell) => Err(farewell.into()),
        }
    }

    /// Forgets a recording of which nothing can be shown. A sender that was only away may begin it anew.
    async fn forget(&self, feed: &Arc<Feed>, ending: Ending) -> Result<(), Farewell> {
        let _door = self.0.open.door(feed.row.id).await;
        feed.is_gone.store(true, Ordering::Release);
        let may_come_again = matches!(ending, Ending::Abandoned { .. });
        self.0.store.feeds().forget(feed.row.id, may_come_again).await.map_err(LiveError::from)?;
        self.close(feed).await;
        self.0.vault.delete_feed(feed.row.id).await.map_err(|error| LiveError::from(error).into())
    }

    /// The recording, put together by a child.
    async fn assemble(&self, feed: &Feed) -> Result<Kept, Failure> {
        let lost = |error: VaultError| Failure::Crashed(format!("met {error}"));
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
            Some([frames, left_out]) => tracing::info!(feed = %feed.row.id, frames, left_out, "a recording is whole"),
            None => return Err(Failure::Crashed("said nothing of the recording".to_owned())),
        }
        made.keep().await.map_err(lost)
    }
}

/// `None` where a recording of so many frames is there whole.
fn all_has_come(feed: &Feed, state: &State, epoch: u32, frames: u64) -> Result<Option<Finished>, Farewell> {
    if *feed.epoch.borrow() != epoch {
        return Err(Farewell::new(Code::Superseded, "another connection sends this recording now"));
    }
    let end = state.numbers.end();
    if frames < end || !is_end(frames) {
        let why = format!("the recording is said to have {frames} frames, but frame {} came", end.saturating_sub(1));
        return Err(Farewell::new(Code::DoesNotBelong, why));
    }
    let missing = state.numbers.missing_below(frames);
    Ok(if missing.is_empty() { None } else { Some(Finished::Missing(missing)) })
}
