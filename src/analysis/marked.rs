//! Frames on which an instructor marked colours: collects the samples, judges them, and makes masks of the pixels that
//! they classify as tape or as bare shaft.

use crate::domain::palette::{FrameMask, PaletteReport, ShaftOnFrame};
use crate::media::Picture;
use crate::vision::blob::false_area::false_area;
use crate::vision::frame::Frame;
use crate::vision::segmentation::Segment;
use crate::vision::segmentation::colour_table::ColourTable;
use crate::vision::segmentation::knn::Knn;
use crate::vision::segmentation::palette::confusion::Confusion;
use crate::vision::segmentation::palette::{FalseArea, verdict};
use crate::vision::segmentation::region_of_interest::{CELL_PX, CellBox};
use crate::vision::segmentation::samples::{ColourSamples, MarkedRectangle};
use crate::vision::still::{self, StillTool};
use crate::vision::strip::finder::BareTool;
use crate::vision::surroundings::{Surroundings, SurroundingsSampler};
use crate::vision::tracker::ToolSpec;

/// Most marked frames kept for the report, which needs all colours; further frames only give samples. A 1080p frame
/// takes 3 MB.
const MAX_FRAMES_KEPT: usize = 6;

/// Most cells of a mask. In a larger picture only every second or third cell is classified, so that the worst case fits
/// into one record.
const MAX_MASK_CELLS: usize = 1 << 20;

/// Collects marked frames, one after the other.
#[derive(Default)]
pub struct MarkedFrames {
    samples: Option<ColourSamples>,
    surroundings: SurroundingsSampler,
    kept: Vec<MarkedFrame>,
    keeps_all: bool,
}

/// A frame and the rectangles marked on it.
type MarkedFrame = (Picture, Vec<MarkedRectangle>);

/// Groups one frame's marks, given with their stroke numbers, into strokes: each is one or more rectangles with the
/// same label.
pub fn group_into_strokes(marks: impl Iterator<Item = (Option<u32>, MarkedRectangle)>) -> Vec<Vec<MarkedRectangle>> {
    let mut strokes: Vec<(Option<u32>, Vec<MarkedRectangle>)> = Vec::new();
    for (number, mark) in marks {
        let is_same = |(other, of): &&mut (Option<u32>, Vec<MarkedRectangle>)| {
            number.is_some() && number == *other && of.first().is_some_and(|first| first.label == mark.label)
        };
        match number.and_then(|_| strokes.iter_mut().find(is_same)) {
            Some((_, stroke)) => stroke.push(mark),
            None => strokes.push((number, vec![mark])),
        }
    }
    strokes.into_iter().map(|(_, stroke)| stroke).collect()
}

/// The distinct tape colours of the tools.
pub fn colours_of(tapes: &[String]) -> Vec<String> {
    let mut colours: Vec<String> = Vec::new();
    for tape in tapes {
        if !colours.contains(tape) {
            colours.push(tape.clone());
        }
    }
    colours
}

impl MarkedFrames {
    /// Keeps every frame, to make a mask of each.
    pub fn keeping_all() -> Self {
        Self { keeps_all: true, ..Self::default() }
    }

    /// Adds a frame and its marks, stroke by stroke. Frames without marks are allowed. All samples use the encoding of
    /// the first frame.
    pub fn add(&mut self, picture: Picture, strokes: Vec<Vec<MarkedRectangle>>) {
        let frame = picture.frame();
        self.surroundings.sample_frame(&frame);
        let samples = self.samples.get_or_insert_with(|| ColourSamples::new(frame.encoding));
        for stroke in &strokes {
            samples.collect_stroke(&frame, stroke);
        }
        if self.keeps_all || !strokes.is_empty() && self.kept.len() < MAX_FRAMES_KEPT {
            self.kept.push((picture, strokes.into_iter().flatten().collect()));
        }
    }

    /// For each kept frame, which cells have which of these colours, of tapes or bare shafts; `None` without a sample.
    pub fn masks(&self, colours: &[String]) -> Option<Vec<FrameMask>> {
        let samples = self.samples.as_ref().filter(|samples| !samples.samples.is_empty())?;
        Some(self.map_frames(samples, colours, |(picture, _), table| vec![mask_of(&picture.frame(), table)]))
    }

    /// The samples; `None` if no frame was added.
    pub fn samples(&self) -> Option<&ColourSamples> {
        self.samples.as_ref()
    }

    /// Columns and rows of the first marked frame; `None` if no frame was marked.
    pub fn frame_size(&self) -> Option<[usize; 2]> {
        self.kept.first().map(|(picture, _)| [picture.frame().width(), picture.frame().height()])
    }

    /// What stands still in the frames; `None` if no frame was added, or if they are too small.
    pub fn surroundings(&self) -> Option<Surroundings> {
        self.surroundings.surroundings()
    }

    /// Judges the colours against each other and against the frames; `None` if no frame was added. `tapes` has one
    /// entry per tool, so a colour that two tools wear is in it twice.
    pub fn report(&self, tapes: &[String]) -> Option<PaletteReport> {
        let samples = self.samples.as_ref()?;
        let colours = colours_of(tapes);
        let confusion = Confusion::of(samples, &colours);
        let false_areas = self.false_areas(samples, &colours, tapes);
        let verdicts = verdict::judge(&confusion, &false_areas);
        Some(PaletteReport::new(&confusion, &verdicts, &false_areas))
    }

    /// The shaft of each of these tools without tape on each kept frame. Each frame is looked at alone.
    pub fn shafts(&self, tools: &[ToolSpec]) -> Vec<ShaftOnFrame> {
        let bare: Vec<&ToolSpec> = tools.iter().filter(|tool| tool.is_bare()).collect();
        let Some(samples) = self.samples.as_ref().filter(|_| !bare.is_empty()) else { return Vec::new() };
        let wanted: Vec<StillTool> = bare.iter().map(|tool| still_tool(tool)).collect();
        let of_frame = |(picture, _): &MarkedFrame| {
            let frame = picture.frame();
            let measured = still::shafts(&frame, samples, &wanted).into_iter().zip(&bare);
            measured.map(|(shaft, tool)| ShaftOnFrame::new(frame.index, &tool.name, shaft)).collect::<Vec<_>>()
        };
        self.kept.iter().flat_map(of_frame).collect()
    }

    fn false_areas(&self, samples: &ColourSamples, colours: &[String], tapes: &[String]) -> Vec<FalseArea> {
        let wearers = |colour: &String| tapes.iter().filter(|tape| *tape == colour).count();
        let worn: Vec<(&String, usize)> = colours.iter().map(|colour| (colour, wearers(colour))).collect();
        self.map_frames(samples, colours, |(picture, marks), table| {
            false_areas_of_frame(&picture.frame(), table, marks, &worn)
        })
    }

    /// Applies `look` to the kept frames; each run of frames with the same encoding gets its own colour table.
    fn map_frames<T>(
        &self,
        samples: &ColourSamples,
        colours: &[String],
        look: impl Fn(&MarkedFrame, &ColourTable) -> Vec<T>,
    ) -> Vec<T> {
        let classes = samples.classes(colours);
        let of_one_encoding = |frames: &[MarkedFrame]| {
            let knn = Knn::new(samples, &classes)?;
            let table = ColourTable::new(knn, frames[0].0.frame().encoding);
            Some(frames.iter().flat_map(|frame| look(frame, &table)).collect::<Vec<_>>())
        };
        let encoding = |(picture, _): &MarkedFrame| picture.frame().encoding;
        self.kept.chunk_by(|a, b| encoding(a) == encoding(b)).filter_map(of_one_encoding).flatten().collect()
    }
}

fn still_tool(spec: &ToolSpec) -> StillTool {
    let tool = BareTool { side: spec.side, diameter_mm: spec.diameter_mm };
    StillTool { colour: spec.colour.clone(), tool, collar_mm: spec.collar_mm() }
}

/// The class of each cell of a frame, looked up as the tracker does.
fn mask_of(frame: &Frame<'_>, segment: &dyn Segment) -> FrameMask {
    let whole = CellBox::whole(frame);
    let mut every = 1;
    while whole.width().div_ceil(every) * whole.height().div_ceil(every) > MAX_MASK_CELLS {
        every += 1;
    }
    let mut runs: Vec<[u32; 2]> = Vec::new();
    let mut classes = Vec::new();
    for row in (0..whole.height()).step_by(every) {
        segment.classify_row(frame, row, 0..whole.width(), every, &mut classes);
    }
    for class in classes.into_iter().map(u32::from) {
        match runs.last_mut() {
            Some([last, cells]) if *last == class => *cells += 1,
            _ => runs.push([class, 1]),
        }
    }
    FrameMask {
        frame: frame.index,
        width: frame.width() as u32,
        height: frame.height() as u32,
        cell_px: (CELL_PX * every) as u32,
        columns: whole.width().div_ceil(every) as u32,
        rows: whole.height().div_ceil(every) as u32,
        runs,
    }
}

/// The false area of each colour that is marked on this frame. Each colour is given with the number of tools that wear
/// it.
fn false_areas_of_frame(
    frame: &Frame<'_>,
    segment: &dyn Segment,
    marks: &[MarkedRectangle],
    colours: &[(&String, usize)],
) -> Vec<FalseArea> {
    let of_colour = |(index, (colour, wearers)): (usize, &(&String, usize))| {
        let own: Vec<&MarkedRectangle> = marks.iter().filter(|mark| mark.label == **colour).collect();
        false_area(frame, segment, index as u8 + 1, &own, *wearers)
    };
    colours.iter().enumerate().filter_map(of_colour).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_are_one_mark_only_if_they_share_a_stroke_and_a_label() {
        let mark = |label: &str, x| MarkedRectangle { label: label.to_owned(), x, y: 0, w: 2, h: 2 };
        let marks = [
            (Some(1), mark("orange", 0)),
            (None, mark("orange", 1)),
            (Some(2), mark("orange", 2)),
            (Some(1), mark("orange", 3)),
            (Some(1), mark("background", 4)),
            (None, mark("orange", 5)),
        ];
        let columns = |stroke: Vec<MarkedRectangle>| stroke.iter().map(|mark| mark.x).collect::<Vec<_>>();
        let found: Vec<Vec<usize>> = group_into_strokes(marks.into_iter()).into_iter().map(columns).collect();
        assert_eq!(found, [vec![0, 3], vec![1], vec![2], vec![4], vec![5]]);
    }
}
