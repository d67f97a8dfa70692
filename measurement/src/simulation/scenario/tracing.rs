//! Trials 1 and 2 of the thesis (T 7.1): following an m-shaped wire, and a printed rectangle with two tools.

use nalgebra::Point3;

use super::{ReachEnding, SceneContext, Script, SimulatedHand};
use crate::simulation::board::{Prop, Stroke};
use crate::simulation::light::Material;
use crate::simulation::rig::above;
use crate::simulation::shape::RoundCone;

const WIRE_UP_MM: f64 = 20.0;
const WIRE: [(f64, f64); 5] = [(-44.0, 26.0), (-27.0, -30.0), (0.0, 14.0), (27.0, -30.0), (44.0, 26.0)];
const BRIGHT_WIRE: Material = Material { matt: [0.32, 0.31, 0.29], gloss: 0.6, sharpness: 30, mirror: 0.3 };

/// One tool follows the wire from end to end and back.
pub(super) fn wire(cast: &SceneContext) -> Script {
    let mut hand = cast.hand(true);
    hand.wait(0.6);
    cast.laps(1, || {
        for point in WIRE.iter().chain(WIRE.iter().rev().skip(1)) {
            hand.reach(above(point.0, point.1, WIRE_UP_MM + 3.0), ReachEnding::Flow);
            hand.pause();
        }
        hand.now_s()
    });
    hand.reach(above(-46.0, 30.0, 42.0), ReachEnding::Stop);
    hand.wait(0.6);
    Script { hands: vec![(0, hand)], props: wire_props(), ..Script::default() }
}

fn wire_props() -> Vec<Prop> {
    let at = |(x, y): (f64, f64)| above(x, y, WIRE_UP_MM);
    let rod = |a: Point3<f64>, b: Point3<f64>| Prop { solid: RoundCone::capsule(a, b, 1.3), material: BRIGHT_WIRE };
    let legs = WIRE.windows(2).map(|pair| rod(at(pair[0]), at(pair[1])));
    let posts = [WIRE[0], WIRE[2], WIRE[4]].map(|(x, y)| rod(above(x, y, 0.0), at((x, y))));
    legs.chain(posts).collect()
}

const HALF_WIDTH: f64 = 46.0;
const FAR: f64 = -38.0;
const NEAR: f64 = 22.0;
const GAP: f64 = 9.0; // between the tools where the halves meet
const OVER_MM: f64 = 5.0;

/// Each tool follows its half of the rectangle and back, resting at the corners.
pub(super) fn rectangle(cast: &SceneContext) -> Script {
    let (mut left, mut right) = (cast.hand(true), cast.hand(false));
    let mut dice = crate::random::Dice::new(cast.seed, "turns");
    left.wait(0.6);
    right.wait(0.9);
    cast.laps(1, || {
        trace_half(&mut left, -1.0);
        if dice.chance(cast.skill.one_handedness) {
            right.wait_until(left.now_s()); // one hand at a time
        }
        trace_half(&mut right, 1.0);
        let both = left.now_s().max(right.now_s());
        left.wait_until(both);
        right.wait_until(both);
        both
    });
    for (hand, x) in [(&mut left, -46.0), (&mut right, 46.0)] {
        hand.reach(above(x, 30.0, 42.0), ReachEnding::Stop);
        hand.wait(0.6);
    }
    Script { hands: vec![(0, left), (1, right)], strokes: rectangle_strokes(), ..Script::default() }
}

fn trace_half(hand: &mut SimulatedHand, side: f64) {
    let corners = [(GAP, FAR), (HALF_WIDTH, FAR), (HALF_WIDTH, NEAR), (GAP, NEAR)];
    for (x, y) in corners.into_iter().chain(corners.into_iter().rev()) {
        hand.reach(above(side * x, y, OVER_MM), ReachEnding::Stop);
        hand.pause();
    }
}

fn rectangle_strokes() -> Vec<Stroke> {
    let corners = [(-HALF_WIDTH, FAR), (HALF_WIDTH, FAR), (HALF_WIDTH, NEAR), (-HALF_WIDTH, NEAR)];
    let sides =
        |width: f64, colour| (0..4).map(move |i| Stroke { from: corners[i], to: corners[(i + 1) % 4], width, colour });
    sides(4.2, [0.03, 0.03, 0.03]).chain(sides(2.4, [0.72, 0.7, 0.66])).collect()
}
