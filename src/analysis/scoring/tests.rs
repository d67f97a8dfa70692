use nalgebra::{Point3, Vector3};

use super::*;
use crate::analysis::paths::TrackingSummary;
use crate::analysis::protocol::QualitySummary;
use crate::vision::covariance::PositionCovariance;
use crate::vision::tracker::{DiameterBasis, EffectiveDiameter};
use crate::vision::trajectory::Sample;

const FRAMES: u64 = 100;

/// A tool that moves to the right at 20 mm/s and is seen on some frames.
fn tracked(seen: impl Fn(u64) -> bool) -> SessionPaths {
    let row = |frame: u64| Sample {
        frame,
        time_s: frame as f64 * 0.04,
        tool: 0,
        tip_mm: Point3::new(0.8 * frame as f64, 0.0, 150.0),
        velocity_mm_s: Some(Vector3::new(20.0, 0.0, 0.0)),
        axis: None,
        tip_px: None,
        covariance_mm2: Some(PositionCovariance::from_sigmas(0.1, 0.5)),
        state: SampleState::Observed,
    };
    let smoothed: Vec<Sample> = (0..FRAMES).filter(|frame| seen(*frame)).map(row).collect();
    let observed = smoothed.len() as u64;
    let tool = ToolQuality {
        observed,
        missing: FRAMES - observed,
        border_residual_px: Some(0.2),
        transient_depth_sigma_mm: Some(0.3),
        effective_diameter: Some(EffectiveDiameter { mm: 5.02, sigma_mm: 0.03, basis: DiameterBasis::Session }),
        ..ToolQuality::default()
    };
    let quality = QualitySummary {
        frames: FRAMES,
        frames_interlaced: FRAMES / 2,
        tools: vec![tool],
        light: Vec::new(),
        view_shifts: Vec::new(),
    };
    SessionPaths {
        tools: vec!["orange".into()],
        frame_times_s: (0..FRAMES).map(|frame| frame as f64 * 0.04).collect(),
        raw: Vec::new(),
        filtered: Vec::new(),
        smoothed,
        tracking: Some(TrackingSummary { quality, frames_expected: None }),
        cuts: Vec::new(),
    }
}

/// The score of these paths after they were stored and read again.
fn score(paths: &SessionPaths) -> Result<ScoreRows, ScoringError> {
    let stored = SessionPaths::from_bytes(&paths.to_bytes().unwrap()).unwrap();
    let known = BoxContext { calibration_rms_px: Some(0.3), ..BoxContext::default() };
    score_tracked(stored, &Unmeasured::new(), (&known, None), &EditsInForce::default())
}

#[test]
fn the_same_paths_give_the_same_bytes_and_one_changed_bit_shows() {
    let paths = tracked(|frame| frame % 17 != 3);
    let [first, again] = [score(&paths).unwrap(), score(&paths).unwrap()];
    assert!(first.features.iter().filter(|row| row.error.as_ref().is_some_and(Result::is_ok)).count() > 5);
    assert_eq!(format!("{:?}", again.features), format!("{:?}", first.features));
    assert_eq!(again.quality.to_string(), first.quality.to_string());

    let mut nudged = paths.clone();
    nudged.smoothed[40].tip_mm[0] += 1e-9;
    assert_ne!(score(&nudged).unwrap().features, first.features, "a changed path gives other features");
    let mut forgetful = paths.clone();
    forgetful.tracking.as_mut().unwrap().quality.frames_interlaced = 0;
    assert_ne!(score(&forgetful).unwrap().quality, first.quality, "a changed summary gives another quality");
    let untracked = SessionPaths { tracking: None, ..paths };
    assert!(matches!(score(&untracked), Err(ScoringError::NoTrackingSummary)));
}

#[test]
fn a_refused_session_has_not_a_single_value() {
    let (seen, hidden) = (score(&tracked(|_| true)).unwrap(), score(&tracked(|frame| frame % 5 < 2)).unwrap());
    let values = |score: &ScoreRows| score.features.iter().filter(|feature| feature.value.is_ok()).count();
    assert_eq!((&seen.quality["verdict"], values(&seen) > 10), (&"usable_with_care".into(), true), "it ends in motion");
    assert_eq!((&hidden.quality["verdict"], values(&hidden)), (&"refused".into(), 0));
    assert_eq!(seen.quality["recording"]["calibration_rms_px"], 0.3);
    assert_eq!(seen.quality["recording"]["interlaced_share"], 0.5);
    assert_eq!(hidden.quality["reasons"][0]["name"], "coverage");
    assert_eq!(hidden.features.len(), seen.features.len(), "each feature gives the reason for its missing value");
}
