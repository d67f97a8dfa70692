//! Turns errors of decoding and tracking into problems for users.

use super::palette::ColourMark;
use crate::analysis::calibration::{CalibrationRefusal, ViewsError};
use crate::analysis::clock::ClockError;
use crate::analysis::empty_box::EmptyBoxError;
use crate::analysis::scoring::ScoringError;
use crate::analysis::self_test::SelfTestError;
use crate::domain::problem::Problem;
use crate::domain::text::count_of;
use crate::media::{MediaError, MuxError, SourceError};
use crate::vision::camera::{BoardProblem, CalibrationProblem};
use crate::vision::segmentation::samples::MarkedRectangle;
use crate::vision::tracker::{Quality, SettingsProblem, ToolQuality};

/// An error that can be shown to users with advice.
pub trait ToProblem {
    /// The error as a problem.
    fn to_problem(&self) -> Problem;
}

impl ToProblem for MediaError {
    fn to_problem(&self) -> Problem {
        let (slug, title) = match self {
            MediaError::Container(_) | MediaError::OtherContainer { .. } => {
                ("not-a-video", "The file is not a readable video")
            }
            MediaError::PictureFile => ("picture-not-video", "The file is a picture, not a video"),
            MediaError::CutOff => ("recording-cut-off", "The recording was cut off"),
            MediaError::NoVideo => ("no-video-stream", "The file contains no video stream"),
            MediaError::Codec(_) => ("codec-not-accepted", "The video codec is not accepted"),
            MediaError::OverLimit { .. } => ("recording-too-large", "The recording is larger than accepted"),
            MediaError::SizeChanged { .. } => (Problem::SIZE_CHANGES, "The picture size changes"),
            MediaError::NoFrames => (Problem::NO_FRAMES, "No frame can be decoded"),
            MediaError::Memory => ("too-much-memory", "The recording needs too much memory"),
            MediaError::Photo(_) | MediaError::PhotoFormat(_) => ("not-a-photo", "The file is not a readable photo"),
            MediaError::PixelFormat(_) => ("pixel-format", "The pixel format cannot be used"),
            MediaError::Orientation(_) => ("picture-orientation", "The picture must be shown in an unusual way"),
            MediaError::HighDynamicRange(_) => ("high-dynamic-range", "The recording has high dynamic range"),
            MediaError::Ffmpeg { doing, .. } => return cannot_decode(doing),
        };
        Problem::new(slug, title, self.to_string())
    }
}

/// The recording stopped the decoder while it was doing this. The decoder's own words, such as "Invalid argument", would
/// help no reader.
fn cannot_decode(doing: &str) -> Problem {
    let detail = format!(
        "the file is damaged, or made in a way that cannot be read ({doing}). Play it to its end on a computer: if that \
         works, export it there as MP4 (H.264) and send that file; if not, record again"
    );
    Problem::new("cannot-decode", "The recording cannot be decoded", detail)
}

impl ToProblem for ClockError {
    fn to_problem(&self) -> Problem {
        match self {
            ClockError::Media(error) => error.to_problem(),
            ClockError::Rewind(_) => cannot_decode("reading it a second time"),
            ClockError::Correction(invalid) => {
                Problem::new("impossible-time", "The given frame rate or duration does not fit", invalid.to_string())
            }
        }
    }
}

impl ToProblem for ScoringError {
    fn to_problem(&self) -> Problem {
        if matches!(self, ScoringError::NoTrackingSummary) {
            let detail = "the program version that tracked this session did not store everything that a score depends \
                          on; request the rescoring with `from=recording`, so that it is tracked again";
            return Problem::new("path-alone", "The stored path cannot be scored again", detail);
        }
        let detail = format!(
            "a stored file that this analysis needs cannot be read ({self}): restore it from a backup, then try again"
        );
        Problem::new("input-damaged", "A file that the analysis needs is damaged", detail)
    }
}

impl ToProblem for SourceError {
    fn to_problem(&self) -> Problem {
        let detail = match self {
            SourceError::Media(error) => return error.to_problem(),
            SourceError::Open(error) => format!(
                "it is not readable as MPEG-TS or Matroska ({error}); push with ffmpeg's -f mpegts or -f matroska"
            ),
            other => other.to_string(),
        };
        Problem::new("not-a-stream", "The stream cannot be used", detail)
    }
}

impl ToProblem for MuxError {
    fn to_problem(&self) -> Problem {
        Problem::new("cannot-assemble", "The recording cannot be assembled", self.to_string())
    }
}

impl ToProblem for SettingsProblem {
    fn to_problem(&self) -> Problem {
        let (slug, title) = match self {
            SettingsProblem::OtherSize { .. } => {
                ("camera-size", "Calibration and recording have different picture sizes")
            }
            SettingsProblem::NoTool => ("no-tool", "No tool is marked"),
            SettingsProblem::CrowdedColour(..) => ("crowded-colour", "Too many tools share a colour"),
            SettingsProblem::SameSide(..) => ("same-side", "Tools of one colour come from one side"),
            SettingsProblem::NoSamples(_) => ("no-samples", "A tool has no colour samples"),
            SettingsProblem::NoBackground => ("no-background", "No background is marked"),
            SettingsProblem::TooManyLabels(..) => ("too-many-labels", "Too many colours are marked"),
            SettingsProblem::Size { .. } => ("tool-size", "A tool's size is impossible"),
        };
        Problem::new(slug, title, self.to_string())
    }
}

/// The work needs a file and none was sent.
pub(super) fn no_input() -> Problem {
    Problem::new("no-input", "No file was sent", "send the recording again")
}

impl ToProblem for BoardProblem {
    fn to_problem(&self) -> Problem {
        Problem::new("board-not-supported", "The board is not supported", self.to_string())
    }
}

impl ToProblem for ViewsError {
    fn to_problem(&self) -> Problem {
        let (slug, title) = match self {
            ViewsError::Count(_) => ("photo-count", "Too few or too many photos"),
            ViewsError::NoPhoto { .. } => ("not-a-photo", "No file is a photo that can be read"),
            ViewsError::SizesDiffer(_) => ("photo-sizes-differ", "The photos differ in size"),
            ViewsError::TurnDiffers { .. } => ("photo-turns-differ", "The photos are turned differently"),
            ViewsError::Video { source, .. } => return source.to_problem(),
        };
        Problem::new(slug, title, self.to_string())
    }
}

impl ToProblem for SelfTestError {
    fn to_problem(&self) -> Problem {
        match self {
            SelfTestError::Media(error) => error.to_problem(),
            SelfTestError::Settings(problem) => problem.to_problem(),
        }
    }
}

impl ToProblem for EmptyBoxError {
    fn to_problem(&self) -> Problem {
        let (slug, title) = match self {
            EmptyBoxError::Media(_) => ("empty-box-photo", "The picture of the empty box is not a readable photo"),
            EmptyBoxError::OtherSize { .. } => {
                ("empty-box-size", "The picture of the empty box has another size than the recording")
            }
        };
        Problem::new(slug, title, self.to_string())
    }
}

impl ToProblem for CalibrationRefusal {
    fn to_problem(&self) -> Problem {
        match self {
            CalibrationRefusal::Problem(problem) => problem.to_problem(),
            CalibrationRefusal::Unstable { .. }
            | CalibrationRefusal::PartFails { .. }
            | CalibrationRefusal::Impossible(_) => Problem::new(
                "camera-undetermined",
                "The camera cannot be calibrated from these pictures",
                self.to_string(),
            ),
        }
    }
}

impl ToProblem for CalibrationProblem {
    fn to_problem(&self) -> Problem {
        let slug = match self {
            CalibrationProblem::TooFewPhotos { .. } => "board-not-found",
            CalibrationProblem::Corners { .. } => "board-differs",
            CalibrationProblem::SamePose { .. } => "board-not-turned",
            CalibrationProblem::Undetermined { .. } | CalibrationProblem::Contradiction => "camera-undetermined",
        };
        Problem::new(slug, "The camera cannot be calibrated from these pictures", self.to_string())
    }
}

/// No tool was measured on any frame. `is_bare`: whether all tools are without tape.
pub(super) fn never_seen(quality: &Quality, is_bare: bool) -> Problem {
    if quality.light.is_empty() {
        let detail = "the picture is so dark or so bright that no colour shows; check the light of the box and the \
                      exposure of its camera, and record again";
        return Problem::new("no-usable-light", "The picture is too dark or too bright", detail);
    }
    let tool = |t: &ToolQuality| {
        let reason = t.reasons.iter().max_by_key(|(_, n)| **n).map_or("not seen", |(reason, _)| reason.name());
        format!("`{}`: {}", t.tool, reason.replace('_', " "))
    };
    let tools: Vec<String> = quality.tools.iter().map(tool).collect();
    let (frames, reasons) = (count_of(quality.frames, "frame"), tools.join(", "));
    if is_bare {
        let detail = format!(
            "no tool was found on any of {frames} ({reasons}). Look at the recording: are the shafts in the \
             picture, and do they differ from the floor of the box in brightness or colour? If so, mark the shafts \
             again on frames of this recording, check their diameters, and score it again. If not, record with a floor \
             of another colour"
        );
        return Problem::new("no-shaft-seen", "No shaft was found", detail);
    }
    let detail = format!(
        "no tool was measured on any of {frames} ({reasons}); mark the tape, or the bare shaft, again on a \
         frame of this recording, in its light"
    );
    Problem::new("no-tool-seen", "No tool was seen", detail)
}

/// A rectangle is on a frame beyond the end of the clip.
pub(super) fn mark_beyond_the_end(frame: u64, frames: u64) -> Problem {
    let detail =
        format!("a rectangle is on frame {frame}, but the clip has only {}, counted from 0", count_of(frames, "frame"));
    Problem::new("mark-beyond-the-end", "A rectangle is on a frame beyond the end", detail)
}

/// A rectangle is on a frame without a picture.
pub(super) fn mark_without_picture(frame: u64) -> Problem {
    let detail =
        format!("a rectangle is on frame {frame}, but no picture of that frame was sent; send it as frame_{frame}");
    Problem::new("mark-without-picture", "A rectangle is on a frame that was not sent", detail)
}

/// A rectangle is empty or reaches outside the frame.
pub(super) fn mark_outside(mark: &ColourMark, width: usize, height: usize) -> Problem {
    let ColourMark { frame, rectangle: MarkedRectangle { label, x, y, w, h }, .. } = mark;
    let detail = format!(
        "the rectangle `{label}` on frame {frame} spans x {x}..{}, y {y}..{}, outside the {width}×{height} frame",
        x.saturating_add(*w),
        y.saturating_add(*h)
    );
    Problem::new("mark-outside", "A rectangle is outside the picture", detail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::reason::MissReason;
    use crate::vision::tracker::LightSample;

    #[test]
    fn a_recording_without_any_tool_gets_advice_for_its_tools_and_its_light() {
        let reasons = [(MissReason::PoorFit, 20)].into();
        let tool = ToolQuality { tool: "left".into(), missing: 20, reasons, ..ToolQuality::default() };
        let mut quality = Quality { frames: 20, tools: vec![tool], ..Quality::default() };
        for is_bare in [true, false] {
            let dark = never_seen(&quality, is_bare);
            assert!(dark.slug == "no-usable-light" && dark.detail.contains("light of the box"), "{dark:?}");
        }
        quality.light = vec![LightSample { time_s: 0.0, luma_ratio: 1.0, chroma_shift: [0.0; 2] }];
        let [bare, taped] = [true, false].map(|is_bare| never_seen(&quality, is_bare));
        assert_eq!([&*bare.slug, &*taped.slug], ["no-shaft-seen", "no-tool-seen"]);
        assert!(bare.detail.contains("poor fit") && !bare.detail.contains("tape"), "{bare:?}");
        assert!(taped.detail.contains("mark the tape, or the bare shaft, again"), "{taped:?}");
    }

    #[test]
    fn a_file_that_cannot_be_used_is_known_as_such_and_what_may_pass_is_not() {
        let over = MediaError::OverLimit { what: "the duration", value: "9 h".into(), limit: "4 h".into() };
        let changed = MediaError::SizeChanged { from: (640, 480), to: (320, 240), frame: 7 };
        let of_file = [
            MediaError::Container("noise".into()),
            MediaError::OtherContainer { name: "MXF", convert: "ffmpeg" },
            MediaError::PictureFile,
            MediaError::CutOff,
            MediaError::NoVideo,
            MediaError::Codec("prores".into()),
            over,
            changed,
            MediaError::NoFrames,
            MediaError::PixelFormat("gbrp".into()),
            MediaError::HighDynamicRange("PQ"),
        ];
        for error in of_file {
            assert!(error.to_problem().is_of_file(), "{error}");
        }
        for error in [MediaError::Memory, MediaError::Photo("cut".into())] {
            assert!(!error.to_problem().is_of_file(), "{error}");
        }
    }
}
