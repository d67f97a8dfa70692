//! A model of skill as it is kept, told and read from a file.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | a model as it is kept; its data's fingerprint |
//! | `readings.rs` | which features may carry a verdict, and a session's values of them |
//! | `file.rs` | a model as a file |
//! | `report.rs` | how well it does on people left out |
//! | `verdict.rs` | what it says of a session, or why it says nothing |

mod file;
mod readings;
mod report;
mod verdict;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

pub use file::ModelFile;
pub use readings::{Reading, Readings, features_offered, most_common_tools};
pub use report::{PerLevel, Report, Share};
pub use verdict::{Carried, Reason, ReasonName, SkillVerdict};

use super::text::Invalid;
use super::trainee::Level;
use crate::pipeline::score::skill::{self, Dataset, Model, Region, Scale, TreeNode};

/// A model as it is kept. It holds no names; only nearest neighbours hold sessions, standardised and without whose they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// How many tools the task is done with.
    pub tools: usize,
    /// The features it goes by.
    pub features: Vec<Scaled>,
    /// Name of its learner.
    pub learner: String,
    /// The learner's parameter, as people read it.
    pub parameter: String,
    /// What was learnt.
    pub scorer: Scorer,
    /// What scores are divided by before they become probabilities.
    pub temperature: f64,
    /// Share of the probability that is the same for all levels.
    pub doubt: f64,
    /// The levels' centres, standardised.
    pub centres: [Vec<f64>; skill::LEVELS],
    /// Inverse of the covariance around them, row by row.
    pub precision: Vec<f64>,
    /// The farthest that a session may lie from the nearest centre, standard deviations.
    pub limit: f64,
    /// Did it do better than models of shuffled levels? Else it gives no verdict.
    pub knows: bool,
}

/// A feature with what it is standardised by, in its unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scaled {
    /// Stable name.
    pub feature: String,
    /// The training sessions' mean.
    pub mean: f64,
    /// Their standard deviation.
    pub deviation: f64,
}

/// What was learnt; see [`skill::Scorer`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Scorer {
    /// Weights of the features, for each level.
    Linear {
        /// Each level's weights.
        weights: [Vec<f64>; skill::LEVELS],
        /// Each level's score in the mean of all sessions.
        offsets: [f64; skill::LEVELS],
    },
    /// The nearest training sessions.
    Neighbours {
        /// How many.
        k: usize,
        /// The sessions, standardised.
        rows: Vec<Vec<f64>>,
        /// Each one's level.
        levels: Vec<Level>,
        /// What one session of each level counts.
        counts: [f64; skill::LEVELS],
    },
    /// Questions, the first one first.
    Tree {
        /// Forks and leaves.
        nodes: Vec<Node>,
    },
}

/// A node of a tree; see [`TreeNode`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub enum Node {
    /// A question.
    Fork {
        /// Which of the features.
        feature: usize,
        /// The limit, standardised.
        limit: f64,
        /// The node that follows at or below it.
        at_most: usize,
        /// The node that follows above it.
        above: usize,
    },
    /// An answer.
    Leaf {
        /// The levels' scores.
        scores: [f64; skill::LEVELS],
    },
}

impl Definition {
    /// A trained model as it is kept, for sessions with so many tools.
    pub fn of(model: Model, tools: usize) -> Self {
        let Model { features, scale, learner, parameter, scorer, temperature, doubt, region, knows } = model;
        let scaled = features.into_iter().zip(scale.mean).zip(scale.deviation);
        let features = scaled.map(|((feature, mean), deviation)| Scaled { feature, mean, deviation }).collect();
        let Region { centres, precision, limit } = region;
        let scorer = scorer.into();
        Self { tools, features, learner, parameter, scorer, temperature, doubt, centres, precision, limit, knows }
    }

    /// The model, if all that was read fits together.
    pub fn model(self) -> Result<Model, Invalid> {
        let Self { features, learner, parameter, scorer, temperature, doubt, centres, precision, limit, knows, .. } =
            self;
        let chosen = (0..features.len()).collect();
        let (mean, deviation) = features.iter().map(|of| (of.mean, of.deviation)).unzip();
        let scale = Scale { chosen, mean, deviation };
        let features = features.into_iter().map(|of| of.feature).collect();
        let region = Region { centres, precision, limit };
        let model =
            Model { features, scale, learner, parameter, scorer: scorer.into(), temperature, doubt, region, knows };
        if model.is_sound() { Ok(model) } else { Err(Invalid::new("model", "its numbers do not fit together")) }
    }
}

/// SHA-256 of all that a model depends on, and the seed that it gives: the same sessions give the same model.
pub fn fingerprint(data: &Dataset) -> (String, u64) {
    let mut hash = Sha256::new();
    for feature in data.features() {
        hash.update(feature.as_bytes());
        hash.update([0]);
    }
    data.numbers().for_each(|number| hash.update(number.to_bits().to_le_bytes()));
    let hash = hash.finalize();
    let seed = hash.iter().take(8).fold(0, |seed: u64, byte| (seed << 8) | u64::from(*byte));
    (hash.iter().map(|byte| format!("{byte:02x}")).collect(), seed)
}

impl From<skill::Level> for Level {
    fn from(level: skill::Level) -> Self {
        Level::ALL[level as usize]
    }
}

impl From<Level> for skill::Level {
    fn from(level: Level) -> Self {
        skill::Level::ALL[level as usize]
    }
}

impl From<skill::Scorer> for Scorer {
    fn from(scorer: skill::Scorer) -> Self {
        match scorer {
            skill::Scorer::Linear { weights, offsets } => Scorer::Linear { weights, offsets },
            skill::Scorer::Neighbours { k, rows, levels, counts } => {
                Scorer::Neighbours { k, rows, levels: levels.into_iter().map(Level::from).collect(), counts }
            }
            skill::Scorer::Tree { nodes } => Scorer::Tree { nodes: nodes.into_iter().map(Node::from).collect() },
        }
    }
}

impl From<Scorer> for skill::Scorer {
    fn from(scorer: Scorer) -> Self {
        match scorer {
            Scorer::Linear { weights, offsets } => skill::Scorer::Linear { weights, offsets },
            Scorer::Neighbours { k, rows, levels, counts } => {
                skill::Scorer::Neighbours { k, rows, levels: levels.into_iter().map(Into::into).collect(), counts }
            }
            Scorer::Tree { nodes } => skill::Scorer::Tree { nodes: nodes.into_iter().map(TreeNode::from).collect() },
        }
    }
}

impl From<TreeNode> for Node {
    fn from(node: TreeNode) -> Self {
        match node {
            TreeNode::Fork { feature, limit, at_most, above } => Node::Fork { feature, limit, at_most, above },
            TreeNode::Leaf { scores } => Node::Leaf { scores },
        }
    }
}

impl From<Node> for TreeNode {
    fn from(node: Node) -> Self {
        match node {
            Node::Fork { feature, limit, at_most, above } => TreeNode::Fork { feature, limit, at_most, above },
            Node::Leaf { scores } => TreeNode::Leaf { scores },
        }
    }
}

#[cfg(test)]
mod tests;
