//! Features of time: the duration, and how much of it was rest.

use super::attempt::TaskAttempt;
use super::motion::{Interval, Motion};
use super::movement::rests;
use super::{BOTH, Direction, Family, Feature, FeatureSettings, Habit, MeasureFn, NotEnough, StretchSource, THREE_D};

/// Time from the start of the first tool to the stop of the last.
pub static DURATION: Feature = Feature {
    name: "duration",
    title: "Duration",
    family: Family::Time,
    unit: "s",
    direction: Direction::Lower,
    description: "Time from the moment that the first tool starts to move or comes into the picture until the last \
                  tool has stopped or left the picture; for one tool, from its own start to its own stop. A tool \
                  moves in a movement that takes its tip at least {min_travel} mm away: a stretch of at least \
                  {movement_min} s in which the speed stays above {movement_end} mm/s and reaches {movement_speed} \
                  mm/s.",
    source: "thesis eq. 4.37; movements after PerkTutor's hysteresis",
    range: (0.0, 86_400.0),
    spaces: THREE_D,
    windowed: false,
    stretches: StretchSource::OwnRests,
    habit: Some(Habit::RestLess),
    measures: &[MeasureFn::Session(task_duration), MeasureFn::Tool(tool_duration)],
};

/// Time below the thinking speed.
pub static THINKING_TIME: Feature = Feature {
    name: "thinking_time",
    title: "Thinking time",
    family: Family::Time,
    unit: "s",
    direction: Direction::Lower,
    description: "Time during the task in which the tool is seen and its speed is below {thinking_speed} mm/s.",
    source: "thesis eq. 4.36, corrected: below the threshold, not above it; threshold as EndoViS",
    range: (0.0, 86_400.0),
    spaces: BOTH,
    windowed: true,
    stretches: StretchSource::SlowMotion,
    habit: Some(Habit::RestLess),
    measures: &[MeasureFn::Tool(thinking_time)],
};

/// Share of the time in rests between movements.
pub static IDLE_SHARE: Feature = Feature {
    name: "idle_share",
    title: "Idle share",
    family: Family::Time,
    unit: "1",
    direction: Direction::Lower,
    description: "Share of the seen time of the task that lies in rests of at least {pause_min} s between movements.",
    source: "D'Angelo 2016 (idle time)",
    range: (0.0, 1.0),
    spaces: BOTH,
    windowed: true,
    stretches: StretchSource::Rests,
    habit: Some(Habit::RestLess),
    measures: &[MeasureFn::Tool(idle_share)],
};

fn task_duration(motions: &[Motion], settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let attempts = motions.iter().filter_map(|motion| motion.context.attempt);
    let all = attempts.reduce(TaskAttempt::hull).ok_or(NotEnough::NoMovement)?;
    Ok(all.interval().steps() as f64 * settings.step_s)
}

fn tool_duration(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let own = motion.context.attempt.ok_or(NotEnough::NoMovement)?;
    Ok(own.interval().steps() as f64 * motion.step_s)
}

fn thinking_time(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let below = |a: f64, b: f64| share_below(a, b, settings.thinking_speed_mm_s);
    let shares = motion.steps().map(|(a, b)| below(a.velocity.norm(), b.velocity.norm()));
    Ok(shares.sum::<f64>() * motion.step_s)
}

/// The share of a step that lies below a threshold, if the speed changes linearly from `a` to `b`.
pub(in crate::motion) fn share_below(a: f64, b: f64, threshold: f64) -> f64 {
    let (low, high) = (a.min(b), a.max(b));
    if high <= threshold {
        1.0
    } else if low >= threshold {
        0.0
    } else {
        (threshold - low) / (high - low)
    }
}

fn idle_share(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let idle =
        rests(motion, settings).filter(|rest| rest.steps() as f64 * motion.step_s >= settings.pause_min_s - 1e-9);
    Ok(idle.map(Interval::steps).sum::<i64>() as f64 / motion.observed_steps() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_that_crosses_the_threshold_counts_in_proportion() {
        assert_eq!(share_below(0.0, 10.0, 5.0), 0.5);
        assert_eq!(share_below(8.0, 4.0, 5.0), 0.25);
        assert_eq!((share_below(5.0, 5.0, 5.0), share_below(6.0, 7.0, 5.0)), (1.0, 0.0));
    }
}
