//! Curves from light to codes. Blur and motion mix *light*, but a file holds codes, which are about the 1/2.2nd power
//! of light.
//!
//! Across a blurred edge the codes are therefore not a blend of both sides' codes: the brighter side seems to reach
//! too far, by 0.2 pixel for a sharp border and by a whole pixel for a strongly blurred one. An edge model must
//! therefore mix light and then encode it.

use super::lanes::Lanes;

/// What blur mixes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BlurDomain {
    /// Light, as in every lens and shutter; codes follow from it by the sRGB curve (IEC 61966-2-1).
    Light,
    /// The codes themselves, as in pictures that were rendered and blurred afterwards.
    Codes,
}

/// A curve from light (1: the brightest that is recorded) to gamma-coded value (0..1), with its slope. It is a
/// straight line below [`Tone::straight_until`], and a polynomial of the light's fourth root above, which takes two
/// square roots and no branch.
pub struct Tone {
    blur_domain: BlurDomain,
    straight_until: f32,
    straight_slope: f32,
    /// Coefficients for the fourth root, the constant first.
    polynomial: [f32; 5],
}

/// The sRGB curve, within 3.5e-5 of the standard's.
static LIGHT: Tone = Tone {
    blur_domain: BlurDomain::Light,
    straight_until: 0.003_130_8,
    straight_slope: 12.92,
    polynomial: [-0.064_612_27, 0.196_140_18, 1.122_674_7, -0.335_499_95, 0.081_332_05],
};
static CODES: Tone = Tone {
    blur_domain: BlurDomain::Codes,
    straight_until: 0.01,
    straight_slope: 1.0,
    polynomial: [0.0, 0.0, 0.0, 0.0, 1.0],
};

impl Tone {
    /// The curve for this blur domain.
    pub fn of(mixing: BlurDomain) -> &'static Self {
        match mixing {
            BlurDomain::Light => &LIGHT,
            BlurDomain::Codes => &CODES,
        }
    }

    /// Codes and slopes of light. Light above 1 is cut off, but the slope fades out beyond it instead of ending at
    /// once, which helps solvers; below 0 the straight line continues. Lane by lane without branches, for the
    /// tracker's innermost loop.
    #[inline(always)]
    pub fn codes(&self, light: Lanes) -> [Lanes; 2] {
        const FADED_OUT: f32 = 1.5;
        let [c0, c1, c2, c3, c4] = self.polynomial;
        let curved = light.at_least(self.straight_until);
        let square = curved.at_most(1.0).sqrt();
        let root = square.sqrt();
        let code = (((root * c4 + c3) * root + c2) * root + c1) * root + c0;
        let by_root = ((root * (4.0 * c4) + 3.0 * c3) * root + 2.0 * c2) * root + c1;
        let left = ((light - FADED_OUT) * (-1.0 / (FADED_OUT - 1.0))).at_least(0.0).at_most(1.0);
        let slope = by_root * left / (root * square * 4.0);
        [code + (light - curved) * self.straight_slope, slope]
    }

    /// Code of this light.
    pub fn code(&self, light: f64) -> f64 {
        f64::from(self.codes(Lanes::all(light as f32))[0].0[0])
    }

    /// Light of this code.
    pub fn light(&self, code: f64) -> f64 {
        match self.blur_domain {
            BlurDomain::Codes => code,
            BlurDomain::Light if code <= 0.040_45 => code / 12.92,
            BlurDomain::Light => ((code + 0.055) / 1.055).powf(2.4),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coded_light_is_the_light_again() {
        for mixing in [BlurDomain::Light, BlurDomain::Codes] {
            let tone = Tone::of(mixing);
            for step in 0..=1000 {
                let code = f64::from(step) / 1000.0;
                let there_and_back = tone.code(tone.light(code));
                assert!((there_and_back - code).abs() < 5e-5, "{mixing:?} {code}: {there_and_back}");
            }
        }
    }

    #[test]
    fn the_slope_is_the_curves_own() {
        const STEP: f64 = 1e-3;
        for mixing in [BlurDomain::Light, BlurDomain::Codes] {
            let tone = Tone::of(mixing);
            for light in [-0.1_f64, 0.001, 0.02, 0.2, 0.5, 0.9] {
                let step = STEP * light.abs();
                let slope = (tone.code(light + step) - tone.code(light - step)) / (2.0 * step);
                assert!(
                    (slope / f64::from(tone.codes(Lanes::all(light as f32))[1].0[0]) - 1.0).abs() < 0.02,
                    "{mixing:?} {light}: {slope}"
                );
            }
        }
    }

    #[test]
    fn more_than_the_brightest_is_cut_off() {
        assert!((Tone::of(BlurDomain::Light).code(1.3) - 1.0).abs() < 5e-5);
        assert_eq!(Tone::of(BlurDomain::Light).codes(Lanes::all(1.6))[1], Lanes::ZERO);
    }
}
