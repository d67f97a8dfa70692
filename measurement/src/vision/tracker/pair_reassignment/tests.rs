use nalgebra::{Matrix5, Point3, Vector3};

use super::*;
use crate::vision::pose::StoredPose;
use crate::vision::pose::normal_equations::NormalEquations;
use crate::vision::tube::Tube;

const TROCARS: [Point3<f64>; 2] = [Point3::new(-112.0, 96.0, 60.0), Point3::new(112.0, 96.0, 60.0)];
const FRAMES: usize = 240;
const FRAME_S: f64 = 0.04;

/// A tool's pose at a frame. Both tools pass the same places, one after the other, and turn enough to determine their
/// trocars.
fn pose(tool: usize, frame: usize) -> TubeEstimate {
    let t = frame as f64 * FRAME_S + 3.0 * tool as f64;
    let tip = Point3::new(35.0 * (0.9 * t).sin(), 25.0 * (1.3 * t).cos() - 10.0, 190.0 + 12.0 * (0.7 * t).sin());
    let tube = Tube { tip, axis: (tip - TROCARS[tool]).normalize(), radius: 2.5 };
    let covariance = Matrix5::from_diagonal(&[0.01, 0.01, 0.25, 4e-4, 4e-4].into());
    TubeEstimate {
        tube,
        covariance,
        lasting: covariance * 0.1,
        equations: NormalEquations::from_covariance(&covariance),
        residual_px: 0.2,
        support: 50.0,
    }
}

fn seen(estimate: TubeEstimate) -> FrameRecord {
    FrameRecord { pose: Some(StoredPose::from(&estimate)), is_good: true, reason: None }
}

const UNSEEN: FrameRecord = FrameRecord { pose: None, is_good: false, reason: Some(MissReason::NoMarkerColour) };

/// Records of both tools, made by `of` for each tool and frame.
fn records(of: impl Fn(usize, usize) -> FrameRecord) -> Records {
    [0, 1].map(|tool| (0..FRAMES).map(|frame| of(tool, frame)).collect())
}

fn instants() -> Vec<FrameInstant> {
    (0..FRAMES).map(|frame| (frame as u64, frame as f64 * FRAME_S)).collect()
}

/// Counts the records that hold the tool's own pose, the other tool's, and none.
fn count(records: &Records) -> [usize; 3] {
    let mut counts = [0; 3];
    for (tool, frame) in [0, 1].into_iter().flat_map(|tool| (0..FRAMES).map(move |frame| (tool, frame))) {
        let tip = records[tool][frame].pose.map(|pose| pose.tube.tip);
        let is_of = |tool: usize| tip == Some(pose(tool, frame).tube.tip);
        counts[if is_of(tool) {
            0
        } else if is_of(1 - tool) {
            1
        } else {
            2
        }] += 1;
    }
    counts
}

fn true_records() -> Records {
    records(|tool, frame| seen(pose(tool, frame)))
}

#[test]
fn correct_records_stay_unchanged() {
    let settled = reassigned(true_records(), &instants(), true);
    assert_eq!(count(&settled), [2 * FRAMES, 0, 0]);
}

#[test]
fn pieces_that_were_exchanged_go_back_to_their_tools() {
    let exchanged = |frame: usize| (60..110).contains(&frame) || frame > 200;
    let wrong = records(|tool, frame| seen(pose(if exchanged(frame) { 1 - tool } else { tool }, frame)));
    assert_eq!(count(&wrong)[1], 2 * 89);
    assert_eq!(count(&reassigned(wrong, &instants(), true)), [2 * FRAMES, 0, 0]);
}

#[test]
fn tools_that_were_exchanged_all_the_time_get_their_sides_names() {
    let wrong = records(|tool, frame| seen(pose(1 - tool, frame)));
    assert_eq!(count(&reassigned(wrong, &instants(), true)), [2 * FRAMES, 0, 0]);
}

#[test]
fn one_tool_followed_as_both_is_one_tool() {
    let doubled =
        records(|tool, frame| if tool == 1 && frame < 60 { seen(pose(0, frame)) } else { seen(pose(tool, frame)) });
    let settled = reassigned(doubled, &instants(), true);
    assert_eq!(count(&settled), [2 * FRAMES - 60, 0, 60]);
    assert!(settled[1].iter().take(60).all(|record| record.reason.is_some()));
}

#[test]
fn a_tool_followed_under_the_others_name_alone_is_given_back() {
    let alone = |tool: usize, frame: usize| match (tool, (80..120).contains(&frame)) {
        (0, true) => seen(pose(1, frame)),
        (1, true) => UNSEEN,
        _ => seen(pose(tool, frame)),
    };
    let settled = reassigned(records(alone), &instants(), true);
    assert_eq!(count(&settled), [2 * FRAMES - 40, 0, 40]);
    assert_eq!(settled[0][100].reason, Some(MissReason::NoMarkerColour), "the left tool was not in sight");
}

#[test]
fn measurements_with_the_other_tools_sizes_are_rejected() {
    let wrong = records(|tool, frame| seen(pose(if frame < 80 { 1 - tool } else { tool }, frame)));
    let settled = reassigned(wrong, &instants(), false);
    assert_eq!(count(&settled), [2 * (FRAMES - 80), 0, 160]);
    assert_eq!(settled[0][10].reason, Some(MissReason::EitherTool));
}

#[test]
fn uninformative_poses_stay_between_segments_of_one_tool_and_are_rejected_between_both() {
    let vague = |estimate: TubeEstimate| {
        let covariance = Matrix5::from_diagonal(&[1.0, 1.0, 9.0, 4.0, 4.0].into());
        FrameRecord {
            is_good: false,
            ..seen(TubeEstimate { covariance, equations: NormalEquations::from_covariance(&covariance), ..estimate })
        }
    };
    let vague_in = |from: usize, exchanged_after: bool| {
        records(move |tool, frame| {
            let as_tool = if exchanged_after && frame >= from + 5 { 1 - tool } else { tool };
            let own = pose(as_tool, frame);
            if (from..from + 5).contains(&frame) { vague(own) } else { seen(own) }
        })
    };
    assert_eq!(count(&reassigned(vague_in(100, false), &instants(), true)), [2 * FRAMES, 0, 0]);
    let between = reassigned(vague_in(100, true), &instants(), true);
    assert_eq!(count(&between), [2 * FRAMES - 10, 0, 10]);
    assert!(between.iter().all(|tool| tool[102].reason == Some(MissReason::EitherTool)));
}

#[test]
fn tools_through_one_trocar_are_rejected() {
    let shift = Vector3::new(9.0, 4.0, 3.0);
    let one = records(|tool, frame| {
        let tip = pose(0, frame).tube.tip + shift * tool as f64;
        let tube = Tube { tip, axis: (tip - TROCARS[0]).normalize(), radius: 2.5 };
        seen(TubeEstimate { tube, ..pose(0, frame) })
    });
    let settled = reassigned(one, &instants(), true);
    assert!(settled.iter().flat_map(Blocks::iter).all(|record| record.reason == Some(MissReason::EitherTool)));
}

#[test]
fn a_tool_that_was_alone_keeps_its_records() {
    let alone = records(|tool, frame| if tool == 0 { seen(pose(0, frame)) } else { UNSEEN });
    assert_eq!(count(&reassigned(alone, &instants(), true)), [FRAMES, 0, FRAMES]);
}
