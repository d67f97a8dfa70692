//! When a live recording began. Its sender states it, by a clock that may be wrong: a small computer without a battery
//! begins at 1970 after a power cut.

use std::time::Duration;

use crate::domain::session::RecordedAtSource;
use crate::time::millis;

/// How long a sender can keep a recording before the server hears of it: a quarter of a year.
const MAX_SPOOLED: Duration = Duration::from_secs(90 * 86_400);

/// Difference between two clocks that are both right enough, ms.
const USUAL_SKEW_MS: i64 = 120_000;

/// How long before its arrival a recording may have begun for the service to vouch for its start: it takes less to connect
/// again after a short cut of the network, and a wrong clock shows.
const MAX_SEEN_DELAY_MS: i64 = 600_000;

/// True if the service knows the start of a live recording itself, because it arrived while it was made.
pub fn is_start_seen(began_at_ms: i64, arrival_ms: i64) -> bool {
    (arrival_ms - MAX_SEEN_DELAY_MS..=arrival_ms).contains(&began_at_ms)
}

/// True if a stated start that gave way to the arrival shows a clock that a person has to set.
pub fn is_clock_wrong(stated_ms: i64, arrival_ms: i64) -> bool {
    start_of_recording(stated_ms, arrival_ms).1 == RecordedAtSource::Arrival
        && !(arrival_ms..=arrival_ms + USUAL_SKEW_MS).contains(&stated_ms)
}

/// The start of a recording that a sender says began at `stated_ms`, and where it comes from. A start in the future, or
/// further back than [`MAX_SPOOLED`], is the fault of a clock, and the arrival takes its place. Rejected: to refuse the
/// recording, since a trainee would lose it by the fault of a clock.
pub fn start_of_recording(stated_ms: i64, arrival_ms: i64) -> (i64, RecordedAtSource) {
    match (arrival_ms - millis(MAX_SPOOLED)..=arrival_ms).contains(&stated_ms) {
        true => (stated_ms, RecordedAtSource::Claimed),
        false => (arrival_ms, RecordedAtSource::Arrival),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_impossible_start_gives_way_to_the_arrival() {
        const NOW_MS: i64 = 1_800_000_000_000;
        const DAY_MS: i64 = 86_400_000;
        for stated_ms in [NOW_MS, NOW_MS - 1, NOW_MS - 90 * DAY_MS] {
            assert_eq!(start_of_recording(stated_ms, NOW_MS), (stated_ms, RecordedAtSource::Claimed));
        }
        for stated_ms in [NOW_MS + 1, NOW_MS + 400 * DAY_MS, NOW_MS - 90 * DAY_MS - 1, 0, -DAY_MS] {
            assert_eq!(start_of_recording(stated_ms, NOW_MS), (NOW_MS, RecordedAtSource::Arrival), "{stated_ms}");
        }
        assert!(!is_clock_wrong(NOW_MS - DAY_MS, NOW_MS) && !is_clock_wrong(NOW_MS + 1000, NOW_MS));
        assert!(is_clock_wrong(NOW_MS + DAY_MS, NOW_MS) && is_clock_wrong(0, NOW_MS));
    }
}
