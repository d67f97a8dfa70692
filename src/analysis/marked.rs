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
    kept: Vec<(Picture, Vec<Rectangle>)>,
}

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

    /// Judges the colours of these tools against each other and against the frames; `None` if no frame came.
    pub fn report(&self, tools: &[String]) -> Option<PaletteReport> {
        let samples = self.samples.as_ref()?;
        let confusion = Confusion::of(samples, tools);
        let false_areas = self.false_areas(samples, tools);
        let verdicts = verdict::judge(&confusion, &false_areas);
        Some(PaletteReport::new(&confusion, &verdicts, &false_areas))
    }

    fn false_areas(&self, samples: &ColourSamples, tools: &[String]) -> Vec<FalseArea> {
        let class = |label: &String| tools.iter().position(|tool| tool == label).map_or(0, |i| i as u8 + 1);
        let classes: Vec<u8> = samples.labels.iter().map(class).collect();
        let on_frame = |(picture, marks): &(Picture, Vec<Rectangle>)| {
            let frame = picture.frame();
            let table = Knn::new(samples, &classes).map(|knn| ColourTable::new(knn, frame.encoding));
            table.map_or_else(Vec::new, |table| of_frame(&frame, &table, marks, tools))
        };
        self.kept.iter().flat_map(on_frame).collect()
    }
}

/// The false area of each tool that is marked on this frame.
fn of_frame(frame: &Frame<'_>, table: &ColourTable, marks: &[Rectangle], tools: &[String]) -> Vec<FalseArea> {
    let of_tool = |(index, tool): (usize, &String)| {
        let own: Vec<&Rectangle> = marks.iter().filter(|mark| mark.label == *tool).collect();
        false_area(frame, table, index as u8 + 1, &own)
    };
    tools.iter().enumerate().filter_map(of_tool).collect()
}
