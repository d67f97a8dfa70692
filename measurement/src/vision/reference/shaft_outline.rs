//! Borders and ends of a shaft in a mask: scan lines across its region, and a line through each border (T 4.2.2).

use nalgebra::Point2;

use super::SHAFT_CLASS;
use crate::vision::blob::moments::RegionRectangle;
use crate::vision::camera::Camera;
use crate::vision::edges::line_fit::{self, BorderLine};
use crate::vision::edges::scan_lines;
use crate::vision::frame::Frame;
use crate::vision::segmentation::Segment;
use crate::vision::space::{Normalised, Pixel};

/// Both borders of a shaft as lines through normalised points, and the ends of its region on its midline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ShaftOutline {
    pub(super) borders: [BorderLine; 2],
    /// The end at the tip: the one farther from the picture's rim.
    pub(super) distal: Normalised,
    /// The end where the shaft leaves the picture, or its visible part ends.
    pub(super) proximal: Normalised,
}

/// Measures the shaft of a region, to whole pixels. `None` if too little of its borders is visible.
pub(super) fn measure(
    frame: &Frame<'_>,
    segment: &dyn Segment,
    camera: &Camera,
    region: &RegionRectangle,
) -> Option<ShaftOutline> {
    let coarse = scan_lines::scan(frame, segment, SHAFT_CLASS, region)?;
    let line = |points: &[Pixel]| {
        let points: Vec<Point2<f64>> = points.iter().filter_map(|at| Some(camera.normalised_of(*at)?.0)).collect();
        line_fit::fit(&points)
    };
    let [first, second] = &coarse.borders;
    let borders = [line(first)?, line(second)?];
    let [back, front] = coarse.ends;
    let is_front_distal = distance_to_rim(front, frame) >= distance_to_rim(back, frame);
    let (distal, proximal) = if is_front_distal { (front, back) } else { (back, front) };
    Some(ShaftOutline { borders, distal: camera.normalised_of(distal)?, proximal: camera.normalised_of(proximal)? })
}

/// Distance of a pixel from the picture's rim, pixels.
fn distance_to_rim(at: Pixel, frame: &Frame<'_>) -> f64 {
    let across = at.u().min(frame.width() as f64 - 1.0 - at.u());
    let down = at.v().min(frame.height() as f64 - 1.0 - at.v());
    across.min(down)
}
