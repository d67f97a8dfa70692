//! Which of the proposed stretches are told: the weightiest that the replicates bear out.

use super::super::features::motion::{Interval, Motion};
use super::super::features::view::Cause;
use super::super::score::distribution::student_quantile;
use super::{MOST_STRETCHES, NoStretches, Stretch, What};

/// Stretches that are tried for these, the weightiest first.
const TRIED: usize = 8;

/// The chance that errors alone make one of all stretches of a feature stand out, one-sided. The weightiest of many is weighty by
/// luck too, so each is asked with its share of this (Bonferroni).
const BY_CHANCE: f64 = 0.025;

/// Of a stretch that is the hand's at least this share of it is left once what errors add is taken off.
const LEFT_SHARE: f64 = 0.5;

/// Of the replicates so many must have a stretch's amount at all.
const ENOUGH_SHARE: f64 = 0.85;

/// How much of something a stretch holds on these motions, one's own first; `None` where that cannot be said.
pub(super) type Amount<'a> = Box<dyn Fn(&[&Motion], Interval) -> Option<f64> + 'a>;

/// What is asked about one feature.
pub(super) struct Question<'a> {
    pub(super) what: What,
    /// Stretches to weigh.
    pub(super) proposed: Vec<(Interval, Option<Cause>)>,
    pub(super) amount: Amount<'a>,
    /// An amount that is as usual in this session.
    pub(super) usual: f64,
    /// Is less of it more of a fault?
    pub(super) less_is_worse: bool,
    /// How amounts make the value.
    pub(super) adds: Adds,
    /// How errors come into an amount.
    pub(super) errors: Errors,
}

/// How stretches' amounts make a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Adds {
    /// They do not add up.
    Not,
    /// Their sum over all of the task is this.
    Up(f64),
    /// The sum of their squares is this.
    InSquares(f64),
}

/// How errors come into an amount.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Errors {
    /// As they come into a length: in squares.
    InSquares,
    /// Otherwise.
    Plainly,
    /// Not at all.
    Not,
}

/// A stretch that may be told, and what the replicates say of it.
pub(super) struct Candidate {
    pub(super) interval: Interval,
    pub(super) cause: Option<Cause>,
    pub(super) amount: f64,
    pub(super) replicated: Vec<f64>,
}

impl Question<'_> {
    /// The weightiest of what is proposed that do not overlap and are more than usual.
    pub(super) fn weightiest(&self, motions: &[&Motion]) -> Vec<Candidate> {
        let amount = |&(interval, cause): &(Interval, Option<Cause>)| {
            let amount = (self.amount)(motions, interval).filter(|amount| amount.is_finite())?;
            Some(Candidate { interval, cause, amount, replicated: Vec::new() })
        };
        let mut all: Vec<Candidate> = self.proposed.iter().filter_map(amount).collect();
        all.retain(|candidate| self.faulty(candidate.amount) > self.faulty(self.usual));
        // Of amounts that differ by rounding alone the earlier goes first.
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

    /// An amount, larger where it is worse.
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
        let told: Vec<Stretch> = candidates.iter().filter(is_the_hands).take(MOST_STRETCHES).map(stretch).collect();
        if told.is_empty() { Err(NoStretches::NothingStandsOut) } else { Ok(told) }
    }

    /// Would it still stand out without what errors add?
    fn is_the_hands(&self, Candidate { interval, amount, replicated, .. }: &Candidate, heard: usize) -> bool {
        let n = replicated.len() as f64;
        if n < 2.0 || n < ENOUGH_SHARE * heard as f64 {
            return false;
        }
        let mean = replicated.iter().sum::<f64>() / n;
        let spread = (replicated.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        let (measured, mean, usual) = (self.faulty(*amount), self.faulty(mean), self.faulty(self.usual));
        let added = (mean - measured).max(0.0); // as much again as errors have added already
        let left = match self.errors {
            Errors::InSquares if added > 0.0 => (2.0 * measured * measured - mean * mean).max(0.0).sqrt(),
            _ => measured - added,
        };
        let is_mostly_left = self.errors != Errors::InSquares || left >= LEFT_SHARE * measured;
        let sigmas = student_quantile(1.0 - BY_CHANCE / self.stretches_like(*interval), n - 1.0);
        is_mostly_left && left - usual > sigmas * spread
    }

    /// How many stretches of this length there are side by side in all that was proposed.
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
