//! Scoring a task's sessions again: what is ordered, how each session stands, what changed.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::feature::FeatureKey;
use super::named;

named! {
    /// What is read again.
    RescoringSource: "source" {
        /// The stored path: the features alone are made anew.
        Trajectory = "trajectory",
        /// The recording: it is tracked again, with the box's present camera and colours.
        Recording = "recording",
    }
}

named! {
    /// How one session of an order stands.
    RescoringItemState: "state" {
        /// Its turn has not come.
        Waiting = "waiting",
        /// Its work is in the queue, or done and not compared yet.
        Working = "working",
        /// Old and new are compared.
        Done = "done",
        /// The work could not be done; the problem says why. The old result stays.
        Failed = "failed",
        /// The order was called off before its turn came.
        Cancelled = "cancelled",
    }
}

named! {
    /// Which sessions of a task.
    Which: "which" {
        /// Those whose result is of another version of the program than the present one.
        Older = "older",
        /// All that have a result.
        All = "all",
    }
}

/// What is ordered.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewRescoring {
    /// What is read again. Usually `trajectory`.
    #[serde(default = "stored")]
    pub from: RescoringSource,
    /// Which sessions. Usually `older`.
    #[serde(default = "older")]
    pub which: Which,
}

fn stored() -> RescoringSource {
    RescoringSource::Trajectory
}

fn older() -> Which {
    Which::Older
}

named! {
    /// What became of a feature.
    Change: "change" {
        /// The error bars do not overlap: more than the errors of measuring explain.
        Apart = "apart",
        /// It differs beyond rounding, but the error bars overlap, or one of them is not known.
        WithinError = "within_error",
        /// Only the old result has a value.
        Lost = "lost",
        /// Only the new result has one.
        Gained = "gained",
    }
}

/// A value with its error bar.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct Barred {
    /// The value, in the feature's unit.
    pub value: f64,
    /// The true value lies with 95 % between `low`
    pub low: Option<f64>,
    /// and `high`; both `null` where that is not known.
    pub high: Option<f64>,
}

/// A feature that is not what it was.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct FeatureChange {
    /// Which.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// Title for people.
    pub title: String,
    /// Unit of the values.
    pub unit: String,
    /// What became of it.
    pub change: Change,
    /// In the old result.
    pub old: Option<Barred>,
    /// In the new one.
    pub new: Option<Barred>,
}
