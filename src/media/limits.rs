//! How much a recording may ask for.

/// Budgets of one recording; beyond them it is refused with a reason.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Widest picture, pixels.
    pub width: u32,
    /// Highest picture, pixels.
    pub height: u32,
    /// Most streams in a container.
    pub streams: usize,
    /// Longest recording, s.
    pub duration_s: f64,
    /// Most frames.
    pub frames: u64,
    /// Decoder threads; cores divided by recordings decoded at a time. With [`super::ReadAhead`] they work beside the caller's.
    pub threads: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { width: 4096, height: 2304, streams: 8, duration_s: 4.0 * 3600.0, frames: 1_000_000, threads: 2 }
    }
}
