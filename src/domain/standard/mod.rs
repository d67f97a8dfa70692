//! A task's standard: limits of features, how often they must be met, and the charts that monitor a trainee's results.
//!
//! A standard is sent as a [`NewStandard`], which names the method for each limit, and stored as a
//! [`StandardDefinition`], which holds the computed limits and what they were computed from. A definition never changes
//! and holds no person's own value.

mod judgement;
mod new_standard;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use judgement::{Judgement, SessionJudgement, ValueToJudge};
pub use new_standard::{LimitMethod, MAX_TARGETS, NewStandard, NewTarget, Preset, StandardStart};

use super::feature::FeatureKey;
use super::hand::ToolHands;
use super::named;
use super::trainee::Handedness;
use crate::motion::features::Direction;
use crate::statistics::interval::ConfidenceInterval;
use crate::statistics::lc_cusum;
use crate::statistics::pass_rule::PassRule;
use crate::statistics::standard::{self, ErrorRate};

/// A task's standard as stored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StandardDefinition {
    /// Limits that a session must meet, all of them.
    pub targets: Vec<Target>,
    /// How often sessions must be passed; `null`: the charts decide.
    pub rule: Option<StandardRule>,
    /// Which failure rate counts as adequate, and how often the charts may be wrong.
    pub charts: ChartDesign,
}

/// A limit for a feature.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Target {
    /// The feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// The feature's title for people.
    pub title: String,
    /// Unit of the limit.
    pub unit: String,
    /// Which side of the limit is better.
    pub better: Better,
    /// The limit; a value equal to it passes.
    pub limit: f64,
    /// Lower end of the limit's 95 % interval over other samples of such people; `null` where it was not computed from
    /// people.
    pub low: Option<f64>,
    /// Upper end of that interval; `null` where it was not computed from people.
    pub high: Option<f64>,
    /// How the limit was set.
    pub basis: Basis,
    /// The values that it was computed from; `null` where it was not computed from people.
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

/// How a limit was set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "method", rename_all = "snake_case")]
pub enum Basis {
    /// A number that a member of staff chose.
    Fixed,
    /// A published number, from other boxes and other clocks: external, not measured here.
    External {
        /// The publication.
        source: String,
    },
    /// The mean of experts, without outliers.
    TrimmedExperts {
        /// How many experts were measured.
        experts: usize,
        /// How many of them lay more than two standard deviations from the mean and were excluded.
        dropped: usize,
    },
    /// The boundary between novices and experts.
    ContrastingGroups {
        /// How many novices.
        novices: usize,
        /// How many experts.
        experts: usize,
        /// Share of novices that pass.
        false_pass: MisjudgedShare,
        /// Share of experts that fail.
        false_fail: MisjudgedShare,
    },
    /// The value that the best share of some people reaches.
    BestShare {
        /// How many people.
        people: usize,
        /// The share, between 0 and 1.
        share: f64,
    },
}

/// The share of a group's people that a limit misjudges, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MisjudgedShare {
    /// Expected from the group's normal distribution.
    pub expected: f64,
    /// Observed among the people measured.
    pub seen: f64,
    /// Lower end of its 95 % interval over all such people.
    pub low: f64,
    /// Upper end of that interval.
    pub high: f64,
}

/// Identifies the values that a limit was computed from, without the values: enough to see whether they have changed
/// since.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MadeFrom {
    /// Version of the program that measured them; the limit does not judge values of another version.
    pub pipeline: String,
    /// SHA-256 of the values, in rising order. `null` for everyone but administrators: a person who knows most of the
    /// values could compute the last one from it.
    pub fingerprint: Option<String>,
    /// For a feature of a tool: the hand that those people prefer; the limit does not judge trainees who prefer the
    /// other.
    pub handedness: Option<Handedness>,
}

/// A pass rule: a number of passes in a row, then a number of further passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StandardRule {
    /// Passes in a row that are needed first, at least 1.
    pub in_a_row: usize,
    /// Further passes after these, in a row or not.
    #[serde(default)]
    pub then_more: usize,
    /// The rule must be met within this number of sessions; absent: no limit.
    #[serde(default)]
    pub at_most: Option<usize>,
}

/// Which failure rate counts as adequate, and how often the charts (LC-CUSUM, then CUSUM) may be wrong. Shares are 0 to
/// 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ChartDesign {
    /// Share of sessions that an inadequate trainee fails. Usually 0.3.
    pub inadequate: f64,
    /// Share of sessions that an adequate trainee fails; smaller than `inadequate`. Usually 0.1.
    pub adequate: f64,
    /// Largest share of inadequate trainees declared proficient within `declare_within` judged sessions. Usually 0.05.
    pub false_declaration: f64,
    /// Number of judged sessions for `false_declaration`, at most 200. Usually 50.
    pub declare_within: usize,
    /// Largest share of adequate trainees with an alarm within `alarm_within` judged sessions. Usually 0.05.
    pub false_alarm: f64,
    /// Number of judged sessions for `false_alarm`, at most 200. Usually 100.
    pub alarm_within: usize,
}

impl Target {
    /// A computed target in its stored form.
    pub fn of(of: FeatureKey, target: standard::FeatureTarget, from: Option<MadeFrom>) -> Self {
        let better = if target.direction == Direction::Higher { Better::Higher } else { Better::Lower };
        Self {
            title: of.feature.title.to_owned(),
            unit: of.feature.unit.to_owned(),
            of,
            better,
            limit: target.limit,
            low: target.interval.map(|interval| interval.low),
            high: target.interval.map(|interval| interval.high),
            basis: target.basis.into(),
            made_from: from,
        }
    }

    fn pipeline_target(&self) -> standard::FeatureTarget {
        let direction = match self.better {
            Better::Lower => Direction::Lower,
            Better::Higher => Direction::Higher,
        };
        standard::FeatureTarget { limit: self.limit, interval: None, direction, basis: standard::TargetBasis::Fixed }
    }
}

impl StandardDefinition {
    /// The definition without fingerprints, which only administrators may see.
    pub fn without_fingerprints(mut self) -> Self {
        self.targets.iter_mut().filter_map(|target| target.made_from.as_mut()).for_each(|from| from.fingerprint = None);
        self
    }

    /// The standard in a session with these hands, of a trainee with this preferred hand: a limit for a hand becomes one
    /// for the tool that was in it. A limit for a hand whose tool is unknown stays as it is, and no row meets it.
    pub fn in_session(&self, hands: &ToolHands, preferred: Option<Handedness>) -> Self {
        let in_session = |target: &Target| {
            let of = target.of.in_session(hands, preferred).unwrap_or_else(|| target.of.clone());
            Target { of, ..target.clone() }
        };
        Self { targets: self.targets.iter().map(in_session).collect(), ..self.clone() }
    }

    /// True if a limit is for a hand whose tool in this session is unknown.
    pub fn has_unknown_hand(&self, hands: &ToolHands, preferred: Option<Handedness>) -> bool {
        self.targets.iter().any(|target| target.of.in_session(hands, preferred).is_none())
    }

    /// The target of a feature, if it has one.
    pub fn target(&self, of: &impl PartialEq<FeatureKey>) -> Option<&Target> {
        self.targets.iter().find(|target| *of == target.of)
    }
}

impl From<standard::TargetBasis> for Basis {
    fn from(basis: standard::TargetBasis) -> Self {
        match basis {
            standard::TargetBasis::Fixed => Basis::Fixed,
            standard::TargetBasis::External { source } => Basis::External { source: source.to_owned() },
            standard::TargetBasis::TrimmedExperts { experts, dropped } => Basis::TrimmedExperts { experts, dropped },
            standard::TargetBasis::ContrastingGroups { novices, experts, false_pass, false_fail } => {
                Basis::ContrastingGroups {
                    novices,
                    experts,
                    false_pass: false_pass.into(),
                    false_fail: false_fail.into(),
                }
            }
            standard::TargetBasis::BestShare { people, share } => Basis::BestShare { people, share },
        }
    }
}

impl From<ErrorRate> for MisjudgedShare {
    fn from(ErrorRate { expected, seen, interval: ConfidenceInterval { low, high } }: ErrorRate) -> Self {
        Self { expected, seen, low, high }
    }
}

impl From<StandardRule> for PassRule {
    fn from(StandardRule { in_a_row, then_more, at_most }: StandardRule) -> Self {
        Self { in_a_row, then_more, at_most }
    }
}

impl From<PassRule> for StandardRule {
    fn from(PassRule { in_a_row, then_more, at_most }: PassRule) -> Self {
        Self { in_a_row, then_more, at_most }
    }
}

impl Default for ChartDesign {
    fn default() -> Self {
        lc_cusum::LcCusumDesign::default().into()
    }
}

impl From<lc_cusum::LcCusumDesign> for ChartDesign {
    fn from(design: lc_cusum::LcCusumDesign) -> Self {
        let lc_cusum::LcCusumDesign {
            inadequate,
            adequate,
            false_declaration,
            declare_within,
            false_alarm,
            alarm_within,
        } = design;
        Self { inadequate, adequate, false_declaration, declare_within, false_alarm, alarm_within }
    }
}

impl From<ChartDesign> for lc_cusum::LcCusumDesign {
    fn from(design: ChartDesign) -> Self {
        let ChartDesign { inadequate, adequate, false_declaration, declare_within, false_alarm, alarm_within } = design;
        Self { inadequate, adequate, false_declaration, declare_within, false_alarm, alarm_within }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::session::FeatureSpace;
    use crate::motion::features::time::DURATION;

    #[test]
    fn a_stored_definition_reads_back_unchanged() {
        let key = FeatureKey::of_session(&DURATION, FeatureSpace::Space3d);
        let limit = standard::FeatureTarget::fixed(48.0, Direction::Lower).unwrap();
        let target = Target::of(key, limit, None);
        let definition = StandardDefinition { targets: vec![target], rule: None, charts: ChartDesign::default() };
        let text = serde_json::to_string(&definition).unwrap();
        assert_eq!(serde_json::from_str::<StandardDefinition>(&text).unwrap(), definition);
        assert_eq!(definition.targets[0].pipeline_target(), limit);
    }
}
