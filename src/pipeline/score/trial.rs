//! Trials in the order in which they were done, as pass rules and control charts see them.

use super::standard::Judgement;

/// What one trial adds to a sequence of trials.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trial {
    /// The standard was kept.
    Passed,
    /// It was not.
    Failed,
    /// Nobody knows: the error bar covers the limit, the feature could not be measured, or the session was refused.
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
    /// A trial of several targets: one that was missed fails it, and only if all were kept is it passed. Without
    /// targets nothing was judged.
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
