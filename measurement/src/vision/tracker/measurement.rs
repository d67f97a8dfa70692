//! A band measured on one frame, and how far the pixels support the measurement.

use crate::vision::edges::probe::FittedEdge;
use crate::vision::edges::shaft::Continuation;
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
    /// Where the borders of its band go on; `None` if this was not looked at.
    pub continuation: Option<Continuation>,
    /// The edges found in the last pass, to learn from.
    pub fitted_edges: Vec<FittedEdge>,
}

/// How far the pixels support a measurement, from worst to best. Each grade includes those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// Too few pixels agree with the tube: it is no band.
    Impossible,
    /// Enough pixels agree that it may be a band.
    Possible,
    /// Enough pixels agree with a tube that was expected about here.
    Plausible,
    /// Also every visible end was found, so the tube cannot have slid along its axis: its edges may be learned from.
    Complete,
    /// The pixels agree so well that no other start need be tried.
    Good,
}

/// Maximum residual of a possible band, pixels: about that of edges located as plain steps (0.7), hence without a
/// model of blur and light.
const MAX_POSSIBLE_RESIDUAL_PX: f64 = 0.8;
/// Minimum share of the outline that agrees: with both ends, a third is enough.
const MIN_POSSIBLE_SHARE: f64 = 0.35;
/// The same while an end is missing: the borders alone also fit a tube that slid along its axis, so half must agree.
const MIN_POSSIBLE_SHARE_WITHOUT_END: f64 = 0.5;
/// Maximum residual of a tube at its expected place, pixels: not above that of edges located as plain steps.
const MAX_PLAUSIBLE_RESIDUAL_PX: f64 = 0.7;
/// Minimum share of its outline that agrees: a majority, so that no other tube explains as much of it.
const MIN_PLAUSIBLE_SHARE: f64 = 0.55;
/// Maximum residual of a good fit, pixels. Below half a pixel, each edge is nearer to the tube than a plain step could
/// show.
const MAX_GOOD_RESIDUAL_PX: f64 = 0.4;
/// Increase of the residual per pixel of motion blur, as a share: the wider an edge, the less precise its place.
const RESIDUAL_PER_SMEAR: f64 = 0.4;

impl Measurement {
    /// How far the pixels support it.
    pub fn grade(&self) -> Grade {
        if !self.is_plausible() {
            return if self.is_possible() { Grade::Possible } else { Grade::Impossible };
        }
        match self.ends_seen {
            false => Grade::Plausible,
            true if self.estimate.residual_px < MAX_GOOD_RESIDUAL_PX => Grade::Good,
            true => Grade::Complete,
        }
    }

    /// How likely it is a tool's band, to compare candidates: the share of its outline that agrees, and whether a tube
    /// continues beyond its proximal end only.
    pub fn likelihood(&self) -> f64 {
        const UNKNOWN: f64 = 0.5;
        let tube = |share: Option<f64>| share.unwrap_or(UNKNOWN);
        self.seen_share + self.continuation.map_or(0.0, |beyond| tube(beyond.by_hand) - tube(beyond.by_tip))
    }

    /// The likelier of two; the first if they are equally likely.
    pub fn likelier(first: Self, second: Self) -> Self {
        if second.likelihood() > first.likelihood() { second } else { first }
    }

    /// Is it so likely a tool's band that it needs no comparison with others? Most of its outline agrees, and a tube
    /// continues beyond its proximal end only.
    pub fn is_clear(&self) -> bool {
        const CLEAR_LIKELIHOOD: f64 = 1.5;
        self.likelihood() > CLEAR_LIKELIHOOD
    }

    /// Do the pixels show that no tube holds the band? Then it is a thing of the tape's colour, or lies the wrong way
    /// round.
    pub fn is_without_shaft(&self) -> bool {
        const MIN_BY_HAND: f64 = 0.15;
        self.continuation.is_some_and(|beyond| beyond.by_hand.is_some_and(|share| share < MIN_BY_HAND))
    }

    fn is_possible(&self) -> bool {
        let min_share = if self.ends_seen { MIN_POSSIBLE_SHARE } else { MIN_POSSIBLE_SHARE_WITHOUT_END };
        self.sharp_residual_px() < MAX_POSSIBLE_RESIDUAL_PX && self.seen_share > min_share
    }

    fn is_plausible(&self) -> bool {
        self.sharp_residual_px() < MAX_PLAUSIBLE_RESIDUAL_PX && self.seen_share > MIN_PLAUSIBLE_SHARE
    }

    /// The residual without its expected increase by motion blur.
    fn sharp_residual_px(&self) -> f64 {
        self.estimate.residual_px / (1.0 + RESIDUAL_PER_SMEAR * self.smear_px)
    }
}
