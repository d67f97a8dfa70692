//! Agreement of two measures, or of several raters: correlations of features with ratings, and the intraclass
//! correlation of raters.
//!
//! Each person counts once: two sessions of one person are alike in both measures and would make any two measures
//! agree.

mod icc;
mod same_raters;

pub use icc::{IccForm, MIN_RATED, Reliability, icc};
pub use same_raters::{SameRaters, same_raters};

use super::interval::{ConfidenceInterval, moments};
use super::no_answer::NoAnswer;
use super::person_values::{MIN_PEOPLE, check_each_once};
use crate::numbers::distribution::Z_95;

/// A correlation of two measures of the same people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correlation {
    /// The coefficient, −1 to 1.
    pub value: f64,
    /// 95 % interval of the coefficient for all such people.
    pub interval: ConfidenceInterval,
    /// Number of people.
    pub people: usize,
}

/// Spearman's ρ of one row per person: Pearson's r of the ranks, where equal values share a rank. The interval is that
/// of Bonett & Wright (2000): the variance of atanh ρ is (1 + ρ²/2) / (n − 3).
///
/// # Errors
/// [`NoAnswer`] for a person with two rows, too few people, unusable values, or values without spread or scatter.
pub fn spearman<P: Ord>(rows: &[(P, f64, f64)]) -> Result<Correlation, NoAnswer> {
    let [a, b] = columns(rows)?;
    correlation(&ranks(&a), &ranks(&b))
}

fn columns<P: Ord>(rows: &[(P, f64, f64)]) -> Result<[Vec<f64>; 2], NoAnswer> {
    check_each_once(rows.iter().map(|(person, ..)| person))?;
    NoAnswer::at_least("people", rows.len(), MIN_PEOPLE)?;
    let columns = [rows.iter().map(|row| row.1).collect(), rows.iter().map(|row| row.2).collect::<Vec<f64>>()];
    columns.iter().try_for_each(|column| NoAnswer::finite(column))?;
    Ok(columns)
}

/// Pearson's r with the interval for ranks.
fn correlation(a: &[f64], b: &[f64]) -> Result<Correlation, NoAnswer> {
    let ((mean_a, spread_a), (mean_b, spread_b)) = (moments(a), moments(b));
    if spread_a == 0.0 || spread_b == 0.0 {
        return Err(NoAnswer::NoSpread);
    }
    let n = a.len() as f64;
    let product = |(a, b): (&f64, &f64)| (a - mean_a) / spread_a * ((b - mean_b) / spread_b);
    let value = a.iter().zip(b).map(product).sum::<f64>() / (n - 1.0);
    if value.abs() > 1.0 - 1e-12 {
        return Err(NoAnswer::Perfect);
    }
    let half = Z_95 * ((1.0 + value * value / 2.0) / (n - 3.0)).sqrt();
    let interval = ConfidenceInterval::around(value.atanh(), half).map(f64::tanh);
    Ok(Correlation { value, interval, people: a.len() })
}

/// The rank of each value, from 1; equal values get the mean of their ranks.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = |value: &f64| {
        let below = sorted.partition_point(|other| other < value);
        let not_above = sorted.partition_point(|other| other <= value);
        (below + not_above + 1) as f64 / 2.0
    };
    values.iter().map(rank).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Means of the immediate and the delayed transfer test of 22 people: completion score, seconds per suture. From
    /// the data of "Bimanual coordination analysis" 1.2.0
    /// (github.com/ywdreamchaser/bimanual-coordination-laparoscopic-suturing, CC BY 4.0), which publishes their
    /// correlation.
    const SUTURES: [(f64, f64); 22] = [
        (14.5, 46.707593450000005),
        (4.25, 157.8051715),
        (11.5, 61.24264015),
        (4.625, 159.04806250000001),
        (4.75, 153.050909),
        (4.25, 176.89335699999998),
        (4.0, 141.59931749999998),
        (4.5, 111.86635000000001),
        (3.0, 233.14437500000003),
        (4.625, 149.9117895),
        (3.75, 284.42758335),
        (2.125, 402.3809615),
        (5.25, 106.79266685),
        (7.875, 76.0862286),
        (2.25, 262.0177),
        (2.5, 290.1624765),
        (7.375, 98.54392365),
        (2.75, 240.7372335),
        (6.5, 88.84545449999999),
        (1.75, 359.4846665),
        (3.5, 193.03485),
        (3.25, 194.0530235),
    ];

    fn rows(pairs: &[(f64, f64)]) -> Vec<(usize, f64, f64)> {
        pairs.iter().enumerate().map(|(person, (a, b))| (person, *a, *b)).collect()
    }

    #[test]
    fn the_published_correlation_of_score_and_time_is_reproduced() {
        let [scores, times] = columns(&rows(&SUTURES)).unwrap();
        let got = correlation(&scores, &times).unwrap();
        assert!((got.value + 0.763_925_876_091_347_8).abs() < 1e-12, "{got:?}");
        // ρ: SciPy 1.17; its interval by Bonett & Wright's formula.
        let ranked = spearman(&rows(&SUTURES)).unwrap();
        assert_eq!(ranked.people, 22);
        assert!((ranked.value + 0.945_762_862_804_898_7).abs() < 1e-12, "{ranked:?}");
        assert!(
            (ranked.interval.low + 0.9812799354).abs() < 1e-9 && (ranked.interval.high + 0.8480289173).abs() < 1e-9,
            "{ranked:?}"
        );
    }

    #[test]
    fn ranks_do_not_change_if_values_are_bent() {
        let bent: Vec<(f64, f64)> = SUTURES.iter().map(|(a, b)| (a.exp(), -b.ln())).collect();
        let (plain, bent) = (spearman(&rows(&SUTURES)).unwrap(), spearman(&rows(&bent)).unwrap());
        assert!((plain.value + bent.value).abs() < 1e-12 && (plain.interval.low + bent.interval.high).abs() < 1e-12);
        assert_eq!(ranks(&[3.0, 1.0, 3.0, 9.0]), [2.5, 1.0, 2.5, 4.0]);
    }

    #[test]
    fn what_cannot_be_correlated_gives_a_reason() {
        let mut twice = rows(&SUTURES);
        twice[3].0 = twice[7].0;
        assert_eq!(spearman(&twice), Err(NoAnswer::PersonTwice));
        assert_eq!(spearman(&rows(&SUTURES[..9])), Err(NoAnswer::TooFew { of: "people", found: 9, needed: 10 }));
        assert_eq!(spearman::<u8>(&[]), Err(NoAnswer::TooFew { of: "people", found: 0, needed: 10 }));
        let with = |change: fn((f64, f64)) -> (f64, f64)| rows(&SUTURES.map(change));
        assert_eq!(spearman(&with(|(a, _)| (a, 3.0))), Err(NoAnswer::NoSpread));
        assert_eq!(spearman(&with(|(a, _)| (a, f64::NAN))), Err(NoAnswer::NotFinite));
        assert_eq!(spearman(&with(|(a, _)| (a, a.exp()))), Err(NoAnswer::Perfect));
    }
}
