//! Measure: fits a tube to a tool's band, at its predicted position or in a region of its colour.
//!
//! Measuring changes nothing. What it collects for learning is returned in the [`Measurement`], and what it collects
//! for the trace in the [`Attempt`].

use nalgebra::{Vector2, Vector3};

use super::band_fit::BandFit;
use super::frame_context::FrameContext;
use super::measurement::Measurement;
use super::predict::{Band, Prediction};
use super::settings::PoseMethod;
use super::tool::ToolTracker;
use super::trace::FitTrace;
use crate::vision::blob::components::Component;
use crate::vision::blob::select;
use crate::vision::camera::Camera;
use crate::vision::reason::MissReason;
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::tube::Tube;

/// An attempt to measure a band at one place.
pub struct Attempt<T> {
    /// The measurement, or why there is none.
    pub outcome: T,
    /// The fits that were tried; empty unless a trace was requested.
    pub fits: Vec<FitTrace>,
}

/// An attempt to measure the band in a region.
pub type RegionAttempt = Attempt<Result<Measurement, MissReason>>;

impl ToolTracker {
    /// Measures the tool at its predicted position from edges alone, without a colour search. The measurement counts
    /// only if it continues the track.
    pub(super) fn measure_at_prediction(
        &self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
    ) -> Attempt<Option<Measurement>> {
        let Some(band) = &prediction.band else { return Attempt { outcome: None, fits: Vec::new() } };
        let Attempt { outcome, fits } = self.band_fit(scene, prediction).follow(band);
        Attempt { outcome: outcome.filter(|found| self.continues_track(scene, found)), fits }
    }

    /// Measures a region as one band. Without a direction to the hand, the picture alone decides which end is the tip.
    pub(super) fn measure_region(
        &self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        region: &Component,
        to_hand: Option<Vector2<f64>>,
    ) -> RegionAttempt {
        match select::check_shape(region) {
            Err(reason) => Attempt { outcome: Err(reason), fits: Vec::new() },
            Ok(rectangle) => self.band_fit(scene, prediction).measure(&rectangle, is_hand_first(to_hand)),
        }
    }

    /// Measures a region as one band, and where that is not clear, as a band beside things of its colour. Not for two
    /// tools of one colour: the region's box may hold the other tool's band.
    pub(super) fn measure_region_of_own_colour(
        &self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        region: &Component,
        to_hand: Option<Vector2<f64>>,
    ) -> RegionAttempt {
        let mut whole = self.measure_region(scene, prediction, region, to_hand);
        let is_settled = match &whole.outcome {
            Ok(found) => found.is_clear(),
            Err(reason) => *reason == MissReason::TooSmall,
        };
        if is_settled || scene.settings.pose == PoseMethod::PinholeWidth {
            return whole;
        }
        let inside = self.band_fit(scene, prediction).measure_inside(region.bounds, is_hand_first(to_hand));
        whole.fits.extend(inside.fits);
        whole.outcome = match (whole.outcome, inside.outcome) {
            (Ok(one), Ok(other)) => Ok(Measurement::likelier(one, other)),
            (one, other) => other.or(one),
        };
        whole
    }

    /// The measurement, with where the borders of its band go on.
    pub(super) fn with_continuation(
        &self,
        scene: &FrameContext<'_>,
        prediction: &Prediction,
        found: Measurement,
    ) -> Measurement {
        self.band_fit(scene, prediction).with_continuation(found)
    }

    /// Length of the band and its standard deviation, mm, once known. A bare shaft has no end on the hand's side.
    fn known_length(&self) -> Option<(f64, f64)> {
        let of_band = || self.spec.band_length_mm().map(|known| (known, 0.0)).or_else(|| self.lengths.estimate());
        if self.spec.is_bare() { None } else { of_band() }
    }

    pub(super) fn band_fit<'a>(&'a self, scene: &'a FrameContext<'a>, prediction: &Prediction) -> BandFit<'a> {
        BandFit {
            scene,
            class: self.class,
            spec: &self.spec,
            length: self.known_length(),
            motion_px_s: prediction.motion_px_s,
            fulcrum: self.fulcrum(),
            last_depth_mm: self.last_band.map(|band| band.tube.tip.z),
            edges: &self.edges,
            is_traced: self.trace.is_recording(),
        }
    }

    /// Direction in the picture from the tip to the hand, if known: from the last tube towards the fulcrum, else
    /// opposite to its axis; without a last tube, by the votes of earlier frames.
    pub(super) fn direction_to_hand(&self, camera: &Camera, prediction: &Prediction) -> Option<Vector2<f64>> {
        let Some(Band { tube: last, .. }) = self.last_band else { return self.hand_direction.direction() };
        let to_hand = self.fulcrum().and_then(|fulcrum| (fulcrum.at - last.tip).try_normalize(1e-9));
        let to_hand = to_hand.or(prediction.band.map(|band| -band.tube.axis));
        to_hand.map_or(self.hand_direction.direction(), |to_hand| direction_in_picture(camera, &last, to_hand))
    }
}

/// Returns whether the first of two ends lies nearer to the hand, if the direction to it is known.
fn is_hand_first(to_hand: Option<Vector2<f64>>) -> impl Fn(Pixel, Pixel) -> Option<bool> {
    move |first, second| to_hand.map(|direction| (first.0 - second.0).dot(&direction) > 0.0)
}

/// A direction from a tube's tip, projected into the picture.
pub(super) fn direction_in_picture(camera: &Camera, tube: &Tube, direction: Vector3<f64>) -> Option<Vector2<f64>> {
    const STEP_MM: f64 = 5.0;
    let pixel = |point| camera.project(CameraPoint(point));
    Some(pixel(tube.tip + direction * STEP_MM)?.0 - pixel(tube.tip)?.0)
}
