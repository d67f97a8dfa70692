//! Where a motion consists of movements: stretches faster than rest.
//!
//! A movement is a stretch in which the speed stays above 0.7 of the movement speed, reaches the movement speed, and
//! which lasts long enough (the hysteresis of PerkTutor's action count). The rule reads the same backwards in time.

use std::ops::Range;

use super::motion::{Interval, Motion, Span};
use super::settings::{FeatureSettings, MOVEMENT_END_RATIO};

/// The movements of a motion, in time order.
pub fn movements(motion: &Motion, settings: &FeatureSettings) -> Vec<Span> {
    motion.spans.iter().flat_map(|span| movements_of_span(span, settings)).collect()
}

/// From the first instant of the first movement to the last of the last.
pub fn extent(motion: &Motion, settings: &FeatureSettings) -> Option<Interval> {
    let movements = movements(motion, settings);
    Some(movements.first()?.interval().hull(movements.last()?.interval()))
}

/// The movements of one span, in time order.
pub fn movements_of_span(span: &Span, settings: &FeatureSettings) -> Vec<Span> {
    let speeds = span.speeds();
    let least_steps = settings.movement_min_s / settings.step_s - 1e-9; // 0.2 s in steps of 0.02 s is 10, not 10.000…2
    let long_enough = |run: &Range<usize>| (run.len() - 1) as f64 >= least_steps;
    let fast_enough = |run: &Range<usize>| speeds[run.clone()].iter().any(|v| *v >= settings.movement_speed_mm_s);
    let faster = runs(&speeds, |speed| speed > MOVEMENT_END_RATIO * settings.movement_speed_mm_s);
    let kept = faster.into_iter().filter(|run| long_enough(run) && fast_enough(run));
    kept.map(|run| Span { first: span.first + run.start as i64, nodes: span.nodes[run].to_vec() }).collect()
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
