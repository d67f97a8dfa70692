//! What a model says of a session, what carried it, and why it may say nothing.

use super::{Level, PerLevel};

/// What a model says of a session.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The level, or why none is given.
    pub level: Result<Level, Abstains>,
    /// Each level's probability; `None` where the model cannot read the session, or is outside its data.
    pub probabilities: Option<PerLevel>,
    /// What speaks for the likeliest level and against it, what changes most first.
    pub carried: Vec<Contribution>,
}

/// One feature's part in a verdict.
#[derive(Clone, Debug, PartialEq)]
pub struct Contribution {
    /// Its name.
    pub feature: String,
    /// The session's value, in the feature's unit.
    pub value: f64,
    /// The training sessions' mean.
    pub mean: f64,
    /// How much likelier the likeliest level is with this value than with the mean, −1 to 1.
    pub raises: f64,
}

/// Why a model gives no level.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Abstains {
    /// Models of shuffled levels did as well.
    #[error("on people it had not seen the model did no better than models of shuffled levels: it knows nothing")]
    KnowsNothing,
    /// A feature that it goes by was not measured.
    #[error("`{feature}`, which the model goes by, was not measured")]
    NotMeasured {
        /// Which.
        feature: String,
    },
    /// Nothing states how far a feature that it goes by may be off.
    #[error("nothing states how far `{feature}`, which the model goes by, may be off")]
    ErrorUnknown {
        /// Which.
        feature: String,
    },
    /// The session is unlike those that the model was made of.
    #[error(
        "the session is unlike those that the model was made of: {distance:.1} standard deviations off, at most {limit:.1}"
    )]
    Outside {
        /// From the nearest level's centre, standard deviations.
        distance: f64,
        /// The farthest at which it speaks.
        limit: f64,
    },
    /// Two levels are about as likely.
    #[error(
        "two levels are about as likely: the likelier leads by {:.0} %, and {:.0} % are asked for",
        100.0 * lead,
        100.0 * least
    )]
    NotClear {
        /// By how much the likeliest leads.
        lead: f64,
        /// By how much it must.
        least: f64,
    },
    /// Other values within the session's own error bars would have another level.
    #[error(
        "within the session's own error bars the level changes: {:.0} % agree, and {:.0} % are asked for",
        100.0 * agreeing,
        100.0 * least
    )]
    WithinErrors {
        /// Share of the values within the bars that have the same level.
        agreeing: f64,
        /// Share that must.
        least: f64,
    },
}

impl Abstains {
    /// Stable name for files, API and pages.
    pub fn name(&self) -> &'static str {
        match self {
            Abstains::KnowsNothing => "knows_nothing",
            Abstains::NotMeasured { .. } => "not_measured",
            Abstains::ErrorUnknown { .. } => "error_unknown",
            Abstains::Outside { .. } => "outside",
            Abstains::NotClear { .. } => "not_clear",
            Abstains::WithinErrors { .. } => "within_errors",
        }
    }
}

impl From<Abstains> for Verdict {
    fn from(why: Abstains) -> Self {
        Self { level: Err(why), probabilities: None, carried: Vec::new() }
    }
}
