//! The report page: tables and plots.

mod honesty;
mod over_time;
mod page;
mod path;
mod plot;
mod slides;
mod summary;

use maud::{Markup, html};
use nalgebra::Point3;

use super::figures;
use crate::checks::evaluation::{Accuracy, JudgedRow, Repeatability, TrueMotion, Truth};

/// A tool and the data that is drawn for it.
struct DrawnTool<'a> {
    name: &'a str,
    /// Name of its colour in the style sheet.
    colour: &'static str,
    /// Its rows.
    rows: Vec<JudgedRow<'a>>,
    motion: TrueMotion,
}

/// The page that compares a trajectory with the truth.
pub fn accuracy(about: &str, accuracy: &Accuracy, rows: &[JudgedRow], truth: &Truth) -> anyhow::Result<String> {
    let names = accuracy.tools.iter().filter_map(|tool| tool.tool.as_deref());
    let drawn = |(at, name): (usize, _)| DrawnTool {
        name,
        colour: colour(name, at),
        rows: rows.iter().filter(|row| row.tool == name).copied().collect(),
        motion: TrueMotion::of(truth, name),
    };
    let drawn: Vec<DrawnTool> = names.enumerate().map(drawn).collect();
    let parts = [
        summary::lead(accuracy),
        summary::table(accuracy),
        over_time::seen(&drawn, truth)?,
        over_time::errors(&drawn)?,
        honesty::histograms(&drawn)?,
        path::views(&drawn)?,
    ];
    Ok(page::page("Track against truth", about, &parts))
}

/// The page that compares paths along one guide with each other.
pub fn repeatability(about: &str, result: &Repeatability, paths: &[Vec<Point3<f64>>]) -> anyhow::Result<String> {
    let parts = [summary::lead_of_slides(result), slides::pictures(paths)?, summary::distances(result)];
    Ok(page::page("Repeatability", about, &parts))
}

/// A plot on its own card, in the tool's colour.
fn tool_card(tool: &DrawnTool, plot: &Markup) -> Markup {
    html! {
        div.card style={ "--tool: var(--tool-" (tool.colour) ")" } {
            h3 { (tool.name) }
            (plot)
        }
    }
}

/// Splits rows into stretches without missing frames.
fn stretches<'a>(rows: &'a [&'a JudgedRow<'a>]) -> impl Iterator<Item = &'a [&'a JudgedRow<'a>]> {
    rows.chunk_by(|a, b| b.sample.frame <= a.sample.frame + 1)
}

/// The style sheet's colour with the tape's name; for other names, a colour by index.
fn colour(name: &str, at: usize) -> &'static str {
    const COLOURS: [&str; 9] = ["orange", "cyan", "purple", "green", "pink", "blue", "yellow", "red", "grey"];
    COLOURS.into_iter().find(|colour| *colour == name).unwrap_or(COLOURS[at % COLOURS.len()])
}

#[cfg(test)]
mod tests;
