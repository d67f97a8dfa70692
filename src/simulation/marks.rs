//! What an instructor would mark: small rectangles on the tapes, the shafts, the jaws and the empty box.

use nalgebra::Point3;

use super::random::Dice;
use super::tool::ToolPose;
use super::truth;
use super::world::World;
use crate::pipeline::space::{CameraPoint, Pixel};

/// One rectangle, pixels of the recorded frame; `x`, `y` is the first pixel inside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mark {
    /// Position in the list of frame times.
    pub frame: usize,
    /// Tape's name, `shaft`, `jaw` or `background`.
    pub label: &'static str,
    /// First column.
    pub x: i64,
    /// First row.
    pub y: i64,
    /// Columns.
    pub w: i64,
    /// Rows.
    pub h: i64,
}

/// Frames that are marked.
const FRAMES: usize = 5;
const BACKGROUNDS: usize = 9;

/// Marks on a few frames spread over a recording whose frames have these times, s.
pub fn of_recording(world: &World, times_s: &[f64]) -> Vec<Mark> {
    let mut dice = Dice::new(world.seed, "marks");
    let last = times_s.len().saturating_sub(1);
    let mut frames: Vec<usize> = (0..FRAMES).map(|i| (last * (2 * i + 1)) / (2 * FRAMES)).collect();
    frames.dedup();
    let on_frame = |frame: usize| times_s.get(frame).map(|time_s| of_frame(world, &mut dice, frame, *time_s));
    frames.into_iter().filter_map(on_frame).flatten().collect()
}

fn of_frame(world: &World, dice: &mut Dice, frame: usize, time_s: f64) -> Vec<Mark> {
    let poses = world.poses(time_s);
    let visible = truth::at(world, time_s);
    let mut marks = Vec::new();
    for (tool, pose) in world.tools.iter().zip(&poses) {
        let name = tool.design.tape.name;
        if !visible.iter().any(|t| t.tool == name && t.visible > 0.98) {
            continue; // an instructor marks what is plain to see
        }
        let (band, radius) = (tool.design.band_mm, 0.5 * tool.design.diameter_mm);
        let inside = [(0.25, name), (0.5, name), (0.75, name), (1.6, "shaft"), (2.2, "shaft")];
        let on_tube = inside.map(|(share, label)| on_axis(world, pose, share * band, radius, label, frame));
        let jaw = on_axis(world, pose, -0.25 * tool.design.jaw_mm, 0.5 * radius, "jaw", frame);
        marks.extend(on_tube.into_iter().chain([jaw]).flatten());
    }
    marks.extend((0..BACKGROUNDS).filter_map(|_| background(world, &poses, dice, frame)));
    marks
}

/// The largest square round a point of the axis that stays on the tube, with a fifth of its width to spare.
fn on_axis(
    world: &World,
    pose: &ToolPose,
    behind: f64,
    radius: f64,
    label: &'static str,
    frame: usize,
) -> Option<Mark> {
    let camera = &world.rig.camera;
    let point = pose.tip - pose.axis * behind;
    let seen = camera.project(CameraPoint(point))?;
    // A square on a slanted strip must be √2 smaller than the strip is wide.
    let half = (0.8 * radius * camera.fx / point.z / std::f64::consts::SQRT_2).floor() as i64;
    let mark = centred(seen, half.max(1), label, frame);
    inside_picture(world, &mark).then_some(mark)
}

/// A rectangle somewhere in the box, away from every tool.
fn background(world: &World, poses: &[ToolPose], dice: &mut Dice, frame: usize) -> Option<Mark> {
    const TRIES: usize = 50;
    let camera = &world.rig.camera;
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    (0..TRIES).find_map(|_| {
        let half = (dice.within(0.008, 0.022) * width) as i64;
        let middle = Pixel::new(dice.within(0.03, 0.97) * width, dice.within(0.04, 0.96) * height);
        let mark = centred(middle, half.max(2), "background", frame);
        let clear = distance_to_tools(world, poses, middle) > 1.5 * half as f64 + 0.03 * width;
        (clear && inside_picture(world, &mark)).then_some(mark)
    })
}

/// Distance from a pixel to the nearest point of any tool's axis, pixels.
fn distance_to_tools(world: &World, poses: &[ToolPose], pixel: Pixel) -> f64 {
    const STEPS: usize = 60;
    let camera = &world.rig.camera;
    let on_axis =
        |pose: &ToolPose, step: usize| -> Point3<f64> { pose.grip - pose.axis * (step as f64 / STEPS as f64 * 160.0) };
    let points = poses.iter().flat_map(|pose| (0..STEPS).map(move |step| on_axis(pose, step)));
    let seen = points.filter_map(|point| camera.project(CameraPoint(point)));
    seen.map(|p| (p.0 - pixel.0).norm()).fold(f64::INFINITY, f64::min)
}

fn centred(middle: Pixel, half: i64, label: &'static str, frame: usize) -> Mark {
    let (x, y) = (middle.u().round() as i64 - half, middle.v().round() as i64 - half);
    Mark { frame, label, x, y, w: 2 * half + 1, h: 2 * half + 1 }
}

fn inside_picture(world: &World, mark: &Mark) -> bool {
    let (width, height) = (i64::from(world.rig.camera.width), i64::from(world.rig.camera.height));
    mark.x >= 0 && mark.y >= 0 && mark.x + mark.w <= width && mark.y + mark.h <= height
}
