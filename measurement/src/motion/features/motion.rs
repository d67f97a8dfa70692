//! A tool's motion on an even time grid. Every feature is measured on it.
//!
//! Instants are whole multiples of the grid's step, counted from time 0, so the grids of two tools and of two frame
//! rates coincide. During a *span* the tool was observed with no gap longer than the settings allow. Nothing is assumed
//! between spans. Samples that the tracker predicted count only inside a span.

use std::cell::OnceCell;
use std::rc::Rc;

use nalgebra::{Point3, Vector3};

use super::attempt::TaskAttempt;
use super::fit::{MIN_SAMPLES, VectorSeries};
use super::settings::FeatureSettings;
use super::view::ExplainedAbsence;
use super::{NotEnough, Space};
use crate::vision::trajectory::{Sample, SampleState, has_cut_between};

/// Maximum coordinate of a usable sample, mm: ten metres.
const MAX_COORDINATE_MM: f64 = 1e4;
/// Maximum time of a usable sample, s: a week.
const MAX_TIME_S: f64 = 604_800.0;

/// No hand moves an instrument faster, mm/s: tips reach about 1.5 m/s, and three times that leaves room for a fast hand.
/// It also bounds the work: a path is never longer than this times the time it was seen.
pub(in crate::motion) const MAX_HAND_SPEED_MM_S: f64 = 5e3;

/// The motion at one instant of the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionNode {
    /// Tip, mm.
    pub position: Point3<f64>,
    /// Velocity, mm/s.
    pub velocity: Vector3<f64>,
    /// Acceleration, mm/s².
    pub acceleration: Vector3<f64>,
}

/// A stretch of motion without a gap; it has at least two nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Span {
    /// Grid instant of the first node.
    pub first: i64,
    /// One node per instant.
    pub nodes: Vec<MotionNode>,
}

/// The grid instants from `first` to `last`, both included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interval {
    /// First instant.
    pub first: i64,
    /// Last instant.
    pub last: i64,
}

/// One tool's motion within an interval.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// The measured interval, whether the tool was seen or not.
    pub interval: Interval,
    /// The spans when the tool was seen.
    pub spans: Vec<Span>,
    /// The grid's step, s.
    pub step_s: f64,
    /// What is known of the tool in addition to its path.
    pub context: ToolContext,
    /// Cache of [`super::movement::movements`].
    pub(super) movements: OnceCell<Vec<Span>>,
    length_mm: OnceCell<f64>,
}

/// What is known of a tool in addition to its path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToolContext {
    /// The point where it passes through the box's wall, mm ([`super::fulcrum`]).
    pub fulcrum: Option<Point3<f64>>,
    /// Its absences over the whole recording, each with its cause ([`super::view`]); `None` if the causes are unknown.
    pub absences: Option<Rc<[ExplainedAbsence]>>,
    /// When the tool's own attempt begins and ends ([`super::attempt`]); `None` if it did not move.
    pub attempt: Option<TaskAttempt>,
}

impl Span {
    /// Grid instant of the last node.
    pub fn last(&self) -> i64 {
        self.first + self.nodes.len() as i64 - 1
    }

    /// The grid instants that it covers.
    pub fn interval(&self) -> Interval {
        Interval { first: self.first, last: self.last() }
    }

    /// The speed at each node, mm/s.
    pub fn speeds(&self) -> Vec<f64> {
        self.nodes.iter().map(|node| node.velocity.norm()).collect()
    }

    /// The length of its path, mm.
    pub fn length_mm(&self) -> f64 {
        self.nodes.windows(2).map(|pair| (pair[1].position - pair[0].position).norm()).sum()
    }

    /// The part inside an interval, if it is longer than 0.
    fn clipped(&self, interval: Interval) -> Option<Span> {
        let (first, last) = (self.first.max(interval.first), self.last().min(interval.last));
        let index = |instant: i64| usize::try_from(instant - self.first).ok();
        let nodes = self.nodes.get(index(first)?..=index(last)?).filter(|nodes| nodes.len() > 1)?;
        Some(Span { first, nodes: nodes.to_vec() })
    }
}

impl Interval {
    /// The smallest interval that contains both.
    pub fn hull(self, other: Interval) -> Interval {
        Interval { first: self.first.min(other.first), last: self.last.max(other.last) }
    }

    /// The intersection of both, if it is longer than 0.
    pub fn intersection(self, other: Interval) -> Option<Interval> {
        let (first, last) = (self.first.max(other.first), self.last.min(other.last));
        (first < last).then_some(Interval { first, last })
    }

    /// Its length in grid steps.
    pub fn steps(self) -> i64 {
        self.last - self.first
    }

    /// For an interval between two spans: true if it is longer than a gap that is bridged. Otherwise only a cut
    /// separates the spans.
    pub fn is_gap(self, settings: &FeatureSettings) -> bool {
        self.steps() as f64 * settings.step_s > settings.max_gap_s
    }
}

impl Motion {
    /// Builds the motion from one tool's samples, in time order. Nothing is bridged across `cuts_s`, s. The interval is
    /// the whole time the tool was seen.
    pub fn of_samples(samples: &[Sample], cuts_s: &[f64], settings: &FeatureSettings) -> Result<Motion, NotEnough> {
        check_samples(samples)?;
        let runs = observed_runs(samples, cuts_s, settings.max_gap_s);
        let spans: Vec<Span> = runs.iter().filter_map(|run| fit_run(run, settings)).collect();
        let (Some(first), Some(last)) = (spans.first(), spans.last()) else { return Err(NotEnough::NeverSeen) };
        let interval = Interval { first: first.first, last: last.last() };
        Ok(Motion::new(interval, spans, settings.step_s))
    }

    /// An empty motion: the tool was not seen in the interval.
    pub fn unseen(interval: Interval, settings: &FeatureSettings) -> Motion {
        Motion::new(interval, Vec::new(), settings.step_s)
    }

    /// The motion within an interval. The interval may extend beyond the time the tool was seen.
    pub fn clipped(&self, interval: Interval) -> Motion {
        let spans = self.spans.iter().filter_map(|span| span.clipped(interval)).collect();
        self.with_spans(interval, spans)
    }

    /// The motion in a space: unchanged, or flattened to x and y.
    pub fn in_space(&self, space: Space) -> Motion {
        let mut spans = self.spans.clone();
        if space == Space::Image {
            for node in spans.iter_mut().flat_map(|span| &mut span.nodes) {
                (node.position.z, node.velocity.z, node.acceleration.z) = (0.0, 0.0, 0.0);
            }
        }
        self.with_spans(self.interval, spans)
    }

    /// The same tool with another interval and other spans.
    fn with_spans(&self, interval: Interval, spans: Vec<Span>) -> Motion {
        Motion { context: self.context.clone(), ..Motion::new(interval, spans, self.step_s) }
    }

    fn new(interval: Interval, spans: Vec<Span>, step_s: f64) -> Motion {
        let (movements, length_mm) = (OnceCell::new(), OnceCell::new());
        Motion { interval, spans, step_s, context: ToolContext::default(), movements, length_mm }
    }

    /// All nodes, span after span.
    pub fn nodes(&self) -> impl Iterator<Item = &MotionNode> {
        self.spans.iter().flat_map(|span| &span.nodes)
    }

    /// Pairs of adjacent nodes: the steps of the path.
    pub fn steps(&self) -> impl Iterator<Item = (&MotionNode, &MotionNode)> {
        self.spans.iter().flat_map(|span| span.nodes.iter().zip(&span.nodes[1..]))
    }

    /// Number of grid steps with the tool in view.
    pub fn observed_steps(&self) -> usize {
        self.spans.iter().map(|span| span.nodes.len() - 1).sum()
    }

    /// How long the tool was seen, s.
    pub fn observed_s(&self) -> f64 {
        self.observed_steps() as f64 * self.step_s
    }

    /// The share of the interval with the tool in view, 0 to 1. The time at a cut counts as seen, although the motion
    /// there is unknown.
    pub fn seen_share(&self, settings: &FeatureSettings) -> f64 {
        let between = self.spans.windows(2).map(|pair| Interval { first: pair[0].last(), last: pair[1].first });
        let cut: i64 = between.filter(|interval| !interval.is_gap(settings)).map(Interval::steps).sum();
        match self.interval.steps() {
            steps if steps > 0 => (self.observed_steps() as f64 + cut as f64) / steps as f64,
            _ => 0.0,
        }
    }

    /// Length of the seen path, mm; computed once and cached.
    pub fn length_mm(&self) -> f64 {
        *self.length_mm.get_or_init(|| self.steps().map(|(a, b)| (b.position - a.position).norm()).sum())
    }

    /// Checks that enough of the motion was seen and that a hand can make it.
    ///
    /// # Errors
    /// The [`NotEnough`] that applies.
    pub fn check_enough(&self, settings: &FeatureSettings) -> Result<(), NotEnough> {
        if self.spans.is_empty() {
            return Err(NotEnough::NeverSeen);
        }
        check_enough(self.observed_s(), self.seen_share(settings), self.length_mm(), settings)
    }
}

/// Checks that enough of a motion was seen and that a hand can make it, from the seen time, s, its share of the
/// interval, and the length of the seen path, mm.
pub(super) fn check_enough(
    observed_s: f64,
    share: f64,
    length_mm: f64,
    settings: &FeatureSettings,
) -> Result<(), NotEnough> {
    if observed_s < settings.min_observed_s {
        Err(NotEnough::TooShort { observed_s, needed_s: settings.min_observed_s })
    } else if share < settings.min_seen_share {
        Err(NotEnough::TooLittleSeen { share, needed: settings.min_seen_share })
    } else if length_mm > MAX_HAND_SPEED_MM_S * observed_s {
        Err(NotEnough::OutOfRange)
    } else {
        Ok(())
    }
}

fn check_samples(samples: &[Sample]) -> Result<(), NotEnough> {
    let usable = |s: &Sample| {
        s.time_s.abs() <= MAX_TIME_S
            && s.tip_mm.iter().all(|c| c.abs() <= MAX_COORDINATE_MM)
            && s.velocity_mm_s.is_none_or(|v| v.iter().all(|c| c.is_finite()))
    };
    let ordered = samples.windows(2).all(|pair| pair[0].time_s < pair[1].time_s);
    if ordered && samples.iter().all(usable) { Ok(()) } else { Err(NotEnough::UnusableSamples) }
}

/// Splits the samples where nothing was observed for too long and at cuts, where the samples change to another tool. A
/// run starts and ends with an observation.
fn observed_runs<'s>(samples: &'s [Sample], cuts_s: &[f64], max_gap_s: f64) -> Vec<&'s [Sample]> {
    let continues =
        |before_s: f64, time_s: f64| time_s - before_s <= max_gap_s && !has_cut_between(cuts_s, [before_s, time_s]);
    let observed = samples.iter().enumerate().filter(|(_, s)| s.state == SampleState::Observed);
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    for (index, sample) in observed {
        match ranges.last_mut() {
            Some((_, last)) if continues(samples[*last].time_s, sample.time_s) => *last = index,
            _ => ranges.push((index, index)),
        }
    }
    ranges.into_iter().map(|(first, last)| &samples[first..=last]).collect()
}

/// Puts one run on the grid. Velocity and acceleration come from the positions even where a filter gives velocities:
/// the filter smooths those differently, and an acceleration derived from them was up to twice as large as without
/// them.
fn fit_run(run: &[Sample], settings: &FeatureSettings) -> Option<Span> {
    let (start, end) = (run.first()?, run.last()?);
    if run.len() < MIN_SAMPLES {
        return None;
    }
    let series = RunSamples::new(run);
    let (first, last) = ((start.time_s / settings.step_s).ceil() as i64, (end.time_s / settings.step_s).floor() as i64);
    let nodes: Option<Vec<MotionNode>> =
        (first..=last).map(|i| series.node(i as f64 * settings.step_s, settings.fit_half_window_s)).collect();
    nodes.filter(|nodes| nodes.len() > 1).map(|nodes| Span { first, nodes })
}

/// A run's samples as separate times and positions.
struct RunSamples {
    times_s: Vec<f64>,
    positions: Vec<Vector3<f64>>,
}

impl RunSamples {
    fn new(run: &[Sample]) -> Self {
        Self {
            times_s: run.iter().map(|s| s.time_s).collect(),
            positions: run.iter().map(|s| s.tip_mm.coords).collect(),
        }
    }

    fn node(&self, at_s: f64, half_window_s: f64) -> Option<MotionNode> {
        let fitted = VectorSeries { times_s: &self.times_s, values: &self.positions }.fit(at_s, half_window_s)?;
        Some(MotionNode { position: Point3::from(fitted.value), velocity: fitted.first, acceleration: fitted.second })
    }
}

/// The motion at one instant of a run.
pub(super) fn node_at(run: &[Sample], at_s: f64, half_window_s: f64) -> Option<MotionNode> {
    RunSamples::new(run).node(at_s, half_window_s)
}
