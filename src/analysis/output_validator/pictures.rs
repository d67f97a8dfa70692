//! Validates photo checks and masks: could an honest child have sent them?

use super::{MAX_TEXT_CHARS, is_plausible_number};
use crate::analysis::protocol::BoardShape;
use crate::domain::palette::FrameMask;
use crate::domain::photo_check::{PhotoCheck, PhotoHint};
use crate::media::MediaLimits;
use crate::vision::camera::Coverage;

/// True if a found board has all its corners, a board that was not found has no more than a search returns, and all
/// corners are within plausible pixel coordinates.
pub(super) fn is_possible_check(check: &PhotoCheck, board: BoardShape, limits: MediaLimits) -> bool {
    let PhotoCheck { width, height, found, corners, reason, hints, cut_off, near, coverage } = check;
    let counted = coverage.corners.iter().map(|&count| u64::from(count)).sum::<u64>();
    let is_word = |text: &String| text.chars().count() <= MAX_TEXT_CHARS[1] && !text.chars().any(char::is_control);
    let whole = u64::from(board.columns) * u64::from(board.rows);
    let most = if *found { whole } else { PhotoCheck::MAX_CORNERS as u64 };
    is_size(*width, *height, limits)
        && corners.len() as u64 <= most
        && (!found || corners.len() as u64 == whole)
        && corners.iter().flatten().all(|&at| is_plausible_number(at))
        && *found == reason.is_none()
        && reason.iter().all(is_word)
        && (!found || hints.is_empty())
        && hints.len() <= PhotoHint::ALL.len()
        && cut_off.len() <= 4
        && (*found || near.is_none())
        && [coverage.columns, coverage.rows] == [Coverage::COLUMNS as u32, Coverage::ROWS as u32]
        && coverage.corners.len() == Coverage::COLUMNS * Coverage::ROWS
        && counted <= if *found { whole } else { 0 }
}

/// True if the cells fill a picture of this frame and name no more colours than there are.
pub(super) fn is_possible_mask(mask: &FrameMask, frame: u64, colours: usize, limits: MediaLimits) -> bool {
    let FrameMask { width, height, cell_px, columns, rows, runs, .. } = mask;
    let fills = |cells: u32, size: u32| *cell_px > 0 && cells == size.div_ceil(*cell_px);
    let cells: u64 = runs.iter().map(|[_, cells]| u64::from(*cells)).sum();
    mask.frame == frame
        && is_size(*width, *height, limits)
        && fills(*columns, *width)
        && fills(*rows, *height)
        && cells == u64::from(*columns) * u64::from(*rows)
        && runs.iter().all(|[class, cells]| *class as usize <= colours && *cells > 0)
        && runs.windows(2).all(|pair| pair[0][0] != pair[1][0])
}

fn is_size(width: u32, height: u32, limits: MediaLimits) -> bool {
    let longest = limits.width.max(limits.height);
    (1..=longest).contains(&width) && (1..=longest).contains(&height)
}
