//! A model's verdict on a session, or why there is none.

use serde::Serialize;
use utoipa::ToSchema;

use super::report::{PerLevel, Report, Share};
use crate::domain::named;
use crate::domain::trainee::Level;
use crate::pipeline::features;
use crate::pipeline::score::skill::{self, Abstains};

/// Maximum number of features listed as contributions to a verdict.
const MOST_CARRIED: usize = 5;

/// The verdict of a task's model on a session's skill. Either `level` or `reason` is given.
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
    /// The features that count most for or against the likeliest level, at most five.
    pub carried: Vec<Carried>,
    /// Share of held-out people's sessions whose level such models found.
    pub accuracy: Option<Share>,
    /// Where such models gave this level: the share that was right; `null` without a level.
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
        /// The model was withdrawn because a person in its training data was erased.
        Withdrawn = "withdrawn",
        /// The session was measured by another version of the program than the model's sessions.
        OtherPipeline = "other_pipeline",
        /// The session's quality is too low to trust its features.
        Refused = "refused",
        /// The model was trained on sessions of this person, so that its verdict on them would only repeat the given
        /// level.
        InTraining = "in_training",
        /// The session has another number of tools than the model's sessions.
        OtherTools = "other_tools",
        /// The model did no better than models trained on shuffled levels.
        KnowsNothing = "knows_nothing",
        /// A feature that the model uses was not measured.
        NotMeasured = "not_measured",
        /// The error of such a feature is unknown.
        ErrorUnknown = "error_unknown",
        /// The session is unlike those that the model was trained on.
        Outside = "outside",
        /// Two levels are about equally likely.
        NotClear = "not_clear",
        /// The level would change within the session's own error bars.
        WithinErrors = "within_errors",
    }
}

/// A feature's contribution to a verdict.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Carried {
    /// Stable name.
    pub feature: String,
    /// Its title for people.
    pub title: String,
    /// Unit of `value` and `mean`.
    pub unit: String,
    /// The session's value; for a feature of tools, the mean over the tools.
    pub value: f64,
    /// The mean of the model's sessions.
    pub mean: f64,
    /// Gain in the likeliest level's probability from this value compared with the mean, −1 to 1.
    pub raises: f64,
}

impl SkillVerdict {
    /// A verdict without a level, with the reason.
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

    /// Adds the model's accuracy to the verdict.
    pub fn worth(self, report: &Report) -> Self {
        let accuracy_where_given = self.level.and_then(|level| report.speaking.right_where(level));
        Self { accuracy: Some(report.accuracy), accuracy_where_given, ..self }
    }

    /// Adds the model's version and accuracy to the verdict.
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
