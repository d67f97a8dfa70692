//! How a stored picture is turned and mirrored for display.
//!
//! MP4 and MOV state it as a matrix that maps stored to displayed places. Phones write one of eight: the four quarter
//! turns, mirrored or not. They are applied as FFmpeg's tools and browsers apply them. Any other matrix is refused:
//! players treat those differently, and a mirror image that is missed exchanges the left and the right hand.

use ffmpeg_next::{codec, format, frame};

use super::MediaError;
use super::picture::middle_px;

/// One in the 16.16 fixed-point numbers of a matrix.
const ONE: f64 = 65_536.0;

/// Maximum deviation of a matrix's numbers from −1, 0 and 1: writers round sines. A turn by this angle (0.06°) moves the
/// border of a picture of 1080 lines by half a pixel.
const MAX_ROUNDING: f64 = 1e-3;

/// An orientation: rows and columns are exchanged or not, then each direction is reversed or not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PictureOrientation {
    swaps_axes: bool,
    flips_x: bool,
    flips_y: bool,
}

impl PictureOrientation {
    /// As stored.
    pub(super) const UPRIGHT: Self = Self { swaps_axes: false, flips_x: false, flips_y: false };

    /// Turned by 90° clockwise.
    #[cfg(test)]
    pub(super) const RIGHT: Self = Self { swaps_axes: true, flips_x: true, flips_y: false };

    /// All eight.
    #[cfg(test)]
    pub(super) const ALL: [Self; 8] = {
        let mut all = [Self::UPRIGHT; 8];
        let mut i = 0;
        while i < 8 {
            all[i] = Self { swaps_axes: i & 1 != 0, flips_x: i & 2 != 0, flips_y: i & 4 != 0 };
            i += 1;
        }
        all
    };

    /// The orientation that the container states.
    ///
    /// # Errors
    /// [`MediaError::Orientation`] if it is none of the eight.
    pub(super) fn of_stream(stream: &format::stream::Stream<'_>) -> Result<Self, MediaError> {
        let is_matrix = |kind| kind == codec::packet::side_data::Type::DisplayMatrix;
        stream.side_data().find(|data| is_matrix(data.kind())).map_or(Ok(Self::UPRIGHT), |data| of_bytes(data.data()))
    }

    /// Checks that a decoded frame does not ask for another orientation than its container.
    ///
    /// # Errors
    /// [`MediaError::Orientation`]: browsers ignore what frames state, and other players follow it.
    pub(super) fn check_frame(self, decoded: &frame::Video) -> Result<(), MediaError> {
        let noted = decoded.side_data(frame::side_data::Type::DisplayMatrix);
        match noted.map(|data| of_bytes(data.data())).transpose()? {
            Some(noted) if noted != self => Err(refused("turned or mirrored, in a note inside its frames")),
            _ => Ok(()),
        }
    }

    /// The orientation of a matrix's upper left part, 16.16 fixed point: (x, y) is displayed at (ax + cy, bx + dy).
    fn of_parts([a, b, c, d]: [f64; 4]) -> Option<Self> {
        let is_unit = |value: f64| (value.abs() - 1.0).abs() <= MAX_ROUNDING;
        let is_zero = |value: f64| value.abs() <= MAX_ROUNDING;
        if is_unit(a) && is_unit(d) && is_zero(b) && is_zero(c) {
            return Some(Self { swaps_axes: false, flips_x: a < 0.0, flips_y: d < 0.0 });
        }
        let is_quarter_turn = is_unit(b) && is_unit(c) && is_zero(a) && is_zero(d);
        is_quarter_turn.then_some(Self { swaps_axes: true, flips_x: c < 0.0, flips_y: b < 0.0 })
    }

    /// Width and height as displayed.
    pub(super) fn displayed<T>(self, (width, height): (T, T)) -> (T, T) {
        if self.swaps_axes { (height, width) } else { (width, height) }
    }

    /// The stored place of a displayed pixel, in a picture of this stored size.
    #[inline]
    pub(super) fn stored_place(self, (x, y): (usize, usize), stored_size: (usize, usize)) -> (usize, usize) {
        let (width, height) = self.displayed(stored_size);
        let x = if self.flips_x { width - 1 - x } else { x };
        let y = if self.flips_y { height - 1 - y } else { y };
        self.displayed((x, y))
    }

    /// Position of the first chroma sample as displayed, pixels of luma; `shift` halves the planes before they are
    /// turned. The size must be whole in chroma samples, see [`Self::splits_chroma`].
    pub(super) fn displayed_chroma(self, first_px: [f32; 2], shift: (u8, u8)) -> [f32; 2] {
        let from_end = |at: f32, halvings: u8| 2.0 * middle_px(halvings) - at;
        let ((x, y), shift) = (self.displayed((first_px[0], first_px[1])), self.displayed(shift));
        [if self.flips_x { from_end(x, shift.0) } else { x }, if self.flips_y { from_end(y, shift.1) } else { y }]
    }

    /// True if a direction of odd length is reversed whose chroma is halved: pixels 0 and 1 shared a sample as stored,
    /// and as displayed pixels 1 and 2 would.
    pub(super) fn splits_chroma(self, stored_size: (u32, u32), shift: (u8, u8)) -> bool {
        let is_odd = |length: u32, halvings: u8| !length.is_multiple_of(1 << halvings);
        let (flips_columns, flips_rows) = self.displayed((self.flips_x, self.flips_y));
        flips_columns && is_odd(stored_size.0, shift.0) || flips_rows && is_odd(stored_size.1, shift.1)
    }
}

fn of_bytes(bytes: &[u8]) -> Result<PictureOrientation, MediaError> {
    let numbers = bytes.as_chunks().0.iter().map(|number| f64::from(i32::from_ne_bytes(*number)));
    match numbers.collect::<Vec<f64>>()[..] {
        [a, b, u, c, d, v, ..] if bytes.len() >= 36 => {
            let parts = [a, b, c, d].map(|number| number / ONE);
            let is_flat = u == 0.0 && v == 0.0;
            PictureOrientation::of_parts(parts).filter(|_| is_flat).ok_or_else(|| refused(&described(parts, is_flat)))
        }
        _ => Ok(PictureOrientation::UPRIGHT),
    }
}

fn refused(how: &str) -> MediaError {
    MediaError::Orientation(how.to_owned())
}

/// How a matrix that is refused changes the picture.
fn described([a, b, c, d]: [f64; 4], is_flat: bool) -> String {
    let (across, down) = (a.hypot(b), c.hypot(d));
    let area = a * d - b * c;
    if !is_flat {
        "distorted in perspective".into()
    } else if area.abs() <= MAX_ROUNDING * (across * down).max(MAX_ROUNDING) {
        "pressed into a line".into()
    } else if (a * c + b * d).abs() > MAX_ROUNDING * across * down {
        "slanted".into()
    } else if (across / down - 1.0).abs() > MAX_ROUNDING {
        "stretched in one direction".into()
    } else if (across - 1.0).abs() > MAX_ROUNDING {
        format!("scaled by the factor {across:.3}")
    } else {
        format!("turned by {:.1}°", b.atan2(a).to_degrees())
    }
}

#[cfg(test)]
mod tests;
