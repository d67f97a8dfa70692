//! Fits a tube to one band on one frame: from a region of the tool's colour to a pose with its covariance.

use nalgebra::Vector2;

use super::measurement::Measurement;
use super::probe_pass::{FoundEdges, ProbePass};
use crate::vision::blob::moments::RegionRectangle;
use crate::vision::camera::Camera;
use crate::vision::edges::edge_model::EdgeModel;
use crate::vision::edges::outline_probes::rim_probes;
use crate::vision::edges::scan_lines::{self, CoarseBand};
use crate::vision::edges::shaft;
use crate::vision::edges::subpixel::Fineness;
use crate::vision::frame::Frame;
use crate::vision::pose::fulcrum::{self, Fulcrum};
use crate::vision::pose::joint_fit::{self, MeasuredEdge, Trust};
use crate::vision::pose::normal_equations::{NormalEquations, OWN_OFFSETS_PX, OffsetPriors, single_pose_offsets_px};
use crate::vision::pose::{TubeEstimate, pinhole_width, tangent_planes};
use crate::vision::reason::MissReason;
use crate::vision::segmentation::colour_table::ColourTable;
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::tracker::trace::TraceRecorder;
use crate::vision::tracker::{CameraView, PoseMethod, ToolSpec};
use crate::vision::tube::{Outline, Tube};

/// Everything needed to fit one band, except the region.
pub struct BandFit<'a> {
    /// The frame.
    pub frame: &'a Frame<'a>,
    /// The camera.
    pub camera: &'a Camera,
    /// The class of every colour.
    pub table: &'a ColourTable,
    /// The tool's class in the table.
    pub class: u8,
    /// The tool.
    pub spec: &'a ToolSpec,
    /// Length of the band and its standard deviation, mm: measured by a person (standard deviation 0), or learned from
    /// this recording.
    pub length: Option<(f64, f64)>,
    /// Expected motion in the picture, pixels/s.
    pub motion_px_s: Vector2<f64>,
    /// Fulcrum in the camera frame, mm, once known.
    pub fulcrum: Option<Fulcrum>,
    /// Depth at the last measurement, mm.
    pub last_depth_mm: Option<f64>,
    /// Outlines of other tools, which may hide this one.
    pub obstacles: &'a [Outline],
    /// Appearance of the tool's edges.
    pub edges: &'a mut EdgeModel,
    /// Records each step if a trace was requested.
    pub trace: &'a mut TraceRecorder,
    /// Pose method.
    pub method: PoseMethod,
    /// Where the camera is, if known.
    pub view: Option<CameraView>,
}

/// Factor on the variances of a fit that is not good: some edges it used may be false. Three times the standard
/// deviation.
const DOUBT_VARIANCE_FACTOR: f64 = 9.0;

/// Probe passes from wide to close: coarse border lines may be two pixels off, the first fit is closer.
const PROBE_PASSES: [ProbePass; 3] = [
    ProbePass { chord_px: 8.0, reach_px: 9.0, fineness: Fineness::Step },
    ProbePass { chord_px: 10.0, reach_px: 5.0, fineness: Fineness::Fine },
    ProbePass { chord_px: 10.0, reach_px: 3.2, fineness: Fineness::Fine },
];

/// Share of the probes that must find an edge in the first pass; with fewer, the region is no tube and the finer
/// passes are skipped.
const MIN_STEP_SHARE: f64 = 0.3;

impl BandFit<'_> {
    /// Measures the band of a region. `hand_first` returns whether the first of two ends is nearer to the hand, if
    /// known. Otherwise the end with the dark shaft beyond it is the hand's, else the camera's view decides.
    pub fn measure(
        &mut self,
        region: &RegionRectangle,
        hand_first: impl Fn(Pixel, Pixel) -> Option<bool>,
    ) -> Result<Measurement, MissReason> {
        let coarse = scan_lines::scan(self.frame, self.table, self.class, region).ok_or(MissReason::BordersNotFound)?;
        let lines = self.border_lines(&coarse).ok_or(MissReason::BordersNotFound)?;
        let [back, front] = coarse.ends;
        let hand_at_back = hand_first(back, front)
            .or_else(|| shaft::is_shaft_beyond_first(self.frame, &coarse))
            .unwrap_or_else(|| self.hand_first_by_view(back, front));
        let (distal, proximal) = if hand_at_back { (front, back) } else { (back, front) };
        let sight = |pixel| self.camera.normalised_of(pixel).ok_or(MissReason::ImpossiblePose);
        let (distal, proximal) = (sight(distal)?, sight(proximal)?);
        let radius = 0.5 * self.spec.diameter_mm;
        if self.method == PoseMethod::PinholeWidth {
            let tube = pinhole_width::locate(lines, distal, proximal, radius).ok_or(MissReason::ImpossiblePose)?;
            return Ok(self.pose_from_width(tube, &coarse));
        }
        let by_taper = tangent_planes::locate(lines, distal, proximal, radius);
        let by_width = 2.0 * radius * self.camera.fx / coarse.width_px + radius;
        let depths = [Some(by_width), self.last_depth_mm];
        let mut starts: Vec<Tube> =
            depths.iter().flatten().filter_map(|depth| self.start_from_fulcrum([distal, proximal], *depth)).collect();
        starts.extend(self.starts_from_length(&coarse, [distal, proximal]));
        if starts.is_empty() {
            starts.extend(by_taper);
        }
        let seen_mm = by_taper.and_then(|tube| tangent_planes::distance_behind_tip(&tube, proximal));
        self.best_fit_of(&starts, seen_mm)
    }

    /// Guesses the hand's end from the camera's position: hands are below the picture, or beside it.
    fn hand_first_by_view(&self, first: Pixel, second: Pixel) -> bool {
        let centre = Pixel::new(0.5 * self.frame.width() as f64, 0.5 * self.frame.height() as f64);
        match self.view {
            Some(CameraView::Top) => first.v() > second.v(),
            _ => (first.0 - centre.0).norm() > (second.0 - centre.0).norm(),
        }
    }

    /// Refines each start until one explains the pixels well; otherwise returns the best fit that is possible at all.
    /// Skips a start that would lead to a fit already made.
    fn best_fit_of(&mut self, starts: &[Tube], seen_mm: Option<f64>) -> Result<Measurement, MissReason> {
        let length_mm = self.length.map(|l| l.0).or(seen_mm).ok_or(MissReason::ImpossiblePose)?;
        let mut refined: Vec<Tube> = Vec::new();
        let mut outcome: Result<Measurement, MissReason> = Err(MissReason::ImpossiblePose);
        for start in starts {
            if refined.iter().any(|tube| self.is_similar(start, tube, length_mm)) {
                continue;
            }
            let found = self.refine(*start, length_mm, &PROBE_PASSES);
            refined.extend(found.as_ref().ok().map(|m| m.estimate.tube));
            let found = found.and_then(|m| if m.is_possible() { Ok(m) } else { Err(MissReason::ImpossiblePose) });
            let better = match (&found, &outcome) {
                (Ok(new), Ok(old)) => new.seen_share > old.seen_share,
                (Ok(_), Err(_)) => true,
                (Err(new), Err(old)) => new > old,
                (Err(_), Ok(_)) => false,
            };
            if better {
                outcome = found;
            }
            if outcome.as_ref().is_ok_and(Measurement::is_good) {
                break;
            }
        }
        outcome
    }

    /// Fits the expected tube to the edges in the pixels, without a colour region. Accepts the fit only if it agrees
    /// with the expectation. If the tube is within `RIGHT_PX` of where it was expected, one close pass is enough.
    pub fn follow(&mut self, expected: &Tube, length_mm: f64) -> Option<Measurement> {
        const RIGHT_PX: f64 = 3.0;
        const MAX_PX: f64 = 15.0;
        if self.method != PoseMethod::TangentPlanes {
            return None;
        }
        let within = |bench: &Self, found: &Measurement, limit_px: f64| {
            bench.corner_distance_px(expected, &found.estimate.tube, length_mm).is_some_and(|px| px < limit_px)
        };
        let close =
            self.refine(*expected, length_mm, &PROBE_PASSES[2..]).ok().filter(Measurement::is_plausible_continuation);
        let (start, looks) = match close {
            Some(found) if found.ends_seen && within(self, &found, RIGHT_PX) => return Some(found),
            Some(found) if found.ends_seen => (found.estimate.tube, &PROBE_PASSES[2..]),
            _ => (*expected, &PROBE_PASSES[1..]), // with an end not found, the tube may have slid along its axis
        };
        let found = self.refine(start, length_mm, looks).ok()?;
        let goes_on = found.is_plausible_continuation() && found.ends_seen && within(self, &found, MAX_PX);
        (found.is_good() || goes_on).then_some(found)
    }

    /// Largest distance between corresponding corners of the bands of two tubes in the picture, pixels.
    fn corner_distance_px(&self, one: &Tube, other: &Tube, length_mm: f64) -> Option<f64> {
        let outlines = (one.outline()?, other.outline()?);
        let corners = [(0, 0.0), (1, 0.0), (0, length_mm), (1, length_mm)];
        corners.into_iter().try_fold(0.0, |most: f64, (side, back)| {
            let pixel = |outline: &Outline| self.camera.project(CameraPoint(outline.border(side, back))).map(|p| p.0);
            Some(most.max((pixel(&outlines.0)? - pixel(&outlines.1)?).norm()))
        })
    }

    /// Would refining `start` lead to `refined`, which was refined already?
    fn is_similar(&self, start: &Tube, refined: &Tube, length_mm: f64) -> bool {
        const NEAR_PX: f64 = 3.0;
        const NEAR_RAD: f64 = 0.15;
        start.axis.angle(&refined.axis) < NEAR_RAD
            && self.corner_distance_px(start, refined, length_mm).is_some_and(|px| px < NEAR_PX)
    }

    /// Fits a rough tube to the edges in the pixels.
    fn refine(&mut self, mut tube: Tube, length_mm: f64, looks: &[ProbePass]) -> Result<Measurement, MissReason> {
        let smear_px = self.motion_px_s.norm() * self.edges.exposure_s / 12f64.sqrt();
        let mut measurement = Err(MissReason::BordersNotFound);
        let mut found = FoundEdges::default();
        self.trace.start_fit(&tube, length_mm);
        for look in looks {
            let first = self.edges.found_count();
            found = self.edges_along(&tube, length_mm, *look)?;
            if found.edges.iter().all(|e| e.point.part() < 2) {
                return Err(MissReason::TipHidden);
            }
            let beliefs = self.offset_priors(&found, &tube, length_mm);
            let estimate = joint_fit::fit(&found.edges, &tube, self.camera, Trust::Majority, &beliefs, None)
                .ok_or(MissReason::BordersNotFound)?;
            tube = estimate.tube;
            self.trace.record_fitted_tube(&tube);
            let seen_share = estimate.support / f64::max(found.visible.iter().sum(), 1.0);
            let ends_seen = found.ends_seen();
            measurement = Ok(Measurement {
                estimate,
                length_mm,
                length_sigma_mm: 0.0,
                seen_share,
                ends_seen,
                fulcrum_miss_squared: 0.0,
                smear_px,
                edges: first..self.edges.found_count(),
            });
            if look.fineness == Fineness::Step && seen_share < MIN_STEP_SHARE {
                return Err(MissReason::BordersNotFound);
            }
        }
        let mut measurement: Measurement = measurement?;
        if let Some(fulcrum) = &self.fulcrum {
            measurement.fulcrum_miss_squared = fulcrum::miss_squared(&measurement.estimate, fulcrum);
            if let Some(bound) = self.constrain_to_fulcrum(&found, &measurement.estimate, length_mm, fulcrum) {
                measurement.estimate = bound;
            }
            tube = measurement.estimate.tube;
        }
        if !self.covers_tape(&tube, length_mm) {
            return Err(MissReason::ImpossiblePose);
        }
        if !measurement.is_good() {
            measurement.estimate.covariance *= DOUBT_VARIANCE_FACTOR;
            measurement.estimate.lasting *= DOUBT_VARIANCE_FACTOR;
            measurement.estimate.equations = measurement.estimate.equations.with_variance_scaled(DOUBT_VARIANCE_FACTOR);
        }
        if self.spec.band_length_mm.is_none() {
            measurement.length_mm += self.length_error_mm(&found, &tube, length_mm).unwrap_or(0.0);
            measurement.length_sigma_mm = length_sigma_mm(&measurement.estimate, measurement.length_mm);
        }
        Ok(measurement)
    }

    /// The estimate, constrained to the fulcrum. The edges of a short visible piece hardly determine its lean, and
    /// errors of the lean are not linear. `None` if the constrained tube does not explain the edges.
    fn constrain_to_fulcrum(
        &self,
        found: &FoundEdges,
        free: &TubeEstimate,
        length_mm: f64,
        fulcrum: &Fulcrum,
    ) -> Option<TubeEstimate> {
        const WORSE: f64 = 2.0;
        const SHARP_PX: f64 = 0.1;
        let axis = (free.tube.tip - fulcrum.at).try_normalize(1e-9).unwrap_or(free.tube.axis);
        let beliefs = self.offset_priors(found, &free.tube, length_mm);
        let from =
            |start: &Tube| joint_fit::fit(&found.edges, start, self.camera, Trust::Majority, &beliefs, Some(fulcrum));
        let bound = from(&Tube { axis, ..free.tube }).or_else(|| from(&free.tube));
        bound.filter(|bound| bound.residual_px < WORSE * free.residual_px.max(SHARP_PX))
    }

    /// Priors on the offsets of a tube's edges: the usual ones, wider where the edges are smeared or the band's length
    /// is uncertain.
    fn offset_priors(&self, found: &FoundEdges, tube: &Tube, length_mm: f64) -> OffsetPriors {
        let px_per_mm = self.px_per_mm_along(tube, length_mm);
        let mut beliefs = OffsetPriors {
            offsets_px: found.offsets_px(single_pose_offsets_px()),
            own_px: found.offsets_px(OWN_OFFSETS_PX),
            length_mm,
            px_per_mm: if self.spec.band_length_mm.is_none() { px_per_mm } else { 0.0 },
        };
        if let Some((_, sigma_mm)) = self.length {
            beliefs.offsets_px[3] = beliefs.offsets_px[3].hypot(sigma_mm * px_per_mm);
        }
        beliefs
    }

    /// Is there tape all along the band, and none beyond its distal end? Edges alone cannot decide this: the shaft's
    /// edges also fit a band one length too far back, and a band hidden in its middle also fits at half the distance.
    fn covers_tape(&self, tube: &Tube, length_mm: f64) -> bool {
        const MIN_INSIDE: f64 = 0.4;
        const MAX_BEYOND: f64 = 0.6;
        const MAX_BARE: usize = 1; // may be glare
        let Some(outline) = tube.outline() else { return false };
        let inside = self.count_tape_at(&outline, [0.2, 0.35, 0.5, 0.65, 0.8].map(|part| part * length_mm));
        let beyond = self.count_tape_at(&outline, [0.2, 0.3, 0.4, 0.5, 0.6].map(|part| -part * length_mm));
        let bare = inside.iter().filter(|(tape, seen)| *seen >= 2 && *tape == 0).count();
        bare <= MAX_BARE
            && tape_share(&inside).is_none_or(|share| share >= MIN_INSIDE)
            && tape_share(&beyond).is_none_or(|share| share <= MAX_BEYOND)
    }

    /// Checks three points across the tube's near side at each distance behind the tip. Returns how many have the
    /// tape's colour, and how many are in sight.
    fn count_tape_at(&self, outline: &Outline, backs_mm: [f64; 5]) -> [(usize, usize); 5] {
        backs_mm.map(|back_mm| {
            let places = [-0.5, 0.0, 0.5].map(|across| outline.rim(back_mm, across));
            let in_sight = places
                .into_iter()
                .filter_map(|place| self.camera.project(CameraPoint(place)).filter(|at| self.is_visible(place, *at)));
            in_sight.fold((0, 0), |(tape, seen), at| {
                let codes = self.frame.yuv_at(at.u().round() as usize, at.v().round() as usize);
                (tape + usize::from(self.table.class_of(codes) == self.class), seen + 1)
            })
        })
    }

    /// By how much the band is longer than assumed, from the edges at its proximal end, mm.
    fn length_error_mm(&mut self, found: &FoundEdges, tube: &Tube, length_mm: f64) -> Option<f64> {
        let outline = tube.outline()?;
        let residual = |edge: &MeasuredEdge| edge.residual_px(&outline, self.camera);
        let mut offsets: Vec<f64> =
            found.edges.iter().filter(|edge| edge.point.part() == 3).filter_map(residual).collect();
        if self.length.is_none() {
            let mut probes = Vec::new();
            rim_probes(&outline, self.camera, length_mm, 0.5 * length_mm, self.layout(PROBE_PASSES[1]), &mut probes);
            let located = probes.iter().filter_map(|(_, probe)| self.locate(probe, Fineness::Fine));
            offsets.extend(located.map(|edge| edge.offset_px));
        }
        offsets.sort_by(f64::total_cmp);
        Some(offsets.get(offsets.len() / 2)? / self.px_per_mm_along(tube, length_mm))
    }

    /// Pixels per millimetre along the axis, at the band's proximal end.
    pub(super) fn px_per_mm_along(&self, tube: &Tube, length_mm: f64) -> f64 {
        let pixel = |back: f64| self.camera.project(CameraPoint(tube.tip - tube.axis * back)).map(|p| p.0);
        let pair = pixel(length_mm).zip(pixel(length_mm + 1.0));
        pair.map_or(1.0, |(near, far)| (near - far).norm()).max(0.05)
    }

    /// Measurement by the width method. Its covariance assumes whole-pixel borders, each uncertain by a third of a
    /// pixel.
    fn pose_from_width(&self, tube: Tube, coarse: &CoarseBand) -> Measurement {
        let sigma_px = 0.33;
        let across = tube.tip.z * sigma_px / self.camera.fx;
        let depth = tube.tip.z * sigma_px * std::f64::consts::SQRT_2 / coarse.width_px;
        let spread = [across * across, across * across, depth * depth, 0.1, 0.1];
        let covariance = nalgebra::Matrix5::from_diagonal(&spread.into());
        Measurement {
            estimate: TubeEstimate {
                tube,
                covariance,
                lasting: covariance,
                equations: NormalEquations::from_covariance(&covariance),
                residual_px: sigma_px,
                support: 1.0,
            },
            length_mm: 0.0,
            length_sigma_mm: 0.0,
            seen_share: 1.0,
            ends_seen: true,
            fulcrum_miss_squared: 0.0,
            smear_px: 0.0,
            edges: 0..0,
        }
    }
}

/// Share of the tape's colour among the points in sight; `None` if too few are in sight.
fn tape_share(places: &[(usize, usize)]) -> Option<f64> {
    const MIN_IN_SIGHT: usize = 4;
    let (tape, seen) = places.iter().fold((0, 0), |sum, place| (sum.0 + place.0, sum.1 + place.1));
    (seen >= MIN_IN_SIGHT).then(|| tape as f64 / seen as f64)
}

/// Standard deviation of the band's length as measured by a pose, mm. The visible length is foreshortened by the lean
/// and scaled by the depth, and both are uncertain.
fn length_sigma_mm(pose: &TubeEstimate, length_mm: f64) -> f64 {
    let towards = pose.tube.tip.coords.normalize().dot(&pose.tube.axis).abs().min(0.999);
    let by_lean =
        towards / (1.0 - towards * towards).sqrt() * pose.covariance[(3, 3)].max(pose.covariance[(4, 4)]).sqrt();
    let by_depth = pose.covariance[(2, 2)].sqrt() / pose.tube.tip.z;
    length_mm * by_lean.hypot(by_depth)
}
