//! `trocar track --segmenter`: follows bare shafts by a reference method. Its path is for comparison only, so there is
//! no quality verdict on it.

use super::progress::TrackProgress;
use super::stages::{StageClock, TrackStage};
use super::{ClipMarks, CommandFailure, TrackArgs, about, open_with_time, report_times, tools, write_path};
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::files::camera::CameraFile;
use crate::media::{MediaError, Picture, ReadAhead};
use crate::vision::reference::{ReferenceMethod, ReferenceTool, ReferenceTracker};
use crate::vision::tracker::{HandSide, ToolSpec};
use crate::vision::trajectory::Trajectory;

/// A reference method for bare shafts.
#[derive(Clone, Copy, clap::ValueEnum)]
pub(super) enum ReferenceSegmenter {
    /// Framework 1 of the thesis: what moves and is dark, then the width.
    Mixture,
    /// Zhou & Payandeh: what is dark in the red channel, then the planes through the borders.
    Zhou,
}

impl From<ReferenceSegmenter> for ReferenceMethod {
    fn from(segmenter: ReferenceSegmenter) -> Self {
        match segmenter {
            ReferenceSegmenter::Mixture => Self::MotionAndDarkness,
            ReferenceSegmenter::Zhou => Self::EdgePlanes,
        }
    }
}

/// Tracks the recording by a reference method, and writes the path.
pub(super) fn run(
    args: &TrackArgs,
    segmenter: ReferenceSegmenter,
    camera: &CameraFile,
    marked: &AnnotationsFile,
    marks: &ClipMarks<'_>,
    mut clock: StageClock,
) -> Result<(), CommandFailure> {
    let in_video = |error: MediaError| about(&args.video, error);
    let shafts = shafts(args, marked)?;
    let samples = marks.collect(&mut clock)?;
    clock.add_lap(TrackStage::Samples);
    let (video, time) = open_with_time(args)?;
    let info = video.info();
    clock.add_lap(TrackStage::Opening);
    let size = (info.width, info.height);
    let tracker = ReferenceTracker::new(segmenter.into(), camera.camera(), &shafts, &samples, size);
    let mut tracker = tracker.map_err(|problem| about(&args.annotations, problem))?;
    clock.add_lap(TrackStage::Preparing);
    let progress = TrackProgress::new(info.frames_expected, args.quiet);
    let mut ahead = ReadAhead::new(video).map_err(in_video)?;
    if ahead.first_pictures(1).map_err(in_video)?.is_empty() {
        return Err(in_video(MediaError::NoFrames));
    }
    while let Some(picture) = ahead.next_picture().map_err(in_video)?.map(Picture::frame) {
        clock.add_lap(TrackStage::Waiting);
        tracker.observe(&picture);
        clock.add_lap(TrackStage::Tracking);
        progress.step();
    }
    progress.end();
    let path = tracker.finish();
    write_path(args, &path, clock)?;
    if !args.quiet {
        report_times(time, &path.frame_times_s);
        report(&path);
    }
    Ok(())
}

/// The bare shafts of the annotations, that of the left hand first.
fn shafts(args: &TrackArgs, marked: &AnnotationsFile) -> Result<Vec<ReferenceTool>, CommandFailure> {
    let mut shafts = tools(marked, &args.annotations)?;
    shafts.retain(ToolSpec::is_bare);
    if shafts.is_empty() {
        let what = "--segmenter follows bare shafts, and no tool here is one: give a tool the marker `shaft`, or leave \
                    out --segmenter";
        return Err(about(&args.annotations, anyhow::anyhow!(what)));
    }
    let place = |tool: &ToolSpec| match tool.side {
        Some(HandSide::Left) => 0,
        None => 1,
        Some(HandSide::Right) => 2,
    };
    shafts.sort_by_key(place);
    Ok(shafts.into_iter().map(|ToolSpec { name, diameter_mm, .. }| ReferenceTool { name, diameter_mm }).collect())
}

fn report(path: &Trajectory) {
    for (i, tool) in path.tools.iter().enumerate() {
        eprintln!("{tool}: measured on {} of {} frames", path.of_tool(i).count(), path.frame_times_s.len());
    }
    eprintln!("verdict: none; this path is of a reference method: compare it (`trocar evaluate`), do not score it");
}
