//! Frame in, labelled cells out (METHOD 2).
//!
//! The colours that an instructor marked decide, by k nearest neighbours, what each possible colour is; the answer is
//! worked out once into a [`colour_table::ColourTable`], and the frame is then only looked up: first around the place
//! where a tool is expected, else on a coarse grid. Whether those colours can be told apart at all, [`palette`] says before
//! anybody records.

pub mod colour_table;
pub mod encoding;
pub mod knn;
pub mod palette;
pub mod region_of_interest;
pub mod samples;
