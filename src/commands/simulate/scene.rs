//! Writes a simulated scene to a folder, in the file formats of [`crate::domain::files`].

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use anyhow::Context;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::bare;
use crate::checks::evaluation::{Truth, TruthFrame, TruthTool};
use crate::domain::files::annotations::{AnnotationsFile, LabelledRectangle, ToolEntry, View as FileView};
use crate::domain::files::camera::CameraFile;
use crate::domain::files::truth::TruthFile;
use crate::media::{SampleFormat, TICKS_PER_S, VideoSettings, VideoWriter};
use crate::simulation::checkerboard;
use crate::simulation::marks::{self, SimulatedMark};
use crate::simulation::render::{Chroma, Photo, Photographer, Renderer};
use crate::simulation::schedule::{Evenness, frame_times};
use crate::simulation::tool::SimulatedMarker;
use crate::simulation::{RigView, Setup, World, truth};

/// Description of a scene to write.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneOrder {
    /// What to simulate.
    pub setup: Setup,
    /// Number of frames in the clip; `None`: until the task is done.
    pub frames: Option<usize>,
    /// Nominal frame rate, Hz.
    pub fps: f64,
    /// Whether frames are evenly spaced in time.
    pub evenness: Evenness,
    /// Pixel format of the clip.
    pub samples: SampleFormat,
    /// Compression: the encoder's constant rate factor, 0 to 51.
    pub crf: u8,
    /// Number of checkerboard photos.
    pub boards: usize,
    /// Number of photos with a bent board.
    pub bent: usize,
}

impl SceneOrder {
    /// The whole task at 25 frames per second, with 18 photos of a flat board.
    pub fn new(setup: Setup) -> Self {
        Self {
            setup,
            frames: None,
            fps: 25.0,
            evenness: Evenness::Even,
            samples: SampleFormat::Yuv420,
            crf: 20,
            boards: 18,
            bent: 0,
        }
    }
}

/// Callback for progress: what is being written, the number done, the total number.
pub type SceneProgress<'a> = &'a mut dyn FnMut(&'static str, usize, usize);

/// File name of the clip in the folder.
pub const CLIP: &str = "clip.mp4";

/// Writes the scene and returns the clip's frame times, s. An interrupted run may leave incomplete files.
pub fn write_scene(folder: &Path, order: &SceneOrder, progress: SceneProgress) -> anyhow::Result<Vec<f64>> {
    fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let world = World::new(&order.setup);
    let count = order.frames.unwrap_or_else(|| (world.duration_s * order.fps).ceil() as usize).max(1);
    let times = frame_times(count, order.fps, order.evenness, order.setup.seed, f64::from(TICKS_PER_S));
    write_text(&folder.join("camera.json"), &CameraFile::from(world.rig.camera).to_json())?;
    write_boards(&folder.join("boards"), &world, order, progress)?;
    write_text(&folder.join("truth.json"), &TruthFile::new(order.fps, &truth_of(&world, &times)).to_json())?;
    let annotations = match order.setup.marker {
        SimulatedMarker::Band => annotations_of(&world, &order.setup, &times)?,
        SimulatedMarker::Bare => {
            bare::write_empty_box(folder, &world)?;
            bare::annotations_of(&world, &order.setup, &times)?
        }
    };
    write_text(&folder.join("annotations.json"), &annotations)?;
    write_clip(&folder.join(CLIP), &world, order, &times, progress)?;
    Ok(times)
}

fn write_clip(
    path: &Path,
    world: &World,
    order: &SceneOrder,
    times: &[f64],
    progress: SceneProgress,
) -> anyhow::Result<()> {
    let settings = VideoSettings {
        width: order.setup.width,
        height: order.setup.height,
        fps: order.fps,
        samples: order.samples,
        crf: order.crf,
    };
    let in_clip = || format!("cannot write {}", path.display());
    let file = File::create(path).with_context(in_clip)?;
    let mut writer = VideoWriter::create(file, settings).with_context(in_clip)?;
    let renderer = Renderer::with_chroma(world, chroma_of(order.samples));
    for (index, time_s) in times.iter().enumerate() {
        let picture = renderer.render(*time_s);
        writer.write(&picture.frame(index as u64, *time_s)).with_context(in_clip)?;
        progress("frames", index + 1, times.len());
    }
    writer.finish().with_context(in_clip)
}

fn chroma_of(samples: SampleFormat) -> Chroma {
    match samples {
        SampleFormat::Yuv420 | SampleFormat::Yuv420Deep => Chroma::Quarter,
        SampleFormat::Yuv422 => Chroma::Half,
        SampleFormat::Yuv444 | SampleFormat::Yuv444Deep => Chroma::Full,
    }
}

fn write_boards(folder: &Path, world: &World, order: &SceneOrder, progress: SceneProgress) -> anyhow::Result<()> {
    if order.boards == 0 {
        return Ok(());
    }
    fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let photographer = Photographer::new(&world.rig);
    let held = checkerboard::poses(&world.rig, order.setup.rig, order.boards, order.bent);
    for (index, held) in held.iter().enumerate() {
        let photo = checkerboard::photo(&photographer, &world.rig.lighting, held, index as u64);
        write_photo(&folder.join(format!("board_{:02}.jpg", index + 1)), &photo)?;
        progress("boards", index + 1, order.boards);
    }
    Ok(())
}

pub(super) fn write_photo(path: &Path, photo: &Photo) -> anyhow::Result<()> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, 94)
        .write_image(&photo.rgb, photo.width, photo.height, ExtendedColorType::Rgb8)
        .with_context(|| format!("cannot encode {}", path.display()))?;
    fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

fn truth_of(world: &World, times: &[f64]) -> Truth {
    let frame = |(index, time_s): (usize, &f64)| TruthFrame {
        frame: index as u64,
        time_s: *time_s,
        tools: truth::at(world, *time_s).into_iter().map(TruthTool::from).collect(),
    };
    Truth { frames: times.iter().enumerate().map(frame).collect() }
}

fn annotations_of(world: &World, setup: &Setup, times: &[f64]) -> anyhow::Result<String> {
    let entry = |tool: &crate::simulation::tool::SimulatedTool| ToolEntry {
        tool: tool.name.to_owned(),
        colour: tool.design.band.map(|band| band.tape.name.to_owned()).filter(|name| name != tool.name),
        side: None,
        diameter_mm: Some(tool.design.diameter_mm),
        band_length_mm: tool.design.band.map(|band| band.length_mm),
        marker: None,
    };
    let file = AnnotationsFile {
        needs: None,
        empty_box: None,
        tool_diameter_mm: Some(setup.diameter_mm),
        band_length_mm: None,
        view: Some(view_of(setup.view)),
        video: Some(CLIP.to_owned()),
        tools: world.tools.iter().map(entry).collect(),
        labels: marks::mark_recording(world, times).into_iter().map(rectangle).collect(),
    };
    Ok(serde_json::to_string_pretty(&file)? + "\n")
}

pub(super) fn view_of(view: RigView) -> FileView {
    match view {
        RigView::Top => FileView::Top,
        RigView::Side => FileView::Side,
    }
}

pub(super) fn rectangle(mark: SimulatedMark) -> LabelledRectangle {
    let SimulatedMark { frame, label, x, y, w, h } = mark;
    LabelledRectangle { frame: frame as u64, label: label.to_owned(), x, y, w, h, stroke: None }
}

fn write_text(path: &PathBuf, text: &str) -> anyhow::Result<()> {
    fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}
