//! The features of absences, with their causes.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::*;
use crate::vision::reason::MissReason;
use crate::vision::tracker::{Absence, Gap, ToolQuality};

const FPS: f64 = 25.0;

/// A tool that circles for 60 s, and another at rest at a place; the first is not seen for some stretches, s.
fn with_gaps(gaps_s: &[(f64, f64)], other: Point3<f64>) -> Trajectory {
    let circle = |t: f64| Point3::new(30.0 * (0.8 * t).cos(), 30.0 * (0.8 * t).sin(), 180.0);
    let mut trajectory = record(&times(FPS, 60.0), &[&circle, &move |_| other]);
    let is_gap = |s: &Sample| s.tool == 0 && gaps_s.iter().any(|(from, until)| (*from..*until).contains(&s.time_s));
    trajectory.samples.retain(|sample| !is_gap(sample));
    trajectory.samples.iter_mut().for_each(|sample| sample.axis = Some(Vector3::new(0.0, -1.0, 0.0)));
    trajectory
}

fn gaps_in_record(gaps_s: &[(f64, f64)], absence: Absence) -> Vec<ToolQuality> {
    let frame = |time_s: f64| (time_s * FPS).round() as u64;
    let gap = |(from, until): &(f64, f64)| Gap { first: frame(*from), last: frame(*until) - 1, absence };
    let tool =
        ToolQuality { gaps: gaps_s.iter().map(gap).collect(), reasons: BTreeMap::new(), ..ToolQuality::default() };
    vec![tool, ToolQuality::default()]
}

fn shares(trajectory: &Trajectory, tools: &[ToolQuality]) -> [Result<f64, NotEnough>; 3] {
    let got = assess(trajectory, tools, &AssessmentSettings::default());
    ["left_view_share", "hidden_share", "lost_share"].map(|name| get(&got, name, Some(0), Space::ThreeD))
}

const ASIDE: Point3<f64> = Point3::new(-90.0, 0.0, 120.0);
const GAPS: [(f64, f64); 2] = [(10.0, 14.0), (30.0, 38.0)];

#[test]
fn absences_are_split_by_cause() {
    let trajectory = with_gaps(&GAPS, ASIDE);
    let left = shares(&trajectory, &gaps_in_record(&GAPS, Absence::LeftView)).map(Result::unwrap);
    let lost =
        shares(&trajectory, &gaps_in_record(&GAPS, Absence::Lost(MissReason::BordersNotFound))).map(Result::unwrap);
    let not_seen = of_first(&score(&trajectory), "not_seen_share");
    near(not_seen, 0.2, 1e-2);
    near(left[0], not_seen, 1e-9);
    near(lost[2], not_seen, 1e-9);
    assert_eq!([left[1], left[2], lost[0], lost[1]], [0.0; 4]);
}

#[test]
fn a_tool_behind_the_other_is_neither_gone_nor_lost() {
    let gap = [(7.4, 8.2)]; // at 7.85 s it is at (30, 0, 180)
    let lost = gaps_in_record(&gap, Absence::Lost(MissReason::BordersNotFound));
    let [left, hidden, lost_by_tracker] = shares(&with_gaps(&gap, Point3::new(20.0, -20.0, 120.0)), &lost);
    assert!(left == Ok(0.0) && lost_by_tracker == Ok(0.0), "{left:?} {lost_by_tracker:?}");
    near(hidden.unwrap(), 0.8 / 60.0, 0.1);
    let [_, hidden, lost_by_tracker] = shares(&with_gaps(&gap, ASIDE), &lost);
    assert!(hidden == Ok(0.0) && lost_by_tracker.unwrap() > 0.01, "{hidden:?} {lost_by_tracker:?}");
}

#[test]
fn a_path_alone_shows_how_often_and_how_long_but_not_why() {
    let got = score(&with_gaps(&GAPS, ASIDE));
    assert_eq!(of_first(&got, "absences"), 2.0);
    near(of_first(&got, "longest_absence"), 8.0, 1e-2);
    for name in ["left_view_share", "hidden_share", "lost_share"] {
        assert_eq!(get(&got, name, Some(0), Space::ThreeD), Err(NotEnough::NoReasons));
        assert_eq!(get(&got, name, Some(1), Space::ThreeD), Ok(0.0), "it was always seen");
    }
}

#[test]
fn a_tool_that_never_came_was_out_of_view_all_the_time() {
    let mut trajectory = with_gaps(&[], ASIDE);
    trajectory.samples.retain(|sample| sample.tool == 1 || sample.time_s < 0.0);
    trajectory.samples.iter_mut().for_each(|sample| sample.tip_mm.x += 20.0 * sample.time_s.sin());
    let never = gaps_in_record(&[(0.0, 60.04)], Absence::LeftView);
    assert_eq!(shares(&trajectory, &never), [Ok(1.0), Ok(0.0), Ok(0.0)]);
}
