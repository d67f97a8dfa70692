//! Selects the stretches to report: the weightiest proposed ones that the replicates confirm.

use super::super::features::motion::{Interval, Motion};
use super::super::features::view::Cause;
use super::super::score::distribution::student_quantile;
use super::{MOST_STRETCHES, NoStretches, Stretch, What};

/// Maximum number of candidates that are tested on the replicates, the weightiest first.
const TRIED: usize = 8;

/// Chance that errors alone make any stretch of a feature stand out, one-sided. The weightiest of many stretches is
/// partly weighty by luck, so each is tested at its share of this chance (Bonferroni).
const BY_CHANCE: f64 = 0.025;

/// Minimum share of a stretch's amount that must remain after the amount added by errors is removed.
const LEFT_SHARE: f64 = 0.5;

/// Minimum share of the replicates that must have an amount for a stretch.
const ENOUGH_SHARE: f64 = 0.85;

/// Measures the amount of a stretch on these motions, the tool's own first; `None` if it cannot be measured.
pub(super) type Amount<'a> = Box<dyn Fn(&[&Motion], Interval) -> Option<f64> + 'a>;

/// How to find the stretches of one feature.
pub(super) struct Question<'a> {
    pub(super) what: What,
    /// Stretches to test.
    pub(super) proposed: Vec<(Interval, Option<Cause>)>,
    pub(super) amount: Amount<'a>,
    /// The usual amount in this session.
    pub(super) usual: f64,
    /// True if a smaller amount is worse.
    pub(super) less_is_worse: bool,
    /// How the amounts add up to the value.
    pub(super) adds: Adds,
    /// How errors add to an amount.
    pub(super) errors: Errors,
}

/// How the amounts of stretches add up to a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Adds {
    /// They do not add up.
    Not,
    /// Their sum over the whole task is this.
    Up(f64),
    /// The sum of their squares is this.
    InSquares(f64),
}

/// How errors add to an amount.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Errors {
    /// In squares, as they add to a length.
    InSquares,
    /// In another way; the shift is removed linearly.
    Plainly,
    /// Not at all.
    Not,
}

/// A stretch that may be reported, with its amounts on the replicates.
pub(super) struct Candidate {
    pub(super) interval: Interval,
    pub(super) cause: Option<Cause>,
    pub(super) amount: f64,
    pub(super) replicated: Vec<f64>,
}

impl Question<'_> {
    /// The weightiest proposed stretches that do not overlap and exceed the usual amount.
    pub(super) fn weightiest(&self, motions: &[&Motion]) -> Vec<Candidate> {
        let amount = |&(interval, cause): &(Interval, Option<Cause>)| {
            let amount = (self.amount)(motions, interval).filter(|amount| amount.is_finite())?;
            Some(Candidate { interval, cause, amount, replicated: Vec::new() })
        };
        let mut all: Vec<Candidate> = self.proposed.iter().filter_map(amount).collect();
        all.retain(|candidate| self.faulty(candidate.amount) > self.faulty(self.usual));
        // Of amounts that differ only by rounding, the earlier stretch comes first.
        let weight = |candidate: &Candidate| self.faulty(candidate.amount) as f32;
        all.sort_by(|a, b| weight(b).total_cmp(&weight(a)).then(a.interval.first.cmp(&b.interval.first)));
        let mut kept: Vec<Candidate> = Vec::new();
        for candidate in all {
            let overlaps = kept.iter().any(|other| other.interval.common(candidate.interval).is_some());
            if kept.len() < TRIED && !overlaps {
                kept.push(candidate);
            }
        }
        kept
    }

    /// The amount with its sign set so that larger is worse.
    fn faulty(&self, amount: f64) -> f64 {
        if self.less_is_worse { -amount } else { amount }
    }

    pub(super) fn told(
        &self,
        candidates: &[Candidate],
        heard: usize,
        step_s: f64,
    ) -> Result<Vec<Stretch>, NoStretches> {
        if self.proposed.is_empty() {
            return Err(NoStretches::Nothing);
        }
        if heard == 0 && self.errors != Errors::Not {
            return Err(NoStretches::NotStated);
        }
        let is_the_hands = |candidate: &&Candidate| self.errors == Errors::Not || self.is_the_hands(candidate, heard);
        let stretch = |candidate: &Candidate| Stretch {
            from_s: candidate.interval.first as f64 * step_s,
            to_s: candidate.interval.last as f64 * step_s,
            amount: candidate.amount,
            share: self.adds.share(candidate.amount),
            cause: candidate.cause,
        };
        let selected: Vec<Stretch> = candidates.iter().filter(is_the_hands).take(MOST_STRETCHES).map(stretch).collect();
        if selected.is_empty() { Err(NoStretches::NothingStandsOut) } else { Ok(selected) }
    }

    /// True if the stretch still stands out after the amount added by errors is removed.
    fn is_the_hands(&self, Candidate { interval, amount, replicated, .. }: &Candidate, heard: usize) -> bool {
        let n = replicated.len() as f64;
        if n < 2.0 || n < ENOUGH_SHARE * heard as f64 {
            return false;
        }
        let mean = replicated.iter().sum::<f64>() / n;
        let spread = (replicated.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        let (measured, mean, usual) = (self.faulty(*amount), self.faulty(mean), self.faulty(self.usual));
        let added = (mean - measured).max(0.0); // errors have already added this much once
        let left = match self.errors {
            Errors::InSquares if added > 0.0 => (2.0 * measured * measured - mean * mean).max(0.0).sqrt(),
            _ => measured - added,
        };
        let is_mostly_left = self.errors != Errors::InSquares || left >= LEFT_SHARE * measured;
        let sigmas = student_quantile(1.0 - BY_CHANCE / self.stretches_like(*interval), n - 1.0);
        is_mostly_left && left - usual > sigmas * spread
    }

    /// How many stretches of this length fit side by side into the proposed time.
    fn stretches_like(&self, interval: Interval) -> f64 {
        let mut all: Vec<Interval> = self.proposed.iter().map(|(interval, _)| *interval).collect();
        all.sort_by_key(|interval| interval.first);
        let (mut covered, mut until) = (0, i64::MIN);
        for Interval { first, last } in all {
            covered += (last - first.max(until)).max(0);
            until = until.max(last);
        }
        (covered as f64 / interval.steps().max(1) as f64).clamp(1.0, self.proposed.len() as f64)
    }
}

impl Adds {
    fn share(self, amount: f64) -> Option<f64> {
        let share = match self {
            Adds::Not => return None,
            Adds::Up(total) => amount / total,
            Adds::InSquares(total) => amount * amount / total,
        };
        (share.is_finite() && share >= 0.0).then(|| share.min(1.0))
    }
}
