//! Which rows every one of some raters has rated: an intraclass correlation of raters who rate everybody cannot fill gaps, and a
//! guess in a gap would be agreement that nobody gave.

use std::collections::{BTreeMap, BTreeSet};

/// The raters who share most people, and their rows.
#[derive(Clone, Debug, PartialEq)]
pub struct SameRaters<P, R> {
    /// The raters, in rising order.
    pub raters: Vec<R>,
    /// What was rated by all of them, and their ratings in the raters' order.
    pub rows: Vec<(P, Vec<f64>)>,
    /// How many rows by two raters or more were left out, since another set shares more.
    pub left_out: usize,
}

/// Of the sets of raters that some row has, the one that rated most people, counted once for each rater; of equals the one with
/// most rows, then the larger, then the first. A person may have many rows. Rows that others have rated besides count too. `None`
/// where no row has two raters.
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
        let row = |(who, ratings): &(P, BTreeMap<R, f64>)| {
            let marks: Option<Vec<f64>> = raters.iter().map(|rater| ratings.get(rater).copied()).collect();
            marks.map(|marks| (who.clone(), marks))
        };
        rows.iter().filter_map(row).collect::<Vec<_>>()
    };
    let count = |raters: &[R]| {
        let rated =
            rows.iter().filter(|(_, ratings)| raters.iter().all(|r| ratings.contains_key(r))).map(|(who, _)| who);
        let people: BTreeSet<Q> = rated.clone().map(&person_of).collect();
        (people.len() * raters.len(), rated.count(), raters.len())
    };
    // `max_by_key` takes the last of equals: in reverse, that is the first.
    let best = sets.into_iter().rev().max_by_key(|raters| count(raters))?;
    let chosen = of_set(&best);
    let by_two = rows.iter().filter(|(_, ratings)| ratings.len() >= 2).count();
    Some(SameRaters { left_out: by_two - chosen.len(), rows: chosen, raters: best })
}

#[cfg(test)]
mod tests {
    use super::super::{Form, icc};
    use super::*;

    fn row<'r>(who: u32, marks: &[(&'r str, f64)]) -> (u32, BTreeMap<&'r str, f64>) {
        (who, marks.iter().copied().collect())
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
        let chosen = same_raters(&rows, |who| *who).unwrap();
        assert_eq!((chosen.raters, chosen.rows.len(), chosen.left_out), (vec!["c", "d"], 10, 20));
    }

    #[test]
    fn the_published_example_comes_through_a_centre_where_others_rated_a_little() {
        let names = ["a", "b", "c", "d"];
        let full = |(who, marks): (usize, &[f64; 4])| {
            row(who as u32, &names.into_iter().zip(marks.iter().copied()).collect::<Vec<_>>())
        };
        let mut rows: Vec<_> = PUBLISHED.iter().enumerate().map(full).collect();
        rows[2].1.insert("e", 3.0);
        rows.push(row(7, &[("a", 9.0), ("e", 1.0)]));
        rows.push(row(8, &[("a", 9.0)]));
        let same = same_raters(&rows, |who| *who).unwrap();
        assert_eq!((same.raters.as_slice(), same.rows.len(), same.left_out), (&names[..], 6, 1));
        let value = |form| icc(&same.rows, form).unwrap().value;
        assert!((value(Form::Agreement) - 0.2898).abs() < 5e-5 && (value(Form::AgreementMean) - 0.6201).abs() < 5e-5);
    }

    #[test]
    fn two_who_share_ten_win_over_three_who_share_four() {
        let mut rows: Vec<_> = (0..10).map(|n| row(n, &[("a", 1.0), ("b", 2.0)])).collect();
        rows.extend((10..14).map(|n| row(n, &[("c", 1.0), ("d", 2.0), ("e", 3.0)])));
        let same = same_raters(&rows, |who| *who).unwrap();
        assert_eq!((same.raters, same.rows.len(), same.left_out), (vec!["a", "b"], 10, 4));
        assert_eq!(same_raters(&[row(1, &[("a", 1.0)]), row(2, &[("b", 1.0)])], |who| *who), None);
    }
}
