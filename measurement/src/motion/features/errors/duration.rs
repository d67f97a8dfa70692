//! The error bar of a duration.
//!
//! A duration is the difference of two moments, so its error does not grow with it. **In:** the attempt, the measured
//! duration, and the durations of the replicates. **Method:** each end has an error of its own ([`END_SIGMA_S`]); the
//! replicates show how far the path's errors move the ends. A tool that moved as it was first or last seen makes the
//! bar longer, on one side, by the time that it was out of sight. Errors of a path make every movement seem to begin
//! earlier and to end later. The shift is below a frame and is not removed. **Gives up** ([`NoErrorBar::AtLeast`]) on
//! an attempt that the recording shows only in part.

use super::{ErrorBar, MIN_REPLICATES, NoErrorBar, STUDENT_T};
use crate::motion::features::attempt::TaskAttempt;
use crate::numbers::quantile::quantile;

/// Standard deviation of one end that was in sight, s: a frame or two. On synthetic paths at 15 to 60 frames a second,
/// every bar then holds the true duration (`features/tests/attempt.rs`).
const END_SIGMA_S: f64 = 0.05;
/// Quantiles that hold the middle two thirds of the replicates: one standard deviation on either side. A replicate in
/// which an error passes for a movement would spoil a mean square.
const MIDDLE: [f64; 2] = [1.0 / 6.0, 5.0 / 6.0];

/// The measured duration, s, unchanged, and its error bar.
///
/// # Errors
/// [`NoErrorBar::AtLeast`] if the recording cut the attempt off, [`NoErrorBar::Unsteady`] if too few replicates have a
/// value.
pub fn error_bar(
    attempt: TaskAttempt,
    measured_s: f64,
    replicates_s: impl Iterator<Item = f64>,
    step_s: f64,
) -> Result<(f64, ErrorBar), NoErrorBar> {
    let replicates: Vec<f64> = replicates_s.collect();
    if attempt.is_cut_off() {
        return Err(NoErrorBar::AtLeast);
    }
    if replicates.len() < MIN_REPLICATES {
        return Err(NoErrorBar::Unsteady);
    }
    let [low, high] = MIDDLE.map(|share| quantile(replicates.clone(), share).unwrap_or(measured_s));
    let in_sight_s = STUDENT_T * (std::f64::consts::SQRT_2 * END_SIGMA_S).hypot(0.5 * (high - low));
    let unseen_s = attempt.unseen_steps() as f64 * step_s;
    let (low, high) = ((measured_s - in_sight_s).max(0.0), measured_s + in_sight_s + unseen_s);
    let sigma = (high - low) / (2.0 * STUDENT_T);
    Ok((measured_s, ErrorBar { as_measured: measured_s, sigma, low, high }))
}
