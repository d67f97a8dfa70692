use nalgebra::Matrix2x3;
use proptest::prelude::*;
use rand::rngs::SmallRng;
use rand::{RngExt, SeedableRng};

use super::*;
use crate::vision::camera::Board;
use crate::vision::camera::testing::wide;

/// Poses as a person would hold a board: tilted to all sides, near and far, over the whole picture.
pub(in crate::vision::camera) fn poses(count: usize) -> Vec<Isometry3<f64>> {
    let pose = |i: usize| {
        let turn = i as f64 * 2.4; // the golden angle spreads them
        let (tilt, depth) = (0.25 + 0.04 * (i % 8) as f64, 260.0 + 25.0 * (i % 5) as f64);
        let aside = Vector3::new(60.0 * (1.7 * turn).cos(), 35.0 * (1.3 * turn).sin(), depth);
        let spin = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3 * i as f64);
        let lean = UnitQuaternion::from_scaled_axis(Vector3::new(turn.cos(), turn.sin(), 0.0) * tilt);
        Isometry3::from_parts(Translation3::from(aside), lean * spin)
    };
    (0..count).map(pose).collect()
}

pub(in crate::vision::camera) fn board() -> Board {
    Board::new(9, 6, 21.0).unwrap()
}

pub(in crate::vision::camera) fn seen(camera: &Camera, pose: &Isometry3<f64>, board: Board) -> Vec<Pixel> {
    board.points_mm().iter().map(|p| project(camera, pose, p).unwrap().0).collect()
}

/// Adds noise of that standard deviation to every coordinate.
pub(in crate::vision::camera) fn noisy(corners: &mut [Pixel], sigma_px: f64, random: &mut SmallRng) {
    let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0; // variance 1, close to Gaussian
    for corner in corners {
        corner.0 += Vector2::new(normal(), normal()) * sigma_px;
    }
}

proptest! {
    #[test]
    fn slopes_agree_with_differences(
        x in -90.0..90.0_f64, y in -60.0..60.0_f64,
        tilt in -0.6..0.6_f64, turn in -3.0..3.0_f64, depth in 200.0..500.0_f64,
    ) {
        let pose = Isometry3::new(Vector3::new(12.0, -7.0, depth), Vector3::new(tilt, -0.5 * tilt, turn));
        let (camera, point) = (wide(), Point2::new(x, y));
        let (_, by_camera, by_pose) = project(&camera, &pose, &point).unwrap();
        let difference = |ahead: Pixel, behind: Pixel, step: f64| (ahead.0 - behind.0) / (2.0 * step);
        for i in 0..INTRINSIC_COUNT {
            let mut step = SVector::<f64, INTRINSIC_COUNT>::zeros();
            step[i] = 1e-5;
            let at = |step: SVector<f64, INTRINSIC_COUNT>| {
                project(&adjusted_camera(&camera, &step), &pose, &point).unwrap().0
            };
            prop_assert!((difference(at(step), at(-step), 1e-5) - by_camera.column(i)).norm() < 1e-4);
        }
        for i in 0..6 {
            let mut step = SVector::<f64, 6>::zeros();
            step[i] = 1e-5;
            let at = |step: SVector<f64, 6>| project(&camera, &moved_pose(&pose, &step), &point).unwrap().0;
            prop_assert!((difference(at(step), at(-step), 1e-5) - by_pose.column(i)).norm() < 1e-3);
        }
    }
}

#[test]
fn slope_against_the_point_agrees_with_differences() {
    let (camera, at) = (wide(), Point3::new(40.0, -25.0, 310.0));
    let (_, _, slope) = project_point(&camera, at).unwrap();
    let columns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| {
        let seen = |k: f64| project_point(&camera, at + axis * (k * 1e-4)).unwrap().0.0;
        (seen(1.0) - seen(-1.0)) / 2e-4
    });
    assert!((Matrix2x3::from_columns(&columns) - slope).norm() < 1e-6);
}

#[test]
fn a_board_behind_the_camera_is_not_seen() {
    assert!(project_point(&wide(), Point3::new(0.0, 0.0, -1.0)).is_none());
}

#[test]
fn the_camera_is_found_from_a_start_without_distortion() {
    let (truth, points) = (wide(), board().points_mm());
    let poses = poses(8);
    let corners: Vec<_> = poses.iter().map(|pose| seen(&truth, pose, board())).collect();
    let photos = corners.iter().zip(&poses).map(|(seen, pose)| PosedPhoto { seen, pose: *pose }).collect();
    let start = Camera { fx: 1100.0, fy: 1100.0, cx: 639.5, cy: 359.5, ..truth }.without_distortion();
    let fit = refine_all(&points, start, photos).unwrap();
    assert!((fit.camera.fx - truth.fx).abs() < 1e-5, "{:?}", fit.camera);
    assert!((fit.camera.k3 - truth.k3).abs() < 1e-6, "{:?}", fit.camera);
}

#[test]
fn standard_deviations_are_those_of_repeated_noisy_calibrations() {
    const REPEATS: usize = 60;
    let (truth, points, poses) = (wide(), board().points_mm(), poses(8));
    let exact: Vec<_> = poses.iter().map(|pose| seen(&truth, pose, board())).collect();
    let mut random = SmallRng::seed_from_u64(1);
    let mut squares = SVector::<f64, INTRINSIC_COUNT>::zeros();
    let mut predicted = SVector::<f64, INTRINSIC_COUNT>::zeros();
    for _ in 0..REPEATS {
        let mut corners = exact.clone();
        corners.iter_mut().for_each(|c| noisy(c, 0.2, &mut random));
        let photos = corners.iter().zip(&poses).map(|(seen, pose)| PosedPhoto { seen, pose: *pose }).collect();
        let fit = refine_all(&points, truth, photos).unwrap();
        let (found, t) = (fit.camera, truth);
        let off = [found.fx - t.fx, found.fy - t.fy, found.cx - t.cx, found.cy - t.cy];
        let lens = [found.k1 - t.k1, found.k2 - t.k2, found.p1 - t.p1, found.p2 - t.p2, found.k3 - t.k3];
        squares += SVector::from_iterator(off.into_iter().chain(lens).map(|d| d * d));
        predicted += fit.covariance.diagonal();
    }
    for i in 0..INTRINSIC_COUNT {
        let ratio = (squares[i] / predicted[i]).sqrt();
        // Sixty repeats give a standard deviation to 9 %; 1 ± 0.3 allows more than three times that.
        assert!((0.7..1.3).contains(&ratio), "number {i}: scatter is {ratio:.2} times the predicted one");
    }
}

#[test]
fn one_wild_corner_hardly_moves_the_camera() {
    let (truth, points, poses) = (wide(), board().points_mm(), poses(8));
    let mut corners: Vec<_> = poses.iter().map(|pose| seen(&truth, pose, board())).collect();
    let mut random = SmallRng::seed_from_u64(2);
    corners.iter_mut().for_each(|c| noisy(c, 0.1, &mut random));
    let fit = |corners: &[Vec<Pixel>]| {
        let photos = corners.iter().zip(&poses).map(|(seen, pose)| PosedPhoto { seen, pose: *pose }).collect();
        let fit = refine_all(&points, truth, photos).unwrap();
        (fit.camera.fx, fit.covariance[(0, 0)].sqrt())
    };
    let (clean, _) = fit(&corners);
    corners[3][10].0.x += 40.0;
    let (spoiled, sigma) = fit(&corners);
    assert!((spoiled - clean).abs() < 2.0 * sigma, "fx moved from {clean} to {spoiled} ± {sigma}");
}
