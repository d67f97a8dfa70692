//! Jumps of a path: rows that no hand can have moved the tool to, such as a slip of another tracker.
//!
//! A feature takes each row for a place where the tool was. One row far away makes the path longer by twice its
//! distance and raises the mean speed, but not the 95 % quantile of the speed: the values contradict each other.
//!
//! **In:** one tool's rows in time order, measured and bridged. **Out:** the fastest step from one row to the next, and
//! the sharpest turn: a row that the tool went out to and came back from. **Method:** every distance is shortened by
//! [`STATED_SIGMAS`] standard deviations of the errors that its rows state, so that a noisy path does not jump. Time
//! stamps may jitter, so no interval counts as shorter than the median one. Nothing is compared across a cut, where the
//! rows change to another tool. [`super::limits`] has the limits of a hand.

use std::fmt;

use nalgebra::Vector3;

use crate::numbers::quantile::quantile;
use crate::vision::trajectory::{Sample, has_cut_between};

/// Allowed part of a distance, in standard deviations of the stated errors: one normal error in two million is larger.
const STATED_SIGMAS: f64 = 5.0;

/// Minimum allowance, mm, also where no errors are stated: trackers err by a millimetre or two.
const MIN_ALLOWANCE_MM: f64 = 3.0;

/// Maximum allowance, mm: [`STATED_SIGMAS`] times the error that refuses a session. Features take even such a row for
/// the tool's place.
const MAX_ALLOWANCE_MM: f64 = STATED_SIGMAS * super::limits::MAX_POSITION_ERROR_MM;

/// Bounds of the median interval, s. Jitter of time stamps is smaller than the upper one.
const USUAL_INTERVAL_S: [f64; 2] = [0.001, 0.1];

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

/// The two rows of a step, or the row of a turn twice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JumpRows {
    /// Frame of the first row.
    pub from_frame: u64,
    /// Its time, s.
    pub from_s: f64,
    /// Frame of the last row.
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
            write!(f, "; between frame {from_frame} ({from_s:.3} s) and frame {to_frame} ({to_s:.3} s)")
        }
    }
}

/// One tool's rows in time order.
pub(super) struct JumpSearch<'a> {
    path: &'a [&'a Sample],
    cuts_s: Vec<f64>,
    /// The median interval, s.
    usual_s: f64,
}

impl<'a> JumpSearch<'a> {
    pub(super) fn new(path: &'a [&'a Sample], cuts_s: Vec<f64>) -> Self {
        let intervals = path.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect();
        let [least, most] = USUAL_INTERVAL_S;
        Self { path, cuts_s, usual_s: quantile(intervals, 0.5).unwrap_or(least).clamp(least, most) }
    }

    /// The fastest step from one row to the next; `None` with a single row.
    pub(super) fn fastest_step(&self) -> Option<PathJump> {
        let speed = |(from, to): (&Sample, &Sample)| {
            let step = to.tip_mm - from.tip_mm;
            let beyond_mm = step.norm() - allowance_mm(&[from, to], step);
            beyond_mm.max(0.0) / MM_PER_M / self.interval_s(from, to)
        };
        let steps = self.uncut(2).map(|rows| (rows[0], rows[1]));
        steps.map(|rows| PathJump { figure: speed(rows), rows: JumpRows::of(rows.0, rows.1) }).reduce(larger)
    }

    /// The sharpest turn out to a row and back; `None` with fewer than three rows.
    pub(super) fn sharpest_turn(&self) -> Option<PathJump> {
        let turns = self.uncut(3).map(|rows| (rows[0], rows[1], rows[2]));
        let jump = |(before, row, after): (&Sample, &Sample, &Sample)| PathJump {
            figure: self.turn_m_s2(before, row, after),
            rows: JumpRows::of(row, row),
        };
        turns.map(jump).reduce(larger)
    }

    /// Mean acceleration of the way out to a row and back, m/s². Only the part counts that leads out as well as back:
    /// a tool that stops, or begins to move, does not turn.
    fn turn_m_s2(&self, before: &Sample, row: &Sample, after: &Sample) -> f64 {
        let [out, back] = [before, after].map(|other| row.tip_mm - other.tip_mm);
        let away = direction_of(out + back);
        let beyond_mm = out.dot(&away).min(back.dot(&away)) - allowance_mm(&[before, row, after], away);
        let [out_s, back_s] = [self.interval_s(before, row), self.interval_s(row, after)];
        let change_m_s = beyond_mm.max(0.0) / MM_PER_M * (1.0 / out_s + 1.0 / back_s);
        change_m_s / (0.5 * (out_s + back_s)).max(MIN_TURN_S)
    }

    /// Runs of `count` adjacent rows without a cut between them.
    fn uncut(&self, count: usize) -> impl Iterator<Item = &'a [&'a Sample]> {
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

/// The part of a distance along a vector that errors of these rows may have made, mm.
fn allowance_mm(rows: &[&Sample], along: Vector3<f64>) -> f64 {
    let direction = direction_of(along);
    let stated = rows.iter().filter_map(|row| row.covariance_mm2);
    let variance: f64 = stated.map(|of| of.sigma_along_mm(&direction).powi(2)).sum();
    (STATED_SIGMAS * variance.sqrt()).clamp(MIN_ALLOWANCE_MM, MAX_ALLOWANCE_MM)
}

/// The unit vector, or zero for a vector without a direction.
fn direction_of(vector: Vector3<f64>) -> Vector3<f64> {
    vector.try_normalize(0.0).unwrap_or_default()
}

#[cfg(test)]
mod tests;
