//! How likely a colour is on a bare shaft, and anywhere in the recording.
//!
//! **In** the marked pixels of the shaft; cells of frames. **Out** logarithms of probability densities per code³.
//! **Method** Luma: the marked pixels' histogram, blurred because light varies along a tube, and a part of a fifth that
//! is spread evenly over darker and brighter codes, because the rectangles of a person miss highlights. Chroma: a
//! Student distribution, whose tails do not rule out what the samples do not show.

use super::cells::CellPicture;

/// Share of the luma that is spread evenly.
const SPREAD_SHARE: f64 = 0.2;
/// How far it reaches beyond the marked codes, towards black and towards white, codes: gloss adds up to a quarter of
/// the range.
const SPREAD_CODES: (f64, f64) = (40.0, 60.0);
/// Share of a still's luma that is in shade: a tube mirrors what is around it, so its unlit parts are darker than the
/// marked ones by any factor, down to black. More than highlights, because the largest part of a tube is not lit.
const SHADE_SHARE: f64 = 0.3;
/// Blur of the luma's histogram: standard deviation, codes.
const LUMA_BLUR: f64 = 12.0;
/// Standard deviation that is added to the chroma's: that of a cell's mean by chroma subsampling and quantisation, codes.
const CHROMA_FLOOR: f64 = 2.0;
/// Degrees of freedom of the Student distribution.
const FREEDOM: f64 = 4.0;
/// Least probability density per code of luma.
const LEAST_DENSITY: f64 = 1e-6;

/// Log density of a shaft's colour.
#[derive(Clone)]
pub struct ShaftColour {
    luma: [f32; 256],
    chroma: [f32; 2],
    /// Luma below which the chroma shrinks in proportion, as it does in shade; 0 without shade.
    shade_luma: f32,
    /// Of each chroma channel, divided by the degrees of freedom.
    scale: [f32; 2],
    normaliser: f32,
}

impl ShaftColour {
    /// From the codes of marked pixels; `None` without any.
    pub fn new(pixels: &[[u8; 3]]) -> Option<Self> {
        Self::with_shade(pixels, 0.0)
    }

    /// The same for a still. Its marks may be of another picture, and show only lit parts of the shaft.
    pub fn in_shade_too(pixels: &[[u8; 3]]) -> Option<Self> {
        Self::with_shade(pixels, SHADE_SHARE)
    }

    fn with_shade(pixels: &[[u8; 3]], shade_share: f64) -> Option<Self> {
        if pixels.is_empty() {
            return None;
        }
        let of = |part: usize| {
            let mut codes: Vec<f64> = pixels.iter().map(|codes| f64::from(codes[part])).collect();
            codes.sort_by(f64::total_cmp);
            codes
        };
        let at = |sorted: &[f64], share: f64| sorted[((sorted.len() - 1) as f64 * share).round() as usize];
        let luma = of(0);
        let top = (at(&luma, 0.95) + SPREAD_CODES.1).min(255.0);
        let bottom = (at(&luma, 0.05) - SPREAD_CODES.0).max(0.0);
        let mut histogram = [0.0; 256];
        luma.iter().for_each(|code| histogram[*code as usize] += 1.0 / luma.len() as f64);
        let blurred = blur(&histogram);
        let spread = |code: usize| {
            if (bottom..=top).contains(&(code as f64)) { 1.0 / (top + 1.0 - bottom) } else { 0.0 }
        };
        let mut shade = [0.0; 256];
        for (code, share) in histogram.iter().enumerate().filter(|(_, share)| **share > 0.0) {
            shade[..=code].iter_mut().for_each(|density| *density += share / (code + 1) as f64);
        }
        let density = |code: usize| {
            (1.0 - SPREAD_SHARE - shade_share) * blurred[code]
                + SPREAD_SHARE * spread(code)
                + shade_share * shade[code]
                + LEAST_DENSITY
        };
        let mut chroma = [0.0; 2];
        let mut variance = [0.0; 2];
        for part in 0..2 {
            let codes = of(part + 1);
            chroma[part] = at(&codes, 0.5);
            let mut off: Vec<f64> = codes.iter().map(|code| (code - chroma[part]).abs()).collect();
            off.sort_by(f64::total_cmp);
            variance[part] = (1.4826 * at(&off, 0.5)).powi(2) + CHROMA_FLOOR * CHROMA_FLOOR;
        }
        let normaliser = -(std::f64::consts::TAU * (variance[0] * variance[1]).sqrt()).ln();
        Some(Self {
            luma: std::array::from_fn(|code| density(code).ln() as f32),
            chroma: chroma.map(|code| code as f32),
            shade_luma: if shade_share > 0.0 { at(&luma, 0.05) as f32 } else { 0.0 },
            scale: variance.map(|variance| (1.0 / (variance * FREEDOM)) as f32),
            normaliser: normaliser as f32,
        })
    }

    /// Usual chroma, codes.
    pub fn chroma(&self) -> [f32; 2] {
        self.chroma
    }

    /// Log density of these codes on the shaft.
    pub fn log_density(&self, codes: [f32; 3]) -> f32 {
        const POWER: f32 = (0.5 * (FREEDOM + 2.0)) as f32;
        const GREY: f32 = 128.0;
        let light = if codes[0] < self.shade_luma { codes[0] / self.shade_luma } else { 1.0 };
        let usual = |part: usize| GREY + light * (self.chroma[part] - GREY);
        let distance: f32 = (0..2).map(|part| (codes[part + 1] - usual(part)).powi(2) * self.scale[part]).sum();
        self.most_log_density(codes) - POWER * distance.ln_1p()
    }

    /// Log density of this luma on the shaft with its usual chroma: with any other it is lower.
    pub fn most_log_density(&self, [luma, ..]: [f32; 3]) -> f32 {
        self.luma[luma.clamp(0.0, 255.0) as usize] + self.normaliser
    }
}

/// A histogram of 256 codes, blurred.
fn blur(histogram: &[f64; 256]) -> [f64; 256] {
    const REACH: isize = 48;
    let weight = |distance: isize| (-0.5 * (distance as f64 / LUMA_BLUR).powi(2)).exp();
    let sum: f64 = (-REACH..=REACH).map(weight).sum();
    std::array::from_fn(|code| {
        let near = (-REACH..=REACH).filter_map(|d| Some((histogram.get(code.checked_add_signed(d)?)?, weight(d))));
        near.map(|(share, weight)| share * weight / sum).sum()
    })
}

/// Codes in one bin of the histogram of all colours.
const BINS: [usize; 3] = [32, 64, 64];

/// Log density of a colour anywhere in the recording.
#[derive(Clone)]
pub struct AnyColour(Vec<f32>);

impl AnyColour {
    /// From the cells of frames spread over the recording.
    pub fn new<'a>(pictures: impl IntoIterator<Item = &'a CellPicture>) -> Self {
        /// Codes³ in one bin.
        const BIN_SIZE: f32 = 128.0;
        const LEAST_DENSITY: f32 = 1e-9;
        let mut counts = vec![0f32; BINS.iter().product()];
        for codes in pictures.into_iter().flat_map(|picture| &picture.codes) {
            counts[bin(codes.map(f32::from))] += 1.0;
        }
        let strides = [BINS[1] * BINS[2], BINS[2], 1];
        for (axis, stride) in strides.into_iter().enumerate() {
            counts = smoothed(&counts, BINS[axis], stride);
        }
        let sum = counts.iter().sum::<f32>().max(1.0);
        Self(counts.into_iter().map(|count| (count / sum / BIN_SIZE + LEAST_DENSITY).ln()).collect())
    }

    /// Log density of these codes.
    pub fn log_density(&self, codes: [f32; 3]) -> f32 {
        self.0[bin(codes)]
    }
}

fn bin(codes: [f32; 3]) -> usize {
    let [y, u, v] = codes.map(|code| code.clamp(0.0, 255.0) as usize);
    (y >> 3) * BINS[1] * BINS[2] + (u >> 2) * BINS[2] + (v >> 2)
}

/// Counts smoothed along one axis with weights ¼, ½, ¼; the axis ends where it ends.
fn smoothed(counts: &[f32], bins: usize, stride: usize) -> Vec<f32> {
    let along = |i: usize| (i / stride) % bins;
    let value = |i: usize| {
        let before = if along(i) > 0 { counts[i - stride] } else { counts[i] };
        let after = if along(i) + 1 < bins { counts[i + stride] } else { counts[i] };
        0.25 * before + 0.5 * counts[i] + 0.25 * after
    };
    (0..counts.len()).map(value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn black() -> ShaftColour {
        let pixels: Vec<[u8; 3]> = (0..200).map(|i| [25 + (i % 20) as u8, 126 + (i % 3) as u8, 129]).collect();
        ShaftColour::new(&pixels).unwrap()
    }

    #[test]
    fn densities_over_luma_add_up_to_one() {
        let sum: f32 = black().luma.iter().map(|log| log.exp()).sum();
        assert!((0.9..1.05).contains(&sum), "{sum}");
    }

    #[test]
    fn a_highlight_is_less_likely_than_the_marked_colour_and_likelier_than_another_hue() {
        let colour = black();
        let [marked, highlight, orange] =
            [[35.0, 127.0, 129.0], [85.0, 127.0, 129.0], [85.0, 90.0, 180.0]].map(|codes| colour.log_density(codes));
        assert!(marked > highlight + 1.0 && highlight > orange + 5.0, "{marked} {highlight} {orange}");
    }

    #[test]
    fn in_a_still_unlit_parts_of_the_shaft_are_black_and_not_coloured() {
        let pixels: Vec<[u8; 3]> = (0..200).map(|i| [40 + (i % 20) as u8, 122, 136]).collect();
        let still = ShaftColour::in_shade_too(&pixels).unwrap();
        let [unlit, coloured] = [[4.0, 127.0, 129.0], [4.0, 122.0, 136.0]].map(|codes| still.log_density(codes));
        assert!(unlit > ShaftColour::new(&pixels).unwrap().log_density([4.0, 127.0, 129.0]) + 2.0);
        assert!(unlit > coloured + 1.0, "{unlit} {coloured}");
        let sum: f32 = still.luma.iter().map(|log| log.exp()).sum();
        assert!((0.9..1.05).contains(&sum), "{sum}");
    }

    #[test]
    fn without_marked_pixels_nothing_is_known() {
        assert!(ShaftColour::new(&[]).is_none());
    }
}
