//! The path once more, as the tracker could have seen it just as well.
//!
//! **In** one tool's samples with the standard deviations that they state. **Out** the same samples, moved by errors of that
//! size. **Method.** An error has three parts, each with a share of the variance: one that *lasts* through the session (the
//! tape's diameter, the focal length), one that changes over hand's breadths and one that changes over millimetres (what lies
//! behind the tape changes its borders). The latter two are Gaussian processes of the Matérn 3/2 kind, which have a velocity,
//! over a clock that runs with the tool: a tool at rest before a background at rest errs by the same all the time. Along the
//! line of sight and across it errors are independent. How large all of a session's errors are, beside what is stated,
//! is itself a matter of chance.
//!
//! **Source:** autocorrelation of the smoothed path's errors over 29 tools in 19 scenes of three renderers.

use nalgebra::{Matrix2, Vector2, Vector3};

use crate::pipeline::trajectory::Sample;
use crate::random::Dice;

/// Shares of the variance that last, change slowly and pass.
const SHARES: [f64; 3] = [0.25, 0.25, 0.5];
/// Time constants of the slow and the passing part at [`USUAL_MM_S`], s.
const SLOW_S: f64 = 1.0;
const PASSING_S: f64 = 0.07;
/// Speed of a tool whose clock runs with time, mm/s; speed that a tool at rest is taken to have; and how fast the
/// clock runs at most: the smoother does not follow what is faster.
const USUAL_MM_S: f64 = 30.0;
const RESTING_MM_S: f64 = 3.0;
const FASTEST: f64 = 1.5;
/// How large a session's errors are beside what it states, where it is the small motions that count: what is stated is
/// what a place may be off by.
const SIZE: f64 = 1.6;
/// Spread of the size of a session's errors beside what it states: standard deviation of the logarithm.
const SIZE_UNSURE: f64 = 0.3;

/// Nearest to a camera that a tip can be, mm.
const LEAST_DEPTH_MM: f64 = 1.0;

/// A tool's samples, in time order, moved by errors of the size that they state; `None` where one states none, or does not lie before a camera.
pub fn replicate(samples: &[Sample], dice: &mut Dice) -> Option<Vec<Sample>> {
    let size = SIZE * (SIZE_UNSURE * dice.gauss()).exp();
    let mut errors = [(); 3].map(|()| Error::new(dice));
    let mut before: Option<&Sample> = None;
    let mut moved = Vec::with_capacity(samples.len());
    for sample in samples {
        let sigma = Sigma::of(sample)?;
        let rate = before.map_or(1.0, |before| clock_rate(before, sample));
        let passed_s = before.map_or(0.0, |before| rate * (sample.time_s - before.time_s));
        let [x, y, depth] = errors.each_mut().map(|error| size * error.after(passed_s, dice));
        let along = Vector3::new(sample.tip_mm.x, sample.tip_mm.y, sample.tip_mm.z) / sample.tip_mm.z;
        let error = |part: usize| {
            Vector3::new(x[part], y[part], 0.0) * sigma.across_mm + along * (depth[part] * sigma.depth_mm)
        };
        moved.push(Sample {
            tip_mm: sample.tip_mm + error(0),
            velocity_mm_s: sample.velocity_mm_s.map(|velocity| velocity + error(1) * rate),
            ..*sample
        });
        before = Some(sample);
    }
    Some(moved)
}

/// Standard deviations that a sample states.
struct Sigma {
    /// In x and in y, for errors across the line of sight, mm.
    across_mm: f64,
    /// Along it, counted in z, mm.
    depth_mm: f64,
}

impl Sigma {
    fn of(sample: &Sample) -> Option<Self> {
        let (xy_mm, depth_mm) = (sample.sigma_xy_mm?, sample.sigma_z_mm?);
        let tip = sample.tip_mm;
        if tip.z < LEAST_DEPTH_MM {
            return None; // not a camera's path: nobody knows in which direction its errors lie
        }
        let by_depth = depth_mm * depth_mm * (tip.x * tip.x + tip.y * tip.y) / (2.0 * tip.z * tip.z);
        let across_mm = (xy_mm * xy_mm - by_depth).max(0.0).sqrt();
        (across_mm.is_finite() && depth_mm.is_finite() && depth_mm >= 0.0).then_some(Self { across_mm, depth_mm })
    }
}

/// How fast the errors' clock runs between two samples.
fn clock_rate(before: &Sample, after: &Sample) -> f64 {
    let speed_mm_s = after.velocity_mm_s.map_or_else(
        || (after.tip_mm - before.tip_mm).norm() / (after.time_s - before.time_s),
        |velocity| velocity.norm(),
    );
    ((RESTING_MM_S + speed_mm_s) / (RESTING_MM_S + USUAL_MM_S)).min(FASTEST)
}

/// An error of variance 1, in its three parts.
struct Error {
    lasting: f64,
    changing: [Matern; 2],
}

impl Error {
    fn new(dice: &mut Dice) -> Self {
        let changing = [SLOW_S, PASSING_S].map(|constant_s| Matern::new(constant_s, dice));
        Self { lasting: dice.gauss(), changing }
    }

    /// Value and rate, s⁻¹, after the clock has gone on.
    fn after(&mut self, passed_s: f64, dice: &mut Dice) -> Vector2<f64> {
        let [slow, passing] = self.changing.each_mut().map(|part| part.after(passed_s, dice));
        let [of_lasting, of_slow, of_passing] = SHARES.map(f64::sqrt);
        Vector2::new(of_lasting * self.lasting, 0.0) + of_slow * slow + of_passing * passing
    }
}

/// A Gaussian process of variance 1 and of the Matérn 3/2 kind: value and rate (Hartikainen & Särkkä 2010).
struct Matern {
    state: Vector2<f64>,
    /// Inverse time constant, s⁻¹.
    lambda: f64,
}

impl Matern {
    fn new(constant_s: f64, dice: &mut Dice) -> Self {
        let lambda = 1.0 / constant_s;
        Self { state: Vector2::new(dice.gauss(), lambda * dice.gauss()), lambda }
    }

    /// Value and rate a while later: exact, however long that is.
    fn after(&mut self, passed_s: f64, dice: &mut Dice) -> Vector2<f64> {
        let (by, rate) = (self.lambda * passed_s, self.lambda);
        let step = Matrix2::new(1.0 + by, passed_s, -by * rate, 1.0 - by) * (-by).exp();
        let usual = Matrix2::from_diagonal(&Vector2::new(1.0, rate * rate));
        let fresh = Vector2::new(dice.gauss(), dice.gauss());
        let noise = (usual - step * usual * step.transpose()).cholesky();
        self.state = step * self.state + noise.map_or_else(Vector2::zeros, |noise| noise.l() * fresh);
        self.state
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::pipeline::trajectory::SampleState;

    #[test]
    fn a_path_that_does_not_lie_before_a_camera_has_no_replicates() {
        let mut dice = Dice::new(1, "errors");
        let about_a_board = |z_mm: f64| {
            let sample = at(0.0, 0.0);
            Sample { tip_mm: Point3::new(50.0, 0.0, z_mm), sigma_xy_mm: Some(0.1), sigma_z_mm: Some(0.5), ..sample }
        };
        assert!(replicate(&[about_a_board(120.0)], &mut dice).is_some());
        for z_mm in [0.0, -5.0, 0.5] {
            assert_eq!(replicate(&[about_a_board(z_mm)], &mut dice), None, "{z_mm}");
        }
    }

    fn at(time_s: f64, speed_mm_s: f64) -> Sample {
        Sample {
            frame: 0,
            time_s,
            tool: 0,
            tip_mm: Point3::new(40.0, -20.0, 200.0),
            velocity_mm_s: Some(Vector3::new(speed_mm_s, 0.0, 0.0)),
            axis: None,
            tip_px: None,
            sigma_xy_mm: Some(0.2),
            sigma_z_mm: Some(0.8),
            state: SampleState::Observed,
        }
    }

    fn path(speed_mm_s: f64) -> Vec<Sample> {
        (0..4000).map(|k| at(0.02 * f64::from(k), speed_mm_s)).collect()
    }

    #[test]
    fn errors_are_as_large_as_stated() {
        let (mut z, mut xy, mut n) = (0.0, 0.0, 0.0);
        for seed in 0..200 {
            let dice = &mut Dice::new(seed, "replicate");
            let moved = replicate(&path(60.0), dice).unwrap();
            for (moved, was) in moved.iter().zip(path(60.0)).step_by(50) {
                let error = moved.tip_mm - was.tip_mm;
                (z, xy, n) = (z + error.z.powi(2), xy + 0.5 * error.xy().norm_squared(), n + 1.0);
            }
        }
        let by_size = (2.0 * SIZE_UNSURE * SIZE_UNSURE).exp(); // mean square of a log-normal
        let [z, xy] = [z, xy].map(|sum: f64| (sum / n / by_size).sqrt() / SIZE);
        assert!((z / 0.8 - 1.0).abs() < 0.12 && (xy / 0.2 - 1.0).abs() < 0.12, "{z} {xy}");
    }

    #[test]
    fn velocities_are_those_of_the_moved_path() {
        const STEP_S: f64 = 0.002;
        let path: Vec<Sample> = (0..4000).map(|k| at(STEP_S * f64::from(k), 60.0)).collect();
        let moved = replicate(&path, &mut Dice::new(5, "replicate")).unwrap();
        let (mut off, mut all) = (0.0, 0.0);
        for pair in moved.windows(2) {
            let slope = (pair[1].tip_mm - pair[0].tip_mm) / STEP_S;
            let stated =
                (pair[0].velocity_mm_s.unwrap() + pair[1].velocity_mm_s.unwrap()) / 2.0 - Vector3::new(60.0, 0.0, 0.0);
            off += (slope - stated).norm_squared();
            all += slope.norm_squared();
        }
        assert!(off < 0.02 * all, "{}", off / all);
    }

    #[test]
    fn a_tool_at_rest_errs_by_nearly_the_same_all_the_time() {
        let speed = |mm_s: f64| {
            let moved = replicate(&path(mm_s), &mut Dice::new(9, "replicate")).unwrap();
            let own = Vector3::new(mm_s, 0.0, 0.0);
            moved.iter().map(|sample| (sample.velocity_mm_s.unwrap() - own).norm()).sum::<f64>() / moved.len() as f64
        };
        assert!(speed(0.0) < 0.15 * speed(30.0), "{} {}", speed(0.0), speed(30.0));
    }

    #[test]
    fn a_path_that_states_no_errors_has_no_replicates() {
        let mut path = path(0.0);
        path[7].sigma_z_mm = None;
        assert_eq!(replicate(&path, &mut Dice::new(1, "replicate")), None);
    }
}
