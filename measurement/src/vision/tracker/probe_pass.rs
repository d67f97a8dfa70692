//! One pass of probes along a tube's outline: which probes are visible, and the edges that they find.

use super::band_fit::BandFit;
use super::trace::FitRecorder;
use crate::vision::edges::outline_probes::{OutlinePoint, ProbeLayout, border_probes, rim_probes};
use crate::vision::edges::probe::{FittedEdge, LocatedEdge, Probe};
use crate::vision::edges::subpixel::Fineness;
use crate::vision::pose::joint_fit::MeasuredEdge;
use crate::vision::pose::normal_equations::OFFSETS;
use crate::vision::reason::MissReason;
use crate::vision::space::Pixel;
use crate::vision::tube::{BorderSide, Outline, OutlinePart, PerPart, Tube};

/// Settings of one probe pass, for a tube at rest.
#[derive(Clone, Copy)]
pub(super) struct ProbePass {
    /// Length of a chord, pixels.
    pub(super) chord_px: f64,
    /// Search distance on both sides of the outline, pixels.
    pub(super) reach_px: f64,
    /// Precision of the edges.
    pub(super) fineness: Fineness,
}

const STEP: ProbePass = ProbePass { chord_px: 8.0, reach_px: 9.0, fineness: Fineness::Step };
const FINE: ProbePass = ProbePass { chord_px: 10.0, reach_px: 5.0, fineness: Fineness::Fine };
const CLOSE: ProbePass = ProbePass { chord_px: 10.0, reach_px: 3.2, fineness: Fineness::Fine };

/// Probe passes from wide to close: coarse border lines may be two pixels off, the first fit is closer.
pub(super) const PROBE_PASSES: &[ProbePass] = &[STEP, FINE, CLOSE];
/// The first pass for a shaft: its strip is a fraction of a cell off, and a highlight on the shaft has borders, too.
const STRIP_STEP: ProbePass = ProbePass { chord_px: 8.0, reach_px: 4.5, fineness: Fineness::Step };
/// Probe passes for a shaft whose strip was found.
pub(super) const STRIP_PASSES: &[ProbePass] = &[STRIP_STEP, FINE, CLOSE];
/// The passes for a tube that is about right.
pub(super) const FINE_PASSES: &[ProbePass] = &[FINE, CLOSE];
/// The pass for a tube that is right to a few pixels.
pub(super) const CLOSE_PASS: &[ProbePass] = &[CLOSE];

/// Maximum number of chords along one border: errors of an edge come from background and light, and more edges hardly
/// average them out.
const MAX_CHORDS: f64 = 8.0;
/// Length of a chord on a bare shaft's end, pixels: short, to see whether the edge is there all across.
const RIM_CHORD_PX: f64 = 4.0;
/// Number of chords on each border that is enough.
const ENOUGH_CHORDS: usize = 5;

/// Border probes leave out this margin at each end of the band, in tube radii: there the rim bends away.
const END_MARGIN_RADII: f64 = 0.35;

/// Edges along an outline.
#[derive(Default)]
pub(super) struct FoundEdges {
    pub(super) edges: Vec<MeasuredEdge>,
    /// Number of visible probes on each of the four parts.
    pub(super) visible: PerPart<f64>,
    /// Sum of the motion blur across them: standard deviations, pixels.
    smears_px: PerPart<f64>,
    /// The fits to learn from: also of edges that another tool's tape makes doubtful.
    pub(super) fitted: Vec<FittedEdge>,
    /// Extra error of the offsets, as a share of the smear.
    smear_error: f64,
    /// Standard deviation that the edges of the distal end share, pixels, besides the usual one.
    distal_px: f64,
}

/// Extra error of a part's offset when it is smeared, as a share of the smear: of tape, and of a bare shaft. The limbs
/// of a shaft mirror the box, so its edges show the exposure time only to a factor of two. In the even of 42 ray-traced
/// recordings, its borders were then off by up to the smear.
const SMEAR_ERROR: f64 = 0.3;
const SMEAR_ERROR_OF_SHAFT: f64 = 1.0;

impl FoundEdges {
    /// Standard deviations of the offsets, pixels: the usual ones, more where edges are smeared.
    pub(super) fn offsets_px(&self, usual: [f64; OFFSETS]) -> [f64; OFFSETS] {
        let of_borders = self.smear_error_px();
        let [distal, proximal] = OutlinePart::ENDS.map(|part| self.smear_error_of(part));
        let more = [of_borders, of_borders, distal.hypot(self.distal_px), proximal, 0.0, 0.0, 0.0];
        std::array::from_fn(|offset| usual[offset].hypot(more[offset]))
    }

    /// Standard deviation of what smear does to both borders together, pixels.
    pub(super) fn smear_error_px(&self) -> f64 {
        let [first, second] = BorderSide::BOTH.map(|side| self.smear_error_of(OutlinePart::Border(side)));
        0.5 * first.hypot(second)
    }

    fn smear_error_of(&self, part: OutlinePart) -> f64 {
        self.smear_error * self.smears_px[part] / self.visible[part].max(1.0)
    }

    /// Replaces the edges of the distal end by others, which share an error with this standard deviation, pixels.
    pub(super) fn replace_distal_end(&mut self, edges: Vec<MeasuredEdge>, shared_px: f64) {
        self.edges.retain(|edge| edge.point.part() != OutlinePart::DistalEnd);
        self.fitted.retain(|edge| edge.probe.part != OutlinePart::DistalEnd);
        self.visible[OutlinePart::DistalEnd] = edges.len() as f64;
        self.smears_px[OutlinePart::DistalEnd] = 0.0;
        self.distal_px = shared_px;
        self.edges.extend(edges);
    }

    /// Was every visible end found?
    pub(super) fn ends_seen(&self) -> bool {
        const MIN_EDGES: usize = 2;
        OutlinePart::ENDS.into_iter().all(|part| {
            let met = self.edges.iter().filter(|e| e.point.part() == part).count();
            met >= MIN_EDGES || self.visible[part] < MIN_EDGES as f64
        })
    }
}

impl BandFit<'_> {
    pub(super) fn layout(&self, pass: ProbePass) -> ProbeLayout {
        ProbeLayout {
            chord_px: pass.chord_px,
            max_chords: MAX_CHORDS,
            reach_px: pass.reach_px,
            motion_px_s: self.motion_px_s,
            exposure_s: self.edges.exposure_s,
        }
    }

    pub(super) fn locate(&self, probe: &Probe, fineness: Fineness) -> Option<LocatedEdge> {
        let (table, class) = (self.scene.table, self.class);
        let strips = self.scene.strips.filter(|_| self.spec.is_bare());
        self.edges.locate(self.scene.frame, probe, fineness, |codes| match strips {
            Some(strips) => strips.is_shaft_colour(codes),
            None => table.class_of(codes) == class,
        })
    }

    /// Finds the edges along a tube's outline, and counts the probes that are visible.
    pub(super) fn edges_along(
        &self,
        tube: &Tube,
        length_mm: f64,
        pass: ProbePass,
        recorder: &mut FitRecorder,
    ) -> Result<FoundEdges, MissReason> {
        let outline = tube.outline().ok_or(MissReason::PoorFit)?;
        let layout = self.layout(pass);
        let mut probes = self.visible_border_probes(&outline, tube.radius, length_mm, layout);
        self.add_end_probes(tube, &outline, length_mm, layout, &mut probes);
        probes.retain(|(place, probe)| self.scene.is_visible(place.position_on(&outline), probe.middle));
        Ok(self.probe_edges(&probes, pass, recorder))
    }

    /// Finds the edges along a tube's borders alone.
    pub(super) fn border_edges(
        &self,
        tube: &Tube,
        length_mm: f64,
        pass: ProbePass,
        recorder: &mut FitRecorder,
    ) -> Option<FoundEdges> {
        let outline = tube.outline()?;
        let probes = self.visible_border_probes(&outline, tube.radius, length_mm, self.layout(pass));
        Some(self.probe_edges(&probes, pass, recorder))
    }

    /// Locates the edges at these visible probes.
    fn probe_edges(&self, probes: &[(OutlinePoint, Probe)], pass: ProbePass, recorder: &mut FitRecorder) -> FoundEdges {
        let smear_error = if self.spec.is_bare() { SMEAR_ERROR_OF_SHAFT } else { SMEAR_ERROR };
        let mut found = FoundEdges { smear_error, ..FoundEdges::default() };
        recorder.start_pass();
        for (place, probe) in probes {
            self.probe_edge(*place, probe, pass.fineness, &mut found, recorder);
        }
        found
    }

    /// The visible probes along both borders. If only a piece of the band is visible, few chords are left: then the
    /// chords are shorter.
    fn visible_border_probes(
        &self,
        outline: &Outline,
        radius_mm: f64,
        length_mm: f64,
        layout: ProbeLayout,
    ) -> Vec<(OutlinePoint, Probe)> {
        let margin = END_MARGIN_RADII * radius_mm;
        let mut probes: Vec<(OutlinePoint, Probe)> = Vec::new();
        for shorter in [1.0, 2.0] {
            let layout =
                ProbeLayout { chord_px: layout.chord_px / shorter, max_chords: MAX_CHORDS * shorter, ..layout };
            probes.clear();
            border_probes(outline, self.camera(), margin, length_mm - margin, layout, &mut probes);
            probes.retain(|(place, probe)| self.scene.is_visible(place.position_on(outline), probe.middle));
            let count = |part| probes.iter().filter(|(place, _)| place.part() == part).count();
            if BorderSide::BOTH.into_iter().all(|side| count(OutlinePart::Border(side)) >= ENOUGH_CHORDS) {
                break;
            }
        }
        probes
    }

    /// Adds the probes of the distal end, and those of the proximal end if the band's length is known. The latter
    /// reach farther while the length is uncertain.
    fn add_end_probes(
        &self,
        tube: &Tube,
        outline: &Outline,
        length_mm: f64,
        layout: ProbeLayout,
        into: &mut Vec<(OutlinePoint, Probe)>,
    ) {
        const MAX_UNSURE_PX: f64 = 6.0;
        let of_rim = if self.spec.is_bare() { ProbeLayout { chord_px: RIM_CHORD_PX, ..layout } } else { layout };
        rim_probes(outline, self.camera(), 0.0, 0.5 * length_mm, of_rim, into);
        if let Some((_, sigma_mm)) = self.length {
            let unsure_px = (2.0 * sigma_mm * self.px_per_mm_along(tube, length_mm)).min(MAX_UNSURE_PX);
            let wider = ProbeLayout { reach_px: layout.reach_px + unsure_px, ..layout };
            rim_probes(outline, self.camera(), length_mm, 0.5 * length_mm, wider, into);
        }
    }

    /// Locates the edge at one visible probe.
    fn probe_edge(
        &self,
        place: OutlinePoint,
        probe: &Probe,
        fineness: Fineness,
        found: &mut FoundEdges,
        recorder: &mut FitRecorder,
    ) {
        let edge = self.locate(probe, fineness);
        found.fitted.extend(edge.and_then(|edge| edge.fit).map(|fit| FittedEdge { probe: *probe, fit }));
        let at = edge.map(|edge| Pixel(probe.middle.0 + probe.outward * edge.offset_px));
        if at.is_some_and(|at| self.is_next_to_other_tape(at, probe)) {
            return;
        }
        let part = place.part();
        found.visible[part] += 1.0;
        found.smears_px[part] += probe.motion_px_s.abs() * self.edges.exposure_s / 12f64.sqrt();
        recorder.record_probe(probe, at);
        if let (Some(edge), Some(at)) = (edge, at) {
            found.edges.extend(MeasuredEdge::new(place, at, probe.outward, edge.sigma_px, self.camera()));
        }
    }

    /// Does another tool's tape lie just outside an edge? That tool may then be in front of this one, nearer than
    /// expected, and the edge may be its own.
    fn is_next_to_other_tape(&self, edge: Pixel, probe: &Probe) -> bool {
        const OUTSIDE_PX: f64 = 3.0; // past the blur of halved chroma
        let at = edge.0 + probe.outward * OUTSIDE_PX;
        let (width, height) = (self.scene.frame.width() as f64, self.scene.frame.height() as f64);
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < width && at.y < height;
        let class = if inside { self.scene.class_at(at.x, at.y) } else { 0 };
        class != 0 && class != self.class
    }
}
