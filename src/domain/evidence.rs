//! The seconds that made a session's features, as they are kept and told.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::feature::FeatureKey;
use super::named;
use crate::pipeline::evidence::{Evidence, MOST_STRETCHES, NoStretches, Stretch};
use crate::pipeline::features::view::Cause;

/// Rows of one session, at most: more than there are features, tools and spaces.
pub const MOST_ROWS: usize = 2_000;

/// Where one feature of a session comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EvidenceRow {
    /// Of which feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// What the stretches are, such as `rest` or `detour`; `null` where the feature has no place in time.
    pub what: Option<String>,
    /// Unit of their amounts; `1` for counts and ratios.
    pub unit: Option<String>,
    /// The stretches, at most three, the weightiest first; they do not overlap.
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
    /// How much of it there was, in the row's unit.
    pub amount: f64,
    /// The share of the feature's value as measured that it made, 0 to 1; `null` of what does not add up.
    pub share: Option<f64>,
    /// Where the tool was not seen: whose doing that was.
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
    /// Whose doing it was that a tool was not seen.
    AbsenceCause: "cause" {
        /// The hand's: it left the picture.
        LeftView = "left_view",
        /// The other tool's: it was in the way.
        Hidden = "hidden",
        /// The tracker's.
        Lost = "lost",
    }
}

impl EvidenceRow {
    /// As the pipeline found it, with tools of these names.
    pub fn of(evidence: &Evidence, tools: &[String]) -> Self {
        let (stretches, none) = match &evidence.stretches {
            Ok(stretches) => (stretches.iter().take(MOST_STRETCHES).map(StretchRow::from).collect(), None),
            Err(reason) => (Vec::new(), Some(NoEvidence::from(*reason))),
        };
        Self {
            of: FeatureKey {
                feature: evidence.feature.name.to_owned(),
                tool: evidence.tool.and_then(|tool| tools.get(tool).cloned()),
                space: evidence.space.into(),
            },
            what: evidence.what.map(|what| what.name.to_owned()),
            unit: evidence.what.map(|what| what.unit.to_owned()),
            stretches,
            none,
        }
    }
}

impl From<&Stretch> for StretchRow {
    /// Numbers with as many digits as they are worth.
    fn from(stretch: &Stretch) -> Self {
        Self {
            from_s: rounded(stretch.from_s, 3),
            to_s: rounded(stretch.to_s, 3),
            amount: rounded(stretch.amount, 4),
            share: stretch.share.map(|share| rounded(share, 4)),
            cause: stretch.cause.map(AbsenceCause::from),
        }
    }
}

fn rounded(value: f64, digits: i32) -> f64 {
    let unit = 10f64.powi(digits);
    (value * unit).round() / unit
}

impl From<NoStretches> for NoEvidence {
    fn from(reason: NoStretches) -> Self {
        Self { reason: reason.name().to_owned(), detail: reason.to_string() }
    }
}

impl From<Cause> for AbsenceCause {
    fn from(cause: Cause) -> Self {
        match cause {
            Cause::LeftView => AbsenceCause::LeftView,
            Cause::Hidden => AbsenceCause::Hidden,
            Cause::Lost => AbsenceCause::Lost,
        }
    }
}
