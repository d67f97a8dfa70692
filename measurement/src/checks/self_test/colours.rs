//! Finds regions of today's picture that have a tape's colour while no tape is in it.
//!
//! In: frames where the tracker follows no tool. Out: for each colour the largest region taken for it, as the median
//! over these frames ([`FalseColour`]); a tool that comes into sight is on few of them. The colours' margins describe
//! the frames that were marked; this check describes the box as it is today, and finds objects that were not marked. A
//! search costs as much as tracking some frames.

use crate::numbers::quantile::quantile;
use crate::vision::blob::components::ComponentFinder;
use crate::vision::frame::{ColourEncoding, Frame};
use crate::vision::segmentation::colour_table::ColourTable;
use crate::vision::segmentation::knn::Knn;
use crate::vision::segmentation::region_of_interest::{CELL_PX, CellBox};
use crate::vision::segmentation::samples::ColourSamples;
use crate::vision::tracker::ToolSpec;

/// Time between two searches, s.
const SEARCH_INTERVAL_S: f64 = 0.4;

/// Maximum of searches. They are enough: the empty box is requested for 3 s at the beginning and some seconds later.
const MAX_SEARCHES: usize = 40;

/// A region of the empty box that is taken for a tape.
#[derive(Clone, Debug, PartialEq)]
pub struct FalseColour {
    /// Label of the tape's colour.
    pub colour: String,
    /// Largest region, pixels.
    pub largest_px: f64,
}

/// Searches for the tapes' colours in pictures without a tape.
pub struct ColourWatch {
    table: Option<ColourTable>,
    /// Each colour with the largest region of every search, pixels.
    colours: Vec<(String, Vec<f64>)>,
    last_s: f64,
}

impl ColourWatch {
    /// Prepares to search for the tape colours of these tools in pictures of this encoding.
    pub fn new(samples: &ColourSamples, tools: &[ToolSpec], encoding: ColourEncoding) -> Self {
        let mut colours: Vec<String> = Vec::new();
        for tool in tools.iter().filter(|tool| !tool.is_bare()) {
            if !colours.contains(&tool.colour) {
                colours.push(tool.colour.clone());
            }
        }
        let knn = Knn::new(samples, &samples.classes(&colours));
        let colours = colours.into_iter().map(|colour| (colour, Vec::new())).collect();
        Self { table: knn.map(|knn| ColourTable::new(knn, encoding)), colours, last_s: f64::NEG_INFINITY }
    }

    /// Searches a frame without tools, if the interval has passed.
    pub fn search_frame(&mut self, frame: &Frame<'_>) {
        let is_known = self.colours.iter().all(|(_, seen)| seen.len() >= MAX_SEARCHES);
        if is_known || frame.time_s < self.last_s + SEARCH_INTERVAL_S {
            return;
        }
        let Some(table) = &self.table else { return };
        self.last_s = frame.time_s;
        for (class, (_, seen)) in (1..).zip(&mut self.colours) {
            let found = ComponentFinder::default().find(frame, table, class, CellBox::whole(frame), 1);
            let cells = found.iter().map(|region| region.moments.cells()).max().unwrap_or(0);
            seen.push((cells * CELL_PX * CELL_PX) as f64);
        }
    }

    /// The false colours found; empty if no frame was without tools.
    pub fn into_false_colours(self) -> Vec<FalseColour> {
        let median = |(colour, seen)| Some(FalseColour { colour, largest_px: quantile(seen, 0.5)? });
        self.colours.into_iter().filter_map(median).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{Matrix, Plane, Range};
    use crate::vision::segmentation::samples::ColourSample;
    use crate::vision::tracker::Marker;

    const ENCODING: ColourEncoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
    const ORANGE: [u8; 3] = [150, 60, 200];
    const GREY: [u8; 3] = [60, 128, 128];

    /// The result for frames 0.4 s apart; each has this many orange columns of 32.
    fn seen(columns: &[usize]) -> Vec<FalseColour> {
        const SIZE: [usize; 2] = [32, 16];
        let sample = |(label, yuv)| ColourSample { label, rectangle: label as u32, yuv };
        let samples = ColourSamples {
            encoding: ENCODING,
            labels: vec!["orange".into(), "background".into()],
            samples: [(0, ORANGE), (1, GREY)].map(sample).repeat(5),
            places: Vec::new(),
        };
        let (diameter_mm, colour) = (5.0, "orange".to_owned());
        let tool =
            ToolSpec { name: "left".into(), colour, side: None, diameter_mm, marker: Marker::Band { length_mm: None } };
        let mut watch = ColourWatch::new(&samples, &[tool], ENCODING);
        for (number, orange) in columns.iter().enumerate() {
            let code = |plane: usize| -> Vec<u8> {
                (0..SIZE[0] * SIZE[1]).map(|i| if i % SIZE[0] < *orange { ORANGE } else { GREY }[plane]).collect()
            };
            let codes = [0, 1, 2].map(code);
            let [y, u, v] =
                [0, 1, 2].map(|i| Plane { data: &codes[i], stride: SIZE[0], width: SIZE[0], height: SIZE[1] });
            let time_s = SEARCH_INTERVAL_S * number as f64;
            watch.search_frame(&Frame {
                index: number as u64,
                time_s,
                y,
                u,
                v,
                shift_x: 0,
                shift_y: 0,
                chroma_first_px: [0.0; 2],
                encoding: ENCODING,
            });
        }
        watch.into_false_colours()
    }

    #[test]
    fn what_stays_is_measured_and_a_tool_that_comes_into_sight_is_not_taken_for_the_box() {
        let orange = |largest_px| vec![FalseColour { colour: "orange".into(), largest_px }];
        assert_eq!(seen(&[0, 0, 0]), orange(0.0));
        assert_eq!(seen(&[0, 0, 0, 12, 20]), orange(0.0));
        assert_eq!(seen(&[4, 4, 4, 12]), orange(4.0 * 16.0));
        assert_eq!(seen(&[]), [], "nothing is known of a box that was never empty");
    }
}
