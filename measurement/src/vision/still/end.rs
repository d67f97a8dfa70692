//! The end of a shaft between its borders in a still: where its colour ends, or its full width.
//!
//! The rows across the shaft and the rules are those of a recording. Without a camera, lengths along the shaft are in
//! widths of the picture: a lean makes them seem shorter than they are.

use crate::vision::edges::edge_model::EdgeModel;
use crate::vision::edges::shaft_rows::{self, ShaftRow};
use crate::vision::edges::{shaft_colour_end, shaft_end};
use crate::vision::frame::Frame;
use crate::vision::space::Pixel;

use super::lines::ShaftLines;

/// Rows across the width at the rough end: their distance is a twentieth of it, and from one pixel to two and a half.
const ROWS_PER_WIDTH: f64 = 20.0;
const ROWS_PX: (f64, f64) = (1.0, 2.5);
/// The rows reach from this far behind the rough end to that far ahead, diameters: things of the shaft's colour may
/// lie between the end and that of the strip.
const REACH_DIAMETERS: (f64, f64) = (20.0, 7.0);
/// Largest distance between the ends of the colour and of the full width, diameters.
const MAX_APART_DIAMETERS: f64 = 0.4;
/// Least width that is read, as a share of that at the rough end: ahead, the lines meet.
const LEAST_WIDTH: f64 = 0.3;

/// The place along the lines where the shaft ends; `None` if that is not clear.
pub fn locate(
    frame: &Frame<'_>,
    lines: &ShaftLines,
    edges: &EdgeModel,
    diameter_mm: f64,
    collar_mm: f64,
) -> Option<f64> {
    let (places, rows) = rows_across(frame, lines, diameter_mm)?;
    let full_width = shaft_end::locate(edges, &rows, diameter_mm, collar_mm).map(|end| end.back_mm);
    let colour = shaft_colour_end::locate(&rows, diameter_mm);
    let apart = |one: f64, other: f64| (one - other).abs() / diameter_mm;
    let is_agreed =
        |colour: &f64| full_width.map_or(collar_mm == 0.0, |end| apart(end, *colour) < MAX_APART_DIAMETERS);
    let reaches = |end: &f64| collar_mm > 0.0 || shaft_colour_end::reaches(&rows, diameter_mm, *end);
    let back_mm = colour.filter(is_agreed).or_else(|| full_width.filter(reaches))?;
    place_of(back_mm, &places, &rows)
}

/// The place along the lines of a distance behind the rough end.
fn place_of(back_mm: f64, places: &[f64], rows: &[ShaftRow]) -> Option<f64> {
    let next = rows.iter().position(|row| row.back_mm <= back_mm)?;
    let before = next.checked_sub(1)?;
    let share = (rows[before].back_mm - back_mm) / (rows[before].back_mm - rows[next].back_mm);
    Some(places[before] + share * (places[next] - places[before]))
}

/// The rows across a shaft, the farthest behind first, and their places along the lines.
fn rows_across(frame: &Frame<'_>, lines: &ShaftLines, diameter_mm: f64) -> Option<(Vec<f64>, Vec<ShaftRow>)> {
    let width = lines.width(lines.length);
    let step_px = (width / ROWS_PER_WIDTH).clamp(ROWS_PX.0, ROWS_PX.1);
    let step_mm = step_px * diameter_mm / width;
    let walk = |diameters: f64, sign: f64| {
        let count = (diameters * diameter_mm / step_mm) as usize;
        let next = move |place: &f64| Some(place + sign * step_mm * lines.width(*place) / diameter_mm);
        let is_shaft = move |place: &f64| lines.width(*place) > LEAST_WIDTH * width;
        std::iter::successors(Some(lines.length), next).skip(1).take(count).take_while(is_shaft).collect::<Vec<f64>>()
    };
    let (behind, ahead) = (walk(REACH_DIAMETERS.0, -1.0), walk(REACH_DIAMETERS.1, 1.0));
    let first = behind.len() as f64;
    let places: Vec<f64> = behind.into_iter().rev().chain([lines.length]).chain(ahead).collect();
    let row = |(i, place): (usize, &f64)| row_at(frame, lines, *place, (first - i as f64) * step_mm);
    let rows = places.iter().enumerate().map(row).collect();
    Some((places, rows))
}

fn row_at(frame: &Frame<'_>, lines: &ShaftLines, place: f64, back_mm: f64) -> ShaftRow {
    let [one, other] = [0, 1].map(|side| lines.offset(side, place));
    let (middle, half) = (0.5 * (one + other), 0.5 * (other - one));
    let codes = |across: f64| shaft_rows::codes_at(frame, Pixel(lines.at(place, middle + across)));
    shaft_rows::row_of(back_mm, |radii| codes(radii * half), |sign, px| codes(sign * (half + px)))
}
