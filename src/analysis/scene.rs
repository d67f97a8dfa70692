//! What a recording shows of its box: frames spread over it. From them the tracker of bare shafts learns what stands
//! still, and where the trocars are.

use std::fs::File;
use std::io::Seek;
use std::sync::Arc;

use super::clock::ClockError;
use crate::heap;
use crate::media::{MediaError, MediaLimits, Picture, VideoFile};
use crate::vision::tracker::{SCENE_FRAMES, SceneSamples, ToolSpec, TrackerSettings};

/// Collects frames for [`Tracker::learn_scene`]. Without a bare tool nothing is read, and there are no frames. Calls
/// `on_packet` for each packet of the recording that is read. Call this before the recording is opened for tracking:
/// only one decoder then needs memory at a time. Afterwards the file's position is its beginning.
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
    let mut scene = SceneSamples::default();
    if !settings.tools.iter().any(ToolSpec::is_bare) {
        return Ok(scene);
    }
    let add = |picture: &Picture| scene.add(&picture.frame());
    let shown = VideoFile::open(file.clone(), limits)?.show_spread(SCENE_FRAMES, add, &mut on_packet);
    (&*file).rewind()?;
    if shown.is_none() {
        scene = of_all_frames(VideoFile::open(file.clone(), limits)?, on_packet)?;
        (&*file).rewind()?;
    }
    heap::release_free_memory();
    Ok(scene)
}

/// Collects while decoding all frames.
fn of_all_frames(mut video: VideoFile, mut on_picture: impl FnMut()) -> Result<SceneSamples, MediaError> {
    let mut scene = SceneSamples::default();
    while let Some(picture) = video.next_picture()? {
        scene.add(&picture.frame());
        video.recycle(picture);
        on_picture();
    }
    Ok(scene)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::child::track::tests::settings;
    use crate::media::{SampleFormat, VideoSettings, VideoWriter};
    use crate::simulation::render::Renderer;
    use crate::simulation::{Scenario, Setup, Skill, World};
    use crate::vision::tracker::Marker;

    /// A recording of this many frames.
    fn recording(frames: u64) -> Arc<File> {
        let (width, height, fps) = (96, 64, 25.0);
        let world = World::new(&Setup { width, height, ..Setup::new(Scenario::Pegs, Skill::INTERMEDIATE, 5) });
        let file = tempfile::tempfile().unwrap();
        let settings = VideoSettings { width, height, fps, samples: SampleFormat::Yuv420, crf: 23 };
        let mut writer = VideoWriter::create(file.try_clone().unwrap(), settings).unwrap();
        let renderer = Renderer::new(&world);
        for index in 0..frames {
            let time_s = index as f64 / fps;
            writer.write(&renderer.render(time_s).frame(index, time_s)).unwrap();
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
        let (file, limits) = (recording(20), MediaLimits::default());
        let mut packets = 0;
        let scene = collect_scene(&bare_settings(), file.clone(), limits, || packets += 1).unwrap();
        assert!(packets >= 20, "{packets}");
        assert_eq!((&*file).stream_position().unwrap(), 0);
        let mut pictures = 0;
        let all = of_all_frames(VideoFile::open(file, limits).unwrap(), || pictures += 1).unwrap();
        assert!(scene == all && pictures == 20, "{pictures} frames"); // cells of pictures: not worth printing
        assert!(scene != SceneSamples::default());
    }

    #[test]
    fn only_bare_tools_need_the_recording() {
        let no_video = || Arc::new(tempfile::tempfile().unwrap());
        let collect = |settings| collect_scene(&settings, no_video(), MediaLimits::default(), || ());
        assert!(collect(settings()).unwrap() == SceneSamples::default());
        assert!(matches!(collect(bare_settings()), Err(ClockError::Media(_))));
    }
}
