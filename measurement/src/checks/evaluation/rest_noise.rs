//! Speed of the track while the tool rests: noise that every motion feature would count as movement.

use std::collections::HashMap;

use super::errors::ErrorSpread;
use super::judged::JudgedRow;
use super::motion::TrueMotion;

/// Below this true speed a tool rests, mm/s.
const AT_REST_MM_S: f64 = 0.5;

/// Minimum duration of a rest that is judged, s, after [`SETTLING_S`].
const MIN_REST_S: f64 = 1.0;

/// Time that a filter may take to follow a tool that has stopped, s: movement within it is lag, not noise.
const SETTLING_S: f64 = 0.5;

/// Minimum of rows for a figure.
const MIN_ROWS: usize = 20;

/// Speed of the track while the tool rests, mm/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestNoise {
    /// Rows at rest.
    pub rows: usize,
    /// Root of the mean square.
    pub rms_mm_s: f64,
    /// Median.
    pub median_mm_s: f64,
}

impl RestNoise {
    /// Measures these rows, in order of time; `None` if the tools never rest for long enough.
    pub(super) fn of(rows: &[&JudgedRow], motions: &HashMap<&str, TrueMotion>) -> Option<RestNoise> {
        let mut speeds = Vec::new();
        for (name, motion) in motions {
            let rests = rests(motion);
            let own: Vec<&JudgedRow> = rows.iter().filter(|row| row.tool == *name).copied().collect();
            let resting = |row: &JudgedRow| rests.iter().any(|(from, to)| (*from..=*to).contains(&row.time_s));
            let at = |i: usize| speed_mm_s(own[i], i.checked_sub(1).map(|before| own[before]));
            speeds.extend((0..own.len()).filter(|i| resting(own[*i])).filter_map(at));
        }
        let rows = speeds.len();
        let spread = ErrorSpread::of(speeds).filter(|_| rows >= MIN_ROWS)?;
        Some(RestNoise { rows, rms_mm_s: spread.rms, median_mm_s: spread.median })
    }
}

/// Start and end, s, of the rests that are long enough; the settling time at the start is left out.
fn rests(motion: &TrueMotion) -> Vec<(f64, f64)> {
    let mut rests: Vec<(f64, f64)> = Vec::new();
    let mut resting = false;
    for (time_s, speed_mm_s) in motion.speeds() {
        match (speed_mm_s < AT_REST_MM_S, rests.last_mut()) {
            (true, Some(rest)) if resting => rest.1 = time_s,
            (true, _) => rests.push((time_s + SETTLING_S, time_s)),
            (false, _) => {}
        }
        resting = speed_mm_s < AT_REST_MM_S;
    }
    rests.retain(|(from, to)| to - from >= MIN_REST_S);
    rests
}

/// The speed that the row states; without a stated speed (a raw track), from the distance to the row before.
fn speed_mm_s(row: &JudgedRow, before: Option<&JudgedRow>) -> Option<f64> {
    let moved = before.map(|b| (row.sample.tip_mm - b.sample.tip_mm).norm() / (row.time_s - b.time_s));
    row.sample.velocity_mm_s.map(|velocity| velocity.norm()).or(moved)
}
