//! The learners, behind one trait: a table of standardised sessions in, a [`Scorer`] out, that gives one score for each level.
//!
//! | file | learner | from |
//! |---|---|---|
//! | `logistic.rs` | multinomial logistic regression with a ridge | smartcore |
//! | `discriminant.rs` | linear discriminant analysis with a shrunk covariance | ours: smartcore has none |
//! | `neighbours.rs` | the k nearest sessions | ours: it must be readable, to be kept |
//! | `tree.rs` | a small decision tree | ours: smartcore's nodes are private, and would not be kept |
//! | `vectors.rs` | linear support vectors for all levels together | ours: smartcore's took 97 % of all time and cannot weigh rare levels |
//!
//! Every level counts the same, however many people it has: what is known of the levels' shares among those who were asked says
//! nothing of the next session.

mod discriminant;
mod logistic;
mod neighbours;
mod tree;
mod vectors;

pub use tree::TreeNode;

use super::{LEVELS, Level, PerLevel};

/// Standardised sessions.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// One row a session.
    pub rows: Vec<Vec<f64>>,
    /// Each one's level.
    pub levels: Vec<Level>,
    /// What each one counts: one divided by its person's sessions.
    pub weights: Vec<f64>,
}

impl Table {
    /// What each level counts in all.
    fn weight_of_levels(&self) -> PerLevel {
        let mut sums = [0.0; LEVELS];
        self.levels.iter().zip(&self.weights).for_each(|(level, weight)| sums[*level as usize] += weight);
        sums
    }
}

/// A way to learn.
pub trait Learner: Sync {
    /// Stable name for files, API and pages.
    fn name(&self) -> &'static str;

    /// Its parameter, as people read it.
    fn parameter(&self) -> String;

    /// Learns; `None` where this cannot be done with these sessions.
    fn fit(&self, table: &Table) -> Option<Scorer>;
}

/// What was learnt. A score is the logarithm of a share, up to what all levels have in common, and up to a factor.
#[derive(Clone, Debug, PartialEq)]
pub enum Scorer {
    /// Each level's score is a sum over the features.
    Linear {
        /// Each level's weights of the features.
        weights: [Vec<f64>; LEVELS],
        /// Each level's score in the mean of all sessions.
        offsets: PerLevel,
    },
    /// Each level's share among the nearest training sessions.
    Neighbours {
        /// How many.
        k: usize,
        /// The training sessions, standardised.
        rows: Vec<Vec<f64>>,
        /// Each one's level.
        levels: Vec<Level>,
        /// What one session of each level counts.
        counts: PerLevel,
    },
    /// Questions of one feature each; the first node is asked first.
    Tree {
        /// The nodes; a fork leads to later ones only.
        nodes: Vec<TreeNode>,
    },
}

impl Scorer {
    /// Each level's score.
    pub fn scores(&self, x: &[f64]) -> PerLevel {
        match self {
            Scorer::Linear { weights, offsets } => {
                let sum = |level: usize| weights[level].iter().zip(x).map(|(w, x)| w * x).sum::<f64>();
                std::array::from_fn(|level| offsets[level] + sum(level))
            }
            Scorer::Neighbours { k, rows, levels, counts } => neighbours::scores(*k, rows, levels, counts, x),
            Scorer::Tree { nodes } => tree::scores(nodes, x),
        }
    }
}

/// Logarithms of shares that start from one session of each level, so that none is impossible.
fn smoothed(shares: PerLevel) -> PerLevel {
    let all: f64 = shares.iter().map(|share| share + 1.0).sum();
    shares.map(|share| ((share + 1.0) / all).ln())
}

/// What is tried, the simplest first: where two do as well, the first is taken.
pub static CANDIDATES: [&dyn Learner; 10] = [
    &discriminant::Discriminant { shrinkage: 0.7 },
    &discriminant::Discriminant { shrinkage: 0.3 },
    &logistic::Logistic { ridge: 10.0 },
    &logistic::Logistic { ridge: 1.0 },
    &vectors::Vectors { ridge: 0.1 },
    &vectors::Vectors { ridge: 0.01 },
    &tree::Tree { depth: 2 },
    &tree::Tree { depth: 3 },
    &neighbours::Neighbours { k: 15 },
    &neighbours::Neighbours { k: 7 },
];
