//! Quantiles of plain and of weighted values.

/// The value with this share of the others below it; NaN if there are no values.
pub fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let rank = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(rank, f64::total_cmp).1
}

/// The value at which the cumulative weight reaches this share, for pairs of value and weight; NaN if there are none.
pub fn weighted_quantile(mut values: Vec<(f64, f64)>, share: f64) -> f64 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let wanted = values.iter().map(|(_, weight)| weight).sum::<f64>() * share;
    let mut reached = 0.0;
    let found = values.iter().find(|(_, weight)| {
        reached += weight;
        reached >= wanted
    });
    found.or(values.last()).map_or(f64::NAN, |(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heavy_value_outweighs_light_ones() {
        assert_eq!(weighted_quantile(vec![(1.0, 1.0), (9.0, 10.0), (2.0, 1.0)], 0.5), 9.0);
        assert_eq!(weighted_quantile(vec![(3.0, 1.0), (1.0, 1.0), (2.0, 1.0)], 0.5), 2.0);
        assert_eq!(weighted_quantile(vec![(3.0, 1.0), (1.0, 18.0), (2.0, 1.0)], 0.95), 2.0);
    }

    #[test]
    fn a_quantile_is_one_of_the_values() {
        let values: Vec<f64> = (0..101).rev().map(f64::from).collect();
        assert_eq!([0.0, 0.5, 0.95, 1.0].map(|share| quantile(values.clone(), share)), [0.0, 50.0, 95.0, 100.0]);
        assert!(quantile(vec![], 0.5).is_nan() && weighted_quantile(vec![], 0.5).is_nan());
    }
}
