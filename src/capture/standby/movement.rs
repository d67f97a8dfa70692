//! The first movement in a picture that was still: it starts a recording by itself.
//!
//! A camera at rest gives pictures that differ by noise, and by flicker of the light, alone. So the detector first learns
//! the picture at rest: mean and spread of each block of the picture over a second, longer with a slow camera. A block has
//! changed if it differs from its rest by more than six times its spread. Movement is a change of two neighbouring blocks
//! in three pictures in succession. A change of half of the picture is none: the light was switched on, or the camera was
//! pushed, and the detector learns again.

use crate::media::{BLOCK_COLUMNS, BLOCK_ROWS};

/// Shortest time over which the picture at rest is learned, s: some fifty periods of the flicker of lamps.
const LEARN_S: f64 = 1.0;
/// Fewest pictures that a spread is estimated from: it is right to a quarter then. A camera with less than eight pictures a
/// second is looked at for longer.
const MIN_LEARNED: usize = 8;
/// A block moved while it was learned if its spread is this many times that of the median block. Noise differs by less
/// between blocks: that of light grows with the root of the brightness.
const MAX_SPREAD_RATIO: f32 = 4.0;
/// Least spread of a block, codes: pictures are coded in whole codes, and JPEG rounds further.
const MIN_SPREAD: f32 = 0.5;
/// A change beyond this many times the spread. Of 768 blocks at 60 pictures a second, normal noise exceeds it once in
/// three hours, in one block of one picture.
const CHANGE_SPREADS: f32 = 6.0;
/// Pictures in succession that must have changed.
const MIN_PICTURES: u32 = 3;
/// A change of more than this share of the picture is one of the light or of the camera.
const MAX_CHANGED_SHARE: f64 = 0.5;
/// Time constant of the rest as it follows slow changes of the light, s.
const FOLLOW_S: f64 = 10.0;
/// Least brightness of a block that the brightness of pictures is compared in, codes.
const MIN_COMPARED: f32 = 10.0;

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PictureMotion {
    /// The picture at rest is being learned.
    Settling,
    /// Nothing moves.
    Still,
    /// Something moves.
    Moves,
}

/// Finds the first movement in pictures.
#[derive(Debug, Default)]
pub(super) struct MovementDetector {
    /// Pictures that the rest is learned from, with their times, s.
    learned: Vec<(f64, Vec<f32>)>,
    rest: Option<Rest>,
}

/// The picture at rest.
#[derive(Debug)]
struct Rest {
    /// Mean and spread of each block, codes.
    blocks: Vec<(f32, f32)>,
    /// Time of the last picture, s.
    last_s: f64,
    /// Pictures in succession that have changed.
    changed: u32,
}

impl MovementDetector {
    /// Looks at the next picture: its time, s, and the mean of each of its blocks. A picture that is not later than the one
    /// before begins anew: the camera was opened again.
    pub(super) fn add(&mut self, time_s: f64, blocks: Vec<f32>) -> PictureMotion {
        let last_s = self.rest.as_ref().map(|rest| rest.last_s).or(self.learned.last().map(|(at_s, _)| *at_s));
        if last_s.is_some_and(|last_s| time_s <= last_s) {
            *self = Self::default();
        }
        let Some(rest) = &mut self.rest else {
            self.learn(time_s, blocks);
            return if self.rest.is_some() { PictureMotion::Still } else { PictureMotion::Settling };
        };
        match rest.look(time_s, &blocks) {
            Some(motion) => motion,
            None => {
                *self = Self::default();
                self.learn(time_s, blocks);
                PictureMotion::Settling
            }
        }
    }

    fn learn(&mut self, time_s: f64, blocks: Vec<f32>) {
        self.learned.push((time_s, blocks));
        let of_time = self.learned.iter().rposition(|(at_s, _)| *at_s <= time_s - LEARN_S);
        let of_count = self.learned.len().checked_sub(MIN_LEARNED);
        let (Some(of_time), Some(of_count)) = (of_time, of_count) else { return };
        self.learned.drain(..of_time.min(of_count));
        self.rest = Rest::of(&self.learned);
        if self.rest.is_some() {
            self.learned.clear();
        }
    }
}

impl Rest {
    /// The picture at rest; `None` if something moved.
    fn of(learned: &[(f64, Vec<f32>)]) -> Option<Self> {
        let (last_s, count) = (learned.last()?.0, learned.len() as f32);
        let of_block = |i: usize| {
            let values = || learned.iter().map(|(_, blocks)| blocks[i]);
            let mean = values().sum::<f32>() / count;
            let variance = values().map(|value| (value - mean).powi(2)).sum::<f32>() / (count - 1.0).max(1.0);
            (mean, variance.sqrt().max(MIN_SPREAD))
        };
        let mut blocks: Vec<(f32, f32)> = (0..BLOCK_COLUMNS * BLOCK_ROWS).map(of_block).collect();
        let usual = median(blocks.iter().map(|(_, spread)| *spread));
        if has_neighbours(&blocks.iter().map(|(_, spread)| *spread > MAX_SPREAD_RATIO * usual).collect::<Vec<_>>()) {
            return None;
        }
        for (_, spread) in &mut blocks {
            *spread = spread.max(usual);
        }
        Some(Self { blocks, last_s, changed: 0 })
    }

    /// Compares a picture; `None` if the rest has to be learned again.
    fn look(&mut self, time_s: f64, picture: &[f32]) -> Option<PictureMotion> {
        let gain = self.gain(picture);
        let pairs = || self.blocks.iter().zip(picture);
        let has_changed: Vec<bool> =
            pairs().map(|((mean, spread), value)| (value * gain - mean).abs() > CHANGE_SPREADS * spread).collect();
        let count = has_changed.iter().filter(|changed| **changed).count();
        if count as f64 > MAX_CHANGED_SHARE * has_changed.len() as f64 {
            return None;
        }
        let share = (1.0 - (-(time_s - self.last_s) / FOLLOW_S).exp()) as f32;
        for ((rest, value), changed) in self.blocks.iter_mut().zip(picture).zip(&has_changed) {
            if !changed {
                rest.0 += share * (value - rest.0);
            }
        }
        self.last_s = time_s;
        self.changed = if has_neighbours(&has_changed) { self.changed + 1 } else { 0 };
        Some(if self.changed >= MIN_PICTURES { PictureMotion::Moves } else { PictureMotion::Still })
    }

    /// The factor that gives a picture the brightness of the rest: automatic exposure changes the whole picture.
    fn gain(&self, picture: &[f32]) -> f32 {
        let bright = self.blocks.iter().zip(picture).filter(|((mean, _), value)| mean.min(**value) >= MIN_COMPARED);
        let ratios: Vec<f32> = bright.map(|((mean, _), value)| mean / value).collect();
        if ratios.len() * 2 < self.blocks.len() { 1.0 } else { median(ratios) }
    }
}

/// True if two blocks side by side or one above the other are set.
fn has_neighbours(blocks: &[bool]) -> bool {
    let right = |i: usize| i % BLOCK_COLUMNS + 1 < BLOCK_COLUMNS && blocks[i + 1];
    let below = |i: usize| blocks.get(i + BLOCK_COLUMNS).copied().unwrap_or_default();
    (0..blocks.len()).any(|i| blocks[i] && (right(i) || below(i)))
}

fn median(values: impl IntoIterator<Item = f32>) -> f32 {
    let mut sorted: Vec<f32> = values.into_iter().collect();
    sorted.sort_by(f32::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use rand::rngs::StdRng;
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// A mat of different brightness, with noise, at 25 pictures a second unless `interval_s` is changed.
    struct Scene {
        random: StdRng,
        noise: f32,
        interval_s: f64,
        time_s: f64,
    }

    impl Scene {
        fn new(noise: f32) -> Self {
            Self { random: StdRng::seed_from_u64(7), noise, interval_s: 0.04, time_s: 0.0 }
        }

        /// The next picture, with a tool over these blocks, in this light.
        fn next(&mut self, tool: &[usize], light: f32) -> (f64, Vec<f32>) {
            self.time_s += self.interval_s;
            let noise = |random: &mut StdRng| (0..12).map(|_| random.random::<f32>()).sum::<f32>() - 6.0;
            let block = |i: usize| {
                let level = if tool.contains(&i) { 30.0 } else { 60.0 + (i % 50) as f32 };
                level * light + self.noise * noise(&mut self.random)
            };
            (self.time_s, (0..BLOCK_COLUMNS * BLOCK_ROWS).map(block).collect())
        }
    }

    fn look(detector: &mut MovementDetector, (time_s, blocks): (f64, Vec<f32>)) -> PictureMotion {
        detector.add(time_s, blocks)
    }

    #[test]
    fn a_tool_that_moves_is_seen_within_three_pictures_and_noise_never() {
        for noise in [0.05, 1.0, 4.0] {
            let (mut scene, mut detector) = (Scene::new(noise), MovementDetector::default());
            let states: Vec<_> = (0..3000).map(|_| look(&mut detector, scene.next(&[], 1.0))).collect();
            let settled = states.iter().position(|state| *state == PictureMotion::Still).unwrap();
            assert!((25..=27).contains(&settled), "{noise}: {settled}");
            assert!(states[settled..].iter().all(|state| *state == PictureMotion::Still), "{noise}");
            let seen: Vec<_> = (0..3).map(|_| look(&mut detector, scene.next(&[300, 301, 332], 1.0))).collect();
            assert_eq!(seen, [PictureMotion::Still, PictureMotion::Still, PictureMotion::Moves], "{noise}");
        }
    }

    #[test]
    fn a_slow_camera_is_looked_at_for_longer() {
        for (rate_hz, pictures) in [(60.0, 61), (10.0, 11), (4.0, 8), (1.0, 8)] {
            let (mut scene, mut detector) = (Scene::new(1.0), MovementDetector::default());
            scene.interval_s = 1.0 / rate_hz;
            let settled = (1..100).find(|_| look(&mut detector, scene.next(&[], 1.0)) == PictureMotion::Still);
            assert!(settled.is_some_and(|seen| (pictures..=pictures + 1).contains(&seen)), "{rate_hz}: {settled:?}");
            let seen = (0..3).map(|_| look(&mut detector, scene.next(&[300, 301, 332], 1.0))).last();
            assert_eq!(seen, Some(PictureMotion::Moves), "{rate_hz}");
        }
    }

    #[test]
    fn one_picture_and_one_block_are_no_movement() {
        let (mut scene, mut detector) = (Scene::new(0.5), MovementDetector::default());
        (0..30).for_each(|_| {
            look(&mut detector, scene.next(&[], 1.0));
        });
        for tool in [&[300, 301][..], &[], &[300, 301], &[300, 301], &[], &[300], &[300], &[300], &[300]] {
            assert_eq!(look(&mut detector, scene.next(tool, 1.0)), PictureMotion::Still, "{tool:?}");
        }
    }

    #[test]
    fn the_picture_settles_only_when_nothing_moves() {
        let (mut scene, mut detector) = (Scene::new(0.5), MovementDetector::default());
        for step in 0..100 {
            let tool = [200 + step % 40, 201 + step % 40, 232 + step % 40];
            assert_eq!(look(&mut detector, scene.next(&tool, 1.0)), PictureMotion::Settling);
        }
        let settled = (0..60).position(|_| look(&mut detector, scene.next(&[], 1.0)) == PictureMotion::Still);
        assert!((24..=28).contains(&settled.unwrap()), "{settled:?}");
    }

    #[test]
    fn a_change_of_the_light_is_no_movement() {
        let (mut scene, mut detector) = (Scene::new(0.5), MovementDetector::default());
        (0..30).for_each(|_| {
            look(&mut detector, scene.next(&[], 1.0));
        });
        // The exposure changes by a tenth, then the evening comes, then a lamp is switched on.
        let slow = (0..1500).map(|i| 1.1 - 0.3 * i as f32 / 1500.0);
        for light in slow {
            assert_eq!(look(&mut detector, scene.next(&[], light)), PictureMotion::Still, "{light}");
        }
        for _ in 0..60 {
            assert_ne!(look(&mut detector, scene.next(&[], 2.4)), PictureMotion::Moves);
        }
        let seen: Vec<_> = (0..3).map(|_| look(&mut detector, scene.next(&[10, 11], 2.4))).collect();
        assert_eq!(seen.last(), Some(&PictureMotion::Moves));
    }

    #[test]
    fn a_camera_that_is_opened_again_is_learned_again() {
        let (mut scene, mut detector) = (Scene::new(0.5), MovementDetector::default());
        (0..30).for_each(|_| {
            look(&mut detector, scene.next(&[], 1.0));
        });
        scene.time_s = 0.0;
        assert_eq!(look(&mut detector, scene.next(&[10, 11], 1.0)), PictureMotion::Settling);
    }
}
