//! Plots of the path over the true path, as seen by the camera and from the side.

use maud::Markup;
use nalgebra::Point3;
use plotters::style::Color;

use super::plot::{ABOVE, BELOW, LEFT, RIGHT, STRONG, TOOL, UNITS, WIDTH, axes, line, part, plot, range_around};
use super::{DrawnTool, page, stretches, tool_card};
use crate::checks::evaluation::JudgedRow;

/// Both views of each tool.
pub fn views(tools: &[DrawnTool]) -> anyhow::Result<Markup> {
    let drawn = tools.iter().filter(|tool| !tool.motion.is_empty());
    let pictures = drawn.map(|tool| Ok(tool_card(tool, &view(tool)?)));
    let caption = "Broad and grey: the truth. Thin and coloured: the track. Left: as the camera sees it. Right: from \
                   the side, with the camera above. Millimetres, same scale on both axes.";
    Ok(page::pictures("Path over truth", &pictures.collect::<anyhow::Result<Vec<_>>>()?, caption))
}

fn view(tool: &DrawnTool) -> anyhow::Result<Markup> {
    const MARGIN_MM: f64 = 6.0;
    const MAX_HEIGHT: f64 = 520.0;
    let truth: &[Point3<f64>] = tool.motion.tips_mm();
    let rows: Vec<&JudgedRow> = tool.rows.iter().filter(|row| !row.is_false()).collect();
    let track: Vec<Vec<Point3<f64>>> =
        stretches(&rows).map(|rows| rows.iter().map(|r| r.sample.tip_mm).collect()).collect();
    let span = |axis: usize| range_around(truth.iter().flat_map(|p| [p[axis] - MARGIN_MM, p[axis] + MARGIN_MM]));
    let [x, y, z] = [0, 1, 2].map(span);
    let [width_mm, height_mm, depth_mm] = [&x, &y, &z].map(|span| span.end - span.start);
    let most_mm = height_mm.max(depth_mm);
    let per_mm = (f64::from(WIDTH / 2 - LEFT - RIGHT) / width_mm).min(MAX_HEIGHT / most_mm);
    let px = |mm: f64| (per_mm * mm).round() as u32;
    plot(&format!("path of {} over the truth", tool.name), ABOVE + px(most_mm) + BELOW, |area| {
        for (left, axis, span, name) in [(0, 1, &y, "y, mm"), (WIDTH / 2, 2, &z, "z (depth), mm")] {
            let size = (LEFT + px(width_mm) + RIGHT, ABOVE + px(span.end - span.start) + BELOW);
            let area = part(area, (left, 0), size);
            let axes = axes(&area, (x.clone(), "x, mm"), (span.end..span.start, name))?;
            let flat = |path: &[Point3<f64>]| path.iter().map(|p| (p.x, p[axis])).collect::<Vec<_>>();
            line(&axes, &flat(truth), STRONG.mix(0.55).stroke_width(4 * UNITS))?;
            track.iter().try_for_each(|path| line(&axes, &flat(path), TOOL.stroke_width(3 * UNITS / 2)))?;
        }
        Ok(())
    })
}
