//! Features of the velocity's spectrum: the share of tremor in the motion, and the frequency of the hand's corrections.
//!
//! **Method** (Welch 1967): the path is divided into stretches of 2.56 s that overlap by half, each faded in and out by
//! a Hann window. The powers of their velocity spectra are added, over both components, so that no direction is
//! preferred. The path is already smoothed: the local fit passes 90 % of 3 Hz, half of 6 Hz and almost nothing of 10
//! Hz, at every frame rate. Measured in the picture only: tremor in depth comes from the tracker.

use nalgebra::Complex;

use super::motion::{Motion, MotionNode, Span};
use super::movement::movements;
use super::{Direction, Family, Feature, FeatureSettings, Habit, IMAGE, MeasureFn, NotEnough, StretchSource};

/// Share of tremor in the motion.
pub static TREMOR_SHARE: Feature = Feature {
    name: "tremor_share",
    title: "Share of 3 to 6 Hz",
    family: Family::Smoothness,
    unit: "1",
    direction: Direction::Lower,
    description: "The share of the velocity's power that lies between 3 and 6 Hz, after the smoothing by the path's \
                  fit.",
    source: "band power of 3–6 Hz, the strongest feature after jerk in a study of the JIGSAWS recordings; Welch's \
             estimate",
    range: (0.0, 1.0),
    spaces: IMAGE,
    windowed: false,
    stretches: StretchSource::TremorBursts,
    habit: Some(Habit::SteadyHand),
    measures: &[MeasureFn::Tool(tremor_share)],
};

/// Frequency of the hand's corrections.
pub static MOTION_FREQUENCY: Feature = Feature {
    name: "motion_frequency",
    title: "Motion frequency (95 %)",
    family: Family::Smoothness,
    unit: "Hz",
    direction: Direction::Lower,
    description: "The frequency below which 95 % of the velocity's power lies.",
    source: "95 % frequency of the tip's motion: separates experts, residents and novices where mean jerk does not",
    range: (0.0, 500.0),
    spaces: IMAGE,
    windowed: false,
    stretches: StretchSource::FastBursts,
    habit: Some(Habit::SteadyHand),
    measures: &[MeasureFn::Tool(motion_frequency)],
};

/// The band of tremor, Hz.
pub(in crate::motion) const TREMOR_HZ: (f64, f64) = (3.0, 6.0);

/// Length of a stretch, s, before it is rounded to a power of two instants.
const STRETCH_S: f64 = 2.56;

fn tremor_share(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let Spectrum { powers, bin_hz } = Spectrum::of(motion, settings)?;
    Ok(power_within(&powers, bin_hz, TREMOR_HZ) / powers.iter().sum::<f64>())
}

fn motion_frequency(motion: &Motion, settings: &FeatureSettings) -> Result<f64, NotEnough> {
    let Spectrum { powers, bin_hz } = Spectrum::of(motion, settings)?;
    let mut left = 0.95 * powers.iter().sum::<f64>();
    let reached = powers.iter().position(|power| {
        left -= power;
        left <= 0.0
    });
    let bin = reached.unwrap_or(powers.len() - 1);
    let part = 1.0 + left.min(0.0) / powers[bin].max(f64::MIN_POSITIVE); // the needed part of the last bin
    Ok(((bin as f64 - 0.5 + part) * bin_hz).max(0.0))
}

/// The velocity's power by frequency, in an arbitrary unit.
struct Spectrum {
    /// Power of each bin, starting at 0 Hz.
    powers: Vec<f64>,
    /// Distance of two bins, Hz.
    bin_hz: f64,
}

impl Spectrum {
    fn of(motion: &Motion, settings: &FeatureSettings) -> Result<Self, NotEnough> {
        motion.check_enough(settings)?;
        if movements(motion, settings).is_empty() {
            return Err(NotEnough::NoMovement); // the spectrum would be that of noise
        }
        let length = stretch_nodes(motion.step_s);
        let long_enough = || motion.spans.iter().filter(move |span| span.nodes.len() >= length);
        let covered: usize = long_enough().map(|span| span.nodes.len()).sum();
        if covered < motion.observed_steps() / 2 || covered == 0 {
            return Err(NotEnough::NoStretch { needed_s: length as f64 * motion.step_s });
        }
        let transform = FourierTransform::new(length);
        let mut powers = vec![0.0; length / 2 + 1];
        for stretch in long_enough().flat_map(|span| stretches(span, length)) {
            transform.add_powers(stretch, &mut powers);
        }
        Ok(Self { powers, bin_hz: 1.0 / (length as f64 * motion.step_s) })
    }
}

/// Stretches that overlap by half, in the middle of a span.
fn stretches(span: &Span, length: usize) -> impl Iterator<Item = &[MotionNode]> {
    let left_over = (span.nodes.len() - length) % (length / 2);
    span.nodes[left_over / 2..].windows(length).step_by(length / 2)
}

/// Measures how fast a tip moves within frequency bands, stretch by stretch.
pub(in crate::motion) struct BandSpeeds {
    transform: FourierTransform,
    bin_hz: f64,
}

impl BandSpeeds {
    /// Prepares for motions on a grid of this step.
    pub(in crate::motion) fn new(step_s: f64) -> Self {
        let length = stretch_nodes(step_s);
        Self { transform: FourierTransform::new(length), bin_hz: 1.0 / (length as f64 * step_s) }
    }

    /// Number of nodes of a stretch.
    pub(in crate::motion) fn length(&self) -> usize {
        self.transform.window.len()
    }

    /// Root mean square speed within a band over a stretch of that many nodes, mm/s (Parseval).
    pub(in crate::motion) fn rms_mm_s(&self, stretch: &[MotionNode], low_hz: f64, high_hz: f64) -> f64 {
        let mut powers = vec![0.0; self.length() / 2 + 1];
        self.transform.add_powers(stretch, &mut powers);
        let squares: f64 = self.transform.window.iter().map(|weight| weight * weight).sum();
        (power_within(&powers, self.bin_hz, (low_hz, high_hz)) / (self.length() as f64 * squares)).sqrt()
    }
}

/// Number of nodes of a stretch on a grid of this step.
fn stretch_nodes(step_s: f64) -> usize {
    ((STRETCH_S / step_s).round() as usize).next_power_of_two()
}

/// The power within a band; a bin at its border counts in proportion.
fn power_within(powers: &[f64], bin_hz: f64, (low_hz, high_hz): (f64, f64)) -> f64 {
    let share_of_bin = |bin: usize| {
        let (low, high) = ((bin as f64 - 0.5) * bin_hz, (bin as f64 + 0.5) * bin_hz);
        ((high.min(high_hz) - low.max(low_hz)) / bin_hz).clamp(0.0, 1.0)
    };
    powers.iter().enumerate().map(|(bin, power)| share_of_bin(bin) * power).sum()
}

/// A fast Fourier transform of one length, a power of two.
struct FourierTransform {
    window: Vec<f64>,
    /// e^(−2πi·k/length), for the first half of the circle.
    twiddles: Vec<Complex<f64>>,
}

impl FourierTransform {
    fn new(length: usize) -> Self {
        let angle = |k: usize| std::f64::consts::TAU * k as f64 / length as f64;
        Self {
            window: (0..length).map(|k| 0.5 - 0.25 * (angle(k).cos() + angle(k + 1).cos())).collect(),
            twiddles: (0..length / 2).map(|k| Complex::new(angle(k).cos(), -angle(k).sin())).collect(),
        }
    }

    /// Adds the power of a stretch's velocity to each bin. The two components are the two parts of a complex number;
    /// their power at a frequency is half of the sum of the powers at that frequency and at its negative.
    fn add_powers(&self, stretch: &[MotionNode], powers: &mut [f64]) {
        let faded = stretch.iter().zip(&self.window);
        let faded = faded.map(|(node, weight)| Complex::new(node.velocity.x, node.velocity.y) * *weight);
        let values = self.apply(&faded.collect::<Vec<_>>());
        for (bin, power) in powers.iter_mut().enumerate() {
            let negative = (values.len() - bin) % values.len();
            *power += values[bin].norm_sqr() + if negative == bin { 0.0 } else { values[negative].norm_sqr() };
        }
    }

    /// Decimation in time (Cooley & Tukey 1965).
    fn apply(&self, values: &[Complex<f64>]) -> Vec<Complex<f64>> {
        let length = values.len();
        let shift = usize::BITS - length.trailing_zeros();
        let mut out: Vec<Complex<f64>> = (0..length).map(|k| values[k.reverse_bits() >> shift]).collect();
        let mut half = 1;
        while half < length {
            for block in out.chunks_exact_mut(2 * half) {
                let (even, odd) = block.split_at_mut(half);
                for (k, (a, b)) in even.iter_mut().zip(odd).enumerate() {
                    let turned = *b * self.twiddles[k * (length / 2 / half)];
                    (*a, *b) = (*a + turned, *a - turned);
                }
            }
            half *= 2;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transform_is_that_of_its_definition() {
        let values: Vec<Complex<f64>> = (0..16).map(|k| Complex::new(f64::from(k * k % 7), f64::from(k % 5))).collect();
        let fast = FourierTransform::new(16).apply(&values);
        for (bin, fast) in fast.iter().enumerate() {
            let turn = |k: usize| -std::f64::consts::TAU * (bin * k) as f64 / 16.0;
            let slow: Complex<f64> =
                values.iter().enumerate().map(|(k, v)| v * Complex::new(turn(k).cos(), turn(k).sin())).sum();
            assert!((fast - slow).norm() < 1e-9, "{bin}");
        }
    }
}
