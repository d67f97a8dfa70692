//! A model's verdict on a session, or why there is none.

use serde::Serialize;
use utoipa::ToSchema;

use super::report::{ModelReport, PerLevel, ShareOfPeople};
use crate::domain::named;
use crate::domain::trainee::Level;
use crate::motion::features;
use crate::statistics::skill::{self, Abstention};

/// Maximum number of features listed as contributions to a verdict.
const MAX_CONTRIBUTIONS: usize = 5;

/// The verdict of a task's model on a session's skill. Either `level` or `reason` is given.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct SkillVerdict {
    /// Version of the task's model; `null` without one.
    pub model: Option<i64>,
    /// The level; `null` where there is none.
    pub level: Option<Level>,
    /// Why there is none.
    pub reason: Option<NoLevelReason>,
    /// Each level's probability; `null` where the model cannot say.
    pub probabilities: Option<PerLevel>,
    /// The features that count most for or against the likeliest level, at most five.
    pub carried: Vec<FeatureContribution>,
    /// Share of held-out people's sessions whose level such models found.
    pub accuracy: Option<ShareOfPeople>,
    /// Where such models gave this level: the share that was right; `null` without a level.
    pub accuracy_where_given: Option<ShareOfPeople>,
}

/// Why a session has no level.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct NoLevelReason {
    /// Stable name.
    pub name: NoLevelReasonName,
    /// The same for people.
    pub detail: String,
}

named! {
    /// Why a session has no level.
    NoLevelReasonName: "reason" {
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
pub struct FeatureContribution {
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
    pub fn without_level(name: NoLevelReasonName, detail: impl Into<String>) -> Self {
        Self {
            model: None,
            level: None,
            reason: Some(NoLevelReason { name, detail: detail.into() }),
            probabilities: None,
            carried: Vec::new(),
            accuracy: None,
            accuracy_where_given: None,
        }
    }

    /// Adds the model's accuracy to the verdict.
    pub fn with_accuracy(self, report: &ModelReport) -> Self {
        let accuracy_where_given = self.level.and_then(|level| report.speaking.accuracy_for(level));
        Self { accuracy: Some(report.accuracy), accuracy_where_given, ..self }
    }

    /// Adds the model's version and accuracy to the verdict.
    pub fn from_model(self, version: i64, report: &ModelReport) -> Self {
        Self { model: Some(version), ..self.with_accuracy(report) }
    }
}

impl From<skill::LevelVerdict> for SkillVerdict {
    fn from(verdict: skill::LevelVerdict) -> Self {
        let skill::LevelVerdict { level, probabilities, contributions: carried } = verdict;
        let (level, reason) = match level {
            Ok(level) => (Some(level.into()), None),
            Err(why) => (None, Some(NoLevelReason { name: NoLevelReasonName::from(&why), detail: why.to_string() })),
        };
        Self {
            model: None,
            level,
            reason,
            probabilities: probabilities.map(PerLevel::from),
            carried: carried.into_iter().take(MAX_CONTRIBUTIONS).map(FeatureContribution::from).collect(),
            accuracy: None,
            accuracy_where_given: None,
        }
    }
}

impl From<skill::Contribution> for FeatureContribution {
    fn from(of: skill::Contribution) -> Self {
        let known = features::find(&of.feature).ok();
        let title = known.map_or_else(|| of.feature.clone(), |feature| feature.title.to_owned());
        let unit = known.map_or_else(String::new, |feature| feature.unit.to_owned());
        Self { feature: of.feature, title, unit, value: of.value, mean: of.mean, raises: of.raises }
    }
}

impl From<&Abstention> for NoLevelReasonName {
    fn from(why: &Abstention) -> Self {
        match why {
            Abstention::KnowsNothing => NoLevelReasonName::KnowsNothing,
            Abstention::NotMeasured { .. } => NoLevelReasonName::NotMeasured,
            Abstention::ErrorUnknown { .. } => NoLevelReasonName::ErrorUnknown,
            Abstention::Outside { .. } => NoLevelReasonName::Outside,
            Abstention::NotClear { .. } => NoLevelReasonName::NotClear,
            Abstention::WithinErrors { .. } => NoLevelReasonName::WithinErrors,
        }
    }
}
