//! The normal equations of one pose's edges, kept for the joint adjustment: for the tube, and for its outline's
//! offsets.

use nalgebra::{Matrix5, SMatrix, SVector, Vector5};

use crate::vision::edges::outline_probes::OutlinePoint;
use crate::vision::tube::{BorderSide, OutlinePart};

/// Number of offsets of an outline (see [`Offsets`]).
pub const OFFSETS: usize = 7;
/// Index of the offset that makes a tube seem displaced.
const DISPLACEMENT: usize = 1;
/// Index of the offset that makes a tube seem to taper.
pub const TAPER: usize = 4;
/// Number of a pose's own unknowns: five of the tube (see [`super::perturbed`]), then the offsets of its outline.
pub const OWN_UNKNOWNS: usize = 5 + OFFSETS;
/// Information matrix of these unknowns.
pub type Information = SMatrix<f64, OWN_UNKNOWNS, OWN_UNKNOWNS>;
const PACKED: usize = OWN_UNKNOWNS * (OWN_UNKNOWNS + 1) / 2;
/// Number of values in [`NormalEquations`].
pub const VALUE_COUNT: usize = PACKED + OWN_UNKNOWNS + 3 * OFFSETS + 3;

/// Offsets of an outline's edges, pixels outwards:
///
/// | | edges | |
/// |---|---|---|
/// | 0 | both borders | alike: the tube seems wider |
/// | 1 | both borders | towards the first one: it seems displaced |
/// | 2, 3 | distal end, proximal end | alike |
/// | 4 | both borders | from −1 at the distal end to 1 at the proximal end: the tube seems to taper |
/// | 5, 6 | distal end, proximal end | from 1 in the middle to −2 at the borders: the end seems to bow |
///
/// Light from one side, and the position of a camera's chroma samples, displace a tube five times as much as they widen
/// it, and only the width affects depth. Taper and bow affect the lean.
pub type Offsets = SVector<f64, OFFSETS>;

/// Offset of a part's edges, pixels outwards: constant, and the factor of [`shape_at`].
pub type PartOffsets = SMatrix<f64, 2, OFFSETS>;

/// The offset of a part of the outline per unit of each of the [`Offsets`].
pub fn by_offsets(part: OutlinePart) -> PartOffsets {
    let mut all = PartOffsets::zeros();
    match part {
        OutlinePart::Border(side) => {
            all[(0, 0)] = 1.0;
            all[(0, 1)] = if side == BorderSide::First { 1.0 } else { -1.0 };
            all[(1, 4)] = 1.0;
        }
        OutlinePart::DistalEnd => (all[(0, 2)], all[(1, 5)]) = (1.0, 1.0),
        OutlinePart::ProximalEnd => (all[(0, 3)], all[(1, 6)]) = (1.0, 1.0),
    }
    all
}

/// The shape of a part's second offset at a point of a band of this length.
pub fn shape_at(point: OutlinePoint, length_mm: f64) -> f64 {
    match point {
        OutlinePoint::Border { back_mm, .. } => 2.0 * back_mm / length_mm.max(1.0) - 1.0,
        OutlinePoint::Rim { across, .. } => 1.0 - 3.0 * across * across,
    }
}

/// Standard deviations of the offsets that a whole session shares, by the picture: tone curve, sharpening, chroma, light
/// and compression shift all edges alike, pixels. Taper and bow: light falls off along the tube and towards its borders.
const BY_PICTURE_PX: [f64; OFFSETS] = [0.2, 0.2, 0.25, 0.25, 0.06, 0.25, 0.3];
/// The same by the tape: a second layer over a part of the turn, creases, ends that are ragged or cut askew, its
/// thickness, and sizes taken with a caliper and a ruler, mm. A second layer of 0.13 mm at a border in a third of the
/// turns widens the tube by 0.045 mm a border (root mean square), and displaces it by as much. An end bows by 0.1 mm if a cut by hand is 0.3 mm
/// farther out in the middle than at the borders; two layers more or less bow it by 0.06 mm.
const BY_TAPE_MM: [f64; OFFSETS] = [0.045, 0.045, 0.07, 0.07, 0.01, 0.1, 0.1];

/// Standard deviations of the offsets that a whole session shares, pixels, for a tape at this scale in the picture,
/// pixels per millimetre across and along the tube. On 59 tools of 39 ray-traced recordings that no threshold had seen,
/// the root mean square of the width was 0.27 px and 0.06 mm, of the taper 0.08 px, and of the bow 0.22 px (distal end)
/// and 0.32 px (proximal end), in the even and in the odd recordings alike.
pub fn shared_offsets_px(across_px_per_mm: f64, along_px_per_mm: f64) -> [f64; OFFSETS] {
    let (across, along) = (across_px_per_mm, along_px_per_mm);
    let scales = [across, across, along, along, across, along, along];
    std::array::from_fn(|offset| BY_PICTURE_PX[offset].hypot(BY_TAPE_MM[offset] * scales[offset]))
}

/// The same by a bare shaft, without tape on it, as a share of its radius: its diameter, and light that its limb
/// mirrors beyond what the edge model expects.
const WIDTH_BY_SHAFT: f64 = 0.006;

/// The same for a bare shaft of this radius. The ends are as uncertain as those of tape.
pub fn shared_offsets_of_shaft_px(radius_px: f64, across_px_per_mm: f64, along_px_per_mm: f64) -> [f64; OFFSETS] {
    let mut shared = shared_offsets_px(across_px_per_mm, along_px_per_mm);
    shared[0] = BY_PICTURE_PX[0].hypot(WIDTH_BY_SHAFT * radius_px);
    shared[DISPLACEMENT] = BY_PICTURE_PX[DISPLACEMENT].hypot(WIDTH_BY_SHAFT * radius_px);
    shared
}

/// Standard deviations of the own offsets of a pose of a bare shaft, pixels: no tape displaces it.
pub fn own_offsets_of_shaft_px() -> [f64; OFFSETS] {
    OWN_BY_PICTURE_PX
}

/// Standard deviations of a pose's own offsets about the shared ones, by the picture: background, shadow and gloss,
/// pixels. Measured on the same recordings.
const OWN_BY_PICTURE_PX: [f64; OFFSETS] = [0.15, 0.1, 0.25, 0.3, 0.08, 0.1, 0.1];
/// By how much the tape displaces the tube while the tool rolls, mm: a second layer over a part of the turn moves from
/// one border to the other, and displaces the tube by half its thickness of 0.06 to 0.2 mm either way.
const OWN_DISPLACEMENT_MM: f64 = 0.04;

/// Standard deviations of a pose's own offsets, pixels, for a tape at this scale in the picture, pixels per millimetre
/// across the tube.
pub fn own_offsets_px(across_px_per_mm: f64) -> [f64; OFFSETS] {
    let mut own = OWN_BY_PICTURE_PX;
    own[DISPLACEMENT] = own[DISPLACEMENT].hypot(OWN_DISPLACEMENT_MM * across_px_per_mm);
    own
}

/// Standard deviations of the offsets of a single pose, pixels: shared and own together.
pub fn single_pose_offsets_px(across_px_per_mm: f64, along_px_per_mm: f64) -> [f64; OFFSETS] {
    together(shared_offsets_px(across_px_per_mm, along_px_per_mm), own_offsets_px(across_px_per_mm))
}

/// Standard deviations of shared and own offsets together.
pub fn together(shared: [f64; OFFSETS], own: [f64; OFFSETS]) -> [f64; OFFSETS] {
    std::array::from_fn(|offset| shared[offset].hypot(own[offset]))
}

/// The normal equations of a pose's edges, in single precision: a recording keeps one for each tool and frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalEquations {
    information: [f32; PACKED],
    /// Offsets in the fitted pose, pixels.
    offsets: [f32; OFFSETS],
    /// Right side of the normal equations: how the edges alone would still move tube and offsets.
    right_side: [f32; OWN_UNKNOWNS],
    /// Priors on the offsets: standard deviations, pixels.
    prior_px: [f32; OFFSETS],
    /// Difference of the offsets from those of similar poses: standard deviations, pixels.
    own_px: [f32; OFFSETS],
    length_mm: f32,
    px_per_mm: f32,
    /// Only the pose's covariance is known; all of it may last.
    is_bare: bool,
}

/// Priors on a pose's offsets: standard deviations, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OffsetPriors {
    /// Of each offset.
    pub offsets_px: [f64; OFFSETS],
    /// Of their difference from the offsets that the session shares.
    pub own_px: [f64; OFFSETS],
    /// The assumed length of the band, mm.
    pub length_mm: f64,
    /// Pixels per millimetre along the axis at the band's proximal end; 0 if its length was measured.
    pub px_per_mm: f64,
}

impl OffsetPriors {
    /// The usual priors, for a band of known length.
    pub fn usual(length_mm: f64) -> Self {
        const PX_PER_MM: f64 = 5.0;
        let offsets_px = single_pose_offsets_px(PX_PER_MM, PX_PER_MM);
        Self { offsets_px, own_px: own_offsets_px(PX_PER_MM), length_mm, px_per_mm: 0.0 }
    }
}

impl NormalEquations {
    /// From the edges' normal equations at the pose and offsets fitted under these priors. `noise` is the factor on
    /// the edges' stated variances.
    pub fn new(
        information: &Information,
        pull: &SVector<f64, OWN_UNKNOWNS>,
        offsets: &Offsets,
        beliefs: &OffsetPriors,
        noise: f64,
    ) -> Self {
        let all = (0..OWN_UNKNOWNS).flat_map(|row| (0..=row).map(move |column| (row, column)));
        let mut packed = [0.0; PACKED];
        for (packed, place) in packed.iter_mut().zip(all) {
            *packed = (information[place] / noise) as f32;
        }
        Self {
            information: packed,
            offsets: std::array::from_fn(|part| offsets[part] as f32),
            right_side: std::array::from_fn(|i| (pull[i] / noise) as f32),
            prior_px: beliefs.offsets_px.map(|px| px as f32),
            own_px: beliefs.own_px.map(|px| px as f32),
            length_mm: beliefs.length_mm as f32,
            px_per_mm: beliefs.px_per_mm as f32,
            is_bare: false,
        }
    }

    /// For a pose with only a covariance.
    pub fn from_covariance(covariance: &Matrix5<f64>) -> Self {
        let mut information = Information::zeros();
        let of_tube = covariance.try_inverse().unwrap_or_else(Matrix5::zeros);
        information.fixed_view_mut::<5, 5>(0, 0).copy_from(&of_tube);
        let bare = Self::new(&information, &SVector::zeros(), &Offsets::zeros(), &OffsetPriors::usual(0.0), 1.0);
        Self { is_bare: true, ..bare }
    }

    /// All values, for storage.
    pub fn values(&self) -> [f32; VALUE_COUNT] {
        let Self {
            information,
            offsets,
            right_side: pull,
            prior_px: believed_px,
            own_px,
            length_mm,
            px_per_mm,
            is_bare,
        } = self;
        let parts: [&[f32]; 5] = [information, offsets, pull, believed_px, own_px];
        let others = [*length_mm, *px_per_mm, f32::from(u8::from(*is_bare))];
        let mut numbers = [0.0; VALUE_COUNT];
        let all = parts.into_iter().flatten().copied().chain(others);
        numbers.iter_mut().zip(all).for_each(|(number, own)| *number = own);
        numbers
    }

    /// From stored values.
    pub fn from_values(numbers: &[f32; VALUE_COUNT]) -> Self {
        fn part<const N: usize>(numbers: &mut impl Iterator<Item = f32>) -> [f32; N] {
            std::array::from_fn(|_| numbers.next().unwrap_or(0.0))
        }
        let mut rest = numbers.iter().copied();
        let (information, offsets, right_side) = (part(&mut rest), part(&mut rest), part(&mut rest));
        let (prior_px, own_px) = (part(&mut rest), part(&mut rest));
        let [length_mm, px_per_mm, is_bare] = part(&mut rest);
        Self { information, offsets, right_side, prior_px, own_px, length_mm, px_per_mm, is_bare: is_bare != 0.0 }
    }

    /// The same with the variance of the noise multiplied by `times`.
    pub fn with_variance_scaled(mut self, times: f64) -> Self {
        self.information.iter_mut().chain(&mut self.right_side).for_each(|number| *number /= times as f32);
        self
    }

    /// Information matrix of tube and offsets.
    pub fn information(&self) -> Information {
        Information::from_fn(|i, j| {
            let (low, high) = (i.min(j), i.max(j));
            f64::from(self.information[high * (high + 1) / 2 + low])
        })
    }

    /// Right side of the normal equations of the edges alone.
    pub fn right_side(&self) -> SVector<f64, OWN_UNKNOWNS> {
        SVector::from(self.right_side.map(f64::from))
    }

    /// Difference of the offsets from the shared ones: standard deviations, pixels.
    pub fn own_px(&self) -> [f64; OFFSETS] {
        self.own_px.map(f64::from)
    }

    /// The offsets that the session shares: standard deviations before anything is known of them, pixels.
    pub fn shared_px(&self) -> [f64; OFFSETS] {
        std::array::from_fn(|part| {
            let [all, own] = [self.prior_px[part], self.own_px[part]].map(f64::from);
            (all * all - own * own).max(0.0).sqrt()
        })
    }

    /// The band's length in the fit, mm.
    pub fn length_mm(&self) -> f64 {
        f64::from(self.length_mm)
    }

    /// Was the band's length not measured?
    pub fn is_length_unknown(&self) -> bool {
        self.px_per_mm > 0.0
    }

    /// Effect of each shared offset on this pose. If the band's length was not measured, the shared offset of the
    /// proximal end is in mm of that length.
    pub fn shared_offset_scale(&self) -> [f64; OFFSETS] {
        let mut scale = [1.0; OFFSETS];
        if self.is_length_unknown() {
            scale[OutlinePart::ProximalEnd.index()] = f64::from(self.px_per_mm);
        }
        scale
    }

    /// The offsets as if the pose had been fitted with this band length, pixels.
    pub fn offsets_for_length(&self, length_mm: f64) -> Offsets {
        let by_length = f64::from(self.px_per_mm) * (self.length_mm() - length_mm);
        let mut offsets = Offsets::from(self.offsets.map(f64::from));
        offsets[OutlinePart::ProximalEnd.index()] += by_length;
        offsets
    }

    /// The offsets as the edges alone show them about the fitted tube, pixels. Parts without edges keep their offsets in
    /// the fit. `None` if the numbers are not finite.
    pub fn offsets_of_edges(&self) -> Option<Offsets> {
        /// Information of an edge of 30 px: none, but the matrix can be inverted.
        const HARDLY_ANY: f64 = 1e-3;
        let of_offsets = self.information().fixed_view::<OFFSETS, OFFSETS>(5, 5).into_owned();
        let right = self.right_side().fixed_rows::<OFFSETS>(5).into_owned();
        let solver = (of_offsets + SMatrix::<f64, OFFSETS, OFFSETS>::identity() * HARDLY_ANY).cholesky()?;
        Some(Offsets::from(self.offsets.map(f64::from)) + solver.solve(&right))
    }

    /// The tube's covariance under the priors alone, and the part that lasts from frame to frame: all but the edges'
    /// own noise, which would remain if the offsets were known.
    pub fn covariance(&self) -> Option<(Matrix5<f64>, Matrix5<f64>)> {
        let information = self.information();
        let all: Matrix5<f64> = self.with_priors().cholesky()?.inverse().fixed_view::<5, 5>(0, 0).into_owned();
        if self.is_bare {
            return Some((all, all));
        }
        let passing = information.fixed_view::<5, 5>(0, 0).into_owned().cholesky()?.inverse();
        Some((all, all - passing))
    }

    /// How the edges alone, under the priors, would move the tube.
    pub fn change_by_edges_alone(&self) -> Option<Vector5<f64>> {
        let mut pull = self.right_side();
        for offset in 0..OFFSETS {
            pull[5 + offset] -= f64::from(self.offsets[offset]) / f64::from(self.prior_px[offset]).powi(2);
        }
        Some(self.with_priors().cholesky()?.solve(&pull).fixed_rows::<5>(0).into_owned())
    }

    fn with_priors(&self) -> Information {
        let mut information = self.information();
        for offset in 0..OFFSETS {
            information[(5 + offset, 5 + offset)] += f64::from(self.prior_px[offset]).powi(-2);
        }
        information
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_borders_of_a_bare_shaft_are_as_certain_as_the_picture_shows_them() {
        const PX_PER_MM: f64 = 9.0;
        let [tape, shaft] = [
            shared_offsets_px(PX_PER_MM, PX_PER_MM),
            shared_offsets_of_shaft_px(2.5 * PX_PER_MM, PX_PER_MM, PX_PER_MM),
        ];
        // The tape's second layer counts 0.4 px here, a shaft's polish a third of it.
        assert!((0.2..0.26).contains(&shaft[0]) && shaft[0] < 0.55 * tape[0], "{shaft:?} {tape:?}");
        assert!(shaft[DISPLACEMENT] < 0.55 * tape[DISPLACEMENT]);
        assert_eq!(shaft[2..], tape[2..], "ends, taper and bow");
        assert!(own_offsets_of_shaft_px()[DISPLACEMENT] < own_offsets_px(PX_PER_MM)[DISPLACEMENT]);
    }
}
