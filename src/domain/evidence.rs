//! The stretches of a recording that made a session's features, as stored and as sent.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::feature::StoredFeatureKey;
use super::named;
use crate::motion::features::view::UnseenCause;
use crate::motion::stretches::{FeatureStretches, MAX_STRETCHES, NoStretches, Stretch};

/// Maximum number of rows of one session: more than there are combinations of features, tools and spaces.
pub const MAX_ROWS: usize = 2_000;

/// The stretches that made one feature of a session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EvidenceRow {
    /// The feature.
    #[serde(flatten)]
    pub of: StoredFeatureKey,
    /// What the stretches show, such as `rest` or `detour`; `null` where the feature has no place in time.
    pub what: Option<String>,
    /// Unit of their amounts; `1` for counts and ratios.
    pub unit: Option<String>,
    /// The stretches, at most three, the one with the largest contribution first; they do not overlap.
    pub stretches: Vec<StretchRow>,
    /// Why there are none; `null` where there are.
    pub none: Option<NoEvidence>,
}

/// A stretch of time that made a feature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StretchRow {
    /// Start, s on the recording's clock.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// The stretch's contribution, in the row's unit.
    pub amount: f64,
    /// The contribution as a share of the feature's measured value, 0 to 1; `null` for features that are not sums.
    pub share: Option<f64>,
    /// If the tool was not seen: the cause.
    pub cause: Option<AbsenceCause>,
}

/// Why a feature has no stretches.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct NoEvidence {
    /// Stable name: `whole_task`, `no_value`, `errors_not_stated`, `nothing`, `nothing_stands_out` or `refused`.
    pub reason: String,
    /// The same in words.
    pub detail: String,
}

named! {
    /// What caused that a tool was not seen.
    AbsenceCause: "cause" {
        /// The hand: the tool left the picture.
        LeftView = "left_view",
        /// The other tool: it was in the way.
        Hidden = "hidden",
        /// The tracker: it lost the tool.
        Lost = "lost",
    }
}

impl EvidenceRow {
    /// The pipeline's evidence with the tools' names.
    pub fn of(evidence: &FeatureStretches, tools: &[String]) -> Self {
        let (stretches, none) = match &evidence.stretches {
            Ok(stretches) => (stretches.iter().take(MAX_STRETCHES).map(StretchRow::from).collect(), None),
            Err(reason) => (Vec::new(), Some(NoEvidence::from(*reason))),
        };
        Self {
            of: StoredFeatureKey {
                feature: evidence.feature.name.to_owned(),
                tool: evidence.tool.and_then(|tool| tools.get(tool).cloned()),
                space: evidence.space.into(),
            },
            what: evidence.kind.map(|what| what.name.to_owned()),
            unit: evidence.kind.map(|what| what.unit.to_owned()),
            stretches,
            none,
        }
    }
}

impl From<&Stretch> for StretchRow {
    /// Rounds the numbers to their meaningful digits.
    fn from(stretch: &Stretch) -> Self {
        Self {
            from_s: round_to(stretch.from_s, 3),
            to_s: round_to(stretch.to_s, 3),
            amount: round_to(stretch.amount, 4),
            share: stretch.share.map(|share| round_to(share, 4)),
            cause: stretch.cause.map(AbsenceCause::from),
        }
    }
}

fn round_to(value: f64, digits: i32) -> f64 {
    let unit = 10f64.powi(digits);
    (value * unit).round() / unit
}

impl From<NoStretches> for NoEvidence {
    fn from(reason: NoStretches) -> Self {
        Self { reason: reason.name().to_owned(), detail: reason.to_string() }
    }
}

impl From<UnseenCause> for AbsenceCause {
    fn from(cause: UnseenCause) -> Self {
        match cause {
            UnseenCause::LeftView => AbsenceCause::LeftView,
            UnseenCause::Hidden => AbsenceCause::Hidden,
            UnseenCause::Lost => AbsenceCause::Lost,
        }
    }
}
