//! Collects the colours that an instructor marked, from the marked clip or from pictures of its frames, and reports on
//! them; or finds out which tapes suit a box.

use std::fs::File;
use std::io::BufReader;

use super::reporter::Reporter;
use super::{Halt, explain};
use crate::analysis::marked::{MarkedFrames, colours_of, strokes};
use crate::analysis::protocol::{Answer, MarkShape, PaletteShape};
use crate::domain::palette::PaletteAdvice;
use crate::domain::problem::Problem;
use crate::media::{Limits, Picture, VideoFile, photo};
use crate::pipeline::segmentation::palette::advice::advise;

/// Frames between two signs of life.
const FRAMES_AT_A_TIME: u64 = 32;

/// Collects colours from a clip. Decodes no further than the last mark.
pub(super) fn from_clip(
    marks: &[MarkShape],
    tools: &[String],
    mut video: VideoFile,
    reporter: &mut Reporter,
) -> Result<(), Halt> {
    let last = marks.iter().map(|mark| mark.frame).max().unwrap_or(0);
    let mut marked = MarkedFrames::default();
    let mut decoded = 0;
    while decoded <= last {
        let Some(picture) = video.next_picture()? else {
            return Err(Halt::Explained(explain::mark_beyond_the_end(last, decoded)));
        };
        take(&mut marked, marks, decoded, picture)?;
        decoded += 1;
        if decoded.is_multiple_of(FRAMES_AT_A_TIME) {
            reporter.say(&Answer::Alive { done: decoded, of: Some(last + 1) })?;
        }
    }
    tell(&marked, tools, reporter)
}

/// Pictures of frames.
pub(super) struct Pictures<'a> {
    /// The frame that each input shows.
    pub(super) frames: &'a [u64],
    /// JPEG or PNG files.
    pub(super) inputs: Vec<File>,
    /// Limits of one picture.
    pub(super) limits: Limits,
}

/// Collects colours from pictures.
pub(super) fn from_pictures(
    marks: &[MarkShape],
    tools: &[String],
    pictures: Pictures<'_>,
    reporter: &mut Reporter,
) -> Result<(), Halt> {
    let mut marked = MarkedFrames::default();
    look_at(&mut marked, marks, pictures, reporter)?;
    tell(&marked, tools, reporter)
}

/// Sends a report on the marks and a mask for each of these pictures, marked or not.
pub(super) fn mask_on(
    marks: &[MarkShape],
    tools: &[String],
    pictures: Pictures<'_>,
    reporter: &mut Reporter,
) -> Result<(), Halt> {
    let mut marked = MarkedFrames::keeping_all();
    look_at(&mut marked, marks, pictures, reporter)?;
    let nothing = || Halt::Explained(explain::no_input());
    reporter.say(&Answer::PaletteReport(marked.report(tools).ok_or_else(nothing)?))?;
    let unmarked = || {
        let how = "mark at least one tape and some background, then try again";
        Halt::Explained(Problem::new("no-marks", "Nothing is marked", how))
    };
    for mask in marked.masks(&colours_of(tools)).ok_or_else(unmarked)? {
        reporter.say(&Answer::Mask(mask))?;
    }
    Ok(())
}

fn look_at(
    marked: &mut MarkedFrames,
    marks: &[MarkShape],
    Pictures { frames, inputs, limits }: Pictures<'_>,
    reporter: &mut Reporter,
) -> Result<(), Halt> {
    if let Some(unseen) = marks.iter().find(|mark| !frames.contains(&mark.frame)) {
        return Err(Halt::Explained(explain::mark_without_picture(unseen.frame)));
    }
    let of = Some(inputs.len() as u64);
    for (done, (file, &frame)) in (1..).zip(inputs.into_iter().zip(frames)) {
        let picture = photo::read_picture(BufReader::new(file), frame, limits)?;
        take(marked, marks, frame, picture)?;
        reporter.say(&Answer::Alive { done, of })?;
    }
    Ok(())
}

/// Finds out which tapes suit the box in this picture.
pub(super) fn advise_on(inputs: Vec<File>, limits: Limits, reporter: &mut Reporter) -> Result<(), Halt> {
    let file = inputs.into_iter().next().ok_or_else(|| Halt::Explained(explain::no_input()))?;
    let picture = photo::first_picture(file, limits)?;
    Ok(reporter.say(&Answer::PaletteAdvice(PaletteAdvice::from(&advise(&picture.frame()))))?)
}

/// Adds the marks on this frame.
fn take(marked: &mut MarkedFrames, marks: &[MarkShape], number: u64, picture: Picture) -> Result<(), Halt> {
    let (width, height) = (picture.frame().width(), picture.frame().height());
    let mut rectangles = Vec::new();
    for mark in marks.iter().filter(|mark| mark.frame == number) {
        let rectangle = mark.rectangle();
        let right = rectangle.x.saturating_add(rectangle.w);
        let bottom = rectangle.y.saturating_add(rectangle.h);
        if rectangle.w == 0 || rectangle.h == 0 || right > width || bottom > height {
            return Err(Halt::Explained(explain::mark_outside(mark, width, height)));
        }
        rectangles.push((mark.stroke, rectangle));
    }
    marked.take(picture, strokes(rectangles.into_iter()));
    Ok(())
}

fn tell(marked: &MarkedFrames, tools: &[String], reporter: &mut Reporter) -> Result<(), Halt> {
    let nothing = || Halt::Explained(explain::no_input());
    reporter.say(&Answer::Palette(PaletteShape::from(marked.samples().ok_or_else(nothing)?)))?;
    Ok(reporter.say(&Answer::PaletteReport(marked.report(tools).ok_or_else(nothing)?))?)
}
