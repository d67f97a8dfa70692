//! Learns the usual light inside one part of an outline.

use super::edge_fit::{EdgeFit, InsideLight};

/// Usual light inside one part of an outline: the mean of each channel, and the number of edges it was learned from.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct UsualInside {
    pub(super) light: [InsideLight; 3],
    edges: f64,
}

impl UsualInside {
    /// Minimum number of edges to use the light.
    const ENOUGH: f64 = 8.0;
    /// Number of edges in the running mean.
    const MEMORY: f64 = 200.0;

    pub(super) fn known(&self) -> Option<&Self> {
        (self.edges >= Self::ENOUGH).then_some(self)
    }

    pub(super) fn learn(&mut self, fit: &EdgeFit) {
        self.edges = (self.edges + 1.0).min(Self::MEMORY);
        for (mean, seen) in self.light.iter_mut().zip(fit.inside_light()) {
            mean.base += (seen.base - mean.base) / self.edges;
            mean.limb += (seen.limb - mean.limb) / self.edges;
            mean.guessed += (seen.guessed - mean.guessed) / self.edges;
        }
    }
}
