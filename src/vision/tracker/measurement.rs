//! A band measured on one frame, and how reliable the measurement is.

use std::ops::Range;

use crate::vision::pose::TubeEstimate;

/// A measured band.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Tube and covariance.
    pub estimate: TubeEstimate,
    /// Length of the band, known or as seen, mm.
    pub length_mm: f64,
    /// Standard deviation of the length as measured on this frame alone, mm.
    pub length_sigma_mm: f64,
    /// Share of the outline's probes that found an edge consistent with the tube.
    pub seen_share: f64,
    /// Every visible end of the band was found.
    pub ends_seen: bool,
    /// By how many standard deviations the axis misses the fulcrum, squared, as fitted from the edges alone; 0 if no
    /// fulcrum is known.
    pub fulcrum_miss_squared: f64,
    /// Motion blur of the edges: standard deviation, pixels.
    pub smear_px: f64,
    /// Its edges, as a range of the edges found on this frame.
    pub edges: Range<usize>,
}

impl Measurement {
    /// Do enough pixels agree with the tube that it may be a band at all?
    pub fn is_possible(&self) -> bool {
        self.sharp_residual_px() < 0.8 && self.seen_share > if self.ends_seen { 0.35 } else { 0.5 }
    }

    /// Do the pixels explain the tube so well that no other start need be tried?
    pub fn is_good(&self) -> bool {
        self.estimate.residual_px < 0.4 && self.is_plausible_continuation() && self.ends_seen
    }

    /// Are its edges reliable enough to learn the edge appearance from them?
    pub fn can_teach_edges(&self) -> bool {
        self.is_plausible_continuation() && self.ends_seen
    }

    /// The residual without its expected increase by motion blur.
    fn sharp_residual_px(&self) -> f64 {
        self.estimate.residual_px / (1.0 + 0.4 * self.smear_px)
    }

    /// Do enough pixels agree with a tube that was expected about here?
    pub(super) fn is_plausible_continuation(&self) -> bool {
        self.sharp_residual_px() < 0.7 && self.seen_share > 0.55
    }
}
