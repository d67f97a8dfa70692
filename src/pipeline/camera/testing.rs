//! A camera for tests.

use super::Camera;

/// A wide-angle box camera: bends straight lines by many pixels, as cheap lenses do.
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
    }
}
