//! Jumps of a path: rows that no hand can have moved the tool to, such as a slip of another tracker.
//!
//! A feature takes each row for a place where the tool was. One row far away makes the path longer by twice its
//! distance and raises the mean speed, but not the 95 % quantile of the speed: the values contradict each other.
//!
//! **In:** one tool's rows in time order, measured and bridged. **Out:** the fastest step from one row to the next, and
//! the sharpest turn: up to [`MAX_ROWS_ASIDE`] rows that the tool went out to and came back from. **Method:** every
//! distance is shortened by [`ALLOWED_SIGMAS`] standard deviations of the errors that its rows state, or of the noise
//! that the path shows if that is larger, so that a noisy path does not jump. Time stamps may jitter or come in bursts,
//! so no interval counts as shorter than the usual one. Rows that only repeat a position are left out if the table has
//! more rows than its camera had frames. Nothing is compared across a cut, where the rows change to another tool.
//! [`super::limits`] has the limits of a hand.

use std::fmt;

use nalgebra::Vector3;

use crate::numbers::quantile::quantile;
use crate::vision::trajectory::{Sample, has_cut_between};

/// Allowed part of a distance, in standard deviations: one normal error in 65,000 is longer in three dimensions.
const ALLOWED_SIGMAS: f64 = 5.0;

/// Minimum allowance, mm, also where a path shows no noise: errors that last for some rows, of a millimetre or two, do
/// not show as noise.
const MIN_ALLOWANCE_MM: f64 = 3.0;

/// Maximum allowance, mm: [`ALLOWED_SIGMAS`] times the error that refuses a session. Features take even such a row for
/// the tool's place.
const MAX_ALLOWANCE_MM: f64 = ALLOWED_SIGMAS * super::limits::MAX_POSITION_ERROR_MM;

/// Median length of the second difference of three positions with normal errors, in standard deviations of one
/// coordinate: √6 times the median length of a normal vector in three dimensions, 1.538.
const MEDIAN_TURN_PER_SIGMA: f64 = 3.767;

/// Bounds of the usual interval, s. Jitter of time stamps is smaller than the upper one.
const USUAL_INTERVAL_S: [f64; 2] = [0.001, 0.1];

/// Between one and two: a camera's frame that fills this many rows is repeated, and after this many frames an equal
/// position is a tool at rest.
const REPEATED: f64 = 1.5;

/// Maximum number of adjacent rows that are judged as aside of the path together.
const MAX_ROWS_ASIDE: usize = 4;

/// Minimum time of a turn, s. An impact turns a tool within a millisecond. One that throws a tool of 1.5 m/s back as
/// fast changes its velocity by 3 m/s, which over this time is as much as a hand's own limit, 100 m/s².
const MIN_TURN_S: f64 = 0.03;

const MM_PER_M: f64 = 1e3;

/// A step or a turn of a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathJump {
    /// Speed of a step, m/s, or acceleration of a turn, m/s².
    pub figure: f64,
    /// Where it is.
    pub rows: JumpRows,
}

/// The two rows of a step, or the first and the last row that a turn went out to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JumpRows {
    /// Frame of the first row.
    pub from_frame: u64,
    /// Its time, s.
    pub from_s: f64,
    /// Frame of the last row; the same as the first if the turn has a single row.
    pub to_frame: u64,
    /// Its time, s.
    pub to_s: f64,
}

impl JumpRows {
    fn of(from: &Sample, to: &Sample) -> Self {
        Self { from_frame: from.frame, from_s: from.time_s, to_frame: to.frame, to_s: to.time_s }
    }
}

/// As an addition to the finding.
impl fmt::Display for JumpRows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { from_frame, from_s, to_frame, to_s } = self;
        if from_frame == to_frame {
            write!(f, "; at frame {from_frame} ({from_s:.3} s)")
        } else {
            write!(f, "; from frame {from_frame} ({from_s:.3} s) to frame {to_frame} ({to_s:.3} s)")
        }
    }
}

/// One tool's rows in time order, without repeated positions.
pub(super) struct JumpSearch<'a> {
    path: Vec<&'a Sample>,
    cuts_s: Vec<f64>,
    /// The median interval or, if stamps come in bursts, the mean one, s.
    usual_s: f64,
    /// Standard deviation of a coordinate's noise, mm. A moving hand adds to it: 0.3 mm at 30 frames a second.
    noise_mm: f64,
}

impl<'a> JumpSearch<'a> {
    pub(super) fn new(path: &[&'a Sample], cuts_s: Vec<f64>) -> Self {
        let path = without_repeats(path, &cuts_s);
        let usual_s = usual_interval_s(&path);
        let noise_mm = noise_mm(&path);
        Self { path, cuts_s, usual_s, noise_mm }
    }

    /// The fastest step from one row to the next; `None` with a single row.
    pub(super) fn fastest_step(&self) -> Option<PathJump> {
        let speed = |(from, to): (&Sample, &Sample)| {
            let step = to.tip_mm - from.tip_mm;
            let beyond_mm = step.norm() - self.allowance_mm(&[from, to], step);
            beyond_mm.max(0.0) / MM_PER_M / self.interval_s(from, to)
        };
        let steps = self.uncut(2).map(|rows| (rows[0], rows[1]));
        steps.map(|rows| PathJump { figure: speed(rows), rows: JumpRows::of(rows.0, rows.1) }).reduce(larger)
    }

    /// The sharpest turn out to one or a few rows and back; `None` with fewer than three rows.
    pub(super) fn sharpest_turn(&self) -> Option<PathJump> {
        let turns = (1..=MAX_ROWS_ASIDE).flat_map(|aside| self.uncut(aside + 2));
        turns.map(|rows| self.turn(rows)).reduce(larger)
    }

    /// Mean acceleration of the way from the first of these rows out to the inner ones and back to the last, m/s². Only
    /// the part counts that leads out as well as back: a tool that stops, or begins to move, does not turn.
    fn turn(&self, rows: &[&Sample]) -> PathJump {
        let (before, inner, after) = (rows[0], &rows[1..rows.len() - 1], rows[rows.len() - 1]);
        let (first, last) = (inner[0], inner[inner.len() - 1]);
        let away = direction_of((first.tip_mm - before.tip_mm) + (last.tip_mm - after.tip_mm));
        let reach_mm = |row: &&Sample| [before, after].map(|end| (row.tip_mm - end.tip_mm).dot(&away));
        let least_mm = inner.iter().flat_map(reach_mm).fold(f64::INFINITY, f64::min);
        let beyond_mm = (least_mm - self.allowance_mm(rows, away)).max(0.0);
        let [out_s, back_s] = [self.interval_s(before, first), self.interval_s(last, after)];
        let change_m_s = beyond_mm / MM_PER_M * (1.0 / out_s + 1.0 / back_s);
        let turn_s = 0.5 * (out_s + back_s) + (last.time_s - first.time_s);
        PathJump { figure: change_m_s / turn_s.max(MIN_TURN_S), rows: JumpRows::of(first, last) }
    }

    /// The part of a distance along a vector that errors of these rows may have made, mm.
    fn allowance_mm(&self, rows: &[&Sample], along: Vector3<f64>) -> f64 {
        let direction = direction_of(along);
        let stated = rows.iter().filter_map(|row| row.covariance_mm2);
        let stated_mm2: f64 = stated.map(|of| of.sigma_along_mm(&direction).powi(2)).sum();
        let shown_mm2 = rows.len() as f64 * self.noise_mm.powi(2);
        (ALLOWED_SIGMAS * stated_mm2.max(shown_mm2).sqrt()).clamp(MIN_ALLOWANCE_MM, MAX_ALLOWANCE_MM)
    }

    /// Runs of `count` adjacent rows without a cut between them.
    fn uncut(&self, count: usize) -> impl Iterator<Item = &[&'a Sample]> {
        let is_whole =
            move |rows: &&[&Sample]| !has_cut_between(&self.cuts_s, [rows[0].time_s, rows[rows.len() - 1].time_s]);
        self.path.windows(count).filter(is_whole)
    }

    fn interval_s(&self, from: &Sample, to: &Sample) -> f64 {
        (to.time_s - from.time_s).max(self.usual_s)
    }
}

fn larger(one: PathJump, other: PathJump) -> PathJump {
    if other.figure > one.figure { other } else { one }
}

/// The rows, without those that repeat a position because the table has more rows than its camera had frames: then a
/// step of the camera would count as a step of a row. A tool at rest keeps a row every [`REPEATED`] frames.
fn without_repeats<'a>(path: &[&'a Sample], cuts_s: &[f64]) -> Vec<&'a Sample> {
    let changes = path.windows(2).filter(|pair| pair[0].tip_mm != pair[1].tip_mm).map(|pair| pair[1]);
    let changed: Vec<&Sample> = path.first().copied().into_iter().chain(changes).collect();
    let frame_s = quantile(intervals_s(&changed), 0.1).unwrap_or(0.0);
    if frame_s < REPEATED * quantile(intervals_s(path), 0.5).unwrap_or(0.0) {
        return path.to_vec();
    }
    let mut kept: Vec<&Sample> = Vec::with_capacity(changed.len());
    for row in path {
        let is_repeat = kept.last().is_some_and(|last| {
            last.tip_mm == row.tip_mm
                && row.time_s - last.time_s < REPEATED * frame_s
                && !has_cut_between(cuts_s, [last.time_s, row.time_s])
        });
        if !is_repeat {
            kept.push(row);
        }
    }
    kept
}

/// The median interval or, if stamps come in bursts, the mean of those that are no gap, s.
fn usual_interval_s(path: &[&Sample]) -> f64 {
    let [least, most] = USUAL_INTERVAL_S;
    let intervals = intervals_s(path);
    let without_gaps: Vec<f64> = intervals.iter().copied().filter(|interval| *interval <= most).collect();
    let mean = without_gaps.iter().sum::<f64>() / without_gaps.len().max(1) as f64;
    quantile(intervals, 0.5).unwrap_or(least).max(mean).clamp(least, most)
}

fn intervals_s(rows: &[&Sample]) -> Vec<f64> {
    rows.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect()
}

/// Standard deviation of a coordinate's noise, mm, from the second differences of the positions. One wrong row is in
/// three of them, so their median ignores it.
fn noise_mm(path: &[&Sample]) -> f64 {
    let second_difference = |rows: &[&Sample]| {
        let [before, row, after] = [0, 1, 2].map(|place| rows[place].tip_mm);
        ((row - before) + (row - after)).norm()
    };
    quantile(path.windows(3).map(second_difference).collect(), 0.5).unwrap_or(0.0) / MEDIAN_TURN_PER_SIGMA
}

/// The unit vector, or zero for a vector without a direction.
fn direction_of(vector: Vector3<f64>) -> Vector3<f64> {
    vector.try_normalize(0.0).unwrap_or_default()
}

#[cfg(test)]
mod tests;
