//! Target times that the Fundamentals of Laparoscopic Surgery (FLS) publish (METHOD 7.1). They are external: measured
//! with other boxes and hand-held clocks, not here.

use super::{FeatureTarget, TargetBasis};
use crate::motion::features::Direction;
use crate::statistics::pass_rule::PassRule;

/// A published target of one task.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlsTarget {
    /// Stable name of the task.
    pub task: &'static str,
    /// Display name.
    pub title: &'static str,
    /// The duration that must not be exceeded.
    pub duration: FeatureTarget,
    /// The pass rule; `None` if the available source does not state it.
    pub rule: Option<PassRule>,
}

const fn preset(task: &'static str, title: &'static str, limit_s: f64, rule: Option<PassRule>) -> FlsTarget {
    let basis = TargetBasis::External { source: "Fundamentals of Laparoscopic Surgery" };
    let duration = FeatureTarget { limit: limit_s, interval: None, direction: Direction::Lower, basis };
    FlsTarget { task, title, duration, rule }
}

/// Twice in a row and ten times more, in 80 trials at most.
const PEG_RULE: PassRule = PassRule { in_a_row: 2, then_more: 10, at_most: Some(80) };

/// The five tasks. Limits in seconds.
pub static FLS: [FlsTarget; 5] = [
    preset("peg_transfer", "Peg transfer", 48.0, Some(PEG_RULE)),
    preset("pattern_cut", "Pattern cutting", 98.0, None),
    preset("loop", "Ligating loop", 53.0, None),
    preset("extracorporeal_knot", "Suture with extracorporeal knot", 136.0, None),
    preset("intracorporeal_knot", "Suture with intracorporeal knot", 112.0, None),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_times_are_targets_to_keep_from_below_and_say_that_they_are_external() {
        assert_eq!(FLS.each_ref().map(|preset| preset.duration.limit), [48.0, 98.0, 53.0, 136.0, 112.0]);
        for preset in &FLS {
            assert_eq!(preset.duration.direction, Direction::Lower);
            assert!(matches!(preset.duration.basis, TargetBasis::External { .. }));
            assert!(preset.rule.is_none_or(|rule| rule.checked().is_ok()));
        }
    }
}
