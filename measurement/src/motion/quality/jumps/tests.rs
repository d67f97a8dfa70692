use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::Point3;
use proptest::prelude::*;

use super::*;
use crate::motion::assessment::{Assessment, AssessmentSettings, assess};
use crate::motion::features::Space;
use crate::motion::quality::{Concern, QualityCause, QualityInput, QualityVerdict, Severity, judge, measure};
use crate::random::Dice;
use crate::vision::covariance::PositionCovariance;
use crate::vision::trajectory::{Cut, SampleState, Trajectory};

/// The path of a tip over time, mm, at these times, s. `sigmas_mm`: its stated errors across and along the line of
/// sight.
fn path(times_s: &[f64], tip: impl Fn(f64) -> Vector3<f64>, sigmas_mm: Option<[f64; 2]>) -> Trajectory {
    let sample = |(frame, time_s): (usize, &f64)| Sample {
        frame: frame as u64,
        time_s: *time_s,
        tool: 0,
        tip_mm: Point3::from(tip(*time_s)),
        velocity_mm_s: None,
        axis: None,
        tip_px: None,
        covariance_mm2: sigmas_mm.map(|[across, along]| PositionCovariance::from_sigmas(across, along)),
        state: SampleState::Observed,
    };
    let samples = times_s.iter().enumerate().map(sample).collect();
    Trajectory { tools: vec!["left".into()], samples, frame_times_s: Vec::new(), cuts: Vec::new() }
}

fn times_s(rate_hz: f64, end_s: f64) -> Vec<f64> {
    (0..(end_s * rate_hz) as u32).map(|frame| f64::from(frame) / rate_hz).collect()
}

/// A slow tool.
fn slow(time_s: f64) -> Vector3<f64> {
    Vector3::new(40.0 * (0.65 * time_s).sin(), 20.0 * (0.35 * time_s).cos(), 150.0 + 5.0 * (0.9 * time_s).sin())
}

fn judged(path: &Trajectory) -> QualityVerdict {
    judge(&measure(&QualityInput::of_path(path)))
}

/// The causes that concern a path, and their effects.
fn causes(path: &Trajectory) -> Vec<(QualityCause, Severity)> {
    judged(path).concerns().iter().map(|concern| (concern.cause, concern.severity)).collect()
}

/// Those that are about a jump.
fn jumps(path: &Trajectory) -> Vec<(QualityCause, Severity)> {
    let is_jump = |(cause, _): &(QualityCause, Severity)| [QualityCause::Jump, QualityCause::Spike].contains(cause);
    causes(path).into_iter().filter(is_jump).collect()
}

/// A slow path at 30 frames a second with one row so far aside, mm.
fn with_row_aside(row: usize, aside_mm: f64) -> Trajectory {
    with_rows_aside(row..row + 1, aside_mm)
}

/// A slow path at 30 frames a second with adjacent rows so far aside, mm.
fn with_rows_aside(rows: Range<usize>, aside_mm: f64) -> Trajectory {
    let mut path = path(&times_s(30.0, 10.0), slow, Some([0.1, 0.2]));
    path.samples[rows].iter_mut().for_each(|sample| sample.tip_mm.x += aside_mm);
    path
}

/// A hand that moves at up to about 1 m/s.
fn fast(time_s: f64) -> Vector3<f64> {
    let wave = |size_mm: f64, hz: f64| size_mm * (TAU * hz * time_s).sin();
    Vector3::new(wave(160.0, 0.35) + wave(32.0, 1.7), wave(100.0, 0.27) + wave(24.0, 2.1), 150.0 + wave(80.0, 0.2))
}

/// A path that a camera sees at one rate and a table holds at a higher one: rows repeat positions.
fn repeated(camera_hz: f64, rows_hz: f64, tip: impl Fn(f64) -> Vector3<f64>) -> Trajectory {
    path(&times_s(rows_hz, 10.0), |t| tip((t * camera_hz + 1e-9).floor() / camera_hz), None)
}

#[test]
fn a_row_metres_away_refuses_the_session_and_is_named() {
    let verdict = judged(&with_row_aside(10, 9990.0));
    let findings: Vec<String> = verdict.concerns().iter().map(Concern::finding).collect();
    assert!(verdict.is_refused() && findings.len() == 2, "{findings:?}");
    assert!(findings[0].starts_with("left: its path has a step of 299.") && findings[0].contains("limit 5.0 m/s"));
    assert!(findings[0].ends_with("; from frame 9 (0.300 s) to frame 10 (0.333 s)"), "{findings:?}");
    assert!(findings[1].ends_with("; at frame 10 (0.333 s)"), "{findings:?}");
    let advice = verdict.concerns()[0].advice();
    assert!(advice.contains("delete it and all others like it from the table"), "{advice}");
}

#[test]
fn a_row_far_away_is_refused_also_at_either_end_and_where_it_is_bridged() {
    for row in [0, 1, 150, 298, 299] {
        for aside_mm in [-200.0, 200.0] {
            assert!(judged(&with_row_aside(row, aside_mm)).is_refused(), "{row}");
        }
    }
    let mut bridged = with_row_aside(150, 200.0);
    bridged.samples[150].state = SampleState::Predicted;
    assert!(judged(&bridged).is_refused(), "features take bridged rows for the tool's place too");
}

#[test]
fn a_single_row_aside_is_judged_by_the_acceleration_that_it_would_need() {
    let spike = |severity| vec![(QualityCause::Spike, severity)];
    assert_eq!(judged(&with_row_aside(150, 25.0)), QualityVerdict::Valid);
    assert_eq!(causes(&with_row_aside(150, 45.0)), spike(Severity::Care));
    assert_eq!(causes(&with_row_aside(150, 80.0)), spike(Severity::Refuse));
}

#[test]
fn up_to_four_adjacent_rows_aside_are_judged_together_and_named() {
    for (rows, aside_mm, severity) in [
        (2, 70.0, Severity::Care),
        (2, 120.0, Severity::Refuse),
        (3, 100.0, Severity::Care),
        (3, 165.0, Severity::Care),
        (4, 140.0, Severity::Care),
    ] {
        let verdict = judged(&with_rows_aside(150..150 + rows, aside_mm));
        let [concern] = verdict.concerns() else { panic!("{verdict:?}") };
        assert_eq!((concern.cause, concern.severity), (QualityCause::Spike, severity), "{rows} rows {aside_mm} mm");
        let named = concern.rows.unwrap();
        assert_eq!((named.from_frame, named.to_frame), (150, 149 + rows as u64), "{}", concern.finding());
    }
}

#[test]
fn rows_that_repeat_a_position_make_no_jump_and_hide_none() {
    for (camera_hz, rows_hz) in
        [(30.0, 60.0), (30.0, 120.0), (30.0, 240.0), (40.0, 200.0), (30.0, 1000.0), (60.0, 120.0)]
    {
        let hand = repeated(camera_hz, rows_hz, fast);
        assert!(jumps(&hand).is_empty(), "{camera_hz} Hz in rows at {rows_hz} Hz");
        let one_frame_aside =
            |t: f64| slow(t) + Vector3::x() * if (t * camera_hz).round() == 150.0 { 90.0 } else { 0.0 };
        let found = jumps(&repeated(camera_hz, rows_hz, one_frame_aside));
        assert!(found.contains(&(QualityCause::Spike, Severity::Refuse)), "{camera_hz} Hz in rows at {rows_hz} Hz");
    }
}

#[test]
fn a_tool_at_rest_keeps_rows_when_repeats_are_left_out() {
    let table = repeated(30.0, 120.0, |t| slow(t.max(5.0)));
    let rows: Vec<&Sample> = table.of_tool(0).collect();
    let kept = without_repeats(&rows, &[]);
    let longest_s = intervals_s(&kept).into_iter().fold(0.0, f64::max);
    assert!(kept.len() < 270 && longest_s < 0.06, "{} rows, {longest_s} s", kept.len());
    let after_cut = without_repeats(&rows, &[rows[2].time_s]);
    assert!(after_cut.iter().any(|row| row.frame == 2), "the first row after a cut stays");
    let ordinary = path(&times_s(30.0, 10.0), |t| slow(t.max(5.0)), None);
    assert_eq!(without_repeats(&ordinary.of_tool(0).collect::<Vec<_>>(), &[]).len(), ordinary.samples.len());
}

#[test]
fn the_fastest_hand_is_no_jump_at_any_frame_rate() {
    let shaken = |t: f64| Vector3::new(20.0 * (TAU * 8.0 * t).sin(), 0.0, 150.0);
    let swept = |t: f64| Vector3::new(1500.0 * t, 0.0, 150.0);
    let thrown_back = |t: f64| Vector3::new(1500.0 * (t - 0.1 * (t / 0.1).round()).abs(), 0.0, 150.0);
    for rate_hz in [25.0, 30.0, 60.0, 120.0, 240.0, 1000.0] {
        let times_s = times_s(rate_hz, 4.0);
        assert_eq!(judged(&path(&times_s, shaken, None)), QualityVerdict::Valid, "{rate_hz}");
        assert!(!judged(&path(&times_s, thrown_back, None)).is_refused(), "an impact at {rate_hz} frames a second");
        let tenth_of_a_second = &times_s[..(rate_hz / 10.0) as usize];
        assert_eq!(judged(&path(tenth_of_a_second, swept, None)), QualityVerdict::Valid, "{rate_hz}");
    }
}

#[test]
fn a_noisy_tracker_does_not_jump_whether_it_states_its_errors_or_not() {
    for (rate_hz, sigmas_mm, is_stated) in [
        (30.0, [1.0, 4.0], true),
        (30.0, [2.0, 4.0], true),
        (240.0, [0.5, 2.0], true),
        (120.0, [0.5, 0.5], false),
        (1000.0, [0.3, 0.3], false),
        (60.0, [5.0, 5.0], false),
        (120.0, [3.0, 3.0], false),
        (240.0, [2.0, 2.0], false),
    ] {
        let mut dice = Dice::new(7, "errors of a tracker");
        let mut noisy = path(&times_s(rate_hz, 10.0), slow, is_stated.then_some(sigmas_mm));
        let sigma = Vector3::new(sigmas_mm[0], sigmas_mm[0], sigmas_mm[1]);
        noisy.samples.iter_mut().for_each(|sample| sample.tip_mm += dice.gauss3().component_mul(&sigma));
        assert!(jumps(&noisy).is_empty(), "{rate_hz} Hz, {sigmas_mm:?} mm");
    }
}

#[test]
fn a_row_that_states_a_huge_error_is_no_excuse_for_a_jump() {
    let mut path = with_row_aside(150, 2000.0);
    path.samples[150].covariance_mm2 = Some(PositionCovariance::from_sigmas(2000.0, 2000.0));
    assert!(judged(&path).is_refused());
}

#[test]
fn time_stamps_that_jitter_make_no_jump() {
    let mut times_s = times_s(30.0, 10.0);
    times_s.iter_mut().skip(1).step_by(100).for_each(|time_s| *time_s -= 0.032);
    let moving = |t: f64| Vector3::new(100.0 * (9.0 * t).sin(), 0.0, 150.0); // at most 0.9 m/s
    let mut path = path(&times_s, moving, None);
    for (frame, sample) in path.samples.iter_mut().enumerate() {
        sample.tip_mm = Point3::from(moving(frame as f64 / 30.0));
    }
    assert_eq!(judged(&path), QualityVerdict::Valid);
}

#[test]
fn time_stamps_of_arrival_in_bursts_make_no_jump() {
    let of_frame = |frame: usize| (frame / 3 + 1) as f64 * 0.1 + (frame % 3) as f64 * 0.001;
    let times_s: Vec<f64> = (0..300).map(of_frame).collect();
    let mut path = path(&times_s, fast, None);
    for (frame, sample) in path.samples.iter_mut().enumerate() {
        sample.tip_mm = Point3::from(fast(frame as f64 / 30.0));
    }
    assert!(jumps(&path).is_empty());
}

#[test]
fn rows_on_either_side_of_a_cut_are_not_compared() {
    let mut path = path(&times_s(30.0, 10.0), |t| slow(t) + Vector3::x() * if t < 5.0 { 0.0 } else { 300.0 }, None);
    assert_eq!(causes(&path), [(QualityCause::Jump, Severity::Refuse)]);
    path.cuts.push(Cut { tool: 0, time_s: 5.0 });
    assert_eq!(judged(&path), QualityVerdict::Valid);
}

#[test]
fn a_path_of_one_row_has_no_step_and_one_of_two_rows_no_turn() {
    let figures = |rows| {
        let path = path(&times_s(30.0, 10.0)[..rows], slow, None);
        let tool = measure(&QualityInput::of_path(&path)).tools.remove(0);
        (tool.fastest_step.is_some(), tool.sharpest_turn.is_some())
    };
    assert_eq!([1, 2, 3].map(figures), [(false, false), (true, false), (true, true)]);
}

/// Number of rows of a path with wrong rows.
const ROWS: usize = 600;

fn value(of: &Assessment, name: &str, space: Space) -> f64 {
    let found = of.features.iter().find(|value| (value.feature.name, value.space) == (name, space));
    found.unwrap().value.unwrap_or_else(|reason| panic!("{name}: {reason}"))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// A tool that moves all the time, 20 s at 30 frames a second, with one to four adjacent wrong rows.
    #[test]
    fn values_of_a_path_with_wrong_rows_agree_with_each_other_or_are_refused(
        phases in prop::array::uniform3(0.0f64..TAU),
        row in prop_oneof![Just(0), Just(ROWS - 1), 0..ROWS],
        count in 1..=MAX_ROWS_ASIDE,
        exponent in 0.0f64..3.9,
        direction in prop::array::uniform3(0.1f64..1.0),
    ) {
        let wave = |t: f64, k: usize| {
            25.0 * (TAU * (0.11 + 0.05 * k as f64) * t + phases[k]).sin() + 6.0 * (TAU * 0.7 * t + k as f64).sin()
        };
        let tip = |t: f64| Vector3::new(wave(t, 0), wave(t, 1), 180.0 + wave(t, 2));
        let mut path = path(&times_s(30.0, ROWS as f64 / 30.0), tip, Some([0.1, 0.2]));
        let aside_mm = 10f64.powf(exponent);
        let aside = Vector3::from(direction).normalize() * aside_mm;
        path.samples[row..].iter_mut().take(count).for_each(|sample| sample.tip_mm += aside);

        let scored = assess(&path, &[], &AssessmentSettings { window_s: 0.0, ..AssessmentSettings::default() });
        for of in &scored.features {
            let Ok(value) = of.value else { continue };
            prop_assert!(value.is_finite(), "{}", of.feature.name);
            if let Ok(bar) = of.error {
                prop_assert!(bar.sigma.is_finite() && bar.as_measured.is_finite(), "{}: {bar:?}", of.feature.name);
                prop_assert!((bar.low..=bar.high).contains(&value), "{}: {value} {bar:?}", of.feature.name);
            }
        }
        let is_refused = judged(&path).is_refused();
        prop_assert!(is_refused || aside_mm < 200.0, "{aside_mm} mm at {count} rows from {row}");
        if !is_refused {
            let (start_s, end_s) = scored.task_s.unwrap();
            for space in [Space::ThreeD, Space::Image] {
                let [mean, peak, length] =
                    ["mean_velocity", "peak_velocity", "path_length"].map(|name| value(&scored, name, space));
                prop_assert!(mean <= peak, "mean {mean}, peak {peak}: {aside_mm} mm at {count} rows from {row}");
                let integral = mean * (end_s - start_s);
                prop_assert!((length - integral).abs() < 0.05 * length, "{length} mm long, {integral} mm by its speed");
            }
        }
    }
}
