//! The fixed parts of a training box: camera, lens, lamps and trocars, which stay the same for all trainees.

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::light::{Lamp, Lighting};
use crate::random::Dice;
use crate::vision::camera::Camera;

/// Position of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RigView {
    /// In the lid, facing straight down; hands enter at the lower edge of the picture.
    Top,
    /// At the trainee's side, at an angle; tools come down from the upper corners.
    Side,
}

/// Properties of lens and sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// Lens blur, standard deviation, pixels.
    pub blur_px: f64,
    /// Light lost at the picture's corner, share.
    pub vignetting: f64,
    /// Exposure time, s; it sets the motion blur.
    pub exposure_s: f64,
    /// Sensor noise in the dark, standard deviation, share of white.
    pub read_noise: f64,
    /// Photon noise at white, standard deviation, share of white.
    pub shot_noise: f64,
}

/// One box.
#[derive(Clone, Debug)]
pub struct Rig {
    /// The camera.
    pub camera: Camera,
    /// Position of the camera.
    pub view: RigView,
    /// Board frame (x right, y to the trainee, z into the board; origin in its middle) → camera frame, mm.
    pub camera_from_board: Isometry3<f64>,
    /// Left and right trocar, camera frame, mm.
    pub fulcrums: [Point3<f64>; 2],
    /// Light.
    pub lighting: Lighting,
    /// Lens and sensor.
    pub optics: Optics,
}

impl Rig {
    /// The box of this number, with a camera of this picture size. Lens and mounting differ a little from box to box.
    pub fn new(number: u64, view: RigView, width: u32, height: u32) -> Self {
        let mut dice = Dice::new(number, "rig");
        let camera = camera(&mut dice, width, height);
        let camera_from_board = mounting(&mut dice, view);
        let to_camera = |x, y, over| camera_from_board * above(x, y, over);
        let fulcrums = match view {
            RigView::Top => [to_camera(-112.0, 96.0, 188.0), to_camera(112.0, 96.0, 188.0)],
            RigView::Side => [to_camera(-128.0, 42.0, 176.0), to_camera(128.0, 42.0, 176.0)],
        };
        let scale = f64::from(width).hypot(f64::from(height)) / DIAGONAL_720P;
        let optics = Optics {
            blur_px: 0.35 + 0.4 * scale,
            vignetting: 0.38,
            exposure_s: 0.006,
            read_noise: 0.0022,
            shot_noise: 0.011,
        };
        Self { camera, view, camera_from_board, fulcrums, lighting: lighting(&camera_from_board), optics }
    }

    /// The same box after its camera was moved to the camera's right by `right_mm`.
    pub fn moved(self, right_mm: f64) -> Self {
        let shift = Translation3::new(-right_mm, 0.0, 0.0);
        let camera_from_board = shift * self.camera_from_board;
        let fulcrums = self.fulcrums.map(|fulcrum| shift * fulcrum);
        Self { camera_from_board, fulcrums, lighting: lighting(&camera_from_board), ..self }
    }
}

/// The point at `x`, `y` on the board, `over` mm above it; board frame.
pub fn above(x: f64, y: f64, over: f64) -> Point3<f64> {
    Point3::new(x, y, -over)
}

const DIAGONAL_720P: f64 = 1468.6;

/// A wide-angle camera module: about 69° across at 16:9, barrel distortion; the same lens at every picture size.
fn camera(dice: &mut Dice, width: u32, height: u32) -> Camera {
    let scale = f64::from(width).hypot(f64::from(height)) / DIAGONAL_720P;
    let focal = scale * 935.0 * (1.0 + 0.015 * dice.within(-1.0, 1.0));
    Camera {
        width,
        height,
        fx: focal,
        fy: focal * (1.0 + 0.002 * dice.within(-1.0, 1.0)),
        cx: 0.5 * f64::from(width - 1) + scale * dice.within(-9.0, 9.0),
        cy: 0.5 * f64::from(height - 1) + scale * dice.within(-9.0, 9.0),
        k1: -0.29 + 0.015 * dice.within(-1.0, 1.0),
        k2: 0.1 + 0.006 * dice.within(-1.0, 1.0),
        p1: 0.0008 * dice.within(-1.0, 1.0),
        p2: 0.0008 * dice.within(-1.0, 1.0),
        k3: -0.012,
        focal_sigma: 0.0,
    }
}

fn mounting(dice: &mut Dice, view: RigView) -> Isometry3<f64> {
    let (eye, target) = match view {
        RigView::Top => (above(0.0, 30.0, 236.0), above(0.0, -3.0, 0.0)),
        RigView::Side => (above(0.0, 150.0, 158.0), above(0.0, -8.0, 12.0)),
    };
    let eye = eye + dice.gauss3() * 2.0;
    let forward = (target - eye).normalize();
    let right = (Vector3::x() - forward * forward.x).normalize();
    let down = forward.cross(&right);
    let camera_from_board = Rotation3::from_basis_unchecked(&[right, down, forward]).inverse();
    let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.02 * dice.gauss());
    let turn = roll * UnitQuaternion::from_rotation_matrix(&camera_from_board);
    Isometry3::from_parts(Translation3::from(-(turn * eye.coords)), turn)
}

/// A ring of LEDs round the lens, and daylight through the lid from the left.
fn lighting(camera_from_board: &Isometry3<f64>) -> Lighting {
    let up = camera_from_board * Vector3::new(0.0, 0.0, -1.0);
    let ring = Lamp { at: Point3::new(6.0, -12.0, -6.0), radius: 13.0, power: [1.02, 0.99, 0.94] };
    let window = Lamp { at: camera_from_board * above(-150.0, -60.0, 235.0), radius: 34.0, power: [0.8, 0.83, 0.9] };
    Lighting {
        lamps: [ring, window],
        ambient: [0.36, 0.36, 0.36],
        below: [0.22, 0.19, 0.16],
        above: [0.4, 0.41, 0.44],
        up,
    }
}
