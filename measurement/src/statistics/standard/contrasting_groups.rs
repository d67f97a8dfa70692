//! The boundary between novices and experts: where the normal distributions of the two groups cross.

use super::{FeatureTarget, TargetBasis, sign};
use crate::motion::features::Direction;
use crate::numbers::distribution::{Z_95, normal_cdf, student_quantile};
use crate::statistics::interval::{ConfidenceInterval, interval_of_resamples, moments, wilson};
use crate::statistics::no_answer::NoAnswer;
use crate::statistics::person_values::{MIN_PEOPLE, PersonValues};
use crate::statistics::resampler::Resampler;

/// Number of times both groups are resampled for the limit's interval.
const RESAMPLES: usize = 400;

/// Maximum share of resamples without a boundary between the groups; with more, the limit is a matter of chance.
const MAX_LOST_RESAMPLES: f64 = 0.05;

/// How often a limit is wrong about a group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorRate {
    /// Share of the group on the wrong side by its normal distribution, 0 to 1.
    pub expected: f64,
    /// Share of the group's people that are on the wrong side, 0 to 1.
    pub seen: f64,
    /// 95 % interval of the share among all such people, from the observed share (Wilson).
    pub interval: ConfidenceInterval,
}

/// The limit at which novices and experts are equally likely (Livingston & Zieky 1982; TABLT, doi 10.1002/bjs.9857),
/// with the share of novices that pass and of experts that fail, and its 95 % interval over resampled people.
///
/// # Errors
/// [`NoAnswer`] for groups that are too small, without spread or not separated, or if neither direction is better.
pub fn contrasting_groups(
    novices: &PersonValues,
    experts: &PersonValues,
    direction: Direction,
) -> Result<FeatureTarget, NoAnswer> {
    let sign = sign(direction)?;
    NoAnswer::at_least("novices", novices.count(), MIN_PEOPLE)?;
    NoAnswer::at_least("experts", experts.count(), MIN_PEOPLE)?;
    let (novice, expert) =
        (NormalDistribution::of(novices.values(), sign)?, NormalDistribution::of(experts.values(), sign)?);
    let limit = sign * crossing(novice, expert)?;
    let basis = TargetBasis::ContrastingGroups {
        novices: novices.count(),
        experts: experts.count(),
        false_pass: meeting_rate(novices, limit, direction)?,
        false_fail: missing_rate(experts, limit, direction)?,
    };
    let interval = interval(novices.values(), experts.values(), sign, limit)?;
    FeatureTarget::new(limit, Some(interval), direction, basis)
}

/// The share of a group that meets a limit of any origin; for novices, the share that it lets pass.
///
/// # Errors
/// [`NoAnswer`] for a group that is too small or without spread, an unusable limit, or if neither direction is better.
pub fn meeting_rate(people: &PersonValues, limit: f64, direction: Direction) -> Result<ErrorRate, NoAnswer> {
    rate(people, limit, direction, true)
}

/// The share of a group that misses a limit of any origin; for experts, the share that it fails.
///
/// # Errors
/// As [`meeting_rate`].
pub fn missing_rate(people: &PersonValues, limit: f64, direction: Direction) -> Result<ErrorRate, NoAnswer> {
    rate(people, limit, direction, false)
}

fn rate(people: &PersonValues, limit: f64, direction: Direction, keeps: bool) -> Result<ErrorRate, NoAnswer> {
    let sign = sign(direction)?;
    NoAnswer::at_least("people", people.count(), MIN_PEOPLE)?;
    NoAnswer::finite(&[limit])?;
    let below = NormalDistribution::of(people.values(), sign)?.below(sign * limit);
    let counted = |value: &&f64| (sign * **value >= sign * limit) == keeps;
    let seen = people.values().iter().filter(counted).count() as f64 / people.count() as f64;
    let expected = if keeps { 1.0 - below } else { below };
    Ok(ErrorRate { expected, seen, interval: wilson(seen, people.count())? })
}

/// Resampled groups scatter less than groups of new people: by (n − 1)/n in the square, and as if the scatter were
/// known. The interval is widened accordingly.
fn interval(novices: &[f64], experts: &[f64], sign: f64, limit: f64) -> Result<ConfidenceInterval, NoAnswer> {
    let fewest = novices.len().min(experts.len()) as f64;
    let wider = (fewest / (fewest - 1.0)).sqrt() * student_quantile(0.975, fewest - 1.0) / Z_95;
    let mut chance = Resampler::of(novices.iter().chain(experts).copied());
    let mut again = || {
        let (novices, experts) = (chance.resample(novices), chance.resample(experts));
        let drawn = sign
            * crossing(NormalDistribution::of(&novices, sign).ok()?, NormalDistribution::of(&experts, sign).ok()?)
                .ok()?;
        Some(limit + wider * (drawn - limit))
    };
    let limits: Vec<f64> = (0..RESAMPLES).filter_map(|_| again()).collect();
    if (limits.len() as f64) < (1.0 - MAX_LOST_RESAMPLES) * RESAMPLES as f64 {
        return Err(NoAnswer::NotApart);
    }
    Ok(interval_of_resamples(limits))
}

/// A group's normal distribution, with the sign set so that more is better.
#[derive(Clone, Copy)]
struct NormalDistribution {
    mean: f64,
    deviation: f64,
}

impl NormalDistribution {
    fn of(values: &[f64], sign: f64) -> Result<Self, NoAnswer> {
        let (mean, deviation) = moments(values);
        if deviation > 0.0 { Ok(Self { mean: sign * mean, deviation }) } else { Err(NoAnswer::NoSpread) }
    }

    fn below(self, value: f64) -> f64 {
        normal_cdf((value - self.mean) / self.deviation)
    }

    /// Logarithm of the density, without the constant that all normal distributions share.
    fn log_density(self, value: f64) -> f64 {
        -0.5 * ((value - self.mean) / self.deviation).powi(2) - self.deviation.ln()
    }
}

/// Where the two distributions cross between their means: from the lower mean to the upper one the first density only
/// falls and the second only rises. If one is so wide that the other is below it everywhere between, they do not cross
/// there.
fn crossing(lower: NormalDistribution, upper: NormalDistribution) -> Result<f64, NoAnswer> {
    let lead = |value: f64| lower.log_density(value) - upper.log_density(value);
    let (mut low, mut high) = (lower.mean, upper.mean);
    if low >= high || lead(low) <= 0.0 || lead(high) >= 0.0 {
        return Err(NoAnswer::NotApart);
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if lead(middle) > 0.0 { low = middle } else { high = middle }
    }
    Ok(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Evenly spread quantiles of a group: mean `centre`, standard deviation about 0.6 of `reach`.
    fn group(centre: f64, reach: f64, count: usize) -> PersonValues {
        let place = |i: usize| centre + reach * (2.0 * i as f64 / (count - 1) as f64 - 1.0);
        PersonValues::of_values((0..count).map(place).collect()).unwrap()
    }

    fn rates(target: &FeatureTarget) -> (ErrorRate, ErrorRate) {
        match target.basis {
            TargetBasis::ContrastingGroups { false_pass, false_fail, .. } => (false_pass, false_fail),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn equally_spread_groups_are_parted_in_the_middle() {
        let (novices, experts) = (group(101.0, 30.0, 13), group(59.0, 30.0, 13));
        let target = contrasting_groups(&novices, &experts, Direction::Lower).unwrap();
        assert!((target.limit - 80.0).abs() < 1e-9, "{target:?}");
        let (_, deviation) = moments(novices.values());
        let (false_pass, false_fail) = rates(&target);
        let tail = normal_cdf(-21.0 / deviation);
        assert!((false_pass.expected - tail).abs() < 1e-9 && (false_fail.expected - tail).abs() < 1e-9);
        // Novices stand at 71, 76, 81 …, experts at … 79, 84, 89.
        assert!((false_pass.seen - 2.0 / 13.0).abs() < 1e-12 && (false_fail.seen - 2.0 / 13.0).abs() < 1e-12);
        let interval = target.interval.unwrap();
        assert!(interval.contains(80.0) && interval.low > 70.0 && interval.high < 90.0, "{interval:?}");
    }

    #[test]
    fn moving_the_limit_trades_one_error_for_the_other_and_beside_it_there_is_no_third() {
        let (novices, experts) = (group(101.0, 30.0, 13), group(59.0, 30.0, 13));
        let lower = Direction::Lower;
        let at = |limit| (meeting_rate(&novices, limit, lower).unwrap(), missing_rate(&experts, limit, lower).unwrap());
        let (strict, mild) = (at(70.0), at(90.0));
        assert!(strict.0.expected < mild.0.expected && strict.0.seen < mild.0.seen, "{strict:?} {mild:?}");
        assert!(strict.1.expected > mild.1.expected && strict.1.seen > mild.1.seen, "{strict:?} {mild:?}");
        for limit in [60.0, 71.0, 100.0] {
            let (kept, broken) =
                (meeting_rate(&novices, limit, lower).unwrap(), missing_rate(&novices, limit, lower).unwrap());
            assert!(
                (kept.seen + broken.seen - 1.0).abs() < 1e-12 && (kept.expected + broken.expected - 1.0).abs() < 1e-12
            );
        }
        let few = group(101.0, 30.0, MIN_PEOPLE - 1);
        assert!(matches!(meeting_rate(&few, 80.0, lower), Err(NoAnswer::TooFew { .. })));
        assert!(meeting_rate(&novices, f64::NAN, lower).is_err());
    }

    #[test]
    fn unequal_spreads_move_the_line_towards_the_narrow_group() {
        // Laws of N(0, 1) and N(4, 2) cross where 3x² + 8x − 16 − 8 ln 2 = 0.
        let (lower, upper) =
            (NormalDistribution { mean: 0.0, deviation: 1.0 }, NormalDistribution { mean: 4.0, deviation: 2.0 });
        let want = (-8.0 + (64.0 + 12.0 * (16.0 + 8.0 * 2.0f64.ln())).sqrt()) / 6.0;
        assert!((crossing(lower, upper).unwrap() - want).abs() < 1e-12);
        assert!(want < 2.0);
    }

    #[test]
    fn the_direction_only_mirrors() {
        let (novices, experts) = (group(100.0, 30.0, 13), group(50.0, 17.0, 11));
        let mirrored =
            |people: &PersonValues| PersonValues::of_values(people.values().iter().map(|v| -v).collect()).unwrap();
        let lower = contrasting_groups(&novices, &experts, Direction::Lower).unwrap();
        let higher = contrasting_groups(&mirrored(&novices), &mirrored(&experts), Direction::Higher).unwrap();
        assert!((lower.limit + higher.limit).abs() < 1e-9);
        assert!((rates(&lower).0.expected - rates(&higher).0.expected).abs() < 1e-9);
        assert_eq!(lower, contrasting_groups(&novices, &experts, Direction::Lower).unwrap());
    }

    #[test]
    fn groups_that_are_not_apart_have_no_line() {
        let of = |novices: PersonValues, experts: &PersonValues| {
            contrasting_groups(&novices, experts, Direction::Lower).map(|target| target.limit)
        };
        let calm = group(60.0, 10.0, 12);
        assert_eq!(of(group(50.0, 10.0, 12), &calm), Err(NoAnswer::NotApart), "experts are worse");
        assert_eq!(of(group(61.0, 10.0, 12), &calm), Err(NoAnswer::NotApart), "apart by chance only");
        assert_eq!(of(group(62.0, 90.0, 12), &calm), Err(NoAnswer::NotApart), "one inside the other");
        assert_eq!(of(PersonValues::of_values(vec![90.0; 12]).unwrap(), &calm), Err(NoAnswer::NoSpread));
    }

    #[test]
    fn a_class_of_one_has_no_line() {
        let (one, many) = (PersonValues::of_values(vec![80.0]).unwrap(), group(60.0, 10.0, 12));
        let too_few = |of| Err(NoAnswer::TooFew { of, found: 1, needed: 10 });
        assert_eq!(contrasting_groups(&one, &many, Direction::Lower), too_few("novices"));
        assert_eq!(contrasting_groups(&many, &one, Direction::Lower), too_few("experts"));
        assert_eq!(contrasting_groups(&many, &many, Direction::Neither), Err(NoAnswer::NoDirection));
    }
}
