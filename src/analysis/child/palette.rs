//! Collects the colours that an instructor marked, from the marked clip or from pictures of its frames, and reports on
//! them.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::BufReader;

use serde::{Deserialize, Serialize};

use super::limits::{MAX_TEXT_CHARS, accept_surroundings, is_plausible_number, set_once};
use super::{ChildEvent, ChildInputs, ChildTask, Reporter, StopReason, WorkRecord, explain, no_input};
use crate::analysis::empty_box::read_empty_box;
use crate::analysis::marked::{MarkedFrames, group_into_strokes};
use crate::domain::palette::PaletteReport;
use crate::media::{MediaLimits, Picture, VideoFile, photo};
use crate::vision::segmentation::samples::{ColourSamples, MarkedRectangle};
use crate::vision::surroundings::Surroundings;

/// Frames between two signs of life.
const FRAMES_PER_ALIVE: u64 = 32;

/// Most samples in a palette.
const MAX_SAMPLES: usize = 1_000_000;

/// What collecting colours needs besides the pictures.
#[derive(Debug, Serialize, Deserialize)]
pub struct PaletteWork {
    /// Marked rectangles.
    pub marks: Vec<ColourMark>,
    /// The tape colour of each tool with tape: a colour occurs twice if two tools wear it.
    pub tools: Vec<String>,
    /// The frame that each input shows; `None` if the only input is a clip.
    pub frames: Option<Vec<u64>>,
    /// Whether the last input is a photo of the empty box.
    pub has_empty_box: bool,
}

/// A marked rectangle on a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColourMark {
    /// Decoded frame, from 0.
    pub frame: u64,
    /// Label and place.
    pub rectangle: MarkedRectangle,
    /// Rectangles of one frame and label with the same number belong to one mark.
    pub stroke: Option<u32>,
}

/// A record about marked colours.
#[derive(Debug, Serialize, Deserialize)]
pub enum PaletteWorkRecord {
    /// Their samples.
    Samples(ColourSamples),
    /// The report on them.
    Report(PaletteReport),
    /// What stands still in the pictures.
    Surroundings(Surroundings),
}

/// What is kept of marked colours.
#[derive(Debug, Default)]
pub struct PaletteOutput {
    /// Their samples.
    pub samples: Option<ColourSamples>,
    /// The report on them.
    pub report: Option<PaletteReport>,
    /// What stands still in the pictures.
    pub surroundings: Option<Surroundings>,
}

impl ChildTask for PaletteWork {
    type Record = PaletteWorkRecord;
    type Output = PaletteOutput;

    fn run(self, mut inputs: ChildInputs, reporter: &mut Reporter) -> Result<(), StopReason> {
        let limits = inputs.limits;
        let empty_box = self.has_empty_box.then(|| inputs.take_last()).transpose()?;
        let mut marked = MarkedFrames::default();
        match &self.frames {
            Some(frames) => add_pictures(&mut marked, &self.marks, frames, inputs, reporter)?,
            None => add_clip(&mut marked, &self.marks, inputs.video()?, reporter)?,
        }
        if let Some((file, size)) = empty_box.zip(marked.frame_size()) {
            read_empty_box(file, size, limits)?; // tracking reads it again: it must be possible then
        }
        let samples = marked.samples().ok_or_else(no_input)?.clone();
        reporter.record(WorkRecord::Palette(PaletteWorkRecord::Samples(samples)))?;
        if let Some(surroundings) = marked.surroundings() {
            reporter.record(WorkRecord::Palette(PaletteWorkRecord::Surroundings(surroundings)))?;
        }
        let report = marked.report(&self.tools).ok_or_else(no_input)?;
        Ok(reporter.record(WorkRecord::Palette(PaletteWorkRecord::Report(report)))?)
    }

    fn accept(
        &self,
        record: PaletteWorkRecord,
        output: &mut PaletteOutput,
        _: MediaLimits,
    ) -> Result<ChildEvent, String> {
        match record {
            PaletteWorkRecord::Samples(samples) => {
                let marked: BTreeSet<&str> = self.marks.iter().map(|mark| mark.rectangle.label.as_str()).collect();
                let labels: BTreeSet<&str> = samples.labels.iter().map(String::as_str).collect();
                let named = labels.len() == samples.labels.len() && labels.is_subset(&marked);
                let labelled = samples.samples.iter().all(|sample| sample.label < samples.labels.len());
                if !named || !labelled || samples.samples.len() > MAX_SAMPLES {
                    return Err("invalid colour samples".into());
                }
                set_once(&mut output.samples, samples, "palette")?;
            }
            PaletteWorkRecord::Report(report) => accept_report(&mut output.report, report)?,
            PaletteWorkRecord::Surroundings(picture) => accept_surroundings(&mut output.surroundings, picture)?,
        }
        Ok(ChildEvent::Nothing)
    }
}

/// Keeps a report on colours.
pub(super) fn accept_report(slot: &mut Option<PaletteReport>, report: PaletteReport) -> Result<(), String> {
    if !report.numbers().all(is_plausible_number) || report.texts().any(|text| text.chars().count() > MAX_TEXT_CHARS[2])
    {
        return Err("an invalid report on colours".into());
    }
    set_once(slot, report, "report on colours")
}

/// Adds the marks on a clip. Decodes no further than the last mark.
fn add_clip(
    marked: &mut MarkedFrames,
    marks: &[ColourMark],
    mut video: VideoFile,
    reporter: &mut Reporter,
) -> Result<(), StopReason> {
    let last = marks.iter().map(|mark| mark.frame).max().unwrap_or(0);
    let mut decoded = 0;
    while decoded <= last {
        let Some(picture) = video.next_picture()? else {
            return Err(StopReason::Impossible(explain::mark_beyond_the_end(last, decoded)));
        };
        add_picture(marked, marks, decoded, picture)?;
        decoded += 1;
        if decoded.is_multiple_of(FRAMES_PER_ALIVE) {
            reporter.alive(decoded, Some(last + 1))?;
        }
    }
    Ok(())
}

/// Adds the marks on pictures; each input shows one of these frames.
pub(super) fn add_pictures(
    marked: &mut MarkedFrames,
    marks: &[ColourMark],
    frames: &[u64],
    ChildInputs { files, limits }: ChildInputs,
    reporter: &mut Reporter,
) -> Result<(), StopReason> {
    if let Some(unseen) = marks.iter().find(|mark| !frames.contains(&mark.frame)) {
        return Err(StopReason::Impossible(explain::mark_without_picture(unseen.frame)));
    }
    let of = Some(files.len() as u64);
    let with_frames = (1..).zip(files.into_iter().zip(frames));
    for (done, (file, &frame)) in with_frames {
        add_picture(marked, marks, frame, read_picture(file, frame, limits)?)?;
        reporter.alive(done, of)?;
    }
    Ok(())
}

fn read_picture(file: File, frame: u64, limits: MediaLimits) -> Result<Picture, StopReason> {
    Ok(photo::read_picture(BufReader::new(file), frame, limits)?)
}

/// Adds the marks on this frame.
fn add_picture(
    marked: &mut MarkedFrames,
    marks: &[ColourMark],
    number: u64,
    picture: Picture,
) -> Result<(), StopReason> {
    let (width, height) = (picture.frame().width(), picture.frame().height());
    let mut rectangles = Vec::new();
    for mark in marks.iter().filter(|mark| mark.frame == number) {
        let rectangle = &mark.rectangle;
        let right = rectangle.x.saturating_add(rectangle.w);
        let bottom = rectangle.y.saturating_add(rectangle.h);
        if rectangle.w == 0 || rectangle.h == 0 || right > width || bottom > height {
            return Err(StopReason::Impossible(explain::mark_outside(mark, width, height)));
        }
        rectangles.push((mark.stroke, rectangle.clone()));
    }
    marked.add(picture, group_into_strokes(rectangles.into_iter()));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::ChildWork;
    use crate::analysis::output_validator::validate_records;
    use crate::domain::palette::{ConfusionRow, LightShares};
    use crate::vision::frame::{ColourEncoding, Matrix, Range};
    use crate::vision::segmentation::samples::ColourSample;

    /// Validates the records of work whose only mark is on an orange tape.
    fn validate(records: Vec<PaletteWorkRecord>) -> Result<PaletteOutput, String> {
        let rectangle = MarkedRectangle { label: "orange".into(), x: 0, y: 0, w: 9, h: 9 };
        let marks = vec![ColourMark { frame: 0, rectangle, stroke: None }];
        let work = ChildWork::Palette(PaletteWork { marks, tools: vec![], frames: None, has_empty_box: false });
        let records = records.into_iter().map(WorkRecord::Palette).collect();
        Ok(validate_records(&work, records)?.palette)
    }

    #[test]
    fn every_colour_sample_has_a_label_that_was_marked() {
        let hear = |labels: &[&str], label: usize| {
            let encoding = ColourEncoding { range: Range::Full, matrix: Matrix::Bt601 };
            let samples = vec![ColourSample { label, rectangle: 7, yuv: [1, 2, 3] }];
            let labels = labels.iter().map(|label| (*label).to_owned()).collect();
            let palette = ColourSamples { encoding, labels, samples, places: Vec::new() };
            validate(vec![PaletteWorkRecord::Samples(palette)])
        };
        assert!(hear(&["orange"], 0).is_ok());
        assert!(hear(&["orange"], 1).is_err());
        assert!(hear(&["cyan"], 0).is_err());
        assert!(hear(&["orange", "orange"], 0).is_err());
    }

    #[test]
    fn a_report_on_colours_is_accepted_once_and_only_with_plausible_numbers() {
        let report = |no_tool: f64, label: &str| {
            let light = LightShares { light: "as marked".into(), no_tool, tools: vec![] };
            let row = ConfusionRow { label: label.into(), rectangles: 1, pixels: 4, lights: vec![light] };
            PaletteReport { confusion: vec![row], ..PaletteReport::default() }
        };
        let hear = |reports: &[PaletteReport]| {
            validate(reports.iter().cloned().map(PaletteWorkRecord::Report).collect()).map(|output| output.report)
        };
        let honest = report(0.25, "background");
        assert_eq!(hear(std::slice::from_ref(&honest)).unwrap().unwrap(), honest);
        assert!(hear(&[honest.clone(), honest.clone()]).is_err());
        assert!(hear(&[report(f64::NAN, "background")]).is_err());
        assert!(hear(&[report(0.25, &"x".repeat(5000))]).is_err());
        let of_palette = WorkRecord::Palette(PaletteWorkRecord::Report(honest));
        assert!(validate_records(&ChildWork::Probe(super::super::probe::ProbeWork), vec![of_palette]).is_err());
    }
}
