//! How far a session lies from the training sessions of a model.

use nalgebra::{DMatrix, DVector};

use super::learner::TrainingTable;
use super::{LEVELS, SkillLevel};

/// Share of the covariance that is replaced by its diagonal: with so few people its small directions are unreliable.
const SHRINKAGE: f64 = 0.3;

/// Share of the training people's sessions, when left out, that must lie inside.
pub(super) const SHARE_INSIDE: f64 = 0.95;

/// The region of the training sessions: the levels' centres, and one spread around them. It contains no person's own
/// session.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// The levels' means, standardised.
    pub centres: [Vec<f64>; LEVELS],
    /// Inverse of the covariance within levels, row by row.
    pub precision: Vec<f64>,
    /// Maximum distance of a session, in standard deviations.
    pub limit: f64,
}

impl Region {
    /// The region of a training part, without a limit yet.
    pub(super) fn of(table: &TrainingTable) -> Option<Self> {
        let (centres, covariance) = within_levels(table, SHRINKAGE)?;
        let precision = covariance.try_inverse()?;
        Some(Self { centres, precision: precision.iter().copied().collect(), limit: f64::INFINITY })
    }

    /// Mahalanobis distance to the nearest level's centre.
    pub fn distance(&self, x: &[f64]) -> f64 {
        let n = x.len();
        let to = |centre: &Vec<f64>| {
            let off: Vec<f64> = x.iter().zip(centre).map(|(a, b)| a - b).collect();
            let row = |i: usize| (0..n).map(|j| self.precision[i * n + j] * off[j]).sum::<f64>() * off[i];
            (0..n).map(row).sum::<f64>().max(0.0).sqrt()
        };
        self.centres.iter().map(to).fold(f64::INFINITY, f64::min)
    }
}

/// Means of the levels, and the covariance within them; a share of the covariance is replaced by its diagonal (Friedman
/// 1989). Every person has the same weight.
pub(super) fn within_levels(table: &TrainingTable, shrinkage: f64) -> Option<([Vec<f64>; LEVELS], DMatrix<f64>)> {
    let n = table.rows.first()?.len();
    let mut sums: [DVector<f64>; LEVELS] = std::array::from_fn(|_| DVector::zeros(n));
    let mut weights = [0.0; LEVELS];
    for ((row, level), weight) in table.rows.iter().zip(&table.levels).zip(&table.weights) {
        sums[*level as usize].axpy(*weight, &DVector::from_column_slice(row), 1.0);
        weights[*level as usize] += weight;
    }
    if weights.iter().any(|weight| *weight <= 0.0) {
        return None;
    }
    let means: [DVector<f64>; LEVELS] = std::array::from_fn(|level| &sums[level] / weights[level]);
    let mut covariance = DMatrix::zeros(n, n);
    for ((row, level), weight) in table.rows.iter().zip(&table.levels).zip(&table.weights) {
        let off = DVector::from_column_slice(row) - &means[*level as usize];
        covariance.ger(weight / weights.iter().sum::<f64>(), &off, &off, 1.0);
    }
    let diagonal = covariance.diagonal();
    covariance *= 1.0 - shrinkage;
    for i in 0..n {
        // A feature with the same value in all sessions of a level has no spread of its own there; it gets a thousandth
        // of the spread over all sessions.
        covariance[(i, i)] += shrinkage * diagonal[i] + 1e-3;
    }
    let centres = SkillLevel::ALL.map(|level| means[level as usize].iter().copied().collect());
    Some((centres, covariance))
}
