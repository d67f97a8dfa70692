//! Features during a live feed: sums over everything seen so far, updated once per sample.
//!
//! **In:** samples of the causal path as they arrive. **Out:** the features of [`super::FEATURES`] that are sums or
//! means. **Law:** after [`RunningFeatures::finish`] each value equals the same feature measured on the whole path at
//! once ([`super::motion::Motion::of_samples`]), except for the order of summation. The path is put on the same grid.
//! An instant is added once no later sample can change its fit: 0.15 s or seven frames after it.
//!
//! The values cover the time since a tool was first seen, not the task, because the end of the task is known only at
//! its end.

use std::collections::VecDeque;

use nalgebra::Vector3;

use super::errors::NoErrorBar;
use super::fit::{MIN_SAMPLES, NEIGHBOURS};
use super::motion::{Interval, MotionNode, check_enough, node_at};
use super::path::{DEPTH_TRAVELLED, PATH_LENGTH};
use super::pauses::{LONG_PAUSES, MEDIUM_PAUSES, SHORT_PAUSES};
use super::per_movement::{MOVEMENT_RATE, MOVEMENTS};
use super::speed::{JITTER, MEAN_VELOCITY};
use super::time::{IDLE_SHARE, THINKING_TIME, share_below};
use super::view::{ABSENCES, LONGEST_ABSENCE, NOT_SEEN_SHARE};
use super::{Feature, FeatureSettings, FeatureValue, NotEnough, Space};
use crate::vision::trajectory::{Sample, SampleState};

mod moving;

use moving::MovementCounter;

/// The features that are available during a live feed, in reading order.
pub static LIVE_FEATURES: [&Feature; 14] = [
    &THINKING_TIME,
    &IDLE_SHARE,
    &SHORT_PAUSES,
    &MEDIUM_PAUSES,
    &LONG_PAUSES,
    &MEAN_VELOCITY,
    &JITTER,
    &PATH_LENGTH,
    &DEPTH_TRAVELLED,
    &MOVEMENTS,
    &MOVEMENT_RATE,
    &NOT_SEEN_SHARE,
    &ABSENCES,
    &LONGEST_ABSENCE,
];

/// The running features of all tools.
pub struct RunningFeatures {
    settings: FeatureSettings,
    tools: Vec<GrowingPath>,
    now_s: f64,
}

impl RunningFeatures {
    /// Starts with this many tools, none of them seen yet.
    pub fn new(tools: usize, settings: FeatureSettings) -> Self {
        Self { tools: (0..tools).map(|_| GrowingPath::default()).collect(), settings, now_s: 0.0 }
    }

    /// Sets the current time, s. The time since a tool's last sample counts as not seen.
    pub fn advance_to(&mut self, now_s: f64) {
        self.now_s = now_s;
        let is_gone =
            |tool: &&mut GrowingPath| tool.run.back().is_some_and(|last| now_s - last.time_s > self.settings.max_gap_s);
        self.tools.iter_mut().filter(is_gone).for_each(|tool| tool.end_run(&self.settings));
    }

    /// Adds a tool's next sample, in time order. A sample of an unknown tool is ignored.
    pub fn add_sample(&mut self, sample: &Sample) {
        if let Some(tool) = self.tools.get_mut(sample.tool) {
            tool.add_sample(*sample, &self.settings);
        }
    }

    /// Ends the path: instants that waited for later samples are added now.
    pub fn finish(&mut self) {
        self.tools.iter_mut().for_each(|tool| tool.end_run(&self.settings));
    }

    /// Each tool's features over everything seen so far, or why there is none.
    pub fn values(&self) -> Vec<FeatureValue> {
        let of_tool = |(tool, growing): (usize, &GrowingPath)| {
            let values = growing.sums.values(self.now_s, &self.settings);
            let (space, error) = (Space::ThreeD, Err(NoErrorBar::NotComputed));
            let value = move |(feature, value)| FeatureValue { feature, tool: Some(tool), space, value, error };
            LIVE_FEATURES.into_iter().zip(values).map(value)
        };
        self.tools.iter().enumerate().flat_map(of_tool).collect()
    }
}

/// One tool's path while samples arrive.
#[derive(Default)]
struct GrowingPath {
    /// Samples of the current run that a later fit may still need; the last is an observation.
    run: VecDeque<Sample>,
    /// Number of samples in the current run so far.
    length: usize,
    /// Samples predicted since the last observation; they count once another observation follows.
    predicted: Vec<Sample>,
    /// The next instant of the grid.
    next: Option<i64>,
    /// The node before it in the same span.
    before: Option<MotionNode>,
    sums: RunningSums,
}

impl GrowingPath {
    fn add_sample(&mut self, sample: Sample, settings: &FeatureSettings) {
        if sample.state != SampleState::Observed {
            if !self.run.is_empty() {
                self.predicted.push(sample);
            }
            return;
        }
        if self.run.back().is_some_and(|last| sample.time_s - last.time_s > settings.max_gap_s) {
            self.end_run(settings);
        }
        self.length += self.predicted.len() + 1;
        self.run.extend(self.predicted.drain(..));
        self.run.push_back(sample);
        self.next.get_or_insert_with(|| (sample.time_s / settings.step_s).ceil() as i64);
        self.add_final_instants(settings, sample.time_s, false);
    }

    /// Adds the rest of the current run and starts a new one.
    fn end_run(&mut self, settings: &FeatureSettings) {
        if let Some(last_s) = self.run.back().map(|last| last.time_s) {
            self.add_final_instants(settings, last_s, true);
        }
        self.sums.movement_counter.end_span(settings);
        (self.length, self.next, self.before) = (0, None, None);
        self.run.clear();
        self.predicted.clear();
    }

    /// Adds the instants whose fits are final; all up to `last_s` if the run `is_whole`.
    fn add_final_instants(&mut self, settings: &FeatureSettings, last_s: f64, is_whole: bool) {
        let FeatureSettings { step_s, fit_half_window_s: half_s, .. } = *settings;
        if self.length < MIN_SAMPLES {
            return;
        }
        let samples = self.run.make_contiguous();
        while let Some(instant) = self.next.filter(|next| *next <= (last_s / step_s).floor() as i64) {
            let at_s = instant as f64 * step_s;
            let behind = samples.len() - samples.partition_point(|sample| sample.time_s <= at_s);
            if !is_whole && (behind < NEIGHBOURS || last_s - at_s < half_s) {
                break;
            }
            if let Some(node) = node_at(samples, at_s, half_s) {
                self.sums.movement_counter.add_instant(instant, node.velocity.norm(), settings);
                self.sums.add_step(self.before, node, instant, settings);
                self.before = Some(node);
            }
            self.next = Some(instant + 1);
        }
        // A fit uses the samples of half a window back, or back to the farthest of its nearest neighbours.
        let needed_s = self.next.map_or(last_s, |next| next as f64 * step_s) - half_s;
        let old = samples.partition_point(|sample| sample.time_s <= needed_s);
        self.run.drain(..old.saturating_sub(NEIGHBOURS));
    }
}

/// Sums over a path's steps.
#[derive(Clone, Copy, Debug, Default)]
struct RunningSums {
    /// First and last instant of the grid.
    extent: Option<Interval>,
    steps: u64,
    length_mm: f64,
    depth_mm: f64,
    /// Sum of the mean speed of each step.
    speeds_mm_s: f64,
    /// Sum of the mean acceleration of each step.
    accelerations_mm_s2: f64,
    /// Number of steps below the thinking speed; a step that crosses it counts in proportion.
    slow_steps: f64,
    /// Number of stretches between spans.
    absences: u32,
    /// The longest of them, in steps.
    longest_absence: i64,
    movement_counter: MovementCounter,
}

impl RunningSums {
    fn add_step(&mut self, before: Option<MotionNode>, node: MotionNode, instant: i64, settings: &FeatureSettings) {
        let Some(before) = before else { return }; // a span has a length from its second node on
        let step = Interval { first: instant - 1, last: instant };
        let missed = self.extent.map_or(0, |extent| step.first - extent.last);
        self.absences += u32::from(missed > 0);
        self.longest_absence = self.longest_absence.max(missed);
        self.extent = Some(self.extent.map_or(step, |extent| extent.hull(step)));
        let moved: Vector3<f64> = node.position - before.position;
        let speeds = [before, node].map(|node| node.velocity.norm());
        let accelerations = [before, node].map(|node| node.acceleration.norm());
        self.steps += 1;
        self.length_mm += moved.norm();
        self.depth_mm += moved.z.abs();
        self.speeds_mm_s += 0.5 * (speeds[0] + speeds[1]);
        self.accelerations_mm_s2 += 0.5 * (accelerations[0] + accelerations[1]);
        self.slow_steps += share_below(speeds[0], speeds[1], settings.thinking_speed_mm_s);
    }

    /// The values of [`LIVE_FEATURES`].
    fn values(&self, now_s: f64, settings: &FeatureSettings) -> [Result<f64, NotEnough>; LIVE_FEATURES.len()] {
        let Some(extent) = self.extent else { return [Err(NotEnough::NeverSeen); LIVE_FEATURES.len()] };
        // A tool that is missing for less than a gap may still count as seen once it is observed again.
        let now = ((now_s - settings.max_gap_s) / settings.step_s).floor() as i64;
        let steps = extent.steps().max(now - extent.first);
        let observed_s = self.steps as f64 * settings.step_s;
        let share = self.steps as f64 / steps as f64;
        let enough = check_enough(observed_s, share, self.length_mm, settings);
        let sum = |value: f64| enough.map(|()| value);
        let (looked_s, needed_s) = (steps as f64 * settings.step_s, settings.min_observed_s);
        let too_short = (looked_s < needed_s).then_some(NotEnough::TooShort { observed_s: looked_s, needed_s });
        let in_view = |value: f64| too_short.map_or(Ok(value), Err);
        let (seen, minutes, gone) = (self.steps as f64, observed_s / 60.0, steps - extent.steps());
        let mut moving = self.movement_counter;
        moving.end_span(settings); // as if it ended now
        let [short, medium, long] = moving.rests.map(|rests| sum(f64::from(rests) / minutes));
        [
            sum(self.slow_steps * settings.step_s),
            sum(moving.idle_steps as f64 / seen),
            short,
            medium,
            long,
            sum(self.speeds_mm_s / seen),
            sum(self.accelerations_mm_s2 / seen),
            sum(self.length_mm),
            sum(self.depth_mm),
            sum(f64::from(moving.movements)),
            sum(f64::from(moving.movements) / minutes),
            in_view(1.0 - share),
            in_view(f64::from(self.absences + u32::from(gone > 0))),
            in_view(self.longest_absence.max(gone) as f64 * settings.step_s),
        ]
    }
}

#[cfg(test)]
mod tests;
