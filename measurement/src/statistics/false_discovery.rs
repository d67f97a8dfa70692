//! p-values for many correlations at once: of a hundred correlations without any relation, five would be "significant"
//! at 5 %.
//!
//! **Method** (Benjamini & Hochberg 1995): of `m` p-values in ascending order, the `k`-th becomes the smallest value of
//! `m/j · p(j)` over all `j ≥ k`. With a threshold of 5 %, one finding in twenty is wrong on average, if the tests are
//! independent or positively dependent (Benjamini & Yekutieli 2001).

use crate::numbers::distribution::student_cdf;

/// The adjusted p-value of each given p-value, in the same order.
pub fn adjusted_p_values(chances: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..chances.len()).collect();
    order.sort_by(|a, b| chances[*b].total_cmp(&chances[*a]));
    let (count, mut least) = (chances.len() as f64, 1.0_f64);
    let mut adjusted = vec![1.0; chances.len()];
    for (larger, index) in order.into_iter().enumerate() {
        least = least.min(chances[index] * count / (count - larger as f64));
        adjusted[index] = least;
    }
    adjusted
}

/// The p-value of a correlation over this many people: the chance of one at least as far from 0 where there is no
/// relation. Student's t with n − 2 degrees of freedom, which also holds for ranks from ten people on.
pub fn correlation_p_value(correlation: f64, people: usize) -> f64 {
    let freedom = people as f64 - 2.0;
    let t = correlation.abs() * (freedom / (1.0 - correlation * correlation).max(f64::MIN_POSITIVE)).sqrt();
    (2.0 * (1.0 - student_cdf(t, freedom))).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_example_is_adjusted_as_r_does() {
        // Benjamini & Hochberg 1995, section 4.1: fifteen p-values; values of R's p.adjust(method = "BH").
        let chances = [
            0.0001, 0.0004, 0.0019, 0.0095, 0.0201, 0.0278, 0.0298, 0.0344, 0.0459, 0.324, 0.4262, 0.5719, 0.6528,
            0.759, 1.0,
        ];
        let got = adjusted_p_values(&chances);
        let expected = [0.0015, 0.003, 0.0095, 0.035625, 0.0603, 0.063857, 0.063857, 0.0645, 0.0765, 0.486];
        for (got, expected) in got.iter().zip(expected) {
            assert!((got - expected).abs() < 1e-6, "{got} {expected}");
        }
        assert_eq!(got.iter().filter(|p| **p < 0.05).count(), 4, "the paper's four");
    }

    #[test]
    fn the_order_of_the_question_does_not_matter_and_nothing_becomes_likelier_than_it_was() {
        let (chances, back) = ([0.2, 0.01, 0.9, 0.03], [0.03, 0.9, 0.01, 0.2]);
        let (mut there, got) = (adjusted_p_values(&chances), adjusted_p_values(&back));
        there.reverse();
        assert_eq!(there, got);
        assert!(got.iter().zip(&back).all(|(adjusted, chance)| adjusted >= chance && *adjusted <= 1.0));
        assert!(adjusted_p_values(&[]).is_empty());
    }

    #[test]
    fn a_correlation_has_the_chance_of_its_t() {
        // SciPy: 2 * t.sf(0.5 * sqrt(18 / 0.75), 18)
        assert!((correlation_p_value(0.5, 20) - 0.024_769_56).abs() < 1e-5, "{}", correlation_p_value(0.5, 20));
        assert_eq!(correlation_p_value(0.0, 20), 1.0);
        assert!(correlation_p_value(-0.9, 20) < 1e-6 && correlation_p_value(1.0, 20) == 0.0);
    }
}
