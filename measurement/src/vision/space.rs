//! A type per space, so that a distorted pixel cannot be used where a normalised point is meant.

use nalgebra::{Point2, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A position in the recorded (distorted) frame, pixels; (0, 0) is the centre of the top-left pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel(pub Point2<f64>);

/// A direction of sight `(x/z, y/z)` with the lens's distortion removed; no unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normalised(pub Point2<f64>);

/// A position in the camera frame: x right, y down, z forward, millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPoint(pub Point3<f64>);

impl Pixel {
    /// The pixel at column `u` and row `v`.
    pub fn new(u: f64, v: f64) -> Self {
        Self(Point2::new(u, v))
    }

    /// Column, pixels.
    pub fn u(&self) -> f64 {
        self.0.x
    }

    /// Row, pixels.
    pub fn v(&self) -> f64 {
        self.0.y
    }
}

impl Normalised {
    /// The direction `(x, y, 1)`.
    pub fn new(x: f64, y: f64) -> Self {
        Self(Point2::new(x, y))
    }

    /// The ray `(x, y, 1)` through this point, not normalised to length 1.
    pub fn ray(&self) -> Vector3<f64> {
        Vector3::new(self.0.x, self.0.y, 1.0)
    }
}

impl CameraPoint {
    /// Where the point is seen; `None` behind the camera or in its plane.
    pub fn normalised(&self) -> Option<Normalised> {
        (self.0.z > 0.0).then(|| Normalised::new(self.0.x / self.0.z, self.0.y / self.0.z))
    }
}

/// The side of a tool's hand, as the camera sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum HandSide {
    /// Left in the picture.
    Left,
    /// Right in the picture.
    Right,
}
