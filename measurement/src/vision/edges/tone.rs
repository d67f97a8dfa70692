//! The curve from light to codes: sRGB (IEC 61966-2-1). Lens and motion mix *light*, but a file holds codes, which are
//! about the 1/2.2nd power of light.
//!
//! Across a blurred edge the codes are therefore not a blend of both sides' codes: the brighter side seems to reach
//! too far, by 0.2 pixel for a sharp border and by a whole pixel for a strongly blurred one. An edge model must
//! therefore mix light and then encode it. A picture that was drawn by a program and blurred afterwards mixes codes
//! instead; its borders are found 0.2 to 0.3 pixel beside the drawn ones.

use super::lanes::Lanes;

/// The curve is a straight line below this light, and a polynomial of the light's fourth root above, which takes two
/// square roots and no branch. It is within 3.5e-5 of the standard's.
const STRAIGHT_UNTIL: f32 = 0.003_130_8;
const STRAIGHT_SLOPE: f32 = 12.92;
/// Coefficients for the fourth root, the constant first.
const POLYNOMIAL: [f32; 5] = [-0.064_612_27, 0.196_140_18, 1.122_674_7, -0.335_499_95, 0.081_332_05];

/// Codes (0..1) and slopes of light (1: the brightest that is recorded). Light above 1 is cut off, but the slope fades
/// out beyond it instead of ending at once, which helps solvers; below 0 the straight line continues. Lane by lane
/// without branches, for the tracker's innermost loop.
#[inline(always)]
pub fn codes(light: Lanes) -> [Lanes; 2] {
    const FADED_OUT: f32 = 1.5;
    let [c0, c1, c2, c3, c4] = POLYNOMIAL;
    let curved = light.at_least(STRAIGHT_UNTIL);
    let square = curved.at_most(1.0).sqrt();
    let root = square.sqrt();
    let code = (((root * c4 + c3) * root + c2) * root + c1) * root + c0;
    let by_root = ((root * (4.0 * c4) + 3.0 * c3) * root + 2.0 * c2) * root + c1;
    let left = ((light - FADED_OUT) * (-1.0 / (FADED_OUT - 1.0))).at_least(0.0).at_most(1.0);
    let slope = by_root * left / (root * square * 4.0);
    [code + (light - curved) * STRAIGHT_SLOPE, slope]
}

/// Code of this light.
pub fn code(light: f64) -> f64 {
    f64::from(codes(Lanes::all(light as f32))[0].0[0])
}

/// Light of this code.
pub fn light(code: f64) -> f64 {
    if code <= 0.040_45 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coded_light_is_the_light_again() {
        for step in 0..=1000 {
            let original = f64::from(step) / 1000.0;
            let there_and_back = code(light(original));
            assert!((there_and_back - original).abs() < 5e-5, "{original}: {there_and_back}");
        }
    }

    #[test]
    fn the_slope_is_the_curves_own() {
        const STEP: f64 = 1e-3;
        for light in [-0.1_f64, 0.001, 0.02, 0.2, 0.5, 0.9] {
            let step = STEP * light.abs();
            let slope = (code(light + step) - code(light - step)) / (2.0 * step);
            let stated = f64::from(codes(Lanes::all(light as f32))[1].0[0]);
            assert!((slope / stated - 1.0).abs() < 0.02, "{light}: {slope}");
        }
    }

    #[test]
    fn more_than_the_brightest_is_cut_off() {
        assert!((code(1.3) - 1.0).abs() < 5e-5);
        assert_eq!(codes(Lanes::all(1.6))[1], Lanes::ZERO);
    }
}
