//! Scenes that are hard for a tracker of bare shafts: long rest, hidden tip, moved pegs, black props.
//!
//! Nothing but its shape and its trocar distinguishes a bare black shaft from other black things, and a tool that rests
//! is easily taken for a part of the box.

use nalgebra::{Point3, Vector3};

use super::{MovedProp, ReachEnding, SceneContext, Script, SimulatedHand};
use crate::simulation::board::Prop;
use crate::simulation::light::Material;
use crate::simulation::motion::ReachSum;
use crate::simulation::rig::{RigView, above};
use crate::simulation::shape::RoundCone;
use crate::simulation::tool::BLACK;

const BLOCK: Material = Material { matt: [0.42, 0.4, 0.36], gloss: 0.05, sharpness: 10, mirror: 0.01 };

/// Duration of the rest, s.
const REST_S: f64 = 60.0;

/// The left tool lies still from the first frame on. The right one moves at first. Then both lie still for a minute,
/// and afterwards both move.
pub(super) fn long_rest(cast: &SceneContext) -> Script {
    let place = above(-24.0, -12.0, 24.0);
    let left = cast.hand_at(place, "left hand").steady();
    let mut hands = [left, cast.hand(false).steady()];
    cast.laps(1, || {
        let right = &mut hands[1];
        right.wait(0.8);
        for target in [above(30.0, -22.0, 24.0), above(22.0, 6.0, 30.0)] {
            right.reach(target, ReachEnding::Stop);
            right.pause();
        }
        together(&mut hands);
        hands.iter_mut().for_each(|hand| hand.wait(REST_S));
        let [left, right] = &mut hands;
        left.reach(above(-38.0, 10.0, 34.0), ReachEnding::Stop);
        right.reach(above(46.0, 30.0, 42.0), ReachEnding::Stop);
        left.pause();
        left.reach(place, ReachEnding::Stop);
        together(&mut hands)
    });
    let [left, right] = hands;
    Script { hands: vec![(0, left), (1, right)], ..Script::default() }
}

/// The tool is pushed along its axis until its tip is behind a block, held there, and pulled back: about half a second
/// without the tip, while the shaft stays in sight. `point_mm` is the distance from the tip to the jaws' point.
pub(super) fn hidden_tip(cast: &SceneContext, point_mm: f64) -> Script {
    const PUSHED_MM: f64 = 26.0;
    const PUSHING_S: f64 = 0.5;
    const HELD_S: f64 = 0.1;
    let deepest = match cast.rig.view {
        RigView::Top => above(-14.0, -10.0, 38.0),
        RigView::Side => above(-14.0, -14.0, 30.0),
    };
    let to_board = cast.rig.camera_from_board.inverse();
    let axis = (deepest - to_board * cast.rig.fulcrums[0]).normalize();
    let [before, behind] = [PUSHED_MM, 0.0].map(|back_mm| deepest + axis * (point_mm - back_mm));
    let mut hand = cast.hand_at(before, "left hand");
    hand.wait(1.2);
    cast.laps(6, || {
        hand.glide(behind, PUSHING_S);
        hand.wait(HELD_S);
        hand.glide(before, PUSHING_S);
        hand.pause();
        hand.reach(before + Vector3::new(-16.0, 8.0, 0.0), ReachEnding::Stop);
        hand.pause();
        hand.reach(before, ReachEnding::Stop);
        hand.wait(1.0);
        hand.now_s()
    });
    Script {
        hands: vec![(0, hand)],
        props: block_before(deepest, axis, to_board * Point3::origin()),
        ..Script::default()
    }
}

/// A block on a post that hides the tip at this place, and little of the shaft, from the eye.
fn block_before(tip: Point3<f64>, axis: Vector3<f64>, eye: Point3<f64>) -> Vec<Prop> {
    const AHEAD_MM: f64 = 8.0; // of the tip: the jaws are hidden, too
    const ABOVE_MM: f64 = 30.0;
    const HALF_MM: f64 = 18.0;
    let hidden = tip + axis * AHEAD_MM;
    let middle = hidden + (eye - hidden).normalize() * ABOVE_MM;
    let across = axis.cross(&(tip - eye)).normalize() * HALF_MM;
    let end = middle + across;
    let prop = |solid| Prop { solid, material: BLOCK };
    let post = RoundCone::capsule(end, Point3::new(end.x, end.y, 0.0), 2.0);
    vec![prop(RoundCone::capsule(middle - across, end, 10.0)), prop(post)]
}

/// Black pegs: places on the mat before and after a hand moves them, mm.
const PEGS: [[(f64, f64); 2]; 4] = [
    [(-30.0, -36.0), (-46.0, -8.0)],
    [(12.0, -40.0), (-6.0, -20.0)],
    [(34.0, -34.0), (50.0, -6.0)],
    [(-8.0, -46.0), (8.0, -8.0)],
];

/// Two tools move over the board. Meanwhile a hand moves one black peg after the other to another place, and back.
pub(super) fn moved_pegs(cast: &SceneContext) -> Script {
    const WAIT_S: f64 = 0.7;
    const MOVING_S: f64 = 0.8;
    let mut hands = [cast.hand(true), cast.hand(false)];
    let at_first = |[(x, y), _]: [(f64, f64); 2]| MovedProp {
        prop: black(above(x, y, 0.0), above(x, y, 22.0), 3.0),
        shift: ReachSum::resting_at(Vector3::zeros()),
    };
    let mut moved = PEGS.map(at_first);
    let mut lap = 0;
    cast.laps(PEGS.len(), || {
        let (peg, is_back) = (lap % PEGS.len(), lap / PEGS.len() % 2 == 1);
        let [from, to] = PEGS[peg].map(|(x, y)| Vector3::new(x, y, 0.0));
        let way = if is_back { from - to } else { to - from };
        moved[peg].shift.add_reach(together(&mut hands) + WAIT_S, MOVING_S, way);
        lap += 1;
        for (hand, side) in hands.iter_mut().zip([-1.0, 1.0]) {
            hand.wait(0.6);
            for (x, y, over) in [(22.0, -12.0, 34.0), (44.0, 14.0, 40.0)] {
                hand.reach(above(side * x, y, over), ReachEnding::Stop);
                hand.pause();
            }
        }
        together(&mut hands)
    });
    let [left, right] = hands;
    Script { hands: vec![(0, left), (1, right)], moved: moved.into(), ..Script::default() }
}

/// Two tools move over and beside bars, a ball and posts that look like shafts.
pub(super) fn black_props(cast: &SceneContext) -> Script {
    let mut hands = [cast.hand(true), cast.hand(false)];
    let targets = [[(-40.0, -26.0), (-14.0, -32.0), (-32.0, 8.0)], [(40.0, -34.0), (16.0, -2.0), (46.0, 10.0)]];
    cast.laps(2, || {
        for (hand, targets) in hands.iter_mut().zip(targets) {
            hand.wait(0.6);
            for (x, y) in targets {
                hand.reach(above(x, y, 22.0), ReachEnding::Stop);
                hand.pause();
            }
        }
        together(&mut hands)
    });
    let post = |x, y| black(above(x, y, 0.0), above(x, y, 18.0), 2.5);
    let props = vec![
        black(above(-120.0, -74.0, 4.0), above(116.0, -84.0, 4.0), 4.0), // behind the shafts, seen from the side
        black(above(-72.0, -12.0, 3.0), above(34.0, -24.0, 3.0), 3.0),
        black(above(-30.0, 30.0, 2.5), above(72.0, 12.0, 2.5), 2.5),
        black(above(-52.0, 14.0, 7.0), above(-52.0, 14.0, 7.0), 9.0),
        post(28.0, -14.0),
        post(-24.0, -46.0),
    ];
    let [left, right] = hands;
    Script { hands: vec![(0, left), (1, right)], props, ..Script::default() }
}

/// A rod with the surface of a black shaft.
fn black(a: Point3<f64>, b: Point3<f64>, radius: f64) -> Prop {
    Prop { solid: RoundCone::capsule(a, b, radius), material: BLACK }
}

/// Lets the hand that is ready earlier wait for the other; returns the time, s.
fn together(hands: &mut [SimulatedHand; 2]) -> f64 {
    let later_s = hands[0].now_s().max(hands[1].now_s());
    hands.iter_mut().for_each(|hand| hand.wait_until(later_s));
    later_s
}
