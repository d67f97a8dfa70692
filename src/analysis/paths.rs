//! The stored form of a session's three paths and of the tracker's summary: one blob, exact to the last bit, read back
//! one path at a time. It holds everything that a score depends on, so scoring it again gives the same bytes.

use serde::{Deserialize, Serialize};

use super::protocol::{PathRow, QualityShape, decode, encode};
pub use crate::vision::trajectory::PathKind;
use crate::vision::trajectory::{self, Cut, Sample, Trajectory};

/// Magic bytes at the start of every blob; the last byte is the version of the format.
const MAGIC: [u8; 8] = *b"trocarP\x02";

/// Magic bytes of the format without the tracker's summary, otherwise the same: written up to pipeline version 8.
const MAGIC_WITHOUT_TRACKING: [u8; 8] = *b"trocarP\x01";

/// Why a blob cannot be read or written as paths.
#[derive(Debug, thiserror::Error)]
pub enum PathsError {
    /// Another kind of file, or another version of this format.
    #[error("not a file of paths of this version")]
    NotPaths,
    /// The magic bytes are right, but the content is inconsistent.
    #[error("a damaged file of paths: {0}")]
    Damaged(postcard::Error),
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
    pub raw: Vec<PathRow>,
    /// Path from the causal filter.
    pub filtered: Vec<PathRow>,
    /// Path from the smoother.
    pub smoothed: Vec<PathRow>,
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
    pub quality: QualityShape,
    /// Number of frames that the container announced, if it did.
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
        if let Some(content) = bytes.strip_prefix(&MAGIC_WITHOUT_TRACKING) {
            return decode(&[content, &[0]].concat()).map_err(PathsError::Damaged); // `None` is one zero byte
        }
        let content = bytes.strip_prefix(&MAGIC).ok_or(PathsError::NotPaths)?;
        decode(content).map_err(PathsError::Damaged)
    }

    /// One of the paths as the pipeline's type.
    pub fn trajectory(&self, kind: PathKind) -> Trajectory {
        Trajectory {
            tools: self.tools.clone(),
            samples: self.rows(kind).iter().map(|&row| row.into()).collect(),
            frame_times_s: self.frame_times_s.clone(),
            cuts: self.cuts.clone(),
        }
    }

    fn rows(&self, kind: PathKind) -> &[PathRow] {
        match kind {
            PathKind::Raw => &self.raw,
            PathKind::Filtered => &self.filtered,
            PathKind::Smoothed => &self.smoothed,
        }
    }
}

impl trajectory::PathSource for SessionPaths {
    fn path(&self, kind: PathKind, tool: usize) -> Vec<Sample> {
        self.rows(kind).iter().filter(|row| row.tool as usize == tool).map(|&row| row.into()).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn row() -> impl Strategy<Value = PathRow> {
        let three = || prop::array::uniform3(-1e6..1e6f64);
        (any::<u32>(), three(), prop::option::of(three()), prop::option::of(0.0..9.0), any::<bool>()).prop_map(
            |(frame, tip_mm, axis, sigma, observed)| PathRow {
                frame: frame.into(),
                time_s: f64::from(frame) / 30.0,
                tool: 0,
                tip_mm,
                velocity_mm_s: axis,
                axis,
                tip_px: None,
                sigma_xy_mm: sigma,
                sigma_z_mm: sigma,
                observed,
            },
        )
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
            let rows: Vec<PathRow> = read.trajectory(PathKind::Smoothed).samples.iter().map(PathRow::from).collect();
            prop_assert_eq!(rows, paths.smoothed);
        }

        #[test]
        fn a_blob_older_than_the_trackers_summary_still_gives_its_paths(rows in prop::collection::vec(row(), 0..20)) {
            let (tools, times): (Vec<String>, Vec<f64>) = (vec!["orange".into()], vec![0.5]);
            let content = encode(&(&tools, &times, &rows, &rows, &rows)).unwrap();
            let read = SessionPaths::from_bytes(&[&MAGIC_WITHOUT_TRACKING[..], &content].concat()).unwrap();
            prop_assert_eq!((read.smoothed, read.tracking), (rows, None));
        }

        #[test]
        fn a_damaged_blob_is_an_error(cut in 0usize..8) {
            prop_assert!(SessionPaths::from_bytes(&MAGIC[..cut]).is_err());
            prop_assert!(SessionPaths::from_bytes(&[&MAGIC[..], &[0xff; 9]].concat()).is_err());
        }
    }
}
