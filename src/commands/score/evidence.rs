//! `trocar score --evidence`: prints the seconds that explain each feature.

use serde_json::{Value, json};

use super::{significant, tool_name_of};
use crate::domain::evidence::EvidenceRow;
use crate::motion::assessment::Assessment;
use crate::motion::stretches::{FeatureStretches, Stretch};

/// One line for each feature with stretches, and one line for each reason why other features have none.
pub(super) fn text(assessment: &Assessment) -> String {
    let mut lines = vec!["  evidence, the seconds that made each feature:".to_owned()];
    let mut silent: Vec<(String, Vec<String>)> = Vec::new();
    for evidence in &assessment.stretches {
        let name = feature_title(evidence, &assessment.tools);
        match &evidence.stretches {
            Ok(stretches) => {
                let unit = evidence.kind.map_or("", |what| what.unit);
                let what = evidence.kind.map_or("", |what| what.name);
                let stretches: Vec<String> = stretches.iter().map(|stretch| stretch_text(stretch, unit)).collect();
                lines.push(format!("  {name}: {what} {}", stretches.join(", ")));
            }
            Err(reason) => match silent.iter_mut().find(|(known, _)| *known == reason.to_string()) {
                Some((_, names)) => names.push(name),
                None => silent.push((reason.to_string(), vec![name])),
            },
        }
    }
    lines.extend(silent.into_iter().map(|(reason, names)| format!("  – {reason}: {}", names.join(", "))));
    lines.join("\n") + "\n"
}

/// The same in the JSON form of the service.
pub(super) fn json(assessment: &Assessment) -> Value {
    let rows = assessment.stretches.iter().map(|evidence| json!(EvidenceRow::of(evidence, &assessment.tools)));
    Value::Array(rows.collect())
}

fn feature_title(evidence: &FeatureStretches, tools: &[String]) -> String {
    let whose = tool_name_of(evidence.tool, tools).map(|tool| format!(" of {tool}")).unwrap_or_default();
    format!("{} ({}){whose}", evidence.feature.name, evidence.space.name())
}

fn stretch_text(stretch: &Stretch, unit: &str) -> String {
    let unit = if unit == "1" { String::new() } else { format!(" {unit}") };
    let share = stretch.share.map(|share| format!(", {:.0} %", 100.0 * share)).unwrap_or_default();
    let amount = significant(stretch.amount);
    format!("{:.2}–{:.2} s ({amount}{unit}{share})", stretch.from_s, stretch.to_s)
}
