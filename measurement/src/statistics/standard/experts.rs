//! Limits from people of one kind: the trimmed mean of experts, and the best share of peers.

use super::{FeatureTarget, TargetBasis};
use crate::motion::features::Direction;
use crate::numbers::distribution::beta_cdf;
use crate::statistics::interval::{ConfidenceInterval, mean, moments};
use crate::statistics::no_answer::NoAnswer;
use crate::statistics::person_values::{MIN_PEOPLE, PersonValues};

/// Minimum number of experts for a trimmed mean. Among five no value can lie two standard deviations off, since (n −
/// 1)/√n is 1.79, so nothing would ever be trimmed.
pub const MIN_EXPERTS: usize = 6;

/// An expert farther than this from the mean, in standard deviations, is left out.
const OUTLIER_SIGMAS: f64 = 2.0;

/// Standard deviation of a normal distribution that is cut off at ±2 σ, in σ: √(1 − 4φ(2)/(2Φ(2) − 1)).
const TRIMMED_DEVIATION: f64 = 0.8796;

/// The mean of the experts who lie within two standard deviations of the mean of all (jamasurgery 508246; METHOD 7.1),
/// with the mean's 95 % interval. Half of the experts miss it: it is a goal to train to, not a minimum.
///
/// # Errors
/// [`NoAnswer`] for too few experts, values without spread, or a feature where neither direction is better.
pub fn trimmed_experts(experts: &PersonValues, direction: Direction) -> Result<FeatureTarget, NoAnswer> {
    NoAnswer::at_least("experts", experts.count(), MIN_EXPERTS)?;
    let (middle, deviation) = moments(experts.values());
    let near = |value: &f64| (value - middle).abs() <= OUTLIER_SIGMAS * deviation;
    let kept: Vec<f64> = experts.values().iter().copied().filter(near).collect();
    let trimmed = mean(&kept)?;
    let widened = if kept.len() < experts.count() { 1.0 / TRIMMED_DEVIATION } else { 1.0 };
    let interval = trimmed.interval.map(|end| trimmed.value + widened * (end - trimmed.value));
    let basis = TargetBasis::TrimmedExperts { experts: experts.count(), dropped: experts.count() - kept.len() };
    FeatureTarget::new(trimmed.value, Some(interval), direction, basis)
}

/// The limit that the best share of these people meets (0.25: the best quarter, as LAP Mentor's benchmarks). Its 95 %
/// interval comes from order statistics of that quantile, which assumes no distribution (David & Nagaraja 2003, 7.1).
/// The ends are rounded outwards: all users may read a limit, and it must not reveal one person's value.
///
/// # Errors
/// [`NoAnswer`] for an unusable share, too few people, or a feature where neither direction is better.
pub fn best_share(people: &PersonValues, share: f64, direction: Direction) -> Result<FeatureTarget, NoAnswer> {
    if !(share > 0.0 && share < 1.0) {
        return Err(NoAnswer::UnusableSetting("share"));
    }
    // With fewer people all may lie on one side of the quantile, and then no two of them enclose it.
    let enclosing = (0.025f64.ln() / share.max(1.0 - share).ln()).ceil() as usize;
    NoAnswer::at_least("people", people.count(), enclosing.max(MIN_PEOPLE))?;
    let below = if direction == Direction::Higher { 1.0 - share } else { share };
    let interval = quantile_interval(people.values(), below);
    let basis = TargetBasis::BestShare { people: people.count(), share };
    FeatureTarget::new(quantile_of_all(people.values(), below), Some(interval), direction, basis)
}

/// A quantile that weights every person's value (Harrell & Davis 1982). It is more certain than one from the two
/// nearest people, and equals neither's own value.
fn quantile_of_all(sorted: &[f64], below: f64) -> f64 {
    let n = sorted.len() as f64;
    let reached = |people: usize| beta_cdf(people as f64 / n, (n + 1.0) * below, (n + 1.0) * (1.0 - below));
    sorted.iter().enumerate().map(|(index, value)| (reached(index + 1) - reached(index)) * value).sum()
}

/// Two values that enclose the population's quantile with at least 95 %.
fn quantile_interval(sorted: &[f64], below: f64) -> ConfidenceInterval {
    let n = sorted.len();
    // The chance that `k` or more of `n` people lie below the quantile.
    let or_more = |k: usize| if k == 0 { 1.0 } else { beta_cdf(below, k as f64, (n - k + 1) as f64) };
    let low = (1..=n).take_while(|k| 1.0 - or_more(*k) <= 0.025).last().unwrap_or(1);
    let high = (1..=n).find(|k| or_more(*k) <= 0.025).unwrap_or(n);
    ConfidenceInterval {
        low: round_to_two_digits(sorted[low - 1], f64::floor),
        high: round_to_two_digits(sorted[high - 1], f64::ceil),
    }
}

/// A value rounded to two digits in the given direction.
fn round_to_two_digits(value: f64, round: impl Fn(f64) -> f64) -> f64 {
    if value == 0.0 {
        return value;
    }
    let digit = 10f64.powf(value.abs().log10().floor() - 1.0);
    round(value / digit) * digit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::resampler::Resampler;

    fn people(values: &[f64]) -> PersonValues {
        PersonValues::of_values(values.to_vec()).unwrap()
    }

    #[test]
    fn an_outlier_does_not_move_the_experts_mean() {
        let calm = [40.0, 42.0, 44.0, 46.0, 48.0, 50.0, 52.0];
        let target = trimmed_experts(&people(&calm), Direction::Lower).unwrap();
        assert_eq!((target.limit, target.basis), (46.0, TargetBasis::TrimmedExperts { experts: 7, dropped: 0 }));
        // t(0.975, 6) = 2.446912 and s² = 56/3.
        let half = 2.446_911_851 * (56.0f64 / 3.0 / 7.0).sqrt();
        assert!((target.interval.unwrap().high - 46.0 - half).abs() < 1e-6);
        let with_outlier = [&calm[..], &[140.0]].concat();
        let trimmed = trimmed_experts(&people(&with_outlier), Direction::Lower).unwrap();
        assert_eq!((trimmed.limit, trimmed.basis), (46.0, TargetBasis::TrimmedExperts { experts: 8, dropped: 1 }));
    }

    #[test]
    fn the_best_quarter_of_peers_sets_the_limit() {
        let peers = people(&(1..=41).map(f64::from).collect::<Vec<_>>());
        let lower = best_share(&peers, 0.25, Direction::Lower).unwrap();
        let higher = best_share(&peers, 0.25, Direction::Higher).unwrap();
        assert!((lower.limit - 10.75).abs() < 1e-6 && (higher.limit - 31.25).abs() < 1e-6); // SciPy
        // Order statistics of a binomial(41, 0.25), each tail at most 2.5 % (SciPy): the 5th and the 17th.
        assert_eq!(lower.interval, Some(ConfidenceInterval { low: 5.0, high: 17.0 }));
        assert_eq!(higher.interval, Some(ConfidenceInterval { low: 25.0, high: 37.0 }));
    }

    #[test]
    fn a_limit_and_its_interval_equal_no_persons_value() {
        let times: Vec<f64> = (0..40).map(|i| 31.37 + 2.713 * f64::from(i)).collect();
        for share in [0.1, 1.0 / 3.0, 0.5] {
            let target = best_share(&people(&times), share, Direction::Lower).unwrap();
            let ConfidenceInterval { low, high } = target.interval.unwrap();
            for shown in [target.limit, low, high] {
                assert!(!times.iter().any(|time| (time - shown).abs() < 1e-3), "{share}: {shown}");
            }
        }
        assert_eq!(
            [
                round_to_two_digits(0.127, f64::floor),
                round_to_two_digits(127.0, f64::ceil),
                round_to_two_digits(-127.0, f64::floor)
            ],
            [0.12, 130.0, -130.0]
        );
    }

    #[test]
    fn the_interval_of_a_quantile_holds_it_in_95_of_100_samples() {
        let mut chance = Resampler::of([1.0]);
        let held = (0..2000).filter(|_| {
            let sample: Vec<f64> = (0..30).map(|_| chance.pick(1_000_000) as f64 / 1e6).collect();
            best_share(&people(&sample), 0.25, Direction::Lower).unwrap().interval.unwrap().contains(0.25)
        });
        let share = held.count() as f64 / 2000.0;
        assert!((0.94..0.99).contains(&share), "{share}");
    }

    #[test]
    fn too_few_experts_or_peers_set_no_limit() {
        let few = |of, found, needed| Err(NoAnswer::TooFew { of, found, needed });
        let values = |n: usize| people(&(0..n).map(|i| i as f64).collect::<Vec<_>>());
        assert_eq!(trimmed_experts(&values(1), Direction::Lower), few("experts", 1, 6));
        assert_eq!(trimmed_experts(&values(0), Direction::Lower), few("experts", 0, 6));
        assert_eq!(trimmed_experts(&people(&[3.0; 8]), Direction::Lower), Err(NoAnswer::NoSpread));
        assert_eq!(trimmed_experts(&values(8), Direction::Neither), Err(NoAnswer::NoDirection));
        assert_eq!(best_share(&values(9), 0.5, Direction::Lower), few("people", 9, 10));
        assert_eq!(best_share(&values(12), 0.25, Direction::Lower), few("people", 12, 13));
        assert!(best_share(&values(13), 0.25, Direction::Lower).is_ok());
        for share in [0.0, 1.0, f64::NAN] {
            assert_eq!(best_share(&values(13), share, Direction::Lower), Err(NoAnswer::UnusableSetting("share")));
        }
    }
}
