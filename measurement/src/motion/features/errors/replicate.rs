//! Replicates of a path: the same path as the tracker could have seen it just as well.
//!
//! **In:** one tool's samples with the covariances that they state. **Out:** the same samples, moved by random
//! errors of that size. **Method:** an error has three parts, each with a share of the variance. The *lasting* part is
//! constant through the session (the tape's diameter, the focal length). The *slow* part changes over a few centimetres
//! of motion and the *passing* part over millimetres (the background behind the tape shifts its borders). The last two
//! are Gaussian processes of the Matérn 3/2 kind, which have a velocity. They change with the tool's motion, not with
//! time alone ([`clock_rate`]): at rest, in front of a resting background, an error changes eleven times more slowly
//! than at [`REFERENCE_SPEED_MM_S`]. The error of depth and two errors across it are independent; the stated
//! covariance says how far each of them moves the tip in x, y and z ([`PositionCovariance::factor`]). The size of a
//! session's errors relative to the stated size is random as well.
//!
//! **Source:** autocorrelation of the smoothed path's errors over 29 tools in 19 scenes of three renderers.

use nalgebra::{Matrix2, Vector2, Vector3};

use crate::random::Dice;
use crate::vision::covariance::PositionCovariance;
use crate::vision::trajectory::Sample;

/// Shares of the variance of the lasting, the slow and the passing part.
const VARIANCE_SHARES: [f64; 3] = [0.86, 0.05, 0.09];
/// Time constant of the slow part at [`REFERENCE_SPEED_MM_S`], s.
const SLOW_S: f64 = 1.0;
/// Time constant of the passing part at the same speed, s.
const PASSING_S: f64 = 0.07;
/// Tool speed at which the two time constants hold, mm/s.
const REFERENCE_SPEED_MM_S: f64 = 30.0;
/// Speed that a tool at rest is assumed to have, mm/s.
const RESTING_SPEED_MM_S: f64 = 3.0;
/// Maximum of [`clock_rate`]: the smoother does not follow faster changes.
const MAX_CLOCK_RATE: f64 = 1.5;
/// Spread of that relative size between sessions: standard deviation of its logarithm.
const ERROR_SCALE_SPREAD: f64 = 0.3;

/// Minimum depth of a tip in front of the camera, mm.
const MIN_DEPTH_MM: f64 = 1.0;

/// A tool's samples, in time order, moved by errors of the size that they state. `None` if a sample states no errors or
/// does not lie in front of a camera.
pub fn replicate(samples: &[Sample], dice: &mut Dice) -> Option<Vec<Sample>> {
    let size = (ERROR_SCALE_SPREAD * dice.gauss()).exp();
    let mut errors = [(); 3].map(|()| UnitError::new(dice));
    let mut before: Option<&Sample> = None;
    let mut moved = Vec::with_capacity(samples.len());
    for sample in samples {
        let factor = stated_error(sample)?.factor() * size;
        let rate = before.map_or(1.0, |before| clock_rate(before, sample));
        let passed_s = before.map_or(0.0, |before| rate * (sample.time_s - before.time_s));
        let [x, y, depth] = errors.each_mut().map(|error| error.advance(passed_s, dice));
        let error = |part: usize| factor * Vector3::new(x[part], y[part], depth[part]);
        moved.push(Sample {
            tip_mm: sample.tip_mm + error(0),
            velocity_mm_s: sample.velocity_mm_s.map(|velocity| velocity + error(1) * rate),
            ..*sample
        });
        before = Some(sample);
    }
    Some(moved)
}

/// The covariance that a sample states; `None` if it states none, or if it does not lie in front of a camera.
fn stated_error(sample: &Sample) -> Option<PositionCovariance> {
    sample.covariance_mm2.filter(|stated| sample.tip_mm.z >= MIN_DEPTH_MM && stated.is_valid())
}

/// How fast errors change between two samples, relative to [`REFERENCE_SPEED_MM_S`]: faster for a faster tool.
fn clock_rate(before: &Sample, after: &Sample) -> f64 {
    let speed_mm_s = after.velocity_mm_s.map_or_else(
        || (after.tip_mm - before.tip_mm).norm() / (after.time_s - before.time_s),
        |velocity| velocity.norm(),
    );
    ((RESTING_SPEED_MM_S + speed_mm_s) / (RESTING_SPEED_MM_S + REFERENCE_SPEED_MM_S)).min(MAX_CLOCK_RATE)
}

/// An error of variance 1 with its three parts.
struct UnitError {
    lasting: f64,
    changing: [MaternProcess; 2],
}

impl UnitError {
    fn new(dice: &mut Dice) -> Self {
        let changing = [SLOW_S, PASSING_S].map(|constant_s| MaternProcess::new(constant_s, dice));
        Self { lasting: dice.gauss(), changing }
    }

    /// Advances the error by `passed_s` and returns value and rate, s⁻¹.
    fn advance(&mut self, passed_s: f64, dice: &mut Dice) -> Vector2<f64> {
        let [slow, passing] = self.changing.each_mut().map(|part| part.advance(passed_s, dice));
        let [of_lasting, of_slow, of_passing] = VARIANCE_SHARES.map(f64::sqrt);
        Vector2::new(of_lasting * self.lasting, 0.0) + of_slow * slow + of_passing * passing
    }
}

/// A Gaussian process of variance 1 of the Matérn 3/2 kind: value and rate (Hartikainen & Särkkä 2010).
struct MaternProcess {
    state: Vector2<f64>,
    /// Inverse time constant, s⁻¹.
    lambda: f64,
}

impl MaternProcess {
    fn new(constant_s: f64, dice: &mut Dice) -> Self {
        let lambda = 1.0 / constant_s;
        Self { state: Vector2::new(dice.gauss(), lambda * dice.gauss()), lambda }
    }

    /// Advances the process by `passed_s` and returns value and rate; exact for any duration.
    fn advance(&mut self, passed_s: f64, dice: &mut Dice) -> Vector2<f64> {
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
    use nalgebra::{Matrix3, Point3};

    use super::*;
    use crate::vision::trajectory::SampleState;

    #[test]
    fn a_path_that_does_not_lie_before_a_camera_has_no_replicates() {
        let mut dice = Dice::new(1, "errors");
        let about_a_board = |z_mm: f64| {
            let sample = at(0.0, 0.0);
            Sample { tip_mm: Point3::new(50.0, 0.0, z_mm), ..sample }
        };
        assert!(replicate(&[about_a_board(120.0)], &mut dice).is_some());
        for z_mm in [0.0, -5.0, 0.5] {
            assert_eq!(replicate(&[about_a_board(z_mm)], &mut dice), None, "{z_mm}");
        }
    }

    const TIP: Point3<f64> = Point3::new(40.0, -20.0, 200.0);

    /// Errors of 0.8 mm in depth, along the line of sight, and of 0.1 mm across it.
    fn stated() -> PositionCovariance {
        let along = TIP.coords / TIP.z * 0.8;
        (along * along.transpose() + Matrix3::from_diagonal(&Vector3::new(0.01, 0.01, 0.0))).into()
    }

    fn at(time_s: f64, speed_mm_s: f64) -> Sample {
        Sample {
            frame: 0,
            time_s,
            tool: 0,
            tip_mm: TIP,
            velocity_mm_s: Some(Vector3::new(speed_mm_s, 0.0, 0.0)),
            axis: None,
            tip_px: None,
            covariance_mm2: Some(stated()),
            state: SampleState::Observed,
        }
    }

    fn path(speed_mm_s: f64) -> Vec<Sample> {
        (0..4000).map(|k| at(0.02 * f64::from(k), speed_mm_s)).collect()
    }

    #[test]
    fn errors_have_the_stated_covariance() {
        let (mut sum, mut n) = (Matrix3::zeros(), 0.0);
        for seed in 0..200 {
            let dice = &mut Dice::new(seed, "replicate");
            let moved = replicate(&path(60.0), dice).unwrap();
            for (moved, was) in moved.iter().zip(path(60.0)).step_by(50) {
                let error = moved.tip_mm - was.tip_mm;
                (sum, n) = (sum + error * error.transpose(), n + 1.0);
            }
        }
        let by_size = (2.0 * ERROR_SCALE_SPREAD * ERROR_SCALE_SPREAD).exp(); // mean square of a log-normal
        let (found, stated) = (sum / (n * by_size), stated().matrix());
        let sigma = stated.diagonal().map(f64::sqrt);
        let off = (found - stated).component_div(&(sigma * sigma.transpose()));
        assert!(off.amax() < 0.24, "{found} {stated}");
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
        path[7].covariance_mm2 = None;
        assert_eq!(replicate(&path, &mut Dice::new(1, "replicate")), None);
    }
}
