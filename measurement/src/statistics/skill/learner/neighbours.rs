//! The k nearest training sessions.

use super::super::{LEVELS, PerLevel, SkillLevel};
use super::{Learner, LevelScorer, TrainingTable, smoothed_log_shares};

/// The `k` nearest training sessions.
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

    fn fit(&self, table: &TrainingTable) -> Option<LevelScorer> {
        // A level whose people have more sessions has more of them nearby by chance, so each level is weighted to the
        // same total.
        let mut sessions = [0.0; LEVELS];
        table.levels.iter().for_each(|level| sessions[*level as usize] += 1.0);
        let counts = sessions.map(|own| table.rows.len() as f64 / (LEVELS as f64 * own));
        let (rows, levels) = (table.rows.clone(), table.levels.clone());
        if rows.len() < self.k || counts.iter().any(|count| !count.is_finite()) {
            return None;
        }
        Some(LevelScorer::Neighbours { k: self.k, rows, levels, counts })
    }
}

/// The share of each level among the `k` nearest sessions; of sessions at equal distance the first ones count.
pub fn scores(k: usize, rows: &[Vec<f64>], levels: &[SkillLevel], counts: &PerLevel, x: &[f64]) -> PerLevel {
    let distance = |row: &Vec<f64>| row.iter().zip(x).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let mut near: Vec<(f64, usize)> = rows.iter().enumerate().map(|(index, row)| (distance(row), index)).collect();
    let nearer = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if k < near.len() {
        near.select_nth_unstable_by(k, nearer);
    }
    let mut shares = [0.0; LEVELS];
    for (_, index) in near.iter().take(k) {
        let level = levels[*index] as usize;
        shares[level] += counts[level];
    }
    smoothed_log_shares(shares)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Dice;

    #[test]
    fn a_level_whose_people_have_more_sessions_is_not_guessed_more_often() {
        let mut dice = Dice::new(1, "neighbours");
        let (mut rows, mut levels, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for (level, sessions) in SkillLevel::ALL.into_iter().zip([3, 1, 1]) {
            for _ in 0..12 * sessions {
                rows.push(vec![dice.gauss(), dice.gauss()]);
                levels.push(level);
                weights.push(1.0 / f64::from(sessions));
            }
        }
        let scorer = Neighbours { k: 15 }.fit(&TrainingTable { rows, levels, weights }).unwrap();
        let guess = |_: usize| {
            let scores = scorer.scores(&[dice.gauss(), dice.gauss()]);
            (0..LEVELS).max_by(|a, b| scores[*a].total_cmp(&scores[*b])).unwrap_or(0)
        };
        let novices = (0..600).map(guess).filter(|level| *level == 0).count();
        assert!((60..420).contains(&novices), "{novices} of 600, where a third is noise");
    }
}
