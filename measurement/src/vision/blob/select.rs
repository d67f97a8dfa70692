//! Decides whether a region can be a band: tests of size and shape, before any border is measured.

use super::components::Component;
use super::moments::RegionRectangle;
use crate::vision::reason::MissReason;

/// Minimum width of a band that can be measured, pixels: with borders blurred over two pixels each, a narrower one has
/// no clear inside.
pub const MIN_WIDTH_PX: f64 = 6.0;

/// Minimum number of cells of a region: half of a band of minimum width that is as long as wide.
pub const MIN_CELLS: usize = 10;

/// Minimum share of its rectangle that a band fills; a region with less is a frame, a fork or scattered noise.
const MIN_FILL: f64 = 0.6;

/// The region's rectangle, or why it is no band.
pub fn check_shape(component: &Component) -> Result<RegionRectangle, MissReason> {
    let rectangle = component.moments.rectangle();
    if component.moments.cells() < MIN_CELLS || rectangle.width_px < MIN_WIDTH_PX {
        return Err(MissReason::TooSmall);
    }
    let fill = component.moments.area_px2() / (rectangle.length_px * rectangle.width_px);
    if fill < MIN_FILL { Err(MissReason::WrongShape) } else { Ok(rectangle) }
}
