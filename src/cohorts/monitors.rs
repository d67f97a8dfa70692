//! Charts by their design: their limits take 20 ms to compute, and are the same ever after.

use std::sync::{Arc, Mutex, PoisonError};

use crate::domain::standard::ChartDesign;
use crate::pipeline::score::NoAnswer;
use crate::pipeline::score::lc_cusum::Monitor;

/// Designs that are kept; a centre has one per task at most, and usually one.
const MOST: usize = 32;

/// The charts that were asked for lately.
#[derive(Debug, Default)]
pub struct Monitors(Mutex<Vec<(ChartDesign, Arc<Monitor>)>>);

impl Monitors {
    /// The charts of a design.
    pub fn of(&self, design: ChartDesign) -> Result<Arc<Monitor>, NoAnswer> {
        if let Some((_, known)) = self.kept().iter().find(|(kept, _)| *kept == design) {
            return Ok(known.clone());
        }
        let made = Arc::new(Monitor::new(design.into())?); // not under the lock: two may compute it, alike
        let mut kept = self.kept();
        if kept.len() >= MOST {
            kept.remove(0);
        }
        kept.push((design, made.clone()));
        Ok(made)
    }

    fn kept(&self) -> std::sync::MutexGuard<'_, Vec<(ChartDesign, Arc<Monitor>)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_design_is_computed_once_and_old_ones_are_forgotten() {
        let monitors = Monitors::default();
        let design = |within| ChartDesign { declare_within: within, alarm_within: 10, ..ChartDesign::default() };
        let first = monitors.of(design(20)).unwrap();
        assert!(Arc::ptr_eq(&first, &monitors.of(design(20)).unwrap()));
        assert_eq!(*first, Monitor::new(design(20).into()).unwrap());
        (21..21 + MOST).for_each(|within| drop(monitors.of(design(within)).unwrap()));
        assert!(monitors.kept().len() == MOST && !Arc::ptr_eq(&first, &monitors.of(design(20)).unwrap()));
        assert!(monitors.of(ChartDesign { adequate: 0.4, ..design(20) }).is_err());
    }
}
