//! Removes interlacing. An interlaced picture holds two fields, two moments half a frame apart, on its even and odd
//! lines.
//!
//! Moving objects then have combed edges, and an edge measured across both fields belongs to neither moment. The first
//! field is kept, because the picture's time stamp belongs to it. The lines of the other field are filled in from their
//! neighbours: this halves the vertical resolution, but the picture shows a single moment. Rejected: to make each field
//! a picture, at twice the frame rate. FFmpeg's `bwdif` does this better, with the lines of three fields; users who
//! need it can apply it to the recording with one command.

use super::picture::OwnedPlane;
use crate::vision::frame::Plane;

/// Copies one field of a plane, which begins at line `first` (0 or 1), and fills the lines between with the mean of
/// their neighbours.
pub(super) fn keep_one_field(plane: Plane<'_>, first: usize, into: &mut OwnedPlane) {
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
    fn the_other_fields_lines_are_filled_from_their_neighbours() {
        let lines = [10, 200, 30, 200, 50];
        let data: Vec<u8> = lines.iter().flat_map(|code| [*code, *code, 0]).collect();
        let plane = Plane { data: &data, stride: 3, width: 2, height: 5 };
        let column_of_field = |first: usize| {
            let mut field = OwnedPlane::default();
            keep_one_field(plane, first, &mut field);
            field.data.chunks(2).map(|line| line[1]).collect::<Vec<u8>>()
        };
        assert_eq!(column_of_field(0), [10, 20, 30, 40, 50]);
        assert_eq!(column_of_field(1), [200; 5]);
    }
}
