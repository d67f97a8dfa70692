//! Splits a motion into movements (stretches faster than rest) and rests.
//!
//! During a movement the speed stays above 0.7 of the movement speed and reaches the movement speed at least once, and
//! the movement lasts long enough (the hysteresis of PerkTutor's action count). The rule gives the same result
//! backwards in time.

use std::ops::Range;

use super::motion::{Interval, Motion, Span};
use super::settings::{FeatureSettings, MOVEMENT_END_RATIO};

/// The movements of a motion, in time order. Computed once and cached; the settings of the first call apply.
pub fn movements<'a>(motion: &'a Motion, settings: &FeatureSettings) -> &'a [Span] {
    let all = || motion.spans.iter().flat_map(|span| movements_of_span(span, settings)).collect();
    motion.movements.get_or_init(all)
}

/// The interval from the start of the first movement to the end of the last.
pub fn extent(motion: &Motion, settings: &FeatureSettings) -> Option<Interval> {
    let movements = movements(motion, settings);
    Some(movements.first()?.interval().hull(movements.last()?.interval()))
}

/// The rests of a motion, in time order: the parts of each span before, between and after its movements.
pub fn rests(motion: &Motion, settings: &FeatureSettings) -> impl Iterator<Item = Interval> {
    let all = movements(motion, settings);
    let of_span = move |span: &'_ Span| {
        let from = all.partition_point(|movement| movement.first < span.first);
        let until = all.partition_point(|movement| movement.first <= span.last());
        let starts = all[from..until].iter().map(|movement| movement.first).chain([span.last()]);
        let ends = [span.first].into_iter().chain(all[from..until].iter().map(Span::last));
        ends.zip(starts).map(|(first, last)| Interval { first, last }).filter(|rest| rest.steps() > 0)
    };
    motion.spans.iter().flat_map(of_span)
}

/// The movements of one span, in time order.
fn movements_of_span(span: &Span, settings: &FeatureSettings) -> Vec<Span> {
    let speeds = span.speeds();
    let long_enough = |run: &Range<usize>| is_long_enough(run.len() as i64 - 1, settings);
    let fast_enough = |run: &Range<usize>| speeds[run.clone()].iter().any(|v| *v >= settings.movement_speed_mm_s);
    let kept = runs(&speeds, |speed| is_fast(speed, settings)).into_iter();
    let kept = kept.filter(|run| long_enough(run) && fast_enough(run));
    kept.map(|run| Span { first: span.first + run.start as i64, nodes: span.nodes[run].to_vec() }).collect()
}

/// True if the speed is too high for rest.
pub(super) fn is_fast(speed_mm_s: f64, settings: &FeatureSettings) -> bool {
    speed_mm_s > MOVEMENT_END_RATIO * settings.movement_speed_mm_s
}

/// True if a stretch of this many steps is long enough for a movement.
pub(super) fn is_long_enough(steps: i64, settings: &FeatureSettings) -> bool {
    steps as f64 >= settings.movement_min_s / settings.step_s - 1e-9 // 0.2 s in steps of 0.02 s is 10, not 10.000…2
}

/// The maximal stretches of values that satisfy a condition; none is empty.
fn runs(values: &[f64], holds: impl Fn(f64) -> bool) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for index in (0..values.len()).filter(|&i| holds(values[i])) {
        match runs.last_mut() {
            Some(run) if run.end == index => run.end += 1,
            _ => runs.push(index..index + 1),
        }
    }
    runs
}
