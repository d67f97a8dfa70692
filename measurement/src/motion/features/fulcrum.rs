//! Finds the fulcrum of a tool: the point where it passes through the box's wall (the trocar), from its path.
//!
//! **In:** a tool's samples with the axis of its shaft. **Out:** the point that all axes pass through, camera frame,
//! mm. **Method:** the point nearest to all axes ([`nearest_point`]). Where the tracker knows the trocar, it states the
//! axis from the trocar to the tip, so this function returns the tracker's trocar. Features measured about the trocar
//! take it as exact: it may be off by millimetres on a lever of decimetres, and no error bar includes that. **Gives
//! up** if no axes are stated, if they turn too little to meet in one point, or if the point would lie at the tip or in
//! front of it.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::vision::pose::fulcrum::{Fulcrum, PLAY_MM, nearest_point};
use crate::vision::trajectory::{Sample, SampleState};

/// Axes within this time share their errors and count as one, s: the background behind the tape changes as slowly.
const CORRELATION_S: f64 = 1.0;

/// Minimum distance of a trocar behind the tip, mm: the band and a piece of shaft lie between them.
const MIN_TROCAR_DISTANCE_MM: f64 = 20.0;

/// Maximum root mean square distance at which the axes pass the point, mm. Beyond it the tool does not turn about a
/// point.
const MAX_MISS_MM: f64 = 5.0;

/// Largest standard deviation along an axis of a trocar that features take as exact, mm: 2 % of the usual distance from
/// the tip.
const WELL_KNOWN_MM: f64 = 4.0;

/// Is a trocar known so well that features may take it as exact?
pub fn is_exact(fulcrum: &Fulcrum) -> bool {
    fulcrum.covariance.symmetric_eigenvalues().max() <= WELL_KNOWN_MM * WELL_KNOWN_MM
}

/// The trocar of one tool, if its axes determine it to within [`WELL_KNOWN_MM`].
pub fn find(samples: &[Sample]) -> Option<Point3<f64>> {
    let observed = samples.iter().filter(|sample| sample.state == SampleState::Observed);
    let line = |sample: &Sample| Some((sample.time_s, (sample.tip_mm, sample.axis?.try_normalize(1e-9)?)));
    let (times, lines): (Vec<f64>, Vec<_>) = observed.filter_map(line).unzip();
    let at = nearest_point(lines.iter().copied())?;
    let independent = times.chunk_by(|a, b| (a / CORRELATION_S).floor() == (b / CORRELATION_S).floor()).count();
    let behind_mm = lines.iter().map(|(tip, axis)| (tip - at).dot(axis)).sum::<f64>() / lines.len() as f64;
    (behind_mm > MIN_TROCAR_DISTANCE_MM && is_well_known(&lines, at, independent as f64)).then_some(at)
}

/// True if the position of the point is certain enough. Axes determine the position along themselves only if they turn.
fn is_well_known(lines: &[(Point3<f64>, Vector3<f64>)], at: Point3<f64>, independent: f64) -> bool {
    let across = |axis: &Vector3<f64>| Matrix3::identity() - axis * axis.transpose();
    let count = lines.len() as f64;
    let missed = lines.iter().map(|(tip, axis)| (across(axis) * (tip - at)).norm_squared()).sum::<f64>() / count;
    let least = 2.0 * PLAY_MM * PLAY_MM; // axes that the tracker made meet show no misses
    let information =
        lines.iter().map(|(_, axis)| across(axis)).sum::<Matrix3<f64>>() * (independent.min(count) / count);
    let largest = information
        .symmetric_eigenvalues()
        .iter()
        .map(|known| 0.5 * missed.max(least) / known.max(f64::MIN_POSITIVE))
        .fold(0.0, f64::max);
    missed <= MAX_MISS_MM * MAX_MISS_MM && largest <= WELL_KNOWN_MM * WELL_KNOWN_MM
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUE: Point3<f64> = Point3::new(-118.0, 108.0, 64.0);

    /// A tip that moves over `wander_mm`, with axes that are off by `off` of their length.
    fn path(wander_mm: f64, off: f64) -> Vec<Sample> {
        let sample = |k: u32| {
            let t = f64::from(k) * 0.04;
            let tip = Point3::new(
                -20.0 + wander_mm * t.sin(),
                -5.0 + wander_mm * t.cos(),
                190.0 + 0.4 * wander_mm * (1.3 * t).sin(),
            );
            let error = Vector3::new((7.1 * t).sin(), (5.3 * t).cos(), (9.7 * t).sin()) * off;
            Sample {
                frame: u64::from(k),
                time_s: t,
                tool: 0,
                tip_mm: tip,
                velocity_mm_s: None,
                axis: Some((tip - TRUE).normalize() + error),
                tip_px: None,
                covariance_mm2: None,
                state: SampleState::Observed,
            }
        };
        (0..1000).map(sample).collect()
    }

    #[test]
    fn axes_that_turn_meet_in_the_trocar() {
        assert!((find(&path(30.0, 0.0)).unwrap() - TRUE).norm() < 1e-6);
        assert!((find(&path(30.0, 0.005)).unwrap() - TRUE).norm() < WELL_KNOWN_MM);
    }

    #[test]
    fn where_axes_do_not_turn_or_point_elsewhere_no_trocar_is_known() {
        assert_eq!(find(&path(0.5, 0.005)), None);
        assert_eq!(find(&path(30.0, 0.1)), None);
        let mut ahead = path(30.0, 0.0);
        ahead.iter_mut().for_each(|sample| sample.axis = sample.axis.map(|axis| -axis));
        assert_eq!(find(&ahead), None);
        let mut without = path(30.0, 0.0);
        without.iter_mut().for_each(|sample| sample.axis = None);
        assert_eq!(find(&without), None);
    }
}
