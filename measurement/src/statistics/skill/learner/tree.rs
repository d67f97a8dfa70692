//! A small decision tree (Breiman et al. 1984); with few people it may only ask few questions.

use super::super::{LEVELS, PerLevel};
use super::{Learner, LevelScorer, TrainingTable, smoothed_log_shares};

/// A tree with at most `depth` questions in sequence.
pub struct Tree {
    pub depth: usize,
}

/// Minimum weight of the sessions in a leaf; each person has weight 1.
const MIN_LEAF_WEIGHT: f64 = 3.0;

/// A node of the tree: a question or an answer.
#[derive(Clone, Debug, PartialEq)]
pub enum TreeNode {
    /// Compares a standardised feature with a limit.
    Fork {
        /// Index among the chosen features.
        feature: usize,
        /// The limit.
        limit: f64,
        /// The next node if the feature is at most the limit; later than this one.
        at_most: usize,
        /// The next node if the feature is above the limit; later than this one.
        above: usize,
    },
    /// The levels' scores.
    Leaf {
        /// The score of each level.
        scores: PerLevel,
    },
}

impl Learner for Tree {
    fn name(&self) -> &'static str {
        "tree"
    }

    fn parameter(&self) -> String {
        format!("depth {}", self.depth)
    }

    fn fit(&self, table: &TrainingTable) -> Option<LevelScorer> {
        let weights = table.weight_of_levels();
        let mean = weights.iter().sum::<f64>() / LEVELS as f64;
        let growth = TreeBuilder { table, counts: weights.map(|weight| mean / weight) };
        if growth.counts.iter().any(|count| !count.is_finite()) {
            return None;
        }
        let mut nodes = Vec::new();
        growth.grow(&mut nodes, (0..table.rows.len()).collect(), self.depth);
        Some(LevelScorer::Tree { nodes })
    }
}

/// The scores of the leaf that a session reaches.
pub fn scores(nodes: &[TreeNode], x: &[f64]) -> PerLevel {
    let mut at = 0;
    loop {
        match nodes.get(at) {
            Some(TreeNode::Fork { feature, limit, at_most, above }) => {
                let next = if x.get(*feature).is_some_and(|x| x <= limit) { *at_most } else { *above };
                if next <= at {
                    return [0.0; LEVELS]; // forks lead only to later nodes: a file with another fork is invalid
                }
                at = next;
            }
            Some(TreeNode::Leaf { scores }) => return *scores,
            None => return [0.0; LEVELS],
        }
    }
}

struct TreeBuilder<'t> {
    table: &'t TrainingTable,
    counts: PerLevel,
}

impl TreeBuilder<'_> {
    fn grow(&self, nodes: &mut Vec<TreeNode>, rows: Vec<usize>, depth: usize) -> usize {
        let at = nodes.len();
        let fork = if depth > 0 { self.best_fork(&rows) } else { None };
        let Some((feature, limit)) = fork else {
            nodes.push(TreeNode::Leaf { scores: smoothed_log_shares(self.shares(&rows)) });
            return at;
        };
        nodes.push(TreeNode::Leaf { scores: [0.0; LEVELS] });
        let (low, high) = rows.into_iter().partition(|row| self.table.rows[*row][feature] <= limit);
        let at_most = self.grow(nodes, low, depth - 1);
        let above = self.grow(nodes, high, depth - 1);
        nodes[at] = TreeNode::Fork { feature, limit, at_most, above };
        at
    }

    fn weight(&self, row: usize) -> f64 {
        self.table.weights[row] * self.counts[self.table.levels[row] as usize]
    }

    fn shares(&self, rows: &[usize]) -> PerLevel {
        let mut shares = [0.0; LEVELS];
        rows.iter().for_each(|row| shares[self.table.levels[*row] as usize] += self.weight(*row));
        shares
    }

    /// The question that leaves the levels least mixed (Gini).
    fn best_fork(&self, rows: &[usize]) -> Option<(usize, f64)> {
        let all = self.shares(rows);
        let mut best = (impurity(all) - 1e-9, None);
        for feature in 0..self.table.rows.first()?.len() {
            let value = |row: usize| self.table.rows[row][feature];
            let mut order = rows.to_vec();
            order.sort_by(|a, b| value(*a).total_cmp(&value(*b)));
            let mut below = [0.0; LEVELS];
            for pair in order.windows(2) {
                below[self.table.levels[pair[0]] as usize] += self.weight(pair[0]);
                let above: PerLevel = std::array::from_fn(|level| all[level] - below[level]);
                let enough = [below, above].iter().all(|side| side.iter().sum::<f64>() >= MIN_LEAF_WEIGHT);
                let left = impurity(below) + impurity(above);
                if enough && value(pair[0]) < value(pair[1]) && left < best.0 {
                    best = (left, Some((feature, (value(pair[0]) + value(pair[1])) / 2.0)));
                }
            }
        }
        best.1
    }
}

/// Gini's impurity, multiplied by the weight of the sessions.
fn impurity(shares: PerLevel) -> f64 {
    let all: f64 = shares.iter().sum();
    if all > 0.0 { all - shares.iter().map(|share| share * share).sum::<f64>() / all } else { 0.0 }
}
