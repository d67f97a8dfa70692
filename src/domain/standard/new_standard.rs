//! A standard as requested: its features, and the method for each limit.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;

use super::{ChartDesign, StandardRule};
use crate::domain::hand::Hand;
use crate::domain::session::FeatureSpace;
use crate::domain::text::{Invalid, Key};
use crate::motion::features;
use crate::statistics::pass_rule::PassRule;
use crate::statistics::standard::{self, fls};
use crate::time::Day;

/// Maximum number of targets in one standard.
pub const MAX_TARGETS: usize = 20;

/// A standard to be created or proposed.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewStandard {
    /// Targets that a session must meet, all of them: 1 to 20, each for a different feature.
    pub targets: Vec<NewTarget>,
    /// How often sessions must be passed before the task counts as learnt; absent: the charts decide.
    pub rule: Option<StandardRule>,
    /// Which failure rate counts as adequate, and how often the charts may be wrong; absent: the usual values.
    pub charts: Option<ChartDesign>,
    /// Which recordings it judges: those that arrive from `now` on, from a day on (`2026-01-05`), or all of them
    /// (`beginning`). Absent: all for a task's first version, and from `now` on for a later one.
    #[schema(value_type = Option<String>)]
    pub valid_from: Option<StandardStart>,
}

/// From when on a standard judges recordings. A recording belongs to the day on which it arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StandardStart {
    /// All recordings.
    Beginning,
    /// Those that arrive after the standard was set.
    Now,
    /// Those that arrived on this day or later.
    Day(Day),
}

impl StandardStart {
    /// The given start, or the usual one of a first or a later version.
    pub fn or_usual(given: Option<Self>, is_later: bool) -> Self {
        given.unwrap_or(if is_later { Self::Now } else { Self::Beginning })
    }

    /// The time of the start for a standard that is set now, epoch ms.
    pub fn valid_from_ms(self, now_ms: i64) -> i64 {
        match self {
            Self::Beginning => 0,
            Self::Now => now_ms,
            Self::Day(day) => day.start_ms().max(0),
        }
    }
}

impl<'de> Deserialize<'de> for StandardStart {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        match text.as_str() {
            "beginning" => Ok(Self::Beginning),
            "now" => Ok(Self::Now),
            day => day
                .parse()
                .map(Self::Day)
                .map_err(|_| D::Error::custom("expected `now`, `beginning`, or a day such as 2026-01-05")),
        }
    }
}

/// A target as requested.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct NewTarget {
    /// Stable name of a feature that has a better side.
    pub feature: String,
    /// The tool's marker; absent for a feature of a hand or of the whole session. A limit for a marker holds only in
    /// boxes whose tools have it: prefer `in_hand`.
    pub tool: Option<String>,
    /// The hand that holds the tool; absent for a feature of a tool or of the whole session.
    pub in_hand: Option<Hand>,
    /// The space to measure it in; absent: three dimensions, if the feature has them.
    pub space: Option<FeatureSpace>,
    /// The method for its limit.
    pub by: LimitMethod,
}

/// A method for setting a limit.
#[derive(Clone, Debug, PartialEq, Deserialize, ToSchema)]
#[serde(tag = "method", rename_all = "snake_case", deny_unknown_fields)]
pub enum LimitMethod {
    /// A number chosen by the user.
    Fixed {
        /// The limit; a value equal to it passes.
        limit: f64,
        /// Unit of the limit; must be the feature's unit.
        unit: String,
    },
    /// A published time of the Fundamentals of Laparoscopic Surgery, for the session's duration.
    Fls {
        /// Name of the preset.
        preset: String,
    },
    /// The mean of experts, without outliers.
    TrimmedExperts {
        /// The experts' cohort, by id or code.
        experts: Key,
    },
    /// The boundary between novices and experts.
    ContrastingGroups {
        /// The novices' cohort, by id or code.
        novices: Key,
        /// The experts' cohort, by id or code.
        experts: Key,
    },
    /// The value that the best share of a cohort reaches.
    BestShare {
        /// The cohort, by id or code.
        cohort: Key,
        /// The share, between 0 and 1; 0.25 is the best quarter.
        share: f64,
    },
}

/// A published target to choose from.
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
    /// The publication.
    pub source: &'static str,
    /// How often it must be met; `null` where the source does not say.
    pub rule: Option<StandardRule>,
}

impl NewStandard {
    /// Returns the standard if its number of targets and its pass rule are valid.
    pub fn checked(self) -> Result<Self, Invalid> {
        if !(1..=MAX_TARGETS).contains(&self.targets.len()) {
            let found = self.targets.len();
            return Err(Invalid::new("targets", format!("are {found}; expected 1 to {MAX_TARGETS}")));
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
        let of = |preset: &fls::FlsTarget| {
            let standard::TargetBasis::External { source } = preset.duration.basis else { return None };
            let duration = &features::time::DURATION;
            let (limit, rule) = (preset.duration.limit, preset.rule.map(StandardRule::from));
            let (preset, title) = (preset.task, preset.title);
            Some(Self { preset, title, feature: duration.name, limit, unit: duration.unit, source, rule })
        };
        fls::FLS.iter().filter_map(of).collect()
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
    fn a_standard_needs_targets_and_an_achievable_rule() {
        let target = json!({"feature": "duration", "by": {"method": "fixed", "limit": 48, "unit": "s"}});
        let standard = sent(json!({"targets": [target], "rule": {"in_a_row": 2, "then_more": 10}})).unwrap();
        assert_eq!(standard.rule, Some(StandardRule { in_a_row: 2, then_more: 10, at_most: None }));
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
        assert_eq!(presets[0].rule, Some(StandardRule { in_a_row: 2, then_more: 10, at_most: Some(80) }));
    }
}
