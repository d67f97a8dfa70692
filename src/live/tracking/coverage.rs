//! Whether a child has received every record of its recording. Only then do its features describe the recording.
//!
//! ```text
//! Pending ──first child──▶ Whole ──child that began later──▶ Partial
//!    └──────first child, in a recording that had frames already────▲
//! ```

use crate::analysis::protocol::RunningRow;

/// What the children of a recording have received of it.
pub(super) enum RecordCoverage {
    /// No child has begun: the first one receives all frames that arrived before it.
    Pending {
        /// The recording had no frame when this service opened it.
        is_fresh: bool,
    },
    /// The child has received every record.
    Whole {
        /// The last features from a child.
        last_features: Option<Vec<RunningRow>>,
    },
    /// The child lacks some records.
    Partial,
}

impl RecordCoverage {
    /// A child begins; `has_all` is true if it receives every record that arrived since this service started.
    pub(super) fn begin_child(&mut self, has_all: bool) {
        *self = match std::mem::replace(self, Self::Partial) {
            Self::Pending { is_fresh: true } if has_all => Self::Whole { last_features: None },
            Self::Whole { last_features } if has_all => Self::Whole { last_features },
            _ => Self::Partial,
        };
    }

    /// Keeps features from a child; removes them if they do not describe the whole recording.
    pub(super) fn take_features(&mut self, features: &mut Option<Vec<RunningRow>>) {
        match self {
            Self::Whole { last_features } => {
                if let Some(rows) = features {
                    *last_features = Some(rows.clone());
                }
            }
            Self::Pending { .. } | Self::Partial => *features = None,
        }
    }

    /// The last features of the whole recording; there are none from then on.
    pub(super) fn take_last(&mut self) -> Option<Vec<RunningRow>> {
        match self {
            Self::Whole { last_features } => last_features.take(),
            Self::Pending { .. } | Self::Partial => None,
        }
    }

    /// True if no child has begun.
    pub(super) fn is_pending(&self) -> bool {
        matches!(self, Self::Pending { .. })
    }
}
