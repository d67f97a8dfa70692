//! Error bars of whole features: on paths with errors of the stated size, the bar contains the value of the true path.

use super::*;
use crate::motion::features::errors::replicate::replicate;
use crate::random::Dice;
use crate::vision::covariance::PositionCovariance;

const LATERAL_MM: f64 = 0.1;
const DEPTH_MM: f64 = 0.4;

/// A path in front of the camera as a tracker could have seen it, with stated errors.
pub(super) fn seen(times: &[f64], path: &Path<'_>, seed: u64) -> Trajectory {
    seen_with([LATERAL_MM, DEPTH_MM], times, path, seed)
}

/// The same with these standard deviations across and along the line of sight, mm.
fn seen_with([across_mm, along_mm]: [f64; 2], times: &[f64], path: &Path<'_>, seed: u64) -> Trajectory {
    let mut trajectory = record(times, &[path]);
    for sample in &mut trajectory.samples {
        sample.tip_mm.z += 200.0;
        sample.covariance_mm2 = Some(PositionCovariance::from_sigmas(across_mm, along_mm));
    }
    trajectory.samples = replicate(&trajectory.samples, &mut Dice::new(seed, "how a tracker erred")).unwrap();
    trajectory
}

pub(super) fn bar(assessment: &Assessment, name: &str) -> ErrorBar {
    let of_tool = assessment.features.iter().find(|v| (v.feature.name, v.tool) == (name, Some(0)));
    of_tool.unwrap().error.unwrap_or_else(|reason| panic!("{name}: {reason}"))
}

#[test]
fn a_resting_tool_is_idle_and_its_path_is_none_within_its_error() {
    let is_none = |seed| {
        let rest = score(&seen(&times(25.0, 40.0), &|_| Point3::new(20.0, -10.0, 0.0), seed));
        assert_eq!(of_first(&rest, "idle_share"), 1.0);
        let bar = bar(&rest, "path_length");
        assert!(of_first(&rest, "path_length") < 0.9 * bar.as_measured, "{bar:?}");
        bar.low == 0.0
    };
    assert!((0..8).filter(|seed| is_none(*seed)).count() >= 7);
}

#[test]
fn errors_of_depth_hide_the_rests_in_space_and_not_in_the_picture() {
    let mut dice = Dice::new(1, "depth alone");
    let mut poor = record(&times(25.0, 40.0), &[&square(0.0)]);
    let idle =
        |path: &Trajectory| [Space::ThreeD, Space::Image].map(|space| get(&score(path), "idle_share", Some(0), space));
    let [good, good_in_picture] = idle(&poor).map(Result::unwrap);
    assert!(good > 0.3 && (good - good_in_picture).abs() < 1e-12, "{good} {good_in_picture}");
    poor.samples.iter_mut().for_each(|sample| sample.tip_mm.z += 2.0 * dice.gauss());
    let [hidden, in_picture] = idle(&poor).map(Result::unwrap);
    assert!(hidden < 0.5 * good && (in_picture - good).abs() < 0.05, "{good}: {hidden} {in_picture}");
}

/// Sum of a feature over the windows, and its value over the task.
fn windows_and_total(assessment: &Assessment, name: &str) -> (f64, f64) {
    let space = find(name).unwrap().spaces[0];
    let of_windows = assessment.windows.iter().flat_map(|window| &window.features);
    let of_windows = of_windows.filter(|v| (v.feature.name, v.tool, v.space) == (name, Some(0), space));
    (of_windows.map(|v| v.value.unwrap_or(0.0)).sum(), of_first(assessment, name))
}

#[test]
fn the_windows_of_a_length_add_up_to_it_also_where_errors_were_removed() {
    for seed in 0..4 {
        let poor = score(&seen_with([0.3, 1.5], &times(25.0, 80.0), &square(0.4), seed));
        assert!(poor.windows.len() > 6);
        for name in ["path_length", "depth_travelled"] {
            let ((sum, total), bar) = (windows_and_total(&poor, name), bar(&poor, name));
            let removed = bar.as_measured - total;
            assert!(removed > 0.02 * total, "{name}: errors lengthen a path");
            assert!((sum - total).abs() < 0.3 * removed, "{name}: {sum} in windows, {total} in all, {removed} removed");
        }
    }
}

#[test]
fn a_resting_tool_has_no_values_of_movement() {
    let rest = score(&seen(&times(25.0, 40.0), &|_| Point3::new(20.0, -10.0, 0.0), 3));
    for name in [
        "median_curvature",
        "peak_curvature",
        "normalised_jerk",
        "tremor_share",
        "motion_frequency",
        "path_ratio",
        "log_dimensionless_jerk",
    ] {
        let space = find(name).unwrap().spaces[0];
        assert_eq!(get(&rest, name, Some(0), space), Err(NotEnough::NoMovement), "{name}");
    }
    let none = ["submovements", "movements", "movement_rate", "short_pauses", "medium_pauses", "absences"];
    assert_eq!(none.map(|name| of_first(&rest, name)), [0.0; 6]);
    assert_eq!(of_first(&rest, "long_pause_share"), 1.0);
    assert_eq!(bar(&rest, "median_velocity").low, 0.0);
    assert!(of_first(&rest, "spread") < DEPTH_MM);
}

#[test]
fn the_true_value_lies_within_the_bar_in_about_95_of_100_sessions() {
    let path = square(0.3);
    let truth = score(&record(&times(25.0, 40.0), &[&|t| path(t) + nalgebra::Vector3::new(0.0, 0.0, 200.0)]));
    let (mut inside, mut all) = (0, 0);
    for seed in 0..12 {
        let found = score(&seen(&times(25.0, 40.0), &path, seed));
        for (found, truth) in found.features.iter().zip(&truth.features) {
            if let (Ok(bar), Ok(value)) = (found.error, truth.value)
                && bar.sigma > 0.0
            {
                all += 1;
                inside += usize::from((bar.low..=bar.high).contains(&value));
            }
        }
    }
    let share = inside as f64 / all as f64;
    assert!(all > 250 && (0.9..=0.995).contains(&share), "{inside} of {all}");
}

#[test]
fn frame_rate_and_lost_frames_change_no_value_beyond_its_error() {
    let path = square(0.3);
    let tenth_lost: Vec<f64> =
        times(25.0, 40.0).into_iter().enumerate().filter(|(i, _)| i % 10 != 3).map(|(_, t)| t).collect();
    let often = score(&seen(&times(50.0, 40.0), &path, 1));
    for other in [score(&seen(&times(25.0, 40.0), &path, 2)), score(&seen(&tenth_lost, &path, 3))] {
        let mut beyond = 0;
        for (one, other) in often.features.iter().zip(&other.features) {
            if let (Ok(a), Ok(b), Ok(bar_a), Ok(bar_b)) = (one.value, other.value, one.error, other.error) {
                beyond += usize::from((a - b).abs() > 2.04 * bar_a.sigma.hypot(bar_b.sigma));
            }
        }
        assert!(beyond <= often.features.len() / 20, "{beyond} of {}", often.features.len());
    }
}

#[test]
fn a_path_that_states_no_errors_gives_values_without_bars_and_one_without_a_value_has_none() {
    let path = square(0.0);
    let plain = score(&record(&times(25.0, 40.0), &[&path]));
    for value in &plain.features {
        let expected = if value.value.is_ok() { NoErrorBar::ErrorsNotStated } else { NoErrorBar::NoValue };
        assert_eq!(value.error, Err(expected), "{}", value.feature.name);
    }
}

#[test]
fn the_same_path_has_the_same_bars() {
    let path = square(0.3);
    let trajectory = seen(&times(25.0, 20.0), &path, 5);
    assert_eq!(score(&trajectory), score(&trajectory));
}
