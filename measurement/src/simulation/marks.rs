//! Marks as an instructor would set them: small rectangles on the tapes, the shafts, the jaws and the empty box. Of
//! tools without tape, only shafts are marked.

use nalgebra::Point3;

use super::tool::{SimulatedTool, ToolPose};
use super::truth;
use super::world::World;
use crate::random::Dice;
use crate::vision::space::{CameraPoint, Pixel};

/// One rectangle, pixels of the recorded frame; `x`, `y` is the first pixel inside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimulatedMark {
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

/// Number of frames where each tool is marked, and number of frames where the empty box is marked.
const MARKED_FRAMES: usize = 5;
/// Number of frames that an instructor browses to find these frames.
const BROWSED_FRAMES: usize = 40;
/// Rectangles on the empty box per frame.
const BACKGROUNDS: usize = 9;
/// Minimum visible share of a marker that an instructor marks.
const MIN_VISIBLE_SHARE: f64 = 0.98;

/// Marks on a few frames spread over a recording with these frame times, s; sorted by frame.
pub fn mark_recording(world: &World, times_s: &[f64]) -> Vec<SimulatedMark> {
    let leafed = spread(&(0..times_s.len()).collect::<Vec<_>>(), BROWSED_FRAMES);
    let seen: Vec<Vec<f64>> =
        leafed.iter().map(|f| truth::at(world, times_s[*f]).iter().map(|t| t.visible).collect()).collect();
    let mut marks = Vec::new();
    for tool in 0..world.tools.len() {
        let looks = leafed.iter().zip(&seen);
        let plain: Vec<usize> =
            looks.filter(|(_, seen)| seen[tool] > MIN_VISIBLE_SHARE).map(|(frame, _)| *frame).collect();
        marks.extend(spread(&plain, MARKED_FRAMES).into_iter().flat_map(|f| on_tool(world, tool, f, times_s[f])));
    }
    let mut dice = Dice::new(world.seed, "marks");
    for frame in spread(&leafed, MARKED_FRAMES) {
        let poses = world.poses(times_s[frame]);
        marks.extend((0..BACKGROUNDS).filter_map(|_| background(world, &poses, &mut dice, frame)));
    }
    marks.sort_by_key(|mark| mark.frame);
    marks
}

/// At most `count` of these, evenly spread.
fn spread(all: &[usize], count: usize) -> Vec<usize> {
    if all.len() <= count {
        return all.to_vec();
    }
    (0..count).map(|i| all[(all.len() * (2 * i + 1)) / (2 * count)]).collect()
}

fn on_tool(world: &World, tool: usize, frame: usize, time_s: f64) -> Vec<SimulatedMark> {
    const BARE_SHARES: [f64; 4] = [0.2, 0.4, 0.6, 0.8];
    let (design, pose) = (&world.tools[tool].design, world.poses(time_s)[tool]);
    let (marker_mm, radius) = (design.marker_mm(), 0.5 * design.diameter_mm);
    let on_tube = |(share, label)| on_axis(world, &pose, share * marker_mm, radius, label, frame);
    let Some(band) = design.band else {
        return BARE_SHARES.into_iter().filter_map(|share| on_tube((share, "shaft"))).collect();
    };
    let name = band.tape.name;
    let along = [(0.25, name), (0.5, name), (0.75, name), (1.6, "shaft"), (2.2, "shaft")];
    let has_jaw = design.jaw_mm > 0.0;
    let jaw = has_jaw.then(|| on_axis(world, &pose, -0.25 * design.jaw_mm, 0.5 * radius, "jaw", frame));
    along.map(on_tube).into_iter().chain(jaw).flatten().collect()
}

/// The largest square around a point of the axis that stays on the tube, with a margin of a fifth of the tube's width.
fn on_axis(
    world: &World,
    pose: &ToolPose,
    behind: f64,
    radius: f64,
    label: &'static str,
    frame: usize,
) -> Option<SimulatedMark> {
    let camera = &world.rig.camera;
    let point = pose.tip - pose.axis * behind;
    let seen = camera.project(CameraPoint(point))?;
    // A square on a slanted strip must be √2 smaller than the strip is wide.
    let half = (0.8 * radius * camera.fx / point.z / std::f64::consts::SQRT_2).floor() as i64;
    let mark = centred(seen, half.max(1), label, frame);
    inside_picture(world, &mark).then_some(mark)
}

/// A random rectangle in the box, away from every tool.
fn background(world: &World, poses: &[ToolPose], dice: &mut Dice, frame: usize) -> Option<SimulatedMark> {
    const TRIES: usize = 50;
    let camera = &world.rig.camera;
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    (0..TRIES).find_map(|_| {
        let half = (dice.within(0.008, 0.022) * width) as i64;
        let middle = Pixel::new(dice.within(0.03, 0.97) * width, dice.within(0.04, 0.96) * height);
        let mark = centred(middle, half.max(2), "background", frame);
        let clear = is_clear(world, poses, middle, 1.5 * half as f64 + 0.03 * width);
        (clear && inside_picture(world, &mark)).then_some(mark)
    })
}

/// True if no tool is within `gap` pixels of a pixel: the axis of a taped one, the outline of a bare one.
fn is_clear(world: &World, poses: &[ToolPose], pixel: Pixel, gap: f64) -> bool {
    let camera = &world.rig.camera;
    let ray = camera.normalised_of(pixel).map(|seen| seen.ray().normalize());
    world.tools.iter().zip(poses).all(|(SimulatedTool { design, .. }, pose)| match (design.band, ray) {
        (Some(_), _) => distance_to_axis(world, pose, pixel) > gap,
        (None, Some(ray)) => !design.shadow_rods(pose).any(|rod| rod.may_meet(ray, gap / camera.fx)),
        (None, None) => false,
    })
}

/// Distance from a pixel to the nearest point of a tool's axis, pixels.
fn distance_to_axis(world: &World, pose: &ToolPose, pixel: Pixel) -> f64 {
    const STEPS: usize = 60;
    let camera = &world.rig.camera;
    let on_axis = |step: usize| -> Point3<f64> { pose.grip - pose.axis * (step as f64 / STEPS as f64 * 160.0) };
    let seen = (0..STEPS).filter_map(|step| camera.project(CameraPoint(on_axis(step))));
    seen.map(|p| (p.0 - pixel.0).norm()).fold(f64::INFINITY, f64::min)
}

fn centred(middle: Pixel, half: i64, label: &'static str, frame: usize) -> SimulatedMark {
    let (x, y) = (middle.u().round() as i64 - half, middle.v().round() as i64 - half);
    SimulatedMark { frame, label, x, y, w: 2 * half + 1, h: 2 * half + 1 }
}

fn inside_picture(world: &World, mark: &SimulatedMark) -> bool {
    let (width, height) = (i64::from(world.rig.camera.width), i64::from(world.rig.camera.height));
    mark.x >= 0 && mark.y >= 0 && mark.x + mark.w <= width && mark.y + mark.h <= height
}
