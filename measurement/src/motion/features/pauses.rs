//! Features of pauses by length: a brief stop, a look, or lost time.
//!
//! A pause is a rest between two movements, or between a movement and a time when the tool was not seen. The whole rest
//! counts in the one tier that its length falls in.

use super::motion::{Interval, Motion};
use super::movement::rests;
use super::{BOTH, Direction, Family, Feature, FeatureSettings, Habit, MeasureFn, NotEnough, StretchSource};

/// How often the tool stops briefly.
pub static SHORT_PAUSES: Feature = Feature {
    name: "short_pauses",
    title: "Pauses below 1 s",
    description: "Rests of less than {pause_min} s between movements, per minute of the seen time of the task.",
    stretches: StretchSource::CountedPauses(PauseTier::Short),
    habit: Some(Habit::StopLessOften),
    measures: &[MeasureFn::Tool(|motion, settings| pauses_per_minute(motion, settings, PauseTier::Short))],
    ..PAUSE_RATE
};

/// How often the tool stops long enough for a look.
pub static MEDIUM_PAUSES: Feature = Feature {
    name: "medium_pauses",
    title: "Pauses of 1 to 3 s",
    description: "Rests of at least {pause_min} s and less than {long_pause} s between movements, per minute of the \
                  seen time of the task.",
    stretches: StretchSource::CountedPauses(PauseTier::Medium),
    habit: Some(Habit::RestLess),
    measures: &[MeasureFn::Tool(|motion, settings| pauses_per_minute(motion, settings, PauseTier::Medium))],
    ..PAUSE_RATE
};

/// How often the tool stops for long.
pub static LONG_PAUSES: Feature = Feature {
    name: "long_pauses",
    title: "Pauses of 3 s and more",
    description: "Rests of at least {long_pause} s between movements, per minute of the seen time of the task.",
    stretches: StretchSource::CountedPauses(PauseTier::Long),
    habit: Some(Habit::RestLess),
    measures: &[MeasureFn::Tool(|motion, settings| pauses_per_minute(motion, settings, PauseTier::Long))],
    ..PAUSE_RATE
};

/// Share of the time in brief stops.
pub static SHORT_PAUSE_SHARE: Feature = Feature {
    name: "short_pause_share",
    title: "Share in pauses below 1 s",
    description: "Share of the seen time of the task that lies in rests of less than {pause_min} s between movements.",
    stretches: StretchSource::TimedPauses(PauseTier::Short),
    habit: Some(Habit::StopLessOften),
    measures: &[MeasureFn::Tool(|motion, settings| share_in_pauses(motion, settings, PauseTier::Short))],
    ..PAUSE_SHARE
};

/// Share of the time in stops long enough for a look.
pub static MEDIUM_PAUSE_SHARE: Feature = Feature {
    name: "medium_pause_share",
    title: "Share in pauses of 1 to 3 s",
    description: "Share of the seen time of the task that lies in rests of at least {pause_min} s and less than \
                  {long_pause} s between movements.",
    stretches: StretchSource::TimedPauses(PauseTier::Medium),
    habit: Some(Habit::RestLess),
    measures: &[MeasureFn::Tool(|motion, settings| share_in_pauses(motion, settings, PauseTier::Medium))],
    ..PAUSE_SHARE
};

/// Share of the time in long pauses.
pub static LONG_PAUSE_SHARE: Feature = Feature {
    name: "long_pause_share",
    title: "Share in pauses of 3 s and more",
    description: "Share of the seen time of the task that lies in rests of at least {long_pause} s between movements.",
    stretches: StretchSource::TimedPauses(PauseTier::Long),
    habit: Some(Habit::RestLess),
    measures: &[MeasureFn::Tool(|motion, settings| share_in_pauses(motion, settings, PauseTier::Long))],
    ..PAUSE_SHARE
};

/// Common fields of the features that count pauses per minute.
const PAUSE_RATE: Feature = Feature {
    name: "",
    title: "",
    family: Family::Time,
    unit: "1/min",
    direction: Direction::Lower,
    description: "",
    source: "AIMotion (micro-pause, check, lost time), per hand; counted by D'Angelo 2016",
    range: (0.0, 600.0),
    spaces: BOTH,
    windowed: false,
    stretches: StretchSource::WholeTask,
    habit: None,
    measures: &[],
};

/// Common fields of the features that state a share of the time.
const PAUSE_SHARE: Feature = Feature { unit: "1", range: (0.0, 1.0), ..PAUSE_RATE };

/// The tier of a rest, by its length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::motion) enum PauseTier {
    /// Below 1 s: a turning point or a brief stop.
    Short,
    /// From 1 s to 3 s: a look or a check.
    Medium,
    /// 3 s and longer: lost time.
    Long,
}

impl PauseTier {
    /// The tier of a rest with this many grid steps.
    pub(in crate::motion) fn of(steps: i64, settings: &FeatureSettings) -> Self {
        let rest_s = steps as f64 * settings.step_s + 1e-9;
        match () {
            _ if rest_s >= settings.long_pause_s => PauseTier::Long,
            _ if rest_s >= settings.pause_min_s => PauseTier::Medium,
            _ => PauseTier::Short,
        }
    }
}

fn pauses_per_minute(motion: &Motion, settings: &FeatureSettings, tier: PauseTier) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    Ok(rests_of_tier(motion, settings, tier).count() as f64 / (motion.observed_s() / 60.0))
}

fn share_in_pauses(motion: &Motion, settings: &FeatureSettings, tier: PauseTier) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    Ok(rests_of_tier(motion, settings, tier).sum::<i64>() as f64 / motion.observed_steps() as f64)
}

/// The lengths of the rests of a tier, in grid steps.
fn rests_of_tier(motion: &Motion, settings: &FeatureSettings, tier: PauseTier) -> impl Iterator<Item = i64> {
    rests(motion, settings).map(Interval::steps).filter(move |steps| PauseTier::of(*steps, settings) == tier)
}
