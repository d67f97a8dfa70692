//! Paths along one straight guide against each other (T 7.1.3): needs no truth.
//!
//! A line is fitted to each path; the *dissimilarity* of two paths is the mean distance from the points of one path to
//! the line of the other. It contains the tracker's error and the hand's freedom on the guide. The thesis found 7 mm
//! from above and 12 mm from the side, for five slides.

use nalgebra::{Matrix3, Point3, Vector3};

/// A line in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line3 {
    /// The centre of the fitted points, mm.
    pub centre: Point3<f64>,
    /// Its direction, a unit vector.
    pub direction: Vector3<f64>,
}

/// The similarity of several paths.
#[derive(Clone, Debug, PartialEq)]
pub struct Repeatability {
    /// The line of each path.
    pub lines: Vec<Line3>,
    /// `mean_distance_mm[line][path]`: mean distance from the path's points to the line.
    pub mean_distance_mm: Vec<Vec<f64>>,
    /// Mean over all pairs of a line and *another* path: the figure to quote.
    pub others_mm: f64,
    /// Mean over all lines and their own paths: noise and wobble, without the differences between paths.
    pub own_mm: f64,
}

/// Why paths cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RepeatabilityProblem {
    /// Fewer than two paths.
    #[error("repeatability compares at least two paths; there is {0}")]
    TooFewPaths(usize),
    /// A path is too short for a line.
    #[error("path {index} has {points} points along {extent_mm:.1} mm: no line can be fitted to it")]
    NoLine {
        /// Number of the path, counted from 1.
        index: usize,
        /// Number of its points.
        points: usize,
        /// Its extent, mm.
        extent_mm: f64,
    },
}

/// Minimum extent of a path for a line fit, mm.
const MIN_EXTENT_MM: f64 = 5.0;

/// A new slide begins when the hand has moved back by this share of the whole extent.
const MIN_TURN_SHARE: f64 = 0.5;

/// Compares paths along one guide.
///
/// # Errors
/// [`RepeatabilityProblem`] with fewer than two paths, or if a path is too short for a line.
pub fn repeatability(paths: &[Vec<Point3<f64>>]) -> Result<Repeatability, RepeatabilityProblem> {
    if paths.len() < 2 {
        return Err(RepeatabilityProblem::TooFewPaths(paths.len()));
    }
    let lines = paths.iter().enumerate().map(|(i, path)| fit_line(i + 1, path)).collect::<Result<Vec<_>, _>>()?;
    let mean_distance_mm: Vec<Vec<f64>> =
        lines.iter().map(|line| paths.iter().map(|path| line.mean_distance_mm(path)).collect()).collect();
    let n = paths.len() as f64;
    let own: f64 = (0..paths.len()).map(|i| mean_distance_mm[i][i]).sum();
    let all: f64 = mean_distance_mm.iter().flatten().sum();
    Ok(Repeatability { lines, mean_distance_mm, others_mm: (all - own) / (n * (n - 1.0)), own_mm: own / n })
}

/// Cuts one path back and forth along a guide into its slides, one per direction of travel. A track that lags gives the
/// two directions different lines, and this counts as an error. (The thesis took each way there and back as one path;
/// one file for each does the same.)
pub fn slides(path: &[Point3<f64>]) -> Vec<Vec<Point3<f64>>> {
    let Some(line) = Line3::fit(path) else { return Vec::new() };
    let places: Vec<f64> = path.iter().map(|p| line.position_mm(p)).collect();
    let turn_mm = MIN_TURN_SHARE * extent(&places);
    let mut cuts = vec![0];
    cuts.extend(turns(&places, turn_mm));
    cuts.push(path.len().saturating_sub(1));
    let legs = cuts.windows(2).filter(|leg| extent(&places[leg[0]..=leg[1]]) >= turn_mm);
    legs.map(|leg| path[leg[0]..=leg[1]].to_vec()).collect()
}

/// Indices of the extremes after which the value moves back by more than `turn_mm`.
fn turns(places: &[f64], turn_mm: f64) -> Vec<usize> {
    let mut turns = Vec::new();
    let (mut lowest, mut highest) = (0, 0); // since the last turn
    for (index, place) in places.iter().enumerate() {
        if *place < places[lowest] {
            lowest = index;
        }
        if *place > places[highest] {
            highest = index;
        }
        let (earlier, later) = (lowest.min(highest), lowest.max(highest));
        if (place - places[later]).abs() > turn_mm && places[later] != places[earlier] {
            turns.push(later);
            (lowest, highest) = if *place < places[later] { (index, later) } else { (later, index) };
        }
    }
    turns
}

fn extent(places: &[f64]) -> f64 {
    let (least, most) = places.iter().fold((f64::MAX, f64::MIN), |(l, m), p| (l.min(*p), m.max(*p)));
    (most - least).max(0.0)
}

fn fit_line(index: usize, path: &[Point3<f64>]) -> Result<Line3, RepeatabilityProblem> {
    let line = Line3::fit(path);
    let extent_mm = line.map_or(0.0, |line| extent(&path.iter().map(|p| line.position_mm(p)).collect::<Vec<_>>()));
    let no_line = RepeatabilityProblem::NoLine { index, points: path.len(), extent_mm };
    line.filter(|_| extent_mm >= MIN_EXTENT_MM).ok_or(no_line)
}

impl Line3 {
    /// The line that minimises the sum of squared distances to the points; `None` without points.
    pub fn fit(points: &[Point3<f64>]) -> Option<Line3> {
        let n = points.len() as f64;
        let centre = Point3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n);
        let scatter: Matrix3<f64> = points.iter().map(|p| (p - centre) * (p - centre).transpose()).sum();
        let axes = scatter.symmetric_eigen();
        (!points.is_empty())
            .then(|| Line3 { centre, direction: axes.eigenvectors.column(axes.eigenvalues.imax()).into() })
    }

    /// Position of a point along the line, mm from the centre.
    pub fn position_mm(&self, point: &Point3<f64>) -> f64 {
        (point - self.centre).dot(&self.direction)
    }

    /// Distance of a point from the line, mm.
    pub fn distance_mm(&self, point: &Point3<f64>) -> f64 {
        (point - self.centre).cross(&self.direction).norm()
    }

    fn mean_distance_mm(&self, path: &[Point3<f64>]) -> f64 {
        path.iter().map(|point| self.distance_mm(point)).sum::<f64>() / path.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::random::Dice;

    /// A slide of 80 mm along a guide through (0, `y_mm`, 180), there and back.
    fn slide(y_mm: f64) -> Vec<Point3<f64>> {
        let direction = Vector3::new(0.6, 0.0, 0.8);
        let places = (0..=200).map(|i| 40.0 * (f64::from(i) * std::f64::consts::TAU / 200.0).cos());
        places.map(|place| Point3::new(0.0, y_mm, 180.0) + direction * place).collect()
    }

    #[test]
    fn slides_along_one_line_agree_and_parallel_ones_differ_by_their_distance() {
        assert!(repeatability(&[slide(0.0), slide(0.0)]).unwrap().others_mm < 1e-9);
        let apart = repeatability(&[slide(0.0), slide(3.0), slide(6.0)]).unwrap();
        assert!((apart.others_mm - 4.0).abs() < 1e-9, "mean of 3, 6, 3"); // each counted from both sides
        assert!(apart.own_mm < 1e-9);
    }

    #[test]
    fn one_path_and_a_resting_tool_cannot_be_compared() {
        assert_eq!(repeatability(&[slide(0.0)]), Err(RepeatabilityProblem::TooFewPaths(1)));
        let resting = vec![Point3::new(1.0, 2.0, 3.0); 50];
        assert!(matches!(repeatability(&[slide(0.0), resting]), Err(RepeatabilityProblem::NoLine { index: 2, .. })));
        assert!(matches!(repeatability(&[Vec::new(), slide(0.0)]), Err(RepeatabilityProblem::NoLine { index: 1, .. })));
    }

    #[test]
    fn going_to_and_fro_five_times_is_ten_slides() {
        let path: Vec<_> = (0..5).flat_map(|_| slide(0.0)).collect();
        let slides = slides(&path);
        assert_eq!(slides.len(), 10);
        assert!(slides.iter().all(|slide| (95..=105).contains(&slide.len())));
        assert_eq!(super::slides(&[]), Vec::<Vec<Point3<f64>>>::new());
    }

    proptest! {
        /// A hand rests at both ends, trembles, and turns back a little on its way; measured points scatter.
        #[test]
        fn slides_are_cut_only_at_the_ends(
            strokes in 1usize..8,
            rest in 0usize..20,
            back in 0.0f64..0.25,
            seed in 0u64..1000,
        ) {
            let mut dice = Dice::new(seed, "slides");
            let mut places = Vec::new();
            for stroke in 0..strokes {
                let towards = if stroke % 2 == 0 { 1.0 } else { -1.0 };
                let way = (0..=60).map(|i| f64::from(i) / 60.0);
                let turning_back = |s: f64| s - back * (3.0 * std::f64::consts::PI * s).sin();
                places.extend(way.map(|s| towards * (80.0 * turning_back(s) - 40.0)));
                places.extend(std::iter::repeat_n(towards * 40.0, rest));
            }
            let direction = Vector3::new(0.6, 0.0, 0.8);
            let path: Vec<_> =
                places.iter().map(|at| Point3::new(5.0, 6.0, 180.0) + direction * *at + dice.gauss3() * 0.5).collect();
            let slides = slides(&path);
            prop_assert_eq!(slides.len(), strokes);
            let line = Line3::fit(&path).unwrap();
            for slide in slides {
                let ends = [slide[0], slide[slide.len() - 1]].map(|end| line.position_mm(&end));
                prop_assert!((ends[1] - ends[0]).abs() > 76.0, "{ends:?}");
            }
        }

        #[test]
        fn a_line_fits_its_own_points(
            centre in prop::array::uniform3(-100.0f64..100.0),
            direction in prop::array::uniform3(0.1f64..1.0),
        ) {
            let direction = Vector3::from(direction).normalize();
            let points: Vec<_> = (-20..20).map(|i| Point3::from(centre) + direction * f64::from(i)).collect();
            let line = Line3::fit(&points).unwrap();
            prop_assert!((line.direction.dot(&direction).abs() - 1.0).abs() < 1e-9);
            prop_assert!(points.iter().all(|p| line.distance_mm(p) < 1e-6));
        }
    }
}
