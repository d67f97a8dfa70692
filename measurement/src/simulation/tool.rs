//! A laparoscopic grasper with or without tape: its sizes and materials, and the positions of its parts in a pose.

use nalgebra::{Point3, Vector3};

use super::light::{Material, Rgb};
use super::motion::{Oscillation, ReachSum};
use super::rig::Rig;
use super::shape::{RoundCone, TapedTube};

/// Difference in diameter between the taped and the bare tube, mm: two layers of 0.06 mm vinyl.
pub const TAPE_STEP_MM: f64 = 0.12;

/// Length of the steel collar between a bare shaft and the jaws, mm.
pub const COLLAR_MM: f64 = 8.0;

/// Diameter of the collar, as a share of the shaft's.
const COLLAR_SHARE: f64 = 0.94;

/// Length of the end of a bare shaft that counts as its marker, as the band of a taped one does, mm.
const SHAFT_END_MM: f64 = 40.0;

/// What shows where the tools are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimulatedMarker {
    /// A band of tape.
    Band,
    /// Nothing but the shaft itself.
    Bare,
}

impl SimulatedMarker {
    /// Every marker.
    pub const ALL: [SimulatedMarker; 2] = [SimulatedMarker::Band, SimulatedMarker::Bare];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            SimulatedMarker::Band => "band",
            SimulatedMarker::Bare => "bare",
        }
    }

    /// The marker of this name.
    pub fn named(name: &str) -> Option<SimulatedMarker> {
        Self::ALL.into_iter().find(|marker| marker.name() == name)
    }
}

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

/// The surface of a tool's shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaftDesign {
    /// Name on the command line.
    pub name: &'static str,
    /// Its surface.
    pub material: Material,
}

impl ShaftDesign {
    /// Every shaft; all are of polished polymer.
    pub const ALL: [ShaftDesign; 3] = [
        ShaftDesign { name: "black", material: BLACK },
        ShaftDesign { name: "grey", material: Material { matt: [0.2, 0.2, 0.205], ..BLACK } },
        ShaftDesign { name: "white", material: Material { matt: [0.66, 0.65, 0.62], ..BLACK } },
    ];

    /// The shaft of this name.
    pub fn named(name: &str) -> Option<ShaftDesign> {
        Self::ALL.into_iter().find(|shaft| shaft.name == name)
    }
}

/// A band of tape round the end of a tube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TapeBand {
    /// Its tape.
    pub tape: TapeDesign,
    /// Length from the distal end of the tube, mm.
    pub length_mm: f64,
}

/// Sizes of one tool, and the surface of its tube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolDesign {
    /// The band of tape that its tube carries; `None`: the tube is bare.
    pub band: Option<TapeBand>,
    /// The tube's own surface.
    pub shaft: ShaftDesign,
    /// Outer diameter of the tube, over the tape if it has some, mm.
    pub diameter_mm: f64,
    /// Length of the steel collar between the tube and the jaws, mm; 0 without a collar.
    pub collar_mm: f64,
    /// Length of the closed jaws, mm; 0 for a rod without jaws.
    pub jaw_mm: f64,
}

/// A tool in a hand: a design, a fixed fulcrum, and the hand's motion.
#[derive(Clone, Debug)]
pub struct SimulatedTool {
    /// Its name: that of its tape, or `left` and `right` if both tools have the same tape or none.
    pub name: &'static str,
    /// Its sizes and surfaces.
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
    /// Centre of the tube's cross-section at its distal end, where the band or the bare shaft ends, mm.
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
        let tip = grip - axis * self.design.point_mm();
        let length_mm = (tip - self.fulcrum).norm() + OUTSIDE_MM;
        ToolPose { tip, axis, grip, length_mm, opening: self.opening.at(time_s), roll: self.roll.at(time_s) }
    }
}

impl ToolDesign {
    /// From the distal end of the tube to the point of the closed jaws, mm.
    pub fn point_mm(&self) -> f64 {
        self.collar_mm + self.jaw_mm
    }

    /// Length behind the tip that shows where the tool is, mm: its band, or the last part of a bare shaft.
    pub fn marker_mm(&self) -> f64 {
        self.band.map_or(SHAFT_END_MM, |band| band.length_mm)
    }

    /// The tube, taped or bare.
    pub fn tube(&self, pose: &ToolPose) -> TapedTube {
        let radius = 0.5 * self.diameter_mm;
        let (bare_radius, band_mm) =
            self.band.map_or((radius, 0.0), |band| (radius - 0.5 * TAPE_STEP_MM, band.length_mm));
        TapedTube::new(pose.tip, pose.axis, (radius, bare_radius), band_mm, pose.length_mm)
    }

    /// The steel collar, if it has one: a short tube of one surface.
    pub fn collar(&self, pose: &ToolPose) -> Option<TapedTube> {
        let radius = 0.5 * COLLAR_SHARE * self.diameter_mm;
        let tube = || {
            let end = self.front(pose);
            TapedTube::new(end, pose.axis, (radius, radius), self.collar_mm, self.collar_mm)
        };
        (self.collar_mm > 0.0).then(tube)
    }

    /// Centre of the end of tube and collar, where the jaws begin.
    fn front(&self, pose: &ToolPose) -> Point3<f64> {
        pose.tip + pose.axis * self.collar_mm
    }

    /// Hinge and both halves of the jaws, if it has any.
    pub fn jaws(&self, pose: &ToolPose) -> Option<[RoundCone; 3]> {
        if self.jaw_mm == 0.0 {
            return None;
        }
        let (width, front) = (self.diameter_mm, self.front(pose));
        let hinge = front + pose.axis * (0.22 * self.jaw_mm);
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
        let block = RoundCone { a: front, radius_a: 0.34 * width, b: hinge, radius_b: 0.27 * width };
        Some([block, half(1.0), half(-1.0)])
    }

    /// The tool as rods, for its shadow: the tube with its collar, and the jaws where it has any.
    pub fn shadow_rods(&self, pose: &ToolPose) -> impl Iterator<Item = RoundCone> + use<> {
        let behind = pose.tip - pose.axis * pose.length_mm;
        let (front, width) = (self.front(pose), self.diameter_mm);
        let jaws = self.jaws(pose).map(|[_, one, other]| {
            let end = nalgebra::center(&one.b, &other.b);
            RoundCone { a: front, radius_a: 0.3 * width, b: end, radius_b: 0.16 * width }
        });
        std::iter::once(RoundCone::capsule(front, behind, 0.5 * width)).chain(jaws)
    }
}

/// A unit vector across the axis, rotated about it by `roll`.
pub fn side_of(axis: Vector3<f64>, roll: f64) -> Vector3<f64> {
    let level = axis.cross(&Vector3::z()).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    level * roll.cos() + axis.cross(&level) * roll.sin()
}

/// The steel of jaws and collar.
pub const STEEL: Material = Material { matt: [0.1, 0.1, 0.105], gloss: 0.8, sharpness: 36, mirror: 0.42 };

/// The bare tube: black polymer, polished.
pub const BLACK: Material = Material { matt: [0.012, 0.012, 0.013], gloss: 0.85, sharpness: 90, mirror: 0.035 };

/// The tube's end face.
pub const FACE: Material = Material { matt: [0.09, 0.09, 0.095], gloss: 0.2, sharpness: 20, mirror: 0.1 };
