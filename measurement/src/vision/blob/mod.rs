//! Classified cells in, band candidates out (METHOD 3.1).
//!
//! Touching cells make components. Parts of one band that a crease, glare or the other tool has split are joined if
//! they lie on one line. Components that are too small or wrongly shaped are dropped, with the reason.

pub mod components;
pub mod false_area;
pub mod join;
pub mod moments;
pub mod select;
