//! Movements: their detours, their smoothness and their corrections.
//!
//! A very long movement is too long to watch. If a movement is longer than the features accept, it is divided into
//! stretches of the maximum length.

use nalgebra::Point3;

use super::{Adds, Amount, Errors, Question, What, nodes, seconds_of, steps};
use crate::pipeline::features::FeatureSettings;
use crate::pipeline::features::motion::{Interval, Motion, Node, Span};
use crate::pipeline::features::movement::movements;
use crate::pipeline::features::per_movement::{jerk_of, ldlj, sparc};
use crate::pipeline::features::smoothness::turned;
use crate::pipeline::features::straightness::way_about;
use crate::pipeline::features::submovements::peaks;
use crate::pipeline::features::turning::angle;

/// What a detour is measured in.
#[derive(Clone, Copy, Debug)]
pub(super) enum Way {
    /// Path length, mm.
    Length,
    /// Travel in depth, mm.
    Depth,
    /// Angle about the trocar, rad.
    Turn(Point3<f64>),
    /// Travel along the tool, to and from the trocar, mm.
    Insertion(Point3<f64>),
}

/// A measure of a whole movement.
#[derive(Clone, Copy, Debug)]
pub(super) enum Measure {
    /// Log dimensionless jerk.
    LogJerk,
    /// Normalised jerk.
    Jerk,
    /// Spectral arc length.
    ArcLength,
    /// Path length divided by the straight distance.
    Ratio,
    /// Path length divided by the shortest way about the trocar.
    RatioAbout(Point3<f64>),
}

/// Time between the starts of two stretches of one long movement, s.
const STEP_S: f64 = 1.0;

/// Detours: how much longer movements are than the way from their start to their end.
pub(super) fn detours<'a>(motions: &[&Motion], settings: &'a FeatureSettings, way: Way, adds: Adds) -> Question<'a> {
    let what = match way {
        Way::Length => What { name: "detour", unit: "mm" },
        Way::Depth => What { name: "detour_in_depth", unit: "mm" },
        Way::Turn(_) => What { name: "detour_about_trocar", unit: "rad" },
        Way::Insertion(_) => What { name: "detour_along_trocar", unit: "mm" },
    };
    let amount = move |motions: &[&Motion], interval: Interval| {
        let nodes = nodes(motions.first()?, interval)?;
        let gone = |a: &Node, b: &Node| match way {
            Way::Length => (b.position - a.position).norm(),
            Way::Depth => (b.position.z - a.position.z).abs(),
            Way::Turn(trocar) => angle(a.position - trocar, b.position - trocar),
            Way::Insertion(trocar) => ((b.position - trocar).norm() - (a.position - trocar).norm()).abs(),
        };
        let straight = gone(nodes.first()?, nodes.last()?);
        Some((steps(nodes).map(|(a, b)| gone(a, b)).sum::<f64>() - straight).max(0.0))
    };
    question(what, stretches(motions[0], settings), Box::new(amount), adds, Errors::InSquares)
}

/// How sharply movements turn.
pub(super) fn crooked<'a>(motions: &[&Motion], settings: &'a FeatureSettings) -> Question<'a> {
    let what = What { name: "crooked_movement", unit: "1/mm²" };
    let amount = |motions: &[&Motion], interval: Interval| {
        let nodes = nodes(motions.first()?, interval)?.to_vec();
        Some(turned(&Span { first: interval.first, nodes }, settings.smoothness_step_mm))
    };
    question(what, stretches(motions[0], settings), Box::new(amount), Adds::Not, Errors::InSquares)
}

/// Movements weighed by a measure, if they are worse than the session's median.
pub(super) fn worst<'a>(
    motions: &[&Motion],
    settings: &'a FeatureSettings,
    measure: Measure,
    median: f64,
) -> Question<'a> {
    let (what, less_is_worse) = match measure {
        Measure::LogJerk => (What { name: "jerky_movement", unit: "1" }, true),
        Measure::Jerk => (What { name: "jerky_movement", unit: "1" }, false),
        Measure::ArcLength => (What { name: "jerky_movement", unit: "1" }, true),
        Measure::Ratio | Measure::RatioAbout(_) => (What { name: "roundabout_movement", unit: "1" }, false),
    };
    let own = motions[0];
    let short = |movement: &&Span| seconds_of(movement.interval(), own) <= settings.longest_movement_s;
    let proposed = movements(own, settings).iter().filter(short).map(Span::interval).collect();
    let step_s = own.step_s;
    let amount = move |motions: &[&Motion], interval: Interval| {
        let nodes = nodes(motions.first()?, interval)?.to_vec();
        let movement = Span { first: interval.first, nodes };
        let (from, to) = (movement.nodes.first()?.position, movement.nodes.last()?.position);
        match measure {
            Measure::LogJerk => ldlj(&movement.speeds(), step_s),
            Measure::Jerk => jerk_of(&movement, step_s),
            Measure::ArcLength => sparc(&movement.speeds(), step_s),
            Measure::Ratio => Some(movement.length_mm() / (to - from).norm()),
            Measure::RatioAbout(trocar) => Some(movement.length_mm() / way_about(trocar, from, to)),
        }
    };
    let question = question(what, proposed, Box::new(amount), Adds::Not, Errors::Plainly);
    Question { usual: median, less_is_worse, ..question }
}

/// Number of pushes per movement that a practised hand needs.
const PUSHES: f64 = 2.0;

/// Time around a movement that is searched for speed peaks, s. Speeds farther away do not change which peaks stand out,
/// so a long recording need not be read again for each movement.
const AROUND_S: f64 = 10.0;

/// Movements that consist of many pushes.
pub(super) fn corrected<'a>(motions: &[&Motion], settings: &'a FeatureSettings, total: f64) -> Question<'a> {
    let amount = |motions: &[&Motion], interval: Interval| {
        let own = motions.first()?;
        let span = own.spans.iter().find(|span| span.first <= interval.first && interval.last <= span.last())?;
        let margin = (AROUND_S / own.step_s).round() as i64;
        let (first, last) = (span.first.max(interval.first - margin), span.last().min(interval.last + margin));
        let around = nodes(own, Interval { first, last })?;
        let of_span = peaks(around.iter().map(|node| node.velocity.norm()), settings.movement_speed_mm_s);
        let inside = |peak: &&usize| (interval.first..=interval.last).contains(&(first + **peak as i64));
        Some(of_span.iter().filter(inside).count() as f64)
    };
    let what = What { name: "submovements", unit: "1" };
    let question = question(what, stretches(motions[0], settings), Box::new(amount), Adds::Up(total), Errors::Plainly);
    Question { usual: PUSHES, ..question }
}

/// Length of the stretches for counting movements, s.
const COUNTED_S: f64 = 10.0;

/// Where movements are frequent: more of them than usual in ten seconds.
pub(super) fn many<'a>(motions: &[&Motion], settings: &'a FeatureSettings, total: f64, adds: Adds) -> Question<'a> {
    let own = motions[0];
    let all = movements(own, settings);
    let from = |(index, first): (usize, &Span)| {
        let within = |movement: &&Span| {
            let whole = Interval { first: first.first, last: movement.last() };
            seconds_of(whole, own) <= COUNTED_S && nodes(own, whole).is_some()
        };
        let last = all[index..].iter().take_while(within).last()?;
        Some(Interval { first: first.first, last: last.last() })
    };
    let proposed = all.iter().enumerate().filter_map(from).collect();
    let amount = |motions: &[&Motion], interval: Interval| {
        let all = movements(motions.first()?, settings);
        let next = all.partition_point(|movement| movement.first < interval.first);
        Some(all[next..].iter().take_while(|movement| movement.last() <= interval.last).count() as f64)
    };
    let what = What { name: "movements_in_a_row", unit: "1" };
    let usual = (total * COUNTED_S / own.observed_s()).max(1.0);
    Question { usual, ..question(what, proposed, Box::new(amount), adds, Errors::Plainly) }
}

fn question<'a>(what: What, proposed: Vec<Interval>, amount: Amount<'a>, adds: Adds, errors: Errors) -> Question<'a> {
    let proposed = proposed.into_iter().map(|interval| (interval, None)).collect();
    Question { what, proposed, amount, usual: 0.0, less_is_worse: false, adds, errors }
}

/// The movements; each one that is too long is replaced by overlapping stretches of the maximum length.
fn stretches(own: &Motion, settings: &FeatureSettings) -> Vec<Interval> {
    let [longest, step] = [settings.longest_movement_s, STEP_S].map(|s| ((s / own.step_s).round() as i64).max(1));
    let of_movement = |movement: &Span| {
        let Interval { first, last } = movement.interval();
        let starts =
            (0..).map(move |k| first + k * step).take_while(move |from| from + longest < last || *from == first);
        starts.map(move |from| Interval { first: from, last: (from + longest).min(last) }).collect::<Vec<_>>()
    };
    movements(own, settings).iter().flat_map(of_movement).collect()
}
