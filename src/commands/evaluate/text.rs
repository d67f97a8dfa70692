//! The figures as text for the terminal: coverage, errors, and whether the stated error bars hold.

use super::figures;
use crate::checks::evaluation::{Accuracy, ErrorSummary, Repeatability, ToolAccuracy, VisibilityLevel};
use crate::commands::table::TextTable;

const ERRORS: [&str; 15] = [
    "error, mm",
    "visible ≥",
    "rows",
    "lateral RMS",
    "median",
    "95 %",
    "depth RMS",
    "median",
    "95 %",
    "3-D RMS",
    "median",
    "95 %",
    "mean x",
    "mean y",
    "mean z",
];

pub(super) fn accuracy(accuracy: &Accuracy) -> String {
    let rows = figures::rows(accuracy);
    let mut found =
        TextTable::new(["found", "visible ≥", "frames", "found", "%", "observed", "swaps", "false", "lag, ms"]);
    let mut errors = TextTable::new(ERRORS);
    let mut honesty =
        TextTable::new(["inside 95 %", "visible ≥", "rows", "lateral", "depth", "3-D", "mean square 3-D"]);
    let mut rest = TextTable::new(["at rest, mm/s", "rows", "median", "RMS"]);
    for (tool, level) in rows {
        found.add_row(found_row(tool, level));
        figures::states(level).into_iter().for_each(|(state, e)| errors.add_row(error_row(tool, level, state, e)));
        honesty_row(tool, level).into_iter().for_each(|row| honesty.add_row(row));
    }
    for tool in figures::tools(accuracy) {
        let row = |floor| [vec![figures::name(tool).to_owned()], figures::at_rest(floor).to_vec()].concat();
        tool.rest_noise.iter().for_each(|floor| rest.add_row(row(floor)));
    }
    let tables = [found, errors, honesty, rest].into_iter().filter(|table| !table.is_empty());
    tables.map(|table| table.to_text() + "\n").collect::<String>() + &notes(accuracy)
}

fn found_row(tool: &ToolAccuracy, level: &VisibilityLevel) -> [String; 9] {
    [
        figures::name(tool).to_owned(),
        level.visible_from.to_string(),
        level.frames.to_string(),
        level.found.to_string(),
        figures::found(level),
        level.observed.to_string(),
        level.swaps.to_string(),
        tool.false_tracks.to_string(),
        figures::lag(level.lag),
    ]
}

fn error_row(tool: &ToolAccuracy, level: &VisibilityLevel, state: &str, errors: &ErrorSummary) -> Vec<String> {
    let name = match state {
        "all" => figures::name(tool).to_owned(),
        _ => format!("{} {state}", figures::name(tool)),
    };
    let spreads = [errors.lateral, errors.depth, errors.three_d].map(|s| [s.rms, s.median, s.p95]);
    let numbers = spreads.into_iter().flatten().chain(errors.bias_mm.iter().copied());
    let head = [name, level.visible_from.to_string(), errors.rows.to_string()];
    head.into_iter().chain(numbers.map(|number| format!("{number:.2}"))).collect()
}

fn honesty_row(tool: &ToolAccuracy, level: &VisibilityLevel) -> Option<Vec<String>> {
    let honesty = level.sigma_check?;
    let shares = [honesty.lateral, honesty.depth, honesty.three_d].map(|share| figures::share(&share));
    let head = [figures::name(tool).to_owned(), level.visible_from.to_string(), honesty.rows.to_string()];
    Some(head.into_iter().chain(shares).chain([format!("{:.2}", honesty.three_d.mean_square)]).collect())
}

fn notes(accuracy: &Accuracy) -> String {
    format!(
        "  {} rows are on frames without truth; the times of the two files differ by at most {:.1} ms\n",
        accuracy.rows_without_truth,
        1000.0 * accuracy.largest_time_difference_s
    )
}

pub(super) fn repeatability(result: &Repeatability) -> String {
    let paths = 1..=result.lines.len();
    let mut table =
        TextTable::new(["mean distance, mm".to_owned()].into_iter().chain(paths.map(|n| format!("path {n}"))));
    for (index, row) in result.mean_distance_mm.iter().enumerate() {
        let cells = row.iter().map(|distance| format!("{distance:.2}"));
        table.add_row([format!("to the line of path {}", index + 1)].into_iter().chain(cells));
    }
    let others = format!("  distance of other paths' points to a path's line: {:.2} mm on average\n", result.others_mm);
    let own = format!("  distance of a path's own points to its line: {:.2} mm on average\n", result.own_mm);
    table.to_text() + &others + &own
}
