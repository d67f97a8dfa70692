//! Tracks one tool through a recording: predict, find the band, measure, accept or reject, learn.

use nalgebra::{Vector2, Vector3};

use super::hand::Hand;
use super::measure::Bench;
use super::measurement::Measurement;
use super::origin::{self, Origin};
use super::record::{PackedRecords, Record};
use super::settings::{MotionSettings, Side, ToolSpec, TrackerSettings};
use super::trace::Tracing;
use crate::pipeline::blob::components::{Component, ComponentFinder};
use crate::pipeline::blob::moments::Moments;
use crate::pipeline::blob::{join, select};
use crate::pipeline::camera::Camera;
use crate::pipeline::edges::edge_model::EdgeModel;
use crate::pipeline::edges::shaft;
use crate::pipeline::filter::identity::{Advance, Thread, ThreadSettings};
use crate::pipeline::frame::Frame;
use crate::pipeline::pose::adjustment::{self, Adjustment};
use crate::pipeline::pose::fulcrum::Fulcrum;
use crate::pipeline::pose::{KeptPose, TubeEstimate};
use crate::pipeline::reason::Reason;
use crate::pipeline::segmentation::colour_table::ColourTable;
use crate::pipeline::segmentation::region_of_interest::{CellBox, coarse_search};
use crate::pipeline::space::CameraPoint;
use crate::pipeline::tube::{Outline, Tube};

/// Tracker of one tool.
pub struct ToolTracker {
    pub(super) spec: ToolSpec,
    class: u8,
    finder: ComponentFinder,
    pub(super) edges: EdgeModel,
    thread: Thread,
    last: Option<(Tube, f64)>,
    hand: Hand,
    adjustment: Option<Adjustment>,
    keyframes: Vec<TubeEstimate>,
    lengths: BandLengths,
    motion_px_s: Vector2<f64>,
    pub(super) last_pose: Option<TubeEstimate>,
    pub(super) records: PackedRecords,
    pub(super) tracing: Tracing,
}

/// Everything a tool's tracker needs of one frame.
pub struct Scene<'a> {
    /// The frame.
    pub frame: &'a Frame<'a>,
    /// The class of every colour.
    pub table: &'a ColourTable,
    /// Camera and tracking methods.
    pub settings: &'a TrackerSettings,
    /// Expected outlines of the other tools.
    pub obstacles: &'a [Outline],
}

/// Estimates the length of a band that was not measured by hand, from views of its two ends. Each view has a length
/// and its standard deviation, mm.
#[derive(Default)]
struct BandLengths {
    seen_mm: Vec<(f64, f64)>,
}

impl BandLengths {
    /// Number of views that are needed, and number that are kept.
    const ENOUGH: usize = 12;
    const MOST: usize = 64;
    /// Number of views whose errors count as independent: neighbouring frames have similar errors.
    const INDEPENDENT: f64 = 3.0;

    /// Adds a view. Once [`Self::MAX_VIEWS`] are kept, it replaces the least certain one if it is more certain.
    fn add(&mut self, length_mm: f64, sigma_mm: f64) {
        if self.seen_mm.len() < Self::MOST {
            self.seen_mm.push((length_mm, sigma_mm));
        } else if let Some(worst) = self.seen_mm.iter_mut().max_by(|a, b| a.1.total_cmp(&b.1))
            && sigma_mm < worst.1
        {
            *worst = (length_mm, sigma_mm);
        }
    }

    /// The median length, weighted by the certainty of each view, with its standard deviation, mm.
    fn learned(&self) -> Option<(f64, f64)> {
        if self.seen_mm.len() < Self::ENOUGH {
            return None;
        }
        let mut sorted = self.seen_mm.clone();
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
        let by_views = (sorted.len() as f64 / all / Self::INDEPENDENT).sqrt();
        Some((at(0.5), (0.5 * (at(0.84) - at(0.16))).max(by_views).max(0.01 * at(0.5))))
    }
}

/// Result of one frame for one tool.
pub struct Seen {
    /// The steadied measurement, or the reason for having none.
    pub outcome: Result<Measurement, Reason>,
    /// How the track advanced.
    pub advance: Advance,
}

/// The causal adjustment is computed from this many poses, and again each time their number has doubled. At the
/// maximum every second pose is dropped.
const FEWEST_KEYFRAMES: usize = 16;
const MOST_KEYFRAMES: usize = 128;

/// The fulcrum is used only once its standard deviation is below this, mm; a less certain one would mislead.
const FULCRUM_SIGMA_MM: f64 = 30.0;

impl ToolTracker {
    pub(super) fn new(spec: ToolSpec, class: u8, edges: EdgeModel) -> Self {
        Self {
            spec,
            class,
            finder: ComponentFinder::default(),
            edges,
            thread: Thread::default(),
            last: None,
            hand: Hand::default(),
            adjustment: None,
            keyframes: Vec::new(),
            lengths: BandLengths::default(),
            motion_px_s: Vector2::zeros(),
            last_pose: None,
            records: PackedRecords::default(),
            tracing: Tracing::default(),
        }
    }

    /// Forgets the tool's position, but keeps the edge appearance, the band length and the direction to the hand.
    pub(super) fn start_over(&mut self) {
        let fresh = Self::new(self.spec.clone(), self.class, self.edges.clone());
        let Self { finder, lengths, hand, .. } = std::mem::replace(self, fresh);
        (self.finder, self.lengths, self.hand) = (finder, lengths, hand);
    }

    /// Finds and measures the tool on a frame.
    pub(super) fn observe(&mut self, scene: &Scene<'_>) -> Seen {
        let expected = self.expect(scene);
        let measured = match self.follow(scene, expected) {
            Some(measurement) => Ok(measurement),
            None => self.search(scene, expected),
        };
        let seen = self.conclude(scene, measured);
        if seen.advance.observed && self.adjustment.is_none() {
            self.ask_for_the_hand(scene);
        }
        seen
    }

    /// Checks on which side of the band the hand is. If the votes contradict the current direction, the tool was
    /// tracked the wrong way round: tracking restarts and its measurements so far are withdrawn. Not called once the
    /// fulcrum is known, because a fulcrum behind the tip confirms the direction.
    fn ask_for_the_hand(&mut self, scene: &Scene<'_>) {
        let Some((last, length_mm)) = self.last else { return };
        let camera = &scene.settings.camera;
        let Some(to_hand) = in_picture(camera, &last, -last.axis) else { return };
        let bench = self.bench(scene);
        let contrast = shaft::contrast(scene.frame, camera, &last, length_mm, |place, at| bench.is_visible(place, at));
        if let Some(contrast) = contrast {
            self.hand.hear(to_hand, contrast);
        }
        if self.keyframes.len().is_power_of_two() && adjustment::meet_before_the_tips(&self.keyframes) {
            self.hand.is_opposite(to_hand);
        }
        if self.hand.contradicts(to_hand) {
            let (records, tracing) = (std::mem::take(&mut self.records), std::mem::take(&mut self.tracing));
            self.start_over();
            (self.records, self.tracing) = (records.without_poses(Reason::ImpossiblePose), tracing);
        }
    }

    /// Predicts the tool's position, and its motion in the picture.
    pub(super) fn expect(&mut self, scene: &Scene<'_>) -> Option<(Tube, f64)> {
        let (time_s, track_settings) = (scene.frame.time_s, scene.settings.motion.thread());
        self.motion_px_s = self.expected_motion(time_s, &track_settings, &scene.settings.camera).unwrap_or_default();
        self.expected_tube(time_s, &track_settings)
    }

    /// Measures the tool at its predicted position from edges alone, without a colour search.
    pub(super) fn follow(&mut self, scene: &Scene<'_>, expected: Option<(Tube, f64)>) -> Option<Measurement> {
        let (time_s, track_settings) = (scene.frame.time_s, scene.settings.motion.thread());
        expected
            .and_then(|(tube, length)| self.bench(scene).follow(&tube, length))
            .filter(|m| self.thread.would_believe(time_s, &m.estimate, &track_settings) && self.comes_from_the_hand(m))
    }

    /// Accepts or rejects the frame's measurement, learns from it, and advances the track.
    pub(super) fn conclude(&mut self, scene: &Scene<'_>, measured: Result<Measurement, Reason>) -> Seen {
        let track_settings = scene.settings.motion.thread();
        let frame = scene.frame;
        if let Some(m) = measured.as_ref().ok().filter(|m| m.teaches()) {
            self.edges.learn(frame, m.edges.clone());
        }
        self.edges.settle();
        self.remember(&measured);
        let steadied = measured.map(|m| self.steady(m));
        let observation = steadied.as_ref().ok().map(|m| (m.estimate.tube.tip, m.estimate.tip_covariance()));
        let advance = self.thread.advance(frame.time_s, observation, &track_settings);
        if let (Ok(m), true) = (&steadied, advance.observed) {
            self.last = Some((m.estimate.tube, m.length_mm));
            self.last_pose = Some(m.estimate);
        }
        let outcome = match advance.refused {
            Some(reason) => Err(reason),
            None => steadied,
        };
        Seen { outcome, advance }
    }

    /// Searches by colour, first around the predicted position, then on the whole frame.
    fn search(&mut self, scene: &Scene<'_>, expected: Option<(Tube, f64)>) -> Result<Measurement, Reason> {
        let mut refused = Vec::new();
        match self.look(scene, expected, &mut refused) {
            Err(_) if expected.is_some() => self.look(scene, None, &mut refused),
            found => found,
        }
    }

    /// Searches one area, or the whole frame, and measures the largest regions until one is a band. A region that was
    /// rejected earlier on this frame is not measured again: the visible part of a hidden band is the same in both
    /// searches.
    fn look(
        &mut self,
        scene: &Scene<'_>,
        expected: Option<(Tube, f64)>,
        refused: &mut Vec<(Moments, Reason)>,
    ) -> Result<Measurement, Reason> {
        const MOST_REGIONS: usize = 3;
        let mut best_reason = Reason::NoMarkerColour;
        for region in self.regions(scene, expected).iter().take(MOST_REGIONS) {
            let before = refused.iter().find(|(moments, _)| *moments == region.moments);
            let reason = match before {
                Some((_, reason)) => *reason,
                None => match self.judge(scene, region) {
                    Ok(measurement) => return Ok(measurement),
                    Err(reason) => {
                        refused.push((region.moments, reason));
                        reason
                    }
                },
            };
            best_reason = best_reason.max(reason);
        }
        Err(best_reason)
    }

    /// Measures a region, and rejects it if its axis does not pass through the fulcrum.
    fn judge(&mut self, scene: &Scene<'_>, region: &Component) -> Result<Measurement, Reason> {
        let to_hand = self.direction_to_hand(&scene.settings.camera);
        let measured = self.measure(scene, region, to_hand);
        let measured =
            measured.and_then(|m| if self.comes_from_the_hand(&m) { Ok(m) } else { Err(Reason::ImpossiblePose) });
        self.tracing.region(region, measured.as_ref().err().copied());
        measured
    }

    fn regions(&mut self, scene: &Scene<'_>, expected: Option<(Tube, f64)>) -> Vec<Component> {
        let places = self.places(scene, expected);
        self.regions_in(scene, &places, |_, _| true)
    }

    /// Areas to search: around the predicted position, or everywhere on the frame that has the tool's colour.
    pub(super) fn places(&self, scene: &Scene<'_>, expected: Option<(Tube, f64)>) -> Vec<CellBox> {
        match expected {
            Some((tube, length)) => place_of(&tube, length, &scene.settings.camera, scene.frame).into_iter().collect(),
            None => coarse_search(scene.frame, scene.table, self.class),
        }
    }

    /// Regions of the tool's colour, the largest first. Cells (column, row) for which `counts` is false are treated as
    /// background.
    pub(super) fn regions_in(
        &mut self,
        scene: &Scene<'_>,
        places: &[CellBox],
        counts: impl Fn(usize, usize) -> bool,
    ) -> Vec<Component> {
        let (frame, table) = (scene.frame, scene.table);
        self.tracing.places(places);
        let mut regions = Vec::new();
        for place in places {
            let parts = self.finder.find_where(frame, table, self.class, *place, select::FEWEST_CELLS, &counts);
            let (band, others) = join::join_collinear(parts);
            regions.extend(band);
            regions.extend(others);
        }
        regions.sort_by_key(|r: &Component| std::cmp::Reverse(r.moments.cells()));
        regions
    }

    /// Measures a region. Without a direction to the hand, the picture alone decides which end is the tip.
    pub(super) fn measure(
        &mut self,
        scene: &Scene<'_>,
        region: &Component,
        to_hand: Option<Vector2<f64>>,
    ) -> Result<Measurement, Reason> {
        let rectangle = select::judge(region)?;
        self.bench(scene)
            .measure(&rectangle, |first, second| to_hand.map(|direction| (first.0 - second.0).dot(&direction) > 0.0))
    }

    fn bench<'a>(&'a mut self, scene: &'a Scene<'a>) -> Bench<'a> {
        Bench {
            frame: scene.frame,
            camera: &scene.settings.camera,
            table: scene.table,
            class: self.class,
            spec: &self.spec,
            length: self.spec.band_length_mm.map(|known| (known, 0.0)).or_else(|| self.lengths.learned()),
            motion_px_s: self.motion_px_s,
            fulcrum: self.adjustment.as_ref().map(|a| a.fulcrum),
            last_depth_mm: self.last.map(|(tube, _)| tube.tip.z),
            obstacles: scene.obstacles,
            edges: &mut self.edges,
            tracing: &mut self.tracing,
            method: scene.settings.pose,
            view: scene.settings.view,
        }
    }

    /// Outline at the last measured position.
    pub(super) fn outline(&self) -> Option<Outline> {
        self.last.and_then(|(tube, _)| tube.outline())
    }

    pub(super) fn expected_tube(&self, time_s: f64, track_settings: &ThreadSettings) -> Option<(Tube, f64)> {
        let state = self.thread.expected(time_s, track_settings)?;
        let (last, length) = self.last?;
        Some((Tube { tip: state.tip(), ..last }, length))
    }

    /// Predicted motion of the tip in the picture, pixels/s.
    fn expected_motion(&self, time_s: f64, track_settings: &ThreadSettings, camera: &Camera) -> Option<Vector2<f64>> {
        const STEP_S: f64 = 1e-3;
        let state = self.thread.expected(time_s, track_settings)?;
        let pixel = |point| camera.project(CameraPoint(point));
        Some((pixel(state.tip() + state.velocity() * STEP_S)?.0 - pixel(state.tip())?.0) / STEP_S)
    }

    /// Direction in the picture from the tip to the hand, if known: from the last tube towards the fulcrum, else
    /// opposite to its axis; without a last tube, by the votes of earlier frames.
    fn direction_to_hand(&self, camera: &Camera) -> Option<Vector2<f64>> {
        let Some((last, _)) = self.last else { return self.hand.direction() };
        let to_hand =
            self.adjustment.as_ref().and_then(|a| (a.fulcrum.at - last.tip).try_normalize(1e-9)).unwrap_or(-last.axis);
        in_picture(camera, &last, to_hand)
    }

    fn remember(&mut self, measured: &Result<Measurement, Reason>) {
        self.records.push(match measured {
            Ok(m) => Record { pose: Some(KeptPose::from(&m.estimate)), is_good: m.is_good(), reason: None },
            Err(reason) => Record { pose: None, is_good: false, reason: Some(*reason) },
        });
        let Some(m) = measured.as_ref().ok().filter(|m| m.is_good()) else { return };
        self.lengths.add(m.length_mm, m.length_sigma_mm);
        self.keyframes.push(m.estimate);
        if self.keyframes.len() >= FEWEST_KEYFRAMES && self.keyframes.len().is_power_of_two() {
            self.adjustment = adjustment::estimate(&self.keyframes).filter(is_known).or(self.adjustment.take());
        }
        if self.keyframes.len() >= MOST_KEYFRAMES {
            let mut keep = false;
            self.keyframes.retain(|_| {
                keep = !keep;
                keep
            });
        }
    }

    /// Does the axis pass through the known fulcrum? A measurement that explains the pixels well is accepted even if
    /// not: it may lead to a better fulcrum.
    pub(super) fn comes_from_the_hand(&self, measurement: &Measurement) -> bool {
        const MOST_SQUARED: f64 = 18.4; // accepts 99.99 % of good ones (two degrees of freedom)
        measurement.is_good() || measurement.beside_squared < MOST_SQUARED
    }

    /// The point about which the tool turns, if known.
    pub(super) fn fulcrum(&self) -> Option<Fulcrum> {
        self.adjustment.as_ref().map(|a| a.fulcrum)
    }

    /// The best known origin of the tool: its fulcrum, else an assumed one from the last pose, else its side of the
    /// picture.
    pub(super) fn origin(&self, side: Side) -> Origin {
        let seen = || self.last_pose.as_ref().map(|pose| Origin::Fulcrum(origin::hand_of(pose)));
        self.adjustment.as_ref().map(|a| Origin::Fulcrum(a.fulcrum)).or_else(seen).unwrap_or(Origin::Side(side))
    }

    /// Squared Mahalanobis distance of a pose from the predicted position; `None` if the tool is not being tracked.
    pub(super) fn surprise(&self, time_s: f64, pose: &TubeEstimate, track_settings: &ThreadSettings) -> Option<f64> {
        let state = self.thread.expected(time_s, track_settings)?;
        Some(state.distance_squared(pose.tube.tip, pose.tip_covariance()))
    }

    fn steady(&self, measurement: Measurement) -> Measurement {
        let steadied = self.adjustment.as_ref().and_then(|a| adjustment::steady(&measurement.estimate, a));
        Measurement { estimate: steadied.unwrap_or(measurement.estimate), ..measurement }
    }
}

/// Is the fulcrum known well enough to be used?
pub fn is_known(adjustment: &Adjustment) -> bool {
    adjustment.fulcrum.covariance.trace() < FULCRUM_SIGMA_MM * FULCRUM_SIGMA_MM
}

/// A direction from a tube's tip, projected into the picture.
fn in_picture(camera: &Camera, tube: &Tube, direction: Vector3<f64>) -> Option<Vector2<f64>> {
    const STEP_MM: f64 = 5.0;
    let pixel = |point| camera.project(CameraPoint(point));
    Some(pixel(tube.tip + direction * STEP_MM)?.0 - pixel(tube.tip)?.0)
}

/// The cells around a tube's band.
fn place_of(tube: &Tube, length_mm: f64, camera: &Camera, frame: &Frame<'_>) -> Option<CellBox> {
    let outline = tube.outline()?;
    let corners = [(0, 0.0), (1, 0.0), (0, length_mm), (1, length_mm)];
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for (side, back) in corners {
        let pixel = camera.project(CameraPoint(outline.border(side, back)))?;
        low = [low[0].min(pixel.u()), low[1].min(pixel.v())];
        high = [high[0].max(pixel.u()), high[1].max(pixel.v())];
    }
    let width = camera.fx * 2.0 * tube.radius / tube.tip.z;
    CellBox::around(low, high, width.max(16.0), frame)
}

impl MotionSettings {
    /// The settings of one track.
    pub(super) fn thread(&self) -> ThreadSettings {
        ThreadSettings {
            noise_density: self.noise_density(),
            first_speed_mm_s: self.first_speed_mm_s,
            gate: self.gate,
            reacquire_s: self.reacquire_s,
            longest_prediction_s: self.longest_prediction_s,
            depth_mm: (self.nearest_mm, self.farthest_mm),
        }
    }
}
