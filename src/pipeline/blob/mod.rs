//! Labelled cells in, band candidates out (METHOD 3.1).
//!
//! Touching cells make components; parts of one band that a crease, glare or the other tool has split are joined when
//! they lie on one line; what is too small or wrongly shaped is dropped, with the reason.

pub mod components;
pub mod false_area;
pub mod join;
pub mod moments;
pub mod select;
