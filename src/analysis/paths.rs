//! The stored form of a session's three paths and of the tracker's summary: one blob, exact to the last bit, read back
//! one path at a time. It holds everything that a score depends on, so scoring it again gives the same bytes.
//! [`stored_rows`](super::stored_rows) reads single rows of it without the whole file in memory.

use std::collections::BTreeMap;

use nalgebra::{Point2, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::protocol::{QualitySummary, decode, encode};
use crate::vision::covariance::PositionCovariance;
use crate::vision::pose::fulcrum::Fulcrum;
use crate::vision::reason::MissReason;
use crate::vision::segmentation::palette::ColourSeparation;
use crate::vision::tracker::{EffectiveDiameter, Gap, LightSample, ToolQuality};
pub use crate::vision::trajectory::PathKind;
use crate::vision::trajectory::{self, Cut, Sample, SampleState, Trajectory};

/// Magic bytes at the start of every blob; the last byte is the version of the format.
pub(super) const MAGIC: [u8; 8] = *b"trocarP\x05";

/// Magic bytes of the format whose summary has no shifts of the view.
pub(super) const MAGIC_WITHOUT_VIEW: [u8; 8] = *b"trocarP\x04";

/// Magic bytes of the format whose tools have no size mismatch: written up to pipeline version 14.
pub(super) const MAGIC_WITHOUT_SIZES: [u8; 8] = *b"trocarP\x03";

/// Magic bytes of the format whose rows hold two standard deviations instead of a covariance.
pub(super) const MAGIC_WITH_SIGMAS: [u8; 8] = *b"trocarP\x02";

/// Magic bytes of that format without the tracker's summary: written up to pipeline version 8.
pub(super) const MAGIC_WITHOUT_TRACKING: [u8; 8] = *b"trocarP\x01";

/// Why a blob cannot be read or written as paths.
#[derive(Debug, thiserror::Error)]
pub enum PathsError {
    /// Another kind of file, or another version of this format.
    #[error("not a file of paths of this version")]
    NotPaths,
    /// The magic bytes are right, but the content is inconsistent.
    #[error("a damaged file of paths: {0}")]
    Damaged(postcard::Error),
    /// The rows of a path are not in order of frame and tool.
    #[error("a damaged file of paths: its rows are out of order")]
    OutOfOrder,
    /// The file cannot be read.
    #[error("a file of paths cannot be read: {0}")]
    Unreadable(#[from] std::io::Error),
    /// There is too little memory to write it.
    #[error("paths cannot be encoded: {0}")]
    Encoding(postcard::Error),
}

/// A session's paths.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SessionPaths {
    /// Names of the tools; rows refer to them by index.
    pub tools: Vec<String>,
    /// Presentation time of every decoded frame, s.
    pub frame_times_s: Vec<f64>,
    /// Unfiltered path.
    pub raw: Vec<Sample>,
    /// Path from the causal filter.
    pub filtered: Vec<Sample>,
    /// Path from the smoother.
    pub smoothed: Vec<Sample>,
    /// The tracker's summary; `None` if another tracker made the path, or if the blob is older than this field.
    pub tracking: Option<TrackingSummary>,
    /// Where edits exchange two tools' names; stored paths have none.
    #[serde(skip)]
    pub cuts: Vec<Cut>,
}

/// The part of the tracker's summary that the score depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackingSummary {
    /// Counts, gaps, colours, light.
    pub quality: QualitySummary,
    /// Number of frames that the file should give, if its container states it.
    pub frames_expected: Option<u64>,
}

impl SessionPaths {
    /// Encodes the paths as a blob.
    pub fn to_bytes(&self) -> Result<Vec<u8>, PathsError> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(encode(self).map_err(PathsError::Encoding)?);
        Ok(bytes)
    }

    /// Decodes a blob.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, PathsError> {
        let decoded = if let Some(content) = bytes.strip_prefix(&MAGIC) {
            decode(content)
        } else if let Some(content) = bytes.strip_prefix(&MAGIC_WITHOUT_VIEW) {
            decode(content).map(OlderPaths::<Sample, ToolQuality>::into_paths)
        } else if let Some(content) = bytes.strip_prefix(&MAGIC_WITHOUT_SIZES) {
            decode(content).map(OlderPaths::<Sample, OlderToolQuality>::into_paths)
        } else if let Some(content) = bytes.strip_prefix(&MAGIC_WITH_SIGMAS) {
            decode(content).map(OlderPaths::<SampleWithSigmas, OlderToolQuality>::into_paths)
        } else {
            let content = bytes.strip_prefix(&MAGIC_WITHOUT_TRACKING).ok_or(PathsError::NotPaths)?;
            let content = [content, &[0]].concat(); // `None` is one zero byte
            decode(&content).map(OlderPaths::<SampleWithSigmas, OlderToolQuality>::into_paths)
        };
        decoded.map_err(PathsError::Damaged)
    }

    /// One of the paths as the pipeline's type.
    pub fn trajectory(&self, kind: PathKind) -> Trajectory {
        Trajectory {
            tools: self.tools.clone(),
            samples: self.rows(kind).to_vec(),
            frame_times_s: self.frame_times_s.clone(),
            cuts: self.cuts.clone(),
        }
    }

    fn rows(&self, kind: PathKind) -> &[Sample] {
        match kind {
            PathKind::Raw => &self.raw,
            PathKind::Filtered => &self.filtered,
            PathKind::Smoothed => &self.smoothed,
        }
    }
}

/// [`SessionPaths`] as older versions stored them, with rows of type `S` and qualities of tools of type `Q`.
#[derive(Deserialize)]
struct OlderPaths<S, Q> {
    tools: Vec<String>,
    frame_times_s: Vec<f64>,
    /// Raw, filtered and smoothed.
    paths: [Vec<S>; 3],
    tracking: Option<OlderTracking<Q>>,
}

impl<S: Into<Sample>, Q: Into<ToolQuality>> OlderPaths<S, Q> {
    fn into_paths(self) -> SessionPaths {
        let Self { tools, frame_times_s, paths, tracking } = self;
        let [raw, filtered, smoothed] = paths.map(|path| path.into_iter().map(S::into).collect());
        let tracking = tracking.map(TrackingSummary::from);
        SessionPaths { tools, frame_times_s, raw, filtered, smoothed, tracking, cuts: Vec::new() }
    }
}

/// A [`TrackingSummary`] as older versions stored it.
#[derive(Deserialize)]
struct OlderTracking<Q> {
    frames: u64,
    frames_interlaced: u64,
    tools: Vec<Q>,
    light: Vec<LightSample>,
    frames_expected: Option<u64>,
}

impl<Q: Into<ToolQuality>> From<OlderTracking<Q>> for TrackingSummary {
    fn from(stored: OlderTracking<Q>) -> Self {
        let OlderTracking { frames, frames_interlaced, tools, light, frames_expected } = stored;
        let tools = tools.into_iter().map(Q::into).collect();
        let quality = QualitySummary { frames, frames_interlaced, tools, light, view_shifts: Vec::new() };
        Self { quality, frames_expected }
    }
}

/// A [`ToolQuality`] as older versions stored it.
#[derive(Deserialize)]
struct OlderToolQuality {
    observed: u64,
    predicted: u64,
    missing: u64,
    reasons: BTreeMap<MissReason, u64>,
    border_residual_px: Option<f64>,
    transient_depth_sigma_mm: Option<f64>,
    effective_diameter: Option<EffectiveDiameter>,
    gaps: Vec<Gap>,
    colour: ColourSeparation,
    fulcrum: Option<Fulcrum>,
}

impl From<OlderToolQuality> for ToolQuality {
    fn from(stored: OlderToolQuality) -> Self {
        let OlderToolQuality { observed, predicted, missing, reasons, border_residual_px, .. } = stored;
        let OlderToolQuality { transient_depth_sigma_mm, effective_diameter, gaps, colour, fulcrum, .. } = stored;
        Self {
            tool: String::new(),
            observed,
            predicted,
            missing,
            reasons,
            border_residual_px,
            transient_depth_sigma_mm,
            effective_diameter,
            gaps,
            colour,
            fulcrum,
            size_mismatch: None,
        }
    }
}

/// A [`Sample`] as older versions stored it.
#[derive(Deserialize)]
pub(super) struct SampleWithSigmas {
    frame: u64,
    time_s: f64,
    tool: usize,
    tip_mm: Point3<f64>,
    velocity_mm_s: Option<Vector3<f64>>,
    axis: Option<Vector3<f64>>,
    tip_px: Option<Point2<f64>>,
    sigma_xy_mm: Option<f64>,
    sigma_z_mm: Option<f64>,
    state: SampleState,
}

impl From<SampleWithSigmas> for Sample {
    fn from(stored: SampleWithSigmas) -> Self {
        let SampleWithSigmas { frame, time_s, tool, tip_mm, velocity_mm_s, axis, tip_px, state, .. } = stored;
        let sigmas = stored.sigma_xy_mm.zip(stored.sigma_z_mm);
        let covariance_mm2 = sigmas.map(|(across, depth)| PositionCovariance::from_sigmas(across, depth));
        Self { frame, time_s, tool, tip_mm, velocity_mm_s, axis, tip_px, covariance_mm2, state }
    }
}

impl trajectory::PathSource for SessionPaths {
    fn path(&self, kind: PathKind, tool: usize) -> Vec<Sample> {
        self.rows(kind).iter().filter(|row| row.tool == tool).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    use super::*;
    use crate::vision::pose::size_check::SizeMismatch;
    use crate::vision::segmentation::palette::Margin;
    use crate::vision::surroundings::ViewShift;
    use crate::vision::tracker::{Absence, DiameterBasis};

    fn row() -> impl Strategy<Value = Sample> {
        let three = || prop::array::uniform3(-1e6..1e6f64);
        (any::<u32>(), three(), prop::option::of(three()), prop::option::of(0.0..9.0), any::<bool>()).prop_map(
            |(frame, tip_mm, axis, sigma, observed)| Sample {
                frame: frame.into(),
                time_s: f64::from(frame) / 30.0,
                tool: 0,
                tip_mm: Point3::from(tip_mm),
                velocity_mm_s: axis.map(Vector3::from),
                axis: axis.map(Vector3::from),
                tip_px: None,
                covariance_mm2: sigma.map(|sigma| PositionCovariance::from_sigmas(sigma, 3.0 * sigma)),
                state: if observed { SampleState::Observed } else { SampleState::Predicted },
            },
        )
    }

    /// A row as older versions stored it.
    fn with_sigmas(row: &Sample) -> impl Serialize + use<> {
        let Sample { frame, time_s, tool, tip_mm, velocity_mm_s, axis, tip_px, state, .. } = *row;
        ((frame, time_s, tool, tip_mm, velocity_mm_s, axis, tip_px), row.sigma_xy_mm(), row.sigma_z_mm(), state)
    }

    #[test]
    fn a_stored_row_is_its_numbers_in_a_fixed_order() {
        let row = Sample {
            frame: 300,
            time_s: 10.0,
            tool: 1,
            tip_mm: Point3::new(1.0, 2.0, 3.0),
            velocity_mm_s: Some(Vector3::new(4.0, 5.0, 6.0)),
            axis: None,
            tip_px: Some([7.0, 8.0].into()),
            covariance_mm2: Some(PositionCovariance::from_upper([9.0, 1.0, 2.0, 10.0, 3.0, 11.0])),
            state: SampleState::Observed,
        };
        let none = None::<[f64; 3]>;
        let start = (300u64, 10.0, 1u32, [1.0, 2.0, 3.0], Some([4.0, 5.0, 6.0]), none, Some([7.0, 8.0]));
        let stored = |is_observed: bool| encode(&(start, Some([9.0, 1.0, 2.0, 10.0, 3.0, 11.0]), is_observed)).unwrap();
        assert_eq!(encode(&row).unwrap(), stored(true));
        assert_eq!(encode(&Sample { state: SampleState::Predicted, ..row }).unwrap(), stored(false));
    }

    #[test]
    fn a_stored_summary_is_its_numbers_in_a_fixed_order() {
        let covariance = Matrix3::new(4.0, 0.1, 0.2, 0.1, 5.0, 0.3, 0.2, 0.3, 6.0);
        let mut tool = ToolQuality {
            tool: "orange".into(),
            observed: 200,
            predicted: 5,
            missing: 6,
            reasons: [(MissReason::TipHidden, 4), (MissReason::PoorFit, 300)].into(),
            border_residual_px: Some(0.2),
            transient_depth_sigma_mm: None,
            effective_diameter: Some(EffectiveDiameter { mm: 5.0, sigma_mm: 0.1, basis: DiameterBasis::Session }),
            gaps: vec![
                Gap { first: 1, last: 2, absence: Absence::LeftView },
                Gap { first: 4, last: 7, absence: Absence::Lost(MissReason::Misread) },
            ],
            fulcrum: Some(Fulcrum { at: Point3::new(1.0, 2.0, 3.0), covariance }),
            size_mismatch: Some(SizeMismatch { px: 0.3, sigma_px: 0.1 }),
            ..ToolQuality::default()
        };
        tool.colour.from_background = Some(Margin { margin_steps: 9.0, spread_steps: 2.0, nearest: "shaft".into() });
        let light = vec![LightSample { time_s: 1.0, luma_ratio: 0.9, chroma_shift: [0.2, 0.3] }];
        let view_shifts = vec![ViewShift { time_s: 1.0, parts: [0.1, 0.2, 0.3, 0.4] }];
        let summary = QualitySummary {
            frames: 211,
            frames_interlaced: 3,
            tools: vec![tool.clone()],
            light: light.clone(),
            view_shifts: view_shifts.clone(),
        };
        let reasons = vec![(11u32, 300u64), (5, 4)]; // in the order of the stages
        let gaps = vec![(1u64, 2u64, None), (4, 7, Some(16u32))];
        let colour = [None, Some(([9.0, 2.0], "shaft"))];
        let fulcrum = Some(([1.0, 2.0, 3.0], [4.0, 0.1, 0.2, 5.0, 0.3, 6.0]));
        let diameter = Some(([5.0, 0.1], true));
        let older = ([200u64, 5, 6], reasons, Some(0.2), None::<f64>, diameter, gaps, colour, fulcrum);
        let summary_of =
            |tool: Vec<u8>| [encode(&(211u64, 3u64, 1u8)).unwrap(), tool, encode(&light).unwrap()].concat();
        let without_view = summary_of(encode(&(&older, Some([0.3, 0.1]))).unwrap());
        let bytes = [&without_view[..], &encode(&view_shifts).unwrap()].concat();
        assert_eq!(encode(&summary).unwrap(), bytes);
        let read: QualitySummary = decode(&bytes).unwrap();
        assert_eq!(read.quality(&["orange".into()]).tools, [tool.clone()]);
        let no_rows = || Vec::<u8>::new();
        let content = encode(&(vec!["orange"], vec![0.5], [no_rows(), no_rows(), no_rows()], true)).unwrap();
        let older = summary_of(encode(&older).unwrap());
        let without = ToolQuality { size_mismatch: None, ..tool.clone() };
        for (magic, summary, expected) in [
            (MAGIC_WITHOUT_VIEW, &without_view, &tool),
            (MAGIC_WITHOUT_SIZES, &older, &without),
            (MAGIC_WITH_SIGMAS, &older, &without),
        ] {
            let blob = [&magic[..], &content, summary, &[0]].concat();
            let read = SessionPaths::from_bytes(&blob).unwrap().tracking.unwrap();
            assert_eq!(read.quality.quality(&["orange".into()]).tools, std::slice::from_ref(expected));
            assert_eq!(read.quality.view_shifts, []);
        }
    }

    proptest! {
        #[test]
        fn paths_survive_their_blob_bit_for_bit(smoothed in prop::collection::vec(row(), 0..20)) {
            let paths = SessionPaths {
                tools: vec!["orange".into()],
                frame_times_s: vec![0.0, 0.1 + 0.2],
                raw: vec![],
                filtered: smoothed.clone(),
                smoothed,
                tracking: None,
                cuts: vec![],
            };
            let read = SessionPaths::from_bytes(&paths.to_bytes().unwrap()).unwrap();
            prop_assert_eq!(&read, &paths);
            prop_assert_eq!(read.trajectory(PathKind::Smoothed).samples, paths.smoothed);
        }

        #[test]
        fn blobs_of_older_formats_still_give_their_paths(rows in prop::collection::vec(row(), 0..20)) {
            let (tools, times): (Vec<String>, Vec<f64>) = (vec!["orange".into()], vec![0.5]);
            let old: Vec<_> = rows.iter().map(with_sigmas).collect();
            let content = encode(&(&tools, &times, &old, &old, &old)).unwrap();
            for bytes in [[&MAGIC_WITHOUT_TRACKING[..], &content].concat(), [&MAGIC_WITH_SIGMAS[..], &content, &[0]].concat()] {
                let read = SessionPaths::from_bytes(&bytes).unwrap();
                prop_assert_eq!((&read.raw, &read.smoothed, read.tracking), (&rows, &rows, None));
            }
        }

        #[test]
        fn a_damaged_blob_is_an_error(cut in 0usize..8) {
            prop_assert!(SessionPaths::from_bytes(&MAGIC[..cut]).is_err());
            prop_assert!(SessionPaths::from_bytes(&[&MAGIC[..], &[0xff; 9]].concat()).is_err());
        }
    }
}
