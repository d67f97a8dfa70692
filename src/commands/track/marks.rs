//! Collects samples of the colours that an instructor marked on a clip.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::anyhow;

use super::stages::{StageClock, TrackStage};
use super::{CommandFailure, about, open, rectangle};
use crate::analysis::marked::group_into_strokes;
use crate::domain::files::annotations::AnnotationsFile;
use crate::domain::text::count_of;
use crate::media::{MediaError, VideoFile};
use crate::vision::frame::Frame;
use crate::vision::segmentation::samples::ColourSamples;

/// The labelled rectangles of a clip.
pub(super) struct ClipMarks<'a> {
    marked: &'a AnnotationsFile,
    annotations: &'a Path,
    clip: PathBuf,
    is_tracked_clip: bool,
}

impl<'a> ClipMarks<'a> {
    /// The marks of the clip that the annotations name; if they name none, of the clip to be tracked.
    pub(super) fn new(marked: &'a AnnotationsFile, annotations: &'a Path, tracked: &Path) -> Self {
        let folder = annotations.parent().unwrap_or(Path::new("."));
        let clip = marked.video.as_ref().map_or_else(|| tracked.to_owned(), |name| folder.join(name));
        let is_tracked_clip =
            fs::canonicalize(&clip).is_ok_and(|clip| fs::canonicalize(tracked).is_ok_and(|tracked| clip == tracked));
        Self { marked, annotations, clip, is_tracked_clip }
    }

    /// A collector without samples.
    pub(super) fn collector(&self) -> SampleCollector<'a> {
        SampleCollector { marked: self.marked, samples: None }
    }

    /// Collects while decoding as few frames as possible. `None` if that fails, or if the clip is not the tracked one,
    /// because then no full pass checks the samples.
    pub(super) fn collect_from_few_frames(
        &self,
        clock: &mut StageClock,
    ) -> Result<Option<ColourSamples>, CommandFailure> {
        if !self.is_tracked_clip {
            return Ok(None);
        }
        let video = self.open()?;
        // Frame 0 is needed too: its colour encoding is that of all samples.
        let numbers: Vec<u64> = self.marked.labels.iter().map(|label| label.frame).chain([0]).collect();
        let mut collector = self.collector();
        let shown = video.show_frames(&numbers, |picture| {
            clock.add_lap(TrackStage::DecodingMarked);
            collector.add_frame(&picture.frame());
            clock.add_lap(TrackStage::Samples);
        });
        clock.add_lap(TrackStage::DecodingMarked);
        Ok(shown.and_then(|()| collector.into_samples()))
    }

    /// Collects while decoding all frames up to the last mark.
    pub(super) fn collect(&self, clock: &mut StageClock) -> Result<ColourSamples, CommandFailure> {
        let mut video = self.open()?;
        let last = self.marked.labels.iter().map(|label| label.frame).max().unwrap_or(0);
        let mut collector = self.collector();
        for number in 0..=last {
            let Some(picture) = video.next_picture().map_err(|e| about(&self.clip, e))? else {
                let frames = count_of(number, "frame");
                return Err(about(
                    self.annotations,
                    anyhow!("a rectangle is on frame {last}, but {} has only {frames}", self.clip.display()),
                ));
            };
            clock.add_lap(TrackStage::DecodingMarked);
            collector.add_frame(&picture.frame());
            video.recycle(picture);
            clock.add_lap(TrackStage::Samples);
        }
        collector.into_samples().ok_or_else(|| about(&self.clip, MediaError::NoFrames))
    }

    fn open(&self) -> Result<VideoFile, CommandFailure> {
        let video = open(&self.clip)?;
        let info = video.info();
        self.marked.check_inside(info.width, info.height).map_err(|e| about(self.annotations, e))?;
        Ok(video)
    }
}

/// Collects samples from the frames that it is given.
pub(super) struct SampleCollector<'a> {
    marked: &'a AnnotationsFile,
    samples: Option<ColourSamples>,
}

impl SampleCollector<'_> {
    /// Collects the marks on this frame. The first frame's encoding is that of all samples.
    pub(super) fn add_frame(&mut self, frame: &Frame<'_>) {
        let samples = self.samples.get_or_insert_with(|| ColourSamples::new(frame.encoding));
        let labels = self.marked.labels.iter().filter(|label| label.frame == frame.index);
        for stroke in group_into_strokes(labels.map(|label| (label.stroke, rectangle(self.marked, label)))) {
            samples.collect_stroke(frame, &stroke);
        }
    }

    /// The samples; `None` without any frame.
    pub(super) fn into_samples(self) -> Option<ColourSamples> {
        self.samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resources::shared;
    use crate::vision::segmentation::Classify;
    use crate::vision::segmentation::colour_table::ColourTable;
    use crate::vision::segmentation::knn::Knn;

    /// Error of the quantised table, on every pixel that tracking would look up.
    #[test]
    fn the_table_agrees_with_exact_neighbours_on_nearly_all_real_pixels() {
        let Some(scenes) = shared("scenes") else { return };
        for scene in ["V1", "V2"] {
            let folder = scenes.join(scene);
            let (annotations, video) = (folder.join("annotations.json"), folder.join("video.mp4"));
            let marked = AnnotationsFile::parse(&fs::read_to_string(&annotations).unwrap()).unwrap();
            let samples = ClipMarks::new(&marked, &annotations, &video).collect(&mut StageClock::start()).unwrap();
            let names: Vec<String> = marked.marked_tools().unwrap().into_iter().map(|t| t.name).collect();
            let classes = samples.classes(&names);
            let knn = Knn::new(&samples, &classes).unwrap();
            let table = ColourTable::new(Knn::new(&samples, &classes).unwrap(), samples.encoding);
            let picture = open(&video).unwrap().next_picture().unwrap().unwrap();
            let frame = picture.frame();
            let pixels: Vec<(usize, usize)> = (0..frame.height())
                .step_by(6)
                .flat_map(|y| (0..frame.width()).step_by(6).map(move |x| (x, y)))
                .collect();
            let agree = |(x, y): &&(usize, usize)| {
                let codes = frame.yuv_at(*x, *y);
                table.class_of(codes) == knn.class_of(samples.encoding.colour_of(codes))
            };
            let share = pixels.iter().filter(agree).count() as f64 / pixels.len() as f64;
            eprintln!("{scene}: {:.3} % of {} pixels agree", 100.0 * share, pixels.len());
            assert!(share >= 0.995, "{scene}: only {:.2} % agree", 100.0 * share);
        }
    }
}
