//! A hand that performs a task: a time cursor that appends reaches.

use nalgebra::{Point3, Vector3};

use crate::random::Dice;
use crate::simulation::motion::ReachSum;
use crate::simulation::skill::Skill;

/// How a reach ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReachEnding {
    /// At rest on the target.
    Stop,
    /// On the way to the next target; a fluent hand starts the next reach early.
    Flow,
}

/// Angle between the open jaws, rad.
const OPEN_ANGLE: f64 = 0.62;

/// A hand, and its movements so far.
#[derive(Clone, Debug)]
pub struct SimulatedHand {
    /// Aim of the closed jaws' point; board frame, mm.
    pub aim: ReachSum<Vector3<f64>>,
    /// Angle between the jaws, rad.
    pub opening: ReachSum<f64>,
    /// Turn about the axis, rad.
    pub roll: ReachSum<f64>,
    /// True if the hand is held by a fixture: it does not tremble or wander.
    pub is_steady: bool,
    now_s: f64,
    at: Vector3<f64>,
    open: bool,
    skill: Skill,
    dice: Dice,
}

impl SimulatedHand {
    /// A hand at rest, jaws closed.
    pub fn resting_at(home: Point3<f64>, skill: Skill, mut dice: Dice) -> Self {
        Self {
            aim: ReachSum::resting_at(home.coords),
            opening: ReachSum::resting_at(0.05),
            roll: ReachSum::resting_at(dice.within(0.2, 1.2)),
            is_steady: false,
            now_s: 0.0,
            at: home.coords,
            open: false,
            skill,
            dice,
        }
    }

    /// The same hand, held by a fixture: no tremor, no detours.
    pub fn steady(mut self) -> Self {
        self.is_steady = true;
        self
    }

    /// Time when the hand is free again, s.
    pub fn now_s(&self) -> f64 {
        self.now_s
    }

    /// Stays for this time, s.
    pub fn wait(&mut self, seconds: f64) {
        self.now_s += seconds;
    }

    /// Stays until this time, s, unless it has passed.
    pub fn wait_until(&mut self, time_s: f64) {
        self.now_s = self.now_s.max(time_s);
    }

    /// Rests for this skill's pause between two movements.
    pub fn pause(&mut self) {
        self.now_s += self.skill.pause_s * self.dice.within(0.5, 1.6);
    }

    /// Reaches for a point with this skill's detour, first miss, corrections and rest.
    pub fn reach(&mut self, target: Point3<f64>, ending: ReachEnding) {
        let whole = target.coords - self.at;
        let length = whole.norm();
        if length < 1e-9 {
            return;
        }
        let corrections = if ending == ReachEnding::Stop { self.skill.corrections } else { 0 };
        let miss =
            if corrections > 0 { self.dice.gauss3() * (self.skill.miss * length).min(6.0) } else { Vector3::zeros() };
        let took = self.add_bowed_reach(whole + miss, length);
        let mut left = -miss;
        for step in 0..corrections {
            self.now_s += 0.3 * self.skill.pause_s + self.dice.within(0.04, 0.14);
            let part = if step + 1 == corrections { left } else { left * self.dice.within(0.5, 1.3) };
            let seconds = self.dice.within(0.22, 0.4);
            self.add_straight_reach(part, seconds);
            left -= part;
        }
        match ending {
            ReachEnding::Stop => {}
            ReachEnding::Flow => self.now_s -= self.skill.fluency * took,
        }
        self.at = target.coords;
    }

    /// Reaches in a straight line within this time, s, without miss or detour.
    pub fn glide(&mut self, target: Point3<f64>, seconds: f64) {
        self.add_straight_reach(target.coords - self.at, seconds);
        self.at = target.coords;
    }

    /// Opens the jaws.
    pub fn open(&mut self) {
        self.move_jaws(true);
    }

    /// Closes the jaws.
    pub fn close(&mut self) {
        self.move_jaws(false);
    }

    fn move_jaws(&mut self, open: bool) {
        const MOVING_S: f64 = 0.22;
        if self.open != open {
            self.opening.add_reach(self.now_s, MOVING_S, if open { OPEN_ANGLE } else { -OPEN_ANGLE });
            self.now_s += MOVING_S;
            self.open = open;
        }
    }

    /// Adds two overlapping reaches over a point beside the straight line; returns the time taken, s.
    fn add_bowed_reach(&mut self, whole: Vector3<f64>, length: f64) -> f64 {
        const MIN_REACH_S: f64 = 0.32; // a reach of a few mm still takes about this long
        let seconds = MIN_REACH_S + length / self.skill.reach_speed_mm_s * self.dice.within(0.85, 1.25);
        let sideways = self.dice.gauss3() * (self.skill.detour * length).min(14.0);
        let (first, second) = (whole * 0.5 + sideways, whole * 0.5 - sideways);
        self.aim.add_reach(self.now_s, 0.72 * seconds, first);
        self.aim.add_reach(self.now_s + 0.28 * seconds, 0.72 * seconds, second);
        let turn = self.dice.gauss() * 0.25;
        self.roll.add_reach(self.now_s, seconds, turn);
        self.now_s += seconds;
        seconds
    }

    fn add_straight_reach(&mut self, by: Vector3<f64>, seconds: f64) {
        self.aim.add_reach(self.now_s, seconds, by);
        self.now_s += seconds;
    }
}
