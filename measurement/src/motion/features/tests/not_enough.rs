//! Paths that were not seen, or that no hand can make: reasons instead of numbers.

use nalgebra::Vector3;

use super::*;

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
    let got = assess(&record(&times(25.0, 40.0), &[&square(0.0)]), &[], &settings);
    let of_one = got.features.iter().filter(|v| !matches!(v.value, Err(NotEnough::NotTwoTools { .. })));
    of_one.for_each(|v| assert_eq!(v.value, Err(NotEnough::UnusableSetting("step_s"))));
}

#[test]
fn no_reason_shows_a_negative_zero() {
    for reason in [
        NotEnough::TooShort { observed_s: -0.0, needed_s: 2.0 },
        NotEnough::TooLittleSeen { share: -0.0, needed: 0.5 },
        NotEnough::MovementsTooLong { share: -0.0, needed: 0.5 },
    ] {
        let text = reason.to_string();
        assert!(!text.contains('-') && text.contains('0'), "{text}");
    }
}
