//! The end of a feed: its log becomes a recording, the recording a session like any other.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::{Code, Farewell, Feed, Feeds, LiveError};
use crate::analysis::protocol::{AssembleWork, Request, Work};
use crate::analysis::{Attempt, Failure, attempt};
use crate::domain::feed::record::{Body, GapReason, Record};
use crate::domain::session::SessionStatus;
use crate::ids::SessionId;
use crate::sandbox::{Budget, Stop};
use crate::store;
use crate::vault::{Kept, VaultError};

/// Attempts to put a recording together before it is left for somebody to look at.
const MOST_FAILURES: u32 = 3;
/// What a recording may be longer than its log: tables of frames.
const TABLES_BYTES: u64 = 64 << 20;

impl Feeds {
    /// Makes a recording of all that came, and a session of it. Again gives the same session.
    pub(super) async fn finish(&self, feed: &Arc<Feed>) -> Result<SessionId, Farewell> {
        let mut state = feed.state.lock().await;
        if let Some(session) = state.ended {
            return Ok(session);
        }
        let kept = match self.assemble(feed).await {
            Ok(kept) => kept,
            Err(Failure::Explained(problem)) => {
                tracing::warn!(feed = %feed.row.id, why = problem.detail, "nothing is kept of a feed");
                self.forget(feed).await?;
                return Err(Farewell::new(Code::DoesNotBelong, problem.detail));
            }
            Err(Failure::Stopped) => return Err(Farewell::new(Code::Ending, "the service ends; come again")),
            Err(Failure::Crashed(why)) => {
                let failures = feed.failures.fetch_add(1, Ordering::AcqRel) + 1;
                tracing::error!(feed = %feed.row.id, failures, why, "a recording could not be put together");
                return Err(Farewell::new(Code::Failed, format!("the recording could not be put together: it {why}")));
            }
        };
        let session = self.0.store.feeds().end(feed.row.id, kept.blob()).await.map_err(LiveError::from)?;
        drop(kept); // only now does a row protect the file
        state.ended = Some(session);
        self.0.open.0.lock().await.remove(&feed.row.id);
        self.0.vault.delete_feed(feed.row.id).await.map_err(LiveError::from)?;
        self.tell(session, feed.row.trainee_id, SessionStatus::Queued);
        self.0.queue.work_arrived();
        Ok(session)
    }

    /// Ends a recording that nobody sends any more with what came; what never came is noted.
    pub(super) async fn end_abandoned(&self, row: store::Feed) -> Result<(), LiveError> {
        let id = row.id;
        let feed = {
            let mut open = self.0.open.0.lock().await;
            match open.get(&id) {
                Some(feed) => feed.clone(),
                None => {
                    let feed = self.enter(row).await?;
                    open.insert(id, feed.clone());
                    feed
                }
            }
        };
        if feed.failures.load(Ordering::Acquire) >= MOST_FAILURES {
            return Ok(());
        }
        {
            let mut state = feed.state.lock().await;
            let epoch = *feed.epoch.borrow();
            let mut gaps = Vec::new();
            for [number, last] in state.numbers.missing_below(state.numbers.end()) {
                let body = Body::Gap { last, reason: GapReason::NeverCame };
                Record { epoch, number, body }.write(&mut gaps);
                state.numbers.add(number, last).map_err(|error| Farewell::new(Code::TooMuch, error.to_string()))?;
            }
            state.log.append(gaps.into()).await?;
            state.log.sync().await?;
        }
        tracing::info!(feed = %id, "nobody ended a recording: it ends with what came");
        match self.finish(&feed).await {
            Ok(_) => Ok(()),
            Err(farewell) if farewell.code == Code::DoesNotBelong => Ok(()), // forgotten, and said so
            Err(farewell) => Err(farewell.into()),
        }
    }

    async fn forget(&self, feed: &Feed) -> Result<(), Farewell> {
        feed.is_gone.store(true, Ordering::Release);
        self.0.store.feeds().forget(feed.row.id).await.map_err(LiveError::from)?;
        self.0.open.0.lock().await.remove(&feed.row.id);
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
