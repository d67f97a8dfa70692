//! Random numbers for resampling, seeded by the data themselves, so that the same data always give the same interval.

use rand::rngs::Xoshiro256PlusPlus;
use rand::{Rng, SeedableRng};

/// A stream of random numbers that the data determine.
pub(super) struct Resampler(Xoshiro256PlusPlus);

impl Resampler {
    /// Seeds the stream with these values, bit for bit (FNV-1a).
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
        const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;
        let bytes = values.into_iter().flat_map(|value| value.to_bits().to_le_bytes());
        let seed = bytes.fold(FNV_OFFSET, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(FNV_PRIME));
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    /// A number in `0..count`, all equally likely.
    pub fn pick(&mut self, count: usize) -> usize {
        ((u128::from(self.0.next_u64()) * count as u128) >> 64) as usize
    }

    /// Draws as many values as given, with replacement.
    pub fn resample(&mut self, values: &[f64]) -> Vec<f64> {
        values.iter().map(|_| values[self.pick(values.len())]).collect()
    }

    /// Puts the values into a random order (Fisher and Yates).
    pub fn shuffle(&mut self, values: &mut [f64]) {
        for last in (1..values.len()).rev() {
            values.swap(last, self.pick(last + 1));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_data_give_the_same_draws_and_others_other_ones() {
        let draws = |seed: &[f64]| {
            let mut chance = Resampler::of(seed.iter().copied());
            (0..20).map(|_| chance.pick(1000)).collect::<Vec<_>>()
        };
        assert_eq!(draws(&[1.0, 2.0]), draws(&[1.0, 2.0]));
        assert_ne!(draws(&[1.0, 2.0]), draws(&[2.0, 1.0]));
    }

    #[test]
    fn every_order_is_as_likely() {
        let mut chance = Resampler::of([6.0]);
        let mut seen = std::collections::BTreeMap::new();
        for _ in 0..6000 {
            let mut values = [0.0, 1.0, 2.0];
            chance.shuffle(&mut values);
            *seen.entry(values.map(|value| value as u8)).or_insert(0) += 1;
        }
        assert!(seen.len() == 6 && seen.values().all(|times| (880..1120).contains(times)), "{seen:?}");
    }
}
