//! Joint adjustment of all poses of a session: estimates the fulcrum, and by how much each part of the outline is off
//! in all of them (bundle adjustment).
//!
//! One pose cannot separate an offset of its borders from its depth: for a 5 mm tool at 720 lines, a tenth of a pixel
//! is a millimetre. Many poses can, because they share the band's length and the point that every axis passes through.
//! **Method** Gauss–Newton. Each pose's edges are a quadratic cost of its own unknowns
//! ([`super::normal_equations`]). Eliminating these (Schur complement) leaves those that all poses share: three of the
//! fulcrum, and the offsets. **Assumes** that a pose's offsets differ from the shared ones within its stated priors,
//! and alike in similar poses, which therefore count as one ([`weights`]), and that the trocar lies at about the usual
//! distance from the tips. If the axes turn too little to meet anywhere, it is assumed there. **Direction** The axes of
//! poses that lie the wrong way round meet ahead of the tips. So the adjustment is solved for a trocar on either side,
//! and the difference in likelihood says how clearly the poses show theirs.

use nalgebra::{Matrix2, Matrix3, Matrix5, Point3, SMatrix, SVector, Vector3, Vector5};

use super::fulcrum::{
    self, Fulcrum, FulcrumConstraint, MAX_FULCRUM_MISS_SQUARED, MIN_TROCAR_DISTANCE_RADII, PLAY_MM,
    TROCAR_DISTANCE_SIGMA_MM, USUAL_TROCAR_DISTANCE_MM,
};
use super::normal_equations::{Information, OFFSETS, OWN_UNKNOWNS, Offsets};
use super::{TubeEstimate, perturbed};
use crate::vision::tube::{OutlinePart, Tube};

/// Number of unknowns that all poses share: the fulcrum, then the offsets.
const SHARED: usize = 3 + OFFSETS;
type SharedMatrix = SMatrix<f64, SHARED, SHARED>;
type SharedVector = SVector<f64, SHARED>;
type OwnVector = SVector<f64, OWN_UNKNOWNS>;

/// Prior standard deviation of a band's length that was not measured, as a share of it.
const LENGTH_WITHIN: f64 = 0.1;

/// Maximum turn of a pose towards the fulcrum, radians: beyond it, the linearisation is invalid.
const MAX_TURN_RAD: f64 = 0.35;

/// Minimum number of poses.
pub(super) const MIN_POSES: usize = 10;

/// A trocar on one side of the tips is certain if it is at least this much likelier than one on the other, in squared
/// standard deviations: odds of 90 to 1 if all errors were Gaussian.
const MIN_SIDE_MARGIN: f64 = 9.0;

/// The unknowns that a session's poses share.
#[derive(Clone, Debug, PartialEq)]
pub struct Adjustment {
    /// The point that all axes pass through.
    pub fulcrum: Fulcrum,
    /// By how much its edges are off, pixels. If the band was not measured, that of the proximal end is in mm beyond
    /// [`Adjustment::length_mm`].
    pub offsets: Offsets,
    /// Reference length of the band for the offsets, mm.
    pub length_mm: f64,
    /// How much likelier a trocar behind the tips is than one ahead of them, in squared standard deviations.
    likelier_behind: f64,
    /// Covariance of fulcrum and offsets.
    covariance: SharedMatrix,
}

/// Estimates the shared unknowns. `None` if the poses are too few; and if the estimate does not settle or the axes of
/// most poses do not meet behind the tips, unless they clearly lie the wrong way round.
pub fn estimate(poses: &[TubeEstimate]) -> Option<Adjustment> {
    /// Share of the poses whose axes must pass the fulcrum behind them: the others are false.
    const MIN_MEETING: f64 = 0.75;
    let behind = fit(poses, Trocar::BehindTips)?;
    let ahead = fit(poses, Trocar::AheadOfTips);
    let likelier_behind = ahead.map_or(0.0, |ahead| behind.likelier_than(&ahead));
    let shared = Adjustment { likelier_behind, ..behind.shared };
    let meets = |pose: &&TubeEstimate| {
        shared.is_behind(&pose.tube) && fulcrum::miss_squared(pose, &shared.fulcrum) < MAX_FULCRUM_MISS_SQUARED
    };
    let meeting = poses.iter().filter(meets).count() as f64 / poses.len() as f64;
    ((behind.is_settled && meeting >= MIN_MEETING) || shared.is_wrong_way_round()).then_some(shared)
}

/// On which side of the tips a trocar is assumed.
#[derive(Clone, Copy)]
enum Trocar {
    BehindTips,
    AheadOfTips,
}

/// The shared unknowns for a trocar on one side of the tips.
struct Fit {
    shared: Adjustment,
    /// How badly the poses match them: minus twice the logarithm of their likelihood, up to a constant.
    cost: f64,
    /// The cost less the decrease that the last step predicts.
    least_cost: f64,
    is_settled: bool,
}

impl Fit {
    /// By how much this fit is likelier than another one, in squared standard deviations; negative if it is less likely,
    /// and 0 if the fit that seems likelier has not settled. The other one may be unsettled: a trocar on the wrong side
    /// turns poses so far that its fit often does not settle.
    fn likelier_than(&self, other: &Self) -> f64 {
        let (own_lead, others_lead) = (other.least_cost - self.cost, self.least_cost - other.cost);
        match (own_lead > 0.0 && self.is_settled, others_lead > 0.0 && other.is_settled) {
            (true, _) => own_lead,
            (_, true) => -others_lead,
            _ => 0.0,
        }
    }
}

/// Fits the shared unknowns for a trocar on one side of the tips.
fn fit(poses: &[TubeEstimate], place: Trocar) -> Option<Fit> {
    const ROUNDS: usize = 30;
    const SETTLED_MM: f64 = 1e-2;
    /// Last step, as a share of the fulcrum's standard deviation, that makes no difference.
    const SETTLED_SHARE: f64 = 0.3;
    if poses.len() < MIN_POSES {
        return None;
    }
    let prior = Prior::of(poses, place)?;
    let mut shared = prior.start(poses)?;
    let weights = weights(poses);
    let mut solved: Vec<AdjustedPose> = poses.iter().map(AdjustedPose::new).collect();
    let (mut last_mm, mut cost, mut decrease) = (f64::INFINITY, 0.0, 0.0);
    for _ in 0..ROUNDS {
        let (mut matrix, mut right) = prior.equations(&shared);
        cost = prior.cost(&shared);
        for (pose, weight) in solved.iter_mut().zip(&weights) {
            let (information, pull, own_cost) = pose.solve(&shared)?;
            let (robust, excess) = robust_weight(&information, &pull);
            matrix += information * (weight * robust);
            right += pull * (weight * robust);
            cost += weight * (own_cost - excess);
        }
        shared.covariance = matrix.cholesky()?.inverse();
        let step = shared.covariance * right;
        if !step.iter().all(|c| c.is_finite()) {
            return None;
        }
        decrease = right.dot(&step);
        shared.apply_step(&step);
        solved.iter_mut().for_each(|pose| pose.apply_shared_step(&step));
        last_mm = step.fixed_rows::<3>(0).norm();
        if last_mm < SETTLED_MM {
            break;
        }
    }
    // The robust weights of a few poses may change to and fro for ever.
    let is_settled = last_mm < f64::max(SETTLED_MM, SETTLED_SHARE * shared.fulcrum.covariance.trace().sqrt());
    Some(Fit { shared, cost, least_cost: cost - decrease, is_settled })
}

/// What is known of the shared unknowns before any pose: the offsets are about 0, and the trocar lies at the usual
/// distance from the tips.
struct Prior {
    offset_sigmas_px: [f64; OFFSETS],
    /// The mean tip, and the mean direction from the tips to the trocar.
    middle: Point3<f64>,
    to_trocar: Vector3<f64>,
}

impl Prior {
    fn of(poses: &[TubeEstimate], place: Trocar) -> Option<Self> {
        let variance = |part: usize| poses.iter().map(|pose| square(pose.equations.shared_px()[part])).sum::<f64>();
        let mut offset_sigmas_px: [f64; OFFSETS] =
            std::array::from_fn(|part| (variance(part) / poses.len() as f64).sqrt());
        if poses[0].equations.is_length_unknown() {
            offset_sigmas_px[OutlinePart::ProximalEnd.index()] = LENGTH_WITHIN * poses.last()?.equations.length_mm();
        }
        let middle = poses.iter().map(|pose| pose.tube.tip.coords).sum::<Vector3<f64>>() / poses.len() as f64;
        let ahead = poses.iter().map(|pose| pose.tube.axis).sum::<Vector3<f64>>().try_normalize(1e-9)?;
        let to_trocar = match place {
            Trocar::BehindTips => -ahead,
            Trocar::AheadOfTips => ahead,
        };
        Some(Self { offset_sigmas_px, middle: middle.into(), to_trocar })
    }

    fn start(&self, poses: &[TubeEstimate]) -> Option<Adjustment> {
        let at = self.middle + self.to_trocar * USUAL_TROCAR_DISTANCE_MM;
        Some(Adjustment {
            fulcrum: Fulcrum { at, covariance: Matrix3::zeros() },
            offsets: Offsets::zeros(),
            length_mm: poses.last()?.equations.length_mm(),
            likelier_behind: 0.0,
            covariance: SharedMatrix::zeros(),
        })
    }

    /// How much nearer the trocar lies than usual, mm.
    fn nearer_mm(&self, shared: &Adjustment) -> f64 {
        USUAL_TROCAR_DISTANCE_MM - (shared.fulcrum.at - self.middle).dot(&self.to_trocar)
    }

    fn equations(&self, shared: &Adjustment) -> (SharedMatrix, SharedVector) {
        let (mut matrix, mut right) = (SharedMatrix::zeros(), SharedVector::zeros());
        let by_distance = 1.0 / square(TROCAR_DISTANCE_SIGMA_MM);
        matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&(self.to_trocar * self.to_trocar.transpose() * by_distance));
        right.fixed_rows_mut::<3>(0).copy_from(&(self.to_trocar * (self.nearer_mm(shared) * by_distance)));
        for (part, sigma) in self.offset_sigmas_px.into_iter().enumerate() {
            matrix[(3 + part, 3 + part)] = 1.0 / square(sigma);
            right[3 + part] = -shared.offsets[part] / square(sigma);
        }
        (matrix, right)
    }

    fn cost(&self, shared: &Adjustment) -> f64 {
        let offsets = shared.offsets.iter().zip(self.offset_sigmas_px).map(|(offset, sigma)| square(offset / sigma));
        square(self.nearer_mm(shared) / TROCAR_DISTANCE_SIGMA_MM) + offsets.sum::<f64>()
    }
}

/// Steadies a pose: returns the most likely pose given the session's fulcrum and offsets and their uncertainty. `None`
/// if the pose would have to turn by more than [`MAX_TURN_RAD`]: its edges then belong to something else.
pub fn steady(pose: &TubeEstimate, shared: &Adjustment) -> Option<TubeEstimate> {
    const ROUNDS: usize = 4;
    let evidence = &pose.equations;
    let (own_px, share) = (evidence.own_px(), evidence.shared_offset_scale());
    // The axis may miss the fulcrum by the fulcrum's error and the play. The edges' offsets may differ from the shared
    // ones by the shared offsets' error and the pose's own offsets.
    let apart_px: [f64; OFFSETS] =
        std::array::from_fn(|part| own_px[part].hypot(share[part] * shared.covariance[(3 + part, 3 + part)].sqrt()));
    let information = evidence.information();
    let mut change = OwnVector::zeros();
    let mut result = None;
    for _ in 0..ROUNDS {
        let tube = perturbed(&pose.tube, &tube_part(&change));
        let play = FulcrumConstraint::at(&tube, shared.fulcrum.at).play(&shared.fulcrum);
        let equations = PoseEquations::at(pose, &information, &change, shared, &play, &apart_px)?;
        let inverse = equations.own.cholesky()?.inverse();
        change = inverse * equations.right;
        // The edges' own noise changes from frame to frame; offsets, play, and errors of the shared unknowns last.
        let through = inverse * equations.cross;
        let passing = inverse * information * inverse;
        let differing = inverse * equations.own_error_covariance(&own_px, &apart_px) * inverse;
        result = Some((passing, through * shared.covariance * through.transpose() + differing));
    }
    if change.fixed_rows::<2>(3).norm() > MAX_TURN_RAD {
        return None;
    }
    let (passing, lasting) = result?;
    let of_tube = |all: Information| -> Matrix5<f64> {
        let block = all.fixed_view::<5, 5>(0, 0).into_owned();
        (block + block.transpose()) * 0.5
    };
    let (passing, lasting) = (of_tube(passing), of_tube(lasting));
    Some(TubeEstimate {
        tube: perturbed(&pose.tube, &tube_part(&change)),
        covariance: passing + lasting,
        lasting,
        ..*pose
    })
}

impl Adjustment {
    /// The fulcrum, to be compared with that of another session. The offsets come from the same tape and camera, and are
    /// the same in both; so the covariance is that with known offsets.
    pub fn comparable_fulcrum(&self) -> Option<Fulcrum> {
        let information = self.covariance.try_inverse()?.fixed_view::<3, 3>(0, 0).into_owned();
        let covariance = information.try_inverse()?;
        Some(Fulcrum { covariance: (covariance + covariance.transpose()) * 0.5, ..self.fulcrum })
    }

    /// The fulcrum, to be compared with that of another session, if the axes show it and it is known well.
    pub fn well_known_fulcrum(&self) -> Option<Fulcrum> {
        self.comparable_fulcrum().filter(|_| self.is_right_way_round())?.well_known()
    }

    /// Do the axes show clearly on which side of the tips the trocar lies?
    pub fn shows_side(&self) -> bool {
        self.is_right_way_round() || self.is_wrong_way_round()
    }

    /// Do the axes show clearly that the trocar lies behind the tips?
    pub fn is_right_way_round(&self) -> bool {
        self.likelier_behind > MIN_SIDE_MARGIN
    }

    /// Do the axes show clearly that the trocar lies ahead of the tips, where none can be? Then the poses lie the wrong
    /// way round.
    pub fn is_wrong_way_round(&self) -> bool {
        self.likelier_behind < -MIN_SIDE_MARGIN
    }

    /// Outward offset of both borders, pixels, and its standard deviation.
    pub fn border_offset_px(&self) -> (f64, f64) {
        (self.offsets[0], self.covariance[(3, 3)].sqrt())
    }

    fn apply_step(&mut self, step: &SharedVector) {
        self.fulcrum.at += step.fixed_rows::<3>(0);
        self.fulcrum.covariance = self.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        self.offsets += step.fixed_rows::<OFFSETS>(3);
    }

    /// Share of the poses with the fulcrum behind the band.
    pub fn share_behind(&self, poses: &[TubeEstimate]) -> f64 {
        poses.iter().filter(|pose| self.is_behind(&pose.tube)).count() as f64 / poses.len().max(1) as f64
    }

    /// Does the fulcrum lie behind the tube's band? If the axes hardly turn, their errors decide where they meet.
    pub fn is_behind(&self, tube: &Tube) -> bool {
        (tube.tip - self.fulcrum.at).dot(&tube.axis) > MIN_TROCAR_DISTANCE_RADII * tube.radius
    }
}

/// One pose during the adjustment.
struct AdjustedPose<'a> {
    pose: &'a TubeEstimate,
    information: Information,
    /// Change of its own unknowns since its edges were fitted.
    change: OwnVector,
    /// The change with the current shared unknowns, and its decrease per step of each shared unknown.
    alone: OwnVector,
    through: SMatrix<f64, OWN_UNKNOWNS, SHARED>,
}

impl<'a> AdjustedPose<'a> {
    fn new(pose: &'a TubeEstimate) -> Self {
        let (change, through) = (OwnVector::zeros(), SMatrix::zeros());
        Self { pose, information: pose.equations.information(), change, alone: change, through }
    }

    /// Information and right side that the pose contributes to the shared unknowns, with its own unknowns eliminated.
    fn solve(&mut self, shared: &Adjustment) -> Option<(SharedMatrix, SharedVector, f64)> {
        let play = Matrix2::identity() * square(PLAY_MM);
        let own_px = self.pose.equations.own_px();
        let equations = PoseEquations::at(self.pose, &self.information, &self.change, shared, &play, &own_px)?;
        let solver = equations.own.cholesky()?;
        self.through = solver.solve(&equations.cross);
        self.alone = solver.solve(&equations.right);
        let back = equations.cross.transpose();
        let cost = equations.cost - equations.right.dot(&self.alone);
        Some((equations.shared - back * self.through, equations.shared_right - back * self.alone, cost))
    }

    fn apply_shared_step(&mut self, step: &SharedVector) {
        self.change = self.alone - self.through * step;
    }
}

/// The linearised equations of one pose: for its own unknowns, for the shared ones, and mixed.
struct PoseEquations {
    own: Information,
    right: OwnVector,
    cross: SMatrix<f64, OWN_UNKNOWNS, SHARED>,
    shared: SharedMatrix,
    shared_right: SharedVector,
    constraint: FulcrumConstraint,
    firm: Matrix2<f64>,
    /// Squared distance of the pose as fitted from the fulcrum and the offsets, in standard deviations.
    cost: f64,
}

impl PoseEquations {
    /// The equations of a pose changed by `change` since its edges were fitted. `play` is the covariance of the axis's
    /// distance from the fulcrum, `apart_px` the standard deviation of its offsets about the shared ones.
    fn at(
        pose: &TubeEstimate,
        information: &Information,
        change: &OwnVector,
        shared: &Adjustment,
        play: &Matrix2<f64>,
        apart_px: &[f64; OFFSETS],
    ) -> Option<Self> {
        let moved = tube_part(change);
        let mut constraint = FulcrumConstraint::at(&perturbed(&pose.tube, &moved), shared.fulcrum.at);
        constraint.miss -= constraint.by_pose * moved; // relative to the fitted pose
        let firm = play.try_inverse()?;
        let (to_pose, to_point) = (constraint.by_pose.transpose() * firm, constraint.by_point.transpose() * firm);
        let mut all = Self {
            own: *information,
            right: pose.equations.right_side(),
            cross: SMatrix::zeros(),
            shared: SharedMatrix::zeros(),
            shared_right: SharedVector::zeros(),
            cost: constraint.miss.dot(&(firm * constraint.miss)),
            constraint,
            firm,
        };
        let FulcrumConstraint { miss: missed, by_pose, by_point } = &all.constraint;
        let mut of_tube = all.own.fixed_view_mut::<5, 5>(0, 0);
        of_tube += to_pose * by_pose;
        let mut of_tube = all.right.fixed_rows_mut::<5>(0);
        of_tube -= to_pose * missed;
        all.cross.fixed_view_mut::<5, 3>(0, 0).copy_from(&(to_pose * by_point));
        all.shared.fixed_view_mut::<3, 3>(0, 0).copy_from(&(to_point * by_point));
        all.shared_right.fixed_rows_mut::<3>(0).copy_from(&-(to_point * missed));
        let (share, offsets) =
            (pose.equations.shared_offset_scale(), pose.equations.offsets_for_length(shared.length_mm));
        for part in 0..OFFSETS {
            let (weight, share) = (1.0 / square(apart_px[part]), share[part]);
            let ahead = offsets[part] - share * shared.offsets[part];
            all.own[(5 + part, 5 + part)] += weight;
            all.cost += weight * square(ahead);
            all.right[5 + part] -= weight * ahead;
            all.cross[(5 + part, 3 + part)] = -weight * share;
            all.shared[(3 + part, 3 + part)] = weight * square(share);
            all.shared_right[3 + part] = weight * share * ahead;
        }
        Some(all)
    }

    /// Covariance of the right side from the pose's own lasting errors: the play, and its offsets relative to the
    /// shared ones.
    fn own_error_covariance(&self, own_px: &[f64; OFFSETS], apart_px: &[f64; OFFSETS]) -> Information {
        let mut all = Information::zeros();
        let to_pose = self.constraint.by_pose.transpose() * self.firm;
        all.fixed_view_mut::<5, 5>(0, 0).copy_from(&(to_pose * to_pose.transpose() * square(PLAY_MM)));
        for part in 0..OFFSETS {
            all[(5 + part, 5 + part)] = square(own_px[part] / square(apart_px[part]));
        }
        all
    }
}

/// Weight of each pose. Similar poses have similar errors, and count as one together. A pose much nearer or farther than
/// most counts little: offsets by the picture are constant in pixels, those by the tape in mm, and a lamp's light
/// changes with the distance.
pub(super) fn weights(poses: &[TubeEstimate]) -> Vec<f64> {
    /// Half a usual band's length: nearer poses have mostly the same background beside the band, and the same light.
    const ALIKE_MM: f64 = 10.0;
    /// Difference of the scale within which offsets are shared. Over 45 ray-traced tools, the offset of both borders
    /// changed by 0.1 px for this difference, half of what a single pose has of its own.
    const SCALE_WITHIN: f64 = 0.1;
    let likeness = |one: &TubeEstimate, other: &TubeEstimate| {
        (-0.5 * (one.tube.tip - other.tube.tip).norm_squared() / square(ALIKE_MM)).exp()
    };
    let log_distance = |pose: &TubeEstimate| pose.tube.tip.coords.norm().ln();
    let mut sorted: Vec<f64> = poses.iter().map(log_distance).collect();
    sorted.sort_by(f64::total_cmp);
    let usual = sorted[sorted.len() / 2];
    let weight = |pose: &TubeEstimate| {
        let of_scale = (-0.5 * square((log_distance(pose) - usual) / SCALE_WITHIN)).exp();
        of_scale / poses.iter().map(|other| likeness(pose, other)).sum::<f64>()
    };
    poses.iter().map(weight).collect()
}

/// Lower weight for a pose that disagrees with all others, so that a false one does little harm, and by how much less
/// than its squared distance it costs.
fn robust_weight(information: &SharedMatrix, pull: &SharedVector) -> (f64, f64) {
    const MAX_SQUARED: f64 = 9.0;
    let of_fulcrum = information.fixed_view::<3, 3>(0, 0) + Matrix3::identity() * 1e-9;
    let pull = pull.fixed_rows::<3>(0).into_owned();
    let distance = of_fulcrum.cholesky().map_or(0.0, |solver| pull.dot(&solver.solve(&pull)));
    if distance <= MAX_SQUARED {
        return (1.0, 0.0);
    }
    (MAX_SQUARED / distance, distance - MAX_SQUARED * (1.0 + (distance / MAX_SQUARED).ln()))
}

fn tube_part(all: &OwnVector) -> Vector5<f64> {
    all.fixed_rows::<5>(0).into_owned()
}

fn square(value: f64) -> f64 {
    value * value
}

#[cfg(test)]
mod tests;
