//! Runs the children of a recording one after the other, and gives up after too many crashes until the next connection.

use std::fs::File;
use std::io::pipe;
use std::os::fd::OwnedFd;
use std::time::Duration;

use metrics::counter;
use tokio::time::{MissedTickBehavior, interval};

use super::{TrackingState, TrackingSupervisor};
use crate::analysis::protocol::{ChildRequest, ChildWork, FollowWork};
use crate::analysis::{self, AttemptFailure, ChildAttempt, LivePlan, run_attempt};
use crate::domain::feed::TimeBase;
use crate::domain::problem::Problem;
use crate::live::{FeedService, cpu_slots};
use crate::sandbox::{Budget, StopSwitch};
use crate::store;

/// Crashes after which live tracking is given up. The next connection of the sender starts the count at zero.
const MAX_CRASHES: u32 = 3;

/// A child that receives nothing for this long gets a heartbeat to answer.
const HEARTBEAT_INTERVAL: Duration = Duration::from_secs(10);

/// Longest life and CPU time of a child: a recording of four hours, and as much again for outages of its sender.
const MAX_CHILD_TIME: Duration = Duration::from_secs(8 * 3600);

/// Most output of a child for four hours: positions, and a picture whenever one is requested.
const MAX_OUTPUT_BYTES: u64 = 64 << 30;

impl TrackingSupervisor {
    /// Runs children until one finishes normally, or returns why none can run.
    pub(super) async fn run_children(
        &self,
        feeds: &FeedService,
        row: &store::FeedRow,
        time_base: TimeBase,
    ) -> Result<(), TrackingState> {
        for _ in 0..MAX_CRASHES {
            match self.run_child(feeds, row, time_base).await {
                Ok(()) | Err(AttemptFailure::Stopped) => return Ok(()),
                Err(AttemptFailure::Impossible(problem)) if problem.slug == Problem::SIZE_CHANGES => {
                    return Err(TrackingState::Refused(problem.detail));
                }
                Err(AttemptFailure::Impossible(problem)) => return Err(TrackingState::Unavailable(problem.detail)),
                Err(AttemptFailure::Crashed(why) | AttemptFailure::TimedOut(why)) => {
                    tracing::warn!(feed = %row.id, why, "live tracking child failed");
                }
            }
            counter!("trocar_feed_followers_died_total").increment(1);
        }
        Err(TrackingState::Unavailable("the process that tracks it crashed several times".to_owned()))
    }

    async fn run_child(
        &self,
        feeds: &FeedService,
        row: &store::FeedRow,
        time_base: TimeBase,
    ) -> Result<(), AttemptFailure> {
        let lost = |error: &dyn std::fmt::Display| AttemptFailure::Crashed(format!("hit an error: {error}"));
        let track = analysis::live_plan(row.box_id, &feeds.0.store).await.map_err(|why| lost(&why))?;
        let LivePlan { track, ports, empty_box } = track.map_err(AttemptFailure::Impossible)?;
        let tools = track.tools.iter().map(|tool| tool.name.clone()).collect();
        let work = FollowWork { track, codec: row.codec, size: (row.width, row.height), time_base, ports };
        let request = ChildRequest { threads: 1, work: ChildWork::Follow(work) };
        let (log, _) = feeds.0.vault.read_feed(row.id).await.map_err(|error| lost(&error))?;
        let (theirs, ours) = pipe().map_err(|error| lost(&error))?;
        let mut inputs = vec![log, File::from(OwnedFd::from(theirs))];
        if let Some(picture) = empty_box {
            let opened = analysis::open_empty_box(picture, &feeds.0.vault).await;
            inputs.extend(opened.map_err(|error| lost(&error))?);
        }
        let budget = Budget {
            cpu: MAX_CHILD_TIME,
            slice: Budget::SHORT_SLICE,
            wall: MAX_CHILD_TIME,
            output_bytes: MAX_OUTPUT_BYTES,
            ..feeds.0.analysis.budget()
        };
        let stop = FeedStopGuard(StopSwitch::new().map_err(|error| lost(&error))?);
        let (program, stopping, follower) = (feeds.0.program.clone(), stop.0.clone(), self.clone());
        self.attach_child(ours);
        self.0.state.send_replace(TrackingState::Tracking(tools));
        let span = tracing::warn_span!("feed", feed = %row.id);
        let mut child = tokio::task::spawn_blocking(move || {
            let what = ChildAttempt { program: &program, request, inputs, budget: &budget, stop: &stopping };
            let on_event = |event| {
                if let analysis::ChildEvent::Followed(followed) = event {
                    follower.handle_reply(followed);
                }
            };
            span.in_scope(|| run_attempt(what, on_event).0)
        });
        let mut beat = interval(HEARTBEAT_INTERVAL);
        let mut look = interval(cpu_slots::MAX_SLOT_TIME);
        look.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let ended = loop {
            tokio::select! {
                ended = &mut child => break ended,
                () = feeds.0.shutdown.begun() => { stop.0.pull(); break child.await }
                _ = beat.tick() => self.child().send_heartbeat(),
                _ = look.tick() => self.0.slots.start_next(),
            }
        };
        self.stop();
        ended.map_err(|panic| AttemptFailure::Crashed(panic.to_string()))?.map(drop)
    }
}

/// Stops a child when its task is dropped.
pub(in crate::live) struct FeedStopGuard(pub(in crate::live) StopSwitch);

impl Drop for FeedStopGuard {
    fn drop(&mut self) {
        self.0.pull();
    }
}
