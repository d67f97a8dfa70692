//! What edits leave of a recording, and which edits are accepted.

use nalgebra::{Point3, Vector3};
use proptest::prelude::*;

use super::*;
use crate::analysis::paths::{PathKind, TrackingSummary};
use crate::analysis::stored_rows::tests::stored;
use crate::domain::files::trajectory::RowSource;
use crate::motion::assessment::{AssessmentSettings, assess};
use crate::vision::covariance::PositionCovariance;
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::surroundings::ViewShift;
use crate::vision::tracker::{DiameterBasis, EffectiveDiameter, LightSample, TrocarEvidence};
use crate::vision::trajectory::SampleState;

const FRAMES: u64 = 250;
const STEP_S: f64 = 0.04;

fn row(frame: u64, tool: usize) -> Sample {
    Sample {
        frame,
        time_s: frame as f64 * STEP_S,
        tool,
        tip_mm: Point3::new(frame as f64, tool as f64, 150.0),
        velocity_mm_s: Some(Vector3::new(25.0, 0.0, 0.0)),
        axis: None,
        tip_px: None,
        covariance_mm2: Some(PositionCovariance::from_sigmas(0.1, 0.5)),
        state: if frame % 10 == 9 { SampleState::Predicted } else { SampleState::Observed },
    }
}

/// Ten seconds of two tools; cyan is out of view from frame 100 to 149, for a reason from 120 on.
fn paths() -> (SessionPaths, Unmeasured) {
    let is_there = |frame: u64, tool: usize| tool == 0 || !(100..150).contains(&frame);
    let rows: Vec<Sample> = (0..FRAMES)
        .flat_map(|f| [0, 1].map(|t| (f, t)))
        .filter(|(f, t)| is_there(*f, *t))
        .map(|(f, t)| row(f, t))
        .collect();
    let gaps = vec![left_view(100, 119), lost(120, 149)];
    let tool = |gaps: Vec<Gap>| {
        let missing: u64 = gaps.iter().map(|gap| gap.last - gap.first + 1).sum();
        let of_tool = rows.iter().filter(|row| row.tool == usize::from(missing > 0));
        let predicted = of_tool.filter(|row| !row.is_observed()).count() as u64;
        ToolQuality {
            observed: FRAMES - missing - predicted,
            predicted,
            missing,
            reasons: (missing > 0).then_some((MissReason::TooSmall, 30)).into_iter().collect(),
            border_residual_px: Some(0.2),
            transient_depth_sigma_mm: Some(0.3),
            gaps,
            ..ToolQuality::default()
        }
    };
    let light = |second: u32| LightSample { time_s: second.into(), luma_ratio: 1.0, chroma_shift: [0.0; 2] };
    let view_shift = |second: u32| ViewShift { time_s: second.into(), parts: [0.0; 4] };
    let quality = QualitySummary {
        frames: FRAMES,
        frames_interlaced: 50,
        tools: vec![tool(Vec::new()), tool(gaps)],
        light: (0..10).map(light).collect(),
        view_shifts: (0..10).map(view_shift).collect(),
    };
    let paths = SessionPaths {
        tools: vec!["orange".to_owned(), "cyan".to_owned()],
        frame_times_s: (0..FRAMES).map(|frame| frame as f64 * STEP_S).collect(),
        raw: rows.clone(),
        filtered: rows.clone(),
        smoothed: rows,
        tracking: Some(TrackingSummary { quality, frames_expected: Some(500) }),
        cuts: Vec::new(),
    };
    (paths, (120..150).map(|frame| (frame, 1, MissReason::TooSmall)).collect())
}

fn left_view(first: u64, last: u64) -> Gap {
    Gap { first, last, absence: Absence::LeftView }
}

fn lost(first: u64, last: u64) -> Gap {
    Gap { first, last, absence: Absence::Lost(MissReason::TooSmall) }
}

fn pair() -> [String; 2] {
    ["orange".to_owned(), "cyan".to_owned()]
}

fn counts(paths: &SessionPaths, tool: usize) -> [u64; 3] {
    let tool = &paths.tracking.as_ref().unwrap().quality.tools[tool];
    [tool.observed, tool.predicted, tool.missing]
}

#[test]
fn a_trim_keeps_the_span_and_counts_only_the_span() {
    let (paths, unmeasured) = paths();
    let edited = apply_edits(&paths, &[EditChange::Trim([4.4, 8.0])], &unmeasured); // frames 110 to 200
    assert_eq!((edited.smoothed.first().unwrap().frame, edited.smoothed.last().unwrap().frame), (110, 200));
    assert_eq!([&edited.raw, &edited.filtered].map(Vec::len), [edited.smoothed.len(); 2]);
    assert_eq!((edited.frame_times_s.len(), edited.frame_times_s[0]), (91, 4.4));
    let quality = &edited.tracking.as_ref().unwrap().quality;
    assert_eq!(
        (quality.frames, edited.tracking.as_ref().unwrap().frames_expected),
        (91, Some(182)),
        "half is cut, as ever"
    );
    assert_eq!(quality.frames_interlaced, 18, "a fifth, as ever");
    assert_eq!((quality.light[0].time_s, quality.light.len()), (5.0, 4));
    assert_eq!((quality.view_shifts[0].time_s, quality.view_shifts.len()), (5.0, 4));
    assert_eq!(quality.tools[1].gaps, [left_view(110, 119), lost(120, 149)]);
    assert_eq!((counts(&edited, 0), counts(&edited, 1)), ([82, 9, 0], [46, 5, 40]));
    assert_eq!(quality.tools[1].reasons, [(MissReason::TooSmall, 30)].into());
    let late = apply_edits(&paths, &[EditChange::Trim([5.2, 8.0])], &unmeasured); // from frame 130
    assert_eq!(late.tracking.unwrap().quality.tools[1].reasons, [(MissReason::TooSmall, 20)].into());
}

#[test]
fn a_trim_leaves_out_trocars_that_were_fitted_to_two_places_of_the_camera() {
    let bases = [DiameterBasis::Session, DiameterBasis::BareShaft];
    let recorded = |right: f64| {
        let (mut paths, _) = paths();
        let quality = &mut paths.tracking.as_mut().unwrap().quality;
        quality.view_shifts.iter_mut().filter(|shift| shift.time_s >= 5.0).for_each(|shift| shift.parts[0] = right);
        for (tool, basis) in quality.tools.iter_mut().zip(bases) {
            tool.fulcrum = Some(Fulcrum::from_upper(Point3::origin(), [1.0, 0.0, 0.0, 1.0, 0.0, 1.0]));
            tool.effective_diameter = Some(EffectiveDiameter { mm: 5.0, sigma_mm: 0.1, basis });
        }
        paths
    };
    let left = |right: f64, change: EditChange| {
        let tools = apply_edits(&recorded(right), &[change], &[]).tracking.unwrap().quality.tools;
        [0, 1].map(|tool| (tools[tool].fulcrum.is_some(), tools[tool].trocar()))
    };
    let (moved, nudged) = (0.1, 0.01); // at a depth of 150 mm
    let known = [(true, TrocarEvidence::Shown); 2];
    for trim in [[0.0, 4.5], [5.5, 9.0], [0.5, 9.96]].map(EditChange::Trim) {
        assert_eq!(left(moved, trim.clone()), [(false, TrocarEvidence::Shown), (false, TrocarEvidence::Possible)]);
        assert_eq!(left(nudged, trim), known);
    }
    assert_eq!(left(moved, EditChange::Swap(pair(), [2.0, 4.0])), known, "nothing is cut off");
}

#[test]
fn a_swap_exchanges_rows_gaps_and_reasons_within_and_nothing_outside() {
    let (paths, unmeasured) = paths();
    let edited = apply_edits(&paths, &[EditChange::Swap(pair(), [4.8, 9.96])], &unmeasured); // frames 120 to 249
    let tools = &edited.tracking.as_ref().unwrap().quality.tools;
    assert_eq!(tools[0].gaps, [lost(120, 149)]);
    assert_eq!(tools[1].gaps, [left_view(100, 119)]);
    assert_eq!((tools[0].reasons.len(), tools[1].reasons.len()), (1, 0));
    let of = |frame: u64, tool: usize| edited.smoothed.iter().find(|row| (row.frame, row.tool) == (frame, tool));
    assert_eq!(of(50, 0).unwrap().tip_mm[1], 0.0);
    assert_eq!(of(200, 0).unwrap().tip_mm[1], 1.0, "cyan's rows are orange's now");
    assert!(of(130, 0).is_none() && of(130, 1).is_some());
    assert!(edited.smoothed.is_sorted_by_key(|row| (row.frame, row.tool)));
}

#[test]
fn a_swap_of_two_tools_at_rest_moves_neither() {
    let row = |frame: u64, tool: usize| {
        let tip_mm = Point3::new(100.0 * tool as f64, 0.0, 150.0);
        Sample { tip_mm, ..self::row(frame, tool) }
    };
    let smoothed = (0..750).flat_map(|frame| [row(frame, 0), row(frame, 1)]).collect();
    let (raw, filtered, frame_times_s) = (Vec::new(), Vec::new(), (0..750).map(|frame| frame as f64 * 0.04).collect());
    let paths = SessionPaths {
        tools: pair().to_vec(),
        frame_times_s,
        raw,
        filtered,
        smoothed,
        tracking: None,
        cuts: Vec::new(),
    };
    let swap = [EditChange::Swap(pair(), [10.0, 20.0])];
    let edited = apply_edits(&paths, &swap, &[]).trajectory(PathKind::Smoothed);
    let cuts: Vec<(usize, f64)> = edited.cuts.iter().map(|cut| (cut.tool, (cut.time_s * 100.0).round())).collect();
    assert_eq!(cuts, [(1, 1000.0), (0, 1000.0), (0, 2004.0), (1, 2004.0)]);
    let assessment = assess(&edited, &[], &AssessmentSettings::default());
    for name in ["path_length", "peak_velocity", "movements", "absences", "not_seen_share", "lost_share"] {
        let of = assessment.features.iter().filter(|value| value.feature.name == name);
        let values: Vec<_> = of.map(|value| value.value).collect();
        let still = values.iter().all(|value| value.is_ok_and(|value| value.abs() < 1e-6));
        assert!(values.len() >= 2 && still, "{name}: {values:?}");
    }
}

#[test]
fn stored_diagnostics_give_the_same_reasons_as_the_childs_output() {
    let seen: Vec<SeenRow> = (0..9)
        .map(|frame| SeenRow {
            frame,
            tool: (frame % 2) as u32,
            reason: MissReason::ALL.get(frame as usize).copied(),
            borders_px: None,
            tip_px: None,
        })
        .collect();
    let tools = pair();
    let json = super::super::diagnostics::Diagnostics::new((640, 480), &tools, &seen).to_json().unwrap();
    assert_eq!(unmeasured_of_diagnostics(&json), unmeasured(&seen));
    assert_eq!(unmeasured(&seen).len(), 9, "every reason has its name");
    assert!(unmeasured_of_diagnostics(b"no json").is_empty());
}

#[test]
fn an_edit_is_brought_within_the_recording_or_refused() {
    let (paths, _) = paths();
    let fits = |in_force: Vec<EditChange>, new| {
        check_edit(&paths, &EditsInForce { revision: 1, changes: in_force, box_answer: None }, new)
    };
    let trim = EditChange::Trim;
    assert_eq!(fits(vec![], trim([3.0, 999.0])), Ok(trim([3.0, 249.0 * STEP_S])));
    for (in_force, new) in [
        (vec![], trim([100.0, 200.0])),
        (vec![], trim([0.0, 999.0])),
        (vec![], trim([3.0, 3.5])),
        (vec![trim([0.0, 4.0])], trim([5.0, 9.0])),
        (vec![trim([0.0, 4.0])], trim([3.5, 9.0])),
        (vec![], EditChange::Swap(["orange".to_owned(), "green".to_owned()], [0.0, 5.0])),
        (vec![], EditChange::Swap(pair(), [50.0, 60.0])),
        (vec![], EditChange::Swap(pair(), [3.001, 3.002])),
    ] {
        assert!(fits(in_force.clone(), new.clone()).is_err(), "{in_force:?} {new:?}");
    }
    let (no_rows, free) =
        (SessionPaths { smoothed: vec![], frame_times_s: vec![], ..paths.clone() }, EditsInForce::default());
    assert!(check_edit(&no_rows, &free, trim([1.0, 5.0])).is_err());
    assert_eq!(fits(vec![trim([2.0, 9.0])], trim([1.0, 8.0])), Ok(trim([1.0, 8.0])), "they may overlap");
}

proptest! {
    #[test]
    fn a_swap_made_twice_is_none_and_a_trim_comes_before_or_after(
        from in 0.0..8.0f64, for_s in 1.0..5.0f64, at in 0.0..9.0f64,
    ) {
        let (paths, unmeasured) = paths();
        let swap = EditChange::Swap(pair(), [at, at + 3.0]);
        for changes in [vec![], vec![swap.clone()], vec![EditChange::Trim([from, from + for_s]), swap.clone()]] {
            let mut rows = EditedRows::new(&stored(&paths), PathKind::Smoothed, &changes, 20..230);
            let cuts = rows.cuts().unwrap();
            let whole = apply_edits(&paths, &changes, &unmeasured);
            let within = |time_s: f64| (20..230).contains(&((time_s / STEP_S).round() as u64));
            prop_assert!(cuts.iter().all(|cut| whole.cuts.contains(cut) && within(cut.time_s)));
            let wanted: Vec<Sample> = whole.smoothed.into_iter().filter(|row| (20..230).contains(&row.frame)).collect();
            for _ in 0..2 {
                let read: Vec<Sample> = std::iter::from_fn(|| rows.next_row().unwrap()).collect();
                prop_assert_eq!(&read, &wanted);
                rows.rewind();
            }
        }
        let twice = apply_edits(&paths, &[swap.clone(), swap.clone()], &unmeasured);
        prop_assert_eq!(&twice.smoothed, &paths.smoothed);
        prop_assert_eq!(&twice.tracking, &paths.tracking);
        let trim = EditChange::Trim([from, from + for_s]);
        let orders = [[swap.clone(), trim.clone()], [trim, swap]];
        let both = orders.map(|changes| apply_edits(&paths, &changes, &unmeasured));
        prop_assert_eq!(&both[0], &both[1]);
        // Every frame is measured, bridged or missing, and each gap is missing.
        for tool in &both[0].tracking.as_ref().unwrap().quality.tools {
            let ToolQuality { observed, predicted, missing, .. } = *tool;
            prop_assert_eq!(observed + predicted + missing, both[0].frame_times_s.len() as u64);
            prop_assert_eq!(tool.gaps.iter().map(|gap| gap.last - gap.first + 1).sum::<u64>(), missing);
            prop_assert!(tool.gaps.is_sorted_by(|a, b| a.last < b.first));
        }
    }
}
