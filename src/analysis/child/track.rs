//! Tracks one recording: every frame passes the [`Tracker`], then the paths are smoothed. Decoding runs ahead on a
//! second thread; everything else stays on this one.

use super::preview::Preview;
use super::reporter::Reporter;
use super::{StopReason, explain};
use crate::analysis::protocol::{ChildReply, KindShape, PathRow, QualityShape, SeenRow, TrackWork};
use crate::heap;
use crate::media::{MediaError, Picture, ReadAhead, VideoFile};
use crate::vision::frame::Frame;
use crate::vision::tracker::{MAX_WARM_UP_FRAMES, Quality, Tracker, TrackerSettings, Tracking};
use crate::vision::trajectory::PathKind;

/// Rows of a path per record.
const ROWS_PER_RECORD: usize = 1024;

pub(super) fn run(work: TrackWork, video: VideoFile, reporter: &mut Reporter) -> Result<(), StopReason> {
    let info = video.info();
    reporter.recording(info)?;
    let mut pictures = ReadAhead::new(video)?;
    let first: Vec<Frame<'_>> = pictures.first_pictures(MAX_WARM_UP_FRAMES)?.iter().map(Picture::frame).collect();
    let encoding = first.first().ok_or(MediaError::NoFrames)?.encoding;
    let mut tracker = Tracker::new(settings(work)?, info.width, info.height, encoding)?;
    tracker.warm_up(&first);
    let mut preview = Preview::new(info.frames_expected);
    let mut frames_interlaced = 0;
    while let Some(seen) = pictures.next_picture()? {
        let frame = seen.frame();
        frames_interlaced += u64::from(seen.is_interlaced());
        preview.consider(&frame);
        let report = tracker.observe(&frame);
        reporter.frame(frame.time_s, report.tools.iter().map(|tool| SeenRow::new(frame.index, tool)))?;
    }
    reporter.flush_frames()?;
    drop(pictures);
    let tracking = tracker.finish();
    heap::release_free_memory(); // the paths need the memory now
    send_results(&tracking, frames_interlaced, reporter)?;
    Ok(reporter.send(&ChildReply::Preview(preview.into_jpeg()))?)
}

pub(super) fn settings(work: TrackWork) -> Result<TrackerSettings, StopReason> {
    let samples = work.palette.colour_samples().ok_or_else(|| StopReason::Impossible(explain::unreadable_palette()))?;
    let tools = work.tools.into_iter().map(Into::into).collect();
    let mut settings = TrackerSettings::new(work.camera.into(), tools, samples);
    settings.view = work.view.map(Into::into);
    Ok(settings)
}

fn send_results(tracking: &Tracking, frames_interlaced: u64, reporter: &mut Reporter) -> Result<(), StopReason> {
    if was_never_seen(&tracking.quality) {
        return Err(StopReason::Impossible(explain::never_seen(&tracking.quality)));
    }
    let kinds = [
        (PathKind::Raw, KindShape::Raw),
        (PathKind::Filtered, KindShape::Filtered),
        (PathKind::Smoothed, KindShape::Smoothed),
    ];
    for (kind, shape) in kinds {
        for rows in tracking.trajectory(kind).samples.chunks(ROWS_PER_RECORD) {
            reporter.send(&ChildReply::Path { kind: shape, rows: rows.iter().map(PathRow::from).collect() })?;
        }
    }
    Ok(reporter.send(&ChildReply::Quality(QualityShape::new(&tracking.quality, frames_interlaced)))?)
}

fn was_never_seen(quality: &Quality) -> bool {
    quality.tools.iter().all(|tool| tool.observed == 0)
}
