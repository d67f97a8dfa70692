//! What a recording shows of its box: frames spread over it. From them the tracker of bare shafts learns what stands
//! still, and where the trocars are.

use std::fs::File;
use std::io::Seek;
use std::sync::Arc;

use super::clock::ClockError;
use crate::heap;
use crate::media::{MediaError, MediaLimits, Picture, VideoFile};
use crate::vision::frame::Frame;
use crate::vision::tracker::{SCENE_FRAMES, SceneSamples, ToolSpec, TrackerSettings};

/// A frame with less mean light is dark if it also has less than [`MAX_DARK_SHARE`] of the brightest frame's. Light is
/// gamma-coded luma, as a share of white.
const MAX_DARK_LIGHT: f64 = 0.1;

/// See [`MAX_DARK_LIGHT`].
const MAX_DARK_SHARE: f64 = 0.4;

/// Dark frames are left out if at least this share of the frames is not dark. With fewer, something bright, such as a
/// sheet of paper, may have covered a dark box for a moment.
const MIN_LIT_SHARE: f64 = 0.25;

/// Columns and rows of the pixels that show a frame's light.
const LIGHT_GRID: (usize, usize) = (32, 18);

/// Collects frames for [`Tracker::learn_scene`]. Frames after the light was switched off are left out. Without a bare
/// tool nothing is read, and there are no frames. Calls `on_packet` for each packet of the recording that is read. Call
/// this before the recording is opened for tracking: only one decoder then needs memory at a time. Afterwards the
/// file's position is its beginning.
///
/// To save time, few frames are decoded. If the packets do not identify them, all are.
///
/// # Errors
/// [`ClockError`] if the recording cannot be read.
///
/// [`Tracker::learn_scene`]: crate::vision::tracker::Tracker::learn_scene
pub fn collect_scene(
    settings: &TrackerSettings,
    file: Arc<File>,
    limits: MediaLimits,
    mut on_packet: impl FnMut(),
) -> Result<SceneSamples, ClockError> {
    if !settings.tools.iter().any(ToolSpec::is_bare) {
        return Ok(SceneSamples::default());
    }
    let mut found = LitScene::of_light(f64::NEG_INFINITY, &file, limits, &mut on_packet)?;
    if let Some(least) = found.least_light() {
        found = LitScene::of_light(least, &file, limits, &mut on_packet)?;
    }
    heap::release_free_memory();
    Ok(found.scene)
}

/// The frames of a recording that have at least some light.
struct LitScene {
    least: f64,
    scene: SceneSamples,
    /// The light of every frame that was looked at.
    lights: Vec<f64>,
}

impl LitScene {
    fn new(least: f64) -> Self {
        Self { least, scene: SceneSamples::default(), lights: Vec::new() }
    }

    fn of_light(
        least: f64,
        file: &Arc<File>,
        limits: MediaLimits,
        mut on_packet: impl FnMut(),
    ) -> Result<Self, ClockError> {
        let mut found = Self::new(least);
        let add = |picture: &Picture| found.add(&picture.frame());
        let shown = VideoFile::open(file.clone(), limits)?.show_spread(SCENE_FRAMES, add, &mut on_packet);
        (&**file).rewind()?;
        if shown.is_none() {
            found = Self::of_all_frames(least, VideoFile::open(file.clone(), limits)?, on_packet)?;
            (&**file).rewind()?;
        }
        Ok(found)
    }

    /// Collects while decoding all frames.
    fn of_all_frames(least: f64, mut video: VideoFile, mut on_picture: impl FnMut()) -> Result<Self, MediaError> {
        let mut found = Self::new(least);
        while let Some(picture) = video.next_picture()? {
            found.add(&picture.frame());
            video.recycle(picture);
            on_picture();
        }
        Ok(found)
    }

    fn add(&mut self, frame: &Frame<'_>) {
        let light = light_of(frame);
        self.lights.push(light);
        if light >= self.least {
            self.scene.add(frame);
        }
    }

    /// The least light of a frame that is not dark; `None` if no frame has to be left out.
    fn least_light(&self) -> Option<f64> {
        let brightest = self.lights.iter().copied().fold(0.0, f64::max);
        let least = MAX_DARK_LIGHT.min(MAX_DARK_SHARE * brightest);
        let lit = self.lights.iter().filter(|light| **light >= least).count();
        (lit < self.lights.len() && lit as f64 >= MIN_LIT_SHARE * self.lights.len() as f64).then_some(least)
    }
}

/// The mean light of a frame.
fn light_of(frame: &Frame<'_>) -> f64 {
    let (columns, rows) = LIGHT_GRID;
    let place = |index: usize, of: usize, size: usize| (2 * index + 1) * size / (2 * of);
    let luma = |row: usize, column: usize| {
        let (x, y) = (place(column, columns, frame.width()), place(row, rows, frame.height()));
        frame.encoding.colour_of(frame.yuv_at(x, y))[0]
    };
    let sum: f64 = (0..rows).flat_map(|row| (0..columns).map(move |column| luma(row, column))).sum();
    sum / (columns * rows) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::track::tests::settings;
    use crate::media::{SampleFormat, VideoSettings, VideoWriter};
    use crate::simulation::render::Renderer;
    use crate::simulation::{Scenario, Setup, Skill, World};
    use crate::vision::tracker::Marker;

    /// A recording of this many frames; the light is off from frame `dark_from` on.
    fn recording(frames: u64, dark_from: u64) -> Arc<File> {
        let (width, height, fps) = (96, 64, 25.0);
        let world = World::new(&Setup { width, height, ..Setup::new(Scenario::Pegs, Skill::INTERMEDIATE, 5) });
        let file = tempfile::tempfile().unwrap();
        let settings = VideoSettings { width, height, fps, samples: SampleFormat::Yuv420, crf: 23 };
        let mut writer = VideoWriter::create(file.try_clone().unwrap(), settings).unwrap();
        let renderer = Renderer::new(&world);
        for index in 0..frames {
            let time_s = index as f64 / fps;
            let mut image = renderer.render(time_s);
            if index >= dark_from {
                image.y.fill(18);
            }
            writer.write(&image.frame(index, time_s)).unwrap();
        }
        writer.finish().unwrap();
        (&file).rewind().unwrap();
        Arc::new(file)
    }

    fn bare_settings() -> TrackerSettings {
        let mut settings = settings();
        settings.tools[0].marker = Marker::Shaft { collar_mm: None, jaw_mm: None };
        settings
    }

    #[test]
    fn a_short_recording_is_collected_whole_and_can_be_opened_again() {
        let (file, limits) = (recording(20, 20), MediaLimits::default());
        let mut packets = 0;
        let scene = collect_scene(&bare_settings(), file.clone(), limits, || packets += 1).unwrap();
        assert!(packets >= 20, "{packets}");
        assert_eq!((&*file).stream_position().unwrap(), 0);
        let mut pictures = 0;
        let all = LitScene::of_all_frames(f64::NEG_INFINITY, VideoFile::open(file, limits).unwrap(), || pictures += 1)
            .unwrap();
        assert!(scene == all.scene && pictures == 20, "{pictures} frames"); // cells of pictures: not worth printing
        assert!(scene != SceneSamples::default());
    }

    #[test]
    fn frames_after_the_light_was_switched_off_do_not_show_the_box() {
        let (file, limits) = (recording(20, 8), MediaLimits::default());
        let scene = collect_scene(&bare_settings(), file.clone(), limits, || ()).unwrap();
        let (mut lit, mut video) = (SceneSamples::default(), VideoFile::open(file, limits).unwrap());
        (0..8).for_each(|_| lit.add(&video.next_picture().unwrap().unwrap().frame()));
        assert!(scene == lit, "dark for most of the time");
        let mut of_dark_box = LitScene::new(0.0);
        of_dark_box.lights = [[0.6; 2].as_slice(), &[0.08; 18]].concat();
        assert_eq!(of_dark_box.least_light(), None, "something bright covered it for a moment");
        of_dark_box.lights = [[0.6; 10].as_slice(), &[0.2; 10]].concat();
        assert_eq!(of_dark_box.least_light(), None, "dimmer light still shows the box");
    }

    #[test]
    fn only_bare_tools_need_the_recording() {
        let no_video = || Arc::new(tempfile::tempfile().unwrap());
        let collect = |settings| collect_scene(&settings, no_video(), MediaLimits::default(), || ());
        assert!(collect(settings()).unwrap() == SceneSamples::default());
        assert!(matches!(collect(bare_settings()), Err(ClockError::Media(_))));
    }
}
