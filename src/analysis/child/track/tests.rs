//! A valid path and summary are kept unchanged; what no honest child sends is refused.

use nalgebra::{Point3, Vector3};

use super::*;
use crate::analysis::child::ChildWork;
use crate::analysis::output_validator::validate_records;
use crate::vision::camera::Camera;
use crate::vision::covariance::PositionCovariance;
use crate::vision::frame::{ColourEncoding, Matrix, Range};
use crate::vision::reason::MissReason;
use crate::vision::segmentation::palette::{ColourSeparation, Margin};
use crate::vision::segmentation::samples::ColourSamples;
use crate::vision::tracker::{Absence, Gap, Marker, ToolSpec};
use crate::vision::trajectory::SampleState;

/// Settings for one orange tool.
pub fn settings() -> TrackerSettings {
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
        focal_sigma: 0.0,
    };
    let tool = ToolSpec {
        name: "orange".into(),
        colour: "orange".into(),
        side: None,
        diameter_mm: 8.0,
        marker: Marker::Band { length_mm: None },
    };
    TrackerSettings::new(camera, vec![tool], ColourSamples::new(encoding))
}

/// The work with them, at the file's own times.
pub fn work() -> TrackWork {
    TrackWork { tracker: settings(), time: None }
}

#[test]
fn a_clock_belongs_to_its_request_and_is_plausible() {
    let hear = |time: Option<TimeCorrection>, basis, factor| {
        let clock = RecordingClock { basis, factor, capture_rate_hz: None };
        let work = ChildWork::Track(TrackWork { time, ..work() });
        validate_records(&work, vec![WorkRecord::Track(TrackRecord::Clock(clock))]).map(|output| output.track.clock)
    };
    let asked = Some(TimeCorrection::FrameRate(16.4));
    assert_eq!(hear(None, ClockBasis::Stamps, 1.0), Ok(Some(RecordingClock::default())));
    assert!(hear(None, ClockBasis::CaptureRate, 0.125).is_ok() && hear(asked, ClockBasis::FrameRate, 0.9).is_ok());
    for (time, basis, factor) in [
        (None, ClockBasis::FrameRate, 0.9),
        (asked, ClockBasis::Stamps, 1.0),
        (asked, ClockBasis::Duration, 0.9),
        (asked, ClockBasis::FrameRate, f64::NAN),
        (None, ClockBasis::Stamps, 0.5),
    ] {
        assert!(hear(time, basis, factor).is_err(), "{time:?} {basis} {factor}");
    }
}

fn row(frame: u64, time_s: f64) -> Sample {
    Sample {
        frame,
        time_s,
        tool: 0,
        tip_mm: Point3::new(1.0, 2.0, 300.0),
        velocity_mm_s: None,
        axis: Some(Vector3::z()),
        tip_px: None,
        covariance_mm2: None,
        state: SampleState::Observed,
    }
}

/// Validates these records after two frames, at 0 s and 0.04 s.
fn validate_all(records: Vec<TrackRecord>) -> Result<TrackOutput, String> {
    let opening = [
        RecordingRecord::Announced { width: 640, height: 480, frames_expected: Some(2) },
        RecordingRecord::Frames { times_s: vec![0.0, 0.04], seen: vec![] },
    ];
    let records = opening.map(TrackRecord::Recording).into_iter().chain(records).map(WorkRecord::Track).collect();
    Ok(validate_records(&ChildWork::Track(work()), records)?.track)
}

fn path(rows: Vec<Sample>) -> Vec<TrackRecord> {
    vec![TrackRecord::Path { kind: PathKind::Raw, rows }]
}

#[test]
fn an_honest_path_is_accepted_unchanged() {
    let rows = vec![row(0, 0.0), row(1, 0.04)];
    assert_eq!(validate_all(path(rows.clone())).unwrap().raw, rows);
}

#[test]
fn invalid_rows_are_refused() {
    let with_covariance =
        |upper: [f64; 6]| vec![Sample { covariance_mm2: Some(PositionCovariance::from_upper(upper)), ..row(0, 0.0) }];
    assert!(validate_all(path(with_covariance([1.0, 0.0, 2.0, 1.0, 0.0, 4.0]))).is_ok());
    let cases = [
        vec![row(2, 0.08)],
        vec![row(1, 0.05)],
        vec![row(1, 0.04), row(0, 0.0)],
        vec![row(0, 0.0), row(0, 0.0)],
        vec![Sample { tool: 1, ..row(0, 0.0) }],
        vec![Sample { tip_mm: Point3::new(f64::NAN, 0.0, 0.0), ..row(0, 0.0) }],
        with_covariance([1.0, 0.0, 0.0, 1.0, 0.0, f64::INFINITY]),
        with_covariance([-1.0, 0.0, 0.0, 1.0, 0.0, 1.0]),
        with_covariance([1.0, 0.0, 2.0, 1.0, 0.0, 1.0]),
        vec![Sample { tip_mm: Point3::new(1e300, 0.0, 0.0), ..row(0, 0.0) }],
    ];
    for rows in cases {
        assert!(validate_all(path(rows.clone())).is_err(), "{rows:?}");
    }
}

#[test]
fn records_out_of_order_are_refused() {
    let recording = TrackRecord::Recording;
    let cases = [
        recording(RecordingRecord::Announced { width: 640, height: 480, frames_expected: None }),
        recording(RecordingRecord::Frames { times_s: vec![0.04], seen: vec![] }),
        recording(RecordingRecord::Frames { times_s: vec![f64::NAN], seen: vec![] }),
        recording(RecordingRecord::Frames { times_s: vec![1e9], seen: vec![] }),
        recording(RecordingRecord::Preview(b"<script>".to_vec())),
        TrackRecord::Quality(QualitySummary { frames: 3, ..summary() }),
    ];
    for record in cases {
        let said = format!("{record:?}");
        assert!(validate_all(vec![record]).is_err(), "{said}");
    }
}

#[test]
fn a_recording_ends_once_and_starts_at_a_possible_time() {
    let end = |starts_at_s| TrackRecord::Recording(RecordingRecord::End { frames_stated: Some(2), starts_at_s });
    let heard = validate_all(vec![end(0.5)]).unwrap().recording;
    assert_eq!((heard.frames_stated, heard.starts_at_s), (Some(2), Some(0.5)));
    for starts_at_s in [-0.5, f64::NAN, f64::INFINITY, 1e9] {
        assert!(validate_all(vec![end(starts_at_s)]).is_err(), "{starts_at_s}");
    }
    assert!(validate_all(vec![end(0.5), end(0.5)]).is_err());
}

/// A summary of two frames without tools.
fn summary() -> QualitySummary {
    QualitySummary { frames: 2, frames_interlaced: 0, tools: vec![], light: vec![], view_shifts: vec![] }
}

fn tool() -> ToolQuality {
    ToolQuality { observed: 1, missing: 1, ..ToolQuality::default() }
}

/// Sends a summary of two frames with this tool.
fn validate_tool(tool: ToolQuality) -> Result<TrackOutput, String> {
    validate_all(vec![TrackRecord::Quality(QualitySummary { tools: vec![tool], ..summary() })])
}

#[test]
fn a_colour_is_a_few_numbers_and_a_short_name() {
    let hear = |steps: f64, nearest: String| {
        let from_background = Some(Margin { margin_steps: steps, spread_steps: 4.0, nearest });
        validate_tool(ToolQuality { colour: ColourSeparation { from_tools: None, from_background }, ..tool() })
    };
    assert!(hear(-2.5, "background".into()).is_ok());
    assert!(hear(f64::NAN, "background".into()).is_err());
    assert!(hear(-2.5, "b".repeat(100_000)).is_err());
}

#[test]
fn a_fulcrum_is_nine_numbers() {
    let hear = |x_mm: f64| {
        let fulcrum = Some(Fulcrum::from_upper(Point3::new(x_mm, 70.0, 40.0), [4.0, 0.0, 0.0, 4.0, 0.0, 4.0]));
        validate_tool(ToolQuality { fulcrum, ..tool() })
    };
    assert!(hear(-110.0).is_ok());
    assert!(hear(f64::NAN).is_err() && hear(1e9).is_err());
}

#[test]
fn a_reason_counts_no_more_frames_than_there_are() {
    let hear = |reasons: Vec<(MissReason, u64)>| {
        validate_tool(ToolQuality { reasons: reasons.into_iter().collect(), ..tool() })
    };
    let reasons = [MissReason::TipHidden, MissReason::PoorFit, MissReason::NoMarkerColour];
    let kept = hear(reasons.map(|reason| (reason, 2)).to_vec()).unwrap().quality.unwrap();
    assert!(kept.tools[0].reasons.keys().copied().eq(reasons.into_iter().rev()), "in the order of the stages");
    assert!(hear(vec![(MissReason::TipHidden, 3)]).is_err());
}

#[test]
fn no_more_frames_are_interlaced_than_there_are() {
    let hear = |frames_interlaced| {
        validate_all(vec![TrackRecord::Quality(QualitySummary { frames_interlaced, tools: vec![tool()], ..summary() })])
    };
    assert!(hear(2).is_ok() && hear(3).is_err());
}

#[test]
fn a_summary_matches_the_reported_frames() {
    let gap = |first, last| Gap { first, last, absence: Absence::LeftView };
    let sample = |luma_ratio| LightSample { time_s: 0.0, luma_ratio, chroma_shift: [0.0; 2] };
    let hear = |gaps: Vec<Gap>, light: Vec<LightSample>| {
        let tools = vec![ToolQuality { gaps, ..tool() }];
        validate_all(vec![TrackRecord::Quality(QualitySummary { tools, light, ..summary() })])
    };
    assert!(hear(vec![gap(0, 0), gap(1, 1)], vec![sample(1.0)]).is_ok());
    let gaps = [vec![gap(1, 0)], vec![gap(0, 2)], vec![gap(0, 1), gap(1, 1)], vec![gap(1, 1), gap(0, 0)]];
    for gaps in gaps {
        assert!(hear(gaps.clone(), vec![]).is_err(), "{gaps:?}");
    }
    for light in [vec![sample(f64::NAN)], vec![sample(1.0); 3]] {
        assert!(hear(vec![], light.clone()).is_err(), "{light:?}");
    }
    let shifted = |right: f64, moments: usize| {
        let view_shifts = vec![ViewShift { time_s: 0.0, parts: [right, 0.0, 0.0, 0.0] }; moments];
        validate_all(vec![TrackRecord::Quality(QualitySummary { tools: vec![tool()], view_shifts, ..summary() })])
    };
    assert!(shifted(0.1, 2).is_ok());
    assert!(shifted(f64::NAN, 1).is_err() && shifted(0.1, 3).is_err(), "more moments than frames");
}
