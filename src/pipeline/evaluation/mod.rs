//! How good is it (METHOD 8): a trajectory against the truth, and paths along one guide against each other.
//!
//! | what | file |
//! |---|---|
//! | what really happened; the true motion between its frames | [`truth`](Truth), [`motion`](Motion) |
//! | each row beside the truth that judges it | [`judged`](Judged) |
//! | found, missing, false, exchanged; all figures per tool | [`mod@accuracy`] |
//! | sizes of errors; their delay; are the stated sigmas true | [`errors`](Errors), [`lag`](Lag), [`honesty`](Honesty) |
//! | speed of a tool that rests | [`rest`](NoiseFloor) |
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
