//! Tabulated shapes of a blurred edge: a step, the shading of a limb and a ramp, blurred by the lens and by motion.
//!
//! A lens blurs by a Gaussian, motion during the exposure by a box. Each table is for one share of the box in the
//! total variance, with distance in total standard deviations.

use std::sync::OnceLock;

use super::lanes::{LANES, Lanes};

const STEPS_PER_SIGMA: f32 = 16.0; // linear interpolation is within 2e-4
const TABLE_REACH: f32 = 8.0;
const STEPS: usize = (2.0 * TABLE_REACH * STEPS_PER_SIGMA) as usize;
/// Tabulated shares of motion in the blur's variance; at 1 the blur would be a box with corners.
const MOTION_SHARES: [f64; 6] = [0.0, 0.3, 0.55, 0.75, 0.88, 0.96];

/// Values of the blurred parts of an edge at one place, `z` standard deviations outside: the share of the inside, the
/// root of the depth inside, the distance outside; then the decrease of the share and of the root per standard
/// deviation outwards.
pub type CurveValues = [Lanes; 5];

/// All curves for `z` from −8 to 8.
pub struct EdgeCurves {
    /// The value of each curve at each step.
    low: Box<[Lanes; STEPS]>,
    /// The increase of each curve to the next step.
    rise: Box<[Lanes; STEPS]>,
}

static EDGE_CURVES: [OnceLock<EdgeCurves>; MOTION_SHARES.len()] = [const { OnceLock::new() }; MOTION_SHARES.len()];

impl EdgeCurves {
    /// The table with the nearest share of motion in the blur's variance.
    pub fn for_motion_share(motion_share: f64) -> &'static Self {
        let far = |i: &usize| (MOTION_SHARES[*i] - motion_share).abs();
        let nearest = (0..MOTION_SHARES.len()).min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(0);
        EDGE_CURVES[nearest].get_or_init(|| Self::new(MOTION_SHARES[nearest]))
    }

    /// Computes a table by numerical integration.
    fn new(motion_share: f64) -> Self {
        let kernel = kernel(motion_share);
        let place = |i: usize| i as f64 / f64::from(STEPS_PER_SIGMA) - f64::from(TABLE_REACH);
        let mean = |of: &dyn Fn(f64) -> f64, z: f64| kernel.iter().map(|(x, weight)| weight * of(z + x)).sum::<f64>();
        let limb: Vec<f64> = (0..=STEPS).map(|i| mean(&|x| (-x).max(0.0).sqrt(), place(i))).collect();
        let at = |i: usize| {
            let z = place(i);
            let (low, high) = (i.saturating_sub(1), (i + 1).min(STEPS));
            let limb_fall = (limb[low] - limb[high]) / (place(high) - place(low));
            let half = 0.5 * KERNEL_STEP; // each kernel point covers this much on both sides
            let share = mean(&|x| (0.5 - x / KERNEL_STEP).clamp(0.0, 1.0), z);
            let density = mean(&|x| if x.abs() < half { 1.0 / KERNEL_STEP } else { 0.0 }, z);
            Lanes([share, limb[i], mean(&|x| x.max(0.0), z), density, limb_fall, 0.0, 0.0, 0.0].map(|c| c as f32))
        };
        let table: Vec<Lanes> = (0..=STEPS).map(at).collect();
        let (mut low, mut rise) = (Box::new([Lanes::ZERO; STEPS]), Box::new([Lanes::ZERO; STEPS]));
        for (i, ends) in table.windows(2).enumerate() {
            (low[i], rise[i]) = (ends[0], ends[1] - ends[0]);
        }
        Self { low, rise }
    }

    /// The interpolated curves at these places.
    #[inline(always)]
    pub fn at(&self, z: Lanes) -> CurveValues {
        // Adding this constant to a number leaves the nearest integer in the last bits: one instruction for all lanes.
        const TO_WHOLE: f32 = 1.5 * (1 << 23) as f32;
        const LAST: f32 = STEPS as f32 - 0.01;
        let at = ((z + TABLE_REACH) * STEPS_PER_SIGMA).at_least(0.0).at_most(LAST);
        let whole = at - 0.5 + TO_WHOLE;
        let part = at - (whole - TO_WHOLE);
        let mut curves = [Lanes::ZERO; 8];
        for lane in 0..LANES {
            let index = whole.0[lane].to_bits() as usize % STEPS;
            let row = self.low[index] + self.rise[index] * part.0[lane];
            for (curve, value) in curves.iter_mut().zip(row.0) {
                curve.0[lane] = value;
            }
        }
        let [share, root, ramp, density, root_fall, ..] = curves;
        let deep = (z * -1.0).at_least(TABLE_REACH).sqrt() - TABLE_REACH.sqrt();
        let far = (z - TABLE_REACH).at_least(0.0);
        [share, root + deep, ramp + far, density, root_fall]
    }
}

const KERNEL_STEP: f64 = 1.0 / 16.0;

/// Points and weights of a Gaussian convolved with a box, with a total variance of 1.
fn kernel(motion_share: f64) -> Vec<(f64, f64)> {
    let (sigma, half_width) = ((1.0 - motion_share).sqrt(), (3.0 * motion_share).sqrt());
    let upper = |x: f64| 0.5 * libm::erfc(x / sigma * std::f64::consts::FRAC_1_SQRT_2);
    let density = |x: f64| {
        if half_width > 0.0 {
            (upper(x - half_width) - upper(x + half_width)) / (2.0 * half_width)
        } else {
            (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt()
        }
    };
    let points: Vec<(f64, f64)> = (-80..=80).map(|k| f64::from(k) * KERNEL_STEP).map(|x| (x, density(x))).collect();
    let sum: f64 = points.iter().map(|p| p.1).sum();
    points.into_iter().map(|(x, weight)| (x, weight / sum)).collect()
}
