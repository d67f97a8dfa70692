//! Records what the tracker looked at on one frame, step by step, for pictures that show why a frame failed.
//!
//! Nothing is recorded unless a trace was requested ([`super::Tracker::observe_traced`]); each recording call then
//! costs one comparison.

use crate::vision::blob::components::Component;
use crate::vision::edges::probe::Probe;
use crate::vision::frame::Frame;
use crate::vision::reason::MissReason;
use crate::vision::segmentation::Segment;
use crate::vision::segmentation::region_of_interest::CellBox;
use crate::vision::space::Pixel;
use crate::vision::tube::Tube;

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
    pub regions: Vec<(Component, Option<MissReason>)>,
    /// Fits of a tube to edges.
    pub fits: Vec<FitTrace>,
}

/// One fit of a tube to the edges in the pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct FitTrace {
    /// The tube at the start.
    pub start: Tube,
    /// Length of its band, mm.
    pub length_mm: f64,
    /// The probe passes, from wide to close.
    pub passes: Vec<ProbePassTrace>,
}

/// One pass of probes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProbePassTrace {
    /// Every visible probe, and the edge it found.
    pub probes: Vec<(Probe, Option<Pixel>)>,
    /// The tube fitted to these edges; `None` if none fits.
    pub fitted: Option<Tube>,
}

/// Records a tool's trace if one was requested.
#[derive(Default)]
pub struct TraceRecorder(Option<ToolTrace>);

impl TraceRecorder {
    /// Starts recording.
    pub fn start(&mut self) {
        self.0 = Some(ToolTrace::default());
    }

    /// Returns the trace and stops recording.
    pub fn finish(&mut self) -> ToolTrace {
        self.0.take().unwrap_or_default()
    }

    pub(super) fn is_recording(&self) -> bool {
        self.0.is_some()
    }

    pub(super) fn record_places(&mut self, places: &[CellBox]) {
        if let Some(trace) = &mut self.0 {
            trace.places.extend(places);
        }
    }

    pub(super) fn record_region(&mut self, region: &Component, refused: Option<MissReason>) {
        if let Some(trace) = &mut self.0 {
            trace.regions.push((*region, refused));
        }
    }

    pub(super) fn record_fits(&mut self, fits: Vec<FitTrace>) {
        if let Some(trace) = &mut self.0 {
            trace.fits.extend(fits);
        }
    }
}

/// Collects the fits of one attempt to measure, if a trace was requested.
pub(super) struct FitRecorder(Option<Vec<FitTrace>>);

impl FitRecorder {
    pub(super) fn new(is_traced: bool) -> Self {
        Self(is_traced.then(Vec::new))
    }

    /// The fits that were tried; empty unless a trace was requested.
    pub(super) fn into_fits(self) -> Vec<FitTrace> {
        self.0.unwrap_or_default()
    }

    pub(super) fn start_fit(&mut self, start: &Tube, length_mm: f64) {
        if let Some(fits) = &mut self.0 {
            fits.push(FitTrace { start: *start, length_mm, passes: Vec::new() });
        }
    }

    pub(super) fn start_pass(&mut self) {
        if let Some(fit) = self.0.as_mut().and_then(|fits| fits.last_mut()) {
            fit.passes.push(ProbePassTrace::default());
        }
    }

    pub(super) fn record_probe(&mut self, probe: &Probe, edge: Option<Pixel>) {
        if let Some(look) = self.last_pass() {
            look.probes.push((*probe, edge));
        }
    }

    pub(super) fn record_fitted_tube(&mut self, tube: &Tube) {
        if let Some(look) = self.last_pass() {
            look.fitted = Some(*tube);
        }
    }

    fn last_pass(&mut self) -> Option<&mut ProbePassTrace> {
        self.0.as_mut()?.last_mut()?.passes.last_mut()
    }
}

/// The class of every cell of a frame, row by row, and the number of cells in a row.
pub(super) fn classify_cells(frame: &Frame<'_>, segment: &dyn Segment) -> (Vec<u8>, usize) {
    let whole = CellBox::whole(frame);
    let mut classes = Vec::with_capacity(whole.width() * whole.height());
    for row in whole.top..whole.bottom {
        segment.classify_row(frame, row, whole.left..whole.right, 1, &mut classes);
    }
    (classes, whole.width())
}
