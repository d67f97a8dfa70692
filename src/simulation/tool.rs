//! A laparoscopic grasper: its sizes and materials, and the positions of its parts in a pose.

use nalgebra::{Point3, Vector3};

use super::light::{Material, Rgb};
use super::motion::{Oscillation, ReachSum};
use super::rig::Rig;
use super::shape::{RoundCone, TapedTube};

/// Difference in diameter between the taped and the bare tube, mm: two layers of 0.06 mm vinyl.
pub const TAPE_STEP_MM: f64 = 0.12;

/// Coloured tape that marks a tool; its name is the tool's name, unless both tools have the same tape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TapeDesign {
    /// Name on the command line and in every file.
    pub name: &'static str,
    /// Matt reflectance.
    pub colour: Rgb,
}

impl TapeDesign {
    /// Every tape.
    pub const ALL: [TapeDesign; 6] = [
        TapeDesign { name: "orange", colour: [0.86, 0.17, 0.012] },
        TapeDesign { name: "cyan", colour: [0.012, 0.34, 0.56] },
        TapeDesign { name: "magenta", colour: [0.66, 0.03, 0.29] },
        TapeDesign { name: "lime", colour: [0.28, 0.66, 0.03] },
        TapeDesign { name: "yellow", colour: [0.88, 0.66, 0.02] },
        TapeDesign { name: "violet", colour: [0.19, 0.06, 0.45] },
    ];

    /// The tape of this name.
    pub fn named(name: &str) -> Option<TapeDesign> {
        Self::ALL.into_iter().find(|t| t.name == name)
    }

    /// The tape's surface: half-glossy vinyl.
    pub fn material(&self) -> Material {
        Material { matt: self.colour, gloss: 0.3, sharpness: 34, mirror: 0.02 }
    }
}

/// Sizes of one tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolDesign {
    /// Its tape.
    pub tape: TapeDesign,
    /// Outer diameter over the tape, mm.
    pub diameter_mm: f64,
    /// Length of the tape from the distal end of the tube, mm.
    pub band_mm: f64,
    /// From the distal end of the tube to the point of the closed jaws, mm; 0 for a rod without jaws.
    pub jaw_mm: f64,
}

/// A tool in a hand: a design, a fixed fulcrum, and the hand's motion.
#[derive(Clone, Debug)]
pub struct SimulatedTool {
    /// Its name: that of its tape, or `left` and `right` if both tools have the same tape.
    pub name: &'static str,
    /// Its sizes and tape.
    pub design: ToolDesign,
    /// The trocar: the axis passes through this point at every time. Camera frame, mm.
    pub fulcrum: Point3<f64>,
    /// Intended position of the closed jaws' point; board frame, mm.
    pub aim: ReachSum<Vector3<f64>>,
    /// Angle between the jaws, rad.
    pub opening: ReachSum<f64>,
    /// Rotation about the axis, rad.
    pub roll: ReachSum<f64>,
    /// Unintended motion of the hand; board frame, mm.
    pub unsteadiness: Vec<Oscillation>,
}

/// The pose of a tool; camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolPose {
    /// Centre of the tube's cross-section at the distal end of the band, mm.
    pub tip: Point3<f64>,
    /// Unit vector from the hand to the tip.
    pub axis: Vector3<f64>,
    /// The closed jaws' point, mm.
    pub grip: Point3<f64>,
    /// Length of the tube from the tip to beyond the fulcrum, mm.
    pub length_mm: f64,
    /// Angle between the jaws, rad.
    pub opening: f64,
    /// Turn about the axis, rad.
    pub roll: f64,
}

impl SimulatedTool {
    /// The tool's pose at a time.
    pub fn pose(&self, rig: &Rig, time_s: f64) -> ToolPose {
        const OUTSIDE_MM: f64 = 60.0; // of tube behind the trocar
        let unsteady: Vector3<f64> = self.unsteadiness.iter().map(|o| o.at(time_s)).sum();
        let grip = rig.camera_from_board * Point3::from(self.aim.at(time_s) + unsteady);
        let axis = (grip - self.fulcrum).normalize();
        let tip = grip - axis * self.design.jaw_mm;
        let length_mm = (tip - self.fulcrum).norm() + OUTSIDE_MM;
        ToolPose { tip, axis, grip, length_mm, opening: self.opening.at(time_s), roll: self.roll.at(time_s) }
    }
}

impl ToolDesign {
    /// The taped tube.
    pub fn tube(&self, pose: &ToolPose) -> TapedTube {
        let radius = 0.5 * self.diameter_mm;
        TapedTube::new(pose.tip, pose.axis, (radius, radius - 0.5 * TAPE_STEP_MM), self.band_mm, pose.length_mm)
    }

    /// Hinge and both halves of the jaws, if it has any.
    pub fn jaws(&self, pose: &ToolPose) -> Option<[RoundCone; 3]> {
        if self.jaw_mm == 0.0 {
            return None;
        }
        let (width, hinge) = (self.diameter_mm, pose.tip + pose.axis * (0.22 * self.jaw_mm));
        let side = side_of(pose.axis, pose.roll);
        let half = |sign: f64| {
            let angle = 0.5 * pose.opening * sign;
            let towards = pose.axis * angle.cos() + side * angle.sin();
            let from = hinge + side * (sign * 0.11 * width);
            RoundCone {
                a: from,
                radius_a: 0.2 * width,
                b: from + towards * (0.74 * self.jaw_mm),
                radius_b: 0.09 * width,
            }
        };
        let block = RoundCone { a: pose.tip, radius_a: 0.34 * width, b: hinge, radius_b: 0.27 * width };
        Some([block, half(1.0), half(-1.0)])
    }

    /// The tool as rods, for its shadow: the tube, and the jaws where it has any.
    pub fn shadow_rods(&self, pose: &ToolPose) -> impl Iterator<Item = RoundCone> + use<> {
        let behind = pose.tip - pose.axis * pose.length_mm;
        let (tip, width) = (pose.tip, self.diameter_mm);
        let jaws = self.jaws(pose).map(|[_, one, other]| {
            let end = nalgebra::center(&one.b, &other.b);
            RoundCone { a: tip, radius_a: 0.3 * width, b: end, radius_b: 0.16 * width }
        });
        std::iter::once(RoundCone::capsule(tip, behind, 0.5 * width)).chain(jaws)
    }
}

/// A unit vector across the axis, rotated about it by `roll`.
pub fn side_of(axis: Vector3<f64>, roll: f64) -> Vector3<f64> {
    let level = axis.cross(&Vector3::z()).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    level * roll.cos() + axis.cross(&level) * roll.sin()
}

/// The jaws' steel.
pub const STEEL: Material = Material { matt: [0.1, 0.1, 0.105], gloss: 0.8, sharpness: 36, mirror: 0.42 };

/// The bare tube: black polymer, polished.
pub const BLACK: Material = Material { matt: [0.012, 0.012, 0.013], gloss: 0.85, sharpness: 90, mirror: 0.035 };

/// The tube's end face.
pub const FACE: Material = Material { matt: [0.09, 0.09, 0.095], gloss: 0.2, sharpness: 20, mirror: 0.1 };
