//! What a task asks for: limits of features, how often they must be kept, and the charts that watch over it.
//!
//! A standard is sent as a [`NewStandard`], which names the way to each limit, and kept as a [`Definition`], which holds the
//! limits themselves with what they were made from. A definition never changes and holds nobody's own value.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::feature::FeatureKey;
use super::named;
use super::session::FeatureSpace;
use super::text::{Invalid, Key};
use super::trainee::Handedness;
use crate::pipeline::features::{self, Direction};
use crate::pipeline::score::interval::{Interval, Measured};
use crate::pipeline::score::lc_cusum;
use crate::pipeline::score::pass_rule::PassRule;
use crate::pipeline::score::standard::{self, ErrorRate, fls};

/// Most targets of one standard.
pub const MOST_TARGETS: usize = 20;

/// A standard to be made or proposed.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewStandard {
    /// What a session must keep, all of it: 1 to 20 targets, each of another feature.
    pub targets: Vec<NewTarget>,
    /// How often a session must be passed before the task counts as learnt; without it, the charts decide.
    pub rule: Option<Rule>,
    /// What counts as adequate, and how often the charts may be wrong; without it, the usual.
    pub charts: Option<ChartDesign>,
}

/// A target to be made.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewTarget {
    /// Stable name of a feature of which more or less is better.
    pub feature: String,
    /// The tool's marker; absent for a feature of the whole session.
    pub tool: Option<String>,
    /// Where it is measured; absent: in three dimensions, if it is.
    pub space: Option<FeatureSpace>,
    /// The way to its limit.
    pub by: Way,
}

/// A way to a limit.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(tag = "method", rename_all = "snake_case", deny_unknown_fields)]
pub enum Way {
    /// A number that somebody chose.
    Fixed {
        /// The limit; keeping it exactly is enough.
        limit: f64,
        /// Its unit, which must be the feature's.
        unit: String,
    },
    /// A published time of the Fundamentals of Laparoscopic Surgery, for the session's duration.
    Fls {
        /// Which of the presets.
        preset: String,
    },
    /// The mean of experts without outliers.
    TrimmedExperts {
        /// The experts' cohort, by id or code.
        experts: Key,
    },
    /// The line between novices and experts.
    ContrastingGroups {
        /// The novices' cohort, by id or code.
        novices: Key,
        /// The experts' cohort, by id or code.
        experts: Key,
    },
    /// As good as the best share of a cohort.
    BestShare {
        /// The cohort, by id or code.
        cohort: Key,
        /// The share, between 0 and 1; 0.25 is the best quarter.
        share: f64,
    },
}

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
    /// SHA-256 of the values, in rising order.
    pub fingerprint: String,
    /// Of a tool's feature: the hand that those people prefer; who prefers the other is not judged by the limit.
    pub handedness: Option<Handedness>,
}

named! {
    /// What a value is worth against a target. Only `pass` and `fail` count.
    Judgement: "judgement" {
        /// The whole error bar keeps the limit.
        Pass = "pass",
        /// The whole error bar breaks it.
        Fail = "fail",
        /// The error bar covers the limit.
        Undecided = "undecided",
        /// Nothing states the value's error.
        ErrorUnknown = "error_unknown",
        /// There is no usable value.
        NotMeasured = "not_measured",
        /// The limit was made from values of another version of the program.
        OtherVersion = "other_version",
        /// The limit of this tool was made from people who prefer the other hand.
        OtherHand = "other_hand",
    }
}

/// A value, what it was measured with, and whose it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToJudge<'v> {
    /// The value; `None` where there is none.
    pub value: Option<f64>,
    /// Where the true value lies with 95 %; `None` where that is not known.
    pub bar: Option<[f64; 2]>,
    /// Version of the program that measured it.
    pub pipeline: &'v str,
    /// The hand that the person prefers, if said.
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

/// A published target to choose.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Preset {
    /// Its name, for `{"method": "fls", "preset": …}`.
    pub preset: &'static str,
    /// Name of the exercise, for people.
    pub title: &'static str,
    /// The feature that it limits.
    pub feature: &'static str,
    /// The limit.
    pub limit: f64,
    /// Its unit.
    pub unit: &'static str,
    /// Who published it.
    pub source: &'static str,
    /// How often it must be kept; `null` where the source does not say.
    pub rule: Option<Rule>,
}

impl NewStandard {
    /// The same, if it asks for something, and for each thing once.
    pub fn checked(self) -> Result<Self, Invalid> {
        if !(1..=MOST_TARGETS).contains(&self.targets.len()) {
            let found = self.targets.len();
            return Err(Invalid::new("targets", format!("are {found}; expected 1 to {MOST_TARGETS}")));
        }
        if let Some(rule) = self.rule {
            PassRule::from(rule).checked().map_err(|why| Invalid::new("rule", why.to_string()))?;
        }
        Ok(self)
    }
}

impl Preset {
    /// The presets: the times of the Fundamentals of Laparoscopic Surgery.
    pub fn all() -> Vec<Self> {
        let of = |preset: &fls::Preset| {
            let standard::Basis::External { source } = preset.duration.basis else { return None };
            let duration = &features::time::DURATION;
            let (limit, rule) = (preset.duration.limit, preset.rule.map(Rule::from));
            let (preset, title) = (preset.task, preset.title);
            Some(Self { preset, title, feature: duration.name, limit, unit: duration.unit, source, rule })
        };
        fls::FLS.iter().filter_map(of).collect()
    }
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

    /// Judges a value, unless it is of another kind than those that the limit was made from.
    pub fn judge(&self, of: ToJudge<'_>) -> Judgement {
        if let Some(from) = &self.made_from {
            if from.pipeline != of.pipeline {
                return Judgement::OtherVersion;
            }
            if from.handedness.is_some() && from.handedness != of.handedness {
                return Judgement::OtherHand;
            }
        }
        self.limit().judge(of.measured()).into()
    }

    fn limit(&self) -> standard::Target {
        let direction = match self.better {
            Better::Lower => Direction::Lower,
            Better::Higher => Direction::Higher,
        };
        standard::Target { limit: self.limit, interval: None, direction, basis: standard::Basis::Fixed }
    }
}

impl ToJudge<'_> {
    /// The value with its bar.
    pub fn measured(&self) -> Option<Measured> {
        let bar = self.bar.map(|[low, high]| Interval { low, high });
        self.value.map(|value| Measured { value, bar })
    }
}

impl Definition {
    /// The target of a feature, if it has one.
    pub fn target(&self, of: &FeatureKey) -> Option<&Target> {
        self.targets.iter().find(|target| target.of == *of)
    }
}

impl From<standard::Judgement> for Judgement {
    fn from(judgement: standard::Judgement) -> Self {
        match judgement {
            standard::Judgement::Pass => Judgement::Pass,
            standard::Judgement::Fail => Judgement::Fail,
            standard::Judgement::Undecided => Judgement::Undecided,
            standard::Judgement::ErrorUnknown => Judgement::ErrorUnknown,
            standard::Judgement::NotMeasured => Judgement::NotMeasured,
        }
    }
}

impl From<Judgement> for standard::Judgement {
    /// What is not judged is worth as much as what is not measured.
    fn from(judgement: Judgement) -> Self {
        match judgement {
            Judgement::Pass => standard::Judgement::Pass,
            Judgement::Fail => standard::Judgement::Fail,
            Judgement::Undecided => standard::Judgement::Undecided,
            Judgement::ErrorUnknown => standard::Judgement::ErrorUnknown,
            Judgement::NotMeasured | Judgement::OtherVersion | Judgement::OtherHand => standard::Judgement::NotMeasured,
        }
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
    use serde_json::json;

    use super::*;

    fn sent(body: serde_json::Value) -> Result<NewStandard, String> {
        let new: NewStandard = serde_json::from_value(body).map_err(|error| error.to_string())?;
        new.checked().map_err(|invalid| invalid.to_string())
    }

    #[test]
    fn a_standard_asks_for_something_and_its_rule_can_be_met() {
        let target = json!({"feature": "duration", "by": {"method": "fixed", "limit": 48, "unit": "s"}});
        let standard = sent(json!({"targets": [target], "rule": {"in_a_row": 2, "then_more": 10}})).unwrap();
        assert_eq!(standard.rule, Some(Rule { in_a_row: 2, then_more: 10, at_most: None }));
        for (body, why) in [
            (json!({"targets": []}), "expected 1 to 20"),
            (json!({"targets": vec![target.clone(); 21]}), "are 21"),
            (json!({"targets": [target], "rule": {"in_a_row": 0}}), "in_a_row"),
            (json!({"targets": [target], "rule": {"in_a_row": 3, "then_more": 3, "at_most": 5}}), "at_most"),
            (json!({"targets": [{"feature": "duration", "by": {"method": "wish"}}]}), "unknown variant"),
            (json!({"targets": [{"feature": "duration", "by": {"method": "fixed", "limit": 48}}]}), "unit"),
            (
                json!({"targets": [{"feature": "duration", "by": {"method": "fixed", "limit": null, "unit": "s"}}]}),
                "null",
            ),
        ] {
            let error = sent(body.clone()).unwrap_err();
            assert!(error.contains(why), "{body}: {error}");
        }
    }

    #[test]
    fn the_presets_are_the_published_times_in_the_features_unit() {
        let presets = Preset::all();
        assert_eq!(presets.iter().map(|preset| preset.limit).collect::<Vec<_>>(), [48.0, 98.0, 53.0, 136.0, 112.0]);
        assert!(presets.iter().all(|preset| (preset.unit, preset.feature) == ("s", "duration")));
        assert_eq!(presets[0].rule, Some(Rule { in_a_row: 2, then_more: 10, at_most: Some(80) }));
    }

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

    #[test]
    fn a_limit_judges_only_values_of_the_kind_that_it_was_made_from() {
        let key = FeatureKey {
            feature: "path_length".to_owned(),
            tool: Some("orange".to_owned()),
            space: FeatureSpace::Space3d,
        };
        let limit = standard::Target::fixed(100.0, Direction::Lower).unwrap();
        let handedness = Some(Handedness::Right);
        let from = MadeFrom { pipeline: "7".to_owned(), fingerprint: String::new(), handedness };
        let target = Target::of(key, &features::path::PATH_LENGTH, limit, Some(from));
        let right = ToJudge { value: Some(90.0), bar: Some([85.0, 95.0]), pipeline: "7", handedness };
        assert_eq!(target.judge(right), Judgement::Pass);
        assert_eq!(target.judge(ToJudge { bar: Some([85.0, 101.0]), ..right }), Judgement::Undecided);
        assert_eq!(target.judge(ToJudge { pipeline: "8", ..right }), Judgement::OtherVersion);
        assert_eq!(target.judge(ToJudge { handedness: Some(Handedness::Left), ..right }), Judgement::OtherHand);
        assert_eq!(target.judge(ToJudge { handedness: None, ..right }), Judgement::OtherHand);
    }
}
