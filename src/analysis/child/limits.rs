//! Limits of records that several kinds of work share.

use crate::media::MediaLimits;
use crate::vision::surroundings::Surroundings;
use crate::vision::trajectory::Sample;

/// Longest texts of a problem, characters: slug, title, detail.
pub(in crate::analysis) const MAX_TEXT_CHARS: [usize; 3] = [64, 200, 4000];

/// Largest preview, bytes.
const MAX_PREVIEW_BYTES: usize = 1 << 20;

/// Largest magnitude of a number in a row: 10 km in mm, and far outside any frame in pixels.
const MAX_MAGNITUDE: f64 = 1e7;

pub(super) fn is_plausible_number(x: f64) -> bool {
    x.is_finite() && x.abs() <= MAX_MAGNITUDE
}

/// True if a row of a path has plausible numbers and a covariance that errors can have.
pub(super) fn is_plausible_row(row: &Sample) -> bool {
    row.numbers().all(is_plausible_number) && row.covariance_mm2.is_none_or(|stated| stated.is_valid())
}

pub(super) fn is_size(width: u32, height: u32, limits: MediaLimits) -> bool {
    let longest = limits.width.max(limits.height);
    (1..=longest).contains(&width) && (1..=longest).contains(&height)
}

pub(super) fn is_small_jpeg(jpeg: &[u8]) -> bool {
    jpeg.len() <= MAX_PREVIEW_BYTES && jpeg.starts_with(&[0xff, 0xd8])
}

/// Keeps the size of a recording or stream; an error if it is too large, or the second one.
pub(super) fn set_size(
    slot: &mut Option<(u32, u32)>,
    (width, height): (u32, u32),
    limits: MediaLimits,
) -> Result<(), String> {
    if !is_size(width, height, limits) {
        return Err(format!("a picture of {width}×{height} pixels"));
    }
    set_once(slot, (width, height), "recording")
}

/// Keeps a picture of surroundings.
pub(super) fn accept_surroundings(slot: &mut Option<Surroundings>, picture: Surroundings) -> Result<(), String> {
    if !picture.is_possible() {
        return Err("an impossible picture of surroundings".into());
    }
    set_once(slot, picture, "picture of surroundings")
}

pub(super) fn set_once<T>(slot: &mut Option<T>, value: T, what: &str) -> Result<(), String> {
    match slot.replace(value) {
        None => Ok(()),
        Some(_) => Err(format!("a second {what}")),
    }
}
