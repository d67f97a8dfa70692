//! Learns one number of a recording from evidence on many frames.

/// Estimate of one number learned from a recording: a Kalman filter with one state.
#[derive(Clone, Copy, Debug)]
pub(super) struct ScalarFilter {
    /// Variance of the number now, and before any evidence.
    variance: f64,
    usual_variance: f64,
    gradient: f64,
    information: f64,
}

impl ScalarFilter {
    /// Share of the evidence that is counted: edges of one frame, and of consecutive frames, have similar errors.
    const TRUST: f64 = 0.2;
    /// Number of frames after which the number may have changed by its usual spread.
    const MEMORY: f64 = 20_000.0;

    pub(super) fn new(sigma: f64) -> Self {
        Self { variance: sigma * sigma, usual_variance: sigma * sigma, gradient: 0.0, information: 0.0 }
    }

    /// Adds a gradient and its information to the evidence.
    pub(super) fn add_evidence(&mut self, gradient: f64, information: f64) {
        self.gradient += gradient;
        self.information += information;
    }

    /// The updated number, from the evidence since the last update.
    pub(super) fn update(&mut self, value: f64) -> f64 {
        let (gradient, information) = (std::mem::take(&mut self.gradient), std::mem::take(&mut self.information));
        self.variance = 1.0 / (1.0 / self.variance + Self::TRUST * information);
        let step = self.variance * Self::TRUST * gradient;
        self.variance += self.usual_variance / Self::MEMORY;
        value + step
    }
}
