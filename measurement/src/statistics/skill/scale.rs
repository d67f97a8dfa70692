//! Standardised features, and which of them distinguish levels; both learnt on the training part alone.

use super::{LEVELS, PerLevel, SkillLevel};
use crate::statistics::interval::{MeasuredValue, moments};

/// Selected features, each with its mean and standard deviation.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    /// Indices of the features among all that a session gives; the one that distinguishes levels best comes first.
    pub chosen: Vec<usize>,
    /// The training sessions' means, in the features' units.
    pub mean: Vec<f64>,
    /// Their standard deviations.
    pub deviation: Vec<f64>,
}

impl Scale {
    /// Selects from the training sessions' features the `most` that distinguish people's levels best.
    pub(super) fn of(
        readings: &[&[MeasuredValue]],
        people: &[usize],
        levels: &[SkillLevel],
        most: usize,
    ) -> Option<Self> {
        let features = readings.first()?.len();
        let mut ranked: Vec<(f64, usize)> = Vec::new();
        for feature in 0..features {
            let values: Vec<f64> = readings.iter().map(|row| row[feature].value).collect();
            if moments(&values).1 > 0.0 {
                ranked.push((between_to_within(&values, people, levels), feature));
            }
        }
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let chosen: Vec<usize> = ranked.into_iter().take(most).map(|(_, feature)| feature).collect();
        let column = |feature: usize| -> Vec<f64> { readings.iter().map(|row| row[feature].value).collect() };
        let (mean, deviation) = chosen.iter().map(|f| moments(&column(*f))).unzip();
        if chosen.is_empty() { None } else { Some(Self { chosen, mean, deviation }) }
    }

    /// The chosen features of a session, standardised.
    pub(super) fn apply(&self, value: impl Fn(usize) -> f64) -> Vec<f64> {
        let standard = |index: usize| (value(self.chosen[index]) - self.mean[index]) / self.deviation[index];
        (0..self.chosen.len()).map(standard).collect()
    }
}

/// Variance of a feature between levels divided by that within them, over people's means: a person with many sessions
/// counts once.
fn between_to_within(values: &[f64], people: &[usize], levels: &[SkillLevel]) -> f64 {
    let mut sums = vec![(0.0, 0.0); levels.len()];
    for (value, person) in values.iter().zip(people) {
        sums[*person].0 += value;
        sums[*person].1 += 1.0;
    }
    let mut groups: [Vec<f64>; LEVELS] = Default::default();
    for ((sum, n), level) in sums.into_iter().zip(levels).filter(|((_, n), _)| *n > 0.0) {
        groups[*level as usize].push(sum / n);
    }
    let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len().max(1) as f64;
    let means: PerLevel = std::array::from_fn(|level| mean(&groups[level]));
    let centre = mean(&means);
    let between: f64 = means.iter().map(|mean| (mean - centre).powi(2)).sum();
    let spread = |(group, mean): (&Vec<f64>, &f64)| {
        group.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / group.len().max(1) as f64
    };
    let within: f64 = groups.iter().zip(&means).map(spread).sum();
    if within > 0.0 { between / within } else { 0.0 }
}
