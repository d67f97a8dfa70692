//! How well a model does on held-out people, as stored and shown.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::Level;
use crate::statistics::skill;

/// How well models of a task do on held-out people.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelReport {
    /// Whether it did better than models trained on shuffled levels. If not, it gives no verdicts.
    pub knows: bool,
    /// Number of people of each level: novice, intermediate, expert.
    pub people: [usize; skill::LEVELS],
    /// Number of sessions of each level.
    pub sessions: [usize; skill::LEVELS],
    /// Number of sessions left out because they lacked a feature.
    pub left_out: usize,
    /// Number of features offered to the learners.
    pub offered: usize,
    /// Share of sessions whose level was found, as the mean over people; the interval counts people.
    pub accuracy: ShareOfPeople,
    /// Mean of the levels' shares; guessing gives a third.
    pub balanced: f64,
    /// The levels' shares.
    pub levels: Vec<LevelAccuracy>,
    /// Of people of each declared level (row), the share of sessions that were given each level (column), summed over
    /// people.
    pub confusion: Vec<PerLevel>,
    /// The result of the same procedure with levels shuffled between people.
    pub baseline: ShuffledBaseline,
    /// Accuracy where it gives a level.
    pub speaking: AccuracyWhereGiven,
    /// The learners chosen in the outer folds.
    pub chosen: Vec<ChosenLearner>,
}

/// One number for each level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PerLevel {
    /// For novice.
    pub novice: f64,
    /// For intermediate.
    pub intermediate: f64,
    /// For expert.
    pub expert: f64,
}

/// A share of some people, 0 to 1, with its 95 % interval (Wilson) over people.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ShareOfPeople {
    /// The share.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
    /// Number of people.
    pub people: usize,
}

/// Accuracy for one level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LevelAccuracy {
    /// The level.
    pub level: Level,
    /// Share of its people's sessions that were given this level.
    #[serde(flatten)]
    pub found: ShareOfPeople,
}

/// Accuracy with shuffled levels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ShuffledBaseline {
    /// How often the levels were shuffled between people.
    pub permutations: usize,
    /// Mean balanced accuracy of the shuffled levels.
    pub mean: f64,
    /// 95th percentile of their balanced accuracy.
    pub high: f64,
    /// Probability of an equally good result by chance.
    pub p: f64,
}

/// Accuracy where the model gives a level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AccuracyWhereGiven {
    /// Share of held-out people's sessions that were given a level.
    pub share: f64,
    /// Share of these whose level was right; `null` if no level was given.
    pub right: Option<ShareOfPeople>,
    /// The same for sessions given novice, intermediate, expert; `null` for a level that was never given.
    pub of_level: [Option<ShareOfPeople>; skill::LEVELS],
}

/// How often a learner was chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ChosenLearner {
    /// `logistic`, `lda`, `knn`, `tree` or `svm`.
    pub learner: String,
    /// Number of outer folds that chose it.
    pub folds: usize,
}

impl AccuracyWhereGiven {
    /// The share that was right where this level was given.
    pub fn accuracy_for(&self, given: Level) -> Option<ShareOfPeople> {
        self.of_level[skill::SkillLevel::from(given) as usize]
    }
}

impl ModelReport {
    /// The stored form of the pipeline's report.
    pub fn of(report: skill::ValidationReport, knows: bool) -> Self {
        let skill::ValidationReport {
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
        let skill::PermutationBaseline { permutations, mean, high, p } = baseline;
        let of_level = |of: skill::LevelReport| LevelAccuracy { level: of.level.into(), found: of.found.into() };
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
            baseline: ShuffledBaseline { permutations, mean, high, p },
            speaking: AccuracyWhereGiven {
                share: speaking.share,
                right: speaking.right.map(ShareOfPeople::from),
                of_level: speaking.of_level.map(|share| share.map(ShareOfPeople::from)),
            },
            chosen: chosen.into_iter().map(|(learner, folds)| ChosenLearner { learner, folds }).collect(),
        }
    }
}

impl From<skill::PerLevel> for PerLevel {
    fn from([novice, intermediate, expert]: skill::PerLevel) -> Self {
        Self { novice, intermediate, expert }
    }
}

impl From<skill::PersonShare> for ShareOfPeople {
    fn from(share: skill::PersonShare) -> Self {
        let skill::PersonShare { value, interval, people } = share;
        Self { value, low: interval.low, high: interval.high, people }
    }
}
