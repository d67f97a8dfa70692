//! What the edges of one pose say, kept for when more is known: of the tube, and of its outline's offsets.

use nalgebra::{Matrix5, SMatrix, SVector, Vector4, Vector5};

#[cfg(doc)]
use crate::pipeline::edges::outline_probes::Place;

/// A pose's own unknowns: five of the tube (see [`super::turned`]), the offsets of its outline's four parts (pixels, see [`Offsets`]).
pub const OWN: usize = 9;
/// Information on them.
pub type Information = SMatrix<f64, OWN, OWN>;
const PACKED: usize = OWN * (OWN + 1) / 2;
/// How many numbers an [`Evidence`] is.
pub const NUMBERS: usize = PACKED + 4 + OWN + 4 + 4 + 3;

/// By how much an outline's edges lie off, pixels outwards: both borders alike (the tube seems wider), both towards the
/// first one (it seems displaced), the distal end, the other end. Light from one side, and where a camera puts its chroma
/// samples, displace a tube five times as much as they widen it, and depth hangs on its width alone.
pub type Offsets = Vector4<f64>;

/// The offset of one of the outline's four parts (see [`Place::part`]), pixels outwards.
pub fn offset_of_part(offsets: &Offsets, part: usize) -> f64 {
    match part {
        0 => offsets[0] + offsets[1],
        1 => offsets[0] - offsets[1],
        _ => offsets[part],
    }
}

/// Standard deviations of the offsets that a whole session shares, pixels: what lens, light and compression do to an edge
/// everywhere; at the other end the tape's own thickness shows. RMS over scenes of three renderers.
pub const SHARED_OFFSETS_PX: [f64; 4] = [0.05, 0.12, 0.2, 0.25];
/// By how much a pose's own offsets differ from them, pixels: background, shadow and gloss.
pub const OWN_OFFSETS_PX: [f64; 4] = [0.06, 0.1, 0.15, 0.25];
/// Offsets of one pose alone, pixels: both together.
pub fn offsets_px() -> [f64; 4] {
    std::array::from_fn(|part| SHARED_OFFSETS_PX[part].hypot(OWN_OFFSETS_PX[part]))
}

/// The normal equations of a pose's edges, in single precision: a recording keeps one for each tool and frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    information: [f32; PACKED],
    /// Offsets that the pose was solved with, pixels.
    offsets: [f32; 4],
    /// Where the edges alone would still pull tube and offsets: the right side of the normal equations.
    pull: [f32; OWN],
    /// What was believed of the offsets: standard deviations, pixels.
    believed_px: [f32; 4],
    /// By how much they may differ from those of like poses: standard deviations, pixels.
    own_px: [f32; 4],
    length_mm: f32,
    px_per_mm: f32,
    /// Nothing is known but how sure the pose is: then all of it may last.
    is_bare: bool,
}

/// What is believed of a pose's offsets before its edges are looked at: standard deviations, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beliefs {
    /// Of each offset.
    pub offsets_px: [f64; 4],
    /// By how much they differ from those that the session shares.
    pub own_px: [f64; 4],
    /// The band's length that is reckoned with, mm.
    pub length_mm: f64,
    /// Pixels that one millimetre along the axis takes at the band's other end; 0 where its length was measured.
    pub px_per_mm: f64,
}

impl Beliefs {
    /// The usual ones, of a band of known length.
    pub fn usual(length_mm: f64) -> Self {
        Self { offsets_px: offsets_px(), own_px: OWN_OFFSETS_PX, length_mm, px_per_mm: 0.0 }
    }
}

impl Evidence {
    /// Of the edges' normal equations, at the pose and offsets that were found under some beliefs, their noise being `noise`
    /// times as large as the edges said.
    pub fn new(
        information: &Information,
        pull: &SVector<f64, OWN>,
        offsets: &Offsets,
        beliefs: &Beliefs,
        noise: f64,
    ) -> Self {
        let all = (0..OWN).flat_map(|row| (0..=row).map(move |column| (row, column)));
        let mut packed = [0.0; PACKED];
        for (packed, place) in packed.iter_mut().zip(all) {
            *packed = (information[place] / noise) as f32;
        }
        Self {
            information: packed,
            offsets: std::array::from_fn(|part| offsets[part] as f32),
            pull: std::array::from_fn(|i| (pull[i] / noise) as f32),
            believed_px: beliefs.offsets_px.map(|px| px as f32),
            own_px: beliefs.own_px.map(|px| px as f32),
            length_mm: beliefs.length_mm as f32,
            px_per_mm: beliefs.px_per_mm as f32,
            is_bare: false,
        }
    }

    /// Of a pose of which only the covariance is known.
    pub fn of_covariance(covariance: &Matrix5<f64>) -> Self {
        let mut information = Information::zeros();
        let of_tube = covariance.try_inverse().unwrap_or_else(Matrix5::zeros);
        information.fixed_view_mut::<5, 5>(0, 0).copy_from(&of_tube);
        let bare = Self::new(&information, &SVector::zeros(), &Vector4::zeros(), &Beliefs::usual(0.0), 1.0);
        Self { is_bare: true, ..bare }
    }

    /// All its numbers, for who keeps them.
    pub fn numbers(&self) -> [f32; NUMBERS] {
        let Self { information, offsets, pull, believed_px, own_px, length_mm, px_per_mm, is_bare } = self;
        let parts: [&[f32]; 5] = [information, offsets, pull, believed_px, own_px];
        let others = [*length_mm, *px_per_mm, f32::from(u8::from(*is_bare))];
        let mut numbers = [0.0; NUMBERS];
        let all = parts.into_iter().flatten().copied().chain(others);
        numbers.iter_mut().zip(all).for_each(|(number, own)| *number = own);
        numbers
    }

    /// Of its numbers.
    pub fn of_numbers(numbers: &[f32; NUMBERS]) -> Self {
        fn part<const N: usize>(numbers: &mut impl Iterator<Item = f32>) -> [f32; N] {
            std::array::from_fn(|_| numbers.next().unwrap_or(0.0))
        }
        let mut rest = numbers.iter().copied();
        let (information, offsets, pull) = (part(&mut rest), part(&mut rest), part(&mut rest));
        let (believed_px, own_px) = (part(&mut rest), part(&mut rest));
        let [length_mm, px_per_mm, is_bare] = part(&mut rest);
        Self { information, offsets, pull, believed_px, own_px, length_mm, px_per_mm, is_bare: is_bare != 0.0 }
    }

    /// As if the noise's variance were so many times as large.
    pub fn doubted(mut self, times: f64) -> Self {
        self.information.iter_mut().chain(&mut self.pull).for_each(|number| *number /= times as f32);
        self
    }

    /// Information on tube and offsets.
    pub fn information(&self) -> Information {
        Information::from_fn(|i, j| {
            let (low, high) = (i.min(j), i.max(j));
            f64::from(self.information[high * (high + 1) / 2 + low])
        })
    }

    /// Where the edges alone would pull tube and offsets.
    pub fn pull(&self) -> SVector<f64, OWN> {
        SVector::from(self.pull.map(f64::from))
    }

    /// By how much the offsets may differ from the shared ones: standard deviations, pixels.
    pub fn own_px(&self) -> [f64; 4] {
        self.own_px.map(f64::from)
    }

    /// The band's length that the pose was solved with, mm.
    pub fn length_mm(&self) -> f64 {
        f64::from(self.length_mm)
    }

    /// Did nobody measure the band?
    pub fn is_of_unknown_length(&self) -> bool {
        self.px_per_mm > 0.0
    }

    /// By how much the shared offsets show, part by part: those of a band whose length nobody measured are counted in mm of
    /// that length.
    pub fn share(&self) -> [f64; 4] {
        [1.0, 1.0, 1.0, if self.is_of_unknown_length() { f64::from(self.px_per_mm) } else { 1.0 }]
    }

    /// Offsets as they would be had the pose been solved with a band of this length, pixels.
    pub fn offsets_at(&self, length_mm: f64) -> Offsets {
        let by_length = f64::from(self.px_per_mm) * (self.length_mm() - length_mm);
        Vector4::from(self.offsets.map(f64::from)) + Vector4::w() * by_length
    }

    /// The tube's covariance, nothing else being known than what was believed, and that part of it which lasts from frame to
    /// frame: were the offsets known, only the edges' own noise would be left.
    pub fn covariance(&self) -> Option<(Matrix5<f64>, Matrix5<f64>)> {
        let information = self.information();
        let all: Matrix5<f64> = self.with_beliefs().cholesky()?.inverse().fixed_view::<5, 5>(0, 0).into_owned();
        if self.is_bare {
            return Some((all, all));
        }
        let passing = information.fixed_view::<5, 5>(0, 0).into_owned().cholesky()?.inverse();
        Some((all, all - passing))
    }

    /// By how much the edges alone would move the tube, nothing else being known than what was believed.
    pub fn change_by_edges_alone(&self) -> Option<Vector5<f64>> {
        let mut pull = self.pull();
        for offset in 0..4 {
            pull[5 + offset] -= f64::from(self.offsets[offset]) / f64::from(self.believed_px[offset]).powi(2);
        }
        Some(self.with_beliefs().cholesky()?.solve(&pull).fixed_rows::<5>(0).into_owned())
    }

    fn with_beliefs(&self) -> Information {
        let mut information = self.information();
        for offset in 0..4 {
            information[(5 + offset, 5 + offset)] += f64::from(self.believed_px[offset]).powi(-2);
        }
        information
    }
}
