//! Turns a child's output into rows and files to store: encoded, and marked with the versions that made it.

use super::child::ChildOutput;
use super::child::recording::RecordingOutput;
use super::child::score::{ImportedRows, ScoreOutput};
use super::child::track::TrackOutput;
use super::diagnostics::Diagnostics;
use super::paths::{self, PathsError, SessionPaths};
use super::scoring::ScoreRows;
use super::stored_palette::store_palette;
use crate::domain::boxes::BoxTool;
use crate::domain::calibration::{CalibrationSource, NewCalibration};
use crate::domain::clock::{RecordingClock, StampFacts};
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::files::camera::{CameraFile, CameraFileError};
use crate::domain::job::{SelfTestInput, TrackInput};
use crate::domain::palette::{LabelCount, NewPalette, PaletteAdvice};
use crate::domain::self_test::NewSelfTest;
use crate::domain::session::{ResultClock, Versions, VideoFacts};
use crate::motion::PIPELINE_VERSION;
use crate::vision::surroundings::Surroundings;

/// Why a child's output makes no result, although each record was valid.
#[derive(Debug, thiserror::Error)]
pub(super) enum ProductError {
    /// The child reported that it was done without sending this.
    #[error("the child process ended without sending {0}")]
    Missing(&'static str),
    /// The paths cannot be encoded.
    #[error(transparent)]
    Paths(#[from] PathsError),
    /// The diagnostics cannot be encoded.
    #[error("diagnostics cannot be encoded: {0}")]
    Diagnostics(#[from] serde_json::Error),
    /// The colours cannot be encoded.
    #[error("colours cannot be encoded: {0}")]
    Palette(#[from] postcard::Error),
    /// The camera's parameters are invalid.
    #[error("the camera that the child process sent is invalid: {0}")]
    Camera(#[from] CameraFileError),
}

/// The result of tracking, before it is scored.
pub(super) struct TrackResult {
    pub(super) versions: Versions,
    pub(super) video: VideoFacts,
    pub(super) tools: Vec<String>,
    pub(super) surroundings: Option<Surroundings>,
    pub(super) files: TrackFiles,
}

/// The content of the files that a tracked session stores.
pub(super) struct TrackFiles {
    pub(super) paths: Vec<u8>,
    pub(super) diagnostics: Vec<u8>,
    pub(super) preview: Option<Vec<u8>>,
}

impl TrackResult {
    /// Encodes what was tracked. Takes a second for an hour of recording: do not call it on an async thread.
    pub(super) fn new(input: &TrackInput, tools: Vec<String>, output: ChildOutput) -> Result<Self, ProductError> {
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
        let files = TrackFiles { paths: paths.to_bytes()?, diagnostics, preview };
        Ok(Self { versions: versions(input), video, tools, surroundings, files })
    }
}

/// The score of a path.
pub(super) fn score(output: ScoreOutput) -> Result<ScoreRows, ProductError> {
    Ok(ScoreRows {
        features: output.features.ok_or(ProductError::Missing("features"))?,
        evidence: output.evidence.ok_or(ProductError::Missing("the stretches behind the features"))?,
        quality: output.quality.ok_or(ProductError::Missing("a quality verdict"))?,
    })
}

/// The score of a table, and its rows.
pub(super) fn imported_score(mut output: ScoreOutput) -> Result<(ScoreRows, ImportedRows), ProductError> {
    let imported = output.imported.take().ok_or(ProductError::Missing("the table's rows"))?;
    Ok((score(output)?, imported))
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
    Ok(NewCalibration { camera: CameraFile::parse(&camera_json)?, source, valid_from_ms: None })
}

/// The self-test as a box stores it.
pub(super) fn self_test(input: &SelfTestInput, output: ChildOutput) -> Result<NewSelfTest, ProductError> {
    let report = output.self_test.ok_or(ProductError::Missing("a self-test"))?;
    Ok(NewSelfTest { calibration: input.calibration, palette: input.palette, person: input.person, report })
}
