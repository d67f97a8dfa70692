//! Where a tool comes from. This distinguishes two tools of one colour (METHOD 4.4, *beyond*).
//!
//! Two trocars are centimetres apart and do not move, and each tool's axis passes through its own. If a tool has
//! turned too little to determine its trocar, an assumed one at the usual distance behind the tip is used; if the tool
//! was never seen, the side of the picture where its hand is. All of these answer the same question about a pose: how
//! badly does it match this origin?

use nalgebra::{Matrix3, Matrix3x5, Point3, Vector3};

use super::settings::HandSide;
use crate::vision::pose::fulcrum::{self, Fulcrum, USUAL_TROCAR_DISTANCE_MM};
use crate::vision::pose::{TubeEstimate, perpendiculars};

/// The best known origin of a tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Origin {
    /// Its fulcrum, or an assumed one near its hand.
    Fulcrum(Fulcrum),
    /// A side of the picture.
    Side(HandSide),
}

/// A difference between two squared distances decides if it is at least this large: odds of 3000 to 1 if all errors
/// were Gaussian.
pub const DECISIVE_MARGIN: f64 = 16.0;

/// Maximum mismatch: a pose that matches neither origin then counts the same for both.
const MAX_MISMATCH: f64 = 1e3;

/// Uncertainty of an assumed trocar across the axis when the tool turns: standard deviation, mm.
const ASSUMED_TROCAR_SIGMA_MM: f64 = 25.0;

/// How far a hand may reach across the picture's middle: standard deviation, mm.
const SIDE_SIGMA_MM: f64 = 15.0;

impl Origin {
    /// How badly a pose's edges match this origin: squared standard deviations.
    pub fn mismatch_squared(&self, pose: &TubeEstimate) -> f64 {
        let pose = &pose.by_edges_alone();
        let squared = match self {
            Origin::Fulcrum(fulcrum) if is_ahead_of_tip(pose, fulcrum) => MAX_MISMATCH,
            Origin::Fulcrum(fulcrum) => fulcrum::miss_squared(pose, fulcrum),
            Origin::Side(side) => side_mismatch_squared(pose, *side),
        };
        squared.min(MAX_MISMATCH)
    }

    /// Position in the camera frame, mm, if known.
    pub fn position(&self) -> Option<Point3<f64>> {
        match self {
            Origin::Fulcrum(fulcrum) => Some(fulcrum.at),
            Origin::Side(_) => None,
        }
    }
}

/// The assumed trocar of a tool: at the usual distance behind its tip.
pub fn assumed_trocar(pose: &TubeEstimate) -> Fulcrum {
    let covariance = Matrix3::identity() * (ASSUMED_TROCAR_SIGMA_MM * ASSUMED_TROCAR_SIGMA_MM);
    Fulcrum { at: pose.tube.tip - pose.tube.axis * USUAL_TROCAR_DISTANCE_MM, covariance }
}

/// Does the fulcrum lie ahead of the tip? A trocar always lies behind it.
fn is_ahead_of_tip(pose: &TubeEstimate, fulcrum: &Fulcrum) -> bool {
    (fulcrum.at - pose.tube.tip).dot(&pose.tube.axis) > 0.0
}

/// How far the hand lies on the other side of the picture's middle, squared and normalised; 0 on its own side.
fn side_mismatch_squared(pose: &TubeEstimate, side: HandSide) -> f64 {
    let [first, second] = perpendiculars(pose.tube.axis);
    let columns: [Vector3<f64>; 5] = [
        Vector3::x(),
        Vector3::y(),
        Vector3::z(),
        first * -USUAL_TROCAR_DISTANCE_MM,
        second * -USUAL_TROCAR_DISTANCE_MM,
    ];
    let hand_by_pose = Matrix3x5::from_columns(&columns);
    let spread = hand_by_pose * pose.covariance * hand_by_pose.transpose();
    let right_mm = assumed_trocar(pose).at.x;
    let beyond_mm = match side {
        HandSide::Left => right_mm.max(0.0),
        HandSide::Right => (-right_mm).max(0.0),
    };
    beyond_mm * beyond_mm / (spread[(0, 0)] + SIDE_SIGMA_MM * SIDE_SIGMA_MM)
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix5;

    use super::*;
    use crate::vision::pose::normal_equations::NormalEquations;
    use crate::vision::tube::Tube;

    const TROCAR: Point3<f64> = Point3::new(-112.0, 96.0, 60.0);

    /// A tool from a trocar to a tip, with a pose's usual uncertainty: its lean to 0.03 radians.
    fn from(trocar: Point3<f64>, tip: Point3<f64>) -> TubeEstimate {
        let tube = Tube { tip, axis: (tip - trocar).normalize(), radius: 2.5 };
        let covariance = Matrix5::from_diagonal(&[0.01, 0.01, 0.5, 1e-3, 1e-3].into());
        TubeEstimate {
            tube,
            covariance,
            lasting: covariance,
            equations: NormalEquations::from_covariance(&covariance),
            residual_px: 0.2,
            support: 50.0,
        }
    }

    fn opposite() -> Point3<f64> {
        Point3::new(-TROCAR.x, TROCAR.y, TROCAR.z)
    }

    #[test]
    fn each_origin_distinguishes_a_hand_on_the_left_from_one_on_the_right() {
        let known = Fulcrum { at: TROCAR, covariance: Matrix3::identity() };
        let seen = assumed_trocar(&from(TROCAR, Point3::new(-30.0, 10.0, 190.0)));
        for origin in [Origin::Fulcrum(known), Origin::Fulcrum(seen), Origin::Side(HandSide::Left)] {
            for tip in [Point3::new(25.0, -20.0, 200.0), Point3::new(-40.0, 5.0, 170.0)] {
                let (own, other) =
                    (origin.mismatch_squared(&from(TROCAR, tip)), origin.mismatch_squared(&from(opposite(), tip)));
                assert!(other - own > DECISIVE_MARGIN, "{origin:?} at {tip}: {own} own, {other} other");
            }
        }
    }

    #[test]
    fn a_hand_in_the_middle_is_on_neither_side() {
        let pose = from(Point3::new(3.0, 140.0, 60.0), Point3::new(0.0, 0.0, 190.0));
        let against = [HandSide::Left, HandSide::Right].map(|side| Origin::Side(side).mismatch_squared(&pose));
        assert!(against.iter().all(|a| *a < DECISIVE_MARGIN), "{against:?}");
    }

    #[test]
    fn a_trocar_beyond_the_tip_is_not_the_tools() {
        let pose = from(TROCAR, Point3::new(0.0, 0.0, 190.0));
        let ahead = pose.tube.tip + pose.tube.axis * 90.0;
        let origin = Origin::Fulcrum(Fulcrum { at: ahead, covariance: Matrix3::identity() });
        assert!(origin.mismatch_squared(&pose) > 100.0);
    }
}
