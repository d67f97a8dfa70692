//! Evidence: the seconds that made a feature what it is, so that a person can look at them.
//!
//! **In:** the motions that the features were measured on, and the same as they could have been seen just as well
//! ([`super::features::errors::replicate`]). **Out:** for each feature, tool and space at most [`MOST_STRETCHES`] stretches of time
//! that do not overlap, the weightiest first, or the reason why there are none.
//!
//! **Method.** What a feature's evidence is stands in one table, [`kinds`]: a pause is a rest, a long path its detours, a
//! trembling hand the bursts of 3 to 6 Hz. Each kind proposes stretches and says how much each holds; the weightiest are asked
//! again of every replicate of the path. What errors alone would add is taken off, and only what then still lies beyond the
//! session's own usual by more than errors make of the weightiest of so many is told: a place where the tracker trembles is
//! nobody's tremor. A stretch lies in what was seen; where nothing was seen, only the features of the view point, and say whose doing it was.
//!
//! | file | holds |
//! |---|---|
//! | `kinds.rs` | what each feature's evidence is |
//! | `rests.rs` | rests, slowness, hands at rest or alone |
//! | `movements.rs` | movements, their detours and their measures |
//! | `seconds.rs` | the fastest, most crooked, farthest seconds |
//! | `bursts.rs` | power in a band of frequencies |
//! | `absences.rs` | where a tool was not seen |
//!
//! **Gives up** with [`NoStretches`]: a path that does not state its own errors has no evidence, for nobody could tell the hand
//! from the tracker.

mod absences;
mod bursts;
mod kinds;
mod movements;
mod rests;
mod seconds;

#[cfg(test)]
mod tests;

use super::features::motion::{Interval, Motion, Node};
use super::features::view::Cause;
use super::features::{Feature, FeatureSettings, FeatureValue, NotEnough, Space};
use super::score::distribution::student_quantile;

/// Stretches that are told of a feature, at most: who looks at three places has seen the fault.
pub const MOST_STRETCHES: usize = 3;

/// Stretches that are tried for these, the weightiest first.
const TRIED: usize = 8;

/// The chance that errors alone make one of all stretches of a feature stand out, one-sided. The weightiest of many is weighty by
/// luck too, so each is asked with its share of this (Bonferroni).
const BY_CHANCE: f64 = 0.025;

/// Of a stretch that is the hand's at least this share of it is left once what errors add is taken off.
const LEFT_SHARE: f64 = 0.5;

/// Of the replicates so many must have a stretch's amount at all.
const ENOUGH_SHARE: f64 = 0.85;

/// The seconds that made one feature.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    /// Of which feature.
    pub feature: &'static Feature,
    /// Whose, as an index into the trajectory's tools; `None` for the session as a whole.
    pub tool: Option<usize>,
    /// In which space.
    pub space: Space,
    /// What the stretches are; `None` where the feature has no place in time.
    pub what: Option<What>,
    /// The stretches, the weightiest first, or why there are none.
    pub stretches: Result<Vec<Stretch>, NoStretches>,
}

/// What a stretch is, and what it is weighed by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct What {
    /// Stable name for files, API and pages.
    pub name: &'static str,
    /// Unit of [`Stretch::amount`]; `1` for shares, counts and ratios.
    pub unit: &'static str,
}

/// A stretch of time that made a feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Start, s on the recording's clock.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// How much of it there was, in the unit of [`What`], as measured.
    pub amount: f64,
    /// The share of the feature's value, as measured, that it made, 0 to 1; `None` of what does not add up.
    pub share: Option<f64>,
    /// Where the tool was not seen: whose doing that was, if the tracker says.
    pub cause: Option<Cause>,
}

/// Why a feature has no stretches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoStretches {
    /// It has no place in time.
    #[error("the whole task made it alike")]
    Whole,
    /// There is no value that anything could have made.
    #[error("there is no value")]
    NoValue,
    /// The path does not say how far it may be off.
    #[error("the path does not state its own errors, so that the hand's doing cannot be told from the tracker's")]
    NotStated,
    /// All of it could be errors, or is as usual.
    #[error("no part of the task stands out from the rest of it by more than the path's errors")]
    NothingStandsOut,
    /// The session is refused.
    #[error("the session is refused")]
    Refused,
}

impl NoStretches {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            NoStretches::Whole => "whole_task",
            NoStretches::NoValue => "no_value",
            NoStretches::NotStated => "errors_not_stated",
            NoStretches::NothingStandsOut => "nothing_stands_out",
            NoStretches::Refused => "refused",
        }
    }
}

impl Evidence {
    /// The same of a session whose numbers must not be believed.
    pub fn withheld(self) -> Self {
        Self { stretches: Err(NoStretches::Refused), ..self }
    }
}

/// How much of something a stretch holds on these motions, one's own first; `None` where that cannot be said.
type Amount<'a> = Box<dyn Fn(&[&Motion], Interval) -> Option<f64> + 'a>;

/// What is asked about one feature.
struct Question<'a> {
    what: What,
    /// Stretches to weigh.
    proposed: Vec<(Interval, Option<Cause>)>,
    amount: Amount<'a>,
    /// An amount that is as usual in this session.
    usual: f64,
    /// Is less of it more of a fault?
    less_is_worse: bool,
    /// How amounts make the value.
    adds: Adds,
    /// How errors come into an amount.
    errors: Errors,
}

/// How stretches' amounts make a value.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Adds {
    /// They do not add up.
    Not,
    /// Their sum over all of the task is this.
    Up(f64),
    /// The sum of their squares is this.
    InSquares(f64),
}

/// How errors come into an amount.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Errors {
    /// As they come into a length: in squares.
    InSquares,
    /// Otherwise.
    Plainly,
    /// Not at all.
    Not,
}

/// A stretch that may be told, and what the replicates say of it.
struct Candidate {
    interval: Interval,
    cause: Option<Cause>,
    amount: f64,
    replicated: Vec<f64>,
}

/// Evidence while it is gathered: stretches are proposed once, then every replicate of the path is heard.
pub struct Gathering<'a> {
    asked: Vec<Asked<'a>>,
    heard: usize,
}

struct Asked<'a> {
    value: FeatureValue,
    question: Result<Question<'a>, NoStretches>,
    candidates: Vec<Candidate>,
}

impl<'a> Gathering<'a> {
    /// Proposes stretches for these values. They were measured on these motions, with errors or without; values are as measured.
    pub fn new(
        values: &[FeatureValue],
        motions: &'a [Result<Motion, NotEnough>],
        settings: &'a FeatureSettings,
    ) -> Self {
        let in_space = |space| Flat::of(motions, space);
        let spaces = [in_space(Space::ThreeD), in_space(Space::Image)];
        let asked = |value: &FeatureValue| {
            let motions = spaces[usize::from(value.space == Space::Image)].of_value(value.tool);
            let question = match (value.value, motions.as_slice()) {
                (Err(_), _) | (_, []) => Err(NoStretches::NoValue),
                (Ok(measured), motions) => kinds::question(value, measured, motions, settings).ok_or(NoStretches::Whole),
            };
            let candidates = question.as_ref().map_or_else(|_| Vec::new(), |question| question.weightiest(&motions));
            Asked { value: value.clone(), question, candidates }
        };
        Self { asked: values.iter().map(asked).collect(), heard: 0 }
    }

    /// Asks a replicate of the path how much of each stretch is in it.
    pub fn hear(&mut self, motions: &[Result<Motion, NotEnough>]) {
        let spaces = [Space::ThreeD, Space::Image].map(|space| Flat::of(motions, space));
        self.heard += 1;
        for Asked { value, question, candidates } in &mut self.asked {
            let Ok(question) = question else { continue };
            let motions = spaces[usize::from(value.space == Space::Image)].of_value(value.tool);
            for candidate in candidates.iter_mut().filter(|_| question.errors != Errors::Not) {
                candidate.replicated.extend((question.amount)(&motions, candidate.interval).filter(|a| a.is_finite()));
            }
        }
    }

    /// What is the hand's doing, of all that was proposed. A path of which no replicate was heard does not state its errors.
    pub fn end(self, step_s: f64) -> Vec<Evidence> {
        let heard = self.heard;
        self.asked.into_iter().map(|asked| asked.end(heard, step_s)).collect()
    }
}

impl Asked<'_> {
    fn end(self, heard: usize, step_s: f64) -> Evidence {
        let FeatureValue { feature, tool, space, .. } = self.value;
        let what = self.question.as_ref().ok().map(|question| question.what);
        let stretches = self.question.and_then(|question| question.told(&self.candidates, heard, step_s));
        Evidence { feature, tool, space, what, stretches }
    }
}

impl Question<'_> {
    /// The weightiest of what is proposed that do not overlap and are more than usual.
    fn weightiest(&self, motions: &[&Motion]) -> Vec<Candidate> {
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

    fn told(&self, candidates: &[Candidate], heard: usize, step_s: f64) -> Result<Vec<Stretch>, NoStretches> {
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

/// The tools' motions in one space.
struct Flat(Vec<Option<Motion>>);

impl Flat {
    fn of(motions: &[Result<Motion, NotEnough>], space: Space) -> Self {
        Self(motions.iter().map(|motion| motion.as_ref().ok().map(|motion| motion.in_space(space))).collect())
    }

    /// The motions that a value was measured on: one's own first, then the others; of the session all of them.
    fn of_value(&self, tool: Option<usize>) -> Vec<&Motion> {
        let own = tool.map(|tool| self.0.get(tool).and_then(Option::as_ref));
        let others = self.0.iter().enumerate().filter(|(index, _)| Some(*index) != tool);
        let others = others.filter_map(|(_, motion)| motion.as_ref());
        match own {
            Some(None) => Vec::new(),
            own => own.flatten().into_iter().chain(others).collect(),
        }
    }
}

/// The nodes of a motion within an interval, if it was seen all the time.
fn nodes(motion: &Motion, interval: Interval) -> Option<&[Node]> {
    let next = motion.spans.partition_point(|span| span.last() < interval.first);
    let span = motion.spans.get(next)?;
    let index = |instant: i64| usize::try_from(instant - span.first).ok();
    span.nodes.get(index(interval.first)?..=index(interval.last)?)
}

/// How long an interval is, s.
fn seconds_of(interval: Interval, motion: &Motion) -> f64 {
    interval.steps() as f64 * motion.step_s
}

/// Neighbouring nodes: steps of the path.
fn steps(nodes: &[Node]) -> impl Iterator<Item = (&Node, &Node)> {
    nodes.iter().zip(nodes.iter().skip(1))
}
