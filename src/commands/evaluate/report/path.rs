//! Plots of the path over the true path, as seen by the camera and from the side.

use nalgebra::Point3;

use super::node::Markup;
use super::plot::{AxisRange, MARGIN, Panel, WIDTH, label, picture};
use super::{DrawnTool, page, stretches, tool_card};
use crate::checks::evaluation::JudgedRow;

/// Both views of each tool.
pub fn views(tools: &[DrawnTool]) -> Markup {
    let pictures = tools.iter().filter(|tool| !tool.motion.is_empty()).map(|tool| tool_card(tool, view(tool)));
    let caption = "Broad and grey: the truth. Thin and coloured: the track. Left: as the camera sees it. Right: from \
                   the side, with the camera above. Millimetres, same scale on both axes.";
    page::section("Path over truth", pictures.chain([page::caption(caption)]))
}

fn view(tool: &DrawnTool) -> Markup {
    const GAP: f64 = 70.0;
    const MAX_HEIGHT: f64 = 520.0;
    let truth: Vec<Point3<f64>> = tool.motion.tips_mm().to_vec();
    let rows: Vec<&JudgedRow> = tool.rows.iter().filter(|row| !row.is_false()).collect();
    let track: Vec<Vec<Point3<f64>>> =
        stretches(&rows).map(|rows| rows.iter().map(|r| r.sample.tip_mm).collect()).collect();
    let span = |axis: usize| AxisRange::around(truth.iter().map(|p| p[axis])).with_margin(6.0);
    let (x, y, z) = (span(0), span(1), span(2));
    let width = 0.5 * (WIDTH - 2.0 * MARGIN.0 - GAP);
    let per_mm = (width / x.length()).min(MAX_HEIGHT / y.length().max(z.length()));
    let panel = |left: f64, down: AxisRange| Panel {
        left,
        top: 24.0,
        width: per_mm * x.length(),
        height: per_mm * down.length(),
        x,
        y: AxisRange { from: down.to, to: down.from },
    };
    let right = MARGIN.0 + width + GAP;
    let mut parts = vec![label("title", (0.0, 14.0), tool.name)];
    for (panel, axis, name) in [(panel(MARGIN.0, y), 1, "y, mm"), (panel(right, z), 2, "z (depth), mm")] {
        let flat = |path: &[Point3<f64>]| path.iter().map(|p| (p.x, p[axis])).collect::<Vec<_>>();
        parts.push(panel.axes("x, mm", name));
        parts.push(panel.line("truth", &flat(&truth)));
        parts.extend(track.iter().map(|stretch| panel.line("track", &flat(stretch))));
    }
    let height = 24.0 + per_mm * y.length().max(z.length()) + MARGIN.1 + 4.0;
    picture(&format!("path of {} over the truth", tool.name), height, parts)
}
