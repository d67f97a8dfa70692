//! Distance of a path from a reference path: a figure to trace, or an expert's path.
//!
//! **In:** two motions. **Out:** two distances, mm. **Method:** the movements of each path are resampled to 2000 points
//! at equal distances along the path, so that neither pace nor rests count. *Dynamic time warping* pairs the points of
//! both paths in order so that the sum of their distances is smallest (Sakoe & Chiba 1978, the symmetric form, whose
//! weights have the same sum for every pairing); it gives a mean distance. The *discrete Fréchet distance* (Eiter &
//! Mannila 1994) is the shortest leash that joins two walkers, one on each path, who never walk back; it gives a
//! largest distance. Both paths are in the camera's frame, so the camera must not move between the recordings.

use nalgebra::Point3;

use super::motion::Motion;
use super::movement::movements;
use super::{FeatureSettings, NotEnough};

/// Number of points of a resampled path: a path of 20 m has one per centimetre.
const PATH_POINTS: usize = 2000;

/// Distance of a path from its reference, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Mean distance of the points that dynamic time warping pairs.
    pub mean_mm: f64,
    /// Discrete Fréchet distance.
    pub largest_mm: f64,
}

/// Compares a motion's path with a reference path.
pub fn deviation(motion: &Motion, reference: &Motion, settings: &FeatureSettings) -> Result<Deviation, NotEnough> {
    let (path, reference) = (resampled_path(motion, settings)?, resampled_path(reference, settings)?);
    Ok(Deviation { mean_mm: warped_mean(&path, &reference), largest_mm: frechet(&path, &reference) })
}

/// The path of a motion's movements, resampled to evenly spaced points.
fn resampled_path(motion: &Motion, settings: &FeatureSettings) -> Result<Vec<Point3<f64>>, NotEnough> {
    motion.check_enough(settings)?;
    let nodes = movements(motion, settings).iter().flat_map(|movement| &movement.nodes);
    let corners: Vec<Point3<f64>> = nodes.map(|node| node.position).collect();
    let length: f64 = corners.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
    let (Some(first), true) = (corners.first(), length > 0.0) else { return Err(NotEnough::NoMovement) };
    let spacing = length / (PATH_POINTS - 1) as f64;
    let (mut points, mut walked) = (vec![*first], 0.0);
    for pair in corners.windows(2) {
        let leg = pair[1] - pair[0];
        while points.len() < PATH_POINTS && points.len() as f64 * spacing <= walked + leg.norm() {
            points.push(pair[0] + leg * ((points.len() as f64 * spacing - walked) / leg.norm()));
        }
        walked += leg.norm();
    }
    points.resize(PATH_POINTS, corners[corners.len() - 1]); // rounding may leave out the last
    Ok(points)
}

/// Smallest weighted sum of the distances of paired points, divided by the sum of the weights. A step forward in both
/// paths has weight 2.
fn warped_mean(a: &[Point3<f64>], b: &[Point3<f64>]) -> f64 {
    let sum = fill_table(a, b, |before, distance| match before {
        None => 2.0 * distance,
        Some([both, one, other]) => (both + 2.0 * distance).min(one + distance).min(other + distance),
    });
    sum / (a.len() + b.len()) as f64
}

/// The discrete Fréchet distance.
fn frechet(a: &[Point3<f64>], b: &[Point3<f64>]) -> f64 {
    fill_table(a, b, |before, distance| match before {
        None => distance,
        Some([both, one, other]) => both.min(one).min(other).max(distance),
    })
}

/// Fills the table of dynamic programming row by row and returns its last value. `best` combines the values of the
/// three predecessors (one step back in both paths, in `a`, in `b`) with the distance of the current pair of points.
/// Cells outside the table are unreachable.
fn fill_table(a: &[Point3<f64>], b: &[Point3<f64>], best: impl Fn(Option<[f64; 3]>, f64) -> f64) -> f64 {
    let mut row = vec![f64::INFINITY; b.len() + 1];
    for (i, from) in a.iter().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], f64::INFINITY);
        for (j, to) in b.iter().enumerate() {
            let before = (i + j > 0).then_some([diagonal, row[j + 1], row[j]]);
            diagonal = row[j + 1];
            row[j + 1] = best(before, (to - from).norm());
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;

    fn line(count: u32, place: impl Fn(f64) -> [f64; 3]) -> Vec<Point3<f64>> {
        (0..count).map(|k| Point3::from(place(f64::from(k) / f64::from(count - 1)))).collect()
    }

    #[test]
    fn a_path_is_nowhere_from_itself_and_as_far_from_a_shifted_one_as_that_is_shifted() {
        let path = line(200, |u| [40.0 * (7.0 * u).cos(), 30.0 * (5.0 * u).sin(), 0.0]);
        assert_eq!((warped_mean(&path, &path), frechet(&path, &path)), (0.0, 0.0));
        let aside: Vec<_> = path.iter().map(|p| p + Vector3::new(0.0, 0.0, 7.0)).collect();
        assert!((warped_mean(&path, &aside) - 7.0).abs() < 1e-9 && (frechet(&path, &aside) - 7.0).abs() < 1e-9);
    }

    #[test]
    fn one_detour_counts_whole_in_the_largest_and_little_in_the_mean() {
        let straight = line(201, |u| [100.0 * u, 0.0, 0.0]);
        let detour = line(201, |u| [100.0 * u, if (0.48..0.52).contains(&u) { 20.0 } else { 0.0 }, 0.0]);
        assert!((frechet(&straight, &detour) - 20.0).abs() < 1e-9);
        let mean = warped_mean(&straight, &detour);
        assert!(mean > 0.35 && mean < 0.85, "{mean}"); // 8 of 201 points, 20 mm off
    }

    #[test]
    fn the_worked_example_of_a_walk_and_its_leash() {
        let a: Vec<_> = [[1.0, 1.0], [2.0, 1.0], [2.0, 2.0]].map(|[x, y]| Point3::new(x, y, 0.0)).into();
        let b: Vec<_> = [[2.0, 2.0], [0.0, 1.0], [2.0, 4.0]].map(|[x, y]| Point3::new(x, y, 0.0)).into();
        assert!((frechet(&a, &b) - 2.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn the_order_of_the_two_does_not_matter_and_the_mean_is_at_most_the_largest(
            a in prop::collection::vec(prop::array::uniform3(-50.0f64..50.0), 2..30),
            b in prop::collection::vec(prop::array::uniform3(-50.0f64..50.0), 2..30),
        ) {
            let [a, b] = [a, b].map(|path| path.into_iter().map(Point3::from).collect::<Vec<_>>());
            prop_assert!((warped_mean(&a, &b) - warped_mean(&b, &a)).abs() < 1e-9);
            prop_assert!((frechet(&a, &b) - frechet(&b, &a)).abs() < 1e-12);
            prop_assert!(warped_mean(&a, &b) <= frechet(&a, &b) + 1e-9);
        }
    }
}
