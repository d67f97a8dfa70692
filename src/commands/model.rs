//! `trocar model`: trains a model of skill from features of sessions and declared levels, and reports its accuracy.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use serde::Deserialize;

use super::progress::Meter;
use super::table::TextTable;
use super::{CommandFailure, print_result};
use crate::domain::session::FeatureSpace;
use crate::domain::skill::{ModelFile, ModelReport, Reading, Readings, most_common_tool_count, verdict_features};
use crate::domain::trainee::Level;
use crate::motion::features;
use crate::statistics::skill::{LabelledSession, MAX_SESSIONS_EACH, SkillDataset};

/// Arguments of `trocar model`.
#[derive(clap::Args)]
pub struct ModelArgs {
    /// Name of the exercise; stored in the model.
    #[arg(long, value_name = "TASK")]
    task: Option<String>,
    /// Table of the sessions' people, CSV with the columns `file,person,level`. `file` is the name that `trocar score`
    /// prints; `level` is novice, intermediate or expert. Each level needs at least eight people. Of each person the
    /// last three sessions count, in the order of the feature files.
    #[arg(long, value_name = "LABELS.CSV")]
    labels: PathBuf,
    /// File to write the model to, for `trocar score --model`.
    #[arg(long, value_name = "MODEL.JSON")]
    out: PathBuf,
    /// Show no progress.
    #[arg(long)]
    quiet: bool,
    /// Features of sessions, as `trocar score --json` prints them.
    #[arg(required = true, value_name = "FEATURES.JSON")]
    features: Vec<PathBuf>,
}

/// One row of the labels.
#[derive(Deserialize)]
struct LabelRow {
    file: String,
    person: String,
    level: Level,
}

/// One session of `trocar score --json`: the fields that are needed here.
#[derive(Deserialize)]
struct ScoreRecord {
    file: String,
    pipeline: String,
    tools: Vec<String>,
    verdict: String,
    features: Vec<ScoredFeature>,
}

/// One feature of a session.
#[derive(Deserialize)]
struct ScoredFeature {
    name: String,
    tool: Option<String>,
    space: FeatureSpace,
    value: Option<f64>,
    low: Option<f64>,
    high: Option<f64>,
    #[serde(default)]
    is_lower_bound: bool,
}

/// Runs the command.
pub fn run(args: ModelArgs) -> Result<(), CommandFailure> {
    let labels = read_labels(&args.labels)?;
    let mut sessions = Vec::new();
    for path in &args.features {
        let text = read(path)?;
        let scored: Vec<ScoreRecord> = serde_json::from_str(&text)
            .with_context(|| format!("{}: expected what `trocar score --json` prints", path.display()))
            .map_err(CommandFailure::Input)?;
        sessions.extend(scored);
    }
    let (samples, about) = usable_samples(sessions, labels)?;
    let features = verdict_features();
    let data = SkillDataset::of(&features, &samples).map_err(CommandFailure::input)?;
    let mut meter = Meter::new(args.quiet);
    let made = ModelFile::train(&data, (args.task, about.0, about.1), |done, all| meter.show("shuffled", done, all));
    let file = made.map_err(CommandFailure::input)?;
    let text = serde_json::to_string_pretty(&file).context("writing JSON")? + "\n";
    fs::write(&args.out, text).with_context(|| format!("writing {}", args.out.display()))?;
    meter.finish(&format!("model in {}", args.out.display()));
    print_result(&report_text(&file))
}

fn read(path: &Path) -> Result<String, CommandFailure> {
    fs::read_to_string(path).with_context(|| format!("reading {}", path.display())).map_err(CommandFailure::Input)
}

fn read_labels(path: &Path) -> Result<HashMap<String, LabelRow>, CommandFailure> {
    let text = read(path)?;
    let mut labels = HashMap::new();
    for row in csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes()).deserialize::<LabelRow>() {
        let label = row.with_context(|| format!("{}: expected file,person,level", path.display()));
        let label = label.map_err(CommandFailure::Input)?;
        if let Some(twice) = labels.insert(label.file.clone(), label) {
            return Err(CommandFailure::Input(anyhow!("{}: {} has two rows; keep one", path.display(), twice.file)));
        }
    }
    Ok(labels)
}

/// Usable sessions, the pipeline version that measured them, and their most common number of tools.
type UsableSamples = (Vec<LabelledSession<String>>, (String, usize));

/// The usable sessions. All must have a label and the same pipeline version.
fn usable_samples(
    sessions: Vec<ScoreRecord>,
    mut labels: HashMap<String, LabelRow>,
) -> Result<UsableSamples, CommandFailure> {
    let input = |why: String| Err(CommandFailure::Input(anyhow!(why)));
    let pipeline = sessions.first().map_or_else(String::new, |session| session.pipeline.clone());
    let tools = most_common_tool_count(sessions.iter().map(|session| session.tools.len()));
    let features = verdict_features();
    let mut by_person: BTreeMap<String, Vec<LabelledSession<String>>> = BTreeMap::new();
    for session in sessions {
        let file = &session.file;
        let Some(label) = labels.remove(file) else {
            return input(format!(
                "{file} has no label, or is in the features twice; each session needs one label and one set of features"
            ));
        };
        if session.pipeline != pipeline {
            let other = session.pipeline;
            return input(format!(
                "{file} was measured by pipeline version {other}, other sessions by {pipeline}; score all of them again"
            ));
        }
        if session.verdict == "refused" || session.tools.len() != tools {
            continue;
        }
        let values = Readings::of(session.features.into_iter().filter_map(ScoredFeature::reading)).values(&features);
        let sample = LabelledSession { person: label.person.clone(), level: label.level.into(), values };
        by_person.entry(label.person).or_default().push(sample);
    }
    if let Some(unmet) = labels.keys().min() {
        return input(format!("{unmet} has a label and no features"));
    }
    let last = |own: Vec<LabelledSession<String>>| {
        let first = own.len().saturating_sub(MAX_SESSIONS_EACH);
        own.into_iter().skip(first)
    };
    Ok((by_person.into_values().flat_map(last).collect(), (pipeline, tools)))
}

impl ScoredFeature {
    /// The value; `None` for a feature that this version does not measure.
    fn reading(self) -> Option<Reading> {
        let bar = self.low.zip(self.high).map(|(low, high)| [low, high]);
        let feature = features::find(&self.name).ok()?;
        Some(Reading {
            feature,
            tool: self.tool,
            space: self.space,
            value: self.value.filter(|_| !self.is_lower_bound),
            bar,
        })
    }
}

fn report_text(file: &ModelFile) -> String {
    let ModelReport { accuracy, baseline, people, sessions, .. } = &file.report;
    let head = format!(
        "{} ({}) with {} features, trained on {} people and {} sessions; measured by pipeline {}\n",
        file.model.learner,
        file.model.parameter,
        file.model.features.len(),
        people.iter().sum::<usize>(),
        sessions.iter().sum::<usize>(),
        file.pipeline,
    );
    let found = format!(
        "for people left out of training it found the right level in {} of the sessions ({} to {}, {} people)\n",
        percent(accuracy.value),
        percent(accuracy.low),
        percent(accuracy.high),
        accuracy.people,
    );
    let knows =
        if file.report.knows { "it knows something" } else { "it is no better than chance and gives no verdicts" };
    let baseline = format!(
        "mean over the levels: {}; with levels shuffled between people {}, in 19 of 20 shuffles at most {}; p = {:.2}: \
         {knows}\n",
        percent(file.report.balanced),
        percent(baseline.mean),
        percent(baseline.high),
        baseline.p,
    );
    let mut table = TextTable::new(["declared", "people", "novice", "intermediate", "expert"]);
    for ((level, row), people) in Level::ALL.iter().zip(&file.report.confusion).zip(people) {
        let share = |of: f64| percent(of / *people as f64);
        let cells = [share(row.novice), share(row.intermediate), share(row.expert)];
        table.add_row([level.name().to_owned(), people.to_string()].into_iter().chain(cells));
    }
    head + &found + &baseline + &table.to_text()
}

/// A share as whole per cent.
pub fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}
