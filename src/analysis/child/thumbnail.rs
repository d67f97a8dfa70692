//! Decodes the first frames of a recording: a picture of it, and whether it can be decoded at all.
//!
//! The picture is that of the last of these frames, since many recordings begin dark. A recording whose later frames
//! are damaged is found when it is tracked.

use serde::{Deserialize, Serialize};

use super::limits::{is_plausible_number, is_size, is_small_jpeg, set_once};
use super::preview::Preview;
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord};
use crate::media::{MediaError, MediaLimits};

/// Frames that are decoded: about two seconds, which take less than a second of computing.
const FRAMES: u64 = 50;

/// Latest time that a file may state, epoch ms: the year 2100.
const MAX_CREATED_MS: i64 = 4_102_444_800_000;

/// Needs nothing besides the recording.
#[derive(Debug, Serialize, Deserialize)]
pub struct ThumbnailWork;

/// What the beginning of a recording shows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Thumbnail {
    /// Width as displayed, pixels.
    pub width: u32,
    /// Height as displayed, pixels.
    pub height: u32,
    /// Duration as the file states it, s.
    pub duration_s: Option<f64>,
    /// When the file says that it was recorded, epoch ms.
    pub created_at_ms: Option<i64>,
    /// A small JPEG; empty if none could be encoded.
    pub jpeg: Vec<u8>,
}

impl ChildTask for ThumbnailWork {
    type Record = Thumbnail;
    type Output = Option<Thumbnail>;

    fn run(self, inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let mut video = inputs.video()?;
        let info = video.info();
        let (mut preview, mut frames) = (Preview::new(Some(2 * (FRAMES - 1))), 0);
        while frames < FRAMES
            && let Some(picture) = video.next_picture()?
        {
            preview.consider(&picture.frame());
            frames += 1;
        }
        if frames == 0 {
            return Err(MediaError::NoFrames.into());
        }
        Ok(reporter.record(WorkRecord::Thumbnail(Thumbnail {
            width: info.width,
            height: info.height,
            duration_s: info.duration_s,
            created_at_ms: info.created_at_ms,
            jpeg: preview.into_jpeg(),
        }))?)
    }

    fn accept(
        &self,
        record: Thumbnail,
        output: &mut Option<Thumbnail>,
        limits: MediaLimits,
    ) -> Result<ChildEvent, String> {
        if !is_possible(&record, limits) {
            return Err("an impossible picture of a recording".into());
        }
        set_once(output, record, "picture of the recording")?;
        Ok(ChildEvent::Nothing)
    }
}

fn is_possible(Thumbnail { width, height, duration_s, created_at_ms, jpeg }: &Thumbnail, limits: MediaLimits) -> bool {
    is_size(*width, *height, limits)
        && duration_s.is_none_or(|length| is_plausible_number(length) && length >= 0.0)
        && created_at_ms.is_none_or(|at_ms| (0..=MAX_CREATED_MS).contains(&at_ms))
        && (jpeg.is_empty() || is_small_jpeg(jpeg))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::ChildWork;
    use crate::analysis::output_validator::validate_records;

    fn honest() -> Thumbnail {
        let jpeg = vec![0xff, 0xd8, 0xff];
        Thumbnail { width: 640, height: 480, duration_s: Some(4.0), created_at_ms: Some(1_700_000_000_000), jpeg }
    }

    #[test]
    fn a_picture_is_accepted_once_and_only_if_a_recording_can_look_so() {
        let work = ChildWork::Thumbnail(ThumbnailWork);
        let say = |record: Thumbnail| validate_records(&work, vec![WorkRecord::Thumbnail(record)]);
        assert_eq!(say(honest()).unwrap().thumbnail, Some(honest()));
        type Spoil = fn(&mut Thumbnail);
        let spoils: [Spoil; 6] = [
            |record| record.width = 0,
            |record| record.height = 100_000,
            |record| record.duration_s = Some(f64::NAN),
            |record| record.duration_s = Some(-1.0),
            |record| record.created_at_ms = Some(-1),
            |record| record.jpeg = b"<html>".to_vec(),
        ];
        for (index, spoil) in spoils.into_iter().enumerate() {
            let mut record = honest();
            spoil(&mut record);
            assert!(say(record).is_err(), "spoil {index}");
        }
        let twice = vec![WorkRecord::Thumbnail(honest()), WorkRecord::Thumbnail(honest())];
        assert!(validate_records(&work, twice).is_err());
    }
}
