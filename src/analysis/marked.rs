//! Frames on which an instructor marked colours: their samples, and what those are worth.

use crate::domain::palette::PaletteReport;
use crate::media::Picture;
use crate::pipeline::blob::false_area::false_area;
use crate::pipeline::frame::Frame;
use crate::pipeline::segmentation::colour_table::ColourTable;
use crate::pipeline::segmentation::knn::Knn;
use crate::pipeline::segmentation::palette::confusion::Confusion;
use crate::pipeline::segmentation::palette::{FalseArea, verdict};
use crate::pipeline::segmentation::samples::{ColourSamples, Rectangle};

/// Frames kept to be looked over when all colours are known; more marked frames than this give samples alone. A 1080p
/// frame takes 3 MB.
const FRAMES_KEPT: usize = 6;

/// Marked frames, one after the other.
#[derive(Default)]
pub struct MarkedFrames {
    samples: Option<ColourSamples>,
    kept: Vec<MarkedFrame>,
}

/// A frame, and what is marked on it.
type MarkedFrame = (Picture, Vec<Rectangle>);

impl MarkedFrames {
    /// Takes what is marked on a frame; every frame may come, also with nothing marked. The first one's encoding is that
    /// of all samples.
    pub fn take(&mut self, picture: Picture, marks: Vec<Rectangle>) {
        let frame = picture.frame();
        let samples = self.samples.get_or_insert_with(|| ColourSamples::new(frame.encoding));
        for mark in &marks {
            samples.collect(&frame, mark);
        }
        if !marks.is_empty() && self.kept.len() < FRAMES_KEPT {
            self.kept.push((picture, marks));
        }
    }

    /// The samples; `None` if no frame came.
    pub fn samples(&self) -> Option<&ColourSamples> {
        self.samples.as_ref()
    }

    /// Judges the colours against each other and against the frames; `None` if no frame came. `tapes` has the colour that
    /// each tool wears: twice, where two wear the same.
    pub fn report(&self, tapes: &[String]) -> Option<PaletteReport> {
        let samples = self.samples.as_ref()?;
        let mut colours: Vec<String> = Vec::new();
        for tape in tapes {
            if !colours.contains(tape) {
                colours.push(tape.clone());
            }
        }
        let confusion = Confusion::of(samples, &colours);
        let false_areas = self.false_areas(samples, &colours, tapes);
        let verdicts = verdict::judge(&confusion, &false_areas);
        Some(PaletteReport::new(&confusion, &verdicts, &false_areas))
    }

    fn false_areas(&self, samples: &ColourSamples, colours: &[String], tapes: &[String]) -> Vec<FalseArea> {
        let classes = samples.classes(colours);
        let wearers = |colour: &String| tapes.iter().filter(|tape| *tape == colour).count();
        let worn: Vec<(&String, usize)> = colours.iter().map(|colour| (colour, wearers(colour))).collect();
        let of_one_encoding = |frames: &[MarkedFrame]| {
            let knn = Knn::new(samples, &classes)?;
            let table = ColourTable::new(knn, frames[0].0.frame().encoding);
            let on_frame = |(picture, marks): &MarkedFrame| of_frame(&picture.frame(), &table, marks, &worn);
            Some(frames.iter().flat_map(on_frame).collect::<Vec<_>>())
        };
        let encoding = |(picture, _): &MarkedFrame| picture.frame().encoding;
        self.kept.chunk_by(|a, b| encoding(a) == encoding(b)).filter_map(of_one_encoding).flatten().collect()
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
