//! Which tape, and is it a good one? Before the recording: can the marked colours be told apart ([`verdict`]), and which
//! tape would stand apart best in an empty box ([`advice`]) (METHOD 2, *palette advice*; T 6.2 did it by eye).
//!
//! | file | answers |
//! |---|---|
//! | [`light`] | what a colour becomes when the light changes |
//! | [`confusion`] | the marked colours against each other, each rectangle judged by the others |
//! | [`margin`] | how much colours may shift before one is taken for another |
//! | [`verdict`] | good, at risk or bad, and why |
//! | [`advice`] | tapes ranked against a frame of the empty box |
//!
//! Distances are in *steps*: 1/255 of the full range, in the classifier's own space, where luma counts 0.4 of a
//! difference. Noise and compression move a colour by about 3 steps.

pub mod advice;
pub mod confusion;
pub mod light;
pub mod margin;
pub mod verdict;

pub use margin::{Apart, Margin, apart};
pub use verdict::{Cause, FalseArea, Grade, Verdict, verdicts};

/// Steps in the classifier's full range.
const STEPS: f64 = 255.0;

/// Distance of two colours in the classifier's space, steps.
fn distance_steps(a: [f32; 3], b: [f32; 3]) -> f64 {
    let square: f32 = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum();
    f64::from(square).sqrt() * STEPS
}

/// The value below which this share of all lies; `None` for none at all. Sorts.
fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let index = (share * values.len() as f64) as usize;
    values.get(index.min(values.len().saturating_sub(1))).copied()
}

#[cfg(test)]
mod tests;
