//! Single seconds: the fastest, the most unsteady, the most crooked, the farthest.

use nalgebra::{Point3, Vector3};

use super::{Additivity, ErrorEffect, StretchKind, StretchSearch, nodes_within, steps};
use crate::motion::features::FeatureSettings;
use crate::motion::features::curvature::node_curvature;
use crate::motion::features::motion::{Interval, Motion, MotionNode};
use crate::motion::features::turning::angle;

/// What a second of one tool is weighed by.
#[derive(Clone, Copy, Debug)]
pub(super) enum SecondMeasure {
    /// Mean speed.
    Fast,
    /// Mean acceleration.
    Unsteady,
    /// Angle about the trocar.
    Turning(Point3<f64>),
    /// How much the path bends while the tool moves.
    Bending,
    /// Distance from the mean position.
    Outlying,
}

/// What a second of two tools is weighed by: the distance between the tips.
#[derive(Clone, Copy, Debug)]
pub(super) enum DistanceMeasure {
    /// A large distance.
    Far,
    /// A small distance.
    Near,
    /// An unusual distance.
    Unusual,
}

/// Length of a stretch, s.
const SECOND_S: f64 = 1.0;
/// Time between the starts of two stretches, s.
const STEP_S: f64 = 0.1;

/// Seconds of one tool, weighed by a measure.
pub(super) fn seconds_of_tool<'a>(
    motions: &[&Motion],
    settings: &'a FeatureSettings,
    by: SecondMeasure,
) -> StretchSearch<'a> {
    let own = motions[0];
    let (name, unit) = match by {
        SecondMeasure::Fast => ("fast", "mm/s"),
        SecondMeasure::Unsteady => ("unsteady", "mm/s²"),
        SecondMeasure::Turning(_) => ("turning", "rad/s"),
        SecondMeasure::Bending => ("bending", "rad/s"),
        SecondMeasure::Outlying => ("outlying", "mm"),
    };
    let count = own.nodes().count().max(1) as f64;
    let middle = own.nodes().map(|node| node.position.coords).sum::<Vector3<f64>>() / count;
    let amount = move |motions: &[&Motion], interval: Interval| {
        let own = motions.first()?;
        Some(mean_measure(nodes_within(own, interval)?, by, middle, own.step_s, settings))
    };
    let parts =
        || own.spans.iter().map(|span| (mean_measure(&span.nodes, by, middle, own.step_s, settings), span.nodes.len()));
    let usual =
        parts().map(|(mean, n)| mean * n as f64).sum::<f64>() / parts().map(|(_, n)| n).sum::<usize>().max(1) as f64;
    StretchSearch {
        kind: StretchKind { name, unit },
        proposed: second_windows(own.spans.iter().map(|span| span.interval()), own.step_s),
        amount: Box::new(amount),
        usual_amount: usual,
        less_is_worse: false,
        additivity: Additivity::NotAdditive,
        error_effect: if matches!(by, SecondMeasure::Outlying) { ErrorEffect::Linear } else { ErrorEffect::InSquares },
    }
}

/// The mean of the measure over some nodes.
fn mean_measure(
    nodes: &[MotionNode],
    by: SecondMeasure,
    middle: Vector3<f64>,
    step_s: f64,
    settings: &FeatureSettings,
) -> f64 {
    let mean = |of: &dyn Fn(&MotionNode) -> f64| nodes.iter().map(of).sum::<f64>() / nodes.len() as f64;
    match by {
        SecondMeasure::Fast => mean(&|node| node.velocity.norm()),
        SecondMeasure::Unsteady => mean(&|node| node.acceleration.norm()),
        SecondMeasure::Outlying => mean(&|node| (node.position.coords - middle).norm()),
        SecondMeasure::Bending => mean(&|node| {
            let speed = node.velocity.norm();
            if speed < settings.movement_speed_mm_s { 0.0 } else { node_curvature(node) * speed }
        }),
        SecondMeasure::Turning(trocar) => {
            let turned = steps(nodes).map(|(a, b)| angle(a.position - trocar, b.position - trocar));
            turned.sum::<f64>() / ((nodes.len() as f64 - 1.0).max(1.0) * step_s)
        }
    }
}

/// Seconds with both tips in view, weighed by the distance between them.
pub(super) fn seconds_by_distance<'a>(motions: &[&Motion], by: DistanceMeasure) -> Option<StretchSearch<'a>> {
    let [a, b, ..] = motions else { return None };
    let both = |of_a: Interval| b.spans.iter().filter_map(move |of_b| of_a.intersection(of_b.interval()));
    let seen: Vec<Interval> = a.spans.iter().flat_map(|of_a| both(of_a.interval())).collect();
    let distances: Vec<f64> = seen.iter().filter_map(|part| distances(&[a, b], *part)).flatten().collect();
    let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
    let spread = (distances.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / distances.len().max(1) as f64).sqrt();
    let amount = move |motions: &[&Motion], interval: Interval| {
        let all = self::distances(motions, interval)?;
        let of_second = all.iter().sum::<f64>() / all.len() as f64;
        Some(if matches!(by, DistanceMeasure::Unusual) { (of_second - mean).abs() } else { of_second })
    };
    let (name, usual) = match by {
        DistanceMeasure::Far => ("far_apart", mean),
        DistanceMeasure::Near => ("near_each_other", mean),
        DistanceMeasure::Unusual => ("unusually_apart", spread),
    };
    Some(StretchSearch {
        kind: StretchKind { name, unit: "mm" },
        proposed: second_windows(seen.into_iter(), a.step_s),
        amount: Box::new(amount),
        usual_amount: usual,
        less_is_worse: matches!(by, DistanceMeasure::Near),
        additivity: Additivity::NotAdditive,
        error_effect: ErrorEffect::Linear,
    })
}

fn distances(motions: &[&Motion], interval: Interval) -> Option<Vec<f64>> {
    let [a, b, ..] = motions else { return None };
    let pairs = nodes_within(a, interval)?.iter().zip(nodes_within(b, interval)?);
    Some(pairs.map(|(a, b)| (a.position - b.position).norm()).collect())
}

/// All seconds of these stretches, counted from the start of each.
fn second_windows(
    stretches: impl Iterator<Item = Interval>,
    step_s: f64,
) -> Vec<(Interval, Option<super::UnseenCause>)> {
    let [length, step] = [SECOND_S, STEP_S].map(|s| ((s / step_s).round() as i64).max(1));
    let of_stretch = |Interval { first, last }: Interval| {
        let starts = (0..).map(move |k| first + k * step).take_while(move |from| from + length <= last);
        starts.map(move |from| (Interval { first: from, last: from + length }, None))
    };
    stretches.flat_map(of_stretch).collect()
}
