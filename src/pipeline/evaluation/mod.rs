//! How good is it (METHOD 8): a trajectory against the truth, and paths along one guide against each other.

mod accuracy;
mod repeatability;
mod truth;

pub use accuracy::{
    Accuracy, Errors, EvaluationProblem, Inside, Level, OUT_OF_SIGHT_BELOW, Spread, ToolAccuracy, VISIBLE_FROM,
    accuracy,
};
pub use repeatability::{Line, Repeatability, RepeatabilityProblem, repeatability, slides};
pub use truth::{Truth, TruthFrame, TruthTool};
