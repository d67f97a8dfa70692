//! Tests of the self-test with exactly known boards and paths: correct boxes are green, faulty boxes are not.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

use super::*;
use crate::vision::camera::testing::wide;
use crate::vision::covariance::PositionCovariance;
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::segmentation::palette::Margin;
use crate::vision::space::{CameraPoint, Pixel};
use crate::vision::tracker::{LightSample, Marker, ToolQuality};
use crate::vision::trajectory::{Sample, SampleState};

const RADIUS_MM: f64 = 2.5;
const STEP_S: f64 = 0.1;

fn board() -> Board {
    Board::new(9, 6, 21.0).unwrap()
}

/// A trocar with a standard deviation of half a millimetre.
fn trocar(at: Point3<f64>) -> Fulcrum {
    Fulcrum { at, covariance: Matrix3::identity() * 0.25 }
}

/// A board that lies in the box, moved sideways by so many mm.
fn lying(aside_mm: f64) -> Isometry3<f64> {
    Isometry3::new(Vector3::new(4.0 + aside_mm, -6.0, 230.0), Vector3::new(0.15, 0.02, 0.03))
}

/// One minute at a box: a rod is held on corners from 3 s on, 3 s for each; the board is in sight all the time.
struct TestRecording {
    /// The lens that records.
    lens: Camera,
    /// Where the board lies at a time, s.
    board_at: fn(f64) -> Isometry3<f64>,
    /// Corners that are touched.
    touched: Vec<usize>,
    /// From the hand to the tip.
    axis: Vector3<f64>,
    /// Error added to the rod's measured position at a touch, mm.
    error_mm: fn(usize) -> Vector3<f64>,
    /// Stated standard deviation of the rod's depth, mm.
    sigma_z_mm: f64,
    /// Position of the rod's trocar, if it was found.
    trocar: Option<Point3<f64>>,
    /// Pixels of the empty box that have the tape's colour, if the box was seen empty.
    orange_px: Option<f64>,
    /// What shows where the rod is.
    marker: Marker,
}

impl Default for TestRecording {
    fn default() -> Self {
        Self {
            lens: wide(),
            board_at: |_| lying(0.0),
            touched: vec![10, 16, 25, 28, 37, 43],
            axis: Vector3::new(0.5, -0.4, 0.8).normalize(),
            error_mm: |_| Vector3::zeros(),
            sigma_z_mm: 0.4,
            trocar: None,
            orange_px: Some(0.0),
            marker: Marker::Band { length_mm: None },
        }
    }
}

impl TestRecording {
    fn findings(&self) -> SelfTestFindings {
        let last_s = 3.0 * (self.touched.len() + 2) as f64;
        let times = |step_s: f64| (0..(last_s / step_s) as usize).map(move |i| i as f64 * step_s);
        let watch = BoardWatch::with_sightings(
            board(),
            wide(),
            times(0.4).map(|time_s| (time_s, self.corners(time_s))).collect(),
        );
        let smoothed = Trajectory {
            tools: vec!["orange".into()],
            samples: times(STEP_S).filter_map(|time_s| self.sample(time_s)).collect(),
            frame_times_s: times(STEP_S).collect(),
            cuts: Vec::new(),
        };
        let spec = ToolSpec {
            name: "orange".into(),
            colour: "orange".into(),
            side: None,
            diameter_mm: 2.0 * RADIUS_MM,
            marker: self.marker,
        };
        let steady = |time_s| LightSample { time_s, luma_ratio: 1.0, chroma_shift: [0.0; 2] };
        let tool = ToolQuality { tool: "orange".into(), fulcrum: self.trocar.map(trocar), ..ToolQuality::default() };
        let apart = |margin_steps| Margin { margin_steps, spread_steps: 3.0, nearest: "background".into() };
        let tool =
            ToolQuality { colour: ColourSeparation { from_tools: None, from_background: Some(apart(12.0)) }, ..tool };
        let orange = |largest_px| FalseColour { colour: "orange".into(), largest_px };
        let quality = Quality {
            frames: smoothed.frame_times_s.len() as u64,
            tools: vec![tool],
            light: times(1.0).map(steady).collect(),
            view_shifts: Vec::new(),
        };
        measure(
            watch,
            &SelfTestEvidence {
                camera: wide(),
                tools: &[spec],
                reach_mm: 0.0,
                quality: &quality,
                smoothed: &smoothed,
                ports: &Ports::new(vec![trocar(Point3::new(0.0, -100.0, 120.0))]),
                false_colours: &self.orange_px.map(orange).into_iter().collect::<Vec<_>>(),
            },
        )
    }

    fn corners(&self, time_s: f64) -> Vec<Pixel> {
        let pose = (self.board_at)(time_s);
        let points = board().points_mm().into_iter().map(|p| CameraPoint(pose * Point3::new(p.x, p.y, 0.0)));
        points.map(|point| self.lens.project(point).unwrap()).collect()
    }

    /// The rod as the tracker would see it: still for 2 s of every 3.
    fn sample(&self, time_s: f64) -> Option<Sample> {
        let touch = (time_s / 3.0) as usize;
        let corner = *self.touched.get(touch.checked_sub(1)?)?;
        let pose = (self.board_at)(time_s);
        let normal = -(pose.rotation * Vector3::z());
        let axis = self.axis;
        let on_board = board().points_mm()[corner];
        let at = pose * Point3::new(on_board.x, on_board.y, 0.0);
        let down = (axis * normal.dot(&axis) - normal).normalize();
        let speed = if (0.4..2.5).contains(&(time_s - 3.0 * touch as f64)) { 0.3 } else { 60.0 };
        Some(Sample {
            frame: (time_s / STEP_S).round() as u64,
            time_s,
            tool: 0,
            tip_mm: at - down * RADIUS_MM + (self.error_mm)(touch - 1),
            velocity_mm_s: Some(Vector3::x() * speed),
            axis: Some(axis),
            tip_px: None,
            covariance_mm2: Some(PositionCovariance::from_sigmas(0.1, self.sigma_z_mm)),
            state: SampleState::Observed,
        })
    }
}

fn signal(findings: &SelfTestFindings, part: SelfTestPart) -> Signal {
    let verdict = verdict::judge(findings, Some(0.1));
    verdict.parts.iter().find(|verdict| verdict.part == part).unwrap().signal
}

fn reasons(findings: &SelfTestFindings) -> Vec<Option<UnusableReason>> {
    findings.touches.iter().map(|touch| touch.outcome.err()).collect()
}

/// Error of the measured tip at the touch with this number, mm.
type Offset = fn(usize) -> Vector3<f64>;

#[test]
fn a_rod_that_is_seen_where_it_touches_is_green_and_every_corner_is_named() {
    let minute = TestRecording::default();
    let findings = minute.findings();
    let accuracy = findings.accuracy.unwrap();
    assert!(accuracy.rms_mm < 1e-4, "{accuracy:?}");
    assert_eq!((accuracy.touches, accuracy.inside, accuracy.stated), (6, 6, 6));
    let named: Vec<usize> = findings.touches.iter().map(|t| t.outcome.unwrap()).map(|m| m.row * 9 + m.column).collect();
    assert_eq!(named, minute.touched);
    assert_eq!(
        (signal(&findings, SelfTestPart::Accuracy), signal(&findings, SelfTestPart::Calibration)),
        (Signal::Green, Signal::Green)
    );
    assert_eq!(findings.placements.len(), 1);
}

#[test]
fn an_error_is_reported_with_its_size_along_and_across_the_line_of_sight() {
    let findings = TestRecording { error_mm: |_| Vector3::new(0.0, 0.0, 3.0), ..TestRecording::default() }.findings();
    let accuracy = findings.accuracy.unwrap();
    assert!((accuracy.rms_mm - 3.0).abs() < 1e-3 && accuracy.along_mean_mm > 2.7, "{accuracy:?}");
    assert_eq!((accuracy.inside, signal(&findings, SelfTestPart::Accuracy)), (0, Signal::Red));
    assert_eq!(verdict::judge(&findings, None).parts[0].advice, Some(SelfTestAdvice::CheckRod));
    let yellow = TestRecording { error_mm: |_| Vector3::new(0.0, 0.0, 1.5), ..TestRecording::default() }.findings();
    assert_eq!(signal(&yellow, SelfTestPart::Accuracy), Signal::Yellow);
}

#[test]
fn an_error_that_the_tracker_states_is_yellow_and_a_larger_one_red() {
    let stated = TestRecording { sigma_z_mm: 3.0, ..TestRecording::default() };
    let within = TestRecording { error_mm: |_| Vector3::new(0.0, 0.0, 4.0), ..stated }.findings();
    assert_eq!((within.accuracy.unwrap().inside, signal(&within, SelfTestPart::Accuracy)), (6, Signal::Yellow));
    let stated = TestRecording { sigma_z_mm: 3.0, ..TestRecording::default() };
    let beyond = TestRecording { error_mm: |_| Vector3::new(0.0, 0.0, 12.0), ..stated }.findings();
    assert_eq!((beyond.accuracy.unwrap().inside, signal(&beyond, SelfTestPart::Accuracy)), (0, Signal::Red));
}

#[test]
fn a_touch_during_which_the_board_slid_does_not_count_and_those_before_and_after_do() {
    let slides = |time_s: f64| lying(if time_s < 10.5 { 0.0 } else { 4.0 });
    let findings = TestRecording { board_at: slides, ..TestRecording::default() }.findings();
    assert_eq!(reasons(&findings), [None, None, Some(UnusableReason::BoardMoved), None, None, None]);
    assert!(findings.accuracy.unwrap().rms_mm < 1e-4 && findings.placements.len() == 2);
    let said = verdict::judge(&findings, None).parts[0].finding.clone();
    assert!(said.contains("1 not counted: the board was moved"), "{said}");
}

/// Offset from a touch's corner towards the camera, mm.
fn lifted(touch: usize, mm: f64) -> Vector3<f64> {
    let on_board = board().points_mm()[TestRecording::default().touched[touch]];
    (lying(0.0) * Point3::new(on_board.x, on_board.y, 0.0)).coords.normalize() * -mm
}

/// Error of a hand and the tracker, mm: 0.6 RMS over all directions.
fn unsteady(touch: usize) -> Vector3<f64> {
    const OFF: [[f64; 3]; 6] =
        [[0.2, -0.1, 0.6], [-0.1, 0.2, -0.5], [0.1, 0.1, 0.2], [-0.2, 0.0, -0.7], [0.0, -0.2, 0.5], [0.1, 0.0, -0.4]];
    Vector3::from(OFF[touch])
}

#[test]
fn waiting_above_the_board_at_any_height_is_no_touch_and_does_not_count_as_an_error() {
    let two_wait: [(Offset, &[usize]); 4] = [
        (|touch| if touch == 2 { lifted(touch, 30.0) } else { unsteady(touch) }, &[2]),
        (|touch| if touch == 4 { lifted(touch, 4.0) } else { unsteady(touch) }, &[4]),
        (|touch| if touch == 0 || touch == 5 { lifted(touch, 9.0) } else { unsteady(touch) }, &[0, 5]),
        (|touch| if touch == 1 || touch == 2 { lifted(touch, 3.5) } else { unsteady(touch) }, &[1, 2]),
    ];
    for (error_mm, waits) in two_wait {
        let findings = TestRecording { error_mm, ..TestRecording::default() }.findings();
        let found: Vec<usize> = (0..6).filter(|i| reasons(&findings)[*i] == Some(UnusableReason::AboveBoard)).collect();
        assert_eq!(found, waits, "{:?}", reasons(&findings));
        assert_eq!(findings.accuracy.as_ref().unwrap().touches, 6 - waits.len());
        assert_eq!(signal(&findings, SelfTestPart::Accuracy), Signal::Green, "{:?}", findings.accuracy);
        let said = verdict::judge(&findings, None).parts[0].finding.clone();
        assert!(said.contains(&format!("{} not counted: the rod was held above the board", waits.len())), "{said}");
    }
}

#[test]
fn touches_that_are_only_unsteady_all_count() {
    let findings = TestRecording { error_mm: unsteady, ..TestRecording::default() }.findings();
    assert_eq!((reasons(&findings), signal(&findings, SelfTestPart::Accuracy)), (vec![None; 6], Signal::Green));
}

#[test]
fn errors_that_touches_share_or_that_scatter_are_the_boxes_and_are_left_in_the_figure() {
    /// Apparent offset of a rod that is thinner than stated.
    fn stretched(touch: usize, by: f64) -> Vector3<f64> {
        let on_board = board().points_mm()[TestRecording::default().touched[touch]];
        (lying(0.0) * Point3::new(on_board.x, on_board.y, 0.0)).coords * by
    }
    let wrong: [(&str, Offset); 4] = [
        ("5 mm called 6", |touch| stretched(touch, 0.2) + unsteady(touch)),
        ("5 mm called 4.9", |touch| stretched(touch, -0.02) + unsteady(touch)),
        ("seen too near at a corner or two", |touch| lifted(touch, [-3.0, 3.0, -3.0, 3.0, 3.0, -3.0][touch])),
        ("half of them too high", |touch| lifted(touch, if touch % 2 == 0 { 6.0 } else { 0.0 })),
    ];
    for (what, error_mm) in wrong {
        let findings = TestRecording { error_mm, ..TestRecording::default() }.findings();
        assert_eq!(
            (reasons(&findings), signal(&findings, SelfTestPart::Accuracy)),
            (vec![None; 6], Signal::Red),
            "{what}"
        );
    }
    let wrong_and_waits =
        |touch| stretched(touch, 0.02) + if touch == 3 { lifted(touch, 7.0) } else { unsteady(touch) };
    let findings = TestRecording { error_mm: wrong_and_waits, ..TestRecording::default() }.findings();
    assert_eq!(
        reasons(&findings)[3],
        Some(UnusableReason::AboveBoard),
        "against the others, although it lies on the board"
    );
    assert_eq!(signal(&findings, SelfTestPart::Accuracy), Signal::Red);
}

#[test]
fn a_rod_that_would_come_from_below_the_board_was_seen_the_wrong_way_round_and_does_not_count() {
    let findings = TestRecording { axis: -TestRecording::default().axis, ..TestRecording::default() }.findings();
    assert_eq!(reasons(&findings), [Some(UnusableReason::WrongWay); 6]);
    assert_eq!(signal(&findings, SelfTestPart::Accuracy), Signal::NotMeasured);
}

#[test]
fn a_rest_between_corners_does_not_count_and_three_touches_are_too_few_for_a_figure() {
    let beside = |touch: usize| if touch < 3 { Vector3::x() * 10.5 } else { Vector3::zeros() };
    let findings = TestRecording { error_mm: beside, ..TestRecording::default() }.findings();
    assert_eq!(reasons(&findings)[..3], [Some(UnusableReason::NoCornerNear); 3]);
    assert_eq!((findings.accuracy, signal(&findings, SelfTestPart::Accuracy)), (None, Signal::NotMeasured));
    assert!(verdict::judge(&findings, None).signal >= Signal::NotMeasured, "what was not measured is never green");
}

#[test]
fn a_lens_that_was_turned_by_three_percent_is_red_although_the_touches_agree() {
    let turned = Camera { fx: wide().fx * 1.03, fy: wide().fy * 1.03, ..wide() };
    let findings = TestRecording { lens: turned, ..TestRecording::default() }.findings();
    let change = findings.focal_change.unwrap();
    assert!((change.share - 0.03).abs() < 1e-3 && change.sigma < 1e-4, "{change:?}");
    assert_eq!(signal(&findings, SelfTestPart::Calibration), Signal::Red);
    assert_eq!(verdict::judge(&findings, Some(0.1)).signal, Signal::Red);
    let slightly = Camera { fx: wide().fx * 1.004, fy: wide().fy * 1.004, ..wide() };
    assert_eq!(
        signal(&TestRecording { lens: slightly, ..TestRecording::default() }.findings(), SelfTestPart::Calibration),
        Signal::Green
    );
}

#[test]
fn a_box_that_contains_the_tapes_colour_today_is_not_green_even_if_it_was_marked_well() {
    let colours = |orange_px| {
        let findings = TestRecording { orange_px, ..TestRecording::default() }.findings();
        verdict::judge(&findings, None).parts.into_iter().find(|part| part.part == SelfTestPart::Colours).unwrap()
    };
    let tape_px = wide().fx * wide().fy / 230f64.powi(2) * 5.0 * 25.0;
    let clean = colours(Some(0.02 * tape_px));
    assert_eq!((clean.signal, clean.unit, clean.figure), (Signal::Green, "steps", Some(12.0)));
    assert!(clean.finding.contains("is 0.02 × a tape"), "{}", clean.finding);
    let nothing = colours(Some(0.0)).finding;
    assert!(nothing.contains("today nothing in the empty box has their colours"), "{nothing}");
    let [some, much] = [0.3, 0.7].map(|share| colours(Some(share * tape_px)));
    assert_eq!((some.signal, much.signal), (Signal::Yellow, Signal::Red));
    assert!((much.figure.unwrap() - 0.7).abs() < 1e-6 && much.advice == Some(SelfTestAdvice::ClearBox), "{much:?}");
    let unseen = colours(None);
    assert_eq!(unseen.signal, Signal::NotMeasured, "{unseen:?}");
    assert!(unseen.finding.contains("never seen") && unseen.advice == Some(SelfTestAdvice::ClearView), "{unseen:?}");
}

#[test]
fn a_rod_without_tape_is_not_asked_for_the_colour_of_a_tape() {
    let marker = Marker::Shaft { collar_mm: None, jaw_mm: None };
    let findings = TestRecording { marker, orange_px: None, ..TestRecording::default() }.findings();
    let verdict = verdict::judge(&findings, None);
    assert!(verdict.parts.iter().all(|part| part.part != SelfTestPart::Colours), "{verdict:?}");
    assert!(verdict.signal < Signal::NotMeasured, "{verdict:?}");
}

#[test]
fn a_trocar_that_lies_elsewhere_asks_whether_the_camera_has_moved() {
    let part = |at: Option<Point3<f64>>| {
        let findings = TestRecording { trocar: at, ..TestRecording::default() }.findings();
        verdict::judge(&findings, None).parts.into_iter().find(|part| part.part == SelfTestPart::Place)
    };
    let signal = |beside_mm: f64| part(Some(Point3::new(beside_mm, -100.0, 120.0))).unwrap().signal;
    assert_eq!((signal(0.0), signal(4.0), signal(9.0)), (Signal::Green, Signal::Green, Signal::Yellow));
    assert_eq!(part(None), None, "of a rod that is held freely nothing is said");
}

#[test]
fn a_minute_without_a_board_measures_neither_accuracy_nor_calibration() {
    let mut findings = TestRecording::default().findings();
    let spec: Vec<ToolSpec> = Vec::new();
    let nothing = Trajectory { tools: Vec::new(), samples: Vec::new(), frame_times_s: Vec::new(), cuts: Vec::new() };
    let (quality, ports) = (&Quality::default(), &Ports::default());
    let evidence = SelfTestEvidence {
        camera: wide(),
        tools: &spec,
        reach_mm: 0.0,
        quality,
        smoothed: &nothing,
        ports,
        false_colours: &[],
    };
    let empty = measure(BoardWatch::new(board(), wide()), &evidence);
    let verdict = verdict::judge(&empty, None);
    assert_eq!(verdict.parts.len(), 4);
    assert!(verdict.parts.iter().all(|part| part.part != SelfTestPart::Place), "an unknown trocar is not reported");
    for part in verdict.parts {
        assert_eq!(part.signal, Signal::NotMeasured, "{part:?}");
    }
    findings.exposure_drift = Some(0.5);
    assert_eq!(signal(&findings, SelfTestPart::Lighting), Signal::Red);
    findings.exposure_drift = Some(0.2);
    assert_eq!(signal(&findings, SelfTestPart::Lighting), Signal::Yellow);
}
