//! A known world as a pure function of time and seed: positions can be asked for any moment, in any order.

use nalgebra::{Isometry3, Point3};

use super::board::{Prop, Scenery};
use super::checkerboard::HeldBoard;
use super::light::Material;
use super::motion::Oscillation;
use super::rig::{Rig, RigView};
use super::scenario::{Bead, BeadPlace, MovedProp, Scenario, Script, SimulatedHand};
use super::shape::RoundCone;
use super::skill::Skill;
use super::tool::{COLLAR_MM, ShaftDesign, SimulatedMarker, SimulatedTool, TapeBand, TapeDesign, ToolDesign, ToolPose};
use crate::random::Dice;

/// What to simulate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setup {
    /// The task.
    pub scenario: Scenario,
    /// The skill of the hands.
    pub skill: Skill,
    /// Position of the camera.
    pub view: RigView,
    /// Number of the box, which sets its camera, lens, lamps and mat. Recordings of one box share one calibration.
    pub rig: u64,
    /// Seed of the hands' motion and the sensor's noise.
    pub seed: u64,
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// The task is repeated until this time, s; with 0 it is played once.
    pub min_duration_s: f64,
    /// What shows where the tools are.
    pub marker: SimulatedMarker,
    /// Tapes of the left and the right tool; both may be the same. Bare tools have none.
    pub tapes: [TapeDesign; 2],
    /// Shaft of both tools.
    pub shaft: ShaftDesign,
    /// Outer diameter of the tools, over the tape if they have some, mm.
    pub diameter_mm: f64,
    /// Distance that the camera was moved to its right since its box was set up, mm.
    pub camera_moved_mm: f64,
}

impl Setup {
    /// A scene in box 1 at 1280×720 from above, black tools of 5 mm with orange and cyan tape, played once.
    pub fn new(scenario: Scenario, skill: Skill, seed: u64) -> Self {
        Self {
            scenario,
            skill,
            view: RigView::Top,
            rig: 1,
            seed,
            width: 1280,
            height: 720,
            min_duration_s: 0.0,
            marker: SimulatedMarker::Band,
            tapes: [TapeDesign::ALL[0], TapeDesign::ALL[1]],
            shaft: ShaftDesign::ALL[0],
            diameter_mm: 5.0,
            camera_moved_mm: 0.0,
        }
    }

    /// The design of a tool: 0 is the left one, 1 the right one. The rod of a self-test has neither collar nor jaws.
    pub fn tool_design(&self, side: usize) -> ToolDesign {
        const BANDS_MM: [f64; 2] = [26.0, 29.0];
        let band = TapeBand { tape: self.tapes[side], length_mm: BANDS_MM[side] };
        let band = (self.marker == SimulatedMarker::Band).then_some(band);
        let is_rod = self.scenario == Scenario::SelfTest;
        ToolDesign {
            band,
            shaft: self.shaft,
            diameter_mm: self.diameter_mm,
            collar_mm: if is_rod || band.is_some() { 0.0 } else { COLLAR_MM },
            jaw_mm: if is_rod { 0.0 } else { 12.0 + self.diameter_mm },
        }
    }

    fn tool_name(&self, side: usize) -> &'static str {
        let tapes_differ = self.tapes[0] != self.tapes[1];
        match self.marker {
            SimulatedMarker::Band if tapes_differ => self.tapes[side].name,
            SimulatedMarker::Band | SimulatedMarker::Bare => ["left", "right"][side],
        }
    }
}

/// The scenery from one change to the next.
#[derive(Clone, Debug)]
pub struct SceneStage {
    /// Start time, s.
    pub from_s: f64,
    /// The scenery.
    pub scenery: Scenery,
}

/// The world of one recording.
#[derive(Clone, Debug)]
pub struct World {
    /// Camera, lens and light.
    pub rig: Rig,
    /// Tools, in the order of the truth.
    pub tools: Vec<SimulatedTool>,
    /// The scenery over time; the first stage starts at 0 s.
    pub stages: Vec<SceneStage>,
    /// Seed of all randomness.
    pub seed: u64,
    /// Duration of the task, s.
    pub duration_s: f64,
    beads: Vec<Bead>,
    moved: Vec<MovedProp>,
}

impl World {
    /// Builds the world.
    pub fn new(setup: &Setup) -> Self {
        let rig = Rig::new(setup.rig, setup.view, setup.width, setup.height).moved(setup.camera_moved_mm);
        let script = setup.scenario.play(&rig, setup);
        let duration_s = script.hands.iter().map(|(_, hand)| hand.now_s()).fold(0.0, f64::max);
        let Script { hands, beads, props, moved, strokes, sheets } = script;
        let tools = hands.into_iter().map(|(side, hand)| tool(setup, &rig, side, hand)).collect();
        let empty = Scenery::new(setup.rig, &rig.camera_from_board, rig.lighting, props, strokes);
        let with = |(from_s, board_from_sheet): &(f64, Isometry3<f64>)| {
            let scenery = empty.clone().with_sheet(HeldBoard::flat(rig.camera_from_board * board_from_sheet));
            SceneStage { from_s: *from_s, scenery }
        };
        let mut stages: Vec<SceneStage> = sheets.iter().map(with).collect();
        if stages.first().is_none_or(|first| first.from_s > 0.0) {
            stages.insert(0, SceneStage { from_s: 0.0, scenery: empty });
        }
        Self { rig, tools, stages, seed: setup.seed, duration_s, beads, moved }
    }

    /// Index in [`Self::stages`] of the stage at a time.
    pub fn stage_at(&self, time_s: f64) -> usize {
        self.stages.partition_point(|stage| stage.from_s <= time_s).saturating_sub(1)
    }

    /// The pose of every tool at a time.
    pub fn poses(&self, time_s: f64) -> Vec<ToolPose> {
        self.tools.iter().map(|tool| tool.pose(&self.rig, time_s)).collect()
    }

    /// The props that a hand moves, where they are at a time; camera frame.
    pub fn moved_props(&self, time_s: f64) -> Vec<Prop> {
        self.moved.iter().map(|moved| moved.at(time_s).moved_by(&self.rig.camera_from_board)).collect()
    }

    /// The box at the first moment, without its tools: their beads lie where they are picked up.
    pub fn empty_box(&self) -> Scenery {
        let loose = self.carried(&self.poses(0.0), 0.0).into_iter().map(|(solid, material)| Prop { solid, material });
        self.stages[0].scenery.clone().with_props(loose)
    }

    /// The objects that tools or hands move, where they are at a time; camera frame.
    pub fn carried(&self, poses: &[ToolPose], time_s: f64) -> Vec<(RoundCone, Material)> {
        let bead = |bead: &Bead| {
            let material = Material { matt: bead.colour, gloss: 0.2, sharpness: 30, mirror: 0.03 };
            (RoundCone::sphere(self.bead_position(bead, poses, time_s), super::scenario::BEAD_RADIUS_MM), material)
        };
        let by_hand = self.moved_props(time_s).into_iter().map(|prop| (prop.solid, prop.material));
        self.beads.iter().map(bead).chain(by_hand).collect()
    }

    fn bead_position(&self, bead: &Bead, poses: &[ToolPose], time_s: f64) -> Point3<f64> {
        let begun = bead.stays.iter().rev().find(|(from_s, _)| *from_s <= time_s);
        match begun.or(bead.stays.first()).map(|(_, place)| *place) {
            Some(BeadPlace::At(point)) => self.rig.camera_from_board * point,
            Some(BeadPlace::Held(hand)) => poses[hand].grip,
            None => Point3::origin(),
        }
    }
}

fn tool(setup: &Setup, rig: &Rig, side: usize, hand: SimulatedHand) -> SimulatedTool {
    SimulatedTool {
        name: setup.tool_name(side),
        design: setup.tool_design(side),
        fulcrum: rig.fulcrums[side],
        unsteadiness: unsteadiness(setup, side, &hand),
        aim: hand.aim,
        opening: hand.opening,
        roll: hand.roll,
    }
}

fn unsteadiness(setup: &Setup, side: usize, hand: &SimulatedHand) -> Vec<Oscillation> {
    match (setup.scenario, hand.is_steady) {
        (Scenario::Slide, _) => vec![super::scenario::slide_wobble(setup.seed)],
        (Scenario::SelfTest, _) => vec![super::scenario::touch_wobble(setup.seed)],
        (_, true) => Vec::new(),
        (_, false) => {
            let mut dice = Dice::new(setup.seed, ["left tremor", "right tremor"][side]);
            let tremor = Oscillation::new(&mut dice, setup.skill.tremor_mm, 5.0, 11.0);
            vec![tremor, Oscillation::new(&mut dice, setup.skill.wander_mm, 0.4, 1.3)]
        }
    }
}
