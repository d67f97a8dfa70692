//! How hands move tools in the picture: the process noise of both systems' filters. The papers state none with a unit.
//!
//! A hand accelerates a tip by 400 mm/s² for 0.05 s, as in the tracker's own settings, at the usual depth.

/// Usual depth of a tip, mm.
pub(super) const DEPTH_MM: f64 = 200.0;

/// Density of the acceleration in normalised coordinates, 1/s³.
pub(super) const ACCELERATION_DENSITY: f64 = 400.0 / DEPTH_MM * (400.0 / DEPTH_MM) * 0.05;

/// Standard deviation of a first velocity of 150 mm/s, in normalised coordinates, 1/s.
pub(super) const FIRST_SPEED: f64 = 150.0 / DEPTH_MM;
