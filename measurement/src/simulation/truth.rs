//! The true pose and visibility of every tool at a time: the reference for measuring a tracker.

use nalgebra::{Point2, Point3, Vector3};

use super::board::{Prop, Scenery};
use super::shape::{RoundCone, TapedTube};
use super::tool::{SimulatedTool, ToolPose, side_of};
use super::world::World;
use crate::vision::space::{CameraPoint, Pixel};

/// The true pose of one tool at one time, and how much of its marker can be seen.
#[derive(Clone, Debug, PartialEq)]
pub struct TrueTool {
    /// The tool's name.
    pub tool: String,
    /// Tip in the camera frame, mm.
    pub tip_mm: Point3<f64>,
    /// Unit vector along the tube from the hand to the tip.
    pub axis: Vector3<f64>,
    /// Tip in the recorded frame, pixels; none if the tip is behind the camera.
    pub tip_px: Option<Point2<f64>>,
    /// Share of the marker's camera-facing surface that is in the picture and not hidden, 0 to 1. The marker is the
    /// band, or the last 40 mm of a bare shaft.
    pub visible: f64,
}

/// What may hide a tool, besides the other tools.
struct PropsBefore<'a> {
    fixed: &'a Scenery,
    moved: Vec<Prop>,
}

/// Every tool at this time. `tip_px` is the projected tip, whether or not it is hidden or outside the picture; none if
/// the tip is behind the camera. `visible` is the share of the marker's surface facing the camera, by projected area,
/// that is in the picture and not hidden by another tool or a prop.
pub fn at(world: &World, time_s: f64) -> Vec<TrueTool> {
    let poses = world.poses(time_s);
    let props = PropsBefore { fixed: &world.stages[world.stage_at(time_s)].scenery, moved: world.moved_props(time_s) };
    let of_tool = |(index, pose): (usize, &ToolPose)| TrueTool {
        tool: world.tools[index].name.to_owned(),
        tip_mm: pose.tip,
        axis: pose.axis,
        tip_px: world.rig.camera.project(CameraPoint(pose.tip)).map(|pixel| pixel.0),
        visible: visible_share(world, &props, &poses, index),
    };
    poses.iter().enumerate().map(of_tool).collect()
}

/// Samples the marker's surface on a grid of patches of equal size, each weighted by its projected area.
fn visible_share(world: &World, props: &PropsBefore, poses: &[ToolPose], index: usize) -> f64 {
    const ALONG: usize = 40;
    const AROUND: usize = 72;
    let (tool, pose) = (&world.tools[index], &poses[index]);
    let others: Vec<(&SimulatedTool, &ToolPose)> =
        world.tools.iter().zip(poses).enumerate().filter(|(i, _)| *i != index).map(|(_, pair)| pair).collect();
    let (mut facing, mut seen) = (0.0, 0.0);
    for patch in 0..ALONG * AROUND {
        let behind = (0.5 + (patch / AROUND) as f64) / ALONG as f64 * tool.design.marker_mm();
        let turn = std::f64::consts::TAU * (patch % AROUND) as f64 / AROUND as f64;
        let normal = side_of(pose.axis, turn);
        let point = pose.tip - pose.axis * behind + normal * (0.5 * tool.design.diameter_mm);
        let square = point.coords.norm_squared();
        let area = (-normal.dot(&point.coords)).max(0.0) / (square * square.sqrt());
        facing += area;
        if area > 0.0 && in_picture(world, point) && !is_hidden(props, &others, point) {
            seen += area;
        }
    }
    if facing > 0.0 { seen / facing } else { 0.0 }
}

fn in_picture(world: &World, point: Point3<f64>) -> bool {
    let camera = &world.rig.camera;
    let inside = |pixel: Pixel| {
        let (u, v) = (pixel.u(), pixel.v());
        u > -0.5 && v > -0.5 && u < f64::from(camera.width) - 0.5 && v < f64::from(camera.height) - 0.5
    };
    // Beyond the lens's widest angle, the distortion folds back into the picture.
    const WIDEST: f64 = 1.5;
    let Some(seen) = CameraPoint(point).normalised() else { return false };
    seen.0.coords.norm() < WIDEST && inside(camera.pixel_of(seen))
}

fn is_hidden(props: &PropsBefore, others: &[(&SimulatedTool, &ToolPose)], point: Point3<f64>) -> bool {
    const NEARER_MM: f64 = 1e-6;
    let (v, depth) = (point.coords / point.z, point.z - NEARER_MM);
    let before = |solid: &RoundCone| solid.meet(v).is_some_and(|met| met.depth < depth);
    let behind_tool = |(tool, pose): &(&SimulatedTool, &ToolPose)| {
        let mut tubes = std::iter::once(tool.design.tube(pose)).chain(tool.design.collar(pose));
        let behind_tube = |tube: TapedTube| tube.meet(v).is_some_and(|(met, _, _)| met.depth < depth);
        tubes.any(behind_tube) || tool.design.jaws(pose).iter().flatten().any(before)
    };
    let behind_prop = props.fixed.prop_before(v, depth).is_some() || props.moved.iter().any(|prop| before(&prop.solid));
    behind_prop || others.iter().any(behind_tool)
}
