//! Problems: why something failed, in words for people: what happened, where, and what to do.

use serde::{Deserialize, Serialize};

/// A problem that is stored with a job and shown to people. HTTP sends it as `application/problem+json`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Problem {
    /// Stable short name, `a–z 0–9 -`: the last part of the problem's `type`, such as `not-a-video`.
    pub slug: String,
    /// One line, the same for every problem of this slug.
    pub title: String,
    /// This problem: what happened, with the figures, and what to do about it.
    pub detail: String,
}

impl Problem {
    /// No frame of a recording can be decoded.
    pub const NO_FRAMES: &'static str = "no-frames";
    /// The picture changes its size.
    pub const SIZE_CHANGES: &'static str = "size-changes";

    /// Problems of a recording's file itself: whenever it is read again, it gives the same problem.
    const OF_FILE: [&'static str; 10] = [
        "not-a-video",
        "picture-not-video",
        "recording-cut-off",
        "no-video-stream",
        "codec-not-accepted",
        "recording-too-large",
        Self::SIZE_CHANGES,
        Self::NO_FRAMES,
        "pixel-format",
        "high-dynamic-range",
    ];

    /// True if the recording's file itself cannot be used, so that to score it again gives the same problem.
    pub fn is_of_file(&self) -> bool {
        Self::OF_FILE.contains(&self.slug.as_str())
    }

    /// A problem of this kind.
    pub fn new(slug: &str, title: &str, detail: impl Into<String>) -> Self {
        Self { slug: slug.to_owned(), title: title.to_owned(), detail: detail.into() }
    }
}
