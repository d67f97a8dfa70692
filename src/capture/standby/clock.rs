//! The server's time, from the last exchange with it.
//!
//! The clock of the computer may be set while the server is away. Its step shows against the time since the computer was
//! started, which nothing sets; the offset then changes by the step, and the server's time continues.

use crate::domain::box_agent::state::ClockState;

/// Difference of the two clocks that is no step, ms: the clock is read twice, and time services correct small errors.
const MAX_UNSTEPPED_MS: i64 = 1_000;
/// How fast a time service may slew a clock: the kernel's limit is 500 parts per million.
const MAX_SLEW_PPM: i64 = 500;

/// A moment by the two clocks of this computer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ComputerTime {
    /// What its clock shows, epoch ms.
    pub(super) shown_ms: i64,
    /// Time since it was started, ms.
    pub(super) since_boot_ms: i64,
}

/// A measured offset, and when it was measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ServerClock {
    measured: ClockState,
    at: ComputerTime,
}

impl ServerClock {
    /// An offset that was measured now.
    pub(super) fn new(measured: ClockState, at: ComputerTime) -> Self {
        Self { measured, at }
    }

    /// By how much the clock was set since the measurement, ms; 0: not at all.
    pub(super) fn step_ms(&self, now: ComputerTime) -> i64 {
        let passed_ms = (now.since_boot_ms - self.at.since_boot_ms).max(0);
        let step_ms = now.shown_ms - self.at.shown_ms - passed_ms;
        let tolerance_ms = MAX_UNSTEPPED_MS + passed_ms.saturating_mul(MAX_SLEW_PPM) / 1_000_000;
        if step_ms.abs() <= tolerance_ms { 0 } else { step_ms }
    }

    /// The offset now.
    pub(super) fn state(&self, now: ComputerTime) -> ClockState {
        ClockState { offset_ms: self.measured.offset_ms - self.step_ms(now), ..self.measured }
    }

    /// The server's time, epoch ms.
    pub(super) fn now_ms(&self, now: ComputerTime) -> i64 {
        now.shown_ms + self.state(now).offset_ms
    }

    /// The server's time at a moment since the computer was started, also before the measurement, epoch ms.
    pub(super) fn at_ms(&self, since_boot_ms: i64) -> i64 {
        self.at.shown_ms + self.measured.offset_ms + since_boot_ms - self.at.since_boot_ms
    }

    /// The better of the known and a newly measured offset: the more precise one, until the clock is set.
    pub(super) fn better(self, measured: ClockState, now: ComputerTime) -> Self {
        let tolerance_ms = self.measured.uncertainty_ms + measured.uncertainty_ms + 50;
        let is_same = (self.measured.offset_ms - measured.offset_ms).abs() <= tolerance_ms;
        let keeps = is_same && self.step_ms(now) == 0 && self.measured.uncertainty_ms <= measured.uncertainty_ms;
        if keeps { self } else { Self::new(measured, now) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const BOOTED_MS: i64 = 1_800_000_000_000;
    const DAY_MS: i64 = 86_400_000;

    fn at(since_boot_ms: i64, step_ms: i64) -> ComputerTime {
        ComputerTime { shown_ms: BOOTED_MS + since_boot_ms + step_ms, since_boot_ms }
    }

    proptest! {
        /// However the clock is set while the server is away, the server's time continues.
        #[test]
        fn the_servers_time_goes_on_when_the_clock_is_set(
            offset_ms in -2 * DAY_MS..2 * DAY_MS, away_ms in 0..DAY_MS, step_ms in -2 * DAY_MS..2 * DAY_MS,
        ) {
            let clock = ServerClock::new(ClockState { offset_ms, uncertainty_ms: 5 }, at(60_000, 0));
            let off_ms = clock.now_ms(at(60_000 + away_ms, step_ms)) - (BOOTED_MS + 60_000 + away_ms + offset_ms);
            prop_assert!(off_ms.abs() <= 1_000 + away_ms / 2_000, "{off_ms}");
            if step_ms.abs() > 120_000 {
                prop_assert_eq!(off_ms, 0);
            }
        }
    }

    #[test]
    fn a_moment_before_the_first_measurement_gets_the_servers_time() {
        let clock = ServerClock::new(ClockState { offset_ms: 7_000, uncertainty_ms: 5 }, at(61_000, 0));
        assert_eq!(clock.at_ms(1_000), BOOTED_MS + 1_000 + 7_000);
    }

    #[test]
    fn a_clock_that_a_time_service_slews_is_not_taken_for_a_set_one() {
        let clock = ServerClock::new(ClockState { offset_ms: 40, uncertainty_ms: 5 }, at(0, 0));
        assert_eq!(clock.state(at(3_600_000, 1_500)).offset_ms, 40, "1.5 s in an hour");
        assert_eq!(clock.state(at(3_600_000, 60_000)).offset_ms, 40 - 60_000);
    }

    #[test]
    fn after_a_step_a_new_measurement_replaces_the_old_one() {
        let (old, new) =
            (ClockState { offset_ms: 0, uncertainty_ms: 2 }, ClockState { offset_ms: 3, uncertainty_ms: 9 });
        let clock = ServerClock::new(old, at(0, 0));
        assert_eq!(clock.better(new, at(1_000, 0)), clock, "the known one is more precise");
        let set = ClockState { offset_ms: -DAY_MS, uncertainty_ms: 9 };
        assert_eq!(clock.better(set, at(1_000, DAY_MS)).state(at(2_000, DAY_MS)), set);
        assert_eq!(clock.better(new, at(1_000, DAY_MS)).state(at(2_000, DAY_MS)), new, "it was set twice");
    }
}
