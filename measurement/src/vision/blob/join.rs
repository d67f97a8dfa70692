//! Joins parts of one band that a crease, glare or the other tool has split, if they lie on one line.

use super::components::Component;
use super::moments::RegionRectangle;

/// Joins to the first (largest) component every other that continues it: on its axis within half a width, no wider
/// than it, and no farther away than its own length. Returns the band, and the parts that belong elsewhere.
pub fn join_collinear(mut parts: Vec<Component>) -> (Option<Component>, Vec<Component>) {
    if parts.is_empty() {
        return (None, parts);
    }
    let mut band = parts.remove(0);
    let mut elsewhere = Vec::new();
    for part in parts {
        if continues(&band.moments.rectangle(), &part.moments.rectangle()) {
            band.moments = band.moments.joined(&part.moments);
            band.bounds.include(part.bounds.left, part.bounds.top);
            band.bounds.include(part.bounds.right - 1, part.bounds.bottom - 1);
        } else {
            elsewhere.push(part);
        }
    }
    (Some(band), elsewhere)
}

fn continues(band: &RegionRectangle, part: &RegionRectangle) -> bool {
    let gap = part.centre - band.centre;
    // The axis of a short stump is unreliable; then the line through both centres must fit both.
    let axis = if band.length_px > 1.5 * band.width_px { band.axis } else { gap.normalize() };
    let across = (gap.x * axis.y - gap.y * axis.x).abs();
    let along = gap.dot(&axis).abs();
    let part_extent = part.length_px.min(part.width_px);
    across < 0.5 * band.width_px
        && along - 0.5 * (band.length_px + part.length_px) < band.length_px
        && part_extent < 1.5 * band.width_px
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::blob::moments::Moments;
    use crate::vision::segmentation::region_of_interest::CellBox;

    fn block(columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> Component {
        let mut moments = Moments::default();
        for row in rows.clone() {
            for column in columns.clone() {
                moments.add_cell(column, row);
            }
        }
        let bounds = CellBox { left: columns.start, top: rows.start, right: columns.end, bottom: rows.end };
        Component { moments, bounds }
    }

    #[test]
    fn a_split_band_is_one_and_a_stray_patch_is_not_its_part() {
        let (band, elsewhere) =
            join_collinear(vec![block(10..40, 20..30), block(48..60, 20..30), block(20..30, 60..70)]);
        assert_eq!(band.unwrap().moments.cells(), 300 + 120);
        assert_eq!(band.unwrap().bounds, CellBox { left: 10, top: 20, right: 60, bottom: 30 });
        assert_eq!(elsewhere.len(), 1);
    }
}
