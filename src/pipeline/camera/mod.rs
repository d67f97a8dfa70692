//! The camera: where a point in space is seen, and how photos of a checkerboard tell.
//!
//! [`model`] is the projection used everywhere; the other files make one from photos (METHOD section 1):
//!
//! ```text
//! luma plane → checkerboard::find → corners → calibrate (initial → refine → leave out) → Calibration
//! ```
//!
//! [`glance`](mod@glance) tells of one photo alone whether it will serve, and if not, why.
//!
//! [`placed`] asks the other way round: where does a board lie before a camera that is known, and does it still know it?

mod bend;
pub mod board;
mod calibrate;
pub mod checkerboard;
pub mod film;
pub mod glance;
mod initial;
pub mod model;
pub mod placed;
mod refine;
pub mod report;
#[cfg(test)]
pub(crate) mod testing;

pub use board::{Board, BoardProblem};
pub use calibrate::{FEWEST_PHOTOS, calibrate};
pub use model::Camera;
pub use report::{BoardView, Calibration, CalibrationProblem, Coverage, PhotoReason, PhotoReport};
