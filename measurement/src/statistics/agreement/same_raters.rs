//! Selects the rows that were rated by all of one set of raters. An intraclass correlation of raters who rate all
//! people cannot fill gaps, and a guessed rating would add agreement that no rater expressed.

use std::collections::{BTreeMap, BTreeSet};

/// The set of raters who share the most people, and the rows that they share.
#[derive(Clone, Debug, PartialEq)]
pub struct SameRaters<P, R> {
    /// The raters, in ascending order.
    pub raters: Vec<R>,
    /// The rows rated by all of them, with the ratings in the raters' order.
    pub rows: Vec<(P, Vec<f64>)>,
    /// Number of rows by two or more raters that were left out, because another set shares more.
    pub left_out: usize,
}

/// Selects from the sets of raters that occur in a row the one with the most rated people, times its number of raters.
/// Ties go to the set with the most rows, then to the larger, then to the first. A person may have many rows. A row
/// with ratings by further raters counts too. `None` if no row has two raters.
pub fn same_raters<P: Clone, R: Ord + Clone, Q: Ord>(
    rows: &[(P, BTreeMap<R, f64>)],
    person_of: impl Fn(&P) -> Q,
) -> Option<SameRaters<P, R>> {
    let sets: BTreeSet<Vec<R>> = rows
        .iter()
        .filter(|(_, ratings)| ratings.len() >= 2)
        .map(|(_, ratings)| ratings.keys().cloned().collect())
        .collect();
    let of_set = |raters: &[R]| {
        let row = |(rated, ratings): &(P, BTreeMap<R, f64>)| {
            let marks: Option<Vec<f64>> = raters.iter().map(|rater| ratings.get(rater).copied()).collect();
            marks.map(|marks| (rated.clone(), marks))
        };
        rows.iter().filter_map(row).collect::<Vec<_>>()
    };
    let count = |raters: &[R]| {
        let rated =
            rows.iter().filter(|(_, ratings)| raters.iter().all(|r| ratings.contains_key(r))).map(|(row, _)| row);
        let people: BTreeSet<Q> = rated.clone().map(&person_of).collect();
        (people.len() * raters.len(), rated.count(), raters.len())
    };
    // `max_by_key` takes the last of equal entries; in reverse order that is the first.
    let best = sets.into_iter().rev().max_by_key(|raters| count(raters))?;
    let chosen = of_set(&best);
    let by_two = rows.iter().filter(|(_, ratings)| ratings.len() >= 2).count();
    Some(SameRaters { left_out: by_two - chosen.len(), rows: chosen, raters: best })
}

#[cfg(test)]
mod tests {
    use super::super::{IccForm, icc};
    use super::*;

    fn row<'r>(person: u32, marks: &[(&'r str, f64)]) -> (u32, BTreeMap<&'r str, f64>) {
        (person, marks.iter().copied().collect())
    }

    /// Shrout and Fleiss's six people by four raters (1979, table 2).
    const PUBLISHED: [[f64; 4]; 6] = [
        [9.0, 2.0, 5.0, 8.0],
        [6.0, 1.0, 3.0, 2.0],
        [8.0, 4.0, 6.0, 8.0],
        [7.0, 1.0, 2.0, 6.0],
        [10.0, 5.0, 6.0, 9.0],
        [6.0, 2.0, 4.0, 7.0],
    ];

    #[test]
    fn raters_of_many_people_count_more_than_raters_who_met_a_few_again_and_again() {
        let often = (0..20).map(|n| row(n % 3, &[("a", f64::from(n)), ("b", 1.0)]));
        let wide = (10..20).map(|n| row(n, &[("c", f64::from(n)), ("d", 1.0)]));
        let rows: Vec<_> = often.chain(wide).collect();
        let chosen = same_raters(&rows, |person| *person).unwrap();
        assert_eq!((chosen.raters, chosen.rows.len(), chosen.left_out), (vec!["c", "d"], 10, 20));
    }

    #[test]
    fn the_published_example_comes_through_a_centre_where_others_rated_a_little() {
        let names = ["a", "b", "c", "d"];
        let full = |(person, marks): (usize, &[f64; 4])| {
            row(person as u32, &names.into_iter().zip(marks.iter().copied()).collect::<Vec<_>>())
        };
        let mut rows: Vec<_> = PUBLISHED.iter().enumerate().map(full).collect();
        rows[2].1.insert("e", 3.0);
        rows.push(row(7, &[("a", 9.0), ("e", 1.0)]));
        rows.push(row(8, &[("a", 9.0)]));
        let same = same_raters(&rows, |person| *person).unwrap();
        assert_eq!((same.raters.as_slice(), same.rows.len(), same.left_out), (&names[..], 6, 1));
        let value = |form| icc(&same.rows, form).unwrap().value;
        assert!(
            (value(IccForm::Agreement) - 0.2898).abs() < 5e-5 && (value(IccForm::AgreementMean) - 0.6201).abs() < 5e-5
        );
    }

    #[test]
    fn two_who_share_ten_win_over_three_who_share_four() {
        let mut rows: Vec<_> = (0..10).map(|n| row(n, &[("a", 1.0), ("b", 2.0)])).collect();
        rows.extend((10..14).map(|n| row(n, &[("c", 1.0), ("d", 2.0), ("e", 3.0)])));
        let same = same_raters(&rows, |person| *person).unwrap();
        assert_eq!((same.raters, same.rows.len(), same.left_out), (vec!["a", "b"], 10, 4));
        assert_eq!(same_raters(&[row(1, &[("a", 1.0)]), row(2, &[("b", 1.0)])], |person| *person), None);
    }
}
