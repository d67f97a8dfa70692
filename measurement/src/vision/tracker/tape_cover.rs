//! Checks a fitted tube against the tape's colour.

use nalgebra::{Vector2, Vector3};

use super::band_fit::BandFit;
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::tube::{Outline, Tube};

/// Tape at one distance behind the tip.
#[derive(Clone, Copy, Default)]
struct TapeCount {
    /// Points with the tape's colour.
    tape: usize,
    /// Points in sight.
    seen: usize,
}

/// Least number of points in sight that show a colour.
const MIN_IN_SIGHT: usize = 4;

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

    /// Does the part behind the proximal end have the band's colour? Then a tube whose end was not found is a piece of a
    /// wider band: the border of the gloss along its middle looks like a border of the band.
    pub(super) fn has_tape_behind(&self, tube: &Tube, length_mm: f64) -> bool {
        /// Largest difference of the mean codes, as a share of the tape's chroma: the colour is nearer to the tape's than
        /// to a grey that is as light as the tape.
        const MAX_DIFFERENCE: f64 = 0.5;
        const GREY: Vector2<f64> = Vector2::new(128.0, 128.0);
        let colour = |parts: [f64; 5]| self.mean_colour(&tube.outline()?, parts.map(|part| part * length_mm));
        let Some(inside) = colour([0.2, 0.35, 0.5, 0.65, 0.8]) else { return false };
        let Some(behind) = colour([1.2, 1.3, 1.4, 1.5, 1.6]) else { return false };
        (behind - inside).norm() < MAX_DIFFERENCE * (inside.yz() - GREY).norm()
    }

    /// Mean codes of the points in sight; `None` if too few are.
    fn mean_colour(&self, outline: &Outline, backs_mm: [f64; 5]) -> Option<Vector3<f64>> {
        let points = backs_mm.into_iter().flat_map(|back_mm| self.in_sight_across(outline, back_mm));
        let codes: Vec<[u8; 3]> = points.map(|at| self.scene.codes_at(at.u().round(), at.v().round())).collect();
        let sum: Vector3<f64> = codes.iter().map(|codes| Vector3::from(codes.map(f64::from))).sum();
        (codes.len() >= MIN_IN_SIGHT).then(|| sum / codes.len() as f64)
    }

    /// Checks three points across the tube's near side at each distance behind the tip.
    fn count_tape_at(&self, outline: &Outline, backs_mm: [f64; 5]) -> [TapeCount; 5] {
        backs_mm.map(|back_mm| {
            self.in_sight_across(outline, back_mm).fold(TapeCount::default(), |count, at| {
                let is_tape = self.scene.class_at(at.u().round(), at.v().round()) == self.class;
                TapeCount { tape: count.tape + usize::from(is_tape), seen: count.seen + 1 }
            })
        })
    }

    /// Those of three points across the tube's near side that are in sight.
    fn in_sight_across(&self, outline: &Outline, back_mm: f64) -> impl Iterator<Item = Pixel> {
        [-0.5, 0.0, 0.5].into_iter().filter_map(move |across| {
            let place = outline.rim(back_mm, across);
            self.camera().project(CameraPoint(place)).filter(|at| self.scene.is_visible(place, *at))
        })
    }
}

/// Share of the tape's colour among the points in sight; `None` if too few are in sight.
fn tape_share(places: &[TapeCount]) -> Option<f64> {
    let (tape, seen) = places.iter().fold((0, 0), |sum, place| (sum.0 + place.tape, sum.1 + place.seen));
    (seen >= MIN_IN_SIGHT).then(|| tape as f64 / seen as f64)
}
