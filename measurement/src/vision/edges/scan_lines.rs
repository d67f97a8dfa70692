//! Coarse borders and ends: scan lines across a band, perpendicular to *its* axis (with the image's axes, T 6.4 loses
//! accuracy), read through the segmentation.
//!
//! Each scan line is walked from outside inwards on both sides until tape begins, so that glare and creases inside the
//! band do no harm. Whole pixels only: [`super::subpixel`] does the rest.

use nalgebra::{Point2, Vector2};

use crate::vision::blob::moments::RegionRectangle;
use crate::vision::frame::Frame;
use crate::vision::segmentation::Segment;
use crate::vision::space::Pixel;

/// Result of the scan lines.
#[derive(Clone, Debug, PartialEq)]
pub struct CoarseBand {
    /// Points on the border to the right of `axis` (looking along it, y down) and to its left.
    pub borders: [Vec<Pixel>; 2],
    /// Points where the midline enters and leaves the tape: at the back and at the front of `axis`.
    pub ends: [Pixel; 2],
    /// Unit vector along the band; its sign has no meaning yet.
    pub axis: Vector2<f64>,
    /// Distance between the borders, pixels.
    pub width_px: f64,
}

/// Number of scan lines across one band.
const LINES: usize = 24;

/// Scans a band. `None` if fewer than a third of the lines found tape on both sides, or an end was not found.
pub fn scan(frame: &Frame<'_>, segment: &dyn Segment, class: u8, band: &RegionRectangle) -> Option<CoarseBand> {
    let across = Vector2::new(-band.axis.y, band.axis.x);
    let reach = 0.75 * band.width_px + 6.0;
    let mut borders = [Vec::with_capacity(LINES), Vec::with_capacity(LINES)];
    let mut widths = Vec::with_capacity(LINES);
    for i in 0..LINES {
        let along = ((i as f64 + 0.5) / LINES as f64 - 0.5) * 0.84 * band.length_px;
        let middle = Point2::from(band.centre + band.axis * along);
        let right = walk_in(frame, segment, class, middle + across * reach, -across, reach);
        let left = walk_in(frame, segment, class, middle - across * reach, across, reach);
        if let (Some(right), Some(left)) = (right, left) {
            widths.push((right.0 - left.0).norm());
            borders[0].push(right);
            borders[1].push(left);
        }
    }
    if widths.len() < LINES / 3 {
        return None;
    }
    widths.sort_by(f64::total_cmp);
    let length = 0.75 * band.length_px + 8.0;
    let centre = Point2::from(band.centre);
    let back = walk_in(frame, segment, class, centre - band.axis * length, band.axis, length)?;
    let front = walk_in(frame, segment, class, centre + band.axis * length, -band.axis, length)?;
    Some(CoarseBand { borders, ends: [back, front], axis: band.axis, width_px: widths[widths.len() / 2] })
}

/// Walks from `from` until two consecutive pixels are tape; the border lies half a step before them.
fn walk_in(
    frame: &Frame<'_>,
    segment: &dyn Segment,
    class: u8,
    from: Point2<f64>,
    step: Vector2<f64>,
    most: f64,
) -> Option<Pixel> {
    let is_tape = |p: Point2<f64>| {
        let (x, y) = (p.x.round(), p.y.round());
        let inside = x >= 0.0 && y >= 0.0 && x < frame.width() as f64 && y < frame.height() as f64;
        inside && segment.class_at(frame, x as usize, y as usize) == class
    };
    let steps = most.floor().max(0.0) as usize;
    let at = |k: usize| from + step * k as f64;
    let first = (0..steps).find(|k| is_tape(at(*k)) && is_tape(at(k + 1)))?;
    Some(Pixel(at(first) - step * 0.5))
}
