//! The k nearest training sessions.

use super::super::{LEVELS, Level, PerLevel};
use super::{Learner, Scorer, Table, smoothed};

/// So many of them.
pub struct Neighbours {
    pub k: usize,
}

impl Learner for Neighbours {
    fn name(&self) -> &'static str {
        "knn"
    }

    fn parameter(&self) -> String {
        format!("k {}", self.k)
    }

    fn fit(&self, table: &Table) -> Option<Scorer> {
        let weights = table.weight_of_levels();
        let mean = weights.iter().sum::<f64>() / LEVELS as f64;
        let counts = weights.map(|weight| mean / weight);
        let (rows, levels) = (table.rows.clone(), table.levels.clone());
        if rows.len() < self.k || counts.iter().any(|count| !count.is_finite()) {
            return None;
        }
        Some(Scorer::Neighbours { k: self.k, rows, levels, counts })
    }
}

/// Each level's share among the `k` nearest; of sessions at one distance the first ones count.
pub fn scores(k: usize, rows: &[Vec<f64>], levels: &[Level], counts: &PerLevel, x: &[f64]) -> PerLevel {
    let distance = |row: &Vec<f64>| row.iter().zip(x).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let mut near: Vec<(f64, usize)> = rows.iter().enumerate().map(|(place, row)| (distance(row), place)).collect();
    let nearer = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if k < near.len() {
        near.select_nth_unstable_by(k, nearer);
    }
    let mut shares = [0.0; LEVELS];
    for (_, place) in near.iter().take(k) {
        let level = levels[*place] as usize;
        shares[level] += counts[level];
    }
    smoothed(shares)
}
