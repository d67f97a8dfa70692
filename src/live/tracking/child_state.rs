//! The state of a recording's child, behind one lock: its phase, its records and its place in the queue for slots.

use std::io::PipeWriter;

use super::arrived_frames::ArrivedFrames;
use super::child_input::{ChildInput, SentRecords};
use super::child_phase::ChildPhase;
use super::coverage::RecordCoverage;
use crate::domain::session::LiveFeature;
use crate::live::cpu_slots::SlotId;

/// The state of the child and of its input.
pub(super) struct ChildState {
    pub(super) phase: ChildPhase,
    pub(super) frames: ArrivedFrames,
    pub(super) sent: SentRecords,
    pub(super) slot: SlotState,
    pub(super) coverage: RecordCoverage,
    /// The features at the end of the recording: used again if the recording has to be ended again.
    pub(super) ended_with: Option<EndFeatures>,
}

/// The features at the end of a recording.
pub(super) struct EndFeatures {
    /// Number of frames at that time.
    pub(super) frames: usize,
    pub(super) features: Vec<LiveFeature>,
}

/// The child's state in the queue for slots.
#[derive(Default)]
pub(super) enum SlotState {
    /// Not in the queue: no record waits.
    #[default]
    Idle,
    /// Waiting in the queue.
    Queued,
    /// Holding this slot.
    Held(SlotId),
}

impl ChildState {
    /// For a new recording (`is_fresh`), or for one that already has frames.
    pub(super) fn new(is_fresh: bool) -> Self {
        Self {
            phase: ChildPhase::default(),
            frames: ArrivedFrames::default(),
            sent: SentRecords::default(),
            slot: SlotState::default(),
            coverage: RecordCoverage::Pending { is_fresh },
            ended_with: None,
        }
    }

    /// Connects a child and queues the frames since the last key frame for it.
    pub(super) fn attach(&mut self, pipe: PipeWriter) {
        self.sent.clear_in_flight();
        self.coverage.begin_child(self.frames.are_all_recent());
        let mut input = ChildInput::new(pipe);
        self.frames.recent().iter().for_each(|position| input.enqueue(*position));
        self.phase.attach(input, &mut self.sent);
    }

    /// Sends all waiting records to the child and closes its input.
    pub(super) fn close_input(&mut self) {
        self.phase.close(&mut self.sent);
    }

    /// The frames in this many bytes of the log can be read: they wait for the child's slot.
    pub(super) fn enqueue_written(&mut self, bytes: u64) {
        while let Some(position) = self.frames.next_written(bytes, self.coverage.is_pending()) {
            if let Some(input) = self.phase.input_mut() {
                input.enqueue(position);
            }
        }
    }

    /// Sends the records that have waited longest, at most `most` of them.
    pub(super) fn send_next(&mut self, most: usize, is_watched: bool) {
        if let Some(input) = self.phase.input_mut() {
            input.send_next(most, is_watched, &mut self.sent);
        }
    }

    /// Sends a heartbeat to a child that has nothing in flight.
    pub(super) fn send_heartbeat(&mut self) {
        if self.sent.in_flight() == 0
            && let Some(input) = self.phase.input_mut()
        {
            input.send_heartbeat();
        }
    }

    /// Releases its slot if it no longer needs it, and returns the slot.
    pub(super) fn release_slot(&mut self) -> Option<SlotId> {
        let SlotState::Held(slot) = self.slot else { return None };
        self.is_nearly_done().then(|| {
            self.slot = SlotState::Idle;
            slot
        })
    }

    /// Marks the child as queued if it needs a slot; returns true if the caller has to enqueue it.
    pub(super) fn queue_for_slot(&mut self) -> bool {
        let needs_slot = matches!(self.slot, SlotState::Idle) && self.queued() > 0;
        if needs_slot {
            self.slot = SlotState::Queued;
        }
        needs_slot
    }

    /// Number of records that wait for a slot.
    pub(super) fn queued(&self) -> usize {
        self.phase.input().map_or(0, ChildInput::queued)
    }

    /// Number of records that arrived and are not tracked yet; 0 without a child.
    pub(super) fn backlog(&self) -> usize {
        let waiting = self.phase.input().map_or(0, |input| input.queued() + self.frames.unwritten());
        self.sent.in_flight() + waiting
    }

    /// True if the next child may start. A child with a backlog is then at its last frame, so that no processor idles
    /// until the reply.
    fn is_nearly_done(&self) -> bool {
        self.sent.in_flight() <= usize::from(self.queued() > 0)
    }

    /// True if frames wait to be written for a child that runs or starts soon.
    pub(super) fn waits_for_log(&self) -> bool {
        self.frames.unwritten() > 0 && self.phase.expects_records()
    }
}
