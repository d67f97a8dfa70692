//! Measures every feature of a session, over the whole task and over windows of it.
//!
//! The *task* is the attempt of all tools: from the moment that the first starts to move or comes into the picture
//! until the last has stopped or left (see [`features::attempt`]). If nothing moved, it is all of the time a tool was
//! seen. Each tool is measured over the whole task, so a hand that rests while the other works is idle, not absent.

use nalgebra::Point3;

use crate::motion::features::attempt::{RecordingEnds, TaskAttempt};
use crate::motion::features::errors::replicate::replicate;
use crate::motion::features::errors::{NoErrorBar, REPLICATES, duration, error_bar};
use crate::motion::features::motion::{Interval, Motion, ToolContext};
use crate::motion::features::time::DURATION;
use crate::motion::features::view::explain_absences;
use crate::motion::features::{self, FeatureSettings, FeatureValue, NotEnough, fulcrum};
use crate::motion::stretches::{FeatureStretches, StretchCollector};
use crate::random::Dice;
use crate::vision::tracker::ToolQuality;
use crate::vision::trajectory::{Sample, Trajectory};

/// Settings of an assessment.
#[derive(Clone, Debug, PartialEq)]
pub struct AssessmentSettings {
    /// How features are measured.
    pub features: FeatureSettings,
    /// Length of the windows, s (T 4.4). Shorter windows show better where a fault lies, but are noisier. Usual 10; with 0
    /// none is computed.
    pub window_s: f64,
    /// For the beginning and the end: true if a person trimmed the recording there. A tool that moves there is then
    /// part of the attempt from or up to that moment; otherwise the attempt was cut off.
    pub is_trimmed: [bool; 2],
}

impl Default for AssessmentSettings {
    fn default() -> Self {
        Self { features: FeatureSettings::default(), window_s: 10.0, is_trimmed: [false; 2] }
    }
}

/// Maximum number of windows; with more, none is computed. No session is that long.
pub const MAX_WINDOWS: i64 = 1000;

/// Every feature of a session.
#[derive(Clone, Debug, PartialEq)]
pub struct Assessment {
    /// Names of the tools; [`FeatureValue::tool`] is an index into this list.
    pub tools: Vec<String>,
    /// Start and end of the task, s; `None` if no tool was seen.
    pub task_s: Option<(f64, f64)>,
    /// Features over the whole task.
    pub features: Vec<FeatureValue>,
    /// For each value of `features`, in the same order: the seconds that made it.
    pub stretches: Vec<FeatureStretches>,
    /// Features over each window of the task, in time order; the last window may be shorter.
    pub windows: Vec<FeatureWindow>,
}

/// One window of the task and its features.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureWindow {
    /// Start, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// The features that make sense over a window.
    pub features: Vec<FeatureValue>,
}

impl Assessment {
    /// The same assessment with every value withheld, for a session whose measurements cannot be trusted
    /// ([`crate::motion::quality`]).
    pub fn withheld(mut self) -> Self {
        let of_windows = self.windows.iter_mut().flat_map(|window| &mut window.features);
        self.features.iter_mut().chain(of_windows).for_each(|value| {
            (value.value, value.error) = (Err(NotEnough::Refused), Err(NoErrorBar::NoValue));
        });
        self.stretches = self.stretches.into_iter().map(FeatureStretches::withheld).collect();
        self
    }
}

/// Measures a session. Never fails: a feature that cannot be measured carries the reason. `tools` is the tracker's
/// quality record of each tool; it is empty for a path that comes without one.
pub fn assess(trajectory: &Trajectory, tools: &[ToolQuality], settings: &AssessmentSettings) -> Assessment {
    let session = AssessedSession {
        is_trimmed: settings.is_trimmed,
        ..AssessedSession::new(trajectory, tools, &settings.features)
    };
    let task = session.task_interval(&session.motions);
    let step_s = settings.features.step_s;
    let mut features = session.measure_task(&session.motions);
    let measured_on = task.map_or_else(|| session.motions.clone(), |task| session.clipped(&session.motions, task));
    let mut evidence = StretchCollector::new(&features, &measured_on, &settings.features);
    let mut windows = MeasuredWindows::new(&session, task, settings.window_s);
    session.add_error_bars(&mut features, |motions| {
        evidence.add_replicate(motions);
        windows.add_replicate(&session, motions);
    });
    Assessment {
        tools: trajectory.tools.clone(),
        task_s: task.map(|task| (task.first as f64 * step_s, task.last as f64 * step_s)),
        features,
        stretches: evidence.finish(step_s),
        windows: windows.finish(step_s),
    }
}

/// The motion of each tool over the whole of a recording, or the reason why there is none.
pub fn motions(trajectory: &Trajectory, settings: &FeatureSettings) -> Vec<Result<Motion, NotEnough>> {
    AssessedSession::new(trajectory, &[], settings).motions
}

/// A tool's trocar: as the tracker states it, or without a tracker, from the axes of its samples. The tracker turns each
/// axis towards the trocar that it assumes, so its axes would seem to meet there more precisely than it is known.
fn trocar(tracked: Option<&ToolQuality>, samples: &[Sample]) -> Option<Point3<f64>> {
    match tracked {
        Some(quality) => quality.fulcrum.filter(fulcrum::is_exact).map(|fulcrum| fulcrum.at),
        None => fulcrum::find(samples),
    }
}

/// A session being measured. The vectors have one entry a tool, in the trajectory's order.
struct AssessedSession<'a> {
    settings: &'a FeatureSettings,
    samples: Vec<Vec<Sample>>,
    cuts_s: Vec<Vec<f64>>,
    motions: Vec<Result<Motion, NotEnough>>,
    known: Vec<ToolContext>,
    /// The time of the recording; `None` if it has no sample.
    recorded: Option<Interval>,
    is_trimmed: [bool; 2],
}

impl<'a> AssessedSession<'a> {
    fn new(trajectory: &Trajectory, tools: &[ToolQuality], settings: &'a FeatureSettings) -> Self {
        let of_tool = |tool| trajectory.of_tool(tool).copied().collect();
        let samples: Vec<Vec<Sample>> = (0..trajectory.tools.len()).map(of_tool).collect();
        let cuts_s: Vec<Vec<f64>> = (0..trajectory.tools.len()).map(|tool| trajectory.cuts_of(tool)).collect();
        let motions: Vec<_> =
            samples.iter().zip(&cuts_s).map(|(samples, cuts_s)| motion(samples, cuts_s, settings)).collect();
        let absent = explain_absences(&samples, &motions, tools, settings);
        let known = samples.iter().zip(absent).enumerate().map(|(tool, (samples, absent))| ToolContext {
            fulcrum: trocar(tools.get(tool), samples),
            absences: absent,
            attempt: None,
        });
        let recorded = recorded_interval(trajectory, settings);
        Self { settings, known: known.collect(), samples, cuts_s, motions, recorded, is_trimmed: [false; 2] }
    }

    fn measure_task(&self, motions: &[Result<Motion, NotEnough>]) -> Vec<FeatureValue> {
        let interval = self.task_interval(motions);
        let motions = interval.map_or_else(|| motions.to_vec(), |interval| self.clipped(motions, interval));
        features::measure(&motions, self.settings, |_| true)
    }

    /// Adds an error bar to each value and removes the shift that errors cause ([`features::errors`]). The same path
    /// always gives the same bars. `on_replicate` receives the motions of each replicate.
    fn add_error_bars(&self, values: &mut [FeatureValue], mut on_replicate: impl FnMut(&[Result<Motion, NotEnough>])) {
        let measure_replicate = |number| {
            let motions = self.replicate_motions(number)?;
            on_replicate(&motions);
            Some(self.measure_task(&motions))
        };
        let replicates: Option<Vec<_>> = (0..REPLICATES).map(measure_replicate).collect();
        for (index, value) in values.iter_mut().enumerate() {
            let bar = match (value.value, &replicates) {
                (Err(_), _) => Err(NoErrorBar::NoValue),
                (Ok(_), None) => Err(NoErrorBar::ErrorsNotStated),
                (Ok(measured), Some(all)) => {
                    let of_this = all.iter().filter_map(|values| values.get(index)?.value.ok());
                    match self.attempt_of(value) {
                        Some(attempt) => duration::error_bar(attempt, measured, of_this, self.settings.step_s),
                        None => error_bar(value.feature, measured, of_this),
                    }
                }
            };
            value.value = bar.map_or(value.value, |(corrected, _)| Ok(corrected));
            value.error = bar.map(|(_, bar)| bar);
        }
    }

    /// The motions of one replicate: the session as the tracker could have seen it just as well. `None` if the path
    /// states no errors.
    fn replicate_motions(&self, number: usize) -> Option<Vec<Result<Motion, NotEnough>>> {
        let of_tool = |(tool, samples): (usize, &Vec<Sample>)| {
            let samples = replicate(samples, &mut Dice::new(number as u64, &format!("errors of tool {tool}")))?;
            Some(motion(&samples, &self.cuts_s[tool], self.settings))
        };
        self.samples.iter().enumerate().map(of_tool).collect()
    }

    /// The motions within an interval. A tool that was never seen has an empty motion over it.
    fn clipped(&self, motions: &[Result<Motion, NotEnough>], interval: Interval) -> Vec<Result<Motion, NotEnough>> {
        self.clipped_in_attempts(motions, &self.attempts(motions), interval)
    }

    /// The same, with the attempts of these motions.
    fn clipped_in_attempts(
        &self,
        motions: &[Result<Motion, NotEnough>],
        attempts: &[Option<TaskAttempt>],
        interval: Interval,
    ) -> Vec<Result<Motion, NotEnough>> {
        let clip = |((motion, known), attempt): ((&Result<Motion, NotEnough>, &ToolContext), &Option<TaskAttempt>)| {
            let mut clipped = match motion {
                Ok(motion) => motion.clipped(interval),
                Err(NotEnough::NeverSeen) => Motion::unseen(interval, self.settings),
                Err(reason) => return Err(*reason),
            };
            clipped.context = ToolContext { attempt: *attempt, ..known.clone() };
            Ok(clipped)
        };
        motions.iter().zip(&self.known).zip(attempts).map(clip).collect()
    }

    /// The attempt of one tool; `None` if it did not move.
    fn attempt(&self, motion: &Motion, known: &ToolContext) -> Option<TaskAttempt> {
        let recording = RecordingEnds { interval: self.recorded?, is_trimmed: self.is_trimmed };
        TaskAttempt::of_tool(motion, known.absences.as_deref(), recording, self.settings)
    }

    /// The attempts of the tools that moved.
    fn attempts(&self, motions: &[Result<Motion, NotEnough>]) -> Vec<Option<TaskAttempt>> {
        let attempt =
            |(motion, known): (&Result<Motion, NotEnough>, &ToolContext)| self.attempt(motion.as_ref().ok()?, known);
        motions.iter().zip(&self.known).map(attempt).collect()
    }

    /// The attempt that a value states the duration of; `None` for another feature.
    fn attempt_of(&self, value: &FeatureValue) -> Option<TaskAttempt> {
        if *value.feature != DURATION {
            return None;
        }
        let attempts = self.attempts(&self.motions);
        match value.tool {
            Some(tool) => attempts.get(tool).copied().flatten(),
            None => attempts.into_iter().flatten().reduce(TaskAttempt::hull),
        }
    }

    fn task_interval(&self, motions: &[Result<Motion, NotEnough>]) -> Option<Interval> {
        let attempt = self.attempts(motions).into_iter().flatten().reduce(TaskAttempt::hull);
        let seen = motions.iter().flatten().map(|motion| motion.interval);
        attempt.map(TaskAttempt::interval).or(seen.reduce(Interval::hull))
    }

    /// The values of one window.
    fn measure_window(
        &self,
        motions: &[Result<Motion, NotEnough>],
        attempts: &[Option<TaskAttempt>],
        window: Interval,
    ) -> Vec<FeatureValue> {
        let clipped = self.clipped_in_attempts(motions, attempts, window);
        features::measure(&clipped, self.settings, |feature| feature.windowed)
    }
}

/// The windows of a task, measured on the path and on its replicates. Their values have the shift by errors removed as
/// the whole task's values have; otherwise the windows of a length would add up to more than the length.
struct MeasuredWindows {
    windows: Vec<MeasuredWindow>,
}

struct MeasuredWindow {
    interval: Interval,
    values: Vec<FeatureValue>,
    /// For each value, those of the replicates that have one.
    of_replicates: Vec<Vec<f64>>,
}

impl MeasuredWindows {
    fn new(session: &AssessedSession<'_>, task: Option<Interval>, window_s: f64) -> Self {
        let attempts = session.attempts(&session.motions);
        let window = |interval| {
            let values = session.measure_window(&session.motions, &attempts, interval);
            MeasuredWindow { interval, of_replicates: vec![Vec::new(); values.len()], values }
        };
        let intervals = task.map(|task| window_intervals(task, window_s, session.settings.step_s));
        Self { windows: intervals.into_iter().flatten().map(window).collect() }
    }

    fn add_replicate(&mut self, session: &AssessedSession<'_>, motions: &[Result<Motion, NotEnough>]) {
        if self.windows.is_empty() {
            return;
        }
        let attempts = session.attempts(motions);
        for window in &mut self.windows {
            let values = session.measure_window(motions, &attempts, window.interval);
            for (known, value) in window.of_replicates.iter_mut().zip(values) {
                known.extend(value.value.ok());
            }
        }
    }

    fn finish(self, step_s: f64) -> Vec<FeatureWindow> {
        let finish = |window: MeasuredWindow| FeatureWindow {
            start_s: window.interval.first as f64 * step_s,
            end_s: window.interval.last as f64 * step_s,
            features: window.values.into_iter().zip(window.of_replicates).map(corrected).collect(),
        };
        self.windows.into_iter().map(finish).collect()
    }
}

/// A window's value with the shift by errors removed, and its error bar.
fn corrected((mut value, of_replicates): (FeatureValue, Vec<f64>)) -> FeatureValue {
    let bar = match value.value {
        Err(_) => Err(NoErrorBar::NoValue),
        Ok(_) if of_replicates.is_empty() => Err(NoErrorBar::ErrorsNotStated),
        Ok(measured) => error_bar(value.feature, measured, of_replicates.into_iter()),
    };
    value.value = bar.map_or(value.value, |(corrected, _)| Ok(corrected));
    value.error = bar.map(|(_, bar)| bar);
    value
}

/// The windows of a task; none if their length is 0 or they would be too many.
fn window_intervals(task: Interval, window_s: f64, step_s: f64) -> Vec<Interval> {
    let steps = (window_s / step_s).round() as i64;
    if steps < 1 || task.steps() / steps >= MAX_WINDOWS {
        return Vec::new();
    }
    let starts = (0..MAX_WINDOWS).map(|k| task.first + k * steps).take_while(|start| *start < task.last);
    starts.map(|first| Interval { first, last: (first + steps).min(task.last) }).collect()
}

/// The motion of one tool, from its samples.
fn motion(samples: &[Sample], cuts_s: &[f64], settings: &FeatureSettings) -> Result<Motion, NotEnough> {
    match settings.unusable_setting() {
        Some(name) => Err(NotEnough::UnusableSetting(name)),
        None => Motion::of_samples(samples, cuts_s, settings),
    }
}

/// From the first frame to the last, or from the first row to the last if the frames' times are unknown.
fn recorded_interval(trajectory: &Trajectory, settings: &FeatureSettings) -> Option<Interval> {
    let frames = trajectory.frame_times_s.first().zip(trajectory.frame_times_s.last());
    let rows = trajectory.samples.first().zip(trajectory.samples.last());
    let (first_s, last_s) = frames.or(rows.map(|(first, last)| (&first.time_s, &last.time_s)))?;
    let [first, last] = [(first_s / settings.step_s).ceil(), (last_s / settings.step_s).floor()];
    Some(Interval { first: first as i64, last: last as i64 })
}
