//! Selects the stretches to report: the weightiest proposed ones that the replicates confirm.

use super::{MAX_STRETCHES, NoStretches, Stretch, StretchKind};
use crate::motion::features::motion::{Interval, Motion};
use crate::motion::features::view::UnseenCause;
use crate::numbers::distribution::student_quantile;

/// Maximum number of candidates that are tested on the replicates, the weightiest first.
const MAX_CANDIDATES: usize = 8;

/// Chance that errors alone make any stretch of a feature stand out, one-sided. The weightiest of many stretches is
/// partly weighty by luck, so each is tested at its share of this chance (Bonferroni).
const SIGNIFICANCE: f64 = 0.025;

/// Minimum share of a stretch's amount that must remain after the amount added by errors is removed.
const MIN_REMAINING_SHARE: f64 = 0.5;

/// Minimum share of the replicates that must have an amount for a stretch.
const MIN_REPLICATE_SHARE: f64 = 0.85;

/// Measures the amount of a stretch on these motions, the tool's own first; `None` if it cannot be measured.
pub(super) type MeasureAmount<'a> = Box<dyn Fn(&[&Motion], Interval) -> Option<f64> + 'a>;

/// How to find the stretches of one feature.
pub(super) struct StretchSearch<'a> {
    pub(super) kind: StretchKind,
    /// Stretches to test.
    pub(super) proposed: Vec<(Interval, Option<UnseenCause>)>,
    pub(super) amount: MeasureAmount<'a>,
    /// The usual amount in this session.
    pub(super) usual_amount: f64,
    /// True if a smaller amount is worse.
    pub(super) less_is_worse: bool,
    /// How the amounts add up to the value.
    pub(super) additivity: Additivity,
    /// How errors add to an amount.
    pub(super) error_effect: ErrorEffect,
}

/// How the amounts of stretches add up to a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Additivity {
    /// They do not add up.
    NotAdditive,
    /// Their sum over the whole task is this.
    Sum(f64),
    /// The sum of their squares is this.
    SumOfSquares(f64),
}

/// How errors add to an amount.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ErrorEffect {
    /// In squares, as they add to a length.
    InSquares,
    /// In another way; the shift is removed linearly.
    Linear,
    /// Not at all.
    NoEffect,
}

/// A stretch that may be reported, with its amounts on the replicates.
pub(super) struct StretchCandidate {
    pub(super) interval: Interval,
    pub(super) cause: Option<UnseenCause>,
    pub(super) amount: f64,
    pub(super) replicate_amounts: Vec<f64>,
}

impl StretchSearch<'_> {
    /// The weightiest proposed stretches that do not overlap and exceed the usual amount.
    pub(super) fn find_candidates(&self, motions: &[&Motion]) -> Vec<StretchCandidate> {
        let amount = |&(interval, cause): &(Interval, Option<UnseenCause>)| {
            let amount = (self.amount)(motions, interval).filter(|amount| amount.is_finite())?;
            Some(StretchCandidate { interval, cause, amount, replicate_amounts: Vec::new() })
        };
        let mut all: Vec<StretchCandidate> = self.proposed.iter().filter_map(amount).collect();
        all.retain(|candidate| self.badness(candidate.amount) > self.badness(self.usual_amount));
        // Of amounts that differ only by rounding, the earlier stretch comes first.
        let weight = |candidate: &StretchCandidate| self.badness(candidate.amount) as f32;
        all.sort_by(|a, b| weight(b).total_cmp(&weight(a)).then(a.interval.first.cmp(&b.interval.first)));
        let mut kept: Vec<StretchCandidate> = Vec::new();
        for candidate in all {
            let overlaps = kept.iter().any(|other| other.interval.intersection(candidate.interval).is_some());
            if kept.len() < MAX_CANDIDATES && !overlaps {
                kept.push(candidate);
            }
        }
        kept
    }

    /// The amount with its sign set so that larger is worse.
    fn badness(&self, amount: f64) -> f64 {
        if self.less_is_worse { -amount } else { amount }
    }

    pub(super) fn select_stretches(
        &self,
        candidates: &[StretchCandidate],
        heard: usize,
        step_s: f64,
    ) -> Result<Vec<Stretch>, NoStretches> {
        if self.proposed.is_empty() {
            return Err(NoStretches::NoneOfThisKind);
        }
        if heard == 0 && self.error_effect != ErrorEffect::NoEffect {
            return Err(NoStretches::ErrorsNotStated);
        }
        let is_the_hands = |candidate: &&StretchCandidate| {
            self.error_effect == ErrorEffect::NoEffect || self.exceeds_errors(candidate, heard)
        };
        let stretch = |candidate: &StretchCandidate| Stretch {
            from_s: candidate.interval.first as f64 * step_s,
            to_s: candidate.interval.last as f64 * step_s,
            amount: candidate.amount,
            share: self.additivity.share(candidate.amount),
            cause: candidate.cause,
        };
        let selected: Vec<Stretch> = candidates.iter().filter(is_the_hands).take(MAX_STRETCHES).map(stretch).collect();
        if selected.is_empty() { Err(NoStretches::NothingStandsOut) } else { Ok(selected) }
    }

    /// True if the stretch still stands out after the amount added by errors is removed.
    fn exceeds_errors(
        &self,
        StretchCandidate { interval, amount, replicate_amounts: replicated, .. }: &StretchCandidate,
        heard: usize,
    ) -> bool {
        let n = replicated.len() as f64;
        if n < 2.0 || n < MIN_REPLICATE_SHARE * heard as f64 {
            return false;
        }
        let mean = replicated.iter().sum::<f64>() / n;
        let spread = (replicated.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        let (measured, mean, usual) = (self.badness(*amount), self.badness(mean), self.badness(self.usual_amount));
        let added = (mean - measured).max(0.0); // errors have already added this much once
        let left = match self.error_effect {
            ErrorEffect::InSquares if added > 0.0 => (2.0 * measured * measured - mean * mean).max(0.0).sqrt(),
            _ => measured - added,
        };
        let is_mostly_left = self.error_effect != ErrorEffect::InSquares || left >= MIN_REMAINING_SHARE * measured;
        let sigmas = student_quantile(1.0 - SIGNIFICANCE / self.comparable_stretches(*interval), n - 1.0);
        is_mostly_left && left - usual > sigmas * spread
    }

    /// How many stretches of this length fit side by side into the proposed time.
    fn comparable_stretches(&self, interval: Interval) -> f64 {
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

impl Additivity {
    fn share(self, amount: f64) -> Option<f64> {
        let share = match self {
            Additivity::NotAdditive => return None,
            Additivity::Sum(total) => amount / total,
            Additivity::SumOfSquares(total) => amount * amount / total,
        };
        (share.is_finite() && share >= 0.0).then(|| share.min(1.0))
    }
}
