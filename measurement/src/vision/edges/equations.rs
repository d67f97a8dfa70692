//! The equations of one edge: what each bin of its profiles contributes on the light of both sides and on the edge's
//! offset.
//!
//! **In** the current estimate of an edge, and its profiles. **Out** all products of the columns of the weighted
//! Jacobian and the residuals: the normal equations of [`super::edge_fit`]. **Method** Light is computed at each bin,
//! encoded, and mixed into the planes. The additional blur of chroma acts on codes and is approximated by the mean of
//! two places. The tracker spends most of its time here, so [`LANES`] bins are processed at once, in single precision,
//! in the widest registers of the machine.

use super::edge_curves::EdgeCurves;
use super::lanes::{LANES, Lanes};
use super::profile::Profile;
use super::tone;

/// Unknowns of the light: `base` inside for three channels, `out` outside for three, additional shading inside for
/// each of them, and one additional ramp outside for all; the last two as shares of the light there.
pub const HEIGHTS: usize = 10;
/// Index of the first shading unknown.
pub const SHADE: usize = 6;
/// Index of the ramp unknown.
pub const RAMP: usize = 9;
/// Number of unknowns: light and offset.
pub const UNKNOWNS: usize = HEIGHTS + 1;
/// Number of columns: unknowns, residual, and the learned parameter.
pub const COLUMNS: usize = UNKNOWNS + 2;
/// Column of the edge's offset.
pub const OFFSET: usize = HEIGHTS;
/// Column of the residuals.
pub const RESIDUAL: usize = HEIGHTS + 1;
/// Column of the learned parameter, see [`LearnedParameter`].
pub const LEARNED: usize = HEIGHTS + 2;

/// Residuals beyond this many standard deviations get less weight.
const ROBUST: f32 = 2.0;

/// Products of all pairs of columns of the weighted equations, summed over bins and planes.
pub struct Products {
    of: [[f32; COLUMNS]; COLUMNS],
    /// Squared residuals of each plane, summed over its pixels.
    pub squares: [f32; 3],
}

impl Products {
    /// The product of two columns.
    pub fn of(&self, one: usize, other: usize) -> f64 {
        f64::from(self.of[one.max(other)][one.min(other)])
    }

    /// The products of the unknowns: the lower half of the normal equations' matrix.
    pub fn normal(&self) -> [[f64; UNKNOWNS]; UNKNOWNS] {
        let mut normal = [[0.0; UNKNOWNS]; UNKNOWNS];
        for (to, from) in normal.iter_mut().zip(&self.of) {
            for (to, from) in to.iter_mut().zip(from) {
                *to = f64::from(*from);
            }
        }
        normal
    }
}

/// A parameter that many edges together determine, not one alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LearnedParameter {
    /// The blur of light.
    LightBlur,
    /// The additional blur of the chroma codes.
    ChromaBlur,
    /// How much farther out the edge lies in chroma.
    ChromaShift,
}

/// Values that are the same for all bins, in single precision.
pub struct EdgeConstants<'a> {
    /// Tables of the blurred step, limb and ramp.
    pub curves: &'a EdgeCurves,
    /// Distance of the edge from the chord, pixels.
    pub offset: f32,
    /// How much farther out it lies in chroma, pixels.
    pub chroma: f32,
    /// Additional blur of the chroma codes, pixels.
    pub chroma_blur: f32,
    /// Blur of light, pixels.
    pub blur: f32,
    /// Does the surface turn away from the camera?
    pub limb: bool,
    /// For a limb: `√(2·blur/radius)` and `blur/radius`. For a cut: `blur/depth` as the second value.
    pub shading: (f32, f32),
    /// Light of each channel.
    pub light: [EdgeLight<f32>; 3],
    /// The parameter to be learned, if any.
    pub learned_parameter: Option<LearnedParameter>,
    /// Matrix from gamma-coded channels to codes.
    pub codes_from_rgb: [[f32; 3]; 3],
    /// Codes of black.
    pub black: [f32; 3],
    /// Inverse variance of each plane.
    pub per_noise: [f32; 3],
}

/// One channel's light on both sides of an edge.
#[derive(Clone, Copy, Debug, Default)]
pub struct EdgeLight<T> {
    /// Inside, without the limb term.
    pub base: T,
    /// The limb term where the surface faces the camera.
    pub limb: T,
    /// Just outside.
    pub out: T,
    /// Increase per pixel outwards.
    pub ramp: T,
    /// Reference light inside and outside: shading and ramp are shares of it.
    pub of: (T, T),
}

impl EdgeLight<f64> {
    /// In single precision.
    pub fn single(self) -> EdgeLight<f32> {
        let Self { base, limb, out, ramp, of } = self;
        let [base, limb, out, ramp] = [base, limb, out, ramp].map(|l| l as f32);
        EdgeLight { base, limb, out, ramp, of: (of.0 as f32, of.1 as f32) }
    }
}

/// The products of all columns of an edge's equations. The same with every instruction set, to the last bit.
pub fn products(constants: &EdgeConstants<'_>, luma: &Profile<1>, chroma: &Profile<2>) -> Products {
    match constants.learned_parameter {
        None => products_without_learned(constants, luma, chroma),
        Some(_) => products_with_learned(constants, luma, chroma),
    }
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn products_without_learned(constants: &EdgeConstants<'_>, luma: &Profile<1>, chroma: &Profile<2>) -> Products {
    products_of_planes::<{ block_count(LEARNED) }, { pair_index(block_count(LEARNED), 0) }>(
        constants, None, luma, chroma,
    )
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn products_with_learned(constants: &EdgeConstants<'_>, luma: &Profile<1>, chroma: &Profile<2>) -> Products {
    products_of_planes::<{ block_count(COLUMNS) }, { pair_index(block_count(COLUMNS), 0) }>(
        constants,
        constants.learned_parameter,
        luma,
        chroma,
    )
}

/// Columns are multiplied in square blocks of this size, which fit into the registers.
const BLOCK: usize = 4;

/// Number of blocks for this many columns.
const fn block_count(columns: usize) -> usize {
    columns.div_ceil(BLOCK)
}

/// Index of the products of two blocks, with `low` ≤ `high`. With `low` 0 and `high` one past the last block: the
/// number of pairs.
const fn pair_index(high: usize, low: usize) -> usize {
    high * (high + 1) / 2 + low
}

#[inline(always)]
fn products_of_planes<const USED: usize, const PAIRS: usize>(
    constants: &EdgeConstants<'_>,
    taught: Option<LearnedParameter>,
    luma: &Profile<1>,
    chroma: &Profile<2>,
) -> Products {
    let mut sums = ProductSums::<PAIRS> { of: [[[Lanes::ZERO; BLOCK]; BLOCK]; PAIRS], squares: [0.0; 3] };
    add_planes::<USED, PAIRS, 1>(constants, taught, luma, 0, &mut sums);
    add_planes::<USED, PAIRS, 2>(constants, taught, chroma, 1, &mut sums);
    let mut of = [[0.0; COLUMNS]; COLUMNS];
    for (high, of) in of.iter_mut().enumerate().take(USED * BLOCK) {
        for (low, of) in of.iter_mut().enumerate().take(high + 1) {
            *of = sums.of[pair_index(high / BLOCK, low / BLOCK)][high % BLOCK][low % BLOCK].sum();
        }
    }
    Products { of, squares: sums.squares }
}

/// [`Products`] while they are being summed, lane by lane.
struct ProductSums<const PAIRS: usize> {
    of: [[[Lanes; BLOCK]; BLOCK]; PAIRS],
    squares: [f32; 3],
}

impl<const PAIRS: usize> ProductSums<PAIRS> {
    /// Adds the products of all pairs of columns for one set of lanes.
    #[inline(always)]
    fn add<const USED: usize>(&mut self, row: &[[Lanes; BLOCK]; USED]) {
        for high in 0..USED {
            for low in 0..=high {
                let sums = &mut self.of[pair_index(high, low)];
                for (sums, one) in sums.iter_mut().zip(&row[high]) {
                    for (sum, other) in sums.iter_mut().zip(&row[low]) {
                        *sum += *one * *other;
                    }
                }
            }
        }
    }
}

/// Adds the equations of planes of one size; `first` is the number of the first plane.
#[inline(always)]
fn add_planes<const USED: usize, const PAIRS: usize, const N: usize>(
    constants: &EdgeConstants<'_>,
    taught: Option<LearnedParameter>,
    profile: &Profile<N>,
    first: usize,
    sums: &mut ProductSums<PAIRS>,
) {
    for (index, scatter) in profile.scatter.iter().enumerate() {
        sums.squares[first + index] = *scatter;
    }
    let is_luma = first == 0;
    for bin in (0..profile.len()).step_by(LANES) {
        let (distances, pixels) = (profile.distances(bin), profile.pixels(bin));
        // The channels are written out by hand: closures passed to library functions would not be compiled for wide
        // registers.
        let EdgeConstants { light: [r, g, b], .. } = constants;
        let lit = if is_luma {
            let at = DistanceTerms::at(constants, distances);
            [ChannelTerms::by(&at, r), ChannelTerms::by(&at, g), ChannelTerms::by(&at, b)]
        } else {
            let (shift, extra) = (constants.chroma, constants.chroma_blur);
            let inner = DistanceTerms::at(constants, distances - (shift + extra));
            let outer = DistanceTerms::at(constants, distances - (shift - extra));
            [
                ChannelTerms::mean(&ChannelTerms::by(&inner, r), &ChannelTerms::by(&outer, r)),
                ChannelTerms::mean(&ChannelTerms::by(&inner, g), &ChannelTerms::by(&outer, g)),
                ChannelTerms::mean(&ChannelTerms::by(&inner, b), &ChannelTerms::by(&outer, b)),
            ]
        };
        for index in 0..N {
            let plane = first + index;
            let [from_r, from_g, from_b] = constants.codes_from_rgb[plane];
            let [r, g, b] = &lit;
            let mixed = |of: fn(&ChannelTerms) -> Lanes| of(r) * from_r + of(g) * from_g + of(b) * from_b;
            let residual = profile.values(index, bin) - constants.black[plane] - mixed(|lit| lit.code);
            let square = residual * residual;
            let per_noise = constants.per_noise[plane];
            let robust = (square * (per_noise / (ROBUST * ROBUST)) + 1.0).sqrt();
            let root = (pixels * per_noise / robust).sqrt();
            sums.squares[plane] += (pixels * square).sum();
            let mut row = [[Lanes::ZERO; BLOCK]; USED];
            let columns = row.as_flattened_mut();
            for (channel, (lit, from)) in lit.iter().zip([from_r, from_g, from_b]).enumerate() {
                let root = root * from;
                columns[channel] = root * lit.by_base;
                columns[3 + channel] = root * lit.by_out;
                columns[SHADE + channel] = root * lit.by_shade;
            }
            let by_offset = root * mixed(|lit| lit.by_offset);
            columns[RAMP] = root * mixed(|lit| lit.by_ramp);
            columns[OFFSET] = by_offset;
            columns[RESIDUAL] = root * residual;
            if let Some(taught) = taught {
                columns[LEARNED] = match taught {
                    LearnedParameter::LightBlur => root * mixed(|lit| lit.by_blur),
                    _ if is_luma => Lanes::ZERO,
                    LearnedParameter::ChromaBlur => root * mixed(|lit| lit.by_chroma_blur),
                    LearnedParameter::ChromaShift => by_offset,
                };
            }
            sums.add::<USED>(&row);
        }
    }
}

/// Coded value of one channel, and its derivatives by light inside and outside, shading, ramp, offset and blur.
#[derive(Clone, Copy)]
struct ChannelTerms {
    code: Lanes,
    by_base: Lanes,
    by_out: Lanes,
    by_shade: Lanes,
    by_ramp: Lanes,
    by_offset: Lanes,
    by_blur: Lanes,
    by_chroma_blur: Lanes,
}

/// Terms at some distances from the edge that are the same for all channels.
struct DistanceTerms {
    /// Distances from the edge, in standard deviations of the blur.
    z: Lanes,
    /// Shares of the inside and the outside.
    inside: Lanes,
    outside: Lanes,
    /// The part outside times the distance from the edge, in pixels, and in standard deviations.
    ramp_px: Lanes,
    ramp: Lanes,
    /// Decrease of the inside's share, px⁻¹.
    density: Lanes,
    /// Limb, or shading of a cut, and its derivatives by offset and blur, px⁻¹.
    limb: Lanes,
    limb_by_offset: Lanes,
    limb_by_blur: Lanes,
}

impl DistanceTerms {
    #[inline(always)]
    fn at(constants: &EdgeConstants<'_>, distances: Lanes) -> Self {
        let (blur, per_blur) = (constants.blur, 1.0 / constants.blur);
        let z = (distances - constants.offset) * per_blur;
        let [inside, root, ramp, density, root_fall] = constants.curves.at(z);
        let (scale, relative) = constants.shading;
        let [limb, limb_by_offset, limb_by_blur] = if constants.limb {
            let deep = (z * -relative).at_least(0.0).at_most(1.0);
            let scale = Lanes::all(scale) - deep * (deep * 0.04 + 0.25) * scale; // √(1 − x/2) to 1e-3
            let per_px = scale * per_blur;
            [scale * root, per_px * root_fall, per_px * (root * 0.5 + z * root_fall)]
        } else {
            let inwards = ramp - z;
            let per_px = relative * per_blur;
            [inwards * relative, inside * per_px, (inwards + z * inside) * per_px]
        };
        Self {
            z,
            inside,
            outside: Lanes::all(1.0) - inside,
            ramp_px: ramp * blur,
            ramp,
            density: density * per_blur,
            limb,
            limb_by_offset,
            limb_by_blur,
        }
    }
}

impl ChannelTerms {
    /// One channel's code and derivatives at these distances.
    #[inline(always)]
    fn by(curves: &DistanceTerms, light: &EdgeLight<f32>) -> Self {
        let &EdgeLight { base, limb: shade, out, ramp: rise, of } = light;
        let &DistanceTerms { z, inside, outside, ramp_px, ramp, density, limb, limb_by_offset, limb_by_blur } = curves;
        let [code, slope] = tone::codes(inside * base + limb * shade + outside * out + ramp_px * rise);
        let step = density * (base - out);
        Self {
            code,
            by_base: slope * inside,
            by_out: slope * outside,
            by_shade: slope * limb * of.0,
            by_ramp: slope * ramp_px * of.1,
            by_offset: slope * (step + limb_by_offset * shade - outside * rise),
            by_blur: slope * (step * z + limb_by_blur * shade + (ramp - z * outside) * rise),
            by_chroma_blur: Lanes::ZERO,
        }
    }

    /// The mean of two places, `outer` lying farther out, and its derivative by the distance between them.
    #[inline(always)]
    fn mean(inner: &Self, outer: &Self) -> Self {
        Self {
            code: (inner.code + outer.code) * 0.5,
            by_base: (inner.by_base + outer.by_base) * 0.5,
            by_out: (inner.by_out + outer.by_out) * 0.5,
            by_shade: (inner.by_shade + outer.by_shade) * 0.5,
            by_ramp: (inner.by_ramp + outer.by_ramp) * 0.5,
            by_offset: (inner.by_offset + outer.by_offset) * 0.5,
            by_blur: (inner.by_blur + outer.by_blur) * 0.5,
            by_chroma_blur: (inner.by_offset - outer.by_offset) * 0.5,
        }
    }
}
