//! The median picture of a recording. Frames are chosen by their number, so that the same recording always gives the
//! same picture: every frame at first, then every second, fourth, …, whenever [`MAX_PICTURES`] are kept.
//!
//! **Cost:** one pass over the luma of a chosen frame (0.6 ms on 1080p); a recording of an hour has about 300 chosen
//! frames.

use super::{LONGER_SIDE, MIN_SIDE, Surroundings};
use crate::vision::frame::{Frame, Plane};

/// Pictures kept at a time: the median of 16 or more leaves a fifth of one picture's noise, and they fill 300 KB.
const MAX_PICTURES: usize = 32;

/// Collects small pictures of a recording.
#[derive(Clone, Debug)]
pub struct SurroundingsSampler {
    /// Frames from one picture to the next.
    interval: u64,
    pictures: Vec<SmallPicture>,
}

/// A frame at the resolution of [`Surroundings`].
#[derive(Clone, Debug)]
struct SmallPicture {
    columns: usize,
    rows: usize,
    luma: Vec<u8>,
}

impl Default for SurroundingsSampler {
    fn default() -> Self {
        Self { interval: 1, pictures: Vec::new() }
    }
}

impl SurroundingsSampler {
    /// Considers the next frame of a recording.
    pub fn sample_frame(&mut self, frame: &Frame<'_>) {
        if !frame.index.is_multiple_of(self.interval) {
            return;
        }
        self.add_picture(frame);
        if self.pictures.len() == MAX_PICTURES {
            self.interval *= 2;
            let mut is_kept = false;
            self.pictures.retain(|_| {
                is_kept = !is_kept;
                is_kept
            });
        }
    }

    /// Adds a picture, if it has the shape of the first and is not too narrow.
    fn add_picture(&mut self, frame: &Frame<'_>) {
        let Some((columns, rows)) = small_size(frame.width(), frame.height()) else { return };
        let is_alike = self.pictures.first().is_none_or(|first| (first.columns, first.rows) == (columns, rows));
        if is_alike {
            let luma = shrink(&frame.y, columns, rows);
            self.pictures.push(SmallPicture { columns, rows, luma });
        }
    }

    /// Number of pictures that are kept.
    #[cfg(test)]
    pub(super) fn pictures(&self) -> usize {
        self.pictures.len()
    }

    /// The median of the pictures; `None` without a picture.
    pub fn surroundings(&self) -> Option<Surroundings> {
        let first = self.pictures.first()?;
        let mut codes = vec![0; self.pictures.len()];
        let median = |cell: usize| {
            codes.iter_mut().zip(&self.pictures).for_each(|(code, picture)| *code = picture.luma[cell]);
            codes.sort_unstable();
            codes[codes.len() / 2]
        };
        let luma = (0..first.luma.len()).map(median).collect();
        Surroundings::new(first.columns as u8, first.rows as u8, luma)
    }
}

/// Columns and rows of the small picture; `None` if the frame is smaller than that, or too narrow.
pub(super) fn small_size(width: usize, height: usize) -> Option<(usize, usize)> {
    let scaled = |side: usize| (side * LONGER_SIDE + width.max(height) / 2) / width.max(height).max(1);
    let (columns, rows) = (scaled(width), scaled(height));
    (width.max(height) >= LONGER_SIDE && columns.min(rows) >= MIN_SIDE).then_some((columns, rows))
}

/// Mean luma of each cell.
pub(super) fn shrink(luma: &Plane<'_>, columns: usize, rows: usize) -> Vec<u8> {
    let first = |index: usize, of: usize, size: usize| index * size / of;
    let mut small = Vec::with_capacity(columns * rows);
    let mut sums = vec![0_u32; columns];
    for row in 0..rows {
        let lines = first(row, rows, luma.height)..first(row + 1, rows, luma.height);
        sums.fill(0);
        for line in lines.clone().map(|y| luma.row(y)) {
            for (column, sum) in sums.iter_mut().enumerate() {
                let pixels = &line[first(column, columns, luma.width)..first(column + 1, columns, luma.width)];
                *sum += pixels.iter().map(|code| u32::from(*code)).sum::<u32>();
            }
        }
        let pixels = |column: usize| {
            (lines.len() * (first(column + 1, columns, luma.width) - first(column, columns, luma.width))) as u32
        };
        small.extend(sums.iter().enumerate().map(|(column, sum)| ((sum + pixels(column) / 2) / pixels(column)) as u8));
    }
    small
}
