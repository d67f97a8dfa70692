//! Tracks with known faults against a known truth.

use nalgebra::{Matrix3, Point3, Vector3};

use super::*;
use crate::random::Dice;
use crate::vision::covariance::PositionCovariance;
use crate::vision::trajectory::{Sample, SampleState, Trajectory};

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

/// The truth as a perfect tracker would report it, with each row changed by `change`.
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
            covariance_mm2: None,
            state: SampleState::Observed,
        })
        .collect::<Vec<_>>()
    });
    let mut samples: Vec<Sample> = rows.collect();
    samples.iter_mut().for_each(change);
    Trajectory {
        tools: vec!["orange".to_owned(), "cyan".to_owned()],
        samples,
        frame_times_s: Vec::new(),
        cuts: Vec::new(),
    }
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
    let of = |s: ErrorSpread| [s.rms, s.median, s.p95, s.max];
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

/// The position on the clip's circle at any time, as in `truth`.
fn on_circle(time_s: f64, tool: usize) -> Point3<f64> {
    let (sin, cos) = (time_s / 0.04 * 0.05).sin_cos();
    Point3::new(60.0 * tool as f64 + 30.0 * cos, 30.0 * sin, 180.0 + 10.0 * sin)
}

fn lag_of(accuracy: &Accuracy) -> (f64, f64) {
    match accuracy.all.levels[0].lag {
        Lag::Measured { lag_s, sigma_s } => (lag_s, sigma_s),
        Lag::TooLittleMotion => panic!("the circle moves at 38 mm/s"),
    }
}

#[test]
fn a_late_track_lags_by_its_delay_however_long_and_biased_it_is() {
    for delay in [-0.05, 0.0, 0.003, 0.08, 0.3] {
        let late = measured(|s| {
            let bias = Vector3::new(0.5, 0.0, if s.tool == 0 { 2.0 } else { -1.0 });
            s.tip_mm = on_circle(s.time_s - delay, s.tool) + bias;
        });
        let (lag_s, sigma_s) = lag_of(&late);
        assert!((lag_s - delay).abs() < 2e-4, "{lag_s} for {delay}");
        assert!(sigma_s < 1e-3, "{sigma_s}");
    }
}

#[test]
fn noise_makes_a_lag_unsure_by_as_much_as_it_is_off() {
    let runs = 200_u64;
    let squares = (0..runs).map(|run| {
        let mut dice = Dice::new(run, "noise");
        let mut noisy = track(|_| ());
        noisy.samples.iter_mut().for_each(|s| s.tip_mm += dice.gauss3());
        let (lag_s, sigma_s) = lag_of(&accuracy(&noisy, &truth()).unwrap());
        (lag_s / sigma_s).powi(2)
    });
    let mean = squares.sum::<f64>() / runs as f64;
    assert!((0.75..1.35).contains(&mean), "normalised square {mean}"); // 1 ± 3·sqrt(2/200)
}

/// The clip of 200 frames; from frame 60 on the tool rests, or creeps at this speed, mm/s.
fn coming_to_rest(creep_mm_s: f64) -> Truth {
    let mut truth = truth();
    for frame in &mut truth.frames {
        frame.tools.truncate(1);
        let time_s = frame.time_s.min(60.0 * 0.04);
        frame.tools[0].tip_mm = on_circle(time_s, 0) + Vector3::x() * creep_mm_s * (frame.time_s - time_s);
        frame.tools[0].visible = 1.0;
    }
    truth
}

/// A track of the clip that states one speed while the tool moves, and another while it rests.
fn resting_track(truth: &Truth, moving_mm_s: f64, resting_mm_s: f64) -> Trajectory {
    let velocity = |frame: u64| Vector3::y() * if frame < 72 { moving_mm_s } else { resting_mm_s };
    let mut track = track(|s| s.velocity_mm_s = Some(velocity(s.frame)));
    track.samples.retain(|s| s.tool == 0 && (s.frame as usize) < truth.frames.len());
    track.samples.iter_mut().for_each(|s| s.tip_mm = truth.frames[s.frame as usize].tools[0].tip_mm);
    track
}

#[test]
fn a_resting_tool_moves_at_the_noise_floor() {
    let truth = coming_to_rest(0.0);
    let floor = |track: &Trajectory| accuracy(track, &truth).unwrap().all.rest_noise.unwrap();
    let stated = floor(&resting_track(&truth, 40.0, 3.0));
    assert!((stated.rms_mm_s - 3.0).abs() < 1e-9 && (stated.median_mm_s - 3.0).abs() < 1e-9, "{stated:?}");
    assert_eq!(stated.rows, 106); // rests from frame 61 to 199, less half a second and the hidden frames 100 to 119
    let mut raw = resting_track(&truth, 0.0, 0.0);
    raw.samples.iter_mut().for_each(|s| {
        s.velocity_mm_s = None;
        s.tip_mm.x += if s.frame % 2 == 0 { 0.1 } else { -0.1 };
    });
    assert!((floor(&raw).median_mm_s - 0.2 / 0.04).abs() < 1e-6, "{:?}", floor(&raw));
}

#[test]
fn a_tool_that_never_rests_or_only_shortly_has_no_noise_floor() {
    assert_eq!(measured(|s| s.velocity_mm_s = Some(Vector3::zeros())).all.rest_noise, None);
    let creeping = coming_to_rest(0.6);
    assert_eq!(accuracy(&resting_track(&creeping, 40.0, 3.0), &creeping).unwrap().all.rest_noise, None);
    let mut short = coming_to_rest(0.0);
    short.frames.truncate(60 + 37);
    assert_eq!(accuracy(&resting_track(&short, 40.0, 3.0), &short).unwrap().all.rest_noise, None);
}

#[test]
fn without_motion_there_is_no_lag() {
    let mut still = truth();
    still.frames.iter_mut().flat_map(|f| &mut f.tools).for_each(|t| t.tip_mm = on_circle(0.0, 0));
    assert_eq!(accuracy(&track(|_| ()), &still).unwrap().all.levels[0].lag, Lag::TooLittleMotion);
    let mut dice = Dice::new(5, "noise");
    let mut wild = track(|_| ());
    wild.samples.iter_mut().for_each(|s| s.tip_mm += 40.0 * dice.gauss3());
    assert_eq!(accuracy(&wild, &truth()).unwrap().all.levels[0].lag, Lag::TooLittleMotion);
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
            s.covariance_mm2 = Some(PositionCovariance::from_sigmas(0.5, 2.0));
            s.tip_mm += Vector3::new(0.0, 0.0, 2.0 * e);
        })
    };
    let honesty = |e: f64| with_error(e).all.levels[0].sigma_check.unwrap();
    assert_eq!(honesty(1.0).depth.inside, 1.0);
    assert_eq!(honesty(2.0).depth.inside, 0.0);
    assert_eq!(honesty(2.0).three_d.inside, 1.0);
    assert!(
        (honesty(2.0).depth.mean_square - 4.0).abs() < 1e-9 && (honesty(3.0).three_d.mean_square - 3.0).abs() < 1e-9
    );
    assert_eq!(measured(|_| ()).all.levels[0].sigma_check, None);
}

#[test]
fn errors_drawn_from_the_stated_sigmas_are_honest_and_from_twice_them_are_not() {
    let drawn = |times: f64| {
        let mut dice = Dice::new(9, "noise");
        let mut track = track(|_| ());
        for sample in &mut track.samples {
            let ray = sample.tip_mm.coords.normalize();
            let along = ray * ray.transpose() * 2.25 + Matrix3::from_diagonal_element(0.01);
            let stated = PositionCovariance::from(along);
            sample.covariance_mm2 = Some(stated);
            sample.tip_mm += times * (stated.factor() * dice.gauss3());
        }
        accuracy(&track, &truth()).unwrap().all.levels[0].sigma_check.unwrap()
    };
    for share in [drawn(1.0).depth, drawn(1.0).lateral, drawn(1.0).three_d] {
        assert!(share.interval[0] < 0.95 && 0.95 < share.interval[1], "{share:?}");
        assert!((share.mean_square - 1.0).abs() < 0.2, "{share:?}");
    }
    for share in [drawn(2.0).depth, drawn(2.0).lateral, drawn(2.0).three_d] {
        assert!(share.interval[1] < 0.8 && (share.mean_square - 4.0).abs() < 0.8, "{share:?}");
    }
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
    let nothing = Trajectory { tools: Vec::new(), samples: Vec::new(), frame_times_s: Vec::new(), cuts: Vec::new() };
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
    assert_eq!(accuracy(&track(|s| s.frame += 150), &truth()).unwrap().rows_without_truth, 280);
    assert_eq!(accuracy(&other, &Truth::default()), Err(EvaluationProblem::EmptyTruth));
}
