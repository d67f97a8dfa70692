//! Scenes that test the measurement rather than the trainee: approach, slide, rest, crossing, exchange.

use nalgebra::Point3;

use super::{ReachEnding, SceneContext, Script, SimulatedHand};
use crate::random::Dice;
use crate::simulation::board::Prop;
use crate::simulation::light::Material;
use crate::simulation::motion::Oscillation;
use crate::simulation::rig::{RigView, above};
use crate::simulation::shape::RoundCone;

const RAIL: Material = Material { matt: [0.34, 0.35, 0.37], gloss: 0.5, sharpness: 26, mirror: 0.25 };
const FOAM: Material = Material { matt: [0.3, 0.31, 0.33], gloss: 0.03, sharpness: 8, mirror: 0.0 };

/// One tool goes straight towards the camera and back: the hardest case for depth.
pub(super) fn approach(cast: &SceneContext) -> Script {
    let (far, near) = match cast.rig.view {
        RigView::Top => (above(-6.0, -6.0, 22.0), above(-4.0, 10.0, 128.0)),
        RigView::Side => (above(-6.0, -30.0, 22.0), above(-4.0, 52.0, 88.0)),
    };
    let mut hand = cast.hand_at(far, "left hand");
    let mut dice = Dice::new(cast.seed, "approach");
    hand.wait(0.8);
    cast.laps(3, || {
        hand.glide(near, dice.within(2.0, 3.4));
        hand.wait(0.6);
        hand.glide(far, dice.within(1.6, 3.0));
        hand.wait(0.6);
        hand.now_s()
    });
    Script { hands: vec![(0, hand)], ..Script::default() }
}

/// One tool is slid along a rail and back, five times, with a hand's wobble of at most 0.3 mm.
pub(super) fn slide(cast: &SceneContext) -> Script {
    let (start, end) = (above(-48.0, 4.0, 18.0), above(44.0, -26.0, 30.0));
    let mut dice = Dice::new(cast.seed, "slide");
    let mut hand = cast.hand_at(start, "left hand").steady();
    hand.wait(0.6);
    cast.laps(5, || {
        for target in [end, start] {
            hand.glide(target, dice.within(1.5, 2.2));
            hand.wait(0.3);
        }
        hand.now_s()
    });
    let under = |p: Point3<f64>| Point3::new(p.x, p.y, p.z + 4.0);
    let rod = |a, b, radius| Prop { solid: RoundCone::capsule(a, b, radius), material: RAIL };
    let post = |p: Point3<f64>| rod(under(p), Point3::new(p.x, p.y, 0.0), 2.2);
    let props = vec![rod(under(start), under(end), 1.6), post(start), post(end)];
    Script { hands: vec![(0, hand)], props, ..Script::default() }
}

/// The wobble of a guided slide: five sines of this RMS stay below 0.3 mm nearly always.
pub(crate) fn slide_wobble(seed: u64) -> Oscillation {
    Oscillation::new(&mut Dice::new(seed, "wobble"), 0.06, 0.5, 4.0)
}

/// One tool rests against a ball of foam and does not move.
pub(super) fn rest(cast: &SceneContext) -> Script {
    let mut dice = Dice::new(cast.seed, "rest");
    let place = above(dice.within(-14.0, 14.0), dice.within(-22.0, 0.0), 24.0);
    let mut hand = cast.hand_at(place, "left hand").steady();
    hand.wait(8.0);
    let ball = RoundCone::sphere(Point3::new(place.x, place.y + 3.0, -9.0), 9.0);
    let block = Prop { solid: ball, material: FOAM };
    Script { hands: vec![(0, hand)], props: vec![block], ..Script::default() }
}

/// The right tool passes behind the left one three times, then leaves the picture and comes back.
pub(super) fn crossing(cast: &SceneContext) -> Script {
    let (front, beside, behind) = match cast.rig.view {
        RigView::Top => {
            (above(8.0, -20.0, 78.0), above(14.0, -14.0, 72.0), [above(34.0, -24.0, 16.0), above(-38.0, -30.0, 16.0)])
        }
        RigView::Side => {
            (above(8.0, 14.0, 40.0), above(16.0, 20.0, 46.0), [above(36.0, -48.0, 14.0), above(-40.0, -50.0, 14.0)])
        }
    };
    let mut left = cast.hand_at(front, "left hand");
    let mut right = cast.hand_at(behind[0], "right hand");
    let away = away_from_view(cast, 1, behind[0], 0.8);
    left.wait(0.5);
    right.wait(0.8);
    cast.laps(1, || {
        for pass in 0..3 {
            right.reach(behind[(pass + 1) % 2], ReachEnding::Stop);
            right.pause();
        }
        right.reach(behind[0], ReachEnding::Stop);
        right.glide(away, 1.3);
        right.wait(1.2);
        right.glide(behind[0], 1.5);
        right.pause();
        while left.now_s() < right.now_s() - 2.0 {
            left.reach(beside, ReachEnding::Flow);
            left.pause();
            left.reach(front, ReachEnding::Stop);
            left.pause();
        }
        right.now_s()
    });
    Script { hands: vec![(0, left), (1, right)], ..Script::default() }
}

/// Both tools cross to the other's side and back, one above the other. Then both leave the picture, the left one first,
/// and return where the other was, the right one first: only the trocars identify the tools.
pub(super) fn exchange(cast: &SceneContext) -> Script {
    let (at_left, at_right) = match cast.rig.view {
        RigView::Top => (
            [above(-32.0, -8.0, 74.0), above(26.0, -16.0, 78.0)],
            [above(34.0, -24.0, 16.0), above(-38.0, -30.0, 16.0)],
        ),
        RigView::Side => {
            ([above(-30.0, 10.0, 42.0), above(26.0, 16.0, 44.0)], [above(36.0, -48.0, 14.0), above(-40.0, -50.0, 14.0)])
        }
    };
    let mut left = cast.hand_at(at_left[0], "left hand");
    let mut right = cast.hand_at(at_right[0], "right hand");
    let away = [away_from_view(cast, 0, at_left[0], 0.74), away_from_view(cast, 1, at_right[0], 0.74)];
    left.wait(0.6);
    right.wait(0.6);
    let together = |left: &mut SimulatedHand, right: &mut SimulatedHand| {
        let later_s = left.now_s().max(right.now_s());
        left.wait_until(later_s);
        right.wait_until(later_s);
    };
    cast.laps(1, || {
        for place in [1, 0] {
            left.reach(at_left[place], ReachEnding::Stop);
            right.reach(at_right[place], ReachEnding::Stop);
            together(&mut left, &mut right);
        }
        left.glide(away[0], 1.2);
        right.wait(0.5);
        right.glide(away[1], 1.2);
        right.wait(0.8);
        right.glide(at_right[1], 1.4);
        left.wait_until(right.now_s() - 0.4);
        left.glide(at_left[1], 1.4);
        together(&mut left, &mut right);
        left.reach(at_left[0], ReachEnding::Stop);
        right.reach(at_right[0], ReachEnding::Stop);
        together(&mut left, &mut right);
        right.now_s()
    });
    Script { hands: vec![(0, left), (1, right)], ..Script::default() }
}

/// The point at this share of the way to a trocar: so near to it that no part of the tool is in the picture.
fn away_from_view(cast: &SceneContext, side: usize, from: Point3<f64>, share: f64) -> Point3<f64> {
    let trocar = cast.rig.camera_from_board.inverse() * cast.rig.fulcrums[side];
    from + (trocar - from) * share
}
