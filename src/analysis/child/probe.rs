//! Decodes a recording from end to end: its size, the times of its frames, a preview. Only tests request it.

use serde::{Deserialize, Serialize};

use super::preview::Preview;
use super::recording::{FrameReporter, RecordingOutput, RecordingRecord};
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::media::MediaLimits;

/// Needs nothing besides the recording.
#[derive(Debug, Serialize, Deserialize)]
pub struct ProbeWork;

impl ChildTask for ProbeWork {
    type Record = RecordingRecord;
    type Output = RecordingOutput;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let mut video = inputs.video()?;
        let info = video.info();
        let mut frames = FrameReporter::start(info, WorkRecord::Probe, reporter)?;
        let mut preview = Preview::new(info.frames_expected);
        while let Some(picture) = video.next_picture()? {
            let frame = picture.frame();
            preview.consider(&frame);
            frames.frame(frame.time_s, std::iter::empty(), reporter)?;
        }
        frames.end(video.whole(), reporter)?;
        Ok(frames.preview(preview.into_jpeg(), reporter)?)
    }

    fn accept(
        &self,
        record: RecordingRecord,
        output: &mut RecordingOutput,
        limits: MediaLimits,
    ) -> Result<ChildEvent, String> {
        output.accept(record, 0, limits)
    }
}
