use nalgebra::{Isometry3, Point3, Vector2};
use rand::SeedableRng;
use rand::rngs::SmallRng;

use super::*;
use crate::vision::camera::refine::tests::{board, noisy, poses, seen};
use crate::vision::camera::testing::wide;
use crate::vision::space::CameraPoint;

fn views(count: usize, sigma_px: f64) -> Vec<BoardView> {
    let mut random = SmallRng::seed_from_u64(7);
    let view = |(i, pose): (usize, &Isometry3<f64>)| {
        let mut corners = seen(&wide(), pose, board());
        noisy(&mut corners, sigma_px, &mut random);
        BoardView { name: format!("photo_{i}"), corners: Ok(corners) }
    };
    poses(count).iter().enumerate().map(view).collect()
}

fn calibrated(views: &[BoardView]) -> Result<Calibration, CalibrationProblem> {
    calibrate(views, 1280, 720, board())
}

/// Corners of a board curved about one axis; its middle bulges by `bulge_mm`.
fn bent(pose: &Isometry3<f64>, bulge_mm: f64) -> Vec<Pixel> {
    let half = 84.0;
    let on_board = |p: &Point2<f64>| Point3::new(p.x, p.y, bulge_mm * (1.0 - (p.x / half).powi(2)));
    board().points_mm().iter().map(|p| wide().project(CameraPoint(pose * on_board(p))).unwrap()).collect()
}

fn left_out(calibration: &Calibration) -> Vec<&str> {
    calibration.photos.iter().filter(|p| !p.is_used()).map(|p| p.name.as_str()).collect()
}

/// Largest distance between the pixels where two cameras see the same direction, over the picture.
fn largest_displacement_px(a: &Camera, b: &Camera) -> f64 {
    let grid = (0..=16).flat_map(|i| (0..=9).map(move |j| Pixel::new(f64::from(80 * i), f64::from(79 * j))));
    grid.map(|p| (a.pixel_of(b.normalised_of(p).unwrap()).0 - p.0).norm()).fold(0.0, f64::max)
}

#[test]
fn synthetic_photos_give_back_the_camera() {
    let calibration = calibrated(&views(12, 0.0)).unwrap();
    assert!(largest_displacement_px(&calibration.camera, &wide()) < 1e-4, "{:?}", calibration.camera);
    assert!(calibration.rms_px < 1e-5);
    assert_eq!(left_out(&calibration), [""; 0]);
}

#[test]
fn rms_is_the_noise_of_both_coordinates() {
    let calibration = calibrated(&views(12, 0.1)).unwrap();
    let expected = 0.1 * 2.0_f64.sqrt(); // per corner, as OpenCV counts; the unknowns take 5 % of it
    assert!((0.9 * expected..1.02 * expected).contains(&calibration.rms_px), "{}", calibration.rms_px);
    let mean = calibration.photos.iter().map(|p| p.rms_px.unwrap().powi(2)).sum::<f64>() / 12.0;
    assert!((mean.sqrt() - calibration.rms_px).abs() < 1e-9);
}

#[test]
fn bent_boards_are_left_out_by_name_and_the_camera_is_as_good_as_without_them() {
    let mut views = views(16, 0.05);
    let straight: Vec<_> =
        views.iter().enumerate().filter(|(i, _)| ![3, 8, 11].contains(i)).map(|v| v.1.clone()).collect();
    for i in [3, 8, 11] {
        views[i].corners = Ok(bent(&poses(16)[i], 4.0));
    }
    let calibration = calibrated(&views).unwrap();
    assert_eq!(left_out(&calibration), ["photo_3", "photo_8", "photo_11"]);
    for i in [3, 8, 11] {
        let Some(PhotoReason::Bent { bulge_mm }) = calibration.photos[i].reason else {
            panic!("photo {i}: {:?}", calibration.photos[i])
        };
        assert!((bulge_mm - 4.0).abs() < 0.4, "{bulge_mm}");
    }
    let without = calibrated(&straight).unwrap();
    assert_eq!(calibration.used_count(), 13);
    assert!(largest_displacement_px(&calibration.camera, &without.camera) < 1e-3);
}

#[test]
fn a_spoiled_corner_raises_the_error_and_is_named() {
    let mut views = views(10, 0.05);
    let clean = calibrated(&views).unwrap();
    views[4].corners.as_mut().unwrap()[9 * 2 + 5].0 += Vector2::new(6.0, 0.0);
    let spoiled = calibrated(&views).unwrap();
    assert_eq!(left_out(&spoiled), ["photo_4"]);
    assert!(spoiled.photos[4].rms_px.unwrap() > 5.0 * clean.photos[4].rms_px.unwrap());
    let Some(PhotoReason::CornerOff { column: 6, row: 3, off_px }) = spoiled.photos[4].reason else {
        panic!("{:?}", spoiled.photos[4])
    };
    assert!((off_px - 6.0).abs() < 0.5, "{off_px}");
}

#[test]
fn a_photo_of_another_zoom_is_left_out() {
    let mut views = views(10, 0.05);
    let zoomed = Camera { fx: 1.1 * wide().fx, fy: 1.1 * wide().fy, k1: -0.1, ..wide() };
    views[2].corners = Ok(seen(&zoomed, &poses(10)[2], board()));
    let calibration = calibrated(&views).unwrap();
    assert_eq!(left_out(&calibration), ["photo_2"]);
}

#[test]
fn photos_without_a_board_are_reported_and_do_no_harm() {
    let mut views = views(6, 0.05);
    views.insert(2, BoardView { name: "wall".to_owned(), corners: Err(BoardReason::NoBoard.into()) });
    let calibration = calibrated(&views).unwrap();
    assert_eq!(left_out(&calibration), ["wall"]);
    assert_eq!(calibration.photos[2].reason, Some(PhotoReason::NoCorners(BoardReason::NoBoard)));
    assert_eq!(calibration.photos[2].rms_px, None);
}

#[test]
fn fewer_than_three_photos_are_refused() {
    for count in 0..3 {
        let problem = calibrated(&views(count, 0.0)).unwrap_err();
        assert!(matches!(problem, CalibrationProblem::TooFewPhotos { found, .. } if found == count), "{problem}");
    }
}

fn views_without_corners(reasons: Vec<PhotoReason>) -> Vec<BoardView> {
    let view = |(place, reason): (usize, PhotoReason)| BoardView { name: place.to_string(), corners: Err(reason) };
    reasons.into_iter().enumerate().map(view).collect()
}

#[test]
fn a_wrongly_counted_board_is_refused_with_the_size_in_the_photos() {
    let larger = BoardReason::OtherBoard { columns: 10, rows: 7 };
    let smaller = BoardReason::Incomplete { columns: 8, rows: 5, is_regular: true, may_be_whole: true };
    for (reason, size) in [(larger, "10x7"), (smaller, "8x5")] {
        let mut reasons = vec![reason.into(); 5];
        reasons.push(BoardReason::NoBoard.into());
        reasons.push(BoardReason::Incomplete { columns: 4, rows: 4, is_regular: false, may_be_whole: false }.into());
        let message = calibrated(&views_without_corners(reasons)).unwrap_err().to_string();
        assert!(message.contains("the 9x6 board was found in 0 of 7"), "{message}");
        assert!(message.contains(&format!("the photos show {size} inner corners")), "{message}");
        assert!(message.contains("where four squares meet") && !message.contains("seen"), "said once: {message}");
    }
}

#[test]
fn a_size_is_proposed_only_if_most_photos_show_a_whole_board_of_it() {
    let part = |columns: usize, is_regular: bool| {
        BoardReason::Incomplete { columns, rows: 6, is_regular, may_be_whole: false }.into()
    };
    let with_gaps = vec![part(8, false); 5];
    let different = vec![part(8, true), part(7, true), part(6, true), part(8, true)];
    let single = vec![part(8, true), BoardReason::NoBoard.into()];
    for reasons in [with_gaps, different, single] {
        let message = calibrated(&views_without_corners(reasons)).unwrap_err().to_string();
        assert!(message.contains("most often: only") && !message.contains("give that number"), "{message}");
    }
    let mut views = views(2, 0.0);
    views.extend(views_without_corners(vec![part(8, true); 5]));
    let problem = calibrated(&views).unwrap_err();
    assert!(!problem.to_string().contains("give that number"), "two photos show the stated board: {problem}");
}

#[test]
fn reasons_that_were_shown_for_each_photo_are_not_repeated() {
    let reasons = vec![PhotoReason::Unreadable("no photo at all".into()); 4];
    let problem = calibrated(&views_without_corners(reasons)).unwrap_err();
    assert!(problem.to_string().contains("most often: no photo at all"), "{problem}");
    let short = problem.without_photo_reasons().to_string();
    assert!(short.contains("found in 0 of 4") && !short.contains("no photo at all"), "{short}");
}

#[test]
fn the_same_pose_again_and_again_is_refused() {
    let mut random = SmallRng::seed_from_u64(3);
    let mut shot = |i: usize| {
        let mut corners = seen(&wide(), &poses(2)[1], board());
        noisy(&mut corners, 0.1, &mut random);
        BoardView { name: i.to_string(), corners: Ok(corners) }
    };
    let views: Vec<_> = (0..8).map(&mut shot).collect();
    let problem = calibrated(&views).unwrap_err();
    assert!(matches!(problem, CalibrationProblem::SamePose { .. }), "{problem}");
}

#[test]
fn parallel_boards_at_several_distances_are_refused() {
    let view = |i: usize| {
        let pose = Isometry3::translation(10.0 * i as f64, -5.0 * i as f64, 250.0 + 30.0 * i as f64);
        BoardView { name: i.to_string(), corners: Ok(seen(&wide(), &pose, board())) }
    };
    let views: Vec<_> = (0..6).map(view).collect();
    assert!(calibrated(&views).is_err());
}

#[test]
fn a_view_with_a_corner_too_few_is_refused_by_name() {
    let mut views = views(4, 0.0);
    views[1].corners.as_mut().unwrap().pop();
    let problem = calibrated(&views).unwrap_err();
    assert_eq!(problem, CalibrationProblem::Corners { name: "photo_1".to_owned(), found: 53, expected: 54 });
}

#[test]
fn corners_that_are_no_numbers_do_not_panic() {
    let mut views = views(4, 0.0);
    for view in &mut views {
        *view.corners.as_mut().unwrap() = vec![Pixel::new(f64::NAN, 5.0); 54];
    }
    assert!(calibrated(&views).is_err());
    for view in &mut views {
        *view.corners.as_mut().unwrap() = vec![Pixel::new(5.0, 5.0); 54];
    }
    assert!(calibrated(&views).is_err());
}

#[test]
fn coverage_says_where_corners_were_seen() {
    let coverage =
        Coverage::of([Pixel::new(0.0, 0.0), Pixel::new(1279.4, 719.4), Pixel::new(-3.0, 5.0)].iter(), 1280, 720);
    assert_eq!((coverage.corners[0], coverage.corners[47], coverage.corners.iter().sum::<usize>()), (1, 1, 2));
    assert!((coverage.share() - 2.0 / 48.0).abs() < 1e-12);
}
