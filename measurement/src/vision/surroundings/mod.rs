//! The still surroundings of a recording, and whether two recordings show the same ones: mat, board, walls and props of
//! a box, without the tools.
//!
//! **In:** frames of a recording ([`SurroundingsSampler`]), or the pictures on which an instructor marked the tapes.
//! **Out:** [`Surroundings`], a small grey picture, and the [`Resemblance`] of two of them. **Method:** the median of
//! each cell over frames that are spread over the recording, so that a tool disappears from every cell that it covers
//! for less than half of the time. Two pictures are compared by their local contrast ([`contrast`]), which exposure and
//! white balance leave alone. A search over shift, turn and scale ([`alignment`]) allows for a camera that was nudged,
//! a wider one for a camera that was moved. The same search on mirrored pictures says what it finds by chance.
//! **Assumes** a camera that stands still during the recording, which [`watch`] checks. **Gives up** (`None`) on
//! pictures of different shape; a picture without structure gives a resemblance of few fields, which the caller must
//! not read as a difference.
//!
//! | file | what |
//! |---|---|
//! | [`sampler`] | the median picture of a recording |
//! | [`contrast`] | local contrast |
//! | [`alignment`] | the search for the change of the camera |
//! | [`resemblance`] | correlation, chance level and fields with structure |
//! | [`watch`] | whether the camera moves during the recording |

pub mod alignment;
mod contrast;
pub mod resemblance;
pub mod sampler;
pub mod watch;

pub use alignment::Alignment;
pub use resemblance::Resemblance;
pub use sampler::SurroundingsSampler;
pub use watch::{ViewShift, ViewWatch};

use serde::{Deserialize, Serialize};

/// Cells along the longer side of the picture. A cell of a 1280-pixel picture is ten pixels wide: holes of a pegboard
/// and grain of wood still show, noise and compression are averaged away, and the picture fills 9 KB. Faces or writing
/// cannot be read in it.
const LONGER_SIDE: usize = 128;

/// Cells along the shorter side, at least. A narrower strip has too few cells to align.
const MIN_SIDE: usize = 24;

/// A small grey picture of what does not move.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Surroundings {
    columns: u8,
    rows: u8,
    luma: Vec<u8>,
}

impl Surroundings {
    /// From luma codes, row by row. `None` if the numbers are not those of such a picture.
    pub fn new(columns: u8, rows: u8, luma: Vec<u8>) -> Option<Self> {
        let sides = [columns, rows].map(usize::from);
        let is_possible = sides.iter().all(|side| (MIN_SIDE..=LONGER_SIDE).contains(side));
        (is_possible && luma.len() == sides[0] * sides[1]).then_some(Self { columns, rows, luma })
    }

    /// True if [`Surroundings::new`] makes such a picture. One that another process sent may be forged.
    pub fn is_possible(&self) -> bool {
        Self::new(self.columns, self.rows, self.luma.clone()).is_some()
    }

    /// For storing: columns, rows, then the luma codes.
    pub fn to_bytes(&self) -> Vec<u8> {
        [self.columns, self.rows].into_iter().chain(self.luma.iter().copied()).collect()
    }

    /// From the stored form.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let [columns, rows, luma @ ..] = bytes else { return None };
        Self::new(*columns, *rows, luma.to_vec())
    }

    /// Cells in a row, and rows.
    fn shape(&self) -> (usize, usize) {
        (self.columns.into(), self.rows.into())
    }

    fn codes(&self) -> Vec<f32> {
        self.luma.iter().map(|code| f32::from(*code)).collect()
    }
}

/// The resemblance of a recording's surroundings with the picture that resembles them most, if the camera was nudged at
/// most. `None` without a picture of the same shape.
pub fn best_resemblance(own: &[Surroundings], now: &Surroundings) -> Option<Resemblance> {
    best_of(own.iter().filter_map(|picture| picture.compare(now)))
}

/// The same for a camera that was moved. Takes longer.
pub fn best_resemblance_moved(own: &[Surroundings], now: &Surroundings) -> Option<Resemblance> {
    best_of(own.iter().filter_map(|picture| picture.compare_moved(now)))
}

fn best_of(found: impl Iterator<Item = Resemblance>) -> Option<Resemblance> {
    let mut best: Option<Resemblance> = None;
    for found in found {
        if best.is_none_or(|best| found.correlation > best.correlation) {
            best = Some(found);
        }
        if found.chance.is_none() {
            break; // no doubt is left
        }
    }
    best
}

#[cfg(test)]
mod tests;
