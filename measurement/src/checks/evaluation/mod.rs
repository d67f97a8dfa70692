//! Accuracy of the method (METHOD 8): a trajectory against the truth, and paths along one guide against each other.
//!
//! | what | file |
//! |---|---|
//! | the true positions; the true motion between frames | [`truth`](Truth), [`motion`](TrueMotion) |
//! | each row with the truth of its frame | [`judged`](JudgedRow) |
//! | found, missing, false, exchanged; all figures per tool | [`mod@accuracy`] |
//! | sizes of errors; the track's lag | [`errors`](ErrorSummary), [`lag`](Lag) |
//! | whether the stated sigmas are right | [`sigma_check`](SigmaCheck) |
//! | speed of the track while the tool rests | [`rest_noise`](RestNoise) |
//! | slides along one guide | [`mod@repeatability`] |

mod accuracy;
mod errors;
mod judged;
mod lag;
mod motion;
mod repeatability;
mod rest_noise;
mod sigma_check;
mod truth;

pub use accuracy::{Accuracy, ToolAccuracy, VISIBILITY_LEVELS, VisibilityLevel, accuracy};
pub use errors::{ErrorSpread, ErrorSummary};
pub use judged::{EvaluationProblem, JudgedRow, MIN_VISIBLE_SHARE, pair_with_truth, tool_names};
pub use lag::Lag;
pub use motion::TrueMotion;
pub use repeatability::{Line3, Repeatability, RepeatabilityProblem, repeatability, slides};
pub use rest_noise::RestNoise;
pub use sigma_check::{CHI_SQUARE_95, SigmaCheck, SigmaCoverage, chi_square_3_density, normalised_square};
pub use truth::{Truth, TruthFrame, TruthTool};

#[cfg(test)]
mod tests;
