//! Whole features against closed forms and laws, through [`assess`] as all callers use it; and the paths that the tests
//! share.

mod about_trocar;
mod attempt;
mod closed_forms;
mod errors;
mod laws;
mod not_enough;
mod view;

use std::f64::consts::{PI, TAU};

use nalgebra::Point3;

use super::*;
use crate::motion::assessment::{Assessment, AssessmentSettings, assess};
use crate::vision::trajectory::{Sample, SampleState, Trajectory};

/// A tip over time, mm.
type Path<'a> = dyn Fn(f64) -> Point3<f64> + 'a;

fn sample(frame: u64, time_s: f64, tool: usize, tip_mm: Point3<f64>) -> Sample {
    Sample {
        frame,
        time_s,
        tool,
        tip_mm,
        velocity_mm_s: None,
        axis: None,
        tip_px: None,
        covariance_mm2: None,
        state: SampleState::Observed,
    }
}

/// Frame times of a recording from 0 to `end_s`.
fn times(fps: f64, end_s: f64) -> Vec<f64> {
    (0..=(end_s * fps).round() as u32).map(|i| f64::from(i) / fps).collect()
}

fn record(times: &[f64], paths: &[&Path<'_>]) -> Trajectory {
    let rows = times.iter().enumerate();
    let samples = rows.flat_map(|(frame, t)| {
        paths.iter().enumerate().map(move |(tool, path)| sample(frame as u64, *t, tool, path(*t)))
    });
    let tools = (0..paths.len()).map(|tool| format!("tool {tool}")).collect();
    Trajectory { tools, samples: samples.collect(), frame_times_s: times.to_vec(), cuts: Vec::new() }
}

fn score(trajectory: &Trajectory) -> Assessment {
    assess(trajectory, &[], &AssessmentSettings::default())
}

fn get(assessment: &Assessment, name: &str, tool: Option<usize>, space: Space) -> Result<f64, NotEnough> {
    let mut found = assessment.features.iter().filter(|v| (v.feature.name, v.tool, v.space) == (name, tool, space));
    found.next().unwrap_or_else(|| panic!("no {name} of {tool:?} in {space:?}")).value
}

fn of_first(assessment: &Assessment, name: &str) -> f64 {
    let space = find(name).unwrap().spaces[0];
    get(assessment, name, Some(0), space).unwrap_or_else(|reason| panic!("{name}: {reason}"))
}

#[track_caller]
fn near(value: f64, expected: f64, relative: f64) {
    assert!((value - expected).abs() <= relative * expected.abs().max(1e-9), "{value} instead of {expected}");
}

/// Position along a minimum-jerk stroke, 0 to 1.
fn stroke(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
}

/// A square of 60 mm: each side is a minimum-jerk stroke of 3 s after a rest of 1.5 s at its corner; `laps` times
/// round.
fn square(tremor_mm: f64) -> impl Fn(f64) -> Point3<f64> {
    let corners = [(0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (0.0, 60.0)];
    move |t| {
        let side = (t / 4.5).floor();
        let u = ((t - 4.5 * side - 1.5) / 3.0).clamp(0.0, 1.0);
        let (from, to) = (corners[side as usize % 4], corners[(side as usize + 1) % 4]);
        let fade = (PI * u).sin().powi(4);
        let (du, dv) = (fade * (TAU * 2.3 * t).sin(), fade * (TAU * 3.1 * t).cos());
        let along = |a: f64, b: f64| a + (b - a) * stroke(u);
        Point3::new(along(from.0, to.0) + tremor_mm * du, along(from.1, to.1) + tremor_mm * dv, 180.0)
    }
}

/// A wandering path of a few slow and fast oscillations.
fn wander(seed: [f64; 4]) -> impl Fn(f64) -> Point3<f64> {
    move |t| {
        let wave = |k: f64| {
            25.0 * (TAU * (0.11 + 0.05 * k) * t + seed[0] * k).sin() + 6.0 * (TAU * 0.7 * t + seed[1] + k).sin()
        };
        Point3::new(wave(1.0) * seed[2], wave(2.0), 180.0 + wave(3.0) * seed[3])
    }
}
