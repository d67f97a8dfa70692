//! Evidence: the seconds that made a feature what it is, so that a person can look at them.
//!
//! **In:** the motions that the features were measured on, and the same as they could have been seen just as well
//! ([`super::features::errors::replicate`]). **Out:** for each feature, tool and space at most [`MOST_STRETCHES`] stretches of
//! time that do not overlap, the weightiest first, or the reason why there are none.
//!
//! **Method.** What a feature's evidence is stands in one table, [`kinds`]: a pause is a rest, a long path its detours, a
//! trembling hand the bursts of 3 to 6 Hz. Each kind proposes stretches and says how much each holds; the weightiest are asked
//! again of every replicate of the path. What errors alone would add is taken off, and only what then still lies beyond the
//! session's own usual by more than errors make of the weightiest of so many is told: a place where the tracker trembles is
//! nobody's tremor. A stretch lies in what was seen; where nothing was seen, only the features of the view point, and say whose
//! doing it was.
//!
//! | file | holds |
//! |---|---|
//! | `kinds.rs` | what each feature's evidence is |
//! | `rests.rs` | rests, slowness, hands at rest or alone |
//! | `movements.rs` | movements, their detours and their measures |
//! | `seconds.rs` | the fastest, most crooked, farthest seconds |
//! | `bursts.rs` | power in a band of frequencies |
//! | `absences.rs` | where a tool was not seen |
//! | `weigh.rs` | which stretches are told |
//!
//! **Gives up** with [`NoStretches`]: a path that does not state its own errors has no evidence, for nobody could tell the hand
//! from the tracker.

mod absences;
mod bursts;
mod kinds;
mod movements;
mod rests;
mod seconds;
mod weigh;

#[cfg(test)]
mod tests;

use std::borrow::Cow;

use super::features::motion::{Interval, Motion, Node};
use super::features::view::Cause;
use super::features::{Feature, FeatureSettings, FeatureValue, NotEnough, Space};
use weigh::{Adds, Amount, Candidate, Errors, Question};

/// Stretches that are told of a feature, at most: who looks at three places has seen the fault.
pub const MOST_STRETCHES: usize = 3;

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
    /// The task has no stretch of this kind: no rest, no absence, no movement.
    #[error("the task has no stretch of this kind")]
    Nothing,
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
            NoStretches::Nothing => "nothing",
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
                (Ok(measured), motions) => {
                    kinds::question(value, measured, motions, settings).ok_or(NoStretches::Whole)
                }
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

/// The tools' motions in one space.
struct Flat<'m>(Vec<Option<Cow<'m, Motion>>>);

impl<'m> Flat<'m> {
    fn of(motions: &'m [Result<Motion, NotEnough>], space: Space) -> Self {
        let in_space = |motion: &'m Motion| match space {
            Space::ThreeD => Cow::Borrowed(motion),
            Space::Image => Cow::Owned(motion.in_space(space)),
        };
        Self(motions.iter().map(|motion| motion.as_ref().ok().map(in_space)).collect())
    }

    /// The motions that a value was measured on: one's own first, then the others; of the session all of them.
    fn of_value(&self, tool: Option<usize>) -> Vec<&Motion> {
        let own = tool.map(|tool| self.0.get(tool).and_then(Option::as_deref));
        let others = self.0.iter().enumerate().filter(|(index, _)| Some(*index) != tool);
        let others = others.filter_map(|(_, motion)| motion.as_deref());
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
