//! Movements: their detours, their smoothness and their corrections.
//!
//! A very long movement is too long to watch. If a movement is longer than the features accept, it is divided into
//! stretches of the maximum length.

use nalgebra::Point3;

use super::{Additivity, ErrorEffect, MeasureAmount, StretchKind, StretchSearch, length_s, nodes_within, steps};
use crate::motion::features::FeatureSettings;
use crate::motion::features::motion::{Interval, Motion, MotionNode, Span};
use crate::motion::features::movement::movements;
use crate::motion::features::per_movement::{ldlj, normalised_jerk_of, sparc};
use crate::motion::features::smoothness::squared_turns;
use crate::motion::features::straightness::shortest_way_about;
use crate::motion::features::submovements::peaks;
use crate::motion::features::turning::angle;

/// What a detour is measured in.
#[derive(Clone, Copy, Debug)]
pub(super) enum DetourMeasure {
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
pub(super) enum MovementMeasure {
    /// Log dimensionless jerk.
    LogJerk,
    /// Normalised jerk.
    Jerk,
    /// Spectral arc length.
    ArcLength,
    /// Path length divided by the straight distance.
    Ratio,
    /// Path length divided by the shortest way about the trocar.
    RatioAboutTrocar(Point3<f64>),
}

/// Time between the starts of two stretches of one long movement, s.
const STEP_S: f64 = 1.0;

/// Detours: how much longer movements are than the way from their start to their end.
pub(super) fn detours<'a>(
    motions: &[&Motion],
    settings: &'a FeatureSettings,
    way: DetourMeasure,
    adds: Additivity,
) -> StretchSearch<'a> {
    let what = match way {
        DetourMeasure::Length => StretchKind { name: "detour", unit: "mm" },
        DetourMeasure::Depth => StretchKind { name: "detour_in_depth", unit: "mm" },
        DetourMeasure::Turn(_) => StretchKind { name: "detour_about_trocar", unit: "rad" },
        DetourMeasure::Insertion(_) => StretchKind { name: "detour_along_trocar", unit: "mm" },
    };
    let amount = move |motions: &[&Motion], interval: Interval| {
        let nodes = nodes_within(motions.first()?, interval)?;
        let gone = |a: &MotionNode, b: &MotionNode| match way {
            DetourMeasure::Length => (b.position - a.position).norm(),
            DetourMeasure::Depth => (b.position.z - a.position.z).abs(),
            DetourMeasure::Turn(trocar) => angle(a.position - trocar, b.position - trocar),
            DetourMeasure::Insertion(trocar) => ((b.position - trocar).norm() - (a.position - trocar).norm()).abs(),
        };
        let straight = gone(nodes.first()?, nodes.last()?);
        Some((steps(nodes).map(|(a, b)| gone(a, b)).sum::<f64>() - straight).max(0.0))
    };
    search(what, movement_stretches(motions[0], settings), Box::new(amount), adds, ErrorEffect::InSquares)
}

/// How sharply movements turn.
pub(super) fn crooked_movements<'a>(motions: &[&Motion], settings: &'a FeatureSettings) -> StretchSearch<'a> {
    let what = StretchKind { name: "crooked_movement", unit: "1/mm²" };
    let amount = |motions: &[&Motion], interval: Interval| {
        let nodes = nodes_within(motions.first()?, interval)?.to_vec();
        Some(squared_turns(&Span { first: interval.first, nodes }, settings.smoothness_step_mm))
    };
    search(
        what,
        movement_stretches(motions[0], settings),
        Box::new(amount),
        Additivity::NotAdditive,
        ErrorEffect::InSquares,
    )
}

/// Movements weighed by a measure, if they are worse than the session's median.
pub(super) fn worst_movements<'a>(
    motions: &[&Motion],
    settings: &'a FeatureSettings,
    measure: MovementMeasure,
    median: f64,
) -> StretchSearch<'a> {
    let (what, less_is_worse) = match measure {
        MovementMeasure::LogJerk => (StretchKind { name: "jerky_movement", unit: "1" }, true),
        MovementMeasure::Jerk => (StretchKind { name: "jerky_movement", unit: "1" }, false),
        MovementMeasure::ArcLength => (StretchKind { name: "jerky_movement", unit: "1" }, true),
        MovementMeasure::Ratio | MovementMeasure::RatioAboutTrocar(_) => {
            (StretchKind { name: "roundabout_movement", unit: "1" }, false)
        }
    };
    let own = motions[0];
    let short = |movement: &&Span| length_s(movement.interval(), own) <= settings.longest_movement_s;
    let proposed = movements(own, settings).iter().filter(short).map(Span::interval).collect();
    let step_s = own.step_s;
    let amount = move |motions: &[&Motion], interval: Interval| {
        let nodes = nodes_within(motions.first()?, interval)?.to_vec();
        let movement = Span { first: interval.first, nodes };
        let (from, to) = (movement.nodes.first()?.position, movement.nodes.last()?.position);
        match measure {
            MovementMeasure::LogJerk => ldlj(&movement.speeds(), step_s),
            MovementMeasure::Jerk => normalised_jerk_of(&movement, step_s),
            MovementMeasure::ArcLength => sparc(&movement.speeds(), step_s),
            MovementMeasure::Ratio => Some(movement.length_mm() / (to - from).norm()),
            MovementMeasure::RatioAboutTrocar(trocar) => {
                Some(movement.length_mm() / shortest_way_about(trocar, from, to))
            }
        }
    };
    let question = search(what, proposed, Box::new(amount), Additivity::NotAdditive, ErrorEffect::Linear);
    StretchSearch { usual_amount: median, less_is_worse, ..question }
}

/// Number of pushes per movement that a practised hand needs.
const USUAL_PUSHES: f64 = 2.0;

/// Time around a movement that is searched for speed peaks, s. Speeds farther away do not change which peaks stand out,
/// so a long recording need not be read again for each movement.
const PEAK_CONTEXT_S: f64 = 10.0;

/// Movements that consist of many pushes.
pub(super) fn corrected_movements<'a>(
    motions: &[&Motion],
    settings: &'a FeatureSettings,
    total: f64,
) -> StretchSearch<'a> {
    let amount = |motions: &[&Motion], interval: Interval| {
        let own = motions.first()?;
        let span = own.spans.iter().find(|span| span.first <= interval.first && interval.last <= span.last())?;
        let margin = (PEAK_CONTEXT_S / own.step_s).round() as i64;
        let (first, last) = (span.first.max(interval.first - margin), span.last().min(interval.last + margin));
        let around = nodes_within(own, Interval { first, last })?;
        let of_span = peaks(around.iter().map(|node| node.velocity.norm()), settings.movement_speed_mm_s);
        let inside = |peak: &&usize| (interval.first..=interval.last).contains(&(first + **peak as i64));
        Some(of_span.iter().filter(inside).count() as f64)
    };
    let what = StretchKind { name: "submovements", unit: "1" };
    let question = search(
        what,
        movement_stretches(motions[0], settings),
        Box::new(amount),
        Additivity::Sum(total),
        ErrorEffect::Linear,
    );
    StretchSearch { usual_amount: USUAL_PUSHES, ..question }
}

/// Length of the stretches for counting movements, s.
const COUNTING_WINDOW_S: f64 = 10.0;

/// Where movements are frequent: more of them than usual in ten seconds.
pub(super) fn frequent_movements<'a>(
    motions: &[&Motion],
    settings: &'a FeatureSettings,
    total: f64,
    adds: Additivity,
) -> StretchSearch<'a> {
    let own = motions[0];
    let all = movements(own, settings);
    let from = |(index, first): (usize, &Span)| {
        let within = |movement: &&Span| {
            let whole = Interval { first: first.first, last: movement.last() };
            length_s(whole, own) <= COUNTING_WINDOW_S && nodes_within(own, whole).is_some()
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
    let what = StretchKind { name: "movements_in_a_row", unit: "1" };
    let usual = (total * COUNTING_WINDOW_S / own.observed_s()).max(1.0);
    StretchSearch { usual_amount: usual, ..search(what, proposed, Box::new(amount), adds, ErrorEffect::Linear) }
}

fn search<'a>(
    what: StretchKind,
    proposed: Vec<Interval>,
    amount: MeasureAmount<'a>,
    adds: Additivity,
    errors: ErrorEffect,
) -> StretchSearch<'a> {
    let proposed = proposed.into_iter().map(|interval| (interval, None)).collect();
    StretchSearch {
        kind: what,
        proposed,
        amount,
        usual_amount: 0.0,
        less_is_worse: false,
        additivity: adds,
        error_effect: errors,
    }
}

/// The movements; each one that is too long is replaced by overlapping stretches of the maximum length.
fn movement_stretches(own: &Motion, settings: &FeatureSettings) -> Vec<Interval> {
    let [longest, step] = [settings.longest_movement_s, STEP_S].map(|s| ((s / own.step_s).round() as i64).max(1));
    let of_movement = |movement: &Span| {
        let Interval { first, last } = movement.interval();
        let starts =
            (0..).map(move |k| first + k * step).take_while(move |from| from + longest < last || *from == first);
        starts.map(move |from| Interval { first: from, last: (from + longest).min(last) }).collect::<Vec<_>>()
    };
    movements(own, settings).iter().flat_map(of_movement).collect()
}
