//! How good is it (METHOD 8): a trajectory against the truth, and paths along one guide against each other.

mod truth;

pub use truth::{Truth, TruthFrame, TruthTool};
