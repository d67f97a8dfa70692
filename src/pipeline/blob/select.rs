//! Is a region a band at all? Size and shape tests, before any border is measured.

use super::components::Component;
use super::moments::Rectangle;
use crate::pipeline::reason::Reason;

/// Narrowest band that can be measured, pixels: borders blurred over two pixels each leave nothing inside below it.
pub const NARROWEST_PX: f64 = 6.0;

/// Fewest cells worth a look: a band as narrow as possible and as long as wide, half of it seen.
pub const FEWEST_CELLS: usize = 10;

/// Least share of its rectangle that a band fills; less is a frame, a fork or scattered noise.
const LEAST_FILL: f64 = 0.6;

/// The rectangle that stands for the region, or why it is no band.
pub fn judge(component: &Component) -> Result<Rectangle, Reason> {
    let rectangle = component.moments.rectangle();
    if component.moments.cells() < FEWEST_CELLS || rectangle.width_px < NARROWEST_PX {
        return Err(Reason::TooSmall);
    }
    let fill = component.moments.area_px2() / (rectangle.length_px * rectangle.width_px);
    if fill < LEAST_FILL { Err(Reason::WrongShape) } else { Ok(rectangle) }
}
