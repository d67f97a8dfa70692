//! How light became codes: blur and motion mix *light*, but a file holds codes that rise about as its 1/2.2nd power.
//!
//! Across a blurred edge the codes are therefore no blend of both sides' codes: the brighter side seems to reach too far,
//! by 0.2 pixel for a sharp border and by a whole one for a smeared one. An edge model must mix light and code it then.

use std::sync::LazyLock;

/// What is mixed by blur.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mixing {
    /// Light, as every lens and shutter does; codes follow it by the curve of sRGB (IEC 61966-2-1).
    Light,
    /// The codes themselves, as pictures that were drawn and blurred afterwards.
    Codes,
}

const STEPS: usize = 1024;

/// A curve from light (1: the brightest that is recorded) to gamma-coded value (0..1), and its slope, tabled.
pub struct Tone {
    mixing: Mixing,
    table: [[f32; 2]; STEPS + 1],
}

static LIGHT: LazyLock<Tone> = LazyLock::new(|| Tone::new(Mixing::Light));
static CODES: LazyLock<Tone> = LazyLock::new(|| Tone::new(Mixing::Codes));

impl Tone {
    /// The one table for this way of mixing.
    pub fn of(mixing: Mixing) -> &'static Self {
        match mixing {
            Mixing::Light => &LIGHT,
            Mixing::Codes => &CODES,
        }
    }

    fn new(mixing: Mixing) -> Self {
        let pair = |light: f64| match mixing {
            Mixing::Codes => [light, 1.0],
            Mixing::Light if light <= 0.003_130_8 => [12.92 * light, 12.92],
            Mixing::Light => {
                let root = 1.055 * light.powf(1.0 / 2.4);
                [root - 0.055, root / (2.4 * light)]
            }
        };
        Self { mixing, table: std::array::from_fn(|i| pair(i as f64 / STEPS as f64).map(|v| v as f32)) }
    }

    /// Code and slope of this much light. More than 1 is cut off. For solvers' sake the slope fades out beyond and does
    /// not end at once, and less than no light goes on straight.
    #[inline(always)]
    pub fn code(&self, light: f32) -> [f32; 2] {
        const FADED_OUT: f32 = 1.5;
        let at = light * STEPS as f32;
        if at >= STEPS as f32 {
            let left = ((FADED_OUT - light) / (FADED_OUT - 1.0)).max(0.0);
            return [1.0, self.table[STEPS][1] * left];
        }
        if at < 0.0 {
            let slope = self.table[0][1];
            return [light * slope, slope];
        }
        let index = at as usize;
        let part = at - index as f32;
        let (low, high) = (self.table[index], self.table[index + 1]);
        [low[0] + part * (high[0] - low[0]), low[1] + part * (high[1] - low[1])]
    }

    /// The light that has this code.
    pub fn light(&self, code: f64) -> f64 {
        match self.mixing {
            Mixing::Codes => code,
            Mixing::Light if code <= 0.040_45 => code / 12.92,
            Mixing::Light => ((code + 0.055) / 1.055).powf(2.4),
        }
    }
}
