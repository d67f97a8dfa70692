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

/// The point that the strips of most score pass through, as a unit vector; `None` if they do not show one. `frames` are
/// the strips of each frame, and `is_possible` says whether a trocar can be there.
pub fn find(frames: &[Vec<Strip>], is_possible: impl Fn(Vector3<f64>) -> bool) -> Option<Vector3<f64>> {
    let planes = planes_of(frames);
    let mut best = (0.0, None);
    for (i, (frame, plane, _)) in planes.iter().enumerate() {
        for (other_frame, other, _) in &planes[..i] {
            let crossing = plane.cross(other);
            if frame == other_frame || crossing.norm() < MIN_CROSSING {
                continue;
            }
            let trocar = crossing.normalize();
            let score = score(&planes, frames.len(), trocar);
            if score > best.0 && is_possible(trocar) {
                best = (score, Some(trocar));
            }
        }
    }
    let found = best.1.map(|trocar| refined(&planes, frames.len(), trocar))?;
    let passing = best_of_frames(&planes, frames.len(), found).into_iter().flatten().count();
    (passing >= MIN_FRAMES && is_possible(found)).then_some(found)
}

/// How far a tool turned about a point: the strips through it turn out of their mean plane by this sine, root mean
/// square. A tool at rest seems to turn by the error of a strip's direction, at most about 0.01.
pub fn turn(frames: &[Vec<Strip>], trocar: Vector3<f64>) -> f64 {
    let passing = best_of_frames(&planes_of(frames), frames.len(), trocar);
    let (mut sum, mut weight) = (Matrix3::zeros(), 0.0);
    for (plane, score) in passing.into_iter().flatten() {
        sum += plane * plane.transpose() * score;
        weight += score;
    }
    let mut shares: [f64; 3] = sum.symmetric_eigenvalues().into();
    shares.sort_by(f64::total_cmp);
    if weight > 0.0 { (shares[1].max(0.0) / weight).sqrt() } else { 0.0 }
}

/// The strips of all frames: frame, plane and score.
fn planes_of(frames: &[Vec<Strip>]) -> Vec<(usize, Vector3<f64>, f64)> {
    let of_frame = |(frame, strips): (usize, &Vec<Strip>)| {
        strips.iter().map(move |strip| (frame, strip.plane(), strip.score.max(0.0))).collect::<Vec<_>>()
    };
    frames.iter().enumerate().flat_map(of_frame).collect()
}

/// Sum over the frames of the best strip that passes through the point.
fn score(planes: &[(usize, Vector3<f64>, f64)], frames: usize, trocar: Vector3<f64>) -> f64 {
    best_of_frames(planes, frames, trocar).into_iter().flatten().map(|(_, score)| score).sum()
}

/// Of each frame, the strip of most score that passes through the point.
fn best_of_frames(
    planes: &[(usize, Vector3<f64>, f64)],
    frames: usize,
    trocar: Vector3<f64>,
) -> Vec<Option<(Vector3<f64>, f64)>> {
    let mut best: Vec<Option<(Vector3<f64>, f64)>> = vec![None; frames];
    for (frame, plane, score) in planes {
        let is_better = best[*frame].is_none_or(|(_, other)| *score > other);
        if plane.dot(&trocar).abs() < MAX_MISS && is_better {
            best[*frame] = Some((*plane, *score));
        }
    }
    best
}

/// The point by least squares over the strips that pass through it.
fn refined(planes: &[(usize, Vector3<f64>, f64)], frames: usize, mut trocar: Vector3<f64>) -> Vector3<f64> {
    const ROUNDS: usize = 5;
    for _ in 0..ROUNDS {
        let mut sum = Matrix3::zeros();
        for (plane, score) in best_of_frames(planes, frames, trocar).into_iter().flatten() {
            sum += plane * plane.transpose() * score;
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
    use nalgebra::Point2;

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
        let found = find(&frames, |_| true).unwrap();
        assert!((found.xy() / found.z - trocar.coords).norm() < 1e-6, "{found}");
        assert!(turn(&frames, found) > 0.05, "{}", turn(&frames, found));
    }

    #[test]
    fn a_resting_tool_and_a_line_of_the_box_meet_in_a_point_about_which_nothing_turned() {
        let line = strip([-0.6, -0.3], [0.2, 0.3], 50.0);
        let resting = |i: i32| strip([-0.5, 0.1], [0.1, 0.2 + 0.002 * f64::from(i % 3 - 1)], 100.0);
        let frames: Vec<Vec<Strip>> = (0..12).map(|i| vec![resting(i), line.clone()]).collect();
        let found = find(&frames, |_| true).unwrap();
        assert!(turn(&frames, found) < 0.01, "{}", turn(&frames, found));
    }

    #[test]
    fn a_tool_that_does_not_turn_shows_no_trocar() {
        let frames = vec![vec![strip([-0.5, 0.1], [0.1, 0.2], 100.0)]; 12];
        assert_eq!(find(&frames, |_| true), None);
    }
}
