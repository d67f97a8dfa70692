//! Plots over the recording's time: when a tool was seen, and its error.

use nalgebra::Vector3;

use super::node::Markup;
use super::plot::{AxisRange, MARGIN, Panel, WIDTH, group, label, picture};
use super::{DrawnTool, page, stretches, tool_card};
use crate::checks::evaluation::{CHI_SQUARE_95, JudgedRow, MIN_VISIBLE_SHARE, Truth, VISIBILITY_LEVELS};
use crate::vision::trajectory::SampleState;

/// Width of the lane names at the left.
const NAMES_WIDTH: f64 = 96.0;
const LANE_HEIGHT: f64 = 14.0;

/// The lanes of each tool: when it was visible, observed, predicted, missing or false.
pub fn seen(tools: &[DrawnTool], truth: &Truth) -> Markup {
    let time = time(truth);
    let pictures = tools.iter().map(|tool| tool_card(tool, lanes(tool, truth, time)));
    let caption = format!(
        "Grey: visible share of the band. Missing: at least {:.0} % of the band is visible, but the track has no row. \
         False: the track has a row while the tool is out of sight.",
        100.0 * VISIBILITY_LEVELS[0]
    );
    page::section("Seen, predicted, missing", pictures.chain([page::caption(&caption)]))
}

fn lanes(tool: &DrawnTool, truth: &Truth, time: AxisRange) -> Markup {
    let frames: Vec<(u64, f64, f64)> =
        truth.frames.iter().map(|f| (f.frame, f.time_s, visible(f, tool.name))).collect();
    let step_s = time.length() / frames.len().max(1) as f64;
    let rows: std::collections::HashMap<u64, &JudgedRow> = tool.rows.iter().map(|r| (r.sample.frame, r)).collect();
    let is = |lane: &str, frame: u64, visible: f64| match rows.get(&frame) {
        Some(row) => match lane {
            "observed" => !row.is_false() && row.sample.state == SampleState::Observed,
            "predicted" => !row.is_false() && row.sample.state == SampleState::Predicted,
            "false" => row.is_false(),
            _ => false,
        },
        None => lane == "missing" && visible >= VISIBILITY_LEVELS[0],
    };
    let head = Panel {
        left: NAMES_WIDTH,
        top: 24.0,
        width: WIDTH - NAMES_WIDTH - 10.0,
        height: 30.0,
        x: time,
        y: AxisRange { from: 0.0, to: 1.0 },
    };
    let shares: Vec<_> = frames.iter().map(|(_, time_s, visible)| (*time_s, 0.0, *visible)).collect();
    let mut parts =
        vec![label("title", (0.0, 14.0), tool.name), label("number end", (NAMES_WIDTH - 8.0, 44.0), "visible")];
    parts.push(head.band("share", &shares));
    let mut top = head.top + head.height + 8.0;
    for lane in ["observed", "predicted", "missing", "false"] {
        let panel = Panel { top, height: LANE_HEIGHT - 4.0, ..head };
        let runs = runs(&frames.iter().map(|(frame, time_s, v)| (*time_s, is(lane, *frame, *v))).collect::<Vec<_>>());
        let count = frames.iter().filter(|(frame, _, v)| is(lane, *frame, *v)).count();
        parts.push(label("number end", (NAMES_WIDTH - 8.0, top + 9.0), &format!("{lane} {count}")));
        parts.push(group("", runs.into_iter().map(|(from, to)| panel.bar(lane, (from, to + step_s), (0.0, 1.0)))));
        top += LANE_HEIGHT;
    }
    let whole = Panel { height: top - head.top, ..head };
    parts.push(whole.axes_below("time, s"));
    picture(&format!("when {} was seen", tool.name), top + MARGIN.1 + 4.0, parts)
}

fn visible(frame: &crate::checks::evaluation::TruthFrame, name: &str) -> f64 {
    frame.tools.iter().find(|tool| tool.tool == name).map_or(0.0, |tool| tool.visible)
}

/// Start and end times of each run of frames whose flag is true.
fn runs(frames: &[(f64, bool)]) -> Vec<(f64, f64)> {
    let holding = frames.chunk_by(|a, b| a.1 == b.1).filter(|run| run[0].1);
    holding.map(|run| (run[0].0, run[run.len() - 1].0)).collect()
}

fn time(truth: &Truth) -> AxisRange {
    let ends = [truth.frames.first(), truth.frames.last()].map(|frame| frame.map_or(0.0, |frame| frame.time_s));
    AxisRange { from: ends[0], to: ends[1].max(ends[0] + 1e-3) }
}

/// Errors in x, y and z over time, with the band that should contain 95 % of them.
pub fn errors(tools: &[DrawnTool]) -> Markup {
    let caption = "Line: the error, measured minus true position. Band: the 95 % error bar that the track states. \
                   Below zero: too far left (x), up (y), near (z). Errors outside the plot are drawn at its edge.";
    let drawn = tools.iter().filter(|tool| tool.rows.iter().any(|row| !row.is_false()));
    let pictures = drawn.map(|tool| tool_card(tool, errors_of(tool)));
    page::section("Errors over time", pictures.chain([page::caption(caption)]))
}

fn errors_of(tool: &DrawnTool) -> Markup {
    const HEIGHT: f64 = 96.0;
    const NEXT: f64 = HEIGHT + 14.0;
    let rows: Vec<&JudgedRow> = tool.rows.iter().filter(|row| row.visible >= MIN_VISIBLE_SHARE).collect();
    let time = AxisRange { from: rows[0].time_s, to: rows[rows.len() - 1].time_s.max(rows[0].time_s + 1e-3) };
    let (lateral, depth) = (axis_limit(&rows, &[0, 1]), axis_limit(&rows, &[2]));
    let mut parts = vec![label("title", (0.0, 14.0), tool.name)];
    for (axis, name) in ["x, mm", "y, mm", "z (depth), mm"].into_iter().enumerate() {
        let reach = if axis == 2 { depth } else { lateral };
        let panel = Panel {
            left: MARGIN.0,
            top: 24.0 + NEXT * axis as f64,
            width: WIDTH - MARGIN.0 - 10.0,
            height: HEIGHT,
            x: time,
            y: AxisRange { from: -reach, to: reach },
        };
        parts.push(if axis == 2 { panel.axes("time, s", name) } else { panel.axes_beside(name) });
        for stretch in stretches(&rows) {
            let band = stretch.iter().filter_map(|r| bound(r, axis).map(|b| (r.time_s, -b, b))).collect::<Vec<_>>();
            parts.push(panel.band("stated", &band));
            parts.push(panel.line("track", &stretch.iter().map(|r| (r.time_s, r.error_mm[axis])).collect::<Vec<_>>()));
        }
    }
    picture(&format!("errors of {} over time", tool.name), 24.0 + 3.0 * NEXT + MARGIN.1 - 10.0, parts)
}

/// Half of the stated 95 % interval of one axis, mm.
fn bound(row: &JudgedRow, axis: usize) -> Option<f64> {
    let sigma = if axis == 2 { row.sample.sigma_z_mm } else { row.sample.sigma_xy_mm };
    sigma.map(|sigma| CHI_SQUARE_95[0].sqrt() * sigma)
}

/// Limit of the axis, mm: 99 % of the errors and bounds fit.
fn axis_limit(rows: &[&JudgedRow], axes: &[usize]) -> f64 {
    let of_row = |row: &&JudgedRow| {
        let error: &Vector3<f64> = &row.error_mm;
        axes.iter().map(|a| error[*a].abs().max(bound(row, *a).unwrap_or(0.0))).fold(0.0, f64::max)
    };
    let mut sizes: Vec<f64> = rows.iter().map(of_row).collect();
    sizes.sort_by(f64::total_cmp);
    1.15 * sizes[(0.99 * (sizes.len() - 1) as f64).ceil() as usize].max(0.05)
}
