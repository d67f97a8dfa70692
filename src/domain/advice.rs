//! Advice: what to work on next, said by rules where a feature surely misses its task's limit.
//!
//! A rule speaks of a feature only where all of this holds: the task's standard sets it a limit; the value's whole error bar
//! breaks that limit ([`Judgement::Fail`]), so that no advice rests on chance; and there are seconds to look at that are the
//! hand's own doing. One rule speaks once for each tool, [`MOST`] speak in all, the feature farthest from its limit first: by
//! the difference as a share of the larger of value and limit, which is the same whatever the unit.

mod rules;

use serde::Serialize;
use utoipa::ToSchema;

pub use rules::{RULES, Rule, Support};

use super::evidence::{EvidenceRow, StretchRow};
use super::feature::FeatureKey;
use super::session::{FeatureError, FeatureRow};
use super::standard::{Better, Definition, Judgement, Target, ToJudge};
use super::trainee::Handedness;

/// Pieces of advice for one session, at most: nobody works on four things at once.
pub const MOST: usize = 3;

/// One piece of advice.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Advice {
    /// Which rule speaks: its stable id.
    pub rule: &'static str,
    /// Of which feature.
    #[serde(flatten)]
    pub of: FeatureKey,
    /// The feature's title for people.
    pub title: String,
    /// Unit of value and limit.
    pub unit: String,
    /// The value.
    pub value: f64,
    /// How far it may be off: all of it breaks the limit.
    pub error: FeatureError,
    /// The limit that the task's standard sets.
    pub limit: f64,
    /// Which side of it is better.
    pub better: Better,
    /// How far from the limit, as a share of the larger of value and limit.
    pub distance: f64,
    /// What the stretches are.
    pub what: Option<String>,
    /// Unit of their amounts.
    pub amount_unit: Option<String>,
    /// What to look at, the weightiest first.
    pub stretches: Vec<StretchRow>,
    /// All of it in plain words.
    pub sentence: String,
}

/// A session's measured features, and what they are held against.
#[derive(Clone, Copy, Debug)]
pub struct Measured<'m> {
    /// The features.
    pub features: &'m [FeatureRow],
    /// Where they come from.
    pub evidence: &'m [EvidenceRow],
    /// Version of the program that measured them.
    pub pipeline: &'m str,
    /// The hand that the person prefers, if said.
    pub handedness: Option<Handedness>,
}

/// What to work on next, the most important first.
pub fn advise(definition: &Definition, measured: Measured<'_>) -> Vec<Advice> {
    let mut all: Vec<Advice> = definition.targets.iter().filter_map(|target| of_target(target, measured)).collect();
    all.sort_by(|a, b| b.distance.total_cmp(&a.distance));
    let mut chosen: Vec<Advice> = Vec::new();
    for advice in all {
        let is_said = chosen.iter().any(|said| said.rule == advice.rule && said.of.tool == advice.of.tool);
        if !is_said && chosen.len() < MOST {
            chosen.push(advice);
        }
    }
    chosen
}

fn of_target(target: &Target, measured: Measured<'_>) -> Option<Advice> {
    let row = measured.features.iter().find(|row| FeatureKey::from(*row) == target.of)?;
    let (value, error) = (*row.value.as_ref().ok()?, *row.error.as_ref()?.as_ref().ok()?);
    let Measured { pipeline, handedness, .. } = measured;
    let to_judge = ToJudge { value: Some(value), bar: Some([error.low, error.high]), pipeline, handedness };
    if target.judge(to_judge) != Judgement::Fail {
        return None;
    }
    let rule = RULES.iter().find(|rule| rule.speaks_of(&target.of.feature, target.better))?;
    let evidence = measured.evidence.iter().find(|row| row.of == target.of)?;
    let stretches: Vec<StretchRow> =
        evidence.stretches.iter().filter(|stretch| rule.rests_on(stretch)).copied().collect();
    let first = stretches.first()?;
    let distance = (value - target.limit).abs() / value.abs().max(target.limit.abs()).max(f64::MIN_POSITIVE);
    let sentence = sentence(rule, target, row, error, first);
    Some(Advice {
        rule: rule.id,
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

/// Words, feature, value, limit and the place to look at.
fn sentence(rule: &Rule, target: &Target, row: &FeatureRow, error: FeatureError, first: &StretchRow) -> String {
    let whose = target.of.tool.as_ref().map_or(String::new(), |tool| format!(" of {tool}"));
    let unit = if row.unit == "1" || row.unit.is_empty() { String::new() } else { format!(" {}", row.unit) };
    let side = if target.better == Better::Lower { "at most" } else { "at least" };
    let value = row.value.as_ref().map_or(f64::NAN, |value| *value);
    format!(
        "{} {}{whose} is {} ({} to {}){unit}; the standard asks for {side} {}{unit}. Look at {} to {}.",
        rule.words,
        row.title,
        digits(value),
        digits(error.low),
        digits(error.high),
        digits(target.limit),
        clock(first.from_s),
        clock(first.to_s)
    )
}

/// Three telling digits.
fn digits(value: f64) -> String {
    let places = if value == 0.0 { 0 } else { 2 - value.abs().log10().floor() as i32 };
    format!("{value:.*}", places.clamp(0, 6) as usize)
}

/// Seconds as `1:02.3`.
fn clock(seconds: f64) -> String {
    let tenths = (seconds * 10.0).round() as i64;
    format!("{}:{:02}.{}", tenths / 600, tenths / 10 % 60, tenths % 10)
}

#[cfg(test)]
mod tests;
