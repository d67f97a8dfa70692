//! `trocar track --debug-dir`: draws pictures of chosen frames, one per stage, that show why a frame failed.
//!
//! | file | shows |
//! |---|---|
//! | `frame_000123_1_colours.png` | cells with a tool's colour, searched areas, regions taken for its band |
//! | `frame_000123_2_edges_tool1_fit1.png` | one per fit: probes of the last pass, edges found, fitted tube |
//! | `frame_000123_3_result.png` | outline, axis and tip, or the reason why there are none |

mod canvas;
mod pictures;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};

use super::{CommandFailure, about};
use crate::vision::frame::Frame;
use crate::vision::tracker::{FrameReport, FrameTrace};
pub(super) use pictures::DebugScene;

/// Limit of drawn frames: about 500 MB of pictures at 1080p.
const MAX_FRAMES: usize = 100;

/// Frames to draw, and the folder for the pictures.
#[derive(clap::Args, Default)]
pub(super) struct DebugArgs {
    /// Draw pictures of chosen frames, one per stage, into this new or empty folder (PNG; at most 100 frames).
    #[arg(long = "debug-dir", value_name = "DIR")]
    dir: Option<PathBuf>,
    /// With --debug-dir: draw every Nth frame.
    #[arg(long = "debug-every", value_name = "N", default_value_t = 50, requires = "dir",
        value_parser = clap::value_parser!(u64).range(1..))]
    every: u64,
    /// With --debug-dir: draw only these frames, counted from 0, such as 12,40,41.
    #[arg(
        long = "debug-frames",
        value_name = "LIST",
        value_delimiter = ',',
        requires = "dir",
        conflicts_with = "every"
    )]
    frames: Vec<u64>,
}

/// Draws the chosen frames.
pub(super) struct DebugPictures {
    folder: PathBuf,
    every: u64,
    frames: Vec<u64>,
    /// Frames drawn so far. A damaged recording is tracked twice; the second pass overwrites the pictures of the first.
    drawn: BTreeSet<u64>,
}

impl DebugPictures {
    /// Creates the folder. `None` without `--debug-dir`.
    pub(super) fn open(args: &DebugArgs) -> Result<Option<Self>, CommandFailure> {
        let Some(folder) = &args.dir else { return Ok(None) };
        std::fs::create_dir_all(folder).map_err(|e| about(folder, e))?;
        if std::fs::read_dir(folder).map_err(|e| about(folder, e))?.next().is_some() {
            let what = "is not empty; pictures of two runs would be mixed: name a new or an empty folder";
            return Err(about(folder, anyhow!(what)));
        }
        check_writable(folder).map_err(|e| about(folder, e))?;
        Ok(Some(Self {
            folder: folder.clone(),
            every: args.every,
            frames: args.frames.clone(),
            drawn: BTreeSet::new(),
        }))
    }

    /// True if this frame is to be drawn.
    pub(super) fn wants(&self, frame: u64) -> bool {
        let chosen =
            if self.frames.is_empty() { frame.is_multiple_of(self.every) } else { self.frames.contains(&frame) };
        chosen && (self.drawn.len() < MAX_FRAMES || self.drawn.contains(&frame))
    }

    /// Draws a frame.
    pub(super) fn draw(
        &mut self,
        scene: &DebugScene,
        frame: &Frame<'_>,
        report: &FrameReport,
        trace: &FrameTrace,
    ) -> anyhow::Result<()> {
        for (name, canvas) in scene.pictures(frame, report, trace) {
            let path = self.folder.join(format!("frame_{:06}_{name}.png", frame.index));
            canvas.save(&path).with_context(|| format!("writing {}", path.display()))?;
        }
        self.drawn.insert(frame.index);
        Ok(())
    }

    /// A line for people: how many frames were drawn, and where.
    pub(super) fn report(&self) -> String {
        let folder = self.folder.display();
        match self.drawn.len() {
            0 => format!("debug: none of the chosen frames is in the recording; {folder} is empty"),
            MAX_FRAMES => {
                format!("debug: {MAX_FRAMES} frames drawn in {folder}, the limit; choose others with --debug-frames")
            }
            1 => format!("debug: 1 frame drawn in {folder}"),
            drawn => format!("debug: {drawn} frames drawn in {folder}"),
        }
    }
}

/// Checks that the folder is writable before the long tracking starts.
fn check_writable(folder: &Path) -> std::io::Result<()> {
    let probe = folder.join(".writable");
    std::fs::write(&probe, [])?;
    std::fs::remove_file(probe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawn_frames_are_drawn_again_and_their_number_is_limited() {
        let all = MAX_FRAMES as u64;
        let folder = PathBuf::from("pictures");
        let mut pictures = DebugPictures { folder, every: 2, frames: Vec::new(), drawn: BTreeSet::new() };
        assert!(pictures.wants(8) && !pictures.wants(9));
        pictures.drawn = (0..all).map(|index| 2 * index).collect();
        assert!(pictures.wants(8) && !pictures.wants(9) && !pictures.wants(2 * all));
        assert!(pictures.report().contains("100 frames drawn in pictures, the limit"), "{}", pictures.report());
    }
}
