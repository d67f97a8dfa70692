//! Poses of one simulated session, with edges as wrong as real ones, corrected together.

use nalgebra::{Matrix5, Point3, Vector3};
use rand::rngs::SmallRng;
use rand::{Rng, SeedableRng};

use super::*;
use crate::vision::camera::Camera;
use crate::vision::camera::testing::wide;
use crate::vision::pose::joint_fit::{self, MeasuredEdge, Trust};
use crate::vision::pose::normal_equations::{NormalEquations, OffsetPriors, shared_offsets_px};
use crate::vision::pose::packed::PackedPoses;
use crate::vision::pose::testing::{self, LENGTH_MM, gaussian};
use crate::vision::pose::{StoredPose, perpendiculars};

const FULCRUM: Point3<f64> = Point3::new(-118.0, 108.0, 64.0);

/// Tools in one trocar whose tips move about by `reach_mm`.
fn tubes(reach_mm: f64) -> Vec<Tube> {
    (0..60)
        .map(|k| {
            let t = f64::from(k) * 0.3;
            let wander = Vector3::new((t * 0.7).sin(), t.cos(), 0.5 * (t * 1.3).sin()) * reach_mm;
            let tip = Point3::new(-20.0, -5.0, 190.0) + wander;
            Tube { tip, axis: (tip - FULCRUM).normalize(), radius: 2.5 }
        })
        .collect()
}

/// Edges along a tube's outline, shifted by offsets of the session, offsets of this pose, and noise.
fn edges(tube: &Tube, camera: &Camera, shared: &Offsets, random: &mut impl Rng) -> Vec<MeasuredEdge> {
    const NOISE_PX: f64 = 0.1;
    let own = Offsets::from([0.03, 0.05, 0.08, 0.12, 0.03, 0.05, 0.05].map(|sigma| sigma * gaussian(random)));
    let backs_mm: Vec<f64> = (0..8).map(|k| 2.0 + 3.0 * f64::from(k)).collect();
    testing::edges(tube, camera, &backs_mm, &(shared + own), NOISE_PX, random)
}

/// A session's true tubes, and its poses, each measured alone.
fn session(reach_mm: f64, shared: [f64; OFFSETS], seed: u64) -> Vec<(Tube, TubeEstimate)> {
    let (camera, mut random) = (wide(), SmallRng::seed_from_u64(seed));
    let measured = tubes(reach_mm).into_iter().filter_map(|tube| {
        let edges = edges(&tube, &camera, &shared.into(), &mut random);
        let beliefs = OffsetPriors::usual(LENGTH_MM);
        Some((tube, joint_fit::fit(&edges, &tube, &camera, Trust::Majority, &beliefs, None)?))
    });
    measured.collect()
}

fn poses(session: &[(Tube, TubeEstimate)]) -> Vec<TubeEstimate> {
    session.iter().map(|(_, pose)| *pose).collect()
}

fn rms_mm(errors: impl Iterator<Item = f64>) -> f64 {
    let (count, squares) = errors.fold((0.0, 0.0), |(n, s), e| (n + 1.0, s + e * e));
    (squares / f64::max(count, 1.0)).sqrt()
}

#[test]
fn the_fulcrum_is_found_within_its_stated_error() {
    let session = session(30.0, [0.0; OFFSETS], 1);
    let shared = estimate(&poses(&session)).unwrap();
    let miss = shared.fulcrum.at - FULCRUM;
    let squared = miss.dot(&(shared.fulcrum.covariance.try_inverse().unwrap() * miss));
    assert!(miss.norm() < 6.0 && squared < 16.3, "{miss:?}, squared {squared}");
}

#[test]
fn steadied_poses_are_much_closer_than_single_ones() {
    let session = session(30.0, [0.03, 0.1, 0.1, 0.1, 0.02, 0.05, 0.05], 2);
    let shared = estimate(&poses(&session)).unwrap();
    let alone = rms_mm(session.iter().map(|(tube, pose)| (pose.tube.tip - tube.tip).norm()));
    let together =
        rms_mm(session.iter().map(|(tube, pose)| (steady(pose, &shared).unwrap().tube.tip - tube.tip).norm()));
    assert!(together < 0.75 * alone, "{together} mm together, {alone} alone");
}

#[test]
fn an_offset_of_both_borders_is_separated_from_depth() {
    let widening = 0.12;
    let session = session(40.0, [widening, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 3);
    let shared = estimate(&poses(&session)).unwrap();
    assert!((0.3 * widening..1.3 * widening).contains(&shared.offsets[0]), "{}", shared.offsets[0]);
}

/// Checks the stated covariance over many sessions, with offsets distributed as in the priors.
#[test]
fn steadied_tips_lie_inside_their_stated_region() {
    const CHI_SQUARED_95: f64 = 7.815; // three degrees of freedom
    let mut random = SmallRng::seed_from_u64(4);
    let (mut inside, mut all) = (0, 0);
    for seed in 0..20 {
        let offsets = shared_offsets_px(5.0, 5.0).map(|sigma| sigma * gaussian(&mut random));
        let session = session(25.0, offsets, 100 + seed);
        let shared = estimate(&poses(&session)).unwrap();
        for (tube, pose) in session.iter().step_by(6) {
            let steadied = steady(pose, &shared).unwrap();
            let miss = steadied.tube.tip - tube.tip;
            let squared = miss.dot(&(steadied.tip_covariance().try_inverse().unwrap() * miss));
            all += 1;
            inside += i32::from(squared < CHI_SQUARED_95);
        }
    }
    let share = f64::from(inside) / f64::from(all);
    assert!((0.9..=1.0).contains(&share), "{share} inside");
}

#[test]
fn poses_that_hardly_turn_assume_the_fulcrum_and_say_how_little_they_know() {
    let session = session(1.0, [0.0; OFFSETS], 5);
    let shared = estimate(&poses(&session)).unwrap();
    let miss = shared.fulcrum.at - FULCRUM;
    let squared = miss.dot(&(shared.fulcrum.covariance.try_inverse().unwrap() * miss));
    assert!(shared.fulcrum.covariance.trace().sqrt() > 40.0 && squared < 16.3, "{miss:?}, squared {squared}");
    assert!(!shared.is_right_way_round() && !shared.is_wrong_way_round());
}

#[test]
fn a_few_false_poses_do_not_hold_the_fulcrum() {
    let session = session(30.0, [0.0; OFFSETS], 6);
    let mut spoiled = poses(&session);
    for pose in spoiled.iter_mut().step_by(12) {
        pose.tube = perturbed(&pose.tube, &Vector5::new(0.0, 0.0, 0.0, 0.5, -0.3));
    }
    let shared = estimate(&spoiled).unwrap();
    assert!((shared.fulcrum.at - FULCRUM).norm() < 12.0, "{}", shared.fulcrum.at);
}

#[test]
fn a_pose_that_would_have_to_turn_far_is_refused() {
    let session = session(30.0, [0.0; OFFSETS], 7);
    let shared = estimate(&poses(&session)).unwrap();
    let (_, pose) = session[0];
    let false_axis = perpendiculars(pose.tube.axis)[0];
    let misread = TubeEstimate {
        tube: Tube { axis: (pose.tube.axis + false_axis).normalize(), ..pose.tube },
        equations: NormalEquations::from_covariance(&Matrix5::identity()),
        ..pose
    };
    assert!(steady(&pose, &shared).is_some());
    assert!(steady(&misread, &shared).is_none());
}

#[test]
fn too_few_poses_are_not_enough() {
    assert_eq!(estimate(&poses(&session(30.0, [0.0; OFFSETS], 8))[..5]), None);
}

#[test]
fn packed_poses_come_again_to_the_last_bit() {
    let poses: Vec<StoredPose> =
        session(30.0, [0.0; OFFSETS], 9).iter().map(|(_, pose)| StoredPose::from(pose)).collect();
    let bare = TubeEstimate {
        equations: NormalEquations::from_covariance(&Matrix5::identity()),
        ..session(30.0, [0.0; OFFSETS], 9)[0].1
    };
    let poses: Vec<StoredPose> = poses.into_iter().chain([StoredPose::from(&bare)]).collect();
    let poses = poses.repeat(9); // more than a block
    let mut packed = PackedPoses::default();
    poses.iter().for_each(|pose| packed.push(pose));
    assert!(packed.unpack().eq(poses));
}

#[test]
fn a_kept_pose_is_the_pose_again() {
    for (_, pose) in session(30.0, [0.0; OFFSETS], 9).iter().step_by(7) {
        let again = StoredPose::from(pose).estimate().unwrap();
        assert_eq!(again.tube, pose.tube);
        assert!((again.covariance - pose.covariance).norm() < 1e-6 * pose.covariance.norm());
        assert!((again.lasting - pose.lasting).norm() < 1e-6 * pose.lasting.norm());
    }
}

/// The same band, taken the wrong way round.
fn reversed(pose: &TubeEstimate) -> TubeEstimate {
    let Tube { tip, axis, radius } = pose.tube;
    TubeEstimate { tube: Tube { tip: tip - axis * LENGTH_MM, axis: -axis, radius }, ..*pose }
}

fn assert_way_round_is_shown(reach_mm: f64, seed: u64) {
    let right = poses(&session(reach_mm, [0.0; OFFSETS], seed));
    let wrong: Vec<TubeEstimate> = right.iter().map(reversed).collect();
    let is = |poses: &[TubeEstimate]| {
        estimate(poses).map(|shared| (shared.is_right_way_round(), shared.is_wrong_way_round()))
    };
    assert_eq!(is(&right), Some((true, false)), "{reach_mm} mm, seed {seed}");
    assert_eq!(is(&wrong), Some((false, true)), "{reach_mm} mm, seed {seed}");
}

#[test]
fn axes_show_which_way_round_the_poses_lie() {
    for (reach_mm, seed) in [(30.0, 11), (15.0, 12)] {
        assert_way_round_is_shown(reach_mm, seed);
    }
}

/// Poses that turn far would have to turn farther to meet on the wrong side. In 2 of these 40 sessions, the fit of that
/// side does not settle.
#[test]
fn the_way_round_is_shown_also_if_the_fit_of_the_wrong_side_does_not_settle() {
    (1000..1040).for_each(|seed| assert_way_round_is_shown(50.0, seed));
}

#[test]
fn axes_that_do_not_meet_are_those_of_no_tool() {
    let right = poses(&session(30.0, [0.0; OFFSETS], 14));
    let shifted = |(k, pose): (usize, &TubeEstimate)| {
        let axis =
            perturbed(&pose.tube, &Vector5::new(0.0, 0.0, 0.0, 0.6 * (k as f64).sin(), 0.6 * (1.7 * k as f64).cos()))
                .axis;
        TubeEstimate { tube: Tube { axis, ..pose.tube }, ..*pose }
    };
    let turned: Vec<TubeEstimate> = right.iter().enumerate().map(shifted).collect();
    assert_eq!(estimate(&turned), None);
}

#[test]
fn a_tool_that_rests_or_goes_straight_shows_no_direction() {
    let right = poses(&session(30.0, [0.0; OFFSETS], 13));
    let shows_none = |poses: &[TubeEstimate]| {
        estimate(poses).is_none_or(|shared| !shared.is_right_way_round() && !shared.is_wrong_way_round())
    };
    assert!(shows_none(&vec![reversed(&right[0]); 60]), "nothing turns");
    let axis = right[0].tube.axis;
    let along: Vec<TubeEstimate> = (0..60)
        .map(|k| TubeEstimate {
            tube: Tube { tip: right[0].tube.tip + axis * f64::from(k), ..right[0].tube },
            ..right[0]
        })
        .collect();
    assert!(shows_none(&along), "it goes along its axis");
}
