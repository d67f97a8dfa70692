//! The point of the picture through which all strips of one tool pass: the picture of its trocar.
//!
//! A tool turns about its trocar, so the planes through the camera and its axis share the line of sight to the trocar.
//! The point may lie far outside the picture or behind the camera, so it is a direction (homogeneous), not a place.

use nalgebra::{Matrix3, Vector3};

use super::Strip;

/// Largest sine of the angle between a tool's plane and the trocar: play of the tool in it, and a degree of direction at
/// its distance.
pub const MAX_MISS: f64 = 0.03;
/// The planes of two strips cross in a line only if they differ by this much (sine).
const MIN_CROSSING: f64 = 0.02;
/// Least number of frames with a strip through it.
const MIN_FRAMES: usize = 6;
/// Largest angle at the camera between the end of a strip and its trocar, degrees. The end is below the camera, and the
/// trocar is at most about as high. A strip of the other tool, from its tips to its hand, needs more if that tool's
/// trocar is less than 45° from the end of the strip.
const MAX_ANGLE_DEG: f64 = 135.0;

/// The point of a tool's strips.
#[derive(Clone, Debug)]
pub struct MeetingPoint {
    /// A unit vector.
    pub at: Vector3<f64>,
    /// Sum of the scores of the strips that pass through it, one of each frame.
    pub score: f64,
    /// Of each frame, the number of that strip.
    pub strips: Vec<Option<usize>>,
}

/// The point that the strips of most score pass through; `None` if they do not show one. `frames` are the strips of
/// each frame, and `is_possible` says whether a trocar can be there.
pub fn find(frames: &[Vec<Strip>], is_possible: impl Fn(Vector3<f64>) -> bool) -> Option<MeetingPoint> {
    let lines = lines_of(frames);
    let mut best = (0.0, None);
    for (i, line) in lines.iter().enumerate() {
        for other in &lines[..i] {
            let crossing = line.plane.cross(&other.plane);
            if line.frame == other.frame || crossing.norm() < MIN_CROSSING {
                continue;
            }
            let trocar = crossing.normalize();
            let score = through(&lines, frames.len(), trocar).into_iter().flatten().map(|line| line.score).sum();
            if score > best.0 && is_possible(trocar) {
                best = (score, Some(trocar));
            }
        }
    }
    let at = best.1.map(|trocar| refined(&lines, frames.len(), trocar))?;
    let passing = through(&lines, frames.len(), at);
    let found = MeetingPoint {
        at,
        score: passing.iter().flatten().map(|line| line.score).sum(),
        strips: passing.iter().map(|line| line.map(|line| line.strip)).collect(),
    };
    (passing.into_iter().flatten().count() >= MIN_FRAMES && is_possible(at)).then_some(found)
}

/// What the strips of a tool show of its trocar.
#[derive(Clone, Debug)]
pub struct TrocarOfTool {
    /// The point of its strips, a unit vector.
    pub at: Vector3<f64>,
    /// How far the tool turned about it ([`turn`]).
    pub turn: f64,
    /// The strip of each frame that passes through it.
    pub strips: Vec<Option<Strip>>,
}

/// The points of several tools. `tools` are the strips of each frame of each tool. A strip is only one tool, so the tool
/// with the most score takes its strips first.
pub fn of_tools(tools: Vec<Vec<Vec<Strip>>>, is_possible: impl Fn(Vector3<f64>) -> bool) -> Vec<Option<TrocarOfTool>> {
    let mut points: Vec<Option<TrocarOfTool>> = tools.iter().map(|_| None).collect();
    let mut open: Vec<(usize, Vec<Vec<Strip>>)> = tools.into_iter().enumerate().collect();
    loop {
        let found = open.iter().map(|(_, frames)| find(frames, &is_possible)).enumerate();
        let surest = found
            .filter_map(|(place, point)| Some((place, point?)))
            .max_by(|(_, one), (_, other)| one.score.total_cmp(&other.score));
        let Some((place, point)) = surest else { return points };
        let (tool, frames) = open.swap_remove(place);
        let own: Vec<Option<Strip>> =
            point.strips.iter().zip(&frames).map(|(strip, strips)| strip.map(|strip| strips[strip].clone())).collect();
        for (number, others) in open.iter_mut().flat_map(|(_, frames)| frames.iter_mut().enumerate()) {
            others.retain(|strip| own[number].as_ref().is_none_or(|own| !strip.is_same_as(own)));
        }
        points[tool] = Some(TrocarOfTool { at: point.at, turn: turn(&frames, point.at), strips: own });
    }
}

/// How far a tool turned about a point: the strips through it turn out of their mean plane by this sine, root mean
/// square. A tool at rest seems to turn by the error of a strip's direction, at most about 0.01.
pub fn turn(frames: &[Vec<Strip>], trocar: Vector3<f64>) -> f64 {
    let lines = lines_of(frames);
    let (mut sum, mut weight) = (Matrix3::zeros(), 0.0);
    for line in through(&lines, frames.len(), trocar).into_iter().flatten() {
        sum += line.plane * line.plane.transpose() * line.score;
        weight += line.score;
    }
    let mut shares: [f64; 3] = sum.symmetric_eigenvalues().into();
    shares.sort_by(f64::total_cmp);
    if weight > 0.0 { (shares[1].max(0.0) / weight).sqrt() } else { 0.0 }
}

/// The line of a strip.
struct Line {
    frame: usize,
    /// The strip's number in the frame.
    strip: usize,
    plane: Vector3<f64>,
    /// The direction of its end, and the one at right angles to it towards its entry.
    directions: [Vector3<f64>; 2],
    /// Angle between its end and its entry, radians.
    length: f64,
    score: f64,
}

impl Line {
    fn of(frame: usize, number: usize, strip: &Strip) -> Self {
        let [end, entry] = [strip.end, strip.entry].map(|at| at.ray().normalize());
        let to_entry = (entry - end * entry.dot(&end)).try_normalize(1e-9).unwrap_or_default();
        let (directions, length) = ([end, to_entry], end.angle(&entry));
        Self { frame, strip: number, plane: strip.plane(), directions, length, score: strip.score.max(0.0) }
    }

    /// Does it pass through a trocar that lies beyond its middle, towards its entry?
    fn comes_from(&self, trocar: Vector3<f64>) -> bool {
        let [along, to_entry] = self.directions.map(|direction| direction.dot(&trocar));
        // Opposite directions are one point of the picture.
        let angle = to_entry.abs().atan2(to_entry.signum() * along);
        self.plane.dot(&trocar).abs() < MAX_MISS && (0.5 * self.length..MAX_ANGLE_DEG.to_radians()).contains(&angle)
    }
}

/// The lines of all frames.
fn lines_of(frames: &[Vec<Strip>]) -> Vec<Line> {
    let of_frame = |(frame, strips): (usize, &Vec<Strip>)| -> Vec<Line> {
        strips.iter().enumerate().map(|(number, strip)| Line::of(frame, number, strip)).collect()
    };
    frames.iter().enumerate().flat_map(of_frame).collect()
}

/// Of each frame, the line of most score that comes from the trocar.
fn through(lines: &[Line], frames: usize, trocar: Vector3<f64>) -> Vec<Option<&Line>> {
    let mut best: Vec<Option<&Line>> = vec![None; frames];
    for line in lines {
        if best[line.frame].is_none_or(|other| line.score > other.score) && line.comes_from(trocar) {
            best[line.frame] = Some(line);
        }
    }
    best
}

/// The point by least squares over the lines that come from it.
fn refined(lines: &[Line], frames: usize, mut trocar: Vector3<f64>) -> Vector3<f64> {
    const ROUNDS: usize = 5;
    for _ in 0..ROUNDS {
        let mut sum = Matrix3::zeros();
        for line in through(lines, frames, trocar).into_iter().flatten() {
            sum += line.plane * line.plane.transpose() * line.score;
        }
        let eigen = sum.symmetric_eigen();
        let smallest = eigen.eigenvalues.imin();
        let found = eigen.eigenvectors.column(smallest).into_owned();
        trocar = if found.dot(&trocar) < 0.0 { -found } else { found };
    }
    trocar
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::space::Normalised;
    use nalgebra::{Point2, Vector2};

    fn strip(entry: [f64; 2], end: [f64; 2], score: f64) -> Strip {
        let [entry, end] = [entry, end].map(Point2::from);
        Strip {
            borders: [[entry, end]; 2],
            entry: Normalised(entry),
            end: Normalised(end),
            width: 0.02,
            length_widths: 10.0,
            score,
            net_evidence: 1.0,
            supported_share: 1.0,
            end_step_codes: None,
        }
    }

    #[test]
    fn the_trocar_is_where_the_strips_of_all_frames_meet_and_stray_strips_do_no_harm() {
        let trocar = Point2::new(-1.4, 0.9);
        let frames: Vec<Vec<Strip>> = (0..12)
            .map(|i| {
                let end = Point2::new(0.1 * f64::from(i % 4), 0.04 * f64::from(i) - 0.2);
                let entry = trocar + (end - trocar) * 0.6;
                let stray = strip([-0.5, 0.1 * f64::from(i % 3)], [0.3, -0.05 * f64::from(i % 5)], 50.0);
                vec![strip(entry.into(), end.into(), 100.0), stray]
            })
            .collect();
        let found = find(&frames, |_| true).unwrap().at;
        assert!((found.xy() / found.z - trocar.coords).norm() < 1e-6, "{found}");
        assert!(turn(&frames, found) > 0.05, "{}", turn(&frames, found));
    }

    #[test]
    fn a_resting_tool_and_a_line_of_the_box_meet_in_a_point_about_which_nothing_turned() {
        let line = strip([-0.6, 0.12], [0.2, 0.5], 50.0);
        let resting = |i: i32| strip([-0.5, 0.1], [0.1, 0.2 + 0.002 * f64::from(i % 3 - 1)], 100.0);
        let frames: Vec<Vec<Strip>> = (0..12).map(|i| vec![resting(i), line.clone()]).collect();
        let found = find(&frames, |_| true).unwrap().at;
        assert!(turn(&frames, found) < 0.01, "{}", turn(&frames, found));
    }

    /// The strips of a tool whose trocar is beyond the lower right of the picture, as seen from its hand.
    fn of_right_tool() -> Vec<Vec<Strip>> {
        let trocar = Point2::new(1.9, 1.7);
        let strip = |i: i32| {
            let tip = Point2::new(-0.1 - 0.03 * f64::from(i % 4), -0.26 + 0.02 * f64::from(i % 5));
            strip((tip + (trocar - tip) * 0.3).into(), tip.into(), 100.0)
        };
        (0..12).map(|i| vec![strip(i)]).collect()
    }

    fn reversed(strip: &Strip) -> Strip {
        Strip { entry: strip.end, end: strip.entry, score: 0.9 * strip.score, ..strip.clone() }
    }

    #[test]
    fn a_tool_that_is_seen_from_tip_to_hand_has_no_trocar_beyond_its_tip() {
        let right = of_right_tool();
        assert!(find(&right, |_| true).is_some());
        let frames: Vec<Vec<Strip>> = right.iter().map(|strips| strips.iter().map(reversed).collect()).collect();
        assert!(find(&frames, |_| true).is_none());
    }

    #[test]
    fn a_strip_of_one_tool_is_not_the_other_one() {
        let right = of_right_tool();
        let own = |i: usize| strip([-0.54, 0.2 + 0.01 * i as f64], [-0.3, -0.02 * i as f64], 50.0);
        let left: Vec<Vec<Strip>> =
            right.iter().enumerate().map(|(i, strips)| vec![strips[0].clone(), own(i)]).collect();
        let points = of_tools(vec![left, right], |_| true);
        let [left, right] = [0, 1].map(|tool| points[tool].as_ref().unwrap().at).map(|at| at.xy() / at.z);
        assert!((right - Vector2::new(1.9, 1.7)).norm() < 1e-3, "{right}");
        assert!(left.x < 0.0, "{left}");
    }

    #[test]
    fn a_tool_that_does_not_turn_shows_no_trocar() {
        let frames = vec![vec![strip([-0.5, 0.1], [0.1, 0.2], 100.0)]; 12];
        assert!(find(&frames, |_| true).is_none());
    }
}
