//! Begin and end of an attempt: where a stopwatch would start and stop, and what is stated where nothing shows it.

use super::errors::{bar, seen};
use super::*;
use crate::motion::features::errors::{ErrorBar, NoErrorBar};
use crate::vision::reason::MissReason;
use crate::vision::tracker::{Absence, Gap, ToolQuality};

/// Rests at `x` = 0 until `start_s`, moves 60 mm in 1.5 s, rests for 1 s, and moves back in 1.5 s: 4 s in all.
fn there_and_back(start_s: f64) -> impl Fn(f64) -> Point3<f64> {
    move |t| Point3::new(60.0 * (stroke((t - start_s) / 1.5) - stroke((t - start_s - 2.5) / 1.5)), -10.0, 0.0)
}

/// Time from the start of a stroke to 7 mm/s, s.
const ONSET_S: f64 = 0.125;

/// Time for which the tip is faster than that, or between two such times, s.
const MOVES_S: f64 = 4.0 - 2.0 * ONSET_S;

/// The seen part of a path: rows outside `seen_s` are missing for this reason.
fn seen_between(mut trajectory: Trajectory, seen_s: [f64; 2], absence: Absence) -> (Trajectory, ToolQuality) {
    let within = |time_s: f64| (seen_s[0]..=seen_s[1]).contains(&time_s);
    trajectory.samples.retain(|sample| within(sample.time_s));
    let frames: Vec<u64> =
        (0..).zip(&trajectory.frame_times_s).filter(|(_, time_s)| !within(**time_s)).map(|(frame, _)| frame).collect();
    let gaps = frames.chunk_by(|a, b| a + 1 == *b).map(|run| Gap { first: run[0], last: run[run.len() - 1], absence });
    (trajectory, ToolQuality { gaps: gaps.collect(), ..ToolQuality::default() })
}

fn assessed(trajectory: &Trajectory, tools: &[ToolQuality]) -> Assessment {
    assess(trajectory, tools, &AssessmentSettings::default())
}

fn duration(assessment: &Assessment) -> Result<ErrorBar, NoErrorBar> {
    let session = assessment.features.iter().find(|value| value.feature.name == "duration" && value.tool.is_none());
    session.unwrap().error
}

#[test]
fn a_duration_is_right_to_a_tenth_of_a_second_at_every_frame_rate() {
    for fps in [15.0, 25.0, 30.0, 60.0] {
        for seed in 0..6 {
            let start_s = 1.3 + 0.037 * seed as f64;
            let got = score(&seen(&times(fps, 8.0), &there_and_back(start_s), seed));
            let (value, bar) = (of_first(&got, "duration"), bar(&got, "duration"));
            assert!((value - MOVES_S).abs() <= 0.2, "{value} at {fps} fps, seed {seed}: a tenth at either end");
            assert!(bar.high - bar.low < 0.6 && bar.low <= MOVES_S && MOVES_S <= bar.high, "{bar:?} at {fps}");
            let (begin_s, end_s) = got.task_s.unwrap();
            assert!(
                (begin_s - start_s - ONSET_S).abs() <= 0.1 && (end_s - begin_s - MOVES_S).abs() <= 0.2,
                "{begin_s} {end_s}"
            );
        }
    }
}

#[test]
fn the_error_of_a_duration_does_not_grow_with_it() {
    let path = square(0.0);
    let [short, long] = [20.0, 60.0].map(|end_s| bar(&score(&seen(&times(25.0, end_s), &path, 1)), "duration"));
    assert!(long.high - long.low < 1.3 * (short.high - short.low), "{short:?} {long:?}");
}

#[test]
fn tremor_and_a_short_touch_begin_no_attempt() {
    let moves = there_and_back(4.0);
    let trembles = |t: f64| moves(t) + nalgebra::Vector3::new(0.15 * (TAU * 7.0 * t).sin(), 0.0, 0.0);
    let touched = |t: f64| moves(t) + nalgebra::Vector3::new(0.0, 1.2 * (-((t - 1.0) / 0.1).powi(2)).exp(), 0.0);
    let paths: [&Path<'_>; 2] = [&trembles, &touched];
    for path in paths {
        let (begin_s, end_s) = score(&record(&times(25.0, 12.0), &[path])).task_s.unwrap();
        assert!((begin_s - 4.0 - ONSET_S).abs() < 0.1 && (end_s - 8.0 + ONSET_S).abs() < 0.1, "{begin_s} to {end_s}");
    }
}

#[test]
fn a_recording_that_begins_or_ends_in_mid_motion_gives_a_lower_bound() {
    let begins_late = score(&seen(&times(25.0, 8.0), &there_and_back(-0.7), 1));
    assert_eq!(duration(&begins_late), Err(NoErrorBar::AtLeast));
    near(of_first(&begins_late, "duration"), MOVES_S + ONSET_S - 0.7, 0.03);
    let ends_early = score(&seen(&times(25.0, 5.0), &there_and_back(1.7), 1));
    assert_eq!(duration(&ends_early), Err(NoErrorBar::AtLeast));
    assert!(duration(&score(&seen(&times(25.0, 8.0), &there_and_back(1.7), 1))).is_ok());
}

#[test]
fn where_a_person_trimmed_a_recording_its_attempt_begins() {
    let path = seen(&times(25.0, 8.0), &there_and_back(-0.7), 1);
    let trimmed = |is_trimmed| assess(&path, &[], &AssessmentSettings { is_trimmed, ..AssessmentSettings::default() });
    assert!(duration(&trimmed([true, false])).is_ok());
    assert_eq!(duration(&trimmed([false, true])), Err(NoErrorBar::AtLeast));
}

#[test]
fn an_attempt_begins_as_a_tool_comes_into_the_picture_and_ends_as_it_leaves() {
    let whole = seen(&times(25.0, 8.0), &there_and_back(1.0), 1);
    let (path, tool) = seen_between(whole, [1.6, 4.4], Absence::LeftView);
    let got = assessed(&path, &[tool]);
    assert_eq!(got.task_s, Some((1.6, 4.4)));
    let bar = duration(&got).unwrap();
    assert!(bar.high - bar.low < 0.6, "{bar:?}");
}

#[test]
fn a_tool_that_the_tracker_found_late_in_motion_may_have_begun_at_any_moment_before() {
    let whole = seen(&times(25.0, 8.0), &there_and_back(1.0), 1);
    let (path, tool) = seen_between(whole, [1.6, 8.0], Absence::Lost(MissReason::PoorFit));
    let bar = duration(&assessed(&path, &[tool])).unwrap();
    assert!(bar.low <= 3.4 && (4.9..5.6).contains(&bar.high), "1.6 s before it was found: {bar:?}");
    let whole = seen(&times(25.0, 8.0), &there_and_back(1.0), 1);
    let (path, tool) = seen_between(whole, [0.6, 8.0], Absence::Lost(MissReason::PoorFit));
    let bar = duration(&assessed(&path, &[tool])).unwrap();
    assert!(bar.high - bar.low < 0.6, "found at rest: {bar:?}");
}

#[test]
fn a_tool_that_moved_while_it_was_hidden_began_there() {
    let whole = seen(&times(25.0, 8.0), &there_and_back(2.0), 1);
    let (mut path, mut tool) = seen_between(whole.clone(), [0.0, 8.0], Absence::LeftView);
    path.samples.retain(|sample| !(1.8..3.6).contains(&sample.time_s));
    tool.gaps = vec![Gap { first: 45, last: 89, absence: Absence::Lost(MissReason::TipHidden) }];
    let got = assessed(&path, &[tool]);
    let (begin_s, end_s) = got.task_s.unwrap();
    assert!((begin_s - 3.6).abs() < 0.05 && (end_s - 6.0 + ONSET_S).abs() < 0.1, "{begin_s} to {end_s}");
    let bar = duration(&got).unwrap();
    assert!(bar.low <= MOVES_S && MOVES_S <= bar.high && bar.high < MOVES_S + 0.6, "{bar:?}");
}

#[test]
fn the_first_and_the_last_of_two_tools_count() {
    let [early, late] = [there_and_back(1.0), there_and_back(3.0)];
    let got = score(&record(&times(25.0, 10.0), &[&late, &early]));
    let (begin_s, end_s) = got.task_s.unwrap();
    assert!((begin_s - 1.0 - ONSET_S).abs() < 0.1 && (end_s - 7.0 + ONSET_S).abs() < 0.1, "{begin_s} to {end_s}");
    near(get(&got, "duration", None, Space::ThreeD).unwrap(), 6.0 - 2.0 * ONSET_S, 0.03);
    near(of_first(&got, "duration"), MOVES_S, 0.05);
}
