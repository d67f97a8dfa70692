//! Advice: what to work on next, given by rules where a feature certainly misses the limit of its task's standard.
//!
//! A rule gives advice on a feature only if the task's standard sets a limit for it; if the value's whole error bar
//! breaks that limit ([`Judgement::Fail`]), so that no advice rests on chance; and if the recording has stretches to
//! look at that the trainee's hand caused. Each rule applies at most once per tool, and a session gets at most
//! [`MAX_ADVICE`] pieces of advice, the feature farthest from its limit first. The distance is the difference as a
//! share of the larger of value and limit, which does not depend on the unit.

mod rules;

use serde::Serialize;
use utoipa::ToSchema;

pub use rules::{AdviceRule, RULES, RequiredStretch};

use super::evidence::{EvidenceRow, StretchRow};
use super::feature::{FeatureKey, StoredFeatureKey};
use super::session::{FeatureError, FeatureRow};
use super::standard::{Better, Judgement, StandardDefinition, Target, ValueToJudge};
use super::trainee::Handedness;

/// Maximum pieces of advice for one session: a trainee cannot work on four things at once.
pub const MAX_ADVICE: usize = 3;

/// One piece of advice.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Advice {
    /// Stable id of the rule.
    pub rule: &'static str,
    /// The feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// The feature's title for people.
    pub title: String,
    /// Unit of value and limit.
    pub unit: String,
    /// The value.
    pub value: f64,
    /// The value's error bar: all of it breaks the limit.
    pub error: FeatureError,
    /// The limit in the task's standard.
    pub limit: f64,
    /// Which side of the limit is better.
    pub better: Better,
    /// Distance from the limit, as a share of the larger of value and limit.
    pub distance: f64,
    /// What the stretches show, such as `rest` or `detour`.
    pub what: Option<String>,
    /// Unit of their amounts.
    pub amount_unit: Option<String>,
    /// The stretches to look at, the one with the largest contribution first.
    pub stretches: Vec<StretchRow>,
    /// What to do, as the rule says it.
    pub words: &'static str,
    /// The same with feature, value, limit and the first seconds to look at.
    pub sentence: String,
}

/// A session's measured features, with their evidence and the data needed to judge them.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredSession<'m> {
    /// The features.
    pub features: &'m [FeatureRow],
    /// The stretches that made the features.
    pub evidence: &'m [EvidenceRow],
    /// Version of the program that measured them.
    pub pipeline: &'m str,
    /// The trainee's preferred hand, if known.
    pub handedness: Option<Handedness>,
}

/// What to work on next, the most important first.
pub fn advise(definition: &StandardDefinition, measured: MeasuredSession<'_>) -> Vec<Advice> {
    let mut all: Vec<Advice> =
        definition.targets.iter().filter_map(|target| advice_for_target(target, measured)).collect();
    all.sort_by(|a, b| b.distance.total_cmp(&a.distance));
    let mut chosen: Vec<Advice> = Vec::new();
    for advice in all {
        let is_given = chosen.iter().any(|given| given.rule == advice.rule && given.of.tool == advice.of.tool);
        if !is_given && chosen.len() < MAX_ADVICE {
            chosen.push(advice);
        }
    }
    chosen
}

fn advice_for_target(target: &Target, measured: MeasuredSession<'_>) -> Option<Advice> {
    let row = measured.features.iter().find(|row| StoredFeatureKey::from(*row) == target.of)?;
    let (value, error) = (*row.value.as_ref().ok()?, *row.error.as_ref()?.as_ref().ok()?);
    let MeasuredSession { pipeline, handedness, .. } = measured;
    let to_judge = ValueToJudge {
        value: Some(value),
        bar: Some([error.low, error.high]),
        is_lower_bound: false,
        pipeline,
        handedness,
    };
    if target.judge(to_judge) != Judgement::Fail {
        return None;
    }
    let rule = RULES.iter().find(|rule| rule.covers(target.of.feature, target.better))?;
    let evidence = measured.evidence.iter().find(|row| row.of == target.of)?;
    let stretches: Vec<StretchRow> =
        evidence.stretches.iter().filter(|stretch| rule.accepts_stretch(stretch)).copied().collect();
    let first = stretches.first()?;
    let distance = (value - target.limit).abs() / value.abs().max(target.limit.abs()).max(f64::MIN_POSITIVE);
    let sentence = sentence(rule, target, row, error, first);
    Some(Advice {
        rule: rule.habit.name(),
        words: rule.words,
        of: target.of.clone(),
        title: row.title.clone(),
        unit: row.unit.clone(),
        value,
        error,
        limit: target.limit,
        better: target.better,
        distance,
        what: evidence.what.clone(),
        amount_unit: evidence.unit.clone(),
        stretches,
        sentence,
    })
}

/// The rule's words, then feature, value, limit and the seconds to look at.
fn sentence(rule: &AdviceRule, target: &Target, row: &FeatureRow, error: FeatureError, first: &StretchRow) -> String {
    let whose = target.of.tool.as_ref().map_or(String::new(), |tool| format!(" of {tool}"));
    let unit = if row.unit == "1" { String::new() } else { format!(" {}", row.unit) };
    let side = if target.better == Better::Lower { "at most" } else { "at least" };
    let value = row.value.as_ref().map_or(f64::NAN, |value| *value);
    format!(
        "{} {}{whose} is {} ({} to {}){unit}; the standard asks for {side} {}{unit}. Look at {} to {}.",
        rule.words,
        row.title,
        significant_digits(value),
        significant_digits(error.low),
        significant_digits(error.high),
        significant_digits(target.limit),
        clock_time(first.from_s),
        clock_time(first.to_s)
    )
}

/// A number with three significant digits.
fn significant_digits(value: f64) -> String {
    let places = if value == 0.0 { 0 } else { 2 - value.abs().log10().floor() as i32 };
    format!("{value:.*}", places.clamp(0, 6) as usize)
}

/// Seconds as `1:02.3`.
fn clock_time(seconds: f64) -> String {
    let tenths = (seconds * 10.0).round() as i64;
    format!("{}:{:02}.{}", tenths / 600, tenths / 10 % 60, tenths % 10)
}

#[cfg(test)]
mod tests;
