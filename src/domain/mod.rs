//! What the centre's people talk about, parsed once at the rim: a value of these types is valid.
//!
//! [`files`] holds the exchange formats (camera.json, annotations.json, trajectories, truth).

pub mod files;
pub mod problem;
