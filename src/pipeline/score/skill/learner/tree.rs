//! A small decision tree (Breiman et al. 1984): few people bear few questions.

use super::super::{LEVELS, PerLevel};
use super::{Learner, Scorer, Table, smoothed};

/// So many questions one after the other.
pub struct Tree {
    pub depth: usize,
}

/// Fewest sessions behind an answer, people counted once.
const FEWEST_IN_A_LEAF: f64 = 3.0;

/// A question, or an answer.
#[derive(Clone, Debug, PartialEq)]
pub enum TreeNode {
    /// Is the standardised feature at most this?
    Fork {
        /// Which of the chosen features.
        feature: usize,
        /// The limit.
        limit: f64,
        /// The node to go on with if so; later than this one.
        at_most: usize,
        /// The node to go on with if not; later than this one.
        above: usize,
    },
    /// The levels' scores.
    Leaf {
        /// Of each level.
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

    fn fit(&self, table: &Table) -> Option<Scorer> {
        let weights = table.weight_of_levels();
        let mean = weights.iter().sum::<f64>() / LEVELS as f64;
        let growth = Growth { table, counts: weights.map(|weight| mean / weight) };
        if growth.counts.iter().any(|count| !count.is_finite()) {
            return None;
        }
        let mut nodes = Vec::new();
        growth.grow(&mut nodes, (0..table.rows.len()).collect(), self.depth);
        Some(Scorer::Tree { nodes })
    }
}

/// The answer that a session is led to.
pub fn scores(nodes: &[TreeNode], x: &[f64]) -> PerLevel {
    let mut at = 0;
    loop {
        match nodes.get(at) {
            Some(TreeNode::Fork { feature, limit, at_most, above }) => {
                let next = if x.get(*feature).is_some_and(|x| x <= limit) { *at_most } else { *above };
                if next <= at {
                    return [0.0; LEVELS]; // forks lead to later nodes only: a file that says otherwise says nothing
                }
                at = next;
            }
            Some(TreeNode::Leaf { scores }) => return *scores,
            None => return [0.0; LEVELS],
        }
    }
}

struct Growth<'t> {
    table: &'t Table,
    counts: PerLevel,
}

impl Growth<'_> {
    fn grow(&self, nodes: &mut Vec<TreeNode>, rows: Vec<usize>, depth: usize) -> usize {
        let at = nodes.len();
        let fork = if depth > 0 { self.best_fork(&rows) } else { None };
        let Some((feature, limit)) = fork else {
            nodes.push(TreeNode::Leaf { scores: smoothed(self.shares(&rows)) });
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

    /// The question after which the levels are least mixed (Gini).
    fn best_fork(&self, rows: &[usize]) -> Option<(usize, f64)> {
        let all = self.shares(rows);
        let mut best = (mixed(all) - 1e-9, None);
        for feature in 0..self.table.rows.first()?.len() {
            let value = |row: usize| self.table.rows[row][feature];
            let mut order = rows.to_vec();
            order.sort_by(|a, b| value(*a).total_cmp(&value(*b)));
            let mut below = [0.0; LEVELS];
            for pair in order.windows(2) {
                below[self.table.levels[pair[0]] as usize] += self.weight(pair[0]);
                let above: PerLevel = std::array::from_fn(|level| all[level] - below[level]);
                let enough = [below, above].iter().all(|side| side.iter().sum::<f64>() >= FEWEST_IN_A_LEAF);
                let left = mixed(below) + mixed(above);
                if enough && value(pair[0]) < value(pair[1]) && left < best.0 {
                    best = (left, Some((feature, (value(pair[0]) + value(pair[1])) / 2.0)));
                }
            }
        }
        best.1
    }
}

/// Gini's impurity, times what the sessions count.
fn mixed(shares: PerLevel) -> f64 {
    let all: f64 = shares.iter().sum();
    if all > 0.0 { all - shares.iter().map(|share| share * share).sum::<f64>() / all } else { 0.0 }
}
