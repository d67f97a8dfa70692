//! Paths whose features can be computed by hand.

use nalgebra::Vector3;

use super::*;
use crate::motion::assessment::motions;

#[test]
fn every_feature_has_its_own_name_and_says_what_it_is() {
    let names: std::collections::HashSet<_> = FEATURES.iter().map(|f| f.name).collect();
    assert_eq!(names.len(), FEATURES.len());
    assert!(FEATURES.is_sorted_by_key(|feature| feature.family), "they stand family by family");
    for feature in FEATURES {
        assert!(feature.range.0 < feature.range.1 && !feature.spaces.is_empty() && !feature.measures.is_empty());
        assert!([feature.title, feature.unit, feature.description, feature.source].iter().all(|text| !text.is_empty()));
        let described = feature.describe(&FeatureSettings::default());
        assert!(!described.contains(['{', '}']), "no such setting: {described}");
    }
}

#[test]
fn titles_and_descriptions_state_the_settings() {
    let settings = FeatureSettings::default();
    let (short, long) = (settings.pause_min_s, settings.long_pause_s);
    assert_eq!(pauses::SHORT_PAUSES.title, format!("Pauses below {short} s"));
    assert_eq!(pauses::MEDIUM_PAUSES.title, format!("Pauses of {short} to {long} s"));
    assert_eq!(pauses::LONG_PAUSES.title, format!("Pauses of {long} s and more"));
    assert_eq!(pauses::SHORT_PAUSE_SHARE.title, format!("Share in pauses below {short} s"));
    assert_eq!(pauses::MEDIUM_PAUSE_SHARE.title, format!("Share in pauses of {short} to {long} s"));
    assert_eq!(pauses::LONG_PAUSE_SHARE.title, format!("Share in pauses of {long} s and more"));
    let (low_hz, high_hz) = spectrum::TREMOR_HZ;
    assert_eq!(spectrum::TREMOR_SHARE.title, format!("Share of {low_hz} to {high_hz} Hz"));
    let faster = FeatureSettings { thinking_speed_mm_s: 6.5, ..settings };
    assert!(time::THINKING_TIME.describe(&faster).ends_with("its speed is below 6.5 mm/s."));
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
    near(of_first(&got, "median_velocity"), speed, 2e-3);
    near(of_first(&got, "median_curvature"), 1.0 / radius, 2e-3);
    near(of_first(&got, "peak_curvature"), 1.0 / radius, 5e-3);
    near(of_first(&got, "spread"), radius, 2e-3);
    near(of_first(&got, "movement_rate"), 1.0, 5e-3);
    assert_eq!(of_first(&got, "submovements"), 1.0);
    assert!(of_first(&got, "tremor_share") < 1e-4 && of_first(&got, "motion_frequency") < 0.8, "it turns at 0.17 Hz");
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
    near(of_first(&got, "median_curvature"), 1.0 / radius, 2e-3);
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
    near(of_first(&got, "medium_pauses"), 15.0 / (task / 60.0), 2e-3);
    near(of_first(&got, "medium_pause_share"), of_first(&got, "idle_share"), 1e-12);
    let others = ["short_pauses", "long_pauses", "short_pause_share", "long_pause_share"];
    assert_eq!(others.map(|name| of_first(&got, name)), [0.0; 4]);
    near(of_first(&got, "movement_rate"), 16.0 / (task / 60.0), 2e-3);
    assert_eq!(of_first(&got, "submovements"), 16.0);
    near(of_first(&got, "path_ratio"), 1.0, 1e-6);

    let profile: Vec<f64> = times(50.0, 3.0).iter().map(|t| speed(t / 3.0)).filter(|v| *v > 7.0).collect();
    near(of_first(&got, "log_dimensionless_jerk"), per_movement::ldlj(&profile, 0.02).unwrap(), 1e-2);
    near(of_first(&got, "spectral_arc_length"), per_movement::sparc(&profile, 0.02).unwrap(), 1e-2);
}

#[test]
fn pauses_are_counted_by_their_length() {
    // Strokes of 40 mm in 1.5 s, there and back, with rests that grow from none to 4 s.
    let pauses = [0.0, 0.3, 1.5, 2.0, 4.0];
    let path = move |t: f64| {
        let (mut x, mut left) = (0.0, t);
        for (k, pause) in pauses.iter().enumerate() {
            let (from, to) = if k % 2 == 0 { (0.0, 40.0) } else { (40.0, 0.0) };
            x = from + (to - from) * stroke(left / 1.5);
            left -= 1.5 + pause;
            if left < 0.0 {
                break;
            }
        }
        Point3::new(x, 0.0, 180.0)
    };
    let got = score(&record(&times(50.0, 20.0), &[&path]));
    let minutes = of_first(&got, "duration") / 60.0;
    for (name, count) in [("short_pauses", 2.0), ("medium_pauses", 2.0), ("long_pauses", 0.0)] {
        near(of_first(&got, name), count / minutes, 1e-6); // the time after the last stroke is not in the task
    }
    assert_eq!(of_first(&got, "movements"), 5.0);
}

/// Time from the start of a stroke of 40 mm in 1.5 s until it is as fast as a movement, s.
fn onset_s() -> f64 {
    1.5 * (1.0 - (1.0 - 4.0 * (7.0f64 / 800.0).sqrt()).sqrt()) / 2.0
}

#[test]
fn a_tool_that_moves_along_the_line_of_sight_rests_in_the_picture() {
    // Every 6 s a stroke of 40 mm across the picture and one in depth, each in 1.5 s before a rest of 1.5 s.
    let path = |t: f64| {
        let (lap, left) = ((t / 6.0).floor(), t % 6.0);
        let place = |u: f64| if (lap as usize).is_multiple_of(2) { 40.0 * stroke(u) } else { 40.0 * (1.0 - stroke(u)) };
        Point3::new(place(left / 1.5), 0.0, 180.0 + place((left - 3.0) / 1.5))
    };
    let got = score(&record(&times(50.0, 8.0 * 6.0 + 3.0), &[&path]));
    let task_s = of_first(&got, "duration");
    for (space, tier, count, rest_s) in [(Space::ThreeD, "medium", 16.0, 1.5), (Space::Image, "long", 8.0, 4.5)] {
        let of = |name: &str| get(&got, name, Some(0), space).unwrap();
        near(of(&format!("{tier}_pauses")), count / (task_s / 60.0), 1e-6);
        near(of("idle_share"), count * (rest_s + 2.0 * onset_s()) / task_s, 2e-2);
        near(of(&format!("{tier}_pause_share")), of("idle_share"), 1e-12);
        assert_eq!(of("short_pauses") + of("short_pause_share"), 0.0);
    }
}

#[test]
fn in_the_picture_a_hand_that_moves_in_depth_alone_leaves_the_work_to_the_other() {
    let strokes = |t: f64| {
        let place = stroke((t % 3.0) / 1.5);
        40.0 * if ((t / 3.0) as usize).is_multiple_of(2) { place } else { 1.0 - place }
    };
    let across = |t: f64| Point3::new(strokes(t), 0.0, 180.0);
    let in_depth = |t: f64| Point3::new(100.0, 0.0, 180.0 + strokes(t));
    let got = score(&record(&times(50.0, 30.0), &[&across, &in_depth]));
    let of = |name: &str, tool: Option<usize>| [Space::ThreeD, Space::Image].map(|space| get(&got, name, tool, space));
    assert_eq!(of("together_share", None), [Ok(1.0), Ok(0.0)]);
    assert_eq!(of("handedness_in_time", Some(0)), [Ok(0.5), Ok(1.0)]);
    let ([alone, alone_in_picture], [neither, in_picture]) = (of("one_hand_share", None), of("neither_share", None));
    assert_eq!((alone, neither), (Ok(0.0), in_picture));
    near(alone_in_picture.unwrap() + in_picture.unwrap(), 1.0, 1e-12);
    // Most of the time the first tip is at either end of its stroke, 40 mm apart.
    let [low, high] =
        ["tip_distance_low", "tip_distance_high"].map(|name| get(&got, name, None, Space::Image).unwrap());
    near(low, 60.0, 1e-2);
    near(high, 100.0, 1e-2);
    let spread = get(&got, "tip_distance_spread", None, Space::Image).unwrap();
    assert!(spread > 15.0 && spread < 20.0, "{spread}");
}

#[test]
fn a_tremor_of_4_hz_is_a_tremor_and_a_slow_circle_has_none() {
    let path = |tremor_mm: f64| {
        move |t: f64| {
            let (sin, cos) = (TAU * t / 6.0).sin_cos();
            Point3::new(30.0 * cos, 30.0 * sin + tremor_mm * (TAU * 4.0 * t).sin(), 180.0)
        }
    };
    let [none, some] = [0.0, 2.0].map(|tremor_mm| score(&record(&times(50.0, 60.0), &[&path(tremor_mm)])));
    assert!(of_first(&none, "tremor_share") < 1e-4);
    // As a tremor of 4 Hz and 2 mm is fitted: 2 mm · 2π · 4 Hz at half the power, beside the circle's 31 mm/s.
    let gain = gain(4.0);
    let power = (gain * 2.0 * TAU * 4.0).powi(2) / 2.0;
    near(of_first(&some, "tremor_share"), power / (power + (TAU * 5.0).powi(2)), 2e-2);
    assert!((3.5..4.5).contains(&of_first(&some, "motion_frequency")));
}

/// How much of a sine's velocity the local fit passes.
fn gain(hz: f64) -> f64 {
    let times: Vec<f64> = (-50..=50).map(|k| f64::from(k) * 0.02).collect();
    let values: Vec<Vector3<f64>> = times.iter().map(|t| Vector3::new((TAU * hz * t).sin(), 0.0, 0.0)).collect();
    let half_s = FeatureSettings::default().fit_half_window_s;
    fit::VectorSeries { times_s: &times, values: &values }.fit(0.0, half_s).unwrap().first.x / (TAU * hz)
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
        let space = find(name).unwrap().spaces[0];
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
    let [one, neither] = ["one_hand_share", "neither_share"].map(|name| get(&got, name, None, Space::ThreeD).unwrap());
    assert!(one > 0.95 && (one + neither - 1.0).abs() < 1e-12, "{one} {neither}");
    assert!(get(&got, "speed_balance", None, Space::ThreeD).unwrap() < 1e-9);
    assert_eq!(get(&got, "handedness_in_time", Some(0), Space::ThreeD), Ok(1.0));
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
    assert_eq!(get(&got, "one_hand_share", None, Space::ThreeD), Ok(0.0));
    near(get(&got, "speed_balance", None, Space::ThreeD).unwrap(), 1.0, 1e-9);
    near(get(&got, "tip_distance_low", None, Space::ThreeD).unwrap(), 50.0, 1e-9);
    near(get(&got, "tip_distance_high", None, Space::ThreeD).unwrap(), 50.0, 1e-9);
    assert!(get(&got, "tip_distance_spread", None, Space::ThreeD).unwrap() < 1e-6);
    near(get(&got, "handedness_in_time", Some(1), Space::ThreeD).unwrap(), 0.5, 1e-9);
}

#[test]
fn a_hand_that_swings_has_the_distances_of_a_swing() {
    // Over a sine of amplitude 30 about 100 mm: standard deviation 30/√2, quantiles at 30·sin(0.45·π).
    let swing = |t: f64| Point3::new(100.0 + 30.0 * (TAU * t / 4.0).sin(), 0.0, 180.0);
    let got = score(&record(&times(25.0, 40.0), &[&|_| Point3::new(0.0, 0.0, 180.0), &swing]));
    near(get(&got, "tip_distance_spread", None, Space::ThreeD).unwrap(), 30.0 / 2f64.sqrt(), 1e-2);
    let off = 30.0 * (0.45 * PI).sin();
    near(get(&got, "tip_distance_low", None, Space::ThreeD).unwrap(), 100.0 - off, 5e-3);
    near(get(&got, "tip_distance_high", None, Space::ThreeD).unwrap(), 100.0 + off, 5e-3);
}

#[test]
fn a_path_strays_from_itself_by_nothing_and_from_a_shifted_one_by_the_shift() {
    let settings = FeatureSettings::default();
    let followed = |path: &Path<'_>| motions(&record(&times(25.0, 40.0), &[path]), &settings).remove(0).unwrap();
    let own = followed(&square(0.0));
    let strays = |other: &Motion| reference::deviation(&own, other, &settings).unwrap();
    assert_eq!(strays(&own), reference::Deviation { mean_mm: 0.0, largest_mm: 0.0 });
    let deeper = strays(&followed(&|t| square(0.0)(t) + Vector3::new(0.0, 0.0, 7.0)));
    near(deeper.mean_mm, 7.0, 1e-6);
    near(deeper.largest_mm, 7.0, 1e-6);
    let faster = strays(&followed(&|t| square(0.0)((1.2 * t).min(40.0))));
    assert!(faster.mean_mm < 0.5, "pace does not count: {faster:?}");
    let rest = followed(&|_| Point3::new(0.0, 0.0, 180.0));
    assert_eq!(reference::deviation(&own, &rest, &settings), Err(NotEnough::NoMovement));
}

#[test]
fn one_tool_has_no_features_of_two() {
    let got = score(&record(&times(25.0, 40.0), &[&square(0.0)]));
    assert_eq!(get(&got, "synchrony", None, Space::ThreeD), Err(NotEnough::NotTwoTools { found: 1 }));
}
