//! One pass of probes along a tube's outline: which probes are visible, and the edges that they find.

use nalgebra::Point3;

use super::band_fit::BandFit;
use crate::vision::edges::outline_probes::{OutlinePoint, ProbeLayout, border_probes, rim_probes};
use crate::vision::edges::probe::{LocatedEdge, Probe};
use crate::vision::edges::subpixel::Fineness;
use crate::vision::pose::joint_fit::MeasuredEdge;
use crate::vision::reason::MissReason;
use crate::vision::space::Pixel;
use crate::vision::tube::Tube;

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

/// Maximum number of chords along one border: errors of an edge come from background and light, and more edges hardly
/// average them out.
const MAX_CHORDS: f64 = 8.0;
/// Number of chords on each border that is enough.
const ENOUGH_CHORDS: usize = 5;

/// Border probes leave out this margin at each end of the band, in tube radii: there the rim bends away.
const END_MARGIN_RADII: f64 = 0.35;

/// Edges along an outline.
#[derive(Default)]
pub(super) struct FoundEdges {
    pub(super) edges: Vec<MeasuredEdge>,
    /// Number of visible probes on each of the four parts.
    pub(super) visible: [f64; 4],
    /// Sum of the motion blur across them: standard deviations, pixels.
    smears_px: [f64; 4],
}

/// Extra error of a part's offset when it is smeared, as a share of the smear.
const SMEAR_ERROR: f64 = 0.3;

impl FoundEdges {
    /// Standard deviations of the offsets, pixels: the usual ones, more where edges are smeared.
    pub(super) fn offsets_px(&self, usual: [f64; 4]) -> [f64; 4] {
        let smear = |part: usize| SMEAR_ERROR * self.smears_px[part] / self.visible[part].max(1.0);
        let of_borders = 0.5 * smear(0).hypot(smear(1));
        let more = [of_borders, of_borders, smear(2), smear(3)];
        std::array::from_fn(|offset| usual[offset].hypot(more[offset]))
    }

    /// Was every visible end found?
    pub(super) fn ends_seen(&self) -> bool {
        const MIN_EDGES: usize = 2;
        [2, 3].into_iter().all(|part| {
            let met = self.edges.iter().filter(|e| e.point.part() == part).count();
            met >= MIN_EDGES || self.visible[part] < MIN_EDGES as f64
        })
    }
}

impl BandFit<'_> {
    pub(super) fn layout(&self, look: ProbePass) -> ProbeLayout {
        ProbeLayout {
            chord_px: look.chord_px,
            max_chords: MAX_CHORDS,
            reach_px: look.reach_px,
            motion_px_s: self.motion_px_s,
            exposure_s: self.edges.exposure_s,
        }
    }

    pub(super) fn locate(&mut self, probe: &Probe, fineness: Fineness) -> Option<LocatedEdge> {
        let (table, class) = (self.table, self.class);
        self.edges.locate(self.frame, probe, fineness, |codes| table.class_of(codes) == class)
    }

    /// Finds the edges along a tube's outline, and counts the probes that are visible.
    pub(super) fn edges_along(
        &mut self,
        tube: &Tube,
        length_mm: f64,
        look: ProbePass,
    ) -> Result<FoundEdges, MissReason> {
        let outline = tube.outline().ok_or(MissReason::ImpossiblePose)?;
        let layout = self.layout(look);
        let margin = END_MARGIN_RADII * tube.radius;
        let mut probes: Vec<(OutlinePoint, Probe)> = Vec::new();
        // If only a piece of the band is visible, few chords are left: use shorter ones.
        for shorter in [1.0, 2.0] {
            let layout =
                ProbeLayout { chord_px: layout.chord_px / shorter, max_chords: MAX_CHORDS * shorter, ..layout };
            probes.clear();
            border_probes(&outline, self.camera, margin, length_mm - margin, layout, &mut probes);
            probes.retain(|(place, probe)| self.is_visible(place.position_on(&outline), probe.middle));
            if (0..2).all(|side| probes.iter().filter(|(place, _)| place.part() == side).count() >= ENOUGH_CHORDS) {
                break;
            }
        }
        rim_probes(&outline, self.camera, 0.0, 0.5 * length_mm, layout, &mut probes);
        if let Some((_, sigma_mm)) = self.length {
            const MAX_UNSURE_PX: f64 = 6.0;
            let unsure_px = (2.0 * sigma_mm * self.px_per_mm_along(tube, length_mm)).min(MAX_UNSURE_PX);
            let wider = ProbeLayout { reach_px: layout.reach_px + unsure_px, ..layout };
            rim_probes(&outline, self.camera, length_mm, 0.5 * length_mm, wider, &mut probes);
        }
        let mut found = FoundEdges::default();
        self.trace.start_pass();
        for (place, probe) in &probes {
            if !self.is_visible(place.position_on(&outline), probe.middle) {
                continue;
            }
            let edge = self.locate(probe, look.fineness);
            let at = edge.map(|edge| Pixel(probe.middle.0 + probe.outward * edge.offset_px));
            if at.is_some_and(|at| self.is_next_to_other_tape(at, probe)) {
                continue;
            }
            found.visible[place.part()] += 1.0;
            found.smears_px[place.part()] += probe.motion_px_s.abs() * self.edges.exposure_s / 12f64.sqrt();
            self.trace.record_probe(probe, at);
            let (Some(edge), Some(at)) = (edge, at) else { continue };
            found.edges.extend(MeasuredEdge::new(*place, at, probe.outward, edge.sigma_px, self.camera));
        }
        Ok(found)
    }

    /// Does another tool's tape lie just outside an edge? That tool may then be in front of this one, nearer than
    /// expected, and the edge may be its own.
    fn is_next_to_other_tape(&self, edge: Pixel, probe: &Probe) -> bool {
        const OUTSIDE_PX: f64 = 3.0; // past the blur of halved chroma
        let at = edge.0 + probe.outward * OUTSIDE_PX;
        let inside =
            at.x >= 0.0 && at.y >= 0.0 && at.x < self.frame.width() as f64 && at.y < self.frame.height() as f64;
        let class = if inside { self.table.class_of(self.frame.yuv_at(at.x as usize, at.y as usize)) } else { 0 };
        class != 0 && class != self.class
    }

    /// Is a point of the outline inside the frame, and in front of all other tools?
    pub(super) fn is_visible(&self, place: Point3<f64>, at: Pixel) -> bool {
        const RIM_PX: f64 = 3.0;
        const CLEAR_PX: f64 = 4.0;
        let (width, height) = (self.frame.width() as f64, self.frame.height() as f64);
        let in_frame = at.u() > RIM_PX && at.v() > RIM_PX && at.u() < width - RIM_PX && at.v() < height - RIM_PX;
        let clear = CLEAR_PX / self.camera.fx;
        in_frame && !self.obstacles.iter().any(|other| other.hides(place.coords, place.z, clear))
    }
}
