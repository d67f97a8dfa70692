//! The self-test of a box: the printed checkerboard lies on the mat, then on a block. Each time the end of a rod is
//! held on six of its inner corners.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::{SceneContext, Script, SimulatedHand};
use crate::random::Dice;
use crate::simulation::checkerboard::{self, HeldBoard};
use crate::simulation::motion::Oscillation;
use crate::simulation::rig::above;

/// Columns and rows of the corners that are touched, in order.
const TOUCHED: [(usize, usize); 6] = [(1, 1), (4, 1), (7, 1), (7, 4), (4, 4), (1, 4)];
/// How long the rod rests on each corner, s.
const HELD_S: f64 = 2.0;
/// Height of the board on the mat (its thickness), mm.
const LYING_MM: f64 = 2.0;
/// Height of the board on its block over the mat, mm.
const LIFTED_MM: f64 = 30.0;
/// Height of the rod over the board between two corners, mm.
const OVER_MM: f64 = 18.0;

/// The left hand holds one rod.
pub(super) fn self_test(cast: &SceneContext, diameter_mm: f64) -> Script {
    let trocar = cast.rig.camera_from_board.inverse() * cast.rig.fulcrums[0];
    let away = trocar + (above(-20.0, 10.0, 40.0) - trocar) * 0.24;
    let mut hand = cast.hand_at(away, "left hand");
    let mut dice = Dice::new(cast.seed, "placing");
    let mut sheets = Vec::new();
    cast.laps(2, || {
        let up_mm = if sheets.len() % 2 == 0 { LYING_MM } else { LIFTED_MM };
        let board_from_sheet = laid(&mut dice, up_mm);
        sheets.push((hand.now_s(), board_from_sheet));
        hand.wait(3.0);
        hand.glide(above(-20.0, 10.0, 70.0), 1.0);
        for (column, row) in TOUCHED {
            let corner = checkerboard::corner(&HeldBoard::flat(board_from_sheet), column, row);
            touch(&mut hand, resting_on(corner, trocar, 0.5 * diameter_mm));
        }
        hand.glide(away, 1.0);
        hand.wait(2.0);
        hand.now_s()
    });
    Script { hands: vec![(0, hand)], sheets, ..Script::default() }
}

/// The unsteadiness of a rod held on paper: five sines of this RMS stay below 0.1 mm nearly always.
pub(crate) fn touch_wobble(seed: u64) -> Oscillation {
    Oscillation::new(&mut Dice::new(seed, "touch"), 0.02, 0.5, 4.0)
}

/// The pose of a board laid by hand into the middle of the box: sheet frame → board frame.
fn laid(dice: &mut Dice, up_mm: f64) -> Isometry3<f64> {
    let place = Translation3::new(dice.within(-6.0, 6.0), dice.within(-5.0, 1.0), -up_mm);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), dice.within(-0.06, 0.06));
    Isometry3::from_parts(place, turn)
}

fn touch(hand: &mut SimulatedHand, target: Point3<f64>) {
    let over = target - Vector3::z() * OVER_MM;
    hand.glide(over, 0.7);
    hand.glide(target, 0.5);
    hand.wait(HELD_S);
    hand.glide(over, 0.4);
}

/// Centre of the end of a rod through this trocar whose rim rests on a point of a level board; board frame.
///
/// The rim's lowest point lies below the centre, across the axis. The axis itself depends on the centre, so the
/// solution is iterated.
fn resting_on(corner: Point3<f64>, trocar: Point3<f64>, radius: f64) -> Point3<f64> {
    const ROUNDS: usize = 20;
    let down = Vector3::z();
    let mut tip = corner;
    for _ in 0..ROUNDS {
        let axis = (tip - trocar).normalize();
        tip = corner - (down - axis * axis.dot(&down)).normalize() * radius;
    }
    tip
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rim_of_a_resting_rod_meets_the_board_in_the_corner_and_nowhere_else() {
        let (corner, trocar, radius) = (above(20.0, -30.0, 30.0), above(-112.0, 96.0, 188.0), 2.5);
        let tip = resting_on(corner, trocar, radius);
        let axis = (tip - trocar).normalize();
        let across = axis.cross(&Vector3::x()).normalize();
        let rim = |angle: f64| tip + (across * angle.cos() + axis.cross(&across) * angle.sin()) * radius;
        let lowest =
            (0..3600).map(|i| rim(f64::from(i) * std::f64::consts::TAU / 3600.0)).max_by(|a, b| a.z.total_cmp(&b.z));
        assert!((lowest.unwrap() - corner).norm() < 0.01, "{lowest:?} for {corner:?}");
        assert!(lowest.unwrap().z <= corner.z + 1e-9, "no part of it is below the board");
    }
}
