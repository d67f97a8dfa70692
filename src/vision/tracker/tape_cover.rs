//! Checks a fitted tube against the tape's colour.

use super::band_fit::BandFit;
use crate::vision::space::CameraPoint;
use crate::vision::tube::{Outline, Tube};

/// Tape at one distance behind the tip.
#[derive(Clone, Copy, Default)]
struct TapeCount {
    /// Points with the tape's colour.
    tape: usize,
    /// Points in sight.
    seen: usize,
}

impl BandFit<'_> {
    /// Is there tape all along the band, and none beyond its distal end? Edges alone cannot decide this: the shaft's
    /// edges also fit a band one length too far back, and a band hidden in its middle also fits at half the distance.
    pub(super) fn covers_tape(&self, tube: &Tube, length_mm: f64) -> bool {
        const MIN_INSIDE: f64 = 0.4;
        const MAX_BEYOND: f64 = 0.6;
        const MAX_BARE: usize = 1; // may be glare
        let Some(outline) = tube.outline() else { return false };
        let inside = self.count_tape_at(&outline, [0.2, 0.35, 0.5, 0.65, 0.8].map(|part| part * length_mm));
        let beyond = self.count_tape_at(&outline, [0.2, 0.3, 0.4, 0.5, 0.6].map(|part| -part * length_mm));
        let bare = inside.iter().filter(|place| place.seen >= 2 && place.tape == 0).count();
        bare <= MAX_BARE
            && tape_share(&inside).is_none_or(|share| share >= MIN_INSIDE)
            && tape_share(&beyond).is_none_or(|share| share <= MAX_BEYOND)
    }

    /// Checks three points across the tube's near side at each distance behind the tip.
    fn count_tape_at(&self, outline: &Outline, backs_mm: [f64; 5]) -> [TapeCount; 5] {
        backs_mm.map(|back_mm| {
            let places = [-0.5, 0.0, 0.5].map(|across| outline.rim(back_mm, across));
            let pixel = |place| self.camera().project(CameraPoint(place));
            let in_sight =
                places.into_iter().filter_map(|place| pixel(place).filter(|at| self.scene.is_visible(place, *at)));
            in_sight.fold(TapeCount::default(), |count, at| {
                let is_tape = self.scene.class_at(at.u().round(), at.v().round()) == self.class;
                TapeCount { tape: count.tape + usize::from(is_tape), seen: count.seen + 1 }
            })
        })
    }
}

/// Share of the tape's colour among the points in sight; `None` if too few are in sight.
fn tape_share(places: &[TapeCount]) -> Option<f64> {
    const MIN_IN_SIGHT: usize = 4;
    let (tape, seen) = places.iter().fold((0, 0), |sum, place| (sum.0 + place.tape, sum.1 + place.seen));
    (seen >= MIN_IN_SIGHT).then(|| tape as f64 / seen as f64)
}
