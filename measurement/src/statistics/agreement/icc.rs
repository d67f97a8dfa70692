//! Intraclass correlation: the share of the ratings' variance that lies between the rated people (Shrout & Fleiss 1979;
//! McGraw & Wong 1996 for the intervals).

use super::check_each_once;
use crate::numbers::distribution::fisher_quantile;
use crate::statistics::interval::ConfidenceInterval;
use crate::statistics::no_answer::NoAnswer;

/// Minimum number of rated people: as in Shrout and Fleiss's example, whose intervals already span half of the scale.
pub const MIN_RATED: usize = 6;

/// The form of the intraclass correlation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IccForm {
    /// ICC(2,1): the same raters rate all people and represent all raters; a strict rater counts as disagreement.
    Agreement,
    /// ICC(2,k): the mean of all raters, as [`IccForm::Agreement`].
    AgreementMean,
}

/// An intraclass correlation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reliability {
    /// The coefficient: 1 if raters agree; below 0 if they differ more within people than between them.
    pub value: f64,
    /// 95 % interval of the coefficient for all such people (and raters, depending on the form).
    pub interval: ConfidenceInterval,
    /// Number of rated people.
    pub people: usize,
    /// Number of raters.
    pub raters: usize,
}

/// The intraclass correlation of one row per person: the person, and the ratings by each rater in the same order.
///
/// # Errors
/// [`NoAnswer`] for a person with two rows, too few people or raters, gaps, unusable ratings, or ratings that do not
/// support the coefficient.
pub fn icc<P: Ord>(rows: &[(P, Vec<f64>)], form: IccForm) -> Result<Reliability, NoAnswer> {
    check_each_once(rows.iter().map(|(person, _)| person))?;
    NoAnswer::at_least("people rated", rows.len(), MIN_RATED)?;
    let ratings: Vec<&[f64]> = rows.iter().map(|(_, ratings)| ratings.as_slice()).collect();
    if ratings.iter().any(|row| row.len() != ratings[0].len()) {
        return Err(NoAnswer::Ragged);
    }
    NoAnswer::at_least("raters", ratings[0].len(), 2)?;
    ratings.iter().try_for_each(|row| NoAnswer::finite(row))?;
    let squares = MeanSquares::of(&ratings)?;
    let (value, interval) = match form {
        IccForm::Agreement => squares.agreement()?,
        IccForm::AgreementMean => squares.of_mean(icc(rows, IccForm::Agreement)?)?,
    };
    Ok(Reliability { value, interval, people: rows.len(), raters: ratings[0].len() })
}

/// The mean squares of the rating table.
struct MeanSquares {
    /// People, n.
    n: f64,
    /// Raters, k.
    k: f64,
    /// Mean square between people.
    people: f64,
    /// Mean square between raters.
    raters: f64,
    /// Residual mean square, explained neither by people nor by raters.
    error: f64,
}

impl MeanSquares {
    fn of(ratings: &[&[f64]]) -> Result<Self, NoAnswer> {
        let (n, k) = (ratings.len() as f64, ratings[0].len() as f64);
        let person: Vec<f64> = ratings.iter().map(|row| row.iter().sum::<f64>() / k).collect();
        let rater: Vec<f64> =
            (0..ratings[0].len()).map(|j| ratings.iter().map(|row| row[j]).sum::<f64>() / n).collect();
        let mean = person.iter().sum::<f64>() / n;
        let about = |means: &[f64]| means.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        let (people, raters) = (k * about(&person), n * about(&rater));
        let total: f64 = ratings.iter().map(|row| about(row)).sum();
        // These are differences of sums of squares, so a remainder within rounding counts as 0.
        let rounding = 1e-12 * total;
        if people <= rounding {
            return Err(NoAnswer::NoSpread);
        }
        let left = |squares: f64| if squares > rounding { squares } else { 0.0 };
        Ok(Self {
            n,
            k,
            people: people / (n - 1.0),
            raters: raters / (k - 1.0),
            error: left(total - people - raters) / ((n - 1.0) * (k - 1.0)),
        })
    }

    /// ICC(2,1): the raters are a sample too; degrees of freedom by Satterthwaite.
    fn agreement(&self) -> Result<(f64, ConfidenceInterval), NoAnswer> {
        let Self { n, k, people, raters, error } = *self;
        if error == 0.0 {
            return Err(NoAnswer::Perfect);
        }
        let value = (people - error) / (people + (k - 1.0) * error + k * (raters - error) / n);
        if value <= self.lowest() {
            return Err(NoAnswer::Discord);
        }
        let (by_raters, by_error) = (k * value * raters / error, n * (1.0 + (k - 1.0) * value) - k * value);
        let freedom = (k - 1.0) * (n - 1.0) * (by_raters + by_error).powi(2)
            / ((n - 1.0) * by_raters * by_raters + by_error * by_error);
        let freedom = freedom.max(1.0);
        let below = fisher_quantile(0.975, n - 1.0, freedom);
        let above = fisher_quantile(0.975, freedom, n - 1.0);
        let rest = k * raters + (k * n - k - n) * error;
        let low = n * (people - below * error) / (below * rest + n * people);
        let high = n * (above * people - error) / (rest + n * above * people);
        Ok((value, ConfidenceInterval { low: low.max(self.lowest()), high }))
    }

    /// The lowest possible value: people do not differ at all, but the ratings of each do.
    fn lowest(&self) -> f64 {
        -1.0 / (self.k - 1.0)
    }

    /// From one rater to the mean of all (Spearman and Brown); the formula has a pole at the lowest value.
    fn of_mean(&self, one: Reliability) -> Result<(f64, ConfidenceInterval), NoAnswer> {
        if one.interval.low <= self.lowest() {
            return Err(NoAnswer::Discord);
        }
        let mean = |value: f64| self.k * value / (1.0 + (self.k - 1.0) * value);
        Ok((mean(one.value), one.interval.map(mean)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six people by four raters (Shrout & Fleiss 1979, table 2).
    const PUBLISHED: [[f64; 4]; 6] = [
        [9.0, 2.0, 5.0, 8.0],
        [6.0, 1.0, 3.0, 2.0],
        [8.0, 4.0, 6.0, 8.0],
        [7.0, 1.0, 2.0, 6.0],
        [10.0, 5.0, 6.0, 9.0],
        [6.0, 2.0, 4.0, 7.0],
    ];

    fn rows<const K: usize>(table: &[[f64; K]]) -> Vec<(usize, Vec<f64>)> {
        table.iter().enumerate().map(|(person, ratings)| (person, ratings.to_vec())).collect()
    }

    #[test]
    fn both_forms_have_the_published_values_and_intervals() {
        // Values to four decimals: those of the paper, recomputed. Intervals as printed by R's psych package for this
        // table.
        let cases = [(IccForm::Agreement, 0.2898, [0.019, 0.761]), (IccForm::AgreementMean, 0.6201, [0.071, 0.927])];
        for (form, value, [low, high]) in cases {
            let got = icc(&rows(&PUBLISHED), form).unwrap();
            assert!((got.value - value).abs() < 5e-5, "{form:?}: {got:?}");
            let ConfidenceInterval { low: got_low, high: got_high } = got.interval;
            assert!((got_low - low).abs() < 1e-3 && (got_high - high).abs() < 1e-3, "{form:?}: {got:?}");
            assert_eq!((got.people, got.raters), (6, 4));
        }
    }

    #[test]
    fn a_strict_rater_changes_the_agreement_and_another_scale_does_not() {
        let stricter = PUBLISHED.map(|[a, b, c, d]| [a - 5.0, b, c, d]);
        let of = |table, form| icc(&rows(table), form).unwrap().value;
        let shifted = PUBLISHED.map(|ratings| ratings.map(|rating| 3.0 * rating - 40.0));
        assert!((of(&shifted, IccForm::Agreement) - of(&PUBLISHED, IccForm::Agreement)).abs() < 1e-12);
        assert!(of(&stricter, IccForm::Agreement) != of(&PUBLISHED, IccForm::Agreement));
    }

    #[test]
    fn ratings_without_an_agreement_give_a_reason() {
        let of = |table: &[(usize, Vec<f64>)]| icc(table, IccForm::Agreement);
        let mut twice = rows(&PUBLISHED);
        twice[0].0 = 1;
        assert_eq!(of(&twice), Err(NoAnswer::PersonTwice));
        let mut ragged = rows(&PUBLISHED);
        ragged[2].1.pop();
        assert_eq!(of(&ragged), Err(NoAnswer::Ragged));
        let mut missing = rows(&PUBLISHED);
        missing[2].1[1] = f64::NAN;
        assert_eq!(of(&missing), Err(NoAnswer::NotFinite));
        assert_eq!(of(&[]), Err(NoAnswer::TooFew { of: "people rated", found: 0, needed: 6 }));
        assert_eq!(of(&rows(&PUBLISHED[..1])), Err(NoAnswer::TooFew { of: "people rated", found: 1, needed: 6 }));
        let one_rater = rows(&PUBLISHED.map(|ratings| [ratings[0]]));
        assert_eq!(of(&one_rater), Err(NoAnswer::TooFew { of: "raters", found: 1, needed: 2 }));
        assert_eq!(of(&rows(&[[4.0, 4.0]; 7])), Err(NoAnswer::NoSpread));
        assert_eq!(of(&rows(&PUBLISHED.map(|ratings| [ratings[0]; 2]))), Err(NoAnswer::Perfect));
        let crossed = [[1.0, 2.0], [2.0, 1.0], [1.0, 2.0], [2.0, 1.1], [1.0, 2.0], [2.0, 1.0]];
        assert_eq!(of(&rows(&crossed)), Err(NoAnswer::Discord));
    }

    #[test]
    fn an_interval_ends_at_the_lowest_value_and_from_there_the_mean_says_nothing() {
        let nearly = rows(&[[1.0, 2.0], [2.0, 1.0], [1.0, 2.0], [2.0, 2.0], [1.0, 2.0], [2.0, 1.0]]);
        let one = icc(&nearly, IccForm::Agreement).unwrap();
        assert!((one.value + 12.0 / 13.0).abs() < 1e-12 && one.interval.low == -1.0, "{one:?}");
        assert_eq!(icc(&nearly, IccForm::AgreementMean), Err(NoAnswer::Discord));
    }
}
