//! Borders and ends in, position in space out (METHOD 4).
//!
//! [`tangent_planes`] gives the axis in closed form from two border lines; [`band_length`] gives it from a known
//! length. [`pinhole_width`] is the thesis's reference method. [`joint_fit`] refines the tube with all measured edges
//! and gives its uncertainty; [`axis_line`] is what is left of it where the end is hidden. [`adjustment`] takes all poses of a session together: it estimates the [`fulcrum`] and
//! the shared offsets of the edges, and *steadies* each pose, that is, corrects it with both.

pub mod adjustment;
pub mod axis_line;
pub mod band_length;
pub mod fulcrum;
pub mod joint_fit;
pub mod normal_equations;
pub mod packed;
pub mod pinhole_width;
pub mod size_check;
pub mod tangent_planes;
#[cfg(test)]
mod testing;

use nalgebra::{Matrix3, Matrix5, Vector3};

use self::normal_equations::NormalEquations;
use crate::vision::tube::Tube;

/// A tube and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TubeEstimate {
    /// The tube.
    pub tube: Tube,
    /// Covariance of the five unknowns: tip (mm), then the axis's turn about two directions (radians, see
    /// [`perturbed`]).
    pub covariance: Matrix5<f64>,
    /// The part of the covariance that stays the same from frame to frame, because light and background hardly change.
    /// No filter over time removes it.
    pub lasting: Matrix5<f64>,
    /// Normal equations of its edges, for the joint adjustment.
    pub equations: NormalEquations,
    /// RMS distance of border points from the outline, pixels.
    pub residual_px: f64,
    /// Number of edges that agree with it: the sum of their robust weights.
    pub support: f64,
}

/// Share of the lasting variance that changes after all, as the background behind the tape does. Of the smoothed path's
/// stated variance in depth, 0.33 changed within a recording (median of 46 tools of 39 ray-traced recordings).
pub const CHANGING_SHARE: f64 = 0.25;

impl TubeEstimate {
    /// Covariance of the tip, mm² (exactly symmetric).
    pub fn tip_covariance(&self) -> Matrix3<f64> {
        let tip = self.covariance.fixed_view::<3, 3>(0, 0);
        (tip + tip.transpose()) * 0.5
    }

    /// Covariance of the part of the tip's error that changes while the tool moves, mm²: all of the passing part, and
    /// some of the lasting one. A filter takes it for noise. The whole covariance would make it follow a hand too
    /// slowly.
    pub fn changing_tip_covariance(&self) -> Matrix3<f64> {
        let lasting = self.lasting_tip_covariance();
        self.tip_covariance() - (lasting + lasting.transpose()) * (0.5 * (1.0 - CHANGING_SHARE))
    }

    /// The pose as determined by its edges alone, without the fulcrum that may have constrained it.
    pub fn by_edges_alone(&self) -> Self {
        let Some(change) = self.equations.change_by_edges_alone() else { return *self };
        let (covariance, lasting) = self.equations.covariance().unwrap_or((self.covariance, self.lasting));
        Self { tube: perturbed(&self.tube, &change), covariance, lasting, ..*self }
    }

    /// The lasting part of the tip's covariance, mm².
    pub fn lasting_tip_covariance(&self) -> Matrix3<f64> {
        self.lasting.fixed_view::<3, 3>(0, 0).into_owned()
    }
}

/// A pose as stored by a recording for each tool and frame; its covariance can be recomputed from its normal
/// equations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StoredPose {
    /// The tube.
    pub tube: Tube,
    equations: NormalEquations,
    residual_px: f32,
    support: f32,
}

impl From<&TubeEstimate> for StoredPose {
    fn from(pose: &TubeEstimate) -> Self {
        let TubeEstimate { tube, equations: evidence, residual_px, support, .. } = *pose;
        Self { tube, equations: evidence, residual_px: residual_px as f32, support: support as f32 }
    }
}

impl StoredPose {
    /// The complete pose; `None` if its edges do not determine one.
    pub fn estimate(&self) -> Option<TubeEstimate> {
        let (covariance, lasting) = self.equations.covariance()?;
        let Self { tube, equations: evidence, residual_px, support } = *self;
        let (residual_px, support) = (f64::from(residual_px), f64::from(support));
        Some(TubeEstimate { tube, covariance, lasting, equations: evidence, residual_px, support })
    }

    /// RMS distance of border points from the outline, pixels.
    pub fn residual_px(&self) -> f64 {
        f64::from(self.residual_px)
    }

    fn as_words(&self) -> Words {
        let Self { tube: Tube { tip, axis, radius }, equations: evidence, residual_px, support } = self;
        let of_tube = tip.iter().chain(axis.iter()).chain([radius]).flat_map(|number| {
            let bits = number.to_bits();
            [(bits >> 32) as u32, bits as u32]
        });
        let of_edges = evidence.values().into_iter().chain([*residual_px, *support]).map(f32::to_bits);
        let mut words = [0; WORDS];
        words.iter_mut().zip(of_tube.chain(of_edges)).for_each(|(word, bits)| *word = bits);
        words
    }

    fn from_words(words: &Words) -> Self {
        let wide = |place: usize| f64::from_bits(u64::from(words[2 * place]) << 32 | u64::from(words[2 * place + 1]));
        let three = |first: usize| [wide(first), wide(first + 1), wide(first + 2)];
        let number = |place: usize| f32::from_bits(words[TUBE_WORDS + place]);
        Self {
            tube: Tube { tip: three(0).into(), axis: three(3).into(), radius: wide(6) },
            equations: NormalEquations::from_values(&std::array::from_fn(number)),
            residual_px: number(normal_equations::VALUE_COUNT),
            support: number(normal_equations::VALUE_COUNT + 1),
        }
    }
}

/// A [`StoredPose`] as bits.
type Words = [u32; WORDS];
const TUBE_WORDS: usize = 2 * 7;
const WORDS: usize = TUBE_WORDS + normal_equations::VALUE_COUNT + 2;

/// Two unit vectors perpendicular to an axis and to each other.
pub fn perpendiculars(axis: Vector3<f64>) -> [Vector3<f64>; 2] {
    let helper = if axis.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
    let first = axis.cross(&helper).normalize();
    [first, axis.cross(&first)]
}

/// The tube changed by five small unknowns: tip by three (mm), axis towards the two [`perpendiculars`] (radians).
pub fn perturbed(tube: &Tube, change: &nalgebra::Vector5<f64>) -> Tube {
    let [first, second] = perpendiculars(tube.axis);
    let axis = tube.axis + first * change[3] + second * change[4];
    Tube { tip: tube.tip + change.fixed_rows::<3>(0), axis: axis.normalize(), radius: tube.radius }
}
