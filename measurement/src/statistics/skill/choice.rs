//! Chooses the learner by folds that leave people out, calibrates its probabilities on the people left out, and fits it
//! to all people.

use super::data::{SkillDataset, TrainingRow};
use super::folds::assign_folds;
use super::learner::{CANDIDATES, Learner, TrainingTable};
use super::model::{LevelModel, shares};
use super::region::{Region, SHARE_INSIDE};
use super::scale::Scale;
use super::{LEVELS, PerLevel, SkillLevel};
use crate::numbers::quantile::interpolated_quantile;
use crate::random::Dice;

/// Number of folds of the inner round.
const FOLDS: usize = 4;

/// Number of features that are used, those that distinguish levels best first; one of these, chosen like the learner.
const FEATURES_USED: [usize; 2] = [4, 12];

/// Divisor of the scores before they become probabilities; one of these. An overconfident learner gets a large one.
const TEMPERATURES: [f64; 9] = [0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0, 8.0];

/// Some of a dataset's people, with levels that may differ from their own (shuffled).
pub(super) struct TrainingPart<'d> {
    pub data: &'d SkillDataset,
    pub levels: &'d [SkillLevel],
    pub people: Vec<usize>,
}

/// A choice: the temperature, the index of the number of features, and the learner.
type ModelChoice = (f64, usize, &'static dyn Learner);

/// A candidate's scores for the people left out, each with the index of its row.
type HeldOutScores = Vec<(usize, PerLevel)>;

impl<'d> TrainingPart<'d> {
    fn rows(&self) -> impl Iterator<Item = (usize, &'d TrainingRow)> {
        self.data.rows.iter().enumerate().filter(|(_, row)| self.people.contains(&row.person))
    }

    fn scale(&self, most: usize) -> Option<Scale> {
        let (readings, people): (Vec<_>, Vec<_>) =
            self.rows().map(|(_, row)| (row.readings.as_slice(), row.person)).unzip();
        Scale::of(&readings, &people, self.levels, most)
    }

    fn table(&self, scale: &Scale) -> TrainingTable {
        let mut table = TrainingTable::default();
        for (_, row) in self.rows() {
            table.rows.push(scale.apply(|feature| row.readings[feature].value));
            table.levels.push(self.levels[row.person]);
            table.weights.push(1.0 / self.data.rows.iter().filter(|other| other.person == row.person).count() as f64);
        }
        table
    }

    /// Divides the people of this part into folds. For each fold: the people left out, and the rest.
    pub fn folds(&self, folds: usize, dice: &mut Dice) -> Vec<(Vec<usize>, TrainingPart<'d>)> {
        let dealt = assign_folds(&self.people, self.levels, folds, dice);
        let of = |fold: usize| {
            let (out, rest): (Vec<_>, Vec<_>) = dealt.iter().partition(|(_, own)| *own == fold);
            let people = |of: Vec<(usize, usize)>| of.into_iter().map(|(person, _)| person).collect::<Vec<_>>();
            (people(out), TrainingPart { data: self.data, levels: self.levels, people: people(rest) })
        };
        (0..folds).map(of).collect()
    }

    /// Fits the model of this part; `None` if no learner can be fitted.
    pub fn model(&self, dice: &mut Dice) -> Option<LevelModel> {
        let tried = self.try_all(dice);
        let (temperature, count_index, learner) = self.best(&tried)?;
        let scale = self.scale(FEATURES_USED[count_index])?;
        let table = self.table(&scale);
        let mut distances = tried.distances[count_index].clone();
        distances.sort_by(f64::total_cmp);
        let limit = interpolated_quantile(&distances, SHARE_INSIDE)?;
        let region = Region { limit, ..Region::of(&table)? };
        let scorer = learner.fit(&table)?;
        let features = scale.chosen.iter().map(|feature| self.data.features[*feature].clone()).collect();
        let (learner, parameter) = (learner.name().to_owned(), learner.parameter());
        // Laplace's rule of succession: as if one more person of each level had been seen, with features that fit every
        // level.
        let doubt = LEVELS as f64 / (self.people.len() + LEVELS) as f64;
        Some(LevelModel { features, scale, learner, parameter, scorer, temperature, doubt, region, has_skill: true })
    }

    fn try_all(&self, dice: &mut Dice) -> CandidateResults {
        let mut tried = CandidateResults::default();
        for (out, rest) in self.folds(FOLDS, dice) {
            let left = TrainingPart { data: self.data, levels: self.levels, people: out };
            for (count_index, count) in FEATURES_USED.iter().enumerate() {
                tried.try_fold(count_index, rest.scale(*count), &rest, &left);
            }
        }
        tried
    }

    /// The temperature, number of features and learner with the smallest log loss on the people left out: the mean
    /// logarithm of the probability of their level. Each person of a level counts the same, and so does each level.
    fn best(&self, tried: &CandidateResults) -> Option<ModelChoice> {
        let weights = self.weights();
        let mut best: Option<(f64, ModelChoice)> = None;
        for (count_index, of_count) in tried.scores.iter().enumerate() {
            for (learner, held_out) in CANDIDATES.iter().zip(of_count) {
                let Some(held_out) = held_out else { continue };
                for temperature in TEMPERATURES {
                    let loss = self.loss(held_out, temperature, &weights);
                    if loss.is_finite() && best.as_ref().is_none_or(|(least, _)| loss < *least - 1e-9) {
                        best = Some((loss, (temperature, count_index, *learner)));
                    }
                }
            }
        }
        best.map(|(_, chosen)| chosen)
    }

    fn loss(&self, held_out: &HeldOutScores, temperature: f64, weights: &[f64]) -> f64 {
        let surprise = |(row, scores): &(usize, PerLevel)| {
            let level = self.levels[self.data.rows[*row].person] as usize;
            -weights[*row] * shares(scores, temperature)[level].max(1e-6).ln()
        };
        held_out.iter().map(surprise).sum()
    }

    /// The weight of each row: its share of its person, and the person's share of the level.
    fn weights(&self) -> Vec<f64> {
        let sessions = |person| self.data.rows.iter().filter(|row| row.person == person).count() as f64;
        let people = |level| self.people.iter().filter(|person| self.levels[**person] == level).count() as f64;
        self.data.rows.iter().map(|row| 1.0 / sessions(row.person) / people(self.levels[row.person]).max(1.0)).collect()
    }
}

/// The results of the inner round.
struct CandidateResults {
    /// By number of features and learner; `None` if it could not be fitted in every fold.
    scores: [[Option<HeldOutScores>; CANDIDATES.len()]; FEATURES_USED.len()],
    /// Distances of the people left out from the rest, by number of features.
    distances: [Vec<f64>; FEATURES_USED.len()],
}

impl Default for CandidateResults {
    fn default() -> Self {
        Self {
            scores: std::array::from_fn(|_| std::array::from_fn(|_| Some(Vec::new()))),
            distances: Default::default(),
        }
    }
}

impl CandidateResults {
    fn try_fold(&mut self, count_index: usize, scale: Option<Scale>, rest: &TrainingPart, left: &TrainingPart) {
        let Some(scale) = scale else {
            self.scores[count_index].iter_mut().for_each(|held_out| *held_out = None);
            return;
        };
        let table = rest.table(&scale);
        let out: Vec<(usize, Vec<f64>)> =
            left.rows().map(|(at, row)| (at, scale.apply(|feature| row.readings[feature].value))).collect();
        if let Some(region) = Region::of(&table) {
            self.distances[count_index].extend(out.iter().map(|(_, x)| region.distance(x)));
        }
        for (learner, held_out) in CANDIDATES.iter().zip(&mut self.scores[count_index]) {
            let Some(all) = held_out else { continue };
            match learner.fit(&table) {
                Some(scorer) => all.extend(out.iter().map(|(at, x)| (*at, scorer.scores(x)))),
                None => *held_out = None,
            }
        }
    }
}
