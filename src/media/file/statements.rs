//! What a container states about a recording.

use ffmpeg_next::{ffi, format};

use super::MediaError;
use crate::domain::clock::FRAME_RATES_HZ;
use crate::time::from_rfc3339;

/// The container's statements, before a frame is decoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecordingInfo {
    /// Width in display orientation, pixels as stored.
    pub width: u32,
    /// Height in display orientation, pixels as stored.
    pub height: u32,
    /// Width and height at which players show it; they differ from those of the picture if pixels are not square.
    pub shown_size: (u32, u32),
    /// Number of frames to be shown, as listed or computed from duration and rate; for progress only.
    pub frames_expected: Option<u64>,
    /// Duration as stated, s.
    pub duration_s: Option<f64>,
    /// Frame rate as stated, Hz.
    pub rate_hz: Option<f64>,
    /// Rate at which the recorder says that it captured, Hz. In slow motion it differs from the frame rate.
    pub capture_rate_hz: Option<f64>,
    /// When the file says that it was recorded, epoch ms.
    pub created_at_ms: Option<i64>,
}

/// What is known of a recording after its last picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WholeRecording {
    /// Number of frames that the file states; `None` if it states none. Fewer pictures mean that the file is cut or
    /// damaged.
    pub frames_stated: Option<u64>,
    /// Time on the file's own clock at which the recording's time 0 lies, s: more than 0 if the picture begins later
    /// than the sound or than the file. Players count from the file's zero.
    pub starts_at_s: f64,
}

/// The picture's size, as probing found it.
pub(in crate::media) fn stated_size(stream: &format::stream::Stream<'_>) -> Result<(u32, u32), MediaError> {
    let parameters = stream.parameters();
    // SAFETY: the parameters live as long as `parameters`, and FFmpeg does not write to them after probing.
    let (width, height) = unsafe { ((*parameters.as_ptr()).width, (*parameters.as_ptr()).height) };
    match (u32::try_from(width), u32::try_from(height)) {
        (Ok(width @ 1..), Ok(height @ 1..)) => Ok((width, height)),
        _ => Err(MediaError::NoFrames),
    }
}

/// The size at which players show pictures of this stored size: one side is stretched by the pixels' shape.
pub(super) fn shown_size(stream: &format::stream::Stream<'_>, (width, height): (u32, u32)) -> (u32, u32) {
    // SAFETY: as above; without a context, the stream's own shape of pixels counts before the codec's.
    let shape = unsafe {
        ffi::av_guess_sample_aspect_ratio(std::ptr::null_mut(), stream.as_ptr().cast_mut(), std::ptr::null_mut())
    };
    let ratio = f64::from(shape.num) / f64::from(shape.den);
    let stretched = |length: u32, factor: f64| (f64::from(length) * factor).round() as u32;
    match ratio {
        ratio if !(ratio.is_finite() && ratio > 0.0) => (width, height),
        ratio if ratio > 1.0 => (stretched(width, ratio), height),
        ratio => (width, stretched(height, 1.0 / ratio)),
    }
}

/// Key of the capture rate in MP4 and MOV files of phones.
const CAPTURE_RATE: &str = "com.android.capture.fps";

pub(super) fn capture_rate_of(input: &format::context::Input) -> Option<f64> {
    let stated = input.metadata().get(CAPTURE_RATE)?.trim().parse().ok();
    stated.filter(|rate| FRAME_RATES_HZ.contains(rate))
}

/// 2000-01-01. Devices without a clock state the beginning of their epoch: 1904, 1970 or 1980.
const MIN_CREATED_AT_MS: i64 = 946_684_800_000;

pub(super) fn created_at_of(input: &format::context::Input) -> Option<i64> {
    from_rfc3339(input.metadata().get("creation_time")?.trim()).filter(|at_ms| *at_ms >= MIN_CREATED_AT_MS)
}

pub(super) fn stated_duration(ticks: i64) -> Option<f64> {
    (ticks > 0).then(|| ticks as f64 / f64::from(ffi::AV_TIME_BASE))
}

/// True if the container lists at least one frame per second of the stated duration. A placeholder, or a duration that
/// is wrong because a clock was set, is no reason to refuse a recording; its frames will show how long it is.
pub(super) fn is_plausible_duration(duration_s: f64, frames_listed: Option<u64>) -> bool {
    frames_listed.is_some_and(|frames| duration_s <= frames as f64)
}
