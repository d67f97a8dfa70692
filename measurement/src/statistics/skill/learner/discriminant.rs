//! Linear discriminant analysis: every level has its own centre, and all have one shape.

use nalgebra::DVector;

use super::super::region::within_levels;
use super::{Learner, LevelScorer, TrainingTable};

/// Linear discriminants; `shrinkage` is the share of the covariance that is replaced by its diagonal (Friedman 1989).
pub struct Discriminant {
    pub shrinkage: f64,
}

impl Learner for Discriminant {
    fn name(&self) -> &'static str {
        "lda"
    }

    fn parameter(&self) -> String {
        format!("shrinkage {}", self.shrinkage)
    }

    fn fit(&self, table: &TrainingTable) -> Option<LevelScorer> {
        let (centres, covariance) = within_levels(table, self.shrinkage)?;
        let solver = covariance.cholesky()?;
        let weights = centres.clone().map(|centre| solver.solve(&DVector::from_vec(centre)));
        let offset = |level: usize| -0.5 * weights[level].dot(&DVector::from_column_slice(&centres[level]));
        let offsets = std::array::from_fn(offset);
        Some(LevelScorer::Linear { weights: weights.map(|w| w.iter().copied().collect()), offsets })
    }
}
