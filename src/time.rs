//! Time, read from a [`Clock`] so that tests can set it.
//!
//! Times are `i64` milliseconds since 1970-01-01 UTC, named `…_ms`. Outside the process they are RFC 3339 text.

use std::fmt;
use std::future::Future;
use std::pin::Pin;
use std::str::FromStr;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use jiff::civil::Date;
use jiff::fmt::rfc2822::DateTimePrinter;
use jiff::tz::TimeZone;
use jiff::{Span, Timestamp};
use serde::{Deserialize, Serialize};
use tokio::sync::watch;

/// A clock that the whole process shares.
pub type SharedClock = Arc<dyn Clock>;

/// A wait for a point in time.
pub type Sleep = Pin<Box<dyn Future<Output = ()> + Send>>;

/// A source of time.
pub trait Clock: fmt::Debug + Send + Sync {
    /// The current time, epoch milliseconds.
    fn now_ms(&self) -> i64;

    /// Milliseconds since a fixed moment of this process. Setting the machine's clock does not change it, so use it to
    /// measure durations.
    fn monotonic_ms(&self) -> i64;

    /// Milliseconds since the machine was started, or another fixed moment. As [`Clock::monotonic_ms`], but it also counts
    /// the time during which the machine sleeps.
    fn since_boot_ms(&self) -> i64 {
        self.monotonic_ms()
    }

    /// Waits until this much time has passed on this clock.
    fn sleep(&self, duration: Duration) -> Sleep;
}

/// The machine's clock.
#[derive(Clone, Copy, Debug, Default)]
pub struct SystemClock;

impl Clock for SystemClock {
    #[expect(clippy::disallowed_methods, reason = "the one place that reads the machine's clock")]
    fn now_ms(&self) -> i64 {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        millis(since)
    }

    fn monotonic_ms(&self) -> i64 {
        static BEGAN: LazyLock<Instant> = LazyLock::new(Instant::now);
        millis(BEGAN.elapsed())
    }

    fn since_boot_ms(&self) -> i64 {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::Boottime);
        now.tv_sec.saturating_mul(1000).saturating_add(now.tv_nsec / 1_000_000)
    }

    fn sleep(&self, duration: Duration) -> Sleep {
        Box::pin(tokio::time::sleep(duration))
    }
}

/// A clock for tests: it moves only by [`ManualClock::advance`], [`ManualClock::set_forward`] and
/// [`ManualClock::set_back`].
#[derive(Debug)]
pub struct ManualClock {
    monotonic_ms: watch::Sender<i64>,
    /// Added to `monotonic_ms`, this is the time that the clock shows.
    offset_ms: AtomicI64,
}

impl ManualClock {
    /// A clock that shows this time.
    pub fn at(now_ms: i64) -> Arc<Self> {
        Arc::new(Self { monotonic_ms: watch::Sender::new(0), offset_ms: AtomicI64::new(now_ms) })
    }

    /// Lets time pass and wakes the sleepers whose time has come.
    pub fn advance(&self, duration: Duration) {
        self.monotonic_ms.send_modify(|passed_ms| *passed_ms += millis(duration));
    }

    /// Sets the clock forward, as an administrator might, without letting time pass.
    pub fn set_forward(&self, duration: Duration) {
        self.offset_ms.fetch_add(millis(duration), Ordering::AcqRel);
    }

    /// Sets the clock back, without letting time pass.
    pub fn set_back(&self, duration: Duration) {
        self.offset_ms.fetch_sub(millis(duration), Ordering::AcqRel);
    }
}

impl Clock for ManualClock {
    fn now_ms(&self) -> i64 {
        self.offset_ms.load(Ordering::Acquire) + self.monotonic_ms()
    }

    fn monotonic_ms(&self) -> i64 {
        *self.monotonic_ms.borrow()
    }

    fn sleep(&self, duration: Duration) -> Sleep {
        let mut hands = self.monotonic_ms.subscribe();
        let until_ms = self.monotonic_ms() + millis(duration);
        Box::pin(async move {
            if hands.wait_for(|passed_ms| *passed_ms >= until_ms).await.is_err() {
                std::future::pending::<()>().await; // the clock was dropped: the time is never reached
            }
        })
    }
}

/// A duration in whole milliseconds.
pub fn millis(duration: Duration) -> i64 {
    i64::try_from(duration.as_millis()).unwrap_or(i64::MAX)
}

/// Epoch milliseconds as RFC 3339 text in UTC, such as `2026-11-21T20:14:00.123Z`. A time outside the years −9999 to
/// 9999 becomes the nearest time inside.
pub fn to_rfc3339(time_ms: i64) -> String {
    let nearest = if time_ms < 0 { Timestamp::MIN } else { Timestamp::MAX };
    Timestamp::from_millisecond(time_ms).unwrap_or(nearest).to_string()
}

/// Epoch milliseconds as an HTTP date, such as `Sat, 21 Nov 2026 20:14:00 GMT`.
pub fn to_http_date(time_ms: i64) -> String {
    let clamped = time_ms.clamp(0, Timestamp::MAX.as_millisecond());
    let printed = Timestamp::from_millisecond(clamped).map(|t| DateTimePrinter::new().timestamp_to_rfc9110_string(&t));
    printed.ok().and_then(Result::ok).unwrap_or_default() // clamped: cannot fail
}

/// Start of the day that contains this time, in the machine's time zone, epoch milliseconds.
pub fn start_of_day_ms(time_ms: i64) -> i64 {
    const DAY_MS: i64 = 24 * 3600 * 1000;
    let here = Timestamp::from_millisecond(time_ms).map(|time| time.to_zoned(TimeZone::system()));
    let began = here.and_then(|here| here.start_of_day()).map(|began| began.timestamp().as_millisecond());
    began.unwrap_or(time_ms - DAY_MS) // only at the limits of the representable range
}

/// A calendar day in the machine's time zone, such as `2026-11-21`. For due dates, which are days and not moments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(try_from = "String", into = "String")]
#[schema(value_type = String, format = "date")]
pub struct Day(Date);

/// Text that is not a day.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("not a day: expected one such as 2026-11-21")]
pub struct NotADay;

impl Day {
    /// The day that contains this time.
    pub fn of(time_ms: i64) -> Self {
        let nearest = if time_ms < 0 { Date::MIN } else { Date::MAX };
        Self(Timestamp::from_millisecond(time_ms).map_or(nearest, |time| time.to_zoned(TimeZone::system()).date()))
    }

    /// This many days later.
    pub fn plus_days(self, days: u32) -> Self {
        let later = Span::new().try_days(days).map(|days| self.0.saturating_add(days));
        Self(later.unwrap_or(Date::MAX))
    }

    /// The day's first moment, epoch milliseconds.
    pub fn start_ms(self) -> i64 {
        let began = self.0.to_zoned(TimeZone::system()).map(|began| began.timestamp().as_millisecond());
        began.unwrap_or(i64::MAX) // only at the end of the representable range
    }
}

impl FromStr for Day {
    type Err = NotADay;

    /// Accepts only the displayed form, so that days sort correctly as text.
    fn from_str(text: &str) -> Result<Self, NotADay> {
        let day = text.parse().map(Self).map_err(|_| NotADay)?;
        if day.to_string() == text && text.len() == 10 { Ok(day) } else { Err(NotADay) }
    }
}

impl TryFrom<String> for Day {
    type Error = NotADay;

    fn try_from(text: String) -> Result<Self, NotADay> {
        text.parse()
    }
}

impl From<Day> for String {
    fn from(day: Day) -> String {
        day.to_string()
    }
}

impl fmt::Display for Day {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// RFC 3339 text with any offset, as epoch milliseconds.
pub fn from_rfc3339(text: &str) -> Option<i64> {
    text.parse::<Timestamp>().ok().map(|t| t.as_millisecond())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_survive_their_text() {
        for time_ms in [0, 1, -1, 1_795_292_040_123] {
            assert_eq!(from_rfc3339(&to_rfc3339(time_ms)), Some(time_ms));
        }
        assert_eq!(from_rfc3339("2026-11-21T21:14:00+01:00"), Some(1_795_292_040_000));
        assert_eq!(from_rfc3339("yesterday"), None);
    }

    #[test]
    fn http_dates_are_those_of_the_standard() {
        assert_eq!(to_http_date(784_111_777_000), "Sun, 06 Nov 1994 08:49:37 GMT");
    }

    #[test]
    fn every_moment_lies_between_the_start_of_its_day_and_the_next() {
        const HOUR_MS: i64 = 3600 * 1000;
        let began_ms = start_of_day_ms(1_795_292_040_123);
        assert!((0..25 * HOUR_MS).contains(&(1_795_292_040_123 - began_ms)), "{began_ms}");
        assert_eq!((start_of_day_ms(began_ms), start_of_day_ms(began_ms + HOUR_MS)), (began_ms, began_ms));
        assert!(start_of_day_ms(began_ms - 1) < began_ms && start_of_day_ms(began_ms + 26 * HOUR_MS) > began_ms);
    }

    #[test]
    fn a_day_contains_its_first_moment_and_not_the_one_before() {
        let day: Day = "2026-02-27".parse().unwrap();
        assert_eq!(Day::of(day.start_ms()), day);
        assert_eq!(Day::of(day.start_ms() - 1).plus_days(1), day);
        assert_eq!(day.plus_days(2).to_string(), "2026-03-01");
        assert!(day < day.plus_days(1) && day.plus_days(u32::MAX) > day);
    }

    #[test]
    fn a_day_has_one_spelling() {
        for text in ["2026-02-29", "2026-2-27", "2026-02-27T10:00", "20260227", "-002026-02-27", "today", ""] {
            assert_eq!(text.parse::<Day>(), Err(NotADay), "{text}");
        }
        assert_eq!(serde_json::to_string(&"2026-02-27".parse::<Day>().unwrap()).unwrap(), "\"2026-02-27\"");
    }

    #[test]
    fn every_time_can_be_written() {
        assert!(!to_rfc3339(i64::MIN).is_empty() && !to_rfc3339(i64::MAX).is_empty());
    }

    #[tokio::test]
    async fn a_sleep_ends_when_the_clock_reaches_its_time_and_not_before() {
        let clock = ManualClock::at(1_000);
        let mut sleep = clock.sleep(Duration::from_millis(10));
        clock.advance(Duration::from_millis(9));
        assert!(futures_util::poll!(&mut sleep).is_pending());
        clock.advance(Duration::from_millis(1));
        sleep.await;
        assert_eq!(clock.now_ms(), 1_010);
    }

    #[tokio::test]
    async fn setting_the_clock_forward_lets_no_time_pass() {
        let clock = ManualClock::at(1_000);
        let mut sleep = clock.sleep(Duration::from_millis(10));
        clock.set_forward(Duration::from_secs(1));
        assert!(futures_util::poll!(&mut sleep).is_pending());
        assert_eq!((clock.now_ms(), clock.monotonic_ms()), (2_000, 0));
    }
}
