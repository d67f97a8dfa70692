//! Features of two hands together, measured at the instants at which both tools are seen.

use std::ops::RangeInclusive;

use super::motion::{Interval, Motion, MotionNode, Span};
use super::movement::movements;
use super::path::path_length;
use super::{BOTH, Direction, Family, Feature, FeatureSettings, Habit, MeasureFn, NotEnough, StretchSource};

/// Whether the hands speed up and slow down together.
pub static SYNCHRONY: Feature = Feature {
    name: "synchrony",
    title: "Synchrony of the hands",
    family: Family::TwoHands,
    unit: "1",
    direction: Direction::Higher,
    description: "Pearson's correlation of the two tips' speeds at the instants at which both are seen.",
    source: "Hofstad 2013 (bimanual dexterity)",
    range: (-1.0, 1.0),
    spaces: BOTH,
    windowed: false,
    stretches: StretchSource::EitherHandAlone,
    habit: Some(Habit::BothHands),
    measures: &[MeasureFn::Pair(synchrony)],
};

/// Whether both hands move at the same time.
pub static TOGETHER_SHARE: Feature = Feature {
    name: "together_share",
    title: "Share of moving together",
    family: Family::TwoHands,
    unit: "1",
    direction: Direction::Higher,
    description: "Of the time at which both tools are seen and at least one is in a movement, the share in which both \
                  are.",
    source: "ours: two-hand synchrony in time",
    range: (0.0, 1.0),
    spaces: BOTH,
    windowed: false,
    stretches: StretchSource::EitherHandAlone,
    habit: Some(Habit::BothHands),
    measures: &[MeasureFn::Pair(together_share)],
};

/// How much one hand moves while the other does not.
pub static ONE_HAND_SHARE: Feature = Feature {
    name: "one_hand_share",
    title: "Share of one hand alone",
    direction: Direction::Neither,
    description: "Of the time at which both tools are seen, the share in which one is in a movement and the other is \
                  not.",
    stretches: StretchSource::OneHandTime,
    habit: Some(Habit::BothHands),
    measures: &[MeasureFn::Pair(
        |a, b, settings| Ok(JointActivity::of(a, b, settings)?.share(|together| together.one)),
    )],
    ..TOGETHER_SHARE
};

/// How much both hands rest.
pub static NEITHER_SHARE: Feature = Feature {
    name: "neither_share",
    title: "Share of both at rest",
    direction: Direction::Lower,
    description: "Of the time at which both tools are seen, the share in which neither is in a movement.",
    source: "AIMotion (idle time of both hands); D'Angelo 2016",
    stretches: StretchSource::RestsOfBothHands,
    habit: Some(Habit::RestLess),
    measures: &[MeasureFn::Pair(|a, b, settings| {
        Ok(JointActivity::of(a, b, settings)?.share(|together| together.neither))
    })],
    ..TOGETHER_SHARE
};

/// How similar the speeds of the hands are.
pub static SPEED_BALANCE: Feature = Feature {
    name: "speed_balance",
    title: "Balance of the speeds",
    family: Family::TwoHands,
    unit: "1",
    direction: Direction::Higher,
    description: "Mean of the slower tip's speed divided by the faster one's, over the instants at which both tools \
                  are seen and at least one is in a movement.",
    source: "AIMotion (speed balance), without the instants at which it would compare noise with noise",
    range: (0.0, 1.0),
    spaces: BOTH,
    windowed: false,
    stretches: StretchSource::EitherHandAlone,
    habit: Some(Habit::BothHands),
    measures: &[MeasureFn::Pair(speed_balance)],
};

/// How the path length is divided between the hands.
pub static HANDEDNESS: Feature = Feature {
    name: "handedness",
    title: "Share of the work",
    family: Family::TwoHands,
    unit: "1",
    direction: Direction::Neither,
    description: "This tool's share of both tools' path length; 0.5 is balance, and at most 0.65 for either is \
                  SurgTrac's target.",
    source: "SurgTrac",
    range: (0.0, 1.0),
    spaces: BOTH,
    windowed: false,
    stretches: StretchSource::OwnHandAlone,
    habit: None,
    measures: &[MeasureFn::EachOfPair(handedness)],
};

/// How the moving time is divided between the hands.
pub static HANDEDNESS_IN_TIME: Feature = Feature {
    name: "handedness_in_time",
    title: "Share of the moving time",
    description: "This tool's share of both tools' time in movements; 0.5 is balance.",
    stretches: StretchSource::OwnHandAlone,
    measures: &[MeasureFn::EachOfPair(handedness_in_time)],
    ..HANDEDNESS
};

/// Each tool's share of a total over both tools: the mean over both is always a half.
pub static SHARES_OF_A_PAIR: [&Feature; 2] = [&HANDEDNESS, &HANDEDNESS_IN_TIME];

fn synchrony(a: &Motion, b: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let both = common_nodes(a, b, settings)?;
    if movements(a, settings).is_empty() || movements(b, settings).is_empty() {
        return Err(NotEnough::NoMovement); // the speed of a resting tool is noise
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
    let JointActivity { both, one, .. } = JointActivity::of(a, b, settings)?;
    if both + one == 0 { Err(NotEnough::NoMovement) } else { Ok(both as f64 / (both + one) as f64) }
}

/// Of the instants at which both tools are seen: how many have both, one or neither hand in a movement.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct JointActivity {
    both: usize,
    one: usize,
    neither: usize,
}

impl JointActivity {
    fn of(a: &Motion, b: &Motion, settings: &FeatureSettings) -> Result<Self, NotEnough> {
        let seen = common_nodes(a, b, settings)?.len();
        let steps = |movements: &[Span]| movements.iter().map(Span::interval).collect::<Vec<_>>();
        let [of_a, of_b] = [a, b].map(|motion| steps(movements(motion, settings)));
        let both = count_instants(&intersections(&of_a, &of_b));
        let within = |movements: &[Interval], other: &Motion| {
            count_instants(&intersections(movements, &other.spans.iter().map(Span::interval).collect::<Vec<_>>()))
        };
        let one = within(&of_a, b) + within(&of_b, a) - 2 * both;
        Ok(Self { both, one, neither: seen - both - one })
    }

    fn share(self, part: impl Fn(Self) -> usize) -> f64 {
        part(self) as f64 / (self.both + self.one + self.neither) as f64 // never 0: enough was seen
    }
}

/// The intersections of two lists of intervals, each in time order.
fn intersections(a: &[Interval], b: &[Interval]) -> Vec<Interval> {
    let (mut a, mut b, mut shared) = (a.iter().peekable(), b.iter().peekable(), Vec::new());
    while let (Some(one), Some(other)) = (a.peek(), b.peek()) {
        let part = Interval { first: one.first.max(other.first), last: one.last.min(other.last) };
        if part.first <= part.last {
            shared.push(part);
        }
        if one.last < other.last {
            a.next()
        } else {
            b.next()
        };
    }
    shared
}

/// Number of instants in the intervals, both ends included.
fn count_instants(intervals: &[Interval]) -> usize {
    intervals.iter().map(|interval| interval.steps() as usize + 1).sum()
}

fn speed_balance(a: &Motion, b: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    common_nodes(a, b, settings)?;
    let mut ratios = Vec::new();
    let [of_a, of_b] = [a, b].map(|motion| movements(motion, settings));
    for (span_a, span_b, instants) in overlaps(a, b) {
        for instant in instants {
            if is_moving(of_a, instant) || is_moving(of_b, instant) {
                let [one, other] =
                    [span_node(span_a, instant), span_node(span_b, instant)].map(|node| node.velocity.norm());
                ratios.push(one.min(other) / one.max(other));
            }
        }
    }
    let count = ratios.len() as f64;
    if ratios.is_empty() { Err(NotEnough::NoMovement) } else { Ok(ratios.iter().sum::<f64>() / count) }
}

fn is_moving(movements: &[Span], instant: i64) -> bool {
    let next = movements.partition_point(|movement| movement.last() < instant);
    movements.get(next).is_some_and(|movement| movement.first <= instant)
}

fn handedness(own: &Motion, other: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let own_mm = path_length(own, settings)?;
    let other_mm = path_length(other, settings).map_err(|_| NotEnough::OtherTool)?;
    let sum = own_mm + other_mm;
    if sum < settings.smoothness_step_mm { Err(NotEnough::NoMovement) } else { Ok(own_mm / sum) }
}

fn handedness_in_time(own: &Motion, other: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    own.check_enough(settings)?;
    other.check_enough(settings).map_err(|_| NotEnough::OtherTool)?;
    let moving = |motion: &Motion| movements(motion, settings).iter().map(|m| m.interval().steps()).sum::<i64>();
    let (own, sum) = (moving(own), moving(own) + moving(other));
    if sum == 0 { Err(NotEnough::NoMovement) } else { Ok(own as f64 / sum as f64) }
}

/// The nodes of both tools at the instants at which both are seen, if there are enough.
pub(super) fn common_nodes<'a>(
    a: &'a Motion,
    b: &'a Motion,
    settings: &FeatureSettings,
) -> Result<Vec<(&'a MotionNode, &'a MotionNode)>, NotEnough> {
    let both: Vec<_> =
        overlaps(a, b).flat_map(|(a, b, range)| range.map(move |i| (span_node(a, i), span_node(b, i)))).collect();
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

/// Pairs of spans that overlap, in time order, with the instants they share.
fn overlaps<'a>(a: &'a Motion, b: &'a Motion) -> impl Iterator<Item = (&'a Span, &'a Span, RangeInclusive<i64>)> {
    a.spans.iter().flat_map(move |of_a| {
        let from = b.spans.partition_point(|of_b| of_b.last() < of_a.first);
        let until = b.spans.partition_point(|of_b| of_b.first <= of_a.last());
        let shared = move |of_b: &'a Span| of_a.first.max(of_b.first)..=of_a.last().min(of_b.last());
        b.spans[from..until].iter().map(move |of_b| (of_a, of_b, shared(of_b)))
    })
}

/// The node at an instant inside the span.
fn span_node(span: &Span, instant: i64) -> &MotionNode {
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
