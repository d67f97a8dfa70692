//! Changes of the light, and their effect on a colour: more or less of it, or warmer or cooler.
//!
//! Cameras choose exposure and white balance by themselves, and choose again when a glove enters the picture. The
//! gains for another colour temperature are those between two black bodies (Wien's approximation, green kept). 500 K
//! at 5500 K makes blue a tenth stronger or weaker relative to red, about what an automatic white balance drifts.

use crate::vision::frame::ColourEncoding;

/// Change of exposure, as a share of the light.
const EXPOSURE: f64 = 0.3;

/// Assumed colour temperature of the recording, and its drift, K.
const TEMPERATURE_K: [f64; 2] = [5500.0, 500.0];

/// Exponent between gamma-coded and linear light; close to every camera's curve over the range of a tape.
const GAMMA: f64 = 2.2;

/// Light condition for judging colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LightCondition {
    /// As it was when the colours were marked.
    AsMarked,
    /// 30 % less of it.
    Darker,
    /// 30 % more of it.
    Brighter,
    /// 500 K warmer.
    Warmer,
    /// 500 K cooler.
    Cooler,
}

impl LightCondition {
    /// All conditions; the first is the light when the colours were marked.
    pub const ALL: [LightCondition; 5] = [
        LightCondition::AsMarked,
        LightCondition::Darker,
        LightCondition::Brighter,
        LightCondition::Warmer,
        LightCondition::Cooler,
    ];

    /// Human-readable name.
    pub fn name(self) -> &'static str {
        match self {
            LightCondition::AsMarked => "as marked",
            LightCondition::Darker => "30 % darker",
            LightCondition::Brighter => "30 % brighter",
            LightCondition::Warmer => "500 K warmer",
            LightCondition::Cooler => "500 K cooler",
        }
    }

    /// A gamma-coded `[Y', Pb, Pr]` as seen in this light. Values that the sensor cannot represent are clipped.
    pub fn apply_to(self, colour: [f64; 3], encoding: ColourEncoding) -> [f64; 3] {
        if self == LightCondition::AsMarked {
            return colour;
        }
        let gains = self.gains().map(|gain| gain.powf(1.0 / GAMMA));
        let rgb = encoding.rgb_from_colour() * nalgebra::Vector3::from(colour);
        encoding.colour_of_rgb([0, 1, 2].map(|i| (rgb[i] * gains[i]).clamp(0.0, 1.0)))
    }

    /// Gains of linear red, green and blue.
    fn gains(self) -> [f64; 3] {
        let [from, drift] = TEMPERATURE_K;
        match self {
            LightCondition::AsMarked => [1.0; 3],
            LightCondition::Darker => [1.0 - EXPOSURE; 3],
            LightCondition::Brighter => [1.0 + EXPOSURE; 3],
            LightCondition::Warmer => black_body_gains(from, from - drift),
            LightCondition::Cooler => black_body_gains(from, from + drift),
        }
    }
}

/// Gains of red, green and blue between black bodies of two temperatures, with green kept.
fn black_body_gains(from_k: f64, to_k: f64) -> [f64; 3] {
    const SECOND_RADIATION_NM_K: f64 = 14_387_769.0; // hc/k, CODATA 2018
    const RED_GREEN_BLUE_NM: [f64; 3] = [600.0, 550.0, 450.0];
    let strength = |nm: f64| (SECOND_RADIATION_NM_K / nm * (1.0 / from_k - 1.0 / to_k)).exp();
    RED_GREEN_BLUE_NM.map(|nm| strength(nm) / strength(RED_GREEN_BLUE_NM[1]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::frame::{Matrix, Range};

    const ENCODING: ColourEncoding = ColourEncoding { range: Range::Limited, matrix: Matrix::Bt709 };

    fn rgb_in(light: LightCondition, rgb: [f64; 3]) -> nalgebra::Vector3<f64> {
        let seen = light.apply_to(ENCODING.colour_of_rgb(rgb), ENCODING);
        ENCODING.rgb_from_colour() * nalgebra::Vector3::from(seen)
    }

    #[test]
    fn exposure_scales_all_and_temperature_turns_red_against_blue() {
        let grey = [0.5; 3];
        let dark = rgb_in(LightCondition::Darker, grey);
        assert!((dark.max() - dark.min()).abs() < 1e-9);
        assert!((dark[0].powf(GAMMA) / 0.5f64.powf(GAMMA) - 0.7).abs() < 1e-9);
        let (warm, cool) = (rgb_in(LightCondition::Warmer, grey), rgb_in(LightCondition::Cooler, grey));
        assert!(warm[0] > warm[1] && warm[1] > warm[2], "{warm}");
        assert!(cool[0] < cool[1] && cool[1] < cool[2], "{cool}");
    }

    #[test]
    fn more_light_than_the_sensor_shows_is_white() {
        assert!((rgb_in(LightCondition::Brighter, [1.0; 3]) - nalgebra::Vector3::repeat(1.0)).norm() < 1e-9);
    }
}
