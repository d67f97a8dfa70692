//! What the tracker looked at on one frame, step by step: for pictures that show why a frame failed.
//!
//! Nothing is kept unless a trace was asked for ([`super::Tracker::observe_traced`]): each note then costs one comparison.

use crate::pipeline::blob::components::Component;
use crate::pipeline::edges::probe::Probe;
use crate::pipeline::frame::Frame;
use crate::pipeline::reason::Reason;
use crate::pipeline::segmentation::colour_table::ColourTable;
use crate::pipeline::segmentation::region_of_interest::{CellBox, class_at};
use crate::pipeline::space::Pixel;
use crate::pipeline::tube::Tube;

/// What was looked at on one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTrace {
    /// Class of every cell of the frame, row by row: 0 for no tool, else the tool's index and 1.
    pub classes: Vec<u8>,
    /// Cells in a row.
    pub columns: usize,
    /// One entry per tool.
    pub tools: Vec<ToolTrace>,
}

/// What was looked at for one tool, in order. Where it was followed from its expected place, nothing was searched.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToolTrace {
    /// Places in which regions of its colour were sought.
    pub places: Vec<CellBox>,
    /// Regions that were taken for its band, and why they are none; the last one may be it.
    pub regions: Vec<(Component, Option<Reason>)>,
    /// Tubes that were laid onto the edges.
    pub fits: Vec<Fit>,
}

/// One tube laid onto the edges that the pixels show.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Where it was laid first.
    pub start: Tube,
    /// Length of its band, mm.
    pub length_mm: f64,
    /// From wide to close.
    pub looks: Vec<Look>,
}

/// One round of probing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Look {
    /// Every probe in sight, and where it met an edge.
    pub probes: Vec<(Probe, Option<Pixel>)>,
    /// The tube that fits these edges; `None` where none does.
    pub fitted: Option<Tube>,
}

/// Takes notes, if anybody wants them.
#[derive(Default)]
pub struct Tracing(Option<ToolTrace>);

impl Tracing {
    /// Takes notes from now on.
    pub fn begin(&mut self) {
        self.0 = Some(ToolTrace::default());
    }

    /// Hands out the notes and takes no more.
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

/// The class of every cell of a frame, row by row, and how many cells a row has.
pub(super) fn classes(frame: &Frame<'_>, table: &ColourTable) -> (Vec<u8>, usize) {
    let whole = CellBox::whole(frame);
    let rows = whole.top..whole.bottom;
    let of_row = |row| (whole.left..whole.right).map(move |column| class_at(frame, table, column, row));
    (rows.flat_map(of_row).collect(), whole.width())
}
