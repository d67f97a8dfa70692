//! Errors of decoding and tracking as problems for people.

use crate::domain::problem::Problem;
use crate::media::MediaError;
use crate::pipeline::tracker::SettingsProblem;

/// An error that says what to do.
pub(super) trait Explain {
    /// As a problem.
    fn explain(&self) -> Problem;
}

impl Explain for MediaError {
    fn explain(&self) -> Problem {
        let (slug, title) = match self {
            MediaError::Container(_) => ("not-a-video", "The file is not a video that can be read"),
            MediaError::NoVideo => ("no-video-stream", "The file holds no picture"),
            MediaError::Codec(_) => ("codec-not-accepted", "The video codec is not accepted"),
            MediaError::OverLimit { .. } => ("recording-too-large", "The recording is larger than accepted"),
            MediaError::SizeChanged { .. } => ("size-changes", "The picture changes its size"),
            MediaError::NoFrames => ("no-frames", "No frame can be decoded"),
            MediaError::Memory => ("too-much-memory", "The recording needs too much memory"),
            MediaError::PixelFormat(_) => ("pixel-format", "The pixel format cannot be used"),
            MediaError::Ffmpeg { .. } => ("cannot-decode", "The recording cannot be decoded"),
        };
        Problem::new(slug, title, self.to_string())
    }
}

impl Explain for SettingsProblem {
    fn explain(&self) -> Problem {
        let (slug, title) = match self {
            SettingsProblem::OtherSize { .. } => ("camera-size", "Camera and recording differ in size"),
            SettingsProblem::NoTool => ("no-tool", "No tool is marked"),
            SettingsProblem::NoSamples(_) => ("no-samples", "A tool has no colour samples"),
            SettingsProblem::NoBackground => ("no-background", "No background is marked"),
            SettingsProblem::TooManyLabels(..) => ("too-many-labels", "Too many colours are marked"),
            SettingsProblem::Size { .. } => ("tool-size", "A tool's size is impossible"),
        };
        Problem::new(slug, title, self.to_string())
    }
}

/// Work that came without its file.
pub(super) fn no_input() -> Problem {
    Problem::new("no-input", "The work came without a file", "send the recording again")
}
