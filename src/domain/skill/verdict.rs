//! What a model says of a session, or why it says nothing.

use serde::Serialize;
use utoipa::ToSchema;

use super::report::{PerLevel, Report, Share};
use crate::domain::named;
use crate::domain::trainee::Level;
use crate::pipeline::features;
use crate::pipeline::score::skill::{self, Abstains};

/// Most features that are said to carry a verdict.
const MOST_CARRIED: usize = 5;

/// What a task's model says of a session's skill. Either `level` or `reason` is there.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct SkillVerdict {
    /// Version of the task's model; `null` without one.
    pub model: Option<i64>,
    /// The level; `null` where there is none.
    pub level: Option<Level>,
    /// Why there is none.
    pub reason: Option<Reason>,
    /// Each level's probability; `null` where the model cannot say.
    pub probabilities: Option<PerLevel>,
    /// What speaks most for the likeliest level, or against it: at most five features.
    pub carried: Vec<Carried>,
    /// In how many sessions of people whom it never saw such models found the level.
    pub accuracy: Option<Share>,
    /// Where they gave this level, in how many it was right; `null` without a level.
    pub accuracy_where_given: Option<Share>,
}

/// Why a session has no level.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Reason {
    /// Stable name.
    pub name: ReasonName,
    /// The same for people.
    pub detail: String,
}

named! {
    /// Why a session has no level.
    ReasonName: "reason" {
        /// The task has no model.
        NoModel = "no_model",
        /// Somebody of whom it was made was erased.
        Withdrawn = "withdrawn",
        /// The session was measured by another version of the program than the model's sessions.
        OtherPipeline = "other_pipeline",
        /// The session's quality does not allow to believe its features.
        Refused = "refused",
        /// The model was made of sessions of this person's: of them it says what it was told.
        InTraining = "in_training",
        /// The session has another number of tools than the model's sessions.
        OtherTools = "other_tools",
        /// The model did no better than models of shuffled levels.
        KnowsNothing = "knows_nothing",
        /// A feature that the model goes by was not measured.
        NotMeasured = "not_measured",
        /// Nothing states how far such a feature may be off.
        ErrorUnknown = "error_unknown",
        /// The session is unlike those that the model was made of.
        Outside = "outside",
        /// Two levels are about as likely.
        NotClear = "not_clear",
        /// Within the session's own error bars the level changes.
        WithinErrors = "within_errors",
    }
}

/// A feature's part in a verdict.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Carried {
    /// Stable name.
    pub feature: String,
    /// Its title for people.
    pub title: String,
    /// Unit of `value` and `mean`.
    pub unit: String,
    /// The session's value; where only tools have it, their mean.
    pub value: f64,
    /// The mean of the model's sessions.
    pub mean: f64,
    /// How much likelier the likeliest level is with this value than with the mean, −1 to 1.
    pub raises: f64,
}

impl SkillVerdict {
    /// No level, and why.
    pub fn without(name: ReasonName, detail: impl Into<String>) -> Self {
        Self {
            model: None,
            level: None,
            reason: Some(Reason { name, detail: detail.into() }),
            probabilities: None,
            carried: Vec::new(),
            accuracy: None,
            accuracy_where_given: None,
        }
    }

    /// The same with what it is worth.
    pub fn worth(self, report: &Report) -> Self {
        let accuracy_where_given = self.level.and_then(|level| report.speaking.right_where(level));
        Self { accuracy: Some(report.accuracy), accuracy_where_given, ..self }
    }

    /// The same, of this version of the model with what it is worth.
    pub fn by(self, version: i64, report: &Report) -> Self {
        Self { model: Some(version), ..self.worth(report) }
    }
}

impl From<skill::Verdict> for SkillVerdict {
    fn from(verdict: skill::Verdict) -> Self {
        let skill::Verdict { level, probabilities, carried } = verdict;
        let (level, reason) = match level {
            Ok(level) => (Some(level.into()), None),
            Err(why) => (None, Some(Reason { name: ReasonName::from(&why), detail: why.to_string() })),
        };
        Self {
            model: None,
            level,
            reason,
            probabilities: probabilities.map(PerLevel::from),
            carried: carried.into_iter().take(MOST_CARRIED).map(Carried::from).collect(),
            accuracy: None,
            accuracy_where_given: None,
        }
    }
}

impl From<skill::Contribution> for Carried {
    fn from(of: skill::Contribution) -> Self {
        let known = features::find(&of.feature);
        let title = known.map_or_else(|| of.feature.clone(), |feature| feature.title.to_owned());
        let unit = known.map_or_else(String::new, |feature| feature.unit.to_owned());
        Self { feature: of.feature, title, unit, value: of.value, mean: of.mean, raises: of.raises }
    }
}

impl From<&Abstains> for ReasonName {
    fn from(why: &Abstains) -> Self {
        match why {
            Abstains::KnowsNothing => ReasonName::KnowsNothing,
            Abstains::NotMeasured { .. } => ReasonName::NotMeasured,
            Abstains::ErrorUnknown { .. } => ReasonName::ErrorUnknown,
            Abstains::Outside { .. } => ReasonName::Outside,
            Abstains::NotClear { .. } => ReasonName::NotClear,
            Abstains::WithinErrors { .. } => ReasonName::WithinErrors,
        }
    }
}
