//! The results of the validation.

use super::validation::Guess;
use super::{LEVELS, NoModel, PerLevel, SkillLevel};
use crate::statistics::interval::{ConfidenceInterval, wilson};

/// How well models do on unseen people.
#[derive(Clone, Debug, PartialEq)]
pub struct ValidationReport {
    /// Number of people of each level.
    pub people: [usize; LEVELS],
    /// Number of sessions of each level.
    pub sessions: [usize; LEVELS],
    /// Number of sessions that lacked a feature and were left out.
    pub left_out: usize,
    /// Number of features that were offered.
    pub offered: usize,
    /// Share of sessions whose level was found, as the mean over people. The interval counts people, since one person's
    /// sessions are alike. The likeliest level counts, even if the model would have abstained.
    pub accuracy: PersonShare,
    /// Mean of the levels' shares. Guessing gives a third, regardless of the number of people of each level.
    pub balanced: f64,
    /// The share of each level.
    pub levels: [LevelReport; LEVELS],
    /// Confusion matrix: for people of a level (row), the share of their sessions that were given each level (column),
    /// summed over people.
    pub confusion: [PerLevel; LEVELS],
    /// The result with shuffled levels.
    pub baseline: PermutationBaseline,
    /// Accuracy on the sessions for which it gives a level.
    pub speaking: VerdictAccuracy,
    /// Number of outer folds that chose each learner.
    pub chosen: Vec<(String, usize)>,
}

/// A share over people, 0 to 1, with Wilson's 95 % interval over people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PersonShare {
    /// The share.
    pub value: f64,
    /// Its 95 % interval.
    pub interval: ConfidenceInterval,
    /// Number of people.
    pub people: usize,
}

/// How well one level is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelReport {
    /// The level.
    pub level: SkillLevel,
    /// Share of its people's sessions that were given this level.
    pub found: PersonShare,
}

/// The result of the whole procedure where levels carry no information.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PermutationBaseline {
    /// Number of times the levels were shuffled between people.
    pub permutations: usize,
    /// Their mean balanced accuracy.
    pub mean: f64,
    /// Their 95 % quantile: nineteen of twenty gave at most this.
    pub high: f64,
    /// p-value: the chance of a result at least as good without skill, (k + 1)/(n + 1).
    pub p: f64,
}

/// How often the model gives a level for people left out, and how often that level is right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VerdictAccuracy {
    /// Share of all sessions for which it gives a level, as the mean over people.
    pub share: f64,
    /// Of these, the share with the right level, over the people with any; `None` if it never gave a level.
    pub right: Option<PersonShare>,
    /// The same among the sessions that were given this level, for each level.
    pub of_level: [Option<PersonShare>; LEVELS],
}

/// The mean of a value over each person's sessions, for people with any value.
pub(super) fn by_person(guesses: &[Guess], value: impl Fn(&Guess) -> Option<f64>) -> Vec<(SkillLevel, f64)> {
    let mut sums = std::collections::BTreeMap::new();
    for guess in guesses {
        if let Some(value) = value(guess) {
            let (_, sum, n) = sums.entry(guess.person).or_insert((guess.level, 0.0, 0.0));
            *sum += value;
            *n += 1.0;
        }
    }
    sums.into_values().map(|(level, sum, n)| (level, sum / n)).collect()
}

/// Balanced accuracy: the mean over levels of the share of sessions that were given their own level.
pub(super) fn balanced(guesses: &[Guess]) -> f64 {
    let right = by_person(guesses, |guess| Some(f64::from(guess.guessed == guess.level)));
    SkillLevel::ALL.iter().map(|level| mean_of(&right, |of| of == *level)).sum::<f64>() / LEVELS as f64
}

pub(super) fn mean_of(people: &[(SkillLevel, f64)], wanted: impl Fn(SkillLevel) -> bool) -> f64 {
    let values: Vec<f64> = people.iter().filter(|(level, _)| wanted(*level)).map(|(_, value)| *value).collect();
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// The share over the wanted people, with its interval.
pub(super) fn share(people: &[(SkillLevel, f64)], wanted: impl Fn(SkillLevel) -> bool) -> Result<PersonShare, NoModel> {
    let count = people.iter().filter(|(level, _)| wanted(*level)).count();
    let value = mean_of(people, wanted);
    // A person's share varies at most as much as a yes or no, so Wilson's interval is conservative.
    let interval = wilson(value, count).map_err(|_| NoModel::NothingFits)?;
    Ok(PersonShare { value, interval, people: count })
}
