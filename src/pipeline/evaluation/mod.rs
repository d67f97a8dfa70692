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
mod honesty;
mod judged;
mod lag;
mod motion;
mod repeatability;
mod rest;
mod truth;

pub use accuracy::{Accuracy, Level, ToolAccuracy, VISIBLE_FROM, accuracy};
pub use errors::{Errors, Spread};
pub use honesty::{Honesty, Share, WITHIN_95, chi_square_3_density, normalised_square};
pub use judged::{EvaluationProblem, Judged, OUT_OF_SIGHT_BELOW, judge, names};
pub use lag::Lag;
pub use motion::Motion;
pub use repeatability::{Line, Repeatability, RepeatabilityProblem, repeatability, slides};
pub use rest::NoiseFloor;
pub use truth::{Truth, TruthFrame, TruthTool};

#[cfg(test)]
mod tests;
