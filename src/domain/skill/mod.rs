//! A model of skill: as stored, as shown, and as a file.
//!
//! | file | holds |
//! |---|---|
//! | `mod.rs` | a model as stored; the fingerprint of its data |
//! | `readings.rs` | the features that a verdict may use, and a session's values of them |
//! | `file.rs` | a model as a file |
//! | `report.rs` | how well a model does on held-out people |
//! | `verdict.rs` | a model's verdict on a session, or why there is none |

mod file;
mod readings;
mod report;
mod verdict;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

pub use file::ModelFile;
pub use readings::{Reading, Readings, most_common_tool_count, verdict_features};
pub use report::{ModelReport, PerLevel, ShareOfPeople};
pub use verdict::{FeatureContribution, NoLevelReason, NoLevelReasonName, SkillVerdict};

use super::text::Invalid;
use super::trainee::Level;
use crate::statistics::skill::{self, LevelModel, Region, Scale, SkillDataset, TreeNode};

/// A model as stored. It holds no names. Only a nearest-neighbour model holds sessions: standardised values without the
/// person.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelDefinition {
    /// Number of tools used in the task.
    pub tools: usize,
    /// The features that the model uses.
    pub features: Vec<ScaledFeature>,
    /// Name of its learner.
    pub learner: String,
    /// The learner's parameter, for people.
    pub parameter: String,
    /// The trained scorer.
    pub scorer: ScorerDefinition,
    /// Scores are divided by this before they are turned into probabilities.
    pub temperature: f64,
    /// Share of the probability that is spread equally over all levels.
    pub doubt: f64,
    /// The levels' centres, standardised.
    pub centres: [Vec<f64>; skill::LEVELS],
    /// Inverse of the covariance around them, row by row.
    pub precision: Vec<f64>,
    /// Maximum distance of a session from the nearest centre, standard deviations.
    pub limit: f64,
    /// Whether it did better than models trained on shuffled levels. If not, it gives no verdict.
    pub knows: bool,
}

/// A feature with the mean and deviation that standardise it, in its unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaledFeature {
    /// Stable name.
    pub feature: String,
    /// The training sessions' mean.
    pub mean: f64,
    /// Their standard deviation.
    pub deviation: f64,
}

/// A trained scorer; see [`skill::LevelScorer`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum ScorerDefinition {
    /// Weights of the features, for each level.
    Linear {
        /// Each level's weights.
        weights: [Vec<f64>; skill::LEVELS],
        /// Each level's score for the mean of all sessions.
        offsets: [f64; skill::LEVELS],
    },
    /// The nearest training sessions.
    Neighbours {
        /// Number of neighbours that vote.
        k: usize,
        /// The sessions, standardised.
        rows: Vec<Vec<f64>>,
        /// Each one's level.
        levels: Vec<Level>,
        /// Weight of one session of each level.
        counts: [f64; skill::LEVELS],
    },
    /// A decision tree.
    Tree {
        /// Forks and leaves; the first node is the root.
        nodes: Vec<TreeNodeDefinition>,
    },
}

/// A node of a tree; see [`TreeNode`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, deny_unknown_fields)]
pub enum TreeNodeDefinition {
    /// Compares a feature with a limit.
    Fork {
        /// Index of the feature.
        feature: usize,
        /// The limit, standardised.
        limit: f64,
        /// The next node if the value is at most the limit.
        at_most: usize,
        /// The next node if the value is above the limit.
        above: usize,
    },
    /// The end of a path through the tree.
    Leaf {
        /// The levels' scores.
        scores: [f64; skill::LEVELS],
    },
}

impl ModelDefinition {
    /// A trained model in its stored form, for sessions with `tools` tools.
    pub fn of(model: LevelModel, tools: usize) -> Self {
        let LevelModel { features, scale, learner, parameter, scorer, temperature, doubt, region, has_skill: knows } =
            model;
        let scaled = features.into_iter().zip(scale.mean).zip(scale.deviation);
        let features = scaled.map(|((feature, mean), deviation)| ScaledFeature { feature, mean, deviation }).collect();
        let Region { centres, precision, limit } = region;
        let scorer = scorer.into();
        Self { tools, features, learner, parameter, scorer, temperature, doubt, centres, precision, limit, knows }
    }

    /// The model, if its numbers are consistent.
    pub fn model(self) -> Result<LevelModel, Invalid> {
        let Self { features, learner, parameter, scorer, temperature, doubt, centres, precision, limit, knows, .. } =
            self;
        let chosen = (0..features.len()).collect();
        let (mean, deviation) = features.iter().map(|of| (of.mean, of.deviation)).unzip();
        let scale = Scale { chosen, mean, deviation };
        let features = features.into_iter().map(|of| of.feature).collect();
        let region = Region { centres, precision, limit };
        let model = LevelModel {
            features,
            scale,
            learner,
            parameter,
            scorer: scorer.into(),
            temperature,
            doubt,
            region,
            has_skill: knows,
        };
        if model.is_sound() { Ok(model) } else { Err(Invalid::new("model", "its numbers are inconsistent")) }
    }
}

/// SHA-256 of all data that a model depends on, and a seed derived from it, so that the same sessions give the same
/// model.
pub fn fingerprint(data: &SkillDataset) -> (String, u64) {
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

impl From<skill::SkillLevel> for Level {
    fn from(level: skill::SkillLevel) -> Self {
        Level::ALL[level as usize]
    }
}

impl From<Level> for skill::SkillLevel {
    fn from(level: Level) -> Self {
        skill::SkillLevel::ALL[level as usize]
    }
}

impl From<skill::LevelScorer> for ScorerDefinition {
    fn from(scorer: skill::LevelScorer) -> Self {
        match scorer {
            skill::LevelScorer::Linear { weights, offsets } => ScorerDefinition::Linear { weights, offsets },
            skill::LevelScorer::Neighbours { k, rows, levels, counts } => {
                ScorerDefinition::Neighbours { k, rows, levels: levels.into_iter().map(Level::from).collect(), counts }
            }
            skill::LevelScorer::Tree { nodes } => {
                ScorerDefinition::Tree { nodes: nodes.into_iter().map(TreeNodeDefinition::from).collect() }
            }
        }
    }
}

impl From<ScorerDefinition> for skill::LevelScorer {
    fn from(scorer: ScorerDefinition) -> Self {
        match scorer {
            ScorerDefinition::Linear { weights, offsets } => skill::LevelScorer::Linear { weights, offsets },
            ScorerDefinition::Neighbours { k, rows, levels, counts } => {
                skill::LevelScorer::Neighbours { k, rows, levels: levels.into_iter().map(Into::into).collect(), counts }
            }
            ScorerDefinition::Tree { nodes } => {
                skill::LevelScorer::Tree { nodes: nodes.into_iter().map(TreeNode::from).collect() }
            }
        }
    }
}

impl From<TreeNode> for TreeNodeDefinition {
    fn from(node: TreeNode) -> Self {
        match node {
            TreeNode::Fork { feature, limit, at_most, above } => {
                TreeNodeDefinition::Fork { feature, limit, at_most, above }
            }
            TreeNode::Leaf { scores } => TreeNodeDefinition::Leaf { scores },
        }
    }
}

impl From<TreeNodeDefinition> for TreeNode {
    fn from(node: TreeNodeDefinition) -> Self {
        match node {
            TreeNodeDefinition::Fork { feature, limit, at_most, above } => {
                TreeNode::Fork { feature, limit, at_most, above }
            }
            TreeNodeDefinition::Leaf { scores } => TreeNode::Leaf { scores },
        }
    }
}

#[cfg(test)]
mod tests;
