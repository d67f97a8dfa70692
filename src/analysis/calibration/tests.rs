//! Calibration from corners with known noise and lenses.

use nalgebra::{Point3, Rotation3, Vector3};
use rand::rngs::SmallRng;
use rand::{RngExt, SeedableRng};

use super::*;
use crate::vision::camera::Camera;
use crate::vision::camera::checkerboard::BoardReason;

const SIZE: (u32, u32) = (960, 600);

fn board() -> Board {
    Board::new(9, 6, 24.0).unwrap()
}

/// Corners of a flat board in 24 poses, some of them far from the centre of the picture, with a noise of 0.05 px.
/// `look` gives the pixel of a point in space, mm.
fn photos(look: impl Fn(Vector3<f64>) -> Pixel) -> Views {
    let mut random = SmallRng::seed_from_u64(5);
    let mut noise = || random.random_range(-0.087..0.087); // 0.05 px RMS
    let mut view = |n: u32| {
        let angle = [0.0, 20.0, 30.0, 36.0_f64][n as usize % 4].to_radians();
        let turn = f64::from(n) * 0.81;
        let direction = Vector3::new(angle.sin() * turn.cos(), angle.sin() * turn.sin() * 0.7, angle.cos()).normalize();
        let tilt = Vector3::new((f64::from(n) * 1.7).sin(), (f64::from(n) * 2.3).cos(), 0.2) * 0.45;
        let rotation = Rotation3::new(tilt);
        let middle = Vector3::new(96.0, 60.0, 0.0);
        let corner = |point: &nalgebra::Point2<f64>| {
            let pixel = look(rotation * (Vector3::new(point.x, point.y, 0.0) - middle) + direction * 420.0);
            Pixel::new(pixel.u() + noise(), pixel.v() + noise())
        };
        BoardView { name: format!("{n}"), corners: Ok(board().points_mm().iter().map(corner).collect()) }
    };
    let inside = |view: &BoardView| {
        let (width, height) = (f64::from(SIZE.0), f64::from(SIZE.1));
        let is_in = |corner: &Pixel| (0.0..width).contains(&corner.u()) && (0.0..height).contains(&corner.v());
        view.corners.as_ref().unwrap().iter().all(is_in)
    };
    let views: Vec<BoardView> = (0..60).map(&mut view).filter(inside).take(24).collect();
    assert_eq!(views.len(), 24);
    Views { views, width: SIZE.0, height: SIZE.1 }
}

/// A lens as the model describes it.
fn usual(point: Vector3<f64>) -> Pixel {
    let (width, height) = SIZE;
    let (fx, fy, cx, cy) = (560.0, 560.0, 478.0, 301.0);
    let camera =
        Camera { width, height, fx, fy, cx, cy, k1: -0.2, k2: 0.05, p1: 0.0, p2: 0.0, k3: 0.0, focal_sigma: 0.0 };
    camera.project(crate::vision::space::CameraPoint(Point3::from(point))).unwrap()
}

/// A lens that shifts each pixel by a wave of 0.6 px: smooth, and unlike any distortion of the model.
fn wavy(point: Vector3<f64>) -> Pixel {
    let pixel = usual(point);
    let wave = |at: f64| 0.6 * (at / 90.0).sin();
    Pixel::new(pixel.u() + wave(pixel.v()), pixel.v() + wave(pixel.u()))
}

/// Every second photo.
fn half(views: &Views, first: usize) -> Views {
    Views { views: views.views.iter().skip(first).step_by(2).cloned().collect(), ..*views }
}

/// Difference of the halves' focal lengths, in units of what the halves state.
fn halves_differ(views: &Views, calibrate_half: impl Fn(&Views) -> Calibration) -> f64 {
    let [a, b] = [0, 1].map(|first| calibrate_half(&half(views, first)));
    (a.camera.fx - b.camera.fx).abs() / a.sigma.fx.hypot(b.sigma.fx)
}

#[test]
fn the_stated_uncertainty_holds_between_the_halves_of_a_set() {
    let by_noise = |views: &Views| calibrate(&views.views, SIZE.0, SIZE.1, board()).unwrap();
    let checked = |views: &Views| calibrate_and_check(views, board()).unwrap().calibration;
    let of_wave = photos(wavy);
    let ratio = checked(&of_wave).sigma.fx / by_noise(&of_wave).sigma.fx;
    assert!(ratio > 1.5, "a lens beside the model is less certain than the noise says: {ratio}");
    assert!(halves_differ(&of_wave, checked) < 2.5, "{}", halves_differ(&of_wave, checked));
    let clean = photos(usual);
    let ratio = checked(&clean).sigma.fx / by_noise(&clean).sigma.fx;
    assert!((1.0..2.0).contains(&ratio), "clean photos keep their uncertainty: {ratio}");
    assert!((checked(&clean).camera.fx - 560.0).abs() < 3.0 * checked(&clean).sigma.fx);
}

#[test]
fn photos_whose_parts_give_other_cameras_are_refused() {
    let clean = photos(usual);
    let mut calibration = calibrate_and_check(&clean, board()).unwrap().calibration;
    assert_eq!(refuse_unstable(&calibration), Ok(()));
    let part = |fx: f64| Calibration { camera: Camera { fx, ..calibration.camera }, ..calibration.clone() };
    let parts = [part(500.0), part(620.0)];
    widen(&mut calibration.sigma, &parts);
    assert!((calibration.sigma.fx - 60.0).abs() < 1e-9, "the jackknife of two groups: {:?}", calibration.sigma);
    let refused = refuse_unstable(&calibration).unwrap_err();
    assert!(refused.to_string().contains("uncertain by 11 % (limit 5 %)"), "{refused}");
    let few = Views { views: clean.views[..MIN_CHECKED_PHOTOS - 1].to_vec(), ..clean };
    assert!(calibrate_and_check(&few, board()).is_ok(), "so few photos cannot be checked; a warning says so");
}

#[test]
fn a_part_that_gives_no_camera_refuses_the_set() {
    let clean = photos(usual);
    let part = calibrate_and_check(&clean, board()).unwrap().calibration;
    assert_eq!(require_all(vec![Some(part.clone()), Some(part.clone())]).unwrap().len(), 2);
    let refused = require_all(vec![Some(part.clone()), None, Some(part)]).unwrap_err();
    assert_eq!(refused, CalibrationRefusal::PartFails { failed: 1, groups: 3 });
}

#[test]
fn photos_at_the_edge_are_known() {
    let views = photos(usual);
    let at_edge = calibrate_and_check(&views, board()).unwrap().at_edge;
    assert_eq!(at_edge.len(), views.views.len());
    assert!(at_edge.contains(&true) && at_edge.contains(&false), "{at_edge:?}");
    let wall = BoardView { name: "wall".into(), corners: Err(BoardReason::NoBoard.into()) };
    assert!(!is_at_edge(&wall, 960, 600));
}
