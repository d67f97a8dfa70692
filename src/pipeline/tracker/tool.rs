//! One tool through a recording: where to look for it, which region is its band, and its thread through time.

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

/// One tool's tracker.
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

/// What all tools see of a frame.
pub struct Scene<'a> {
    /// The frame.
    pub frame: &'a Frame<'a>,
    /// Colours.
    pub table: &'a ColourTable,
    /// Camera and methods.
    pub settings: &'a TrackerSettings,
    /// Outlines of the other tools, where they are expected.
    pub obstacles: &'a [Outline],
}

/// Lengths of a band that nobody measured, as its ends were seen, each with its standard deviation, mm.
#[derive(Default)]
struct BandLengths {
    seen_mm: Vec<(f64, f64)>,
}

impl BandLengths {
    /// Views that are enough to know the length, and to keep.
    const ENOUGH: usize = 12;
    const MOST: usize = 64;
    /// Views whose errors can be taken for independent: neighbouring frames err alike.
    const INDEPENDENT: f64 = 3.0;

    /// Takes a view; where there are enough, in place of the least sure one.
    fn add(&mut self, length_mm: f64, sigma_mm: f64) {
        if self.seen_mm.len() < Self::MOST {
            self.seen_mm.push((length_mm, sigma_mm));
        } else if let Some(worst) = self.seen_mm.iter_mut().max_by(|a, b| a.1.total_cmp(&b.1))
            && sigma_mm < worst.1
        {
            *worst = (length_mm, sigma_mm);
        }
    }

    /// The median length, weighed by how sure each view is of it, with its standard deviation, mm.
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

/// What one frame says of a tool.
pub struct Seen {
    /// The steadied measurement, or why there is none.
    pub outcome: Result<Measurement, Reason>,
    /// What the thread made of it.
    pub advance: Advance,
}

/// Poses that the causal adjustment is made from, each time they have doubled; at most, then every second one is let go.
const FEWEST_KEYFRAMES: usize = 16;
const MOST_KEYFRAMES: usize = 128;

/// A fulcrum is used once it is known this well, mm: before, it would rather mislead.
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

    /// Forgets where the tool was, but not how its edges look, how long its band is and from where it is held.
    pub(super) fn start_over(&mut self) {
        let fresh = Self::new(self.spec.clone(), self.class, self.edges.clone());
        let Self { finder, lengths, hand, .. } = std::mem::replace(self, fresh);
        (self.finder, self.lengths, self.hand) = (finder, lengths, hand);
    }

    /// Finds the tool on a frame.
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

    /// Asks a frame on which side the hand is; a tool that was taken the wrong way round begins anew, and what was measured of it
    /// is taken back. A trocar that is known lies behind the tip: then it is the right way round.
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

    /// Where the tool is expected, and how it is expected to move.
    pub(super) fn expect(&mut self, scene: &Scene<'_>) -> Option<(Tube, f64)> {
        let (time_s, thread) = (scene.frame.time_s, scene.settings.motion.thread());
        self.motion_px_s = self.expected_motion(time_s, &thread, &scene.settings.camera).unwrap_or_default();
        self.expected_tube(time_s, &thread)
    }

    /// The tool where it is expected, by the edges alone.
    pub(super) fn follow(&mut self, scene: &Scene<'_>, expected: Option<(Tube, f64)>) -> Option<Measurement> {
        let (time_s, thread) = (scene.frame.time_s, scene.settings.motion.thread());
        expected
            .and_then(|(tube, length)| self.bench(scene).follow(&tube, length))
            .filter(|m| self.thread.would_believe(time_s, &m.estimate, &thread) && self.comes_from_the_hand(m))
    }

    /// Takes what a frame showed, or why nothing.
    pub(super) fn conclude(&mut self, scene: &Scene<'_>, measured: Result<Measurement, Reason>) -> Seen {
        let thread = scene.settings.motion.thread();
        let frame = scene.frame;
        if let Some(m) = measured.as_ref().ok().filter(|m| m.teaches()) {
            self.edges.learn(frame, m.edges.clone());
        }
        self.edges.settle();
        self.remember(&measured);
        let steadied = measured.map(|m| self.steady(m));
        let observation = steadied.as_ref().ok().map(|m| (m.estimate.tube.tip, m.estimate.tip_covariance()));
        let advance = self.thread.advance(frame.time_s, observation, &thread);
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

    /// Searches by colour: first where it is expected, then on the whole frame.
    fn search(&mut self, scene: &Scene<'_>, expected: Option<(Tube, f64)>) -> Result<Measurement, Reason> {
        let mut refused = Vec::new();
        match self.look(scene, expected, &mut refused) {
            Err(_) if expected.is_some() => self.look(scene, None, &mut refused),
            found => found,
        }
    }

    /// Searches one place, or the whole frame, and measures the likeliest regions until one is a band. One that was refused
    /// on this frame before is not measured again: what little is seen of a hidden band is the same wherever one looked.
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

    /// Measures a region; what does not come from the hand is refused.
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

    /// Where to search: around the expected place, or wherever on the frame the colour is.
    pub(super) fn places(&self, scene: &Scene<'_>, expected: Option<(Tube, f64)>) -> Vec<CellBox> {
        match expected {
            Some((tube, length)) => place_of(&tube, length, &scene.settings.camera, scene.frame).into_iter().collect(),
            None => coarse_search(scene.frame, scene.table, self.class),
        }
    }

    /// Regions of the tool's colour, the largest first; cells (column, row) that do not count are taken for background.
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

    /// Measures a region; without a direction to the hand, the picture alone tells which of its ends is the tip.
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

    /// Where it was seen last.
    pub(super) fn outline(&self) -> Option<Outline> {
        self.last.and_then(|(tube, _)| tube.outline())
    }

    pub(super) fn expected_tube(&self, time_s: f64, thread: &ThreadSettings) -> Option<(Tube, f64)> {
        let state = self.thread.expected(time_s, thread)?;
        let (last, length) = self.last?;
        Some((Tube { tip: state.tip(), ..last }, length))
    }

    /// How the tip is expected to move in the picture, pixels/s.
    fn expected_motion(&self, time_s: f64, thread: &ThreadSettings, camera: &Camera) -> Option<Vector2<f64>> {
        const STEP_S: f64 = 1e-3;
        let state = self.thread.expected(time_s, thread)?;
        let pixel = |point| camera.project(CameraPoint(point));
        Some((pixel(state.tip() + state.velocity() * STEP_S)?.0 - pixel(state.tip())?.0) / STEP_S)
    }

    /// The direction in the picture, from the tip to the hand, where it is known: towards the fulcrum, as it was last, or as
    /// frames have said.
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

    /// Does its axis pass through the fulcrum, where that is known? What the pixels explain well is believed without: it may
    /// teach a better one.
    pub(super) fn comes_from_the_hand(&self, measurement: &Measurement) -> bool {
        const MOST_SQUARED: f64 = 18.4; // passes 99.99 % of good ones: two degrees of freedom
        measurement.is_good() || measurement.beside_squared < MOST_SQUARED
    }

    /// The point that it turns about, if that is known.
    pub(super) fn fulcrum(&self) -> Option<Fulcrum> {
        self.adjustment.as_ref().map(|a| a.fulcrum)
    }

    /// Where it comes from, as far as that is known.
    pub(super) fn origin(&self, side: Side) -> Origin {
        let seen = || self.last_pose.as_ref().map(|pose| Origin::Fulcrum(origin::hand_of(pose)));
        self.adjustment.as_ref().map(|a| Origin::Fulcrum(a.fulcrum)).or_else(seen).unwrap_or(Origin::Side(side))
    }

    /// Squared Mahalanobis distance of a pose to where the tool is expected; `None` where it is not tracked.
    pub(super) fn surprise(&self, time_s: f64, pose: &TubeEstimate, thread: &ThreadSettings) -> Option<f64> {
        let state = self.thread.expected(time_s, thread)?;
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

/// A direction from a tube's tip, as the picture shows it.
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
    /// The part that a thread needs.
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
