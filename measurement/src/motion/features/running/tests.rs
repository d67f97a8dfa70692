//! Features of a live feed equal those of the whole path, and a feed keeps only a moment of the path.

use nalgebra::Point3;
use proptest::prelude::*;

use super::*;
use crate::motion::features;
use crate::motion::features::motion::Motion;

/// A path with uneven frames, each observed or not: a hand that circles and sometimes rests.
fn path(steps_s: &[f64], seen: &[bool]) -> Vec<Sample> {
    let mut time_s = 0.0;
    let frames = steps_s.iter().zip(seen).enumerate();
    let samples = frames.map(|(frame, (step_s, seen))| {
        time_s += step_s;
        let moving_s = if time_s % 4.0 < 3.0 { time_s } else { time_s - time_s % 4.0 + 3.0 };
        let at = |t: f64| Vector3::new(20.0 * t.cos(), 20.0 * (1.3 * t).sin(), 150.0 + 9.0 * (0.7 * t).sin());
        Sample {
            frame: frame as u64,
            time_s,
            tool: 0,
            tip_mm: Point3::from(at(moving_s)),
            velocity_mm_s: Some((at(moving_s + 1e-4) - at(moving_s)) * 1e4),
            axis: None,
            tip_px: None,
            covariance_mm2: None,
            state: if *seen { SampleState::Observed } else { SampleState::Predicted },
        }
    });
    samples.collect()
}

proptest! {
    #[test]
    fn sums_over_a_feed_are_those_over_the_whole_path(
        steps_s in prop::collection::vec(0.015f64..0.06, 60..300),
        lost in prop::collection::vec((0usize..300, 1usize..14), 0..5),
    ) {
        let mut seen = vec![true; steps_s.len()];
        for (first, length) in lost {
            let first = first.min(seen.len());
            let end = (first + length).min(seen.len());
            seen[first..end].fill(false);
        }
        let samples = path(&steps_s, &seen);
        let settings = FeatureSettings::default();
        let mut running = RunningFeatures::new(1, settings.clone());
        samples.iter().for_each(|sample| running.add_sample(sample));
        running.finish();
        let motion = Motion::of_samples(&samples, &[], &settings);
        let whole = features::measure(&[motion], &settings, |feature| LIVE_FEATURES.contains(&feature));
        for live in running.values() {
            let batch = whole.iter().find(|v| v.feature == live.feature && v.space == live.space).unwrap();
            match (live.value, batch.value) {
                (Ok(live), Ok(batch)) => prop_assert!((live - batch).abs() <= 1e-9 * (1.0 + batch.abs())),
                (live, batch) => prop_assert_eq!(live.is_err(), batch.is_err(), "{:?} {:?}", live, batch),
            }
        }
    }
}

#[test]
fn a_tool_that_is_gone_is_not_seen_for_longer_and_longer() {
    let samples = path(&[0.04; 100], &[true; 100]);
    let mut running = RunningFeatures::new(1, FeatureSettings::default());
    samples.iter().for_each(|sample| running.add_sample(sample));
    let not_seen =
        |running: &RunningFeatures| running.values().into_iter().find(|v| v.feature == &NOT_SEEN_SHARE).unwrap().value;
    running.advance_to(4.1);
    assert!(not_seen(&running).unwrap() < 0.03, "{:?}", not_seen(&running));
    running.advance_to(8.25);
    assert!((not_seen(&running).unwrap() - 0.5).abs() < 0.03, "{:?}", not_seen(&running));
}

#[test]
fn a_feed_of_an_hour_keeps_no_more_than_a_moment_of_it() {
    let samples = path(&vec![0.04; 3000], &vec![true; 3000]);
    let mut running = RunningFeatures::new(1, FeatureSettings::default());
    for sample in &samples {
        running.add_sample(sample);
        assert!(running.tools[0].run.len() < 40, "{}", running.tools[0].run.len());
    }
}

#[test]
fn too_little_is_said_to_be_so() {
    let samples = path(&[0.04; 20], &[true; 20]);
    let mut running = RunningFeatures::new(2, FeatureSettings::default());
    samples.iter().for_each(|sample| running.add_sample(sample));
    let values = running.values();
    assert_eq!(values.len(), 2 * LIVE_FEATURES.len());
    assert!(values.iter().all(|value| value.value.is_err()), "{values:?}");
}

#[test]
fn the_share_not_seen_is_stated_even_if_less_than_a_second_was_seen() {
    let mut seen = [true; 60];
    seen[16..40].fill(false);
    let samples = path(&[0.02; 60], &seen);
    let settings = FeatureSettings::default();
    let mut running = RunningFeatures::new(1, settings.clone());
    samples.iter().for_each(|sample| running.add_sample(sample));
    running.finish();
    let motions = [Motion::of_samples(&samples, &[], &settings)];
    let whole = features::measure(&motions, &settings, |feature| *feature == NOT_SEEN_SHARE);
    let live = running.values().into_iter().find(|value| value.feature == &NOT_SEEN_SHARE).unwrap();
    assert_eq!((live.value, whole.len()), (whole[0].value, 1));
    assert!((live.value.unwrap() - 0.4).abs() < 0.05, "{:?}", live.value);
}
