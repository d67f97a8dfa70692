//! Orders to score sessions again, worked off in small batches behind everything else.
//!
//! ```text
//! order ─▶ items wait ──feed──▶ jobs (at most so many, turn 2) ──▶ new results, beside the old ones
//!                                  └─ ended ──settle──▶ old and new compared, the item done ──▶ report
//! ```
//! An order of ten thousand sessions thus never has more than [`RescoringSettings::open`] jobs in the queue, and each of them lets
//! new sessions go first. Whatever ends in between, the next look goes on from the rows.

pub mod compare;

use std::time::Duration;

use serde::Deserialize;

use crate::domain::problem::Problem;
use crate::domain::rescoring::Change;
use crate::domain::scope::Scope;
use crate::queue::Queue;
use crate::shutdown::Shutdown;
use crate::store::{Compared, EndedItem, Store, StoreError, StoreResult};
use crate::time::SharedClock;

/// Items that are settled at a time: two results of each are read.
const AT_A_TIME: u32 = 16;

/// Limits of rescoring.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RescoringSettings {
    /// Jobs of rescorings in the queue at a time, of all orders. More keep more workers busy; each may be under way when a new session
    /// comes. Usually 16.
    pub open: u32,
    /// How often orders are looked after, ms. Usually 1000.
    pub look_ms: u64,
}

impl Default for RescoringSettings {
    fn default() -> Self {
        Self { open: 16, look_ms: 1_000 }
    }
}

/// Looks after all orders until the service ends.
pub async fn keep(store: &Store, queue: &Queue, settings: &RescoringSettings, clock: SharedClock, ending: &Shutdown) {
    while !ending.is_begun() {
        match look(store, settings.open).await {
            Ok(0) => {}
            Ok(_) => queue.work_arrived(),
            Err(error) => tracing::warn!(%error, "looking after rescorings"),
        }
        tokio::select! {
            () = ending.begun() => {}
            () = clock.sleep(Duration::from_millis(settings.look_ms.max(1))) => {}
        }
    }
}

/// Settles what has ended and queues what fits; how many were queued.
pub async fn look(store: &Store, open: u32) -> StoreResult<usize> {
    loop {
        let ended = store.rescorings().ended(AT_A_TIME).await?;
        if ended.is_empty() {
            break;
        }
        for item in ended {
            settle(store, item).await?;
        }
    }
    let queued = store.rescorings().feed(open).await?;
    store.rescorings().close().await?;
    Ok(queued)
}

async fn settle(store: &Store, item: EndedItem) -> StoreResult<()> {
    match &item.new_result {
        Ok(_) => match compared(store, &item).await {
            Ok(compared) => store.rescorings().settle(&item, compared).await,
            Err(StoreError::NotFound { .. }) => Ok(()), // erased with its session meanwhile, and the item with it
            // One damaged row must not hold up everybody's orders; a store that does not answer at all is asked again.
            Err(error) if error.is_unreadable() => {
                tracing::warn!(%error, session = %item.session, "comparing what a rescoring changed");
                store.rescorings().settle(&item, Err(not_compared())).await
            }
            Err(error) => Err(error),
        },
        Err(problem) => {
            let problem = problem.clone().unwrap_or_else(gone);
            store.rescorings().settle(&item, Err(problem)).await
        }
    }
}

/// What the program's update changed; an edit that came in between changes more than that.
async fn compared(store: &Store, item: &EndedItem) -> StoreResult<Result<Compared, Problem>> {
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
        [&old, &new].map(|result| standard.definition.judge(&result.features, &result.versions.pipeline, hand))
    });
    let apart = changes.iter().filter(|change| change.change == Change::Apart).count();
    Ok(Ok(Compared { new_result: new.id, judged, apart: apart as u64, changed: changes.len() as u64 }))
}

fn edited_meanwhile() -> Problem {
    let detail = "the new score stands, but somebody edited the session, or undid an edit, while the order was worked off, so \
                  that a difference need not be the program’s";
    Problem::new("edited-meanwhile", "It was edited meanwhile", detail)
}

fn not_compared() -> Problem {
    let detail = "the new score stands, but one of the two results cannot be read, so that nobody can say what changed; \
                  the service’s log says which";
    Problem::new("not-compared", "It could not be compared", detail)
}

fn gone() -> Problem {
    let detail = "its box has lost its camera or its colours, or the work was taken out of the queue; order the rescoring once more \
                  when the box is ready";
    Problem::new("not-queued", "It could not be worked on", detail)
}
