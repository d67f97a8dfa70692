//! Robust line fit through points with outliers: iteratively reweighted least squares with Geman–McClure weights
//! (METHOD 3.3).

use nalgebra::{Matrix2, Point2, Vector2};

/// A line in the plane: the points `p` with `normal · p = offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BorderLine {
    /// Unit normal.
    pub normal: Vector2<f64>,
    /// Distance from the origin along the normal.
    pub offset: f64,
}

impl BorderLine {
    /// Signed distance of a point.
    pub fn distance(&self, point: Point2<f64>) -> f64 {
        self.normal.dot(&point.coords) - self.offset
    }
}

/// Fits a line; points farther from it than a few times the median distance get little weight. `None` for fewer than
/// three points, or if all lie in one place.
pub fn fit(points: &[Point2<f64>]) -> Option<BorderLine> {
    const ROUNDS: usize = 8;
    if points.len() < 3 {
        return None;
    }
    let mut weights = vec![1.0; points.len()];
    let mut line = fit_weighted(points, &weights)?;
    for _ in 0..ROUNDS {
        let mut distances: Vec<f64> = points.iter().map(|p| line.distance(*p).abs()).collect();
        for (weight, distance) in weights.iter_mut().zip(&distances) {
            *weight = *distance;
        }
        distances.sort_by(f64::total_cmp);
        let scale = (1.4826 * distances[distances.len() / 2]).max(1e-9);
        for weight in &mut weights {
            let ratio = *weight / (2.5 * scale);
            *weight = 1.0 / (1.0 + ratio * ratio).powi(2); // Geman–McClure: far points lose their weight
        }
        line = fit_weighted(points, &weights)?;
    }
    Some(line)
}

fn fit_weighted(points: &[Point2<f64>], weights: &[f64]) -> Option<BorderLine> {
    let total: f64 = weights.iter().sum();
    let mean = points.iter().zip(weights).map(|(p, w)| p.coords * *w).sum::<Vector2<f64>>() / total;
    let spread = points
        .iter()
        .zip(weights)
        .map(|(p, w)| (p.coords - mean) * (p.coords - mean).transpose() * *w)
        .sum::<Matrix2<f64>>();
    let eigen = spread.symmetric_eigen();
    let thin = if eigen.eigenvalues[0] <= eigen.eigenvalues[1] { 0 } else { 1 };
    if !(total > 0.0 && eigen.eigenvalues[1 - thin] > 0.0) {
        return None;
    }
    let normal = eigen.eigenvectors.column(thin).into_owned();
    Some(BorderLine { normal, offset: normal.dot(&mean) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_of_outliers_on_one_side_does_not_move_the_line() {
        let good = (0..30).map(|i| Point2::new(f64::from(i), 3.0 + 0.5 * f64::from(i)));
        let bad = (0..10).map(|i| Point2::new(f64::from(i) * 3.0, 12.0 + 1.5 * f64::from(i)));
        let line = fit(&good.chain(bad).collect::<Vec<_>>()).unwrap();
        for i in 0..30 {
            assert!(line.distance(Point2::new(f64::from(i), 3.0 + 0.5 * f64::from(i))).abs() < 0.02);
        }
    }

    #[test]
    fn two_points_are_not_enough() {
        assert_eq!(fit(&[Point2::origin(), Point2::new(1.0, 1.0)]), None);
    }
}
