//! Feature stretches: the seconds that made a feature what it is, so that a person can watch them.
//!
//! **In:** the motions that the features were measured on, and replicates of them as the tracker could have seen them
//! just as well ([`crate::motion::features::errors::replicate`]). **Out:** for each feature, tool and space at most
//! [`MAX_STRETCHES`] stretches of time that do not overlap, the weightiest first, or the reason why there are none.
//!
//! **Method.** Each feature states the kind of stretch that explains it: for pauses the rests, for a long path the
//! detours, for tremor the bursts in its band. Each kind proposes stretches and measures how much each contains.
//! The weightiest ones are measured again on every replicate of the path. The amount that errors alone add is removed.
//! A stretch is reported only if the remaining amount exceeds the session's usual one by more than errors can explain
//! for the weightiest of so many: trembling of the tracker must not count as tremor of the hand. A stretch lies where
//! the tool was seen. Only the features of the view report stretches where it was not seen, with the cause.
//!
//! | file | contents |
//! |---|---|
//! | `kinds.rs` | how the stretches of each kind are found |
//! | `rests.rs` | rests, slow motion, hands at rest or alone |
//! | `movements.rs` | movements, their detours and their measures |
//! | `seconds.rs` | the fastest, most crooked, farthest seconds |
//! | `bursts.rs` | power in a frequency band |
//! | `absences.rs` | where a tool was not seen |
//! | `weigh.rs` | the selection of the stretches to report |
//!
//! **Gives up** with [`NoStretches`]: a path that does not state its own errors has no stretches, because the hand's
//! motion could not be distinguished from the tracker's errors.

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

use crate::motion::features::motion::{Interval, Motion, MotionNode};
use crate::motion::features::view::UnseenCause;
use crate::motion::features::{Feature, FeatureSettings, FeatureValue, NotEnough, Space};
use weigh::{Additivity, ErrorEffect, MeasureAmount, StretchCandidate, StretchSearch};

/// Maximum number of stretches per feature: three places are enough to see a fault.
pub const MAX_STRETCHES: usize = 3;

/// The seconds that made one feature.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureStretches {
    /// The feature.
    pub feature: &'static Feature,
    /// The tool, as an index into the trajectory's tools; `None` for the session as a whole.
    pub tool: Option<usize>,
    /// The space it was measured in.
    pub space: Space,
    /// The kind of its stretches; `None` if the whole task contributes alike.
    pub kind: Option<StretchKind>,
    /// The stretches, the weightiest first, or why there are none.
    pub stretches: Result<Vec<Stretch>, NoStretches>,
}

/// The kind of a stretch, and the unit that it is weighed in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StretchKind {
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
    /// The measured amount, in the unit of [`StretchKind`].
    pub amount: f64,
    /// Its share of the feature's measured value, 0 to 1; `None` if amounts do not add up to the value.
    pub share: Option<f64>,
    /// For a stretch where the tool was not seen: the cause, if the tracker states it.
    pub cause: Option<UnseenCause>,
}

/// Why a feature has no stretches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoStretches {
    /// The whole task contributes alike.
    #[error("the whole task contributed equally")]
    WholeTask,
    /// The feature has no value.
    #[error("there is no value")]
    NoValue,
    /// The path does not state its own errors.
    #[error("the path does not state its own errors, so the hand's motion cannot be distinguished from them")]
    ErrorsNotStated,
    /// The task has no stretch of this kind: no rest, no absence, no movement.
    #[error("the task has no stretch of this kind")]
    NoneOfThisKind,
    /// Nothing exceeds the usual amount by more than errors can explain.
    #[error("no part of the task differs from the rest by more than the path's errors")]
    NothingStandsOut,
    /// The session is refused.
    #[error("the session was refused")]
    Refused,
}

impl NoStretches {
    /// Stable name for files, API and pages.
    pub fn name(self) -> &'static str {
        match self {
            NoStretches::WholeTask => "whole_task",
            NoStretches::NoValue => "no_value",
            NoStretches::ErrorsNotStated => "errors_not_stated",
            NoStretches::NoneOfThisKind => "nothing",
            NoStretches::NothingStandsOut => "nothing_stands_out",
            NoStretches::Refused => "refused",
        }
    }
}

impl FeatureStretches {
    /// The same with the stretches withheld, for a session whose measurements cannot be trusted.
    pub fn withheld(self) -> Self {
        Self { stretches: Err(NoStretches::Refused), ..self }
    }
}

/// Collects feature stretches: proposes candidates once, then measures them on every replicate of the path.
pub struct StretchCollector<'a> {
    searches: Vec<FeatureSearch<'a>>,
    replicates: usize,
}

struct FeatureSearch<'a> {
    value: FeatureValue,
    search: Result<StretchSearch<'a>, NoStretches>,
    candidates: Vec<StretchCandidate>,
}

impl<'a> StretchCollector<'a> {
    /// Proposes stretches for these values. The values are as measured on these motions; whether they state errors does
    /// not matter.
    pub fn new(
        values: &[FeatureValue],
        motions: &'a [Result<Motion, NotEnough>],
        settings: &'a FeatureSettings,
    ) -> Self {
        let in_space = |space| MotionsInSpace::of(motions, space);
        let spaces = [in_space(Space::ThreeD), in_space(Space::Image)];
        let asked = |value: &FeatureValue| {
            let motions = spaces[usize::from(value.space == Space::Image)].motions_of_value(value.tool);
            let question = match (value.value, motions.as_slice()) {
                (Err(_), _) | (_, []) => Err(NoStretches::NoValue),
                (Ok(measured), motions) => {
                    kinds::search_for_feature(value, measured, motions, settings).ok_or(NoStretches::WholeTask)
                }
            };
            let candidates =
                question.as_ref().map_or_else(|_| Vec::new(), |question| question.find_candidates(&motions));
            FeatureSearch { value: value.clone(), search: question, candidates }
        };
        Self { searches: values.iter().map(asked).collect(), replicates: 0 }
    }

    /// Measures every candidate on a replicate of the path.
    pub fn add_replicate(&mut self, motions: &[Result<Motion, NotEnough>]) {
        let spaces = [Space::ThreeD, Space::Image].map(|space| MotionsInSpace::of(motions, space));
        self.replicates += 1;
        for FeatureSearch { value, search: question, candidates } in &mut self.searches {
            let Ok(question) = question else { continue };
            let motions = spaces[usize::from(value.space == Space::Image)].motions_of_value(value.tool);
            for candidate in candidates.iter_mut().filter(|_| question.error_effect != ErrorEffect::NoEffect) {
                candidate
                    .replicate_amounts
                    .extend((question.amount)(&motions, candidate.interval).filter(|a| a.is_finite()));
            }
        }
    }

    /// Selects the stretches that the hand caused. If no replicate was added, the path does not state its errors.
    pub fn finish(self, step_s: f64) -> Vec<FeatureStretches> {
        let heard = self.replicates;
        self.searches.into_iter().map(|asked| asked.finish(heard, step_s)).collect()
    }
}

impl FeatureSearch<'_> {
    fn finish(self, heard: usize, step_s: f64) -> FeatureStretches {
        let FeatureValue { feature, tool, space, .. } = self.value;
        let what = self.search.as_ref().ok().map(|question| question.kind);
        let stretches = self.search.and_then(|question| question.select_stretches(&self.candidates, heard, step_s));
        FeatureStretches { feature, tool, space, kind: what, stretches }
    }
}

/// The tools' motions in one space.
struct MotionsInSpace<'m>(Vec<Option<Cow<'m, Motion>>>);

impl<'m> MotionsInSpace<'m> {
    fn of(motions: &'m [Result<Motion, NotEnough>], space: Space) -> Self {
        let in_space = |motion: &'m Motion| match space {
            Space::ThreeD => Cow::Borrowed(motion),
            Space::Image => Cow::Owned(motion.in_space(space)),
        };
        Self(motions.iter().map(|motion| motion.as_ref().ok().map(in_space)).collect())
    }

    /// The motions that a value was measured on: the tool's own first, then the others; for the session, all of them.
    fn motions_of_value(&self, tool: Option<usize>) -> Vec<&Motion> {
        let own = tool.map(|tool| self.0.get(tool).and_then(Option::as_deref));
        let others = self.0.iter().enumerate().filter(|(index, _)| Some(*index) != tool);
        let others = others.filter_map(|(_, motion)| motion.as_deref());
        match own {
            Some(None) => Vec::new(),
            own => own.flatten().into_iter().chain(others).collect(),
        }
    }
}

/// The nodes of a motion within an interval, if the tool was seen in all of it.
fn nodes_within(motion: &Motion, interval: Interval) -> Option<&[MotionNode]> {
    let next = motion.spans.partition_point(|span| span.last() < interval.first);
    let span = motion.spans.get(next)?;
    let index = |instant: i64| usize::try_from(instant - span.first).ok();
    span.nodes.get(index(interval.first)?..=index(interval.last)?)
}

/// The length of an interval, s.
fn length_s(interval: Interval, motion: &Motion) -> f64 {
    interval.steps() as f64 * motion.step_s
}

/// Pairs of adjacent nodes: the steps of the path.
fn steps(nodes: &[MotionNode]) -> impl Iterator<Item = (&MotionNode, &MotionNode)> {
    nodes.iter().zip(nodes.iter().skip(1))
}
