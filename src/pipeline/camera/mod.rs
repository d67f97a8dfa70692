//! The camera: where a point in space is seen, and how photos of a checkerboard tell.
//!
//! [`model`] is the projection used everywhere; the other files make one from photos (METHOD section 1).

pub mod model;

pub use model::Camera;
