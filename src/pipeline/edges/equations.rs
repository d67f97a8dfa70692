//! The equations of one edge: what each bin of its profiles says of light on both sides and of the edge's place.
//!
//! **In** an edge as it is assumed, and its profiles. **Out** all products of the columns of the weighed Jacobian and the
//! residuals: the normal equations of [`super::edge_fit`]. **Method** light is worked out where each bin lies, coded, and
//! mixed into the planes; chroma's own blur, which acts on codes, is the mean of two places. The tracker spends most of
//! its time here: [`LANES`] bins are worked on at once, in single precision, in the widest registers that the machine has.

use super::edge_curves::EdgeCurves;
use super::profile::{LANES, MOST_BINS, Profile};
use super::tone::Tone;

/// Light's unknowns per channel: inside `base` and `limb`, outside `out` and `ramp`.
pub const PER_CHANNEL: usize = 4;
/// Light's unknowns.
pub const HEIGHTS: usize = 3 * PER_CHANNEL;
/// With the offset.
pub const UNKNOWNS: usize = HEIGHTS + 1;
/// With what only many edges teach together, and the residual.
pub const COLUMNS: usize = UNKNOWNS + 2;
/// Column of the edge's offset.
pub const OFFSET: usize = HEIGHTS;
/// Column of what many edges teach: the blur of light at a cut, how much farther out chroma lies at a limb.
pub const TAUGHT: usize = HEIGHTS + 1;
/// Column of the residuals.
pub const RESIDUAL: usize = HEIGHTS + 2;

/// Sums of products of two columns each.
pub type Products = [[f32; COLUMNS]; COLUMNS];

/// Residuals beyond so many standard deviations count less.
const ROBUST: f32 = 2.0;

/// Equations, one per bin and plane: weighed, column by column.
pub struct Equations {
    columns: [[f32; MOST_ROWS]; COLUMNS],
    count: usize,
    /// Squared residuals of each plane, summed over its pixels.
    pub squares: [f32; 3],
}

const MOST_ROWS: usize = 3 * (MOST_BINS + LANES);

impl Default for Equations {
    fn default() -> Self {
        Self { columns: [[0.0; MOST_ROWS]; COLUMNS], count: 0, squares: [0.0; 3] }
    }
}

impl Equations {
    /// The equations of an edge, as products of their columns; those below the diagonal are left out.
    pub fn of(&mut self, constants: &Constants<'_>, luma: &Profile<1>, chroma: &Profile<2>) -> Products {
        self.count = 0;
        let mut products = [[0.0; COLUMNS]; COLUMNS];
        work_out(constants, luma, chroma, self, &mut products);
        products
    }
}

/// Some lanes of one number each.
type Lanes = [f32; LANES];

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
    /// `[base, limb, out, ramp]` of each channel.
    pub light: [[f32; PER_CHANNEL]; 3],
    /// Gamma-coded channels to codes.
    pub codes_from_rgb: [[f32; 3]; 3],
    /// Codes of black.
    pub black: [f32; 3],
    /// Inverse variance of each plane.
    pub per_noise: [f32; 3],
}

/// Coded value of each channel, and how it depends on the unknowns.
#[derive(Clone, Copy)]
struct Lit {
    code: [Lanes; 3],
    slopes: [[Lanes; PER_CHANNEL]; 3],
    by_offset: [Lanes; 3],
    by_blur: [Lanes; 3],
}

/// All equations of an edge and the products of their columns. The same in every instruction set, to the last bit.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn work_out(
    constants: &Constants<'_>,
    luma: &Profile<1>,
    chroma: &Profile<2>,
    rows: &mut Equations,
    products: &mut Products,
) {
    add(constants, luma, 0, 0.0, rows);
    add(constants, chroma, 1, constants.chroma_blur, rows);
    let used = rows.count;
    for (i, (one, products)) in rows.columns.iter().zip(products.iter_mut()).enumerate() {
        for (other, product) in rows.columns.iter().zip(products.iter_mut()).skip(i) {
            *product = dot(&one[..used], &other[..used]);
        }
    }
}

/// Adds the equations of planes of one size, from plane number `first` on.
#[inline(always)]
fn add<const N: usize>(
    constants: &Constants<'_>,
    profile: &Profile<N>,
    first: usize,
    extra_px: f32,
    rows: &mut Equations,
) {
    for (index, scatter) in profile.scatter.iter().enumerate() {
        rows.squares[first + index] = *scatter;
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
            let mixed = |channels: &[Lanes; 3]| -> Lanes {
                std::array::from_fn(|l| {
                    to_codes[0] * channels[0][l] + to_codes[1] * channels[1][l] + to_codes[2] * channels[2][l]
                })
            };
            let (values, codes) = (profile.values(index, bin), mixed(&lit.code));
            let residual: Lanes = std::array::from_fn(|l| values[l] - constants.black[plane] - codes[l]);
            let per_noise = constants.per_noise[plane];
            let root: Lanes = std::array::from_fn(|l| {
                let square = residual[l] * residual[l];
                (pixels[l] * per_noise / (1.0 + square * per_noise / (ROBUST * ROBUST)).sqrt()).sqrt()
            });
            let squares: Lanes = std::array::from_fn(|l| pixels[l] * residual[l] * residual[l]);
            rows.squares[plane] += squares.iter().sum::<f32>();
            let at = rows.count;
            rows.count += LANES;
            let mut set = |column: usize, values: &Lanes, factor: f32| {
                for l in 0..LANES {
                    rows.columns[column][at + l] = root[l] * factor * values[l];
                }
            };
            for (column, slopes) in lit.slopes.as_flattened().iter().enumerate() {
                set(column, slopes, to_codes[column / PER_CHANNEL]);
            }
            set(OFFSET, &mixed(&lit.by_offset), 1.0);
            let by_taught = match (constants.limb, first) {
                (false, _) => mixed(&lit.by_blur),
                (true, 0) => [0.0; LANES],
                (true, _) => mixed(&lit.by_offset),
            };
            set(TAUGHT, &by_taught, 1.0);
            set(RESIDUAL, &residual, 1.0);
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
    let zero = [0.0; LANES];
    let mut lit = Lit { code: [zero; 3], slopes: [[zero; PER_CHANNEL]; 3], by_offset: [zero; 3], by_blur: [zero; 3] };
    for (c, [base, shade, out, rise]) in constants.light.into_iter().enumerate() {
        let light: Lanes =
            std::array::from_fn(|l| base * share[l] + shade * limb[l] + out * outside[l] + rise * ramp_px[l]);
        let mut slope = [0.0f32; LANES];
        for l in 0..LANES {
            [lit.code[c][l], slope[l]] = constants.tone.code(light[l]);
        }
        for l in 0..LANES {
            lit.slopes[c][0][l] = slope[l] * share[l];
            lit.slopes[c][1][l] = slope[l] * limb[l];
            lit.slopes[c][2][l] = slope[l] * outside[l];
            lit.slopes[c][3][l] = slope[l] * ramp_px[l];
            let step = (base - out) * density[l] / blur;
            lit.by_offset[c][l] = slope[l] * (step + shade * limb_out[l] - rise * outside[l]);
            lit.by_blur[c][l] = slope[l] * (step * z[l] + shade * limb_blur[l] + rise * (ramp[l] - z[l] * outside[l]));
        }
    }
    lit
}

impl Lit {
    /// Half this, half the other.
    #[inline(always)]
    fn average(&mut self, other: &Self) {
        let average = |one: &mut Lanes, other: &Lanes| {
            for l in 0..LANES {
                one[l] = 0.5 * (one[l] + other[l]);
            }
        };
        for c in 0..3 {
            average(&mut self.code[c], &other.code[c]);
            average(&mut self.by_offset[c], &other.by_offset[c]);
            average(&mut self.by_blur[c], &other.by_blur[c]);
            for j in 0..PER_CHANNEL {
                average(&mut self.slopes[c][j], &other.slopes[c][j]);
            }
        }
    }
}

#[inline(always)]
fn dot(one: &[f32], other: &[f32]) -> f32 {
    let mut sums = [0.0f32; LANES];
    for (a, b) in one.as_chunks::<LANES>().0.iter().zip(other.as_chunks::<LANES>().0) {
        for l in 0..LANES {
            sums[l] += a[l] * b[l];
        }
    }
    let [a, b, c, d, e, f, g, h] = sums;
    ((a + e) + (b + f)) + ((c + g) + (d + h))
}
