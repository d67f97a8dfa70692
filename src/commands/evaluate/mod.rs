//! `trocar evaluate`: compares a trajectory with the truth, or paths along one guide with each other.

mod figures;
mod json;
mod report;
mod text;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use nalgebra::Point3;
use serde_json::Value;

use super::{CommandFailure, print_result, read_trajectory};
use crate::checks::evaluation::{self, Truth, accuracy, repeatability};
use crate::domain::files::truth::TruthFile;
use crate::vision::trajectory::{SampleState, Trajectory};

/// Arguments of `trocar evaluate`.
#[derive(clap::Args)]
pub struct EvaluateArgs {
    /// Compare paths along one straight guide: one file per path, or one file with a path to and fro.
    #[arg(long)]
    repeatability: bool,
    /// With --repeatability: the tool to compare; needed if a file holds several tools.
    #[arg(long, value_name = "TOOL", requires = "repeatability")]
    tool: Option<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Also write a page with tables and plots: one HTML file that needs no network.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// `track.csv truth.json`; with --repeatability, one or more trajectories.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
}

/// The result of a comparison, for programs (JSON), for the terminal (text) and as an HTML page.
struct EvaluationOutput {
    json: Value,
    text: String,
    page: String,
}

/// Runs the command.
pub fn run(args: EvaluateArgs) -> Result<(), CommandFailure> {
    let findings = if args.repeatability {
        compare_paths(&args.files, args.tool.as_deref())?
    } else {
        let [track, truth] = args.files.as_slice() else {
            return Err(CommandFailure::Input(anyhow!(
                "expected a trajectory and a truth: trocar evaluate track.csv truth.json"
            )));
        };
        compare_with_truth(track, truth)?
    };
    if let Some(report) = &args.report {
        fs::write(report, findings.page).with_context(|| format!("writing {}", report.display()))?;
    }
    if args.json {
        print_result(&(serde_json::to_string_pretty(&findings.json).context("writing JSON")? + "\n"))
    } else {
        print_result(&findings.text)
    }
}

fn compare_with_truth(track: &Path, truth: &Path) -> Result<EvaluationOutput, CommandFailure> {
    let trajectory = read_trajectory(track)?;
    let truth_read = read_truth(truth, &trajectory.tools).map_err(CommandFailure::Input)?;
    let against = || format!("{} against {}", track.display(), truth.display());
    let result = accuracy(&trajectory, &truth_read).with_context(against).map_err(CommandFailure::Input)?;
    let rows =
        evaluation::pair_with_truth(&trajectory, &truth_read).with_context(against).map_err(CommandFailure::Input)?;
    Ok(EvaluationOutput {
        json: json::accuracy(&result),
        text: text::accuracy(&result),
        page: report::accuracy(&against(), &result, &rows, &truth_read)?,
    })
}

fn read_truth(path: &Path, tools: &[String]) -> anyhow::Result<Truth> {
    let text = fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
    Ok(TruthFile::parse(&text).with_context(|| path.display().to_string())?.truth_named_as(tools))
}

fn compare_paths(files: &[PathBuf], tool: Option<&str>) -> Result<EvaluationOutput, CommandFailure> {
    let read = |file: &PathBuf| {
        path_of(&read_trajectory(file)?, tool).map_err(|e| CommandFailure::Input(e.context(file.display().to_string())))
    };
    let mut paths = files.iter().map(read).collect::<Result<Vec<_>, CommandFailure>>()?;
    if let [only] = paths.as_slice() {
        paths = evaluation::slides(only);
    }
    let result = repeatability(&paths).map_err(CommandFailure::input)?;
    let names = files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join(", ");
    Ok(EvaluationOutput {
        json: json::repeatability(&result),
        text: text::repeatability(&result),
        page: report::repeatability(&names, &result, &paths)?,
    })
}

/// The observed positions of the named tool, or of the only tool.
fn path_of(trajectory: &Trajectory, tool: Option<&str>) -> anyhow::Result<Vec<Point3<f64>>> {
    let names = trajectory.tools.join(", ");
    let tool = match tool {
        Some(name) => trajectory
            .tools
            .iter()
            .position(|t| t == name)
            .ok_or_else(|| anyhow!("no tool `{name}`; it has {names}"))?,
        None if trajectory.tools.len() > 1 => return Err(anyhow!("several tools ({names}); pick one with --tool")),
        None => 0,
    };
    let observed = trajectory.of_tool(tool).filter(|sample| sample.state == SampleState::Observed);
    Ok(observed.map(|sample| sample.tip_mm).collect())
}
