//! Names the corners of a board that were not seen.

use std::fmt;

use super::lattice::MissingCorner;

/// Maximum number of corners that are named, so that the sentence stays short.
const MAX_NAMED: usize = 4;

/// The corners of a board that were not seen between the others: under a highlight, a finger or dirt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HiddenCorners {
    /// Number of corners that were not seen.
    pub count: usize,
    /// Number of corners that a whole board of the size seen has.
    pub of: usize,
    /// The first of them: row and column in the picture, from 1.
    named: [(usize, usize); MAX_NAMED],
}

impl HiddenCorners {
    pub(super) fn new(missing: &[MissingCorner], of: usize) -> Self {
        let place = |index: usize| missing.get(index).map_or((0, 0), |corner| (corner.row, corner.column));
        Self { count: missing.len(), of, named: std::array::from_fn(place) }
    }

    /// Row and column of the corners that are named, as they lie in the picture, from 1 at the top left.
    pub fn named(&self) -> &[(usize, usize)] {
        &self.named[..self.count.min(MAX_NAMED)]
    }
}

impl fmt::Display for HiddenCorners {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {} inner corners hidden, blurred or overexposed: ", self.count, self.of)?;
        for (index, (row, column)) in self.named().iter().enumerate() {
            let comma = if index > 0 { ", " } else { "" };
            write!(f, "{comma}row {row} column {column}")?;
        }
        if self.count > MAX_NAMED {
            write!(f, " and {} more", self.count - MAX_NAMED)?;
        }
        write!(f, ", counted from the board's top left in the picture")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hidden(places: &[(usize, usize)], of: usize) -> HiddenCorners {
        let missing = |&(row, column): &(usize, usize)| MissingCorner { row, column, expected: None };
        HiddenCorners::new(&places.iter().map(missing).collect::<Vec<_>>(), of)
    }

    #[test]
    fn few_corners_are_all_named_and_many_are_counted_in_a_short_sentence() {
        let text = hidden(&[(2, 3), (2, 4)], 54).to_string();
        assert!(
            text.starts_with("2 of 54 inner corners") && text.contains("row 2 column 3, row 2 column 4,"),
            "{text}"
        );
        let text = hidden(&vec![(60, 60); 1799], 3600).to_string();
        assert!(text.contains("and 1795 more") && text.chars().count() <= 200, "{}: {text}", text.chars().count());
    }
}
