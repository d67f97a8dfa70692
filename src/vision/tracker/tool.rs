//! Tracks one tool through a recording: predict, find the band, measure, accept or reject, learn.

use nalgebra::{Vector2, Vector3};

use super::band_fit::BandFit;
use super::hand_direction::HandDirection;
use super::measurement::Measurement;
use super::origin::{self, Origin};
use super::record::{FrameRecord, PackedRecords};
use super::settings::{HandSide, MotionSettings, ToolSpec, TrackerSettings};
use super::trace::TraceRecorder;
use crate::vision::blob::components::{Component, ComponentFinder};
use crate::vision::blob::moments::Moments;
use crate::vision::blob::{join, select};
use crate::vision::camera::Camera;
use crate::vision::edges::edge_model::EdgeModel;
use crate::vision::edges::shaft;
use crate::vision::filter::track::{Advance, Track, TrackSettings};
use crate::vision::frame::Frame;
use crate::vision::pose::adjustment::{self, Adjustment};
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::pose::{StoredPose, TubeEstimate};
use crate::vision::reason::MissReason;
use crate::vision::segmentation::colour_table::ColourTable;
use crate::vision::segmentation::region_of_interest::{CellBox, coarse_search};
use crate::vision::space::CameraPoint;
use crate::vision::tube::{Outline, Tube};

/// Tracker of one tool.
pub struct ToolTracker {
    pub(super) spec: ToolSpec,
    class: u8,
    finder: ComponentFinder,
    pub(super) edges: EdgeModel,
    track: Track,
    last: Option<(Tube, f64)>,
    hand_direction: HandDirection,
    adjustment: Option<Adjustment>,
    keyframes: Vec<TubeEstimate>,
    lengths: BandLengthEstimator,
    motion_px_s: Vector2<f64>,
    pub(super) last_pose: Option<TubeEstimate>,
    pub(super) records: PackedRecords,
    pub(super) trace: TraceRecorder,
}

/// Everything a tool's tracker needs of one frame.
pub struct FrameContext<'a> {
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
struct BandLengthEstimator {
    views_mm: Vec<(f64, f64)>,
}

impl BandLengthEstimator {
    /// Number of views that are needed, and number that are kept.
    const MIN_VIEWS: usize = 12;
    const MAX_VIEWS: usize = 64;
    /// Number of views whose errors count as independent: neighbouring frames have similar errors.
    const INDEPENDENT_VIEWS: f64 = 3.0;

    /// Adds a view. Once [`Self::MAX_VIEWS`] are kept, it replaces the least certain one if it is more certain.
    fn add(&mut self, length_mm: f64, sigma_mm: f64) {
        if self.views_mm.len() < Self::MAX_VIEWS {
            self.views_mm.push((length_mm, sigma_mm));
        } else if let Some(worst) = self.views_mm.iter_mut().max_by(|a, b| a.1.total_cmp(&b.1))
            && sigma_mm < worst.1
        {
            *worst = (length_mm, sigma_mm);
        }
    }

    /// The median length, weighted by the certainty of each view, with its standard deviation, mm.
    fn estimate(&self) -> Option<(f64, f64)> {
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

/// Result of one frame for one tool.
pub struct ToolFrameResult {
    /// The steadied measurement, or the reason for having none.
    pub outcome: Result<Measurement, MissReason>,
    /// How the track advanced.
    pub advance: Advance,
}

/// The causal adjustment is computed from this many poses, and again each time their number has doubled. At the
/// maximum every second pose is dropped.
const MIN_KEYFRAMES: usize = 16;
const MAX_KEYFRAMES: usize = 128;

/// The fulcrum is used only once its standard deviation is below this, mm; a less certain one would mislead.
const MAX_FULCRUM_SIGMA_MM: f64 = 30.0;

impl ToolTracker {
    pub(super) fn new(spec: ToolSpec, class: u8, edges: EdgeModel) -> Self {
        Self {
            spec,
            class,
            finder: ComponentFinder::default(),
            edges,
            track: Track::default(),
            last: None,
            hand_direction: HandDirection::default(),
            adjustment: None,
            keyframes: Vec::new(),
            lengths: BandLengthEstimator::default(),
            motion_px_s: Vector2::zeros(),
            last_pose: None,
            records: PackedRecords::default(),
            trace: TraceRecorder::default(),
        }
    }

    /// Forgets the tool's position, but keeps the edge appearance, the band length and the direction to the hand.
    pub(super) fn start_over(&mut self) {
        let fresh = Self::new(self.spec.clone(), self.class, self.edges.clone());
        let Self { finder, lengths, hand_direction: hand, .. } = std::mem::replace(self, fresh);
        (self.finder, self.lengths, self.hand_direction) = (finder, lengths, hand);
    }

    /// Finds and measures the tool on a frame.
    pub(super) fn observe(&mut self, scene: &FrameContext<'_>) -> ToolFrameResult {
        let expected = self.predict(scene);
        let measured = match self.follow(scene, expected) {
            Some(measurement) => Ok(measurement),
            None => self.search(scene, expected),
        };
        let seen = self.accept(scene, measured);
        if seen.advance.observed && self.adjustment.is_none() {
            self.estimate_hand_side(scene);
        }
        seen
    }

    /// Checks on which side of the band the hand is. If the votes contradict the current direction, the tool was
    /// tracked the wrong way round: tracking restarts and its measurements so far are withdrawn. Not called once the
    /// fulcrum is known, because a fulcrum behind the tip confirms the direction.
    fn estimate_hand_side(&mut self, scene: &FrameContext<'_>) {
        let Some((last, length_mm)) = self.last else { return };
        let camera = &scene.settings.camera;
        let Some(to_hand) = direction_in_picture(camera, &last, -last.axis) else { return };
        let bench = self.band_fit(scene);
        let contrast = shaft::contrast(scene.frame, camera, &last, length_mm, |place, at| bench.is_visible(place, at));
        if let Some(contrast) = contrast {
            self.hand_direction.add_vote(to_hand, contrast);
        }
        if self.keyframes.len().is_power_of_two() && adjustment::axes_meet_ahead_of_tips(&self.keyframes) {
            self.hand_direction.set_opposite(to_hand);
        }
        if self.hand_direction.contradicts(to_hand) {
            let (records, tracing) = (std::mem::take(&mut self.records), std::mem::take(&mut self.trace));
            self.start_over();
            (self.records, self.trace) = (records.without_poses(MissReason::ImpossiblePose), tracing);
        }
    }

    /// Predicts the tool's position, and its motion in the picture.
    pub(super) fn predict(&mut self, scene: &FrameContext<'_>) -> Option<(Tube, f64)> {
        let (time_s, track_settings) = (scene.frame.time_s, scene.settings.motion.track_settings());
        self.motion_px_s = self.expected_motion(time_s, &track_settings, &scene.settings.camera).unwrap_or_default();
        self.expected_tube(time_s, &track_settings)
    }

    /// Measures the tool at its predicted position from edges alone, without a colour search.
    pub(super) fn follow(&mut self, scene: &FrameContext<'_>, expected: Option<(Tube, f64)>) -> Option<Measurement> {
        let (time_s, track_settings) = (scene.frame.time_s, scene.settings.motion.track_settings());
        expected
            .and_then(|(tube, length)| self.band_fit(scene).follow(&tube, length))
            .filter(|m| self.track.would_accept(time_s, &m.estimate, &track_settings) && self.passes_through_fulcrum(m))
    }

    /// Accepts or rejects the frame's measurement, learns from it, and advances the track.
    pub(super) fn accept(
        &mut self,
        scene: &FrameContext<'_>,
        measured: Result<Measurement, MissReason>,
    ) -> ToolFrameResult {
        let track_settings = scene.settings.motion.track_settings();
        let frame = scene.frame;
        if let Some(m) = measured.as_ref().ok().filter(|m| m.can_teach_edges()) {
            self.edges.learn(frame, m.edges.clone());
        }
        self.edges.finish_frame();
        self.record(&measured);
        let steadied = measured.map(|m| self.steady(m));
        let observation = steadied.as_ref().ok().map(|m| (m.estimate.tube.tip, m.estimate.tip_covariance()));
        let advance = self.track.advance(frame.time_s, observation, &track_settings);
        if let (Ok(m), true) = (&steadied, advance.observed) {
            self.last = Some((m.estimate.tube, m.length_mm));
            self.last_pose = Some(m.estimate);
        }
        let outcome = match advance.refused {
            Some(reason) => Err(reason),
            None => steadied,
        };
        ToolFrameResult { outcome, advance }
    }

    /// Searches by colour, first around the predicted position, then on the whole frame.
    fn search(&mut self, scene: &FrameContext<'_>, expected: Option<(Tube, f64)>) -> Result<Measurement, MissReason> {
        let mut refused = Vec::new();
        match self.search_in(scene, expected, &mut refused) {
            Err(_) if expected.is_some() => self.search_in(scene, None, &mut refused),
            found => found,
        }
    }

    /// Searches one area, or the whole frame, and measures the largest regions until one is a band. A region that was
    /// rejected earlier on this frame is not measured again: the visible part of a hidden band is the same in both
    /// searches.
    fn search_in(
        &mut self,
        scene: &FrameContext<'_>,
        expected: Option<(Tube, f64)>,
        refused: &mut Vec<(Moments, MissReason)>,
    ) -> Result<Measurement, MissReason> {
        const MAX_REGIONS: usize = 3;
        let mut best_reason = MissReason::NoMarkerColour;
        for region in self.find_regions(scene, expected).iter().take(MAX_REGIONS) {
            let before = refused.iter().find(|(moments, _)| *moments == region.moments);
            let reason = match before {
                Some((_, reason)) => *reason,
                None => match self.measure_checked(scene, region) {
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
    fn measure_checked(&mut self, scene: &FrameContext<'_>, region: &Component) -> Result<Measurement, MissReason> {
        let to_hand = self.direction_to_hand(&scene.settings.camera);
        let measured = self.measure(scene, region, to_hand);
        let measured = measured
            .and_then(|m| if self.passes_through_fulcrum(&m) { Ok(m) } else { Err(MissReason::ImpossiblePose) });
        self.trace.record_region(region, measured.as_ref().err().copied());
        measured
    }

    fn find_regions(&mut self, scene: &FrameContext<'_>, expected: Option<(Tube, f64)>) -> Vec<Component> {
        let places = self.search_areas(scene, expected);
        self.find_regions_in(scene, &places, |_, _| true)
    }

    /// Areas to search: around the predicted position, or everywhere on the frame that has the tool's colour.
    pub(super) fn search_areas(&self, scene: &FrameContext<'_>, expected: Option<(Tube, f64)>) -> Vec<CellBox> {
        match expected {
            Some((tube, length)) => {
                cells_around_band(&tube, length, &scene.settings.camera, scene.frame).into_iter().collect()
            }
            None => coarse_search(scene.frame, scene.table, self.class),
        }
    }

    /// Regions of the tool's colour, the largest first. Cells (column, row) for which `counts` is false are treated as
    /// background.
    pub(super) fn find_regions_in(
        &mut self,
        scene: &FrameContext<'_>,
        places: &[CellBox],
        counts: impl Fn(usize, usize) -> bool,
    ) -> Vec<Component> {
        let (frame, table) = (scene.frame, scene.table);
        self.trace.record_places(places);
        let mut regions = Vec::new();
        for place in places {
            let parts = self.finder.find_where(frame, table, self.class, *place, select::MIN_CELLS, &counts);
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
        scene: &FrameContext<'_>,
        region: &Component,
        to_hand: Option<Vector2<f64>>,
    ) -> Result<Measurement, MissReason> {
        let rectangle = select::check_shape(region)?;
        self.band_fit(scene)
            .measure(&rectangle, |first, second| to_hand.map(|direction| (first.0 - second.0).dot(&direction) > 0.0))
    }

    fn band_fit<'a>(&'a mut self, scene: &'a FrameContext<'a>) -> BandFit<'a> {
        BandFit {
            frame: scene.frame,
            camera: &scene.settings.camera,
            table: scene.table,
            class: self.class,
            spec: &self.spec,
            length: self.spec.band_length_mm.map(|known| (known, 0.0)).or_else(|| self.lengths.estimate()),
            motion_px_s: self.motion_px_s,
            fulcrum: self.adjustment.as_ref().map(|a| a.fulcrum),
            last_depth_mm: self.last.map(|(tube, _)| tube.tip.z),
            obstacles: scene.obstacles,
            edges: &mut self.edges,
            trace: &mut self.trace,
            method: scene.settings.pose,
            view: scene.settings.view,
        }
    }

    /// Outline at the last measured position.
    pub(super) fn last_outline(&self) -> Option<Outline> {
        self.last.and_then(|(tube, _)| tube.outline())
    }

    pub(super) fn expected_tube(&self, time_s: f64, track_settings: &TrackSettings) -> Option<(Tube, f64)> {
        let state = self.track.expected(time_s, track_settings)?;
        let (last, length) = self.last?;
        Some((Tube { tip: state.tip(), ..last }, length))
    }

    /// Predicted motion of the tip in the picture, pixels/s.
    fn expected_motion(&self, time_s: f64, track_settings: &TrackSettings, camera: &Camera) -> Option<Vector2<f64>> {
        const STEP_S: f64 = 1e-3;
        let state = self.track.expected(time_s, track_settings)?;
        let pixel = |point| camera.project(CameraPoint(point));
        Some((pixel(state.tip() + state.velocity() * STEP_S)?.0 - pixel(state.tip())?.0) / STEP_S)
    }

    /// Direction in the picture from the tip to the hand, if known: from the last tube towards the fulcrum, else
    /// opposite to its axis; without a last tube, by the votes of earlier frames.
    fn direction_to_hand(&self, camera: &Camera) -> Option<Vector2<f64>> {
        let Some((last, _)) = self.last else { return self.hand_direction.direction() };
        let to_hand =
            self.adjustment.as_ref().and_then(|a| (a.fulcrum.at - last.tip).try_normalize(1e-9)).unwrap_or(-last.axis);
        direction_in_picture(camera, &last, to_hand)
    }

    fn record(&mut self, measured: &Result<Measurement, MissReason>) {
        self.records.push(match measured {
            Ok(m) => FrameRecord { pose: Some(StoredPose::from(&m.estimate)), is_good: m.is_good(), reason: None },
            Err(reason) => FrameRecord { pose: None, is_good: false, reason: Some(*reason) },
        });
        let Some(m) = measured.as_ref().ok().filter(|m| m.is_good()) else { return };
        self.lengths.add(m.length_mm, m.length_sigma_mm);
        self.keyframes.push(m.estimate);
        if self.keyframes.len() >= MIN_KEYFRAMES && self.keyframes.len().is_power_of_two() {
            self.adjustment = adjustment::estimate(&self.keyframes).filter(is_fulcrum_known).or(self.adjustment.take());
        }
        if self.keyframes.len() >= MAX_KEYFRAMES {
            let mut keep = false;
            self.keyframes.retain(|_| {
                keep = !keep;
                keep
            });
        }
    }

    /// Does the axis pass through the known fulcrum? A measurement that explains the pixels well is accepted even if
    /// not: it may lead to a better fulcrum.
    pub(super) fn passes_through_fulcrum(&self, measurement: &Measurement) -> bool {
        const MAX_MISS_SQUARED: f64 = 18.4; // accepts 99.99 % of good ones (two degrees of freedom)
        measurement.is_good() || measurement.fulcrum_miss_squared < MAX_MISS_SQUARED
    }

    /// The point about which the tool turns, if known.
    pub(super) fn fulcrum(&self) -> Option<Fulcrum> {
        self.adjustment.as_ref().map(|a| a.fulcrum)
    }

    /// The best known origin of the tool: its fulcrum, else an assumed one from the last pose, else its side of the
    /// picture.
    pub(super) fn origin(&self, side: HandSide) -> Origin {
        let seen = || self.last_pose.as_ref().map(|pose| Origin::Fulcrum(origin::assumed_trocar(pose)));
        self.adjustment.as_ref().map(|a| Origin::Fulcrum(a.fulcrum)).or_else(seen).unwrap_or(Origin::Side(side))
    }

    /// Squared Mahalanobis distance of a pose from the predicted position; `None` if the tool is not being tracked.
    pub(super) fn mahalanobis_squared(
        &self,
        time_s: f64,
        pose: &TubeEstimate,
        track_settings: &TrackSettings,
    ) -> Option<f64> {
        let state = self.track.expected(time_s, track_settings)?;
        Some(state.distance_squared(pose.tube.tip, pose.tip_covariance()))
    }

    fn steady(&self, measurement: Measurement) -> Measurement {
        let steadied = self.adjustment.as_ref().and_then(|a| adjustment::steady(&measurement.estimate, a));
        Measurement { estimate: steadied.unwrap_or(measurement.estimate), ..measurement }
    }
}

/// Is the fulcrum known well enough to be used?
pub fn is_fulcrum_known(adjustment: &Adjustment) -> bool {
    adjustment.fulcrum.covariance.trace() < MAX_FULCRUM_SIGMA_MM * MAX_FULCRUM_SIGMA_MM
}

/// A direction from a tube's tip, projected into the picture.
fn direction_in_picture(camera: &Camera, tube: &Tube, direction: Vector3<f64>) -> Option<Vector2<f64>> {
    const STEP_MM: f64 = 5.0;
    let pixel = |point| camera.project(CameraPoint(point));
    Some(pixel(tube.tip + direction * STEP_MM)?.0 - pixel(tube.tip)?.0)
}

/// The cells around a tube's band.
fn cells_around_band(tube: &Tube, length_mm: f64, camera: &Camera, frame: &Frame<'_>) -> Option<CellBox> {
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
    pub(super) fn track_settings(&self) -> TrackSettings {
        TrackSettings {
            noise_density: self.noise_density(),
            first_speed_mm_s: self.first_speed_mm_s,
            gate: self.gate,
            reacquire_s: self.reacquire_s,
            max_prediction_s: self.max_prediction_s,
            depth_mm: (self.nearest_mm, self.farthest_mm),
        }
    }
}
