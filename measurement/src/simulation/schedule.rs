//! Times of the frames: even, or uneven as in a live feed.

use crate::random::Dice;

/// Whether a camera takes its frames at even times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Evenness {
    /// One frame every `1/fps` s.
    Even,
    /// Each frame up to a quarter of a period early or late, and one in twenty-five lost: a webcam on a busy machine.
    Uneven,
}

/// Times of `count` frames, s, from 0, rounded to the recording's clock of `ticks_per_s`.
pub fn frame_times(count: usize, fps: f64, evenness: Evenness, seed: u64, ticks_per_s: f64) -> Vec<f64> {
    const LOST: f64 = 0.04;
    const EARLY_OR_LATE: f64 = 0.25;
    let mut dice = Dice::new(seed, "schedule");
    let mut period = 0;
    let mut next = || {
        let (mut shift, now) = (0.0, period);
        period += 1;
        if evenness == Evenness::Uneven && now > 0 {
            shift = dice.within(-EARLY_OR_LATE, EARLY_OR_LATE);
            period += usize::from(dice.chance(LOST));
        }
        ((now as f64 + shift) / fps * ticks_per_s).round() / ticks_per_s
    };
    (0..count).map(|_| next()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_even_camera_takes_a_frame_every_period() {
        assert_eq!(frame_times(3, 25.0, Evenness::Even, 1, 90_000.0), [0.0, 0.04, 0.08]);
    }

    #[test]
    fn an_uneven_camera_is_late_and_loses_frames_but_time_never_runs_back() {
        let times = frame_times(500, 25.0, Evenness::Uneven, 7, 90_000.0);
        let gaps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(gaps.iter().all(|gap| *gap > 0.0));
        let lost = gaps.iter().filter(|gap| **gap > 0.061).count();
        assert!((8..40).contains(&lost), "{lost} gaps of a lost frame");
    }
}
