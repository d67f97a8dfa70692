//! The stored model: it reads a session's features and gives a verdict.

use super::learner::LevelScorer;
use super::region::Region;
use super::scale::Scale;
use super::verdict::{Abstention, Contribution, LevelVerdict};
use super::{LEVELS, PerLevel, SkillLevel};
use crate::random::Dice;
use crate::statistics::interval::{ConfidenceInterval, MeasuredValue};

/// Minimum lead in probability of the likeliest level.
const MIN_LEAD: f64 = 0.2;

/// Number of sessions drawn at random from within a session's own error bars.
const DRAWS: usize = 200;

/// Minimum share of these that must get the same level.
const MIN_AGREEMENT: f64 = 0.95;

/// Half of a bar, in standard deviations.
const BAR_SIGMAS: f64 = crate::numbers::distribution::Z_95;

/// A model of skill.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelModel {
    /// Names of its features, in the order of `scale`.
    pub features: Vec<String>,
    /// The means and deviations that standardise them.
    pub scale: Scale,
    /// Name of its learner.
    pub learner: String,
    /// The learner's parameter in readable form.
    pub parameter: String,
    /// The fitted learner.
    pub scorer: LevelScorer,
    /// Divisor of the scores before they become probabilities.
    pub temperature: f64,
    /// Share of the probability that is divided equally between all levels: a model trained on few people must not be
    /// more certain than this allows.
    pub doubt: f64,
    /// The region of its training data.
    pub region: Region,
    /// True if it did better than models of shuffled levels; otherwise it gives no verdict.
    pub has_skill: bool,
}

impl LevelModel {
    /// Judges a session; `reading` returns a feature's value by name.
    pub fn judge(&self, reading: impl Fn(&str) -> Option<MeasuredValue>) -> LevelVerdict {
        if !self.has_skill {
            return Abstention::KnowsNothing.into();
        }
        let mut readings = Vec::with_capacity(self.features.len());
        for name in &self.features {
            match reading(name).map(MeasuredValue::checked) {
                Some(Ok(MeasuredValue { value, bar: Some(bar) })) => readings.push((value, bar)),
                Some(Ok(_)) => return Abstention::ErrorUnknown { feature: name.clone() }.into(),
                _ => return Abstention::NotMeasured { feature: name.clone() }.into(),
            }
        }
        self.judge_readings(&readings)
    }

    fn judge_readings(&self, readings: &[(f64, ConfidenceInterval)]) -> LevelVerdict {
        let x = self.standardised(|index| readings[index].0);
        let distance = self.region.distance(&x);
        if distance.is_nan() || distance > self.region.limit {
            return Abstention::Outside { distance, limit: self.region.limit }.into();
        }
        let probabilities = self.probabilities(&x);
        let level = likeliest(&probabilities);
        let lead = lead(&probabilities);
        let agreeing = self.agreement(level, readings);
        let said = if lead < MIN_LEAD {
            Err(Abstention::NotClear { lead, least: MIN_LEAD })
        } else if agreeing < MIN_AGREEMENT {
            Err(Abstention::WithinErrors { agreeing, least: MIN_AGREEMENT })
        } else {
            Ok(level)
        };
        LevelVerdict {
            level: said,
            probabilities: Some(probabilities),
            contributions: self.contributions(level, readings, &x),
        }
    }

    /// The probability of each level for standardised features.
    pub(super) fn probabilities(&self, x: &[f64]) -> PerLevel {
        let even = self.doubt / LEVELS as f64;
        shares(&self.scorer.scores(x), self.temperature).map(|share| (1.0 - self.doubt) * share + even)
    }

    pub(super) fn standardised(&self, value: impl Fn(usize) -> f64) -> Vec<f64> {
        let of = |index: usize| (value(index) - self.scale.mean[index]) / self.scale.deviation[index];
        (0..self.features.len()).map(of).collect()
    }

    /// Share of the sessions drawn from within the error bars that get this level. The features' errors are
    /// independent, and normal on each side.
    fn agreement(&self, level: SkillLevel, readings: &[(f64, ConfidenceInterval)]) -> f64 {
        let mut dice = Dice::new(0, "error bars");
        let agrees = |_: &usize| {
            let mut draw = |(value, bar): &(f64, ConfidenceInterval)| {
                let z = dice.gauss() / BAR_SIGMAS;
                value + z * if z < 0.0 { value - bar.low } else { bar.high - value }
            };
            let drawn: Vec<f64> = readings.iter().map(&mut draw).collect();
            likeliest(&self.probabilities(&self.standardised(|index| drawn[index]))) == level
        };
        (0..DRAWS).filter(agrees).count() as f64 / DRAWS as f64
    }

    /// By how much each feature raises the level's probability, compared with the feature at the training sessions'
    /// mean and the others unchanged; the largest first. Features with the same information share its contribution.
    /// (The mean rather than the median, because a median may be one person's own value.)
    fn contributions(&self, level: SkillLevel, readings: &[(f64, ConfidenceInterval)], x: &[f64]) -> Vec<Contribution> {
        let own = self.probabilities(x)[level as usize];
        let of = |index: usize| {
            let mut other = x.to_vec();
            other[index] = 0.0;
            let raises = own - self.probabilities(&other)[level as usize];
            let (feature, mean) = (self.features[index].clone(), self.scale.mean[index]);
            Contribution { feature, value: readings[index].0, mean, raises }
        };
        let mut all: Vec<Contribution> = (0..x.len()).map(of).collect();
        all.sort_by(|a, b| b.raises.abs().total_cmp(&a.raises.abs()).then(a.feature.cmp(&b.feature)));
        all
    }

    /// True if all numbers are finite and all lists have matching lengths, since a file may contain anything.
    pub fn is_sound(&self) -> bool {
        let n = self.features.len();
        let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
        let of_n = |values: &[f64]| values.len() == n && finite(values);
        let scale = of_n(&self.scale.mean) && of_n(&self.scale.deviation);
        let region = self.region.centres.iter().all(|centre| of_n(centre))
            && self.region.precision.len() == n * n
            && finite(&self.region.precision)
            && self.region.limit.is_finite();
        let scorer = match &self.scorer {
            LevelScorer::Linear { weights, offsets } => weights.iter().all(|weights| of_n(weights)) && finite(offsets),
            LevelScorer::Neighbours { k, rows, levels, counts } => {
                (1..=rows.len()).contains(k)
                    && rows.len() == levels.len()
                    && rows.iter().all(|row| of_n(row))
                    && finite(counts)
            }
            LevelScorer::Tree { nodes } => !nodes.is_empty(),
        };
        let positive = self.temperature > 0.0 && self.temperature.is_finite() && (0.0..1.0).contains(&self.doubt);
        n > 0 && scale && self.scale.deviation.iter().all(|d| *d > 0.0) && region && scorer && positive
    }
}

/// Converts scores to probabilities.
pub(super) fn shares(scores: &PerLevel, temperature: f64) -> PerLevel {
    let top = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let raised = scores.map(|score| ((score - top) / temperature).exp());
    let all: f64 = raised.iter().sum();
    raised.map(|share| share / all)
}

/// The likeliest level; of equally likely levels the lower one.
pub(super) fn likeliest(probabilities: &PerLevel) -> SkillLevel {
    let best = (1..LEVELS).fold(0, |best, level| if probabilities[level] > probabilities[best] { level } else { best });
    SkillLevel::ALL[best]
}

fn lead(probabilities: &PerLevel) -> f64 {
    let mut sorted = *probabilities;
    sorted.sort_by(f64::total_cmp);
    sorted[LEVELS - 1] - sorted[LEVELS - 2]
}
