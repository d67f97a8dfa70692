//! Two markerless systems as their authors wrote them: the references that the project's own tracking is measured
//! against.
//!
//! Both follow bare dark shafts with one camera. Their known faults are kept, so that the comparison shows them. Their
//! paths are for `trocar evaluate`, never for scores. Where a paper leaves something open, the file says what was
//! chosen.
//!
//! | system | mask | position |
//! |---|---|---|
//! | [`framework1`]: Framework 1 of the thesis (T 5.1) | changed and dark cells ([`mixture`]) | width of the shaft |
//! | [`zhou`]: Zhou & Payandeh (T 4.15–4.20) | dark in the red channel | planes as printed ([`planes_as_printed`]) |
//!
//! Expected faults of Framework 1: it loses a tool that rests or was there from the start, takes shadows and dark props
//! that move for tools, sees whole cells, and takes a leaning tool for one in the image plane. Of Zhou & Payandeh: it
//! takes all that is dark for a tool, sees whole pixels, and its tip lies too far along the axis.
//!
//! | step | file |
//! |---|---|
//! | mask of a frame | [`mixture`], [`zhou`], with the colours of [`rgb`] |
//! | borders and ends of a region | [`shaft_outline`] |
//! | which region is which tool | [`association`], with the Kalman filter of [`pair_filter`] |
//! | process noise of the filter | [`hand_motion`] |
//! | midline as a filtered line | [`midline`] |
//!
//! A pose states no error, because neither paper derives one: the samples of [`ReferenceTracker::finish`] have no
//! covariance. They have no velocity either, and a tool that is not seen on a frame has no sample there.

mod association;
mod framework1;
mod hand_motion;
mod midline;
mod mixture;
mod pair_filter;
mod planes_as_printed;
mod rgb;
mod shaft_outline;
#[cfg(test)]
mod testing;
mod zhou;

use nalgebra::{Point3, Vector3};

use crate::vision::camera::Camera;
use crate::vision::frame::Frame;
use crate::vision::segmentation::samples::ColourSamples;
use crate::vision::space::CameraPoint;
use crate::vision::trajectory::{Sample, SampleState, Trajectory};
use framework1::MotionAndDarkness;
use zhou::EdgePlanes;

/// Class of a shaft in a mask.
const SHAFT_CLASS: u8 = 1;

/// Minimum share of the picture that a large region covers: 900 of 921,600 pixels at 720p, a shaft of 24 × 38 pixels.
const MIN_REGION_SHARE: f64 = 0.001;

/// Maximum number of tools: both systems name tools by the two halves of the picture.
const MAX_TOOLS: usize = 2;

/// A system from the literature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReferenceMethod {
    /// Framework 1 of the thesis: motion and darkness, then the width.
    MotionAndDarkness,
    /// Zhou & Payandeh: the red channel, then the planes through the borders.
    EdgePlanes,
}

/// A bare shaft to follow.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceTool {
    /// The tool's name.
    pub name: String,
    /// Outer diameter, mm.
    pub diameter_mm: f64,
}

/// A tool on one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferencePose {
    /// Tip in the camera frame, mm.
    pub tip: Point3<f64>,
    /// Unit vector along the tube from the hand to the tip.
    pub axis: Vector3<f64>,
}

/// Why a reference system cannot be created.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ReferenceProblem {
    /// No tool, or more than the two halves of the picture can name.
    #[error("{0} bare shafts are given; a reference method follows one or two: correct `tools` in the annotations")]
    ToolCount(usize),
    /// A diameter that is no positive number.
    #[error("tool `{tool}`: its diameter is given as {diameter_mm} mm; it must be more than 0")]
    Diameter {
        /// The tool.
        tool: String,
        /// The value given, mm.
        diameter_mm: f64,
    },
    /// The camera was calibrated at another picture size.
    #[error(
        "the camera is calibrated for {}×{} pixels, but the recording is {}×{}; calibrate at the recorded size",
        camera.0, camera.1, frame.0, frame.1
    )]
    FrameSize {
        /// Width and height in the calibration.
        camera: (u32, u32),
        /// Width and height of the frames.
        frame: (u32, u32),
    },
}

/// The part that differs between the systems.
trait ReferenceSystem {
    /// The pose of each tool on the next frame, where the system finds it.
    fn observe(&mut self, frame: &Frame<'_>) -> Vec<Option<ReferencePose>>;
}

/// Follows bare shafts through a recording with one of the systems.
pub struct ReferenceTracker {
    camera: Camera,
    system: Box<dyn ReferenceSystem>,
    path: Trajectory,
}

impl ReferenceTracker {
    /// Creates a system for frames of this width and height. Of two tools, the first is the one that is seen first in
    /// the left half of the picture. Samples labelled `shaft` state how dark the shafts are; without any, a usual
    /// threshold is used.
    ///
    /// # Errors
    /// [`ReferenceProblem`] if the system cannot follow these tools with this camera.
    pub fn new(
        method: ReferenceMethod,
        camera: Camera,
        tools: &[ReferenceTool],
        samples: &ColourSamples,
        frame: (u32, u32),
    ) -> Result<Self, ReferenceProblem> {
        if tools.is_empty() || tools.len() > MAX_TOOLS {
            return Err(ReferenceProblem::ToolCount(tools.len()));
        }
        let is_possible = |tool: &&ReferenceTool| tool.diameter_mm.is_finite() && tool.diameter_mm > 0.0;
        if let Some(tool) = tools.iter().find(|tool| !is_possible(tool)) {
            return Err(ReferenceProblem::Diameter { tool: tool.name.clone(), diameter_mm: tool.diameter_mm });
        }
        if (camera.width, camera.height) != frame {
            return Err(ReferenceProblem::FrameSize { camera: (camera.width, camera.height), frame });
        }
        let radii_mm = tools.iter().map(|tool| 0.5 * tool.diameter_mm).collect();
        let system: Box<dyn ReferenceSystem> = match method {
            ReferenceMethod::MotionAndDarkness => Box::new(MotionAndDarkness::new(camera, radii_mm, samples)),
            ReferenceMethod::EdgePlanes => Box::new(EdgePlanes::new(camera, radii_mm)),
        };
        let names = tools.iter().map(|tool| tool.name.clone()).collect();
        let path = Trajectory { tools: names, samples: Vec::new(), frame_times_s: Vec::new(), cuts: Vec::new() };
        Ok(Self { camera, system, path })
    }

    /// The pose of each tool on the next frame, in the order of the tools. `None` where it is not found.
    pub fn observe(&mut self, frame: &Frame<'_>) -> Vec<Option<ReferencePose>> {
        let poses = self.system.observe(frame);
        self.path.frame_times_s.push(frame.time_s);
        for (tool, pose) in poses.iter().enumerate() {
            self.path.samples.extend(pose.map(|pose| Sample {
                frame: frame.index,
                time_s: frame.time_s,
                tool,
                tip_mm: pose.tip,
                velocity_mm_s: None,
                axis: Some(pose.axis),
                tip_px: self.camera.project(CameraPoint(pose.tip)).map(|pixel| pixel.0),
                covariance_mm2: None,
                state: SampleState::Observed,
            }));
        }
        poses
    }

    /// The path of all frames, as the tracker's own result has it.
    pub fn finish(self) -> Trajectory {
        self.path
    }
}

#[cfg(test)]
mod tests {
    use super::testing::{CAMERA, DARK, FRAME_S, GreyPicture, no_samples};
    use super::*;
    use crate::vision::tube::Tube;

    const SIZE: (u32, u32) = (CAMERA.width, CAMERA.height);

    fn tool(name: &str, diameter_mm: f64) -> ReferenceTool {
        ReferenceTool { name: name.into(), diameter_mm }
    }

    fn problem(tools: &[ReferenceTool], frame: (u32, u32)) -> Option<ReferenceProblem> {
        ReferenceTracker::new(ReferenceMethod::EdgePlanes, CAMERA, tools, &no_samples(), frame).err()
    }

    #[test]
    fn tools_and_frames_that_cannot_work_are_refused() {
        let (good, flat) = (tool("left", 5.0), tool("flat", 0.0));
        assert_eq!(problem(std::slice::from_ref(&good), SIZE), None);
        assert_eq!(problem(&[], SIZE), Some(ReferenceProblem::ToolCount(0)));
        assert_eq!(problem(&[good.clone(), good.clone(), good.clone()], SIZE), Some(ReferenceProblem::ToolCount(3)));
        assert!(matches!(problem(&[flat], SIZE), Some(ReferenceProblem::Diameter { .. })));
        let other = problem(&[good], (640, 480)).unwrap().to_string();
        assert!(other.contains("320×240") && other.contains("640×480"), "{other}");
    }

    #[test]
    fn a_path_has_the_tool_s_name_each_frame_s_time_and_no_stated_error() {
        let mut tracker =
            ReferenceTracker::new(ReferenceMethod::EdgePlanes, CAMERA, &[tool("bare", 10.0)], &no_samples(), SIZE)
                .unwrap();
        let tube = Tube { tip: Point3::new(-10.0, 5.0, 130.0), axis: Vector3::x(), radius: 5.0 };
        let picture = GreyPicture::of(&[(tube, DARK)]);
        for frame in 0..6 {
            tracker.observe(&picture.frame(frame, frame as f64 * FRAME_S));
        }
        let path = tracker.finish();
        assert_eq!((path.tools, path.frame_times_s.len()), (vec!["bare".to_owned()], 6));
        assert_eq!(path.samples.iter().map(|sample| sample.frame).collect::<Vec<_>>(), [3, 4, 5]);
        for sample in &path.samples {
            assert!(sample.is_observed() && sample.covariance_mm2.is_none() && sample.velocity_mm_s.is_none());
            let seen = CAMERA.project(CameraPoint(tube.tip)).unwrap().0;
            assert!((sample.tip_px.unwrap() - seen).norm() < 4.0, "{sample:?}");
        }
    }
}
