//! The camera: which pixel shows a point in space, and how the camera is calibrated from photos of a checkerboard.
//!
//! [`model`] is the projection used everywhere; the other files make a camera from photos (METHOD 1):
//!
//! ```text
//! luma plane → checkerboard::find → corners → calibrate (initial → refine → leave out) → Calibration
//! ```
//!
//! [`photo_inspection`] says of a single photo whether it can be used, and if not, why.
//!
//! [`board_pose`] works the other way round: given a known camera, it finds the pose of a board and checks whether the
//! calibration still holds.

mod bent_board;
pub mod board;
pub mod board_pose;
mod calibrate;
pub mod checkerboard;
mod initial;
pub mod model;
pub mod photo_inspection;
mod refine;
pub mod report;
#[cfg(test)]
pub(crate) mod testing;
pub mod view_picker;

pub use board::{Board, BoardProblem};
pub use calibrate::{MIN_PHOTOS, calibrate};
pub use model::Camera;
pub use report::{BoardView, Calibration, CalibrationProblem, Coverage, PhotoReason, PhotoReport};
