//! Pass rules: the number of passes in a row, and of further passes, after which a task counts as learnt.
//!
//! Trials with unknown outcome count as neither passed nor failed. A rule is met only if it is met for *every* possible
//! outcome of them: such a trial breaks a row, since it may have been a miss, but is never called one. A rule is out of
//! reach only if it is so even with all of them passed. So a covered camera can neither promote nor fail a trainee.

use super::no_answer::NoAnswer;
use super::trial::TrialOutcome;

/// A rule such as "two in a row and ten more, within 80 trials".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PassRule {
    /// Passes in a row that are needed first, at least 1.
    pub in_a_row: usize,
    /// Passes needed after these, in a row or not.
    pub then_more: usize,
    /// Number of trials within which the rule must be met; `None` for no limit.
    pub at_most: Option<usize>,
}

/// The progress of a trainee under a rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PassProgress {
    /// The rule is met.
    Met {
        /// The trial that met it, from 1.
        at: usize,
    },
    /// The rule is not met yet.
    Open {
        /// Passes in a row so far, at most the number that the rule needs.
        in_a_row: usize,
        /// Passes after the row was complete.
        more: usize,
        /// Number of trials so far with unknown outcome.
        unknown: usize,
    },
    /// The rule cannot be met any more within its trials, whether or not the unknown ones were passed.
    OutOfReach,
}

impl PassRule {
    /// The rule itself, if it is usable.
    ///
    /// # Errors
    /// [`NoAnswer::UnusableSetting`] with the name of the unusable part.
    pub fn checked(self) -> Result<Self, NoAnswer> {
        let shortest = self.in_a_row.saturating_add(self.then_more);
        match self {
            Self { in_a_row: 0, .. } => Err(NoAnswer::UnusableSetting("in_a_row")),
            Self { at_most: Some(at_most), .. } if at_most < shortest => Err(NoAnswer::UnusableSetting("at_most")),
            _ => Ok(self),
        }
    }

    /// Evaluates the trials in their order.
    ///
    /// # Errors
    /// As [`Self::checked`].
    pub fn evaluate(self, trials: &[TrialOutcome]) -> Result<PassProgress, NoAnswer> {
        let rule = self.checked()?;
        let counted = &trials[..trials.len().min(rule.at_most.unwrap_or(usize::MAX))];
        let (mut surely, mut at_best) = (PassCount::default(), PassCount::default());
        for (index, trial) in counted.iter().enumerate() {
            surely.add(rule, *trial == TrialOutcome::Passed);
            at_best.add(rule, *trial != TrialOutcome::Failed);
            if surely.missing(rule) == 0 {
                return Ok(PassProgress::Met { at: index + 1 });
            }
        }
        let left = rule.at_most.map_or(usize::MAX, |at_most| at_most - counted.len());
        if at_best.missing(rule) > left {
            return Ok(PassProgress::OutOfReach);
        }
        let unknown = counted.iter().filter(|trial| **trial == TrialOutcome::Unknown).count();
        Ok(PassProgress::Open { in_a_row: surely.in_a_row, more: surely.more, unknown })
    }

    /// The passes that met the rule, or that count towards it so far, as indices among the trials, from 0.
    pub fn counted_passes(self, trials: &[TrialOutcome]) -> Vec<usize> {
        let (mut count, mut made) = (PassCount::default(), Vec::new());
        for (index, trial) in trials.iter().take(self.at_most.unwrap_or(usize::MAX)).enumerate() {
            if count.missing(self) == 0 {
                break;
            }
            count.add(self, *trial == TrialOutcome::Passed);
            match trial {
                TrialOutcome::Passed => made.push(index),
                _ if count.in_a_row == 0 => made.clear(),
                _ => {}
            }
        }
        made
    }
}

/// The passes so far.
#[derive(Clone, Copy, Default)]
struct PassCount {
    in_a_row: usize,
    more: usize,
}

impl PassCount {
    fn add(&mut self, rule: PassRule, passed: bool) {
        match (passed, self.in_a_row == rule.in_a_row) {
            (true, true) => self.more += 1,
            (true, false) => self.in_a_row += 1,
            (false, true) => {}
            (false, false) => self.in_a_row = 0,
        }
    }

    /// Number of passes still missing, in a row where the rule needs that.
    fn missing(self, rule: PassRule) -> usize {
        rule.in_a_row - self.in_a_row + rule.then_more.saturating_sub(self.more)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const RULE: PassRule = PassRule { in_a_row: 2, then_more: 3, at_most: Some(10) };

    fn trials(letters: &str) -> Vec<TrialOutcome> {
        let of = |letter| match letter {
            'p' => TrialOutcome::Passed,
            'f' => TrialOutcome::Failed,
            _ => TrialOutcome::Unknown,
        };
        letters.chars().map(of).collect()
    }

    fn follow(letters: &str) -> PassProgress {
        RULE.evaluate(&trials(letters)).unwrap()
    }

    #[test]
    fn a_rule_is_made_of_the_row_and_the_passes_after_it() {
        let made = |letters: &str| RULE.counted_passes(&trials(letters));
        assert_eq!(
            made("pfppfpfppp"),
            [2, 3, 5, 7, 8],
            "the pass before the row is none of them, nor is one after the end"
        );
        assert_eq!(made("ppfpf"), [0, 1, 3]);
        assert_eq!(made("pfp?"), [] as [usize; 0], "an unknown trial breaks a row");
        assert_eq!(made("fff"), [] as [usize; 0]);
    }

    #[test]
    fn two_in_a_row_and_three_more() {
        assert_eq!(follow("fppfpfpp"), PassProgress::Met { at: 8 });
        assert_eq!(follow("ppppp"), PassProgress::Met { at: 5 });
        assert_eq!(follow("pfpfp"), PassProgress::Open { in_a_row: 1, more: 0, unknown: 0 });
        assert_eq!(follow("ppfp"), PassProgress::Open { in_a_row: 2, more: 1, unknown: 0 });
        assert_eq!(follow(""), PassProgress::Open { in_a_row: 0, more: 0, unknown: 0 });
        assert_eq!(RULE.evaluate(&vec![TrialOutcome::Passed; 500]).unwrap(), PassProgress::Met { at: 5 });
    }

    #[test]
    fn an_unknown_trial_breaks_a_row_and_is_no_pass() {
        assert_eq!(follow("p?p"), PassProgress::Open { in_a_row: 1, more: 0, unknown: 1 });
        assert_eq!(follow("pp???"), PassProgress::Open { in_a_row: 2, more: 0, unknown: 3 });
        assert_eq!(follow("pp?p?pp"), PassProgress::Met { at: 7 });
    }

    #[test]
    fn a_rule_is_out_of_reach_only_if_no_unknown_trial_could_save_it() {
        assert_eq!(follow("ffffff"), PassProgress::OutOfReach);
        assert_eq!(follow("fffff"), PassProgress::Open { in_a_row: 0, more: 0, unknown: 0 });
        assert_eq!(follow("??ffffff?f"), PassProgress::OutOfReach, "three at best");
        assert_eq!(follow("?????fffff"), PassProgress::Open { in_a_row: 0, more: 0, unknown: 5 });
        assert_eq!(
            follow("ffffffffffppppp"),
            PassProgress::OutOfReach,
            "what comes after the last trial does not count"
        );
    }

    #[test]
    fn a_rule_that_cannot_be_met_or_missed_is_refused() {
        let rule = |in_a_row, then_more, at_most| PassRule { in_a_row, then_more, at_most }.evaluate(&[]).map(drop);
        assert_eq!(rule(0, 3, None), Err(NoAnswer::UnusableSetting("in_a_row")));
        assert_eq!(rule(2, 3, Some(4)), Err(NoAnswer::UnusableSetting("at_most")));
        assert_eq!(rule(2, 3, Some(5)), Ok(()));
    }

    proptest! {
        #[test]
        fn knowing_less_never_promotes_nor_sinks(letters in "[pf?]{0,14}", at in 0usize..14) {
            let mut less = trials(&letters);
            if let Some(trial) = less.get_mut(at) {
                *trial = TrialOutcome::Unknown;
            }
            let (known, unknown) = (follow(&letters), RULE.evaluate(&less).unwrap());
            match (known, unknown) {
                (PassProgress::Met { at: known }, PassProgress::Met { at: unknown }) => prop_assert!(unknown >= known),
                (known, PassProgress::Met { .. }) => {
                    return Err(TestCaseError::fail(format!("promoted from {known:?}")));
                }
                (PassProgress::Met { .. } | PassProgress::Open { .. }, unknown) => {
                    prop_assert!(unknown != PassProgress::OutOfReach);
                }
                (PassProgress::OutOfReach, _) => {}
            }
        }
    }
}
