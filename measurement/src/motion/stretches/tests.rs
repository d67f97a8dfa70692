//! Laws of feature stretches: where they lie, what they add up to, that planted faults are found, and that errors are
//! not.

use std::f64::consts::TAU;

use nalgebra::Point3;

use super::*;
use crate::motion::assessment::{Assessment, AssessmentSettings, assess};
use crate::motion::features::{StretchSource, find};
use crate::random::Dice;
use crate::vision::covariance::PositionCovariance;
use crate::vision::trajectory::{Sample, SampleState, Trajectory};

/// A tip over time, mm.
type Path<'a> = dyn Fn(f64) -> Point3<f64> + 'a;

const FPS: f64 = 50.0;

/// Samples at 50 a second from `start_s`, with the errors that they state.
fn record(start_s: f64, length_s: f64, paths: &[&Path<'_>], sigma_mm: f64) -> Trajectory {
    let frames = (length_s * FPS) as u64;
    let time_s = |frame: u64| start_s + frame as f64 / FPS;
    let sample = |frame: u64, tool: usize| Sample {
        frame,
        time_s: time_s(frame),
        tool,
        tip_mm: paths[tool](frame as f64 / FPS),
        velocity_mm_s: None,
        axis: None,
        tip_px: None,
        covariance_mm2: Some(PositionCovariance::from_sigmas(sigma_mm, sigma_mm)),
        state: SampleState::Observed,
    };
    let samples = (0..frames).flat_map(|frame| (0..paths.len()).map(move |tool| (frame, tool)));
    Trajectory {
        tools: (0..paths.len()).map(|tool| format!("tool {tool}")).collect(),
        samples: samples.map(|(frame, tool)| sample(frame, tool)).collect(),
        frame_times_s: (0..frames).map(time_s).collect(),
        cuts: Vec::new(),
    }
}

fn assessed(trajectory: &Trajectory) -> Assessment {
    assess(trajectory, &[], &AssessmentSettings::default())
}

fn of<'a>(assessment: &'a Assessment, name: &str, tool: Option<usize>) -> &'a FeatureStretches {
    let space = find(name).unwrap().spaces[0];
    let mut all = assessment.stretches.iter();
    all.find(|e| (e.feature.name, e.tool, e.space) == (name, tool, space)).unwrap()
}

#[track_caller]
fn first(assessment: &Assessment, name: &str, tool: Option<usize>) -> Stretch {
    match &of(assessment, name, tool).stretches {
        Ok(stretches) => stretches[0],
        Err(reason) => panic!("{name}: {reason}"),
    }
}

/// Strokes of 40 mm there and back every two seconds, with one rest: `stop` is its start and its length, s.
fn strokes(stop: (f64, f64)) -> impl Fn(f64) -> Point3<f64> {
    move |t| {
        let moved = if t < stop.0 { t } else { (t - stop.1).max(stop.0) };
        let wide = 20.0 + 0.13 * moved; // no two strokes are the same
        Point3::new(wide * (TAU * moved / 4.0).sin(), 10.0 * (TAU * moved / 4.0).cos(), 180.0)
    }
}

/// The same, with a loop of 15 mm that starts at `at_s` and lasts 1.5 s.
fn with_loop(at_s: f64) -> impl Fn(f64) -> Point3<f64> {
    move |t| {
        let along = Point3::new(2.0 * t + 8.0 * (TAU * t / 5.0 - TAU / 4.0).sin(), 0.0, 180.0);
        let turn = ((t - at_s) / 1.5).clamp(0.0, 1.0);
        let eased = turn * turn * (3.0 - 2.0 * turn);
        along + nalgebra::Vector3::new(15.0 * (TAU * eased).sin(), 15.0 * (1.0 - (TAU * eased).cos()), 0.0)
    }
}

/// The strokes with a tremor of 4.5 Hz and 1.2 mm for three seconds from `at_s`.
fn trembling(at_s: f64) -> impl Fn(f64) -> Point3<f64> {
    let base = strokes((1e9, 0.0));
    move |t| {
        let fade = ((t - at_s) * std::f64::consts::PI / 3.0).sin().max(0.0);
        let fade = if (at_s..at_s + 3.0).contains(&t) { fade } else { 0.0 };
        base(t) + nalgebra::Vector3::new(0.0, 1.2 * fade * (TAU * 4.5 * t).sin(), 0.0)
    }
}

#[test]
fn every_feature_has_evidence_or_is_made_by_the_whole_task_alike() {
    let assessment = assessed(&record(0.0, 40.0, &[&strokes((12.0, 5.0)), &strokes((25.0, 3.0))], 0.02));
    assert_eq!(assessment.stretches.len(), assessment.features.len());
    for (evidence, value) in assessment.stretches.iter().zip(&assessment.features) {
        assert_eq!((evidence.feature, evidence.tool, evidence.space), (value.feature, value.tool, value.space));
        let is_whole = evidence.feature.stretches == StretchSource::WholeTask;
        let expected_whole = value.value.is_ok() && is_whole;
        assert_eq!(evidence.stretches == Err(NoStretches::WholeTask), expected_whole, "{}", evidence.feature.name);
    }
}

#[test]
fn stretches_lie_in_the_task_do_not_overlap_and_add_up_to_no_more_than_the_value() {
    let (a, b) = (with_loop(11.0), trembling(20.0));
    let assessment = assessed(&record(0.0, 40.0, &[&a, &b], 0.02));
    let (start, end) = assessment.task_s.unwrap();
    let mut found = 0;
    for evidence in &assessment.stretches {
        let Ok(stretches) = &evidence.stretches else { continue };
        let name = evidence.feature.name;
        assert!((1..=MAX_STRETCHES).contains(&stretches.len()), "{name}");
        for (index, stretch) in stretches.iter().enumerate() {
            assert!(
                start - 1e-9 <= stretch.from_s && stretch.from_s < stretch.to_s && stretch.to_s <= end + 1e-9,
                "{name}"
            );
            let apart = |other: &Stretch| other.to_s <= stretch.from_s + 1e-9 || stretch.to_s <= other.from_s + 1e-9;
            assert!(stretches[..index].iter().all(apart), "{name}: {stretches:?}");
        }
        let shares: f64 = stretches.iter().filter_map(|stretch| stretch.share).sum();
        assert!(shares <= 1.0 + 1e-9, "{name}: {stretches:?}");
        found += 1;
    }
    assert!(found > 30, "{found} features have stretches");
}

#[test]
fn amounts_of_what_adds_up_are_part_of_the_value() {
    let assessment = assessed(&record(0.0, 40.0, &[&strokes((12.0, 5.0)), &with_loop(20.0)], 0.02));
    for (name, tool, by) in [("thinking_time", 0, 1.0), ("path_length", 1, 1.0), ("duration", 0, 1.0)] {
        let evidence = of(&assessment, name, Some(tool));
        let value = assessment.features.iter().find(|v| (v.feature, v.tool) == (evidence.feature, Some(tool))).unwrap();
        // A tool moves as the recording begins, so its duration is a lower bound without an error bar.
        let measured = value.error.map_or_else(|_| value.value.unwrap(), |bar| bar.as_measured);
        let sum: f64 = evidence.stretches.as_ref().unwrap().iter().map(|stretch| stretch.amount).sum();
        assert!(sum * by <= measured + 1e-9 && sum > 0.0, "{name}: {sum} of {measured}");
        let stretch = first(&assessment, name, Some(tool));
        assert!((stretch.share.unwrap() - stretch.amount / measured).abs() < 1e-9, "{name}: {stretch:?}");
    }
}

#[test]
fn a_pause_a_detour_a_burst_and_an_absence_are_found_where_they_were_put() {
    let assessment = assessed(&record(0.0, 40.0, &[&strokes((12.0, 5.0)), &with_loop(20.0)], 0.02));
    for (name, tool) in
        [("idle_share", Some(0)), ("thinking_time", Some(0)), ("duration", Some(0)), ("long_pause_share", Some(0))]
    {
        let pause = first(&assessment, name, tool);
        assert!((pause.from_s - 12.0).abs() < 1.0 && (pause.to_s - 17.0).abs() < 1.0, "{name}: {pause:?}");
    }
    let both = assessed(&record(0.0, 40.0, &[&strokes((12.0, 5.0)), &strokes((1e9, 0.0))], 0.02));
    for (name, tool) in [("one_hand_share", None), ("handedness", Some(1)), ("synchrony", None)] {
        let alone = first(&both, name, tool);
        assert!((alone.from_s - 12.0).abs() < 1.0 && (alone.to_s - 17.0).abs() < 1.0, "{name}: {alone:?}");
    }
    assert!(of(&both, "handedness", Some(0)).stretches.is_err(), "it never works alone");
    let detour = first(&assessment, "path_length", Some(1));
    assert!(detour.from_s < 20.5 && detour.to_s > 21.0, "{detour:?}");
    let burst = first(&assessed(&record(0.0, 40.0, &[&trembling(23.0)], 0.02)), "tremor_share", Some(0));
    assert!(burst.from_s > 21.0 && burst.to_s < 28.0, "{burst:?}");

    let mut left = record(0.0, 40.0, &[&strokes((1e9, 0.0))], 0.02);
    left.samples.retain(|sample| !(14.0..18.0).contains(&sample.time_s) && !(30.0..31.0).contains(&sample.time_s));
    let absence = of(&assessed(&left), "not_seen_share", Some(0)).stretches.clone().unwrap();
    assert_eq!(absence.len(), 2, "{absence:?}");
    assert!((absence[0].from_s - 14.0).abs() < 0.1 && (absence[0].to_s - 18.0).abs() < 0.1, "{absence:?}");
}

#[test]
fn stretches_that_were_not_seen_count_for_no_hand() {
    let mut left = record(0.0, 40.0, &[&strokes((12.0, 5.0))], 0.02);
    left.samples.retain(|sample| !(13.0..16.0).contains(&sample.time_s));
    let assessment = assessed(&left);
    for evidence in assessment.stretches.iter().filter(|evidence| evidence.feature.family.name() != "view") {
        for stretch in evidence.stretches.iter().flatten() {
            assert!(stretch.to_s < 13.1 || stretch.from_s > 15.9, "{}: {stretch:?}", evidence.feature.name);
        }
    }
}

#[test]
fn trembling_of_the_tracker_is_no_tremor_of_the_hand() {
    const PASSING: f64 = 0.26; // most of the stated error lasts
    let still = |dice: &mut Dice, sigma: f64| {
        let mut trajectory = record(0.0, 40.0, &[&strokes((1e9, 0.0))], sigma);
        for sample in &mut trajectory.samples {
            sample.tip_mm += nalgebra::Vector3::new(dice.gauss(), dice.gauss(), dice.gauss()) * (PASSING * sigma);
        }
        trajectory
    };
    let assessment = assessed(&still(&mut Dice::new(3, "tracker"), 1.9));
    for name in ["tremor_share", "motion_frequency", "jitter", "normalised_jerk", "smoothness", "peak_curvature"] {
        let evidence = of(&assessment, name, Some(0));
        assert!(evidence.stretches.is_err(), "{name}: {:?}", evidence.stretches);
    }
}

#[test]
fn a_path_that_states_no_errors_has_no_evidence_but_for_what_was_not_seen() {
    let mut silent = record(0.0, 40.0, &[&strokes((12.0, 5.0))], 0.02);
    silent.samples.retain(|sample| !(30.0..33.0).contains(&sample.time_s));
    silent.samples.iter_mut().for_each(|sample| sample.covariance_mm2 = None);
    let assessment = assessed(&silent);
    assert_eq!(of(&assessment, "idle_share", Some(0)).stretches, Err(NoStretches::ErrorsNotStated));
    assert!(of(&assessment, "longest_absence", Some(0)).stretches.is_ok());
    let withheld = assessment.withheld();
    assert!(withheld.stretches.iter().all(|evidence| evidence.stretches == Err(NoStretches::Refused)));
}

#[test]
fn tools_that_change_places_change_evidence_with_them() {
    let (a, b) = (strokes((12.0, 5.0)), with_loop(20.0));
    let (one, other) = (assessed(&record(0.0, 40.0, &[&a, &b], 1e-6)), assessed(&record(0.0, 40.0, &[&b, &a], 1e-6)));
    for evidence in &one.stretches {
        let swapped = evidence.tool.map(|tool| 1 - tool);
        let like = |e: &&FeatureStretches| (e.feature, e.tool, e.space) == (evidence.feature, swapped, evidence.space);
        let same = other.stretches.iter().find(like).unwrap();
        assert_same(&evidence.stretches, &same.stretches, 0.0, evidence.feature.name);
    }
}

#[test]
fn a_recording_that_begins_later_has_its_evidence_later() {
    let (a, b) = (strokes((12.0, 5.0)), with_loop(20.0));
    let [early, late] = [0.0, 100.0].map(|start| assessed(&record(start, 40.0, &[&a, &b], 1e-6)));
    for (evidence, later) in early.stretches.iter().zip(&late.stretches) {
        assert_same(&evidence.stretches, &later.stretches, 100.0, evidence.feature.name);
    }
}

#[track_caller]
fn assert_same(a: &Result<Vec<Stretch>, NoStretches>, b: &Result<Vec<Stretch>, NoStretches>, later_s: f64, name: &str) {
    let (Ok(a), Ok(b)) = (a, b) else { return assert_eq!(a, b, "{name}") };
    let near = |x: f64, y: f64, within: f64| (x - y).abs() <= within;
    let same = |(a, b): (&Stretch, &Stretch)| {
        near(a.from_s + later_s, b.from_s, 0.03)
            && near(a.to_s + later_s, b.to_s, 0.03)
            && near(a.amount, b.amount, 1e-3 * a.amount.abs() + 0.05)
    };
    assert!(a.len() == b.len() && a.iter().zip(b).all(same), "{name}: {a:?} and {b:?}");
}
