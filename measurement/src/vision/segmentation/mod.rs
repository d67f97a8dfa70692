//! Frame in, classified cells out (METHOD 2).
//!
//! [`Classify`] gives the class of a colour: by its k nearest neighbours among the colours that an instructor marked
//! ([`knn`]). The results are stored in a [`colour_table::ColourTable`]. [`Segment`] gives the class at a place: the
//! frame's pixels are only looked up in the table, first around the predicted position of a tool, else on a coarse
//! grid. [`palette`] checks before the recording whether the marked colours can be distinguished at all.

pub mod background;
pub mod cells;
pub mod colour_table;
pub mod encoding;
pub mod knn;
pub mod palette;
pub mod region_of_interest;
pub mod samples;
pub mod shaft_colour;
pub mod shaft_evidence;

use std::ops::Range;

use crate::vision::frame::Frame;
use region_of_interest::CELL_PX;

/// Gives the class at each place of a frame: 0 for nothing, from 1 on a tool's class.
pub trait Segment {
    /// The class at a pixel.
    fn class_at(&self, frame: &Frame<'_>, x: usize, y: usize) -> u8;

    /// Appends the classes of each `step`th cell of a row: one call for a row, because a call for each cell would cost
    /// as much as looking it up.
    fn classify_row(&self, frame: &Frame<'_>, row: usize, columns: Range<usize>, step: usize, into: &mut Vec<u8>) {
        into.extend(columns.step_by(step).map(|column| self.class_at(frame, column * CELL_PX, row * CELL_PX)));
    }
}

/// Gives the class of a colour: 0 for nothing, from 1 on a tool's class.
pub trait Classify: Send + Sync {
    /// The class of a gamma-coded colour `[Y', Pb, Pr]`.
    fn class_of(&self, colour: [f64; 3]) -> u8;
}
