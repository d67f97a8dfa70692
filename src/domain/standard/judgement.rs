//! Judging values and sessions against targets.

use super::{StandardDefinition, Target};
use crate::domain::feature::StoredFeatureKey;
use crate::domain::named;
use crate::domain::session::FeatureRow;
use crate::domain::trainee::Handedness;
use crate::statistics::TrialOutcome;
use crate::statistics::interval::{ConfidenceInterval, MeasuredValue};
use crate::statistics::standard;

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
pub struct ValueToJudge<'v> {
    /// The value; `None` where there is none.
    pub value: Option<f64>,
    /// 95 % interval of the true value; `None` where unknown.
    pub bar: Option<[f64; 2]>,
    /// True if the true value is at least this one.
    pub is_lower_bound: bool,
    /// Version of the program that measured it.
    pub pipeline: &'v str,
    /// The trainee's preferred hand, if known.
    pub handedness: Option<Handedness>,
}

impl Target {
    /// Judges a value if its program version and hand match those that the limit was computed from.
    pub fn judge(&self, of: ValueToJudge<'_>) -> Judgement {
        if let Some(from) = &self.made_from {
            if from.pipeline != of.pipeline {
                return Judgement::OtherVersion;
            }
            if from.handedness.is_some() && from.handedness != of.handedness {
                return Judgement::OtherHand;
            }
        }
        let target = self.pipeline_target();
        let judgement = match of.value {
            Some(value) if of.is_lower_bound => target.judge_lower_bound(value),
            _ => target.judge(of.measured()),
        };
        judgement.into()
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

impl StandardDefinition {
    /// Judges a session by all targets, in the same way as a trainee's progress.
    pub fn judge(&self, features: &[FeatureRow], pipeline: &str, handedness: Option<Handedness>) -> SessionJudgement {
        let judged = |target: &Target| {
            let Some(row) = features.iter().find(|row| StoredFeatureKey::from(*row) == target.of) else {
                return standard::TargetJudgement::NotMeasured;
            };
            let bar = row.error.as_ref().and_then(|error| error.as_ref().ok()).map(|error| [error.low, error.high]);
            let (value, is_lower_bound) = (row.value.as_ref().ok().copied(), row.is_lower_bound());
            target.judge(ValueToJudge { value, bar, is_lower_bound, pipeline, handedness }).into()
        };
        TrialOutcome::of_all(&self.targets.iter().map(judged).collect::<Vec<_>>()).into()
    }

    /// The same from the judgement by each target.
    pub fn judge_all(&self, by: impl Fn(&Target) -> Judgement) -> SessionJudgement {
        let judged = |target: &Target| by(target).into();
        TrialOutcome::of_all(&self.targets.iter().map(judged).collect::<Vec<_>>()).into()
    }
}

impl From<TrialOutcome> for SessionJudgement {
    fn from(outcome: TrialOutcome) -> Self {
        match outcome {
            TrialOutcome::Passed => SessionJudgement::Pass,
            TrialOutcome::Failed => SessionJudgement::Fail,
            TrialOutcome::Unknown => SessionJudgement::Unknown,
        }
    }
}

impl ValueToJudge<'_> {
    /// The value with its error bar; `None` for a lower bound, which cannot be compared with other values.
    pub fn measured(&self) -> Option<MeasuredValue> {
        let bar = self.bar.map(|[low, high]| ConfidenceInterval { low, high });
        self.value.filter(|_| !self.is_lower_bound).map(|value| MeasuredValue { value, bar })
    }
}

impl From<standard::TargetJudgement> for Judgement {
    fn from(judgement: standard::TargetJudgement) -> Self {
        match judgement {
            standard::TargetJudgement::Pass => Judgement::Pass,
            standard::TargetJudgement::Fail => Judgement::Fail,
            standard::TargetJudgement::Undecided => Judgement::Undecided,
            standard::TargetJudgement::ErrorUnknown => Judgement::ErrorUnknown,
            standard::TargetJudgement::NotMeasured => Judgement::NotMeasured,
        }
    }
}

impl From<Judgement> for standard::TargetJudgement {
    /// A value that is not judged counts as not measured.
    fn from(judgement: Judgement) -> Self {
        match judgement {
            Judgement::Pass => standard::TargetJudgement::Pass,
            Judgement::Fail => standard::TargetJudgement::Fail,
            Judgement::Undecided => standard::TargetJudgement::Undecided,
            Judgement::ErrorUnknown => standard::TargetJudgement::ErrorUnknown,
            Judgement::NotMeasured | Judgement::OtherVersion | Judgement::OtherHand => {
                standard::TargetJudgement::NotMeasured
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::feature::FeatureKey;
    use crate::domain::session::FeatureSpace;
    use crate::domain::standard::MadeFrom;
    use crate::motion::features::Direction;
    use crate::motion::features::path::PATH_LENGTH;

    #[test]
    fn a_limit_judges_only_values_of_its_own_version_and_hand() {
        let key = FeatureKey::of_tool(&PATH_LENGTH, Some("orange".to_owned()), FeatureSpace::Space3d);
        let limit = standard::FeatureTarget::fixed(100.0, Direction::Lower).unwrap();
        let handedness = Some(Handedness::Right);
        let from = MadeFrom { pipeline: "7".to_owned(), fingerprint: None, handedness };
        let target = Target::of(key, limit, Some(from));
        let (value, bar) = (Some(90.0), Some([85.0, 95.0]));
        let right = ValueToJudge { value, bar, is_lower_bound: false, pipeline: "7", handedness };
        assert_eq!(target.judge(right), Judgement::Pass);
        assert_eq!(target.judge(ValueToJudge { bar: Some([85.0, 101.0]), ..right }), Judgement::Undecided);
        assert_eq!(target.judge(ValueToJudge { pipeline: "8", ..right }), Judgement::OtherVersion);
        assert_eq!(target.judge(ValueToJudge { handedness: Some(Handedness::Left), ..right }), Judgement::OtherHand);
        assert_eq!(target.judge(ValueToJudge { handedness: None, ..right }), Judgement::OtherHand);
    }

    #[test]
    fn a_lower_bound_is_judged_as_such_and_not_compared() {
        let key = FeatureKey::of_tool(&PATH_LENGTH, Some("orange".to_owned()), FeatureSpace::Space3d);
        let limit = standard::FeatureTarget::fixed(100.0, Direction::Lower).unwrap();
        let target = Target::of(key, limit, None);
        let at_least = |value| {
            let value = Some(value);
            ValueToJudge { value, bar: None, is_lower_bound: true, pipeline: "7", handedness: None }
        };
        assert_eq!(target.judge(at_least(110.0)), Judgement::Fail);
        assert_eq!(target.judge(at_least(90.0)), Judgement::Undecided);
        assert_eq!(at_least(110.0).measured(), None);
    }
}
