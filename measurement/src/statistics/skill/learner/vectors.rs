//! Linear support vectors for all levels together (Crammer & Singer 2001), by projected subgradients (Pegasos,
//! Shalev-Shwartz et al. 2011) over all sessions at once.

use super::super::{LEVELS, PerLevel, SkillLevel};
use super::{Learner, LevelScorer, TrainingTable};

/// Linear support vectors. A larger ridge gives smaller weights and a wider margin between levels.
pub struct SupportVectors {
    pub ridge: f64,
}

/// Number of steps; the result is the mean over the second half.
const STEPS: usize = 200;

impl Learner for SupportVectors {
    fn name(&self) -> &'static str {
        "svm"
    }

    fn parameter(&self) -> String {
        format!("ridge {}", self.ridge)
    }

    fn fit(&self, table: &TrainingTable) -> Option<LevelScorer> {
        let of_levels = table.weight_of_levels();
        if of_levels.iter().any(|weight| *weight <= 0.0) {
            return None;
        }
        // Every level weighs a third, and every person of a level the same.
        let share = |(level, weight): (&SkillLevel, &f64)| weight / of_levels[*level as usize] / LEVELS as f64;
        let shares: Vec<f64> = table.levels.iter().zip(&table.weights).map(share).collect();
        // An additional feature, 1 in every session, carries the offsets.
        let rows: Vec<Vec<f64>> = table.rows.iter().map(|row| row.iter().copied().chain([1.0]).collect()).collect();
        let width = rows.first()?.len();
        let mut planes: Planes = std::array::from_fn(|_| vec![0.0; width]);
        let mut mean = planes.clone();
        for step in 1..=STEPS {
            self.descend(&mut planes, step, &rows, &table.levels, &shares);
            if 2 * step > STEPS {
                for (mean, plane) in mean.iter_mut().flatten().zip(planes.iter().flatten()) {
                    *mean += 2.0 * plane / STEPS as f64;
                }
            }
        }
        let offsets = std::array::from_fn(|level| mean[level].pop().unwrap_or(0.0));
        Some(LevelScorer::Linear { weights: mean, offsets })
    }
}

type Planes = [Vec<f64>; LEVELS];

impl SupportVectors {
    /// One descent step, projected back into the ball that contains the best planes.
    fn descend(&self, planes: &mut Planes, step: usize, rows: &[Vec<f64>], levels: &[SkillLevel], shares: &[f64]) {
        let length = 1.0 / (self.ridge * step as f64);
        let mut to: Planes = planes.clone().map(|plane| plane.iter().map(|w| w * (1.0 - 1.0 / step as f64)).collect());
        for ((row, level), share) in rows.iter().zip(levels).zip(shares) {
            let own = *level as usize;
            let scores: PerLevel = std::array::from_fn(|of| planes[of].iter().zip(row).map(|(w, x)| w * x).sum());
            let others = (0..LEVELS).filter(|other| *other != own);
            let Some(rival) = others.max_by(|a, b| scores[*a].total_cmp(&scores[*b])) else { continue };
            if scores[own] - scores[rival] < 1.0 {
                for (index, x) in row.iter().enumerate() {
                    to[own][index] += length * share * x;
                    to[rival][index] -= length * share * x;
                }
            }
        }
        let norm = to.iter().flatten().map(|w| w * w).sum::<f64>().sqrt();
        let shrink = (1.0 / (self.ridge.sqrt() * norm)).min(1.0); // 1 if all weights are 0
        to.iter_mut().flatten().for_each(|w| *w *= shrink);
        *planes = to;
    }
}
