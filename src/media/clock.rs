//! Computes the time of each frame from the container's time stamps.
//!
//! The rule, for every container: **`time_s` is presentation time, counted from the start that the container states for
//! the video stream.** An MP4 edit list or an MPEG-TS offset moves that start, so an earlier start of the sound or the
//! usual 1.4 s of a transport stream do not show. Without a stated start, the first frame is at 0. A first frame later
//! than the stated start (its key frame was cut off) keeps its delay. Gaps stay gaps, because the stamps exist to
//! describe dropped frames and variable rates.
//!
//! Times increase strictly for any stamps:
//!
//! | stamp | time |
//! |---|---|
//! | missing | one frame interval after the previous frame |
//! | not later than the previous frame, by at most [`JITTER_S`] (stamps too coarse, or doubled) | the same |
//! | earlier by more, or later by more than [`GAP_S`] (the recorder's clock was set) | the same, and all later stamps are shifted too |
//!
//! The interval is the container's frame rate; without one, the last interval seen; at first 1/25 s.

/// A step back of up to this time is disorder among neighbouring frames; beyond it, the clock was set.
pub(super) const JITTER_S: f64 = 1.0;

/// A step forward of up to this time is a gap in the recording; beyond it, the clock was set.
pub(super) const GAP_S: f64 = 600.0;

/// Frame rates that are plausible if a container states them, Hz.
const CREDIBLE_HZ: std::ops::RangeInclusive<f64> = 1.0..=1000.0;

/// Turns stamps into strictly increasing times.
#[derive(Clone, Debug)]
pub(super) struct FrameClock {
    seconds_per_tick: f64,
    start_ticks: Option<i64>,
    interval_s: f64,
    interval_is_stated: bool,
    shift_s: f64,
    last_s: Option<f64>,
}

impl FrameClock {
    /// A clock for stamps in units of `seconds_per_tick`, from the stream's stated start and frame rate.
    pub(super) fn new(seconds_per_tick: f64, start_ticks: Option<i64>, rate_hz: f64) -> Self {
        let stated = CREDIBLE_HZ.contains(&rate_hz);
        Self {
            seconds_per_tick,
            start_ticks,
            interval_s: if stated { 1.0 / rate_hz } else { 0.04 },
            interval_is_stated: stated,
            shift_s: 0.0,
            last_s: None,
        }
    }

    /// The time of the next frame, s.
    pub(super) fn time_s(&mut self, stamp: Option<i64>) -> f64 {
        let stamped = stamp.map(|ticks| self.stamped_s(ticks));
        let time_s = match (self.last_s, stamped) {
            (None, stamped) => self.first(stamped),
            (Some(last), Some(time)) if last < time && time - last <= GAP_S => {
                if !self.interval_is_stated {
                    self.interval_s = time - last;
                }
                time
            }
            (Some(last), stamped) => self.repair(last, stamped),
        };
        self.last_s = Some(time_s);
        time_s
    }

    /// Ticks of the stamps in seconds.
    pub(super) fn seconds(&self, ticks: i64) -> f64 {
        ticks as f64 * self.seconds_per_tick
    }

    fn stamped_s(&mut self, ticks: i64) -> f64 {
        let start = *self.start_ticks.get_or_insert(ticks);
        ticks.saturating_sub(start) as f64 * self.seconds_per_tick + self.shift_s
    }

    fn first(&mut self, stamped: Option<f64>) -> f64 {
        match stamped {
            Some(time) if (0.0..=GAP_S).contains(&time) => time,
            Some(time) => {
                self.shift_s -= time; // the stated start belongs to another clock
                0.0
            }
            None => 0.0,
        }
    }

    fn repair(&mut self, last: f64, stamped: Option<f64>) -> f64 {
        let time_s = last + self.interval_s;
        if let Some(stamped) = stamped.filter(|s| last - s > JITTER_S || s - last > GAP_S) {
            self.shift_s += time_s - stamped;
        }
        time_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn times(start: Option<i64>, rate_hz: f64, stamps: &[Option<i64>]) -> Vec<f64> {
        let mut clock = FrameClock::new(0.001, start, rate_hz);
        stamps.iter().map(|&s| (clock.time_s(s) * 1e6).round() / 1e6).collect()
    }

    #[test]
    fn times_count_from_the_stated_start_and_gaps_stay() {
        let stamps = [1400, 1440, 1600, 1640].map(Some);
        assert_eq!(times(Some(1400), 25.0, &stamps), [0.0, 0.04, 0.2, 0.24]);
    }

    #[test]
    fn a_first_frame_later_than_the_stated_start_keeps_its_lateness() {
        assert_eq!(times(Some(0), 25.0, &[Some(500), Some(540)]), [0.5, 0.54]);
    }

    #[test]
    fn without_a_stated_start_the_first_frame_is_at_zero() {
        assert_eq!(times(None, 25.0, &[Some(7000), Some(7040)]), [0.0, 0.04]);
    }

    #[test]
    fn without_any_stamp_frames_follow_at_the_stated_rate() {
        assert_eq!(times(None, 50.0, &[None, None, None]), [0.0, 0.02, 0.04]);
    }

    #[test]
    fn stamps_too_coarse_for_the_rate_fall_between_their_neighbours() {
        let stamps = [0, 0, 40, 40, 80].map(Some);
        assert_eq!(times(Some(0), 50.0, &stamps), [0.0, 0.02, 0.04, 0.06, 0.08]);
    }

    #[test]
    fn a_clock_set_back_continues_from_the_last_time() {
        let stamps = [9_000_000, 9_000_040, 100, 140, 180].map(Some);
        assert_eq!(times(Some(9_000_000), 25.0, &stamps), [0.0, 0.04, 0.08, 0.12, 0.16]);
    }

    #[test]
    fn one_wild_stamp_costs_its_own_frame_alone() {
        let stamps = [0, 40, 95_443_000, 120, 160].map(Some);
        assert_eq!(times(Some(0), 25.0, &stamps), [0.0, 0.04, 0.08, 0.12, 0.16]);
    }

    proptest! {
        #[test]
        fn times_are_finite_and_strictly_increase_for_any_stamps(
            start in prop::option::of(any::<i64>()),
            rate_hz in prop_oneof![Just(f64::NAN), Just(0.0), Just(-3.0), 0.5f64..2000.0],
            stamps in prop::collection::vec(prop::option::of(-1_000_000_000i64..1_000_000_000), 1..60),
        ) {
            let mut clock = FrameClock::new(0.001, start.map(|s| s % 1_000_000), rate_hz);
            let times: Vec<f64> = stamps.iter().map(|&s| clock.time_s(s)).collect();
            prop_assert!(times[0] >= 0.0);
            prop_assert!(times.windows(2).all(|pair| pair[0] < pair[1] && pair[1].is_finite()));
        }
    }
}
