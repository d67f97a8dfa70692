//! Novice, intermediate or expert: a model of skill from sessions of people whose level was declared (METHOD 7.2).
//!
//! **In:** features of sessions with their error bars, each session with its person and that person's declared level. **Out:** a
//! [`Model`] and a [`Report`] of how well it does on people whom it never saw. **Method:** a learner with its parameter is
//! chosen and made honest about its probabilities by folds that leave whole people out; all of that is done again for each fold
//! of a second, outer round, whose people had no part in it (nested validation, Varma & Simon 2006); and all of *that* is
//! repeated with the levels shuffled between people (Ojala & Garriga 2010). Where the shuffled levels do as well, the model
//! knows nothing and gives no verdicts. Features are chosen, and standardised, on the training part alone: choosing them on all
//! people first is how published figures came to be too good. **Gives up** with [`NoModel`]; a single session with [`Abstains`].
//!
//! | file | holds |
//! |---|---|
//! | `data.rs` | sessions as they are given, features that enough of them have, people |
//! | `scale.rs` | standardised features, and which of them tell levels apart |
//! | `learner/` | logistic regression, LDA, kNN, tree, SVM behind one trait |
//! | `folds.rs` | people dealt into folds; labels shuffled |
//! | `choice.rs` | the learner chosen, its probabilities made honest, the region of its data |
//! | `region.rs` | how far a session lies from the training people |
//! | `model.rs` | what is kept: reads a session, gives a verdict |
//! | `verdict.rs` | a verdict, what carried it, why there is none |
//! | `validation.rs` | the outer round, and the baseline of shuffled levels |
//! | `report.rs` | what came of it |
//!
//! **Cost**, bounded by [`MOST_PER_LEVEL`], [`SESSIONS_EACH`], [`MOST_FEATURES`] and [`PERMUTATIONS`]: 65,000 fits. On one
//! core that takes 20 s with the fewest people and 75 s with the most.

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

pub use data::{Dataset, Sample};
pub use learner::{CANDIDATES, Learner, Scorer, Table, TreeNode};
pub use model::Model;
pub use region::Region;
pub use report::{Baseline, LevelReport, Report, Share, Speaking};
pub use scale::Scale;
pub use validation::{Trained, train};
pub use verdict::{Abstains, Contribution, Verdict};

/// Fewest people of each level. With eight, one of each is left out in each of the eight outer folds.
pub const FEWEST_PER_LEVEL: usize = 8;

/// Most people of each level; more would cost time and change little.
pub const MOST_PER_LEVEL: usize = 40;

/// Most sessions of one person: their last ones.
pub const SESSIONS_EACH: usize = 3;

/// Most features that are offered.
pub const MOST_FEATURES: usize = 64;

/// How often the levels are shuffled between people: the least p-value is one in a hundred.
pub const PERMUTATIONS: usize = 99;

/// A model whose p-value is above this knows nothing.
pub const SIGNIFICANT: f64 = 0.05;

/// Levels in their order: novice, intermediate, expert.
pub const LEVELS: usize = 3;

/// One number for each level.
pub type PerLevel = [f64; LEVELS];

/// A declared level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// First steps.
    Novice,
    /// Some operations.
    Intermediate,
    /// Operates regularly.
    Expert,
}

impl Level {
    /// All levels, from least to most practised.
    pub const ALL: [Level; LEVELS] = [Level::Novice, Level::Intermediate, Level::Expert];

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
        /// How many there are with usable sessions, of each level.
        found: [usize; LEVELS],
    },
    /// More than a model is made from.
    #[error("there are {found} {of}; at most {most} are used")]
    TooMany {
        /// Of what, in the plural.
        of: &'static str,
        /// How many there are.
        found: usize,
        /// How many there may be.
        most: usize,
    },
    /// One person is said to have two levels.
    #[error("one person has sessions of two levels; each person has one level")]
    TwoLevels,
    /// A session has another number of values than there are features.
    #[error("not every session has as many values as there are features")]
    Ragged,
    /// A value or a bar is NaN or infinite, or the bar does not hold its value.
    #[error("a value or its error bar is not usable")]
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
    let each = Level::ALL.map(|level| {
        let has = found[level as usize];
        let name = level.name();
        match FEWEST_PER_LEVEL.saturating_sub(has) {
            0 => format!("{name}: {has}"),
            missing => format!("{name}: {has}, {missing} missing"),
        }
    });
    format!("a model takes {FEWEST_PER_LEVEL} people of each level with usable sessions ({})", each.join("; "))
}

#[cfg(test)]
mod tests;
