//! The scenes that can be simulated: task, hands, and objects on the mat.
//!
//! | scene | what | tools |
//! |---|---|---|
//! | `wire` | along an m-shaped wire (the thesis's trial 1) | 1 |
//! | `rectangle` | along a printed rectangle, half each (trial 2) | 2 |
//! | `approach` | three times towards the camera and back | 1 |
//! | `slide` | along a straight guide and back, five times (repeatability, T 7.1.3) | 1 |
//! | `rest` | lying still: any movement in the result is noise | 1 |
//! | `pegs` | beads handed over from left to right pegs | 2 |
//! | `crossing` | one tool behind the other, three times, then out of the picture and back | 2 |
//! | `long-rest` | both lie still for a minute, the left one from the first frame on | 2 |
//! | `hidden-tip` | the tip is behind a block for half a second, six times; the shaft stays in sight | 1 |
//! | `moved-pegs` | a hand moves black pegs, one after the other, between two tools | 2 |
//! | `black-props` | over and beside props with the surface of a black shaft | 2 |
//! | `self-test` | a rod touches corners of the printed checkerboard, on the mat and lifted | 1 |
//! | `exchange` | each to the other's side and back, then both out of the picture, and back in the other order | 2 |

mod hand;
mod measurement;
mod pegs;
mod self_test;
mod shafts;
mod tracing;

pub use hand::{ReachEnding, SimulatedHand};
pub(crate) use measurement::slide_wobble;
pub(crate) use pegs::BEAD_RADIUS_MM;
pub(crate) use self_test::touch_wobble;

use nalgebra::{Isometry3, Translation3, Vector3};

use super::board::{Prop, Stroke};
use super::motion::ReachSum;
use super::rig::{Rig, above};
use super::skill::Skill;
use super::world::Setup;
use crate::random::Dice;

/// A scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scenario {
    /// Along an m-shaped wire.
    Wire,
    /// Along a printed rectangle, half each.
    Rectangle,
    /// Towards the camera and back.
    Approach,
    /// Along a guide, five times.
    Slide,
    /// No movement.
    Rest,
    /// Beads from peg to peg, handed over.
    Pegs,
    /// One tool behind the other, and out of the picture.
    Crossing,
    /// Each to the other's side; both out of the picture, and back on swapped sides in the other order.
    Exchange,
    /// A rod's end is held on corners of the printed checkerboard.
    SelfTest,
    /// No movement for a minute, in the middle of a recording.
    LongRest,
    /// The tip behind a block, the shaft in sight.
    HiddenTip,
    /// Black pegs are moved by hand.
    MovedPegs,
    /// Over props as black as a shaft.
    BlackProps,
}

impl Scenario {
    /// Every scene.
    pub const ALL: [Scenario; 13] = [
        Scenario::Wire,
        Scenario::Rectangle,
        Scenario::Approach,
        Scenario::Slide,
        Scenario::Rest,
        Scenario::Pegs,
        Scenario::Crossing,
        Scenario::Exchange,
        Scenario::SelfTest,
        Scenario::LongRest,
        Scenario::HiddenTip,
        Scenario::MovedPegs,
        Scenario::BlackProps,
    ];

    /// The scene of this name.
    pub fn named(name: &str) -> Option<Scenario> {
        Self::ALL.into_iter().find(|s| s.name() == name)
    }

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Scenario::Wire => "wire",
            Scenario::Rectangle => "rectangle",
            Scenario::Approach => "approach",
            Scenario::Slide => "slide",
            Scenario::Rest => "rest",
            Scenario::Pegs => "pegs",
            Scenario::Crossing => "crossing",
            Scenario::Exchange => "exchange",
            Scenario::SelfTest => "self-test",
            Scenario::LongRest => "long-rest",
            Scenario::HiddenTip => "hidden-tip",
            Scenario::MovedPegs => "moved-pegs",
            Scenario::BlackProps => "black-props",
        }
    }

    /// Performs the scene in this box as the setup states; the task is repeated until it is long enough.
    pub fn play(self, rig: &Rig, setup: &Setup) -> Script {
        let Setup { skill, seed, min_duration_s: at_least_s, .. } = *setup;
        let cast = SceneContext { rig, skill, seed, min_duration_s: at_least_s };
        match self {
            Scenario::Wire => tracing::wire(&cast),
            Scenario::Rectangle => tracing::rectangle(&cast),
            Scenario::Approach => measurement::approach(&cast),
            Scenario::Slide => measurement::slide(&cast),
            Scenario::Rest => measurement::rest(&cast),
            Scenario::Pegs => pegs::pegs(&cast),
            Scenario::Crossing => measurement::crossing(&cast),
            Scenario::Exchange => measurement::exchange(&cast),
            Scenario::SelfTest => self_test::self_test(&cast, setup.diameter_mm),
            Scenario::LongRest => shafts::long_rest(&cast),
            Scenario::HiddenTip => shafts::hidden_tip(&cast, setup.tool_design(0).point_mm()),
            Scenario::MovedPegs => shafts::moved_pegs(&cast),
            Scenario::BlackProps => shafts::black_props(&cast),
        }
    }
}

/// The contents of a scene.
#[derive(Clone, Debug, Default)]
pub struct Script {
    /// Hands with the trocar each uses (0 left, 1 right).
    pub hands: Vec<(usize, SimulatedHand)>,
    /// Beads that are carried.
    pub beads: Vec<Bead>,
    /// Fixed objects on the mat; board frame.
    pub props: Vec<Prop>,
    /// Objects that are moved by hand.
    pub moved: Vec<MovedProp>,
    /// Lines printed on the mat.
    pub strokes: Vec<Stroke>,
    /// Poses of the checkerboard (board frame), each with its start time, s; there is no checkerboard before the first.
    pub sheets: Vec<(f64, Isometry3<f64>)>,
}

/// A prop that a hand moves.
#[derive(Clone, Debug)]
pub struct MovedProp {
    /// The prop at its first place; board frame.
    pub prop: Prop,
    /// Its distance from this place over time; board frame, mm.
    pub shift: ReachSum<Vector3<f64>>,
}

impl MovedProp {
    /// The prop at a time; board frame.
    pub fn at(&self, time_s: f64) -> Prop {
        self.prop.moved_by(&Isometry3::from(Translation3::from(self.shift.at(time_s))))
    }
}

/// A bead, and its places over time.
#[derive(Clone, Debug)]
pub struct Bead {
    /// Places with their start times, s, in order; the first starts at 0.
    pub stays: Vec<(f64, BeadPlace)>,
    /// Matt reflectance.
    pub colour: super::light::Rgb,
}

/// The place of a bead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BeadPlace {
    /// On the board; board frame, mm.
    At(nalgebra::Point3<f64>),
    /// Between the jaws of the hand of this index.
    Held(usize),
}

/// What every scene needs: the box, the skill, the seed and the minimum duration.
struct SceneContext<'a> {
    rig: &'a Rig,
    skill: Skill,
    seed: u64,
    min_duration_s: f64,
}

impl SceneContext<'_> {
    /// A hand of this skill at its usual place.
    fn hand(&self, left: bool) -> SimulatedHand {
        let home = if left { above(-46.0, 30.0, 42.0) } else { above(46.0, 30.0, 42.0) };
        self.hand_at(home, if left { "left hand" } else { "right hand" })
    }

    fn hand_at(&self, home: nalgebra::Point3<f64>, purpose: &str) -> SimulatedHand {
        SimulatedHand::resting_at(home, self.skill, Dice::new(self.seed, purpose))
    }

    /// Plays at least `least` laps, and more until the scene is long enough; a lap returns the time at its end.
    fn laps(&self, least: usize, mut lap: impl FnMut() -> f64) {
        const MOST: usize = 100_000;
        for played in 1..=MOST {
            if lap() >= self.min_duration_s && played >= least {
                break;
            }
        }
    }
}
