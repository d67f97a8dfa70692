//! Trial outcomes, as pass rules and control charts use them, in the order of the trials.

use super::standard::TargetJudgement;

/// The outcome of one trial in a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialOutcome {
    /// The standard was met.
    Passed,
    /// The standard was missed.
    Failed,
    /// Unknown: the error bar covers the limit, the feature could not be measured, or the session was refused.
    Unknown,
}

impl From<TargetJudgement> for TrialOutcome {
    fn from(judgement: TargetJudgement) -> Self {
        match judgement {
            TargetJudgement::Pass => TrialOutcome::Passed,
            TargetJudgement::Fail => TrialOutcome::Failed,
            TargetJudgement::Undecided | TargetJudgement::ErrorUnknown | TargetJudgement::NotMeasured => {
                TrialOutcome::Unknown
            }
        }
    }
}

impl TrialOutcome {
    /// The outcome of a trial with several targets: one missed target fails it, and it is passed only if all were met.
    /// Without targets nothing was judged.
    pub fn of_all(judgements: &[TargetJudgement]) -> Self {
        let has = |trial| judgements.iter().any(|judgement| TrialOutcome::from(*judgement) == trial);
        match (has(TrialOutcome::Failed), has(TrialOutcome::Unknown), has(TrialOutcome::Passed)) {
            (true, _, _) => TrialOutcome::Failed,
            (false, false, true) => TrialOutcome::Passed,
            _ => TrialOutcome::Unknown,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_missed_target_fails_a_trial_and_one_unknown_one_keeps_it_from_passing() {
        use TargetJudgement::{ErrorUnknown, Fail, NotMeasured, Pass, Undecided};
        assert_eq!(TrialOutcome::of_all(&[Pass, Pass]), TrialOutcome::Passed);
        assert_eq!(TrialOutcome::of_all(&[Pass, Undecided, Fail]), TrialOutcome::Failed);
        for unknown in [Undecided, ErrorUnknown, NotMeasured] {
            assert_eq!(TrialOutcome::of_all(&[Pass, unknown]), TrialOutcome::Unknown);
        }
        assert_eq!(TrialOutcome::of_all(&[]), TrialOutcome::Unknown);
    }
}
