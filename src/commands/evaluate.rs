//! `trocar evaluate`: a trajectory against the truth, or paths along one guide against each other.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use nalgebra::Point3;
use serde_json::{Value, json};

use super::table::Table;
use super::{Failure, print_result, read_trajectory};
use crate::domain::files::truth::TruthFile;
use crate::pipeline::evaluation::{
    self, Accuracy, Errors, Inside, Level, Repeatability, Spread, ToolAccuracy, accuracy, repeatability,
};
use crate::pipeline::trajectory::{SampleState, Trajectory};

/// Arguments of `trocar evaluate`.
#[derive(clap::Args)]
pub struct Args {
    /// Compare paths along one straight guide: one file per path, or one file whose path goes to and fro.
    #[arg(long)]
    repeatability: bool,
    /// With --repeatability, the tool whose path to take; needed where a file holds several.
    #[arg(long, value_name = "TOOL", requires = "repeatability")]
    tool: Option<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// `track.csv truth.json`, or with --repeatability one or more trajectories.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    let (json, text) = if args.repeatability {
        let result = compare(&args.files, args.tool.as_deref())?;
        (repeatability_json(&result), repeatability_text(&result))
    } else {
        let [track, truth] = args.files.as_slice() else {
            return Err(Failure::Input(anyhow!(
                "expected a trajectory and a truth: trocar evaluate track.csv truth.json"
            )));
        };
        let result = judge(track, truth)?;
        (accuracy_json(&result), accuracy_text(&result))
    };
    if args.json {
        print_result(&(serde_json::to_string_pretty(&json).context("writing JSON")? + "\n"))
    } else {
        print_result(&text)
    }
}

fn judge(track: &Path, truth: &Path) -> Result<Accuracy, Failure> {
    let trajectory = read_trajectory(track)?;
    let text = fs::read_to_string(truth).with_context(|| format!("reading {}", truth.display()));
    let file = TruthFile::parse(&text.map_err(Failure::Input)?).with_context(|| truth.display().to_string());
    let result = accuracy(&trajectory, &file.map_err(Failure::Input)?.truth());
    result.with_context(|| format!("{} against {}", track.display(), truth.display())).map_err(Failure::Input)
}

fn compare(files: &[PathBuf], tool: Option<&str>) -> Result<Repeatability, Failure> {
    let read = |file: &PathBuf| {
        path_of(&read_trajectory(file)?, tool).map_err(|e| Failure::Input(e.context(file.display().to_string())))
    };
    let mut paths = files.iter().map(read).collect::<Result<Vec<_>, Failure>>()?;
    if let [only] = paths.as_slice() {
        paths = evaluation::slides(only);
    }
    repeatability(&paths).map_err(Failure::input)
}

/// The observed positions of the tool that is asked for, or of the only one.
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

fn accuracy_json(accuracy: &Accuracy) -> Value {
    json!({
        "tools": accuracy.tools.iter().map(tool_json).collect::<Vec<_>>(),
        "all": tool_json(&accuracy.all),
        "unjudged_rows": accuracy.unjudged,
        "largest_time_difference_s": accuracy.largest_time_difference_s,
    })
}

fn tool_json(tool: &ToolAccuracy) -> Value {
    json!({
        "tool": tool.tool,
        "rows": tool.rows,
        "false_tracks": tool.false_tracks,
        "levels": tool.levels.iter().map(level_json).collect::<Vec<_>>(),
    })
}

fn level_json(level: &Level) -> Value {
    json!({
        "visible_from": level.visible_from,
        "frames": level.frames,
        "found": level.found,
        "observed": level.observed,
        "coverage": share(level.found, level.frames),
        "swaps": level.swaps,
        "lag_s": level.lag_s,
        "errors_mm": level.errors.as_ref().map(errors_json),
        "observed_errors_mm": level.observed_errors.as_ref().map(errors_json),
        "predicted_errors_mm": level.predicted_errors.as_ref().map(errors_json),
        "inside_95": level.inside.map(inside_json),
    })
}

fn errors_json(errors: &Errors) -> Value {
    let spread = |s: &Spread| json!({ "rms": s.rms, "median": s.median, "p95": s.p95, "max": s.max });
    json!({
        "rows": errors.rows,
        "lateral": spread(&errors.lateral),
        "depth": spread(&errors.depth),
        "3d": spread(&errors.three_d),
        "bias_xyz": errors.bias_mm.as_slice(),
        "deviation_xyz": errors.deviation_mm.as_slice(),
    })
}

fn inside_json(inside: Inside) -> Value {
    json!({ "rows": inside.rows, "lateral": inside.lateral, "depth": inside.depth, "3d": inside.three_d })
}

fn repeatability_json(result: &Repeatability) -> Value {
    json!({
        "paths": result.lines.len(),
        "others_mm": result.others_mm,
        "own_mm": result.own_mm,
        "mean_distance_mm": result.mean_distance_mm,
    })
}

fn accuracy_text(accuracy: &Accuracy) -> String {
    let tools =
        || accuracy.tools.iter().chain([&accuracy.all]).flat_map(|tool| tool.levels.iter().map(move |l| (tool, l)));
    let mut found =
        Table::new(["tool", "visible ≥", "frames", "found", "%", "observed", "swaps", "false", "lag ms", "in 95 %"]);
    tools().for_each(|(tool, level)| found.row(found_row(tool, level)));
    let mut errors = Table::new([
        "error in mm",
        "visible ≥",
        "rows",
        "",
        "lateral RMS",
        "median",
        "95 %",
        "depth RMS",
        "median",
        "95 %",
        "3-D RMS",
        "median",
        "95 %",
        "bias x",
        "y",
        "z",
    ]);
    for (tool, level) in tools() {
        let kinds =
            [("all", &level.errors), ("observed", &level.observed_errors), ("predicted", &level.predicted_errors)];
        kinds
            .into_iter()
            .filter_map(|(kind, e)| Some((kind, e.as_ref()?)))
            .for_each(|(kind, e)| errors.row(error_row(tool, level, kind, e)));
    }
    let notes = format!(
        "  {} rows on frames that the truth does not have; times differ by at most {:.1} ms\n",
        accuracy.unjudged,
        1000.0 * accuracy.largest_time_difference_s
    );
    format!("{}\n{}\n{notes}", found.text(), errors.text())
}

fn name(tool: &ToolAccuracy) -> String {
    tool.tool.clone().unwrap_or_else(|| "all".to_owned())
}

fn found_row(tool: &ToolAccuracy, level: &Level) -> [String; 10] {
    let percent = |share: Option<f64>| share.map_or("–".to_owned(), |share| format!("{:.1}", 100.0 * share));
    [
        name(tool),
        level.visible_from.to_string(),
        level.frames.to_string(),
        level.found.to_string(),
        percent(share(level.found, level.frames)),
        level.observed.to_string(),
        level.swaps.to_string(),
        tool.false_tracks.to_string(),
        level.lag_s.map_or("–".to_owned(), |lag| format!("{:.1}", 1000.0 * lag)),
        percent(level.inside.map(|inside| inside.three_d)),
    ]
}

fn error_row(tool: &ToolAccuracy, level: &Level, kind: &str, errors: &Errors) -> Vec<String> {
    let head = [name(tool), level.visible_from.to_string(), errors.rows.to_string(), kind.to_owned()];
    let spreads = [errors.lateral, errors.depth, errors.three_d].map(|s| [s.rms, s.median, s.p95]);
    let numbers = spreads.into_iter().flatten().chain(errors.bias_mm.iter().copied());
    head.into_iter().chain(numbers.map(|number| format!("{number:.2}"))).collect()
}

fn share(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

fn repeatability_text(result: &Repeatability) -> String {
    let paths = 1..=result.lines.len();
    let mut table = Table::new(["mean distance, mm".to_owned()].into_iter().chain(paths.map(|n| format!("path {n}"))));
    for (index, row) in result.mean_distance_mm.iter().enumerate() {
        let cells = row.iter().map(|distance| format!("{distance:.2}"));
        table.row([format!("to the line of path {}", index + 1)].into_iter().chain(cells));
    }
    let others = format!("  other paths' points to a path's line: {:.2} mm on average\n", result.others_mm);
    let own = format!("  a path's own points to its line: {:.2} mm on average\n", result.own_mm);
    table.text() + &others + &own
}
