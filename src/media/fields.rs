//! Interlaced pictures: two moments in one picture, the odd lines a half frame after the even ones or the other way round.
//!
//! Whatever moves has combed edges then, and an edge that is measured across both moments is neither's. The first field is
//! kept, for the picture's time stamp is its own, and the other's lines are filled in from their neighbours: half the
//! resolution downwards, but of one moment. Rejected: both fields as pictures of their own, twice as many a second, as
//! FFmpeg's `bwdif` does better with the lines of three fields; whoever needs that has it with one command.

use super::picture::OwnedPlane;
use crate::pipeline::frame::Plane;

/// Fills a plane with another's field that begins at this line, 0 or 1, and the mean of its lines between them.
pub(super) fn one_field(plane: Plane<'_>, first: usize, into: &mut OwnedPlane) {
    let (width, height) = (plane.width, plane.height);
    let is_kept = |row: usize| row % 2 == first;
    let line = |row: usize| &plane.data[row * plane.stride..row * plane.stride + width];
    (into.width, into.height) = (width, height);
    let data = &mut into.data;
    data.clear();
    data.reserve(width * height);
    for row in 0..height {
        let above = row.checked_sub(1);
        let below = Some(row + 1).filter(|below| *below < height);
        match (above, below) {
            _ if is_kept(row) => data.extend_from_slice(line(row)),
            (Some(above), Some(below)) => data.extend(line(above).iter().zip(line(below)).map(|(a, b)| a.midpoint(*b))),
            (above, below) => data.extend_from_slice(line(above.or(below).unwrap_or(row))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_other_field_s_lines_are_made_of_their_neighbours() {
        let lines = [10, 200, 30, 200, 50];
        let data: Vec<u8> = lines.iter().flat_map(|code| [*code, *code, 0]).collect();
        let plane = Plane { data: &data, stride: 3, width: 2, height: 5 };
        let column_of_field = |first: usize| {
            let mut field = OwnedPlane::default();
            one_field(plane, first, &mut field);
            field.data.chunks(2).map(|line| line[1]).collect::<Vec<u8>>()
        };
        assert_eq!(column_of_field(0), [10, 20, 30, 40, 50]);
        assert_eq!(column_of_field(1), [200; 5]);
    }
}
