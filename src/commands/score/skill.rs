//! `trocar score --model`: the verdict of a model of skill on a trajectory.

use std::fs;
use std::path::Path;

use anyhow::{Context, anyhow};

use crate::commands::CommandFailure;
use crate::commands::model::percent;
use crate::domain::session::FeatureSpace;
use crate::domain::skill::{
    FeatureContribution, ModelFile, NoLevelReasonName, Reading, Readings, ShareOfPeople, SkillVerdict,
};
use crate::motion::PIPELINE_VERSION;
use crate::motion::assessment::Assessment;
use crate::motion::features::FeatureValue;
use crate::motion::features::errors::NoErrorBar;

/// Reads a model. Refuses a model of another task or of another pipeline version.
pub fn read_model(path: &Path, task: Option<&str>) -> Result<ModelFile, CommandFailure> {
    let text = fs::read_to_string(path)
        .with_context(|| format!("reading {}", path.display()))
        .map_err(CommandFailure::Input)?;
    let model = ModelFile::parse(&text).with_context(|| path.display().to_string()).map_err(CommandFailure::Input)?;
    let refused = |why: String| Err(CommandFailure::Input(anyhow!("{}: {why}", path.display())));
    if model.pipeline != PIPELINE_VERSION {
        let own = &model.pipeline;
        return refused(format!(
            "its sessions were measured by pipeline {own}, this program has {PIPELINE_VERSION}; train the model again"
        ));
    }
    match (task, model.task.as_deref()) {
        (Some(asked), Some(own)) if asked != own => refused(format!("is of the task {own}, not of {asked}")),
        _ => Ok(model),
    }
}

/// The model's verdict on a session. A refused session gets none.
pub fn verdict(model: &ModelFile, assessment: &Assessment, is_refused: bool) -> SkillVerdict {
    if is_refused {
        return SkillVerdict::without_level(
            NoLevelReasonName::Refused,
            "the session is refused, its features are not reliable",
        );
    }
    let readings = Readings::of(assessment.features.iter().map(|value| reading(value, &assessment.tools)));
    model.model.judge(&readings, assessment.tools.len()).with_accuracy(&model.report)
}

fn reading(value: &FeatureValue, tools: &[String]) -> Reading {
    Reading {
        feature: value.feature,
        tool: value.tool.and_then(|tool| tools.get(tool)).cloned(),
        space: FeatureSpace::from(value.space),
        value: value.value.ok().filter(|_| value.error != Err(NoErrorBar::AtLeast)),
        bar: value.error.ok().map(|bar| [bar.low, bar.high]),
    }
}

/// The verdict as text for people.
pub fn text(verdict: &SkillVerdict) -> String {
    let said = match (&verdict.level, &verdict.reason) {
        (Some(level), _) => level.name().to_owned(),
        (None, Some(reason)) => format!("no level; {}", reason.detail),
        (None, None) => "no level".to_owned(),
    };
    let probabilities = verdict.probabilities.map_or_else(String::new, |of| {
        let [novice, intermediate, expert] = [of.novice, of.intermediate, of.expert].map(percent);
        format!(" (novice {novice}, intermediate {intermediate}, expert {expert})")
    });
    let of_people = |of: ShareOfPeople| {
        let [value, low, high] = [of.value, of.low, of.high].map(percent);
        format!("in {value} ({low} to {high}, {} people) of the sessions of people left out of training\n", of.people)
    };
    let worth = match (verdict.accuracy_where_given, verdict.accuracy) {
        (Some(given), _) => format!("  – where such models gave this level, it was right {}", of_people(given)),
        (None, Some(all)) => format!("  – such models found the level {}", of_people(all)),
        (None, None) => String::new(),
    };
    let carried = |of: &FeatureContribution| {
        let [value, mean] = [of.value, of.mean].map(super::significant);
        format!("  – {} {value} {}, mean {mean}: {:+.0} %\n", of.feature, of.unit, 100.0 * of.raises)
    };
    format!("skill: {said}{probabilities}\n{worth}") + &verdict.carried.iter().map(carried).collect::<String>()
}
