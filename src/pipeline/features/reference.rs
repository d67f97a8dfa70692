//! How far a path is from another that shows how it should go: a figure to be traced, or an expert's path.
//!
//! **In:** two motions. **Out:** two distances, mm. **Method:** of both, the path of the movements alone is laid out in 2000 points
//! evenly spaced along it, so that neither pace nor rests count. *Dynamic time warping* pairs the points of both in order so that
//! their distances add up to the least (Sakoe & Chiba 1978, the symmetric form, whose weights add up to the same whatever the
//! pairing): a mean. The *discrete Fréchet distance* (Eiter & Mannila 1994) is the longest leash that two walkers need who
//! never turn back: a largest one. Both paths are where the camera saw them: it must not have moved in between.

use nalgebra::Point3;

use super::motion::Motion;
use super::movement::movements;
use super::{FeatureSettings, NotEnough};

/// Points in which a path is laid out: a path of 20 m has one each centimetre.
const POINTS: usize = 2000;

/// How far a path is from its reference, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Mean distance of the points that dynamic time warping pairs.
    pub mean_mm: f64,
    /// Discrete Fréchet distance.
    pub largest_mm: f64,
}

/// How far a motion's path is from another's.
pub fn deviation(motion: &Motion, reference: &Motion, settings: &FeatureSettings) -> Result<Deviation, NotEnough> {
    let (path, reference) = (laid_out(motion, settings)?, laid_out(reference, settings)?);
    Ok(Deviation { mean_mm: warped_mean(&path, &reference), largest_mm: frechet(&path, &reference) })
}

/// The path of a motion's movements in evenly spaced points.
fn laid_out(motion: &Motion, settings: &FeatureSettings) -> Result<Vec<Point3<f64>>, NotEnough> {
    motion.check_enough(settings)?;
    let nodes = movements(motion, settings).iter().flat_map(|movement| &movement.nodes);
    let corners: Vec<Point3<f64>> = nodes.map(|node| node.position).collect();
    let length: f64 = corners.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
    let (Some(first), true) = (corners.first(), length > 0.0) else { return Err(NotEnough::NoMovement) };
    let spacing = length / (POINTS - 1) as f64;
    let (mut points, mut walked) = (vec![*first], 0.0);
    for pair in corners.windows(2) {
        let leg = pair[1] - pair[0];
        while points.len() < POINTS && points.len() as f64 * spacing <= walked + leg.norm() {
            points.push(pair[0] + leg * ((points.len() as f64 * spacing - walked) / leg.norm()));
        }
        walked += leg.norm();
    }
    points.resize(POINTS, corners[corners.len() - 1]); // rounding may leave out the last
    Ok(points)
}

/// Least sum of the distances of paired points over the sum of their weights: a step ahead in both paths counts twice.
fn warped_mean(a: &[Point3<f64>], b: &[Point3<f64>]) -> f64 {
    let sum = along(a, b, |before, distance| match before {
        None => 2.0 * distance,
        Some([both, one, other]) => (both + 2.0 * distance).min(one + distance).min(other + distance),
    });
    sum / (a.len() + b.len()) as f64
}

/// The discrete Fréchet distance.
fn frechet(a: &[Point3<f64>], b: &[Point3<f64>]) -> f64 {
    along(a, b, |before, distance| match before {
        None => distance,
        Some([both, one, other]) => both.min(one).min(other).max(distance),
    })
}

/// Fills a table by what is best before a pair of points (a step back in both paths, in the one, in the other) and their
/// distance, row by row; its last value. Before the table's edges nothing is reachable.
fn along(a: &[Point3<f64>], b: &[Point3<f64>], best: impl Fn(Option<[f64; 3]>, f64) -> f64) -> f64 {
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
