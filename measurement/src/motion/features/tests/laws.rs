//! Properties that features must not depend on, and how features scale.

use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;

use super::*;

#[test]
fn windows_cover_the_task_and_their_paths_add_up() {
    let got = score(&record(&times(25.0, 60.0), &[&wander([0.3, 1.0, 1.0, 1.0])]));
    let (start, end) = got.task_s.unwrap();
    assert_eq!((got.windows[0].start_s, got.windows.last().unwrap().end_s), (start, end));
    assert!(got.windows.windows(2).all(|w| w[0].end_s == w[1].start_s));
    let lengths = got.windows.iter().flat_map(|w| &w.features);
    let lengths = lengths.filter(|v| v.feature.name == "path_length" && v.space == Space::ThreeD);
    near(lengths.map(|v| v.value.unwrap_or(0.0)).sum(), of_first(&got, "path_length"), 1e-9);
}

/// Every value that two recordings of one performance give, side by side.
fn pairs<'a>(a: &'a Assessment, b: &'a Assessment) -> impl Iterator<Item = (&'static str, f64, f64)> + 'a {
    assert_eq!(a.features.len(), b.features.len());
    let both = a.features.iter().zip(&b.features);
    both.filter_map(|(a, b)| match (a.value, b.value) {
        (Ok(x), Ok(y)) => Some((a.feature.name, x, y)),
        (Err(_), Err(_)) => None,
        _ => panic!("{} has a value in one recording only: {:?}, {:?}", a.feature.name, a.value, b.value),
    })
}

/// How far a feature may differ between two recordings of one performance: shares and counts by a little, others by a
/// few per cent of their value.
fn same_performance(name: &str, a: f64, b: f64) -> bool {
    let (absolute, relative) = match name {
        "log_dimensionless_jerk" | "spectral_arc_length" => (0.15, 0.0),
        _ if name.ends_with("share") || name.starts_with("handedness") => (0.01, 0.0),
        "synchrony" | "speed_balance" => (0.01, 0.0),
        "movements" | "submovements" => (1.0, 0.0),
        _ if name.ends_with("pauses") || name == "movement_rate" => (60.0 / 72.0 + 1e-9, 0.0), // one more or less
        "median_curvature" | "normalised_jerk" => (1e-6, 0.05),
        "peak_curvature" => (1e-6, 0.1),
        "motion_frequency" => (0.05, 0.02),
        "thinking_time" => (0.15, 0.02),
        "jitter" | "relative_jitter" => (1e-6, 0.05),
        "smoothness" => (1e-6, 0.1), // a square of a turn
        _ => (0.05, 0.01),
    };
    (a - b).abs() <= absolute + relative * a.abs().max(b.abs())
}

/// A share in 0..1 that looks random and is the same on every run.
fn hash(i: usize) -> f64 {
    ((i as f64 * 12.9898).sin() * 43_758.545).rem_euclid(1.0)
}

#[test]
fn frame_rate_and_dropped_frames_change_no_feature() {
    let (left, right) = (square(0.4), wander([0.3, 1.0, 1.0, 1.0]));
    let reference = score(&record(&times(50.0, 72.0), &[&left, &right]));
    let slow = times(25.0, 72.0);
    let dropped: Vec<f64> = slow.iter().copied().enumerate().filter(|(i, _)| hash(*i) > 0.1).map(|(_, t)| t).collect();
    let uneven: Vec<f64> = slow.iter().enumerate().map(|(i, t)| t + 0.02 * hash(i)).collect();
    for (what, times) in [("25 fps", slow), ("a tenth dropped", dropped), ("uneven", uneven)] {
        let other = score(&record(&times, &[&left, &right]));
        for (name, a, b) in pairs(&reference, &other) {
            assert!(same_performance(name, a, b), "{what}: {name} {a} at 50 fps, {b} here");
        }
    }
}

#[test]
fn velocities_of_the_filter_and_fitted_ones_give_the_same_features() {
    let path = wander([0.3, 1.0, 1.0, 1.0]);
    let fitted = record(&times(50.0, 40.0), &[&path]);
    let mut filtered = fitted.clone();
    for s in &mut filtered.samples {
        s.velocity_mm_s = Some((path(s.time_s + 1e-5) - path(s.time_s - 1e-5)) / 2e-5);
    }
    for (name, a, b) in pairs(&score(&fitted), &score(&filtered)) {
        assert!(same_performance(name, a, b), "{name}: {a} fitted, {b} filtered");
    }
}

fn moved(trajectory: &Trajectory, change: impl Fn(&mut Sample)) -> Trajectory {
    let mut moved = trajectory.clone();
    moved.samples.iter_mut().for_each(change);
    moved
}

/// Features that do not depend on the position of the camera.
const RIGID: [&str; 20] = [
    "duration",
    "thinking_time",
    "idle_share",
    "not_seen_share",
    "mean_velocity",
    "peak_velocity",
    "jitter",
    "path_length",
    "smoothness",
    "working_volume",
    "log_dimensionless_jerk",
    "spectral_arc_length",
    "short_pauses",
    "medium_pause_share",
    "median_velocity",
    "spread",
    "movement_rate",
    "submovements",
    "path_ratio",
    "absences",
];

/// Features of the picture that do not depend on its orientation.
const PLANAR: [&str; 12] = [
    "path_length",
    "idle_share",
    "short_pauses",
    "medium_pauses",
    "long_pause_share",
    "working_area",
    "spread",
    "median_curvature",
    "peak_curvature",
    "normalised_jerk",
    "tremor_share",
    "motion_frequency",
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn turning_and_shifting_the_picture_changes_nothing_that_is_seen_in_it(
        seed in prop::array::uniform4(0.5f64..2.0),
        turn in -3.0f64..3.0,
        shift in prop::array::uniform3(-300.0f64..300.0),
    ) {
        let path = record(&times(25.0, 30.0), &[&wander(seed)]);
        let pose = Isometry3::new(Vector3::from(shift), Vector3::new(0.0, 0.0, turn));
        let (a, b) = (score(&path), score(&moved(&path, |s| s.tip_mm = pose * s.tip_mm)));
        for name in PLANAR {
            match (get(&a, name, Some(0), Space::Image), get(&b, name, Some(0), Space::Image)) {
                (Ok(a), Ok(b)) => prop_assert!((a - b).abs() <= 1e-5 * (1.0 + a.abs()), "{name}: {a} {b}"),
                (a, b) => prop_assert_eq!(a.is_ok(), b.is_ok(), "{}", name),
            }
        }
    }

    #[test]
    fn turning_and_shifting_the_path_changes_no_length_time_or_smoothness(
        seed in prop::array::uniform4(0.5f64..2.0),
        turn in prop::array::uniform3(-3.0f64..3.0),
        shift in prop::array::uniform3(-300.0f64..300.0),
    ) {
        let path = record(&times(25.0, 30.0), &[&wander(seed)]);
        let pose = Isometry3::new(Vector3::from(shift), Vector3::from(turn));
        let (a, b) = (score(&path), score(&moved(&path, |s| s.tip_mm = pose * s.tip_mm)));
        for name in RIGID {
            let (a, b) = (get(&a, name, Some(0), Space::ThreeD), get(&b, name, Some(0), Space::ThreeD));
            match (a, b) {
                (Ok(a), Ok(b)) => prop_assert!((a - b).abs() <= 1e-5 * (1.0 + a.abs()), "{name}: {a} {b}"),
                (a, b) => prop_assert_eq!(a, b),
            }
        }
    }

    #[test]
    fn a_path_run_backwards_has_the_same_features(seed in prop::array::uniform4(0.5f64..2.0)) {
        let end_s = 30.0;
        let forwards = record(&times(25.0, end_s), &[&wander(seed), &square(0.3)]);
        let (left, right) = (wander(seed), square(0.3));
        let backwards = record(&times(25.0, end_s), &[&|t| left(end_s - t), &|t| right(end_s - t)]);
        for (name, a, b) in pairs(&score(&forwards), &score(&backwards)) {
            let tolerance = match name {
                "smoothness" => 0.03, // its points are laid from the path's other end
                "working_area" | "working_volume" => 1e-4, // its lattice
                "tremor_share" | "motion_frequency" => 1e-2, // its stretches lie half a step aside
                _ => 1e-6,
            };
            prop_assert!((a - b).abs() <= tolerance * (1.0 + a.abs()), "{name}: {a} {b}");
        }
    }

    #[test]
    fn a_mirrored_pair_of_hands_has_mirrored_features(seed in prop::array::uniform4(0.5f64..2.0)) {
        let (left, right) = (wander(seed), square(0.3));
        let mirrored = |p: Point3<f64>| Point3::new(-p.x, p.y, p.z);
        let pair = score(&record(&times(25.0, 30.0), &[&left, &right]));
        let mirror = score(&record(&times(25.0, 30.0), &[&|t| mirrored(right(t)), &|t| mirrored(left(t))]));
        for v in &pair.features {
            let other = get(&mirror, v.feature.name, v.tool.map(|tool| 1 - tool), v.space);
            match (v.value, other) {
                (Ok(a), Ok(b)) => {
                    let tolerance = if v.feature.name == "working_volume" { 1e-4 } else { 1e-6 }; // its lattice
                    prop_assert!((a - b).abs() <= tolerance * (1.0 + a.abs()), "{}: {a} {b}", v.feature.name);
                }
                (a, b) => prop_assert_eq!(a.is_ok(), b.is_ok(), "{}", v.feature.name),
            }
        }
    }

    #[test]
    fn a_path_k_times_as_large_has_features_that_scale_by_their_units(
        seed in prop::array::uniform4(0.5f64..2.0),
        k in 1.0f64..3.0, // the distance that begins an attempt does not scale; a small path may lack it
    ) {
        let path = record(&times(25.0, 30.0), &[&wander(seed), &wander(seed.map(|s| 2.5 - s))]);
        let large = moved(&path, |s| s.tip_mm = Point3::from(s.tip_mm.coords * k));
        let settings = AssessmentSettings::default();
        let mut scaled = settings.clone();
        scaled.features.movement_speed_mm_s *= k;
        scaled.features.thinking_speed_mm_s *= k;
        scaled.features.smoothness_step_mm *= k;
        for (name, a, b) in pairs(&assess(&path, &[], &settings), &assess(&large, &[], &scaled)) {
            let power = match find(name).unwrap().unit {
                "mm" | "mm/s" | "mm/s²" => 1,
                "mm²" => 2,
                "mm³" => 3,
                "1/mm" => -1,
                "1/mm²" => -2,
                _ => 0,
            };
            let expected = a * k.powi(power);
            prop_assert!((b - expected).abs() <= 1e-4 * expected.abs().max(1e-6), "{name}: {b} instead of {expected}");
        }
    }

    #[test]
    fn no_trajectory_makes_a_feature_leave_its_range(
        rows in prop::collection::vec(
            (0.0f64..0.3, prop::array::uniform3(-400.0f64..400.0), 0usize..2, any::<bool>()),
            0..200,
        ),
    ) {
        let mut time_s = 0.0;
        let samples = rows.into_iter().enumerate().map(|(frame, (dt, tip, tool, seen))| {
            time_s += dt;
            let state = if seen { SampleState::Observed } else { SampleState::Predicted };
            Sample { state, ..sample(frame as u64, time_s, tool, Point3::from(tip)) }
        });
        let tools = vec!["a".to_owned(), "b".to_owned()];
        let trajectory = Trajectory { tools, samples: samples.collect(), frame_times_s: Vec::new(), cuts: Vec::new() };
        let got = score(&trajectory);
        for v in got.features.iter().chain(got.windows.iter().flat_map(|w| &w.features)) {
            let (least, most) = v.feature.range;
            prop_assert!(v.value.is_err() || (least..=most).contains(&v.value.unwrap()));
        }
    }
}
