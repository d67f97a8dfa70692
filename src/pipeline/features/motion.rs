//! A tool's motion on an even time grid: what every feature is measured on.
//!
//! Instants are whole multiples of the grid's step, counted from time 0, so the grids of two tools and of two frame
//! rates coincide. A *span* is a stretch in which the tool was observed with no gap longer than the settings allow;
//! between spans nothing is assumed. Samples that the tracker predicted count only inside such a stretch.

use std::cell::OnceCell;
use std::rc::Rc;

use nalgebra::{Point3, Vector3};

use super::fit::{MIN_SAMPLES, Series};
use super::settings::FeatureSettings;
use super::view::Absent;
use super::{NotEnough, Space};
use crate::pipeline::trajectory::{Sample, SampleState, is_cut};

/// Largest coordinate, mm, and latest time, s, that is taken for a measurement: ten metres and a week.
const LARGEST_MM: f64 = 1e4;
const LATEST_S: f64 = 604_800.0;

/// Fastest mean speed that is taken for a hand's, mm/s. It also bounds the work: a path is never longer than this
/// times the time it was seen.
const FASTEST_MM_S: f64 = 5e3;

/// The motion at one instant of the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Tip, mm.
    pub position: Point3<f64>,
    /// Velocity, mm/s.
    pub velocity: Vector3<f64>,
    /// Acceleration, mm/s².
    pub acceleration: Vector3<f64>,
}

/// A stretch of motion without a gap: at least two nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Span {
    /// Grid instant of the first node.
    pub first: i64,
    /// One node per instant.
    pub nodes: Vec<Node>,
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
    /// What is measured, seen or not.
    pub interval: Interval,
    /// Where it was seen.
    pub spans: Vec<Span>,
    /// The grid's step, s.
    pub step_s: f64,
    /// What is known of the tool beside its path.
    pub known: Known,
    /// What [`super::movement::movements`] found.
    pub(super) movements: OnceCell<Vec<Span>>,
    length_mm: OnceCell<f64>,
}

/// What is known of a tool beside its path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Known {
    /// Where it passes through the box's wall, mm ([`super::fulcrum`]).
    pub fulcrum: Option<Point3<f64>>,
    /// Why it was not seen where it was not, over the whole recording ([`super::view`]).
    pub absent: Option<Rc<[Absent]>>,
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

    /// The part inside an interval, if it has a length.
    fn clipped(&self, interval: Interval) -> Option<Span> {
        let (first, last) = (self.first.max(interval.first), self.last().min(interval.last));
        let index = |instant: i64| usize::try_from(instant - self.first).ok();
        let nodes = self.nodes.get(index(first)?..=index(last)?).filter(|nodes| nodes.len() > 1)?;
        Some(Span { first, nodes: nodes.to_vec() })
    }
}

impl Interval {
    /// The smallest interval that holds both.
    pub fn hull(self, other: Interval) -> Interval {
        Interval { first: self.first.min(other.first), last: self.last.max(other.last) }
    }

    /// What both have in common, if that has a length.
    pub fn common(self, other: Interval) -> Option<Interval> {
        let (first, last) = (self.first.max(other.first), self.last.min(other.last));
        (first < last).then_some(Interval { first, last })
    }

    /// How many steps long it is.
    pub fn steps(self) -> i64 {
        self.last - self.first
    }

    /// Between two spans: is it longer than what is bridged? Else only a cut parts them.
    pub fn is_gap(self, settings: &FeatureSettings) -> bool {
        self.steps() as f64 * settings.step_s > settings.max_gap_s
    }
}

impl Motion {
    /// Follows one tool's samples, in time order; over none of the cuts, s. The interval is the whole time in which the tool was seen.
    pub fn of_samples(samples: &[Sample], cuts_s: &[f64], settings: &FeatureSettings) -> Result<Motion, NotEnough> {
        check(samples)?;
        let runs = runs(samples, cuts_s, settings.max_gap_s);
        let spans: Vec<Span> = runs.iter().filter_map(|run| follow(run, settings)).collect();
        let (Some(first), Some(last)) = (spans.first(), spans.last()) else { return Err(NotEnough::NeverSeen) };
        let interval = Interval { first: first.first, last: last.last() };
        Ok(Motion::new(interval, spans, settings.step_s))
    }

    /// The motion of a tool that was not seen in an interval.
    pub fn unseen(interval: Interval, settings: &FeatureSettings) -> Motion {
        Motion::new(interval, Vec::new(), settings.step_s)
    }

    /// The motion within an interval, which may be longer than what was seen.
    pub fn clipped(&self, interval: Interval) -> Motion {
        let spans = self.spans.iter().filter_map(|span| span.clipped(interval)).collect();
        self.with(interval, spans)
    }

    /// The motion as a space shows it: whole, or flattened to x and y.
    pub fn in_space(&self, space: Space) -> Motion {
        let mut spans = self.spans.clone();
        if space == Space::Image {
            for node in spans.iter_mut().flat_map(|span| &mut span.nodes) {
                (node.position.z, node.velocity.z, node.acceleration.z) = (0.0, 0.0, 0.0);
            }
        }
        self.with(self.interval, spans)
    }

    /// The same tool seen otherwise.
    fn with(&self, interval: Interval, spans: Vec<Span>) -> Motion {
        Motion { known: self.known.clone(), ..Motion::new(interval, spans, self.step_s) }
    }

    fn new(interval: Interval, spans: Vec<Span>, step_s: f64) -> Motion {
        let (movements, length_mm) = (OnceCell::new(), OnceCell::new());
        Motion { interval, spans, step_s, known: Known::default(), movements, length_mm }
    }

    /// All nodes, span after span.
    pub fn nodes(&self) -> impl Iterator<Item = &Node> {
        self.spans.iter().flat_map(|span| &span.nodes)
    }

    /// Neighbouring nodes: the steps of the path.
    pub fn steps(&self) -> impl Iterator<Item = (&Node, &Node)> {
        self.spans.iter().flat_map(|span| span.nodes.iter().zip(&span.nodes[1..]))
    }

    /// How many steps of the grid the tool was seen for.
    pub fn observed_steps(&self) -> usize {
        self.spans.iter().map(|span| span.nodes.len() - 1).sum()
    }

    /// How long the tool was seen, s.
    pub fn observed_s(&self) -> f64 {
        self.observed_steps() as f64 * self.step_s
    }

    /// The share of the interval in which the tool was seen, 0 to 1; where the path was cut it was, though nothing is known of the
    /// motion.
    pub fn seen_share(&self, settings: &FeatureSettings) -> f64 {
        let between = self.spans.windows(2).map(|pair| Interval { first: pair[0].last(), last: pair[1].first });
        let cut: i64 = between.filter(|hole| !hole.is_gap(settings)).map(Interval::steps).sum();
        match self.interval.steps() {
            steps if steps > 0 => (self.observed_steps() as f64 + cut as f64) / steps as f64,
            _ => 0.0,
        }
    }

    /// The path's length as far as it was seen, mm; worked out once.
    pub fn length_mm(&self) -> f64 {
        *self.length_mm.get_or_init(|| self.steps().map(|(a, b)| (b.position - a.position).norm()).sum())
    }

    /// Refuses a motion of which too little was seen, or that no hand can make.
    pub fn check_enough(&self, settings: &FeatureSettings) -> Result<(), NotEnough> {
        if self.spans.is_empty() {
            return Err(NotEnough::NeverSeen);
        }
        check_enough(self.observed_s(), self.seen_share(settings), self.length_mm(), settings)
    }
}

/// Was enough seen of a motion, and can a hand make it? Takes how long it was seen, s, in which share of the time, and how
/// far it went meanwhile, mm.
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
    } else if length_mm > FASTEST_MM_S * observed_s {
        Err(NotEnough::OutOfRange)
    } else {
        Ok(())
    }
}

fn check(samples: &[Sample]) -> Result<(), NotEnough> {
    let usable = |s: &Sample| {
        s.time_s.abs() <= LATEST_S
            && s.tip_mm.iter().all(|c| c.abs() <= LARGEST_MM)
            && s.velocity_mm_s.is_none_or(|v| v.iter().all(|c| c.is_finite()))
    };
    let ordered = samples.windows(2).all(|pair| pair[0].time_s < pair[1].time_s);
    if ordered && samples.iter().all(usable) { Ok(()) } else { Err(NotEnough::UnusableSamples) }
}

/// Cuts the samples where nothing was observed for too long, and where they are another tool's from then on. A run starts and
/// ends with an observation.
fn runs<'s>(samples: &'s [Sample], cuts_s: &[f64], max_gap_s: f64) -> Vec<&'s [Sample]> {
    let goes_on = |before_s: f64, time_s: f64| time_s - before_s <= max_gap_s && !is_cut(cuts_s, [before_s, time_s]);
    let observed = samples.iter().enumerate().filter(|(_, s)| s.state == SampleState::Observed);
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    for (index, sample) in observed {
        match ranges.last_mut() {
            Some((_, last)) if goes_on(samples[*last].time_s, sample.time_s) => *last = index,
            _ => ranges.push((index, index)),
        }
    }
    ranges.into_iter().map(|(first, last)| &samples[first..=last]).collect()
}

/// One run on the grid. Velocity and acceleration come from the positions, also where a filter gives velocities: those are
/// smoothed otherwise, and an acceleration made of them was up to twice as large as that of a path without them.
fn follow(run: &[Sample], settings: &FeatureSettings) -> Option<Span> {
    let (start, end) = (run.first()?, run.last()?);
    if run.len() < MIN_SAMPLES {
        return None;
    }
    let series = Samples::new(run);
    let (first, last) = ((start.time_s / settings.step_s).ceil() as i64, (end.time_s / settings.step_s).floor() as i64);
    let nodes: Option<Vec<Node>> =
        (first..=last).map(|i| series.node(i as f64 * settings.step_s, settings.fit_half_window_s)).collect();
    nodes.filter(|nodes| nodes.len() > 1).map(|nodes| Span { first, nodes })
}

/// A run's samples, taken apart.
struct Samples {
    times_s: Vec<f64>,
    positions: Vec<Vector3<f64>>,
}

impl Samples {
    fn new(run: &[Sample]) -> Self {
        Self {
            times_s: run.iter().map(|s| s.time_s).collect(),
            positions: run.iter().map(|s| s.tip_mm.coords).collect(),
        }
    }

    fn node(&self, at_s: f64, half_window_s: f64) -> Option<Node> {
        let place = Series { times_s: &self.times_s, values: &self.positions }.fit(at_s, half_window_s)?;
        Some(Node { position: Point3::from(place.value), velocity: place.first, acceleration: place.second })
    }
}

/// The motion at one moment of a run.
pub(super) fn node_at(run: &[Sample], at_s: f64, half_window_s: f64) -> Option<Node> {
    Samples::new(run).node(at_s, half_window_s)
}
