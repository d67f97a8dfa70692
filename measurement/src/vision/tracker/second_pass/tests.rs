//! Gaps of known length: which frames are bridged, and what the counts say.

use nalgebra::{Matrix3, Point3, Vector3};

use super::*;
use crate::vision::camera::testing::STRAIGHT as CAMERA;
use crate::vision::edges::shaft::Continuation;
use crate::vision::pose::normal_equations::NormalEquations;
use crate::vision::tracker::TrocarEvidence;
use crate::vision::tracker::settings::Marker;
use crate::vision::trajectory::Sample;
use crate::vision::tube::Tube;

/// Chosen so that no multiple of it equals a time limit, where rounding would decide.
const FRAME_S: f64 = 0.039;

struct Paths {
    filtered: Vec<Sample>,
    smoothed: Vec<Sample>,
    quality: ToolQuality,
}

/// A tool that points along the line of sight.
fn pose(tip: Point3<f64>) -> TubeEstimate {
    let covariance = nalgebra::Matrix5::identity() * 0.01;
    TubeEstimate {
        tube: Tube { tip, axis: Vector3::z(), radius: 2.5 },
        covariance,
        lasting: covariance,
        equations: NormalEquations::from_covariance(&covariance),
        residual_px: 0.1,
        support: 50.0,
    }
}

fn paths(seen: &[bool]) -> Paths {
    paths_from(0.0, 0.0, seen)
}

/// A tool that moves to the right (mm, mm/s), seen on some frames only.
fn paths_from(x_mm: f64, speed_mm_s: f64, seen: &[bool]) -> Paths {
    paths_by(&CAMERA, x_mm, speed_mm_s, seen)
}

fn paths_by(camera: &Camera, x_mm: f64, speed_mm_s: f64, seen: &[bool]) -> Paths {
    let settings = MotionSettings::default();
    let mut rework = SecondPass::new(0, camera, &settings);
    for (frame, seen) in seen.iter().enumerate() {
        let instant = (frame as u64, frame as f64 * FRAME_S);
        let pose = pose(Point3::new(x_mm + speed_mm_s * instant.1, 0.0, 150.0));
        rework.add_frame(instant, seen.then_some(pose), None, None);
    }
    let (motion, quality) = rework.finish();
    Paths { filtered: motion.path(PathKind::Filtered), smoothed: motion.path(PathKind::Smoothed), quality }
}

fn frames(samples: &[Sample]) -> Vec<u64> {
    samples.iter().map(|sample| sample.frame).collect()
}

fn with_gap(length: usize, after: usize) -> Vec<bool> {
    [vec![true; 10], vec![false; length], vec![true; after]].concat()
}

#[test]
fn no_filter_averages_the_camera_s_error_away() {
    let share = 0.01;
    let camera = Camera { focal_sigma: share, ..CAMERA };
    let [exact, doubtful] = [CAMERA, camera].map(|camera| paths_by(&camera, 0.0, 0.0, &[true; 200]));
    let all = |paths: Paths| paths.filtered.into_iter().chain(paths.smoothed);
    for (exact, doubtful) in all(exact).zip(all(doubtful)) {
        let by_camera_mm = |of: fn(&Sample) -> Option<f64>| {
            let [all_mm, others_mm] = [&doubtful, &exact].map(|sample| of(sample).unwrap());
            (all_mm.powi(2) - others_mm.powi(2)).max(0.0).sqrt()
        };
        let in_depth_mm = by_camera_mm(Sample::sigma_z_mm);
        assert!((in_depth_mm - share * 150.0).abs() < 1e-3, "{in_depth_mm} mm of a depth of 150 mm");
        assert!(by_camera_mm(Sample::sigma_xy_mm) < 1e-3, "x and y do not depend on the focal length");
    }
}

#[test]
fn no_position_is_stated_better_than_pictures_show_it() {
    let least_mm = 0.3 * 150.0 / CAMERA.fx;
    let exact = Matrix3::from_diagonal(&Vector3::new(1e-6, 1e-6, 4.0));
    let stated = crate::vision::tracker::motion::stated_covariance(&exact, &CAMERA, &Point3::new(0.0, 0.0, 150.0));
    assert!((stated.sigma_xy_mm() - least_mm).abs() < 1e-9, "{} mm, not {least_mm}", stated.sigma_xy_mm());
    assert!((stated.sigma_z_mm() - 2.0).abs() < 1e-9, "a larger one stays as it is");
}

#[test]
fn hindsight_bridges_a_gap_that_the_filter_does_not_and_says_how_unsure_it_is() {
    let paths = paths(&with_gap(8, 10));
    assert_eq!(frames(&paths.smoothed), (0..28).collect::<Vec<_>>());
    assert_eq!(frames(&paths.filtered), (0..15).chain(18..28).collect::<Vec<_>>());
    let sigma = |frame: usize| paths.smoothed[frame].sigma_z_mm().unwrap();
    assert!(sigma(13) > 2.0 * sigma(5), "{} in the gap, {} before", sigma(13), sigma(5));
    assert_eq!((paths.quality.observed, paths.quality.predicted, paths.quality.missing), (20, 8, 0));
}

#[test]
fn a_tool_that_does_not_come_back_is_predicted_for_a_short_time_and_with_hindsight_not_at_all() {
    let paths = paths(&with_gap(30, 0));
    assert_eq!(frames(&paths.smoothed), (0..10).collect::<Vec<_>>());
    assert_eq!(frames(&paths.filtered), (0..15).collect::<Vec<_>>());
    assert_eq!((paths.quality.observed, paths.quality.predicted, paths.quality.missing), (10, 0, 30));
}

#[test]
fn a_tip_that_leaves_the_picture_is_not_predicted_beyond_its_rim() {
    let rim_mm = CAMERA.cx / CAMERA.fx * 150.0;
    let paths = paths_from(rim_mm - 41.0, 100.0, &with_gap(10, 0)); // last seen 5.9 mm inside, 3.9 mm a frame
    assert_eq!(frames(&paths.filtered), (0..11).collect::<Vec<_>>());
}

#[test]
fn a_few_measurements_between_two_gaps_are_not_believed() {
    let instants: Vec<FrameInstant> = (0..60).map(|frame| (frame, frame as f64 * FRAME_S)).collect();
    let found_of = |spec: &ToolSpec, seen: &[Range<usize>]| {
        let pose = StoredPose::from(&pose(Point3::new(0.0, 0.0, 150.0)));
        let record = |frame: usize| {
            let is_seen = seen.iter().any(|piece| piece.contains(&frame));
            FrameRecord { pose: is_seen.then_some(pose), is_good: false, reason: None }
        };
        isolated_runs(&(0..60).map(record).collect(), &instants, 0.2, spec)
    };
    let taped = ToolSpec { marker: Marker::Band { length_mm: None }, ..bare_spec() };
    let found = |seen: &[Range<usize>]| found_of(&taped, seen);
    assert_eq!(found(&[0..15, 31..33, 43..60]), vec![31..33]);
    assert_eq!(found(&[0..15, 31..32, 33..34, 43..60]), vec![31..34]);
    assert!(found(&[0..15, 18..20, 43..60]).is_empty(), "close to a long run");
    assert!(found(&[0..15, 31..36, 43..60]).is_empty(), "long enough by itself");
    let only = std::slice::from_ref(&(31..33));
    assert!(found(only).is_empty(), "the only run");
    assert_eq!(found_of(&bare_spec(), only), vec![31..33], "no colour confirms it");
}

fn bare_spec() -> ToolSpec {
    let (name, colour) = ("left".to_owned(), "shaft".to_owned());
    ToolSpec { name, colour, side: None, diameter_mm: 5.0, marker: Marker::Shaft { collar_mm: None, jaw_mm: None } }
}

#[test]
fn a_trocar_is_assumed_only_for_a_band_with_a_shaft() {
    let instants: Vec<FrameInstant> = (0..40).map(|frame| (frame, frame as f64 * FRAME_S)).collect();
    let (name, colour) = ("orange".to_owned(), "orange".to_owned());
    let spec = ToolSpec { name, colour, side: None, diameter_mm: 5.0, marker: Marker::Band { length_mm: Some(20.0) } };
    let basis = |seen_shaft: &SeenShaft| {
        let pose = StoredPose::from(&pose(Point3::new(0.0, 0.0, 150.0)));
        let record = || FrameRecord { pose: Some(pose), is_good: true, reason: None };
        let records = (0..40).map(|_| record()).collect();
        let (_, quality) =
            run((records, Vec::new()), seen_shaft, &spec, 0, &instants, &CAMERA, &MotionSettings::default());
        quality.effective_diameter.unwrap().basis
    };
    let shaft = |by_hand| {
        let mut seen = SeenShaft::default();
        seen.add(&Continuation { by_hand: Some(by_hand), by_tip: None });
        seen
    };
    assert_eq!(basis(&shaft(1.0)), DiameterBasis::AssumedTrocar);
    assert_eq!(basis(&shaft(0.3)), DiameterBasis::Usual);
    assert_eq!(basis(&SeenShaft::default()), DiameterBasis::AssumedTrocar, "nothing was looked at");
}

#[test]
fn a_bare_shaft_whose_axes_meet_nowhere_has_no_trocar() {
    let spec = bare_spec();
    let quality = |tips: &[Point3<f64>]| {
        let record =
            |tip: &Point3<f64>| FrameRecord { pose: Some(StoredPose::from(&pose(*tip))), is_good: true, reason: None };
        let instants: Vec<FrameInstant> = (0..tips.len()).map(|frame| (frame as u64, frame as f64 * FRAME_S)).collect();
        let records = tips.iter().map(record).collect();
        let motion = MotionSettings::default();
        run((records, Vec::new()), &SeenShaft::default(), &spec, 0, &instants, &CAMERA, &motion).1
    };
    let resting = [Point3::new(0.0, 0.0, 150.0); 40];
    assert_eq!(quality(&resting).trocar(), TrocarEvidence::Possible);
    assert_eq!(quality(&resting[..5]).trocar(), TrocarEvidence::Missing, "too few poses");
    let sliding: Vec<Point3<f64>> = (0..40).map(|at| Point3::new(8.0 * f64::from(at) - 156.0, 0.0, 150.0)).collect();
    let slid = quality(&sliding);
    assert_eq!(slid.trocar(), TrocarEvidence::Missing, "parallel axes up to 312 mm apart");
    assert!(slid.effective_diameter.unwrap().basis.is_of_bare_shaft());
}

#[test]
fn a_long_gap_stays_one() {
    let paths = paths(&with_gap(30, 5));
    assert_eq!(frames(&paths.smoothed), (0..10).chain(40..45).collect::<Vec<_>>());
}
