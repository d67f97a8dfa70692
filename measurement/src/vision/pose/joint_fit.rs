//! Fits a tube to all measured edges at once: borders, and one or both ends of the band, with five unknowns of the
//! tube (METHOD 4.3).
//!
//! **In** edges with their point on the outline, their pixel and its standard deviation; a tube close to the truth.
//! **Out** the best tube, its covariance, the RMS residual. **Method** Gauss–Newton with robust weights (Tukey).
//! Borders and ends also have unknown offsets, 0 ± [`OffsetPriors::offsets_px`]: light, compression and sharpening
//! shift a whole edge alike, and averaging over many pixels does not remove that. **Gives up** if fewer than
//! [`MIN_BORDER_EDGES`] edges support either border, or no end was seen.

use nalgebra::{Matrix2, Matrix5, SMatrix, SVector, Vector2, Vector5};

use super::fulcrum::{Fulcrum, FulcrumConstraint};
use super::normal_equations::{
    NormalEquations, OFFSETS, OWN_UNKNOWNS as UNKNOWNS, OffsetPriors, Offsets, by_offsets, shape_at,
};
use super::{TubeEstimate, perturbed};
use crate::vision::camera::Camera;
use crate::vision::edges::outline_probes::OutlinePoint;
use crate::vision::space::{CameraPoint, Normalised, Pixel};
use crate::vision::tube::{BorderSide, Outline, OutlinePart, Tube};

/// One measured edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredEdge {
    /// The point of the outline that it belongs to.
    pub point: OutlinePoint,
    /// Its pixel.
    pub at: Pixel,
    /// Unit normal out of the tube, pixels.
    pub outward: Vector2<f64>,
    /// Standard deviation along the normal, pixels.
    pub sigma_px: f64,
    /// Viewing direction.
    sight: Normalised,
    /// Change of the viewing direction per pixel outwards.
    sight_per_px: Vector2<f64>,
}

/// Minimum number of edges on each border.
pub const MIN_BORDER_EDGES: usize = 2;

/// By how much the ends of a tape are found too far out, pixels; the cause is not known. Over 59 ray-traced tools, the
/// mean of both ends was 0.18 in the even and 0.16 in the odd recordings. Borders have no such offset, and neither have
/// ends that are drawn as the edge model assumes.
pub const END_OFFSET_PX: f64 = 0.17;

/// Minimum standard deviation of a single edge, pixels: texture and compression that the noise does not include.
const MIN_SIGMA_PX: f64 = 0.1;

impl MeasuredEdge {
    /// An edge at a pixel; `None` if the lens model has no direction for it.
    pub fn new(place: OutlinePoint, at: Pixel, outward: Vector2<f64>, sigma_px: f64, camera: &Camera) -> Option<Self> {
        let sight = camera.normalised_of(at)?;
        let (_, jacobian) = camera.distort_with_jacobian(sight);
        let per_px = Vector2::new(outward.x / camera.fx, outward.y / camera.fy);
        Some(Self { point: place, at, outward, sigma_px, sight, sight_per_px: jacobian.try_inverse()? * per_px })
    }

    /// The same edge on a band whose length is taken to be `times` as much.
    #[cfg(test)]
    pub fn with_length_scaled(mut self, times: f64) -> Self {
        let (OutlinePoint::Border { back_mm, .. } | OutlinePoint::Rim { back_mm, .. }) = &mut self.point;
        *back_mm *= times;
        self
    }

    /// Outward distance of the edge from the outline, pixels.
    pub fn residual_px(&self, outline: &Outline, camera: &Camera) -> Option<f64> {
        match self.point {
            OutlinePoint::Border { side, .. } => {
                let normal = outline.normal(side);
                let per_px = normal.xy().dot(&self.sight_per_px);
                (per_px.abs() > 1e-9).then(|| normal.dot(&self.sight.ray()) / per_px)
            }
            OutlinePoint::Rim { back_mm, across } => {
                let expected = camera.project(CameraPoint(outline.tape_end(back_mm, across)))?;
                Some((self.at.0 - expected.0).dot(&self.outward) - END_OFFSET_PX)
            }
        }
    }
}

/// Whether edges may be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trust {
    /// Edges that disagree with most others get little or no weight: for measured edges.
    Majority,
    /// All edges count: for a rough start, where one point per end must not be outvoted by the borders.
    All,
}

/// Fits the tube to the edges, starting from `start`, under priors on the offsets of its parts. With a known fulcrum
/// the tube is constrained to it, but normal equations and covariance are those of the edges alone.
pub fn fit(
    edges: &[MeasuredEdge],
    start: &Tube,
    camera: &Camera,
    trust: Trust,
    beliefs: &OffsetPriors,
    fulcrum: Option<&Fulcrum>,
) -> Option<TubeEstimate> {
    const ROUNDS: usize = 8;
    let count = |part: OutlinePart| edges.iter().filter(|e| e.point.part() == part).count();
    let is_border_thin = |side: BorderSide| count(OutlinePart::Border(side)) < MIN_BORDER_EDGES;
    if BorderSide::BOTH.into_iter().any(is_border_thin) || OutlinePart::ENDS.map(count) == [0, 0] {
        return None;
    }
    let mut tube = *start;
    let mut offsets = Offsets::zeros();
    let mut last = f64::INFINITY;
    for _ in 0..ROUNDS {
        let system = EdgeEquations::build(edges, &tube, &offsets, camera, trust, beliefs.length_mm)?;
        let step = system.constrained_step(&tube, &offsets, beliefs, fulcrum)?;
        tube = perturbed(&tube, &Vector5::from(step.fixed_rows::<5>(0)));
        offsets += step.fixed_rows::<OFFSETS>(5);
        let size = step.fixed_rows::<3>(0).norm();
        if !size.is_finite() || size > 100.0 {
            return None;
        }
        if size < 1e-4 || (size < 1e-2 && size > last) {
            break;
        }
        last = size;
    }
    let system = EdgeEquations::build(edges, &tube, &offsets, camera, trust, beliefs.length_mm)?;
    let noise = system.variance_factor.max(1.0);
    let evidence = NormalEquations::new(&system.matrix, &system.right, &offsets, beliefs, noise);
    let (covariance, lasting) = evidence.covariance()?;
    Some(TubeEstimate {
        tube,
        covariance,
        lasting,
        equations: evidence,
        residual_px: system.residual_px,
        support: system.support,
    })
}

/// The edges' normal equations at one linearisation.
struct EdgeEquations {
    matrix: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    right: SVector<f64, UNKNOWNS>,
    variance_factor: f64,
    residual_px: f64,
    support: f64,
}

impl EdgeEquations {
    /// The step from edges, priors and fulcrum together.
    fn constrained_step(
        &self,
        tube: &Tube,
        offsets: &Offsets,
        beliefs: &OffsetPriors,
        fulcrum: Option<&Fulcrum>,
    ) -> Option<SVector<f64, UNKNOWNS>> {
        let (mut matrix, mut right) = (self.matrix, self.right);
        for (offset, sigma_px) in beliefs.offsets_px.into_iter().enumerate() {
            let weight = sigma_px.powi(-2);
            matrix[(5 + offset, 5 + offset)] += weight;
            right[5 + offset] -= weight * offsets[offset];
        }
        if let Some(fulcrum) = fulcrum {
            let constraint = FulcrumConstraint::at(tube, fulcrum.at);
            let to_pose = constraint.by_pose.transpose() * constraint.play(fulcrum).try_inverse()?;
            let mut of_tube = matrix.fixed_view_mut::<5, 5>(0, 0);
            of_tube += to_pose * constraint.by_pose;
            let mut of_tube = right.fixed_rows_mut::<5>(0);
            of_tube -= to_pose * constraint.miss;
        }
        Some(matrix.cholesky()?.solve(&right))
    }

    fn build(
        edges: &[MeasuredEdge],
        tube: &Tube,
        offsets: &Offsets,
        camera: &Camera,
        trust: Trust,
        length_mm: f64,
    ) -> Option<Self> {
        let outline = tube.outline()?;
        let nudged = nudged_outlines(tube)?;
        let by_offsets = PARTS.map(by_offsets);
        let shape = |e: &MeasuredEdge| Vector2::new(1.0, shape_at(e.point, length_mm));
        let expected = |e: &MeasuredEdge| (by_offsets[e.point.part().index()] * offsets).dot(&shape(e));
        let distances: Vec<f64> = edges.iter().map(|e| e.residual_px(&outline, camera)).collect::<Option<_>>()?;
        let residuals: Vec<f64> = edges.iter().zip(&distances).map(|(e, distance)| distance - expected(e)).collect();
        let sigma = |e: &MeasuredEdge| (e.sigma_px * e.sigma_px + MIN_SIGMA_PX * MIN_SIGMA_PX).sqrt();
        let scale = median(edges.iter().zip(&residuals).map(|(e, r)| (r / sigma(e)).abs())).max(0.67) / 0.6745;
        // Each edge depends on the tube and on its own part's two offsets only.
        let mut sums = [PartSums::default(); PARTS.len()];
        let (mut squares, mut weights) = (0.0, 0.0);
        for ((edge, residual), distance) in edges.iter().zip(&residuals).zip(&distances) {
            let weight = match trust {
                Trust::Majority => tukey(residual / (4.7 * scale * sigma(edge))),
                Trust::All => 1.0,
            };
            let mut row = Vector5::zeros();
            for (i, ahead) in nudged.iter().enumerate() {
                // The outline moves outwards by as much as the residual decreases.
                row[i] = (distance - edge.residual_px(ahead, camera)?) / DERIVATIVE_STEPS[i];
            }
            sums[edge.point.part().index()].add(&row, &shape(edge), *residual, weight / sigma(edge).powi(2));
            squares += weight * residual * residual;
            weights += weight;
        }
        let mut matrix = SMatrix::zeros();
        let mut right = SVector::zeros();
        for (of_part, by_offsets) in sums.iter().zip(&by_offsets) {
            of_part.enter(by_offsets, &mut matrix, &mut right);
        }
        Some(Self {
            matrix,
            right,
            variance_factor: scale * scale,
            residual_px: (squares / weights.max(1e-9)).sqrt(),
            support: weights,
        })
    }
}

/// The parts of an outline in the order of [`OutlinePart::index`].
const PARTS: [OutlinePart; 4] = [
    OutlinePart::Border(BorderSide::First),
    OutlinePart::Border(BorderSide::Second),
    OutlinePart::DistalEnd,
    OutlinePart::ProximalEnd,
];

/// Sums over the edges of one part, for the tube and the part's two offsets.
#[derive(Clone, Copy, Default)]
struct PartSums {
    tube: Matrix5<f64>,
    cross: SMatrix<f64, 5, 2>,
    own: Matrix2<f64>,
    right_tube: Vector5<f64>,
    right_own: Vector2<f64>,
}

impl PartSums {
    fn add(&mut self, row: &Vector5<f64>, shape: &Vector2<f64>, residual: f64, information: f64) {
        let weighed = row * information;
        self.tube.ger(1.0, &weighed, row, 1.0);
        self.cross.ger(1.0, &weighed, shape, 1.0);
        self.own.ger(information, shape, shape, 1.0);
        self.right_tube += weighed * residual;
        self.right_own += shape * (information * residual);
    }

    /// Enters the sums into the equations of all unknowns.
    fn enter(
        &self,
        by_offsets: &SMatrix<f64, 2, OFFSETS>,
        matrix: &mut SMatrix<f64, UNKNOWNS, UNKNOWNS>,
        right: &mut SVector<f64, UNKNOWNS>,
    ) {
        let cross = self.cross * by_offsets;
        let mut block = matrix.fixed_view_mut::<5, 5>(0, 0);
        block += self.tube;
        let mut block = matrix.fixed_view_mut::<5, OFFSETS>(0, 5);
        block += cross;
        let mut block = matrix.fixed_view_mut::<OFFSETS, 5>(5, 0);
        block += cross.transpose();
        let mut block = matrix.fixed_view_mut::<OFFSETS, OFFSETS>(5, 5);
        block += by_offsets.transpose() * self.own * by_offsets;
        let mut block = right.fixed_rows_mut::<5>(0);
        block += self.right_tube;
        let mut block = right.fixed_rows_mut::<OFFSETS>(5);
        block += by_offsets.transpose() * self.right_own;
    }
}

/// Steps of the numerical derivative: mm, mm, mm, rad, rad.
const DERIVATIVE_STEPS: [f64; 5] = [1e-4, 1e-4, 1e-4, 1e-6, 1e-6];

fn nudged_outlines(tube: &Tube) -> Option<[Outline; 5]> {
    let mut all = [tube.outline()?; 5];
    for (i, outline) in all.iter_mut().enumerate() {
        let mut change = Vector5::zeros();
        change[i] = DERIVATIVE_STEPS[i];
        *outline = perturbed(tube, &change).outline()?;
    }
    Some(all)
}

fn tukey(ratio: f64) -> f64 {
    let left = 1.0 - ratio * ratio;
    if left > 0.0 { left * left } else { 0.0 }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    if sorted.is_empty() {
        return 0.0;
    }
    let middle = sorted.len() / 2;
    *sorted.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::camera::testing::wide as camera;
    use crate::vision::pose::normal_equations::single_pose_offsets_px;
    use crate::vision::pose::testing::{self, LENGTH_MM, gaussian};
    use nalgebra::{Point3, Vector3};
    use rand::rngs::SmallRng;
    use rand::{Rng, SeedableRng};

    fn tube() -> Tube {
        Tube { tip: Point3::new(-30.0, -8.0, 190.0), axis: Vector3::new(0.40, -0.62, 0.675).normalize(), radius: 2.5 }
    }

    /// Edges along the tube's true outline, each shifted by noise, and by offsets with these standard deviations.
    fn edges(random: &mut impl Rng, sigma_px: f64, offsets_px: [f64; OFFSETS]) -> Vec<MeasuredEdge> {
        let offsets = Offsets::from(offsets_px.map(|sigma| sigma * gaussian(random)));
        let backs_mm: Vec<f64> = (1..25).map(f64::from).collect();
        testing::edges(&tube(), &camera(), &backs_mm, &offsets, sigma_px, random)
    }

    fn rough_start() -> Tube {
        perturbed(&tube(), &Vector5::new(1.0, -1.0, 6.0, 0.05, -0.08))
    }

    #[test]
    fn clean_edges_give_the_tube_back_from_a_rough_start() {
        let clean = edges(&mut SmallRng::seed_from_u64(1), 0.0, [0.0; OFFSETS]);
        let fitted =
            fit(&clean, &rough_start(), &camera(), Trust::Majority, &OffsetPriors::usual(LENGTH_MM), None).unwrap();
        assert!((fitted.tube.tip - tube().tip).norm() < 1e-3, "{}", (fitted.tube.tip - tube().tip).norm());
        assert!((fitted.tube.axis - tube().axis).norm() < 1e-4);
    }

    #[test]
    fn a_fifth_of_the_edges_may_be_wrong() {
        let mut spoiled = edges(&mut SmallRng::seed_from_u64(2), 0.05, [0.0; OFFSETS]);
        for edge in spoiled.iter_mut().step_by(5) {
            *edge = MeasuredEdge::new(
                edge.point,
                Pixel(edge.at.0 + edge.outward * 2.5),
                edge.outward,
                edge.sigma_px,
                &camera(),
            )
            .unwrap();
        }
        let fitted =
            fit(&spoiled, &rough_start(), &camera(), Trust::Majority, &OffsetPriors::usual(LENGTH_MM), None).unwrap();
        assert!((fitted.tube.tip - tube().tip).norm() < 0.5, "{}", (fitted.tube.tip - tube().tip).norm());
    }

    /// Checks the stated covariance by sampling.
    #[test]
    fn ninety_five_of_a_hundred_tips_lie_inside_their_95_percent_region() {
        const TRIALS: usize = 300;
        const CHI_SQUARED_95: f64 = 7.815; // three degrees of freedom
        let mut random = SmallRng::seed_from_u64(3);
        let inside = (0..TRIALS)
            .filter(|_| {
                let sampled = edges(&mut random, 0.15, single_pose_offsets_px(5.0, 5.0));
                let fitted =
                    fit(&sampled, &rough_start(), &camera(), Trust::Majority, &OffsetPriors::usual(LENGTH_MM), None)
                        .unwrap();
                let miss = fitted.tube.tip - tube().tip;
                miss.dot(&(fitted.tip_covariance().try_inverse().unwrap() * miss)) < CHI_SQUARED_95
            })
            .count();
        let share = inside as f64 / TRIALS as f64;
        assert!((0.90..=0.99).contains(&share), "{share} inside");
    }

    #[test]
    fn one_border_alone_is_not_enough() {
        let mut one = edges(&mut SmallRng::seed_from_u64(4), 0.05, [0.0; OFFSETS]);
        one.retain(|e| e.point.part() != OutlinePart::Border(BorderSide::Second));
        assert_eq!(fit(&one, &rough_start(), &camera(), Trust::Majority, &OffsetPriors::usual(LENGTH_MM), None), None);
    }
}
