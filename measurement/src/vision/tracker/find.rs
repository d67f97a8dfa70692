//! Find: the regions of a tool's colour, around its predicted position or anywhere on the frame.

use super::frame_context::FrameContext;
use super::predict::Band;
use super::tool::ToolTracker;
use crate::vision::blob::components::Component;
use crate::vision::blob::{join, select};
use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::segmentation::region_of_interest::{CellBox, coarse_search};
use crate::vision::space::CameraPoint;

/// Minimum margin around an expected band, pixels: two cells, because a narrow band can leave its own width between
/// two frames.
const MIN_MARGIN_PX: f64 = 16.0;

impl ToolTracker {
    /// Regions of the tool's colour near its expected band, or anywhere if there is none; the largest first.
    pub(super) fn find_regions(&mut self, scene: &FrameContext<'_>, expected: Option<Band>) -> Vec<Component> {
        let areas = self.search_areas(scene, expected);
        self.find_regions_in(scene, &areas, |_, _| true)
    }

    /// Areas to search: around the predicted position, or everywhere on the frame that has the tool's colour.
    pub(super) fn search_areas(&self, scene: &FrameContext<'_>, expected: Option<Band>) -> Vec<CellBox> {
        match expected {
            Some(band) => cells_around_band(&band, scene.camera(), scene.frame).into_iter().collect(),
            None => coarse_search(scene.frame, scene.segment, self.class),
        }
    }

    /// Regions of the tool's colour, the largest first. Cells (column, row) for which `counts` is false are treated as
    /// background.
    pub(super) fn find_regions_in(
        &mut self,
        scene: &FrameContext<'_>,
        areas: &[CellBox],
        counts: impl Fn(usize, usize) -> bool,
    ) -> Vec<Component> {
        self.trace.record_places(areas);
        let mut regions = Vec::new();
        for area in areas {
            let parts =
                self.finder.find_where(scene.frame, scene.segment, self.class, *area, select::MIN_CELLS, &counts);
            let (band, others) = join::join_collinear(parts);
            regions.extend(band);
            regions.extend(others);
        }
        regions.sort_by_key(|r: &Component| std::cmp::Reverse(r.moments.cells()));
        regions
    }
}

/// The cells around a band.
fn cells_around_band(band: &Band, camera: &Camera, frame: &Frame<'_>) -> Option<CellBox> {
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for corner in band.tube.outline()?.corners(band.length_mm) {
        let pixel = camera.project(CameraPoint(corner))?;
        low = [low[0].min(pixel.u()), low[1].min(pixel.v())];
        high = [high[0].max(pixel.u()), high[1].max(pixel.v())];
    }
    let width_px = camera.fx * 2.0 * band.tube.radius / band.tube.tip.z;
    CellBox::around(low, high, width_px.max(MIN_MARGIN_PX), frame)
}
