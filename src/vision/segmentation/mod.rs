//! Frame in, classified cells out (METHOD 2).
//!
//! The colours that an instructor marked decide, by k nearest neighbours, the class of each possible colour. The
//! results are stored in a [`colour_table::ColourTable`], and the frame's pixels are only looked up in it: first
//! around the predicted position of a tool, else on a coarse grid. [`palette`] checks before the recording whether the
//! marked colours can be distinguished at all.

pub mod colour_table;
pub mod encoding;
pub mod knn;
pub mod palette;
pub mod region_of_interest;
pub mod samples;
