//! From what a child said to what is stored: assessed, coded, named by the versions that made it.

use serde_json::{Value, json};

use super::diagnostics::Diagnostics;
use super::paths::{Paths, PathsError};
use super::protocol::{PaletteShape, QualityShape, ToolQualityShape, encode};
use super::receipt::Heard;
use crate::domain::boxes::BoxTool;
use crate::domain::calibration::{CalibrationSource, NewCalibration};
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::files::camera::{CameraFile, CameraFileError};
use crate::domain::job::TrackInput;
use crate::domain::palette::{LabelCount, NewPalette};
use crate::domain::session::{FeatureRow, FeatureSpace, Versions, VideoFacts};
use crate::pipeline::PIPELINE_VERSION;
use crate::pipeline::assessment::{AssessmentSettings, assess};
use crate::pipeline::features::{FeatureValue, Space};
use crate::pipeline::reason::Reason;
use crate::pipeline::trajectory::Kind;

/// Why what a child said makes no result, although each record was in order.
#[derive(Debug, thiserror::Error)]
pub(super) enum ProductError {
    /// It ended as done without saying this.
    #[error("the child ended without {0}")]
    Missing(&'static str),
    /// Paths that cannot be coded.
    #[error(transparent)]
    Paths(#[from] PathsError),
    /// Diagnostics that cannot be coded.
    #[error("diagnostics cannot be coded: {0}")]
    Diagnostics(#[from] serde_json::Error),
    /// Colours that cannot be coded.
    #[error("colours cannot be coded: {0}")]
    Palette(#[from] postcard::Error),
    /// A camera that cannot be.
    #[error("the child's camera: {0}")]
    Camera(#[from] CameraFileError),
}

/// What tracking gave, but for its files' places in the vault.
pub(super) struct Tracked {
    pub(super) versions: Versions,
    pub(super) video: VideoFacts,
    pub(super) tools: Vec<String>,
    pub(super) features: Vec<FeatureRow>,
    pub(super) quality: Value,
    pub(super) paths: Vec<u8>,
    pub(super) diagnostics: Vec<u8>,
    pub(super) preview: Option<Vec<u8>>,
}

impl Tracked {
    /// Assesses the smoothed path and codes the rest. Takes a while for an hour of recording: not for an async thread.
    pub(super) fn new(input: &TrackInput, tools: Vec<String>, heard: Heard) -> Result<Self, ProductError> {
        let (width, height) = heard.size.ok_or(ProductError::Missing("a picture size"))?;
        let quality = heard.quality.ok_or(ProductError::Missing("a summary"))?;
        let diagnostics = Diagnostics::new((width, height), &tools, &heard.seen).to_json()?;
        let video = facts(width, height, &heard.times_s);
        let paths = Paths {
            tools: tools.clone(),
            frame_times_s: heard.times_s,
            raw: heard.raw,
            filtered: heard.filtered,
            smoothed: heard.smoothed,
        };
        Ok(Self {
            versions: versions(input),
            video,
            features: features(&paths),
            quality: quality_document(&quality, &tools),
            paths: paths.to_bytes()?,
            diagnostics,
            preview: heard.preview,
            tools,
        })
    }
}

fn versions(input: &TrackInput) -> Versions {
    let TrackInput { calibration, palette, .. } = *input;
    Versions { pipeline: PIPELINE_VERSION.to_owned(), calibration, palette, model: None }
}

fn facts(width: u32, height: u32, times_s: &[f64]) -> VideoFacts {
    let duration_s = times_s.last().zip(times_s.first()).map_or(0.0, |(last, first)| last - first);
    VideoFacts { width, height, frames: times_s.len() as u64, duration_s }
}

fn features(paths: &Paths) -> Vec<FeatureRow> {
    let assessment = assess(&paths.trajectory(Kind::Smoothed), &AssessmentSettings::default());
    assessment.features.iter().map(|value| feature_row(value, &paths.tools)).collect()
}

fn feature_row(value: &FeatureValue, tools: &[String]) -> FeatureRow {
    FeatureRow {
        name: value.feature.name.to_owned(),
        title: value.feature.title.to_owned(),
        unit: value.feature.unit.to_owned(),
        tool: value.tool.and_then(|tool| tools.get(tool).cloned()),
        space: match value.space {
            Space::ThreeD => FeatureSpace::Space3d,
            Space::Image => FeatureSpace::Image,
        },
        value: value.value.map_err(|reason| reason.to_string()),
    }
}

fn quality_document(quality: &QualityShape, tools: &[String]) -> Value {
    let tool = |(shape, name): (&ToolQualityShape, &String)| {
        let [observed, predicted, missing] = shape.observed_predicted_missing;
        let reasons: serde_json::Map<String, Value> =
            shape.reasons.iter().map(|&(reason, n)| (Reason::from(reason).name().to_owned(), n.into())).collect();
        json!({
            "tool": name, "observed": observed, "predicted": predicted, "missing": missing, "reasons": reasons,
            "border_residual_px": shape.border_residual_px,
        })
    };
    let tools: Vec<Value> = quality.tools.iter().zip(tools).map(tool).collect();
    json!({ "frames": quality.frames, "tools": tools })
}

/// Colours as a box keeps them.
pub(super) fn palette(annotations: &AnnotationsFile, heard: Heard) -> Result<NewPalette, ProductError> {
    let palette: PaletteShape = heard.palette.ok_or(ProductError::Missing("colours"))?;
    let count = |(label, samples)| LabelCount { label, samples };
    Ok(NewPalette {
        tools: annotations.marked_tools().unwrap_or_default().into_iter().map(BoxTool::from).collect(),
        annotations: annotations.clone(),
        counts: palette.counts().into_iter().map(count).collect(),
        samples: encode(&palette)?,
        report: heard.palette_report.ok_or(ProductError::Missing("a report on the colours"))?,
    })
}

/// A camera as a box keeps it.
pub(super) fn calibration(is_video: bool, heard: Heard) -> Result<NewCalibration, ProductError> {
    let shape = heard.calibration.ok_or(ProductError::Missing("a calibration"))?;
    let source = if is_video { CalibrationSource::Video } else { CalibrationSource::Photos };
    Ok(NewCalibration { camera: CameraFile::parse(&shape.camera_json)?, source })
}
