//! Frames on which an instructor marked colours: their samples, what those are worth, and what of any frame they take for tape.

use crate::domain::palette::{FrameMask, PaletteReport};
use crate::media::Picture;
use crate::pipeline::blob::false_area::false_area;
use crate::pipeline::frame::Frame;
use crate::pipeline::segmentation::colour_table::ColourTable;
use crate::pipeline::segmentation::knn::Knn;
use crate::pipeline::segmentation::palette::confusion::Confusion;
use crate::pipeline::segmentation::palette::{FalseArea, verdict};
use crate::pipeline::segmentation::region_of_interest::{CELL_PX, CellBox, class_at};
use crate::pipeline::segmentation::samples::{ColourSamples, Rectangle};

/// Frames kept to be looked over when all colours are known; more marked frames than this give samples alone. A 1080p
/// frame takes 3 MB.
const FRAMES_KEPT: usize = 6;

/// Most cells of a mask: of a larger picture every second or third one is looked at, so that a record holds the worst of them.
const MOST_CELLS: usize = 1 << 20;

/// Marked frames, one after the other.
#[derive(Default)]
pub struct MarkedFrames {
    samples: Option<ColourSamples>,
    kept: Vec<MarkedFrame>,
    keeps_all: bool,
}

/// A frame, and what is marked on it.
type MarkedFrame = (Picture, Vec<Rectangle>);

/// The marks of one frame with the number of their stroke, put together: each is one or more rectangles of a label.
pub fn strokes(marks: impl Iterator<Item = (Option<u32>, Rectangle)>) -> Vec<Vec<Rectangle>> {
    let mut strokes: Vec<(Option<u32>, Vec<Rectangle>)> = Vec::new();
    for (number, mark) in marks {
        let is_same = |(other, of): &&mut (Option<u32>, Vec<Rectangle>)| {
            number.is_some() && number == *other && of.first().is_some_and(|first| first.label == mark.label)
        };
        match number.and_then(|_| strokes.iter_mut().find(is_same)) {
            Some((_, stroke)) => stroke.push(mark),
            None => strokes.push((number, vec![mark])),
        }
    }
    strokes.into_iter().map(|(_, stroke)| stroke).collect()
}

/// The colours of tape of tools, each once.
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
    /// Keeps every frame, to make masks of them all.
    pub fn keeping_all() -> Self {
        Self { keeps_all: true, ..Self::default() }
    }

    /// Takes what is marked on a frame, stroke by stroke; every frame may come, also with nothing marked. The first one's
    /// encoding is that of all samples.
    pub fn take(&mut self, picture: Picture, strokes: Vec<Vec<Rectangle>>) {
        let frame = picture.frame();
        let samples = self.samples.get_or_insert_with(|| ColourSamples::new(frame.encoding));
        for stroke in &strokes {
            samples.collect_stroke(&frame, stroke);
        }
        if self.keeps_all || !strokes.is_empty() && self.kept.len() < FRAMES_KEPT {
            self.kept.push((picture, strokes.into_iter().flatten().collect()));
        }
    }

    /// What of every frame kept the tracker takes for which of these colours of tape; `None` without a sample.
    pub fn masks(&self, colours: &[String]) -> Option<Vec<FrameMask>> {
        let samples = self.samples.as_ref().filter(|samples| !samples.samples.is_empty())?;
        Some(self.of_frames(samples, colours, |(picture, _), table| vec![mask_of(&picture.frame(), table)]))
    }

    /// The samples; `None` if no frame came.
    pub fn samples(&self) -> Option<&ColourSamples> {
        self.samples.as_ref()
    }

    /// Judges the colours against each other and against the frames; `None` if no frame came. `tapes` has the colour that
    /// each tool wears: twice, where two wear the same.
    pub fn report(&self, tapes: &[String]) -> Option<PaletteReport> {
        let samples = self.samples.as_ref()?;
        let colours = colours_of(tapes);
        let confusion = Confusion::of(samples, &colours);
        let false_areas = self.false_areas(samples, &colours, tapes);
        let verdicts = verdict::judge(&confusion, &false_areas);
        Some(PaletteReport::new(&confusion, &verdicts, &false_areas))
    }

    fn false_areas(&self, samples: &ColourSamples, colours: &[String], tapes: &[String]) -> Vec<FalseArea> {
        let wearers = |colour: &String| tapes.iter().filter(|tape| *tape == colour).count();
        let worn: Vec<(&String, usize)> = colours.iter().map(|colour| (colour, wearers(colour))).collect();
        self.of_frames(samples, colours, |(picture, marks), table| of_frame(&picture.frame(), table, marks, &worn))
    }

    /// Looks over the frames kept, each with a table of its own encoding.
    fn of_frames<T>(
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

/// The class of each of a frame's cells, as the tracker looks them up.
fn mask_of(frame: &Frame<'_>, table: &ColourTable) -> FrameMask {
    let whole = CellBox::whole(frame);
    let mut every = 1;
    while whole.width().div_ceil(every) * whole.height().div_ceil(every) > MOST_CELLS {
        every += 1;
    }
    let mut runs: Vec<[u32; 2]> = Vec::new();
    for row in (0..whole.height()).step_by(every) {
        for column in (0..whole.width()).step_by(every) {
            let class = u32::from(class_at(frame, table, column, row));
            match runs.last_mut() {
                Some([last, cells]) if *last == class => *cells += 1,
                _ => runs.push([class, 1]),
            }
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

/// The false area of each colour that is marked on this frame. Colours come with how many tools wear them.
fn of_frame(
    frame: &Frame<'_>,
    table: &ColourTable,
    marks: &[Rectangle],
    colours: &[(&String, usize)],
) -> Vec<FalseArea> {
    let of_colour = |(index, (colour, wearers)): (usize, &(&String, usize))| {
        let own: Vec<&Rectangle> = marks.iter().filter(|mark| mark.label == **colour).collect();
        false_area(frame, table, index as u8 + 1, &own, *wearers)
    };
    colours.iter().enumerate().filter_map(of_colour).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_are_one_mark_only_if_they_share_a_stroke_and_a_label() {
        let mark = |label: &str, x| Rectangle { label: label.to_owned(), x, y: 0, w: 2, h: 2 };
        let marks = [
            (Some(1), mark("orange", 0)),
            (None, mark("orange", 1)),
            (Some(2), mark("orange", 2)),
            (Some(1), mark("orange", 3)),
            (Some(1), mark("background", 4)),
            (None, mark("orange", 5)),
        ];
        let columns = |stroke: Vec<Rectangle>| stroke.iter().map(|mark| mark.x).collect::<Vec<_>>();
        let found: Vec<Vec<usize>> = strokes(marks.into_iter()).into_iter().map(columns).collect();
        assert_eq!(found, [vec![0, 3], vec![1], vec![2], vec![4], vec![5]]);
    }
}
