//! How much two pictures of surroundings resemble each other: the correlation of their local contrast after the best
//! alignment, the correlation that the same search finds by chance, and how much of the picture has structure at all.
//!
//! A correlation of r means that the other picture explains a share of r² of the contrast. Two pictures of one box
//! share their mat, board and walls; tools, moved props and glare are what is left. Pictures of two boxes share
//! nothing, and the search finds what so many alignments offer by chance: as much as in a mirrored picture of the box,
//! which has the same structures in an order that no camera shows. On a symmetric board the mirrored picture fits
//! nearly as well as the true one, so that a good correlation there proves little.

use super::Surroundings;
use super::alignment::{self, Alignment, MOVED_SHIFT, NUDGE_SHIFT};
use super::contrast::{ContrastPicture, deviations};

/// Side of a field, cells.
const FIELD: usize = 8;

/// Luma that varies less within a field is no structure, codes of 255 (standard deviation from the local mean). Noise
/// of 5 codes per pixel and compression leave less than 1 in a cell.
const MIN_STRUCTURE_CODES: f32 = 3.0;

/// A field is not counted if the other picture shows a smaller share of it.
const MIN_SHOWN: f32 = 0.75;

/// From this correlation on, the place where the camera was is right and nothing is searched: mirrored pictures of 60
/// rendered boxes reached 0.58 at most, the other pictures of the same box 0.6 to 1.
const CERTAIN_CORRELATION: f32 = 0.6;

/// Mirrored left to right, top to bottom, and both.
const MIRRORS: [[bool; 2]; 3] = [[true, false], [false, true], [true, true]];

/// The resemblance of two pictures of surroundings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resemblance {
    /// Correlation after the best alignment, −1 to 1.
    pub correlation: f64,
    /// The highest correlation of a mirrored picture; `None` where the correlation leaves no doubt.
    pub chance: Option<f64>,
    /// Share of the fields where at least one of the pictures has structure.
    pub structured: f64,
    /// Shift of the picture's centre, share of its longer side.
    pub shift: f64,
    /// The change of the camera from the first picture to the second.
    pub alignment: Alignment,
}

impl Surroundings {
    /// Compares the surroundings of a recording with these, if the camera was nudged at most. `None` if the pictures
    /// have different shapes.
    pub fn compare(&self, now: &Surroundings) -> Option<Resemblance> {
        self.compare_within(now, NUDGE_SHIFT)
    }

    /// Compares the surroundings of a recording whose camera was moved. Takes longer.
    pub fn compare_moved(&self, now: &Surroundings) -> Option<Resemblance> {
        self.compare_within(now, MOVED_SHIFT)
    }

    fn compare_within(&self, now: &Surroundings, max_shift: f32) -> Option<Resemblance> {
        if self.shape() != now.shape() {
            return None;
        }
        let [own, shown] = [self, now].map(Surroundings::contrast);
        let mut best = alignment::refine(&own, &shown, Alignment::default(), max_shift);
        let mut chance = None;
        if best.0 < CERTAIN_CORRELATION {
            best = alignment::align(&own, &shown, max_shift);
            let mirrored = |mirror: &[bool; 2]| alignment::align(&own.mirrored(*mirror), &shown, max_shift).0;
            let by_chance = MIRRORS.iter().map(mirrored);
            chance = Some(by_chance.fold(0.0, f32::max).into());
        }
        let (correlation, alignment) = best;
        let (columns, rows) = self.shape();
        let [right, down] = alignment.shift_cells;
        Some(Resemblance {
            correlation: correlation.into(),
            chance,
            structured: structured_share(&self.deviations().aligned(&alignment), &now.deviations()),
            shift: f64::from(right.hypot(down)) / columns.max(rows) as f64,
            alignment,
        })
    }

    fn contrast(&self) -> ContrastPicture {
        let (columns, rows) = self.shape();
        ContrastPicture::of(columns, rows, &self.codes())
    }

    /// Luma relative to the local mean, codes.
    fn deviations(&self) -> ContrastPicture {
        let (columns, rows) = self.shape();
        deviations(columns, rows, &self.codes())
    }
}

/// Among the fields that both pictures show, the share where at least one has structure.
fn structured_share(own: &ContrastPicture, now: &ContrastPicture) -> f64 {
    let (mut shown, mut structured) = (0_usize, 0_usize);
    for top in (0..=own.rows.saturating_sub(FIELD)).step_by(FIELD) {
        for left in (0..=own.columns.saturating_sub(FIELD)).step_by(FIELD) {
            let Some(before) = spread(own, left, top) else { continue };
            let after = spread(now, left, top).unwrap_or(0.0);
            shown += 1;
            structured += usize::from(before.max(after) >= MIN_STRUCTURE_CODES);
        }
    }
    structured as f64 / shown.max(1) as f64
}

/// Root mean square of a field's values; `None` if too few are known.
fn spread(picture: &ContrastPicture, left: usize, top: usize) -> Option<f32> {
    let rows = (top..top + FIELD).map(|y| &picture.values[y * picture.columns + left..][..FIELD]);
    let (mut known, mut squares) = (0.0_f32, 0.0);
    for value in rows.flatten().filter(|value| !value.is_nan()) {
        known += 1.0;
        squares += value * value;
    }
    (known >= MIN_SHOWN * (FIELD * FIELD) as f32).then(|| (squares / known).sqrt())
}
