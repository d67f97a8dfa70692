//! The main figures at the top, and the table of all figures with units.

use maud::{Markup, html};

use super::figures::{self, NO_VALUE};
use super::page;
use crate::checks::evaluation::{
    Accuracy, ErrorSpread, ErrorSummary, Repeatability, SigmaCheck, ToolAccuracy, VisibilityLevel,
};

/// The main figures of a track, over all tools.
pub fn lead(accuracy: &Accuracy) -> Markup {
    let (all, level) = (&accuracy.all, &accuracy.all.levels[0]);
    let or_none = |value: Option<String>| value.unwrap_or_else(|| NO_VALUE.to_owned());
    let error = level.errors.map(|e| format!("{:.2} mm", e.three_d.rms));
    let inside = level.sigma_check.map(|h| format!("{} %", figures::percent(h.three_d.inside)));
    page::lead(&[
        ("3-D error", or_none(error), "root mean square, all tools"),
        ("Tips found", format!("{} %", figures::found(level)), "of frames that show at least 40 % of the band"),
        (
            "False · exchanged",
            format!("{} · {}", all.false_tracks, level.swaps),
            "rows for a tool out of sight · rows at the other tool",
        ),
        ("Inside stated 95 %", or_none(inside), "of the errors; 95 % are expected"),
    ])
}

type FigureRow = (&'static str, fn(&ToolAccuracy, &VisibilityLevel) -> String);

/// The table of all figures, with a column per tool.
pub fn table(accuracy: &Accuracy) -> Markup {
    let columns = figures::rows(accuracy);
    let head = |(tool, level): &(&ToolAccuracy, &VisibilityLevel)| match level.visible_from {
        from if from > 0.4 => format!("{}, ≥ {:.0} % visible", figures::name(tool), 100.0 * from),
        _ => figures::name(tool).to_owned(),
    };
    let mut rows = vec![[String::new()].into_iter().chain(columns.iter().map(head)).collect()];
    for (name, of) in ROWS {
        rows.push([name.to_owned()].into_iter().chain(columns.iter().map(|(tool, level)| of(tool, level))).collect());
    }
    let notes = format!(
        "Only frames that show at least 40 % of a tool's band count. {} rows are on frames without truth. The times of \
         a frame in the two files differ by at most {:.1} ms. The interval after a share is its 95 % interval for \
         independent rows; the rows of a smoothed track are not independent, so the true interval is wider.",
        accuracy.rows_without_truth,
        1000.0 * accuracy.largest_time_difference_s
    );
    page::section("Figures", html! { (page::table(&rows)) p { (notes) } })
}

const ROWS: [FigureRow; 17] = [
    ("Frames with the tool in view", |_, level| level.frames.to_string()),
    ("Found, %", |_, level| figures::found(level)),
    ("Found by a measurement, frames", |_, level| level.observed.to_string()),
    ("False tracks, rows", |tool, _| tool.false_tracks.to_string()),
    ("Exchanged with another tool, rows", |_, level| level.swaps.to_string()),
    ("Lateral error: RMS · median · 95 %, mm", |_, level| sizes(level, |e| e.lateral)),
    ("Depth error: RMS · median · 95 %, mm", |_, level| sizes(level, |e| e.depth)),
    ("3-D error: RMS · median · 95 %, mm", |_, level| sizes(level, |e| e.three_d)),
    ("Mean error x, mm", |_, level| mean(level, 0)),
    ("Mean error y, mm", |_, level| mean(level, 1)),
    ("Mean error of depth, mm (+: too far)", |_, level| mean(level, 2)),
    ("Lag, ms (± 95 %)", |_, level| figures::lag(level.lag)),
    ("Inside stated 95 %, lateral, %", |_, level| honesty(level, |h| figures::share(&h.lateral))),
    ("Inside stated 95 %, depth, %", |_, level| honesty(level, |h| figures::share(&h.depth))),
    ("Inside stated 95 %, 3-D, %", |_, level| honesty(level, |h| figures::share(&h.three_d))),
    ("Mean normalised squared error (expected: 1)", |_, level| {
        honesty(level, |h| format!("{:.2}", h.three_d.mean_square))
    }),
    ("Speed while the tool rests: median · RMS, mm/s", |tool, _| {
        tool.rest_noise.map_or_else(|| "no rest".to_owned(), |f| format!("{:.2} · {:.2}", f.median_mm_s, f.rms_mm_s))
    }),
];

fn sizes(level: &VisibilityLevel, of: fn(&ErrorSummary) -> ErrorSpread) -> String {
    let sizes = level.errors.as_ref().map(of);
    sizes.map_or_else(|| NO_VALUE.to_owned(), |s| format!("{:.2} · {:.2} · {:.2}", s.rms, s.median, s.p95))
}

fn mean(level: &VisibilityLevel, axis: usize) -> String {
    level.errors.map_or_else(|| NO_VALUE.to_owned(), |e| signed(e.bias_mm[axis]))
}

/// A number with a typographic minus sign; never "−0.00".
fn signed(mm: f64) -> String {
    let mm = if mm.abs() < 0.005 { 0.0 } else { mm };
    format!("{mm:.2}").replace('-', "\u{2212}")
}

fn honesty(level: &VisibilityLevel, of: fn(&SigmaCheck) -> String) -> String {
    level.sigma_check.as_ref().map_or_else(|| "no error stated".to_owned(), of)
}

/// The main figures of repeatability.
pub fn lead_of_slides(result: &Repeatability) -> Markup {
    let mm = |value: f64| format!("{value:.2} mm");
    page::lead(&[
        ("Repeatability", mm(result.others_mm), "mean distance of other slides' points to a slide's line"),
        ("Within a slide", mm(result.own_mm), "mean distance of its points to its own line"),
        ("Slides", result.lines.len().to_string(), "along one guide, each way counted"),
    ])
}

/// The table of mean distances of each slide's points to each slide's line.
pub fn distances(result: &Repeatability) -> Markup {
    let head = (1..=result.lines.len()).map(|n| n.to_string());
    let mut rows = vec![["points of slide".to_owned()].into_iter().chain(head).collect::<Vec<_>>()];
    for (line, distances) in result.mean_distance_mm.iter().enumerate() {
        let cells = distances.iter().map(|mm| format!("{mm:.2}"));
        rows.push([format!("to the line of slide {}", line + 1)].into_iter().chain(cells).collect());
    }
    page::section("Mean distance of a slide's points, mm", page::table(&rows))
}
