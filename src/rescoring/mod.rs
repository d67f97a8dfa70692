//! Executes rescoring orders in small batches, at the lowest priority.
//!
//! ```text
//! order ─▶ items wait ──queue──▶ jobs (bounded, lowest priority) ──▶ new results, beside the old ones
//!                                  └─ ended ──settle──▶ compare old and new, item done ──▶ report
//! ```
//! An order of ten thousand sessions never has more than [`RescoringSettings::open`] jobs in the queue, and new
//! sessions go before each of them. After an interruption the next round continues from the rows.

pub mod compare;

use std::time::Duration;

use serde::Deserialize;

use crate::domain::problem::Problem;
use crate::domain::rescoring::FeatureChangeKind;
use crate::domain::scope::Scope;
use crate::queue::Queue;
use crate::shutdown::Shutdown;
use crate::store::{EndedItem, ResultComparison, Store, StoreError, StoreResult};
use crate::time::SharedClock;

/// Number of items to settle at a time: two results are read for each.
const SETTLE_BATCH: u32 = 16;

/// Limits of rescoring.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RescoringSettings {
    /// Maximum number of rescoring jobs in the queue, of all orders. More keep more workers busy; each may be running
    /// when a new session arrives. Usually 16.
    pub open: u32,
    /// Time between rounds of working on the orders, ms. Usually 1000.
    pub look_ms: u64,
}

impl Default for RescoringSettings {
    fn default() -> Self {
        Self { open: 16, look_ms: 1_000 }
    }
}

/// Works on all orders until the service ends.
pub async fn run(store: &Store, queue: &Queue, settings: &RescoringSettings, clock: SharedClock, ending: &Shutdown) {
    while !ending.is_begun() {
        match run_once(store, settings.open).await {
            Ok(0) => {}
            Ok(_) => queue.work_arrived(),
            Err(error) => tracing::warn!(%error, "working on rescoring orders failed; retrying in the next round"),
        }
        tokio::select! {
            () = ending.begun() => {}
            () = clock.sleep(Duration::from_millis(settings.look_ms.max(1))) => {}
        }
    }
}

/// Settles ended items and queues jobs up to the limit; returns how many were queued.
pub async fn run_once(store: &Store, open: u32) -> StoreResult<usize> {
    loop {
        let ended = store.rescorings().ended(SETTLE_BATCH).await?;
        if ended.is_empty() {
            break;
        }
        for item in ended {
            settle(store, item).await?;
        }
    }
    let queued = store.rescorings().queue_waiting(open).await?;
    store.rescorings().end_completed().await?;
    Ok(queued)
}

async fn settle(store: &Store, item: EndedItem) -> StoreResult<()> {
    match &item.new_result {
        Ok(_) => match compare_results(store, &item).await {
            Ok(compared) => store.rescorings().settle(&item, compared).await,
            Err(StoreError::NotFound { .. }) => Ok(()), // the session was erased meanwhile, and its item with it
            // One damaged row must not block all orders. Other errors of the store are retried.
            Err(error) if error.is_unreadable() => {
                tracing::warn!(
                    %error, session = %item.session,
                    "results not comparable; rescoring item marked as failed"
                );
                store.rescorings().settle(&item, Err(not_compared())).await
            }
            Err(error) => Err(error),
        },
        Err(problem) => {
            let problem = problem.clone().unwrap_or_else(job_gone);
            store.rescorings().settle(&item, Err(problem)).await
        }
    }
}

/// The changes due to the new version of the program. An edit in between would change more than that.
async fn compare_results(store: &Store, item: &EndedItem) -> StoreResult<Result<ResultComparison, Problem>> {
    let (service, session) = (Scope::service(), item.session);
    let new = item.new_result.as_ref().copied().unwrap_or(item.old_result);
    let hand = store.sessions().get(&service, session).await?.trainee_handedness;
    let old = store.sessions().result_of(&service, session, item.old_result).await?;
    let new = store.sessions().result_of(&service, session, new).await?;
    if old.edits != new.edits {
        return Ok(Err(edited_meanwhile()));
    }
    let changes = compare::changes(&old.features, &new.features);
    let standard = match item.standard {
        Some(id) => Some(store.standards().get(&service, id).await?),
        None => None,
    };
    let judged = standard.map(|standard| {
        [&old, &new].map(|result| {
            let definition = standard.definition.in_session(&result.hands, hand);
            definition.judge(&result.features, &result.versions.pipeline, hand)
        })
    });
    let apart = changes.iter().filter(|change| change.change == FeatureChangeKind::Apart).count();
    Ok(Ok(ResultComparison { new_result: new.id, judged, apart: apart as u64, changed: changes.len() as u64 }))
}

fn edited_meanwhile() -> Problem {
    let detail = "the new score is valid, but the session was edited during the rescoring, so differences may come \
                  from the edit instead of the program";
    Problem::new("edited-meanwhile", "The session was edited meanwhile", detail)
}

fn not_compared() -> Problem {
    let detail = "the new score is valid, but the old or the new result cannot be read, so the changes are unknown; \
                  the log of the service names the session";
    Problem::new("not-compared", "The results could not be compared", detail)
}

fn job_gone() -> Problem {
    let detail = "its box has no camera or no colours any more, or the job was removed from the queue; order the \
                  rescoring again when the box is ready";
    Problem::new("not-queued", "The session could not be scored again", detail)
}
