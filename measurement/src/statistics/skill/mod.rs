//! Novice, intermediate or expert: a model of skill from sessions of people whose level was declared (METHOD 7.2).
//!
//! **In:** features of sessions with their error bars; each session belongs to a person with a declared level. **Out:**
//! a [`LevelModel`] and a [`ValidationReport`] on how well it does on unseen people. **Method:** folds that leave whole
//! people out choose a learner with its parameter and calibrate its probabilities. All of that is repeated for each
//! fold of a second, outer round, on people who had no part in it (nested validation, Varma & Simon 2006). All of
//! *that* is repeated with the levels shuffled between people (Ojala & Garriga 2010). If shuffled levels do as well,
//! the model has no skill and gives no verdicts. Features are selected and standardised on the training part alone:
//! selecting them on all people first is why published figures came out too good. **Gives up** with [`NoModel`]; on a
//! single session with [`Abstention`].
//!
//! | file | contents |
//! |---|---|
//! | `data.rs` | the given sessions, the features that enough of them have, the people |
//! | `scale.rs` | standardised features, and which of them distinguish levels |
//! | `learner/` | logistic regression, LDA, kNN, tree, SVM behind one trait |
//! | `folds.rs` | people divided into folds; labels shuffled |
//! | `choice.rs` | choice of the learner, calibration of its probabilities, region of its data |
//! | `region.rs` | how far a session lies from the training people |
//! | `model.rs` | the stored model: reads a session, gives a verdict |
//! | `verdict.rs` | a verdict, the features that contributed to it, and why there may be none |
//! | `validation.rs` | the outer round, and the baseline of shuffled levels |
//! | `report.rs` | the results of the validation |
//!
//! **Cost**, bounded by [`MAX_PER_LEVEL`], [`MAX_SESSIONS_EACH`], [`MAX_FEATURES`] and [`PERMUTATIONS`]: 65,000 fits.
//! On one core that takes 20 s with the fewest people and 75 s with the most.

mod choice;
mod data;
mod folds;
mod learner;
mod model;
mod region;
mod report;
mod scale;
mod validation;
mod verdict;

pub use data::{LabelledSession, SkillDataset};
pub use learner::{CANDIDATES, Learner, LevelScorer, TrainingTable, TreeNode};
pub use model::LevelModel;
pub use region::Region;
pub use report::{LevelReport, PermutationBaseline, PersonShare, ValidationReport, VerdictAccuracy};
pub use scale::Scale;
pub use validation::{TrainedModel, train};
pub use verdict::{Abstention, Contribution, LevelVerdict};

/// Minimum number of people of each level. With eight, each of the eight outer folds leaves out one of each level.
pub const MIN_PER_LEVEL: usize = 8;

/// Maximum number of people of each level; more would cost time and change little.
pub const MAX_PER_LEVEL: usize = 40;

/// Maximum number of sessions of one person: the last ones.
pub const MAX_SESSIONS_EACH: usize = 3;

/// Maximum number of features that are offered.
pub const MAX_FEATURES: usize = 64;

/// Number of times the levels are shuffled between people: the smallest p-value is one in a hundred.
pub const PERMUTATIONS: usize = 99;

/// A model with a p-value above this has no skill.
pub const SIGNIFICANCE: f64 = 0.05;

/// Number of levels: novice, intermediate, expert.
pub const LEVELS: usize = 3;

/// One number for each level.
pub type PerLevel = [f64; LEVELS];

/// A declared level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SkillLevel {
    /// First steps.
    Novice,
    /// Some operations.
    Intermediate,
    /// Operates regularly.
    Expert,
}

impl SkillLevel {
    /// All levels, from least to most practised.
    pub const ALL: [SkillLevel; LEVELS] = [SkillLevel::Novice, SkillLevel::Intermediate, SkillLevel::Expert];

    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        ["novice", "intermediate", "expert"][self as usize]
    }
}

/// Why there is no model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoModel {
    /// Too few people of a level.
    #[error("{}", missing(found))]
    TooFewPeople {
        /// Number of people with usable sessions, per level.
        found: [usize; LEVELS],
    },
    /// There are more than a model can use.
    #[error("there are {found} {of}; at most {most} are used")]
    TooMany {
        /// What there is too much of, in the plural.
        of: &'static str,
        /// Number of them.
        found: usize,
        /// Maximum number.
        most: usize,
    },
    /// One person has sessions of two levels.
    #[error("one person has sessions of two levels; each person has one level")]
    TwoLevels,
    /// A session has a different number of values than there are features.
    #[error("not every session has as many values as there are features")]
    Ragged,
    /// A value or a bar is NaN or infinite, or the bar does not contain its value.
    #[error("a value or its error bar is not a usable number")]
    NotFinite,
    /// No feature was measured, with its error, in enough sessions, or none differs between them.
    #[error("no feature was measured with its error in enough sessions")]
    NoFeatures,
    /// No learner could be fitted.
    #[error("no learner could be fitted to these sessions")]
    NothingFits,
}

impl NoModel {
    /// Stable name for files, API and pages.
    pub fn name(&self) -> &'static str {
        match self {
            NoModel::TooFewPeople { .. } => "too_few_people",
            NoModel::TooMany { .. } => "too_many",
            NoModel::TwoLevels => "two_levels",
            NoModel::Ragged => "ragged",
            NoModel::NotFinite => "not_finite",
            NoModel::NoFeatures => "no_features",
            NoModel::NothingFits => "nothing_fits",
        }
    }
}

fn missing(found: &[usize; LEVELS]) -> String {
    let each = SkillLevel::ALL.map(|level| {
        let has = found[level as usize];
        let name = level.name();
        match MIN_PER_LEVEL.saturating_sub(has) {
            0 => format!("{name}: {has}"),
            missing => format!("{name}: {has}, {missing} missing"),
        }
    });
    format!("a model needs {MIN_PER_LEVEL} people of each level with usable sessions ({})", each.join("; "))
}

#[cfg(test)]
mod tests;
