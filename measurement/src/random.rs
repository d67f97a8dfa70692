//! Reproducible random numbers: a fixed generator (xoshiro256++) with one independent stream per purpose.
//!
//! The standard generator of the `rand` crate may change between releases; scenes and error bars must not change with
//! it.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{Rng, SeedableRng};

/// One stream of random numbers.
#[derive(Clone, Debug)]
pub struct Dice(Xoshiro256PlusPlus);

impl Dice {
    /// The stream of this seed for this purpose. Streams with other purposes are independent of it.
    pub fn new(seed: u64, purpose: &str) -> Self {
        const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
        const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;
        let fold = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(FNV_PRIME);
        let hash = seed.to_le_bytes().into_iter().chain(purpose.bytes()).fold(FNV_OFFSET, fold);
        Self(Xoshiro256PlusPlus::seed_from_u64(hash))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A number from `low..high`, uniformly distributed.
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        let unit = (self.bits() >> 11) as f64 / (1u64 << 53) as f64;
        low + (high - low) * unit
    }

    /// A standard normal number (Box–Muller).
    pub fn gauss(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.within(0.0, 1.0)).ln()).sqrt();
        radius * self.within(0.0, TAU).cos()
    }

    /// Three independent standard normal numbers.
    pub fn gauss3(&mut self) -> Vector3<f64> {
        Vector3::new(self.gauss(), self.gauss(), self.gauss())
    }

    /// True with probability `share`.
    pub fn chance(&mut self, share: f64) -> bool {
        self.within(0.0, 1.0) < share
    }

    /// A number from `0..count`; 0 if `count` is 0.
    pub fn pick(&mut self, count: usize) -> usize {
        (self.within(0.0, count as f64) as usize).min(count.saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_gives_the_published_numbers_of_xoshiro256_plus_plus() {
        // First outputs of the reference implementation, with the state filled by SplitMix64 from 0.
        let mut generator = Xoshiro256PlusPlus::seed_from_u64(0);
        let first = [generator.next_u64(), generator.next_u64()];
        assert_eq!(first, [5_987_356_902_031_041_503, 7_051_070_477_665_621_255]);
    }

    #[test]
    fn purposes_do_not_share_a_stream() {
        assert_ne!(Dice::new(1, "motion").bits(), Dice::new(1, "board").bits());
        assert_eq!(Dice::new(1, "motion").bits(), Dice::new(1, "motion").bits());
    }

    #[test]
    fn gauss_has_mean_0_and_deviation_1() {
        let mut dice = Dice::new(3, "moments");
        let draws: Vec<f64> = (0..20_000).map(|_| dice.gauss()).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let square = draws.iter().map(|d| d * d).sum::<f64>() / draws.len() as f64;
        assert!(mean.abs() < 0.03 && (square - 1.0).abs() < 0.03, "mean {mean}, mean square {square}");
    }
}
