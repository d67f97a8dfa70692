//! Valid replies are stored unchanged; replies that no honest child sends are refused.

use proptest::prelude::*;

use super::*;
use crate::analysis::protocol::{
    BoardShape, CameraShape, FulcrumShape, MarginShape, PaletteWork, ReasonShape, SelfTestWork, ToolQualityShape,
    ToolShape, TrackWork, encode,
};
use crate::domain::feed::FrameCodec;
use crate::domain::palette::{ConfusionRow, LightShares, PaletteAdvice};
use crate::domain::self_test::{
    HoldReport, NotCountedReason, PartReport, PlacementReport, SelfTestReport, TestedPart, TrafficLight,
};
use crate::vision::camera::Camera;
use crate::vision::frame::{ColourEncoding, Matrix, Range};
use crate::vision::segmentation::samples::ColourSamples;

fn track_work() -> TrackWork {
    let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
    let camera = Camera {
        width: 640,
        height: 480,
        fx: 500.0,
        fy: 500.0,
        cx: 320.0,
        cy: 240.0,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        k3: 0.0,
    };
    TrackWork {
        camera: CameraShape::from(camera),
        tools: vec![ToolShape {
            name: "orange".into(),
            colour: "orange".into(),
            side: None,
            diameter_mm: 8.0,
            band_length_mm: None,
        }],
        palette: PaletteShape::from(&ColourSamples::new(encoding)),
        view: None,
    }
}

fn tracking() -> OutputValidator {
    OutputValidator::new(&ChildWork::Track(track_work()), MediaLimits::default())
}

fn row(frame: u64, time_s: f64) -> PathRow {
    PathRow {
        frame,
        time_s,
        tool: 0,
        tip_mm: [1.0, 2.0, 300.0],
        velocity_mm_s: None,
        axis: Some([0.0, 0.0, 1.0]),
        tip_px: None,
        sigma_xy_mm: None,
        sigma_z_mm: None,
        observed: true,
    }
}

/// Validates these replies after the confinement and two frames, at 0 s and 0.04 s.
fn validate_all(answers: Vec<ChildReply>) -> Result<ChildOutput, String> {
    let mut receipt = tracking();
    let opening = [
        ChildReply::Confined { landlock: true },
        ChildReply::Recording { width: 640, height: 480, frames_expected: Some(2) },
        ChildReply::Frames { times_s: vec![0.0, 0.04], seen: vec![] },
    ];
    for answer in opening.into_iter().chain(answers) {
        receipt.validate(&encode(&answer).unwrap())?;
    }
    Ok(receipt.into_output())
}

fn path(rows: Vec<PathRow>) -> Vec<ChildReply> {
    vec![ChildReply::Path { kind: KindShape::Raw, rows }]
}

#[test]
fn an_honest_path_is_accepted_unchanged() {
    let rows = vec![row(0, 0.0), row(1, 0.04)];
    assert_eq!(validate_all(path(rows.clone())).unwrap().raw, rows);
}

#[test]
fn invalid_rows_are_refused() {
    let cases = [
        vec![row(2, 0.08)],
        vec![row(1, 0.05)],
        vec![row(1, 0.04), row(0, 0.0)],
        vec![row(0, 0.0), row(0, 0.0)],
        vec![PathRow { tool: 1, ..row(0, 0.0) }],
        vec![PathRow { tip_mm: [f64::NAN, 0.0, 0.0], ..row(0, 0.0) }],
        vec![PathRow { sigma_z_mm: Some(f64::INFINITY), ..row(0, 0.0) }],
        vec![PathRow { tip_mm: [1e300, 0.0, 0.0], ..row(0, 0.0) }],
    ];
    for rows in cases {
        assert!(validate_all(path(rows.clone())).is_err(), "{rows:?}");
    }
}

#[test]
fn replies_out_of_order_are_refused() {
    let cases = [
        vec![ChildReply::Confined { landlock: true }],
        vec![ChildReply::Recording { width: 640, height: 480, frames_expected: None }],
        vec![ChildReply::Frames { times_s: vec![0.04], seen: vec![] }],
        vec![ChildReply::Frames { times_s: vec![f64::NAN], seen: vec![] }],
        vec![ChildReply::Frames { times_s: vec![1e9], seen: vec![] }],
        vec![ChildReply::Preview(b"<script>".to_vec())],
        vec![ChildReply::Quality(QualityShape { frames: 3, frames_interlaced: 0, tools: vec![], light: vec![] })],
        vec![ChildReply::Calibration(CalibrationShape { camera_json: "{}".into() })],
        vec![ChildReply::Done, ChildReply::Done],
        vec![ChildReply::Problem(Problem::new("no such name!", "", ""))],
    ];
    for answers in cases {
        let said = format!("{answers:?}");
        assert!(validate_all(answers).is_err(), "{said}");
    }
}

#[test]
fn frames_of_a_stream_follow_its_header_and_none_exceeds_the_feeds_limit() {
    let hear = |answers: &[ChildReply]| {
        let mut receipt = OutputValidator::new(&ChildWork::Demux, MediaLimits::default());
        receipt.validate(&encode(&ChildReply::Confined { landlock: true }).unwrap()).unwrap();
        answers.iter().try_for_each(|answer| receipt.validate(&encode(answer).unwrap()).map(drop))
    };
    let stream = |size| {
        let time_base = [1, 90_000].try_into().unwrap();
        ChildReply::Stream(SourceInfo {
            codec: FrameCodec::H264,
            size,
            time_base,
            coded_from: None,
            is_file: false,
            is_camera: false,
        })
    };
    let frame = |bytes, due_s| ChildReply::Coded(CapturedFrame { time: 0, due_s, is_key: true, bytes: vec![1; bytes] });
    assert!(hear(&[stream((640, 480)), frame(9, 0.0), frame(MAX_PAYLOAD, 0.04), frame(0, 0.08)]).is_ok());
    assert!(hear(&[frame(9, 0.0)]).is_err());
    assert!(hear(&[stream((640, 480)), stream((640, 480))]).is_err());
    assert!(hear(&[stream((60_000, 480))]).is_err());
    assert!(hear(&[stream((640, 480)), frame(MAX_PAYLOAD + 1, 0.0)]).is_err());
    assert!(hear(&[stream((640, 480)), frame(9, f64::NAN)]).is_err());
    assert!(hear(&[stream((640, 480)), ChildReply::Preview(vec![0xff, 0xd8])]).is_err());
}

fn tool() -> ToolQualityShape {
    let colour = [None, None];
    let (reasons, gaps) = (vec![], vec![]);
    ToolQualityShape {
        observed_predicted_missing: [1, 0, 1],
        reasons,
        border_residual_px: None,
        passing_depth_mm: None,
        effective_diameter: None,
        gaps,
        colour,
        fulcrum: None,
    }
}

#[test]
fn a_colour_is_a_few_numbers_and_a_short_name() {
    let hear = |steps: f64, nearest: String| {
        let margin = MarginShape { margin_spread_steps: [steps, 4.0], nearest };
        let tool = ToolQualityShape { colour: [None, Some(margin)], ..tool() };
        validate_all(vec![ChildReply::Quality(QualityShape {
            frames: 2,
            frames_interlaced: 0,
            tools: vec![tool],
            light: vec![],
        })])
    };
    assert!(hear(-2.5, "background".into()).is_ok());
    assert!(hear(f64::NAN, "background".into()).is_err());
    assert!(hear(-2.5, "b".repeat(100_000)).is_err());
}

#[test]
fn a_fulcrum_is_nine_numbers() {
    let hear = |x_mm: f64| {
        let fulcrum = Some(FulcrumShape { at_mm: [x_mm, 70.0, 40.0], covariance_mm2: [4.0, 0.0, 0.0, 4.0, 0.0, 4.0] });
        let tools = vec![ToolQualityShape { fulcrum, ..tool() }];
        validate_all(vec![ChildReply::Quality(QualityShape { frames: 2, frames_interlaced: 0, tools, light: vec![] })])
    };
    assert!(hear(-110.0).is_ok());
    assert!(hear(f64::NAN).is_err() && hear(1e9).is_err());
}

#[test]
fn the_reasons_of_a_summary_come_in_the_order_of_the_stages_once_each() {
    let hear = |reasons: Vec<MissReason>| {
        let reasons = reasons.into_iter().map(|reason| (reason.into(), 1)).collect();
        let tools = vec![ToolQualityShape { reasons, ..tool() }];
        validate_all(vec![ChildReply::Quality(QualityShape { frames: 2, frames_interlaced: 0, tools, light: vec![] })])
    };
    assert!(hear(vec![MissReason::NoMarkerColour, MissReason::PoorFit, MissReason::TipHidden]).is_ok());
    assert!(hear(vec![MissReason::TipHidden, MissReason::PoorFit]).is_err());
    assert!(hear(vec![MissReason::PoorFit, MissReason::PoorFit]).is_err());
}

#[test]
fn no_more_frames_are_interlaced_than_there_are() {
    let hear = |frames_interlaced| {
        validate_all(vec![ChildReply::Quality(QualityShape {
            frames: 2,
            frames_interlaced,
            tools: vec![tool()],
            light: vec![],
        })])
    };
    assert!(hear(2).is_ok() && hear(3).is_err());
}

#[test]
fn a_summary_matches_the_reported_frames() {
    let gap = |first, last| (first, last, None);
    let hear = |gaps: Vec<(u64, u64, Option<ReasonShape>)>, light: Vec<[f64; 4]>| {
        let tool = ToolQualityShape { gaps, ..tool() };
        validate_all(vec![ChildReply::Quality(QualityShape {
            frames: 2,
            frames_interlaced: 0,
            tools: vec![tool],
            light,
        })])
    };
    assert!(hear(vec![gap(0, 0), gap(1, 1)], vec![[0.0, 1.0, 0.0, 0.0]]).is_ok());
    let gaps = [vec![gap(1, 0)], vec![gap(0, 2)], vec![gap(0, 1), gap(1, 1)], vec![gap(1, 1), gap(0, 0)]];
    for gaps in gaps {
        assert!(hear(gaps.clone(), vec![]).is_err(), "{gaps:?}");
    }
    for light in [vec![[0.0, f64::NAN, 0.0, 0.0]], vec![[0.0; 4]; 3]] {
        assert!(hear(vec![], light.clone()).is_err(), "{light:?}");
    }
}

#[test]
fn a_report_on_colours_is_accepted_once_and_only_with_plausible_numbers() {
    let work = || ChildWork::Palette(PaletteWork { marks: vec![], tools: vec![], frames: None });
    let report = |no_tool: f64, label: &str| {
        let light = LightShares { light: "as marked".into(), no_tool, tools: vec![] };
        let row = ConfusionRow { label: label.into(), rectangles: 1, pixels: 4, lights: vec![light] };
        PaletteReport { confusion: vec![row], ..PaletteReport::default() }
    };
    let palette_hears = |reports: &[PaletteReport]| {
        let mut receipt = OutputValidator::new(&work(), MediaLimits::default());
        receipt.validate(&encode(&ChildReply::Confined { landlock: true }).unwrap())?;
        for report in reports {
            receipt.validate(&encode(&ChildReply::PaletteReport(report.clone())).unwrap())?;
        }
        Ok::<_, String>(receipt.into_output().palette_report)
    };
    let honest = report(0.25, "background");
    assert_eq!(palette_hears(std::slice::from_ref(&honest)).unwrap().unwrap(), honest);
    assert!(palette_hears(&[honest.clone(), honest.clone()]).is_err());
    assert!(palette_hears(&[report(f64::NAN, "background")]).is_err());
    assert!(palette_hears(&[report(0.25, &"x".repeat(5000))]).is_err());
    assert!(validate_all(vec![ChildReply::PaletteReport(honest)]).is_err());
}

#[test]
fn a_self_test_is_accepted_once_and_only_if_it_matches_the_request() {
    let part = |part: TestedPart, light: TrafficLight| PartReport {
        part,
        light,
        figure: Some(0.6),
        limit: None,
        unit: "mm".into(),
        finding: "6 touches".into(),
        advice: String::new(),
    };
    let hold = HoldReport {
        tool: "orange".into(),
        from_s: 3.0,
        to_s: 5.0,
        placement: Some(1),
        column: Some(9),
        row: Some(6),
        error_mm: Some(0.6),
        along_mm: Some(0.5),
        across_mm: Some(0.3),
        inside: None,
        not_counted: None,
    };
    let hovers = HoldReport {
        placement: None,
        column: None,
        row: None,
        error_mm: None,
        along_mm: None,
        across_mm: None,
        not_counted: Some(NotCountedReason::AboveBoard),
        ..hold.clone()
    };
    let honest = SelfTestReport {
        light: TrafficLight::Yellow,
        parts: TestedPart::ALL.iter().map(|of| part(*of, TrafficLight::Green)).collect(),
        board: "9x6".parse().unwrap(),
        square_mm: 21.0,
        placements: vec![PlacementReport { from_s: 0.0, to_s: 9.0, looks: 9, rms_px: 0.1, depth_mm: 200.0 }],
        focal_change_percent: None,
        focal_sigma_percent: None,
        accuracy: None,
        holds: vec![hold, hovers],
        exposure_drift: None,
        white_drift_codes: None,
    };
    let honest = {
        let mut honest = honest;
        honest.parts[3].light = TrafficLight::Yellow;
        honest
    };
    let hears = |reports: &[&SelfTestReport]| {
        let board = BoardShape { columns: 9, rows: 6, square_mm: 21.0 };
        let work =
            SelfTestWork { track: track_work(), board, reach_mm: 0.0, calibration_rms_px: None, ports: Vec::new() };
        let mut receipt = OutputValidator::new(&ChildWork::SelfTest(work), MediaLimits::default());
        receipt.validate(&encode(&ChildReply::Confined { landlock: true }).unwrap())?;
        for report in reports {
            receipt.validate(&encode(&ChildReply::SelfTest(Box::new((*report).clone()))).unwrap())?;
        }
        Ok::<_, String>(receipt.into_output().self_test)
    };
    assert_eq!(hears(&[&honest]).unwrap(), Some(honest.clone()));
    let mut placeless = honest.clone();
    placeless.parts.remove(2);
    assert!(hears(&[&placeless]).is_ok(), "an unknown trocar is left out");
    assert!(hears(&[&honest, &honest]).is_err());
    let forgeries: [fn(&mut SelfTestReport); 16] = [
        |r| r.light = TrafficLight::Green,
        |r| r.parts[0].light = TrafficLight::Red,
        |r| r.parts[0].figure = Some(f64::NAN),
        |r| r.parts[0].finding = "\u{1b}[31m".into(),
        |r| r.parts[0].advice = "x".repeat(5000),
        |r| r.parts.push(r.parts[4].clone()),
        |r| r.parts.swap(0, 1),
        |r| drop(r.parts.remove(0)),
        |r| r.parts.clear(),
        |r| r.board = "9x7".parse().unwrap(),
        |r| r.square_mm = 20.0,
        |r| r.holds[0].tool = "cyan".into(),
        |r| r.holds[0].placement = Some(2),
        |r| r.holds[0].row = Some(7),
        |r| r.holds[0].error_mm = None,
        |r| r.holds[1].column = Some(1),
    ];
    for (number, forge) in forgeries.into_iter().enumerate() {
        let mut forged = honest.clone();
        forge(&mut forged);
        assert!(hears(&[&forged]).is_err(), "forgery {number}");
    }
    assert!(validate_all(vec![ChildReply::SelfTest(Box::new(honest))]).is_err(), "not requested");
}

#[test]
fn advice_is_accepted_only_for_every_known_tape_and_pair() {
    use crate::vision::frame::{Frame, Plane};
    use crate::vision::segmentation::palette::advice::rank_tapes;
    let hears = |advice: &PaletteAdvice| {
        let mut receipt = OutputValidator::new(&ChildWork::Advise, MediaLimits::default());
        receipt.validate(&encode(&ChildReply::Confined { landlock: true }).unwrap())?;
        receipt.validate(&encode(&ChildReply::PaletteAdvice(advice.clone())).unwrap())?;
        Ok::<_, String>(receipt.into_output().palette_advice)
    };
    let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
    let grey = [128; 64];
    let plane = Plane { data: &grey, stride: 8, width: 8, height: 8 };
    let (y, u, v) = (plane, plane, plane);
    let frame = Frame { index: 0, time_s: 0.0, y, u, v, shift_x: 0, shift_y: 0, encoding };
    let honest = PaletteAdvice::from(&rank_tapes(&frame));
    assert_eq!(hears(&honest).unwrap(), Some(honest.clone()));
    let forgeries: [fn(&mut PaletteAdvice); 11] = [
        |a| a.tapes.clear(),
        |a| drop(a.tapes.pop()),
        |a| a.tapes[1] = a.tapes[0].clone(),
        |a| a.tapes[0].tape = "gold".into(),
        |a| a.tapes[0].srgb = "url(x)".into(),
        |a| a.tapes[0].ral += 1,
        |a| a.tapes[0].in_box = 1.5,
        |a| a.pairs[0] = a.pairs[1].clone(),
        |a| a.pairs[0].tapes[0] = a.pairs[0].tapes[1].clone(),
        |a| a.pairs[0].apart_steps = f64::INFINITY,
        |a| a.warnings.push("\n".into()),
    ];
    for (number, forge) in forgeries.into_iter().enumerate() {
        let mut forged = honest.clone();
        forge(&mut forged);
        assert!(hears(&forged).is_err(), "forgery {number}");
    }
}

#[test]
fn nothing_is_accepted_before_confinement() {
    assert!(tracking().validate(&encode(&ChildReply::Done).unwrap()).is_err());
}

#[test]
fn a_problems_texts_are_short_and_without_control_characters() {
    let problem = Problem::new("not-a-video", "a\nb", "x".repeat(10_000) + "\x1b[31m");
    let heard = validate_all(vec![ChildReply::Problem(problem)]).unwrap().problem.unwrap();
    assert_eq!((heard.title.as_str(), heard.detail.len()), ("a b", 4000));
}

proptest! {
    #[test]
    fn arbitrary_records_are_accepted_or_refused_but_never_panic(
        records in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..80), 1..8),
    ) {
        let mut receipt = tracking();
        receipt.validate(&encode(&ChildReply::Confined { landlock: true }).unwrap()).unwrap();
        for record in records {
            let _ = receipt.validate(&record);
        }
    }
}

fn check_work() -> ChildWork {
    ChildWork::Check(BoardShape { columns: 9, rows: 6, square_mm: 1.0 })
}

fn honest_check() -> PhotoCheck {
    let mut corners = vec![0; 48];
    corners[20] = 54;
    PhotoCheck {
        width: 640,
        height: 360,
        found: true,
        corners: vec![[300.0, 200.0]; 54],
        reason: None,
        hints: vec![],
        cut_off: vec![],
        near: None,
        coverage: crate::domain::photo_check::PhotoCoverage { columns: 8, rows: 6, corners },
    }
}

fn answered(work: &ChildWork, answers: Vec<ChildReply>) -> Result<ChildOutput, String> {
    let mut receipt = OutputValidator::new(work, MediaLimits::default());
    for answer in [ChildReply::Confined { landlock: true }].into_iter().chain(answers) {
        receipt.validate(&encode(&answer).unwrap())?;
    }
    Ok(receipt.into_output())
}

#[test]
fn a_photo_check_is_accepted_only_if_a_board_can_look_so() {
    let say = |check: PhotoCheck| answered(&check_work(), vec![ChildReply::PhotoCheck(check)]);
    assert_eq!(say(honest_check()).unwrap().photo_check, Some(honest_check()));
    type Spoil = fn(&mut PhotoCheck);
    let spoils: [Spoil; 8] = [
        |check| check.corners.truncate(53),
        |check| check.corners[0][0] = f64::NAN,
        |check| check.found = false,
        |check| check.reason = Some("x".repeat(201)),
        |check| check.width = 100_000,
        |check| check.coverage.corners[0] = 1,
        |check| check.coverage.columns = 9,
        |check| check.hints = vec![crate::domain::photo_check::PhotoHint::Dark],
    ];
    for (index, spoil) in spoils.into_iter().enumerate() {
        let mut check = honest_check();
        spoil(&mut check);
        assert!(say(check).is_err(), "spoil {index}");
    }
    let twice = vec![ChildReply::PhotoCheck(honest_check()), ChildReply::PhotoCheck(honest_check())];
    assert!(answered(&check_work(), twice).is_err());
    assert!(answered(&ChildWork::Advise, vec![ChildReply::PhotoCheck(honest_check())]).is_err());
}

#[test]
fn a_mask_fills_its_picture_with_known_colours_and_arrives_in_order() {
    let work =
        || ChildWork::Mask(PaletteWork { marks: vec![], tools: vec!["orange".into()], frames: Some(vec![3, 9]) });
    let mask = |frame, runs: &[[u32; 2]]| {
        ChildReply::Mask(FrameMask { frame, width: 9, height: 4, cell_px: 2, columns: 5, rows: 2, runs: runs.to_vec() })
    };
    let whole: &[[u32; 2]] = &[[0, 4], [1, 6]];
    let heard = answered(&work(), vec![mask(3, whole), mask(9, &[[0, 10]])]).unwrap();
    assert_eq!(heard.masks.len(), 2);
    for (what, answers) in [
        ("another picture", vec![mask(9, whole)]),
        ("one picture too many", vec![mask(3, whole), mask(9, whole), mask(3, whole)]),
        ("an unknown colour", vec![mask(3, &[[0, 4], [2, 6]])]),
        ("too few cells", vec![mask(3, &[[0, 4], [1, 5]])]),
        ("an empty run", vec![mask(3, &[[0, 4], [1, 0], [0, 6]])]),
        ("a run in two", vec![mask(3, &[[0, 4], [0, 6]])]),
    ] {
        assert!(answered(&work(), answers).is_err(), "{what}");
    }
    assert!(answered(&ChildWork::Probe, vec![mask(3, whole)]).is_err());
}
