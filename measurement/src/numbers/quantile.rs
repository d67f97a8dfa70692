//! Quantiles of plain, sorted and weighted values.

/// The quantile of the values at `share` (0 to 1), by nearest rank: always one of the values. `None` if there are none.
pub fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    let rank = (values.len().checked_sub(1)? as f64 * share).round() as usize;
    Some(*values.select_nth_unstable_by(rank, f64::total_cmp).1)
}

/// The quantile of sorted values at `share` (0 to 1), linear between adjacent values (type 7 of Hyndman & Fan 1996).
/// `None` if there are none.
pub fn interpolated_quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let position = sorted.len().checked_sub(1)? as f64 * share;
    let (below, above) = (sorted[position.floor() as usize], sorted[position.ceil() as usize]);
    Some(below + (above - below) * position.fract())
}

/// The value where the cumulative weight reaches this share, for pairs of value and weight. `None` if there are none.
pub fn weighted_quantile(mut values: Vec<(f64, f64)>, share: f64) -> Option<f64> {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let wanted = values.iter().map(|(_, weight)| weight).sum::<f64>() * share;
    let mut reached = 0.0;
    let found = values.iter().find(|(_, weight)| {
        reached += weight;
        reached >= wanted
    });
    found.or(values.last()).map(|(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heavy_value_outweighs_light_ones() {
        assert_eq!(weighted_quantile(vec![(1.0, 1.0), (9.0, 10.0), (2.0, 1.0)], 0.5), Some(9.0));
        assert_eq!(weighted_quantile(vec![(3.0, 1.0), (1.0, 1.0), (2.0, 1.0)], 0.5), Some(2.0));
        assert_eq!(weighted_quantile(vec![(3.0, 1.0), (1.0, 18.0), (2.0, 1.0)], 0.95), Some(2.0));
    }

    #[test]
    fn a_quantile_is_one_of_the_values() {
        let values: Vec<f64> = (0..101).rev().map(f64::from).collect();
        let quantiles = [0.0, 0.5, 0.95, 1.0].map(|share| quantile(values.clone(), share));
        assert_eq!(quantiles, [0.0, 50.0, 95.0, 100.0].map(Some));
    }

    #[test]
    fn interpolated_quantiles_lie_between_adjacent_values() {
        let values = [1.0, 2.0, 4.0, 6.0];
        assert_eq!([0.0, 0.5, 1.0].map(|share| interpolated_quantile(&values, share)), [1.0, 3.0, 6.0].map(Some));
    }

    #[test]
    fn no_values_have_no_quantile() {
        assert_eq!((quantile(vec![], 0.5), weighted_quantile(vec![], 0.5)), (None, None));
        assert_eq!(interpolated_quantile(&[], 0.5), None);
    }
}
