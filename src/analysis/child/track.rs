//! Tracks one recording: every frame passes the [`Tracker`], then the paths are smoothed. Decoding runs ahead on a
//! second thread; everything else stays on this one.

use super::preview::Preview;
use super::reporter::Reporter;
use super::{Halt, explain};
use crate::analysis::protocol::{Answer, KindShape, PathRow, QualityShape, SeenRow, TrackWork};
use crate::heap;
use crate::media::{MediaError, Picture, ReadAhead, VideoFile};
use crate::pipeline::frame::Frame;
use crate::pipeline::tracker::{MOST_REHEARSED, Quality, Tracker, TrackerSettings, Tracking};
use crate::pipeline::trajectory::Kind;

/// Rows of a path per record.
const ROWS_AT_A_TIME: usize = 1024;

pub(super) fn run(work: TrackWork, video: VideoFile, reporter: &mut Reporter) -> Result<(), Halt> {
    let info = video.info();
    reporter.recording(info)?;
    let mut pictures = ReadAhead::new(video)?;
    let first: Vec<Frame<'_>> = pictures.first_pictures(MOST_REHEARSED)?.iter().map(Picture::frame).collect();
    let encoding = first.first().ok_or(MediaError::NoFrames)?.encoding;
    let mut tracker = Tracker::new(settings(work)?, info.width, info.height, encoding)?;
    tracker.rehearse(&first);
    let mut preview = Preview::new(info.frames_expected);
    let mut frames_interlaced = 0;
    while let Some(seen) = pictures.next_picture()? {
        let frame = seen.frame();
        frames_interlaced += u64::from(seen.is_interlaced());
        preview.consider(&frame);
        let report = tracker.observe(&frame);
        reporter.frame(frame.time_s, report.tools.iter().map(|tool| SeenRow::new(frame.index, tool)))?;
    }
    reporter.frames_end()?;
    drop(pictures);
    let tracking = tracker.finish();
    heap::give_back(); // the paths need the memory now
    tell(&tracking, frames_interlaced, reporter)?;
    Ok(reporter.say(&Answer::Preview(preview.into_jpeg()))?)
}

pub(super) fn settings(work: TrackWork) -> Result<TrackerSettings, Halt> {
    let samples = work.palette.colour_samples().ok_or_else(|| Halt::Explained(explain::unreadable_palette()))?;
    let tools = work.tools.into_iter().map(Into::into).collect();
    let mut settings = TrackerSettings::new(work.camera.into(), tools, samples);
    settings.view = work.view.map(Into::into);
    Ok(settings)
}

fn tell(tracking: &Tracking, frames_interlaced: u64, reporter: &mut Reporter) -> Result<(), Halt> {
    if was_never_seen(&tracking.quality) {
        return Err(Halt::Explained(explain::never_seen(&tracking.quality)));
    }
    let kinds =
        [(Kind::Raw, KindShape::Raw), (Kind::Filtered, KindShape::Filtered), (Kind::Smoothed, KindShape::Smoothed)];
    for (kind, shape) in kinds {
        for rows in tracking.trajectory(kind).samples.chunks(ROWS_AT_A_TIME) {
            reporter.say(&Answer::Path { kind: shape, rows: rows.iter().map(PathRow::from).collect() })?;
        }
    }
    Ok(reporter.say(&Answer::Quality(QualityShape::new(&tracking.quality, frames_interlaced)))?)
}

fn was_never_seen(quality: &Quality) -> bool {
    quality.tools.iter().all(|tool| tool.observed == 0)
}
