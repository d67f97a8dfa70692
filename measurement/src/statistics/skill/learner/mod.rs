//! The learners behind one trait: each takes a table of standardised sessions and returns a [`LevelScorer`], which
//! gives one score per level.
//!
//! | file | learner | from |
//! |---|---|---|
//! | `logistic.rs` | multinomial logistic regression with a ridge | smartcore |
//! | `discriminant.rs` | linear discriminant analysis with a shrunk covariance | ours: smartcore has none |
//! | `neighbours.rs` | the k nearest sessions | ours: its data must be accessible to be stored |
//! | `tree.rs` | a small decision tree | ours: smartcore's nodes are private and cannot be stored |
//! | `vectors.rs` | linear support vectors for all levels | ours: smartcore's took 97 % of all time, without level weights |
//!
//! Every level counts the same, regardless of its number of people: the shares of the levels among the training people
//! say nothing about the next session.

mod discriminant;
mod logistic;
mod neighbours;
mod tree;
mod vectors;

pub use tree::TreeNode;

use super::{LEVELS, PerLevel, SkillLevel};

/// Standardised sessions.
#[derive(Clone, Debug, Default)]
pub struct TrainingTable {
    /// One row a session.
    pub rows: Vec<Vec<f64>>,
    /// Level of each session.
    pub levels: Vec<SkillLevel>,
    /// Weight of each session: 1 divided by the number of its person's sessions.
    pub weights: Vec<f64>,
}

impl TrainingTable {
    /// The total weight of each level.
    fn weight_of_levels(&self) -> PerLevel {
        let mut sums = [0.0; LEVELS];
        self.levels.iter().zip(&self.weights).for_each(|(level, weight)| sums[*level as usize] += weight);
        sums
    }
}

/// A learning method.
pub trait Learner: Sync {
    /// Stable name for files, API and pages.
    fn name(&self) -> &'static str;

    /// Its parameter in readable form.
    fn parameter(&self) -> String;

    /// Fits the method to the sessions; `None` if this is impossible.
    fn fit(&self, table: &TrainingTable) -> Option<LevelScorer>;
}

/// A fitted learner. A score is the logarithm of a level's share, up to a constant common to all levels, and up to a
/// factor.
#[derive(Clone, Debug, PartialEq)]
pub enum LevelScorer {
    /// Each level's score is a sum over the features.
    Linear {
        /// The weights of the features for each level.
        weights: [Vec<f64>; LEVELS],
        /// The score of each level at the mean of all sessions.
        offsets: PerLevel,
    },
    /// Each level's share among the nearest training sessions.
    Neighbours {
        /// Number of nearest sessions.
        k: usize,
        /// The training sessions, standardised.
        rows: Vec<Vec<f64>>,
        /// Level of each training session.
        levels: Vec<SkillLevel>,
        /// Weight of one session of each level.
        counts: PerLevel,
    },
    /// A tree of questions about one feature each, starting at the first node.
    Tree {
        /// The nodes; a fork leads only to later nodes.
        nodes: Vec<TreeNode>,
    },
}

impl LevelScorer {
    /// The score of each level.
    pub fn scores(&self, x: &[f64]) -> PerLevel {
        match self {
            LevelScorer::Linear { weights, offsets } => {
                let sum = |level: usize| weights[level].iter().zip(x).map(|(w, x)| w * x).sum::<f64>();
                std::array::from_fn(|level| offsets[level] + sum(level))
            }
            LevelScorer::Neighbours { k, rows, levels, counts } => neighbours::scores(*k, rows, levels, counts, x),
            LevelScorer::Tree { nodes } => tree::scores(nodes, x),
        }
    }
}

/// Logarithms of shares that start from one session of each level, so that no level is impossible.
fn smoothed_log_shares(shares: PerLevel) -> PerLevel {
    let all: f64 = shares.iter().map(|share| share + 1.0).sum();
    shares.map(|share| ((share + 1.0) / all).ln())
}

/// The candidates, the simplest first: of equally good ones the first is chosen.
pub static CANDIDATES: [&dyn Learner; 10] = [
    &discriminant::Discriminant { shrinkage: 0.7 },
    &discriminant::Discriminant { shrinkage: 0.3 },
    &logistic::Logistic { ridge: 10.0 },
    &logistic::Logistic { ridge: 1.0 },
    &vectors::SupportVectors { ridge: 0.1 },
    &vectors::SupportVectors { ridge: 0.01 },
    &tree::Tree { depth: 2 },
    &tree::Tree { depth: 3 },
    &neighbours::Neighbours { k: 15 },
    &neighbours::Neighbours { k: 7 },
];
