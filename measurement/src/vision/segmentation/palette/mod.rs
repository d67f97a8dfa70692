//! Advice on tape, before the recording: can the marked colours be distinguished ([`verdict`]), and which tape would
//! be separated best in an empty box ([`advice`]) (METHOD 2, *palette advice*; T 6.2 did it by eye)?
//!
//! | file | answers |
//! |---|---|
//! | [`light`] | how a colour changes with the light |
//! | [`confusion`] | how the marked colours are confused, each rectangle classified by the others |
//! | [`margin`] | how much colours may shift before one is classified as another |
//! | [`verdict`] | good, at risk or bad, and why |
//! | [`advice`] | tapes ranked for a frame of the empty box |
//!
//! Distances are in *steps*: 1/255 of the full range, in the classifier's own space, with luma weighted 0.4 relative
//! to a difference. Noise and compression move a colour by about 3 steps.

pub mod advice;
pub mod confusion;
pub mod light;
pub mod margin;
pub mod verdict;

pub use margin::{ColourSeparation, Margin, colour_separations};
pub use verdict::{FalseArea, PaletteGrade, TapeProblem, TapeVerdict, verdicts};

/// Steps in the classifier's full range.
const STEPS: f64 = 255.0;

/// Distance of two colours in the classifier's space, steps.
fn distance_steps(a: [f32; 3], b: [f32; 3]) -> f64 {
    let square: f32 = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum();
    f64::from(square).sqrt() * STEPS
}

/// The quantile of the values at this share; `None` if there are none. Sorts the values.
fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let index = (share * values.len() as f64) as usize;
    values.get(index.min(values.len().saturating_sub(1))).copied()
}

#[cfg(test)]
mod tests;
