//! A band measured on one frame, and how far that may be believed.

use std::ops::Range;

use crate::pipeline::pose::TubeEstimate;

/// A band measured.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Tube and covariance.
    pub estimate: TubeEstimate,
    /// Length of band that was seen or is known, mm.
    pub length_mm: f64,
    /// How well this frame alone tells that length, mm.
    pub length_sigma_mm: f64,
    /// Share of the outline's probes that found an edge which agrees with the tube.
    pub seen_share: f64,
    /// Every end of the band that is in sight was met.
    pub ends_seen: bool,
    /// How many standard deviations the axis passes beside the fulcrum as the edges alone have it, squared: 0 where no
    /// fulcrum is known.
    pub beside_squared: f64,
    /// How far edges are smeared by motion: standard deviation, pixels.
    pub smear_px: f64,
    /// Which of the edges found on this frame are its own.
    pub edges: Range<usize>,
}

impl Measurement {
    /// Do enough pixels agree with the tube that it may be one at all?
    pub fn is_possible(&self) -> bool {
        self.sharp_residual_px() < 0.8 && self.seen_share > if self.ends_seen { 0.35 } else { 0.5 }
    }

    /// Do the pixels explain the tube so well that no other start need be tried?
    pub fn is_good(&self) -> bool {
        self.estimate.residual_px < 0.4 && self.continues() && self.ends_seen
    }

    /// Are its edges those of a tube, so that they teach how edges look?
    pub fn teaches(&self) -> bool {
        self.continues() && self.ends_seen
    }

    /// What the residual would be about, were nothing smeared.
    fn sharp_residual_px(&self) -> f64 {
        self.estimate.residual_px / (1.0 + 0.4 * self.smear_px)
    }

    /// Do enough pixels agree that a tube that was expected about here goes on?
    pub(super) fn continues(&self) -> bool {
        self.sharp_residual_px() < 0.7 && self.seen_share > 0.55
    }
}
