//! Does the picture contradict the sizes of a tool: the diameter over its tape, and the length of its band?
//!
//! The ratio of both decides how much the band leans: it looks shorter, the more it leans. How much it leans also shows
//! in how its borders converge. With wrong sizes, the two disagree on every pose. **In** the poses of a session.
//! **Out** [`SizeMismatch`], the mean difference of the borders' convergence. **Cannot show** sizes that are both wrong
//! by the same factor, and **gives up** (`None`) on poses that hardly lean.

use serde::{Deserialize, Serialize};

use super::TubeEstimate;
use super::adjustment::{MIN_POSES, weights};
use super::normal_equations::TAPER;

/// By how much a band's borders converge less than its sizes make them, at its ends against its middle, pixels. A band
/// that is shorter than stated, relative to its diameter, leans less than it seems: the difference is positive.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SizeMismatch {
    /// The difference, pixels.
    pub px: f64,
    /// Standard deviation of such a difference on tools with the right sizes, pixels.
    pub sigma_px: f64,
}

impl SizeMismatch {
    /// The difference in standard deviations: positive if the band is shorter than stated, relative to its diameter.
    pub fn sigmas(&self) -> f64 {
        self.px / self.sigma_px
    }
}

/// The mismatch of a session's poses. `None` if too few of them lean, or if the band's length was not given.
pub fn mismatch(poses: &[TubeEstimate]) -> Option<SizeMismatch> {
    /// Minimum cosine of the angle between axis and line of sight: 12° from being seen from the side. Below it, noise
    /// decides on which side of that the axis lies.
    const MIN_LEAN: f64 = 0.2;
    let lean = |pose: &TubeEstimate| Some(pose.tube.axis.dot(&pose.tube.tip.coords.try_normalize(1e-9)?));
    let has_lean = |pose: &&TubeEstimate| lean(pose).is_some_and(|lean| lean.abs() > MIN_LEAN);
    let leaning: Vec<TubeEstimate> = poses.iter().filter(has_lean).copied().collect();
    let first = &leaning.first()?.equations;
    if leaning.len() < MIN_POSES || first.is_length_unknown() {
        return None;
    }
    let (mut sum, mut all) = (0.0, 0.0);
    for (pose, weight) in leaning.iter().zip(weights(&leaning)) {
        let taper_px = pose.equations.offsets_of_edges()?[TAPER];
        sum -= weight * taper_px * lean(pose)?.signum();
        all += weight;
    }
    let own_px = first.own_px()[TAPER] / all.sqrt();
    Some(SizeMismatch { px: sum / all, sigma_px: first.shared_px()[TAPER].hypot(own_px) })
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use rand::SeedableRng;
    use rand::rngs::SmallRng;

    use super::*;
    use crate::vision::camera::testing::wide as camera;
    use crate::vision::pose::band_length;
    use crate::vision::pose::joint_fit::{Trust, fit};
    use crate::vision::pose::normal_equations::{OffsetPriors, Offsets, own_offsets_px, shared_offsets_px};
    use crate::vision::pose::testing::{LENGTH_MM, edges, gaussian};
    use crate::vision::space::CameraPoint;
    use crate::vision::tube::Tube;

    const RADIUS_MM: f64 = 2.5;

    /// Poses of a tool that turns about its trocar, fitted as if its sizes were `by` times the true ones: its diameter,
    /// its band's length.
    fn session(seed: u64, [by_diameter, by_length]: [f64; 2]) -> Vec<TubeEstimate> {
        let random = &mut SmallRng::seed_from_u64(seed);
        let mut errors = |sigmas: [f64; 7]| Offsets::from(sigmas.map(|sigma| sigma * gaussian(random)));
        let shared = errors(shared_offsets_px(5.0, 5.0));
        let own: Vec<Offsets> = (0..40).map(|_| errors(own_offsets_px(5.0))).collect();
        let pose = |(index, own): (usize, &Offsets)| {
            let turn = 0.5 * index as f64;
            let tip =
                Point3::new(-30.0 + 25.0 * turn.sin(), -8.0 + 20.0 * turn.cos(), 190.0 + 10.0 * (1.7 * turn).sin());
            let axis = (tip - Point3::new(-118.0, 108.0, 64.0)).normalize();
            let (tube, backs_mm) = (Tube { tip, axis, radius: RADIUS_MM }, (1..25).map(f64::from).collect::<Vec<_>>());
            let found = edges(&tube, &camera(), &backs_mm, &(shared + own), 0.1, &mut SmallRng::seed_from_u64(seed));
            let sights = [tip, tip - axis * LENGTH_MM].map(|end| CameraPoint(end).normalised().unwrap());
            let depth_mm = by_diameter * (tip - axis * (0.5 * LENGTH_MM)).z;
            let start =
                band_length::leaning(sights, depth_mm, by_length * LENGTH_MM, by_diameter * RADIUS_MM, 1.0).unwrap();
            let stated: Vec<_> = found.into_iter().map(|edge| edge.with_length_scaled(by_length)).collect();
            fit(&stated, &start, &camera(), Trust::Majority, &OffsetPriors::usual(by_length * LENGTH_MM), None)
        };
        own.iter().enumerate().filter_map(pose).collect()
    }

    fn sigmas(seed: u64, by: [f64; 2]) -> f64 {
        mismatch(&session(seed, by)).unwrap().sigmas()
    }

    #[test]
    fn right_sizes_are_rarely_contradicted() {
        let beyond = (0..40).filter(|seed| sigmas(*seed, [1.0, 1.0]).abs() > 2.0).count();
        assert!(beyond <= 5, "{beyond} of 40 beyond two standard deviations");
    }

    #[test]
    fn a_band_that_is_half_as_long_as_stated_is_contradicted_and_so_is_a_tube_twice_as_thick() {
        for seed in 0..5 {
            let [long, thin] = [[1.0, 2.0], [0.5, 1.0]].map(|by| sigmas(seed, by));
            assert!(long > 3.3 && thin > 3.3, "{long} {thin}");
        }
    }

    #[test]
    fn the_sign_says_whether_the_band_is_shorter_or_longer_than_stated() {
        let mean = |by_length: f64| (0..20).map(|seed| sigmas(seed, [1.0, by_length])).sum::<f64>() / 20.0;
        let [shorter, right, longer] = [1.3, 1.0, 0.9].map(mean);
        assert!(shorter > right + 0.8 && longer < right - 0.2, "{shorter} {right} {longer}");
    }

    #[test]
    fn sizes_that_are_wrong_by_the_same_factor_are_not_contradicted() {
        assert!((0..5).all(|seed| sigmas(seed, [2.0, 2.0]).abs() < 3.0));
    }

    #[test]
    fn few_poses_give_no_mismatch() {
        let poses = session(1, [1.0, 1.0]);
        assert_eq!(mismatch(&poses[..MIN_POSES - 1]), None);
    }
}
