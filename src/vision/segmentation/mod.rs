//! Frame in, classified cells out (METHOD 2).
//!
//! [`Classify`] decides what a colour is: the colours that an instructor marked decide it by k nearest neighbours
//! ([`knn`]). The results are stored in a [`colour_table::ColourTable`]. [`Segment`] decides what is at a place: the
//! frame's pixels are only looked up in the table, first around the predicted position of a tool, else on a coarse grid. [`palette`] checks before the recording whether the
//! marked colours can be distinguished at all.

pub mod colour_table;
pub mod encoding;
pub mod knn;
pub mod palette;
pub mod region_of_interest;
pub mod samples;

use crate::vision::frame::Frame;
use region_of_interest::CELL_PX;

/// Decides what is at each place of a frame: 0 for nothing, from 1 on a tool's class.
pub trait Segment {
    /// The class at a pixel.
    fn class_at(&self, frame: &Frame<'_>, x: usize, y: usize) -> u8;

    /// The class of a cell.
    fn class_of_cell(&self, frame: &Frame<'_>, column: usize, row: usize) -> u8 {
        self.class_at(frame, column * CELL_PX, row * CELL_PX)
    }
}

/// Decides the class of a colour: 0 for nothing, from 1 on a tool's class.
pub trait Classify: Send + Sync {
    /// The class of a gamma-coded colour `[Y', Pb, Pr]`.
    fn class_of(&self, colour: [f64; 3]) -> u8;
}
