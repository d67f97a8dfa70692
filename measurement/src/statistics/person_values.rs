//! One value per person: the input of cohorts, standards and correlations. Sessions of one person are alike, so
//! counting each session would count one person's habits many times.

use std::collections::BTreeMap;

use super::no_answer::NoAnswer;
use crate::numbers::quantile::interpolated_quantile;

/// Minimum number of people for a percentile, a group's limit or a correlation. With ten, one person more or less
/// shifts a percentile by ten points. With fewer it would mean nothing, and would reveal too much about the people in
/// it.
pub const MIN_PEOPLE: usize = 10;

/// One usable value for each of several people; the people's identities are not kept.
#[derive(Clone, Debug, PartialEq)]
pub struct PersonValues {
    sorted: Vec<f64>,
}

impl PersonValues {
    /// From any number of sessions per person; the median of each person's sessions counts, so one bad day does not
    /// move it.
    ///
    /// # Errors
    /// [`NoAnswer::NotFinite`] for NaN and infinity.
    pub fn of_sessions<P: Ord>(rows: &[(P, f64)]) -> Result<Self, NoAnswer> {
        let mut sessions: BTreeMap<&P, Vec<f64>> = BTreeMap::new();
        for (person, value) in rows {
            NoAnswer::finite(&[*value])?;
            sessions.entry(person).or_default().push(*value);
        }
        let median = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            interpolated_quantile(&values, 0.5).unwrap_or(f64::NAN) // a person has at least one session
        };
        Self::of_values(sessions.into_values().map(median).collect())
    }

    pub(super) fn of_values(mut sorted: Vec<f64>) -> Result<Self, NoAnswer> {
        NoAnswer::finite(&sorted)?;
        sorted.sort_by(f64::total_cmp);
        Ok(Self { sorted })
    }

    /// The values, in ascending order.
    pub fn values(&self) -> &[f64] {
        &self.sorted
    }

    /// The number of people.
    pub fn count(&self) -> usize {
        self.sorted.len()
    }
}

/// Refuses rows if two belong to one person.
pub(super) fn check_each_once<P: Ord>(people: impl Iterator<Item = P>) -> Result<(), NoAnswer> {
    let mut people: Vec<P> = people.collect();
    people.sort();
    if people.windows(2).any(|pair| pair[0] == pair[1]) { Err(NoAnswer::PersonTwice) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_person_counts_once_however_many_sessions_there_are() {
        let rows = [("b", 9.0), ("a", 1.0), ("a", 100.0), ("a", 2.0), ("c", 4.0), ("c", 5.0)];
        assert_eq!(PersonValues::of_sessions(&rows).unwrap().values(), [2.0, 4.5, 9.0]);
    }

    #[test]
    fn what_is_no_number_is_refused() {
        assert_eq!(PersonValues::of_sessions(&[(1, 1.0), (2, f64::NAN)]), Err(NoAnswer::NotFinite));
        assert_eq!(PersonValues::of_sessions(&[(1, 1.0), (1, f64::INFINITY)]), Err(NoAnswer::NotFinite));
    }
}
