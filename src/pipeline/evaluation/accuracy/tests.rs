//! Tracks with known faults against a known truth.

use nalgebra::Point3;

use super::super::truth::TruthFrame;
use super::*;

/// Two tools on circles of 30 mm, 60 mm apart, for 200 frames at 25 fps; orange is hidden from frame 100 to 119.
fn truth() -> Truth {
    let tip = |frame: u64, x: f64| {
        let (sin, cos) = (f64::from(frame as u32) * 0.05).sin_cos();
        Point3::new(x + 30.0 * cos, 30.0 * sin, 180.0 + 10.0 * sin)
    };
    let tool =
        |name: &str, tip_mm, visible| TruthTool { tool: name.to_owned(), tip_mm, axis: None, tip_px: None, visible };
    let frame = |frame: u64| TruthFrame {
        frame,
        time_s: frame as f64 * 0.04,
        tools: vec![
            tool("orange", tip(frame, 0.0), if (100..120).contains(&frame) { 0.0 } else { 1.0 }),
            tool("cyan", tip(frame, 60.0), 0.5),
        ],
    };
    Truth { frames: (0..200).map(frame).collect() }
}

/// The truth as a perfect tracker would report it, then changed.
fn track(change: impl Fn(&mut Sample)) -> Trajectory {
    let rows = truth().frames.into_iter().flat_map(|frame| {
        let seen = frame.tools.into_iter().enumerate().filter(|(_, tool)| tool.visible > 0.0);
        seen.map(move |(tool, truth)| Sample {
            frame: frame.frame,
            time_s: frame.time_s,
            tool,
            tip_mm: truth.tip_mm,
            velocity_mm_s: None,
            axis: None,
            tip_px: None,
            sigma_xy_mm: None,
            sigma_z_mm: None,
            state: SampleState::Observed,
        })
        .collect::<Vec<_>>()
    });
    let mut samples: Vec<Sample> = rows.collect();
    samples.iter_mut().for_each(change);
    Trajectory { tools: vec!["orange".to_owned(), "cyan".to_owned()], samples, frame_times_s: Vec::new() }
}

fn measured(change: impl Fn(&mut Sample)) -> Accuracy {
    accuracy(&track(change), &truth()).unwrap()
}

#[test]
fn a_perfect_track_has_no_error_and_misses_nothing() {
    let got = measured(|_| ());
    let [wide, narrow] = [&got.all.levels[0], &got.all.levels[1]];
    assert_eq!((wide.frames, wide.found, narrow.frames, narrow.found), (380, 380, 180, 180));
    assert_eq!(wide.errors.unwrap().three_d.max, 0.0);
    assert_eq!((got.all.false_tracks, wide.swaps, got.largest_time_difference_s), (0, 0, 0.0));
}

#[test]
fn a_constant_offset_is_bias_without_deviation() {
    let errors = measured(|s| s.tip_mm += Vector3::new(3.0, -4.0, 12.0)).all.levels[0].errors.unwrap();
    assert!((errors.bias_mm - Vector3::new(3.0, -4.0, 12.0)).norm() < 1e-9);
    assert!(errors.deviation_mm.norm() < 1e-5);
    let of = |s: Spread| [s.rms, s.median, s.p95, s.max];
    for (spread, size) in [(errors.lateral, 5.0), (errors.depth, 12.0), (errors.three_d, 13.0)] {
        assert!(of(spread).iter().all(|v| (v - size).abs() < 1e-9), "{spread:?}");
    }
}

#[test]
fn a_row_for_a_hidden_tool_is_a_false_track_and_a_missing_row_lowers_what_was_found() {
    let mut track = track(|_| ());
    track.samples.retain(|s| s.frame >= 10);
    track.samples.push(Sample { frame: 105, tool: 0, ..track.samples[0] });
    let got = accuracy(&track, &truth()).unwrap();
    assert_eq!((got.all.false_tracks, got.tools[0].false_tracks, got.tools[1].false_tracks), (1, 1, 0));
    assert_eq!((got.tools[0].levels[0].frames, got.tools[0].levels[0].found), (180, 170));
}

#[test]
fn exchanged_names_are_swaps() {
    let got = measured(|s| {
        if (50..60).contains(&s.frame) {
            s.tool = 1 - s.tool
        }
    });
    assert_eq!(got.all.levels[0].swaps, 20);
}

#[test]
fn a_late_track_lags() {
    let mut late = track(|_| ());
    let early = track(|_| ());
    let two_frames_before = |s: &Sample| early.samples.iter().find(|e| e.frame + 2 == s.frame && e.tool == s.tool);
    late.samples.retain_mut(|s| two_frames_before(s).map(|e| s.tip_mm = e.tip_mm).is_some());
    let lag = accuracy(&late, &truth()).unwrap().all.levels[0].lag_s.unwrap();
    assert!((lag - 0.08).abs() < 0.002, "{lag}");
}

#[test]
fn predicted_rows_are_judged_apart() {
    let got = measured(|s| {
        if s.frame % 10 == 0 {
            s.state = SampleState::Predicted;
            s.tip_mm.x += 5.0;
        }
    });
    let level = &got.all.levels[0];
    assert_eq!(level.observed_errors.unwrap().three_d.max, 0.0);
    assert!((level.predicted_errors.unwrap().lateral.median - 5.0).abs() < 1e-9);
    assert_eq!((level.observed, level.predicted_errors.unwrap().rows), (342, 38));
}

#[test]
fn errors_of_two_sigmas_are_outside_and_of_one_sigma_inside() {
    let with_error = |e: f64| {
        measured(move |s| {
            (s.sigma_xy_mm, s.sigma_z_mm) = (Some(0.5), Some(2.0));
            s.tip_mm += Vector3::new(0.0, 0.0, 2.0 * e);
        })
    };
    assert_eq!(with_error(1.0).all.levels[0].inside.unwrap().depth, 1.0);
    assert_eq!(with_error(2.0).all.levels[0].inside.unwrap().depth, 0.0);
    assert_eq!(with_error(2.0).all.levels[0].inside.unwrap().three_d, 1.0);
}

#[test]
fn a_tool_that_the_truth_does_not_have_is_a_false_track() {
    let mut track = track(|_| ());
    track.tools.push("purple".to_owned());
    track.samples.push(Sample { tool: 2, ..track.samples[0] });
    let got = accuracy(&track, &truth()).unwrap();
    assert_eq!((got.all.false_tracks, got.tools[2].false_tracks, got.tools[2].rows), (1, 1, 1));
}

#[test]
fn a_track_in_which_nothing_was_found_covers_nothing() {
    let nothing = Trajectory { tools: Vec::new(), samples: Vec::new(), frame_times_s: Vec::new() };
    let got = accuracy(&nothing, &truth()).unwrap();
    assert_eq!((got.all.levels[0].frames, got.all.levels[0].found, got.all.levels[0].errors), (380, 0, None));
}

#[test]
fn a_track_of_another_scene_is_refused() {
    let mut other = track(|_| ());
    other.tools = vec!["purple".to_owned(), "green".to_owned()];
    assert!(matches!(accuracy(&other, &truth()), Err(EvaluationProblem::UnknownTools { .. })));
    let later = accuracy(&track(|s| s.frame += 200), &truth());
    assert_eq!(later, Err(EvaluationProblem::UnknownFrames { first: 200 }));
    assert_eq!(accuracy(&track(|s| s.frame += 150), &truth()).unwrap().unjudged, 280);
    assert_eq!(accuracy(&other, &Truth::default()), Err(EvaluationProblem::EmptyTruth));
}
