//! What came of the validation.

use super::validation::Guess;
use super::{LEVELS, Level, NoModel, PerLevel};
use crate::pipeline::score::interval::{Interval, wilson};

/// How well models do on people whom they never saw.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// How many people of each level.
    pub people: [usize; LEVELS],
    /// How many sessions of each.
    pub sessions: [usize; LEVELS],
    /// Sessions that lacked a feature and were left out.
    pub left_out: usize,
    /// How many features were offered.
    pub offered: usize,
    /// Share of sessions whose level was found, the mean over people: their interval counts people, since one person's sessions
    /// are alike. The likeliest level counts, whether the model would have said it or not.
    pub accuracy: Share,
    /// Mean of the levels' shares: what guessing gives is a third, however many people each level has.
    pub balanced: f64,
    /// Each level's share.
    pub levels: [LevelReport; LEVELS],
    /// Of people of a level (row), the share of sessions that were given each level (column), summed over people.
    pub confusion: [PerLevel; LEVELS],
    /// What shuffled levels give.
    pub baseline: Baseline,
    /// What it is worth where it speaks.
    pub speaking: Speaking,
    /// In how many of the outer folds each learner was chosen.
    pub chosen: Vec<(String, usize)>,
}

/// A share of some people, 0 to 1, with Wilson's 95 % interval over people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    /// The share.
    pub value: f64,
    /// Where it lies with 95 %.
    pub interval: Interval,
    /// Over how many people.
    pub people: usize,
}

/// How well one level is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelReport {
    /// Which.
    pub level: Level,
    /// Share of its people's sessions that were given it.
    pub found: Share,
}

/// What the whole procedure gives where levels say nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Baseline {
    /// How often levels were shuffled between people.
    pub permutations: usize,
    /// The balanced accuracy that they gave in the mean.
    pub mean: f64,
    /// Nineteen of twenty of them gave at most this.
    pub high: f64,
    /// How likely as good a result is without knowledge: (k + 1)/(n + 1).
    pub p: f64,
}

/// Sessions of people left out of whom the model would have given a level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speaking {
    /// Their share of all sessions, the mean over people.
    pub share: f64,
    /// Of these, the share whose level was right, over people of whom it spoke; `None` if it never did.
    pub right: Option<Share>,
    /// The same of the sessions that were given this level, for each level.
    pub of_level: [Option<Share>; LEVELS],
}

/// Of each person with any, the mean over their sessions.
pub(super) fn by_person(guesses: &[Guess], value: impl Fn(&Guess) -> Option<f64>) -> Vec<(Level, f64)> {
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

/// Mean of the levels' shares of sessions that were given their level.
pub(super) fn balanced(guesses: &[Guess]) -> f64 {
    let right = by_person(guesses, |guess| Some(f64::from(guess.guessed == guess.level)));
    Level::ALL.iter().map(|level| mean_of(&right, |of| of == *level)).sum::<f64>() / LEVELS as f64
}

pub(super) fn mean_of(people: &[(Level, f64)], wanted: impl Fn(Level) -> bool) -> f64 {
    let values: Vec<f64> = people.iter().filter(|(level, _)| wanted(*level)).map(|(_, value)| *value).collect();
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// The share of some people, with its interval.
pub(super) fn share(people: &[(Level, f64)], wanted: impl Fn(Level) -> bool) -> Result<Share, NoModel> {
    let count = people.iter().filter(|(level, _)| wanted(*level)).count();
    let value = mean_of(people, wanted);
    // A person's share varies at most as much as a yes or no: Wilson's interval is on the safe side.
    let interval = wilson(value, count).map_err(|_| NoModel::NothingFits)?;
    Ok(Share { value, interval, people: count })
}
