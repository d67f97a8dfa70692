//! Assigns bands to two tools of one colour. All combinations are tried, so the result is optimal.
//!
//! Each band is given to at most one tool. A tool gets its band only if giving that band to the other tool would cost
//! at least [`DECISIVE_MARGIN`] more; otherwise the band stays undecided.

use super::origin::DECISIVE_MARGIN;

/// Cost of giving a tool no band: more than any band that may be its own.
pub const NO_BAND_COST: f64 = 40.0;

/// The assignment of one tool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// The band of this index.
    Band(usize),
    /// The band could equally be the other tool's.
    Undecided,
    /// No band.
    Nothing,
}

/// Assigns bands. `costs` holds the cost of each band for both tools; `None` means that it cannot be that tool's.
/// `are_two` returns whether two indices, the first tool's and the second's, are different bands.
pub fn assign(costs: &[[Option<f64>; 2]], are_two: impl Fn(usize, usize) -> bool) -> [Choice; 2] {
    let differ = |first: usize, second: usize| first != second && are_two(first, second);
    let all = combinations(costs, differ);
    let Some((best, [first, second])) = all.iter().copied().min_by(|a, b| a.0.total_cmp(&b.0)) else {
        return [Choice::Nothing; 2];
    };
    let cheapest = |gives_away: &dyn Fn([Option<usize>; 2]) -> bool| {
        all.iter().filter(|(_, taken)| gives_away(*taken)).map(|(cost, _)| *cost).fold(f64::INFINITY, f64::min)
    };
    let choice = |band: Option<usize>, given_away: f64| match band {
        None => Choice::Nothing,
        Some(_) if given_away - best < DECISIVE_MARGIN => Choice::Undecided,
        Some(band) => Choice::Band(band),
    };
    let to_second = cheapest(&|taken| first.zip(taken[1]).is_some_and(|(own, other)| !differ(own, other)));
    let to_first = cheapest(&|taken| second.zip(taken[0]).is_some_and(|(own, other)| !differ(other, own)));
    [choice(first, to_second), choice(second, to_first)]
}

/// All combinations that give no band to both tools, with their costs.
fn combinations(costs: &[[Option<f64>; 2]], differ: impl Fn(usize, usize) -> bool) -> Vec<(f64, [Option<usize>; 2])> {
    let options = |tool: usize| {
        let bands = costs.iter().enumerate().filter_map(move |(i, cost)| Some((cost[tool]?, Some(i))));
        bands.chain([(NO_BAND_COST, None)])
    };
    let pairs = options(0).flat_map(|first| options(1).map(move |second| (first, second)));
    let possible = pairs.filter(|((_, first), (_, second))| first.zip(*second).is_none_or(|(a, b)| differ(a, b)));
    possible.map(|((a, first), (b, second))| (a + b, [first, second])).collect()
}

#[cfg(test)]
mod tests {
    use super::Choice::{Band, Nothing, Undecided};
    use super::*;

    fn of(costs: &[[f64; 2]]) -> [Choice; 2] {
        let costs: Vec<[Option<f64>; 2]> = costs.iter().map(|c| c.map(|c| c.is_finite().then_some(c))).collect();
        assign(&costs, |_, _| true)
    }

    #[test]
    fn two_bands_go_where_they_are_cheapest_together() {
        assert_eq!(of(&[[2.0, 30.0], [30.0, 1.0]]), [Band(0), Band(1)]);
        // The first band alone is nearer to the second tool, but then the second band would be left over.
        assert_eq!(of(&[[3.0, 2.0], [60.0, 1.0]]), [Band(0), Band(1)]);
    }

    #[test]
    fn a_band_that_could_be_either_tools_stays_undecided() {
        assert_eq!(of(&[[3.0, 5.0]]), [Undecided, Nothing]);
        assert_eq!(of(&[[3.0, 5.0], [4.0, 5.0]]), [Undecided, Undecided]);
    }

    #[test]
    fn a_single_band_leaves_the_other_tool_without() {
        assert_eq!(of(&[[28.0, 2.0]]), [Nothing, Band(0)]);
        assert_eq!(of(&[[f64::NAN, f64::NAN]]), [Nothing, Nothing]);
        assert_eq!(of(&[]), [Nothing, Nothing]);
    }

    #[test]
    fn one_band_seen_as_two_regions_is_given_once() {
        let costs = [[Some(2.0), Some(30.0)], [Some(4.0), Some(29.0)]];
        assert_eq!(assign(&costs, |_, _| false), [Band(0), Nothing]);
    }
}
