//! Estimates the length of a band that was not measured by hand, from views of its two ends.

/// The views so far: each has a length and its standard deviation, mm.
#[derive(Default)]
pub struct BandLengthEstimator {
    views_mm: Vec<(f64, f64)>,
}

impl BandLengthEstimator {
    /// Number of views that are needed, and number that are kept.
    const MIN_VIEWS: usize = 12;
    const MAX_VIEWS: usize = 64;
    /// Number of views whose errors count as independent: neighbouring frames have similar errors.
    const INDEPENDENT_VIEWS: f64 = 3.0;

    /// Adds a view. Once [`Self::MAX_VIEWS`] are kept, it replaces the least certain one if it is more certain.
    pub fn add(&mut self, length_mm: f64, sigma_mm: f64) {
        if self.views_mm.len() < Self::MAX_VIEWS {
            self.views_mm.push((length_mm, sigma_mm));
        } else if let Some(worst) = self.views_mm.iter_mut().max_by(|a, b| a.1.total_cmp(&b.1))
            && sigma_mm < worst.1
        {
            *worst = (length_mm, sigma_mm);
        }
    }

    /// The median length, weighted by the certainty of each view, with its standard deviation, mm.
    pub fn estimate(&self) -> Option<(f64, f64)> {
        if self.views_mm.len() < Self::MIN_VIEWS {
            return None;
        }
        let mut sorted = self.views_mm.clone();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let weight = |view: &(f64, f64)| 1.0 / (view.1 * view.1);
        let all: f64 = sorted.iter().map(weight).sum();
        let at = |share: f64| {
            let mut sum = 0.0;
            let reached = sorted.iter().find(|view| {
                sum += weight(view);
                sum >= share * all
            });
            reached.map_or(0.0, |view| view.0)
        };
        let by_views = (sorted.len() as f64 / all / Self::INDEPENDENT_VIEWS).sqrt();
        Some((at(0.5), (0.5 * (at(0.84) - at(0.16))).max(by_views).max(0.01 * at(0.5))))
    }
}
