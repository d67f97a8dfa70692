//! Turns light on the sensor into codes in a file: lens blur, vignetting, tone curve, YUV, noise.

use super::super::light::Rgb;
use super::super::rig::{Optics, Rig};
use super::picture::chroma_length;
use super::tile::TILE;
use crate::random::Dice;

/// Pixels of blur on each side.
pub const BLUR_REACH_PX: usize = 3;
/// Pixels along a patch: a tile and the pixels that blur into it.
pub const PATCH: usize = TILE + 2 * BLUR_REACH_PX;

const TONES: usize = 2048;
const MAX_LIGHT: f32 = 2.0;

/// Response of lens and sensor, as tables.
pub struct SensorModel {
    taps: [f32; 2 * BLUR_REACH_PX + 1],
    tone: Vec<f32>,
    vignette: Vec<f32>,
    width: usize,
}

/// Gamma-encoded red, green, blue in 0..1.
pub type Encoded = [f32; 3];

impl SensorModel {
    /// The lens and sensor of a rig.
    pub fn new(rig: &Rig) -> Self {
        let camera = &rig.camera;
        let (width, height) = (camera.width as usize, camera.height as usize);
        let corner = (camera.cx / camera.fx).hypot(camera.cy / camera.fy);
        let loss = |u: usize, v: usize| {
            let radius = ((u as f64 - camera.cx) / camera.fx).hypot((v as f64 - camera.cy) / camera.fy) / corner;
            (1.0 - rig.optics.vignetting * radius * radius).max(0.05) as f32
        };
        let vignette = (0..width * height).map(|i| loss(i % width, i / width)).collect();
        let tone = (0..=TONES).map(|i| encode(MAX_LIGHT * i as f32 / TONES as f32)).collect();
        Self { taps: taps(rig.optics.blur_px), tone, vignette, width }
    }

    /// Blurs and encodes the tile in the middle of a patch; the tile begins at pixel (`left`, `top`).
    pub fn develop(&self, patch: &[Rgb], left: usize, top: usize, size: (usize, usize)) -> Vec<Encoded> {
        let mut across = [[0.0f32; 3]; PATCH * TILE];
        for y in 0..size.1 + 2 * BLUR_REACH_PX {
            for x in 0..size.0 {
                across[y * TILE + x] = self.blurred(|k| patch[y * PATCH + x + k]);
            }
        }
        let mut encoded = Vec::with_capacity(size.0 * size.1);
        for y in 0..size.1 {
            for x in 0..size.0 {
                let light = self.blurred(|k| across[(y + k) * TILE + x]);
                let share = self.vignette[(top + y) * self.width + left + x];
                encoded.push(light.map(|c| self.tone_of(c * share)));
            }
        }
        encoded
    }

    #[inline]
    fn blurred(&self, at: impl Fn(usize) -> Rgb) -> Rgb {
        let mut sum = [0.0; 3];
        for (k, tap) in self.taps.iter().enumerate() {
            let rgb = at(k);
            for (channel, value) in sum.iter_mut().zip(rgb) {
                *channel += tap * value;
            }
        }
        sum
    }

    #[inline]
    fn tone_of(&self, light: f32) -> f32 {
        let at = (light * (TONES as f32 / MAX_LIGHT)).clamp(0.0, TONES as f32 - 1.0);
        let step = at as usize;
        self.tone[step] + (self.tone[step + 1] - self.tone[step]) * (at - step as f32)
    }
}

fn taps(sigma: f64) -> [f32; 2 * BLUR_REACH_PX + 1] {
    let weights: [f64; 2 * BLUR_REACH_PX + 1] = std::array::from_fn(|k| {
        let off = k as f64 - BLUR_REACH_PX as f64;
        (-0.5 * (off / sigma.max(1e-3)).powi(2)).exp()
    });
    let sum: f64 = weights.iter().sum();
    weights.map(|w| (w / sum) as f32)
}

/// sRGB encoding, with a soft roll-off for highlights.
fn encode(light: f32) -> f32 {
    const KNEE: f32 = 0.72;
    let over = (light - KNEE).max(0.0);
    let kept = light.min(KNEE) + (1.0 - KNEE) * (1.0 - (-over / (1.0 - KNEE)).exp());
    if kept <= 0.003_130_8 { 12.92 * kept } else { 1.055 * kept.powf(1.0 / 2.4) - 0.055 }
}

/// A tile as codes of BT.709, limited range, before noise and rounding.
pub struct EncodedTile {
    /// Luma samples in a row.
    pub width: usize,
    /// Chroma samples in a row.
    pub chroma_width: usize,
    /// Luma.
    pub y: Vec<f32>,
    /// Blue difference.
    pub u: Vec<f32>,
    /// Red difference.
    pub v: Vec<f32>,
}

impl EncodedTile {
    /// The codes of a tile; a chroma sample is the mean of the pixels that share it.
    pub fn new(tile: &[Encoded], (width, height): (usize, usize), (sx, sy): (u8, u8)) -> Self {
        let (chroma_width, chroma_height) = (chroma_length(width, sx), chroma_length(height, sy));
        let mut plate = Self {
            width,
            chroma_width,
            y: tile.iter().map(|rgb| yuv(*rgb)[0]).collect(),
            u: Vec::with_capacity(chroma_width * chroma_height),
            v: Vec::with_capacity(chroma_width * chroma_height),
        };
        for sample in 0..chroma_width * chroma_height {
            let (left, top) = ((sample % chroma_width) << sx, (sample / chroma_width) << sy);
            let (right, bottom) = ((left + (1 << sx)).min(width), (top + (1 << sy)).min(height));
            let rows = (top..bottom).flat_map(|row| &tile[row * width + left..row * width + right]);
            let sum = rows.fold([0.0; 3], |sum: Encoded, rgb| [0, 1, 2].map(|c| sum[c] + rgb[c]));
            let count = ((right - left) * (bottom - top)) as f32;
            let [_, blue, red] = yuv(sum.map(|c| c / count));
            plate.u.push(blue);
            plate.v.push(red);
        }
        plate
    }
}

fn yuv(rgb: Encoded) -> [f32; 3] {
    let [r, g, b] = rgb;
    let y = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    [16.0 + 219.0 * y, 128.0 + 224.0 * (b - y) / 1.8556, 128.0 + 224.0 * (r - y) / 1.5748]
}

/// The sensor's noise: stronger in bright light, but amplified in the dark by the tone curve.
pub struct SensorNoise {
    normals: Vec<f32>,
    sigma: [f32; 256],
}

/// Noise for one row of samples.
pub struct NoiseRow<'a> {
    grain: &'a SensorNoise,
    dice: Dice,
    bits: u64,
    left: u32,
}

const NORMALS_BITS: u32 = 12;

impl SensorNoise {
    /// The noise of a sensor.
    pub fn new(optics: &Optics) -> Self {
        let mut dice = Dice::new(0, "grain");
        let normals = (0..1 << NORMALS_BITS).map(|_| dice.gauss() as f32).collect();
        let sigma = std::array::from_fn(|code| sigma_of_code(optics, code as f32));
        Self { normals, sigma }
    }

    /// The noise of a row; `key` distinguishes frames and bands.
    pub fn row(&self, seed: u64, key: &str) -> NoiseRow<'_> {
        NoiseRow { grain: self, dice: Dice::new(seed, key), bits: 0, left: 0 }
    }
}

impl NoiseRow<'_> {
    /// The next standard normal.
    #[inline]
    pub fn normal(&mut self) -> f32 {
        if self.left == 0 {
            (self.bits, self.left) = (self.dice.bits(), 64 / NORMALS_BITS);
        }
        let index = self.bits & ((1 << NORMALS_BITS) - 1);
        self.bits >>= NORMALS_BITS;
        self.left -= 1;
        self.grain.normals[index as usize]
    }

    /// Noise at a luma code, codes.
    #[inline]
    pub fn luma_noise(&mut self, code: f32) -> f32 {
        self.grain.sigma[code as u8 as usize] * self.normal()
    }

    /// A luma code with noise, rounded.
    #[inline]
    pub fn luma(&mut self, code: f32) -> u8 {
        (code + self.luma_noise(code) + 0.5) as u8 // saturates at both ends
    }

    /// A chroma code with noise, rounded.
    #[inline]
    pub fn chroma(&mut self, code: f32) -> u8 {
        const CHROMA_SIGMA: f32 = 0.8; // codes; averaged over four pixels and cleaned by every camera
        (code + CHROMA_SIGMA * self.normal() + 0.5) as u8
    }
}

/// Standard deviation of a luma code: the linear noise times the slope of the tone curve at this code.
fn sigma_of_code(optics: &Optics, code: f32) -> f32 {
    let encoded = ((code - 16.0) / 219.0).clamp(0.0, 1.0);
    let linear = if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) };
    let noise = ((optics.read_noise.powi(2) + optics.shot_noise.powi(2) * f64::from(linear)) as f32).sqrt();
    let slope =
        (encode(linear + 0.002) - encode((linear - 0.002).max(0.0))) / (linear + 0.002 - (linear - 0.002).max(0.0));
    219.0 * noise * slope
}
