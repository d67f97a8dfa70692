//! What a task asks for: limits of features, how often they must be kept, and the charts that watch over it.
//!
//! A standard is sent as a [`NewStandard`], which names the way to each limit, and kept as a [`Definition`], which holds the
//! limits themselves with what they were made from. A definition never changes and holds nobody's own value.

mod judgement;
mod order;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use judgement::{Judgement, SessionJudgement, ToJudge};
pub use order::{MOST_TARGETS, NewStandard, NewTarget, Preset, Way};

use super::feature::FeatureKey;
use super::named;
use super::trainee::Handedness;
use crate::pipeline::features::{self, Direction};
use crate::pipeline::score::interval::Interval;
use crate::pipeline::score::lc_cusum;
use crate::pipeline::score::pass_rule::PassRule;
use crate::pipeline::score::standard::{self, ErrorRate};

/// What a task asks for, as it is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Definition {
    /// What a session must keep, all of it.
    pub targets: Vec<Target>,
    /// How often a session must be passed; `null`: the charts decide.
    pub rule: Option<Rule>,
    /// What counts as adequate, and how often the charts may be wrong.
    pub charts: ChartDesign,
}

/// A limit that a feature has to keep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Target {
    /// Of which feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// The feature's title for people.
    pub title: String,
    /// Unit of the limit.
    pub unit: String,
    /// Which side of the limit is better.
    pub better: Better,
    /// The limit; keeping it exactly is enough.
    pub limit: f64,
    /// Other people of the same kind being asked, the limit lies with 95 % between `low`
    pub low: Option<f64>,
    /// and `high`; both `null` where it was not made from people.
    pub high: Option<f64>,
    /// What it was made from.
    pub basis: Basis,
    /// Which values that was; `null` where it was not made from people.
    pub made_from: Option<MadeFrom>,
}

named! {
    /// Which side of a limit is better.
    Better: "side" {
        /// Below it.
        Lower = "lower",
        /// Above it.
        Higher = "higher",
    }
}

/// What a limit was made from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "method", rename_all = "snake_case")]
pub enum Basis {
    /// A number that somebody chose.
    Fixed,
    /// A published number, made with other boxes and other clocks: external, not measured here.
    External {
        /// Who published it.
        source: String,
    },
    /// The mean of experts without outliers.
    TrimmedExperts {
        /// How many experts were measured.
        experts: usize,
        /// How many of them lay more than two standard deviations off and were left out.
        dropped: usize,
    },
    /// The line between novices and experts.
    ContrastingGroups {
        /// How many novices.
        novices: usize,
        /// How many experts.
        experts: usize,
        /// The novices whom it lets pass.
        false_pass: Share,
        /// The experts whom it fails.
        false_fail: Share,
    },
    /// As good as the best share of some people.
    BestShare {
        /// How many people.
        people: usize,
        /// The share, between 0 and 1.
        share: f64,
    },
}

/// A share of a group's people that a limit is wrong about, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Share {
    /// By the group's normal law.
    pub expected: f64,
    /// Of the people measured.
    pub seen: f64,
    /// Of all such people it lies with 95 % between `low`
    pub low: f64,
    /// and `high`.
    pub high: f64,
}

/// Which values a limit was made from: enough to see whether others would be taken today, and not the values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MadeFrom {
    /// Version of the program that measured them; values of another version are not judged by the limit.
    pub pipeline: String,
    /// SHA-256 of the values, in rising order; `null` to all but administrators, for who knows most of the values could find the
    /// last one by it.
    pub fingerprint: Option<String>,
    /// Of a tool's feature: the hand that those people prefer; who prefers the other is not judged by the limit.
    pub handedness: Option<Handedness>,
}

/// So many passes in a row, and so many more.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    /// Passes in a row that come first, at least 1.
    pub in_a_row: usize,
    /// Passes after these, in a row or not.
    #[serde(default)]
    pub then_more: usize,
    /// Sessions within which it must be met; absent: without an end.
    #[serde(default)]
    pub at_most: Option<usize>,
}

/// What counts as adequate, and how often the charts may be wrong (LC-CUSUM, and CUSUM after it). Shares are 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ChartDesign {
    /// Share of sessions that an inadequate trainee misses. Usually 0.3.
    pub inadequate: f64,
    /// Share of sessions that an adequate one misses; smaller. Usually 0.1.
    pub adequate: f64,
    /// Largest share of inadequate trainees that are called proficient within so many judged sessions. Usually 0.05.
    pub false_declaration: f64,
    /// So many, at most 200. Usually 50.
    pub declare_within: usize,
    /// Largest share of adequate trainees with an alarm within so many judged sessions. Usually 0.05.
    pub false_alarm: f64,
    /// So many, at most 200. Usually 100.
    pub alarm_within: usize,
}

impl Target {
    /// A computed target as it is kept.
    pub fn of(of: FeatureKey, feature: &features::Feature, target: standard::Target, from: Option<MadeFrom>) -> Self {
        let better = if target.direction == Direction::Higher { Better::Higher } else { Better::Lower };
        Self {
            of,
            title: feature.title.to_owned(),
            unit: feature.unit.to_owned(),
            better,
            limit: target.limit,
            low: target.interval.map(|interval| interval.low),
            high: target.interval.map(|interval| interval.high),
            basis: target.basis.into(),
            made_from: from,
        }
    }

    fn limit(&self) -> standard::Target {
        let direction = match self.better {
            Better::Lower => Direction::Lower,
            Better::Higher => Direction::Higher,
        };
        standard::Target { limit: self.limit, interval: None, direction, basis: standard::Basis::Fixed }
    }
}

impl Definition {
    /// Without what only administrators are told.
    pub fn without_fingerprints(mut self) -> Self {
        self.targets.iter_mut().filter_map(|target| target.made_from.as_mut()).for_each(|from| from.fingerprint = None);
        self
    }

    /// The target of a feature, if it has one.
    pub fn target(&self, of: &FeatureKey) -> Option<&Target> {
        self.targets.iter().find(|target| target.of == *of)
    }
}

impl From<standard::Basis> for Basis {
    fn from(basis: standard::Basis) -> Self {
        match basis {
            standard::Basis::Fixed => Basis::Fixed,
            standard::Basis::External { source } => Basis::External { source: source.to_owned() },
            standard::Basis::TrimmedExperts { experts, dropped } => Basis::TrimmedExperts { experts, dropped },
            standard::Basis::ContrastingGroups { novices, experts, false_pass, false_fail } => {
                Basis::ContrastingGroups {
                    novices,
                    experts,
                    false_pass: false_pass.into(),
                    false_fail: false_fail.into(),
                }
            }
            standard::Basis::BestShare { people, share } => Basis::BestShare { people, share },
        }
    }
}

impl From<ErrorRate> for Share {
    fn from(ErrorRate { expected, seen, interval: Interval { low, high } }: ErrorRate) -> Self {
        Self { expected, seen, low, high }
    }
}

impl From<Rule> for PassRule {
    fn from(Rule { in_a_row, then_more, at_most }: Rule) -> Self {
        Self { in_a_row, then_more, at_most }
    }
}

impl From<PassRule> for Rule {
    fn from(PassRule { in_a_row, then_more, at_most }: PassRule) -> Self {
        Self { in_a_row, then_more, at_most }
    }
}

impl Default for ChartDesign {
    fn default() -> Self {
        lc_cusum::Design::default().into()
    }
}

impl From<lc_cusum::Design> for ChartDesign {
    fn from(design: lc_cusum::Design) -> Self {
        let lc_cusum::Design { inadequate, adequate, false_declaration, declare_within, false_alarm, alarm_within } =
            design;
        Self { inadequate, adequate, false_declaration, declare_within, false_alarm, alarm_within }
    }
}

impl From<ChartDesign> for lc_cusum::Design {
    fn from(design: ChartDesign) -> Self {
        let ChartDesign { inadequate, adequate, false_declaration, declare_within, false_alarm, alarm_within } = design;
        Self { inadequate, adequate, false_declaration, declare_within, false_alarm, alarm_within }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::session::FeatureSpace;

    #[test]
    fn a_kept_definition_reads_back_as_it_was() {
        let key = FeatureKey { feature: "duration".to_owned(), tool: None, space: FeatureSpace::Space3d };
        let limit = standard::Target::fixed(48.0, Direction::Lower).unwrap();
        let target = Target::of(key, &features::time::DURATION, limit, None);
        let definition = Definition { targets: vec![target], rule: None, charts: ChartDesign::default() };
        let text = serde_json::to_string(&definition).unwrap();
        assert_eq!(serde_json::from_str::<Definition>(&text).unwrap(), definition);
        assert_eq!(definition.targets[0].limit(), limit);
    }
}
