//! Features of absences: how much and how often a tool was not seen, and why.
//!
//! A tool counts as not seen where it was neither observed nor in a short gap between two observations. The tracker
//! gives the cause frame by frame ([`explain_absences`]): the hand took it out of the view, the other tool covered it,
//! or it was lost in plain view. For a path that comes without the tracker's reasons only the amount is measured.

use super::motion::{Interval, Motion};
use super::{Direction, Family, Feature, FeatureSettings, Habit, MeasureFn, NotEnough, StretchSource, THREE_D};

mod reasons;

pub use reasons::{ExplainedAbsence, UnseenCause, explain_absences};

/// Share of the time when the tool was neither observed nor in a bridged gap.
pub static NOT_SEEN_SHARE: Feature = Feature {
    name: "not_seen_share",
    title: "Share not seen",
    family: Family::View,
    unit: "1",
    direction: Direction::Lower,
    description: "Share of the task in which the tool was neither observed nor in a gap of at most {max_gap} s \
                  between two observations: out of view, hidden, or lost by the tracker.",
    source: "SurgTrac's time off-screen",
    range: (0.0, 1.0),
    spaces: THREE_D,
    windowed: true,
    stretches: StretchSource::TimedAbsences(None),
    habit: None,
    measures: &[MeasureFn::Tool(not_seen_share)],
};

/// Absence caused by the hand.
pub static LEFT_VIEW_SHARE: Feature = Feature {
    name: "left_view_share",
    title: "Share out of view",
    description: "Share of the task in which the tool was not seen because it had left the picture.",
    source: "SurgTrac's time off-screen, without what the tracker lost",
    windowed: false,
    stretches: StretchSource::TimedAbsences(Some(UnseenCause::LeftView)),
    habit: Some(Habit::StayInView),
    measures: &[MeasureFn::Tool(|motion, settings| share_by_cause(motion, settings, UnseenCause::LeftView))],
    ..NOT_SEEN_SHARE
};

/// Absence caused by the other tool.
pub static HIDDEN_SHARE: Feature = Feature {
    name: "hidden_share",
    title: "Share behind the other tool",
    direction: Direction::Neither,
    description: "Share of the task in which the tool was not seen because the other tool's tube was between it and \
                  the camera.",
    source: "ours: neither the hand's fault nor the tracker's",
    windowed: false,
    stretches: StretchSource::TimedAbsences(Some(UnseenCause::Hidden)),
    measures: &[MeasureFn::Tool(|motion, settings| share_by_cause(motion, settings, UnseenCause::Hidden))],
    ..NOT_SEEN_SHARE
};

/// Absence caused by the tracker.
pub static LOST_SHARE: Feature = Feature {
    name: "lost_share",
    title: "Share lost by the tracker",
    direction: Direction::Neither,
    description: "Share of the task in which the tool was in view but could not be followed.",
    source: "ours: says nothing about the hand, but how far to trust the other features",
    windowed: false,
    stretches: StretchSource::TimedAbsences(Some(UnseenCause::Lost)),
    measures: &[MeasureFn::Tool(|motion, settings| share_by_cause(motion, settings, UnseenCause::Lost))],
    ..NOT_SEEN_SHARE
};

/// Number of absences.
pub static ABSENCES: Feature = Feature {
    name: "absences",
    title: "Times not seen",
    description: "How often during the task the tool was not seen for longer than {max_gap} s, for any reason.",
    source: "SurgTrac's time off-screen, in episodes",
    range: (0.0, 1e6),
    windowed: false,
    stretches: StretchSource::Absences,
    measures: &[MeasureFn::Tool(|motion, settings| Ok(absences(motion, settings)?.count() as f64))],
    ..NOT_SEEN_SHARE
};

/// The longest absence.
pub static LONGEST_ABSENCE: Feature = Feature {
    name: "longest_absence",
    title: "Longest time not seen",
    unit: "s",
    description: "The longest time during the task, of more than {max_gap} s, in which the tool was not seen, for any \
                  reason.",
    source: "SurgTrac's time off-screen, in episodes",
    range: (0.0, 86_400.0),
    windowed: false,
    stretches: StretchSource::Absences,
    measures: &[MeasureFn::Tool(longest_absence)],
    ..NOT_SEEN_SHARE
};

fn not_seen_share(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    check_long_enough(motion, settings)?;
    Ok(1.0 - motion.seen_share(settings))
}

fn share_by_cause(motion: &Motion, settings: &FeatureSettings, cause: UnseenCause) -> Result<f64, NotEnough> {
    if not_seen_share(motion, settings)? <= 0.0 {
        return Ok(0.0); // without an absence no cause is needed
    }
    let absent = motion.context.absences.as_ref().ok_or(NotEnough::NoReasons)?;
    let of_cause = absent.iter().filter(|absent| absent.cause == cause);
    let steps: i64 =
        of_cause.filter_map(|absent| absent.interval.intersection(motion.interval)).map(Interval::steps).sum();
    Ok(steps as f64 / motion.interval.steps() as f64)
}

fn longest_absence(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    Ok(absences(motion, settings)?.map(Interval::steps).max().unwrap_or(0) as f64 * motion.step_s)
}

/// The intervals when the tool was not seen for longer than a bridged gap.
pub(in crate::motion) fn absences(
    motion: &Motion,
    settings: &FeatureSettings,
) -> Result<impl Iterator<Item = Interval>, NotEnough> {
    check_long_enough(motion, settings)?;
    let ends = [motion.interval.first].into_iter().chain(motion.spans.iter().map(|span| span.last()));
    let starts = motion.spans.iter().map(|span| span.first).chain([motion.interval.last]);
    let between = ends.zip(starts).map(|(first, last)| Interval { first, last });
    Ok(between.filter(|interval| interval.is_gap(settings)))
}

fn check_long_enough(motion: &Motion, settings: &FeatureSettings) -> Result<(), NotEnough> {
    let (observed_s, needed_s) = (motion.interval.steps() as f64 * motion.step_s, settings.min_observed_s);
    if observed_s < needed_s { Err(NotEnough::TooShort { observed_s, needed_s }) } else { Ok(()) }
}
