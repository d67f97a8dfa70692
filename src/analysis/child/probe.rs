//! Decodes a recording from end to end: its size, the times of its frames, a preview.

use super::StopReason;
use super::preview::Preview;
use super::reporter::Reporter;
use crate::analysis::protocol::ChildReply;
use crate::media::VideoFile;

pub(super) fn run(mut video: VideoFile, reporter: &mut Reporter) -> Result<(), StopReason> {
    let info = video.info();
    reporter.recording(info)?;
    let mut preview = Preview::new(info.frames_expected);
    while let Some(picture) = video.next_picture()? {
        let frame = picture.frame();
        preview.consider(&frame);
        reporter.frame(frame.time_s, std::iter::empty())?;
    }
    reporter.flush_frames()?;
    Ok(reporter.send(&ChildReply::Preview(preview.into_jpeg()))?)
}
