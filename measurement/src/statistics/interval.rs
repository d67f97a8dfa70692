//! Confidence intervals of 95 %, and values that carry one.

use super::no_answer::NoAnswer;
use crate::numbers::distribution::{Z_95, student_quantile};

/// A range that contains a quantity with a confidence of 95 %, in the quantity's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConfidenceInterval {
    /// Its lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

impl ConfidenceInterval {
    /// True if the value is inside, ends included.
    pub fn contains(self, value: f64) -> bool {
        self.low <= value && value <= self.high
    }

    pub(super) fn around(centre: f64, half: f64) -> Self {
        Self { low: centre - half, high: centre + half }
    }

    pub(super) fn map(self, of: impl Fn(f64) -> f64) -> Self {
        let (a, b) = (of(self.low), of(self.high));
        Self { low: a.min(b), high: a.max(b) }
    }
}

/// A measured value with its error bar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredValue {
    /// The value, in the feature's unit.
    pub value: f64,
    /// 95 % interval of the true value; `None` if the error is unknown (a foreign file without sigmas).
    pub bar: Option<ConfidenceInterval>,
}

impl MeasuredValue {
    /// Checks that the value is a usable number and that its bar contains it.
    pub(super) fn checked(self) -> Result<Self, NoAnswer> {
        let bar = self.bar.unwrap_or(ConfidenceInterval { low: self.value, high: self.value });
        NoAnswer::finite(&[self.value, bar.low, bar.high])?;
        if bar.contains(self.value) { Ok(self) } else { Err(NoAnswer::NotFinite) }
    }
}

/// A mean with the interval of the mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// The mean.
    pub value: f64,
    /// 95 % interval of the population's mean (Student's t), assuming independent and nearly normal values.
    pub interval: ConfidenceInterval,
    /// Standard deviation of one value (n − 1 in the denominator).
    pub deviation: f64,
    /// Number of values.
    pub n: usize,
}

/// The mean of independent values (one per person) with Student's interval: x̄ ± t(0.975, n − 1) · s / √n.
///
/// # Errors
/// [`NoAnswer`] for fewer than two values, unusable values, or values without spread.
pub fn mean(values: &[f64]) -> Result<Mean, NoAnswer> {
    NoAnswer::finite(values)?;
    NoAnswer::at_least("values", values.len(), 2)?;
    let n = values.len() as f64;
    let (value, deviation) = moments(values);
    if deviation <= 0.0 {
        return Err(NoAnswer::NoSpread);
    }
    let half = student_quantile(0.975, n - 1.0) * deviation / n.sqrt();
    Ok(Mean { value, interval: ConfidenceInterval::around(value, half), deviation, n: values.len() })
}

/// Mean and standard deviation (n − 1); a deviation within rounding counts as 0.
pub(super) fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    let deviation = (squares / (n - 1.0)).sqrt();
    (mean, if deviation > 1e-12 * mean.abs() { deviation } else { 0.0 })
}

/// Wilson's 95 % interval of a share observed in `n` independent draws. Unlike the normal interval it stays within 0 to
/// 1 and is meaningful at both ends (Brown, Cai & DasGupta 2001).
///
/// # Errors
/// [`NoAnswer`] without draws, or for a share outside 0 to 1.
pub fn wilson(share: f64, n: usize) -> Result<ConfidenceInterval, NoAnswer> {
    NoAnswer::at_least("draws", n, 1)?;
    if !(0.0..=1.0).contains(&share) {
        return Err(NoAnswer::NotFinite);
    }
    let (n, z2) = (n as f64, Z_95 * Z_95);
    let centre = share + z2 / (2.0 * n);
    let half = (z2 * (share * (1.0 - share) / n + z2 / (4.0 * n * n))).sqrt();
    Ok(ConfidenceInterval::around(centre, half).map(|end| (end / (1.0 + z2 / n)).clamp(0.0, 1.0)))
}

/// The interval that leaves 2.5 % of the resamples on each side. The resamples may be unsorted and infinite.
pub(super) fn interval_of_resamples(mut values: Vec<f64>) -> ConfidenceInterval {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
    ConfidenceInterval { low: at(0.025), high: at(0.975) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_holds_its_share_shrinks_with_the_draws_and_stays_within_nought_and_one() {
        let rough = wilson(0.95, 100).unwrap(); // (0.888, 0.978) in Brown, Cai & DasGupta 2001
        assert!((rough.low - 0.8882).abs() < 1e-3 && (rough.high - 0.9785).abs() < 1e-3, "{rough:?}");
        let tight = wilson(0.95, 10_000).unwrap();
        assert!(rough.low < tight.low && tight.low < 0.95 && 0.95 < tight.high && tight.high < rough.high);
        for (seen, n, want) in [(0.0, 10, [0.0, 0.2775]), (5.0, 10, [0.2366, 0.7634]), (18.0, 24, [0.5510, 0.8800])] {
            let got = wilson(seen / n as f64, n).unwrap();
            assert!((got.low - want[0]).abs() < 5e-5 && (got.high - want[1]).abs() < 5e-5, "{seen} of {n}: {got:?}");
        }
    }

    #[test]
    fn a_mean_has_the_published_interval() {
        // Counts of 11 people: `lt_rn_count`, baseline, workload_adapted. From the data of "Bimanual coordination
        // analysis" 1.2.0 (github.com/ywdreamchaser/bimanual-coordination-laparoscopic-suturing, CC BY 4.0), with the
        // mean, deviation and interval that its own tables publish.
        let got = mean(&[22.0, 15.0, 27.0, 34.0, 25.0, 22.0, 28.0, 22.0, 31.0, 17.0, 23.0]).unwrap();
        assert_eq!(got.n, 11);
        assert!((got.value - 24.181_818_18).abs() < 1e-7 && (got.deviation - 5.635_924).abs() < 1e-6, "{got:?}");
        assert!(
            (got.interval.low - 20.395_553).abs() < 1e-6 && (got.interval.high - 27.968_083).abs() < 1e-6,
            "{got:?}"
        );
    }

    #[test]
    fn values_without_an_interval_give_a_reason() {
        assert_eq!(mean(&[]), Err(NoAnswer::TooFew { of: "values", found: 0, needed: 2 }));
        assert_eq!(mean(&[3.0]), Err(NoAnswer::TooFew { of: "values", found: 1, needed: 2 }));
        assert_eq!(mean(&[3.1; 7]), Err(NoAnswer::NoSpread));
        assert_eq!(mean(&[1.0, f64::NAN]), Err(NoAnswer::NotFinite));
        assert_eq!(wilson(0.5, 0), Err(NoAnswer::TooFew { of: "draws", found: 0, needed: 1 }));
        assert_eq!(wilson(f64::NAN, 5), Err(NoAnswer::NotFinite));
        assert_eq!(wilson(1.1, 5), Err(NoAnswer::NotFinite));
    }

    #[test]
    fn a_bar_that_does_not_hold_its_value_is_refused() {
        let measured = |value, low, high| MeasuredValue { value, bar: Some(ConfidenceInterval { low, high }) };
        assert!(measured(1.0, 0.5, 1.5).checked().is_ok());
        assert_eq!(measured(1.0, 1.5, 0.5).checked(), Err(NoAnswer::NotFinite));
        assert_eq!(measured(1.0, 2.0, 3.0).checked(), Err(NoAnswer::NotFinite));
        assert_eq!(measured(1.0, 0.0, f64::INFINITY).checked(), Err(NoAnswer::NotFinite));
        assert_eq!(MeasuredValue { value: f64::NAN, bar: None }.checked(), Err(NoAnswer::NotFinite));
    }
}
