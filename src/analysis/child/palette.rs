//! Collect the colours that an instructor marked, from the clip in which they were marked or from pictures of its frames.

use std::fs::File;
use std::io::BufReader;

use super::reporter::Reporter;
use super::{Halt, explain};
use crate::analysis::protocol::{Answer, MarkShape, PaletteShape};
use crate::media::{Limits, VideoFile, photo};
use crate::pipeline::frame::Frame;
use crate::pipeline::segmentation::samples::ColourSamples;

/// Frames between two signs of life.
const FRAMES_AT_A_TIME: u64 = 32;

/// Decodes no further than the last mark.
pub(super) fn from_clip(marks: &[MarkShape], mut video: VideoFile, reporter: &mut Reporter) -> Result<(), Halt> {
    let last = marks.iter().map(|mark| mark.frame).max().unwrap_or(0);
    let mut samples = None;
    let mut decoded = 0;
    while decoded <= last {
        let Some(picture) = video.next_picture()? else {
            return Err(Halt::Explained(explain::mark_beyond_the_end(last, decoded)));
        };
        collect(&mut samples, marks, decoded, &picture.frame())?;
        decoded += 1;
        if decoded.is_multiple_of(FRAMES_AT_A_TIME) {
            reporter.say(&Answer::Alive { done: decoded, of: Some(last + 1) })?;
        }
    }
    tell(samples, reporter)
}

/// Each input shows the frame of the same place in `frames`.
pub(super) fn from_pictures(
    marks: &[MarkShape],
    frames: &[u64],
    inputs: Vec<File>,
    limits: Limits,
    reporter: &mut Reporter,
) -> Result<(), Halt> {
    if let Some(unseen) = marks.iter().find(|mark| !frames.contains(&mark.frame)) {
        return Err(Halt::Explained(explain::mark_without_picture(unseen.frame)));
    }
    let of = Some(inputs.len() as u64);
    let mut samples = None;
    for (done, (file, &frame)) in (1..).zip(inputs.into_iter().zip(frames)) {
        let picture = photo::read_picture(BufReader::new(file), frame, limits)?;
        collect(&mut samples, marks, frame, &picture.frame())?;
        reporter.say(&Answer::Alive { done, of })?;
    }
    tell(samples, reporter)
}

/// Adds what is marked on this frame. The first frame's encoding is that of all samples.
fn collect(
    samples: &mut Option<ColourSamples>,
    marks: &[MarkShape],
    number: u64,
    frame: &Frame<'_>,
) -> Result<(), Halt> {
    let samples = samples.get_or_insert_with(|| ColourSamples::new(frame.encoding));
    for mark in marks.iter().filter(|mark| mark.frame == number) {
        let (rectangle, width, height) = (mark.rectangle(), frame.width(), frame.height());
        let right = rectangle.x.saturating_add(rectangle.w);
        let bottom = rectangle.y.saturating_add(rectangle.h);
        if rectangle.w == 0 || rectangle.h == 0 || right > width || bottom > height {
            return Err(Halt::Explained(explain::mark_outside(mark, width, height)));
        }
        samples.collect(frame, &rectangle);
    }
    Ok(())
}

fn tell(samples: Option<ColourSamples>, reporter: &mut Reporter) -> Result<(), Halt> {
    let samples = samples.ok_or_else(|| Halt::Explained(explain::no_input()))?;
    Ok(reporter.say(&Answer::Palette(PaletteShape::from(&samples)))?)
}
