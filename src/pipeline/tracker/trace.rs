//! Records what the tracker looked at on one frame, step by step, for pictures that show why a frame failed.
//!
//! Nothing is recorded unless a trace was requested ([`super::Tracker::observe_traced`]); each recording call then
//! costs one comparison.

use crate::pipeline::blob::components::Component;
use crate::pipeline::edges::probe::Probe;
use crate::pipeline::frame::Frame;
use crate::pipeline::reason::Reason;
use crate::pipeline::segmentation::colour_table::ColourTable;
use crate::pipeline::segmentation::region_of_interest::{CellBox, class_at};
use crate::pipeline::space::Pixel;
use crate::pipeline::tube::Tube;

/// Everything that was looked at on one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTrace {
    /// Class of every cell of the frame, row by row: 0 for no tool, else the class of the tool's colour.
    pub classes: Vec<u8>,
    /// Cells in a row.
    pub columns: usize,
    /// One entry per tool.
    pub tools: Vec<ToolTrace>,
}

/// Everything that was looked at for one tool, in order. A tool that was followed at its predicted position was not
/// searched for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToolTrace {
    /// Areas searched for regions of its colour.
    pub places: Vec<CellBox>,
    /// Regions that were measured, with the reason if rejected; the last one may be the band.
    pub regions: Vec<(Component, Option<Reason>)>,
    /// Fits of a tube to edges.
    pub fits: Vec<Fit>,
}

/// One fit of a tube to the edges in the pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The tube at the start.
    pub start: Tube,
    /// Length of its band, mm.
    pub length_mm: f64,
    /// The probe passes, from wide to close.
    pub looks: Vec<Look>,
}

/// One pass of probes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Look {
    /// Every visible probe, and the edge it found.
    pub probes: Vec<(Probe, Option<Pixel>)>,
    /// The tube fitted to these edges; `None` if none fits.
    pub fitted: Option<Tube>,
}

/// Records a trace if one was requested.
#[derive(Default)]
pub struct Tracing(Option<ToolTrace>);

impl Tracing {
    /// Starts recording.
    pub fn begin(&mut self) {
        self.0 = Some(ToolTrace::default());
    }

    /// Returns the trace and stops recording.
    pub fn end(&mut self) -> ToolTrace {
        self.0.take().unwrap_or_default()
    }

    pub(super) fn places(&mut self, places: &[CellBox]) {
        if let Some(trace) = &mut self.0 {
            trace.places.extend(places);
        }
    }

    pub(super) fn region(&mut self, region: &Component, refused: Option<Reason>) {
        if let Some(trace) = &mut self.0 {
            trace.regions.push((*region, refused));
        }
    }

    pub(super) fn fit(&mut self, start: &Tube, length_mm: f64) {
        if let Some(trace) = &mut self.0 {
            trace.fits.push(Fit { start: *start, length_mm, looks: Vec::new() });
        }
    }

    pub(super) fn look(&mut self) {
        if let Some(fit) = self.0.as_mut().and_then(|trace| trace.fits.last_mut()) {
            fit.looks.push(Look::default());
        }
    }

    pub(super) fn probe(&mut self, probe: &Probe, edge: Option<Pixel>) {
        if let Some(look) = self.last_look() {
            look.probes.push((*probe, edge));
        }
    }

    pub(super) fn fitted(&mut self, tube: &Tube) {
        if let Some(look) = self.last_look() {
            look.fitted = Some(*tube);
        }
    }

    fn last_look(&mut self) -> Option<&mut Look> {
        self.0.as_mut()?.fits.last_mut()?.looks.last_mut()
    }
}

/// The class of every cell of a frame, row by row, and the number of cells in a row.
pub(super) fn classes(frame: &Frame<'_>, table: &ColourTable) -> (Vec<u8>, usize) {
    let whole = CellBox::whole(frame);
    let rows = whole.top..whole.bottom;
    let of_row = |row| (whole.left..whole.right).map(move |column| class_at(frame, table, column, row));
    (rows.flat_map(of_row).collect(), whole.width())
}
