//! Plots of slides along one guide: the deviation of each slide from the line through all slides.

use maud::{Markup, html};
use nalgebra::{Point3, Vector3};
use plotters::style::{Color, RGBColor};

use super::page;
use super::plot::{BELOW, UNITS, WIDTH, axes, line, part, plot, range_around, zero_line};
use crate::checks::evaluation::Line3;

/// Distance from the common line over the position along the guide: across in the picture plane, and in depth.
pub fn pictures(paths: &[Vec<Point3<f64>>]) -> anyhow::Result<Markup> {
    let all: Vec<Point3<f64>> = paths.iter().flatten().copied().collect();
    let plot = Line3::fit(&all).map(|line| deviation_plot(&line, paths)).transpose()?;
    let card = |plot| {
        html! {
            div.card {
                p.legend { @for n in 0..paths.len() { (legend(n, paths.len())) } }
                (plot)
            }
        }
    };
    let caption = "Zero is the line through all slides. If the curves run together but bend away from zero, there is a \
                   systematic error along the guide. If they run apart, slides were measured differently. Early slides \
                   are blue, late ones orange.";
    Ok(page::pictures("Slides along the guide", &plot.map(card).into_iter().collect::<Vec<_>>(), caption))
}

fn deviation_plot(guide: &Line3, paths: &[Vec<Point3<f64>>]) -> anyhow::Result<Markup> {
    const HEIGHT: u32 = 166;
    let (across, deep) = cross_directions(&guide.direction);
    let places = |side: Vector3<f64>| {
        let of_point = move |p: &Point3<f64>| (guide.position_mm(p), (p - guide.centre).dot(&side));
        paths.iter().map(|path| path.iter().map(of_point).collect::<Vec<_>>()).collect::<Vec<_>>()
    };
    let drawn = [(places(across), "across, mm", "", 0), (places(deep), "in depth, mm", "along the guide, mm", BELOW)];
    let x = range_around(drawn[0].0.iter().flatten().map(|(place, _)| *place));
    plot("slides along the guide", 2 * HEIGHT + BELOW, |area| {
        for (index, (slides, name, x_name, below)) in drawn.iter().enumerate() {
            let reach = slides.iter().flatten().map(|(_, off)| off.abs()).fold(0.2, f64::max) * 1.1;
            let area = part(area, (0, HEIGHT * index as u32), (WIDTH, HEIGHT + below));
            let axes = axes(&area, (x.clone(), x_name), (-reach..reach, name))?;
            zero_line(&axes)?;
            for (n, slide) in slides.iter().enumerate() {
                line(&axes, slide, colour(n, slides.len()).stroke_width(3 * UNITS / 2))?;
            }
        }
        Ok(())
    })
}

fn legend(n: usize, count: usize) -> Markup {
    let RGBColor(r, g, b) = colour(n, count);
    html! { span { span style=(format!("color: rgb({r} {g} {b})")) { "■" } " slide " (n + 1) } " " }
}

/// The colour of slide `n` of `count`, from blue to orange, readable on light and dark.
fn colour(n: usize, count: usize) -> RGBColor {
    let place = n as f64 / (count - 1).max(1) as f64;
    let mixed = |early: f64, late: f64| (early + place * (late - early)).round() as u8;
    RGBColor(mixed(75.0, 224.0), mixed(112.0, 96.0), mixed(214.0, 24.0))
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
