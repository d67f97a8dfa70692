//! The true motion of one tool between the frames of its truth.

use nalgebra::{Point3, Vector3};

use super::truth::Truth;

/// Maximum time between two frames that is interpolated, s.
const MAX_STEP_S: f64 = 0.25;

/// The position of one tool at any time: cubic Hermite pieces between the truth's frames. (The truth has no noise that
/// this could amplify.)
#[derive(Clone, Debug, PartialEq)]
pub struct TrueMotion {
    /// Times of the frames, s, rising.
    times_s: Vec<f64>,
    tips_mm: Vec<Point3<f64>>,
    velocities_mm_s: Vec<Vector3<f64>>,
}

impl TrueMotion {
    /// The motion of the tool of this name; empty if the truth does not have it.
    pub fn of(truth: &Truth, name: &str) -> TrueMotion {
        let here = |frame: &super::TruthFrame| {
            let own = frame.tools.iter().find(|tool| tool.tool == name);
            own.map(|tool| (frame.time_s, tool.tip_mm))
        };
        let (times_s, tips_mm): (Vec<f64>, Vec<Point3<f64>>) = truth.frames.iter().filter_map(here).unzip();
        let velocities_mm_s = (0..times_s.len()).map(|i| velocity(&times_s, &tips_mm, i)).collect();
        TrueMotion { times_s, tips_mm, velocities_mm_s }
    }

    /// True if the truth does not have the tool.
    pub fn is_empty(&self) -> bool {
        self.times_s.is_empty()
    }

    /// Tips on the frames on which the tool exists, mm.
    pub fn tips_mm(&self) -> &[Point3<f64>] {
        &self.tips_mm
    }

    /// Times of the frames on which the tool exists, s, with its speed there, mm/s.
    pub fn speeds(&self) -> impl Iterator<Item = (f64, f64)> {
        self.times_s.iter().copied().zip(self.velocities_mm_s.iter().map(Vector3::norm))
    }

    /// Tip, mm, and velocity, mm/s, at a time; `None` outside the truth or in a gap of it.
    pub fn at(&self, time_s: f64) -> Option<(Point3<f64>, Vector3<f64>)> {
        let after = self.times_s.partition_point(|t| *t < time_s);
        if self.times_s.get(after) == Some(&time_s) {
            return Some((self.tips_mm[after], self.velocities_mm_s[after])); // gaps next to it do not matter
        }
        let before = after.checked_sub(1)?;
        let step_s = self.times_s.get(after)? - self.times_s[before];
        let s = (time_s - self.times_s[before]) / step_s;
        let (from, to) = (self.tips_mm[before], self.tips_mm[after]);
        let [start, end] = [before, after].map(|i| self.velocities_mm_s[i] * step_s);
        let chord = to - from;
        let (square, cube) = (3.0 * chord - 2.0 * start - end, start + end - 2.0 * chord);
        let tip = from + (start + (square + cube * s) * s) * s;
        let velocity = (start + (2.0 * square + 3.0 * cube * s) * s) / step_s;
        (step_s <= MAX_STEP_S).then_some((tip, velocity))
    }
}

/// Velocity from the two neighbouring frames, or one at an end; zero if the frame has no neighbour.
fn velocity(times_s: &[f64], tips_mm: &[Point3<f64>], at: usize) -> Vector3<f64> {
    let (before, after) = (at.saturating_sub(1), (at + 1).min(times_s.len() - 1));
    let span_s = times_s[after] - times_s[before];
    if span_s > 0.0 { (tips_mm[after] - tips_mm[before]) / span_s } else { Vector3::zeros() }
}

#[cfg(test)]
mod tests {
    use super::super::truth::{TruthFrame, TruthTool};
    use super::*;

    fn moving(tip: impl Fn(f64) -> Point3<f64>, times_s: &[f64]) -> TrueMotion {
        let tool = |time_s| TruthTool {
            tool: "orange".to_owned(),
            tip_mm: tip(time_s),
            axis: None,
            tip_px: None,
            visible: 1.0,
        };
        let frames = times_s.iter().enumerate();
        let frames = frames.map(|(i, t)| TruthFrame { frame: i as u64, time_s: *t, tools: vec![tool(*t)] }).collect();
        TrueMotion::of(&Truth { frames }, "orange")
    }

    #[test]
    fn a_curve_is_followed_between_frames_better_than_by_a_chord() {
        let tip = |t: f64| Point3::new(30.0 * (3.0 * t).sin(), 20.0 * t, 180.0 + 10.0 * (2.0 * t).cos());
        let times: Vec<f64> = (0..50).map(|i| f64::from(i) * 0.04).collect();
        let motion = moving(tip, &times);
        for i in 1..400 {
            let time_s = 0.04 + f64::from(i) * 0.0047;
            let (got, velocity) = motion.at(time_s).unwrap();
            assert!((got - tip(time_s)).norm() < 0.02, "{time_s}: {}", (got - tip(time_s)).norm()); // a chord: 0.05
            let slope = (tip(time_s + 1e-4) - tip(time_s - 1e-4)) / 2e-4;
            assert!((velocity - slope).norm() < 0.6, "{velocity} {slope}");
        }
    }

    #[test]
    fn outside_and_in_a_gap_nothing_is_known() {
        let motion = moving(|t| Point3::new(t, 0.0, 0.0), &[0.0, 0.04, 0.5, 0.54]);
        for unknown in [-0.01, 0.2, 0.55] {
            assert_eq!(motion.at(unknown), None, "{unknown}");
        }
        assert!(motion.at(0.5).is_some() && motion.at(0.52).is_some());
        assert_eq!(moving(|_| Point3::origin(), &[]).at(0.0), None);
    }
}
