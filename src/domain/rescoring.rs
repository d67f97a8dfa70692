//! Scoring a task's sessions again: the order, the state of each session, and the changes.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::feature::StoredFeatureKey;
use super::named;

named! {
    /// The data to score again.
    RescoringSource: "source" {
        /// The stored trajectory: only the features are computed again.
        Trajectory = "trajectory",
        /// The recording: it is tracked again, with the box's present camera and colours.
        Recording = "recording",
    }
}

named! {
    /// State of one session of an order.
    RescoringItemState: "state" {
        /// Not queued yet.
        Waiting = "waiting",
        /// Its job is in the queue or running, or done and not compared yet.
        Working = "working",
        /// The old and new results have been compared.
        Done = "done",
        /// The job could not be done; the problem says why. The old result stays.
        Failed = "failed",
        /// The order was cancelled before its job was queued.
        Cancelled = "cancelled",
    }
}

named! {
    /// The sessions of a task to score again.
    RescoringSelection: "which" {
        /// Sessions whose result was made by another program version than the present one.
        Older = "older",
        /// All sessions with a result.
        All = "all",
    }
}

/// An order as requested.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewRescoring {
    /// The data to score again. Usually `trajectory`.
    #[serde(default = "stored")]
    pub from: RescoringSource,
    /// The sessions. Usually `older`.
    #[serde(default = "older")]
    pub which: RescoringSelection,
}

fn stored() -> RescoringSource {
    RescoringSource::Trajectory
}

fn older() -> RescoringSelection {
    RescoringSelection::Older
}

named! {
    /// How a feature changed.
    FeatureChangeKind: "change" {
        /// The error bars do not overlap: the change is larger than measurement errors explain.
        Apart = "apart",
        /// The values differ by more than rounding, but the error bars overlap or one of them is unknown.
        WithinError = "within_error",
        /// Only the old result has a value.
        Lost = "lost",
        /// Only the new result has a value.
        Gained = "gained",
    }
}

/// A value with its error bar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct ValueWithError {
    /// The value, in the feature's unit.
    pub value: f64,
    /// Lower end of its 95 % interval; `null` where unknown.
    pub low: Option<f64>,
    /// Upper end of its 95 % interval; `null` where unknown.
    pub high: Option<f64>,
}

/// A feature whose value changed.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct FeatureChange {
    /// The feature.
    #[serde(flatten)]
    pub of: StoredFeatureKey,
    /// Title for people.
    pub title: String,
    /// Unit of the values.
    pub unit: String,
    /// How it changed.
    pub change: FeatureChangeKind,
    /// The value in the old result.
    pub old: Option<ValueWithError>,
    /// The value in the new result.
    pub new: Option<ValueWithError>,
}
