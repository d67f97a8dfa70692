//! Opens a recording with its corrected times.

use std::fs::File;
use std::io::Seek;
use std::sync::Arc;

use crate::domain::clock::{RecordingClock, TimeCorrection};
use crate::domain::text::Invalid;
use crate::media::{MediaError, MediaLimits, VideoFile};

/// Why a recording cannot be opened with corrected times.
#[derive(Debug, thiserror::Error)]
pub enum ClockError {
    /// The recording cannot be read.
    #[error(transparent)]
    Media(#[from] MediaError),
    /// The file cannot be read from its beginning again.
    #[error("the recording cannot be read twice: {0}")]
    Rewind(#[from] std::io::Error),
    /// The correction does not fit the recording.
    #[error("{0}")]
    Correction(Invalid),
}

/// Opens a recording and sets its times: by the correction, else by the capture rate that the file states, else by its
/// stamps. A correction needs all stamps, so the packets are then read once more.
///
/// # Errors
/// [`ClockError`] if the recording cannot be read or the correction does not fit it.
pub fn open_with_clock(
    file: impl Into<Arc<File>>,
    time: Option<TimeCorrection>,
    limits: MediaLimits,
) -> Result<(VideoFile, RecordingClock), ClockError> {
    let file: Arc<File> = file.into();
    let mut video = VideoFile::open(file.clone(), limits)?;
    let info = video.info();
    let clock = match time {
        None => RecordingClock::of_file(info.rate_hz, info.capture_rate_hz),
        Some(time) => {
            let stamps = video.stamps();
            (&*file).rewind()?;
            video = VideoFile::open(file, limits)?;
            RecordingClock::corrected(time, stamps, info.capture_rate_hz).map_err(ClockError::Correction)?
        }
    };
    video.scale_times(clock.factor);
    Ok((video, clock))
}
