//! Finds out why a tool was not seen, from the tracker's reasons and from the position of the other tool.
//!
//! A stretch has one cause: that of most of its frames. A stretch that the tracker lost counts as hidden if the other
//! tool's tube was in the line of sight in the middle of the stretch. The tool is assumed halfway between its last and
//! its next observed position, and the line of sight must pass the tube before it reaches that point.

use std::rc::Rc;

use nalgebra::{Point3, Vector3};

use crate::motion::features::motion::{Interval, Motion};
use crate::motion::features::{FeatureSettings, NotEnough};
use crate::vision::tracker::{Absence, Gap, ToolQuality};
use crate::vision::trajectory::Sample;

/// Why a tool is not seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum UnseenCause {
    /// The hand moved it out of the picture.
    LeftView,
    /// The other tool covered it.
    Hidden,
    /// The tracker lost it.
    Lost,
}

/// A stretch of time when a tool was not seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExplainedAbsence {
    /// When it was not seen.
    pub interval: Interval,
    /// Why it was not seen.
    pub cause: UnseenCause,
}

/// Maximum length of a stretch such that the tool is about halfway in its middle, s.
const MAX_HALFWAY_S: f64 = 2.0;

/// A line of sight that passes a tube's axis at a smaller distance does not see all of the target's tape, mm: the radii
/// of both tubes.
const BLOCKING_MM: f64 = 7.0;

/// How far a tool extends in front of its tip (jaw) and behind it (shaft up to the wall), mm.
const REACH_MM: (f64, f64) = (20.0, 300.0);

/// An interval that contains every recording, in instants of the grid.
const ALL_TIME: Interval = Interval { first: i64::MIN / 4, last: i64::MAX / 4 };

/// The absences of each tool with their causes; `None` for a tool without a record from the tracker.
pub fn explain_absences(
    samples: &[Vec<Sample>],
    motions: &[Result<Motion, NotEnough>],
    tools: &[ToolQuality],
    settings: &FeatureSettings,
) -> Vec<Option<Rc<[ExplainedAbsence]>>> {
    let of_tool = |tool: usize| {
        let other = if samples.len() == 2 { samples[1 - tool].as_slice() } else { &[] };
        Some(explain_gaps(&samples[tool], motions[tool].as_ref().ok(), &tools.get(tool)?.gaps, other, settings))
    };
    (0..samples.len()).map(of_tool).collect()
}

fn explain_gaps(
    samples: &[Sample],
    motion: Option<&Motion>,
    gaps: &[Gap],
    other: &[Sample],
    settings: &FeatureSettings,
) -> Rc<[ExplainedAbsence]> {
    let spans = motion.map_or(&[][..], |motion| &motion.spans);
    let step_s = settings.step_s;
    let ends = [ALL_TIME.first].into_iter().chain(spans.iter().map(|span| span.last()));
    let starts = spans.iter().map(|span| span.first).chain([ALL_TIME.last]);
    let cause = |interval: Interval| {
        let until = samples.partition_point(|sample| sample.time_s <= interval.first as f64 * step_s);
        let again = samples.partition_point(|sample| sample.time_s < interval.last as f64 * step_s);
        let (before, after) = (until.checked_sub(1).and_then(|last| samples.get(last)), samples.get(again));
        find_cause(before, after, gaps, other)
    };
    ends.zip(starts)
        .map(|(first, last)| Interval { first, last })
        .filter(|interval| interval.is_gap(settings))
        .map(|i| ExplainedAbsence { interval: i, cause: cause(i) })
        .collect()
}

fn find_cause(before: Option<&Sample>, after: Option<&Sample>, gaps: &[Gap], other: &[Sample]) -> UnseenCause {
    let (first, last) = (before.map_or(0, |sample| sample.frame), after.map_or(u64::MAX - 1, |sample| sample.frame));
    let frames = |gap: &Gap| (gap.last.min(last) + 1).saturating_sub(gap.first.max(first));
    let (left, lost): (Vec<&Gap>, Vec<&Gap>) = gaps.iter().partition(|gap| gap.absence == Absence::LeftView);
    let [left, lost] = [left, lost].map(|gaps| gaps.into_iter().map(frames).sum::<u64>());
    match before.zip(after) {
        _ if left > lost => UnseenCause::LeftView,
        Some((before, after)) if is_hidden(before, after, other) => UnseenCause::Hidden,
        _ => UnseenCause::Lost,
    }
}

/// True if the other tool was in the line of sight halfway between two observations.
fn is_hidden(before: &Sample, after: &Sample, other: &[Sample]) -> bool {
    let halfway_s = 0.5 * (before.time_s + after.time_s);
    let next = other.partition_point(|sample| sample.time_s < halfway_s);
    let near =
        other[next.saturating_sub(1)..].iter().take(2).find(|s| (s.time_s - halfway_s).abs() < 0.5 * MAX_HALFWAY_S);
    let tube = near.and_then(|sample| Some((sample.tip_mm, sample.axis?)));
    let halfway = nalgebra::center(&before.tip_mm, &after.tip_mm);
    after.time_s - before.time_s < MAX_HALFWAY_S && tube.is_some_and(|(tip, axis)| is_in_the_way(tip, axis, halfway))
}

/// True if the line of sight to a point passes a tube first.
fn is_in_the_way(tip: Point3<f64>, axis: Vector3<f64>, place: Point3<f64>) -> bool {
    let (sight, distance) = (place.coords.normalize(), place.coords.norm());
    // The nearest points of two lines: t along the line of sight, s back along the tube.
    let across = sight.cross(&-axis);
    let square = across.norm_squared();
    if square < 1e-9 {
        return false;
    }
    let t = tip.coords.cross(&-axis).dot(&across) / square;
    let s = (tip.coords.cross(&sight).dot(&across) / square).clamp(-REACH_MM.0, REACH_MM.1);
    let on_tube = tip - axis * s;
    let passes_mm = sight.cross(&on_tube.coords).norm();
    passes_mm < BLOCKING_MM && (0.0..distance - BLOCKING_MM).contains(&t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tube_between_camera_and_place_is_in_the_way_and_one_behind_or_beside_is_not() {
        let (place, axis) = (Point3::new(10.0, 0.0, 200.0), Vector3::new(0.0, 1.0, 0.0));
        let at = |x: f64, y: f64, z: f64| is_in_the_way(Point3::new(x, y, z), axis, place);
        assert!(at(7.5, 50.0, 150.0), "its shaft crosses the line of sight");
        assert!(at(7.5, -10.0, 150.0), "its jaw does");
        assert!(!at(7.5, -40.0, 150.0), "it does not reach so far");
        assert!(!at(12.5, 50.0, 250.0), "behind");
        assert!(!at(20.0, 50.0, 150.0), "beside");
    }
}
