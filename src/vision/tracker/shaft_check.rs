//! Checks that a bare tube ends where its tip was found.
//!
//! Black jaws continue a black shaft, and have edges of their own. A tip on such an edge would be a centimetre off and look
//! right.

use super::band_fit::BandFit;
use super::probe_pass::FoundEdges;
use crate::vision::pose::joint_fit::MeasuredEdge;
use crate::vision::reason::MissReason;
use crate::vision::tube::{OutlinePart, Tube};

impl BandFit<'_> {
    /// Rejects a tube whose end does not show all across. A shaft that turns into steel or into the box has an edge along
    /// its whole rim; jaws in its own colour leave only pieces of one.
    pub(super) fn check_shaft_end(&self, tube: &Tube, found: &FoundEdges) -> Result<(), MissReason> {
        /// Share of the rim in sight whose edge lies on it. The median over a tool's frames was 0.67 to 1 for steel jaws,
        /// and 0.18 to 0.33 for black ones, in the even of 22 ray-traced recordings.
        const MIN_SHARE: f64 = 0.6;
        /// Largest distance of an edge on the rim, pixels: a few times the error of an edge.
        const ON_RIM_PX: f64 = 1.0;
        let Some(outline) = tube.outline() else { return Err(MissReason::PoorFit) };
        let is_on_rim = |edge: &&MeasuredEdge| {
            edge.point.part() == OutlinePart::DistalEnd
                && edge.residual_px(&outline, self.camera()).is_some_and(|px| px.abs() < ON_RIM_PX)
        };
        let on_rim = found.edges.iter().filter(is_on_rim).count() as f64;
        if on_rim >= MIN_SHARE * found.visible[OutlinePart::DistalEnd] { Ok(()) } else { Err(MissReason::TipHidden) }
    }
}
