//! Trial outcomes, as pass rules and control charts use them, in the order of the trials.

use super::standard::Judgement;

/// The outcome of one trial in a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trial {
    /// The standard was met.
    Passed,
    /// The standard was missed.
    Failed,
    /// Unknown: the error bar covers the limit, the feature could not be measured, or the session was refused.
    Unknown,
}

impl From<Judgement> for Trial {
    fn from(judgement: Judgement) -> Self {
        match judgement {
            Judgement::Pass => Trial::Passed,
            Judgement::Fail => Trial::Failed,
            Judgement::Undecided | Judgement::ErrorUnknown | Judgement::NotMeasured => Trial::Unknown,
        }
    }
}

impl Trial {
    /// The outcome of a trial with several targets: one missed target fails it, and it is passed only if all were met.
    /// Without targets nothing was judged.
    pub fn of_all(judgements: &[Judgement]) -> Self {
        let has = |trial| judgements.iter().any(|judgement| Trial::from(*judgement) == trial);
        match (has(Trial::Failed), has(Trial::Unknown), has(Trial::Passed)) {
            (true, _, _) => Trial::Failed,
            (false, false, true) => Trial::Passed,
            _ => Trial::Unknown,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_missed_target_fails_a_trial_and_one_unknown_one_keeps_it_from_passing() {
        use Judgement::{ErrorUnknown, Fail, NotMeasured, Pass, Undecided};
        assert_eq!(Trial::of_all(&[Pass, Pass]), Trial::Passed);
        assert_eq!(Trial::of_all(&[Pass, Undecided, Fail]), Trial::Failed);
        for unknown in [Undecided, ErrorUnknown, NotMeasured] {
            assert_eq!(Trial::of_all(&[Pass, unknown]), Trial::Unknown);
        }
        assert_eq!(Trial::of_all(&[]), Trial::Unknown);
    }
}
