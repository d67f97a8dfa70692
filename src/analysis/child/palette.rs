//! Collects the colours that an instructor marked, from the marked clip or from pictures of its frames, and reports on
//! them; or finds out which tapes suit a box.

use std::fs::File;
use std::io::BufReader;

use super::reporter::Reporter;
use super::{StopReason, explain};
use crate::analysis::marked::{MarkedFrames, colours_of, group_into_strokes};
use crate::analysis::protocol::{ChildReply, MarkShape, PaletteShape};
use crate::domain::palette::PaletteAdvice;
use crate::domain::problem::Problem;
use crate::media::{MediaLimits, Picture, VideoFile, photo};
use crate::vision::segmentation::palette::advice::rank_tapes;

/// Frames between two signs of life.
const FRAMES_PER_ALIVE: u64 = 32;

/// Collects colours from a clip. Decodes no further than the last mark.
pub(super) fn from_clip(
    marks: &[MarkShape],
    tools: &[String],
    mut video: VideoFile,
    reporter: &mut Reporter,
) -> Result<(), StopReason> {
    let last = marks.iter().map(|mark| mark.frame).max().unwrap_or(0);
    let mut marked = MarkedFrames::default();
    let mut decoded = 0;
    while decoded <= last {
        let Some(picture) = video.next_picture()? else {
            return Err(StopReason::Impossible(explain::mark_beyond_the_end(last, decoded)));
        };
        add_picture(&mut marked, marks, decoded, picture)?;
        decoded += 1;
        if decoded.is_multiple_of(FRAMES_PER_ALIVE) {
            reporter.send(&ChildReply::Alive { done: decoded, of: Some(last + 1) })?;
        }
    }
    send_report(&marked, tools, reporter)
}

/// Pictures of frames.
pub(super) struct PictureInputs<'a> {
    /// The frame that each input shows.
    pub(super) frames: &'a [u64],
    /// JPEG or PNG files.
    pub(super) inputs: Vec<File>,
    /// Limits of one picture.
    pub(super) limits: MediaLimits,
}

/// Collects colours from pictures.
pub(super) fn from_pictures(
    marks: &[MarkShape],
    tools: &[String],
    pictures: PictureInputs<'_>,
    reporter: &mut Reporter,
) -> Result<(), StopReason> {
    let mut marked = MarkedFrames::default();
    add_pictures(&mut marked, marks, pictures, reporter)?;
    send_report(&marked, tools, reporter)
}

/// Sends a report on the marks and a mask for each of these pictures, marked or not.
pub(super) fn mask_on(
    marks: &[MarkShape],
    tools: &[String],
    pictures: PictureInputs<'_>,
    reporter: &mut Reporter,
) -> Result<(), StopReason> {
    let mut marked = MarkedFrames::keeping_all();
    add_pictures(&mut marked, marks, pictures, reporter)?;
    let nothing = || StopReason::Impossible(explain::no_input());
    reporter.send(&ChildReply::PaletteReport(marked.report(tools).ok_or_else(nothing)?))?;
    let unmarked = || {
        let how = "mark at least one tape and some background, then try again";
        StopReason::Impossible(Problem::new("no-marks", "Nothing is marked", how))
    };
    for mask in marked.masks(&colours_of(tools)).ok_or_else(unmarked)? {
        reporter.send(&ChildReply::Mask(mask))?;
    }
    Ok(())
}

fn add_pictures(
    marked: &mut MarkedFrames,
    marks: &[MarkShape],
    PictureInputs { frames, inputs, limits }: PictureInputs<'_>,
    reporter: &mut Reporter,
) -> Result<(), StopReason> {
    if let Some(unseen) = marks.iter().find(|mark| !frames.contains(&mark.frame)) {
        return Err(StopReason::Impossible(explain::mark_without_picture(unseen.frame)));
    }
    let of = Some(inputs.len() as u64);
    for (done, (file, &frame)) in (1..).zip(inputs.into_iter().zip(frames)) {
        let picture = photo::read_picture(BufReader::new(file), frame, limits)?;
        add_picture(marked, marks, frame, picture)?;
        reporter.send(&ChildReply::Alive { done, of })?;
    }
    Ok(())
}

/// Finds out which tapes suit the box in this picture.
pub(super) fn advise_on_tapes(
    inputs: Vec<File>,
    limits: MediaLimits,
    reporter: &mut Reporter,
) -> Result<(), StopReason> {
    let file = inputs.into_iter().next().ok_or_else(|| StopReason::Impossible(explain::no_input()))?;
    let picture = photo::first_picture(file, limits)?;
    Ok(reporter.send(&ChildReply::PaletteAdvice(PaletteAdvice::from(&rank_tapes(&picture.frame()))))?)
}

/// Adds the marks on this frame.
fn add_picture(
    marked: &mut MarkedFrames,
    marks: &[MarkShape],
    number: u64,
    picture: Picture,
) -> Result<(), StopReason> {
    let (width, height) = (picture.frame().width(), picture.frame().height());
    let mut rectangles = Vec::new();
    for mark in marks.iter().filter(|mark| mark.frame == number) {
        let rectangle = mark.rectangle();
        let right = rectangle.x.saturating_add(rectangle.w);
        let bottom = rectangle.y.saturating_add(rectangle.h);
        if rectangle.w == 0 || rectangle.h == 0 || right > width || bottom > height {
            return Err(StopReason::Impossible(explain::mark_outside(mark, width, height)));
        }
        rectangles.push((mark.stroke, rectangle));
    }
    marked.add(picture, group_into_strokes(rectangles.into_iter()));
    Ok(())
}

fn send_report(marked: &MarkedFrames, tools: &[String], reporter: &mut Reporter) -> Result<(), StopReason> {
    let nothing = || StopReason::Impossible(explain::no_input());
    reporter.send(&ChildReply::Palette(PaletteShape::from(marked.samples().ok_or_else(nothing)?)))?;
    Ok(reporter.send(&ChildReply::PaletteReport(marked.report(tools).ok_or_else(nothing)?))?)
}
