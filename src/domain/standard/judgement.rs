//! Judging values and sessions against targets.

use super::{Definition, Target};
use crate::domain::feature::FeatureKey;
use crate::domain::named;
use crate::domain::session::FeatureRow;
use crate::domain::trainee::Handedness;
use crate::pipeline::score::Trial;
use crate::pipeline::score::interval::{Interval, Measured};
use crate::pipeline::score::standard;

named! {
    /// The result of judging a value against a target. Only `pass` and `fail` count.
    Judgement: "judgement" {
        /// The whole error bar meets the limit.
        Pass = "pass",
        /// The whole error bar breaks it.
        Fail = "fail",
        /// The error bar covers the limit.
        Undecided = "undecided",
        /// The value's error is unknown.
        ErrorUnknown = "error_unknown",
        /// There is no usable value.
        NotMeasured = "not_measured",
        /// The limit was computed from values of another program version.
        OtherVersion = "other_version",
        /// The limit for this tool was computed from people who prefer the other hand.
        OtherHand = "other_hand",
    }
}

/// A value to judge, with the program version that measured it and the trainee's preferred hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToJudge<'v> {
    /// The value; `None` where there is none.
    pub value: Option<f64>,
    /// 95 % interval of the true value; `None` where unknown.
    pub bar: Option<[f64; 2]>,
    /// Version of the program that measured it.
    pub pipeline: &'v str,
    /// The trainee's preferred hand, if known.
    pub handedness: Option<Handedness>,
}

impl Target {
    /// Judges a value if its program version and hand match those that the limit was computed from.
    pub fn judge(&self, of: ToJudge<'_>) -> Judgement {
        if let Some(from) = &self.made_from {
            if from.pipeline != of.pipeline {
                return Judgement::OtherVersion;
            }
            if from.handedness.is_some() && from.handedness != of.handedness {
                return Judgement::OtherHand;
            }
        }
        self.limit().judge(of.measured()).into()
    }
}

named! {
    /// The result of judging a session against a standard.
    SessionJudgement: "judgement" {
        /// All targets were met.
        Pass = "pass",
        /// At least one target was missed.
        Fail = "fail",
        /// The session could not be judged.
        Unknown = "unknown",
    }
}

impl Definition {
    /// Judges a session by all targets, in the same way as a trainee's progress.
    pub fn judge(&self, features: &[FeatureRow], pipeline: &str, handedness: Option<Handedness>) -> SessionJudgement {
        let judged = |target: &Target| {
            let Some(row) = features.iter().find(|row| FeatureKey::from(*row) == target.of) else {
                return standard::Judgement::NotMeasured;
            };
            let bar = row.error.as_ref().and_then(|error| error.as_ref().ok()).map(|error| [error.low, error.high]);
            target.judge(ToJudge { value: row.value.as_ref().ok().copied(), bar, pipeline, handedness }).into()
        };
        match Trial::of_all(&self.targets.iter().map(judged).collect::<Vec<_>>()) {
            Trial::Passed => SessionJudgement::Pass,
            Trial::Failed => SessionJudgement::Fail,
            Trial::Unknown => SessionJudgement::Unknown,
        }
    }
}

impl ToJudge<'_> {
    /// The value with its error bar.
    pub fn measured(&self) -> Option<Measured> {
        let bar = self.bar.map(|[low, high]| Interval { low, high });
        self.value.map(|value| Measured { value, bar })
    }
}

impl From<standard::Judgement> for Judgement {
    fn from(judgement: standard::Judgement) -> Self {
        match judgement {
            standard::Judgement::Pass => Judgement::Pass,
            standard::Judgement::Fail => Judgement::Fail,
            standard::Judgement::Undecided => Judgement::Undecided,
            standard::Judgement::ErrorUnknown => Judgement::ErrorUnknown,
            standard::Judgement::NotMeasured => Judgement::NotMeasured,
        }
    }
}

impl From<Judgement> for standard::Judgement {
    /// A value that is not judged counts as not measured.
    fn from(judgement: Judgement) -> Self {
        match judgement {
            Judgement::Pass => standard::Judgement::Pass,
            Judgement::Fail => standard::Judgement::Fail,
            Judgement::Undecided => standard::Judgement::Undecided,
            Judgement::ErrorUnknown => standard::Judgement::ErrorUnknown,
            Judgement::NotMeasured | Judgement::OtherVersion | Judgement::OtherHand => standard::Judgement::NotMeasured,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::session::FeatureSpace;
    use crate::domain::standard::MadeFrom;
    use crate::pipeline::features::{self, Direction};

    #[test]
    fn a_limit_judges_only_values_of_the_kind_that_it_was_made_from() {
        let key = FeatureKey {
            feature: "path_length".to_owned(),
            tool: Some("orange".to_owned()),
            space: FeatureSpace::Space3d,
        };
        let limit = standard::Target::fixed(100.0, Direction::Lower).unwrap();
        let handedness = Some(Handedness::Right);
        let from = MadeFrom { pipeline: "7".to_owned(), fingerprint: None, handedness };
        let target = Target::of(key, &features::path::PATH_LENGTH, limit, Some(from));
        let right = ToJudge { value: Some(90.0), bar: Some([85.0, 95.0]), pipeline: "7", handedness };
        assert_eq!(target.judge(right), Judgement::Pass);
        assert_eq!(target.judge(ToJudge { bar: Some([85.0, 101.0]), ..right }), Judgement::Undecided);
        assert_eq!(target.judge(ToJudge { pipeline: "8", ..right }), Judgement::OtherVersion);
        assert_eq!(target.judge(ToJudge { handedness: Some(Handedness::Left), ..right }), Judgement::OtherHand);
        assert_eq!(target.judge(ToJudge { handedness: None, ..right }), Judgement::OtherHand);
    }
}
