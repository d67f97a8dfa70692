//! Plots of the report, drawn by plotters as SVG.
//!
//! plotters writes fixed colours and whole picture units. So the style sheet replaces each colour by one of the page,
//! in light and dark mode and on paper, and a plot has several units per pixel.

use std::ops::Range;

use maud::{Markup, PreEscaped, html};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::data::float::pretty_print_float;
use plotters::element::DashedPathElement;
use plotters::prelude::*;

/// Width of a plot, pixels of a wide page.
pub const WIDTH: u32 = 960;

/// Picture units per pixel of a wide page.
pub const UNITS: u32 = 4;

/// Space above the axes, pixels.
pub const ABOVE: u32 = 8;
/// Space at the left for numbers and name of the vertical axis, pixels.
pub const LEFT: u32 = 58;
/// Space for numbers and name of the horizontal axis, pixels.
pub const BELOW: u32 = 38;
/// Space at the right of the axes, pixels.
pub const RIGHT: u32 = 10;

/// Colour of the tool. The style sheet replaces this colour and the next ones.
pub const TOOL: RGBColor = RGBColor(0xc2, 0x56, 0x0a);
/// Colour of text and of curves to compare with.
pub const INK: RGBColor = RGBColor(0x12, 0x20, 0x1f);
/// Colour of the truth and of zero.
pub const STRONG: RGBColor = RGBColor(0x7d, 0x8f, 0x8e);
/// Colour of the grid.
pub const GRID: RGBColor = RGBColor(0xd3, 0xdc, 0xdb);
/// Colour of warnings.
pub const WARN: RGBColor = RGBColor(0x81, 0x50, 0x00);
/// Colour of faults.
pub const BAD: RGBColor = RGBColor(0xa4, 0x26, 0x2c);

/// The area of a plot, or a part of it.
pub type PlotArea<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Axes with their area.
pub type PlotAxes<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// The labels of a vertical axis.
pub struct PlotLabels<'a> {
    /// Width of their column, pixels.
    pub width: u32,
    /// Smallest distance between two labels, pixels.
    pub distance: u32,
    /// The text at a value.
    pub text: &'a dyn Fn(&f64) -> String,
}

/// A plot of this height, pixels. `name` describes it for readers who do not see it.
pub fn plot(name: &str, height: u32, draw: impl FnOnce(&PlotArea<'_>) -> anyhow::Result<()>) -> anyhow::Result<Markup> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, (WIDTH * UNITS, height * UNITS)).into_drawing_area();
    draw(&area)?;
    area.present()?;
    drop(area);
    Ok(html! { div role="img" aria-label=(name) { (PreEscaped(svg)) } })
}

/// The part of an area with this left upper corner and size, pixels.
pub fn part<'a>(area: &PlotArea<'a>, corner: (u32, u32), size: (u32, u32)) -> PlotArea<'a> {
    area.clone().shrink((corner.0 * UNITS, corner.1 * UNITS), (size.0 * UNITS, size.1 * UNITS))
}

/// Axes over the whole area, each with its range and name. An empty name leaves the horizontal axis without numbers.
pub fn axes<'a>(area: &PlotArea<'a>, x: (Range<f64>, &str), y: (Range<f64>, &str)) -> anyhow::Result<PlotAxes<'a>> {
    labelled_axes(area, x, y, &PlotLabels { width: LEFT, distance: 26, text: &number })
}

/// The same with other labels of the vertical axis.
pub fn labelled_axes<'a>(
    area: &PlotArea<'a>,
    (x, x_name): (Range<f64>, &str),
    (y, y_name): (Range<f64>, &str),
    y_labels: &PlotLabels,
) -> anyhow::Result<PlotAxes<'a>> {
    let mut axes = ChartBuilder::on(area)
        .margin_top(ABOVE * UNITS)
        .margin_right(RIGHT * UNITS)
        .x_label_area_size(if x_name.is_empty() { 0 } else { BELOW * UNITS })
        .y_label_area_size(y_labels.width * UNITS)
        .build_cartesian_2d(x, y)?;
    let (width, height) = axes.plotting_area().dim_in_pixel();
    axes.configure_mesh()
        .x_labels((width / (90 * UNITS)).max(2) as usize)
        .y_labels((height / (y_labels.distance * UNITS)).max(2) as usize)
        .x_label_formatter(&number)
        .y_label_formatter(y_labels.text)
        .x_desc(x_name)
        .y_desc(y_name)
        .label_style(("sans-serif", 15 * UNITS)) // the SVG's text is smaller by a factor of 1.24
        .set_all_tick_mark_size(2 * UNITS)
        .light_line_style(TRANSPARENT)
        .bold_line_style(GRID.stroke_width(UNITS))
        .axis_style(GRID.stroke_width(UNITS))
        .draw()?;
    Ok(axes)
}

/// The line where y is zero.
pub fn zero_line(axes: &PlotAxes) -> anyhow::Result<()> {
    let x = axes.x_range();
    line(axes, &[(x.start, 0.0), (x.end, 0.0)], STRONG.stroke_width(UNITS))
}

/// A line through the points in order. Points outside the axes are drawn at their edge.
pub fn line(axes: &PlotAxes, points: &[(f64, f64)], style: ShapeStyle) -> anyhow::Result<()> {
    Ok(axes.plotting_area().draw(&PathElement::new(thinned(points, &axes.x_range()), style))?)
}

/// A dashed line through the points in order.
pub fn dashed_line(axes: &PlotAxes, points: Vec<(f64, f64)>, style: ShapeStyle) -> anyhow::Result<()> {
    Ok(axes.plotting_area().draw(&DashedPathElement::new(points, 5 * UNITS, 4 * UNITS, style))?)
}

/// The area between two lines with the same x values: x, lower and upper y.
pub fn band(axes: &PlotAxes, points: &[(f64, f64, f64)], colour: RGBAColor) -> anyhow::Result<()> {
    let upper: Vec<_> = points.iter().map(|(x, _, high)| (*x, *high)).collect();
    let lower: Vec<_> = points.iter().map(|(x, low, _)| (*x, *low)).collect();
    let mut outline = thinned(&upper, &axes.x_range());
    outline.extend(thinned(&lower, &axes.x_range()).into_iter().rev());
    Ok(axes.plotting_area().draw(&Polygon::new(outline, colour))?)
}

/// A bar between two corners.
pub fn bar(axes: &PlotAxes, corners: [(f64, f64); 2], colour: RGBAColor) -> anyhow::Result<()> {
    Ok(axes.plotting_area().draw(&Rectangle::new(corners, colour.filled()))?)
}

/// A range that holds all values, with a small margin. Never empty.
pub fn range_around(values: impl IntoIterator<Item = f64>) -> Range<f64> {
    let (low, high) = values.into_iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
    let (low, high) = if low > high { (0.0, 1.0) } else { (low, high) };
    let margin = (0.04 * (high - low)).max(1e-3);
    low - margin..high + margin
}

/// If there are many points, only the first, lowest, highest and last of each pixel column: an hour of video then looks
/// the same and takes no more space than a minute.
fn thinned(points: &[(f64, f64)], x: &Range<f64>) -> Vec<(f64, f64)> {
    const MAX_POINTS: usize = 2000;
    if points.len() <= MAX_POINTS {
        return points.to_vec();
    }
    let column = |point: &(f64, f64)| ((point.0 - x.start) / (x.end - x.start) * f64::from(WIDTH)).floor();
    let of_column = |group: &[(f64, f64)]| {
        let by_height = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let ends = [group.first(), group.iter().min_by(by_height), group.iter().max_by(by_height), group.last()];
        ends.into_iter().flatten().copied().collect::<Vec<_>>()
    };
    points.chunk_by(|a, b| column(a) == column(b)).flat_map(of_column).collect()
}

/// A number with a typographic minus sign.
fn number(value: &f64) -> String {
    let value = if value.abs() < 1e-9 { 0.0 } else { *value }; // never "−0"
    pretty_print_float(value, false).replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::super::page::STYLES;
    use super::*;

    #[test]
    fn a_long_line_keeps_its_extremes_and_few_points() {
        let mut points: Vec<(f64, f64)> = (0..100_000).map(|i| (f64::from(i) * 1e-3, 0.0)).collect();
        points[54_321].1 = 1.0;
        points[60_000].1 = -1.0;
        let thinned = thinned(&points, &(0.0..100.0));
        assert!(thinned.len() <= 4 * (WIDTH as usize + 1), "{}", thinned.len());
        assert!(thinned.contains(&(54.321, 1.0)) && thinned.contains(&(60.0, -1.0)));
    }

    #[test]
    fn up_is_up_and_points_outside_are_drawn_at_the_edge() {
        let drawn = plot("a line", 100, |area| {
            line(&axes(area, (0.0..10.0, "x"), (-1.0..1.0, "y"))?, &[(0.0, -1.0), (10.0, 7.0)], TOOL.stroke_width(1))
        });
        let (left, right) = (LEFT * UNITS, (WIDTH - RIGHT) * UNITS - 1);
        let (top, bottom) = (ABOVE * UNITS, (100 - BELOW) * UNITS - 1);
        let points = format!("points=\"{left},{bottom} {right},{top} \"");
        let svg = drawn.unwrap().into_string();
        assert!(svg.contains(&points), "{points}\n{svg}");
    }

    #[test]
    fn numbers_on_axes_are_short_with_a_minus_sign() {
        assert_eq!([-0.5, -1e-17, 20.0].map(|value| number(&value)), ["\u{2212}0.5", "0", "20"]);
    }

    #[test]
    fn the_style_sheet_replaces_every_colour() {
        for RGBColor(r, g, b) in [TOOL, INK, STRONG, GRID, WARN, BAD] {
            let colour = format!("\"#{r:02X}{g:02X}{b:02X}\"] {{");
            assert!(STYLES.concat().contains(&colour), "{colour}");
        }
    }
}
