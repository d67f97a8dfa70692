//! Plots of slides along one guide: the deviation of each slide from the line through all slides.

use nalgebra::{Point3, Vector3};

use super::node::{Markup, element};
use super::page;
use super::plot::{AxisRange, MARGIN, Panel, WIDTH, label, picture};
use crate::checks::evaluation::Line3;

/// Distance from the common line over the position along the guide: across in the picture plane, and in depth.
pub fn pictures(paths: &[Vec<Point3<f64>>]) -> Markup {
    let all: Vec<Point3<f64>> = paths.iter().flatten().copied().collect();
    let picture = Line3::fit(&all).map(|line| element("div", &[("class", "card")], [deviation_plot(&line, paths)]));
    let caption = "Zero is the line through all slides. If the curves run together but bend away from zero, there is a \
                   systematic error along the guide. If they run apart, slides were measured differently. Early slides \
                   are blue, late ones orange.";
    page::section("Slides along the guide", picture.into_iter().chain([page::caption(caption)]))
}

fn deviation_plot(line: &Line3, paths: &[Vec<Point3<f64>>]) -> Markup {
    const HEIGHT: f64 = 150.0;
    let (across, deep) = cross_directions(&line.direction);
    let places = |side: Vector3<f64>| {
        let of_point = move |p: &Point3<f64>| (line.position_mm(p), (p - line.centre).dot(&side));
        paths.iter().map(|path| path.iter().map(of_point).collect::<Vec<_>>()).collect::<Vec<_>>()
    };
    let drawn = [(across, "across, mm"), (deep, "in depth, mm")].map(|(side, name)| (places(side), name));
    let x = AxisRange::around(drawn[0].0.iter().flatten().map(|(place, _)| *place));
    let mut parts: Vec<Markup> = paths.iter().enumerate().map(|(n, _)| name(n, paths.len())).collect();
    for (index, (slides, name)) in drawn.iter().enumerate() {
        let reach = slides.iter().flatten().map(|(_, off)| off.abs()).fold(0.2, f64::max) * 1.1;
        let top = 28.0 + (HEIGHT + 16.0) * index as f64;
        let y = AxisRange { from: -reach, to: reach };
        let panel = Panel { left: MARGIN.0, top, width: WIDTH - MARGIN.0 - 10.0, height: HEIGHT, x, y };
        parts.push(if index == 1 { panel.axes("along the guide, mm", name) } else { panel.axes_beside(name) });
        parts.extend(
            slides.iter().enumerate().map(|(n, slide)| coloured_by_order(n, slides.len(), panel.line("slide", slide))),
        );
    }
    picture("slides along the guide", 28.0 + 2.0 * (HEIGHT + 16.0) + MARGIN.1, parts)
}

fn name(n: usize, count: usize) -> Markup {
    let step = ((WIDTH - MARGIN.0) / count as f64).min(70.0);
    coloured_by_order(n, count, label("slide", (MARGIN.0 + step * n as f64, 14.0), &format!("slide {}", n + 1)))
}

/// A part in the colour of slide `n` of `count`.
fn coloured_by_order(n: usize, count: usize, part: Markup) -> Markup {
    let place = n as f64 / (count - 1).max(1) as f64;
    element("g", &[("style", &format!("--place: {place:.3}"))], [part])
}

/// Two directions perpendicular to the guide: one in the picture plane, the other as close to the line of sight as
/// possible.
fn cross_directions(direction: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let across = direction.cross(&Vector3::z()).try_normalize(1e-6).unwrap_or_else(Vector3::x);
    (across, across.cross(direction))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sides_are_square_to_the_guide_and_one_lies_in_the_picture_plane() {
        for direction in [Vector3::new(0.6, 0.0, 0.8), Vector3::new(0.43, -0.9, 0.06), Vector3::z()] {
            let direction = direction.normalize();
            let (across, deep) = cross_directions(&direction);
            assert!(across.dot(&direction).abs() < 1e-9 && deep.dot(&direction).abs() < 1e-9);
            assert!(across.z.abs() < 1e-9 && (across.norm() - 1.0).abs() < 1e-9 && (deep.norm() - 1.0).abs() < 1e-9);
        }
        assert_eq!(cross_directions(&Vector3::x()).1, Vector3::z());
    }
}
