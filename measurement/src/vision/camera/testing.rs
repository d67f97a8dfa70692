//! Cameras for tests. The tests of the crate `trocar` include this file, too.

use crate::vision::camera::Camera;

/// A wide-angle box camera: it bends straight lines by many pixels, as cheap lenses do.
pub fn wide() -> Camera {
    Camera {
        width: 1280,
        height: 720,
        fx: 938.0,
        fy: 936.1,
        cx: 633.5,
        cy: 366.2,
        k1: -0.298,
        k2: 0.103,
        p1: -0.0006,
        p2: 0.0009,
        k3: -0.012,
        focal_sigma: 0.0,
    }
}

/// A pinhole camera without distortion.
pub const STRAIGHT: Camera = Camera {
    width: 1280,
    height: 720,
    fx: 900.0,
    fy: 900.0,
    cx: 639.5,
    cy: 359.5,
    k1: 0.0,
    k2: 0.0,
    p1: 0.0,
    p2: 0.0,
    k3: 0.0,
    focal_sigma: 0.0,
};
