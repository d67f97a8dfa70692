//! Features of two hands together, on the instants at which both are seen.

use std::ops::RangeInclusive;

use super::motion::{Motion, Node, Span};
use super::movement::movements;
use super::path::path_length;
use super::{BOTH, Direction, Feature, FeatureSettings, Measure, NotEnough, THREE_D};

/// How far apart.
pub const TIP_DISTANCE: Feature = Feature {
    name: "tip_distance",
    title: "Distance between the tips",
    unit: "mm",
    direction: Direction::Neither,
    description: "Mean distance between the two tips while both are seen.",
    source: "SurgTrac",
    range: (0.0, 20_000.0),
    spaces: BOTH,
    windowed: true,
    measures: &[Measure::Pair(tip_distance)],
};

/// Do they speed up and slow down together?
pub const SYNCHRONY: Feature = Feature {
    name: "synchrony",
    title: "Synchrony of the hands",
    unit: "1",
    direction: Direction::Higher,
    description: "Pearson's correlation of the two tips' speeds at the instants at which both are seen.",
    source: "Hofstad 2013 (bimanual dexterity)",
    range: (-1.0, 1.0),
    spaces: BOTH,
    windowed: false,
    measures: &[Measure::Pair(synchrony)],
};

/// Do they work at the same time?
pub const TOGETHER_SHARE: Feature = Feature {
    name: "together_share",
    title: "Share of moving together",
    unit: "1",
    direction: Direction::Higher,
    description: "Of the time at which both tools are seen and at least one is in a movement, the share in which both are.",
    source: "ours: two-hand synchrony in time",
    range: (0.0, 1.0),
    spaces: THREE_D,
    windowed: false,
    measures: &[Measure::Pair(together_share)],
};

/// Which of them does the work?
pub const HANDEDNESS: Feature = Feature {
    name: "handedness",
    title: "Share of the work",
    unit: "1",
    direction: Direction::Neither,
    description: "This tool's share of both tools' path length; 0.5 is balance, and at most 0.65 for either is SurgTrac's \
                  target.",
    source: "SurgTrac",
    range: (0.0, 1.0),
    spaces: BOTH,
    windowed: false,
    measures: &[Measure::EachOfPair(handedness)],
};

fn tip_distance(a: &Motion, b: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let both = common(a, b, settings)?;
    Ok(both.iter().map(|(a, b)| (a.position - b.position).norm()).sum::<f64>() / both.len() as f64)
}

fn synchrony(a: &Motion, b: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let both = common(a, b, settings)?;
    if movements(a, settings).is_empty() || movements(b, settings).is_empty() {
        return Err(NotEnough::NoMovement); // the correlation with a resting tool is one with its noise
    }
    let speeds: Vec<(f64, f64)> = both.iter().map(|(a, b)| (a.velocity.norm(), b.velocity.norm())).collect();
    correlation(&speeds).ok_or(NotEnough::NoMovement)
}

/// Pearson's correlation; `None` where one side is constant.
fn correlation(pairs: &[(f64, f64)]) -> Option<f64> {
    let n = pairs.len() as f64;
    let (mean_a, mean_b) = (pairs.iter().map(|p| p.0).sum::<f64>() / n, pairs.iter().map(|p| p.1).sum::<f64>() / n);
    let sums = pairs.iter().map(|(a, b)| (a - mean_a, b - mean_b));
    let (ab, aa, bb) = sums.fold((0.0, 0.0, 0.0), |(ab, aa, bb), (a, b)| (ab + a * b, aa + a * a, bb + b * b));
    let tiny = |square: f64, mean: f64| square <= 1e-18 * n * mean * mean; // rounding alone
    (!tiny(aa, mean_a) && !tiny(bb, mean_b)).then(|| (ab / (aa * bb).sqrt()).clamp(-1.0, 1.0))
}

fn together_share(a: &Motion, b: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    common(a, b, settings)?;
    let [of_a, of_b] = [a, b].map(|motion| movements(motion, settings));
    let moving = |movements: &[Span], instant: i64| {
        let next = movements.partition_point(|m| m.last() < instant);
        movements.get(next).is_some_and(|m| m.first <= instant)
    };
    let (mut any, mut all) = (0_u32, 0_u32);
    for instant in overlaps(a, b).flat_map(|(_, _, instants)| instants) {
        let (a, b) = (moving(&of_a, instant), moving(&of_b, instant));
        any += u32::from(a || b);
        all += u32::from(a && b);
    }
    if any == 0 { Err(NotEnough::NoMovement) } else { Ok(f64::from(all) / f64::from(any)) }
}

fn handedness(own: &Motion, other: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let own_mm = path_length(own, settings)?;
    let other_mm = path_length(other, settings).map_err(|_| NotEnough::OtherTool)?;
    let sum = own_mm + other_mm;
    if sum < settings.smoothness_step_mm { Err(NotEnough::NoMovement) } else { Ok(own_mm / sum) }
}

/// The nodes of both tools at the instants at which both are seen, if these are enough.
fn common<'a>(
    a: &'a Motion,
    b: &'a Motion,
    settings: &FeatureSettings,
) -> Result<Vec<(&'a Node, &'a Node)>, NotEnough> {
    let both: Vec<_> = overlaps(a, b).flat_map(|(a, b, range)| range.map(move |i| (at(a, i), at(b, i)))).collect();
    let observed_s = both.len() as f64 * a.step_s;
    let task_s = a.interval.steps() as f64 * a.step_s;
    if observed_s < settings.min_observed_s {
        Err(NotEnough::TooShort { observed_s, needed_s: settings.min_observed_s })
    } else if observed_s < settings.min_seen_share * task_s {
        Err(NotEnough::TooLittleSeen { share: observed_s / task_s, needed: settings.min_seen_share })
    } else {
        Ok(both)
    }
}

/// Pairs of spans that share instants, in time order.
fn overlaps<'a>(a: &'a Motion, b: &'a Motion) -> impl Iterator<Item = (&'a Span, &'a Span, RangeInclusive<i64>)> {
    a.spans.iter().flat_map(move |of_a| {
        let from = b.spans.partition_point(|of_b| of_b.last() < of_a.first);
        let until = b.spans.partition_point(|of_b| of_b.first <= of_a.last());
        let shared = move |of_b: &'a Span| of_a.first.max(of_b.first)..=of_a.last().min(of_b.last());
        b.spans[from..until].iter().map(move |of_b| (of_a, of_b, shared(of_b)))
    })
}

/// The node of an instant that lies in the span.
fn at(span: &Span, instant: i64) -> &Node {
    &span.nodes[(instant - span.first) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_speeds_correlate_fully_and_opposite_ones_inversely() {
        let rising: Vec<(f64, f64)> = (0..9).map(|i| (f64::from(i), 2.0 * f64::from(i) + 1.0)).collect();
        let falling: Vec<(f64, f64)> = rising.iter().map(|(a, b)| (*a, -b)).collect();
        assert!((correlation(&rising).unwrap() - 1.0).abs() < 1e-12);
        assert!((correlation(&falling).unwrap() + 1.0).abs() < 1e-12);
        assert_eq!(correlation(&[(1.0, 0.1), (2.0, 0.1), (3.0, 0.1)]), None);
    }
}
