//! The equations of one edge: what each bin of its profiles says of light on both sides and of the edge's place.
//!
//! **In** an edge as it is assumed, and its profiles. **Out** all products of the columns of the weighed Jacobian and the
//! residuals: the normal equations of [`super::edge_fit`]. **Method** light is worked out where each bin lies, coded, and
//! mixed into the planes; chroma's own blur, which acts on codes, is the mean of two places. The tracker spends most of
//! its time here: [`LANES`] bins are worked on at once, in single precision, in the widest registers that the machine has.

use super::edge_curves::EdgeCurves;
use super::profile::{LANES, Profile};
use super::tone::Tone;

/// Heights of light: inside `base` of three channels, outside `out` of three, by how much more the inside shades in each
/// of them, and by how much more the outside rises in all, as shares of the light there.
pub const HEIGHTS: usize = 10;
/// The first height of the shading, and the one of the ramp.
pub const SHADE: usize = 6;
/// See [`SHADE`].
pub const RAMP: usize = 9;
/// With the offset.
pub const UNKNOWNS: usize = HEIGHTS + 1;
/// With the residual, and what only many edges teach together.
pub const COLUMNS: usize = UNKNOWNS + 2;
/// Column of the edge's offset.
pub const OFFSET: usize = HEIGHTS;
/// Column of the residuals.
pub const RESIDUAL: usize = HEIGHTS + 1;
/// Column of what only many edges teach: see [`Taught`].
pub const TAUGHT: usize = HEIGHTS + 2;

/// Residuals beyond so many standard deviations count less.
const ROBUST: f32 = 2.0;

/// Sums, over all bins and planes, of products of two columns of the weighed equations.
pub struct Products {
    of: [f32; PAIRS],
    /// Squared residuals of each plane, summed over its pixels.
    pub squares: [f32; 3],
}

/// Pairs of columns, each with itself too.
const PAIRS: usize = COLUMNS * (COLUMNS + 1) / 2;

impl Products {
    /// The product of two columns.
    pub fn of(&self, one: usize, other: usize) -> f64 {
        let (low, high) = (one.min(other), one.max(other));
        f64::from(self.of[high * (high + 1) / 2 + low])
    }
}

/// Some lanes of one number each.
type Lanes = [f32; LANES];

/// What only many edges teach together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taught {
    /// The blur of light.
    LightBlur,
    /// The blur of chroma's codes besides.
    ChromaBlur,
    /// How much farther out the edge lies in chroma.
    ChromaShift,
}

/// What does not change from bin to bin, in single precision.
pub struct Constants<'a> {
    /// Blurred step, limb and ramp.
    pub curves: &'a EdgeCurves,
    /// Light to codes.
    pub tone: &'a Tone,
    /// Of the edge from the chord, pixels.
    pub offset: f32,
    /// How much farther out it lies in chroma, pixels.
    pub chroma: f32,
    /// Blur of chroma's codes besides that of light, pixels.
    pub chroma_blur: f32,
    /// Blur of light, pixels.
    pub blur: f32,
    /// Does the surface turn away?
    pub limb: bool,
    /// `√(2·blur/radius)` and `blur/radius` of a limb; `blur/depth` of a cut.
    pub shading: (f32, f32),
    /// Light of each channel.
    pub light: [Light<f32>; 3],
    /// What besides is asked of the edge.
    pub taught: Option<Taught>,
    /// Gamma-coded channels to codes.
    pub codes_from_rgb: [[f32; 3]; 3],
    /// Codes of black.
    pub black: [f32; 3],
    /// Inverse variance of each plane.
    pub per_noise: [f32; 3],
}

/// One channel's light on both sides of an edge.
#[derive(Clone, Copy, Debug, Default)]
pub struct Light<T> {
    /// Inside, but for what the limb adds.
    pub base: T,
    /// What the limb adds where the surface faces the camera.
    pub limb: T,
    /// Just outside.
    pub out: T,
    /// How much more per pixel outwards.
    pub ramp: T,
    /// The light inside and outside that shading and ramp are shares of.
    pub of: (T, T),
}

impl Light<f64> {
    /// In single precision.
    pub fn single(self) -> Light<f32> {
        let Self { base, limb, out, ramp, of } = self;
        let [base, limb, out, ramp] = [base, limb, out, ramp].map(|l| l as f32);
        Light { base, limb, out, ramp, of: (of.0 as f32, of.1 as f32) }
    }
}

/// Coded value of each channel, and how it depends on light inside and outside, shading, ramp, offset and blur.
#[derive(Clone, Copy)]
struct Lit {
    channels: [[Lanes; KINDS]; 3],
}

const KINDS: usize = 8;
const CODE: usize = 0;
const BY_BASE: usize = 1;
const BY_OUT: usize = 2;
const BY_SHADE: usize = 3;
const BY_RAMP: usize = 4;
const BY_OFFSET: usize = 5;
const BY_BLUR: usize = 6;
const BY_CHROMA_BLUR: usize = 7;

/// The products of all columns of an edge's equations. The same in every instruction set, to the last bit.
#[multiversion::multiversion(targets("x86_64+avx2"))]
pub fn products(constants: &Constants<'_>, luma: &Profile<1>, chroma: &Profile<2>) -> Products {
    let mut sums = Sums { of: [[0.0; LANES]; PAIRS], squares: [0.0; 3] };
    add(constants, luma, 0, 0.0, &mut sums);
    add(constants, chroma, 1, constants.chroma_blur, &mut sums);
    Products { of: sums.of.map(|lanes| lanes.iter().sum()), squares: sums.squares }
}

/// [`Products`] while they grow, lane by lane.
struct Sums {
    of: [Lanes; PAIRS],
    squares: [f32; 3],
}

/// Adds the equations of planes of one size, from plane number `first` on.
#[inline(always)]
fn add<const N: usize>(constants: &Constants<'_>, profile: &Profile<N>, first: usize, extra_px: f32, sums: &mut Sums) {
    for (index, scatter) in profile.scatter.iter().enumerate() {
        sums.squares[first + index] = *scatter;
    }
    for bin in (0..profile.len()).step_by(LANES) {
        let (distances, pixels) = (profile.distances(bin), profile.pixels(bin));
        let shift = if first == 0 { 0.0 } else { constants.chroma };
        let mut lit = light_at(constants, distances.map(|d| d - shift - extra_px));
        if extra_px > 0.0 {
            lit.average(&light_at(constants, distances.map(|d| d - shift + extra_px)));
        }
        for index in 0..N {
            let plane = first + index;
            let to_codes = constants.codes_from_rgb[plane];
            let mixed = |kind: usize| -> Lanes {
                let [r, g, b] = [&lit.channels[0][kind], &lit.channels[1][kind], &lit.channels[2][kind]];
                std::array::from_fn(|l| to_codes[0] * r[l] + to_codes[1] * g[l] + to_codes[2] * b[l])
            };
            let (values, codes) = (profile.values(index, bin), mixed(CODE));
            let residual: Lanes = std::array::from_fn(|l| values[l] - constants.black[plane] - codes[l]);
            let per_noise = constants.per_noise[plane];
            let root: Lanes = std::array::from_fn(|l| {
                let square = residual[l] * residual[l];
                (pixels[l] * per_noise / (1.0 + square * per_noise / (ROBUST * ROBUST)).sqrt()).sqrt()
            });
            let squares: Lanes = std::array::from_fn(|l| pixels[l] * residual[l] * residual[l]);
            sums.squares[plane] += squares.iter().sum::<f32>();
            let mut row = [[0.0; LANES]; COLUMNS];
            let mut set = |column: usize, values: &Lanes, factor: f32| {
                for l in 0..LANES {
                    row[column][l] = root[l] * factor * values[l];
                }
            };
            for (channel, (lit, to_codes)) in lit.channels.iter().zip(to_codes).enumerate() {
                set(channel, &lit[BY_BASE], to_codes);
                set(3 + channel, &lit[BY_OUT], to_codes);
                set(SHADE + channel, &lit[BY_SHADE], to_codes);
            }
            set(RAMP, &mixed(BY_RAMP), 1.0);
            let by_offset = mixed(BY_OFFSET);
            set(OFFSET, &by_offset, 1.0);
            set(RESIDUAL, &residual, 1.0);
            if let Some(taught) = constants.taught {
                let by_taught = match (taught, first) {
                    (Taught::LightBlur, _) => mixed(BY_BLUR),
                    (_, 0) => [0.0; LANES],
                    (Taught::ChromaBlur, _) => mixed(BY_CHROMA_BLUR),
                    (Taught::ChromaShift, _) => by_offset,
                };
                set(TAUGHT, &by_taught, 1.0);
            }
            if constants.taught.is_some() {
                sums.add::<COLUMNS>(&row);
            } else {
                sums.add::<TAUGHT>(&row);
            }
        }
    }
}

impl Sums {
    /// Adds the products of the first columns of some lanes.
    #[inline(always)]
    fn add<const USED: usize>(&mut self, row: &[Lanes; COLUMNS]) {
        for high in 0..USED {
            for low in 0..=high {
                let sum = &mut self.of[high * (high + 1) / 2 + low];
                for l in 0..LANES {
                    sum[l] += row[high][l] * row[low][l];
                }
            }
        }
    }
}

/// What light does at some distances from the chord.
#[inline(always)]
fn light_at(constants: &Constants<'_>, distances: Lanes) -> Lit {
    let blur = constants.blur;
    let z: Lanes = distances.map(|d| (d - constants.offset) / blur);
    let mut at = [[0.0f32; LANES]; 5];
    for l in 0..LANES {
        let curves = constants.curves.at(z[l]);
        for (at, curve) in at.iter_mut().zip(curves) {
            at[l] = curve;
        }
    }
    let [share, root, ramp, density, root_fall] = at;
    let (scale, relative) = constants.shading;
    let (mut limb, mut limb_out, mut limb_blur) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for l in 0..LANES {
        if constants.limb {
            let inside = (-z[l] * relative).clamp(0.0, 1.0);
            let scale = scale * (1.0 - inside * (0.25 + 0.04 * inside)); // √(1 − x/2) to 1e-3
            limb[l] = scale * root[l];
            limb_out[l] = scale * root_fall[l] / blur;
            limb_blur[l] = scale * (0.5 * root[l] + z[l] * root_fall[l]) / blur;
        } else {
            let inwards = ramp[l] - z[l];
            limb[l] = inwards * relative;
            limb_out[l] = share[l] * relative / blur;
            limb_blur[l] = (inwards + z[l] * share[l]) * relative / blur;
        }
    }
    let outside: Lanes = share.map(|share| 1.0 - share);
    let ramp_px: Lanes = ramp.map(|ramp| ramp * blur);
    let mut lit = Lit { channels: [[[0.0; LANES]; KINDS]; 3] };
    for (lit, Light { base, limb: shade, out, ramp: rise, of }) in lit.channels.iter_mut().zip(constants.light) {
        let light: Lanes =
            std::array::from_fn(|l| base * share[l] + shade * limb[l] + out * outside[l] + rise * ramp_px[l]);
        let [code, slope] = constants.tone.codes(light);
        lit[CODE] = code;
        for l in 0..LANES {
            lit[BY_BASE][l] = slope[l] * share[l];
            lit[BY_OUT][l] = slope[l] * outside[l];
            lit[BY_SHADE][l] = slope[l] * of.0 * limb[l];
            lit[BY_RAMP][l] = slope[l] * of.1 * ramp_px[l];
            let step = (base - out) * density[l] / blur;
            lit[BY_OFFSET][l] = slope[l] * (step + shade * limb_out[l] - rise * outside[l]);
            lit[BY_BLUR][l] = slope[l] * (step * z[l] + shade * limb_blur[l] + rise * (ramp[l] - z[l] * outside[l]));
        }
    }
    lit
}

impl Lit {
    /// Half this, half the other, which lies farther out; and how that depends on how far apart the two are.
    #[inline(always)]
    fn average(&mut self, other: &Self) {
        for (one, other) in self.channels.iter_mut().zip(&other.channels) {
            for l in 0..LANES {
                one[BY_CHROMA_BLUR][l] = one[BY_OFFSET][l] - other[BY_OFFSET][l];
            }
        }
        for (one, other) in self.channels.as_flattened_mut().iter_mut().zip(other.channels.as_flattened()) {
            for l in 0..LANES {
                one[l] = 0.5 * (one[l] + other[l]);
            }
        }
    }
}
