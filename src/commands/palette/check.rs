//! `trocar palette --check`: compares the marked colours with each other and with the frames on which they were marked.

use std::path::Path;

use anyhow::{Context, anyhow};

use super::{CommandFailure, print_result};
use crate::analysis::marked::{MarkedFrames, group_into_strokes};
use crate::commands::table::TextTable;
use crate::commands::track::{about, open, read, rectangle};
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::palette::{ColourGrade, ColourVerdict, ConfusionRow, PaletteReport};
use crate::media::MediaError;

/// Runs the command. A bad colour is a failure, reported after the table.
pub fn run(annotations: &Path, video: Option<&Path>, json: bool) -> Result<(), CommandFailure> {
    let marked = AnnotationsFile::parse(&read(annotations)?).map_err(|e| about(annotations, e))?;
    let report = report(&marked, annotations, video)?;
    let text =
        if json { serde_json::to_string_pretty(&report).context("writing JSON")? + "\n" } else { text_of(&report) };
    print_result(&text)?;
    let bad = report.verdicts.iter().filter(|verdict| verdict.grade == ColourGrade::Bad);
    let bad: Vec<String> = bad.map(|verdict| format!("`{}`", verdict.tool)).collect();
    if bad.is_empty() {
        return Ok(());
    }
    let what = if bad.len() == 1 { "colour is" } else { "colours are" };
    Err(CommandFailure::Failed(anyhow!(
        "{what} bad: {}; use another tape, see `trocar palette --advise`",
        bad.join(", ")
    )))
}

fn report(marked: &AnnotationsFile, annotations: &Path, video: Option<&Path>) -> Result<PaletteReport, CommandFailure> {
    let folder = annotations.parent().unwrap_or(Path::new("."));
    let named = marked.video.as_ref().map(|name| folder.join(name));
    let path = named.as_deref().or(video).ok_or_else(|| {
        about(
            annotations,
            anyhow!("names no `video`; give the video that the frame numbers belong to as the last argument"),
        )
    })?;
    let mut video = open(path)?;
    let info = video.info();
    marked.check_inside(info.width, info.height).map_err(|e| about(annotations, e))?;
    let mut frames = MarkedFrames::default();
    let last = marked.labels.iter().map(|label| label.frame).max().unwrap_or(0);
    for index in 0..=last {
        let Some(picture) = video.next_picture().map_err(|e| about(path, e))? else {
            let what = anyhow!("a rectangle is on frame {last}, but {} has only {index} frames", path.display());
            return Err(about(annotations, what));
        };
        let labels = marked.labels.iter().filter(|label| label.frame == index);
        frames.add(picture, group_into_strokes(labels.map(|label| (label.stroke, rectangle(marked, label)))));
    }
    frames.report(&marked.tape_colours()).ok_or_else(|| about(path, MediaError::NoFrames))
}

fn text_of(report: &PaletteReport) -> String {
    if report.verdicts.is_empty() {
        return String::from(
            "None of the tools has tape, so there is no tape colour to check. The tracker follows their shafts.\n",
        );
    }
    let mut text = String::from("How the marked pixels are classified without their own rectangle, %:\n");
    text += &confusion_table(report);
    text += "\nUnder changed light: share of a tape lost, and largest share of another label taken for it, %:\n";
    text += &light_table(report);
    text += "\nThe tools' colours (margins in steps of 1/255 of the full range):\n";
    text += &verdict_table(report);
    let warnings: String = report.warnings.iter().map(|warning| format!("{warning}\n")).collect();
    if warnings.is_empty() { text } else { text + "\n" + &warnings }
}

fn confusion_table(report: &PaletteReport) -> String {
    let tools = report.verdicts.iter().map(|verdict| verdict.tool.clone());
    let head = ["label", "rectangles", "pixels", "no tool"].map(str::to_owned).into_iter().chain(tools);
    let mut table = TextTable::new(head);
    for ConfusionRow { label, rectangles, pixels, lights } in &report.confusion {
        let as_marked = lights.iter().take(1).flat_map(|light| {
            std::iter::once(percent(light.no_tool)).chain(light.tools.iter().map(|of| percent(of.share)))
        });
        table.add_row([label.clone(), rectangles.to_string(), pixels.to_string()].into_iter().chain(as_marked));
    }
    table.to_text()
}

fn light_table(report: &PaletteReport) -> String {
    let tools = || report.verdicts.iter().map(|verdict| &verdict.tool);
    let head = tools().flat_map(|tool| [format!("{tool} lost"), "taken for it".to_owned()]);
    let mut table = TextTable::new(std::iter::once("light".to_owned()).chain(head));
    let lights = report.confusion.first().map_or(0, |row| row.lights.len());
    for light in 0..lights {
        let taken = |row: &ConfusionRow, tool: usize| row.lights[light].tools[tool].share;
        let cells = tools().enumerate().flat_map(|(index, tool)| {
            let own = report.confusion.iter().find(|row| row.label == *tool);
            let lost = own.map_or("not marked".to_owned(), |row| percent(1.0 - taken(row, index)));
            let others = report.confusion.iter().filter(|row| row.label != *tool);
            [lost, percent(others.map(|row| taken(row, index)).fold(0.0, f64::max))]
        });
        table.add_row(std::iter::once(report.confusion[0].lights[light].light.clone()).chain(cells));
    }
    table.to_text()
}

fn percent(share: f64) -> String {
    format!("{:.1}", 100.0 * share.abs()) // avoids "-0.0"
}

fn verdict_table(report: &PaletteReport) -> String {
    let mut table = TextTable::new(["tool", "verdict", "margin", "spread", "nearest", "false area", "largest region"]);
    for ColourVerdict { tool, grade, margin, false_area, .. } in &report.verdicts {
        let margin = margin.as_ref();
        let steps = |value: Option<f64>| value.map_or("too few".to_owned(), |value| format!("{value:.1}"));
        table.add_row([
            tool.clone(),
            grade.name().replace('_', " "),
            steps(margin.map(|m| m.margin_steps)),
            steps(margin.map(|m| m.spread_steps)),
            margin.map_or("–".to_owned(), |m| m.nearest.clone()),
            false_area.as_ref().map_or("not seen".to_owned(), |a| format!("{:.3} %", 100.0 * a.share)),
            false_area.as_ref().map_or("not seen".to_owned(), |a| format!("{:.2} × band", a.largest_of_band)),
        ]);
    }
    table.to_text()
}
