//! Stretches of rest: a tool's rests, its slow motion, and one or both hands at rest.

use super::{Additivity, ErrorEffect, MeasureAmount, StretchKind, StretchSearch, UnseenCause, nodes_within, steps};
use crate::motion::features::FeatureSettings;
use crate::motion::features::motion::{Interval, Motion, Span};
use crate::motion::features::movement::{extent, movements, rests};
use crate::motion::features::time::share_below;

const REST: StretchKind = StretchKind { name: "rest", unit: "s" };
const ALL_AT_REST: StretchKind = StretchKind { name: "all_at_rest", unit: "s" };
const SLOW: StretchKind = StretchKind { name: "slow", unit: "s" };
const ONE_HAND: StretchKind = StretchKind { name: "one_hand_alone", unit: "s" };
const THIS_HAND: StretchKind = StretchKind { name: "this_hand_alone", unit: "s" };

/// The rests of a tool whose length, in steps, is wanted. With `within_own` only those between its own first and last
/// movement.
pub(super) fn rests_of_tool<'a>(
    motions: &[&Motion],
    settings: &'a FeatureSettings,
    within_own: bool,
    wanted: impl Fn(i64) -> bool,
    adds: Additivity,
) -> StretchSearch<'a> {
    let own = motions[0];
    let task = if within_own { extent(own, settings) } else { Some(own.interval) };
    let inside = |rest: &Interval| task.is_some_and(|task| task.first <= rest.first && rest.last <= task.last);
    let proposed = rests(own, settings).filter(inside).filter(|rest| wanted(rest.steps())).map(|rest| (rest, None));
    let amount = |motions: &[&Motion], interval: Interval| Some(rests_s(motions.first()?, interval, settings));
    search(REST, proposed.collect(), Box::new(amount), adds)
}

/// True if a rest of this many steps is long enough for a pause.
pub(super) fn is_pause(steps: i64, settings: &FeatureSettings) -> bool {
    steps as f64 * settings.step_s >= settings.pause_min_s - 1e-9
}

/// Where no tool is in a movement for at least the length of a pause, while all tools that are seen at all are in view.
pub(super) fn common_rests<'a>(
    motions: &[&Motion],
    settings: &'a FeatureSettings,
    adds: Additivity,
) -> StretchSearch<'a> {
    let proposed = common_rest_intervals(&seen_motions(motions), settings)
        .into_iter()
        .filter(|run| is_pause(run.steps(), settings));
    let amount = |motions: &[&Motion], interval: Interval| {
        let seen = seen_motions(motions);
        let step_s = seen.first()?.step_s;
        Some(count_instants(&seen, interval, settings, |at| !at.contains(&ToolState::Moving)) * step_s)
    };
    search(ALL_AT_REST, proposed.map(|run| (run, None)).collect(), Box::new(amount), adds)
}

/// Where both hands rest in view; `share` is their share of the time with both in view.
pub(super) fn rests_of_both_hands<'a>(
    motions: &[&Motion],
    settings: &'a FeatureSettings,
    share: f64,
) -> Option<StretchSearch<'a>> {
    let pair = motions.get(..2)?;
    let total_s = share * count_instants(pair, pair[0].interval, settings, |_| true) * pair[0].step_s;
    Some(common_rests(pair, settings, Additivity::Sum(total_s)))
}

fn seen_motions<'m>(motions: &[&'m Motion]) -> Vec<&'m Motion> {
    motions.iter().copied().filter(|motion| !motion.spans.is_empty()).collect()
}

/// Where the tool is below the thinking speed.
pub(super) fn slow_stretches<'a>(
    motions: &[&Motion],
    settings: &'a FeatureSettings,
    total_s: f64,
) -> StretchSearch<'a> {
    let mut proposed: Vec<Interval> = Vec::new();
    for span in &motions[0].spans {
        let slow = |speed: &f64| *speed < settings.thinking_speed_mm_s;
        for (index, _) in span.speeds().iter().enumerate().filter(|(_, speed)| slow(speed)) {
            let instant = span.first + index as i64;
            match proposed.last_mut() {
                Some(run) if run.last + 1 == instant => run.last = instant,
                _ => proposed.push(Interval { first: instant, last: instant }),
            }
        }
    }
    let proposed = proposed.into_iter().filter(|run| run.steps() > 0).map(|run| (run, None)).collect();
    let amount = |motions: &[&Motion], interval: Interval| {
        let own = motions.first()?;
        let speeds = steps(nodes_within(own, interval)?).map(|(a, b)| (a.velocity.norm(), b.velocity.norm()));
        Some(speeds.map(|(a, b)| share_below(a, b, settings.thinking_speed_mm_s)).sum::<f64>() * own.step_s)
    };
    search(SLOW, proposed, Box::new(amount), Additivity::Sum(total_s))
}

/// Where one hand works alone: either hand, or the tool's own. The hand may pause briefly; only its movements count.
pub(super) fn one_hand_alone<'a>(
    motions: &[&Motion],
    settings: &'a FeatureSettings,
    own: bool,
    share: Option<f64>,
) -> Option<StretchSearch<'a>> {
    let pair = motions.get(..2)?;
    let hands = if own { 0..1 } else { 0..2 };
    let proposed = hands.flat_map(|hand| one_hand_intervals(pair, hand, settings)).map(|run| (run, None)).collect();
    let total_s =
        |share: f64| share * count_instants(pair, motions[0].interval, settings, |_| true) * motions[0].step_s;
    let amount = move |motions: &[&Motion], interval: Interval| {
        let alone = |at: &[ToolState]| match at {
            [ToolState::Moving, ToolState::Resting] => true,
            [ToolState::Resting, ToolState::Moving] => !own,
            _ => false,
        };
        Some(count_instants(motions.get(..2)?, interval, settings, alone) * motions[0].step_s)
    };
    let what = if own { THIS_HAND } else { ONE_HAND };
    Some(search(
        what,
        proposed,
        Box::new(amount),
        share.map_or(Additivity::NotAdditive, |share| Additivity::Sum(total_s(share))),
    ))
}

fn search<'a>(
    what: StretchKind,
    proposed: Vec<(Interval, Option<UnseenCause>)>,
    amount: MeasureAmount<'a>,
    adds: Additivity,
) -> StretchSearch<'a> {
    StretchSearch {
        kind: what,
        proposed,
        amount,
        usual_amount: 0.0,
        less_is_worse: false,
        additivity: adds,
        error_effect: ErrorEffect::Linear,
    }
}

/// Time that a tool is not in a movement, s.
fn rests_s(motion: &Motion, interval: Interval, settings: &FeatureSettings) -> f64 {
    let moving = movements(motion, settings).iter().filter_map(|movement| movement.interval().intersection(interval));
    (interval.steps() - moving.map(Interval::steps).sum::<i64>()) as f64 * motion.step_s
}

/// The state of a tool at an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ToolState {
    Unseen,
    Resting,
    Moving,
}

/// The state of each tool at each instant of an interval, instant after instant.
fn states(motions: &[&Motion], interval: Interval, settings: &FeatureSettings) -> Vec<ToolState> {
    let tools = motions.len();
    let mut states = vec![ToolState::Unseen; usize::try_from(interval.steps() + 1).unwrap_or(0) * tools];
    for (tool, motion) in motions.iter().enumerate() {
        let mut paint = |spans: &[Span], state: ToolState| {
            let from = spans.partition_point(|span| span.last() < interval.first);
            for span in spans[from..].iter().take_while(|span| span.first <= interval.last) {
                for instant in span.first.max(interval.first)..=span.last().min(interval.last) {
                    states[(instant - interval.first) as usize * tools + tool] = state;
                }
            }
        };
        paint(&motion.spans, ToolState::Resting);
        paint(movements(motion, settings), ToolState::Moving);
    }
    states
}

/// Number of instants at which all tools are seen and `holds` is true.
fn count_instants(
    motions: &[&Motion],
    interval: Interval,
    settings: &FeatureSettings,
    holds: impl Fn(&[ToolState]) -> bool,
) -> f64 {
    let states = states(motions, interval, settings);
    states.chunks_exact(motions.len()).filter(|at| !at.contains(&ToolState::Unseen) && holds(at)).count() as f64
}

/// Stretches where all tools rest in view.
fn common_rest_intervals(motions: &[&Motion], settings: &FeatureSettings) -> Vec<Interval> {
    let Some(first) = motions.first().map(|motion| motion.interval.first) else { return Vec::new() };
    let states = states(motions, motions[0].interval, settings);
    let mut runs: Vec<Interval> = Vec::new();
    for (instant, at) in (first..).zip(states.chunks_exact(motions.len())) {
        match runs.last_mut() {
            _ if at.iter().any(|state| *state != ToolState::Resting) => {}
            Some(run) if run.last + 1 == instant => run.last = instant,
            _ => runs.push(Interval { first: instant, last: instant }),
        }
    }
    runs
}

/// Stretches where one hand works while the other rests in view, without a pause of both.
fn one_hand_intervals(pair: &[&Motion], hand: usize, settings: &FeatureSettings) -> Vec<Interval> {
    let longest = (settings.pause_min_s / settings.step_s).round() as i64;
    let first = pair[0].interval.first;
    let (mut runs, mut continues) = (Vec::<Interval>::new(), false);
    for (instant, at) in (first..).zip(states(pair, pair[0].interval, settings).chunks_exact(pair.len())) {
        match (at[hand], at[1 - hand]) {
            (ToolState::Moving, ToolState::Resting) => {
                match runs.last_mut() {
                    Some(run) if continues && instant - run.last < longest => run.last = instant,
                    _ => runs.push(Interval { first: instant, last: instant }),
                }
                continues = true;
            }
            (ToolState::Resting, ToolState::Resting) => {}
            _ => continues = false,
        }
    }
    runs
}
