//! Plots over the recording's time: when a tool was seen, and its error.

use std::collections::HashMap;
use std::ops::Range;

use maud::Markup;
use nalgebra::Vector3;
use plotters::style::{Color, RGBColor};

use super::plot::{
    BAD, BELOW, PlotLabels, STRONG, TOOL, UNITS, WARN, WIDTH, axes, band, bar, labelled_axes, line, part, plot,
    zero_line,
};
use super::{DrawnTool, page, stretches, tool_card};
use crate::checks::evaluation::{CHI_SQUARE_95, JudgedRow, MIN_VISIBLE_SHARE, Truth, TruthFrame, VISIBILITY_LEVELS};
use crate::vision::trajectory::SampleState;

/// The lanes from below; the visible share is drawn above them.
const LANES: [(&str, RGBColor); 4] = [("false", BAD), ("missing", BAD), ("predicted", WARN), ("observed", TOOL)];

/// The lanes of each tool: when it was visible, observed, predicted, missing or false.
pub fn seen(tools: &[DrawnTool], truth: &Truth) -> anyhow::Result<Markup> {
    let time = time(truth);
    let pictures = tools.iter().map(|tool| Ok(tool_card(tool, &lanes(tool, truth, &time)?)));
    let caption = format!(
        "Grey: visible share of the band. Missing: at least {:.0} % of the band is visible, but the track has no row. \
         False: the track has a row while the tool is out of sight.",
        100.0 * VISIBILITY_LEVELS[0]
    );
    Ok(page::pictures("Seen, predicted, missing", &pictures.collect::<anyhow::Result<Vec<_>>>()?, &caption))
}

fn lanes(tool: &DrawnTool, truth: &Truth, time: &Range<f64>) -> anyhow::Result<Markup> {
    const HALF_LANE: f64 = 0.36;
    let frames: Vec<(f64, f64, Option<&str>)> = lanes_of_frames(tool, truth);
    let length_s = time.end - time.start;
    let step_s = length_s / frames.len().max(1) as f64;
    let count = |lane: &str| frames.iter().filter(|(_, _, of_frame)| *of_frame == Some(lane)).count();
    let names: Vec<String> = LANES.iter().map(|(lane, _)| format!("{lane} {}", count(lane))).collect();
    let name = |y: &f64| match y.round() as usize {
        lane if lane == LANES.len() => "visible".to_owned(),
        lane => names.get(lane).cloned().unwrap_or_default(),
    };
    let labels = PlotLabels { width: 96, distance: 13, text: &name };
    let bottom = LANES.len() as f64 - HALF_LANE;
    let shares: Vec<_> = frames.iter().map(|(time_s, visible, _)| (*time_s, bottom, bottom + visible)).collect();
    plot(&format!("when {} was seen", tool.name), 130, |area| {
        let axes = labelled_axes(area, (time.clone(), "time, s"), (-0.5..bottom + 1.1, ""), &labels)?;
        band(&axes, &shares, STRONG.mix(0.4))?;
        for (y, (lane, colour)) in LANES.iter().enumerate() {
            let is_in_lane: Vec<_> = frames.iter().map(|(time_s, _, of)| (*time_s, *of == Some(*lane))).collect();
            for (from, to) in runs(&is_in_lane) {
                // One frame of an hour is visible, too.
                let to = to + step_s.max(1e-3 * length_s);
                bar(&axes, [(from, y as f64 - HALF_LANE), (to, y as f64 + HALF_LANE)], colour.mix(1.0))?;
            }
        }
        Ok(())
    })
}

/// Time, visible share and lane of each frame.
fn lanes_of_frames(tool: &DrawnTool, truth: &Truth) -> Vec<(f64, f64, Option<&'static str>)> {
    let rows: HashMap<u64, &JudgedRow> = tool.rows.iter().map(|row| (row.sample.frame, row)).collect();
    let lane = |frame: u64, visible: f64| match rows.get(&frame) {
        Some(row) if row.is_false() => Some("false"),
        Some(row) => match row.sample.state {
            SampleState::Observed => Some("observed"),
            SampleState::Predicted => Some("predicted"),
        },
        None => (visible >= VISIBILITY_LEVELS[0]).then_some("missing"),
    };
    let of_frame = |frame: &TruthFrame| {
        let visible = frame.tools.iter().find(|t| t.tool == tool.name).map_or(0.0, |t| t.visible);
        (frame.time_s, visible, lane(frame.frame, visible))
    };
    truth.frames.iter().map(of_frame).collect()
}

/// Start and end times of each run of frames whose flag is true.
fn runs(frames: &[(f64, bool)]) -> Vec<(f64, f64)> {
    let holding = frames.chunk_by(|a, b| a.1 == b.1).filter(|run| run[0].1);
    holding.map(|run| (run[0].0, run[run.len() - 1].0)).collect()
}

fn time(truth: &Truth) -> Range<f64> {
    let ends = [truth.frames.first(), truth.frames.last()].map(|frame| frame.map_or(0.0, |frame| frame.time_s));
    ends[0]..ends[1].max(ends[0] + 1e-3)
}

/// Errors in x, y and z over time, with the band that should contain 95 % of them.
pub fn errors(tools: &[DrawnTool]) -> anyhow::Result<Markup> {
    let caption = "Line: the error, measured minus true position. Band: the 95 % error bar that the track states. \
                   Below zero: too far left (x), up (y), near (z). Errors outside the plot are drawn at its edge.";
    let drawn = tools.iter().filter(|tool| tool.rows.iter().any(|row| !row.is_false()));
    let pictures = drawn.map(|tool| Ok(tool_card(tool, &errors_of(tool)?)));
    Ok(page::pictures("Errors over time", &pictures.collect::<anyhow::Result<Vec<_>>>()?, caption))
}

fn errors_of(tool: &DrawnTool) -> anyhow::Result<Markup> {
    const HEIGHT: u32 = 110;
    let rows: Vec<&JudgedRow> = tool.rows.iter().filter(|row| row.visible >= MIN_VISIBLE_SHARE).collect();
    let time = rows[0].time_s..rows[rows.len() - 1].time_s.max(rows[0].time_s + 1e-3);
    let (lateral, depth) = (axis_limit(&rows, &[0, 1]), axis_limit(&rows, &[2]));
    plot(&format!("errors of {} over time", tool.name), 3 * HEIGHT + BELOW, |area| {
        for (axis, name) in ["x, mm", "y, mm", "z (depth), mm"].into_iter().enumerate() {
            let (reach, time_name, below) = if axis == 2 { (depth, "time, s", BELOW) } else { (lateral, "", 0) };
            let area = part(area, (0, HEIGHT * axis as u32), (WIDTH, HEIGHT + below));
            let axes = axes(&area, (time.clone(), time_name), (-reach..reach, name))?;
            zero_line(&axes)?;
            for stretch in stretches(&rows) {
                let stated: Vec<_> = stretch.iter().filter_map(|r| bound(r, axis).map(|b| (r.time_s, -b, b))).collect();
                band(&axes, &stated, TOOL.mix(0.2))?;
                let errors: Vec<_> = stretch.iter().map(|r| (r.time_s, r.error_mm[axis])).collect();
                line(&axes, &errors, TOOL.stroke_width(3 * UNITS / 2))?;
            }
        }
        Ok(())
    })
}

/// Half of the stated 95 % interval of one axis, mm.
fn bound(row: &JudgedRow, axis: usize) -> Option<f64> {
    let stated = row.sample.covariance_mm2?.matrix();
    Some((CHI_SQUARE_95[0] * stated[(axis, axis)]).sqrt())
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
