//! How well a model does on people left out, as it is told.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::Level;
use crate::pipeline::score::skill;

/// How well models of a task do on people whom they never saw.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// Did it do better than models of shuffled levels? Else it knows nothing, and gives no verdicts.
    pub knows: bool,
    /// How many people of each level: novice, intermediate, expert.
    pub people: [usize; skill::LEVELS],
    /// How many sessions of each.
    pub sessions: [usize; skill::LEVELS],
    /// Sessions that lacked a feature and were left out.
    pub left_out: usize,
    /// How many features were offered to the learners.
    pub offered: usize,
    /// Share of sessions whose level was found, the mean over people; the interval counts people.
    pub accuracy: Share,
    /// Mean of the levels' shares; guessing gives a third.
    pub balanced: f64,
    /// The levels' shares.
    pub levels: Vec<OfLevel>,
    /// Of people of each declared level (row), the share of sessions that were given each level (column), summed over people.
    pub confusion: Vec<PerLevel>,
    /// What the same procedure gives with levels shuffled between people.
    pub baseline: Baseline,
    /// What it is worth where it gives a level.
    pub speaking: Speaking,
    /// Which learners were chosen in the outer folds.
    pub chosen: Vec<Chosen>,
}

/// One number for each level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PerLevel {
    /// Of novice.
    pub novice: f64,
    /// Of intermediate.
    pub intermediate: f64,
    /// Of expert.
    pub expert: f64,
}

/// A share of some people, 0 to 1, with its 95 % interval (Wilson) over people.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Share {
    /// The share.
    pub value: f64,
    /// It lies with 95 % between `low`
    pub low: f64,
    /// and `high`.
    pub high: f64,
    /// Over how many people.
    pub people: usize,
}

/// How well a level is found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OfLevel {
    /// Which.
    pub level: Level,
    /// Share of its people's sessions that were given it.
    #[serde(flatten)]
    pub found: Share,
}

/// What shuffled levels give.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Baseline {
    /// How often the levels were shuffled between people.
    pub permutations: usize,
    /// The balanced accuracy that they gave in the mean.
    pub mean: f64,
    /// Nineteen of twenty gave at most this.
    pub high: f64,
    /// How likely as good a result is without knowledge.
    pub p: f64,
}

/// What it is worth where it gives a level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Speaking {
    /// Share of the sessions of people left out that were given a level.
    pub share: f64,
    /// Share of these whose level was right; `null` if it never spoke.
    pub right: Option<Share>,
    /// The same of those that were given novice, intermediate, expert; `null` of a level that it never gave.
    pub of_level: [Option<Share>; skill::LEVELS],
}

/// How often a learner was chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Chosen {
    /// `logistic`, `lda`, `knn`, `tree` or `svm`.
    pub learner: String,
    /// In so many outer folds.
    pub folds: usize,
}

impl Speaking {
    /// Where this level was given, the share that was right.
    pub fn right_where(&self, given: Level) -> Option<Share> {
        self.of_level[skill::Level::from(given) as usize]
    }
}

impl Report {
    /// A report as it is told.
    pub fn of(report: skill::Report, knows: bool) -> Self {
        let skill::Report {
            people,
            sessions,
            left_out,
            offered,
            accuracy,
            balanced,
            levels,
            confusion,
            baseline,
            speaking,
            chosen,
        } = report;
        let skill::Baseline { permutations, mean, high, p } = baseline;
        let of_level = |of: skill::LevelReport| OfLevel { level: of.level.into(), found: of.found.into() };
        Self {
            knows,
            people,
            sessions,
            left_out,
            offered,
            accuracy: accuracy.into(),
            balanced,
            levels: levels.map(of_level).into(),
            confusion: confusion.map(PerLevel::from).into(),
            baseline: Baseline { permutations, mean, high, p },
            speaking: Speaking {
                share: speaking.share,
                right: speaking.right.map(Share::from),
                of_level: speaking.of_level.map(|share| share.map(Share::from)),
            },
            chosen: chosen.into_iter().map(|(learner, folds)| Chosen { learner, folds }).collect(),
        }
    }
}

impl From<skill::PerLevel> for PerLevel {
    fn from([novice, intermediate, expert]: skill::PerLevel) -> Self {
        Self { novice, intermediate, expert }
    }
}

impl From<skill::Share> for Share {
    fn from(share: skill::Share) -> Self {
        let skill::Share { value, interval, people } = share;
        Self { value, low: interval.low, high: interval.high, people }
    }
}
