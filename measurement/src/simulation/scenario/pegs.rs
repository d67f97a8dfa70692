//! Peg transfer: each bead is lifted off a left peg, handed over in the air and put on the right peg opposite.

use nalgebra::Point3;

use super::{Bead, BeadPlace, ReachEnding, SceneContext, Script, SimulatedHand};
use crate::random::Dice;
use crate::simulation::board::Prop;
use crate::simulation::light::{Material, Rgb};
use crate::simulation::rig::above;
use crate::simulation::shape::RoundCone;

/// Radius of a bead, mm.
pub(crate) const BEAD_RADIUS_MM: f64 = 4.6;

const PEGS: [(f64, f64); 3] = [(36.0, -40.0), (52.0, -16.0), (34.0, 6.0)];
const PEG_MM: f64 = 22.0;
const BEAD_UP_MM: f64 = 14.0;
const LIFTED_MM: f64 = 40.0;
const COLOURS: [Rgb; 3] = [[0.3, 0.05, 0.26], [0.62, 0.6, 0.56], [0.05, 0.2, 0.08]];
const PEG: Material = Material { matt: [0.5, 0.5, 0.5], gloss: 0.25, sharpness: 20, mirror: 0.08 };

/// Moves three beads to the right; a longer scene moves them back and repeats.
pub(super) fn pegs(cast: &SceneContext) -> Script {
    let mut hands = [cast.hand(true), cast.hand(false)];
    let mut dice = Dice::new(cast.seed, "hand-overs");
    let mut beads = beads();
    hands[0].wait(0.6);
    hands[1].wait(0.9);
    let mut giver = 0; // the beads lie on this hand's side
    cast.laps(1, || {
        for (bead, peg) in beads.iter_mut().zip(PEGS) {
            if dice.chance(cast.skill.one_handedness) {
                carry_alone(&mut hands, giver, bead, peg);
            } else {
                hand_over(&mut hands, giver, bead, peg);
            }
        }
        giver = 1 - giver;
        hands[0].now_s().max(hands[1].now_s())
    });
    for (hand, x) in hands.iter_mut().zip([-46.0, 46.0]) {
        hand.reach(above(x, 30.0, 42.0), ReachEnding::Stop);
        hand.wait(0.6);
    }
    let [left, right] = hands;
    Script { hands: vec![(0, left), (1, right)], beads, props: peg_props(), ..Script::default() }
}

fn beads() -> Vec<Bead> {
    let bead = |((x, y), colour): ((f64, f64), Rgb)| Bead {
        stays: vec![(0.0, BeadPlace::At(above(-x, y, BEAD_UP_MM)))],
        colour,
    };
    PEGS.into_iter().zip(COLOURS).map(bead).collect()
}

fn peg_props() -> Vec<Prop> {
    let peg = |(x, y)| RoundCone { a: above(x, y, 0.0), radius_a: 1.9, b: above(x, y, PEG_MM), radius_b: 1.5 };
    let both = PEGS.into_iter().flat_map(|(x, y)| [(x, y), (-x, y)]);
    both.map(|at| Prop { solid: peg(at), material: PEG }).collect()
}

fn side_of(hand: usize) -> f64 {
    if hand == 0 { -1.0 } else { 1.0 }
}

/// Takes the bead off its peg and lifts it.
fn pick_up(hand: &mut SimulatedHand, index: usize, bead: &mut Bead, peg: Point3<f64>) {
    hand.reach(over(peg), ReachEnding::Flow);
    hand.open();
    hand.reach(peg, ReachEnding::Stop);
    hand.pause();
    hand.close();
    bead.stays.push((hand.now_s(), BeadPlace::Held(index)));
    hand.reach(over(peg), ReachEnding::Flow);
}

/// Puts the bead on a peg and lets go.
fn put_down(hand: &mut SimulatedHand, bead: &mut Bead, peg: Point3<f64>) {
    hand.reach(over(peg), ReachEnding::Flow);
    hand.reach(peg, ReachEnding::Stop);
    hand.pause();
    bead.stays.push((hand.now_s(), BeadPlace::At(peg)));
    hand.open();
    hand.reach(over(peg), ReachEnding::Flow);
    hand.close();
}

fn hand_over(hands: &mut [SimulatedHand; 2], giver: usize, bead: &mut Bead, (x, y): (f64, f64)) {
    let taker = 1 - giver;
    let meeting = above(0.0, -12.0, 46.0);
    pick_up(&mut hands[giver], giver, bead, above(side_of(giver) * x, y, BEAD_UP_MM));
    hands[giver].reach(meeting, ReachEnding::Stop);
    let arrives_s = hands[giver].now_s();
    let taking = &mut hands[taker];
    taking.wait_until(arrives_s - 1.2);
    taking.open();
    taking.reach(beside(meeting, taker, 14.0), ReachEnding::Flow);
    taking.wait_until(arrives_s);
    taking.reach(beside(meeting, taker, 3.0), ReachEnding::Stop);
    taking.pause();
    taking.close();
    let taken_s = taking.now_s();
    bead.stays.push((taken_s, BeadPlace::Held(taker)));
    let giving = &mut hands[giver];
    giving.wait_until(taken_s);
    giving.open();
    let free_s = giving.now_s();
    giving.reach(beside(meeting, giver, 26.0), ReachEnding::Flow);
    giving.close();
    hands[taker].wait_until(free_s);
    put_down(&mut hands[taker], bead, above(side_of(taker) * x, y, BEAD_UP_MM));
}

/// One hand carries the bead the whole way while the other rests.
fn carry_alone(hands: &mut [SimulatedHand; 2], giver: usize, bead: &mut Bead, (x, y): (f64, f64)) {
    const DOMINANT: usize = 1;
    let from = above(side_of(giver) * x, y, BEAD_UP_MM);
    let to = above(-side_of(giver) * x, y, BEAD_UP_MM);
    let idle = above(-58.0, 24.0, 40.0);
    let other = hands[1 - DOMINANT].now_s();
    hands[DOMINANT].wait_until(other);
    hands[1 - DOMINANT].reach(idle, ReachEnding::Stop);
    pick_up(&mut hands[DOMINANT], DOMINANT, bead, from);
    put_down(&mut hands[DOMINANT], bead, to);
    let done = hands[DOMINANT].now_s();
    hands[1 - DOMINANT].wait_until(done);
}

fn over(peg: Point3<f64>) -> Point3<f64> {
    Point3::new(peg.x, peg.y, -LIFTED_MM)
}

/// The point shifted by `by` mm to a hand's own side.
fn beside(point: Point3<f64>, hand: usize, by: f64) -> Point3<f64> {
    Point3::new(point.x + side_of(hand) * by, point.y, point.z)
}
