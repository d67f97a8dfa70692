//! Whole features against closed forms and laws, through [`assess`] as everyone calls it.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Point3, Vector3};
use proptest::prelude::*;

use super::*;
use crate::pipeline::assessment::{Assessment, AssessmentSettings, assess};
use crate::pipeline::trajectory::{Sample, SampleState, Trajectory};

/// A tip over time, mm.
type Path<'a> = dyn Fn(f64) -> Point3<f64> + 'a;

fn sample(frame: u64, time_s: f64, tool: usize, tip_mm: Point3<f64>) -> Sample {
    Sample {
        frame,
        time_s,
        tool,
        tip_mm,
        velocity_mm_s: None,
        axis: None,
        tip_px: None,
        sigma_xy_mm: None,
        sigma_z_mm: None,
        state: SampleState::Observed,
    }
}

/// Frame times of a recording from 0 to `end_s`.
fn times(fps: f64, end_s: f64) -> Vec<f64> {
    (0..=(end_s * fps).round() as u32).map(|i| f64::from(i) / fps).collect()
}

fn record(times: &[f64], paths: &[&Path<'_>]) -> Trajectory {
    let rows = times.iter().enumerate();
    let samples = rows.flat_map(|(frame, t)| {
        paths.iter().enumerate().map(move |(tool, path)| sample(frame as u64, *t, tool, path(*t)))
    });
    let tools = (0..paths.len()).map(|tool| format!("tool {tool}")).collect();
    Trajectory { tools, samples: samples.collect(), frame_times_s: times.to_vec() }
}

fn score(trajectory: &Trajectory) -> Assessment {
    assess(trajectory, &AssessmentSettings::default())
}

fn get(assessment: &Assessment, name: &str, tool: Option<usize>, space: Space) -> Result<f64, NotEnough> {
    let mut found = assessment.features.iter().filter(|v| (v.feature.name, v.tool, v.space) == (name, tool, space));
    found.next().unwrap_or_else(|| panic!("no {name} of {tool:?} in {space:?}")).value
}

fn of_first(assessment: &Assessment, name: &str) -> f64 {
    let space = super::find(name).unwrap().spaces[0];
    get(assessment, name, Some(0), space).unwrap_or_else(|reason| panic!("{name}: {reason}"))
}

#[track_caller]
fn near(value: f64, expected: f64, relative: f64) {
    assert!((value - expected).abs() <= relative * expected.abs().max(1e-9), "{value} instead of {expected}");
}

/// Position along a minimum-jerk stroke, 0 to 1.
fn stroke(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
}

/// A square of 60 mm: each side a minimum-jerk stroke of 3 s after a rest of 1.5 s at its corner; `laps` times round.
/// A tremor in the picture, of the given amplitude in mm, fades in and out with each stroke.
fn square(tremor_mm: f64) -> impl Fn(f64) -> Point3<f64> {
    let corners = [(0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (0.0, 60.0)];
    move |t| {
        let side = (t / 4.5).floor();
        let u = ((t - 4.5 * side - 1.5) / 3.0).clamp(0.0, 1.0);
        let (from, to) = (corners[side as usize % 4], corners[(side as usize + 1) % 4]);
        let fade = (PI * u).sin().powi(4);
        let (du, dv) = (fade * (TAU * 2.3 * t).sin(), fade * (TAU * 3.1 * t).cos());
        let along = |a: f64, b: f64| a + (b - a) * stroke(u);
        Point3::new(along(from.0, to.0) + tremor_mm * du, along(from.1, to.1) + tremor_mm * dv, 180.0)
    }
}

/// A wandering path of a few slow and fast oscillations.
fn wander(seed: [f64; 4]) -> impl Fn(f64) -> Point3<f64> {
    move |t| {
        let wave = |k: f64| {
            25.0 * (TAU * (0.11 + 0.05 * k) * t + seed[0] * k).sin() + 6.0 * (TAU * 0.7 * t + seed[1] + k).sin()
        };
        Point3::new(wave(1.0) * seed[2], wave(2.0), 180.0 + wave(3.0) * seed[3])
    }
}

#[test]
fn every_feature_has_its_own_name_and_says_what_it_is() {
    let names: std::collections::HashSet<_> = FEATURES.iter().map(|f| f.name).collect();
    assert_eq!(names.len(), FEATURES.len());
    for feature in FEATURES {
        assert!(feature.range.0 < feature.range.1 && !feature.spaces.is_empty() && !feature.measures.is_empty());
        assert!([feature.title, feature.unit, feature.description, feature.source].iter().all(|text| !text.is_empty()));
    }
}

#[test]
fn a_circle_has_the_features_of_a_circle() {
    let (radius, period) = (30.0, 6.0);
    let circle = move |t: f64| {
        let (sin, cos) = (TAU * t / period).sin_cos();
        Point3::new(radius * cos, radius * sin, 180.0)
    };
    let got = score(&record(&times(25.0, 60.0), &[&circle]));
    let speed = TAU * radius / period;
    near(of_first(&got, "duration"), 60.0, 1e-3);
    near(of_first(&got, "path_length"), 60.0 * speed, 2e-3);
    near(of_first(&got, "mean_velocity"), speed, 1e-3);
    near(of_first(&got, "peak_velocity"), speed, 2e-3);
    near(of_first(&got, "jitter"), speed * speed / radius, 5e-3);
    near(of_first(&got, "relative_jitter"), speed / radius, 5e-3);
    near(of_first(&got, "smoothness"), 60.0 * speed / (radius * radius), 1e-2);
    near(of_first(&got, "economy_of_area"), 2.0 * radius / (60.0 * speed), 5e-3);
    near(of_first(&got, "working_area"), PI * radius * radius, 5e-3);
    assert!(of_first(&got, "depth_travelled") < 1e-6 && of_first(&got, "working_volume") < 1e-3);
    assert_eq!(["thinking_time", "idle_share", "not_seen_share"].map(|name| of_first(&got, name)), [0.0; 3]);
    let jerk = get(&got, "log_dimensionless_jerk", Some(0), Space::ThreeD);
    assert_eq!(
        jerk,
        Err(NotEnough::MovementsTooLong { share: 0.0, needed: 0.5 }),
        "one movement of 60 s is not discrete"
    );
}

#[test]
fn a_helix_has_the_features_of_a_helix() {
    let (radius, period, rise) = (20.0, 5.0, 4.0); // rise in mm/s
    let helix = move |t: f64| {
        let (sin, cos) = (TAU * t / period).sin_cos();
        Point3::new(radius * cos, radius * sin, 120.0 + rise * t)
    };
    let got = score(&record(&times(50.0, 20.0), &[&helix]));
    let around = TAU * radius / period;
    let speed = around.hypot(rise);
    let curvature = around * around / radius / (speed * speed);
    near(of_first(&got, "path_length"), 20.0 * speed, 3e-3);
    near(of_first(&got, "depth_travelled"), 20.0 * rise, 5e-3);
    near(of_first(&got, "jitter"), around * around / radius, 5e-3);
    near(of_first(&got, "smoothness"), 20.0 * speed * curvature * curvature, 2e-2);
    near(of_first(&got, "economy_of_volume"), (4.0 * radius * radius * 20.0 * rise).cbrt() / (20.0 * speed), 5e-3);
    near(get(&got, "path_length", Some(0), Space::Image).unwrap(), 20.0 * around, 3e-3);
    near(get(&got, "smoothness", Some(0), Space::Image).unwrap(), 20.0 * around / (radius * radius), 2e-2);
}

#[test]
fn a_square_with_pauses_has_the_features_of_its_strokes() {
    let got = score(&record(&times(50.0, 16.0 * 4.5), &[&square(0.0)]));
    let speed = |u: f64| 600.0 * u * u * (1.0 - u) * (1.0 - u); // mm/s, of a stroke of 60 mm in 3 s
    let reaches = |v: f64| (1.0 - (1.0 - 4.0 * (v / 600.0).sqrt()).sqrt()) / 2.0; // where a stroke has speed v
    let (onset, slow) = (3.0 * reaches(7.0), 3.0 * reaches(5.0)); // s from a stroke's start
    let task = 15.0 * 4.5 + 3.0 - 2.0 * onset;
    assert_eq!(of_first(&got, "movements"), 16.0);
    assert!((of_first(&got, "duration") - task).abs() < 0.045, "two instants of the grid at most");
    near(of_first(&got, "path_length"), 16.0 * 60.0, 5e-3);
    near(of_first(&got, "thinking_time"), 15.0 * (1.5 + 2.0 * slow), 1e-2);
    near(of_first(&got, "idle_share"), 15.0 * (1.5 + 2.0 * onset) / task, 2e-2);

    let profile: Vec<f64> = times(50.0, 3.0).iter().map(|t| speed(t / 3.0)).filter(|v| *v > 7.0).collect();
    near(of_first(&got, "log_dimensionless_jerk"), per_movement::ldlj(&profile, 0.02).unwrap(), 1e-2);
    near(of_first(&got, "spectral_arc_length"), per_movement::sparc(&profile, 0.02).unwrap(), 1e-2);
}

#[test]
fn noise_orders_the_square_as_the_thesis_table_does() {
    let [none, small, large] = [0.0, 0.5, 1.5].map(|tremor| score(&record(&times(25.0, 72.0), &[&square(tremor)])));
    for name in ["duration", "thinking_time"] {
        for noisy in [&small, &large] {
            near(of_first(noisy, name), of_first(&none, name), 5e-3);
        }
    }
    assert!(of_first(&none, "smoothness") < 1e-6, "the turns at the corners happen at rest; the thesis prints 0.0000");
    for name in ["mean_velocity", "jitter", "smoothness"] {
        for space in [Space::ThreeD, Space::Image] {
            let of = |a| get(a, name, Some(0), space).unwrap();
            assert!(of(&none) < of(&small) && of(&small) < of(&large), "{name}");
        }
    }
}

#[test]
fn a_resting_tool_is_idle_all_the_time_and_goes_nowhere() {
    let got = score(&record(&times(25.0, 30.0), &[&|_| Point3::new(5.0, 5.0, 150.0)]));
    assert_eq!(of_first(&got, "idle_share"), 1.0);
    near(of_first(&got, "thinking_time"), 30.0, 1e-9);
    assert!(of_first(&got, "path_length") < 1e-6);
    for name in ["duration", "smoothness", "economy_of_area", "relative_jitter"] {
        let space = super::find(name).unwrap().spaces[0];
        assert_eq!(get(&got, name, Some(0), space), Err(NotEnough::NoMovement), "{name}");
    }
}

#[test]
fn a_hand_that_rests_while_the_other_works_is_idle_not_absent() {
    let got = score(&record(&times(25.0, 40.0), &[&wander([0.3, 1.0, 1.0, 1.0]), &|_| Point3::new(0.0, 0.0, 150.0)]));
    assert_eq!(get(&got, "idle_share", Some(1), Space::ThreeD), Ok(1.0));
    assert_eq!(get(&got, "duration", None, Space::ThreeD), get(&got, "duration", Some(0), Space::ThreeD));
    assert!(get(&got, "handedness", Some(0), Space::ThreeD).unwrap() > 0.999);
    assert_eq!(get(&got, "synchrony", None, Space::ThreeD), Err(NotEnough::NoMovement));
    assert_eq!(get(&got, "together_share", None, Space::ThreeD), Ok(0.0));
}

#[test]
fn hands_that_move_as_one_are_in_full_synchrony() {
    let path = wander([0.3, 1.0, 1.0, 1.0]);
    let beside = |t: f64| path(t) + Vector3::new(40.0, 0.0, 30.0);
    let got = score(&record(&times(25.0, 40.0), &[&path, &beside]));
    near(get(&got, "synchrony", None, Space::ThreeD).unwrap(), 1.0, 1e-9);
    near(get(&got, "tip_distance", None, Space::ThreeD).unwrap(), 50.0, 1e-9);
    near(get(&got, "tip_distance", None, Space::Image).unwrap(), 40.0, 1e-9);
    near(get(&got, "handedness", Some(1), Space::ThreeD).unwrap(), 0.5, 1e-9);
    assert_eq!(get(&got, "together_share", None, Space::ThreeD), Ok(1.0));
}

#[test]
fn one_tool_has_no_features_of_two() {
    let got = score(&record(&times(25.0, 40.0), &[&square(0.0)]));
    assert_eq!(get(&got, "synchrony", None, Space::ThreeD), Err(NotEnough::NotTwoTools { found: 1 }));
}

/// Out of view from 10 to 16 s, coming back 100 mm away.
fn with_a_gap(state_in_gap: Option<SampleState>) -> Trajectory {
    let circle = |t: f64| {
        let (sin, cos) = (TAU * t / 6.0).sin_cos();
        Point3::new(30.0 * cos + if t > 13.0 { 100.0 } else { 0.0 }, 30.0 * sin, 180.0)
    };
    let mut trajectory = record(&times(25.0, 30.0), &[&circle]);
    let in_gap = |s: &Sample| s.time_s > 10.0 && s.time_s < 16.0;
    match state_in_gap {
        None => trajectory.samples.retain(|s| !in_gap(s)),
        Some(state) => trajectory.samples.iter_mut().filter(|s| in_gap(s)).for_each(|s| s.state = state),
    }
    trajectory
}

#[test]
fn a_gap_splits_the_path_and_is_counted_as_not_seen() {
    let got = score(&with_a_gap(None));
    near(of_first(&got, "not_seen_share"), 0.2, 2e-3);
    near(of_first(&got, "path_length"), 24.0 * TAU * 5.0, 5e-3);
    near(of_first(&got, "mean_velocity"), TAU * 5.0, 2e-3);
}

#[test]
fn a_long_prediction_counts_as_little_as_no_row_at_all() {
    assert_eq!(score(&with_a_gap(Some(SampleState::Predicted))).features, score(&with_a_gap(None)).features);
    assert_ne!(score(&with_a_gap(Some(SampleState::Observed))).features, score(&with_a_gap(None)).features);
}

#[test]
fn a_tool_seen_for_less_than_half_of_the_task_gets_no_sums() {
    let mut trajectory = record(&times(25.0, 40.0), &[&wander([0.3, 1.0, 1.0, 1.0]), &square(0.0)]);
    trajectory.samples.retain(|s| s.tool == 0 || s.time_s < 12.0);
    let got = score(&trajectory);
    assert!(matches!(get(&got, "path_length", Some(1), Space::ThreeD), Err(NotEnough::TooLittleSeen { .. })));
    near(get(&got, "not_seen_share", Some(1), Space::ThreeD).unwrap(), 0.7, 0.01);
    assert!(matches!(get(&got, "synchrony", None, Space::ThreeD), Err(NotEnough::TooLittleSeen { .. })));
}

#[test]
fn a_tool_that_is_never_seen_is_absent_all_the_time() {
    let mut trajectory = record(&times(25.0, 40.0), &[&square(0.0)]);
    trajectory.tools.push("cyan".to_owned());
    let got = score(&trajectory);
    assert_eq!(get(&got, "not_seen_share", Some(1), Space::ThreeD), Ok(1.0));
    assert_eq!(get(&got, "path_length", Some(1), Space::ThreeD), Err(NotEnough::NeverSeen));
}

#[test]
fn bad_samples_give_reasons_and_never_a_number() {
    let good = record(&times(25.0, 40.0), &[&square(0.0)]);
    let spoil = |change: &dyn Fn(&mut Vec<Sample>)| {
        let mut bad = good.clone();
        change(&mut bad.samples);
        bad
    };
    let bad = [
        spoil(&|s| s.clear()),
        spoil(&|s| s.truncate(1)),
        spoil(&|s| s.truncate(5)),
        spoil(&|s| s[100].tip_mm.x = f64::NAN),
        spoil(&|s| s[100].tip_mm.z = 1e300),
        spoil(&|s| s[100].time_s = f64::INFINITY),
        spoil(&|s| s[100].time_s = s[99].time_s),
        spoil(&|s| s.swap(3, 700)),
        spoil(&|s| s[7].velocity_mm_s = Some(Vector3::new(0.0, f64::NAN, 0.0))),
        spoil(&|s| s.iter_mut().for_each(|s| s.state = SampleState::Predicted)),
    ];
    for (case, trajectory) in bad.iter().enumerate() {
        let got = score(trajectory);
        assert_eq!(got.features.len(), score(&good).features.len());
        let values = got.features.iter().find(|v| v.value.is_ok()).map(|v| (v.feature.name, v.value));
        assert_eq!(values, None, "case {case}");
    }
}

#[test]
fn a_path_that_no_hand_can_make_is_withheld() {
    let jumps = |t: f64| Point3::new(if (t * 25.0).round() as i64 % 2 == 0 { -9e3 } else { 9e3 }, 0.0, 180.0);
    let got = score(&record(&times(25.0, 40.0), &[&jumps]));
    for name in ["mean_velocity", "path_length", "smoothness", "working_volume"] {
        assert_eq!(get(&got, name, Some(0), Space::ThreeD), Err(NotEnough::OutOfRange), "{name}");
    }
}

#[test]
fn a_setting_that_cannot_be_used_is_named() {
    let mut settings = AssessmentSettings::default();
    settings.features.step_s = 0.0;
    let got = assess(&record(&times(25.0, 40.0), &[&square(0.0)]), &settings);
    let of_one = got.features.iter().filter(|v| !matches!(v.value, Err(NotEnough::NotTwoTools { .. })));
    of_one.for_each(|v| assert_eq!(v.value, Err(NotEnough::UnusableSetting("step_s"))));
}

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
        "idle_share" | "not_seen_share" | "together_share" | "handedness" | "synchrony" => (0.01, 0.0),
        "movements" => (1.0, 0.0),
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

/// Features that do not ask where the camera is.
const RIGID: [&str; 12] = [
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
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

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
                _ => 1e-6,
            };
            prop_assert!((a - b).abs() <= tolerance * (1.0 + a.abs()), "{name}: {a} {b}");
        }
    }

    #[test]
    fn a_path_k_times_as_large_has_features_that_scale_by_their_units(
        seed in prop::array::uniform4(0.5f64..2.0),
        k in 0.3f64..3.0,
    ) {
        let path = record(&times(25.0, 30.0), &[&wander(seed), &wander(seed.map(|s| 2.5 - s))]);
        let large = moved(&path, |s| s.tip_mm = Point3::from(s.tip_mm.coords * k));
        let settings = AssessmentSettings::default();
        let mut scaled = settings.clone();
        scaled.features.movement_speed_mm_s *= k;
        scaled.features.thinking_speed_mm_s *= k;
        scaled.features.smoothness_step_mm *= k;
        for (name, a, b) in pairs(&assess(&path, &settings), &assess(&large, &scaled)) {
            let power = match super::find(name).unwrap().unit {
                "mm" | "mm/s" | "mm/s²" => 1,
                "mm²" => 2,
                "mm³" => 3,
                "1/mm²" => -2,
                _ => 0,
            };
            let expected = a * k.powi(power);
            prop_assert!((b - expected).abs() <= 1e-4 * expected.abs().max(1e-6), "{name}: {b} instead of {expected}");
        }
    }

    #[test]
    fn no_trajectory_makes_a_feature_leave_its_range(
        rows in prop::collection::vec((0.0f64..0.3, prop::array::uniform3(-400.0f64..400.0), 0usize..2, any::<bool>()), 0..200),
    ) {
        let mut time_s = 0.0;
        let samples = rows.into_iter().enumerate().map(|(frame, (dt, tip, tool, seen))| {
            time_s += dt;
            let state = if seen { SampleState::Observed } else { SampleState::Predicted };
            Sample { state, ..sample(frame as u64, time_s, tool, Point3::from(tip)) }
        });
        let tools = vec!["a".to_owned(), "b".to_owned()];
        let trajectory = Trajectory { tools, samples: samples.collect(), frame_times_s: Vec::new() };
        let got = score(&trajectory);
        for v in got.features.iter().chain(got.windows.iter().flat_map(|w| &w.features)) {
            let (least, most) = v.feature.range;
            prop_assert!(v.value.is_err() || (least..=most).contains(&v.value.unwrap()));
        }
    }
}
