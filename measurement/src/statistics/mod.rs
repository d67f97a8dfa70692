//! Statistics of scores: compares features with those of other people and of earlier sessions (METHOD 7).
//!
//! **In:** values with their error bars, one per person or one per session. **Out:** percentiles, judgements, curves,
//! levels of skill and alarms, each with its interval and with the number of people or sessions behind it. **Gives up**
//! with a [`NoAnswer`]: unusable or too few data give a reason, never a number. A session that could not be judged is
//! neither a pass nor a fail.

pub mod agreement;
pub mod cohort;
pub mod curve;
pub mod cusum;
pub mod false_discovery;
pub mod interval;
pub mod lc_cusum;
mod no_answer;
pub mod pass_rule;
mod person_values;
pub mod reminder;
mod resampler;
pub mod skill;
pub mod standard;
mod trial;

pub use no_answer::NoAnswer;
pub use person_values::{MIN_PEOPLE, PersonValues};
pub use trial::TrialOutcome;
