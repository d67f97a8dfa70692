//! Makes a self-test report from a recording: tracks the tools and looks for the board in one pass.
//!
//! The command line and the service's confined child both go through here.

use crate::checks::self_test::{BoardWatch, ColourWatch, SelfTestEvidence, measure, verdict};
use crate::domain::self_test::SelfTestReport;
use crate::media::{MediaError, Picture, ReadAhead, VideoFile};
use crate::motion::quality::ports::Ports;
use crate::vision::camera::Board;
use crate::vision::frame::Frame;
use crate::vision::tracker::{
    MAX_WARM_UP_FRAMES, Marker, SceneSamples, SettingsProblem, ToolSpec, Tracker, TrackerSettings,
};
use crate::vision::trajectory::PathKind;

/// What a self-test needs besides the recording and the tracker's settings.
#[derive(Clone, Debug, PartialEq)]
pub struct SelfTestSetup {
    /// The board that lies in the box.
    pub board: Board,
    /// Distance from the end of the tape to the tool's tip, mm; 0 for a rod that ends flat where its tape ends.
    pub reach_mm: f64,
    /// RMS reprojection error of the stored calibration, pixels, where it is known.
    pub calibration_rms_px: Option<f64>,
    /// Trocar positions in the box's sessions; empty where they are unknown.
    pub ports: Ports,
}

/// Largest distance from the tape to the tool's tip, mm: jaws are 15 to 30 mm long.
pub const MAX_REACH_MM: f64 = 100.0;

/// Why a recording cannot be tested.
#[derive(Debug, thiserror::Error)]
pub enum SelfTestError {
    /// The recording cannot be decoded.
    #[error(transparent)]
    Media(#[from] MediaError),
    /// The recording cannot be tracked with these settings.
    #[error(transparent)]
    Settings(#[from] SettingsProblem),
}

/// Takes bare tools for rods, which end flat, without collar or jaws. A tool that touches with its jaws has a reach, and
/// keeps its sizes.
fn take_for_rods(tools: &mut [ToolSpec], reach_mm: f64) {
    if reach_mm == 0.0 {
        for tool in tools.iter_mut().filter(|tool| tool.is_bare()) {
            tool.marker = Marker::Shaft { collar_mm: None, jaw_mm: Some(0.0) };
        }
    }
}

/// Tests a box. `scene` shows the box to a tracker of tools without tape: see [`collect_scene`]. Calls `done` after each
/// frame with the number of frames so far and, if known, in all.
///
/// # Errors
/// The recording cannot be decoded, or its size differs from the camera's.
///
/// [`collect_scene`]: super::scene::collect_scene
pub fn test_video(
    video: VideoFile,
    scene: &SceneSamples,
    mut settings: TrackerSettings,
    asked: SelfTestSetup,
    mut done: impl FnMut(u64, Option<u64>),
) -> Result<SelfTestReport, SelfTestError> {
    let info = video.info();
    take_for_rods(&mut settings.tools, asked.reach_mm);
    let (camera, tools, samples) = (settings.camera, settings.tools.clone(), settings.samples.clone());
    let mut ahead = ReadAhead::new(video)?;
    let first: Vec<Frame<'_>> = ahead.first_pictures(MAX_WARM_UP_FRAMES)?.iter().map(Picture::frame).collect();
    let encoding = first.first().ok_or(MediaError::NoFrames)?.encoding;
    let tracker = Tracker::new(settings, info.width, info.height, encoding);
    let mut tracker = tracker.map_err(|problem| problem.of_shown(info.shown_size))?;
    tracker.learn_scene(scene);
    tracker.warm_up(&first);
    let (mut watch, mut colours) = (BoardWatch::new(asked.board, camera), ColourWatch::new(&samples, &tools, encoding));
    while let Some(seen) = ahead.next_picture()? {
        let frame = seen.frame();
        let has_tool = tracker.observe(&frame).tools.iter().any(|tool| tool.filtered.is_some());
        watch.search_frame(&frame, has_tool);
        if !has_tool {
            colours.search_frame(&frame);
        }
        done(frame.index + 1, info.frames_expected);
    }
    drop(ahead);
    let tracking = tracker.finish();
    let smoothed = tracking.trajectory(PathKind::Smoothed);
    let evidence = SelfTestEvidence {
        camera,
        tools: &tools,
        reach_mm: asked.reach_mm,
        quality: &tracking.quality,
        smoothed: &smoothed,
        ports: &asked.ports,
        false_colours: &colours.into_false_colours(),
    };
    let findings = measure(watch, &evidence);
    let verdict = verdict::judge(&findings, asked.calibration_rms_px);
    Ok(SelfTestReport::new(&findings, &verdict, &smoothed.tools))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_bare_tool_without_reach_is_a_rod() {
        let tool =
            |marker| ToolSpec { name: "left".into(), colour: "shaft".into(), side: None, diameter_mm: 5.0, marker };
        let (bare, band) =
            (Marker::Shaft { collar_mm: Some(8.0), jaw_mm: Some(28.0) }, Marker::Band { length_mm: None });
        let taken = |reach_mm| {
            let mut tools = [tool(bare), tool(band)];
            take_for_rods(&mut tools, reach_mm);
            tools.map(|tool| tool.marker)
        };
        assert_eq!(taken(0.0), [Marker::Shaft { collar_mm: None, jaw_mm: Some(0.0) }, band]);
        assert_eq!(taken(28.0), [bare, band]);
    }
}
