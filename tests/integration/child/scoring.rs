//! Scoring in a child: the same numbers as in this process, within the child's own limits.

use std::io::Write;

use trocar::analysis::edits::Unmeasured;
use trocar::analysis::paths::{SessionPaths, TrackingSummary};
use trocar::analysis::protocol::{QualitySummary, ScoreSource, ScoreWork};
use trocar::analysis::scoring::{BoxContext, ScoreRows, paths_of_table, read_table, score_imported, score_tracked};
use trocar::domain::edit::{EditChange, EditsInForce};
use trocar::vision::tracker::ToolQuality;

use super::*;

const TOOLS: [&str; 2] = ["left", "right"];

/// Two tools that move to and fro at 25 frames a second; `errors`: whether each row states its error.
fn table(frames: u64, errors: bool) -> String {
    let mut table = "frame,time_s,tool,x_mm,y_mm,z_mm".to_owned();
    table += if errors { ",sigma_xy_mm,sigma_z_mm\n" } else { "\n" };
    for frame in 0..frames {
        let time = frame as f64 * 0.04;
        for (tool, reach) in TOOLS.into_iter().zip([20.0, 60.0]) {
            let (x, y) = (reach * (time * 1.3).sin(), 20.0 * (time * 0.7).cos());
            let stated = if errors { ",0.1,0.4" } else { "" };
            table += &format!("{frame},{time},{tool},{x},{y},150{stated}\n");
        }
    }
    table
}

/// The paths of such a table.
fn paths(frames: u64) -> SessionPaths {
    paths_of_table(read_table(table(frames, true).as_bytes()).unwrap().trajectory)
}

fn trim() -> EditsInForce {
    EditsInForce { revision: 1, changes: vec![EditChange::Trim([1.0, 5.0])], box_answer: None }
}

/// Scores this file in a child.
fn score(
    source: ScoreSource,
    edits: EditsInForce,
    file: &[u8],
    budget: &Budget,
) -> Result<ChildOutput, AttemptFailure> {
    let mut stored = tempfile::NamedTempFile::new().unwrap();
    stored.write_all(file).unwrap();
    let tools = match source {
        ScoreSource::Table => vec![],
        ScoreSource::ImportedPath { .. } | ScoreSource::TrackedPath { .. } => TOOLS.map(str::to_owned).to_vec(),
    };
    let attempt = ChildAttempt {
        program: &program(),
        request: ChildRequest { threads: 1, work: ChildWork::Score(ScoreWork { source, tools, edits }) },
        inputs: vec![stored.reopen().unwrap()],
        budget,
        stop: &StopSwitch::new().unwrap(),
    };
    run_attempt(attempt, |_| {}).0
}

/// Compares to the last bit: numbers are printed in the shortest form that reads back to the same bits.
fn assert_same(output: ChildOutput, expected: &ScoreRows) {
    let output = output.score;
    assert_eq!(format!("{:?}", output.features.unwrap()), format!("{:?}", expected.features));
    assert_eq!(format!("{:?}", output.evidence.unwrap()), format!("{:?}", expected.evidence));
    assert_eq!(output.quality.unwrap().to_string(), expected.quality.to_string());
}

#[test]
fn a_table_gets_the_score_and_the_path_that_this_process_gives_it() {
    let mut output =
        score(ScoreSource::Table, EditsInForce::default(), table(200, true).as_bytes(), &budget()).unwrap();
    let imported = output.score.imported.take().unwrap();
    assert_eq!((imported.frames(), imported.duration_s()), (200, 199.0 * 0.04));
    assert_eq!(imported.into_file().0, paths(200).to_bytes().unwrap());
    let expected = score_imported(paths(200), 200, &EditsInForce::default()).unwrap();
    assert!(expected.features.iter().any(|row| row.error.as_ref().is_some_and(Result::is_ok)));
    assert_same(output, &expected);
}

#[test]
fn a_stored_path_is_scored_with_its_edits_as_in_this_process() {
    let source = ScoreSource::ImportedPath { frames: 200 };
    let output = score(source, trim(), &paths(200).to_bytes().unwrap(), &budget()).unwrap();
    let expected = score_imported(paths(200), 200, &trim()).unwrap();
    let whole = score_imported(paths(200), 200, &EditsInForce::default()).unwrap();
    assert_ne!(expected.features, whole.features, "the trim changes the score");
    assert_same(output, &expected);
}

#[test]
fn a_tracked_path_is_scored_with_its_summary_as_in_this_process() {
    let tool = ToolQuality { observed: 200, ..ToolQuality::default() };
    let quality = QualitySummary {
        frames: 200,
        frames_interlaced: 7,
        tools: vec![tool.clone(), tool],
        light: Vec::new(),
        view_shifts: Vec::new(),
    };
    let tracked = || SessionPaths {
        frame_times_s: (0..200).map(|frame| f64::from(frame) * 0.04).collect(),
        tracking: Some(TrackingSummary { quality: quality.clone(), frames_expected: Some(201) }),
        ..paths(200)
    };
    let known = BoxContext { calibration_rms_px: Some(0.3), ..BoxContext::default() };
    let source = ScoreSource::TrackedPath { known: known.clone(), shown: None };
    let output = score(source, trim(), &tracked().to_bytes().unwrap(), &budget()).unwrap();
    assert_same(output, &score_tracked(tracked(), &Unmeasured::new(), (&known, None), &trim()).unwrap());

    let source = ScoreSource::TrackedPath { known, shown: None };
    match score(source, trim(), &paths(200).to_bytes().unwrap(), &budget()) {
        Err(AttemptFailure::Impossible(problem)) => assert_eq!(problem.slug, "path-alone"),
        other => panic!("expected a problem, got {other:?}"),
    }
}

#[test]
fn a_path_that_fills_the_memory_of_its_child_is_a_problem_of_its_length() {
    let small = Budget { memory_bytes: 24 << 20, ..budget() };
    let failed = score(ScoreSource::Table, EditsInForce::default(), table(80_000, false).as_bytes(), &small);
    match failed {
        Err(AttemptFailure::Impossible(problem)) => assert_eq!(problem.slug, "path-too-long", "{problem:?}"),
        other => panic!("expected a problem, got {other:?}"),
    }
}

#[test]
fn a_damaged_path_is_a_problem_and_not_a_crash() {
    let mut damaged = paths(20).to_bytes().unwrap();
    damaged.truncate(damaged.len() / 2);
    match score(ScoreSource::ImportedPath { frames: 20 }, EditsInForce::default(), &damaged, &budget()) {
        Err(AttemptFailure::Impossible(problem)) => assert_eq!(problem.slug, "input-damaged"),
        other => panic!("expected a problem, got {other:?}"),
    }
}
