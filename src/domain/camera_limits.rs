//! Numbers that no camera has. A file with such a number is refused where it is read: every position would be wrong, and
//! the reasons that the tracker then gives would speak of the tape and the light.
//!
//! The limits leave room for every camera that exists, also for cropped and stretched pictures; what is merely unusual
//! is a [`super::camera_warning`].

use nalgebra::Vector2;

use crate::vision::camera::Camera;
use crate::vision::space::{Normalised, Pixel};

/// Smallest focal length, as a share of the picture's diagonal. A fisheye lens that shows 180° across the diagonal has
/// 0.32; a pinhole camera with 0.15 would show 147°.
const MIN_FOCAL: f64 = 0.15;
/// Largest focal length, as a share of the picture's diagonal: it would show 3°, at a box's 200 mm a picture of 10 mm.
const MAX_FOCAL: f64 = 20.0;
/// Largest ratio of the two focal lengths. Stored pixels of wide pictures are up to 1.42 times as wide as high, and those
/// of a single field twice as high as wide.
const MAX_FOCAL_RATIO: f64 = 2.5;
/// Largest distance of the principal point from the picture, in widths or heights of the picture. A picture that is
/// cropped to a quarter of its side, at the edge, has it one width outside, and a little more with the lens off centre.
const MAX_OUTSIDE: f64 = 1.5;
/// Share of the way from the principal point to the border of the picture on which the lens model must not fold. A
/// calibration extrapolates to the very corners, so a fold there is only a warning.
const UNFOLDED_SHARE: f64 = 0.95;
/// Steps on that way.
const STEPS: u32 = 64;

/// What to do about it.
const ADVICE: &str = "check that the file belongs to this camera and its picture size, or calibrate the camera again";

/// Why no camera has these numbers.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ImpossibleCamera {
    /// A focal length that no lens has.
    #[error(
        "{key} is {value}, but the focal length of a lens for pictures of {}×{} is between {:.0} and {:.0} px; {ADVICE}",
        size.0, size.1, limits[0], limits[1]
    )]
    FocalLength {
        /// `fx` or `fy`.
        key: &'static str,
        /// Its value, pixels.
        value: f64,
        /// Width and height of the picture, pixels.
        size: (u32, u32),
        /// Smallest and largest focal length, pixels.
        limits: [f64; 2],
    },
    /// Focal lengths that differ more than pixels are stretched.
    #[error(
        "fx is {fx} and fy is {fy}, but no camera's pixels are more than {MAX_FOCAL_RATIO} times as long as wide; {ADVICE}"
    )]
    FocalRatio {
        /// Focal length in x, pixels.
        fx: f64,
        /// Focal length in y, pixels.
        fy: f64,
    },
    /// A principal point far outside the picture.
    #[error(
        "{key} is {value}, but the principal point lies in the picture, which is {side_px} px {direction}, or at most {MAX_OUTSIDE} times \
         that far beside it if the picture is cropped; {ADVICE}"
    )]
    Centre {
        /// `cx` or `cy`.
        key: &'static str,
        /// Its value, pixels.
        value: f64,
        /// The picture's size in that direction, pixels.
        side_px: u32,
        /// `wide` or `high`.
        direction: &'static str,
    },
    /// A lens model that folds back inside the picture.
    #[error(
        "k1, k2, p1, p2 and k3 ({k1}, {k2}, {p1}, {p2}, {k3}) describe a lens that folds back inside the picture: a real \
         lens shows a point farther out the farther it lies from the axis; check their order and signs (as in OpenCV), and \
         the picture's size, or calibrate the camera again with the board also at the picture's edges"
    )]
    Fold {
        /// Radial distortion, r².
        k1: f64,
        /// Radial distortion, r⁴.
        k2: f64,
        /// Tangential distortion.
        p1: f64,
        /// Tangential distortion.
        p2: f64,
        /// Radial distortion, r⁶.
        k3: f64,
    },
}

/// Checks that a camera with these finite numbers and positive lengths can exist.
///
/// # Errors
/// [`ImpossibleCamera`] for the first number that no camera has.
pub fn check_camera(camera: &Camera) -> Result<(), ImpossibleCamera> {
    let Camera { width, height, fx, fy, cx, cy, k1, k2, p1, p2, k3, .. } = *camera;
    let diagonal = f64::from(width).hypot(f64::from(height));
    let limits = [MIN_FOCAL * diagonal, MAX_FOCAL * diagonal];
    let is_focal = |value: f64| (limits[0]..=limits[1]).contains(&value);
    let is_inside = |value: f64, side_px: u32| {
        let outside = MAX_OUTSIDE * f64::from(side_px);
        (-outside..=f64::from(side_px) + outside).contains(&(value + 0.5)) // pixel centres are whole
    };
    if fx.max(fy) > MAX_FOCAL_RATIO * fx.min(fy) {
        return Err(ImpossibleCamera::FocalRatio { fx, fy });
    }
    if let Some((key, value)) = [("fx", fx), ("fy", fy)].into_iter().find(|(_, value)| !is_focal(*value)) {
        return Err(ImpossibleCamera::FocalLength { key, value, size: (width, height), limits });
    }
    let centre = [("cx", cx, width, "wide"), ("cy", cy, height, "high")];
    if let Some((key, value, side_px, direction)) = centre.into_iter().find(|(_, value, px, _)| !is_inside(*value, *px))
    {
        return Err(ImpossibleCamera::Centre { key, value, side_px, direction });
    }
    if folds_back(camera) { Err(ImpossibleCamera::Fold { k1, k2, p1, p2, k3 }) } else { Ok(()) }
}

/// Whether the lens model folds on the way from the principal point to a corner or to the middle of a side.
fn folds_back(camera: &Camera) -> bool {
    let sides = |size: u32| [0.0, 0.5, 1.0].map(|share| share * (f64::from(size) - 1.0));
    let border = sides(camera.width).into_iter().flat_map(|u| sides(camera.height).map(|v| Vector2::new(u, v)));
    let centre = Vector2::new(camera.cx, camera.cy);
    let mut ends = border.map(|end| centre + UNFOLDED_SHARE * (end - centre));
    ends.any(|end| {
        let Some(sight) = camera.normalised_of(Pixel::new(end.x, end.y)) else { return true };
        let grows = |step: u32| {
            let at = sight.0.coords * (f64::from(step) / f64::from(STEPS));
            let (_, jacobian) = camera.distort_with_jacobian(Normalised::new(at.x, at.y));
            jacobian.determinant() > 0.0 && jacobian.trace() > 0.0
        };
        !(0..=STEPS).all(grows)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_cameras::{STRAIGHT, wide};

    /// The camera of a picture that shows a part of another's: the columns and rows from `left` and `top` on.
    fn cropped(of: Camera, [left, top]: [u32; 2], [width, height]: [u32; 2]) -> Camera {
        Camera { width, height, cx: of.cx - f64::from(left), cy: of.cy - f64::from(top), ..of }
    }

    #[test]
    fn cameras_that_exist_are_accepted() {
        let fisheye = Camera { fx: 470.0, fy: 470.0, ..STRAIGHT };
        let field = Camera { height: 360, fy: 450.0, cy: 179.5, ..STRAIGHT };
        let anamorphic = Camera { fx: 900.0 / 1.42, ..STRAIGHT };
        let mut cameras = vec![STRAIGHT, wide(), fisheye, field, anamorphic];
        for (place, size) in [([0, 0], [640, 360]), ([640, 360], [640, 360]), ([960, 540], [320, 180])] {
            cameras.extend([cropped(STRAIGHT, place, size), cropped(wide(), place, size)]);
        }
        // The strongest barrel distortion of box cameras, wide and less wide.
        cameras.push(Camera { fx: 0.55 * 1280.0, fy: 0.55 * 1280.0, k1: -0.33, k2: 0.13, k3: 0.0, ..STRAIGHT });
        cameras.push(Camera { fx: 1.0 * 1280.0, fy: 1.0 * 1280.0, k1: -0.40, k2: 0.05, k3: 0.0, ..STRAIGHT });
        for camera in cameras {
            assert_eq!(check_camera(&camera), Ok(()), "{camera:?}");
        }
    }

    #[test]
    fn each_number_that_no_camera_has_is_refused_by_its_key_and_value() {
        let impossible = [
            (Camera { cx: 6400.0, ..wide() }, "cx is 6400,"),
            (Camera { cy: -1081.0, ..wide() }, "cy is -1081,"),
            (Camera { fy: wide().fx / 10.0, ..wide() }, "fy is 93.8,"),
            (Camera { fx: 9.0, fy: 9.0, ..wide() }, "fx is 9,"),
            (Camera { fx: 3e4, fy: 3e4, ..wide() }, "fx is 30000,"),
            (Camera { k1: -1.5, k2: 0.0, k3: 0.0, ..wide() }, "(-1.5, 0,"),
            (Camera { k1: -1.5, k2: 0.0, k3: 1.0, ..wide() }, "(-1.5, 0,"),
            (Camera { p2: 0.5, ..wide() }, "0.5, -0.012)"),
        ];
        for (camera, named) in impossible {
            let text = check_camera(&camera).unwrap_err().to_string();
            assert!(text.contains(named) && text.contains("calibrate the camera again"), "{text}");
        }
    }

    #[test]
    fn radial_models_are_refused_exactly_if_they_turn_before_the_corner() {
        let corner = (639.5_f64).hypot(359.5) / 900.0;
        for k1 in (0..60).map(|step| -0.02 * f64::from(step)) {
            let turn = if k1 < 0.0 { 2.0 / 3.0 / (-3.0 * k1).sqrt() } else { f64::INFINITY }; // r + k1·r³ is largest there
            let refused = check_camera(&Camera { k1, ..STRAIGHT }).is_err();
            assert_eq!(refused, turn < UNFOLDED_SHARE * corner, "k1 {k1}: turns at {turn}, the corner is at {corner}");
        }
    }
}
