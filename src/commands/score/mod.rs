//! `trocar score`: computes features from trajectories. For a refused trajectory it prints the reasons instead.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use serde_json::{Value, json};

use self::reference::{Deviations, Reference};
use super::table::TextTable;
use super::{CommandFailure, print_result, read_trajectory, verdict};
use crate::domain::files::quality::ConcernDocument;
use crate::domain::skill::{ModelFile, SkillVerdict};
use crate::motion::PIPELINE_VERSION;
use crate::motion::assessment::{Assessment, AssessmentSettings, assess};
use crate::motion::features::errors::NoErrorBar;
use crate::motion::features::path_error::PathError;
use crate::motion::features::{FeatureValue, Space, TooUncertain};
use crate::motion::quality::{self, QualityInput, QualityVerdict};
use crate::vision::trajectory::Trajectory;

mod evidence;
mod reference;
mod skill;

/// Arguments of `trocar score`.
#[derive(clap::Args)]
pub struct ScoreArgs {
    /// Name of the exercise; repeated in the result.
    #[arg(long, value_name = "TASK")]
    task: Option<String>,
    /// Length of the time windows for which features are computed too, s.
    #[arg(long, value_name = "SECONDS", default_value_t = AssessmentSettings::default().window_s)]
    window_s: f64,
    /// Trajectory of an exemplary performance: also print how far each tool deviates from the tool of the same name in
    /// it. The camera must not have moved between the two recordings.
    #[arg(long, value_name = "TRACK.CSV")]
    reference: Option<PathBuf>,
    /// Also print the seconds that explain each feature: the longest rests, the worst detours, when a tool was not
    /// seen, …
    #[arg(long)]
    evidence: bool,
    /// Model of skill, made by `trocar model`: also print novice, intermediate or expert for each trajectory, or why
    /// not.
    #[arg(long, value_name = "MODEL.JSON")]
    model: Option<PathBuf>,
    /// Print JSON, including the time windows.
    #[arg(long)]
    json: bool,
    /// Trajectories from `trocar track`, or from any tracker that writes the columns frame,time_s,tool,x_mm,y_mm,z_mm.
    #[arg(required = true, value_name = "TRACK.CSV")]
    tracks: Vec<PathBuf>,
}

/// Runs the command. It reads all files before it prints anything, so that a bad file leaves no partial result.
pub fn run(args: ScoreArgs) -> Result<(), CommandFailure> {
    if !(args.window_s.is_finite() && args.window_s >= 1.0) {
        return Err(CommandFailure::Input(anyhow!("--window-s is {}; expected at least 1 second", args.window_s)));
    }
    let settings = AssessmentSettings { window_s: args.window_s, ..AssessmentSettings::default() };
    let reference = args.reference.as_deref().map(|path| Reference::read(path, &settings.features)).transpose()?;
    let task = args.task.as_deref();
    let model = args.model.as_deref().map(|path| skill::read_model(path, task)).transpose()?;
    let scored = |path: &PathBuf| {
        let trajectory = read_trajectory(path)?;
        let strays = reference.as_ref().map(|reference| reference.deviations(path, &trajectory, &settings.features));
        let scored = TrackScore::new(path, &trajectory, &settings);
        Ok(TrackScore { deviations: strays.transpose()?, ..scored.judged_by(model.as_ref()) })
    };
    let sessions = args.tracks.iter().map(scored).collect::<Result<Vec<TrackScore>, CommandFailure>>()?;
    if args.json {
        let all: Vec<Value> = sessions.iter().map(|session| session_json(session, task, args.evidence)).collect();
        print_result(&(serde_json::to_string_pretty(&all).context("writing JSON")? + "\n"))
    } else {
        let blocks: Vec<String> = sessions.iter().map(|session| session_text(session, task, args.evidence)).collect();
        print_result(&blocks.join("\n"))
    }
}

/// One trajectory's features and its quality verdict, judged from its rows alone.
struct TrackScore {
    path: PathBuf,
    assessment: Assessment,
    verdict: QualityVerdict,
    /// Deviations from the reference, if there is one.
    deviations: Option<Deviations>,
    /// Verdict of the model of skill, if there is one.
    skill: Option<SkillVerdict>,
}

impl TrackScore {
    fn new(path: &Path, trajectory: &Trajectory, settings: &AssessmentSettings) -> Self {
        let verdict = quality::judge(&quality::measure(&QualityInput::of_path(trajectory)));
        let assessment = assess(trajectory, &[], settings);
        let assessment = if verdict.is_refused() { assessment.withheld() } else { assessment };
        Self { path: path.to_owned(), assessment, verdict, deviations: None, skill: None }
    }

    fn judged_by(self, model: Option<&ModelFile>) -> Self {
        let skill = model.map(|model| skill::verdict(model, &self.assessment, self.verdict.is_refused()));
        Self { skill, ..self }
    }
}

fn session_json(
    TrackScore { path, assessment, verdict, deviations: strays, skill }: &TrackScore,
    task: Option<&str>,
    with_evidence: bool,
) -> Value {
    let values = |values: &[FeatureValue]| values.iter().map(|v| value_json(v, &assessment.tools)).collect::<Vec<_>>();
    let windows = assessment.windows.iter().map(
        |window| json!({ "start_s": window.start_s, "end_s": window.end_s, "features": values(&window.features) }),
    );
    json!({
        "file": path.display().to_string(),
        "task": task,
        "pipeline": PIPELINE_VERSION,
        "tools": assessment.tools,
        "verdict": verdict.name(),
        "reasons": verdict.concerns().iter().map(ConcernDocument::from).collect::<Vec<_>>(),
        "start_s": assessment.task_s.map(|(start, _)| start),
        "end_s": assessment.task_s.map(|(_, end)| end),
        "compare_in": PathError::of_values(&assessment.features).map(|error| json!({
            "space": error.better_space().name(),
            "path_error_3d": error.three_d,
            "path_error_image": error.image,
        })),
        "features": values(&assessment.features),
        "evidence": with_evidence.then(|| evidence::json(assessment)),
        "windows": windows.collect::<Vec<_>>(),
        "reference": strays.as_ref().filter(|_| !verdict.is_refused()).map(Deviations::json),
        "skill": skill,
    })
}

fn value_json(value: &FeatureValue, tools: &[String]) -> Value {
    let bar = value.error.ok();
    json!({
        "name": value.feature.name,
        "title": value.feature.title,
        "family": value.feature.family.name(),
        "unit": value.feature.unit,
        "direction": value.feature.direction.name(),
        "tool": tool_name(value, tools),
        "space": value.space.name(),
        "value": value.value.ok(),
        "as_measured": bar.map(|bar| bar.as_measured),
        "sigma": bar.map(|bar| bar.sigma),
        "low": bar.map(|bar| bar.low),
        "high": bar.map(|bar| bar.high),
        "is_lower_bound": value.value.is_ok() && value.error == Err(NoErrorBar::AtLeast),
        "too_uncertain": value.too_uncertain().map(TooUncertain::name),
        "no_error": value.error.err().filter(|_| value.value.is_ok()).map(|reason| reason.to_string()),
        "not_enough": value.value.err().map(|reason| reason.to_string()),
    })
}

fn tool_name<'a>(value: &FeatureValue, tools: &'a [String]) -> Option<&'a str> {
    tool_name_of(value.tool, tools)
}

fn tool_name_of(tool: Option<usize>, tools: &[String]) -> Option<&str> {
    tool.and_then(|tool| tools.get(tool)).map(String::as_str)
}

/// A head line and the verdict. Unless the trajectory is refused, also the table, and the reasons for missing values.
fn session_text(
    TrackScore { path, assessment, verdict, deviations: strays, skill }: &TrackScore,
    task: Option<&str>,
    with_evidence: bool,
) -> String {
    let task = task.map(|task| format!(", task {task}")).unwrap_or_default();
    let when = match assessment.task_s {
        Some((start, end)) => format!("from {start:.2} s to {end:.2} s"),
        None => "nothing was seen".to_owned(),
    };
    let head = format!("{}{task}, pipeline {PIPELINE_VERSION}: {when}\n", path.display());
    let strays = strays.as_ref().map(Deviations::text).unwrap_or_default();
    let evidence = if with_evidence { evidence::text(assessment) } else { String::new() };
    let values = match verdict.is_refused() {
        true => String::new(),
        false => advice(assessment) + &table(assessment).to_text() + &reasons(assessment) + &strays + &evidence,
    };
    let skill = skill.as_ref().map(skill::text).unwrap_or_default();
    head + &verdict::text(verdict) + &skill + &values
}

/// Where to compare the values if depth is poor; else nothing.
fn advice(assessment: &Assessment) -> String {
    let poor = PathError::of_values(&assessment.features).filter(|error| error.better_space() == Space::Image);
    poor.map_or_else(String::new, |PathError { three_d, image }| {
        let [three_d, image] = [three_d, image].map(|share| format!("{:.0} %", 100.0 * share));
        format!(
            "depth is poor: path lengths in space (3d) may be off by {three_d}, in the picture (image) by \
             {image}; compare the values in the picture\n"
        )
    })
}

/// One row per feature and space, one column per tool, and one for the session as a whole.
fn table(assessment: &Assessment) -> TextTable {
    let head = ["feature", "space", "unit"].map(str::to_owned).into_iter();
    let mut table = TextTable::new(head.chain(assessment.tools.iter().cloned()).chain(["session".to_owned()]));
    let in_one_row = |a: &FeatureValue, b: &FeatureValue| (a.feature, a.space) == (b.feature, b.space);
    for row in assessment.features.chunk_by(in_one_row) {
        let columns = (0..assessment.tools.len()).map(Some).chain([None]);
        let cell = |tool| row.iter().find(|v| v.tool == tool).map_or(String::new(), value_text);
        let head = [row[0].feature.name, row[0].space.name(), row[0].feature.unit].map(str::to_owned).into_iter();
        table.add_row(head.chain(columns.map(cell)));
    }
    table
}

/// The value ± half the width of its 95 % interval, or as a lower bound.
fn value_text(value: &FeatureValue) -> String {
    let off = value.error.map_or(String::new(), |bar| format!(" ± {}", significant((bar.high - bar.low) / 2.0)));
    let at_least = if value.error == Err(NoErrorBar::AtLeast) { "≥ " } else { "" };
    value.value.map_or("–".to_owned(), |v| format!("{at_least}{}{off}", significant(v)))
}

/// One line per reason, with all features that have no value for this reason.
fn reasons(assessment: &Assessment) -> String {
    let mut lines: Vec<(String, Vec<String>)> = Vec::new();
    for value in &assessment.features {
        let Err(reason) = value.value else { continue };
        let whose = tool_name(value, &assessment.tools).map(|tool| format!("{tool}: ")).unwrap_or_default();
        let (why, what) = (format!("{whose}{reason}"), format!("{} ({})", value.feature.name, value.space.name()));
        match lines.iter_mut().find(|(known, _)| *known == why) {
            Some((_, features)) => features.push(what),
            None => lines.push((why, vec![what])),
        }
    }
    let lines = lines.into_iter().map(|(why, features)| format!("  – {why}: {}\n", features.join(", ")));
    lines.collect::<Vec<_>>().concat()
}

/// A number with four significant digits; whole numbers in full.
fn significant(value: f64) -> String {
    let digits = if value.fract() == 0.0 { 0 } else { 3 - value.abs().log10().floor() as i32 };
    format!("{value:.*}", digits.clamp(0, 6) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_significant_digits() {
        let shown = [0.0, 0.012_345, 1.234_56, 123.456, 123_456.7, 17.0].map(significant);
        assert_eq!(shown, ["0", "0.01235", "1.235", "123.5", "123457", "17"]);
    }
}
