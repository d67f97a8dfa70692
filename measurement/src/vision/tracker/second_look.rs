//! A second look at a recording: tracks it again from its first frame, with what the first look has taught.
//!
//! A tool may be lost at the beginning because its edges are not known yet, because its tip is hidden, or because its
//! band is taken the wrong way round. At the end the tracker knows how its edges look, where its trocar is, and where
//! the hand is. **When** a tool was lost in view for more than [`MIN_LOST_SHARE`] of the frames. **Result** of each tool,
//! the look with more measurements; of two tools that share a colour, both from the same look, because their names
//! depend on each other. A live feed has no second look.

use super::measure::direction_in_picture;
use super::predict::Band;
use super::report::{Absence, FrameReport, Quality, ToolQuality, Tracking};
use super::tool::ToolTracker;
use super::{LightWatch, Tracker};
use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::pose::adjustment::Adjustment;
use crate::vision::reason::MissReason;

/// Share of a recording's frames on which a tool must be lost in view. Fewer cost sums such as a path's length less than
/// their usual error.
const MIN_LOST_SHARE: f64 = 0.02;

/// What a first look at a recording gives.
pub enum FirstLook {
    /// Its result.
    Enough(Tracking),
    /// A second look is likely to measure more.
    LookAgain(Box<SecondLook>),
}

/// A second look at a recording.
pub struct SecondLook {
    tracker: Tracker,
    first: Tracking,
}

impl Tracker {
    /// Ends the recording like [`Self::finish`], unless a second look at its frames is likely to measure more.
    pub fn finish_first_look(mut self) -> FirstLook {
        let first = self.conclude();
        if !is_worthwhile(&first.quality) {
            return FirstLook::Enough(first);
        }
        self.forget_past();
        self.light = LightWatch::default();
        self.last_samples.fill(None);
        for (i, tool) in self.tools.iter_mut().enumerate() {
            let shares_colour = self.pairs.iter().flatten().any(|of_pair| *of_pair == i);
            tool.start_second_look(&first.quality.tools[i], &self.settings.camera, shares_colour);
        }
        FirstLook::LookAgain(Box::new(SecondLook { tracker: self, first }))
    }
}

impl SecondLook {
    /// Tracks the next frame, from the first one of the recording.
    pub fn observe(&mut self, frame: &Frame<'_>) -> FrameReport {
        self.tracker.observe(frame)
    }

    /// Ends the recording. Also returns, for each tool, whether its path is the one of the second look.
    pub fn finish(mut self) -> (Tracking, Vec<bool>) {
        let second = self.tracker.conclude();
        let measured = |of: &Tracking, tool: usize| of.quality.tools[tool].observed;
        let is_better = |tools: &[usize]| {
            let [one, other] =
                [&self.first, &second].map(|of| tools.iter().map(|tool| measured(of, *tool)).sum::<u64>());
            other > one && second.frame_times_s == self.first.frame_times_s
        };
        let mut taken: Vec<bool> = (0..second.motions.len()).map(|tool| is_better(&[tool])).collect();
        for pair in &self.tracker.pairs {
            pair.iter().for_each(|tool| taken[*tool] = is_better(pair));
        }
        (self.first.with_tools_of(second, &taken), taken)
    }
}

impl Tracking {
    /// The same with some tools' paths and qualities from another tracking of the same frames.
    fn with_tools_of(mut self, other: Self, taken: &[bool]) -> Self {
        let others = other.motions.into_iter().zip(other.quality.tools);
        for (tool, (motion, quality)) in others.enumerate().filter(|(tool, _)| taken[*tool]) {
            (self.motions[tool], self.quality.tools[tool]) = (motion, quality);
        }
        self
    }
}

/// Was a tool that was found lost on so many frames that a second look is likely to measure more?
fn is_worthwhile(Quality { frames, tools, .. }: &Quality) -> bool {
    let was_found = |tool: &&ToolQuality| tool.observed > 0 || was_wrong_way_round(tool);
    tools.iter().filter(was_found).any(|tool| lost_frames(tool) as f64 > MIN_LOST_SHARE * *frames as f64)
}

fn lost_frames(tool: &ToolQuality) -> u64 {
    let lost = tool.gaps.iter().filter(|gap| matches!(gap.absence, Absence::Lost(_)));
    lost.map(|gap| gap.last - gap.first + 1).sum()
}

/// Were all poses rejected because the trocar lies ahead of them?
fn was_wrong_way_round(tool: &ToolQuality) -> bool {
    tool.observed == 0 && tool.reasons.contains_key(&MissReason::WrongWayRound)
}

impl ToolTracker {
    /// Starts over with what the first look has taught. A tool that shares its colour keeps no trocar, because the two
    /// may have been exchanged.
    fn start_second_look(&mut self, first: &ToolQuality, camera: &Camera, shares_colour: bool) {
        let (keyframes, adjustment) = (std::mem::take(&mut self.keyframes), self.adjustment.take());
        let last = self.last_band;
        self.start_over();
        if was_wrong_way_round(first) {
            let to_hand = last.and_then(|Band { tube, .. }| direction_in_picture(camera, &tube, -tube.axis));
            to_hand.into_iter().for_each(|to_hand| self.hand_direction.set_opposite(to_hand));
        } else if !shares_colour && adjustment.as_ref().is_some_and(Adjustment::is_right_way_round) {
            (self.keyframes, self.adjustment) = (keyframes, adjustment);
        }
    }
}
