//! The measurement of the width method ([`super::PoseMethod::PinholeWidth`]), which uses whole-pixel borders.

use super::band_fit::BandFit;
use super::measurement::Measurement;
use crate::vision::edges::scan_lines::CoarseBand;
use crate::vision::pose::TubeEstimate;
use crate::vision::pose::normal_equations::NormalEquations;
use crate::vision::tube::Tube;

/// Standard deviation of a whole-pixel border, pixels.
const SIGMA_PX: f64 = 0.33;

impl BandFit<'_> {
    /// Measurement by the width method. Its covariance assumes whole-pixel borders.
    pub(super) fn measurement_from_width(&self, tube: Tube, coarse: &CoarseBand) -> Measurement {
        let across = tube.tip.z * SIGMA_PX / self.camera().fx;
        let depth = tube.tip.z * SIGMA_PX * std::f64::consts::SQRT_2 / coarse.width_px;
        let spread = [across * across, across * across, depth * depth, 0.1, 0.1];
        let covariance = nalgebra::Matrix5::from_diagonal(&spread.into());
        Measurement {
            estimate: TubeEstimate {
                tube,
                covariance,
                lasting: covariance,
                equations: NormalEquations::from_covariance(&covariance),
                residual_px: SIGMA_PX,
                support: 1.0,
            },
            length_mm: 0.0,
            length_sigma_mm: 0.0,
            seen_share: 1.0,
            ends_seen: true,
            fulcrum_miss_squared: 0.0,
            smear_px: 0.0,
            continuation: None,
            fitted_edges: Vec::new(),
        }
    }
}
