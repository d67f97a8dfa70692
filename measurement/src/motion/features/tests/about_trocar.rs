//! Features about the trocar, on paths that retract, turn and insert.

use nalgebra::{Rotation3, Vector3};

use super::*;

const TROCAR: Point3<f64> = Point3::new(-100.0, -80.0, 60.0);
const LEVER_MM: f64 = 150.0;

/// Every 4.5 s, after a rest of 1.5 s: in by 40 mm, turned by 0.4 rad, out by 40 mm, turned back. With `at_once` the
/// first two are one stroke, and so are the last two.
fn strokes(at_once: bool) -> impl Fn(f64) -> Point3<f64> {
    move |t| {
        let (number, u) = ((t / 4.5).floor(), ((t % 4.5 - 1.5) / 3.0).clamp(0.0, 1.0));
        let done = stroke(u);
        let (insertion, turn) = match (number as usize % 4, at_once) {
            (0, false) => (done, 0.0),
            (1, false) => (1.0, done),
            (2, false) => (1.0 - done, 1.0),
            (_, false) => (0.0, 1.0 - done),
            (0 | 2, true) => (done, done),
            (_, true) => (1.0 - done, 1.0 - done),
        };
        let direction =
            Rotation3::from_axis_angle(&Vector3::y_axis(), 0.4 * turn) * Vector3::new(0.4, 0.4, 0.8).normalize();
        TROCAR + direction * (LEVER_MM + 40.0 * insertion)
    }
}

/// A recording with the axes of the shaft.
fn with_axes(path: &Path<'_>) -> Trajectory {
    let mut trajectory = record(&times(25.0, 16.0 * 4.5), &[path]);
    trajectory.samples.iter_mut().for_each(|sample| sample.axis = Some((sample.tip_mm - TROCAR).normalize()));
    trajectory
}

#[test]
fn going_in_and_turning_one_after_the_other_is_the_way_about_the_trocar() {
    let got = score(&with_axes(&strokes(false)));
    near(of_first(&got, "fulcrum_path_ratio"), 1.0, 2e-3);
    let turned = Vector3::new(0.4, 0.4, 0.8).normalize().cross(&Vector3::y()).norm(); // share of a turn about y
    near(of_first(&got, "angular_path"), 8.0 * 0.4 * turned, 5e-3);
    near(of_first(&got, "insertion_travelled"), 8.0 * 40.0, 5e-3);
    near(of_first(&got, "angular_velocity"), of_first(&got, "angular_path") / of_first(&got, "duration"), 1e-3);
}

#[test]
fn doing_both_at_once_is_shorter_than_that_and_longer_than_straight() {
    let got = score(&with_axes(&strokes(true)));
    let (about, straight) = (of_first(&got, "fulcrum_path_ratio"), of_first(&got, "path_ratio"));
    assert!(about > 0.7 && about < 0.8 && straight > 1.0 && straight < 1.05, "{about} {straight}");
}

#[test]
fn features_about_an_unknown_trocar_have_no_values() {
    let mut still = with_axes(&|t| Point3::new(0.0, 30.0 * (0.5 * t).sin(), 180.0));
    let named = ["angular_path", "angular_velocity", "insertion_travelled", "fulcrum_path_ratio"];
    still.samples.iter_mut().for_each(|sample| sample.axis = None);
    let got = score(&still);
    for name in named {
        assert_eq!(get(&got, name, Some(0), Space::ThreeD), Err(NotEnough::NoFulcrum), "{name}");
    }
}
