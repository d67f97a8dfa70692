//! A model's verdict on a session: the level, the features that contributed to it, and why it may abstain.

use super::{PerLevel, SkillLevel};

/// A model's verdict on a session.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelVerdict {
    /// The level, or why none is given.
    pub level: Result<SkillLevel, Abstention>,
    /// The probability of each level; `None` if the model cannot read the session, or if the session is outside its
    /// data.
    pub probabilities: Option<PerLevel>,
    /// How each feature contributes to the likeliest level, for or against; the largest change first.
    pub contributions: Vec<Contribution>,
}

/// The contribution of one feature to a verdict.
#[derive(Clone, Debug, PartialEq)]
pub struct Contribution {
    /// The feature's name.
    pub feature: String,
    /// The session's value, in the feature's unit.
    pub value: f64,
    /// The training sessions' mean.
    pub mean: f64,
    /// By how much this value raises the probability of the likeliest level, compared with the mean, −1 to 1.
    pub raises: f64,
}

/// Why a model gives no level.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Abstention {
    /// Models of shuffled levels did as well.
    #[error("on unseen people the model did no better than models of shuffled levels, so it gives no verdicts")]
    KnowsNothing,
    /// A feature that the model uses was not measured.
    #[error("`{feature}`, which the model uses, was not measured")]
    NotMeasured {
        /// The feature.
        feature: String,
    },
    /// A feature that the model uses has no error bar.
    #[error("the error of `{feature}`, which the model uses, is unknown")]
    ErrorUnknown {
        /// The feature.
        feature: String,
    },
    /// The session is unlike the training sessions.
    #[error("the session is unlike the training sessions: {distance:.1} standard deviations off (limit {limit:.1})")]
    Outside {
        /// Distance from the nearest level's centre, standard deviations.
        distance: f64,
        /// Maximum distance for a verdict.
        limit: f64,
    },
    /// Two levels are about as likely.
    #[error(
        "two levels are about equally likely: the likelier leads by {:.0} %; needs {:.0} %",
        100.0 * lead,
        100.0 * least
    )]
    NotClear {
        /// Lead of the likeliest level.
        lead: f64,
        /// Minimum lead.
        least: f64,
    },
    /// Other values within the session's own error bars would give another level.
    #[error(
        "within the session's own error bars the level changes: {:.0} % agree; needs {:.0} %",
        100.0 * agreeing,
        100.0 * least
    )]
    WithinErrors {
        /// Share of the values within the bars that have the same level.
        agreeing: f64,
        /// Minimum share.
        least: f64,
    },
}

impl From<Abstention> for LevelVerdict {
    fn from(why: Abstention) -> Self {
        Self { level: Err(why), probabilities: None, contributions: Vec::new() }
    }
}
