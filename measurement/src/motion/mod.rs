//! Motion: a trajectory in, features with error bars out, and whether they can be trusted. Pure, like
//! [`crate::vision`].
//!
//! | part | input | output | file | METHOD |
//! |---|---|---|---|---|
//! | features | trajectory | [`features::Feature`] values with units and error bars | `features/` | 6 |
//! | stretches | features and their motion | the stretches of time that determined each feature | `stretches/` | 6 |
//! | quality | trajectories, frame counts, reasons | figures and a [`quality::QualityVerdict`] | `quality/` | 6, 8 |
//! | assessment | trajectories | all of the above for one session | `assessment.rs` | 6 |

pub mod assessment;
pub mod features;
pub mod quality;
pub mod stretches;

/// Version of the whole chain from pixels to features. Raised whenever the same input gives other numbers. Stored with
/// every result, so that results of different versions are never compared by mistake.
pub const PIPELINE_VERSION: &str = "24";
