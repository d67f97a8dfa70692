//! Features of single movements: their number, and the smoothness of each.
//!
//! Jerk and spectrum are defined for discrete movements of a few seconds, and their authors warn against longer ones.
//! So they are measured per movement; the session's value is the median, weighted by the movements' durations.

use super::motion::{Motion, Span};
use super::movement::movements;
use super::{BOTH, Direction, Family, Feature, FeatureSettings, Habit, IMAGE, MeasureFn, NotEnough, StretchSource};
use crate::numbers::quantile::weighted_quantile;

/// Number of movements.
pub static MOVEMENTS: Feature = Feature {
    name: "movements",
    title: "Number of movements",
    family: Family::Movements,
    unit: "1",
    direction: Direction::Lower,
    description: "How many movements the task took: stretches of at least {movement_min} s in which the speed stays \
                  above {movement_end} mm/s and reaches {movement_speed} mm/s.",
    source: "ICSAD's third measure, with PerkTutor's hysteresis",
    range: (0.0, 1e6),
    spaces: BOTH,
    windowed: true,
    stretches: StretchSource::CountedMovements,
    habit: Some(Habit::FewerCorrections),
    measures: &[MeasureFn::Tool(movement_count)],
};

/// Number of movements per minute.
pub static MOVEMENT_RATE: Feature = Feature {
    name: "movement_rate",
    title: "Movements per minute",
    family: Family::Movements,
    unit: "1/min",
    direction: Direction::Neither,
    description: "Number of movements per minute of the seen time of the task.",
    source: "PerkTutor (actions), as a rate",
    range: (0.0, 600.0),
    spaces: BOTH,
    windowed: false,
    stretches: StretchSource::MovementsPerMinute,
    habit: None,
    measures: &[MeasureFn::Tool(movement_rate)],
};

/// Smoothness of the speed over time.
pub static LOG_DIMENSIONLESS_JERK: Feature = Feature {
    name: "log_dimensionless_jerk",
    title: "Log dimensionless jerk",
    family: Family::Smoothness,
    unit: "1",
    direction: Direction::Higher,
    description: "−ln(T³/v² · ∫ (d²s/dt²)² dt) of a movement's speed s with duration T and peak v; median over the \
                  movements of at most {longest_movement} s, weighted by their duration. Closer to 0 is smoother.",
    source: "Balasubramanian 2012, 2015 (LDLJ)",
    range: (-50.0, 10.0),
    spaces: BOTH,
    windowed: false,
    stretches: StretchSource::WorstLogJerk,
    habit: Some(Habit::FlowingMovements),
    measures: &[MeasureFn::Tool(log_dimensionless_jerk)],
};

/// Smoothness of the motion in space over time.
pub static NORMALISED_JERK: Feature = Feature {
    name: "normalised_jerk",
    title: "Normalised jerk",
    family: Family::Smoothness,
    unit: "1",
    direction: Direction::Lower,
    description: "√(T⁵/(2·L²) · ∫ j² dt) of a movement's jerk j with duration T and path length L; median over the \
                  movements of at most {longest_movement} s, weighted by their duration. The smoothest stroke has 19.",
    source: "Cotin 2002; EVA (Oropesa 2013)",
    range: (0.0, 1e6),
    spaces: IMAGE,
    windowed: false,
    stretches: StretchSource::WorstNormalisedJerk,
    habit: Some(Habit::FlowingMovements),
    measures: &[MeasureFn::Tool(normalised_jerk)],
};

/// Smoothness of the speed's frequency spectrum.
pub static SPECTRAL_ARC_LENGTH: Feature = Feature {
    name: "spectral_arc_length",
    title: "Spectral arc length",
    family: Family::Smoothness,
    unit: "1",
    direction: Direction::Higher,
    description: "Minus the length of the curve of a movement's normalised speed spectrum up to 10 Hz; median over \
                  the movements of at most {longest_movement} s, weighted by their duration. Closer to 0 is smoother.",
    source: "Balasubramanian 2012, 2015 (SPARC; cut-off 10 Hz, threshold 0.05, padding 4)",
    range: (-1e4, 0.0),
    spaces: BOTH,
    windowed: false,
    stretches: StretchSource::WorstSpectralArcLength,
    habit: Some(Habit::FlowingMovements),
    measures: &[MeasureFn::Tool(spectral_arc_length)],
};

/// Highest frequency of the spectrum, Hz.
const CUT_OFF_HZ: f64 = 10.0;

/// The spectrum ends at the last frequency whose amplitude is at least this share of the largest.
const MIN_AMPLITUDE: f64 = 0.05;

/// The speed profile is padded with zeros to 2⁴ times its length (rounded up to a power of two), which refines the
/// spectrum.
const PADDING: u32 = 4;

/// Number of frequencies computed at a time.
const FREQUENCY_BATCH: usize = 8;

fn movement_count(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    Ok(movements(motion, settings).len() as f64)
}

fn movement_rate(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    Ok(movement_count(motion, settings)? / (motion.observed_s() / 60.0))
}

fn normalised_jerk(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    median_over_movements(motion, settings, |movement| normalised_jerk_of(movement, motion.step_s))
}

fn log_dimensionless_jerk(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    median_over_movements(motion, settings, |movement| ldlj(&movement.speeds(), motion.step_s))
}

fn spectral_arc_length(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    median_over_movements(motion, settings, |movement| sparc(&movement.speeds(), motion.step_s))
}

/// The median of a value of each movement that is short enough, weighted by duration.
pub(super) fn median_over_movements(
    motion: &Motion,
    settings: &FeatureSettings,
    of: impl Fn(&Span) -> Option<f64>,
) -> Result<f64, NotEnough> {
    motion.check_enough(settings)?;
    let all = movements(motion, settings);
    let moving: i64 = all.iter().map(|m| m.interval().steps()).sum();
    let short = all.iter().filter(|m| m.interval().steps() as f64 * motion.step_s <= settings.longest_movement_s);
    let values: Vec<(f64, f64)> = short.filter_map(|m| Some((of(m)?, m.interval().steps() as f64))).collect();
    let share = values.iter().map(|(_, steps)| steps).sum::<f64>() / moving.max(1) as f64;
    if moving == 0 {
        Err(NotEnough::NoMovement)
    } else if values.is_empty() || share < settings.min_short_share {
        Err(NotEnough::MovementsTooLong { share, needed: settings.min_short_share })
    } else {
        Ok(weighted_quantile(values, 0.5).unwrap_or(f64::NAN))
    }
}

/// Normalised jerk of a movement; `None` if it has no length. The jerk is the change of the fitted acceleration over a
/// step; it contains as little noise as the acceleration does.
pub(in crate::motion) fn normalised_jerk_of(movement: &Span, step_s: f64) -> Option<f64> {
    let steps = || movement.nodes.iter().zip(&movement.nodes[1..]);
    let jerk: f64 = steps().map(|(a, b)| (b.acceleration - a.acceleration).norm_squared()).sum::<f64>() / step_s;
    let duration_s = (movement.nodes.len() - 1) as f64 * step_s;
    let value = (duration_s.powi(5) / (2.0 * movement.length_mm().powi(2)) * jerk).sqrt();
    value.is_finite().then_some(value)
}

/// Log dimensionless jerk of a speed profile at even steps. `None` for a profile that is too short, at rest, or of
/// perfectly constant acceleration.
pub fn ldlj(speeds: &[f64], step_s: f64) -> Option<f64> {
    let peak = speeds.iter().copied().fold(0.0, f64::max);
    let duration_s = speeds.len() as f64 * step_s;
    let second = |w: &[f64]| (w[0] - 2.0 * w[1] + w[2]) / (step_s * step_s);
    let jerk: f64 = speeds.windows(3).map(|w| second(w).powi(2)).sum::<f64>() * step_s;
    let value = -(duration_s.powi(3) / (peak * peak) * jerk).ln();
    value.is_finite().then_some(value)
}

/// Spectral arc length of a speed profile at even steps. `None` for a profile at rest or of constant speed.
pub fn sparc(speeds: &[f64], step_s: f64) -> Option<f64> {
    let spectrum = amplitudes(speeds, step_s)?;
    let last = spectrum.iter().rposition(|amplitude| *amplitude >= MIN_AMPLITUDE)?;
    let first = spectrum.iter().position(|amplitude| *amplitude >= MIN_AMPLITUDE)?;
    let bins = (last - first) as f64;
    let steps = spectrum[first..=last].windows(2).map(|w| (w[1] - w[0]).hypot(1.0 / bins));
    (last > first).then(|| -steps.sum::<f64>())
}

/// The amplitudes of the spectrum up to the cut-off, relative to the largest. A speed is never negative, so its largest
/// amplitude is at frequency 0: the sum.
fn amplitudes(speeds: &[f64], step_s: f64) -> Option<Vec<f64>> {
    let sum: f64 = speeds.iter().sum();
    let length = speeds.len().next_power_of_two() << PADDING;
    let bins = ((CUT_OFF_HZ * step_s * length as f64 + 1e-9) as usize).min(length - 1);
    let amplitudes = |first: usize| {
        // Goertzel's recurrence: one pass per frequency, without a table of sines. Several run at a time, since they
        // are independent.
        let cosine = |bin: usize| (std::f64::consts::TAU * (first + bin) as f64 / length as f64).cos();
        let turns: [f64; FREQUENCY_BATCH] = std::array::from_fn(|bin| 2.0 * cosine(bin));
        let (mut s1, mut s2) = ([0.0; FREQUENCY_BATCH], [0.0; FREQUENCY_BATCH]);
        for v in speeds {
            for bin in 0..FREQUENCY_BATCH {
                (s1[bin], s2[bin]) = (v + turns[bin] * s1[bin] - s2[bin], s1[bin]);
            }
        }
        let square = move |bin: usize| s1[bin] * s1[bin] + s2[bin] * s2[bin] - turns[bin] * s1[bin] * s2[bin];
        (0..FREQUENCY_BATCH).map(move |bin| square(bin).max(0.0).sqrt() / sum)
    };
    (sum > 0.0).then(|| (0..=bins).step_by(FREQUENCY_BATCH).flat_map(amplitudes).take(bins + 1).collect())
}

#[cfg(test)]
mod tests {
    use super::super::motion::MotionNode;
    use super::*;

    /// The reference implementation's example: speed exp(−5t²), t from −1 to 1 (excluded), 100 Hz.
    fn example() -> Vec<f64> {
        (0..200).map(|i| f64::from(i) / 100.0 - 1.0).map(|t| (-5.0 * t * t).exp()).collect()
    }

    #[test]
    fn the_reference_movement_has_the_published_spectral_arc_length() {
        assert!((sparc(&example(), 0.01).unwrap() + 1.41403).abs() < 5e-6);
    }

    #[test]
    fn the_reference_movement_has_the_published_log_dimensionless_jerk() {
        assert!((ldlj(&example(), 0.01).unwrap() + 5.81636).abs() < 5e-6);
    }

    #[test]
    fn neither_depends_on_the_size_of_the_movement() {
        let large: Vec<f64> = example().iter().map(|v| 1000.0 * v).collect();
        assert!((sparc(&large, 0.01).unwrap() - sparc(&example(), 0.01).unwrap()).abs() < 1e-9);
        assert!((ldlj(&large, 0.01).unwrap() - ldlj(&example(), 0.01).unwrap()).abs() < 1e-9);
    }

    #[test]
    fn two_pulses_in_a_row_are_less_smooth_than_one() {
        let two: Vec<f64> = example().into_iter().chain(example()).collect();
        assert!(sparc(&two, 0.01) < sparc(&example(), 0.01));
        assert!(ldlj(&two, 0.01) < ldlj(&example(), 0.01));
    }

    #[test]
    fn rest_has_no_smoothness() {
        assert_eq!((sparc(&[0.0; 50], 0.02), ldlj(&[0.0; 50], 0.02)), (None, None));
        assert_eq!((sparc(&[], 0.02), ldlj(&[], 0.02)), (None, None));
    }

    #[test]
    fn a_minimum_jerk_stroke_has_the_least_normalised_jerk() {
        let node = |k: u32| {
            let u = f64::from(k) / 100.0;
            let along = |value: f64| nalgebra::Vector3::new(value, 0.0, 0.0);
            MotionNode {
                position: along(40.0 * u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)).into(),
                velocity: along(20.0 * 30.0 * (u * (1.0 - u)).powi(2)),
                acceleration: along(10.0 * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)),
            }
        };
        let stroke = Span { first: 0, nodes: (0..=100).map(node).collect() };
        // 40 mm in 2 s: ∫ j² = 720 · 40² / 2⁵
        assert!((normalised_jerk_of(&stroke, 0.02).unwrap() - 360f64.sqrt()).abs() < 0.02);
    }
}
