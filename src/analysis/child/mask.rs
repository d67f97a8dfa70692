//! Makes a mask of the tools' colours on each picture, marked or not, and a report on the tapes' colours.

use serde::{Deserialize, Serialize};

use super::limits::is_size;
use super::palette::{ColourMark, accept_report, add_pictures};
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord, no_input};
use crate::analysis::marked::MarkedFrames;
use crate::domain::palette::{FrameMask, PaletteReport, ShaftOnFrame};
use crate::domain::problem::Problem;
use crate::media::MediaLimits;
use crate::vision::reason::MissReason;
use crate::vision::tracker::ToolSpec;

/// What masks need besides the pictures.
#[derive(Debug, Serialize, Deserialize)]
pub struct MaskWork {
    /// Marked rectangles.
    pub marks: Vec<ColourMark>,
    /// The tape colour of each tool with tape: a colour occurs twice if two tools wear it.
    pub tools: Vec<String>,
    /// The colours of the masks' classes: of tapes and of bare shafts, each once.
    pub colours: Vec<String>,
    /// The tools without tape, whose shafts are sought.
    pub bare: Vec<ToolSpec>,
    /// The frame that each input shows.
    pub frames: Vec<u64>,
}

/// A record about the pictures.
#[derive(Debug, Serialize, Deserialize)]
pub enum MaskRecord {
    /// The report on the colours.
    Report(PaletteReport),
    /// The pixels classified as tape or as bare shaft in the next picture.
    Mask(FrameMask),
    /// The shaft of a tool in a picture.
    Shaft(ShaftOnFrame),
}

/// What is kept of the pictures.
#[derive(Debug, Default)]
pub struct MaskOutput {
    /// The report on the colours.
    pub report: Option<PaletteReport>,
    /// For each picture, the pixels classified as tape or as bare shaft.
    pub masks: Vec<FrameMask>,
    /// The shafts of the tools without tape, picture by picture.
    pub shafts: Vec<ShaftOnFrame>,
}

impl ChildTask for MaskWork {
    type Record = MaskRecord;
    type Output = MaskOutput;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let mut marked = MarkedFrames::keeping_all();
        add_pictures(&mut marked, &self.marks, &self.frames, inputs, reporter)?;
        let report = marked.report(&self.tools).ok_or_else(no_input)?;
        reporter.record(WorkRecord::Mask(MaskRecord::Report(report)))?;
        let unmarked = || {
            let how = "mark at least one tape or bare shaft, and some background, then try again";
            StopReason::Impossible(Problem::new("no-marks", "Nothing is marked", how))
        };
        for mask in marked.masks(&self.colours).ok_or_else(unmarked)? {
            reporter.record(WorkRecord::Mask(MaskRecord::Mask(mask)))?;
        }
        for shaft in marked.shafts(&self.bare) {
            reporter.record(WorkRecord::Mask(MaskRecord::Shaft(shaft)))?;
        }
        Ok(())
    }

    fn accept(&self, record: MaskRecord, output: &mut MaskOutput, limits: MediaLimits) -> Result<ChildEvent, String> {
        match record {
            MaskRecord::Report(report) => accept_report(&mut output.report, report)?,
            MaskRecord::Mask(mask) => {
                let next = self.frames.get(output.masks.len()).ok_or("a mask without a picture")?;
                if !is_possible(&mask, *next, self.colours.len(), limits) {
                    return Err("an invalid mask".into());
                }
                output.masks.push(mask);
            }
            MaskRecord::Shaft(shaft) => {
                let mut places =
                    self.frames.iter().flat_map(|frame| self.bare.iter().map(move |tool| (*frame, &tool.name)));
                let next = places.nth(output.shafts.len()).ok_or("a shaft without a tool")?;
                if next != (shaft.frame, &shaft.tool) || !is_possible_shaft(&shaft, limits) {
                    return Err("an invalid shaft".into());
                }
                output.shafts.push(shaft);
            }
        }
        Ok(ChildEvent::Nothing)
    }
}

/// True if the cells fill a picture of this frame and name no more colours than there are.
fn is_possible(mask: &FrameMask, frame: u64, colours: usize, limits: MediaLimits) -> bool {
    let FrameMask { width, height, cell_px, columns, rows, runs, .. } = mask;
    let fills = |cells: u32, size: u32| *cell_px > 0 && cells == size.div_ceil(*cell_px);
    let cells: u64 = runs.iter().map(|[_, cells]| u64::from(*cells)).sum();
    mask.frame == frame
        && is_size(*width, *height, limits)
        && fills(*columns, *width)
        && fills(*rows, *height)
        && cells == u64::from(*columns) * u64::from(*rows)
        && runs.iter().all(|[class, cells]| *class as usize <= colours && *cells > 0)
        && runs.windows(2).all(|pair| pair[0][0] != pair[1][0])
}

/// True if its places lie in or next to a picture, and its reason is one that a tracker gives.
fn is_possible_shaft(shaft: &ShaftOnFrame, limits: MediaLimits) -> bool {
    /// A border may leave the picture before it ends: at most so many pictures away.
    const BEYOND: f64 = 2.0;
    let ShaftOnFrame { edges_px, edges_shown, end_px, reason, .. } = shaft;
    let mut places = edges_px.iter().flatten().flatten().chain(end_px).flatten();
    let most = BEYOND * f64::from(limits.width.max(limits.height));
    places.all(|place| place.abs() <= most)
        && edges_shown.is_none_or(|shown| (0.0..=1.0).contains(&shown))
        && reason.as_ref().is_none_or(|reason| MissReason::ALL.iter().any(|known| known.name() == reason))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::ChildWork;
    use crate::analysis::child::probe::ProbeWork;
    use crate::analysis::output_validator::validate_records;
    use crate::vision::tracker::Marker;

    #[test]
    fn a_mask_fills_its_picture_with_known_colours_and_arrives_in_order() {
        let (tools, colours) = (vec!["orange".into()], vec!["orange".into()]);
        let work = ChildWork::Mask(MaskWork { marks: vec![], tools, colours, bare: vec![], frames: vec![3, 9] });
        let mask = |frame, runs: &[[u32; 2]]| {
            let runs = runs.to_vec();
            let mask = FrameMask { frame, width: 9, height: 4, cell_px: 2, columns: 5, rows: 2, runs };
            WorkRecord::Mask(MaskRecord::Mask(mask))
        };
        let whole: &[[u32; 2]] = &[[0, 4], [1, 6]];
        let heard = validate_records(&work, vec![mask(3, whole), mask(9, &[[0, 10]])]).unwrap();
        assert_eq!(heard.mask.masks.len(), 2);
        for (what, records) in [
            ("another picture", vec![mask(9, whole)]),
            ("one picture too many", vec![mask(3, whole), mask(9, whole), mask(3, whole)]),
            ("an unknown colour", vec![mask(3, &[[0, 4], [2, 6]])]),
            ("too few cells", vec![mask(3, &[[0, 4], [1, 5]])]),
            ("an empty run", vec![mask(3, &[[0, 4], [1, 0], [0, 6]])]),
            ("a run in two", vec![mask(3, &[[0, 4], [0, 6]])]),
        ] {
            assert!(validate_records(&work, records).is_err(), "{what}");
        }
        assert!(validate_records(&ChildWork::Probe(ProbeWork), vec![mask(3, whole)]).is_err());
    }

    #[test]
    fn every_bare_tool_has_a_shaft_or_a_reason_on_every_picture() {
        let marker = Marker::Shaft { collar_mm: None, jaw_mm: None };
        let tool =
            |name: &str| ToolSpec { name: name.into(), colour: "shaft".into(), side: None, diameter_mm: 5.0, marker };
        let bare = vec![tool("left"), tool("right")];
        let work =
            ChildWork::Mask(MaskWork { marks: vec![], tools: vec![], colours: vec![], bare, frames: vec![3, 9] });
        let missing = |frame, tool: &str| ShaftOnFrame::new(frame, tool, Err(MissReason::NoMarkerColour));
        let validate = |shafts: Vec<ShaftOnFrame>| {
            validate_records(&work, shafts.into_iter().map(|of| WorkRecord::Mask(MaskRecord::Shaft(of))).collect())
        };
        let found = ShaftOnFrame {
            edges_px: Some([[[0.0, 10.0], [50.0, 20.0]], [[0.0, 20.0], [50.0, 26.0]]]),
            edges_shown: Some(0.9),
            end_px: Some([50.0, 23.0]),
            reason: None,
            ..missing(3, "right")
        };
        let whole = vec![missing(3, "left"), found.clone(), missing(9, "left"), missing(9, "right")];
        assert_eq!(validate(whole.clone()).unwrap().mask.shafts, whole);
        let far = ShaftOnFrame { end_px: Some([1e6, 0.0]), ..found.clone() };
        let unsure = ShaftOnFrame { edges_shown: Some(f64::NAN), ..found.clone() };
        let unknown = ShaftOnFrame { reason: Some("<b>".into()), ..found };
        for (what, second) in [("a place outside", far), ("no share", unsure), ("an unknown reason", unknown)] {
            assert!(validate(vec![missing(3, "left"), second]).is_err(), "{what}");
        }
        assert!(validate(vec![missing(3, "right")]).is_err(), "another tool's turn");
        assert!(validate([whole, vec![missing(9, "right")]].concat()).is_err(), "one too many");
    }
}
