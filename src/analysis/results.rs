//! Turns a child's output into rows and files to store: assessed, encoded, and marked with the versions that made it.
//! Stored paths are assessed again in the same way ([`super::rescore`]).

use serde_json::Value;

use super::child::ChildOutput;
use super::child::recording::RecordingOutput;
use super::child::track::TrackOutput;
use super::diagnostics::Diagnostics;
use super::edits;
use super::job_plan::BoxContext;
use super::paths::{self, PathsError, SessionPaths};
use super::stored_palette::store_palette;
use crate::domain::boxes::BoxTool;
use crate::domain::calibration::{CalibrationSource, NewCalibration};
use crate::domain::clock::{RecordingClock, StampFacts};
use crate::domain::edit::EditsInForce;
use crate::domain::evidence::{EvidenceRow, MAX_ROWS};
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::files::camera::{CameraFile, CameraFileError};
use crate::domain::files::quality::QualityDocument;
use crate::domain::job::{SelfTestInput, TrackInput};
use crate::domain::palette::{LabelCount, NewPalette, PaletteAdvice};
use crate::domain::self_test::NewSelfTest;
use crate::domain::session::{FeatureError, FeatureRow, ResultClock, Versions, VideoFacts};
use crate::motion::PIPELINE_VERSION;
use crate::motion::assessment::{AssessmentSettings, assess};
use crate::motion::features::FeatureValue;
use crate::motion::features::errors::ErrorBar;
use crate::motion::quality::{self, QualityInput};
use crate::vision::surroundings::Surroundings;
use crate::vision::tracker::{MotionSettings, Quality, ToolQuality};
use crate::vision::trajectory::{PathKind, SampleState, Trajectory};

/// Why a child's output makes no result, although each record was valid.
#[derive(Debug, thiserror::Error)]
pub(super) enum ProductError {
    /// The child reported that it was done without sending this.
    #[error("the child process ended without sending {0}")]
    Missing(&'static str),
    /// The paths cannot be encoded.
    #[error(transparent)]
    Paths(#[from] PathsError),
    /// The diagnostics or the quality document cannot be encoded.
    #[error("diagnostics cannot be encoded: {0}")]
    Diagnostics(#[from] serde_json::Error),
    /// The colours cannot be encoded.
    #[error("colours cannot be encoded: {0}")]
    Palette(#[from] postcard::Error),
    /// The camera's parameters are invalid.
    #[error("the camera that the child process sent is invalid: {0}")]
    Camera(#[from] CameraFileError),
}

/// The result of tracking, before its files are in the vault.
pub(super) struct TrackResult {
    pub(super) versions: Versions,
    pub(super) edits: u64,
    pub(super) video: VideoFacts,
    pub(super) tools: Vec<String>,
    pub(super) features: Vec<FeatureRow>,
    pub(super) evidence: Vec<EvidenceRow>,
    pub(super) quality: Value,
    pub(super) paths: Vec<u8>,
    pub(super) diagnostics: Vec<u8>,
    pub(super) preview: Option<Vec<u8>>,
    pub(super) surroundings: Option<Surroundings>,
}

impl TrackResult {
    /// Assesses the smoothed path with its edits, and encodes everything else as it was tracked. `edits_clock` is the
    /// factor between the file's stamps and the times in the edits. Takes seconds for an hour of recording: do not call
    /// it on an async thread.
    pub(super) fn new(
        input: &TrackInput,
        tools: Vec<String>,
        known: &BoxContext,
        (edits, edits_clock): (&EditsInForce, f64),
        output: ChildOutput,
    ) -> Result<Self, ProductError> {
        let TrackOutput { clock, recording, raw, filtered, smoothed, quality, surroundings } = output.track;
        let clock = clock.ok_or(ProductError::Missing("how it computed the times"))?;
        let RecordingOutput { size, frames_stated, starts_at_s, times_s, seen, preview, .. } = recording;
        let (width, height) = size.ok_or(ProductError::Missing("a picture size"))?;
        let summary = quality.ok_or(ProductError::Missing("a summary"))?;
        let diagnostics = Diagnostics::new((width, height), &tools, &seen).to_json()?;
        let starts_at_s = starts_at_s.ok_or(ProductError::Missing("the recording's end"))?;
        let video = video_facts((width, height), &times_s, starts_at_s, clock);
        let paths = SessionPaths {
            tools: tools.clone(),
            frame_times_s: times_s,
            raw,
            filtered,
            smoothed,
            tracking: Some(paths::TrackingSummary { quality: summary, frames_expected: frames_stated }),
            cuts: Vec::new(),
        };
        let edits = edits.scaled(clock.factor / edits_clock);
        let edited = edits::apply_edits(&paths, &edits.changes, &edits::unmeasured(&seen));
        let is_trimmed = edits::trimmed_ends(&paths, &edits.changes);
        let AssessmentRows { features, evidence, quality } =
            assess_tracked(&edited, known, surroundings.as_ref(), is_trimmed)?;
        Ok(Self {
            versions: versions(input),
            edits: edits.revision,
            video,
            features,
            evidence,
            quality,
            paths: paths.to_bytes()?,
            diagnostics,
            preview,
            surroundings,
            tools,
        })
    }
}

/// What follows from a session's paths alone.
#[derive(Debug, PartialEq)]
pub(super) struct AssessmentRows {
    pub(super) features: Vec<FeatureRow>,
    pub(super) evidence: Vec<EvidenceRow>,
    pub(super) quality: Value,
}

impl AssessmentRows {
    /// Every feature and its evidence; the values are withheld if the session is refused.
    fn of(path: &Trajectory, tools: &[ToolQuality], is_trimmed: [bool; 2], is_refused: bool, quality: Value) -> Self {
        let assessment =
            assess(path, tools, &AssessmentSettings { is_trimmed, window_s: 0.0, ..AssessmentSettings::default() });
        let assessment = if is_refused { assessment.withheld() } else { assessment };
        Self {
            features: assessment.features.iter().map(|value| feature_row(value, &path.tools)).collect(),
            evidence: assessment.stretches.iter().take(MAX_ROWS).map(|of| EvidenceRow::of(of, &path.tools)).collect(),
            quality,
        }
    }
}

/// Judges and assesses paths that were tracked here, given what stands still in their recording. `is_trimmed` says
/// whether edits cut off the beginning and the end. The same paths and the same context give the same bytes.
pub(super) fn assess_tracked(
    paths: &SessionPaths,
    known: &BoxContext,
    shown: Option<&Surroundings>,
    is_trimmed: [bool; 2],
) -> Result<AssessmentRows, ProductError> {
    let tracking = paths.tracking.as_ref().ok_or(ProductError::Missing("how it was tracked"))?;
    let counts = tracking.quality.quality(&paths.tools);
    let trocars: Vec<_> = counts.tools.iter().map(|tool| tool.fulcrum).collect();
    let smoothed = paths.trajectory(PathKind::Smoothed);
    let figures = quality::measure(&QualityInput {
        smoothed: &smoothed,
        others: Some(paths),
        tracker: Some(&counts),
        motion: MotionSettings::default(),
        calibration_rms_px: known.calibration_rms_px,
        frames_expected: tracking.frames_expected,
        frames_interlaced: Some(tracking.quality.frames_interlaced),
        ports: Some(&known.ports),
        of_box: Some(known.evidence(shown, &trocars)),
    });
    let verdict = quality::judge(&figures);
    let quality = serde_json::to_value(QualityDocument::new(&counts, &figures, &verdict))?;
    Ok(AssessmentRows::of(&smoothed, &counts.tools, is_trimmed, verdict.is_refused(), quality))
}

/// Judges and assesses rows from another tracker. How they were measured is unknown, so the quality gate judges the
/// path alone, and a value has an error bar only where the rows state their uncertainty. `is_trimmed` as for
/// [`assess_tracked`].
pub(super) fn assess_imported(
    path: &Trajectory,
    frames: u64,
    is_trimmed: [bool; 2],
) -> Result<AssessmentRows, ProductError> {
    let figures = quality::measure(&QualityInput::of_path(path));
    let verdict = quality::judge(&figures);
    let of_tool = |(tool, name): (usize, &String)| {
        let count = |state| path.of_tool(tool).filter(|sample| sample.state == state).count() as u64;
        let (observed, predicted) = (count(SampleState::Observed), count(SampleState::Predicted));
        let missing = frames.saturating_sub(observed + predicted);
        ToolQuality { tool: name.clone(), observed, predicted, missing, ..ToolQuality::default() }
    };
    let counts = Quality { frames, tools: path.tools.iter().enumerate().map(of_tool).collect(), light: Vec::new() };
    let quality = serde_json::to_value(QualityDocument::new(&counts, &figures, &verdict))?;
    Ok(AssessmentRows::of(path, &[], is_trimmed, verdict.is_refused(), quality))
}

fn versions(input: &TrackInput) -> Versions {
    let TrackInput { calibration, palette, .. } = *input;
    Versions {
        pipeline: PIPELINE_VERSION.to_owned(),
        tracked_with: None,
        calibration: Some(calibration),
        palette: Some(palette),
        model: None,
    }
}

fn video_facts((width, height): (u32, u32), times_s: &[f64], starts_at_s: f64, applied: RecordingClock) -> VideoFacts {
    let facts = StampFacts::of_times(times_s);
    let StampFacts { rate_hz, duration_s, is_uneven } = facts.before(applied.factor);
    let clock =
        ResultClock { applied, stamped_frame_rate_hz: rate_hz, stamped_duration_s: duration_s, is_uneven, starts_at_s };
    VideoFacts {
        width: Some(width),
        height: Some(height),
        frames: times_s.len() as u64,
        duration_s: facts.duration_s,
        clock: Some(clock),
    }
}

fn feature_row(value: &FeatureValue, tools: &[String]) -> FeatureRow {
    FeatureRow {
        name: value.feature.name.to_owned(),
        title: value.feature.title.to_owned(),
        unit: value.feature.unit.to_owned(),
        tool: value.tool.and_then(|tool| tools.get(tool).cloned()),
        space: value.space.into(),
        value: value.value.map_err(|reason| reason.to_string()),
        error: value.value.ok().map(|_| value.error.map(feature_error).map_err(|reason| reason.to_string())),
    }
}

fn feature_error(ErrorBar { as_measured, sigma, low, high }: ErrorBar) -> FeatureError {
    FeatureError { as_measured, sigma, low, high }
}

/// The colours as a box stores them.
pub(super) fn palette(annotations: &AnnotationsFile, output: ChildOutput) -> Result<NewPalette, ProductError> {
    let palette = output.palette.samples.ok_or(ProductError::Missing("colours"))?;
    let count = |(label, samples)| LabelCount { label, samples };
    Ok(NewPalette {
        tools: annotations.marked_tools().unwrap_or_default().into_iter().map(BoxTool::from).collect(),
        annotations: annotations.clone(),
        counts: palette.counts().into_iter().map(count).collect(),
        samples: store_palette(&palette)?,
        surroundings: output.palette.surroundings,
        report: output.palette.report.ok_or(ProductError::Missing("a report on the colours"))?,
    })
}

/// Which tapes suit the box.
pub(super) fn advice(output: ChildOutput) -> Result<PaletteAdvice, ProductError> {
    output.advice.ok_or(ProductError::Missing("advice on tapes"))
}

/// The camera as a box stores it.
pub(super) fn calibration(is_video: bool, output: ChildOutput) -> Result<NewCalibration, ProductError> {
    let camera_json = output.camera_json.ok_or(ProductError::Missing("a calibration"))?;
    let source = if is_video { CalibrationSource::Video } else { CalibrationSource::Photos };
    Ok(NewCalibration { camera: CameraFile::parse(&camera_json)?, source })
}

/// The self-test as a box stores it.
pub(super) fn self_test(input: &SelfTestInput, output: ChildOutput) -> Result<NewSelfTest, ProductError> {
    let report = output.self_test.ok_or(ProductError::Missing("a self-test"))?;
    Ok(NewSelfTest { calibration: input.calibration, palette: input.palette, person: input.person, report })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::analysis::protocol::QualitySummary;
    use crate::domain::blob::Blob;
    use crate::ids::{CalibrationId, PaletteId, SessionId};
    use crate::vision::covariance::PositionCovariance;
    use crate::vision::tracker::{DiameterBasis, EffectiveDiameter};
    use crate::vision::trajectory::Sample;

    const FRAMES: u64 = 100;

    /// The result for a tool that moves to the right at 20 mm/s and is seen on some frames.
    fn tracked(seen: impl Fn(u64) -> bool) -> TrackResult {
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
        let times_s = (0..FRAMES).map(|frame| frame as f64 * 0.04).collect();
        let (size, starts_at_s) = (Some((1280, 720)), Some(0.0));
        let recording = RecordingOutput { size, starts_at_s, times_s, ..RecordingOutput::default() };
        let (tools, light) = (vec![tool], vec![]);
        let quality = Some(QualitySummary { frames: FRAMES, frames_interlaced: FRAMES / 2, tools, light });
        let clock = Some(RecordingClock::default());
        let track = TrackOutput { clock, recording, smoothed, quality, ..TrackOutput::default() };
        let output = ChildOutput { track, ..ChildOutput::default() };
        let video = Blob::of(b"a recording");
        let (session, calibration, palette) = (SessionId::at(0), CalibrationId::at(0), PaletteId::at(0));
        let known = BoxContext { calibration_rms_px: Some(0.3), ..BoxContext::default() };
        let input = TrackInput { session, video, calibration, palette, time: None, time_revision: 0 };
        let edits = EditsInForce::default();
        TrackResult::new(&input, vec!["orange".into()], &known, (&edits, 1.0), output).unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn stored_paths_are_assessed_again_to_the_same_bytes_and_one_changed_bit_shows() {
        let known = BoxContext { calibration_rms_px: Some(0.3), ..BoxContext::default() };
        let first = tracked(|frame| frame % 17 != 3);
        let stored = SessionPaths::from_bytes(&first.paths).unwrap();
        let again = assess_tracked(&stored, &known, None, [false; 2]).unwrap();
        assert!(first.features.iter().filter(|row| row.error.as_ref().is_some_and(Result::is_ok)).count() > 5);
        assert_eq!(format!("{:?}", again.features), format!("{:?}", first.features));
        assert_eq!(again.quality.to_string(), first.quality.to_string());

        let mut nudged = stored.clone();
        nudged.smoothed[40].tip_mm[0] += 1e-9;
        assert_ne!(
            assess_tracked(&nudged, &known, None, [false; 2]).unwrap().features,
            first.features,
            "a changed path gives other features"
        );
        let mut forgetful = stored.clone();
        forgetful.tracking.as_mut().unwrap().quality.frames_interlaced = 0;
        assert_ne!(
            assess_tracked(&forgetful, &known, None, [false; 2]).unwrap().quality,
            first.quality,
            "a changed summary gives another quality"
        );
        let untracked = SessionPaths { tracking: None, ..stored };
        assert!(
            assess_tracked(&untracked, &known, None, [false; 2]).is_err(),
            "paths without a tracker's summary cannot be assessed"
        );
    }

    #[test]
    fn a_refused_session_is_stored_without_a_single_value() {
        let (seen, hidden) = (tracked(|_| true), tracked(|frame| frame % 5 < 2));
        let values = |tracked: &TrackResult| tracked.features.iter().filter(|feature| feature.value.is_ok()).count();
        assert_eq!(
            (&seen.quality["verdict"], values(&seen) > 10),
            (&"usable_with_care".into(), true),
            "it ends in motion"
        );
        assert_eq!((&hidden.quality["verdict"], values(&hidden)), (&"refused".into(), 0));
        assert_eq!(seen.quality["recording"]["calibration_rms_px"], 0.3);
        assert_eq!(seen.quality["recording"]["interlaced_share"], 0.5);
        assert_eq!(hidden.quality["reasons"][0]["name"], "coverage");
        assert_eq!(hidden.features.len(), seen.features.len(), "each feature gives the reason for its missing value");
    }
}
