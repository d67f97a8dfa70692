use nalgebra::{Point2, Point3, Vector3};

use super::limits::BetterDirection;
use super::*;
use crate::random::Dice;
use crate::vision::covariance::PositionCovariance;
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::reason::MissReason;
use crate::vision::segmentation::palette::{ColourSeparation, Margin};
use crate::vision::surroundings::{Resemblance, ViewShift};
use crate::vision::tracker::{Absence, DiameterBasis, EffectiveDiameter, Gap, LightSample, ToolQuality};
use crate::vision::trajectory::{PathKind, Sample};

const FRAME_S: f64 = 0.04;
const FRAMES: u64 = 500;

/// A tool that circles at 24 mm/s, seen on some frames.
fn path(seen: impl Fn(u64) -> bool) -> Trajectory {
    let sample = |frame: u64| {
        let time_s = frame as f64 * FRAME_S;
        let (sin, cos) = (1.2 * time_s).sin_cos();
        Sample {
            frame,
            time_s,
            tool: 0,
            tip_mm: Point3::new(20.0 * cos, 20.0 * sin, 150.0),
            velocity_mm_s: Some(Vector3::new(-24.0 * sin, 24.0 * cos, 0.0)),
            axis: None,
            tip_px: Some(Point2::new(640.0 + 120.0 * cos, 360.0 + 120.0 * sin)),
            covariance_mm2: Some(PositionCovariance::from_sigmas(0.2, 1.0)),
            state: SampleState::Observed,
        }
    };
    let samples = (0..FRAMES).filter(|frame| seen(*frame)).map(sample).collect();
    Trajectory { tools: vec!["orange".into()], samples, frame_times_s: Vec::new(), cuts: Vec::new() }
}

fn judged(path: &Trajectory) -> QualityVerdict {
    judge(&measure(&QualityInput::of_path(path)))
}

fn rank(verdict: &QualityVerdict) -> Option<Severity> {
    verdict.concerns().first().map(|concern| concern.severity)
}

fn causes(verdict: &QualityVerdict) -> Vec<QualityCause> {
    verdict.concerns().iter().map(|concern| concern.cause).collect()
}

fn counts(gaps: Vec<Gap>) -> Quality {
    let diameter = EffectiveDiameter { mm: 5.0, sigma_mm: 0.1, basis: DiameterBasis::Session };
    let tool =
        ToolQuality { tool: "orange".into(), gaps, effective_diameter: Some(diameter), ..ToolQuality::default() };
    Quality { frames: FRAMES, tools: vec![tool], ..Quality::default() }
}

#[test]
fn a_path_that_is_seen_all_the_time_is_valid() {
    assert_eq!(judged(&path(|_| true)), QualityVerdict::Valid);
}

#[test]
fn every_figure_that_gets_worse_makes_no_verdict_better() {
    for cause in QualityCause::ALL {
        let limits = cause.limits();
        let worse = |a: f64, b: f64| if limits.better == BetterDirection::More { a < b } else { a > b };
        if let (Some(care), Some(refuse)) = (limits.care, limits.refuse) {
            assert!(!worse(care, refuse), "{cause:?} is refused before it asks for care");
        }
        assert!(limits.care.or(limits.refuse).is_some(), "{cause:?} has no limit");
    }
}

#[test]
fn less_coverage_never_makes_a_better_verdict() {
    let mut last = None;
    let mut verdicts = Vec::new();
    for hidden in 0..100 {
        // The first and the last frame stay, so that the session stays as long.
        let verdict = judged(&path(|frame| frame % 100 >= hidden || frame == 0 || frame == FRAMES - 1));
        assert!(rank(&verdict) >= last, "{hidden} % hidden: {verdict:?}");
        last = rank(&verdict);
        verdicts.push(verdict.name());
    }
    verdicts.dedup();
    assert_eq!(verdicts, ["valid", "usable_with_care", "refused"]);
}

#[test]
fn a_tool_that_is_seen_less_than_half_of_the_time_is_refused_for_its_coverage() {
    let verdict = judged(&path(|frame| frame % 5 < 2));
    let QualityVerdict::Refused(concerns) = &verdict else { panic!("{verdict:?}") };
    assert_eq!(
        (concerns[0].cause, concerns[0].limit, concerns[0].tool.as_deref()),
        (QualityCause::Coverage, 0.5, Some("orange"))
    );
    assert!(concerns[0].finding().contains("orange: measured on 40 % of the frames"), "{}", concerns[0].finding());
}

#[test]
fn time_out_of_view_and_lost_time_are_separate_within_the_session() {
    let mut path = path(|frame| (50..200).contains(&frame) || (300..400).contains(&frame));
    path.frame_times_s = (0..FRAMES).map(|frame| frame as f64 * FRAME_S).collect();
    let gap = |first, last, absence| Gap { first, last, absence };
    let counts = counts(vec![
        gap(0, 49, Absence::LeftView),
        gap(200, 269, Absence::LeftView),
        gap(270, 299, Absence::Lost(MissReason::PoorFit)),
        gap(400, 499, Absence::LeftView),
    ]);
    let figures = measure(&QualityInput { tracker: Some(&counts), ..QualityInput::of_path(&path) });
    let tool = &figures.tools[0];
    assert_eq!((tool.coverage, tool.coverage_of_recording), (Some(250.0 / 350.0), Some(0.5)));
    assert_eq!((tool.left_view_share, tool.lost_share), (Some(70.0 / 350.0), Some(30.0 / 280.0)));
    assert_eq!(tool.lost_frames.get(&MissReason::PoorFit), Some(&30));
    assert!((tool.longest_gap_s.unwrap() - 101.0 * FRAME_S).abs() < 1e-9);
    let verdict = judge(&figures);
    assert_eq!(
        causes(&verdict),
        [QualityCause::Coverage, QualityCause::LeftView, QualityCause::Lost, QualityCause::LongGap]
    );
    assert_eq!(rank(&verdict), Some(Severity::Care));
    let finding = |path: &Trajectory, counts: &Quality| {
        let verdict = judge(&measure(&QualityInput { tracker: Some(counts), ..QualityInput::of_path(path) }));
        let lost = verdict.concerns().iter().find(|concern| concern.cause == QualityCause::Lost).map(Concern::finding);
        lost.unwrap()
    };
    let within = finding(&path, &counts);
    assert!(within.ends_with("; longest from 10.8 s to 12.0 s"), "{within}");
    let to_end = Quality { tools: vec![lost_to_the_end()], ..counts };
    let found = finding(&path, &to_end);
    assert!(found.ends_with("; longest from 16.0 s to the end of the recording"), "{found}");
    // An edit that keeps the frames from 60 to 449.
    path.samples.retain(|sample| (60..450).contains(&sample.frame));
    path.frame_times_s = (60..450).map(|frame| f64::from(frame) * FRAME_S).collect();
    let found = finding(&path, &to_end);
    assert!(found.ends_with("; longest from 16.0 s to the end of the recording"), "{found}");
    path.frame_times_s.truncate(340);
    let found = finding(&path, &to_end);
    assert!(found.ends_with("; longest from 10.8 s to 12.0 s"), "{found}");
}

fn lost_to_the_end() -> ToolQuality {
    let gap = |first, last| Gap { first, last, absence: Absence::Lost(MissReason::NoMarkerColour) };
    ToolQuality { tool: "orange".into(), gaps: vec![gap(270, 299), gap(400, FRAMES - 1)], ..ToolQuality::default() }
}

#[test]
fn a_tool_that_the_task_does_not_need_is_no_reason_to_refuse() {
    let mut path = path(|_| true);
    path.tools.push("cyan".into());
    let mut counts = counts(Vec::new());
    let absence = |absence| vec![Gap { first: 0, last: FRAMES - 1, absence }];
    counts.tools.push(ToolQuality { tool: "cyan".into(), gaps: absence(Absence::LeftView), ..ToolQuality::default() });
    let judged =
        |counts: &Quality| judge(&measure(&QualityInput { tracker: Some(counts), ..QualityInput::of_path(&path) }));
    assert_eq!(causes(&judged(&counts)), [QualityCause::NeverInPicture]);
    assert_eq!(rank(&judged(&counts)), Some(Severity::Care));
    counts.tools[1].gaps = absence(Absence::Lost(MissReason::WrongShape));
    assert_eq!(causes(&judged(&counts))[..2], [QualityCause::Coverage, QualityCause::Lost], "its colour was there");
    assert!(judged(&counts).is_refused());
}

#[test]
fn a_figure_does_not_read_as_the_limit_that_it_broke() {
    let finding = |cause: QualityCause, figure, limit| cause.finding(figure, limit);
    assert!(finding(QualityCause::NoiseFloor, 2.53, 2.5).contains("move at 2.53 mm/s (limit 2.50 mm/s)"));
    assert!(finding(QualityCause::NoiseFloor, 3.12, 2.5).contains("move at 3.1 mm/s (limit 2.5 mm/s)"));
    assert!(
        finding(QualityCause::Coverage, 0.8996, 0.9)
            .contains("on 89.96 % of the frames between the first and the last that show a tool; needs 90.00 %")
    );
}

#[test]
fn nothing_seen_is_refused() {
    let verdict = judged(&path(|_| false));
    assert_eq!((causes(&verdict), rank(&verdict)), (vec![QualityCause::NothingSeen], Some(Severity::Refuse)));
}

#[test]
fn dropped_frames_breaks_and_cut_files_are_separate() {
    let with_times = |time_of: fn(u64) -> f64, frames_expected: Option<u64>| {
        let mut path = path(|_| true);
        path.frame_times_s = (0..FRAMES).map(time_of).collect();
        let evidence = QualityInput { frames_expected, ..QualityInput::of_path(&path) };
        measure(&evidence).session
    };
    let even = with_times(|frame| frame as f64 * FRAME_S, Some(FRAMES));
    assert_eq!((even.dropped_share, even.cut_share), (Some(0.0), Some(0.0)));
    assert!((even.frame_rate_hz.unwrap() - 25.0).abs() < 1e-6);
    let dropped = with_times(|frame| (frame + frame / 10) as f64 * FRAME_S, None);
    assert!((dropped.dropped_share.unwrap() - 49.0 / 549.0).abs() < 1e-9, "every eleventh: {dropped:?}");
    let broken = with_times(|frame| frame as f64 * FRAME_S + if frame < 250 { 0.0 } else { 30.0 }, Some(1000));
    assert_eq!((broken.dropped_share, broken.cut_share), (Some(0.0), Some(0.5)));
    assert!((broken.longest_interval_s.unwrap() - 30.04).abs() < 1e-9);
}

fn moved_mm(verdict: &QualityVerdict) -> f64 {
    verdict.concerns().iter().find(|c| c.cause == QualityCause::NoTrocar).map_or(0.0, |c| c.figure)
}

#[test]
fn a_colour_like_the_background_is_refused_and_one_like_another_tool_is_not() {
    let path = path(|_| true);
    let margin =
        |margin_steps, nearest: &str| Some(Margin { margin_steps, spread_steps: 4.0, nearest: nearest.into() });
    let judged_with = |basis, from_tools, from_background| {
        let mut counts = counts(Vec::new());
        counts.tools[0].effective_diameter = Some(EffectiveDiameter { mm: 5.0, sigma_mm: 0.1, basis });
        counts.tools[0].colour = ColourSeparation { from_tools, from_background };
        judge(&measure(&QualityInput { tracker: Some(&counts), ..QualityInput::of_path(&path) }))
    };
    let judged = |from_tools, from_background| judged_with(DiameterBasis::Session, from_tools, from_background);
    assert_eq!(judged(margin(9.0, "cyan"), margin(9.0, "background")), QualityVerdict::Valid);
    assert_eq!(judged(None, None), QualityVerdict::Valid);
    let refused = judged_with(DiameterBasis::AssumedTrocar, margin(-3.0, "cyan"), margin(1.8, "background"));
    let fields = |c: &Concern| (c.cause, c.severity, c.figure, c.limit, c.label.clone());
    let of = |label: &str| Some(label.to_owned());
    assert_eq!(
        refused.concerns().iter().map(fields).collect::<Vec<_>>(),
        [
            (QualityCause::ColourBackground, Severity::Refuse, 1.8, 2.5, of("background")),
            (QualityCause::ColourPair, Severity::Care, -3.0, 4.0, of("cyan")),
            (QualityCause::NoTrocar, Severity::Care, moved_mm(&refused), 0.0, None),
        ]
    );
    let shown = judged(None, margin(1.8, "background"));
    let background = (QualityCause::ColourBackground, Severity::Care, 1.8, 4.0, of("background"));
    assert_eq!(shown.concerns().iter().map(fields).collect::<Vec<_>>(), [background], "a tool shows its trocar");
    let findings = [0, 1].map(|i| refused.concerns()[i].finding());
    assert!(findings[0].contains("by only 1.8 of 255 steps; needs 2.5 (nearest: `background`)"), "{findings:?}");
    let overlap = "overlaps with another tool's; needs 4.0 of 255 steps between them (nearest: `cyan`)";
    assert!(findings[1].contains(overlap), "{findings:?}");
    let of_trocar = refused.concerns()[2].finding();
    assert!(of_trocar.ends_with("do not show its trocar"), "a limit of 0 mm says nothing: {of_trocar}");
    assert_eq!(causes(&judged(margin(9.0, "cyan"), margin(1.8, "background"))), [QualityCause::ColourBackground]);
    assert_eq!(causes(&judged(margin(1.8, "cyan"), margin(9.0, "background"))), [QualityCause::ColourPair]);
    assert_eq!(rank(&judged(None, margin(3.0, "background"))), Some(Severity::Care));
}

#[test]
fn a_picture_that_is_black_for_most_of_the_time_has_a_finite_change_of_light() {
    let path = path(|_| true);
    for (black, dim) in [(0.0, 1.0), (0.01, 0.99)] {
        let mut counts = counts(Vec::new());
        let luma_ratio = |second: u32| if second < 2 { 1.0 } else { black };
        let sample = |second: u32| LightSample {
            time_s: f64::from(second),
            luma_ratio: luma_ratio(second),
            chroma_shift: [0.0; 2],
        };
        counts.light = (0..20).map(sample).collect();
        let figures = measure(&QualityInput { tracker: Some(&counts), ..QualityInput::of_path(&path) });
        assert!((figures.session.exposure_drift.unwrap() - dim).abs() < 1e-12, "{:?}", figures.session.exposure_drift);
        let finding = judge(&figures).concerns()[0].finding();
        assert!(finding.contains("brightness changes by 100 %") || finding.contains("by 99 %"), "{finding}");
        assert!(finding.ends_with("; at 2 s"), "when it went off: {finding}");
    }
}

#[test]
fn an_interlaced_recording_asks_for_care_and_says_how_to_mend_it() {
    let path = path(|_| true);
    let judged =
        |frames| judge(&measure(&QualityInput { frames_interlaced: Some(frames), ..QualityInput::of_path(&path) }));
    assert_eq!(judged(0), QualityVerdict::Valid);
    assert_eq!(judged(FRAMES / 50), QualityVerdict::Valid, "single frames do no harm");
    let verdict = judged(FRAMES);
    assert_eq!((causes(&verdict), rank(&verdict)), (vec![QualityCause::Interlaced], Some(Severity::Care)));
    assert!(verdict.concerns()[0].advice().contains("bwdif"));
}

#[test]
fn a_tool_without_a_trocar_is_refused_and_one_that_may_have_one_asks_for_care() {
    let moving = path(|_| true);
    let mut resting = path(|_| true);
    resting.samples.iter_mut().for_each(|sample| sample.tip_mm = Point3::new(0.01 * sample.tip_mm.x, 0.0, 150.0));
    let mut counts = counts(Vec::new());
    let judged = |counts: &Quality, path: &Trajectory| {
        judge(&measure(&QualityInput { tracker: Some(counts), ..QualityInput::of_path(path) }))
    };
    assert_eq!(judged(&counts, &moving), QualityVerdict::Valid);
    let possible = EffectiveDiameter { mm: 5.0, sigma_mm: 0.1, basis: DiameterBasis::AssumedTrocar };
    counts.tools[0].effective_diameter = Some(possible);
    assert_eq!(rank(&judged(&counts, &moving)), Some(Severity::Care), "it may have a trocar");
    counts.tools[0].effective_diameter = None;
    let refused = judged(&counts, &moving);
    assert_eq!((causes(&refused), rank(&refused)), (vec![QualityCause::NoTrocar], Some(Severity::Refuse)));
    assert!(refused.concerns()[0].finding().ends_with("do not show its trocar"));
    assert_eq!(rank(&judged(&counts, &resting)), Some(Severity::Refuse), "a thing that lies still");
    counts.tools[0].effective_diameter = Some(possible);
    assert_eq!(rank(&judged(&counts, &resting)), Some(Severity::Care), "a tool at rest");
}

#[test]
fn light_that_changes_slowly_has_no_moment_and_comes_before_what_it_causes() {
    let path = path(|frame| !(FRAMES / 5..=FRAMES / 3).contains(&frame));
    let mut counts = counts(Vec::new());
    let sample = |second: u32| LightSample {
        time_s: f64::from(second),
        luma_ratio: 1.0 - 0.04 * f64::from(second),
        chroma_shift: [0.0; 2],
    };
    counts.light = (0..20).map(sample).collect();
    let figures = measure(&QualityInput { tracker: Some(&counts), ..QualityInput::of_path(&path) });
    assert_eq!(figures.session.light_step_s, None);
    let verdict = judge(&figures);
    assert_eq!((causes(&verdict)[0], verdict.concerns()[0].at_s), (QualityCause::Exposure, None), "{verdict:?}");
    assert!(causes(&verdict).contains(&QualityCause::Coverage), "{verdict:?}");
}

#[test]
fn light_that_went_off_is_said_before_the_refusal_that_it_explains() {
    let judged = |least: f64| {
        let path = path(|frame| frame < FRAMES / 3 || frame + 1 == FRAMES);
        let mut counts = counts(Vec::new());
        let luma_ratio = |second: u32| if second < 7 { 1.0 } else { least };
        let sample = |second: u32| LightSample {
            time_s: f64::from(second),
            luma_ratio: luma_ratio(second),
            chroma_shift: [0.0; 2],
        };
        counts.light = (0..20).map(sample).collect();
        let verdict = judge(&measure(&QualityInput { tracker: Some(&counts), ..QualityInput::of_path(&path) }));
        assert!(verdict.is_refused(), "{verdict:?}");
        verdict
    };
    let dark = judged(0.05);
    assert_eq!((causes(&dark)[0], dark.concerns()[0].severity), (QualityCause::Exposure, Severity::Care));
    assert!(dark.concerns()[0].finding().ends_with("; at 7 s"), "{dark:?}");
    assert_eq!(rank(&judged(0.8)), Some(Severity::Refuse), "a little less light explains nothing");
}

#[test]
fn a_view_that_no_longer_fits_the_picture_of_the_empty_box_is_said_of_bare_tools() {
    let judged = |shift: f64, basis: DiameterBasis| {
        let mut counts = counts(Vec::new());
        counts.tools[0].effective_diameter = Some(EffectiveDiameter { mm: 5.0, sigma_mm: 0.1, basis });
        counts.tools[0].fulcrum =
            Some(Fulcrum::from_upper(Point3::new(0.0, 0.0, 50.0), [1.0, 0.0, 0.0, 1.0, 0.0, 1.0]));
        let path = path(|_| true);
        let mut figures = measure(&QualityInput { tracker: Some(&counts), ..QualityInput::of_path(&path) });
        let (chance, alignment) = (Some(0.1), Default::default());
        let resemblance = Some(Resemblance { correlation: 0.9, chance, structured: 0.9, shift, alignment });
        let evidence = BoxEvidence { resemblance, answer: None };
        figures.session.box_match = Some(BoxMatch::of(evidence, PortAgreement::Unknown));
        causes(&judge(&figures))
    };
    assert!(judged(0.04, DiameterBasis::BareShaft).contains(&QualityCause::ViewShifted));
    assert!(!judged(0.004, DiameterBasis::BareShaft).contains(&QualityCause::ViewShifted));
    assert!(!judged(0.04, DiameterBasis::Session).contains(&QualityCause::ViewShifted), "tape needs no picture");
}

#[test]
fn the_advice_on_a_bare_tool_does_not_speak_of_its_tape() {
    let mut path = path(|_| true);
    path.samples.iter_mut().for_each(|one| one.covariance_mm2 = Some(PositionCovariance::from_sigmas(3.0, 8.0)));
    let advice = |basis: DiameterBasis| {
        let mut counts = counts(Vec::new());
        counts.tools[0].effective_diameter = Some(EffectiveDiameter { mm: 5.0, sigma_mm: 0.1, basis });
        counts.tools[0].border_residual_px = Some(1.5);
        let verdict = judge(&measure(&QualityInput { tracker: Some(&counts), ..QualityInput::of_path(&path) }));
        let of = |cause| verdict.concerns().iter().find(|of| of.cause == cause).unwrap().advice();
        [QualityCause::ErrorBar, QualityCause::BorderResidual].map(of)
    };
    assert!(advice(DiameterBasis::Session).iter().all(|advice| advice.contains("tape")));
    assert!(advice(DiameterBasis::BareShaft).iter().all(|advice| !advice.contains("tape")));
}

#[test]
fn light_is_held_against_its_median() {
    let path = path(|_| true);
    let mut counts = counts(Vec::new());
    let sample = |second: u32| LightSample {
        time_s: f64::from(second),
        luma_ratio: if second < 2 { 0.8 } else { 1.0 },
        chroma_shift: [0.0, if second == 7 { 5.6 / 224.0 } else { 0.0 }],
    };
    counts.light = (0..20).map(sample).collect();
    let figures = measure(&QualityInput { tracker: Some(&counts), ..QualityInput::of_path(&path) });
    assert!((figures.session.exposure_drift.unwrap() - 0.2).abs() < 1e-12);
    assert!((figures.session.white_drift_codes.unwrap() - 5.6).abs() < 1e-9);
    assert_eq!(causes(&judge(&figures)), [QualityCause::Exposure, QualityCause::WhiteBalance]);
}

#[test]
fn a_recording_that_ends_while_a_tool_moves_is_not_whole() {
    let mut path = path(|frame| frame >= 100);
    path.frame_times_s = (0..FRAMES).map(|frame| frame as f64 * FRAME_S).collect();
    let figures = measure(&QualityInput::of_path(&path));
    assert_eq!(figures.session.first_speed_mm_s, None, "it came later");
    assert!((figures.session.last_speed_mm_s.unwrap() - 24.0).abs() < 1e-6);
    assert_eq!(causes(&judge(&figures)), [QualityCause::EndsInMotion]);
}

#[test]
fn independent_errors_make_the_speed_computed_from_one_of_them() {
    use crate::vision::filter::kalman::KalmanState;
    use crate::vision::filter::smoother::FilterRun;
    let (noise, stated) = (Vector3::new(0.05, 0.03, 0.4), Vector3::new(0.2, 0.2, 1.5));
    let covariance = nalgebra::Matrix3::from_diagonal(&stated.component_mul(&stated));
    let density = MotionSettings::default().noise_density();
    let mut dice = Dice::new(5, "errors of a rest");
    let mut state = KalmanState::first_seen(Point3::origin(), covariance, 0.0);
    let mut run = FilterRun::default();
    run.push(0.0, &state, 0.0, None);
    for step in 1..8000 {
        let seen = Point3::from(dice.gauss3().component_mul(&noise));
        state = state.predicted(FRAME_S, density).updated(seen, covariance);
        run.push(f64::from(step) * FRAME_S, &state, density, Some((seen, covariance)));
    }
    let rms = |states: &mut dyn Iterator<Item = KalmanState>| {
        let squares: Vec<f64> = states.map(|s| s.velocity().norm_squared()).collect();
        let inner = &squares[100..squares.len() - 100];
        (inner.iter().sum::<f64>() / inner.len() as f64).sqrt()
    };
    let drawn = (rms(&mut run.smoothed()), rms(&mut run.filtered()));
    let computed = noise_floor::noise_speeds(noise, stated, FRAME_S, density);
    assert!((computed.0 / drawn.0 - 1.0).abs() < 0.1, "smoothed: {} computed, {} drawn", computed.0, drawn.0);
    assert!((computed.1 / drawn.1 - 1.0).abs() < 0.1, "causal: {} computed, {} drawn", computed.1, drawn.1);
    assert!(computed.0 < computed.1, "the smoothed path is calmer");
}

#[test]
fn a_camera_that_moves_during_the_recording_asks_for_care_and_names_the_moment() {
    let moved_to = |angle: f64| {
        let shift = |second: u32| ViewShift {
            time_s: second.into(),
            parts: [0.0, if second < 8 { 0.0 } else { angle }, 0.0, 0.0],
        };
        let counts = Quality { view_shifts: (0..20).map(shift).collect(), ..counts(Vec::new()) };
        let path = path(|_| true);
        judge(&measure(&QualityInput { tracker: Some(&counts), ..QualityInput::of_path(&path) }))
    };
    let verdict = moved_to(0.08); // at a depth of 150 mm
    assert_eq!((causes(&verdict), rank(&verdict)), (vec![QualityCause::CameraMovedDuring], Some(Severity::Care)));
    assert_eq!(
        verdict.concerns()[0].finding(),
        "the camera moved during the recording, by 12.0 mm at the depth of the tools (limit 5.0 mm); at 8 s"
    );
    assert_eq!(moved_to(0.03), QualityVerdict::Valid, "4.5 mm");
}

#[test]
fn tremor_is_no_noise() {
    /// The passing error of a measured depth, mm.
    const PASSING: f64 = 0.3;
    #[derive(Debug)]
    struct Measured(Vec<Sample>);
    impl PathSource for Measured {
        fn path(&self, _kind: PathKind, _tool: usize) -> Vec<Sample> {
            self.0.clone()
        }
    }
    let floor_mm_s = |across_mm: f64, along_mm: f64| {
        let mut dice = Dice::new(6, "errors and tremor");
        let mut measured = path(|_| true);
        for sample in &mut measured.samples {
            sample.tip_mm += dice.gauss3().component_mul(&Vector3::new(across_mm, across_mm, along_mm));
        }
        let (smoothed, others) = (path(|_| true), Measured(measured.samples));
        let tool = ToolQuality { transient_depth_sigma_mm: Some(PASSING), ..ToolQuality::default() };
        let tracker = Quality { tools: vec![tool], ..Quality::default() };
        let evidence =
            QualityInput { others: Some(&others), tracker: Some(&tracker), ..QualityInput::of_path(&smoothed) };
        noise_floor::from_measurements(&evidence, 0).unwrap().smoothed_mm_s
    };
    let calm = floor_mm_s(0.03, 0.9 * PASSING);
    for (across, along) in [(0.4, 0.9 * PASSING), (0.03, 5.0 * PASSING)] {
        let trembling = floor_mm_s(across, along);
        assert!(trembling < 1.6 * calm, "{trembling} mm/s with tremor, {calm} without");
    }
    let calmer = floor_mm_s(0.03, 0.3 * PASSING);
    assert!(calmer < 0.55 * calm, "a smaller passing error must give less noise: {calmer} of {calm} mm/s");
}

#[test]
fn a_rest_counts_without_the_motion_around_it() {
    let mut path = path(|_| true);
    for sample in path.samples.iter_mut().filter(|s| (200..300).contains(&s.frame)) {
        sample.tip_px = Some(Point2::new(600.0, 300.0));
        let settled = (213..287).contains(&sample.frame); // without the first and the last half second of the rest
        sample.velocity_mm_s = Some(Vector3::new(0.0, 0.0, if settled { 1.5 } else { 20.0 }));
    }
    let noise = measure(&QualityInput::of_path(&path)).tools[0].noise_floor.unwrap();
    let NoiseFloorBasis::Rest(rest_s) = noise.basis else { panic!("{noise:?}") };
    assert!((rest_s - 2.96).abs() < 1e-6, "{rest_s}");
    assert!((noise.smoothed_mm_s - 1.5).abs() < 1e-9, "{noise:?}");
}
