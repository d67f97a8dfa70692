//! `trocar palette --check`: compares the marked colours with each other and with the frames on which they were marked,
//! and shows the shafts of tools without tape on these frames.

use std::fs::File;
use std::path::Path;

use anyhow::{Context, anyhow};

use serde::Serialize;

use super::{CommandFailure, print_result};
use crate::analysis::marked::{MarkedFrames, group_into_strokes};
use crate::commands::table::TextTable;
use crate::commands::track::{about, read, rectangle, tools};
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::palette::{ColourGrade, ColourVerdict, ConfusionRow, PaletteReport, ShaftOnFrame};
use crate::domain::text::count_of;
use crate::media::{MediaError, MediaLimits, Picture, VideoFile, photo};

/// The result as JSON.
#[derive(Serialize)]
struct CheckDocument {
    #[serde(flatten)]
    report: PaletteReport,
    /// The shafts of tools without tape on the marked frames.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    shafts: Vec<ShaftOnFrame>,
}

/// Runs the command. A bad colour is a failure, reported after the table.
pub fn run(annotations: &Path, video: Option<&Path>, json: bool) -> Result<(), CommandFailure> {
    let marked = AnnotationsFile::parse(&read(annotations)?).map_err(|e| about(annotations, e))?;
    let checked = check(&marked, annotations, video)?;
    let text = match json {
        true => serde_json::to_string_pretty(&checked).context("writing JSON")? + "\n",
        false => text_of(&checked.report) + &text_of_shafts(&checked.shafts),
    };
    print_result(&text)?;
    let bad = checked.report.verdicts.iter().filter(|verdict| verdict.grade == ColourGrade::Bad);
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

/// What the marks are on: a clip, or one photo.
enum MarkedClip {
    Video(Box<VideoFile>),
    /// `None` once it was shown.
    Photo(Option<Picture>),
}

impl MarkedClip {
    fn open(path: &Path) -> Result<Self, CommandFailure> {
        let limits = MediaLimits::default();
        let file = File::open(path).map_err(|e| about(path, e))?;
        match photo::picture_of_photo(&file, limits).map_err(|e| about(path, e))? {
            Some(picture) => Ok(Self::Photo(Some(picture))),
            None => Ok(Self::Video(Box::new(VideoFile::open(file, limits).map_err(|e| about(path, e))?))),
        }
    }

    /// Width and height, pixels.
    fn size(&self) -> (u32, u32) {
        match self {
            Self::Video(video) => (video.info().width, video.info().height),
            Self::Photo(photo) => photo.as_ref().map_or((0, 0), |photo| {
                let frame = photo.frame();
                (frame.width() as u32, frame.height() as u32)
            }),
        }
    }

    fn next_picture(&mut self) -> Result<Option<Picture>, MediaError> {
        match self {
            Self::Video(video) => video.next_picture(),
            Self::Photo(photo) => Ok(photo.take()),
        }
    }
}

fn check(marked: &AnnotationsFile, annotations: &Path, video: Option<&Path>) -> Result<CheckDocument, CommandFailure> {
    let folder = annotations.parent().unwrap_or(Path::new("."));
    let named = marked.video.as_ref().map(|name| folder.join(name));
    let path = named.as_deref().or(video).ok_or_else(|| {
        about(
            annotations,
            anyhow!("names no `video`; give the video that the frame numbers belong to as the last argument"),
        )
    })?;
    let mut clip = MarkedClip::open(path)?;
    let (width, height) = clip.size();
    marked.check_inside(width, height).map_err(|e| about(annotations, e))?;
    let mut frames = MarkedFrames::default();
    let last = marked.labels.iter().map(|label| label.frame).max().unwrap_or(0);
    for index in 0..=last {
        let Some(picture) = clip.next_picture().map_err(|e| about(path, e))? else {
            let frames = count_of(index, "frame");
            let what = anyhow!("a rectangle is on frame {last}, but {} has only {frames}", path.display());
            return Err(about(annotations, what));
        };
        let labels = marked.labels.iter().filter(|label| label.frame == index);
        frames.add(picture, group_into_strokes(labels.map(|label| (label.stroke, rectangle(marked, label)))));
    }
    let report = frames.report(&marked.tape_colours()).ok_or_else(|| about(path, MediaError::NoFrames))?;
    Ok(CheckDocument { report, shafts: frames.shafts(&tools(marked, annotations)?) })
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

/// The shafts of tools without tape; empty without any.
fn text_of_shafts(shafts: &[ShaftOnFrame]) -> String {
    if shafts.is_empty() {
        return String::new();
    }
    let mut table = TextTable::new(["tool", "frame", "one edge", "other edge", "seen", "end"]);
    let place = |[x, y]: [f64; 2]| format!("{x:.1},{y:.1}");
    for ShaftOnFrame { frame, tool, edges_px, edges_shown, end_px, reason } in shafts {
        let [one, other] = edges_px.map_or([const { String::new() }; 2], |edges| {
            edges.map(|[from, to]| format!("{} to {}", place(from), place(to)))
        });
        let shown = edges_shown.map_or(String::new(), |shown| format!("{:.0} %", 100.0 * shown));
        let end = end_px.map_or(reason.clone().unwrap_or_default(), place);
        table.add_row([tool.clone(), frame.to_string(), one, other, shown, end]);
    }
    let mut reasons: Vec<&str> = shafts.iter().filter_map(|shaft| shaft.reason.as_deref()).collect();
    reasons.sort_unstable();
    reasons.dedup();
    let reasons: String = reasons.into_iter().map(|reason| format!("{reason}: {}\n", why(reason))).collect();
    format!("\nThe shafts without tape, each frame looked at alone, x,y in pixels:\n{}{reasons}", table.to_text())
}

/// Why a shaft or its end was not found, and what to do.
fn why(reason: &str) -> &'static str {
    match reason {
        "no_marker_colour" => {
            "nothing straight of the marked colour comes from the tool's side; mark more of the shaft"
        }
        "tip_hidden" => "the end is hidden, outside the picture, or looks like what lies ahead of it",
        "other_tools_band" => "the only shaft in sight is the other tool's; check the tools' sides",
        _ => "its edges hardly differ from what is behind them; cover dark things in the box, or use tape",
    }
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
