//! Limits of a recording.

/// Limits of one recording; a recording beyond them is refused with a reason.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MediaLimits {
    /// Maximum width of the picture, pixels.
    pub width: u32,
    /// Maximum height of the picture, pixels.
    pub height: u32,
    /// Maximum of streams in a container.
    pub streams: usize,
    /// Maximum duration, s.
    pub duration_s: f64,
    /// Maximum of frames.
    pub frames: u64,
    /// Decoder threads: cores divided by the recordings decoded at a time. With [`super::ReadAhead`] they run in
    /// addition to the caller's thread.
    pub threads: usize,
}

impl Default for MediaLimits {
    fn default() -> Self {
        Self { width: 4096, height: 2304, streams: 8, duration_s: 4.0 * 3600.0, frames: 1_000_000, threads: 2 }
    }
}
